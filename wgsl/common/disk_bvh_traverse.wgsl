// What a ray meets first among surfels as disks, in levels (The Bounced Z-buffer 4.2).
//
// On level l a pixel sees the disks of its sub-buffer, one in 4^l, with 2^l times their radius, and of the hits with them
// those at a distance within the level's shell about it. The levels' nearest hits are then merged into one.
//
// The importer declares the texture `nodes` (wgsl/disk_bounds.wgsl), `counters`, and `params` with a world_radius. Bindings
// from 16 on are this module's own.

#needs nodes counters params

#import bvh4_traverse
#import disk_bvh_layout

struct DiskParams {
  levels: u32,
  merge: u32,
  seed: u32,
  // Surfels that the cloud has room for.
  capacity: u32,
  // Where each level's nodes begin.
  level_first: array<vec4u, 2>,
  // Of level 0's shell: its outer bound in radii of the surfel.
  shell_radii: f32,
  padding0: u32,
  padding1: u32,
  padding2: u32,
}

const MERGE_NEAREST: u32 = 0u;
const MERGE_FINEST: u32 = 1u;

@group(0) @binding(16) var<uniform> disks: DiskParams;
// Centre and radius.
@group(0) @binding(17) var<storage, read> surfels: array<vec4f>;
@group(0) @binding(18) var<storage, read> sources: array<SurfelSource>;

// What the traversal that is under way looks into.
struct Search {
  level: u32,
  sub_buffer: u32,
  count: u32,
  // Of the receiver.
  normal: vec3f,
}

var<private> search: Search;

// From either side; FAR where the ray misses it or meets it outside of the level's shell.
fn meet_disk(ray: Ray, rank: u32) -> f32 {
  if rank >= search.count {
    return FAR;
  }
  let index = surfel_dealt(rank, search.sub_buffer, search.level);
  let disk = surfels[index];
  let normal = unpack_normal(sources[index].normal);
  let to_center = disk.xyz - ray.origin;
  let height = dot(normal, to_center);
  let slope = dot(normal, ray.direction);
  // A ray within the disk's plane passes it by.
  if abs(slope) < 1e-12 {
    return FAR;
  }
  let t = height / slope;
  let inner = 0.5 * radius_on(search.level, min(disks.shell_radii * disk.w, FAR));
  let outer = reach_of(vec4f(disk.w)).x;
  if !(t > 0.0 && (search.level == 0u || t >= inner) && t < outer) {
    return FAR;
  }
  let aside = ray.direction * t - to_center;
  let radius = radius_on(search.level, disk.w);
  if dot(aside, aside) > radius * radius {
    return FAR;
  }
  // The receiver's own surface, whose disks do not lie exactly in it where it is curved.
  let own = abs(dot(normal, search.normal)) > 0.8 && abs(height) < 0.5 * disk.w && t < 4.0 * disk.w;
  return select(t, FAR, search.level == 0u && own);
}

// Where the level's shell about such disks ends.
fn reach_of(radius: vec4f) -> vec4f {
  let last = search.level + 1u == disks.levels;
  let reach = min(disks.shell_radii * radius, vec4f(FAR)) * f32(1u << search.level);
  return select(min(reach, vec4f(FAR)), vec4f(FAR), last);
}

fn intersect_leaf(ray: Ray, leaf: u32) -> vec4f {
  let rank = leaf * 4u;
  return vec4f(meet_disk(ray, rank), meet_disk(ray, rank + 1u), meet_disk(ray, rank + 2u), meet_disk(ray, rank + 3u));
}

// The hit that counts, with the surfel for its sender; with `any` one that tells as well whether there is one. Of two that
// are equally near that of the coarser level counts.
fn walk_disks(ray: Ray, pixel: vec2u, normal: vec3f, any: bool) -> Hit {
  // Where the finest level wins it may win with a hit that is too far to count, and hide one that is not. Else any level's
  // hit tells that there is one.
  let finest = disks.merge == MERGE_FINEST && !(any && params.world_radius >= FAR);
  let stop = any && !finest;
  var merged = Hit(select(params.world_radius, FAR, finest), MISS);
  for (var i = 0u; i < disks.levels; i++) {
    // Else the coarse ones come first: they have few disks, and what they find bounds the search among many.
    let level = select(disks.levels - 1u - i, i, finest);
    let sub_buffer = sub_buffer_of(pixel, level, disks.seed);
    let level_first = disks.level_first[level / 4u][level % 4u];
    let tree = disk_bvh(level, sub_buffer, level_first, counters.stored, disks.capacity);
    search = Search(level, sub_buffer, tree.count, normal);
    let hit = bvh4_nearest(ray, tree.first, tree.count, tree.capacity, merged.t, stop);
    if hit.primitive != MISS {
      merged = Hit(hit.t, surfel_dealt(hit.primitive, sub_buffer, level));
      if finest || stop {
        break;
      }
    }
  }
  if merged.t >= params.world_radius {
    return Hit(params.world_radius, MISS);
  }
  return merged;
}

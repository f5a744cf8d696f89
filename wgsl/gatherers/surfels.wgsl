// A lit cloud's surfels as lights (src/sg_hull/surfels.rs), by point-to-disk form factors and without shadows, on the levels
// of the ShellSplatter (wgsl/shell_splatter.wgsl): on level l a vertex is dealt one surfel in 4^l, which stands for the
// others, of those whose shell it lies in.

#import hashing
#import levels
#import cluster

struct SurfelParams {
  // What takes a position to the cloud's space.
  offset: vec3f,
  // Surfels in the cloud.
  stored: u32,
  levels: u32,
  unbounded: u32,
  seed: u32,
  world_radius: f32,
  // Radii of the first level's shell.
  reach: f32,
  padding0: u32,
  padding1: u32,
  padding2: u32,
  // Of each level: clusters that a sub-buffer has room for, where they begin, and the same of groups.
  places: array<vec4u, 8>,
}

@group(1) @binding(0) var<uniform> surfel_params: SurfelParams;
@group(1) @binding(1) var<storage, read> gathered_surfels: array<vec4f>;
// SurfelSource; x is the packed normal.
@group(1) @binding(2) var<storage, read> surfel_sources: array<vec4u>;
// SurfelRadiance: what the front sends, and the back.
@group(1) @binding(3) var<storage, read> surfel_radiance: array<vec4f>;
@group(1) @binding(4) var<storage, read> clusters: array<Cluster>;

// Stands for infinity; its square is finite.
const UNBOUNDED: f32 = 1e18;

fn may_reach(cluster: Cluster, p: vec3f) -> bool {
  let gap = max(max(cluster.low - p, p - cluster.high), vec3f(0.0));
  return cluster.reach >= 0.0 && dot(gap, gap) <= cluster.reach * cluster.reach * 1.00001;
}

// Inner and outer radius of the shell of a surfel of radius r on a level.
fn surfel_shell(r: f32, level: u32) -> vec2f {
  let reach = min(r * surfel_params.reach * f32(1u << level), UNBOUNDED);
  let inner = select(0.0, 0.5 * reach, level > 0u);
  let is_last = surfel_params.unbounded != 0u && level + 1u == surfel_params.levels;
  return vec2f(inner, min(select(reach, UNBOUNDED, is_last), surfel_params.world_radius));
}

fn add_surfel(lobes: Lobes, normal: vec3f, p: vec3f, at: u32, level: u32) -> Lobes {
  let disk = gathered_surfels[at];
  let to_surfel = disk.xyz - p;
  let distance2 = dot(to_surfel, to_surfel);
  let radii = surfel_shell(disk.w, level);
  if !(distance2 >= radii.x * radii.x && distance2 < radii.y * radii.y && distance2 > 0.0) {
    return lobes;
  }
  let direction = to_surfel * inverseSqrt(distance2);
  let facing = -dot(unpack_normal(surfel_sources[at].x), direction);
  // pi r^2 cos / (d^2 + r^2), arranged so that no radius overflows its square.
  let radius = max(disk.w, 1e-18);
  let solid_angle = PI * abs(facing) / (1.0 + distance2 / radius / radius);
  let radiance = surfel_radiance[2u * at + select(1u, 0u, facing > 0.0)].xyz * f32(1u << (2u * level));
  return add_moments(lobes, normal, vec4f(direction, 1.0) * solid_angle, radiance);
}

fn gather(position: vec3f, normal: vec3f, lane: u32, lanes: u32) -> Lobes {
  var lobes: Lobes;
  let p = position + surfel_params.offset;
  let bits = bitcast<vec3u>(position);
  let key = hash2(bits.x, hash2(bits.y, bits.z + surfel_params.seed));
  for (var level = 0u; level < surfel_params.levels; level++) {
    // Other bits of another hash on each level, so that levels choose independently.
    let sub_buffer = hash2(key, level) & ((1u << (2u * level)) - 1u);
    let place = surfel_params.places[level];
    let surfel_count = surfels_dealt(surfel_params.stored, sub_buffer, level);
    let cluster_count = divide_up(surfel_count, CLUSTER);
    for (var g = 0u; g < divide_up(cluster_count, GROUP); g++) {
      if !may_reach(clusters[place.w + sub_buffer * place.z + g], p) {
        continue;
      }
      let end = min((g + 1u) * GROUP, cluster_count);
      for (var c = g * GROUP + lane; c < end; c += lanes) {
        if !may_reach(clusters[place.y + sub_buffer * place.x + c], p) {
          continue;
        }
        for (var rank = c * CLUSTER; rank < min((c + 1u) * CLUSTER, surfel_count); rank++) {
          lobes = add_surfel(lobes, normal, p, surfel_dealt(rank, sub_buffer, level), level);
        }
      }
    }
  }
  return lobes;
}

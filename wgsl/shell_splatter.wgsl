// ShellSplatter: sums of an effect's contributions over the surfels, per pixel and level (Deep Screen Space 3.2).
//
// On level l a surfel affects the pixels of one of 4^l sub-buffers that lie in a shell about it, and stands there for
// the 4^l surfels that other sub-buffers got. Shells of successive levels double and are disjoint.
//
// Gathered by tile rather than blended by raster: sums stay in f32 registers, in a fixed order, with one write per pixel.
// Surfels are in order of emission and so near their neighbours; 16 successive ones of a sub-buffer form a cluster and
// 64 clusters a group, each with bounds, which a tile tests before it loads a surfel.
//
//   plan            one workgroup: how many workgroups the next two need on each level
//   build_clusters  one thread per cluster
//   build_groups    a thread a group
//   splat           one workgroup per tile of 32x16 pixels of a sub-buffer: 8 units of 8x8, 8 threads a unit, 8 pixels a
//                   thread. A surfel is loaded once per tile and tested against each unit's bounds.

#import math
#import packing
#import hashing
#import dispatch
#import receiver
#import surfel
#import levels
#import cluster

alias Counter = u32;

struct Params {
  // Of the image, and of a sub-buffer.
  size: vec2u,
  sub_size: vec2u,
  // Of a sub-buffer, in tiles.
  tiles: vec2u,
  level: u32,
  // 1 on the last level where it has no outer bound.
  unbounded: u32,
  epsilon: f32,
  // Beyond which nothing contributes, world units.
  world_radius: f32,
  seed: u32,
  // Of this level: clusters and groups that a sub-buffer has room for, and where they begin.
  clusters: u32,
  first_cluster: u32,
  groups: u32,
  first_group: u32,
  padding: u32,
}

#import effect_types

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> surfels: array<vec4f>;
@group(0) @binding(2) var<storage, read> sources: array<SurfelSource>;
@group(0) @binding(3) var<storage, read> counters: Counters;
#if BUILD
@group(0) @binding(4) var<storage, read_write> clusters: array<Cluster>;
// Two indirect dispatches per level.
@group(0) @binding(9) var<storage, read_write> dispatches: array<u32>;
#else
@group(0) @binding(4) var<storage, read> clusters: array<Cluster>;
@group(0) @binding(5) var receivers: texture_2d<u32>;
#if COLOR
@group(0) @binding(6) var sums: texture_storage_2d_array<rgba32float, write>;
#else
@group(0) @binding(6) var sums: texture_storage_2d_array<r32float, write>;
#endif
#endif
#if MATERIAL
@group(0) @binding(7) var<storage, read> materials: array<Material>;
#endif
#if STATISTICS
// A row of four per level: pairs evaluated, in their shell, contributing, and unused.
@group(0) @binding(8) var<storage, read_write> statistics: array<atomic<u32>>;
#endif

#import effect

// Stands for infinity; its square is finite.
const UNBOUNDED: f32 = 1e18;
// Rounding of positions, relative to their size: what lies this little in front of a surfel is taken to lie in its
// plane. Walls would else light and shade themselves through the last bit.
const PLANE_TOLERANCE: f32 = 1e-6;

fn sender_of(disk: vec4f, source: SurfelSource) -> Sender {
  var sender: Sender;
  sender.radius = disk.w;
  sender.normal = unpack_normal(source.normal);
#if MATERIAL
  sender.material = materials[min(source.material, arrayLength(&materials) - 1u)];
#endif
  return sender;
}

// Inner and outer radius of a surfel's shell on this level.
fn shell(sender: Sender) -> vec2f {
  let reach = min(max_distance(sender, params.epsilon) * f32(1u << params.level), UNBOUNDED);
  let inner = select(0.0, 0.5 * reach, params.level > 0u);
  let outer = select(reach, UNBOUNDED, params.unbounded != 0u);
  return vec2f(inner, min(outer, params.world_radius));
}

fn surfels_in(sub_buffer: u32) -> u32 {
  return surfels_dealt(counters.stored, sub_buffer, params.level);
}

fn pack_bounds(low: vec3f, high: vec3f) -> u32 {
  let l = vec3u(vec3i(clamp(floor(low * 15.0), vec3f(-15.0), vec3f(15.0))) + vec3i(15));
  let h = vec3u(vec3i(clamp(ceil(high * 15.0), vec3f(-15.0), vec3f(15.0))) + vec3i(15));
  return l.x | (l.y << 5u) | (l.z << 10u) | (h.x << 15u) | (h.y << 20u) | (h.z << 25u);
}

fn unpack_low(bits: u32) -> vec3f {
  return (vec3f(vec3u(bits, bits >> 5u, bits >> 10u) & vec3u(31u)) - 15.0) / 15.0;
}

fn unpack_high(bits: u32) -> vec3f {
  return unpack_low(bits >> 15u);
}

#if BUILD

fn empty_cluster() -> Cluster {
  return Cluster(vec3f(MAX_F32), -1.0, vec3f(-MAX_F32), 0u);
}

fn plan_dispatch(at: u32, threads: u32) {
  let workgroups = divide_up(threads, 64u);
  dispatches[at] = min(workgroups, DISPATCH_ROW);
  dispatches[at + 1u] = divide_up(workgroups, DISPATCH_ROW);
  dispatches[at + 2u] = 1u;
}

@compute @workgroup_size(8)
fn plan(@builtin(local_invocation_index) level: u32) {
  if level * 6u < arrayLength(&dispatches) {
    // Sub-buffer 0 has the most.
    let clusters_each = divide_up(surfels_dealt(counters.stored, 0u, level), CLUSTER);
    plan_dispatch(level * 6u, clusters_each << (2u * level));
    plan_dispatch(level * 6u + 3u, divide_up(clusters_each, GROUP) << (2u * level));
  }
}

@compute @workgroup_size(64)
fn build_clusters(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  let clusters_each = divide_up(surfels_in(0u), CLUSTER);
  let sub_buffer = i / clusters_each;
  if sub_buffer >= (1u << (2u * params.level)) {
    return;
  }
  let number = i % clusters_each;
  let first = number * CLUSTER;
  let end = min(first + CLUSTER, surfels_in(sub_buffer));
  var cluster = empty_cluster();
  var normal_low = vec3f(1.0);
  var normal_high = vec3f(-1.0);
  for (var rank = first; rank < end; rank++) {
    let at = surfel_dealt(rank, sub_buffer, params.level);
    let disk = surfels[at];
    let sender = sender_of(disk, sources[at]);
    let radii = shell(sender);
    if radii.y > radii.x {
      cluster.low = min(cluster.low, disk.xyz);
      cluster.high = max(cluster.high, disk.xyz);
      cluster.reach = max(cluster.reach, radii.y);
      normal_low = min(normal_low, sender.normal);
      normal_high = max(normal_high, sender.normal);
    }
  }
  cluster.normals = pack_bounds(normal_low, normal_high);
  clusters[params.first_cluster + sub_buffer * params.clusters + number] = cluster;
}

@compute @workgroup_size(64)
fn build_groups(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  let groups_each = divide_up(divide_up(surfels_in(0u), CLUSTER), GROUP);
  let sub_buffer = i / groups_each;
  if sub_buffer >= (1u << (2u * params.level)) {
    return;
  }
  let number = i % groups_each;
  let first = number * GROUP;
  let end = min(first + GROUP, divide_up(surfels_in(sub_buffer), CLUSTER));
  var group = empty_cluster();
  var normal_low = vec3f(1.0);
  var normal_high = vec3f(-1.0);
  for (var c = first; c < end; c++) {
    let cluster = clusters[params.first_cluster + sub_buffer * params.clusters + c];
    if cluster.reach >= 0.0 {
      group.low = min(group.low, cluster.low);
      group.high = max(group.high, cluster.high);
      group.reach = max(group.reach, cluster.reach);
      normal_low = min(normal_low, unpack_low(cluster.normals));
      normal_high = max(normal_high, unpack_high(cluster.normals));
    }
  }
  group.normals = pack_bounds(normal_low, normal_high);
  clusters[params.first_group + sub_buffer * params.groups + number] = group;
}

#else

const PIXELS: u32 = 8u;
const UNITS: u32 = 8u;
const THREADS: u32 = 64u;
const TILE: vec2u = vec2u(32u, 16u);

struct Box {
  low: vec3f,
  high: vec3f,
}

var<workgroup> thread_boxes: array<Box, THREADS>;
var<workgroup> unit_boxes: array<Box, UNITS>;
// The surfels of a round: centre and radius; normal; squares of the shell's radii.
var<workgroup> disks: array<vec4f, THREADS>;
var<workgroup> senders: array<Sender, THREADS>;
var<workgroup> shells: array<vec2f, THREADS>;
// Which surfels of a round each unit needs: two words of bits a unit; the rounds take turns with two sets.
var<workgroup> needed: array<atomic<u32>, 32>;
// Groups and clusters that passed their test: bits, and their numbers in order. The groups have the first two words;
// clusters take turns with two sets of two.
var<workgroup> passed: array<atomic<u32>, 6>;
var<workgroup> passed_groups: array<u32, THREADS>;
var<workgroup> passed_clusters: array<u32, THREADS>;
var<workgroup> passed_count: u32;

fn empty_box() -> Box {
  return Box(vec3f(MAX_F32), vec3f(-MAX_F32));
}

fn merged(a: Box, b: Box) -> Box {
  return Box(min(a.low, b.low), max(a.high, b.high));
}

fn distance2_of_boxes(a: Box, b: Box) -> f32 {
  let gap = max(max(a.low - b.high, b.low - a.high), vec3f(0.0));
  return dot(gap, gap);
}

// Whether surfels within a cluster's bounds may affect receivers in a box.
fn may_affect(cluster: Cluster, box: Box) -> bool {
  if cluster.reach < 0.0 || box.low.x > box.high.x {
    return false;
  }
  if distance2_of_boxes(Box(cluster.low, cluster.high), box) > cluster.reach * cluster.reach * 1.00001 {
    return false;
  }
#if ONE_SIDED
  // The largest that dot(normal, receiver - surfel) can be, by interval arithmetic.
  let low = box.low - cluster.high;
  let high = box.high - cluster.low;
  let n0 = unpack_low(cluster.normals);
  let n1 = unpack_high(cluster.normals);
  let front = max(max(n0 * low, n0 * high), max(n1 * low, n1 * high));
  let scale = max_component(max(abs(box.low), abs(box.high))) + max_component(max(abs(cluster.low), abs(cluster.high)));
  return front.x + front.y + front.z > PLANE_TOLERANCE * scale;
#else
  return true;
#endif
}

// The same for one surfel.
fn surfel_may_affect(center: vec3f, normal: vec3f, reach2: f32, box: Box) -> bool {
  if box.low.x > box.high.x {
    return false;
  }
  let gap = max(max(box.low - center, center - box.high), vec3f(0.0));
  if dot(gap, gap) > reach2 * 1.00001 {
    return false;
  }
#if ONE_SIDED
  let farthest = select(box.low, box.high, normal > vec3f(0.0));
  let scale = max_component(max(abs(box.low), abs(box.high))) + max_component(abs(center));
  return dot(normal, farthest - center) > PLANE_TOLERANCE * scale;
#else
  return true;
#endif
}

// A pixel of this thread.
struct Pixel {
  position: vec3f,
  // 1 where it has a place in the image.
  inside: u32,
  normal: vec3f,
  // x in the lower half, y in the upper.
  at: u32,
#if OWN_SURFACE
  // Of the surface itself, where `normal` may be that of a normal map.
  surface: vec3f,
#endif
}

#if OWN_SURFACE

// The unit vector to a pixel's neighbour, and how much the line of the two is bent at it: 0 on a plane, up to 2.
struct Side {
  direction: vec3f,
  bend: f32,
}

const NO_SIDE: Side = Side(vec3f(0.0), 4.0);

fn side_of(at: vec2i, step: vec2i, position: vec3f) -> Side {
  let near = at + step;
  let far = near + step;
  if any(near < vec2i(0)) || any(near >= vec2i(params.size)) {
    return NO_SIDE;
  }
  let near_texel = textureLoad(receivers, near, 0);
  if near_texel.w == SKY {
    return NO_SIDE;
  }
  let direction = normalize_or(receiver_position(near_texel) - position, vec3f(0.0));
  if any(far < vec2i(0)) || any(far >= vec2i(params.size)) {
    return Side(direction, 2.0);
  }
  let far_texel = textureLoad(receivers, far, 0);
  if far_texel.w == SKY {
    return Side(direction, 2.0);
  }
  let further = receiver_position(far_texel) - receiver_position(near_texel);
  return Side(direction, 1.0 - dot(direction, normalize_or(further, vec3f(0.0))));
}

// Along a row or a column of the image within the surface that a pixel shows: from or to the neighbour that lies in line
// with the one after it, as it does unless an edge is between.
fn along_surface(at: vec2i, step: vec2i, position: vec3f) -> vec3f {
  let before = side_of(at, -step, position);
  let after = side_of(at, step, position);
  return select(after.direction, -before.direction, before.bend < after.bend);
}

// The normal of the surface at a pixel, from the positions around it, on the side of its shading normal; that itself where
// no neighbour shows anything.
fn surface_normal(at: vec2i, position: vec3f, normal: vec3f) -> vec3f {
  let across = cross(along_surface(at, vec2i(1, 0), position), along_surface(at, vec2i(0, 1), position));
  let found = normalize_or(across, normal);
  return select(-found, found, dot(found, normal) >= 0.0);
}

#endif

fn load_pixel(row: vec2u, i: u32, sub_buffer: u32) -> Pixel {
  let block = row + vec2u(i, 0u);
  let at = pixel_of(block, sub_buffer, params.level, params.seed);
  // Far outside of every bounded shell and facing nowhere, so that what follows needs no test for the sky.
#if OWN_SURFACE
  var pixel = Pixel(vec3f(UNBOUNDED), 0u, vec3f(0.0), at.x | (at.y << 16u), vec3f(0.0));
#else
  var pixel = Pixel(vec3f(UNBOUNDED), 0u, vec3f(0.0), at.x | (at.y << 16u));
#endif
  if sub_buffer < (1u << (2u * params.level)) && all(block < params.sub_size) && all(at < params.size) {
    pixel.inside = 1u;
    let texel = textureLoad(receivers, at, 0);
    if texel.w != SKY {
      pixel.position = receiver_position(texel);
      pixel.normal = unpack_normal(texel.w);
#if OWN_SURFACE
      pixel.surface = surface_normal(vec2i(at), pixel.position, pixel.normal);
#endif
    }
  }
  return pixel;
}

// Nothing for the sky.
fn box_of(pixel: Pixel) -> Box {
  if pixel.position.x == UNBOUNDED {
    return empty_box();
  }
  return Box(pixel.position, pixel.position);
}

fn store_sum(pixel: Pixel, surfels_sum: Sum) {
  if pixel.inside != 0u {
    let at = vec2u(pixel.at & 0xffffu, pixel.at >> 16u);
    var sum = surfels_sum;
#if OWN_SURFACE
    if params.level == 0u && pixel.position.x != UNBOUNDED {
      sum += own_surface(min(dot(pixel.normal, pixel.surface), 1.0));
    }
#endif
#if COLOR
    textureStore(sums, at, params.level, vec4f(sum, 0.0));
#else
    textureStore(sums, at, params.level, vec4f(sum, 0.0, 0.0, 0.0));
#endif
  }
}

#if STATISTICS
var<private> in_shell: u32;
var<private> contributing: u32;
#endif

// What a surfel adds to one pixel.
fn pair(disk: vec4f, sender: Sender, radii2: vec2f, pixel: Pixel) -> Sum {
  let to_sender = disk.xyz - pixel.position;
  let distance2 = dot(to_sender, to_sender);
#if OWN_SURFACE
  let inside = distance2 >= radii2.x && distance2 < radii2.y && dot(pixel.surface, to_sender) > 0.0;
#else
  let inside = distance2 >= radii2.x && distance2 < radii2.y;
#endif
  let value = contribution(sender, pixel.normal, to_sender, distance2);
#if STATISTICS
  in_shell += select(0u, 1u, inside);
  contributing += select(0u, 1u, inside && any(value > Sum(0.0)));
#endif
  return select(Sum(0.0), value, inside);
}

// Whether this thread's bit is set in a pair of words, and how many are set before it.
fn rank_in(words: vec2u, thread: u32) -> vec2u {
  let word = select(words.x, words.y, thread >= 32u);
  let before = countOneBits(word & ((1u << (thread & 31u)) - 1u)) + select(0u, countOneBits(words.x), thread >= 32u);
  return vec2u((word >> (thread & 31u)) & 1u, before);
}

// Sets the bits of the units that need the surfel in `slot`.
fn mark(parity: u32, slot: u32, units: u32, lane: u32) {
  let base = parity * 16u;
  let word = slot / 32u;
#if SUBGROUP
  for (var unit = 0u; unit < UNITS; unit++) {
    let ballot = subgroupBallot(((units >> unit) & 1u) != 0u);
    // Slots of a subgroup are successive and its first lane's is a multiple of its size.
    if lane == 0u {
      if ballot.x != 0u {
        atomicOr(&needed[base + unit * 2u + word], ballot.x << (slot & 31u));
      }
      if ballot.y != 0u {
        atomicOr(&needed[base + unit * 2u + 1u], ballot.y);
      }
    }
  }
#else
  var rest = units;
  while rest != 0u {
    let unit = firstTrailingBit(rest);
    rest &= rest - 1u;
    atomicOr(&needed[base + unit * 2u + word], 1u << (slot & 31u));
  }
#endif
}

@compute @workgroup_size(64)
fn splat(
  @builtin(workgroup_id) workgroup: vec3u,
  @builtin(local_invocation_index) thread: u32,
#if SUBGROUP
  @builtin(subgroup_id) subgroup: u32,
  @builtin(subgroup_size) subgroup_size: u32,
  @builtin(subgroup_invocation_id) lane: u32,
#endif
) {
#if SUBGROUP
  let slot = subgroup * subgroup_size + lane;
#else
  let slot = thread;
  let lane = 0u;
#endif
  let tile_count = params.tiles.x * params.tiles.y;
  let index = linear_workgroup(workgroup);
  let sub_buffer = index / tile_count;
  let tile = vec2u(index % tile_count % params.tiles.x, index % tile_count / params.tiles.x);
  let unit = thread / 8u;
  let block = tile * TILE + vec2u((unit % 4u) * 8u, (unit / 4u) * 8u + thread % 8u);

  // This thread's row of pixels, its bounds, and those of its unit and tile. Written out rather than looped over:
  // arrays that a loop indexes live in memory, not in registers.
  let q0 = load_pixel(block, 0u, sub_buffer); let q1 = load_pixel(block, 1u, sub_buffer);
  let q2 = load_pixel(block, 2u, sub_buffer); let q3 = load_pixel(block, 3u, sub_buffer);
  let q4 = load_pixel(block, 4u, sub_buffer); let q5 = load_pixel(block, 5u, sub_buffer);
  let q6 = load_pixel(block, 6u, sub_buffer); let q7 = load_pixel(block, 7u, sub_buffer);
  var own = box_of(q0);
  own = merged(own, box_of(q1)); own = merged(own, box_of(q2)); own = merged(own, box_of(q3));
  own = merged(own, box_of(q4)); own = merged(own, box_of(q5)); own = merged(own, box_of(q6));
  own = merged(own, box_of(q7));
  thread_boxes[thread] = own;
  if thread < 32u {
    atomicStore(&needed[thread], 0u);
  }
  if thread < 6u {
    atomicStore(&passed[thread], 0u);
  }
  workgroupBarrier();
  if thread < UNITS {
    var all_rows = thread_boxes[thread * 8u];
    for (var row = 1u; row < 8u; row++) {
      all_rows = merged(all_rows, thread_boxes[thread * 8u + row]);
    }
    unit_boxes[thread] = all_rows;
  }
  workgroupBarrier();
  var tile_box = unit_boxes[0];
  for (var u = 1u; u < UNITS; u++) {
    tile_box = merged(tile_box, unit_boxes[u]);
  }

  var s0 = Sum(0.0); var s1 = Sum(0.0); var s2 = Sum(0.0); var s3 = Sum(0.0);
  var s4 = Sum(0.0); var s5 = Sum(0.0); var s6 = Sum(0.0); var s7 = Sum(0.0);
#if STATISTICS
  var evaluated = 0u;
#endif

  let surfel_count = surfels_in(sub_buffer);
  let cluster_count = divide_up(surfel_count, CLUSTER);
  let group_count = divide_up(cluster_count, GROUP);
  let first_cluster = params.first_cluster + sub_buffer * params.clusters;
  let first_group = params.first_group + sub_buffer * params.groups;
  var parity = 0u;
  var turn = 2u;

  for (var group_base = 0u; group_base < group_count; group_base += THREADS) {
    if group_base + thread < group_count && may_affect(clusters[first_group + group_base + thread], tile_box) {
      atomicOr(&passed[thread / 32u], 1u << (thread & 31u));
    }
    workgroupBarrier();
    let group_bits = vec2u(atomicLoad(&passed[0]), atomicLoad(&passed[1]));
    let group_rank = rank_in(group_bits, thread);
    if group_rank.x != 0u {
      passed_groups[group_rank.y] = group_base + thread;
    }
    if thread == 0u {
      passed_count = countOneBits(group_bits.x) + countOneBits(group_bits.y);
    }
    let groups = workgroupUniformLoad(&passed_count);

    for (var g = 0u; g < groups; g++) {
      let cluster_base = passed_groups[g] * GROUP;
      if cluster_base + thread < cluster_count && may_affect(clusters[first_cluster + cluster_base + thread], tile_box) {
        atomicOr(&passed[turn + thread / 32u], 1u << (thread & 31u));
      }
      workgroupBarrier();
      let cluster_bits = vec2u(atomicLoad(&passed[turn]), atomicLoad(&passed[turn + 1u]));
      // All have read the other set by now, and none writes it before the barriers below.
      turn = 6u - turn;
      if thread < 2u {
        atomicStore(&passed[turn + thread], 0u);
      }
      let cluster_rank = rank_in(cluster_bits, thread);
      if cluster_rank.x != 0u {
        passed_clusters[cluster_rank.y] = cluster_base + thread;
      }
      if thread == 0u {
        passed_count = countOneBits(cluster_bits.x) + countOneBits(cluster_bits.y);
      }
      let clusters_here = workgroupUniformLoad(&passed_count);

      // Rounds of four clusters: one thread per surfel.
      for (var c = 0u; c < clusters_here; c += 4u) {
        let mine = c + slot / CLUSTER;
        var units = 0u;
        if mine < clusters_here {
          let rank = passed_clusters[mine] * CLUSTER + slot % CLUSTER;
          if rank < surfel_count {
            let at = surfel_dealt(rank, sub_buffer, params.level);
            let disk = surfels[at];
            let sender = sender_of(disk, sources[at]);
            let radii = shell(sender);
            if radii.y > radii.x {
              let radii2 = radii * radii;
              disks[slot] = disk;
              senders[slot] = sender;
              shells[slot] = radii2;
              for (var u = 0u; u < UNITS; u++) {
                if surfel_may_affect(disk.xyz, sender.normal, radii2.y, unit_boxes[u]) {
                  units |= 1u << u;
                }
              }
            }
          }
        }
        mark(parity, slot, units, lane);
        workgroupBarrier();
        for (var word = 0u; word < 2u; word++) {
          var rest = atomicLoad(&needed[parity * 16u + unit * 2u + word]);
          while rest != 0u {
            let k = word * 32u + firstTrailingBit(rest);
            rest &= rest - 1u;
            let disk = disks[k];
            let sender = senders[k];
            let radii2 = shells[k];
            s0 += pair(disk, sender, radii2, q0);
            s1 += pair(disk, sender, radii2, q1);
            s2 += pair(disk, sender, radii2, q2);
            s3 += pair(disk, sender, radii2, q3);
            s4 += pair(disk, sender, radii2, q4);
            s5 += pair(disk, sender, radii2, q5);
            s6 += pair(disk, sender, radii2, q6);
            s7 += pair(disk, sender, radii2, q7);
#if STATISTICS
            evaluated += PIXELS;
#endif
          }
        }
        if thread < 16u {
          atomicStore(&needed[(1u - parity) * 16u + thread], 0u);
        }
        parity = 1u - parity;
        workgroupBarrier();
      }
    }
    workgroupBarrier();
    if thread < 2u {
      atomicStore(&passed[thread], 0u);
    }
    workgroupBarrier();
  }

  // The surfels of the other sub-buffers lie like this one's: each of its surfels stands for all of theirs.
  let share = f32(1u << (2u * params.level));
  store_sum(q0, s0 * share); store_sum(q1, s1 * share); store_sum(q2, s2 * share); store_sum(q3, s3 * share);
  store_sum(q4, s4 * share); store_sum(q5, s5 * share); store_sum(q6, s6 * share); store_sum(q7, s7 * share);
#if STATISTICS
  atomicAdd(&statistics[params.level * 4u], evaluated);
  atomicAdd(&statistics[params.level * 4u + 1u], in_shell);
  atomicAdd(&statistics[params.level * 4u + 2u], contributing);
#endif
}

#endif

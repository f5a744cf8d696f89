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
//                   thread. The clusters that may affect the tile are listed, then their surfels tested against each
//                   unit's bounds, up to 2048 at once, then each unit evaluates its own without a barrier. A team of
//                   lanes loads as many surfels at once and passes them around, where there are subgroups.
//
// Drivers that run on a CPU go through the whole of an `if` with lanes masked out, and through a loop's body once more than
// it is asked to, unless its condition stands at the end: heavy code stands in one loop of the latter kind, not in nested ones.

#if SUBGROUP
// Lanes of a team branch alike, though teams of a subgroup need not: what a shuffle reads from is always active.
diagnostic(off, subgroup_uniformity);
#endif

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
// So many planes a level as the sums have.
#if COLOR || QUAD || OCTET
@group(0) @binding(6) var sums: texture_storage_2d_array<rgba32float, write>;
#else
#if PAIR
@group(0) @binding(6) var sums: texture_storage_2d_array<rg32float, write>;
#else
@group(0) @binding(6) var sums: texture_storage_2d_array<r32float, write>;
#endif
#endif
#endif
#if MATERIAL
@group(0) @binding(7) var<storage, read> materials: array<Material>;
#endif
#if STATISTICS
// A row of four per level: pairs evaluated, in their shell, contributing, and unused.
@group(0) @binding(8) var<storage, read_write> statistics: array<atomic<u32>>;
#endif
#if RADIANCE
@group(0) @binding(10) var<storage, read> radiance: array<SurfelRadiance>;
#endif
#if VIEW || ROUGHNESS
// Where pixels are seen from.
struct View {
  camera: Camera,
  // Which sub-image.
  sub_image: u32,
  padding0: u32,
  padding1: u32,
  padding2: u32,
}

#import camera
#import sub_image
@group(0) @binding(11) var<uniform> view: View;
#endif
#if ROUGHNESS
#import roughness
@group(0) @binding(12) var roughness_texture: texture_2d<f32>;
#endif
#if ENVIRONMENT
#import environment_levels
@group(0) @binding(13) var<uniform> environment: Environment;
@group(0) @binding(14) var environment_levels: texture_2d<f32>;
@group(0) @binding(15) var<storage, read> environment_irradiance: array<vec4f, 9>;
#endif

#import effect

// Stands for infinity; its square is finite.
const UNBOUNDED: f32 = 1e18;
// Rounding of positions, relative to their size: what lies this little in front of a surfel is taken to lie in its
// plane. Walls would else light and shade themselves through the last bit.
const PLANE_TOLERANCE: f32 = 1e-6;

#if MATERIAL
fn material_of(number: u32) -> Material {
  return materials[min(number, arrayLength(&materials) - 1u)];
}
#endif

// The surfels of the other sub-buffers lie like this one's: each of its surfels stands for all of theirs.
fn level_share() -> f32 {
  return f32(1u << (2u * params.level));
}

fn sender_of(at: u32, disk: vec4f, source: SurfelSource) -> Sender {
  var sender: Sender;
  sender.radius = disk.w;
  sender.normal = unpack_normal(source.normal);
  sender.share = level_share();
#if MATERIAL
  sender.material = material_of(source.material);
#endif
#if RADIANCE
  sender.front = radiance[at].front;
#if !ONE_SIDED
  sender.back = radiance[at].back;
#endif
#endif
  return sender;
}

// Inner and outer radius of a surfel's shell on this level; the outer one is negative for a surfel that contributes nothing.
fn shell(sender: Sender) -> vec2f {
  let reach = min(max_distance(sender, params.epsilon) * f32(1u << params.level), UNBOUNDED);
  let inner = select(0.0, 0.5 * reach, params.level > 0u);
  let outer = select(reach, UNBOUNDED, (params.unbounded != 0u) & !(reach < 0.0));
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
    let sender = sender_of(at, disk, sources[at]);
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
// Clusters of a round, and words of bits that tell which of their surfels a unit needs.
const QUEUE: u32 = 128u;
const WORDS: u32 = QUEUE * CLUSTER / 32u;
const NEEDED: u32 = WORDS * UNITS;


struct Box {
  low: vec3f,
  high: vec3f,
}

var<workgroup> thread_boxes: array<Box, THREADS>;
var<workgroup> unit_boxes: array<Box, UNITS>;
// The groups that passed their test, as bits; and the clusters of those, two words a group.
var<workgroup> groups_passed: array<atomic<u32>, 2>;
var<workgroup> clusters_passed: array<atomic<u32>, 128>;
// The numbers of the clusters of a round, in order, and how many there are in all.
var<workgroup> queue: array<u32, QUEUE>;
var<workgroup> queued: u32;
// Which surfels of a round each unit needs, as bits.
var<workgroup> needed: array<atomic<u32>, NEEDED>;

// The lowest of 64 bits that is set, and all but that.
fn lowest(bits: vec2u) -> u32 {
  return select(firstTrailingBit(bits.x), 32u + firstTrailingBit(bits.y), bits.x == 0u);
}

fn without_lowest(bits: vec2u) -> vec2u {
  return select(vec2u(bits.x & (bits.x - 1u), bits.y), vec2u(0u, bits.y & (bits.y - 1u)), bits.x == 0u);
}

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
  let gap = max(max(box.low - center, center - box.high), vec3f(0.0));
  let near = (dot(gap, gap) <= reach2 * 1.00001) & (box.low.x <= box.high.x);
#if ONE_SIDED
  let farthest = select(box.low, box.high, normal > vec3f(0.0));
  let scale = max_component(max(abs(box.low), abs(box.high))) + max_component(abs(center));
  return near & (dot(normal, farthest - center) > PLANE_TOLERANCE * scale);
#else
  return near;
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
#if VIEW
  to_eye: vec3f,
#endif
#if ROUGHNESS
  roughness: f32,
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
  var pixel = Pixel();
  pixel.position = vec3f(UNBOUNDED);
  pixel.at = at.x | (at.y << 16u);
  if sub_buffer < (1u << (2u * params.level)) && all(block < params.sub_size) && all(at < params.size) {
    pixel.inside = 1u;
    let texel = textureLoad(receivers, at, 0);
    if texel.w != SKY {
      pixel.position = receiver_position(texel);
      pixel.normal = unpack_normal(texel.w);
#if OWN_SURFACE
      pixel.surface = surface_normal(vec2i(at), pixel.position, pixel.normal);
#endif
#if VIEW
      pixel.to_eye = to_camera(view.camera, pixel.position - view.camera.eye);
#endif
#if ROUGHNESS
      let shown = view.camera.viewport.xy + stands_for(at, view.sub_image, view.camera.viewport.zw);
      pixel.roughness = clean_roughness(textureLoad(roughness_texture, shown, 0).x);
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
    textureStore(sums, at, params.level * PLANES, texel_of(sum, 0u));
#if OCTET
    textureStore(sums, at, params.level * PLANES + 1u, texel_of(sum, 1u));
#endif
  }
}

#if STATISTICS
var<private> in_shell: u32;
var<private> contributing: u32;
#endif

#if RECEIVER
fn receiver_of(pixel: Pixel) -> Receiver {
  var receiver: Receiver;
  receiver.normal = pixel.normal;
#if VIEW
  receiver.to_eye = pixel.to_eye;
#endif
#if ROUGHNESS
  receiver.roughness = pixel.roughness;
#endif
  return receiver;
}
#endif

// What a surfel adds to one pixel.
fn pair(disk: vec4f, sender: Sender, radii2: vec2f, pixel: Pixel) -> Sum {
  let to_sender = disk.xyz - pixel.position;
  let distance2 = dot(to_sender, to_sender);
#if OWN_SURFACE
  let inside = (distance2 >= radii2.x) & (distance2 < radii2.y) & (dot(pixel.surface, to_sender) > 0.0);
#else
  let inside = (distance2 >= radii2.x) & (distance2 < radii2.y);
#endif
#if RECEIVER
  let value = contribution(sender, pixel.normal, to_sender, distance2, receiver_of(pixel));
#else
  let value = contribution(sender, pixel.normal, to_sender, distance2);
#endif
#if STATISTICS
  in_shell += select(0u, 1u, inside);
  contributing += select(0u, 1u, inside && is_positive(value));
#endif
  return chosen(value, inside);
}

@compute @workgroup_size(64)
fn splat(
  @builtin(workgroup_id) workgroup: vec3u,
  @builtin(local_invocation_index) local: u32,
#if SUBGROUP
  @builtin(subgroup_id) subgroup: u32,
  @builtin(subgroup_size) subgroup_size: u32,
  @builtin(subgroup_invocation_id) lane: u32,
#endif
) {
#if SUBGROUP
  let thread = subgroup * subgroup_size + lane;
  // Lanes of a subgroup within a unit, and which of them this is. Units are runs of 8 threads.
  let team = min(subgroup_size, 8u);
  let mate = lane & (team - 1u);
  let team_base = lane - mate;
#else
  let thread = local;
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
  for (var i = thread; i < NEEDED; i += THREADS) {
    atomicStore(&needed[i], 0u);
  }
  atomicStore(&clusters_passed[thread * 2u], 0u);
  atomicStore(&clusters_passed[thread * 2u + 1u], 0u);
  if thread < 2u {
    atomicStore(&groups_passed[thread], 0u);
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
  let b0 = unit_boxes[0]; let b1 = unit_boxes[1]; let b2 = unit_boxes[2]; let b3 = unit_boxes[3];
  let b4 = unit_boxes[4]; let b5 = unit_boxes[5]; let b6 = unit_boxes[6]; let b7 = unit_boxes[7];
  let tile_box = merged(merged(merged(b0, b1), merged(b2, b3)), merged(merged(b4, b5), merged(b6, b7)));

  var s0 = Sum(); var s1 = Sum(); var s2 = Sum(); var s3 = Sum();
  var s4 = Sum(); var s5 = Sum(); var s6 = Sum(); var s7 = Sum();
#if VIEW
  // What depends on the view is long: it stands once, in a loop, where drivers would take minutes to compile eight of it.
  var pixels = array<Pixel, PIXELS>(q0, q1, q2, q3, q4, q5, q6, q7);
  var own_sums = array<Sum, PIXELS>();
#endif
#if STATISTICS
  var evaluated = 0u;
#endif

  let surfel_count = surfels_in(sub_buffer);
  let cluster_count = divide_up(surfel_count, CLUSTER);
  let group_count = divide_up(cluster_count, GROUP);
  let first_cluster = params.first_cluster + sub_buffer * params.clusters;
  let first_group = params.first_group + sub_buffer * params.groups;

  var group_base = 0u;
  loop {
    if group_base + thread < group_count && may_affect(clusters[first_group + group_base + thread], tile_box) {
      atomicOr(&groups_passed[thread / 32u], 1u << (thread & 31u));
    }
    workgroupBarrier();
    let group_bits = vec2u(atomicLoad(&groups_passed[0]), atomicLoad(&groups_passed[1]));
    var rest = group_bits;
    var nth = 0u;
    while any(rest != vec2u(0u)) {
      let group = lowest(rest);
      rest = without_lowest(rest);
      let cluster = (group_base + group) * GROUP + thread;
      if cluster < cluster_count && may_affect(clusters[first_cluster + cluster], tile_box) {
        atomicOr(&clusters_passed[nth * 2u + thread / 32u], 1u << (thread & 31u));
      }
      nth++;
    }
    workgroupBarrier();
    var round_base = 0u;
    loop {
      // The round's clusters in order; how many there are in all.
      var before = 0u;
      nth = 0u;
      rest = group_bits;
      while any(rest != vec2u(0u)) {
        let group = lowest(rest);
        rest = without_lowest(rest);
        let low = atomicLoad(&clusters_passed[nth * 2u]);
        let high = atomicLoad(&clusters_passed[nth * 2u + 1u]);
        nth++;
        let word = select(low, high, thread >= 32u);
        let below = countOneBits(word & ((1u << (thread & 31u)) - 1u)) + select(0u, countOneBits(low), thread >= 32u);
        let rank = before + below;
        if (((word >> (thread & 31u)) & 1u) != 0u) & (rank >= round_base) & (rank < round_base + QUEUE) {
          queue[rank - round_base] = (group_base + group) * GROUP + thread;
        }
        before += countOneBits(low) + countOneBits(high);
      }
      if thread == 0u {
        queued = before;
      }
      let total = workgroupUniformLoad(&queued);
      let round_surfels = min(total - round_base, QUEUE) * CLUSTER;
      // Each thread tests a run of surfels, a power of two, so that a run lies within a word of bits. That is within a
      // cluster, or two of them.
      let run = 1u << (32u - countLeadingZeros((max(round_surfels, 1u) - 1u) / THREADS));
      let first = thread * run;
      let start = queue[min(first / CLUSTER, QUEUE - 1u)] * CLUSTER + first % CLUSTER;
      let second_start = queue[min(first / CLUSTER + 1u, QUEUE - 1u)] * CLUSTER;
      var n0 = 0u; var n1 = 0u; var n2 = 0u; var n3 = 0u; var n4 = 0u; var n5 = 0u; var n6 = 0u; var n7 = 0u;
      var i = 0u;
      loop {
        let rank = select(start + i, second_start + i - CLUSTER, i >= CLUSTER);
        if (rank < surfel_count) & (first + i < round_surfels) {
          let at = surfel_dealt(rank, sub_buffer, params.level);
          let disk = surfels[at];
          let sender = sender_of(at, disk, sources[at]);
          let radii = shell(sender);
          let reach2 = select(-1.0, radii.y * radii.y, radii.y > radii.x);
          let bit = 1u << ((first + i) & 31u);
          n0 |= select(0u, bit, surfel_may_affect(disk.xyz, sender.normal, reach2, b0));
          n1 |= select(0u, bit, surfel_may_affect(disk.xyz, sender.normal, reach2, b1));
          n2 |= select(0u, bit, surfel_may_affect(disk.xyz, sender.normal, reach2, b2));
          n3 |= select(0u, bit, surfel_may_affect(disk.xyz, sender.normal, reach2, b3));
          n4 |= select(0u, bit, surfel_may_affect(disk.xyz, sender.normal, reach2, b4));
          n5 |= select(0u, bit, surfel_may_affect(disk.xyz, sender.normal, reach2, b5));
          n6 |= select(0u, bit, surfel_may_affect(disk.xyz, sender.normal, reach2, b6));
          n7 |= select(0u, bit, surfel_may_affect(disk.xyz, sender.normal, reach2, b7));
        }
        i++;
        continuing { break if i >= run; }
      }
      let mine = first / 32u;
      if n0 != 0u { atomicOr(&needed[mine], n0); }
      if n1 != 0u { atomicOr(&needed[WORDS + mine], n1); }
      if n2 != 0u { atomicOr(&needed[2u * WORDS + mine], n2); }
      if n3 != 0u { atomicOr(&needed[3u * WORDS + mine], n3); }
      if n4 != 0u { atomicOr(&needed[4u * WORDS + mine], n4); }
      if n5 != 0u { atomicOr(&needed[5u * WORDS + mine], n5); }
      if n6 != 0u { atomicOr(&needed[6u * WORDS + mine], n6); }
      if n7 != 0u { atomicOr(&needed[7u * WORDS + mine], n7); }
      workgroupBarrier();

      // What this unit needs of the round, in order.
      let words = divide_up(round_surfels, 32u);
      var word = 0u;
      var bits = 0u;
      var even = 0u;
      var odd = 0u;
      loop {
        while (bits == 0u) & (word < words) {
          bits = atomicLoad(&needed[unit * WORDS + word]);
          even = queue[word * 2u] * CLUSTER;
          odd = queue[word * 2u + 1u] * CLUSTER - CLUSTER;
          word++;
        }
        if bits == 0u {
          break;
        }
#if SUBGROUP
        // Each of the team loads one of the next: its own bit is the lowest after those of the lanes before it.
        var own_bits = bits;
        own_bits = select(own_bits & (own_bits - 1u), own_bits, mate < 1u);
        own_bits = select(own_bits & (own_bits - 1u), own_bits, mate < 2u);
        own_bits = select(own_bits & (own_bits - 1u), own_bits, mate < 3u);
        own_bits = select(own_bits & (own_bits - 1u), own_bits, mate < 4u);
        own_bits = select(own_bits & (own_bits - 1u), own_bits, mate < 5u);
        own_bits = select(own_bits & (own_bits - 1u), own_bits, mate < 6u);
        own_bits = select(own_bits & (own_bits - 1u), own_bits, mate < 7u);
        let count = min(countOneBits(bits), team);
        var own_disk = vec4f(0.0);
        var own_normal = vec3f(0.0);
        var own_radii2 = vec2f(0.0);
#if MATERIAL
        var own_material = 0u;
#endif
#if RADIANCE
        var own_front = vec3f(0.0);
        var own_back = vec3f(0.0);
#endif
        if own_bits != 0u {
          let k = firstTrailingBit(own_bits);
          let at = surfel_dealt(select(odd, even, k < CLUSTER) + k, sub_buffer, params.level);
          own_disk = surfels[at];
          let own_sender = sender_of(at, own_disk, sources[at]);
          own_normal = own_sender.normal;
          let radii = shell(own_sender);
          own_radii2 = radii * radii;
#if MATERIAL
          own_material = sources[at].material;
#endif
#if RADIANCE
          own_front = own_sender.front;
          own_back = own_sender.back;
#endif
        }
        bits = subgroupShuffle(own_bits, team_base + count - 1u);
        bits &= bits - 1u;
        var j = 0u;
        loop {
          let giver = team_base + j;
          let disk = subgroupShuffle(own_disk, giver);
          var sender: Sender;
          sender.radius = disk.w;
          sender.normal = subgroupShuffle(own_normal, giver);
          sender.share = level_share();
#if MATERIAL
          sender.material = material_of(subgroupShuffle(own_material, giver));
#endif
#if RADIANCE
          sender.front = subgroupShuffle(own_front, giver);
#if !ONE_SIDED
          sender.back = subgroupShuffle(own_back, giver);
#endif
#endif
          let radii2 = subgroupShuffle(own_radii2, giver);
#if VIEW
          var p = 0u;
          loop {
            own_sums[p] += pair(disk, sender, radii2, pixels[p]);
            p++;
            continuing { break if p >= PIXELS; }
          }
#else
          s0 += pair(disk, sender, radii2, q0);
          s1 += pair(disk, sender, radii2, q1);
          s2 += pair(disk, sender, radii2, q2);
          s3 += pair(disk, sender, radii2, q3);
          s4 += pair(disk, sender, radii2, q4);
          s5 += pair(disk, sender, radii2, q5);
          s6 += pair(disk, sender, radii2, q6);
          s7 += pair(disk, sender, radii2, q7);
#endif
#if STATISTICS
          evaluated += PIXELS;
#endif
          j++;
          continuing { break if j >= count; }
        }
#else
        loop {
          let k = firstTrailingBit(bits);
          bits &= bits - 1u;
          let at = surfel_dealt(select(odd, even, k < CLUSTER) + k, sub_buffer, params.level);
          let disk = surfels[at];
          let sender = sender_of(at, disk, sources[at]);
          let radii = shell(sender);
          let radii2 = radii * radii;
#if VIEW
          var p = 0u;
          loop {
            own_sums[p] += pair(disk, sender, radii2, pixels[p]);
            p++;
            continuing { break if p >= PIXELS; }
          }
#else
          s0 += pair(disk, sender, radii2, q0);
          s1 += pair(disk, sender, radii2, q1);
          s2 += pair(disk, sender, radii2, q2);
          s3 += pair(disk, sender, radii2, q3);
          s4 += pair(disk, sender, radii2, q4);
          s5 += pair(disk, sender, radii2, q5);
          s6 += pair(disk, sender, radii2, q6);
          s7 += pair(disk, sender, radii2, q7);
#endif
#if STATISTICS
          evaluated += PIXELS;
#endif
          continuing { break if bits == 0u; }
        }
#endif
      }
      round_base += QUEUE;
      workgroupBarrier();
      for (var n = thread; n < NEEDED; n += THREADS) {
        atomicStore(&needed[n], 0u);
      }
      continuing { break if round_base >= total; }
    }
    group_base += THREADS;
    atomicStore(&clusters_passed[thread * 2u], 0u);
    atomicStore(&clusters_passed[thread * 2u + 1u], 0u);
    if thread < 2u {
      atomicStore(&groups_passed[thread], 0u);
    }
    workgroupBarrier();
    continuing { break if group_base >= group_count; }
  }

#if VIEW
  s0 = own_sums[0]; s1 = own_sums[1]; s2 = own_sums[2]; s3 = own_sums[3];
  s4 = own_sums[4]; s5 = own_sums[5]; s6 = own_sums[6]; s7 = own_sums[7];
#endif
  let share = level_share();
  store_sum(q0, s0 * share); store_sum(q1, s1 * share); store_sum(q2, s2 * share); store_sum(q3, s3 * share);
  store_sum(q4, s4 * share); store_sum(q5, s5 * share); store_sum(q6, s6 * share); store_sum(q7, s7 * share);
#if STATISTICS
  atomicAdd(&statistics[params.level * 4u], evaluated);
  atomicAdd(&statistics[params.level * 4u + 1u], in_shell);
  atomicAdd(&statistics[params.level * 4u + 2u], contributing);
#endif
}

#endif

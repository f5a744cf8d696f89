// Surfelizer: triangles to surfels (Deep Screen Space 3.1; The Bounced Z-buffer 4.3).
//
//   count_pieces    one thread per triangle: how many pieces it is pre-split into
//   merge_pieces    the same where the cloud has no room for them all: large triangles are cut less, until they have
//   (prefix sum)
//   emit_pieces     the same walk again: writes the pieces and how many surfels each gives
//   (prefix sum)
//   finish          one thread: totals for the caller, and how many workgroups the last stage needs
//   emit_surfels    one thread per surfel: finds its piece, walks down to its leaf, places the disk
//
// A surface's area is cut so that a surfel covers `radius_pixels` pixels at its Euclidean distance from the eye. Large
// triangles are first split by longest-edge bisection until a piece is small against its distance, so that one radius
// serves a whole piece; a piece is then bisected j times, to 2^j leaves. Where no surfels are asked for, pieces are the
// triangles themselves, but for those that are huge against their distance.
//
// Every decision depends on a triangle, the camera and sums over all triangles, never on what other threads did: two runs
// give the same cloud, and a small step of the camera changes few of its surfels.

#import math
#import packing
#import hashing
#import camera
#import dispatch
#import surfel
#import triangle
#import slots
#import mesh
#import placed

struct Params {
  camera: Camera,
  // Inward planes (normal, offset) of the views to cull by, six each, in the cloud's space.
  planes: array<vec4f, 24>,
  view_count: u32,
  triangle_count: u32,
  piece_capacity: u32,
  surfel_capacity: u32,
  // Target radius in pixels.
  radius_pixels: f32,
  // Surfels of the target's area kept for each target area of small triangles; infinite keeps them whole.
  density: f32,
  // How far a surfel's effect reaches: a multiple of its radius, and a distance; the smaller one holds.
  reach_radii: f32,
  reach_world: f32,
  // The focus that the cloud is relative to, as two floats a coordinate: high + low.
  origin_high: vec3f,
  placement: u32,
  origin_low: vec3f,
  // Triangles of meshes without vertices, which nothing is dispatched for.
  without_vertices: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> pieces: array<Piece>;
@group(0) @binding(2) var<storage, read_write> piece_offsets: array<u32>;
@group(0) @binding(3) var<storage, read_write> counters: Counters;
// Sums over all triangles, of TALLY_WORDS words.
@group(0) @binding(4) var<storage, read_write> tally: array<atomic<u32>, TALLY_WORDS>;

@group(1) @binding(0) var<uniform> mesh: Mesh;
@group(1) @binding(1) var<storage, read> vertices: array<u32>;
@group(1) @binding(2) var<storage, read> indices: array<u32>;
@group(1) @binding(3) var<storage, read> transforms: array<u32>;
@group(1) @binding(4) var<storage, read_write> triangle_offsets: array<u32>;

@group(1) @binding(5) var<storage, read_write> surfels: array<vec4f>;
@group(1) @binding(6) var<storage, read_write> sources: array<SurfelSource>;
// The indirect dispatch of emit_surfels.
@group(1) @binding(7) var<storage, read_write> emission: array<u32, 3>;

alias Counter = atomic<u32>;

const PLACE_CENTROID: u32 = 0u;
const PLACE_RANDOM: u32 = 1u;
const PLACE_GRID: u32 = 2u;

// Words of the tally: the bits of the largest triangle's area_root(), triangles that have a piece, and sums of two words,
// the lower one first: pieces, the surfels that they ask for, those of merged pieces, and area in all and lost, in units of
// 2^-31 of the largest triangle's.
const TALLY_WORDS: u32 = 12u;
const TALLY_LARGEST: u32 = 0u;
const TALLY_TRIANGLES: u32 = 1u;
const TALLY_PIECES: u32 = 2u;
const TALLY_SURFELS: u32 = 4u;
const TALLY_MERGED_SURFELS: u32 = 6u;
const TALLY_AREA: u32 = 8u;
const TALLY_LOST: u32 = 10u;

// A piece's longest edge is at most this fraction of its distance from the eye, so that its leaves' projected radii
// differ little from that of its centroid.
const PIECE_EXTENT: f32 = 0.5;
// For rays alone: at most this multiple of the distance of the piece's nearest point. A hit is then off the piece's plane by
// a third at most of what rays start off surfaces by; with triangles 10000 times as large as they are near it is by ten
// times that, and what is lit where rays hit would shadow itself.
const RAY_PIECE_EXTENT: f32 = 16.0;
// A piece that is partly out of reach is split while it has more than 2^16 leaves.
const CULLED_ORDER: f32 = 16.0;
// A piece has at most 2^24 leaves, or as many segments a side of the grid.
const MAX_ORDER: u32 = 24u;
const MAX_GRID_LEVEL: u32 = 4000u;
// Bounds of the walk: beyond them a node is taken as it is, coarser than asked for but with its area. A triangle that
// spans eight decades of distance takes 30000 rounds. Lavapipe (Mesa 22.3) leaves all loops of a thread after 65535 rounds
// in all, without a word, and threads that run side by side count those of the longest: so the walk is a single loop,
// each of whose rounds is a step, and its last nodes take 3600 rounds at most.
const MAX_DEPTH: u32 = 60u;
const MAX_ROUNDS: u32 = 48000u;
// The same for all that is tried for how coarse a triangle is to be cut; what was found is then walked once more.
const MAX_SEARCH_ROUNDS: u32 = 28000u;
// The walk goes back down from a node at a multiple of this depth, at least as far above where it goes to.
const ANCHOR_STEP: u32 = 4u;
// a below which round(log2(a)) is negative: 1 / sqrt(2).
const SMALL_AREA: f32 = 0.70710678;

// The square root of the area: of the range of a length, where the area itself may not be.
fn area_root(t: Triangle) -> f32 {
  let v = area_vector(t);
  return v.scale * sqrt(0.5 * length(v.direction));
}

// The radius that a surfel at p should have. Euclidean distance: the view depth of the paper explodes beside the camera.
fn target_radius(p: vec3f) -> f32 {
  return params.radius_pixels * footprint(params.camera, p - params.camera.eye);
}

// The area of a triangle in units of the target's, pi r*^2.
fn relative_area(t: Triangle) -> f32 {
  let x = area_root(t) / target_radius(centroid(t));
  return x * x / PI;
}

// How often a piece of relative area a is bisected: round(log2(a)).
fn bisections(a: f32) -> u32 {
  return u32(clamp(floor(log2(a) + 0.5), 0.0, f32(MAX_ORDER)));
}

// The tessellation level of Deep Screen Space 3.1 that gives a piece of relative area a at least a surfels: solved from
// 3/4 i^2 + 3/2 i + 1 = a.
fn grid_level(a: f32) -> u32 {
  return u32(clamp(ceil(sqrt(max(12.0 * a - 3.0, 0.0)) / 3.0 - 1.0), 1.0, f32(MAX_GRID_LEVEL)));
}

fn surfels_of(shape: u32) -> u32 {
  let order = shape & SHAPE_ORDER;
  if (shape & SHAPE_SMALL) != 0u {
    return 1u;
  }
  if params.placement != PLACE_GRID {
    return 1u << order;
  }
  let half = (order + 1u) / 2u;
  return select(3u * half * (half + 1u) + 1u, 3u * half * half, (order & 1u) != 0u);
}

// How much of a triangle has surfels whose reach any view can see.
const WITHIN_REACH: u32 = 0u;
const PARTLY: u32 = 1u;
const OUT_OF_REACH: u32 = 2u;

// How far a point is within a view's planes; negative outside.
fn in_view(view: u32, p: vec3f) -> f32 {
  let point = vec4f(p, 1.0);
  let i = view * 6u;
  let sides = min(
    min(dot(params.planes[i], point), dot(params.planes[i + 1u], point)),
    min(dot(params.planes[i + 2u], point), dot(params.planes[i + 3u], point)),
  );
  return min(sides, min(dot(params.planes[i + 4u], point), dot(params.planes[i + 5u], point)));
}

fn seen_by_views(t: Triangle) -> u32 {
  if params.view_count == 0u {
    return WITHIN_REACH;
  }
  let center = centroid(t);
  let extent = sqrt(max(length2(t.a - center), max(length2(t.b - center), length2(t.c - center))));
  // The largest radius that a surfel of this triangle can get: rounding to a power of two gives a factor of 2^(1/4), and
  // thinning one of density^(-1/2).
  let farthest = params.camera.pixel
    * select(1.0, max(length(center - params.camera.eye) + extent, params.camera.near), params.camera.perspective != 0u);
  let radius = 1.25 * params.radius_pixels * farthest * max(1.0, inverseSqrt(params.density));
  let reach = min(params.reach_radii * radius, params.reach_world);
  // Not a loop: its rounds would count (MAX_ROUNDS).
  var inside = in_view(0u, center);
  inside = select(inside, max(inside, in_view(1u, center)), params.view_count > 1u);
  inside = select(inside, max(inside, in_view(2u, center)), params.view_count > 2u);
  inside = select(inside, max(inside, in_view(3u, center)), params.view_count > 3u);
  if inside < -reach - extent {
    return OUT_OF_REACH;
  }
  // Of pieces smaller than their reach hardly fewer would be.
  return select(WITHIN_REACH, PARTLY, inside < extent - reach && extent > reach);
}

// What the walk does with a triangle.
const CULL: u32 = 0u;
const SPLIT: u32 = 1u;
const TAKE: u32 = 2u;

// How much coarser than asked for a triangle is cut, in powers of two of a piece's extent; WHOLE is not cut at all.
const WHOLE: u32 = 31u;

fn classify(t: Triangle, coarseness: u32) -> u32 {
  let seen = seen_by_views(t);
  if seen == OUT_OF_REACH {
    return CULL;
  }
  if coarseness == WHOLE {
    return TAKE;
  }
  if params.camera.perspective != 0u {
    let center = centroid(t);
    let edge = sqrt(max(length2(t.b - t.a), max(length2(t.c - t.b), length2(t.a - t.c))));
    let from_eye = center - params.camera.eye;
    var extent = PIECE_EXTENT * max(length(from_eye), params.camera.near);
    if params.surfel_capacity == 0u {
      // The nearest point is no nearer than the plane, nor than the circle around the centroid.
      let normal = normalize_or(area_vector(t).direction, vec3f(0.0));
      let nearest = max(abs(dot(normal, from_eye)), length(from_eye) - edge * (2.0 / 3.0));
      extent = RAY_PIECE_EXTENT * max(nearest, params.camera.near);
    }
    if edge > extent * f32(1u << coarseness) {
      return SPLIT;
    }
  }
  let large = log2(relative_area(t)) > CULLED_ORDER + 2.0 * f32(coarseness);
  return select(TAKE, SPLIT, seen == PARTLY && large && params.surfel_capacity != 0u);
}

// The shape of a piece, or NO_SHAPE for a small one that thinning drops.
const NO_SHAPE: u32 = 0xffffffffu;

fn piece_shape(t: Triangle, triangle: u32, path: u32) -> u32 {
  let a = relative_area(t);
  let tag = path << SHAPE_PATH_SHIFT;
  if a < SMALL_AREA {
    // Kept with the probability that keeps the expected area, density * a; the paper prints its inverse. The golden
    // ratio spreads the kept ones evenly along the triangles' order.
    let draw = unit_float(triangle * 2654435769u + hash(path) * select(0u, 1u, path != 0u));
    return select(NO_SHAPE, tag | SHAPE_SMALL, draw < params.density * a);
  }
  if params.placement == PLACE_GRID {
    return tag | grid_level(a);
  }
  return tag | bisections(a);
}

// What is written for a small triangle that thinning kept: one of the area that it stands for, the target's divided by
// the density, at its place and in its plane. Equilateral, since a sliver enlarged would reach far beyond its surface.
fn stand_in(t: Triangle, shape: u32) -> Triangle {
  let a = relative_area(t);
  if (shape & SHAPE_SMALL) == 0u || params.density * a >= 1.0 {
    return t;
  }
  let center = centroid(t);
  let normal = normalize_or(area_vector(t).direction, vec3f(0.0, 0.0, 1.0));
  let tangent = normalize_or(t.b - t.a, vec3f(1.0, 0.0, 0.0));
  // The area is 3 sqrt(3) / 4 times the square of the circumradius.
  let radius = target_radius(center) * inverseSqrt(params.density) * sqrt(PI / 1.29903811);
  let up = tangent * radius;
  let aside = cross(normal, tangent) * radius * 0.86602540;
  return Triangle(center + up, center - 0.5 * up + aside, center - 0.5 * up - aside);
}

// The path from a triangle to a node of its bisection tree: bit d of it is the side taken at depth d.
struct Path {
  bits: vec2u,
  depth: u32,
}

fn path_side(path: Path, depth: u32) -> u32 {
  let word = select(path.bits.x, path.bits.y, depth >= 32u);
  return (word >> (depth & 31u)) & 1u;
}

// The path to one half of a node that has to be split.
fn path_into(path: Path, side: u32) -> Path {
  let bit = side << (path.depth & 31u);
  return Path(path.bits | select(vec2u(bit, 0u), vec2u(0u, bit), path.depth >= 32u), path.depth + 1u);
}

// The lower bits of a word.
fn low_bits(word: u32, count: u32) -> u32 {
  return select(word & ((1u << (count & 31u)) - 1u), word, count >= 32u);
}

// The path to the next node to the right: up past the second halves, over to the second half of the first that is open.
// Of depth 0 after the last one. No bit of where the walk has been stays behind: the hash of a path is that of its node
// alone.
fn path_to_next(path: Path) -> Path {
  let first = low_bits(~path.bits.x, path.depth);
  let second = low_bits(~path.bits.y, max(path.depth, 32u) - 32u);
  if (first | second) == 0u {
    return Path(vec2u(0u), 0u);
  }
  let depth = select(firstLeadingBit(first), 32u + firstLeadingBit(second), second != 0u);
  let above = vec2u(low_bits(path.bits.x, depth), low_bits(path.bits.y, max(depth, 32u) - 32u));
  return path_into(Path(above, depth), 1u);
}

// 19 bits that tell the pieces of a triangle apart; 0 for the whole triangle.
fn path_hash(path: Path) -> u32 {
  if path.depth == 0u {
    return 0u;
  }
  return hash2(path.bits.x, hash2(path.bits.y, path.depth)) >> SHAPE_PATH_SHIFT;
}

// A number of 64 bits.
struct Wide {
  low: u32,
  high: u32,
}

fn wide_add(a: Wide, b: u32) -> Wide {
  let low = a.low + b;
  return Wide(low, a.high + select(0u, 1u, low < b));
}

fn tally_wide(at: u32) -> Wide {
  return Wide(atomicLoad(&tally[at]), atomicLoad(&tally[at + 1u]));
}

fn tally_add(at: u32, value: Wide) {
  let carry = wide_add(Wide(atomicAdd(&tally[at], value.low), value.high), value.low).high;
  if carry != 0u {
    atomicAdd(&tally[at + 1u], carry);
  }
}

fn saturated(value: Wide) -> u32 {
  return select(value.low, 0xffffffffu, value.high != 0u);
}

// Whether the pieces as asked for are more than the cloud has room for.
fn is_merged() -> bool {
  return saturated(tally_wide(TALLY_PIECES)) > params.piece_capacity;
}

// How many of its pieces a triangle that asks for `asked` may keep where they are merged: one, and its share of the room
// that one of each triangle leaves.
fn quota_of(asked: u32) -> u32 {
  let triangles = atomicLoad(&tally[TALLY_TRIANGLES]);
  let pieces = tally_wide(TALLY_PIECES);
  let spare = max(params.piece_capacity, triangles) - triangles;
  // Both in 32 bits.
  let low = pieces.low - triangles;
  let high = pieces.high - select(0u, 1u, pieces.low < triangles);
  let shift = 32u - countLeadingZeros(high);
  let more = select(((low >> shift) | (high << ((32u - shift) & 31u))) + 1u, low, shift == 0u);
  if (spare >> shift) >= more {
    return asked;
  }
  return 1u + multiply_high(asked - 1u, keep_ratio(more, spare >> shift));
}

// How often each piece is bisected less than asked for, so that the number of all surfels stays below 2^32.
fn coarser_by() -> u32 {
  let surfels = tally_wide(select(TALLY_SURFELS, TALLY_MERGED_SURFELS, is_merged()));
  return select(33u - countLeadingZeros(surfels.high), surfels.low >> 31u, surfels.high == 0u);
}

// A piece's shape bisected less.
fn coarser(shape: u32, by: u32) -> u32 {
  let order = shape & SHAPE_ORDER;
  let rest = shape & ~SHAPE_ORDER;
  if params.placement == PLACE_GRID {
    return rest | min(order, max(order >> ((by + 1u) / 2u), 1u));
  }
  return rest | (max(order, by) - by);
}

// Area in the tally's units.
fn area_share(t: Triangle) -> u32 {
  let x = area_root(t) / bitcast<f32>(atomicLoad(&tally[TALLY_LARGEST]));
  return u32(min(x * x, 1.0) * 2147483648.0);
}

struct Cut {
  pieces: u32,
  // That the pieces ask for.
  surfels: Wide,
}

const NO_QUOTA: u32 = 0xffffffffu;

// Walks the bisection tree of a triangle from left to right. With a quota the tree is cut coarser, a power of two at a
// time, until it gives no more pieces than that. With `write` the pieces are written from `first_piece` on.
fn walk(root: Triangle, triangle: u32, quota: u32, write: bool, first_piece: u32) -> Cut {
  var path = Path(vec2u(0u), 0u);
  // The current node is that of the path, or one above it on the way down.
  var node = root;
  var depth = 0u;
  // Another one on the way. Going down from the root each time would take most of the walk.
  var anchor = root;
  var anchor_depth = 0u;
  var searching = quota != NO_QUOTA;
  var coarseness = select(0u, 1u, searching);
  var cut = Cut(0u, Wide(0u, 0u));
  var total = 0u;
  var by = 0u;
  if write {
    total = triangle_offsets[params.triangle_count];
    by = coarser_by();
  }
  for (var round = 0u; true; round++) {
    if depth < path.depth {
      if depth % ANCHOR_STEP == 0u && path.depth - depth >= ANCHOR_STEP {
        anchor = node;
        anchor_depth = depth;
      }
      node = bisect(node, path_side(path, depth));
      depth++;
      continue;
    }
    let verdict = classify(node, coarseness);
    if verdict == SPLIT && path.depth < MAX_DEPTH && (round < MAX_ROUNDS || quota != NO_QUOTA) {
      path = path_into(path, 0u);
      node = bisect(node, 0u);
      depth++;
      continue;
    }
    if verdict != CULL {
      let shape = piece_shape(node, triangle, path_hash(path));
      if shape != NO_SHAPE {
        if write && !searching {
          emit_piece(stand_in(node, shape), coarser(shape, by), triangle, first_piece + cut.pieces, total);
        }
        cut.pieces++;
        cut.surfels = wide_add(cut.surfels, surfels_of(shape));
      }
    }
    path = path_to_next(path);
    if searching {
      let late = round >= MAX_SEARCH_ROUNDS && coarseness != WHOLE;
      if late || (path.depth == 0u && cut.pieces > quota) {
        // Once more, and coarser. Not before the end of the walk, so that any quota finds the same in as many rounds.
        coarseness = select(coarseness + 1u, WHOLE, late);
        cut = Cut(0u, Wide(0u, 0u));
        path = Path(vec2u(0u), 0u);
      } else if path.depth == 0u {
        if !write {
          break;
        }
        searching = false;
        cut = Cut(0u, Wide(0u, 0u));
      }
    } else if path.depth == 0u {
      break;
    }
    if anchor_depth >= path.depth {
      anchor = root;
      anchor_depth = 0u;
    }
    node = anchor;
    depth = anchor_depth;
  }
  return cut;
}

fn emit_piece(t: Triangle, shape: u32, triangle: u32, index: u32, total: u32) {
  let room = slot_for(index, total, params.piece_capacity);
  if room != NO_ROOM {
    pieces[room] = Piece(t.a, mesh.material, t.b, shape, t.c, triangle);
    piece_offsets[room] = surfels_of(shape);
  }
  if total > params.piece_capacity {
    let area = Wide(area_share(t), 0u);
    tally_add(TALLY_AREA, area);
    if room == NO_ROOM {
      tally_add(TALLY_LOST, area);
    }
  }
}

// What the triangles of a workgroup sum up to.
var<workgroup> group_largest: atomic<u32>;
var<workgroup> group_triangles: atomic<u32>;
var<workgroup> group_pieces: atomic<u32>;
var<workgroup> group_surfels: array<atomic<u32>, 2>;
var<workgroup> group_rejected: atomic<u32>;

fn group_clear(thread: u32) {
  if thread == 0u {
    atomicStore(&group_largest, 0u);
    atomicStore(&group_triangles, 0u);
    atomicStore(&group_pieces, 0u);
    atomicStore(&group_surfels[0], 0u);
    atomicStore(&group_surfels[1], 0u);
    atomicStore(&group_rejected, 0u);
  }
  workgroupBarrier();
}

fn group_add(cut: Cut) {
  atomicAdd(&group_triangles, min(cut.pieces, 1u));
  atomicAdd(&group_pieces, cut.pieces);
  let low = atomicAdd(&group_surfels[0], cut.surfels.low);
  atomicAdd(&group_surfels[1], wide_add(Wide(low, cut.surfels.high), cut.surfels.low).high);
}

fn group_sum_of_surfels() -> Wide {
  return Wide(atomicLoad(&group_surfels[0]), atomicLoad(&group_surfels[1]));
}

@compute @workgroup_size(64)
fn count_pieces(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  group_clear(thread);
  if i < mesh.triangles * mesh.instances {
    let root = fetch(i);
    let size = area_root(root);
    var cut = Cut(0u, Wide(0u, 0u));
    if size > 0.0 {
      cut = walk(root, mesh.first_triangle + i, NO_QUOTA, false, 0u);
      atomicMax(&group_largest, bitcast<u32>(size));
      group_add(cut);
    } else {
      atomicAdd(&group_rejected, 1u);
    }
    triangle_offsets[mesh.first_triangle + i] = cut.pieces;
  }
  workgroupBarrier();
  if thread == 0u {
    atomicMax(&tally[TALLY_LARGEST], atomicLoad(&group_largest));
    atomicAdd(&tally[TALLY_TRIANGLES], atomicLoad(&group_triangles));
    tally_add(TALLY_PIECES, Wide(atomicLoad(&group_pieces), 0u));
    tally_add(TALLY_SURFELS, group_sum_of_surfels());
    atomicAdd(&counters.rejected, atomicLoad(&group_rejected));
  }
}

@compute @workgroup_size(64)
fn merge_pieces(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  group_clear(thread);
  if is_merged() && i < mesh.triangles * mesh.instances {
    let triangle = mesh.first_triangle + i;
    let asked = triangle_offsets[triangle];
    if asked > 0u {
      let cut = walk(fetch(i), triangle, quota_of(asked), false, 0u);
      group_add(cut);
      triangle_offsets[triangle] = cut.pieces;
    }
  }
  workgroupBarrier();
  if thread == 0u && is_merged() {
    tally_add(TALLY_MERGED_SURFELS, group_sum_of_surfels());
  }
}

@compute @workgroup_size(64)
fn emit_pieces(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= mesh.triangles * mesh.instances {
    return;
  }
  let triangle = mesh.first_triangle + i;
  let first = triangle_offsets[triangle];
  let count = triangle_offsets[triangle + 1u] - first;
  if count == 0u {
    return;
  }
  if first == 0u {
    // One triangle has the first piece: it leaves the total for the next stages.
    counters.pieces = triangle_offsets[params.triangle_count];
  }
  walk(fetch(i), triangle, select(NO_QUOTA, count, is_merged()), true, first);
}

@compute @workgroup_size(1)
fn finish() {
  atomicAdd(&counters.rejected, params.without_vertices);
  let total = piece_offsets[params.piece_capacity];
  counters.surfels = total;
  counters.stored = min(total, params.surfel_capacity);
  let asked = saturated(tally_wide(TALLY_PIECES));
  counters.merged = max(asked, counters.pieces) - counters.pieces;
  let lost = tally_wide(TALLY_LOST);
  if (lost.low | lost.high) != 0u {
    let all = tally_wide(TALLY_AREA);
    let share = (f32(lost.high) + f32(lost.low) / 4294967296.0) / (f32(all.high) + f32(all.low) / 4294967296.0);
    counters.lost_area = max(u32(min(share, 0.99999994) * 4294967296.0), 1u);
  }
  let workgroups = (counters.stored + 63u) / 64u;
  emission = array<u32, 3>(min(workgroups, DISPATCH_ROW), (workgroups + DISPATCH_ROW - 1u) / DISPATCH_ROW, 1u);
}

// Uniform over a triangle (Turk 1990).
fn random_point(t: Triangle, key: u32) -> vec3f {
  let u = sqrt(unit_float(hash(key)));
  let v = unit_float(hash(key ^ 0x5bd1e995u));
  return t.a * (1.0 - u) + t.b * (u * (1.0 - v)) + t.c * (u * v);
}

// Vertex k of the pattern of Deep Screen Space 3.1: concentric triangles with `level`, level - 2, ... segments a side.
fn grid_point(t: Triangle, k: u32, level: u32) -> vec3f {
  let center = centroid(t);
  var ring = level;
  var at = k;
  while ring > 0u && at >= 3u * ring {
    at -= 3u * ring;
    ring = select(0u, ring - 2u, ring >= 2u);
  }
  if ring == 0u {
    return center;
  }
  let along = f32(at % ring) / f32(ring);
  var p = mix(t.a, t.b, along);
  if at / ring == 1u {
    p = mix(t.b, t.c, along);
  } else if at / ring == 2u {
    p = mix(t.c, t.a, along);
  }
  return mix(center, p, f32(ring) / f32(level));
}

// Moves a corner towards the centre by r, but not beyond it.
fn inset(corner: vec3f, center: vec3f, r: f32) -> vec3f {
  let d = center - corner;
  let l = length(d);
  return corner + d * min(1.0, r / max(l, 1e-30));
}

fn place(t: Triangle, normal: vec3f, shape: u32, leaf: u32, key: u32, radius: f32) -> vec3f {
  if (shape & SHAPE_SMALL) != 0u {
    return centroid(t);
  }
  let order = shape & SHAPE_ORDER;
  if params.placement == PLACE_CENTROID {
    return centroid(leaf_of(t, leaf, order));
  }
  if params.placement == PLACE_RANDOM {
    return random_point(t, key);
  }
  let center = centroid(t);
  let inner = Triangle(inset(t.a, center, radius), inset(t.b, center, radius), inset(t.c, center, radius));
  // Jittered within the triangle's plane, uniformly over a disk of the surfel's radius.
  let tangent = normalize_or(t.b - t.a, vec3f(1.0, 0.0, 0.0));
  let bitangent = cross(normal, tangent);
  let distance = radius * sqrt(unit_float(hash(key)));
  let angle = 2.0 * PI * unit_float(hash(key ^ 0x5bd1e995u));
  return grid_point(inner, leaf, order) + distance * (cos(angle) * tangent + sin(angle) * bitangent);
}

@compute @workgroup_size(64)
fn emit_surfels(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= counters.stored {
    return;
  }
  let total = counters.surfels;
  let item = item_of(i, total, params.surfel_capacity);
  // The last piece whose first surfel is not beyond this one.
  var low = 0u;
  var high = min(counters.pieces, params.piece_capacity) - 1u;
  while low < high {
    let middle = low + (high - low + 1u) / 2u;
    if piece_offsets[middle] <= item {
      low = middle;
    } else {
      high = middle - 1u;
    }
  }
  let piece = pieces[low];
  let leaf = item - piece_offsets[low];
  let t = Triangle(piece.a, piece.b, piece.c);
  let normal = normalize_or(area_vector(t).direction, vec3f(0.0, 0.0, 1.0));

  var radius = area_root(t) * inverseSqrt(PI * f32(surfels_of(piece.shape)));
  // What overflow dropped is made up for in area by those that stay.
  radius *= sqrt(max(1.0, f32(total) / f32(params.surfel_capacity)))
    * sqrt(max(1.0, f32(counters.pieces) / f32(params.piece_capacity)));

  let key = hash2(hash2(piece.triangle, piece.shape >> SHAPE_PATH_SHIFT), leaf);
  surfels[i] = vec4f(place(t, normal, piece.shape, leaf, key, radius), radius);
  sources[i] = SurfelSource(pack_normal(normal), low, leaf, piece.material);
}

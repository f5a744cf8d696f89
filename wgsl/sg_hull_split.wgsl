// Flat quads that do not fit, split in four until their parts do (src/sg_hull): where light is to be gathered, and what to do
// with the parts when it has been.
//
//   place_points  a thread a point
//   divide        a thread a split
//
// @group(0) @binding(0) params, 1 receivers, 2 the segment of each pixel, 3 segments, 4 counters, 5 the splits, 6 the parts
// that fit, 7 the list of what does not

#import sg_hull
#import dispatch
#import sg_hull_split
#import sg_hull_error
#import sg_hull_corner

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var receivers: texture_2d<u32>;
@group(0) @binding(2) var<storage, read> segment_of: array<u32>;
@group(0) @binding(3) var<storage, read> segments: array<Segment>;
@group(0) @binding(4) var<storage, read_write> counters: SplitCounters;
@group(0) @binding(5) var<storage, read_write> splits: array<Split>;
@group(0) @binding(6) var<storage, read_write> parts: array<Part>;
@group(0) @binding(7) var<storage, read_write> rejected: array<RejectedQuad>;

// Counters.
struct SplitCounters {
  segments: u32,
  fallbacks: u32,
  fallback_pixels: u32,
  gathered: u32,
  draw: vec4u,
  rejected: atomic<u32>,
  per_pixel: u32,
  mean_irradiance: f32,
  splits: atomic<u32>,
  points: vec4u,
  part_vertices: u32,
  parts: atomic<u32>,
  first_vertex: u32,
  first_instance: u32,
  round: vec2u,
  padding: vec2u,
}

// How much the whole's being off at a part's points counts as the part's error. Of what is off there a quarter is left in
// the part where light is smooth, half of it where it has a kink.
const OFF_SHARE: f32 = 3.0;
// How much its corners' being apart does: what is steep may have been right at the points by chance.
const APART_SHARE: f32 = 0.25;

// Places of the points of a split on its lattice of 3 x 3.
const POINTS: array<u32, 5> = array(1u, 3u, 4u, 5u, 7u);

@compute @workgroup_size(64)
fn place_points(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let k = linear_workgroup(workgroup) * 64u + thread;
  let i = counters.round.x + k / SPLIT_POINTS;
  if i >= counters.round.y {
    return;
  }
  let slot = splits[i].whole.slot;
  let segment = segments[slot];
  let low = unpack_pixel(splits[i].whole.low);
  let high = unpack_pixel(splits[i].whole.high);
  var lattice = POINTS;
  let at = lattice[k % SPLIT_POINTS];
  let middle = middle_of(low, high);
  let column = at % 3u;
  let row = at / 3u;
  let edge = vec2u(select(select(high.x, middle.x, column == 1u), low.x, column == 0u),
    select(select(high.y, middle.y, row == 1u), low.y, row == 0u));
  // Of the four pixels around it the last that is the segment's own.
  var pixel = min(edge, segment.rect.zw - 1u);
  for (var j = 1u; j < 4u; j++) {
    let other = clamp(edge - vec2u(j & 1u, j >> 1u), segment.rect.xy, segment.rect.zw - 1u);
    pixel = select(pixel, other, is_of_segment(other, slot));
  }
  let place = place_at(segment, slot, edge, pixel);
  splits[i].points[k % SPLIT_POINTS] = SplitPoint(place.position, pack_normal(place.normal), vec3f(0.0),
    view_depth(params, place.position));
}

// What a rasteriser shows of corners at a point of their rectangle, 0 to 1 across: two triangles.
fn shown(corners: array<vec4f, 4>, at: vec2f) -> vec3f {
  let upper = vec4f(1.0 - at.x - at.y, at.x, at.y, 0.0);
  let lower = vec4f(0.0, 1.0 - at.y, 1.0 - at.x, at.x + at.y - 1.0);
  let depths = vec4f(corners[0].w, corners[1].w, corners[2].w, corners[3].w);
  let farthest = max(max(depths.x, depths.y), max(depths.z, depths.w));
  let w = select(vec4f(1.0), clamp(depths / max(farthest, 1e-30), vec4f(1e-6), vec4f(1.0)), params.camera.perspective != 0u);
  let weights = select(lower, upper, at.x + at.y <= 1.0) / w;
  let sum = weights.x * corners[0].xyz + weights.y * corners[1].xyz + weights.z * corners[2].xyz + weights.w * corners[3].xyz;
  return sum / max(dot(weights, vec4f(1.0)), 1e-30);
}

@compute @workgroup_size(64)
fn divide(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = counters.round.x + linear_workgroup(workgroup) * 64u + thread;
  if i >= counters.round.y {
    return;
  }
  let split = splits[i];
  let low = unpack_pixel(split.whole.low);
  let high = unpack_pixel(split.whole.high);
  let middle = middle_of(low, high);
  let share = vec2f(middle - low) / vec2f(high - low);
  var lattice: array<vec4f, 9>;
  var places = POINTS;
  for (var k = 0u; k < 4u; k++) {
    lattice[(k & 1u) * 2u + (k >> 1u) * 6u] = split.whole.corners[k];
  }
  // How far the whole's light is off at each point.
  var off: array<f32, 9>;
  for (var k = 0u; k < SPLIT_POINTS; k++) {
    let place = places[k];
    let here = split.points[k];
    lattice[place] = vec4f(here.irradiance, here.depth);
    let column = place % 3u;
    let row = place / 3u;
    let at = vec2f(select(select(1.0, share.x, column == 1u), 0.0, column == 0u),
      select(select(1.0, share.y, row == 1u), 0.0, row == 0u));
    let right = average(here.irradiance);
    off[place] = relative_error(OFF_SHARE * abs(average(shown(split.whole.corners, at)) - right), right,
      counters.mean_irradiance);
  }
  for (var k = 0u; k < 4u; k++) {
    let column = k & 1u;
    let row = k >> 1u;
    let first = column + 3u * row;
    let part_low = vec2u(select(low.x, middle.x, column != 0u), select(low.y, middle.y, row != 0u));
    let part_high = vec2u(select(middle.x, high.x, column != 0u), select(middle.y, high.y, row != 0u));
    let part = Part(pack_pixel(part_low), pack_pixel(part_high), split.whole.slot, 0u,
      array(lattice[first], lattice[first + 1u], lattice[first + 3u], lattice[first + 4u]));
    // No number is no fit.
    var fits = true;
    var least = MAX_F32;
    var most = 0.0;
    for (var j = 0u; j < 4u; j++) {
      let at = first + (j & 1u) + (j >> 1u) * 3u;
      let light = average(lattice[at].xyz);
      fits = fits && off[at] < params.error_threshold;
      least = min(least, light);
      most = max(most, light);
    }
    if fits && relative_error(APART_SHARE * (most - least), least, counters.mean_irradiance) < params.error_threshold {
      parts[atomicAdd(&counters.parts, 1u)] = part;
      continue;
    }
    if can_be_split(part_low, part_high) {
      let next = atomicAdd(&counters.splits, 1u);
      if next < params.split_room {
        splits[next].whole = part;
        continue;
      }
    }
    rejected[atomicAdd(&counters.rejected, 1u)] = RejectedQuad(part.slot, part.low, part.high, 0u);
  }
}

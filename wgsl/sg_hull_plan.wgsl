// From what was counted to the arguments of the indirect draws and dispatches (src/sg_hull).
//
// @group(0) @binding(0) params, 1 counters, 2 arguments of the dispatch, and a padding

#import sg_hull
#import dispatch
#import sg_hull_split

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> counters: Counters;
@group(0) @binding(2) var<storage, read_write> dispatch: vec4u;

fn groups_of(count: u32, size: u32) -> vec4u {
  let groups = (count + size - 1u) / size;
  return vec4u(min(groups, DISPATCH_ROW), (groups + DISPATCH_ROW - 1u) / DISPATCH_ROW, 1u, 0u);
}

// One thread per vertex.
@compute @workgroup_size(1)
fn plan_vertices() {
  let count = min(counters.segments, first_fallback(params)) + counters.fallbacks;
  counters.draw = vec4u(4u, count, 0u, 0u);
  dispatch = groups_of(4u * count, 64u);
}

// One thread per vertex that light is gathered at.
@compute @workgroup_size(1)
fn plan_gather() {
  dispatch = groups_of(counters.gathered, 64u);
}

// One thread per quad.
@compute @workgroup_size(1)
fn plan_classify() {
  dispatch = groups_of(counters.draw.y, 64u);
}

// A thread a point of the splits that there are since the last round.
@compute @workgroup_size(1)
fn plan_points() {
  counters.round = vec2u(counters.round.y, min(counters.splits, params.split_room));
  counters.parts = vec4u(4u, counters.parts.y, 0u, 0u);
  dispatch = groups_of(SPLIT_POINTS * (counters.round.y - counters.round.x), 64u);
}

// A thread a split of the round.
@compute @workgroup_size(1)
fn plan_divide() {
  dispatch = groups_of(counters.round.y - counters.round.x, 64u);
}

// A workgroup a quad, or a part of one.
@compute @workgroup_size(1)
fn plan_list() {
  dispatch = groups_of(counters.rejected, 1u);
}

// A thread, and a point, a pixel.
@compute @workgroup_size(1)
fn plan_pixels() {
  let count = min(counters.per_pixel, params.per_pixel_capacity);
  dispatch = groups_of(count, 64u);
  counters.points = vec4u(count, 1u, 0u, 0u);
}

// From the number of segments to the arguments of the indirect draw and dispatch (src/sg_hull).
//
// @group(0) @binding(0) params, 1 counters

#import sg_hull
#import dispatch

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> counters: Counters;

// Four vertices of eight threads each in a workgroup of 64: as in wgsl/sg_hull_gather.wgsl.
const SEGMENTS_A_WORKGROUP: u32 = 2u;

@compute @workgroup_size(1)
fn plan() {
  let count = min(counters.segments, first_fallback(params)) + counters.fallbacks;
  counters.draw = vec4u(4u, count, 0u, 0u);
  let groups = (count + SEGMENTS_A_WORKGROUP - 1u) / SEGMENTS_A_WORKGROUP;
  counters.dispatch = vec4u(min(groups, DISPATCH_ROW), (groups + DISPATCH_ROW - 1u) / DISPATCH_ROW, 1u, 0u);
}

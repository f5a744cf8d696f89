// Bvh, first stage: primitives are put in an order of space.
//
//   plan       one workgroup: how many workgroups the others need
//   measure    one thread per primitive: bounds of the centres
//   make_keys  one thread per primitive: its place along a Morton curve
//   (sort)

#import math
#import hashing
#import dispatch
#import surfel
#if INSTANCES
#import instance
#endif
#import slots

alias Counter = u32;
alias StateWord = atomic<u32>;

#import bvh_build

struct Params {
  // Primitives that there is room for.
  capacity: u32,
  // Of blocks of clusters, or of nodes from the root on.
  level: u32,
  // Of a dispatch that takes what there is in turn.
  threads: u32,
  padding: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> counters: Counters;
@group(0) @binding(2) var<storage, read> primitives: array<Primitive>;
@group(0) @binding(3) var<storage, read_write> state: State;
// Indirect dispatches: one with one thread per primitive, then one per level of clustering.
@group(0) @binding(4) var<storage, read_write> dispatches: array<u32>;
// Pairs of a key and a primitive.
@group(0) @binding(5) var<storage, read_write> items: array<vec2u>;

fn plan_dispatch(at: u32, workgroups: u32) {
  dispatches[at] = min(workgroups, DISPATCH_ROW);
  dispatches[at + 1u] = (workgroups + DISPATCH_ROW - 1u) / DISPATCH_ROW;
  dispatches[at + 2u] = 1u;
}

@compute @workgroup_size(64)
fn plan(@builtin(local_invocation_index) thread: u32) {
  let count = slots_taken(counters.pieces, params.capacity);
  atomicStore(&state.levels[thread], select(0u, 1u, thread == 0u && count > 0u));
  if thread < 6u {
    atomicStore(&state.bounds[thread], select(0u, 0xffffffffu, thread < 3u));
  }
  if thread == 0u {
    state.count = count;
    state.root = NO_NODE;
    state.before[0] = 0u;
    plan_dispatch(0u, (count + 63u) / 64u);
    // Each level's workgroups take what four of the one below left, until one is left.
    var blocks = (count + BLOCK - 1u) / BLOCK;
    for (var at = 3u; at + 3u <= arrayLength(&dispatches); at += 3u) {
      plan_dispatch(at, blocks);
      blocks = select(0u, (blocks + 3u) / 4u, blocks > 1u);
    }
  }
}

var<workgroup> bounds: array<atomic<u32>, 6>;

@compute @workgroup_size(64)
fn measure(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  if thread < 6u {
    atomicStore(&bounds[thread], select(0u, 0xffffffffu, thread < 3u));
  }
  workgroupBarrier();
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i < state.count && is_sound(primitives[i]) {
    let center = center_of(primitives[i]);
    for (var axis = 0u; axis < 3u; axis++) {
      atomicMin(&bounds[axis], ordered(center[axis]));
      atomicMax(&bounds[3u + axis], ordered(center[axis]));
    }
  }
  workgroupBarrier();
  if thread < 3u {
    atomicMin(&state.bounds[thread], atomicLoad(&bounds[thread]));
  } else if thread < 6u {
    atomicMax(&state.bounds[thread], atomicLoad(&bounds[thread]));
  }
}

// Two zeros between the bits of an 11-bit number.
fn spread(bits: u32) -> u32 {
  var x = bits & 0x7ffu;
  x = (x | (x << 16u)) & 0x70000ffu;
  x = (x | (x << 8u)) & 0x700f00fu;
  x = (x | (x << 4u)) & 0x430c30c3u;
  return (x | (x << 2u)) & 0x49249249u;
}

@compute @workgroup_size(64)
fn make_keys(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= state.count {
    return;
  }
  // What is out of range comes last.
  var key = 0xffffffffu;
  if is_sound(primitives[i]) {
    var low: vec3f;
    var high: vec3f;
    for (var axis = 0u; axis < 3u; axis++) {
      low[axis] = from_ordered(atomicLoad(&state.bounds[axis]));
      high[axis] = from_ordered(atomicLoad(&state.bounds[3u + axis]));
    }
    // Linear, so that the order does not depend on the eye; cells are cubes.
    let extent = max(max_component(high - low), 1e-30);
    let unit = (center_of(primitives[i]) - low) / extent;
    let cell = vec3u(clamp(unit * 2048.0, vec3f(0.0), vec3f(2047.0)));
    // Of 33 bits the last is left out.
    key = (spread(cell.x) << 1u) | spread(cell.y) | (spread(cell.z) >> 1u);
  }
  items[i] = vec2u(key, i);
}

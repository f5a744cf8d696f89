// SenderBounds: bounds over runs of a cloud's pieces, for rays to skip (wgsl/common/walk.wgsl). Made anew from each
// cloud: pieces are put in an order of space, then bounded four by four.
//
//   plan          one workgroup: how many workgroups the others need
//   measure       a thread a piece: the nearest and the farthest one
//   make_keys     a thread a piece: its place in the order
//   (sort)
//   build_first   a thread a node over four pieces
//   build_next    a thread a node over four nodes, once a depth

#import math
#import hashing
#import dispatch
#import surfel
#import rooms
#import walk_tree

alias Counter = u32;

struct Params {
  depth: u32,
  // Pieces that the cloud has room for.
  capacity: u32,
  perspective: u32,
  padding: u32,
}

// What is found on the way.
struct Range {
  // Pieces.
  count: u32,
  // Bits of the least and the largest distance of a piece's centroid along an axis.
  nearest: RangeValue,
  farthest: RangeValue,
  padding: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> counters: Counters;
@group(0) @binding(2) var<storage, read> pieces: array<Piece>;
@group(0) @binding(3) var<storage, read_write> range: Range;
#if PLAN
alias RangeValue = atomic<u32>;
// Indirect dispatches: one with a thread a piece, then one a depth.
@group(0) @binding(4) var<storage, read_write> dispatches: array<u32>;
// Pairs of a key and a piece.
@group(0) @binding(5) var<storage, read_write> items: array<vec2u>;
#else
alias RangeValue = u32;
@group(0) @binding(4) var<storage, read_write> nodes: array<vec4f>;
@group(0) @binding(5) var<storage, read> items: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> leaves: array<vec4f>;
#endif

fn centroid(piece: Piece) -> vec3f {
  return (piece.a + piece.b + piece.c) * (1.0 / 3.0);
}

#if PLAN

fn plan_dispatch(at: u32, threads: u32) {
  let workgroups = (threads + 63u) / 64u;
  dispatches[at] = min(workgroups, DISPATCH_ROW);
  dispatches[at + 1u] = (workgroups + DISPATCH_ROW - 1u) / DISPATCH_ROW;
  dispatches[at + 2u] = 1u;
}

@compute @workgroup_size(16)
fn plan(@builtin(local_invocation_index) thread: u32) {
  let count = rooms_taken(counters.pieces, params.capacity);
  if thread == 0u {
    range.count = count;
    atomicStore(&range.nearest, bitcast<u32>(MAX_F32));
    atomicStore(&range.farthest, 0u);
    plan_dispatch(0u, count);
  }
  let depth = thread;
  if depth * 3u + 3u < arrayLength(&dispatches) {
    plan_dispatch(depth * 3u + 3u, select(0u, nodes_at(count, depth), depth <= top_of(count)));
  }
}

var<workgroup> nearest: atomic<u32>;
var<workgroup> farthest: atomic<u32>;

@compute @workgroup_size(64)
fn measure(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  if thread == 0u {
    atomicStore(&nearest, bitcast<u32>(MAX_F32));
    atomicStore(&farthest, 0u);
  }
  workgroupBarrier();
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i < range.count {
    // Bits of floats that are not negative have the floats' order.
    let distance = bitcast<u32>(max_component(abs(centroid(pieces[i]))));
    atomicMin(&nearest, distance);
    atomicMax(&farthest, distance);
  }
  workgroupBarrier();
  if thread == 0u {
    atomicMin(&range.nearest, atomicLoad(&nearest));
    atomicMax(&range.farthest, atomicLoad(&farthest));
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
  if i >= range.count {
    return;
  }
  // Pieces are as small as they are near: cells of a logarithmic scale hold about as many everywhere. An orthographic
  // camera's are of one size, and so are its cells.
  let farthest = max(bitcast<f32>(atomicLoad(&range.farthest)), 1e-18);
  let nearest = clamp(bitcast<f32>(atomicLoad(&range.nearest)), 1e-3 * farthest, farthest);
  let p = centroid(pieces[i]);
  var unit = p / farthest;
  if params.perspective != 0u {
    unit = sign(p) * log(1.0 + abs(p) / nearest) / log(1.0 + farthest / nearest);
  }
  let cell = vec3u(clamp((unit * 0.5 + 0.5) * 2048.0, vec3f(0.0), vec3f(2047.0)));
  // Morton order; of 33 bits the last is left out.
  let key = (spread(cell.x) << 1u) | spread(cell.y) | (spread(cell.z) >> 1u);
  items[i] = vec2u(key, i);
}

#else

#import node_boxes

fn box_of(piece: Piece) -> Box {
  // Grown by what rounding can move a hit.
  let margin = POSITION_TOLERANCE * max(abs(piece.a), max(abs(piece.b), abs(piece.c)));
  return Box(min(piece.a, min(piece.b, piece.c)) - margin, max(piece.a, max(piece.b, piece.c)) + margin);
}

// A leaf a thread; its node at depth 0 holds the boxes of its triangles.
@compute @workgroup_size(64)
fn build_first(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= nodes_at(range.count, 0u) {
    return;
  }
  var boxes: array<Box, 4>;
  var corner: mat4x3f;
  var edge1: mat4x3f;
  var edge2: mat4x3f;
  for (var k = 0u; k < 4u; k++) {
    boxes[k] = empty_box();
    if i * 4u + k < range.count {
      let piece = pieces[items[i * 4u + k].y];
      boxes[k] = box_of(piece);
      corner[k] = piece.a;
      edge1[k] = piece.b - piece.a;
      edge2[k] = piece.c - piece.a;
    }
  }
  store_node(depth_offset(params.capacity, 0u) + i, boxes);
  let rows = array<mat3x4f, 3>(transpose(corner), transpose(edge1), transpose(edge2));
  for (var row = 0u; row < 9u; row++) {
    leaves[i * LEAF_TEXELS + row] = rows[row / 3u][row % 3u];
  }
}

@compute @workgroup_size(64)
fn build_next(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= nodes_at(range.count, params.depth) {
    return;
  }
  var boxes: array<Box, 4>;
  let below = nodes_at(range.count, params.depth - 1u);
  for (var k = 0u; k < 4u; k++) {
    boxes[k] = empty_box();
    if i * 4u + k < below {
      boxes[k] = box_of_node(depth_offset(params.capacity, params.depth - 1u) + i * 4u + k);
    }
  }
  store_node(depth_offset(params.capacity, params.depth) + i, boxes);
}

#endif

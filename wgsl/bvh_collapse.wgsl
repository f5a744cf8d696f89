// Bvh, third stage: wide nodes from the binary tree, from the root down.
//
//   collapse       threads that take the nodes of a level in turn, one dispatch per level
//   collapse_rest  one workgroup, for all levels that are left; most trees have none
//
// A node takes the largest of its descendants apart until it has eight children. How many primitives are below each is
// known, and with it where its triangles and the nodes below it have room: no place is counted, and all are the same every
// time. A tree of m > 2 primitives has at most (8 m - 3) / 21 nodes, since a node of fewer than eight children has leaves
// alone, and three primitives at least.
//
// With #if INSTANCES a primitive is an instance of a mesh and becomes a node itself, which rays go on from to that mesh's root.
// A tree of m > 1 of them has at most (4 m - 1) / 7 nodes besides, since one of fewer than eight children has two at least.

#import math
#import hashing
#import dispatch
#if INSTANCES
#import instance
#else
#import surfel
#endif
#if ALPHA_TESTED
#import cutout
#endif
#import bvh_layout

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

// A node to be made.
struct Task {
  // Reference to what becomes the node.
  reference: u32,
  node: u32,
  // First triangle of those below, and first node of those.
  triangle: u32,
  below: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> state: State;
@group(0) @binding(2) var<storage, read> primitives: array<Primitive>;
@group(0) @binding(3) var<storage, read> binary: array<BinaryNode>;
// Of all levels, one after the other.
@group(0) @binding(4) var<storage, read_write> tasks: array<Task>;
@group(0) @binding(5) var nodes: texture_storage_2d<rgba32uint, write>;
#if !INSTANCES
@group(0) @binding(6) var triangles: texture_storage_2d<rgba32uint, write>;
#endif
#if ALPHA_TESTED
// Of each primitive.
@group(0) @binding(7) var<storage, read> cutouts: array<Cutout>;
#endif

// From this level on nodes take those apart that are nearest the root, so that three levels of the binary tree go at a time:
// the binary tree's depth is bounded, and with it that of the wide one.
const DEEP: u32 = 16u;

// What a reference stands for.
struct Below {
  box: Box,
  // Primitives, and their area.
  count: u32,
  area: f32,
}

fn load_below(reference: u32) -> Below {
  if (reference & LEAF) == 0u {
    let node = binary[reference];
    return Below(Box(node.low, node.high), node.count, node.area);
  }
  let primitive = primitives[reference & ~LEAF];
  if is_sound(primitive) {
    return Below(box_of(primitive), 1u, area_of(primitive));
  }
  let b = &state.bounds;
  return Below(point_of(vec3u(atomicLoad(&b[0]), atomicLoad(&b[1]), atomicLoad(&b[2]))), 1u, 0.0);
}

#if INSTANCES
fn is_node(count: u32) -> bool {
  return true;
}

// Nodes below one of `count` primitives, which may be a primitive itself.
fn nodes_below(count: u32) -> u32 {
  return select(0u, count + (4u * count - 8u) / 7u, count > 1u);
}

fn write_instance(node: u32, instance: Instance) {
  let at = node_texel_at(node);
  if !is_sound(instance) {
    // A node without children.
    textureStore(nodes, at, vec4u(0u));
    return;
  }
  textureStore(nodes, at, vec4u(bitcast<vec3u>(instance.shift), IS_INSTANCE));
  textureStore(nodes, at + vec2u(1u, 0u), vec4u(bitcast<vec3u>(instance.x), instance.root));
  textureStore(nodes, at + vec2u(2u, 0u), vec4u(bitcast<vec3u>(instance.y), instance.material));
  textureStore(nodes, at + vec2u(3u, 0u), vec4u(bitcast<vec3u>(instance.z), instance.index));
}
#else
fn is_node(count: u32) -> bool {
  return count > LEAF_SIZE;
}

// Nodes below one of `count` primitives that is a node itself.
fn nodes_below(count: u32) -> u32 {
  return select(0u, (8u * count - 24u) / 21u, is_node(count));
}

fn write_triangle(triangle: u32, primitive: u32) {
  let piece = primitives[primitive];
  let e1 = piece.b - piece.a;
  let e2 = piece.c - piece.a;
  let size = POSITION_TOLERANCE * (max_component(abs(e1)) + max_component(abs(e2)));
  let at = triangle_texel_at(triangle);
#if ALPHA_TESTED
  let cutout = cutouts[primitive];
  let tag = primitive | select(0u, HAS_HOLES, cutout.threshold > 0.0);
  textureStore(triangles, at, vec4u(bitcast<vec3u>(piece.a), tag));
  textureStore(triangles, at + vec2u(3u, 0u), bitcast<vec4u>(vec4f(cutout.a, cutout.b)));
  textureStore(triangles, at + vec2u(4u, 0u), vec4u(bitcast<vec2u>(cutout.c), bitcast<u32>(cutout.threshold), cutout.map));
#else
  textureStore(triangles, at, vec4u(bitcast<vec3u>(piece.a), primitive));
#endif
  textureStore(triangles, at + vec2u(1u, 0u), bitcast<vec4u>(vec4f(e1, size)));
  textureStore(triangles, at + vec2u(2u, 0u), bitcast<vec4u>(vec4f(e2, max_component(abs(piece.a)))));
}
#endif

// The biased exponent of the least power of two that is at least x.
fn exponent_above(x: f32) -> u32 {
  let bits = bitcast<u32>(x);
  return clamp((bits >> 23u) + select(0u, 1u, (bits & 0x7fffffu) != 0u), 1u, 254u);
}

// What is below a node, up to eight.
struct Children {
  references: array<u32, 8>,
  lows: array<vec3f, 8>,
  highs: array<vec3f, 8>,
  counts: array<u32, 8>,
  // What has the largest is taken apart next, what has 0 never.
  sizes: array<u32, 8>,
  // What has the largest comes first; then which is where.
  ranks: array<u32, 8>,
}

const IS_NODE: u32 = 0x80000000u;

// `depth` counts from the node that is made.
fn set_below(children: ptr<function, Children>, i: u32, reference: u32, depth: u32, deep: bool) {
  let below = load_below(reference);
  let area = half_area(below.box);
  (*children).references[i] = reference;
  (*children).lows[i] = below.box.low;
  (*children).highs[i] = below.box.high;
  (*children).counts[i] = below.count;
  // Bits of floats that are not negative have the floats' order. Pairs of triangles come last: they are leaves as they are.
  var size = 0u;
  if below.count > 1u {
    size = select(1u + (bitcast<u32>(area) >> 1u), IS_NODE | select(bitcast<u32>(area), 64u - depth, deep), is_node(below.count));
  }
  (*children).sizes[i] = size;
  // Nodes come before leaves, and of either kind first what is fuller of its primitives: it is more likely to stop a ray.
  let full = select(0.0, min(below.area / area, FAR), area > 0.0);
  (*children).ranks[i] = bitcast<u32>(full) | select(0u, IS_NODE, is_node(below.count));
}

// How many of eight are larger than the i-th, or as large and before it.
fn rank_of(a: vec4u, b: vec4u, own: u32, i: u32) -> u32 {
  let is_before_a = (a > vec4u(own)) | ((a == vec4u(own)) & (vec4u(0u, 1u, 2u, 3u) < vec4u(i)));
  let is_before_b = (b > vec4u(own)) | ((b == vec4u(own)) & (vec4u(4u, 5u, 6u, 7u) < vec4u(i)));
  let ones = select(vec4u(0u), vec4u(1u), is_before_a) + select(vec4u(0u), vec4u(1u), is_before_b);
  return ones.x + ones.y + ones.z + ones.w;
}

fn make_node(task: Task, level: u32, end: u32) {
#if INSTANCES
  if (task.reference & LEAF) != 0u {
    write_instance(task.node, primitives[task.reference & ~LEAF]);
    return;
  }
#endif
  let deep = level >= DEEP;
  var children = Children();
  set_below(&children, 0u, task.reference, 0u, deep);
  let own = Box(children.lows[0], children.highs[0]);
  var size = 1u;
  while size < WIDTH {
    var which = 0u;
    var largest = children.sizes[0];
    for (var i = 1u; i < size; i++) {
      let is_larger = children.sizes[i] > largest;
      which = select(which, i, is_larger);
      largest = max(largest, children.sizes[i]);
    }
    if largest == 0u {
      break;
    }
    let source = children.references[which];
    let left = binary[source].left;
    let right = binary[source].right;
    let depth = 65u - (largest & ~IS_NODE);
    set_below(&children, which, left, depth, deep);
    set_below(&children, size, right, depth, deep);
    size++;
  }

  let keys_a = vec4u(children.ranks[0], children.ranks[1], children.ranks[2], children.ranks[3]);
  let keys_b = vec4u(children.ranks[4], children.ranks[5], children.ranks[6], children.ranks[7]);
  var inner = 0u;
  for (var i = 0u; i < size; i++) {
    inner += select(0u, 1u, is_node(children.counts[i]));
  }
  for (var i = 0u; i < size; i++) {
    var own_key = keys_a[i & 3u];
    if i > 3u {
      own_key = keys_b[i & 3u];
    }
    children.ranks[rank_of(keys_a, keys_b, own_key, i)] = i;
  }

  // Leaves' triangles first, then those of the nodes below.
  var triangle = task.triangle;
  var present = 0u;
#if !INSTANCES
  for (var rank = inner; rank < size; rank++) {
    let i = children.ranks[rank];
    let reference = children.references[i];
    present |= ((1u << children.counts[i]) - 1u) << (2u * (rank - inner));
    if (reference & LEAF) != 0u {
      write_triangle(triangle, reference & ~LEAF);
    } else {
      write_triangle(triangle, binary[reference].left & ~LEAF);
      write_triangle(triangle + 1u, binary[reference].right & ~LEAF);
    }
    triangle += children.counts[i];
  }
#endif
  if inner > 0u {
    let at = end + atomicAdd(&state.levels[level + 1u], inner);
    var below = task.below + inner;
    for (var rank = 0u; rank < inner; rank++) {
      let i = children.ranks[rank];
      tasks[at + rank] = Task(children.references[i], task.below + rank, triangle, below);
      triangle += children.counts[i];
      below += nodes_below(children.counts[i]);
    }
  }

  let exponents = vec3u(
    exponent_above((own.high.x - own.low.x) / 254.0),
    exponent_above((own.high.y - own.low.y) / 254.0),
    exponent_above((own.high.z - own.low.z) / 254.0),
  );
  let step = bitcast<vec3f>(exponents << vec3u(23u));
  // One word per plane of four children; no ray meets a child that is missing.
  var low_words: array<vec3u, 2>;
  var high_words: array<vec3u, 2>;
  for (var half = 0u; half < 2u; half++) {
    var low_word = vec3u(0u);
    var high_word = vec3u(0u);
    for (var k = 0u; k < 4u; k++) {
      let rank = half * 4u + k;
      var low = vec3u(255u);
      var high = vec3u(0u);
      if rank < size {
        let i = children.ranks[rank];
        // Grown by more than what decoding rounds, but not below 0, which is exact.
        low = vec3u(clamp(floor((children.lows[i] - own.low) / step - 0.00390625), vec3f(0.0), vec3f(255.0)));
        high = vec3u(clamp(ceil((children.highs[i] - own.low) / step + 0.00390625), vec3f(0.0), vec3f(255.0)));
      }
      low_word |= low << vec3u(8u * k);
      high_word |= high << vec3u(8u * k);
    }
    low_words[half] = low_word;
    high_words[half] = high_word;
  }
  let at = node_texel_at(task.node);
  let kinds = (inner << 24u) | ((size - inner) << 28u);
  let packed = exponents.x | (exponents.y << 8u) | (exponents.z << 16u) | kinds;
  textureStore(nodes, at, vec4u(bitcast<vec3u>(own.low), packed));
  textureStore(nodes, at + vec2u(1u, 0u), vec4u(task.below, task.triangle, present, 0u));
  let low0 = low_words[0];
  let low1 = low_words[1];
  let high0 = high_words[0];
  let high1 = high_words[1];
  textureStore(nodes, at + vec2u(2u, 0u), vec4u(low0.x, low1.x, low0.y, low1.y));
  textureStore(nodes, at + vec2u(3u, 0u), vec4u(low0.z, low1.z, high0.x, high1.x));
  textureStore(nodes, at + vec2u(4u, 0u), vec4u(high0.y, high1.y, high0.z, high1.z));
}

// Nodes before a level, and before the next one, for which it is noted.
fn range_of(level: u32, is_first: bool) -> vec2u {
  let first = state.before[level];
  let end = first + atomicLoad(&state.levels[level]);
  if is_first {
    state.before[level + 1u] = end;
  }
  return vec2u(first, end);
}

@compute @workgroup_size(64)
fn collapse(@builtin(global_invocation_id) id: vec3u) {
  let level = params.level;
  let nodes_here = range_of(level, id.x == 0u);
  let end = nodes_here.y;
  if level == 0u && id.x == 0u && end == 0u {
    // Without primitives the root has no children.
    textureStore(nodes, node_texel_at(state.first_node), vec4u(0u));
  }
  for (var i = nodes_here.x + id.x; i < end; i += params.threads) {
    var task = Task(state.root, state.first_node, state.first_triangle, state.first_node + 1u);
    if level > 0u {
      task = tasks[i];
    }
    make_node(task, level, end);
  }
}

var<workgroup> range: vec2u;

@compute @workgroup_size(64)
fn collapse_rest(@builtin(local_invocation_index) thread: u32) {
  for (var level = params.level; level < MAX_DEPTH; level++) {
    if thread == 0u {
      range = range_of(level, true);
    }
    let level_range = workgroupUniformLoad(&range);
    if level_range.x == level_range.y {
      break;
    }
    for (var i = level_range.x + thread; i < level_range.y; i += 64u) {
      make_node(tasks[i], level, level_range.y);
    }
    storageBarrier();
    workgroupBarrier();
  }
}

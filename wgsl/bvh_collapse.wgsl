// Bvh, third stage: wide nodes from the binary tree, from the root down.
//
//   collapse       threads that take the nodes of a level in turn, a dispatch a level
//   collapse_rest  one workgroup, for all levels that are left; most trees have none
//
// A node takes the largest of its descendants apart until it has eight children. How many primitives are below each is
// known, and with it where its triangles and the nodes below it have room: no place is counted, and all are the same every
// time. A tree of m > 2 primitives has at most (8 m - 3) / 21 nodes, since a node of fewer than eight children has leaves
// alone, and three primitives at least.

#import math
#import hashing
#import dispatch
#import surfel
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
@group(0) @binding(2) var<storage, read> pieces: array<Piece>;
@group(0) @binding(3) var<storage, read> binary: array<BinaryNode>;
// Of all levels, one after the other.
@group(0) @binding(4) var<storage, read_write> tasks: array<Task>;
@group(0) @binding(5) var nodes: texture_storage_2d<rgba32uint, write>;
@group(0) @binding(6) var triangles: texture_storage_2d<rgba32uint, write>;

// From this level on nodes take those apart that are nearest the root, so that three levels of the binary tree go at a time:
// the binary tree's depth is bounded, and with it that of the wide one.
const DEEP: u32 = 16u;

fn reference_box(reference: u32) -> Box {
  if (reference & LEAF) != 0u {
    let b = &state.bounds;
    let low = lowest_of(vec3u(atomicLoad(&b[0]), atomicLoad(&b[1]), atomicLoad(&b[2])));
    return box_of(pieces[reference & ~LEAF], low);
  }
  let node = binary[reference];
  return Box(node.low, node.high);
}

fn reference_count(reference: u32) -> u32 {
  if (reference & LEAF) != 0u {
    return 1u;
  }
  return binary[reference].count;
}

fn reference_area(reference: u32) -> f32 {
  if (reference & LEAF) != 0u {
    return area_of(pieces[reference & ~LEAF]);
  }
  return binary[reference].area;
}

// Nodes below one of `count` primitives that is a node itself.
fn nodes_below(count: u32) -> u32 {
  return select(0u, (8u * count - 24u) / 21u, count > LEAF_SIZE);
}

fn write_triangle(triangle: u32, primitive: u32) {
  let piece = pieces[primitive];
  let e1 = piece.b - piece.a;
  let e2 = piece.c - piece.a;
  let size = POSITION_TOLERANCE * (max_component(abs(e1)) + max_component(abs(e2)));
  let at = triangle_texel_at(triangle);
  textureStore(triangles, at, vec4u(bitcast<vec3u>(piece.a), primitive));
  textureStore(triangles, at + vec2u(1u, 0u), bitcast<vec4u>(vec4f(e1, size)));
  textureStore(triangles, at + vec2u(2u, 0u), bitcast<vec4u>(vec4f(e2, max_component(abs(piece.a)))));
}

// The biased exponent of the least power of two that is at least x.
fn exponent_above(x: f32) -> u32 {
  let bits = bitcast<u32>(x);
  return clamp((bits >> 23u) + select(0u, 1u, (bits & 0x7fffffu) != 0u), 1u, 254u);
}

fn make_node(task: Task, level: u32, end: u32) {
  var children: array<u32, 8>;
  var counts: array<u32, 8>;
  // What the largest of is taken apart next.
  var keys: array<f32, 8>;
  children[0] = task.reference;
  counts[0] = reference_count(task.reference);
  keys[0] = 0.0;
  var size = 1u;
  while size < WIDTH {
    var which = WIDTH;
    for (var i = 0u; i < size; i++) {
      // Pairs of triangles come last: they are leaves as they are.
      let larger = counts[i] > LEAF_SIZE;
      if counts[i] > 1u {
        if which == WIDTH {
          which = i;
        } else {
          let best_larger = counts[which] > LEAF_SIZE;
          if (larger && !best_larger) || (larger == best_larger && keys[i] > keys[which]) {
            which = i;
          }
        }
      }
    }
    if which == WIDTH {
      break;
    }
    let node = binary[children[which]];
    let below = keys[which] - 1.0;
    let deep = level >= DEEP;
    children[which] = node.left;
    counts[which] = reference_count(node.left);
    keys[which] = select(half_area(reference_box(node.left)), below, deep);
    children[size] = node.right;
    counts[size] = reference_count(node.right);
    keys[size] = select(half_area(reference_box(node.right)), below, deep);
    size++;
  }

  // Nodes before leaves, and of either kind first what is fuller of triangles: it is more likely to stop a ray.
  for (var i = 0u; i < size; i++) {
    let box_area = half_area(reference_box(children[i]));
    keys[i] = select(0.0, reference_area(children[i]) / box_area, box_area > 0.0);
  }
  for (var i = 1u; i < size; i++) {
    for (var j = i; j > 0u; j--) {
      let larger = counts[j] > LEAF_SIZE;
      let larger_before = counts[j - 1u] > LEAF_SIZE;
      if (larger_before && !larger) || (larger_before == larger && !(keys[j] > keys[j - 1u])) {
        break;
      }
      let key = keys[j];
      keys[j] = keys[j - 1u];
      keys[j - 1u] = key;
      let child = children[j];
      children[j] = children[j - 1u];
      children[j - 1u] = child;
      let count = counts[j];
      counts[j] = counts[j - 1u];
      counts[j - 1u] = count;
    }
  }
  var inner = 0u;
  for (var i = 0u; i < size; i++) {
    inner += select(0u, 1u, counts[i] > LEAF_SIZE);
  }

  // Leaves' triangles first, then those of the nodes below.
  var triangle = task.triangle;
  var present = 0u;
  for (var i = inner; i < size; i++) {
    let child = children[i];
    present |= ((1u << counts[i]) - 1u) << (2u * (i - inner));
    if (child & LEAF) != 0u {
      write_triangle(triangle, child & ~LEAF);
    } else {
      write_triangle(triangle, binary[child].left & ~LEAF);
      write_triangle(triangle + 1u, binary[child].right & ~LEAF);
    }
    triangle += counts[i];
  }
  var below = task.below + inner;
  if inner > 0u {
    var at = end + atomicAdd(&state.levels[level + 1u], inner);
    for (var i = 0u; i < inner; i++) {
      tasks[at] = Task(children[i], task.below + i, triangle, below);
      triangle += counts[i];
      below += nodes_below(counts[i]);
      at++;
    }
  }

  let own = reference_box(task.reference);
  let exponents = vec3u(
    exponent_above((own.high.x - own.low.x) / 254.0),
    exponent_above((own.high.y - own.low.y) / 254.0),
    exponent_above((own.high.z - own.low.z) / 254.0),
  );
  let step = bitcast<vec3f>(exponents << vec3u(23u));
  // Two words of each of six planes; no ray meets a child that is missing.
  var words = array<u32, 12>(
    0xffffffffu, 0xffffffffu, 0xffffffffu, 0xffffffffu, 0xffffffffu, 0xffffffffu, 0u, 0u, 0u, 0u, 0u, 0u,
  );
  for (var i = 0u; i < size; i++) {
    let box = reference_box(children[i]);
    // Grown by more than what decoding rounds, but not below 0, which is exact.
    let low = vec3u(clamp(floor((box.low - own.low) / step - 0.00390625), vec3f(0.0), vec3f(255.0)));
    let high = vec3u(clamp(ceil((box.high - own.low) / step + 0.00390625), vec3f(0.0), vec3f(255.0)));
    let shift = 8u * (i % 4u);
    for (var axis = 0u; axis < 3u; axis++) {
      let word = 2u * axis + i / 4u;
      words[word] = (words[word] & ~(0xffu << shift)) | (low[axis] << shift);
      words[word + 6u] |= high[axis] << shift;
    }
  }
  let at = node_texel_at(task.node);
  let kinds = (inner << 24u) | ((size - inner) << 28u);
  let packed = exponents.x | (exponents.y << 8u) | (exponents.z << 16u) | kinds;
  textureStore(nodes, at, vec4u(bitcast<vec3u>(own.low), packed));
  textureStore(nodes, at + vec2u(1u, 0u), vec4u(task.below, task.triangle, present, 0u));
  for (var i = 0u; i < 3u; i++) {
    let word = 4u * i;
    textureStore(nodes, at + vec2u(2u + i, 0u), vec4u(words[word], words[word + 1u], words[word + 2u], words[word + 3u]));
  }
}

// Nodes of the levels before one.
fn nodes_before(level: u32) -> u32 {
  var sum = 0u;
  for (var i = 0u; i < level; i++) {
    sum += atomicLoad(&state.levels[i]);
  }
  return sum;
}

@compute @workgroup_size(64)
fn collapse(@builtin(global_invocation_id) id: vec3u) {
  let level = params.level;
  let first = nodes_before(level);
  let end = first + atomicLoad(&state.levels[level]);
  if level == 0u && id.x == 0u && end == 0u {
    // Without primitives the root has no children.
    textureStore(nodes, vec2u(0u), vec4u(0u));
  }
  for (var i = first + id.x; i < end; i += params.threads) {
    var task = Task(state.root, 0u, 0u, 1u);
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
      let first = nodes_before(level);
      range = vec2u(first, first + atomicLoad(&state.levels[level]));
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

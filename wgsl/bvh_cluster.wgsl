// Bvh, second stage: a binary tree by parallel locally-ordered clustering (Meister and Bittner 2018), by blocks.
//
//   cluster   a workgroup a block: it merges what are each other's nearest neighbours in the order of space until a quarter
//             is left, of the last block one. One dispatch per level; the next one's blocks are four of this one's
//
// Every cluster brings a free place for a node along: a primitive that of its own index, a merged one that of its second
// part, while its node stands in the first part's. So places are known without counting, and the same every time.

#import math
#import hashing
#import dispatch
#if INSTANCES
#import instance
#else
#import surfel
#endif

alias Counter = u32;
alias StateWord = u32;

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
@group(0) @binding(1) var<storage, read_write> state: State;
@group(0) @binding(2) var<storage, read> primitives: array<Primitive>;
// Pairs of a key and a primitive, in the order of space.
@group(0) @binding(3) var<storage, read> items: array<vec2u>;
// What each block of the level below has left and what those of this one leave: a reference, NO_NODE for none, and a place.
@group(0) @binding(4) var<storage, read> clusters_below: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> clusters_left: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> binary: array<BinaryNode>;

// Neighbours that are looked at, in either direction.
const RADIUS: u32 = 8u;
// Clusters of such a height merge no more with their nearest neighbour: what is left once nothing else does is merged in
// pairs, which takes 8 rounds at most. This bounds the depth of the tree, and that there is always something to merge.
fn height_limit(level: u32) -> u32 {
  return 24u + 8u * level;
}

// Clusters in the order of space: where what is below is of each, and above 8 bits its levels of nodes.
var<workgroup> order: array<u32, 256>;
// A cluster's lowest corner and the area of its primitives, and its highest corner and the number of its primitives.
var<workgroup> lows: array<vec4f, 256>;
var<workgroup> highs: array<vec4f, 256>;
// The same box in steps of what bounds all of them, one word per axis: the lowest plane in 16 bits, the highest above them.
var<workgroup> boxes_x: array<u32, 256>;
var<workgroup> boxes_y: array<u32, 256>;
var<workgroup> boxes_z: array<u32, 256>;
// Reference and place.
var<workgroup> ids: array<vec2u, 256>;
var<workgroup> partners: array<u32, 256>;
// What bounds all clusters, as ordered() has it: lowest x, y, z and highest x, y, z.
var<workgroup> bounds: array<atomic<u32>, 6>;
// Pairs of clusters that become one, each a byte, and above them the levels of nodes of what they become; and how many.
var<workgroup> pairs: array<u32, 128>;
var<workgroup> pairs_found: atomic<u32>;
// A bit a cluster that stays.
var<workgroup> stays: array<atomic<u32>, 8>;
// How many clusters there are, and 1 where there are to be no fewer.
var<workgroup> progress: vec2u;

const STEPS: f32 = 65535.0;
// The box of a cluster that is to be nobody's nearest neighbour: all there is, an axis.
const WHOLE: u32 = 0xffff0000u;

// Boxes of four successive clusters: planes in steps, one vector per axis.
struct Four {
  low: mat3x4f,
  high: mat3x4f,
}

struct Nearest {
  index: vec4u,
  area: vec4u,
}

fn lowest_of(words: vec4u) -> vec4f {
  return vec4f(words & vec4u(0xffffu));
}

fn highest_of(words: vec4u) -> vec4f {
  return vec4f(words >> vec4u(16u));
}

fn load_four(first: u32) -> Four {
  let at = vec4u(order[first], order[first + 1u], order[first + 2u], order[first + 3u]) & vec4u(0xffu);
  let x = vec4u(boxes_x[at.x], boxes_x[at.y], boxes_x[at.z], boxes_x[at.w]);
  let y = vec4u(boxes_y[at.x], boxes_y[at.y], boxes_y[at.z], boxes_y[at.w]);
  let z = vec4u(boxes_z[at.x], boxes_z[at.y], boxes_z[at.z], boxes_z[at.w]);
  return Four(mat3x4f(lowest_of(x), lowest_of(y), lowest_of(z)), mat3x4f(highest_of(x), highest_of(y), highest_of(z)));
}

// Of what is found and one more cluster what makes the smaller box with each of four. Of equally small boxes that whose index
// differs in the lowest bits counts: it would choose the same.
fn nearer_of(found: Nearest, first: u32, four: Four, j: u32, low: vec3f, high: vec3f, faces: vec3f) -> Nearest {
  let x = max(four.high[0], vec4f(high.x)) - min(four.low[0], vec4f(low.x));
  let y = max(four.high[1], vec4f(high.y)) - min(four.low[1], vec4f(low.y));
  let z = max(four.high[2], vec4f(high.z)) - min(four.low[2], vec4f(low.z));
  // Bits of floats that are not negative have the floats' order.
  let area = bitcast<vec4u>(x * y * faces.x + y * z * faces.y + z * x * faces.z);
  let own = vec4u(first) + vec4u(0u, 1u, 2u, 3u);
  let other = vec4u(j);
  let is_in_reach = (own != other) & (own + RADIUS >= other) & (other + RADIUS >= own);
  let is_less = (area < found.area) | ((area == found.area) & ((own ^ other) < (own ^ found.index)));
  return Nearest(
    select(found.index, other, is_in_reach & is_less),
    select(found.area, area, is_in_reach & is_less),
  );
}

// What bounds all clusters.
fn bounds_of_all() -> Box {
  return Box(
    vec3f(
      from_ordered(atomicLoad(&bounds[0])),
      from_ordered(atomicLoad(&bounds[1])),
      from_ordered(atomicLoad(&bounds[2])),
    ),
    vec3f(
      from_ordered(atomicLoad(&bounds[3])),
      from_ordered(atomicLoad(&bounds[4])),
      from_ordered(atomicLoad(&bounds[5])),
    ),
  );
}

// Areas of the faces xy, yz and zx of a step's box, of which the longest edge is 1.
fn faces_of(all: Box) -> vec3f {
  let extent = min(all.high - all.low, vec3f(FAR));
  let edges = extent / max(max_component(extent), 1e-30);
  return edges * edges.yzx;
}

// Of each of successive clusters the one that makes the smallest box with it, or itself where there is none or it is too high.
fn choose_partners(first: u32, count: u32, limit: u32, faces: vec3f) {
  let a = load_four(first);
  let b = load_four(first + 4u);
  var nearest_a = Nearest(vec4u(first) + vec4u(0u, 1u, 2u, 3u), vec4u(0xffffffffu));
  var nearest_b = Nearest(vec4u(first) + vec4u(4u, 5u, 6u, 7u), vec4u(0xffffffffu));
  // What each of them may choose is loaded once for all: loads from workgroup memory are what takes the time.
  for (var j = max(first, RADIUS) - RADIUS; j < min(first + CLUSTERS_A_THREAD + RADIUS, count); j++) {
    let source = order[j] & 0xffu;
    let box = vec3u(boxes_x[source], boxes_y[source], boxes_z[source]);
    let low = vec3f(box & vec3u(0xffffu));
    let high = vec3f(box >> vec3u(16u));
    nearest_a = nearer_of(nearest_a, first, a, j, low, high, faces);
    nearest_b = nearer_of(nearest_b, first + 4u, b, j, low, high, faces);
  }
  for (var k = 0u; k < 4u; k++) {
    partners[first + k] = nearest_a.index[k];
    partners[first + 4u + k] = nearest_b.index[k];
  }
  for (var k = 0u; k < CLUSTERS_A_THREAD; k++) {
    if (order[first + k] >> 8u) >= limit {
      partners[first + k] = first + k;
    }
  }
}

// Puts a cluster that is read from outside into its place; its box.
fn load_cluster(place: u32, found: vec2u) -> Box {
  let reference = found.x;
  var box: Box;
  var count = 1u;
  var area = 0.0;
  var height = 0u;
  if (reference & LEAF) != 0u {
    let primitive = primitives[reference & ~LEAF];
    if is_sound(primitive) {
      box = box_of(primitive);
      area = area_of(primitive);
    } else {
      box = point_of(vec3u(state.bounds[0], state.bounds[1], state.bounds[2]));
    }
  } else {
    let node = binary[reference];
    box = Box(node.low, node.high);
    count = node.count;
    area = node.area;
    height = node.height;
  }
  order[place] = place | (height << 8u);
  lows[place] = vec4f(box.low, area);
  highs[place] = vec4f(box.high, f32(count));
  ids[place] = found;
  return box;
}

// A box's planes along an axis in steps of the bounds. They tell what is near what, and need not hold the box.
fn in_steps(low: f32, high: f32, start: f32, steps_per_unit: f32) -> u32 {
  let first = u32(clamp(round((low - start) * steps_per_unit), 0.0, STEPS));
  let last = u32(clamp(round((high - start) * steps_per_unit), 0.0, STEPS));
  return first | (last << 16u);
}

fn wider_of(a: u32, b: u32) -> u32 {
  return min(a & 0xffffu, b & 0xffffu) | (max(a >> 16u, b >> 16u) << 16u);
}

// Makes one of two clusters, where the first one is.
fn merge(pair: u32, limit: u32) {
  let a = pair & 0xffu;
  let b = (pair >> 8u) & 0xffu;
  let height = pair >> 16u;
  let low = vec4f(min(lows[a].xyz, lows[b].xyz), lows[a].w + lows[b].w);
  let high = vec4f(max(highs[a].xyz, highs[b].xyz), highs[a].w + highs[b].w);
  let first = ids[a];
  let second = ids[b];
  binary[first.y] = BinaryNode(low.xyz, first.x, high.xyz, second.x, u32(high.w), low.w, height, 0u);
  lows[a] = low;
  highs[a] = high;
  ids[a] = vec2u(first.y, second.y);
  let is_open = height < limit;
  boxes_x[a] = select(WHOLE, wider_of(boxes_x[a], boxes_x[b]), is_open);
  boxes_y[a] = select(WHOLE, wider_of(boxes_y[a], boxes_y[b]), is_open);
  boxes_z[a] = select(WHOLE, wider_of(boxes_z[a], boxes_z[b]), is_open);
}

// How many of the clusters that stay come before one.
fn place_of(i: u32) -> u32 {
  var before = 0u;
  for (var word = 0u; word < i / 32u; word++) {
    before += countOneBits(atomicLoad(&stays[word]));
  }
  return before + countOneBits(atomicLoad(&stays[i / 32u]) & ((1u << (i % 32u)) - 1u));
}

fn number_that_stay() -> u32 {
  return place_of(BLOCK - 1u) + (atomicLoad(&stays[7]) >> 31u);
}

// A thread has so many clusters that follow each other.
const CLUSTERS_A_THREAD: u32 = 8u;
const THREADS: u32 = 32u;

@compute @workgroup_size(32)
fn cluster(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let block = linear_workgroup(workgroup);
  let first = thread * CLUSTERS_A_THREAD;
  // Blocks of this level: the last one goes on until there is one root.
  var blocks = (state.count + BLOCK - 1u) / BLOCK;
  var blocks_below = 0u;
  for (var level = 0u; level < params.level; level++) {
    blocks_below = blocks;
    blocks = (blocks + 3u) / 4u;
  }
  let goal = select(BLOCK_LEFT, 1u, blocks == 1u);
  if thread < 8u {
    atomicStore(&stays[thread], 0u);
  }
  if thread < 6u {
    atomicStore(&bounds[thread], select(0u, 0xffffffffu, thread < 3u));
  }
  workgroupBarrier();
  var found: array<vec2u, CLUSTERS_A_THREAD>;
  var stay = 0u;
  for (var k = 0u; k < CLUSTERS_A_THREAD; k++) {
    let at = block * BLOCK + first + k;
    found[k] = vec2u(NO_NODE, 0u);
    if params.level == 0u {
      if at < state.count {
        found[k] = vec2u(items[at].y | LEAF, at);
      }
    } else if at / BLOCK_LEFT < blocks_below {
      found[k] = clusters_below[at];
    }
    stay |= select(0u, 1u << k, found[k].x != NO_NODE);
  }
  atomicOr(&stays[first / 32u], stay << (first % 32u));
  workgroupBarrier();
  // What is missing is in between: the four blocks' clusters close up.
  let start = place_of(first);
  var next = start;
  var box = Box(vec3f(FAR), vec3f(-FAR));
  for (var k = 0u; k < CLUSTERS_A_THREAD; k++) {
    if found[k].x != NO_NODE {
      box = union_of(box, load_cluster(next, found[k]));
      next++;
    }
  }
  if stay != 0u {
    for (var axis = 0u; axis < 3u; axis++) {
      atomicMin(&bounds[axis], ordered(box.low[axis]));
      atomicMax(&bounds[3u + axis], ordered(box.high[axis]));
    }
  }
  if thread == 0u {
    let count = number_that_stay();
    progress = vec2u(count, select(0u, 1u, count <= goal));
  }
  workgroupBarrier();
  let all = bounds_of_all();
  let faces = faces_of(all);
  let extent = all.high - all.low;
  let steps_per_unit = vec3f(STEPS) / max(extent, vec3f(1e-30));
  let limit = height_limit(params.level);
  for (var i = start; i < next; i++) {
    let low = lows[i].xyz;
    let high = highs[i].xyz;
    let is_open = (order[i] >> 8u) < limit;
    boxes_x[i] = select(WHOLE, in_steps(low.x, high.x, all.low.x, steps_per_unit.x), is_open);
    boxes_y[i] = select(WHOLE, in_steps(low.y, high.y, all.low.y, steps_per_unit.y), is_open);
    boxes_z[i] = select(WHOLE, in_steps(low.z, high.z, all.low.z, steps_per_unit.z), is_open);
  }
  var in_pairs = false;
  var left = 0u;
  loop {
    let now = workgroupUniformLoad(&progress);
    let count = now.x;
    left = count;
    if now.y != 0u {
      break;
    }
    if first < count {
      if in_pairs {
        for (var k = 0u; k < CLUSTERS_A_THREAD; k++) {
          partners[first + k] = select(first + k, (first + k) ^ 1u, ((first + k) ^ 1u) < count);
        }
      } else {
        choose_partners(first, count, limit, faces);
      }
    }
    if thread < 8u {
      atomicStore(&stays[thread], 0u);
    }
    if thread == 0u {
      atomicStore(&pairs_found, 0u);
    }
    workgroupBarrier();
    var kept: array<u32, CLUSTERS_A_THREAD>;
    stay = 0u;
    for (var k = 0u; k < CLUSTERS_A_THREAD; k++) {
      let i = first + k;
      if i < count {
        let partner = partners[i];
        let own = order[i];
        let is_mutual = partner != i && partners[partner] == i;
        if !is_mutual || i < partner {
          stay |= 1u << k;
          kept[k] = own;
          if is_mutual {
            let other = order[partner];
            let height = max(own >> 8u, other >> 8u) + 1u;
            // Which pair comes first does not matter to what becomes of any.
            pairs[atomicAdd(&pairs_found, 1u)] = (own & 0xffu) | ((other & 0xffu) << 8u) | (height << 16u);
            kept[k] = (own & 0xffu) | (height << 8u);
          }
        }
      }
    }
    if stay != 0u {
      atomicOr(&stays[first / 32u], stay << (first % 32u));
    }
    workgroupBarrier();
    var place = place_of(first);
    for (var k = 0u; k < CLUSTERS_A_THREAD; k++) {
      if (stay & (1u << k)) != 0u {
        order[place] = kept[k];
        place++;
      }
    }
    // One after the other over all threads, since few of a thread's clusters are merged.
    let found_here = atomicLoad(&pairs_found);
    for (var i = thread; i < found_here; i += THREADS) {
      merge(pairs[i], limit);
    }
    let remaining = number_that_stay();
    in_pairs = remaining == count;
    if thread == 0u {
      progress = vec2u(remaining, select(0u, 1u, remaining <= goal));
    }
  }
  if goal == 1u {
    if thread == 0u && left > 0u {
      state.root = ids[order[0] & 0xffu].x;
    }
  } else if block < blocks {
    for (var i = thread; i < BLOCK_LEFT; i += THREADS) {
      clusters_left[block * BLOCK_LEFT + i] = select(vec2u(NO_NODE, 0u), ids[order[i] & 0xffu], i < left);
    }
  }
}

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

// Clusters in the order of space: where what is below is of each.
var<workgroup> order: array<u32, 256>;
// A cluster's lowest corner and the area of its primitives, and its highest corner and the number of its primitives.
var<workgroup> lows: array<vec4f, 256>;
var<workgroup> highs: array<vec4f, 256>;
// Reference and place.
var<workgroup> ids: array<vec2u, 256>;
var<workgroup> partners: array<u32, 256>;
// Levels of nodes.
var<workgroup> heights: array<u32, 256>;
// A bit a cluster that stays.
var<workgroup> stays: array<atomic<u32>, 8>;
// How many clusters there are, and 1 where there are to be no fewer.
var<workgroup> progress: vec2u;

// Of each of four successive clusters the one that makes the smallest box with it, or itself where none may. Of equally small
// boxes that whose index differs in the lowest bits counts: it would choose the same.
fn nearest_neighbors(first: u32, count: u32, limit: u32) -> vec4u {
  let own = vec4u(first) + vec4u(0u, 1u, 2u, 3u);
  let at = vec4u(order[own.x], order[own.y], order[own.z], order[own.w]);
  let lowest = transpose(mat4x3f(lows[at.x].xyz, lows[at.y].xyz, lows[at.z].xyz, lows[at.w].xyz));
  let highest = transpose(mat4x3f(highs[at.x].xyz, highs[at.y].xyz, highs[at.z].xyz, highs[at.w].xyz));
  var best = own;
  var least = vec4u(0xffffffffu);
  // What each of the four may choose is loaded once for all: loads from workgroup memory are what takes the time.
  for (var j = max(first, RADIUS) - RADIUS; j < min(first + 4u + RADIUS, count); j++) {
    let source = order[j];
    if heights[source] < limit {
      let low = lows[source].xyz;
      let high = highs[source].xyz;
      let x = min(max(highest[0], vec4f(high.x)) - min(lowest[0], vec4f(low.x)), vec4f(FAR));
      let y = min(max(highest[1], vec4f(high.y)) - min(lowest[1], vec4f(low.y)), vec4f(FAR));
      let z = min(max(highest[2], vec4f(high.z)) - min(lowest[2], vec4f(low.z)), vec4f(FAR));
      // Bits of floats that are not negative have the floats' order.
      let area = bitcast<vec4u>(x * y + y * z + z * x);
      let other = vec4u(j);
      let is_in_reach = (own != other) & (own + RADIUS >= other) & (other + RADIUS >= own);
      let is_less = (area < least) | ((area == least) & ((own ^ other) < (own ^ best)));
      best = select(best, other, is_in_reach & is_less);
      least = select(least, area, is_in_reach & is_less);
    }
  }
  let is_open = vec4u(heights[at.x], heights[at.y], heights[at.z], heights[at.w]) < vec4u(limit);
  return select(own, best, is_open);
}

// Puts a cluster that is read from outside into its place.
fn load_cluster(thread: u32, reference: u32, place: u32) {
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
  lows[thread] = vec4f(box.low, area);
  highs[thread] = vec4f(box.high, f32(count));
  ids[thread] = vec2u(reference, place);
  heights[thread] = height;
}

// Makes one of two clusters, where the first one is.
fn merge(a: u32, b: u32) {
  let low = vec4f(min(lows[a].xyz, lows[b].xyz), lows[a].w + lows[b].w);
  let high = vec4f(max(highs[a].xyz, highs[b].xyz), highs[a].w + highs[b].w);
  let height = max(heights[a], heights[b]) + 1u;
  let first = ids[a];
  let second = ids[b];
  binary[first.y] = BinaryNode(low.xyz, first.x, high.xyz, second.x, u32(high.w), low.w, height, 0u);
  lows[a] = low;
  highs[a] = high;
  heights[a] = height;
  ids[a] = vec2u(first.y, second.y);
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

// A thread has four clusters that follow each other.
const CLUSTERS_A_THREAD: u32 = 4u;

@compute @workgroup_size(64)
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
  workgroupBarrier();
  var found: array<vec2u, 4>;
  for (var k = 0u; k < CLUSTERS_A_THREAD; k++) {
    let i = first + k;
    order[i] = i;
    let at = block * BLOCK + i;
    found[k] = vec2u(NO_NODE, 0u);
    if params.level == 0u {
      if at < state.count {
        found[k] = vec2u(items[at].y | LEAF, at);
      }
    } else if at / BLOCK_LEFT < blocks_below {
      found[k] = clusters_below[at];
    }
    if found[k].x != NO_NODE {
      atomicOr(&stays[i / 32u], 1u << (i % 32u));
    }
  }
  workgroupBarrier();
  // What is missing is in between: the four blocks' clusters close up.
  var next = place_of(first);
  for (var k = 0u; k < CLUSTERS_A_THREAD; k++) {
    if found[k].x != NO_NODE {
      load_cluster(next, found[k].x, found[k].y);
      next++;
    }
  }
  if thread == 0u {
    let count = number_that_stay();
    progress = vec2u(count, select(0u, 1u, count <= goal));
  }
  let limit = height_limit(params.level);
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
      var chosen = vec4u(first) + vec4u(1u, 0u, 3u, 2u);
      if !in_pairs {
        chosen = nearest_neighbors(first, count, limit);
      }
      for (var k = 0u; k < CLUSTERS_A_THREAD; k++) {
        partners[first + k] = select(first + k, chosen[k], chosen[k] < count);
      }
    }
    if thread < 8u {
      atomicStore(&stays[thread], 0u);
    }
    workgroupBarrier();
    var kept: array<u32, 4>;
    var stay = 0u;
    for (var k = 0u; k < CLUSTERS_A_THREAD; k++) {
      let i = first + k;
      if i < count {
        let partner = partners[i];
        let is_mutual = partner != i && partners[partner] == i;
        if !is_mutual || i < partner {
          stay |= 1u << k;
          kept[k] = order[i];
          if is_mutual {
            merge(kept[k], order[partner]);
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
    let remaining = number_that_stay();
    in_pairs = remaining == count;
    if thread == 0u {
      progress = vec2u(remaining, select(0u, 1u, remaining <= goal));
    }
  }
  if goal == 1u {
    if thread == 0u && left > 0u {
      state.root = ids[order[0]].x;
    }
  } else if thread < BLOCK_LEFT && block < blocks {
    clusters_left[block * BLOCK_LEFT + thread] = select(vec2u(NO_NODE, 0u), ids[order[thread]], thread < left);
  }
}

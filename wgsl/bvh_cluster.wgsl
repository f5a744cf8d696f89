// Bvh, second stage: a binary tree by parallel locally-ordered clustering (Meister and Bittner 2018), by blocks.
//
//   cluster   a workgroup a block: it merges what are each other's nearest neighbours in the order of space until a quarter
//             is left, of the last block one. A dispatch a level; the next one's blocks are four of this one's
//
// Every cluster brings a free place for a node along: a primitive that of its own index, a merged one that of its second
// part, while its node stands in the first part's. So places are known without counting, and the same every time.

#import math
#import hashing
#import dispatch
#import surfel

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
@group(0) @binding(2) var<storage, read> pieces: array<Piece>;
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

// A cluster's lowest corner and the area of its triangles, and its highest corner and the number of its primitives.
var<workgroup> lows: array<vec4f, 256>;
var<workgroup> highs: array<vec4f, 256>;
// Reference and place.
var<workgroup> ids: array<vec2u, 256>;
var<workgroup> partners: array<u32, 256>;
// Levels of nodes.
var<workgroup> heights: array<u32, 256>;
// A bit a cluster that stays.
var<workgroup> stays: array<atomic<u32>, 8>;
var<workgroup> active_clusters: u32;

fn box_at(i: u32) -> Box {
  return Box(lows[i].xyz, highs[i].xyz);
}

// The cluster that makes the smallest box with cluster i. Of equally small ones that whose index differs in the lowest bits:
// it would choose cluster i as well.
fn nearest_neighbor(i: u32, count: u32, limit: u32) -> u32 {
  let own = box_at(i);
  var best = i;
  var least = 0xffffffffu;
  for (var j = max(i, RADIUS) - RADIUS; j < min(i + RADIUS + 1u, count); j++) {
    if j != i && heights[j] < limit {
      // Bits of floats that are not negative have the floats' order.
      let area = bitcast<u32>(half_area(union_of(own, box_at(j))));
      if area < least || (area == least && (i ^ j) < (i ^ best)) {
        least = area;
        best = j;
      }
    }
  }
  return best;
}

// Puts a cluster that is read from outside into its place.
fn load_cluster(thread: u32, reference: u32, place: u32) {
  var box: Box;
  var count = 1u;
  var area = 0.0;
  var height = 0u;
  if (reference & LEAF) != 0u {
    let piece = pieces[reference & ~LEAF];
    box = box_of(piece, vec3f(from_ordered(state.bounds[0]), from_ordered(state.bounds[1]), from_ordered(state.bounds[2])));
    area = area_of(piece);
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

@compute @workgroup_size(256)
fn cluster(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let block = linear_workgroup(workgroup);
  let at = block * BLOCK + thread;
  // Blocks of this level: the last one goes on until there is one root.
  var blocks = (state.count + BLOCK - 1u) / BLOCK;
  var blocks_below = 0u;
  for (var level = 0u; level < params.level; level++) {
    blocks_below = blocks;
    blocks = (blocks + 3u) / 4u;
  }
  let goal = select(BLOCK_LEFT, 1u, blocks == 1u);
  var id = vec2u(NO_NODE, 0u);
  if params.level == 0u {
    if at < state.count {
      id = vec2u(items[at].y | LEAF, at);
    }
  } else if at / BLOCK_LEFT < blocks_below {
    id = clusters_below[at];
  }
  // What is missing is in between: the four blocks' clusters close up.
  if thread < 8u {
    atomicStore(&stays[thread], 0u);
  }
  workgroupBarrier();
  let filled = id.x != NO_NODE;
  if filled {
    atomicOr(&stays[thread / 32u], 1u << (thread % 32u));
  }
  workgroupBarrier();
  var before = 0u;
  var total = 0u;
  for (var word = 0u; word < 8u; word++) {
    let bits = atomicLoad(&stays[word]);
    total += countOneBits(bits);
    let mask = select(select(0u, 0xffffffffu, word < thread / 32u), (1u << (thread % 32u)) - 1u, word == thread / 32u);
    before += countOneBits(bits & mask);
  }
  if filled {
    load_cluster(before, id.x, id.y);
  }
  if thread == 0u {
    active_clusters = total;
  }
  let limit = height_limit(params.level);
  var in_pairs = false;
  loop {
    let count = workgroupUniformLoad(&active_clusters);
    if count <= goal {
      break;
    }
    let is_active = thread < count;
    if is_active {
      var partner = thread;
      if in_pairs {
        partner = select(thread ^ 1u, thread, (thread ^ 1u) >= count);
      } else if heights[thread] < limit {
        partner = nearest_neighbor(thread, count, limit);
      }
      partners[thread] = partner;
    }
    if thread < 8u {
      atomicStore(&stays[thread], 0u);
    }
    workgroupBarrier();
    var low = vec4f(0.0);
    var high = vec4f(0.0);
    var own = vec2u(NO_NODE, 0u);
    var height = 0u;
    var stay = false;
    if is_active {
      low = lows[thread];
      high = highs[thread];
      own = ids[thread];
      height = heights[thread];
      let partner = partners[thread];
      let mutual = partner != thread && partners[partner] == thread;
      stay = !mutual || thread < partner;
      if mutual && stay {
        let other = ids[partner];
        low = vec4f(min(low.xyz, lows[partner].xyz), low.w + lows[partner].w);
        high = vec4f(max(high.xyz, highs[partner].xyz), high.w + highs[partner].w);
        height = max(height, heights[partner]) + 1u;
        binary[own.y] = BinaryNode(low.xyz, own.x, high.xyz, other.x, u32(high.w), low.w, height, 0u);
        own = vec2u(own.y, other.y);
      }
      if stay {
        atomicOr(&stays[thread / 32u], 1u << (thread % 32u));
      }
    }
    workgroupBarrier();
    var place = 0u;
    var left = 0u;
    for (var word = 0u; word < 8u; word++) {
      let bits = atomicLoad(&stays[word]);
      left += countOneBits(bits);
      let mask = select(select(0u, 0xffffffffu, word < thread / 32u), (1u << (thread % 32u)) - 1u, word == thread / 32u);
      place += countOneBits(bits & mask);
    }
    if stay {
      lows[place] = low;
      highs[place] = high;
      ids[place] = own;
      heights[place] = height;
    }
    if thread == 0u {
      active_clusters = left;
    }
    in_pairs = left == count;
  }
  if goal == 1u {
    if thread == 0u && total > 0u {
      state.root = ids[0].x;
    }
  } else if thread < BLOCK_LEFT && block < blocks {
    clusters_left[block * BLOCK_LEFT + thread] = select(vec2u(NO_NODE, 0u), ids[thread], thread < active_clusters);
  }
}

// Bounds over runs of primitives: over each run of four successive primitives stands a node, over four nodes another one, and
// so on up to a single node. A node's place is its depth and its index. Primitives and nodes stand in arrays of vectors that
// have a component for each of the four, so that a ray meets four at once.

#import ray

// Of four boxes, 7 vectors: lowest x, y, z, highest x, y, z and the largest radius.
const NODE_TEXELS: u32 = 7u;
const TEXELS_A_ROW: u32 = 4096u;

// Nodes at a depth, counted from 0 where a node has four primitives.
fn nodes_at(count: u32, depth: u32) -> u32 {
  let shift = 2u * depth + 2u;
  return (count >> shift) + select(0u, 1u, (count & ((1u << shift) - 1u)) != 0u);
}

// The depth with a single node.
fn top_of(count: u32) -> u32 {
  let bits = 32u - countLeadingZeros(max(count, 1u) - 1u);
  return max((bits + 1u) / 2u, 1u) - 1u;
}

// Where a depth's nodes begin, given room for `capacity` primitives: at least nodes_at(capacity, depth) apart, as a third
// of the capacity is left over from each depth to the next.
fn depth_offset(capacity: u32, depth: u32) -> u32 {
  let third = capacity / 3u + 1u;
  return third - (third >> (2u * depth)) + 2u * depth;
}

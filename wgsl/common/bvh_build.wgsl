// What the stages of building a bounding volume hierarchy share: wgsl/bvh_order.wgsl, bvh_cluster.wgsl, bvh_collapse.wgsl.
// Needs math, hashing, surfel and slots.

#import ray
#import sound_piece

// Found and counted on the way.
struct State {
  // Primitives.
  count: u32,
  // The root of the binary tree.
  root: u32,
  padding0: u32,
  padding1: u32,
  // Bounds of the primitives' centres, as ordered() has them: lowest x, y, z and highest x, y, z.
  bounds: array<StateWord, 6>,
  padding2: u32,
  padding3: u32,
  // Nodes of each level of the tree of wide nodes, and of those before it.
  levels: array<StateWord, 64>,
  before: array<u32, 64>,
}

// An inner node of the binary tree. A reference to a node is its index, one to a primitive its index and LEAF.
struct BinaryNode {
  low: vec3f,
  left: u32,
  high: vec3f,
  right: u32,
  // Primitives below it, and the area of their triangles.
  count: u32,
  area: f32,
  // Levels of nodes from it on.
  height: u32,
  padding: u32,
}

const LEAF: u32 = 0x80000000u;
const NO_NODE: u32 = 0xffffffffu;
// Primitives that a workgroup clusters at a time, and clusters that it leaves.
const BLOCK: u32 = 256u;
const BLOCK_LEFT: u32 = 64u;

struct Box {
  low: vec3f,
  high: vec3f,
}

fn union_of(a: Box, b: Box) -> Box {
  return Box(min(a.low, b.low), max(a.high, b.high));
}

// Half of a box's surface; finite.
fn half_area(box: Box) -> f32 {
  let e = min(box.high - box.low, vec3f(FAR));
  return e.x * e.y + e.y * e.z + e.z * e.x;
}

fn center_of(piece: Piece) -> vec3f {
  return (piece.a + piece.b + piece.c) * (1.0 / 3.0);
}

// The box around a primitive, grown by what rounding can move a hit.
fn box_of(piece: Piece) -> Box {
  let margin = POSITION_TOLERANCE * max(abs(piece.a), max(abs(piece.b), abs(piece.c)));
  return Box(min(piece.a, min(piece.b, piece.c)) - margin, max(piece.a, max(piece.b, piece.c)) + margin);
}

// The box of a primitive that is out of range, which no ray meets: the lowest corner of what bounds the others' centres, or 0
// where there are none.
fn point_of(words: vec3u) -> Box {
  let corner = vec3f(from_ordered(words.x), from_ordered(words.y), from_ordered(words.z));
  let point = select(vec3f(0.0), corner, vec3<bool>(is_finite3(corner)));
  return Box(point, point);
}

fn area_of(piece: Piece) -> f32 {
  return 0.5 * length(min(abs(cross(piece.b - piece.a, piece.c - piece.a)), vec3f(FAR)));
}

// Bits of a float that are ordered as floats are.
fn ordered(x: f32) -> u32 {
  let bits = bitcast<u32>(x);
  return select(bits | 0x80000000u, ~bits, (bits & 0x80000000u) != 0u);
}

fn from_ordered(word: u32) -> f32 {
  return bitcast<f32>(select(~word, word & 0x7fffffffu, (word & 0x80000000u) != 0u));
}

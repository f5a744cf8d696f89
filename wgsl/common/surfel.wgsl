// The surfel cloud (src/surfel.rs).

// What a disk is: position in the cloud's space and radius (0 for none).
// And what it belongs to: its packed normal, its piece, its leaf's path within the piece, and its material.
struct SurfelSource {
  normal: u32,
  piece: u32,
  leaf: u32,
  material: u32,
}

// What a surfel sends from each side, W/(m^2 sr).
struct SurfelRadiance {
  front: vec3f,
  padding0: f32,
  back: vec3f,
  padding1: f32,
}

// A triangle after pre-splitting, in the cloud's space.
struct Piece {
  a: vec3f,
  material: u32,
  b: vec3f,
  // See piece_shape() in wgsl/surfelizer.wgsl.
  shape: u32,
  c: vec3f,
  triangle: u32,
}

// Of Piece.shape: bits 0 to 11 are the order, bit 12 says that the piece is below the target area, the rest is a hash
// of the piece's path.
const SHAPE_ORDER: u32 = 0xfffu;
const SHAPE_SMALL: u32 = 0x1000u;
const SHAPE_PATH_SHIFT: u32 = 13u;

// Counts of one recording, readable by the caller: SurfelCounts of src/surfel.rs. The shader that counts aliases
// Counter to atomic<u32>, the others to u32.
struct Counters {
  // Pieces and surfels that the settings ask for, saturating at 2^32 - 1; what exceeds the capacity was dropped.
  pieces: u32,
  surfels: u32,
  // Triangles left out: degenerate, not finite, or with an index out of range.
  rejected: Counter,
  // Surfels in the cloud.
  stored: u32,
  // Pieces fewer than asked for, since large triangles were cut less.
  merged: u32,
  // Share of the pieces' area that found no room, in units of 2^-32.
  lost_area: u32,
}

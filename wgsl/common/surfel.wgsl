// The surfel cloud (src/surfel.rs).

// What a disk is: position in the cloud's eye space and radius (0 for none).
// And what it belongs to: its packed normal, its piece, its leaf's path within the piece, and its material.
struct SurfelSource {
  normal: u32,
  piece: u32,
  leaf: u32,
  material: u32,
}

// A triangle after pre-splitting, in the cloud's eye space.
struct Piece {
  a: vec3f,
  material: u32,
  b: vec3f,
  // See piece_shape() in wgsl/surfelizer.wgsl.
  shape: u32,
  c: vec3f,
  triangle: u32,
}

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
}

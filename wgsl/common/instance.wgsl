// An instance of a mesh: where it is, and what takes rays to the mesh's own space. wgsl/instanced_bvh.wgsl writes them.

struct Instance {
  // Its box, relative to the scene's origin. Where it is left out: beyond all range.
  low: vec3f,
  // The root of the mesh's hierarchy.
  root: u32,
  high: vec3f,
  material: u32,
  // Rows of the matrix that takes what `shift` was subtracted from to the mesh's space.
  x: vec3f,
  // Counted over all meshes'.
  index: u32,
  y: vec3f,
  padding0: u32,
  z: vec3f,
  padding1: u32,
  // Where the mesh's origin is.
  shift: vec3f,
  padding2: u32,
}

// The bounding volume hierarchy that rays traverse: wide nodes in one texture, triangles in another one (src/bvh).
//
// A node is five texels. Its children's boxes are eight bits per plane, in steps of a power of two per axis from the node's own
// lowest corner:
//
//   0   xyz  bits of the lowest corner
//       w    biased exponents of the steps, 8 bits each of x, y and z; from bit 24 on how many children are nodes, from bit
//            28 on how many are leaves
//   1   x    index of the first child that is a node; the others follow
//       y    index of the first triangle of the first leaf; the others follow
//       z    bits 2 k and 2 k + 1 are set where leaf k has a first and a second triangle
//   2…4      lowest x, y, z and highest x, y, z, two words each of four children: nodes first, then leaves, and of either
//            kind first what is most likely to stop a ray that enters it
//
// An instance of a mesh is a node of four texels, from which a ray goes on to the root of the mesh's hierarchy, in its own space:
//
//   0   xyz  bits of where the mesh's origin is; in w IS_INSTANCE, which no other node has there
//   1…3      bits of the rows of the matrix that takes what the origin was subtracted from to the mesh's space; in w the root,
//            the index of the mesh's material, and that of the instance
//
// A triangle is three texels of bits of floats:
//
//   0   a corner; in w the index of its primitive
//   1   the edge from it to the second corner; in w the sum of both edges' largest components, times POSITION_TOLERANCE
//   2   the edge from it to the third corner; in w the corner's largest component
//
// With #if ALPHA_TESTED it is five; the highest bit of its primitive's index then says whether it has holes, and if so
//
//   3   texture coordinates of the first and the second corner
//   4   those of the third; the least alpha that is there, and which picture tells (wgsl/common/cutout.wgsl)

const NODE_TEXELS: u32 = 5u;
#if ALPHA_TESTED
const TRIANGLE_TEXELS: u32 = 5u;
const HAS_HOLES: u32 = 0x80000000u;
#else
const TRIANGLE_TEXELS: u32 = 3u;
#endif
const IS_INSTANCE: u32 = 0xffffffffu;
// Texels of a row: whole nodes and whole triangles.
const ROW_TEXELS: u32 = 4095u;
const NODES_A_ROW: u32 = ROW_TEXELS / NODE_TEXELS;
const TRIANGLES_A_ROW: u32 = ROW_TEXELS / TRIANGLE_TEXELS;

// Children of a node.
const WIDTH: u32 = 8u;
// Triangles of a leaf, at most.
const LEAF_SIZE: u32 = 2u;
// Levels of nodes, at most: see src/bvh/triangles.rs.
const MAX_DEPTH: u32 = 52u;
#if TWO_LEVELS
// Those of the instances, and of a mesh.
const STACK_SIZE: u32 = 2u * MAX_DEPTH;
#else
const STACK_SIZE: u32 = MAX_DEPTH;
#endif

fn node_texel_at(node: u32) -> vec2u {
  return vec2u((node % NODES_A_ROW) * NODE_TEXELS, node / NODES_A_ROW);
}

fn triangle_texel_at(triangle: u32) -> vec2u {
  return vec2u((triangle % TRIANGLES_A_ROW) * TRIANGLE_TEXELS, triangle / TRIANGLES_A_ROW);
}

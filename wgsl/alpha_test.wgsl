// AlphaTest: the holes of a cloud's pieces.
//
//   cut_pieces   one thread per triangle of an alpha-tested mesh: texture coordinates of the pieces that it was split into
//
// A triangle's texture coordinates are linear over its plane: a piece's corners have them by where they lie in it.

#import math
#import hashing
#import dispatch
#import surfel
#import triangle
#import slots
#import mesh
#import placed
#import cutout
#import cutout_at
#import tex_coords

alias Counter = u32;

struct Params {
  // The focus that the cloud is relative to, as two floats a coordinate: high + low.
  origin_high: vec3f,
  // Triangles and pieces that the cloud has room for.
  triangle_count: u32,
  origin_low: vec3f,
  piece_capacity: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> mesh: Mesh;
@group(0) @binding(2) var<uniform> alpha_test: AlphaTest;
@group(0) @binding(3) var<storage, read> vertices: array<u32>;
@group(0) @binding(4) var<storage, read> indices: array<u32>;
@group(0) @binding(5) var<storage, read> transforms: array<u32>;
@group(0) @binding(6) var<storage, read> tex_coords: array<u32>;
// First piece of each triangle, and behind the last one how many there are.
@group(0) @binding(7) var<storage, read> triangle_offsets: array<u32>;
@group(0) @binding(8) var<storage, read> pieces: array<Piece>;
// Of each piece; those of meshes that are not alpha-tested were cleared.
@group(0) @binding(9) var<storage, read_write> cutouts: array<Cutout>;

@compute @workgroup_size(64)
fn cut_pieces(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= mesh.triangles * mesh.instances {
    return;
  }
  let first = triangle_offsets[mesh.first_triangle + i];
  let end = triangle_offsets[mesh.first_triangle + i + 1u];
  let total = triangle_offsets[params.triangle_count];
  let t = fetch(i);
  var whole = cutout_of(vertices_of(i % mesh.triangles));
  if are_mirrored(axes_of(i / mesh.triangles)) {
    // So are the corners.
    whole = Cutout(whole.a, whole.c, whole.b, whole.threshold, whole.map);
  }
  for (var index = first; index < end; index++) {
    let room = slot_for(index, total, params.piece_capacity);
    if room != NO_ROOM && whole.threshold > 0.0 {
      let piece = pieces[room];
      // Most triangles are their only piece. A small one may be enlarged, since it stands for others: what is there of it is
      // what there is of the small one.
      let is_small = (piece.shape & SHAPE_SMALL) != 0u && (piece.shape >> SHAPE_PATH_SHIFT) == 0u;
      if is_small || (all(piece.a == t.a) && all(piece.b == t.b) && all(piece.c == t.c)) {
        cutouts[room] = whole;
      } else {
        let a = tex_coords_at(piece.a, t, whole);
        cutouts[room] = sound_cutout(a, tex_coords_at(piece.b, t, whole), tex_coords_at(piece.c, t, whole));
      }
    }
  }
}

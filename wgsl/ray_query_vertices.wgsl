// Bvh by the device: the corners of a cloud's pieces, for the device to build its acceleration structure from.
//
//   place_corners  one thread per slot of the cloud: three corners each, so that a triangle has its piece's index

#import math
#import hashing
#import dispatch
#import surfel
#import slots
#import sound_piece

alias Counter = u32;

@group(0) @binding(0) var<storage, read> counters: Counters;
@group(0) @binding(1) var<storage, read> pieces: array<Piece>;
// Three floats a corner.
@group(0) @binding(2) var<storage, read_write> vertices: array<f32>;

// Where triangles shrink to that no ray is to meet: a place of the scene, so that the structure is not wider for them. Corners
// that are no numbers would be left out of it altogether, but lavapipe (Mesa 25.0) then builds one that nothing hits.
fn hidden_corner(count: u32) -> vec3f {
  if count > 0u && is_sound(pieces[0]) {
    return pieces[0].a;
  }
  return vec3f(0.0);
}

fn store_corner(at: u32, corner: vec3f) {
  vertices[at] = corner.x;
  vertices[at + 1u] = corner.y;
  vertices[at + 2u] = corner.z;
}

@compute @workgroup_size(64)
fn place_corners(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  let capacity = arrayLength(&pieces);
  if i >= capacity {
    return;
  }
  let count = slots_taken(counters.pieces, capacity);
  var piece = pieces[i];
  // Behind the pieces that there are may be some of an earlier recording.
  if i >= count || !is_sound(piece) {
    piece.a = hidden_corner(count);
    piece.b = piece.a;
    piece.c = piece.a;
  }
  store_corner(9u * i, piece.a);
  store_corner(9u * i + 3u, piece.b);
  store_corner(9u * i + 6u, piece.c);
}

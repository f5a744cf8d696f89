// Texture coordinates of a mesh in the caller's buffer, and the holes of its triangles. Needs mesh and cutout.
//
// The importer declares `alpha_test: AlphaTest` and the buffer `tex_coords`.

#needs alpha_test tex_coords

struct AlphaTest {
  // In words of 4 bytes from the start of the binding.
  offset: u32,
  stride: u32,
  format: u32,
  // As Cutout has them.
  threshold: f32,
  map: u32,
  padding0: u32,
  padding1: u32,
  padding2: u32,
}

fn tex_coords_of(vertex: u32) -> vec2f {
  let word = alpha_test.offset + vertex * alpha_test.stride;
  if alpha_test.format == 0u {
    return bitcast<vec2f>(vec2u(tex_coords[word], tex_coords[word + 1u]));
  }
  if alpha_test.format == 1u {
    return unpack2x16float(tex_coords[word]);
  }
  return unpack2x16unorm(tex_coords[word]);
}

// Of a triangle with these vertices.
fn cutout_of(vertices: vec3u) -> Cutout {
  if alpha_test.threshold == 0.0 || any(vertices == vec3u(NO_VERTEX)) {
    return NO_HOLES;
  }
  return sound_cutout(tex_coords_of(vertices.x), tex_coords_of(vertices.y), tex_coords_of(vertices.z));
}

// Where no coordinates are known there are no holes.
fn sound_cutout(a: vec2f, b: vec2f, c: vec2f) -> Cutout {
  if !(is_finite3(vec3f(a, b.x)) && is_finite3(vec3f(b.y, c))) {
    return NO_HOLES;
  }
  return Cutout(a, b, c, alpha_test.threshold, alpha_test.map);
}

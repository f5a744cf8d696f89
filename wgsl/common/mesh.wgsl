// A mesh in the caller's buffers, and its transforms.

#needs mesh vertices indices transforms

struct Mesh {
  // In words of 4 bytes from the start of the binding.
  vertex_offset: u32,
  vertex_stride: u32,
  vertex_format: u32,
  vertex_count: u32,
  // In indices.
  index_offset: u32,
  index_format: u32,
  base_vertex: i32,
  triangles: u32,
  instance_offset: u32,
  instance_stride: u32,
  instance_format: u32,
  instances: u32,
  // Number of this mesh's first triangle among those of all meshes.
  first_triangle: u32,
  material: u32,
  padding0: u32,
  padding1: u32,
}

fn vertex_position(vertex: u32) -> vec3f {
  let word = mesh.vertex_offset + vertex * mesh.vertex_stride;
  if mesh.vertex_format == 0u {
    return bitcast<vec3f>(vec3u(vertices[word], vertices[word + 1u], vertices[word + 2u]));
  }
  let xy = unpack2x16float(vertices[word]);
  return vec3f(xy, unpack2x16float(vertices[word + 1u]).x);
}

// The vertex that corner `i` of the draw refers to, or NO_VERTEX where it is out of range.
const NO_VERTEX: u32 = 0xffffffffu;

fn vertex_index(i: u32) -> u32 {
  let at = mesh.index_offset + i;
  if at < i {
    return NO_VERTEX;
  }
  var index = at;
  if mesh.index_format == 1u {
    index = (indices[at / 2u] >> (16u * (at & 1u))) & 0xffffu;
  } else if mesh.index_format == 2u {
    index = indices[at];
  }
  // A sum that wraps around is out of range, not a vertex at the other end.
  let vertex = index + bitcast<u32>(mesh.base_vertex);
  let wraps = select((vertex < index), (vertex > index), mesh.base_vertex < 0);
  return select(vertex, NO_VERTEX, wraps || vertex >= mesh.vertex_count);
}

// The vertices of triangle `i` of the draw.
fn vertices_of(i: u32) -> vec3u {
  return vec3u(vertex_index(3u * i), vertex_index(3u * i + 1u), vertex_index(3u * i + 2u));
}

fn transform_element(base: u32, row: u32, column: u32) -> f32 {
  // Format 1: columns of four. Format 2: rows of four.
  let at = select(row * 4u + column, column * 4u + row, mesh.instance_format == 1u);
  return bitcast<f32>(transforms[base + at]);
}

fn transform_column(base: u32, column: u32) -> vec3f {
  return vec3f(
    transform_element(base, 0u, column),
    transform_element(base, 1u, column),
    transform_element(base, 2u, column),
  );
}

// The origin, of two floats a coordinate, is subtracted before anything is added to a translation, so that nothing is rounded
// at the scale of a scene far from the world's origin.
fn relative_to(origin_high: vec3f, origin_low: vec3f, p: vec3f) -> vec3f {
  return (p - origin_high) - origin_low;
}

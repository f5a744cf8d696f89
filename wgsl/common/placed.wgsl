// A mesh's triangles as its instances have them, in the cloud's space. Needs math, triangle and mesh.
//
// The importer declares `params` with the cloud's origin, as two floats a coordinate: `origin_high` and `origin_low`.

#needs params

fn relative_to_origin(p: vec3f) -> vec3f {
  return relative_to(params.origin_high, params.origin_low, p);
}

// The axes of an instance; the identity's without transforms.
fn axes_of(instance: u32) -> mat3x3f {
  if mesh.instance_format == 0u {
    return mat3x3f(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), vec3f(0.0, 0.0, 1.0));
  }
  let base = mesh.instance_offset + instance * mesh.instance_stride;
  return mat3x3f(transform_column(base, 0u), transform_column(base, 1u), transform_column(base, 2u));
}

// Whether axes mirror: their triangles' corners then go around the other way. Products of axes as they are could leave the
// range of f32.
fn are_mirrored(axes: mat3x3f) -> bool {
  let largest = max(max_component(abs(axes[0])), max(max_component(abs(axes[1])), max_component(abs(axes[2]))));
  return determinant(mat3x3f(axes[0] / largest, axes[1] / largest, axes[2] / largest)) < 0.0;
}

// Triangle `i` of the draw in the cloud's space; all zero where it is unusable.
fn fetch(i: u32) -> Triangle {
  let none = Triangle(vec3f(0.0), vec3f(0.0), vec3f(0.0));
  let instance = i / mesh.triangles;
  let corners = vertices_of(i % mesh.triangles);
  if any(corners == vec3u(NO_VERTEX)) {
    return none;
  }
  var t = Triangle(vertex_position(corners.x), vertex_position(corners.y), vertex_position(corners.z));
  if mesh.instance_format == 0u {
    t = Triangle(relative_to_origin(t.a), relative_to_origin(t.b), relative_to_origin(t.c));
  } else {
    let m = axes_of(instance);
    let base = mesh.instance_offset + instance * mesh.instance_stride;
    let shift = relative_to_origin(transform_column(base, 3u));
    t = Triangle(m * t.a + shift, m * t.b + shift, m * t.c + shift);
    if are_mirrored(m) {
      t = Triangle(t.a, t.c, t.b);
    }
  }
  if !(is_finite3(t.a) && is_finite3(t.b) && is_finite3(t.c)) {
    return none;
  }
  return t;
}

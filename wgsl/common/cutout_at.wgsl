// Texture coordinates within a triangle with holes. Needs math, triangle and cutout.

// Of a point in the triangle's plane.
fn tex_coords_at(point: vec3f, t: Triangle, whole: Cutout) -> vec2f {
  let e1 = t.b - t.a;
  let e2 = t.c - t.a;
  // Products of edges would underflow below 1e-19.
  let scale = max(max_component(abs(e1)), max_component(abs(e2)));
  let normal = cross(e1 / scale, e2 / scale);
  let from_a = (point - t.a) / scale;
  let per_area = 1.0 / dot(normal, normal);
  let v = dot(cross(from_a, e2 / scale), normal) * per_area;
  let w = dot(cross(e1 / scale, from_a), normal) * per_area;
  return whole.a + (whole.b - whole.a) * v + (whole.c - whole.a) * w;
}

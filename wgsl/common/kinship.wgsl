// How far a neighbour's surface is the pixel's own, for what is shared among pixels.

#needs params

// 1 where it lies in its tangent plane and is turned alike. `d` leads from the pixel to it.
fn kinship(normal: vec3f, other_normal: vec3f, d: vec3f, per_tolerance: f32) -> f32 {
  let off_plane = max(abs(dot(normal, d)), abs(dot(other_normal, d))) * per_tolerance;
  let in_plane = max(1.0 - off_plane * off_plane, 0.0);
  let alike = max(1.0 - (params.normal_power / 8.0) * (1.0 - dot(normal, other_normal)), 0.0);
  let alike4 = alike * alike * alike * alike;
  return in_plane * in_plane * alike4 * alike4;
}

fn per_tolerance_at(pixel: f32) -> f32 {
  return 1.0 / max(params.plane_distance * pixel, 1e-30);
}

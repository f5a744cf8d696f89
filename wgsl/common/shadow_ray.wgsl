// Shadows along rays, among a cloud's pieces. Needs light and meet_triangles, with #if SHADOW_RAYS.

// Whether a light reaches a point off a surface, 1 or 0.
fn unshadowed(point: vec3f, light: Light, count: u32, capacity: u32) -> f32 {
  // From where the ray starts: with the way from the surface itself its end would lie beyond the light.
  let way = way_to(light, point);
  var ray = make_ray(point, way.to_light);
  if light.kind != DIRECTIONAL {
    ray.end_size = max_component(abs(light.position));
  }
  let hit = walk(ray, count, capacity, way.distance, true);
  return select(0.0, 1.0, hit.sender == NO_SENDER);
}

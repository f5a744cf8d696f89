// Shadows along rays. Needs light, and bvh_traverse or ray_query_traverse, with #if SHADOW_RAYS.

// Whether a light reaches a point off a surface, 1 or 0.
fn unshadowed(point: vec3f, light: Light) -> f32 {
  // From where the ray starts: with the way from the surface itself its end would lie beyond the light.
  let way = way_to(light, point);
  var ray = make_ray(point, way.to_light);
  if light.kind != DIRECTIONAL {
    ray.end_size = max_component(abs(light.position));
  }
  return select(1.0, 0.0, trace_any(ray, way.distance) < FAR);
}

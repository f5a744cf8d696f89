// Shadows along rays. Needs light and bvh_traverse.

// Whether a light reaches a point off a surface, 1 or 0.
fn unshadowed(point: vec3f, arrival: Arrival) -> f32 {
  // What the light itself lies on casts no shadow.
  return select(1.0, 0.0, trace_any(make_ray(point, arrival.to_light), arrival.distance * (1.0 - 1e-5)));
}

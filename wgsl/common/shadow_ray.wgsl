// Shadows along rays, among a cloud's pieces. Needs light and meet_triangles.

// Whether a light reaches a point off a surface, 1 or 0.
fn unshadowed(point: vec3f, arrival: Arrival, count: u32, capacity: u32) -> f32 {
  // What the light itself lies on casts no shadow.
  let hit = walk(make_ray(point, arrival.to_light), count, capacity, arrival.distance * (1.0 - 1e-5), true);
  return select(0.0, 1.0, hit.sender == NO_SENDER);
}

// Needs spherical_gaussian.

// A vertex of the hull (src/sg_hull): where it is, how far along the camera's axis, and the light that arrives there.
struct HullVertex {
  position: vec3f,
  depth: f32,
  red: vec4f,
  green: vec4f,
  blue: vec4f,
  // What one lobe gets wrong of the irradiance of a surface with the vertex's normal, a colour channel each.
  excess: vec3f,
  // The vertex whose light it has: itself, or one of another corner that is the same point of the same surface.
  owner: u32,
  // What a surface with the vertex's normal receives, and from classifying on one with the segment's.
  irradiance: vec3f,
  padding: u32,
}

// Irradiance from the moments of a colour channel, less their excess at a vertex.
fn lobe_irradiance(moments: LightMoments, excess: f32, normal: vec3f) -> f32 {
  let scaled = sg_lobe(moments);
  let found = scaled.amplitude * sg_cosine_integral(dot(normal, scaled.lobe.axis), scaled.lobe.sharpness);
  return max(found - excess, 0.0);
}

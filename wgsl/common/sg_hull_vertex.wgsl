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
}

// What a surface sends (src/geometry.rs). Needs math.
struct Material {
  albedo: vec3f,
  // Radiosity.
  emission: vec3f,
}

// The brightest that is stored, and what a material may say.
const BRIGHTEST: f32 = 1e18;

// A material's colour; what is negative or not finite counts as black.
fn sound(color: vec3f) -> vec3f {
  let finite = vec3<bool>(is_finite(color.x), is_finite(color.y), is_finite(color.z));
  return select(vec3f(0.0), clamp(color, vec3f(0.0), vec3f(BRIGHTEST)), finite);
}

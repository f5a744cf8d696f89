// What a surface sends (src/geometry.rs). Needs math.
struct Material {
  albedo: vec3f,
  // Radiosity of the front.
  emission: vec3f,
  // Not 0: of the back too.
  double_sided: u32,
}

// The brightest that is stored, and what a material may say.
const BRIGHTEST: f32 = 1e18;

// A material's colour; what is negative or not finite counts as black.
fn sanitize(color: vec3f) -> vec3f {
  let finite = vec3<bool>(is_finite(color.x), is_finite(color.y), is_finite(color.z));
  return select(vec3f(0.0), clamp(color, vec3f(0.0), vec3f(BRIGHTEST)), finite);
}

// What a side of a surface sends of its own.
fn own_radiosity(material: Material, front: bool) -> vec3f {
  return select(vec3f(0.0), sanitize(material.emission), front || material.double_sided != 0u);
}

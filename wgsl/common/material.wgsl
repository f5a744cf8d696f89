// What a surface sends (src/geometry.rs).
struct Material {
  albedo: vec3f,
  // Radiosity.
  emission: vec3f,
}

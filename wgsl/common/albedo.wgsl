// The albedo that a texel of the G-buffer holds (src/gbuffer.rs): what is not finite counts as black, the rest is 0…1. Needs
// math.
fn decode_albedo(texel: vec3f) -> vec3f {
  let finite = vec3<bool>(is_finite(texel.x), is_finite(texel.y), is_finite(texel.z));
  return select(vec3f(0.0), clamp(texel, vec3f(0.0), vec3f(1.0)), finite);
}

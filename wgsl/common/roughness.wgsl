// The perceptual roughness that a texel of the G-buffer holds (src/gbuffer.rs): clamped to 0...1; NaN counts as 1. Compares
// bits, as is_finite does.
fn clean_roughness(roughness: f32) -> f32 {
  let is_nan = (bitcast<u32>(roughness) & 0x7fffffffu) > 0x7f800000u;
  return select(clamp(roughness, 0.0, 1.0), 1.0, is_nan);
}

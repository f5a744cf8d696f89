// What a target of floats can hold (src/gpu/screen.rs): of what is brighter, halves make infinity, or no number at all. All that
// is drawn into a caller's texture goes through held().
override brightest: f32 = 3.4e38;

fn held(color: vec4f) -> vec4f {
  // Where floats are stored as they are, so are those that arithmetic might flush to 0.
  if brightest > 3e38 {
    return color;
  }
  return clamp(color, vec4f(-brightest), vec4f(brightest));
}

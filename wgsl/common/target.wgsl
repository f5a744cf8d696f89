// What a target of floats can hold (src/gpu/screen.rs): of what is brighter, halves make infinity, or no number at all.
override brightest: f32 = 3.4e38;

fn held(color: vec4f) -> vec4f {
  return vec4f(min(color.xyz, vec3f(brightest)), color.w);
}

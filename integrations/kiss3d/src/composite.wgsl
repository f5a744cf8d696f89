// Adds light to kiss3d's film, a pixel for a pixel.

@group(0) @binding(0) var light: texture_2d<f32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
  let corner = vec2f(f32((index << 1u) & 2u), f32(index & 2u));
  return vec4f(corner * 2.0 - 1.0, 0.0, 1.0);
}

@fragment
fn fragment(@builtin(position) at: vec4f) -> @location(0) vec4f {
  return vec4f(textureLoad(light, vec2i(at.xy), 0).rgb, 0.0);
}

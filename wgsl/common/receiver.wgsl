// What a pass reads of a pixel: one texel of the Rgba32Uint texture that wgsl/receivers.wgsl writes. xyz are the bits
// of the position in the cloud's space, w is the packed shading normal or SKY.

// Both halves are -32768, which pack2x16snorm never gives.
const SKY: u32 = 0x80008000u;

fn receiver_position(texel: vec4u) -> vec3f {
  return bitcast<vec3f>(texel.xyz);
}

// Unit vectors as octahedral coordinates in two snorm16 (Cigolle et al. 2014).

fn sign_not_zero(v: vec2f) -> vec2f {
  return select(vec2f(-1.0), vec2f(1.0), v >= vec2f(0.0));
}

fn octahedral_from(n: vec3f) -> vec2f {
  let p = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
  return select((vec2f(1.0) - abs(p.yx)) * sign_not_zero(p), p, n.z >= 0.0);
}

// Not normalised: the caller knows whether it needs to be.
fn octahedral_to(e: vec2f) -> vec3f {
  let z = 1.0 - abs(e.x) - abs(e.y);
  let folded = (vec2f(1.0) - abs(e.yx)) * sign_not_zero(e);
  return vec3f(select(folded, e, z >= 0.0), z);
}

fn pack_normal(n: vec3f) -> u32 {
  return pack2x16snorm(octahedral_from(n));
}

fn unpack_normal(bits: u32) -> vec3f {
  return normalize(octahedral_to(unpack2x16snorm(bits)));
}

// A colour of 0 to 1e30 in four bytes: 8 bits per channel and a shared exponent (Ward 1991), rounded to nearest, so within
// 1/256 of the largest channel.
fn pack_color(color: vec3f) -> u32 {
  // By its bits, see is_finite: clamp may return anything for what is not a number. That counts as 0.
  let is_nan = (bitcast<vec3u>(color) & vec3u(0x7fffffffu)) > vec3u(0x7f800000u);
  let c = clamp(select(color, vec3f(0.0), is_nan), vec3f(0.0), vec3f(1e30));
  let largest = max(c.x, max(c.y, c.z));
  if !(largest >= 1e-30) {
    return 0u;
  }
  // 2^(exponent - 1) <= largest < 2^exponent, and one more where rounding to 8 bits reaches 256.
  var exponent = i32(bitcast<u32>(largest) >> 23u) - 126;
  exponent += select(0, 1, largest * color_scale(exponent) >= 255.5);
  let bits = vec3u(floor(c * color_scale(exponent) + 0.5));
  return bits.x | (bits.y << 8u) | (bits.z << 16u) | (u32(exponent + 128) << 24u);
}

// 2^(8 - exponent).
fn color_scale(exponent: i32) -> f32 {
  return bitcast<f32>(u32(127 + 8 - exponent) << 23u);
}

fn unpack_color(bits: u32) -> vec3f {
  let exponent = i32(bits >> 24u) - 128;
  let scale = bitcast<f32>(u32(clamp(127 - 8 + exponent, 0, 254)) << 23u);
  return vec3f(vec3u(bits, bits >> 8u, bits >> 16u) & vec3u(255u)) * scale;
}

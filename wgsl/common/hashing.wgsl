// Integer hashing. `hash` is the 32-bit finaliser by C. Wellons ("lowbias32"): a bijection with low bias.

fn hash(value: u32) -> u32 {
  var x = value;
  x ^= x >> 16u;
  x *= 0x7feb352du;
  x ^= x >> 15u;
  x *= 0x846ca68bu;
  x ^= x >> 16u;
  return x;
}

fn hash2(a: u32, b: u32) -> u32 {
  return hash(a ^ hash(b + 0x9e3779b9u));
}

// 0 <= x < 1, from the upper 24 bits.
fn unit_float(bits: u32) -> f32 {
  return f32(bits >> 8u) * (1.0 / 16777216.0);
}

// The upper 32 bits of a 64-bit product.
fn multiply_high(a: u32, b: u32) -> u32 {
  let al = a & 0xffffu;
  let ah = a >> 16u;
  let bl = b & 0xffffu;
  let bh = b >> 16u;
  let low = al * bl;
  let middle = ah * bl + (low >> 16u);
  let middle2 = al * bh + (middle & 0xffffu);
  return ah * bh + (middle >> 16u) + (middle2 >> 16u);
}

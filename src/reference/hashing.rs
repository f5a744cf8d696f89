//! Mirror of `wgsl/common/hashing.wgsl`: the same bits as the shader's.

/// The 32-bit finaliser by C. Wellons ("lowbias32").
pub fn hash(value: u32) -> u32 {
    let mut x = value;
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^= x >> 16;
    x
}

/// One hash of two numbers.
pub fn hash2(a: u32, b: u32) -> u32 {
    hash(a ^ hash(b.wrapping_add(0x9e37_79b9)))
}

/// 0 ≤ x < 1, from the upper 24 bits. The same number in f32 and f64.
pub fn unit_float(bits: u32) -> f64 {
    f64::from(bits >> 8) * (1.0 / 16_777_216.0)
}

/// The upper 32 bits of a 64-bit product. The shader has no 64-bit integers and multiplies in halves.
pub fn multiply_high(a: u32, b: u32) -> u32 {
    ((u64::from(a) * u64::from(b)) >> 32) as u32
}

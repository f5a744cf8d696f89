//! A hash of integers, for variety that is the same on every machine and in every run.

/// Scatters the bits of `x`. Constants: "lowbias32" of Chris Wellons's hash-prospector.
pub(super) fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// A number in [0, 1) made from `x`.
pub(super) fn unit(x: u32) -> f64 {
    f64::from(hash(x)) / 2.0_f64.powi(32)
}

//! Mirror of `wgsl/common/packing.wgsl`.

use glam::{DVec2, DVec3};

fn sign_not_zero(v: DVec2) -> DVec2 {
    DVec2::select(v.cmpge(DVec2::ZERO), DVec2::ONE, DVec2::NEG_ONE)
}

/// Octahedral coordinates of a unit vector.
pub fn octahedral_from(n: DVec3) -> DVec2 {
    let p = n.truncate() / (n.x.abs() + n.y.abs() + n.z.abs());
    if n.z >= 0.0 {
        p
    } else {
        (DVec2::ONE - DVec2::new(p.y, p.x).abs()) * sign_not_zero(p)
    }
}

/// The direction of octahedral coordinates. Not normalised: the caller knows whether it needs to be.
pub fn octahedral_to(e: DVec2) -> DVec3 {
    let z = 1.0 - e.x.abs() - e.y.abs();
    let folded = (DVec2::ONE - DVec2::new(e.y, e.x).abs()) * sign_not_zero(e);
    let xy = if z >= 0.0 { e } else { folded };
    xy.extend(z)
}

/// A unit vector as octahedral coordinates in two snorm16.
pub fn pack_normal(n: DVec3) -> u32 {
    let e = octahedral_from(n);
    let snorm = |v: f64| u32::from((0.5 + 32767.0 * v.clamp(-1.0, 1.0)).floor() as i16 as u16);
    snorm(e.x) | snorm(e.y) << 16
}

/// The unit vector that [`pack_normal`] packed, to its precision.
pub fn unpack_normal(bits: u32) -> DVec3 {
    let snorm = |half: u32| (f64::from(half as u16 as i16) / 32767.0).max(-1.0);
    octahedral_to(DVec2::new(snorm(bits), snorm(bits >> 16))).normalize()
}

/// A colour of 0 to 1e30 in four bytes: 8 bits per channel and a shared exponent. In the shader's own f32, since a bit
/// more or less would be another colour.
pub fn pack_color(color: [f32; 3]) -> u32 {
    let c = color.map(|c| c.clamp(0.0, 1e30));
    let largest = c[0].max(c[1]).max(c[2]);
    if largest.is_nan() || largest < 1e-30 {
        return 0;
    }
    let mut exponent = (largest.to_bits() >> 23) as i32 - 126;
    if largest * color_scale(exponent) >= 255.5 {
        exponent += 1;
    }
    let [r, g, b] = c.map(|c| (c * color_scale(exponent) + 0.5).floor() as u32);
    r | (g << 8) | (b << 16) | (((exponent + 128) as u32) << 24)
}

/// 2^(8 − exponent).
fn color_scale(exponent: i32) -> f32 {
    f32::from_bits(((127 + 8 - exponent) as u32) << 23)
}

/// The colour that [`pack_color`] packed, to its precision.
pub fn unpack_color(bits: u32) -> DVec3 {
    let exponent = (bits >> 24) as i32 - 128;
    let [r, g, b, _] = bits.to_le_bytes().map(f64::from);
    DVec3::new(r, g, b) * 2_f64.powi((exponent - 8).clamp(-127, 127))
}

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

//! Bent normals with an occlusion cone, by splatting (`wgsl/effects/bent_normals.wgsl`).

use super::ambient_occlusion::Overlap;
use crate::effect::Effect;

/// The mean of the directions in which a pixel sees the sky, cosine-weighted about its normal (Landis, *Production-Ready Global
/// Illumination*, 2002), and visibility as [`AmbientOcclusion`](crate::AmbientOcclusion) has it, of which
/// [`HitResolver::cone_angle`](crate::HitResolver::cone_angle) makes a cone.
///
/// Two thirds of the normal, less the sum over surfels of what each hides: a point-to-disk form factor times the direction to
/// it. What lies behind something else counts twice, as in all sums, so that much of it turns the normal too far; rays know
/// better ([`RayTracedEffect::BentNormals`](crate::RayTracedEffect::BentNormals)).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct BentNormals {
    /// As [`AmbientOcclusion::two_sided`](crate::AmbientOcclusion::two_sided).
    pub two_sided: bool,
    /// How occluders combine: what all of them hide is the sum, up to all, or `1 − exp(−Σ F)` of the hemisphere.
    pub overlap: Overlap,
}

impl BentNormals {
    /// The effect. Four channels; reads the G-buffer's normals, and writes the unit bent normal, in world axes, to r, g and
    /// b, and visibility to a; black and 1 for the sky. Where nothing is open the bent normal is the shading normal.
    pub fn effect(self) -> Effect {
        Effect {
            channels: 4,
            normal: true,
            two_sided: self.two_sided,
            constants: vec![
                ("TWO_SIDED".into(), f64::from(u8::from(self.two_sided))),
                ("OVERLAP".into(), self.overlap.constant()),
            ],
            ..Effect::new(
                "bent normals",
                include_str!("../../wgsl/effects/bent_normals.wgsl"),
            )
        }
    }
}

//! What a sky gives, less what hides it, by splatting (`wgsl/effects/directional_occlusion.wgsl`).

use super::ambient_occlusion::Overlap;
use crate::effect::Effect;

/// What a white diffuse surface sends on of an [`Environment`](crate::Environment), less what surfels hide of it: of each the
/// form factor of its disk times the mean radiance of the environment over the disk's solid angle.
///
/// The environment has [levels](crate::EnvironmentSettings::levels). What is open is known by spherical harmonics
/// ([`Environment::irradiance`](crate::Environment::irradiance)), and a surfel's solid angle is at least that of
/// [`SplatSettings::epsilon`](crate::SplatSettings::epsilon), π ε, but where it is alone on its level: the shadow of a small
/// sun is as soft as that, 11° for 0.01, and sums do not know what hides what. Rays do
/// ([`RayTracedEffect::DirectionalOcclusion`](crate::RayTracedEffect::DirectionalOcclusion)).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct DirectionalOcclusion {
    /// As [`AmbientOcclusion::two_sided`](crate::AmbientOcclusion::two_sided).
    pub two_sided: bool,
    /// How occluders combine: what they hide is taken off all there is, `E − Σ F L`, at least 0, or leaves the share
    /// `exp(−Σ F L / E)` of it.
    pub overlap: Overlap,
}

impl DirectionalOcclusion {
    /// The effect. Three channels; reads the G-buffer's normals and the environment, and writes outgoing radiance, W/(m² sr), to
    /// r, g and b and 1 to a; black for the sky.
    pub fn effect(self) -> Effect {
        Effect {
            channels: 3,
            normal: true,
            environment: true,
            two_sided: self.two_sided,
            constants: vec![
                ("TWO_SIDED".into(), f64::from(u8::from(self.two_sided))),
                ("OVERLAP".into(), self.overlap.constant()),
            ],
            ..Effect::new(
                "directional occlusion",
                include_str!("../../wgsl/effects/directional_occlusion.wgsl"),
            )
        }
    }
}

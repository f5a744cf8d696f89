//! One bounce of glossy light by splatting (`wgsl/effects/specular_bounce.wgsl`).

use crate::{
    effect::Effect,
    error::{Error, check_setting},
};

/// Light that surfels send on to glossy surfaces: of each its radiance times its solid angle, the GGX lobe of the pixel's
/// roughness about its view, and the cosine, from all surfaces, seen or not. The lobe is that of
/// [`Sampling::Glossy`](crate::Sampling::Glossy), widened by the disk's own size. What a surfel sends comes from the
/// [`SurfelShader`](crate::SurfelShader) or the caller ([`SplatInput::radiance`](crate::SplatInput::radiance)).
///
/// A mirror shows surfels, not surfaces: they are at least as wide as
/// [`SplatSettings::epsilon`](crate::SplatSettings::epsilon) has them, about what a roughness of 0.27 blurs with 0.01, 0.38
/// with 0.04. And nothing is between a surfel and a pixel, so that what is hidden is reflected too. Rays know what hides what
/// ([`RayTracedEffect::IndirectSpecular`](crate::RayTracedEffect::IndirectSpecular)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpecularBounce {
    /// As [`DiffuseBounce::two_sided`](crate::DiffuseBounce::two_sided).
    pub two_sided: bool,
    /// As [`DiffuseBounce::unit`](crate::DiffuseBounce::unit).
    pub unit: f32,
    /// Reflectance seen straight on, linear RGB, 0…1 each, as
    /// [`HitResolverSettings::f0`](crate::HitResolverSettings::f0). Default 0.04, of most that is no metal.
    pub f0: [f32; 3],
}

impl Default for SpecularBounce {
    fn default() -> Self {
        Self {
            two_sided: false,
            unit: 1.0,
            f0: [0.04; 3],
        }
    }
}

impl SpecularBounce {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.unit > 0.0 && self.unit <= 1e18,
            "SpecularBounce::unit",
            self.unit,
            "above 0 to 1e18",
        )?;
        for channel in self.f0 {
            check_setting(
                (0.0..=1.0).contains(&channel),
                "SpecularBounce::f0",
                channel,
                "0 to 1",
            )?;
        }
        Ok(())
    }

    /// The effect. Three channels; reads the surfels' radiance and the G-buffer's normals and roughness, and writes outgoing
    /// radiance, W/(m² sr), to r, g and b and 1 to a.
    ///
    /// # Errors
    /// What [`SpecularBounce::validate`] finds.
    pub fn effect(self) -> Result<Effect, Error> {
        self.validate()?;
        let [red, green, blue] = self.f0.map(f64::from);
        Ok(Effect {
            channels: 3,
            radiance: true,
            view: true,
            roughness: true,
            two_sided: self.two_sided,
            constants: vec![
                ("UNIT".into(), self.unit.into()),
                ("F0_RED".into(), red),
                ("F0_GREEN".into(), green),
                ("F0_BLUE".into(), blue),
            ],
            ..Effect::new(
                "specular bounce",
                include_str!("../../wgsl/effects/specular_bounce.wgsl"),
            )
        })
    }
}

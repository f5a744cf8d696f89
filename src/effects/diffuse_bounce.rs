//! One bounce of diffuse light by splatting (`wgsl/effects/diffuse_bounce.wgsl`).

use crate::{
    effect::Effect,
    error::{Error, check_setting},
};

/// Light that surfels send on to diffuse surfaces: the radiosity of each times the form factor of its disk (Deep Screen Space 4),
/// from all surfaces, seen or not. What a surfel sends comes from the [`SurfelShader`](crate::SurfelShader) or the caller
/// ([`SplatInput::radiance`](crate::SplatInput::radiance)).
///
/// Nothing is between a surfel and a pixel: what is hidden lights what it cannot see. In rooms, where little is hidden, the
/// picture is near the truth; where things hide each other, as dominoes in a row do, it is too bright. Rays know what hides what
/// ([`RayTracedEffect::IndirectDiffuse`](crate::RayTracedEffect::IndirectDiffuse)); this one goes into one splat with other
/// effects ([`Effect::and`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiffuseBounce {
    /// Whether surfaces also light what is behind their backs, with what their backs send. Closed bodies need their front
    /// alone. Default false.
    pub two_sided: bool,
    /// The irradiance, W/m², that [`SplatSettings::epsilon`](crate::SplatSettings::epsilon) is a share of, above 0 to 1e18: about
    /// what bright surfaces of the scene send, so that quality does not change with exposure. A surfel of radiosity B is on the
    /// first level up to `r √(max(B) / (epsilon · unit) − 1)` from it, and costs nothing where it is black. Default 1.
    pub unit: f32,
}

impl Default for DiffuseBounce {
    fn default() -> Self {
        Self {
            two_sided: false,
            unit: 1.0,
        }
    }
}

impl DiffuseBounce {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.unit > 0.0 && self.unit <= 1e18,
            "DiffuseBounce::unit",
            self.unit,
            "above 0 to 1e18",
        )
    }

    /// The effect. Three channels; reads the surfels' radiance and the G-buffer's albedo, and writes outgoing radiance,
    /// W/(m² sr), to r, g and b and 1 to a.
    ///
    /// # Errors
    /// What [`DiffuseBounce::validate`] finds.
    pub fn effect(self) -> Result<Effect, Error> {
        self.validate()?;
        Ok(Effect {
            channels: 3,
            radiance: true,
            albedo: true,
            two_sided: self.two_sided,
            constants: vec![("UNIT".into(), self.unit.into())],
            ..Effect::new(
                "diffuse bounce",
                include_str!("../../wgsl/effects/diffuse_bounce.wgsl"),
            )
        })
    }
}

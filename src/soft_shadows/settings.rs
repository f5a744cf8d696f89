//! Public settings and their validation.

use crate::error::{Error, check_setting};

/// The most points that are looked up a pixel, of each kind.
const MAX_SAMPLES: u32 = 1024;

/// Settings of [`SoftShadows`](crate::SoftShadows).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoftShadowsSettings {
    /// The light's extent: the radius of a point or spot light, world units; of a directional one the tangent of its
    /// angular radius (0.0047 for the sun). 0 or more, finite; 0 gives hard shadows with one look-up a pixel. Default 0.05.
    pub extent: f32,
    /// The widest half width of a penumbra, world units, above 0, finite: blockers are looked for as far around a
    /// pixel. What would be softer is as soft as this; larger finds fine blockers less surely. Default 0.25.
    pub max_penumbra: f32,
    /// At how many points blockers are looked for, 1…1024. Default 32.
    pub blockers: u32,
    /// At how many points visibility is looked up, 1…1024: a pixel where anything is found has one of `samples + 1`
    /// values. Default 64.
    pub samples: u32,
    /// Whether each pixel's points are turned by an angle of its own: the bands that few samples make become noise, for
    /// a filter of the caller's. Sub-images are blended better without. Default false.
    pub turn: bool,
}

impl Default for SoftShadowsSettings {
    fn default() -> Self {
        Self {
            extent: 0.05,
            max_penumbra: 0.25,
            blockers: 32,
            samples: 64,
            turn: false,
        }
    }
}

impl SoftShadowsSettings {
    /// Hard shadows: what [`MultiResMaskInput::shading`](crate::MultiResMaskInput::shading) takes.
    pub fn hard() -> Self {
        Self {
            extent: 0.0,
            ..Self::default()
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            (0.0..=1e18).contains(&self.extent),
            "SoftShadowsSettings::extent",
            self.extent,
            "0 to 1e18",
        )?;
        check_setting(
            self.max_penumbra > 0.0 && self.max_penumbra <= 1e18,
            "SoftShadowsSettings::max_penumbra",
            self.max_penumbra,
            "above 0, up to 1e18",
        )?;
        for (field, value) in [
            ("SoftShadowsSettings::blockers", self.blockers),
            ("SoftShadowsSettings::samples", self.samples),
        ] {
            check_setting(
                (1..=MAX_SAMPLES).contains(&value),
                field,
                value,
                "1 to 1024",
            )?;
        }
        Ok(())
    }
}

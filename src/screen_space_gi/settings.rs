//! Public settings and their validation.

use crate::error::{Error, check_setting};

/// Settings of [`ScreenSpaceGi`](crate::ScreenSpaceGi).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScreenSpaceGiSettings {
    /// How far light is gathered from, world units, above 0, up to 1e8. Default 1.
    pub radius: f32,
    /// Points in the hemisphere over a pixel, 1…16384. The error of evenly spread points falls about with their number;
    /// the cost grows with it. Default 64.
    pub samples: u32,
    /// Whether each pixel's points are turned by an angle of its own: the bands that few samples make become noise, for
    /// a filter of the caller's. Sub-images are blended better without. Default false.
    pub turn: bool,
}

impl Default for ScreenSpaceGiSettings {
    fn default() -> Self {
        Self {
            radius: 1.0,
            samples: 64,
            turn: false,
        }
    }
}

impl ScreenSpaceGiSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.radius > 0.0 && self.radius <= 1e8,
            "ScreenSpaceGiSettings::radius",
            self.radius,
            "above 0, up to 1e8",
        )?;
        check_setting(
            (1..=16384).contains(&self.samples),
            "ScreenSpaceGiSettings::samples",
            self.samples,
            "1 to 16384",
        )
    }
}

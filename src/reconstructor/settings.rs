//! Public settings and their validation.

use crate::error::{Error, check_setting};

/// Settings of the [`Reconstructor`](crate::Reconstructor).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReconstructorSettings {
    /// Half width of the filter of level l in units of 2^l pixels, 0…8. At 0 nothing is smoothed; from ½ on a pixel's
    /// mean covers a block, which together saw all surfels. Default 1.
    pub radius: f32,
    /// How far a neighbour may lie off the pixel's tangent plane to count, in half widths of the filter at the pixel's
    /// distance, above 0. Smaller keeps finer relief, and leaves more noise on it. Default 0.25.
    pub plane_distance: f32,
    /// Exponent n of the cosine c between the pixel's normal and a neighbour's, 8…1000: the neighbour counts
    /// `(1 − (1 − c) n / 8)⁸`, which is c⁸ at 8 and close to cⁿ above, and nothing from perpendicular on. Larger keeps
    /// creases and curvature sharper, and leaves more noise there. Default 8.
    pub normal_power: f32,
}

impl Default for ReconstructorSettings {
    fn default() -> Self {
        Self {
            radius: 1.0,
            plane_distance: 0.25,
            normal_power: 8.0,
        }
    }
}

impl ReconstructorSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            (0.0..=8.0).contains(&self.radius),
            "ReconstructorSettings::radius",
            self.radius,
            "0 to 8",
        )?;
        check_setting(
            self.plane_distance > 0.0 && self.plane_distance.is_finite(),
            "ReconstructorSettings::plane_distance",
            self.plane_distance,
            "above 0, finite",
        )?;
        check_setting(
            (8.0..=1000.0).contains(&self.normal_power),
            "ReconstructorSettings::normal_power",
            self.normal_power,
            "8 to 1000",
        )
    }
}

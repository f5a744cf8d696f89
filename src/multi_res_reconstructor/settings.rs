//! Public settings and their validation.

use crate::error::{Error, check_setting};

/// Settings of the [`MultiResReconstructor`](crate::MultiResReconstructor). The levels' weights are those of the mask.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MultiResReconstructorSettings {
    /// How far a pixel of a sub-image may lie off a pixel's tangent plane to count, in pixels of the sub-image at the
    /// pixel's distance, above 0. Smaller keeps finer relief where a level is coarse. Default 1.
    pub plane_distance: f32,
    /// Exponent n of the cosine c between both normals, 8…1000, as
    /// [`ReconstructorSettings::normal_power`](crate::ReconstructorSettings::normal_power). Default 8.
    pub normal_power: f32,
}

impl Default for MultiResReconstructorSettings {
    fn default() -> Self {
        Self {
            plane_distance: 1.0,
            normal_power: 8.0,
        }
    }
}

impl MultiResReconstructorSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.plane_distance > 0.0 && self.plane_distance.is_finite(),
            "MultiResReconstructorSettings::plane_distance",
            self.plane_distance,
            "above 0, finite",
        )?;
        check_setting(
            (8.0..=1000.0).contains(&self.normal_power),
            "MultiResReconstructorSettings::normal_power",
            self.normal_power,
            "8 to 1000",
        )
    }
}

//! Public settings and their validation.

use crate::error::{Error, check_setting};

/// Settings of the [`SurfelShader`](crate::SurfelShader).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfelShaderSettings {
    /// At how many points of a surfel light is looked up, 1, 2, 4, 8 or 16: the centroids of equal parts of the triangle
    /// that the surfel stands for. More average the edges of shadows that cross a surfel, where a single point is all
    /// lit or all dark and flickers when the camera moves; each costs a look-up a surfel and light. Where surfels are
    /// not placed at [`Placement::Centroid`](crate::Placement::Centroid) they have no triangles of their own, and only
    /// their centres are lit. Default 4: 0.4 of the error of one point where an edge crosses coarse surfels, at 3 times
    /// the time.
    pub samples: u32,
}

impl Default for SurfelShaderSettings {
    fn default() -> Self {
        Self { samples: 4 }
    }
}

impl SurfelShaderSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.samples.is_power_of_two() && self.samples <= 16,
            "SurfelShaderSettings::samples",
            self.samples,
            "1, 2, 4, 8 or 16",
        )
    }
}

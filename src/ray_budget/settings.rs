//! Public settings and their validation.

use crate::error::{Error, check_setting};

/// Settings of the [`RayBudget`](crate::RayBudget).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayBudgetSettings {
    /// Further rays per pixel on average, 0…255, over the pixels that are not of the sky, those towards emitters among them. They
    /// go where noise is greatest, so that most pixels have none. Default 4.
    pub rays_per_pixel: f32,
    /// The most rays that a pixel has, those that it had before among them, 0…255. As sets are whole, as many as
    /// [`BouncedSettings::rays_per_pixel`](crate::BouncedSettings::rays_per_pixel) each and those towards emitters, it is rounded
    /// down to those. Default 128.
    pub most: u32,
}

/// The most rays of one pixel: the sum of how near their hits are has to fit.
pub(crate) const MOST_RAYS: u32 = 255;

impl Default for RayBudgetSettings {
    fn default() -> Self {
        Self {
            rays_per_pixel: 4.0,
            most: 128,
        }
    }
}

impl RayBudgetSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            (0.0..=MOST_RAYS as f32).contains(&self.rays_per_pixel),
            "RayBudgetSettings::rays_per_pixel",
            self.rays_per_pixel,
            "0 to 255",
        )?;
        check_setting(
            self.most <= MOST_RAYS,
            "RayBudgetSettings::most",
            self.most,
            "0 to 255",
        )
    }
}

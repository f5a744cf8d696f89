//! What a user turns.

use crate::error::{Error, check_setting};

/// Settings of the [`HitReconstructor`](crate::HitReconstructor).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HitReconstructorSettings {
    /// Half width of the window in pixels, 0…16: `(2 radius + 1)²` pixels share their hits. 0 for each pixel's own
    /// alone. Default 3.
    pub radius: u32,
    /// How far a neighbour may lie off the pixel's tangent plane, and the pixel off the neighbour's, to count, in pixels
    /// at the pixel's distance, above 0. Smaller keeps finer relief, and leaves more noise on it. Default 2.
    pub plane_distance: f32,
    /// Exponent n of the cosine c between the pixel's normal and a neighbour's, 8…1000: the neighbour counts
    /// `(1 − (1 − c) n / 8)⁸`, which is c⁸ at 8 and close to cⁿ above. Larger keeps creases and curvature sharper, and
    /// leaves more noise there. Default 8.
    pub normal_power: f32,
    /// How far a neighbour's mean may differ from the pixel's own, in standard deviations of their difference, 0…100: at
    /// this many it counts 1/e. Keeps what the hits themselves show to differ, such as contact shadows that end within
    /// the window. Both means are noisy: a small number of directions needs a larger one here. 0 (default) for no
    /// such test.
    pub deviations: f32,
    /// Reflectance of glossy receivers seen straight on, linear RGB, 0…1 (Schlick, *An Inexpensive BRDF Model for
    /// Physically-based Rendering*, 1994); of use with [`Sampling::Glossy`](crate::Sampling::Glossy) and
    /// [`Payload::Radiance`](crate::Payload::Radiance) alone. Default 0.04, that of glass and most plastics; metals have
    /// their colour.
    pub f0: [f32; 3],
}

/// The widest window.
pub(crate) const MAX_RADIUS: u32 = 16;

impl Default for HitReconstructorSettings {
    fn default() -> Self {
        Self {
            radius: 3,
            plane_distance: 2.0,
            normal_power: 8.0,
            deviations: 0.0,
            f0: [0.04; 3],
        }
    }
}

impl HitReconstructorSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.radius <= MAX_RADIUS,
            "HitReconstructorSettings::radius",
            self.radius,
            "0 to 16",
        )?;
        check_setting(
            self.plane_distance > 0.0 && self.plane_distance.is_finite(),
            "HitReconstructorSettings::plane_distance",
            self.plane_distance,
            "above 0, finite",
        )?;
        check_setting(
            (8.0..=1000.0).contains(&self.normal_power),
            "HitReconstructorSettings::normal_power",
            self.normal_power,
            "8 to 1000",
        )?;
        check_setting(
            (0.0..=100.0).contains(&self.deviations),
            "HitReconstructorSettings::deviations",
            self.deviations,
            "0 to 100",
        )?;
        for channel in self.f0 {
            check_setting(
                (0.0..=1.0).contains(&channel),
                "HitReconstructorSettings::f0",
                channel,
                "0 to 1",
            )?;
        }
        Ok(())
    }
}

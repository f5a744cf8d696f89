//! Public settings and their validation.

use crate::{
    bounced_z_buffer::{descriptor::MAX_EMITTER_SAMPLES, settings::MAX_FRAME},
    error::{Error, check_setting},
};

/// Settings of the [`SurfelGatherer`](crate::SurfelGatherer).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelGathererSettings {
    /// Rays from each side of a surfel, 1…64. Noise falls with the root of their number, and as each pixel sees the light of
    /// many surfels, few are enough. Numbers with two nearly equal factors are stratified best: 4, 6, 9, 12, 16, 20, 25, 36, 49,
    /// 64. Default 16.
    pub rays_per_surfel: u32,
    /// How many rays of each side go to surfaces that shine of themselves, beside those, 0…16, for a gatherer
    /// [with emitters](crate::SurfelGatherer::with_emitters). What shines is then weighed by multiple importance sampling, so
    /// that the sum has no bias. Default 0.
    pub emitter_samples: u32,
    /// Whether backs gather too. Where surfaces are closed nothing sees their backs, and half of the rays can be saved: they
    /// are black then. Default true.
    pub backs: bool,
    /// The largest share of light that a surface reflects in a further bounce, whatever its albedo, 0…1. In a closed room each
    /// bounce is at most this times the one before: over frames, light that was switched off is below the share s after
    /// `ln s / ln most_albedo` frames. Default 1.
    pub most_albedo: f32,
    /// Radiance that comes from where nothing is hit, linear RGB, W/(m² sr), each 0…1e18. Default black.
    pub sky_radiance: [f32; 3],
    /// Which set of directions to take, 0…2²⁰, as [`BouncedSettings::frame`](crate::BouncedSettings::frame). Default 0.
    pub frame: u32,
}

/// The most rays from a side.
pub(crate) const MAX_RAYS_PER_SURFEL: u32 = 64;

impl Default for SurfelGathererSettings {
    fn default() -> Self {
        Self {
            rays_per_surfel: 16,
            emitter_samples: 0,
            backs: true,
            most_albedo: 1.0,
            sky_radiance: [0.0; 3],
            frame: 0,
        }
    }
}

impl SurfelGathererSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            (1..=MAX_RAYS_PER_SURFEL).contains(&self.rays_per_surfel),
            "SurfelGathererSettings::rays_per_surfel",
            self.rays_per_surfel,
            "1 to 64",
        )?;
        check_setting(
            self.emitter_samples <= MAX_EMITTER_SAMPLES,
            "SurfelGathererSettings::emitter_samples",
            self.emitter_samples,
            "0 to 16",
        )?;
        check_setting(
            (0.0..=1.0).contains(&self.most_albedo),
            "SurfelGathererSettings::most_albedo",
            self.most_albedo,
            "0 to 1",
        )?;
        for channel in self.sky_radiance {
            check_setting(
                (0.0..=1e18).contains(&channel),
                "SurfelGathererSettings::sky_radiance",
                channel,
                "0 to 1e18",
            )?;
        }
        check_setting(
            self.frame <= MAX_FRAME,
            "SurfelGathererSettings::frame",
            self.frame,
            "0 to 2^20",
        )
    }
}

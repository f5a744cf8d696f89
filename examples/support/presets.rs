//! The crate's qualities by name (`benches/error_time` draws all of the curve of error over time), for each method.

use deep_screen_space::{
    BouncedSettings, HitResolverSettings, Payload, Quality, RayBudgetSettings, RaySettings,
    SplatQuality, SurfelizerSettings,
};

/// Settings of the passes that splat.
pub type Preset = SplatQuality;

/// Settings of the passes that bounce.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BouncedPreset {
    pub surfelizer: SurfelizerSettings,
    pub bounced: BouncedSettings,
    /// For rays that are counted.
    pub further: Option<RayBudgetSettings>,
    /// For renderers that aim so many.
    pub emitter_samples: u32,
    pub reconstructor: HitResolverSettings,
}

pub const NAMES: [&str; 3] = ["fast", "balanced", "accurate"];

/// One of [`NAMES`].
pub fn quality(name: &str) -> Option<Quality> {
    let named = NAMES.iter().zip(Quality::ALL);
    named
        .into_iter()
        .find_map(|(known, quality)| (*known == name).then_some(quality))
}

/// One of [`NAMES`], for occluders nearer than `radius`.
pub fn preset(name: &str, radius: f32) -> Option<Preset> {
    Some(quality(name)?.splats(radius))
}

/// One of [`NAMES`].
pub fn rays(name: &str, payload: Payload) -> Option<RaySettings> {
    Some(quality(name)?.rays(payload))
}

/// One of [`NAMES`], for hits nearer than `radius`.
pub fn bounced_preset(name: &str, payload: Payload, radius: f32) -> Option<BouncedPreset> {
    Some(of(&rays(name, payload)?, radius))
}

/// So many rays per pixel, and the filter that suits them.
pub fn bounced(rays_per_pixel: u32, payload: Payload, radius: f32) -> BouncedPreset {
    of(&RaySettings::new(rays_per_pixel, payload), radius)
}

/// Whatever rays there are to be.
pub fn of(rays: &RaySettings, radius: f32) -> BouncedPreset {
    BouncedPreset {
        surfelizer: SurfelizerSettings {
            // Small triangles whole: hits are exact.
            density: f32::INFINITY,
            ..SurfelizerSettings::default()
        },
        bounced: rays.bounced(radius),
        further: rays.further,
        emitter_samples: rays.emitter_samples,
        reconstructor: rays.filter,
    }
}

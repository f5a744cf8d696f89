//! Three points on the curve of error over time (`benches/error_time` draws all of it), for each method.

use deep_screen_space::{
    BouncedSettings, HitResolverSettings, Payload, ReconstructorSettings, SplatSettings,
    SurfelizerSettings,
};

/// Settings of the passes that splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    pub surfelizer: SurfelizerSettings,
    pub splat: SplatSettings,
    pub reconstructor: ReconstructorSettings,
}

/// Settings of the passes that bounce.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BouncedPreset {
    pub surfelizer: SurfelizerSettings,
    pub bounced: BouncedSettings,
    pub reconstructor: HitResolverSettings,
}

pub const NAMES: [&str; 3] = ["fast", "balanced", "accurate"];

// The error follows the surfels' radius: a smaller epsilon buys little at the same radius, while pairs grow with its
// inverse. It has to fall with the radius, or fine surfels reach the noisy levels too soon.
/// One of [`NAMES`], for occluders nearer than `radius`.
pub fn preset(name: &str, radius: f32) -> Option<Preset> {
    let (radius_pixels, epsilon, levels) = match name {
        "fast" => (4.0, 0.08, 5),
        "balanced" => (2.0, 0.04, 5),
        "accurate" => (1.5, 0.02, 5),
        _ => return None,
    };
    Some(Preset {
        surfelizer: SurfelizerSettings {
            radius_pixels,
            ..SurfelizerSettings::default()
        },
        splat: SplatSettings {
            levels,
            epsilon,
            radius,
            ..SplatSettings::default()
        },
        reconstructor: ReconstructorSettings::default(),
    })
}

// Light that bounces is noisier than what it is blocked by, and its detail finer: it takes more directions. Of the surfels'
// radius hits do not depend.
/// One of [`NAMES`], for hits nearer than `radius`.
pub fn bounced_preset(name: &str, payload: Payload, radius: f32) -> Option<BouncedPreset> {
    let rays_per_pixel = match (name, payload) {
        ("fast", Payload::Occlusion) => 4,
        ("balanced", Payload::Occlusion) => 16,
        ("fast", _) => 8,
        ("balanced", _) => 40,
        ("accurate", _) => 64,
        _ => return None,
    };
    Some(bounced(rays_per_pixel, payload, radius))
}

/// So many directions, and the filter that suits them.
pub fn bounced(rays_per_pixel: u32, payload: Payload, radius: f32) -> BouncedPreset {
    BouncedPreset {
        surfelizer: SurfelizerSettings {
            // Small triangles whole: hits are exact.
            density: f32::INFINITY,
            ..SurfelizerSettings::default()
        },
        bounced: BouncedSettings {
            rays_per_pixel,
            radius,
            ..BouncedSettings::default()
        },
        reconstructor: match payload {
            Payload::Occlusion => HitResolverSettings::for_occlusion(rays_per_pixel),
            Payload::Radiance | Payload::LitRadiance => {
                HitResolverSettings::for_light(rays_per_pixel)
            }
        },
    }
}

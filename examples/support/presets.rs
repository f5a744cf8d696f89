//! Three points on the curve of error over time (benches/trade draws all of it).

use deep_screen_space::{ReconstructorSettings, SplatSettings, SurfelizerSettings};

/// Settings of all passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    pub surfelizer: SurfelizerSettings,
    pub splat: SplatSettings,
    pub reconstructor: ReconstructorSettings,
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

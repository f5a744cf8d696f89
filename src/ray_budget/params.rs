//! What the GPU reads: `Params` of `wgsl/ray_budget.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::settings::RayBudgetSettings;
use crate::{
    bounced_z_buffer::settings::BouncedSettings,
    camera::CameraParams,
    hit_resolver::{
        params::{falloff, per_hit_distance},
        settings::HitResolverSettings,
    },
    receivers::Frame,
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct RayBudgetParams {
    pub(crate) camera: CameraParams,
    pub(crate) plane_distance: f32,
    pub(crate) normal_power: f32,
    pub(crate) falloff: f32,
    pub(crate) per_hit_distance: f32,
    pub(crate) least_share: f32,
    pub(crate) sets: f32,
    pub(crate) most_sets: f32,
    pub(crate) frame: u32,
    pub(crate) f0: f32,
    pub(crate) padding: [u32; 3],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: RayBudgetParams as "Params" in ["ray_budget", "ray_budget glossy"] {
        camera, plane_distance, normal_power, falloff, per_hit_distance, least_share, sets, most_sets,
        frame, f0,
    }
);

/// Of all weights of a window, the share of a pixel's own where all are alike.
pub(crate) fn least_share(filter: &HitResolverSettings) -> f32 {
    ((2 * filter.radius + 1) as f32).powi(-2)
}

/// Luminance of the reflectance straight on.
pub(crate) fn f0(filter: &HitResolverSettings) -> f32 {
    let [r, g, b] = filter.f0;
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Sets per pixel: on average, and of one pixel at most. Of each set so many rays go to emitters.
pub(crate) fn sets(
    settings: RayBudgetSettings,
    traced: &BouncedSettings,
    emitter_samples: u32,
) -> [f32; 2] {
    let set = traced.rays_per_pixel.max(1) + emitter_samples;
    let most = (settings.most / set).saturating_sub(1);
    [settings.rays_per_pixel / set as f32, most as f32]
}

impl RayBudgetParams {
    pub fn new(
        settings: RayBudgetSettings,
        frame: &Frame<'_>,
        filter: &HitResolverSettings,
        (traced, emitter_samples): (&BouncedSettings, u32),
    ) -> Self {
        let [sets, most_sets] = sets(settings, traced, emitter_samples);
        Self {
            camera: frame.camera.params(frame.origin),
            plane_distance: filter.plane_distance,
            normal_power: filter.normal_power,
            falloff: falloff(filter),
            per_hit_distance: per_hit_distance(filter),
            least_share: least_share(filter),
            sets,
            most_sets,
            frame: traced.frame,
            f0: f0(filter),
            padding: [0; 3],
        }
    }
}

//! What the GPU reads: `Params` of `wgsl/hit_resolver.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::settings::HitResolverSettings;
use crate::{
    bounced_z_buffer::{params::grid, settings::BouncedSettings, words},
    camera::CameraParams,
    receivers::Frame,
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct HitResolverParams {
    pub(crate) camera: CameraParams,
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    pub(crate) frame: u32,
    pub(crate) words: u32,
    pub(crate) radius: u32,
    pub(crate) plane_distance: f32,
    pub(crate) normal_power: f32,
    pub(crate) variance_clamp: f32,
    pub(crate) f0: [f32; 3],
    pub(crate) near_radius: u32,
    pub(crate) falloff: f32,
    pub(crate) per_hit_distance: f32,
    pub(crate) damping: f32,
    pub(crate) spread: f32,
    pub(crate) narrowing: f32,
    pub(crate) per_frames: f32,
    pub(crate) padding: [u32; 2],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: HitResolverParams as "Params" in [
        "hit_resolver occlusion average", "hit_resolver radiance average",
        "hit_resolver occlusion glossy average", "hit_resolver radiance glossy average",
    ] {
        camera, columns, rows, frame, words, radius, plane_distance, normal_power, variance_clamp,
        f0, near_radius, falloff, per_hit_distance, damping, spread, narrowing, per_frames,
    }
);

/// Stands for infinity: such planes have no slope, and its square is finite in f32.
const FLAT: f32 = 1e9;

/// More than any exponent needs, and finite times whatever it meets.
const STEEP: f32 = 1e9;

/// Of the square of a neighbour's distance in pixels.
pub(crate) fn falloff(settings: &HitResolverSettings) -> f32 {
    (0.5 / settings.spread.powi(2)).min(STEEP)
}

/// Over the mean distance of hits.
pub(crate) fn per_hit_distance(settings: &HitResolverSettings) -> f32 {
    settings.hit_distances.recip().min(STEEP)
}

/// Unit of the plane's coordinates in pixels. Of less than half a pixel nothing is in sight but the pixel itself.
pub(crate) fn plane_unit(settings: &HitResolverSettings) -> f32 {
    settings.spread.clamp(0.5, settings.radius.max(1) as f32)
}

/// Half width of the window over which distances of hits are averaged: the fewer directions, the less one pixel knows.
pub(crate) fn near_radius(rays_per_pixel: u32) -> u32 {
    match rays_per_pixel {
        0 | 1 => 4,
        2 | 3 => 3,
        _ => 2,
    }
}

impl HitResolverParams {
    pub fn new(
        settings: &HitResolverSettings,
        frame: &Frame<'_>,
        bounced: &BouncedSettings,
    ) -> Self {
        let [columns, rows] = grid(bounced.rays_per_pixel);
        Self {
            camera: frame.camera.params(frame.origin),
            columns,
            rows,
            frame: bounced.frame,
            words: words(bounced.rays_per_pixel),
            radius: settings.radius,
            plane_distance: settings.plane_distance,
            normal_power: settings.normal_power,
            variance_clamp: settings.variance_clamp,
            f0: settings.f0,
            near_radius: near_radius(bounced.rays_per_pixel),
            falloff: falloff(settings),
            per_hit_distance: per_hit_distance(settings),
            damping: settings.damping.min(FLAT),
            spread: plane_unit(settings),
            narrowing: settings.narrowing,
            per_frames: settings.frames.recip(),
            padding: [0; 2],
        }
    }
}

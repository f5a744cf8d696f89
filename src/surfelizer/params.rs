//! What the GPU reads: `Params` of `wgsl/surfelizer.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::settings::SurfelizerSettings;
use crate::{
    camera::{Camera, CameraParams},
    surfel::CloudCapacity,
};

/// Views that one cloud can be culled by.
pub(crate) const MAX_VIEWS: usize = 4;

/// Stands for infinity: WGSL lets a compiler assume that floats are finite. Its products with scene scales up to
/// 1e15 are finite too.
const UNBOUNDED: f32 = 1e18;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SurfelizerParams {
    pub(crate) camera: CameraParams,
    pub(crate) planes: [[f32; 4]; 6 * MAX_VIEWS],
    pub(crate) view_count: u32,
    pub(crate) triangle_count: u32,
    pub(crate) piece_capacity: u32,
    pub(crate) surfel_capacity: u32,
    pub(crate) radius_pixels: f32,
    pub(crate) density: f32,
    pub(crate) reach_radii: f32,
    pub(crate) reach_world: f32,
    pub(crate) origin_high: [f32; 3],
    pub(crate) placement: u32,
    pub(crate) origin_low: [f32; 3],
    pub(crate) without_vertices: u32,
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: SurfelizerParams as "Params" in ["surfelizer"] {
        camera, planes, view_count, triangle_count, piece_capacity, surfel_capacity,
        radius_pixels, density, reach_radii, reach_world, origin_high, placement, origin_low,
        without_vertices,
    }
);

impl SurfelizerParams {
    pub fn new(
        settings: &SurfelizerSettings,
        camera: &Camera,
        views: &[Camera],
        capacity: CloudCapacity,
        without_vertices: u32,
    ) -> Self {
        let origin = camera.focus();
        let mut planes = [[0.0; 4]; 6 * MAX_VIEWS];
        let all = views.iter().flat_map(|view| view.frustum(origin));
        for (to, plane) in planes.iter_mut().zip(all) {
            *to = plane.as_vec4().to_array();
        }
        let high = origin.as_vec3();
        Self {
            camera: camera.params(origin),
            planes,
            view_count: views.len() as u32,
            triangle_count: capacity.triangles,
            piece_capacity: capacity.pieces,
            surfel_capacity: capacity.surfels,
            radius_pixels: settings.radius_pixels,
            density: settings.density.min(UNBOUNDED),
            reach_radii: settings.reach.radii.min(UNBOUNDED),
            reach_world: settings.reach.world.min(UNBOUNDED),
            origin_high: high.to_array(),
            placement: settings.placement.code(),
            origin_low: (origin - high.as_dvec3()).as_vec3().to_array(),
            without_vertices,
        }
    }
}

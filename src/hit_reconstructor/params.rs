//! What the GPU reads: `Params` of `wgsl/hit_reconstructor.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::settings::HitReconstructorSettings;
use crate::{
    bounced_z_buffer::{params::grid, settings::BouncedSettings, words},
    camera::{Camera, CameraParams},
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct HitReconstructorParams {
    pub(crate) camera: CameraParams,
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    pub(crate) frame: u32,
    pub(crate) words: u32,
    pub(crate) radius: u32,
    pub(crate) plane_distance: f32,
    pub(crate) normal_power: f32,
    pub(crate) deviations: f32,
    pub(crate) f0: [f32; 3],
    pub(crate) padding: u32,
}

impl HitReconstructorParams {
    pub fn new(
        settings: &HitReconstructorSettings,
        bounced: &BouncedSettings,
        camera: &Camera,
        origin: DVec3,
    ) -> Self {
        let [columns, rows] = grid(bounced.directions);
        Self {
            camera: camera.params(origin),
            columns,
            rows,
            frame: bounced.frame,
            words: words(bounced.directions),
            radius: settings.radius,
            plane_distance: settings.plane_distance,
            normal_power: settings.normal_power,
            deviations: settings.deviations,
            f0: settings.f0,
            padding: 0,
        }
    }
}

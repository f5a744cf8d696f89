//! What the GPU reads: `Params` of `wgsl/reconstructor.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::settings::ReconstructorSettings;
use crate::camera::{Camera, CameraParams};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ReconstructorParams {
    pub(crate) camera: CameraParams,
    pub(crate) levels: u32,
    pub(crate) radius: f32,
    pub(crate) plane_distance: f32,
    pub(crate) normal_power: f32,
}

impl ReconstructorParams {
    pub fn new(
        settings: &ReconstructorSettings,
        camera: &Camera,
        origin: DVec3,
        levels: u32,
    ) -> Self {
        Self {
            camera: camera.params(origin),
            levels,
            radius: settings.radius,
            plane_distance: settings.plane_distance,
            normal_power: settings.normal_power,
        }
    }
}

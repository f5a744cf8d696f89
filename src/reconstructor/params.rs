//! What the GPU reads: `Params` of `wgsl/reconstructor.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::settings::ReconstructorSettings;
use crate::{camera::CameraParams, receivers::Frame, shell_splatter::Splatted, work::level_size};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ReconstructorParams {
    pub(crate) camera: CameraParams,
    pub(crate) levels: u32,
    pub(crate) radius: f32,
    pub(crate) plane_distance: f32,
    pub(crate) normal_power: f32,
    pub(crate) viewport: [u32; 4],
    pub(crate) sub_image: u32,
    pub(crate) padding: [u32; 3],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: ReconstructorParams as "Params" in [
        "reconstructor smooth", "reconstructor",
    ]
    { camera, levels, radius, plane_distance, normal_power, viewport, sub_image }
);

impl ReconstructorParams {
    pub fn new(settings: &ReconstructorSettings, frame: &Frame<'_>, splatted: &Splatted) -> Self {
        let &Splatted {
            levels, sub_image, ..
        } = splatted;
        let full = frame.camera.params(frame.origin);
        let [_, _, width, height] = full.viewport;
        let part = |level| full.of_sub_image(level_size([width, height], level), level);
        Self {
            camera: sub_image.map_or(full, part),
            levels,
            radius: settings.radius,
            plane_distance: settings.plane_distance,
            normal_power: settings.normal_power,
            viewport: full.viewport,
            sub_image: sub_image.unwrap_or(0),
            padding: [0; 3],
        }
    }
}

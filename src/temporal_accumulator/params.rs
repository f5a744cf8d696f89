//! What the GPU reads: `Params` of `wgsl/temporal_accumulator.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec3};

use super::settings::TemporalSettings;
use crate::{
    camera::{Camera, CameraParams},
    receivers::Frame,
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct TemporalParams {
    pub(crate) previous: CameraParams,
    pub(crate) project: [[f32; 4]; 4],
    pub(crate) viewport: [u32; 4],
    pub(crate) motion_scale: [f32; 2],
    pub(crate) max_frames: f32,
    pub(crate) depth_tolerance: f32,
    pub(crate) normal_tolerance: f32,
    pub(crate) clip_deviations: f32,
    pub(crate) still: u32,
    pub(crate) forget: u32,
    pub(crate) previous_origin: [f32; 3],
    pub(crate) padding: u32,
    pub(crate) picture_corner: [u32; 2],
    pub(crate) padding1: [u32; 2],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: TemporalParams as "Params" in [
        "temporal_accumulator", "temporal_accumulator show",
    ] {
        previous, project, viewport, motion_scale, max_frames, depth_tolerance, normal_tolerance,
        clip_deviations, still, forget, previous_origin, picture_corner,
    }
);

impl TemporalParams {
    /// With the previous camera comes the origin of its frame, from its focus. `motion_scale` takes a motion vector to a share of
    /// the viewport; `forget` drops the history.
    pub fn new(
        settings: &TemporalSettings,
        frame: &Frame<'_>,
        (previous, previous_origin): (&Camera, DVec3),
        motion_scale: [f32; 2],
        forget: bool,
    ) -> Self {
        let camera = &frame.camera;
        let previous_origin = previous.focus() + previous_origin;
        let viewport = camera.viewport();
        let size = [f64::from(viewport.width), f64::from(viewport.height)];
        let project = DMat4::from_scale(DVec3::new(0.5 * size[0], -0.5 * size[1], 1.0))
            * previous.clip_matrix(previous_origin);
        Self {
            previous: previous.params(previous_origin),
            project: project.as_mat4().to_cols_array_2d(),
            viewport: [viewport.x, viewport.y, viewport.width, viewport.height],
            motion_scale: [0, 1].map(|i| (f64::from(motion_scale[i]) * size[i]) as f32),
            max_frames: settings.max_frames as f32,
            depth_tolerance: settings.depth_tolerance,
            normal_tolerance: settings.normal_tolerance,
            clip_deviations: if settings.clamping > 0.0 {
                (1.0 / settings.clamping).min(1e18)
            } else {
                0.0
            },
            still: u32::from(camera == previous),
            // A frame alone needs no history.
            forget: u32::from(forget || settings.max_frames == 1),
            previous_origin: (previous_origin - frame.origin).as_vec3().to_array(),
            padding: 0,
            picture_corner: [viewport.x, viewport.y],
            padding1: [0; 2],
        }
    }
}

//! What the GPU reads: `Params` of `wgsl/screen_space_gi.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::{ScreenSpaceGiInput, settings::ScreenSpaceGiSettings};
use crate::receivers::ReceiversParams;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct ScreenSpaceGiParams {
    pub(crate) gbuffer: ReceiversParams,
    pub(crate) project: [[f32; 4]; 4],
    pub(crate) level: u32,
    pub(crate) samples: u32,
    pub(crate) turn: u32,
    pub(crate) radius: f32,
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: ScreenSpaceGiParams as "Params" in [
        "screen_space_gi", "screen_space_gi list",
    ] {
        gbuffer.camera, gbuffer.normals, gbuffer.depth_step, gbuffer.depth_relative, project,
        level, samples, turn, radius,
    }
);

impl ScreenSpaceGiParams {
    pub fn new(
        input: &ScreenSpaceGiInput<'_>,
        settings: &ScreenSpaceGiSettings,
        level: u32,
    ) -> Self {
        let camera = input.camera;
        let project = camera.clip_matrix(camera.focus());
        Self {
            gbuffer: ReceiversParams::new(&input.gbuffer, camera, camera.focus()),
            project: project.as_mat4().to_cols_array_2d(),
            level,
            samples: settings.samples,
            turn: u32::from(settings.turn),
            radius: settings.radius,
        }
    }
}

//! What the GPU reads: `Params` of `wgsl/soft_shadows.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::{SoftShadowsInput, settings::SoftShadowsSettings};
use crate::{light::LightParams, receivers::ReceiversParams};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SoftShadowsParams {
    pub(crate) gbuffer: ReceiversParams,
    pub(crate) light: LightParams,
    pub(crate) level: u32,
    pub(crate) blockers: u32,
    pub(crate) samples: u32,
    pub(crate) turn: u32,
    pub(crate) extent: f32,
    pub(crate) max_penumbra: f32,
    pub(crate) padding: [u32; 2],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: SoftShadowsParams as "Params" in ["soft_shadows", "soft_shadows list"] {
        gbuffer.camera, gbuffer.normals, gbuffer.depth_step, gbuffer.depth_relative, light, level,
        blockers, samples, turn, extent, max_penumbra,
    }
);

impl SoftShadowsParams {
    pub fn new(input: &SoftShadowsInput<'_>, settings: &SoftShadowsSettings, level: u32) -> Self {
        let focus = input.camera.focus();
        Self {
            gbuffer: ReceiversParams::new(&input.gbuffer, input.camera, focus),
            light: LightParams::new(input.light, focus),
            level,
            blockers: settings.blockers,
            samples: settings.samples,
            turn: u32::from(settings.turn),
            extent: settings.extent,
            max_penumbra: settings.max_penumbra,
            padding: [0; 2],
        }
    }
}

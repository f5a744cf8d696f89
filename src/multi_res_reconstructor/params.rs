//! What the GPU reads: `Params` of `wgsl/multi_res_reconstructor.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::{MultiResReconstructorInput, settings::MultiResReconstructorSettings};
use crate::{multi_res_mask::settings::MultiResMaskSettings, receivers::ReceiversParams};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct MultiResReconstructorParams {
    pub(crate) gbuffer: ReceiversParams,
    pub(crate) level: u32,
    pub(crate) coarser: u32,
    pub(crate) weight: f32,
    pub(crate) plane_distance: f32,
    pub(crate) normal_power: f32,
    pub(crate) has_own: u32,
    pub(crate) whole_from: f32,
    pub(crate) padding: u32,
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: MultiResReconstructorParams as "Params" in [
        "multi_res_reconstructor", "multi_res_reconstructor blend",
    ] {
        gbuffer.camera, gbuffer.normals, gbuffer.depth_step, gbuffer.depth_relative, level,
        coarser, weight, plane_distance, normal_power, has_own, whole_from,
    }
);

/// A bit for each level whose pixels about one are on its surface where the next finer level has nothing listed there: its
/// blur reaches as far as they lie, and no edge was left out of it.
pub(crate) fn alike(mask: &MultiResMaskSettings, has_importance: bool) -> u32 {
    let present: Vec<_> = mask.present().collect();
    present
        .windows(2)
        .filter(|pair| {
            let (finer, own) = (pair[0].0, pair[0].1);
            let reaches = own.radius() << finer >= 1 << pair[1].0;
            reaches && own.threshold == 0.0 && !has_importance
        })
        .map(|pair| 1 << pair[1].0)
        .sum()
}

impl MultiResReconstructorParams {
    /// Of a level and the next coarser one.
    pub fn new(
        input: &MultiResReconstructorInput<'_>,
        mask: &MultiResMaskSettings,
        settings: MultiResReconstructorSettings,
        [level, coarser]: [u32; 2],
    ) -> Self {
        let own = mask.levels[level as usize];
        Self {
            gbuffer: ReceiversParams::new(&input.gbuffer, input.camera, input.camera.focus()),
            level,
            coarser,
            // The masks' smallest values times what stands for infinity are 1 and more.
            weight: own.map_or(0.0, |own| own.weight.min(1e30)),
            plane_distance: settings.plane_distance,
            normal_power: settings.normal_power,
            has_own: u32::from(own.is_some()),
            whole_from: mask.whole_from(level),
            padding: 0,
        }
    }
}

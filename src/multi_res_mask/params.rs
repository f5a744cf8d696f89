//! What the GPU reads: the two `Params` of `wgsl/multi_res_mask.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::{MultiResMaskInput, settings::MultiResMaskSettings};
use crate::{receivers::ReceiversParams, work::level_size};

/// Stands for infinity.
const UNBOUNDED: f32 = 1e18;

/// Of the stage that finds edges.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct EdgeParams {
    pub(crate) gbuffer: ReceiversParams,
    pub(crate) normal_threshold: f32,
    pub(crate) depth_threshold: f32,
    pub(crate) shading_threshold: f32,
    pub(crate) sources: u32,
}

impl EdgeParams {
    pub fn new(input: &MultiResMaskInput<'_>, settings: &MultiResMaskSettings) -> Self {
        // Smaller than the smallest normal number a driver may take a threshold for 0.
        let threshold = |t: f32| t.clamp(1e-30, UNBOUNDED);
        let sources = [input.shading, input.edges, input.importance];
        Self {
            gbuffer: ReceiversParams::new(&input.gbuffer, input.camera, input.camera.eye()),
            normal_threshold: threshold(settings.normal_threshold),
            depth_threshold: threshold(settings.depth_threshold),
            shading_threshold: threshold(settings.shading_threshold),
            sources: (0..)
                .zip(sources)
                .map(|(bit, source)| u32::from(source.is_some()) << bit)
                .sum(),
        }
    }
}

/// Of the stages that take a level at a time.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct LevelParams {
    pub(crate) size: [u32; 2],
    pub(crate) tiles: [u32; 2],
    pub(crate) finer_size: [u32; 2],
    pub(crate) finer_by: u32,
    pub(crate) radius: u32,
    pub(crate) falloff: f32,
    pub(crate) threshold: f32,
    pub(crate) everything: u32,
    pub(crate) first_tile: u32,
}

/// Of every level that there is, from the finest on, with its number; `size` is the image's.
pub(crate) fn levels(size: [u32; 2], settings: &MultiResMaskSettings) -> Vec<(u32, LevelParams)> {
    let mut first_tile = 0;
    let mut finer = None;
    let mut all = Vec::new();
    for (level, own) in settings.present() {
        let own_size = level_size(size, level);
        let tiles = own_size.map(|n| n.div_ceil(8));
        let params = LevelParams {
            size: own_size,
            tiles,
            finer_size: level_size(size, finer.unwrap_or(level)),
            finer_by: level - finer.unwrap_or(level),
            radius: own.radius(),
            falloff: 0.5 / own.variance.max(1e-6),
            threshold: own.threshold,
            everything: u32::from(level == settings.coarsest()),
            first_tile,
        };
        first_tile += tiles[0] * tiles[1];
        finer = Some(level);
        all.push((level, params));
    }
    all
}

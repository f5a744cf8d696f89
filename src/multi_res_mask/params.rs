//! What the GPU reads: the two `Params` of `wgsl/multi_res_mask.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::{
    MultiResMaskInput,
    settings::{MAX_RADIUS, MultiResLevel, MultiResMaskSettings},
};
use crate::{
    receivers::ReceiversParams,
    work::{LEVELS, level_size},
};

/// Stands for infinity.
const UNBOUNDED: f32 = 1e18;

/// Of the stage that finds edges.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct EdgeParams {
    pub(crate) gbuffer: ReceiversParams,
    pub(crate) scale: [f32; 4],
    pub(crate) slope: f32,
    pub(crate) normal_threshold: f32,
    pub(crate) depth_threshold: f32,
    pub(crate) shading_threshold: f32,
    pub(crate) sources: u32,
    pub(crate) padding: [u32; 3],
}

crate::reflection::same_as_wgsl!(
    edge_params_are_the_shaders: EdgeParams as "Params" in ["multi_res_mask edges"] {
        gbuffer.camera, gbuffer.normals, gbuffer.depth_step, gbuffer.depth_relative, scale, slope,
        normal_threshold, depth_threshold, shading_threshold, sources,
    }
);

impl EdgeParams {
    pub fn new(input: &MultiResMaskInput<'_>, settings: &MultiResMaskSettings) -> Self {
        // Smaller than the smallest normal number a driver may take a threshold for 0.
        let threshold = |t: f32| t.clamp(1e-30, UNBOUNDED);
        let sources = [input.edges, input.importance];
        let gbuffer = ReceiversParams::new(&input.gbuffer, input.camera, input.camera.focus());
        let camera = gbuffer.camera;
        let (scale, slope) = if input.camera.is_perspective() {
            // A point's homogeneous coordinates end in it.
            let w = camera.unproject.map(|column| column[3]);
            ([w[0], w[1], w[3], w[2]], w[2].abs())
        } else {
            let [x, y, z, _] = camera.unproject[2];
            let extent = camera.pixel * camera.viewport[3] as f32;
            ([0.0, 0.0, extent, 0.0], x.hypot(y).hypot(z))
        };
        Self {
            gbuffer,
            scale,
            slope,
            normal_threshold: threshold(settings.normal_threshold),
            depth_threshold: threshold(settings.depth_threshold),
            shading_threshold: threshold(settings.shading_threshold),
            sources: (0..)
                .zip(sources)
                .map(|(bit, source)| u32::from(source.is_some()) << bit)
                .sum(),
            padding: [0; 3],
        }
    }
}

/// Blocks of 2 × 2 pixels that a blur reaches to each side, and the block itself.
const BLOCKS: usize = MAX_RADIUS as usize / 2 + 1;

/// Of the stages that take a level at a time.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct LevelParams {
    pub(crate) size: [u32; 2],
    pub(crate) tiles: [u32; 2],
    pub(crate) first_count: u32,
    pub(crate) finer_by: u32,
    pub(crate) reach: u32,
    pub(crate) threshold: f32,
    pub(crate) whole_from: f32,
    pub(crate) padding: [u32; 3],
    pub(crate) bell: [[f32; 4]; BLOCKS],
}

crate::reflection::same_as_wgsl!(
    level_params_are_the_shaders: LevelParams as "Params" in [
        "multi_res_mask widen", "multi_res_mask list",
    ]
    { size, tiles, first_count, finer_by, reach, threshold, whole_from, bell }
);

/// Of every level that there is, from the finest on, with its number; `size` is the image's.
pub(crate) fn levels(size: [u32; 2], settings: &MultiResMaskSettings) -> Vec<(u32, LevelParams)> {
    let mut first_count = 0;
    let mut finer = None;
    let mut all = Vec::new();
    for (level, own) in settings.present() {
        let own_size = level_size(size, level);
        let tiles = own_size.map(|n| n.div_ceil(8));
        let params = LevelParams {
            size: own_size,
            tiles,
            first_count,
            finer_by: level - finer.unwrap_or(level),
            reach: own.radius().div_ceil(2),
            threshold: own.threshold,
            whole_from: settings.whole_from(level),
            padding: [0; 3],
            bell: bell(own),
        };
        first_count += 2 * tiles[0] * tiles[1];
        finer = Some(level);
        all.push((level, params));
    }
    all
}

/// A level's blur along an axis, as the shader has it for blocks.
fn bell(level: MultiResLevel) -> [[f32; 4]; BLOCKS] {
    let radius = level.radius();
    let falloff = 0.5 / level.variance.max(1e-6);
    let bell = |offset: u32| {
        let value = (-((offset * offset) as f32) * falloff).exp();
        if offset > radius { 0.0 } else { value }
    };
    let total = bell(0) + 2.0 * (1..=radius).map(bell).sum::<f32>();
    let mut blocks = [[0.0; 4]; BLOCKS];
    for (offset, block) in (0..).zip(&mut blocks) {
        let pixels: u32 = 2 * offset;
        *block = [
            bell(pixels) / total,
            bell(pixels + 1) / total,
            bell(pixels.abs_diff(1)) / total,
            0.0,
        ];
    }
    blocks
}

/// Counts of all levels that there can be: two per tile of 8 × 8 pixels.
pub(crate) fn all_counts(size: [u32; 2]) -> u32 {
    (0..LEVELS)
        .map(|level| {
            let [columns, rows] = level_size(size, level).map(|n| n.div_ceil(8));
            2 * columns * rows
        })
        .sum()
}

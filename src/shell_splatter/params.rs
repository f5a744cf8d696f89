//! What the GPU reads: `Params` of `wgsl/shell_splatter.wgsl`, one per level, and how clusters are laid out.

use bytemuck::{Pod, Zeroable};

use super::settings::{MIN_EPSILON, SplatSettings};
use crate::{camera::CameraParams, receivers::Frame};

/// Surfels of a cluster, and clusters of a group.
pub(crate) const CLUSTER: u32 = 16;
pub(crate) const GROUP: u32 = 64;

/// Pixels of a sub-buffer that one workgroup serves.
pub(crate) const TILE: [u32; 2] = [32, 16];

/// Stands for infinity; its square is finite in f32.
pub(crate) const UNBOUNDED: f32 = 1e18;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SplatParams {
    pub(crate) size: [u32; 2],
    pub(crate) sub_size: [u32; 2],
    pub(crate) tiles: [u32; 2],
    pub(crate) level: u32,
    pub(crate) unbounded: u32,
    pub(crate) epsilon: f32,
    pub(crate) world_radius: f32,
    pub(crate) seed: u32,
    pub(crate) clusters: u32,
    pub(crate) first_cluster: u32,
    pub(crate) groups: u32,
    pub(crate) first_group: u32,
    pub(crate) padding: u32,
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: SplatParams as "Params" in [
        "shell_splatter build", "shell_splatter splat",
    ] {
        size, sub_size, tiles, level, unbounded, epsilon, world_radius, seed, clusters,
        first_cluster, groups, first_group,
    }
);

impl SplatParams {
    pub fn new(settings: &SplatSettings, level: u32, size: [u32; 2], place: LevelPlace) -> Self {
        let sub_size = size.map(|n| n.div_ceil(1 << level));
        Self {
            size,
            sub_size,
            tiles: [sub_size[0].div_ceil(TILE[0]), sub_size[1].div_ceil(TILE[1])],
            level,
            unbounded: u32::from(settings.unbounded && level + 1 == settings.levels),
            epsilon: settings.epsilon.clamp(MIN_EPSILON, UNBOUNDED),
            world_radius: settings.radius.min(UNBOUNDED),
            seed: settings.seed,
            clusters: place.clusters,
            first_cluster: place.first_cluster,
            groups: place.groups,
            first_group: place.first_group,
            padding: 0,
        }
    }

    /// Workgroups of the splat kernel.
    pub fn tiles_of_all_sub_buffers(&self) -> u32 {
        (self.tiles[0] * self.tiles[1]) << (2 * self.level)
    }
}

/// `View` of the shader: where pixels are seen from, for effects that ask.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ViewParams {
    pub(crate) camera: CameraParams,
    pub(crate) sub_image: u32,
    pub(crate) padding: [u32; 3],
}

crate::reflection::same_as_wgsl!(
    views_are_the_shaders: ViewParams as "View" in ["shell_splatter build", "shell_splatter splat"]
    { camera, sub_image }
);

impl ViewParams {
    pub fn new(frame: &Frame<'_>, sub_image: u32) -> Self {
        Self {
            camera: frame.camera.params(frame.origin),
            sub_image,
            padding: [0; 3],
        }
    }
}

/// Where a level's clusters and groups stand in the buffer: room for the cloud's capacity, sub-buffer by sub-buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LevelPlace {
    pub clusters: u32,
    pub first_cluster: u32,
    pub groups: u32,
    pub first_group: u32,
}

/// The places of all levels, and how many clusters and groups there are in all.
pub(crate) fn place_levels(capacity: u32, levels: u32) -> (Vec<LevelPlace>, u64) {
    let mut next = 0_u64;
    let mut take = |count: u64| {
        let first = next;
        next += count;
        first as u32
    };
    let places = (0..levels)
        .map(|level| {
            let sub_buffers = 1_u64 << (2 * level);
            let clusters = capacity.div_ceil(1 << (2 * level)).div_ceil(CLUSTER);
            let groups = clusters.div_ceil(GROUP);
            LevelPlace {
                clusters,
                first_cluster: take(sub_buffers * u64::from(clusters)),
                groups,
                first_group: take(sub_buffers * u64::from(groups)),
            }
        })
        .collect();
    (places, next)
}

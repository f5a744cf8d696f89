//! Bounds over a cloud's surfels as disks, for rays to skip (`wgsl/disk_bounds.wgsl`, `wgsl/common/disk_walk.wgsl`).

use bytemuck::{Pod, Zeroable};
use wgpu::{
    BindGroupLayout, CommandEncoder, ComputePipeline, Device, PipelineCache, ShaderStages,
    TextureView,
};

use crate::{
    bounced_z_buffer::settings::{DiskSettings, MAX_LEVELS},
    error::Error,
    gpu::{
        Kernel, Timestamps, WORKGROUP,
        binding::{self, READ, UNIFORM, WRITE, whole},
        compute_pass, dispatch, shader, uniform,
    },
    sender_bounds::{VectorArray, depth_offset, nodes_at, top_of},
    shaders::Listing,
    surfel::SurfelCloud,
};

const SOURCE: &str = include_str!("../../wgsl/disk_bounds.wgsl");

const LABEL: &str = "deep-screen-space disk bounds";

/// Vectors that a node has, as in the shader.
const NODE_TEXELS: u64 = 7;

/// Stands for infinity, as in the shader.
const FAR: f32 = 1e18;

/// A tree over the surfels of each sub-buffer of each level.
#[derive(Debug)]
pub(crate) struct DiskBounds {
    /// What is built, and the texture that gets a copy of it, as in [`crate::SenderBounds`].
    built: VectorArray,
    pub nodes: TextureView,
    levels: Vec<LevelTrees>,
    pub capacity: u32,
}

/// The trees of one level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct LevelTrees {
    /// Where their nodes begin.
    first: u32,
    /// Surfels that each has room for.
    room: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct DiskBoundsParams {
    pub(crate) level: u32,
    pub(crate) depth: u32,
    pub(crate) capacity: u32,
    pub(crate) level_first: u32,
}

/// What rays among disks read: `DiskParams` of `wgsl/common/disk_walk.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct DiskParams {
    pub(crate) levels: u32,
    pub(crate) merge: u32,
    pub(crate) seed: u32,
    pub(crate) capacity: u32,
    pub(crate) level_first: [u32; MAX_LEVELS as usize],
    pub(crate) shell_radii: f32,
    pub(crate) padding: [u32; 3],
}

impl DiskBounds {
    pub fn new(device: &Device, cloud: &SurfelCloud, levels: u32) -> Result<Self, Error> {
        let capacity = cloud.capacity.surfels;
        let (levels, nodes) = place_levels(capacity, levels);
        let built = VectorArray::new(device, "deep-screen-space disk bounds", NODE_TEXELS * nodes)?;
        Ok(Self {
            nodes: built.view(),
            built,
            levels,
            capacity,
        })
    }

    pub fn levels(&self) -> u32 {
        self.levels.len() as u32
    }

    pub fn memory_bytes(&self) -> u64 {
        2 * self.built.bytes()
    }

    pub fn params(&self, settings: &DiskSettings) -> DiskParams {
        let mut level_first = [0; MAX_LEVELS as usize];
        for (first, level) in level_first.iter_mut().zip(&self.levels) {
            *first = level.first;
        }
        DiskParams {
            levels: self.levels(),
            merge: settings.merge.code(),
            seed: settings.seed,
            capacity: self.capacity,
            level_first,
            shell_radii: settings.shell_radii.min(FAR),
            padding: [0; 3],
        }
    }
}

/// Nodes of a tree with room for so many surfels: all but those of depth 0.
fn nodes_each(room: u32) -> u32 {
    depth_offset(room, top_of(room) + 1) - depth_offset(room, 1)
}

/// The levels' trees one after the other, and how many nodes they have in all.
fn place_levels(capacity: u32, levels: u32) -> (Vec<LevelTrees>, u64) {
    let mut next = 0_u64;
    let trees = (0..levels)
        .map(|level| {
            let room = capacity.div_ceil(1 << (2 * level));
            let first = next as u32;
            next += u64::from(nodes_each(room)) << (2 * level);
            LevelTrees { first, room }
        })
        .collect();
    (trees, next)
}

/// The pipelines.
#[derive(Debug)]
pub(crate) struct DiskBoundsPass {
    layout: BindGroupLayout,
    build_first: ComputePipeline,
    build_next: ComputePipeline,
}

/// The module.
fn source() -> Result<String, Error> {
    shader::assemble("disk_bounds", SOURCE, &["SENDER_DISKS"], &[])
}

impl DiskBoundsPass {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let layout = binding::layout(
            device,
            LABEL,
            ShaderStages::COMPUTE,
            &[(0, UNIFORM), (1, READ), (2, READ), (3, READ), (4, WRITE)],
        );
        let module = shader::create(device, LABEL, source()?);
        let kernel = |entry| {
            Kernel {
                label: &format!("{LABEL}: {entry}"),
                module: &module,
                entry,
                layouts: &[&layout],
                constants: &[],
                cache,
            }
            .create(device)
        };
        Ok(Self {
            build_first: kernel("build_first"),
            build_next: kernel("build_next"),
            layout,
        })
    }

    /// Records into a pass of its own.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        cloud: &SurfelCloud,
        bounds: &DiskBounds,
        timestamps: Option<Timestamps<'_>>,
    ) {
        let mut pass = compute_pass(encoder, LABEL, timestamps);
        for (level, trees) in (0..).zip(&bounds.levels) {
            for depth in 1..=top_of(trees.room) {
                let params = DiskBoundsParams {
                    level,
                    depth,
                    capacity: bounds.capacity,
                    level_first: trees.first,
                };
                let params = uniform(device, LABEL, &params);
                let group = binding::group(
                    device,
                    LABEL,
                    &self.layout,
                    &[
                        (0, whole(&params)),
                        (1, whole(&cloud.counters)),
                        (2, whole(&cloud.surfels)),
                        (3, whole(&cloud.sources)),
                        (4, whole(bounds.built.buffer())),
                    ],
                );
                let pipeline = if depth == 1 {
                    &self.build_first
                } else {
                    &self.build_next
                };
                // As many threads as there is room for: how many surfels there are only the GPU knows.
                let threads = nodes_at(trees.room, depth) << (2 * level);
                dispatch(&mut pass, pipeline, &group, threads.div_ceil(WORKGROUP));
            }
        }
        drop(pass);
        bounds.built.copy(encoder);
    }
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add("disk_bounds", source()?);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodes of a tree stay within its room at every depth, whatever the count.
    #[test]
    fn trees_do_not_overlap() {
        for capacity in [0, 1, 4, 5, 16, 17, 63, 64, 65, 1000, 4097, 100_000, 1 << 23] {
            for levels in 1..=MAX_LEVELS {
                let (trees, nodes) = place_levels(capacity, levels);
                let inputs = format!("capacity {capacity}, {levels} levels");
                assert!(nodes < u64::from(u32::MAX), "{inputs}: {nodes} nodes");
                for (level, tree) in trees.iter().enumerate() {
                    let top = top_of(tree.room);
                    for depth in 1..=top {
                        let start = depth_offset(tree.room, depth);
                        let next = depth_offset(tree.room, depth + 1);
                        assert!(
                            start + nodes_at(tree.room, depth) <= next,
                            "{inputs}: level {level}, depth {depth}"
                        );
                    }
                    let end =
                        u64::from(tree.first) + (u64::from(nodes_each(tree.room)) << (2 * level));
                    let following = trees.get(level + 1).map_or(nodes, |t| u64::from(t.first));
                    assert_eq!(end, following, "{inputs}: level {level}");
                }
            }
        }
    }
}

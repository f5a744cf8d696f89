//! Bounds over a cloud's surfels as disks, for rays to skip (`wgsl/disk_bounds.wgsl`, `wgsl/common/disk_bvh_traverse.wgsl`).

use bytemuck::{Pod, Zeroable};
use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device, PipelineCache, Texture,
    TextureUsages, TextureView,
};

use crate::{
    effect::Listing,
    error::{Error, check_limit},
    gpu::{
        Kernel, Timestamps, WORKGROUP,
        binding::{Kept, Layout, whole},
        compute_pass, dispatch, shader, storage,
        texture::Plane,
        uniforms::{Parameters, Place, Uploaded},
    },
    surfel::SurfelCloud,
};

const SOURCE: &str = include_str!("../../wgsl/disk_bounds.wgsl");

const LABEL: &str = "deep-screen-space disk bounds";

/// Of disks.
pub(crate) const MAX_LEVELS: u32 = 8;

/// Texels of a row of the texture, and vectors that a node has, as in the shader.
const ROW: u64 = 4096;
const NODE_TEXELS: u64 = 7;

/// A tree over the surfels of each sub-buffer of each level.
#[derive(Debug)]
pub(crate) struct DiskBounds {
    /// What is built, and the texture that gets a copy of it, as in [`crate::Bvh`].
    built: VectorArray,
    pub nodes: TextureView,
    levels: Vec<LevelTrees>,
    pub capacity: u32,
    parameters: Uploaded,
    /// What is built, in order.
    depths: Vec<Depth>,
    kept: Kept,
}

/// A depth of the trees of a level.
#[derive(Debug)]
struct Depth {
    params: Place,
    number: u32,
    /// As many as there is room for: how many surfels there are only the GPU knows.
    threads: u32,
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

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: DiskBoundsParams as "Params" in ["disk_bounds"]
    { level, depth, capacity, level_first }
);

/// An array of vectors in whole rows, and the texture of the same.
#[derive(Debug)]
struct VectorArray {
    buffer: Buffer,
    texture: Texture,
}

impl VectorArray {
    pub fn new(device: &Device, label: &'static str, vectors: u64) -> Result<Self, Error> {
        let rows = vectors.div_ceil(ROW).max(1);
        check_limit(
            "max_texture_dimension_2d",
            u64::from(device.limits().max_texture_dimension_2d),
            rows.max(ROW),
            label,
        )?;
        Ok(Self {
            buffer: storage(device, label, 16 * ROW * rows, BufferUsages::COPY_SRC)?,
            texture: Plane::new(
                label,
                wgpu::TextureFormat::Rgba32Float,
                [ROW as u32, rows as u32],
                TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
            )
            .create(device),
        })
    }

    pub fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Bytes of the buffer, and of the texture.
    pub fn bytes(&self) -> u64 {
        self.buffer.size()
    }

    pub fn view(&self) -> TextureView {
        self.texture
            .create_view(&wgpu::TextureViewDescriptor::default())
    }

    pub fn copy(&self, encoder: &mut CommandEncoder) {
        encoder.copy_buffer_to_texture(
            wgpu::TexelCopyBufferInfo {
                buffer: &self.buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(16 * ROW as u32),
                    rows_per_image: None,
                },
            },
            self.texture.as_image_copy(),
            self.texture.size(),
        );
    }
}

impl DiskBounds {
    pub fn new(device: &Device, cloud: &SurfelCloud, levels: u32) -> Result<Self, Error> {
        let capacity = cloud.capacity.surfels;
        let (levels, nodes) = place_levels(capacity, levels);
        let built = VectorArray::new(device, "deep-screen-space disk bounds", NODE_TEXELS * nodes)?;
        let mut parameters = Parameters::new(device);
        let mut depths = Vec::new();
        for (level, trees) in (0..).zip(&levels) {
            for depth in 1..=top_of(trees.room) {
                depths.push(Depth {
                    params: parameters.add(&DiskBoundsParams {
                        level,
                        depth,
                        capacity,
                        level_first: trees.first,
                    }),
                    number: depth,
                    threads: nodes_at(trees.room, depth) << (2 * level),
                });
            }
        }
        Ok(Self {
            nodes: built.view(),
            built,
            levels,
            capacity,
            parameters: parameters.fixed(device, LABEL),
            depths,
            kept: Kept::default(),
        })
    }

    pub fn levels(&self) -> u32 {
        self.levels.len() as u32
    }

    pub fn memory_bytes(&self) -> u64 {
        2 * self.built.bytes()
    }

    /// Where the nodes of each level begin.
    pub fn level_first(&self) -> impl Iterator<Item = u32> {
        self.levels.iter().map(|level| level.first)
    }
}

/// The depth with a single node: `top_of` of the shader.
pub(crate) fn top_of(count: u32) -> u32 {
    let bits = 32 - (count.max(1) - 1).leading_zeros();
    bits.div_ceil(2).max(1) - 1
}

/// Nodes at a depth: `nodes_at` of the shader.
pub(crate) fn nodes_at(count: u32, depth: u32) -> u32 {
    count.div_ceil(1 << (2 * depth + 2))
}

/// Where a depth's nodes begin: `depth_offset` of the shader.
pub(crate) fn depth_offset(capacity: u32, depth: u32) -> u32 {
    let third = capacity / 3 + 1;
    third - (third >> (2 * depth)) + 2 * depth
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
    layout: Layout,
    build_first: ComputePipeline,
    build_next: ComputePipeline,
}

/// The module.
fn source() -> Result<String, Error> {
    shader::assemble("disk_bounds", SOURCE, &[], &[])
}

impl DiskBoundsPass {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let module = shader::create(device, LABEL, source()?);
        let layout = module.layout(device, &["build_first", "build_next"]);
        let kernel = |entry| {
            Kernel {
                label: &format!("{LABEL}: {entry}"),
                module: &module,
                entry,
                layouts: &[&layout.raw],
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
        let mut groups = bounds.kept.groups(device);
        for of in &bounds.depths {
            let resources = [
                ("params", bounds.parameters.at(of.params)),
                ("counters", whole(&cloud.counters)),
                ("surfels", whole(&cloud.surfels)),
                ("sources", whole(&cloud.sources)),
                ("nodes", whole(bounds.built.buffer())),
            ];
            let group = groups.next(&self.layout, &resources);
            let pipeline = if of.number == 1 {
                &self.build_first
            } else {
                &self.build_next
            };
            dispatch(&mut pass, pipeline, &group, of.threads.div_ceil(WORKGROUP));
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

//! Bounds over runs of a cloud's senders, for rays to skip (`wgsl/sender_bounds.wgsl`, `wgsl/common/walk.wgsl`): here
//! those of pieces, and in `src/disk_bounds` those of disks.

use bytemuck::{Pod, Zeroable};
use wgpu::{
    BindGroupLayout, BindingType, Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device,
    PipelineCache, ShaderStages, Texture, TextureUsages, TextureView,
};

use crate::{
    bounced_z_buffer::descriptor::Senders,
    disk_bounds::{DiskBounds, DiskBoundsPass},
    error::{Error, check_limit},
    gpu::{
        Kernel, Timestamps,
        binding::{self, READ, UNIFORM, WRITE, whole},
        compute_pass, dispatch, shader,
        sort::{Sort, SortBuffer},
        storage, uniform,
    },
    recorded::{Last, Stamp},
    surfel::SurfelCloud,
};

pub(crate) const SOURCE: &str = include_str!("../../wgsl/sender_bounds.wgsl");

const LABEL: &str = "deep-screen-space sender bounds";

/// Bytes of an indirect dispatch.
const DISPATCH_BYTES: u64 = 12;

/// Texels of a row of the textures; vectors a node and a leaf have, as in the shader.
const ROW: u64 = 4096;
const NODE_TEXELS: u64 = 6;
const LEAF_TEXELS: u64 = 9;

/// Bounds over runs of four senders of a cloud that lie near each other, of four such runs, and so on: what a ray skips
/// by. Made anew from each recording of the cloud; nothing of it is kept from frame to frame.
#[derive(Debug)]
pub struct SenderBounds {
    bounds: Bounds,
    /// The cloud's recording.
    recorded: Last<Stamp>,
}

/// Of either kind of senders.
#[derive(Debug)]
enum Bounds {
    Pieces(Box<PieceBounds>),
    Disks(Box<DiskBounds>),
}

/// Bounds over a cloud's pieces in an order of space.
#[derive(Debug)]
pub(crate) struct PieceBounds {
    /// What is built, in buffers that the textures then get a copy of: drivers read textures faster, and a texture
    /// cannot be read where it is written.
    built: [VectorArray; 2],
    pub nodes: TextureView,
    pub leaves: TextureView,
    pub order: SortBuffer,
    range: Buffer,
    dispatches: Buffer,
    capacity: u32,
}

/// An array of vectors in whole rows, and the texture of the same.
#[derive(Debug)]
pub(crate) struct VectorArray {
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
            texture: device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d {
                    width: ROW as u32,
                    height: rows as u32,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::Rgba32Float,
                usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
                view_formats: &[],
            }),
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

impl SenderBounds {
    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        match &self.bounds {
            Bounds::Pieces(bounds) => bounds.memory_bytes(),
            Bounds::Disks(bounds) => bounds.memory_bytes(),
        }
    }

    /// Those of a cloud's pieces. [`Error::Mismatch`] where they are of another kind or for another capacity,
    /// [`Error::Recording`] where they were not recorded from this cloud, since that was.
    pub(crate) fn pieces(&self, cloud: &SurfelCloud) -> Result<&PieceBounds, Error> {
        let bounds = self.room_for_pieces(cloud)?;
        self.check_source(cloud)?;
        Ok(bounds)
    }

    /// Those of a cloud's surfels as disks on so many levels.
    pub(crate) fn disks(&self, cloud: &SurfelCloud, levels: u32) -> Result<&DiskBounds, Error> {
        let bounds = self.room_for_disks(cloud, levels)?;
        self.check_source(cloud)?;
        Ok(bounds)
    }

    fn check_source(&self, cloud: &SurfelCloud) -> Result<(), Error> {
        cloud.last()?;
        cloud.check_source("SenderBounds", &self.recorded.get("SenderBounds")?)
    }

    fn room_for_pieces(&self, cloud: &SurfelCloud) -> Result<&PieceBounds, Error> {
        match &self.bounds {
            Bounds::Pieces(bounds) if bounds.capacity == cloud.capacity.pieces => Ok(bounds),
            _ => Err(self.mismatch(describe_pieces(cloud.capacity.pieces))),
        }
    }

    fn room_for_disks(&self, cloud: &SurfelCloud, levels: u32) -> Result<&DiskBounds, Error> {
        match &self.bounds {
            Bounds::Disks(bounds)
                if bounds.capacity == cloud.capacity.surfels && bounds.levels() == levels =>
            {
                Ok(bounds)
            }
            _ => Err(self.mismatch(describe_disks(cloud.capacity.surfels, levels))),
        }
    }

    fn mismatch(&self, needed: String) -> Error {
        Error::Mismatch {
            name: "SenderBounds",
            found: match &self.bounds {
                Bounds::Pieces(bounds) => describe_pieces(bounds.capacity),
                Bounds::Disks(bounds) => describe_disks(bounds.capacity, bounds.levels()),
            },
            needed,
        }
    }
}

fn describe_pieces(capacity: u32) -> String {
    format!("{capacity} pieces")
}

fn describe_disks(capacity: u32, levels: u32) -> String {
    format!("{capacity} disks on {levels} levels")
}

impl PieceBounds {
    fn memory_bytes(&self) -> u64 {
        let built: u64 = self.built.iter().map(VectorArray::bytes).sum();
        2 * built + self.order.bytes() + self.range.size() + self.dispatches.size()
    }
}

/// The pipelines for one kind of senders.
#[derive(Debug)]
pub(crate) enum SenderBoundsPass {
    Pieces(Box<PieceBoundsPass>),
    Disks(DiskBoundsPass, u32),
}

impl SenderBoundsPass {
    pub fn new(
        device: &Device,
        senders: Senders,
        cache: Option<&PipelineCache>,
    ) -> Result<Self, Error> {
        Ok(match senders {
            Senders::Pieces => Self::Pieces(Box::new(PieceBoundsPass::new(device, cache)?)),
            Senders::Disks { levels } => Self::Disks(DiskBoundsPass::new(device, cache)?, levels),
        })
    }

    pub fn create(&self, device: &Device, cloud: &SurfelCloud) -> Result<SenderBounds, Error> {
        let bounds = match self {
            Self::Pieces(pass) => Bounds::Pieces(Box::new(pass.create(device, cloud)?)),
            Self::Disks(_, levels) => {
                Bounds::Disks(Box::new(DiskBounds::new(device, cloud, *levels)?))
            }
        };
        Ok(SenderBounds {
            bounds,
            recorded: Last::default(),
        })
    }

    /// Records into a pass of its own.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for bounds of another kind, or of another cloud's capacity, [`Error::Recording`] for a cloud that
    /// was not recorded.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        cloud: &SurfelCloud,
        bounds: &SenderBounds,
        timestamps: Option<Timestamps<'_>>,
    ) -> Result<(), Error> {
        let of = cloud.last()?;
        let recorded = &bounds.recorded;
        match self {
            Self::Pieces(pass) => {
                let bounds = bounds.room_for_pieces(cloud)?;
                pass.record(device, encoder, cloud, bounds, timestamps);
            }
            Self::Disks(pass, levels) => {
                let bounds = bounds.room_for_disks(cloud, *levels)?;
                pass.record(device, encoder, cloud, bounds, timestamps);
            }
        }
        recorded.set(of);
        Ok(())
    }
}

/// The pipelines for pieces.
#[derive(Debug)]
pub(crate) struct PieceBoundsPass {
    plan_layout: BindGroupLayout,
    build_layout: BindGroupLayout,
    plan: ComputePipeline,
    measure: ComputePipeline,
    make_keys: ComputePipeline,
    build_first: ComputePipeline,
    build_next: ComputePipeline,
    sort: Sort,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SenderBoundsParams {
    pub(crate) depth: u32,
    pub(crate) capacity: u32,
    pub(crate) perspective: u32,
    pub(crate) padding: u32,
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

/// The modules that it is made of: for what comes before the sort, and for what comes after.
pub(crate) fn source(plan: bool) -> Result<String, Error> {
    let flags: &[&str] = if plan { &["PLAN"] } else { &[] };
    shader::assemble("sender_bounds", SOURCE, flags, &[])
}

impl PieceBoundsPass {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let shared = [(0, UNIFORM), (1, READ), (2, READ), (3, WRITE), (4, WRITE)];
        let layout = |rest: &[(u32, BindingType)]| {
            let entries = [&shared, rest].concat();
            binding::layout(device, LABEL, ShaderStages::COMPUTE, &entries)
        };
        let plan_layout = layout(&[(5, WRITE)]);
        let build_layout = layout(&[(5, READ), (6, WRITE)]);
        let plan_module = shader::create(device, LABEL, source(true)?);
        let build_module = shader::create(device, LABEL, source(false)?);
        let kernel = |module, entry, layout: &BindGroupLayout| {
            Kernel {
                label: &format!("{LABEL}: {entry}"),
                module,
                entry,
                layouts: &[layout],
                constants: &[],
                cache,
            }
            .create(device)
        };
        Ok(Self {
            plan: kernel(&plan_module, "plan", &plan_layout),
            measure: kernel(&plan_module, "measure", &plan_layout),
            make_keys: kernel(&plan_module, "make_keys", &plan_layout),
            build_first: kernel(&build_module, "build_first", &build_layout),
            build_next: kernel(&build_module, "build_next", &build_layout),
            sort: Sort::new(device, cache)?,
            plan_layout,
            build_layout,
        })
    }

    pub fn create(&self, device: &Device, cloud: &SurfelCloud) -> Result<PieceBounds, Error> {
        let capacity = cloud.capacity.pieces;
        let depths = top_of(capacity) + 1;
        let range = storage(
            device,
            "deep-screen-space range of senders",
            16,
            BufferUsages::empty(),
        )?;
        let built = [
            VectorArray::new(
                device,
                "deep-screen-space sender bounds",
                NODE_TEXELS * u64::from(depth_offset(capacity, depths)),
            )?,
            VectorArray::new(
                device,
                "deep-screen-space runs of senders",
                LEAF_TEXELS * u64::from(capacity.div_ceil(4)),
            )?,
        ];
        Ok(PieceBounds {
            nodes: built[0].view(),
            leaves: built[1].view(),
            built,
            order: self.sort.buffer(
                device,
                "deep-screen-space order of senders",
                capacity,
                &range,
            )?,
            range,
            dispatches: storage(
                device,
                "deep-screen-space sender bounds dispatches",
                DISPATCH_BYTES * u64::from(depths + 1),
                BufferUsages::INDIRECT,
            )?,
            capacity,
        })
    }

    /// Records into a pass of its own.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        cloud: &SurfelCloud,
        bounds: &PieceBounds,
        timestamps: Option<Timestamps<'_>>,
    ) {
        let [nodes, leaves] = &bounds.built;
        let group = |layout, depth, written, rest: Option<&Buffer>| {
            let params = SenderBoundsParams {
                depth,
                capacity: bounds.capacity,
                perspective: u32::from(cloud.perspective),
                padding: 0,
            };
            let params = uniform(device, LABEL, &params);
            let mut resources = vec![
                (0, whole(&params)),
                (1, whole(&cloud.counters)),
                (2, whole(&cloud.pieces)),
                (3, whole(&bounds.range)),
                (4, whole(written)),
                (5, whole(&bounds.order.items)),
            ];
            resources.extend(rest.map(|buffer| (6, whole(buffer))));
            binding::group(device, LABEL, layout, &resources)
        };
        let plan = group(&self.plan_layout, 0, &bounds.dispatches, None);
        // A dispatch cannot bind the buffer that sizes it: these do not write the dispatches, but bind something there.
        let keys = group(&self.plan_layout, 0, &nodes.buffer, None);
        let mut pass = compute_pass(encoder, LABEL, timestamps);
        dispatch(&mut pass, &self.plan, &plan, 1);
        pass.set_bind_group(0, &keys, &[]);
        for pipeline in [&self.measure, &self.make_keys] {
            pass.set_pipeline(pipeline);
            pass.dispatch_workgroups_indirect(&bounds.dispatches, 0);
        }
        self.sort.record(&mut pass, &bounds.order);
        for depth in 0..=top_of(bounds.capacity) {
            let group = group(
                &self.build_layout,
                depth,
                &nodes.buffer,
                Some(&leaves.buffer),
            );
            pass.set_pipeline(if depth == 0 {
                &self.build_first
            } else {
                &self.build_next
            });
            pass.set_bind_group(0, &group, &[]);
            let at = DISPATCH_BYTES * u64::from(depth + 1);
            pass.dispatch_workgroups_indirect(&bounds.dispatches, at);
        }
        drop(pass);
        nodes.copy(encoder);
        leaves.copy(encoder);
    }
}

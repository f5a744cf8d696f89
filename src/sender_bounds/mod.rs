//! Bounds over runs of a cloud's senders, for rays to skip (`wgsl/sender_bounds.wgsl`, `wgsl/common/walk.wgsl`).

use bytemuck::{Pod, Zeroable};
use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device, PipelineCache, ShaderStages,
};

use crate::{
    error::Error,
    gpu::{
        Kernel, Timestamps,
        binding::{self, READ, UNIFORM, WRITE, whole},
        compute_pass, dispatch, shader,
        sort::{Sort, SortBuffer},
        storage, uniform,
    },
    surfel::SurfelCloud,
};

pub(crate) const SOURCE: &str = include_str!("../../wgsl/sender_bounds.wgsl");

const LABEL: &str = "deep-screen-space sender bounds";

/// Bytes of an indirect dispatch.
const DISPATCH_BYTES: u64 = 12;

/// Bounds over runs of four pieces of a cloud, of four such runs, and so on: what a ray skips by. Made anew from each
/// recording of the cloud; nothing of it is kept from frame to frame.
#[derive(Debug)]
pub struct SenderBounds {
    pub(crate) nodes: Buffer,
    pub(crate) leaves: Buffer,
    pub(crate) node_texture: wgpu::Texture,
    pub(crate) leaf_texture: wgpu::Texture,
    pub(crate) order: SortBuffer,
    range: Buffer,
    dispatches: Buffer,
    pub(crate) capacity: u32,
}

impl SenderBounds {
    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.nodes.size() + self.order.bytes() + self.range.size() + self.dispatches.size()
    }
}

/// The pipelines.
#[derive(Debug)]
pub(crate) struct SenderBoundsPass {
    plan_layout: wgpu::BindGroupLayout,
    build_layout: wgpu::BindGroupLayout,
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

/// Where a depth's nodes begin: `depth_offset` of the shader.
pub(crate) fn depth_offset(capacity: u32, depth: u32) -> u32 {
    let third = capacity / 3 + 1;
    third - (third >> (2 * depth)) + 2 * depth
}

/// The modules that it is made of.
pub(crate) fn source(plan: bool) -> Result<String, Error> {
    shader::assemble(
        "sender_bounds",
        SOURCE,
        if plan { &["PLAN"] } else { &[] },
        &[],
    )
}

impl SenderBoundsPass {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let layout = |items| {
            let mut e = vec![
                    (0, UNIFORM),
                    (1, READ),
                    (2, READ),
                    (3, WRITE),
                    (4, WRITE),
                    (5, items),
                ];
            if items == READ { e.push((6, WRITE)); }
            binding::layout(
                device,
                LABEL,
                ShaderStages::COMPUTE,
                &e,
            )
        };
        let (plan_layout, build_layout) = (layout(WRITE), layout(READ));
        let plan_module = shader::create(device, LABEL, source(true)?);
        let build_module = shader::create(device, LABEL, source(false)?);
        let kernel = |module, entry, layout: &wgpu::BindGroupLayout| {
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

    pub fn create(&self, device: &Device, cloud: &SurfelCloud) -> Result<SenderBounds, Error> {
        let capacity = cloud.capacity.pieces;
        let depths = top_of(capacity) + 1;
        let range = storage(
            device,
            "deep-screen-space range of senders",
            16,
            BufferUsages::empty(),
        )?;
        let tex = |texels: u64| device.create_texture(&wgpu::TextureDescriptor {
            label: Some(LABEL),
            size: wgpu::Extent3d { width: 4096, height: texels.div_ceil(4096) as u32, depth_or_array_layers: 1 },
            mip_level_count: 1, sample_count: 1, dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[] });
        let node_bytes = (96 * u64::from(depth_offset(capacity, depths))).next_multiple_of(65536);
        let leaf_bytes = (144 * u64::from(capacity.div_ceil(4))).next_multiple_of(65536);
        Ok(SenderBounds {
            node_texture: tex(node_bytes / 16),
            leaf_texture: tex(leaf_bytes / 16),
            leaves: storage(device, "leaves", leaf_bytes, BufferUsages::COPY_SRC)?,
            nodes: storage(
                device,
                "deep-screen-space sender bounds",
                node_bytes,
                BufferUsages::COPY_SRC,
            )?,
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
        bounds: &SenderBounds,
        timestamps: Option<Timestamps<'_>>,
    ) {
        let group = |layout: &wgpu::BindGroupLayout, depth, written| {
            let params = SenderBoundsParams {
                depth,
                capacity: bounds.capacity,
                perspective: u32::from(cloud.perspective),
                padding: 0,
            };
            let u = uniform(device, LABEL, &params);
            let mut e = vec![
                    (0, whole(&u)),
                    (1, whole(&cloud.counters)),
                    (2, whole(&cloud.pieces)),
                    (3, whole(&bounds.range)),
                    (4, whole(written)),
                    (5, whole(&bounds.order.items)),
                ];
            if std::ptr::eq(layout, &self.build_layout) { e.push((6, whole(&bounds.leaves))); }
            binding::group(
                device,
                LABEL,
                layout,
                &e,
            )
        };
        // A buffer cannot be written by a dispatch that it sizes: the plan is made in a pass of its own kind of group.
        let plan = group(&self.plan_layout, 0, &bounds.dispatches);
        let keys = group(&self.plan_layout, 0, &bounds.nodes);
        let mut pass = compute_pass(encoder, LABEL, timestamps);
        dispatch(&mut pass, &self.plan, &plan, 1);
        pass.set_bind_group(0, &keys, &[]);
        for pipeline in [&self.measure, &self.make_keys] {
            pass.set_pipeline(pipeline);
            pass.dispatch_workgroups_indirect(&bounds.dispatches, 0);
        }
        self.sort.record(&mut pass, &bounds.order);
        for depth in 0..=top_of(bounds.capacity) {
            let group = group(&self.build_layout, depth, &bounds.nodes);
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
        for (b, t) in [(&bounds.nodes, &bounds.node_texture), (&bounds.leaves, &bounds.leaf_texture)] {
            encoder.copy_buffer_to_texture(wgpu::TexelCopyBufferInfo { buffer: b, layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(65536), rows_per_image: None } }, t.as_image_copy(), t.size());
        }
    }
}

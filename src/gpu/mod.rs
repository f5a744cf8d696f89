//! What every pass shares: shader assembly, layouts and pipelines, uniforms, textures, prefix sums, fragment passes, labels
//! and timestamps.

pub(crate) mod binding;
pub(crate) mod compiler;
pub(crate) mod interface;
pub(crate) mod listing;
pub(crate) mod preprocess;
pub(crate) mod scan;
pub(crate) mod screen;
pub(crate) mod shader;
pub(crate) mod sort;
pub(crate) mod texture;
pub(crate) mod tokens;
pub(crate) mod uniforms;

use wgpu::{
    BindGroupLayout, Buffer, BufferUsages, CommandEncoder, ComputePass, ComputePipeline, Device,
    PipelineCache,
};

use self::{binding::Group, shader::Shader};
use crate::error::{Error, check_limit, check_setting};

/// Where a pass writes its begin and end timestamps. Optional everywhere; the device needs
/// [`wgpu::Features::TIMESTAMP_QUERY`] to create such a set at all.
#[derive(Clone, Copy, Debug)]
pub struct Timestamps<'a> {
    /// The caller's query set, of the type `Timestamp`.
    pub set: &'a wgpu::QuerySet,
    /// Index written when the pass begins.
    pub begin: u32,
    /// Index written when the pass has ended; another than `begin`.
    pub end: u32,
}

/// [`Error::Setting`] for timestamps that would overwrite each other or lie outside of their set, [`Error::Mismatch`] for a
/// set of another kind.
pub(crate) fn check_timestamps(timestamps: Option<Timestamps<'_>>) -> Result<(), Error> {
    let Some(Timestamps { set, begin, end }) = timestamps else {
        return Ok(());
    };
    if !matches!(set.ty(), wgpu::QueryType::Timestamp) {
        return Err(Error::Mismatch {
            name: "Timestamps::set",
            found: format!("{:?}", set.ty()),
            needed: "Timestamp".into(),
        });
    }
    for (field, index) in [("Timestamps::begin", begin), ("Timestamps::end", end)] {
        check_setting(
            index < set.count(),
            field,
            index,
            "an index of the query set, below its count",
        )?;
    }
    check_setting(
        begin != end,
        "Timestamps::end",
        end,
        "another index than Timestamps::begin",
    )
}

/// Invocations per workgroup in every kernel that has no reason for another number.
pub(crate) const WORKGROUP: u32 = 64;

/// A dispatch dimension ends at 65535; larger counts wrap into rows of this many workgroups, and kernels recover a
/// linear index with `linear_index` of `wgsl/common/dispatch.wgsl`, which must know the same number.
pub(crate) const DISPATCH_ROW: u32 = 32768;

/// Workgroup counts for `groups` workgroups in rows of [`DISPATCH_ROW`].
pub(crate) fn dispatch_rows(groups: u32) -> [u32; 3] {
    if groups <= DISPATCH_ROW {
        [groups, 1, 1]
    } else {
        [DISPATCH_ROW, groups.div_ceil(DISPATCH_ROW), 1]
    }
}

/// A storage buffer of `bytes` that only the GPU touches, after a check against the binding limit. A binding may not be smaller
/// than one element of what shaders take it for: where that is more than 16 bytes a buffer needs room for one.
pub(crate) fn storage(
    device: &Device,
    label: &'static str,
    bytes: u64,
    usage: BufferUsages,
) -> Result<Buffer, Error> {
    let limits = device.limits();
    check_limit(
        "max_storage_buffer_binding_size",
        limits.max_storage_buffer_binding_size,
        bytes,
        label,
    )?;
    check_limit("max_buffer_size", limits.max_buffer_size, bytes, label)?;
    Ok(device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: bytes.max(16),
        usage: usage | BufferUsages::STORAGE,
        mapped_at_creation: false,
    }))
}

/// Everything that a compute pipeline is made from.
pub(crate) struct Kernel<'a> {
    pub label: &'a str,
    pub module: &'a Shader,
    pub entry: &'a str,
    pub layouts: &'a [&'a BindGroupLayout],
    pub constants: &'a [(&'a str, f64)],
    pub cache: Option<&'a PipelineCache>,
}

impl Kernel<'_> {
    pub fn create(&self, device: &Device) -> ComputePipeline {
        let layouts: Vec<Option<&BindGroupLayout>> =
            self.layouts.iter().copied().map(Some).collect();
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(self.label),
            bind_group_layouts: &layouts,
            immediate_size: 0,
        });
        device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(self.label),
            layout: Some(&layout),
            module: &self.module.raw,
            entry_point: Some(self.entry),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: self.constants,
                // Kernels write their workgroup memory before they read it.
                zero_initialize_workgroup_memory: false,
            },
            cache: self.cache,
        })
    }
}

/// A compute pass with the crate's label and the caller's timestamps. The label is the pass's debug group: one on the
/// encoder would begin and end in two of the command buffers that wgpu cuts an encoder into, which lavapipe of Mesa 22.3
/// does not survive.
pub(crate) fn compute_pass<'e>(
    encoder: &'e mut CommandEncoder,
    label: &str,
    timestamps: Option<Timestamps<'_>>,
) -> ComputePass<'e> {
    begin(encoder, label, timestamps, true)
}

/// The same for the first of several passes that share a pair of timestamps: the last one writes the end time.
pub(crate) fn first_pass<'e>(
    encoder: &'e mut CommandEncoder,
    label: &str,
    timestamps: Option<Timestamps<'_>>,
) -> ComputePass<'e> {
    begin(encoder, label, timestamps, false)
}

/// The end time of recordings that end outside of a pass, by a pass of nothing; none without timestamps.
#[cfg(feature = "ray-query")]
pub(crate) fn end_pass(
    encoder: &mut CommandEncoder,
    label: &str,
    timestamps: Option<Timestamps<'_>>,
) {
    let Some(timestamps) = timestamps else {
        return;
    };
    encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
        label: Some(label),
        timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
            query_set: timestamps.set,
            beginning_of_pass_write_index: None,
            end_of_pass_write_index: Some(timestamps.end),
        }),
    });
}

fn begin<'e>(
    encoder: &'e mut CommandEncoder,
    label: &str,
    timestamps: Option<Timestamps<'_>>,
    ends: bool,
) -> ComputePass<'e> {
    encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
        label: Some(label),
        timestamp_writes: timestamps.map(|t| wgpu::ComputePassTimestampWrites {
            query_set: t.set,
            beginning_of_pass_write_index: Some(t.begin),
            end_of_pass_write_index: ends.then_some(t.end),
        }),
    })
}

/// One dispatch of `groups` workgroups (see [`dispatch_rows`]) with a single bind group.
pub(crate) fn dispatch(
    pass: &mut ComputePass<'_>,
    pipeline: &ComputePipeline,
    group: &Group,
    groups: u32,
) {
    if groups == 0 {
        return;
    }
    let [x, y, z] = dispatch_rows(groups);
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &group.raw, &group.offsets);
    pass.dispatch_workgroups(x, y, z);
}

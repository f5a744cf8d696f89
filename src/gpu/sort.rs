//! Sorting on the GPU (`wgsl/sort.wgsl`).

use bytemuck::{Pod, Zeroable};
use wgpu::{
    BindGroup, Buffer, BufferUsages, ComputePass, ComputePipeline, Device, PipelineCache,
    ShaderStages,
};

use super::{
    Kernel,
    binding::{self, READ, UNIFORM, WRITE, whole},
    dispatch,
    scan::{Scan, ScanBuffer},
    shader, storage, uniform,
};
use crate::error::Error;

/// Keys that one workgroup moves, and values that a digit has; as in the shader.
const BLOCK: u32 = 1024;
const DIGITS: u32 = 16;
const DIGIT_BITS: u32 = 4;

pub(crate) const SOURCE: &str = include_str!("../../wgsl/sort.wgsl");

const LABEL: &str = "deep-screen-space sort";

/// The pipelines.
#[derive(Debug)]
pub(crate) struct Sort {
    layout: wgpu::BindGroupLayout,
    count_digits: ComputePipeline,
    move_keys: ComputePipeline,
    scan: Scan,
}

/// An array of pairs of key and value, each a `u32`, that is sorted by key.
#[derive(Debug)]
pub(crate) struct SortBuffer {
    /// The pairs, before and after: an even number of passes brings them back here.
    pub items: Buffer,
    other: Buffer,
    counts: ScanBuffer,
    passes: Vec<BindGroup>,
    blocks: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SortParams {
    pub(crate) shift: u32,
    pub(crate) blocks: u32,
    pub(crate) padding: [u32; 2],
}

impl Sort {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let layout = binding::layout(
            device,
            LABEL,
            ShaderStages::COMPUTE,
            &[(0, UNIFORM), (1, READ), (2, READ), (3, WRITE), (4, WRITE)],
        );
        let module = shader::create(device, LABEL, shader::assemble("sort", SOURCE, &[], &[])?);
        let kernel = |entry| {
            Kernel {
                label: LABEL,
                module: &module,
                entry,
                layouts: &[&layout],
                constants: &[],
                cache,
            }
            .create(device)
        };
        Ok(Self {
            count_digits: kernel("count_digits"),
            move_keys: kernel("move_keys"),
            scan: Scan::new(device, cache)?,
            layout,
        })
    }

    /// Room for `capacity` pairs, of which the first `u32` of `length` says how many there are.
    pub fn buffer(
        &self,
        device: &Device,
        label: &'static str,
        capacity: u32,
        length: &Buffer,
    ) -> Result<SortBuffer, Error> {
        let blocks = capacity.div_ceil(BLOCK).max(1);
        let bytes = 8 * u64::from(capacity);
        let items = storage(device, label, bytes, BufferUsages::empty())?;
        let other = storage(device, label, bytes, BufferUsages::empty())?;
        let counts = self.scan.buffer(device, label, DIGITS * blocks)?;
        let passes = (0..32 / DIGIT_BITS)
            .map(|pass| {
                let params = SortParams {
                    shift: pass * DIGIT_BITS,
                    blocks,
                    padding: [0; 2],
                };
                let (from, to) = if pass % 2 == 0 {
                    (&items, &other)
                } else {
                    (&other, &items)
                };
                binding::group(
                    device,
                    label,
                    &self.layout,
                    &[
                        (0, whole(&uniform(device, label, &params))),
                        (1, whole(length)),
                        (2, whole(from)),
                        (3, whole(to)),
                        (4, whole(&counts.values)),
                    ],
                )
            })
            .collect();
        Ok(SortBuffer {
            items,
            other,
            counts,
            passes,
            blocks,
        })
    }

    pub fn record(&self, pass: &mut ComputePass<'_>, buffer: &SortBuffer) {
        for group in &buffer.passes {
            dispatch(pass, &self.count_digits, group, buffer.blocks);
            self.scan.record(pass, &buffer.counts);
            dispatch(pass, &self.move_keys, group, buffer.blocks);
        }
    }
}

impl SortBuffer {
    pub fn bytes(&self) -> u64 {
        self.items.size() + self.other.size() + self.counts.bytes()
    }
}

//! Exclusive prefix sums on the GPU (`wgsl/scan.wgsl`).

use wgpu::{BufferUsages, ComputePass, ComputePipeline, Device, PipelineCache};

use super::listing::Listing;
use super::{
    Kernel,
    binding::{Group, Layout, whole},
    dispatch, shader, storage,
};
use crate::error::Error;

/// Values that one workgroup scans; `BLOCK` of the shader.
const BLOCK: u32 = 1024;

const SOURCE: &str = include_str!("../../wgsl/scan.wgsl");

/// The pipelines.
#[derive(Debug)]
pub(crate) struct Scan {
    layout: Layout,
    blocks: ComputePipeline,
    totals: ComputePipeline,
}

/// An array that is scanned in place, with room for the blocks' totals.
#[derive(Debug)]
pub(crate) struct ScanBuffer {
    /// `count + 1` values: after the scan the last one is the total.
    pub values: wgpu::Buffer,
    /// A bind group and a number of blocks for each stage, the values themselves first.
    stages: Vec<(Group, u32)>,
    totals: Vec<wgpu::Buffer>,
}

impl Scan {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let module = shader::create(
            device,
            "deep-screen-space scan",
            shader::assemble("scan", SOURCE, &[], &[])?,
        );
        let layout = module.layout(device, &["scan_blocks", "add_totals"]);
        let kernel = |entry| {
            Kernel {
                label: "deep-screen-space scan",
                module: &module,
                entry,
                layouts: &[&layout.raw],
                constants: &[],
                cache,
            }
            .create(device)
        };
        let (blocks, totals) = (kernel("scan_blocks"), kernel("add_totals"));
        Ok(Self {
            layout,
            blocks,
            totals,
        })
    }

    /// Room for `count` values and their total.
    pub fn buffer(
        &self,
        device: &Device,
        label: &'static str,
        count: u32,
    ) -> Result<ScanBuffer, Error> {
        let bytes = |n: u32| 4 * u64::from(n);
        let values = storage(
            device,
            label,
            bytes(count) + 4,
            BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
        )?;
        let mut length = count + 1;
        let mut totals = Vec::new();
        loop {
            let blocks = length.div_ceil(BLOCK);
            totals.push(storage(
                device,
                label,
                bytes(blocks),
                BufferUsages::empty(),
            )?);
            length = blocks;
            if blocks == 1 {
                break;
            }
        }
        let mut stages = Vec::new();
        let mut from = &values;
        let mut length = count + 1;
        for to in &totals {
            let resources = [("values", whole(from)), ("totals", whole(to))];
            let group = self.layout.group(device, &resources);
            stages.push((group, length.div_ceil(BLOCK)));
            length = length.div_ceil(BLOCK);
            from = to;
        }
        Ok(ScanBuffer {
            values,
            stages,
            totals,
        })
    }

    pub fn record(&self, pass: &mut ComputePass<'_>, buffer: &ScanBuffer) {
        for (group, blocks) in &buffer.stages {
            dispatch(pass, &self.blocks, group, *blocks);
        }
        // The last stage is one block: it has no total to add.
        for (group, blocks) in buffer.stages.iter().rev().skip(1) {
            dispatch(pass, &self.totals, group, *blocks);
        }
    }
}

impl ScanBuffer {
    pub fn bytes(&self) -> u64 {
        self.values.size() + self.totals.iter().map(wgpu::Buffer::size).sum::<u64>()
    }
}

/// Every module of the pass.
pub(crate) fn list<E>(all: &mut Listing<'_, E>) -> Result<(), Error> {
    all.add("scan", shader::assemble("scan", SOURCE, &[], &[])?);
    Ok(())
}

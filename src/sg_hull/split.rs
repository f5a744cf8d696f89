//! Quads that do not fit, split in four again and again (`wgsl/sg_hull_split.wgsl`).

use wgpu::{ComputePass, ComputePipeline, ShaderModule, ShaderStages};

use super::{
    bindings::{
        Bindings,
        Resource::{Counts, Params, Parts, Receivers, Rejected, SegmentOf, Segments, Splits},
    },
    modules::HullStage,
    pipelines::Maker,
    plan::{Plan, Planned},
    settings::{SgHullSettings, SgHullSize},
};
use crate::{
    error::Error,
    gpu::binding::{READ, UINT_2D, UNIFORM, WRITE},
};

/// What splits quads that do not fit: without gloss, of which parts know nothing.
#[derive(Debug)]
pub(super) struct Splitter {
    bindings: Bindings,
    gather_bindings: Bindings,
    place: ComputePipeline,
    gather: ComputePipeline,
    divide: ComputePipeline,
}

impl Splitter {
    pub fn new(make: &Maker<'_>, gather_module: &ShaderModule) -> Result<Self, Error> {
        let module = make.module(HullStage::Split)?;
        let bindings = make.bindings(
            ShaderStages::COMPUTE,
            &[
                (0, Params, UNIFORM),
                (1, Receivers, UINT_2D),
                (2, SegmentOf, READ),
                (3, Segments, READ),
                (4, Counts, WRITE),
                (5, Splits, WRITE),
                (6, Parts, WRITE),
                (7, Rejected, WRITE),
            ],
        );
        let gather_bindings = make.bindings(
            ShaderStages::COMPUTE,
            &[(0, Params, UNIFORM), (1, Counts, READ), (4, Splits, WRITE)],
        );
        Ok(Self {
            place: make.kernel(&module, "place_points", &bindings, &[]),
            gather: make.gathering_kernel(gather_module, "gather_points", &gather_bindings),
            divide: make.kernel(&module, "divide", &bindings, &[]),
            bindings,
            gather_bindings,
        })
    }

    /// Records all rounds.
    pub fn record(&self, pass: &mut ComputePass<'_>, planned: &Planned<'_>) {
        let recording = planned.recording;
        let points = self.bindings.group(recording);
        let light = self.gather_bindings.group(recording);
        for _ in 0..split_rounds(recording.settings, &recording.hull.size) {
            planned.run(
                pass,
                Plan::Points,
                &[(&self.place, &points), (&self.gather, &light)],
            );
            planned.run(pass, Plan::Divide, &[(&self.divide, &points)]);
        }
        // The parts that the last round found.
        planned.run(pass, Plan::Points, &[]);
    }
}

/// Rounds until no part of a quad is wide enough to be split.
fn split_rounds(settings: &SgHullSettings, size: &SgHullSize) -> u32 {
    const SPLIT_SIDE: u32 = 4;
    // Pixels of a texel beside a quad's own may be of its segment.
    let mut side = (settings.quad + 2) * size.texel();
    let mut rounds = 0;
    while side >= SPLIT_SIDE {
        side = side.div_ceil(2);
        rounds += 1;
    }
    rounds
}

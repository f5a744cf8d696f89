//! Quads that do not fit, split in four again and again (`wgsl/sg_hull_split.wgsl`).

use wgpu::{ComputePass, ComputePipeline};

use super::{
    modules::HullStage,
    pipelines::Maker,
    plan::{Plan, Planned},
    settings::{SgHullSettings, SgHullSize},
};
use crate::{
    error::Error,
    gpu::{binding::Layout, shader::Shader},
};

/// What splits quads that do not fit: without gloss, of which parts know nothing.
#[derive(Debug)]
pub(super) struct Splitter {
    layout: Layout,
    gather_layout: Layout,
    place: ComputePipeline,
    gather: ComputePipeline,
    divide: ComputePipeline,
}

impl Splitter {
    pub fn new(make: &Maker<'_>, gather_module: &Shader) -> Result<Self, Error> {
        let module = make.module(HullStage::Split)?;
        let layout = module.layout(make.device, &["place_points", "divide"]);
        let gather_layout = gather_module.layout(make.device, &["gather_points"]);
        Ok(Self {
            place: make.kernel(&module, "place_points", &layout, &[]),
            gather: make.gathering_kernel(gather_module, "gather_points", &gather_layout),
            divide: make.kernel(&module, "divide", &layout, &[]),
            layout,
            gather_layout,
        })
    }

    /// Records all rounds.
    pub fn record(&self, pass: &mut ComputePass<'_>, planned: &Planned<'_, '_>) {
        let recording = planned.recording;
        let points = recording.group(&self.layout);
        let light = recording.group(&self.gather_layout);
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

//! The stages that make the hull: segments, their vertices, the vertices' light, and which quads it does not fit.

use wgpu::{ComputePass, ComputePipeline, ShaderModule, ShaderStages};

use super::{
    bindings::{
        Bindings,
        Resource::{
            Counts, List, Others, Params, PerPixel, Receivers, Rejected, SegmentOf, Segments,
            Splits, Vertices,
        },
    },
    modules::HullStage,
    pipelines::Maker,
    plan::{Plan, Planned},
    settings::Components,
    split::Splitter,
};
use crate::{
    error::Error,
    gpu::binding::{READ, UINT_2D, UNIFORM, WRITE},
};

/// Their pipelines, each after what it binds.
#[derive(Debug)]
pub(super) struct Stages {
    segment_bindings: Bindings,
    segment: ComputePipeline,
    place_bindings: Bindings,
    place: ComputePipeline,
    gather_bindings: Bindings,
    gather: ComputePipeline,
    classify_bindings: Bindings,
    mean: ComputePipeline,
    classify: ComputePipeline,
    list: ComputePipeline,
}

impl Stages {
    pub fn new(make: &Maker<'_>, gather_module: &ShaderModule) -> Result<Self, Error> {
        let segment_bindings = make.bindings(
            ShaderStages::COMPUTE,
            &[
                (0, Params, UNIFORM),
                (1, Receivers, UINT_2D),
                (2, SegmentOf, WRITE),
                (3, Segments, WRITE),
                (4, Counts, WRITE),
                (5, Others, WRITE),
            ],
        );
        let place_bindings = make.bindings(
            ShaderStages::COMPUTE,
            &[
                (0, Params, UNIFORM),
                (1, Receivers, UINT_2D),
                (2, SegmentOf, READ),
                (3, Segments, READ),
                (4, Counts, WRITE),
                (5, Vertices, WRITE),
                (6, List, WRITE),
            ],
        );
        let gather_bindings = make.bindings(
            ShaderStages::COMPUTE,
            &[
                (0, Params, UNIFORM),
                (1, Counts, READ),
                (2, List, READ),
                (3, Vertices, WRITE),
            ],
        );
        let classify_bindings = make.bindings(
            ShaderStages::COMPUTE,
            &[
                (0, Params, UNIFORM),
                (2, SegmentOf, READ),
                (3, Segments, READ),
                (4, Counts, WRITE),
                (5, Vertices, WRITE),
                (6, List, READ),
                (7, Rejected, WRITE),
                (8, PerPixel, WRITE),
                (9, Splits, WRITE),
            ],
        );
        let propagates = make.descriptor.components == Components::Propagation;
        let classify_module = make.module(HullStage::Classify)?;
        let classifying = |entry| make.kernel(&classify_module, entry, &classify_bindings, &[]);
        Ok(Self {
            segment: make.kernel(
                &make.module(HullStage::Segment)?,
                "segment",
                &segment_bindings,
                &[("PROPAGATE", f64::from(u8::from(propagates)))],
            ),
            place: make.kernel(
                &make.module(HullStage::Place)?,
                "place_vertices",
                &place_bindings,
                &[],
            ),
            gather: make.gathering_kernel(gather_module, "gather_vertices", &gather_bindings),
            mean: classifying("mean"),
            classify: classifying("classify"),
            list: classifying("list_pixels"),
            segment_bindings,
            place_bindings,
            gather_bindings,
            classify_bindings,
        })
    }

    /// Records them, with the splits of quads that do not fit before pixels are listed.
    pub fn record(
        &self,
        pass: &mut ComputePass<'_>,
        planned: &Planned<'_>,
        splitter: Option<&Splitter>,
    ) {
        let recording = planned.recording;
        let [columns, rows] = recording.hull.size.tiles();
        pass.set_pipeline(&self.segment);
        pass.set_bind_group(0, &self.segment_bindings.group(recording), &[]);
        pass.dispatch_workgroups(columns, rows, 1);
        let place = self.place_bindings.group(recording);
        planned.run(pass, Plan::Vertices, &[(&self.place, &place)]);
        let gather = self.gather_bindings.group(recording);
        planned.run(pass, Plan::Gather, &[(&self.gather, &gather)]);
        let classify = self.classify_bindings.group(recording);
        pass.set_pipeline(&self.mean);
        pass.set_bind_group(0, &classify, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        planned.run(pass, Plan::Classify, &[(&self.classify, &classify)]);
        if let Some(splitter) = splitter {
            splitter.record(pass, planned);
        }
        planned.run(pass, Plan::List, &[(&self.list, &classify)]);
    }
}

//! The stages that make the hull: segments, their vertices, the vertices' light, and which quads it does not fit.

use wgpu::{ComputePass, ComputePipeline};

use super::{
    modules::HullStage,
    pipelines::Maker,
    plan::{Plan, Planned},
    settings::Components,
    split::Splitter,
};
use crate::{
    error::Error,
    gpu::{binding::Layout, shader::Shader},
};

/// Their pipelines, each after what it binds.
#[derive(Debug)]
pub(super) struct Stages {
    segment_layout: Layout,
    segment: ComputePipeline,
    place_layout: Layout,
    place: ComputePipeline,
    gather_layout: Layout,
    gather: ComputePipeline,
    classify_layout: Layout,
    mean: ComputePipeline,
    classify: ComputePipeline,
    list: ComputePipeline,
}

impl Stages {
    pub fn new(make: &Maker<'_>, gather_module: &Shader) -> Result<Self, Error> {
        let propagates = make.descriptor.components == Components::Propagation;
        let classify_module = make.module(HullStage::Classify)?;
        let segment_module = make.module(HullStage::Segment)?;
        let place_module = make.module(HullStage::Place)?;
        let segment_layout = segment_module.layout(make.device, &["segment"]);
        let place_layout = place_module.layout(make.device, &["place_vertices"]);
        let gather_layout = gather_module.layout(make.device, &["gather_vertices"]);
        let classify_layout =
            classify_module.layout(make.device, &["mean", "classify", "list_pixels"]);
        let classifying = |entry| make.kernel(&classify_module, entry, &classify_layout, &[]);
        Ok(Self {
            segment: make.kernel(
                &segment_module,
                "segment",
                &segment_layout,
                &[("PROPAGATE", f64::from(u8::from(propagates)))],
            ),
            place: make.kernel(&place_module, "place_vertices", &place_layout, &[]),
            gather: make.gathering_kernel(gather_module, "gather_vertices", &gather_layout),
            mean: classifying("mean"),
            classify: classifying("classify"),
            list: classifying("list_pixels"),
            segment_layout,
            place_layout,
            gather_layout,
            classify_layout,
        })
    }

    /// Records them, with the splits of quads that do not fit before pixels are listed.
    pub fn record(
        &self,
        pass: &mut ComputePass<'_>,
        planned: &Planned<'_, '_>,
        splitter: Option<&Splitter>,
    ) {
        let recording = planned.recording;
        let [columns, rows] = recording.hull.size.tiles();
        pass.set_pipeline(&self.segment);
        let segment = recording.group(&self.segment_layout);
        pass.set_bind_group(0, &segment.raw, &segment.offsets);
        pass.dispatch_workgroups(columns, rows, 1);
        let place = recording.group(&self.place_layout);
        planned.run(pass, Plan::Vertices, &[(&self.place, &place)]);
        let gather = recording.group(&self.gather_layout);
        planned.run(pass, Plan::Gather, &[(&self.gather, &gather)]);
        let classify = recording.group(&self.classify_layout);
        pass.set_pipeline(&self.mean);
        pass.set_bind_group(0, &classify.raw, &classify.offsets);
        pass.dispatch_workgroups(1, 1, 1);
        planned.run(pass, Plan::Classify, &[(&self.classify, &classify)]);
        if let Some(splitter) = splitter {
            splitter.record(pass, planned);
        }
        planned.run(pass, Plan::List, &[(&self.list, &classify)]);
    }
}

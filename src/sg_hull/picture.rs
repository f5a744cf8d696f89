//! The sky, quads and parts of quads as they are drawn (`wgsl/sg_hull.wgsl`).

use std::mem::offset_of;

use wgpu::{PrimitiveTopology, RenderPass, RenderPipeline, ShaderStages};

use super::{
    bindings::{
        Bindings,
        Resource::{Counts, Params, Parts, Receivers, SegmentOf, Segments, Vertices},
        surface,
    },
    modules::HullStage,
    params::SgHullCounts,
    pipelines::Maker,
    recording::Recording,
};
use crate::{
    error::Error,
    gpu::binding::{READ, UINT_2D, UNIFORM},
};

/// Its pipelines.
#[derive(Debug)]
pub(super) struct Picture {
    bindings: Bindings,
    clear_sky: RenderPipeline,
    shade: RenderPipeline,
    shade_flat: RenderPipeline,
    /// Without gloss.
    parts: Option<RenderPipeline>,
}

impl Picture {
    pub fn new(make: &Maker<'_>) -> Result<Self, Error> {
        let glossy = make.variant.glossy;
        let mut list = vec![
            (0, Params, UNIFORM),
            (1, Receivers, UINT_2D),
            (2, SegmentOf, READ),
            (3, Segments, READ),
            (4, Counts, READ),
            (5, Vertices, READ),
        ];
        list.extend(surface(make.variant));
        list.extend((!glossy).then_some((8, Parts, READ)));
        let bindings = make.bindings(ShaderStages::VERTEX_FRAGMENT, &list);
        let module = make.module(HullStage::Shade)?;
        let draw = |entries, topology| make.drawing(&module, entries, topology, &bindings);
        let (strip, triangles) = (
            PrimitiveTopology::TriangleStrip,
            PrimitiveTopology::TriangleList,
        );
        Ok(Self {
            clear_sky: draw(["cover", "clear_sky"], triangles),
            shade: draw(["corner", "shade"], strip),
            shade_flat: draw(["flat_corner", "shade_flat"], strip),
            parts: (!glossy).then(|| draw(["part_corner", "shade_flat"], strip)),
            bindings,
        })
    }

    /// Draws it: with the parts of quads where they were split.
    pub fn draw(&self, pass: &mut RenderPass<'_>, recording: &Recording<'_>, split: bool) {
        let counts = &recording.hull.counts;
        pass.set_bind_group(0, &self.bindings.group(recording), &[]);
        pass.set_pipeline(&self.clear_sky);
        pass.draw(0..3, 0..1);
        for pipeline in [&self.shade, &self.shade_flat] {
            pass.set_pipeline(pipeline);
            pass.draw_indirect(counts, offset_of!(SgHullCounts, draw) as u64);
        }
        if let Some(parts) = self.parts.as_ref().filter(|_| split) {
            pass.set_pipeline(parts);
            pass.draw_indirect(counts, offset_of!(SgHullCounts, parts) as u64);
        }
    }
}

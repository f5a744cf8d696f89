//! The sky, quads and parts of quads as they are drawn (`wgsl/sg_hull.wgsl`).

use std::mem::offset_of;

use wgpu::{PrimitiveTopology, RenderPass, RenderPipeline};

use super::{modules::HullStage, params::SgHullCounts, pipelines::Maker, recording::Recording};
use crate::{error::Error, gpu::binding::Layout};

/// Its pipelines.
#[derive(Debug)]
pub(super) struct Picture {
    layout: Layout,
    clear_sky: RenderPipeline,
    shade: RenderPipeline,
    shade_flat: RenderPipeline,
    /// Without gloss.
    parts: Option<RenderPipeline>,
}

impl Picture {
    pub fn new(make: &Maker<'_>) -> Result<Self, Error> {
        let glossy = make.variant.glossy;
        let module = make.module(HullStage::Shade)?;
        let layout = module.layout(
            make.device,
            &[
                "clear_sky",
                "corner",
                "shade",
                "flat_corner",
                "part_corner",
                "shade_flat",
            ],
        );
        let draw = |entries, topology| make.drawing(&module, entries, topology, &layout);
        let (strip, triangles) = (
            PrimitiveTopology::TriangleStrip,
            PrimitiveTopology::TriangleList,
        );
        Ok(Self {
            clear_sky: draw(["cover", "clear_sky"], triangles),
            shade: draw(["corner", "shade"], strip),
            shade_flat: draw(["flat_corner", "shade_flat"], strip),
            parts: (!glossy).then(|| draw(["part_corner", "shade_flat"], strip)),
            layout,
        })
    }

    /// Draws it: with the parts of quads where they were split.
    pub fn draw(&self, pass: &mut RenderPass<'_>, recording: &Recording<'_>, split: bool) {
        let counts = &recording.hull.counts;
        let group = recording.group(&self.layout);
        pass.set_bind_group(0, &group.raw, &group.offsets);
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

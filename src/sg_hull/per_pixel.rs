//! Light gathered at each pixel: of quads that do not fit, or of the whole picture (`wgsl/sg_hull_per_pixel.wgsl`).

use std::mem::offset_of;

use wgpu::{ComputePass, ComputePipeline, PrimitiveTopology, RenderPass, RenderPipeline};

use super::{
    modules::HullStage,
    params::SgHullCounts,
    pipelines::Maker,
    plan::{Plan, Planned},
    recording::Recording,
};
use crate::{error::Error, gpu::binding::Layout};

/// Its pipelines, each after what it binds.
#[derive(Debug)]
pub(super) struct PerPixel {
    pixels_layout: Layout,
    pixels: ComputePipeline,
    points_layout: Layout,
    points: RenderPipeline,
    cover_layout: Layout,
    cover: RenderPipeline,
}

impl PerPixel {
    pub fn new(make: &Maker<'_>) -> Result<Self, Error> {
        let module = make.module(HullStage::PerPixel)?;
        // Points are drawn with irradiance, or with what is reflected where that is more than albedo times irradiance.
        let layout = |entries: &[&str]| module.layout(make.device, entries);
        let pixels_layout = layout(&["gather_pixels"]);
        let points_layout = layout(&["point", "draw_point"]);
        let cover_layout = layout(&["cover", "per_pixel"]);
        Ok(Self {
            pixels: make.gathering_kernel(&module, "gather_pixels", &pixels_layout),
            points: make.drawing(
                &module,
                ["point", "draw_point"],
                PrimitiveTopology::PointList,
                &points_layout,
            ),
            cover: make.gathering_drawing(
                &module,
                ["cover", "per_pixel"],
                PrimitiveTopology::TriangleList,
                &cover_layout,
            ),
            pixels_layout,
            points_layout,
            cover_layout,
        })
    }

    /// Gathers light at the listed pixels.
    pub fn gather(&self, pass: &mut ComputePass<'_>, planned: &Planned<'_, '_>) {
        let pixels = planned.recording.group(&self.pixels_layout);
        planned.run(pass, Plan::Pixels, &[(&self.pixels, &pixels)]);
    }

    /// Draws the listed pixels.
    pub fn draw_points(&self, pass: &mut RenderPass<'_>, recording: &Recording<'_>) {
        let group = recording.group(&self.points_layout);
        pass.set_bind_group(0, &group.raw, &group.offsets);
        pass.set_pipeline(&self.points);
        pass.draw_indirect(
            &recording.hull.counts,
            offset_of!(SgHullCounts, points) as u64,
        );
    }

    /// Draws every pixel, with light gathered for it.
    pub fn draw_all(&self, pass: &mut RenderPass<'_>, recording: &Recording<'_>) {
        pass.set_pipeline(&self.cover);
        let group = recording.group(&self.cover_layout);
        pass.set_bind_group(0, &group.raw, &group.offsets);
        if let Some(lights) = recording.input.gather {
            pass.set_bind_group(1, &lights.group, &[]);
        }
        pass.draw(0..3, 0..1);
    }
}

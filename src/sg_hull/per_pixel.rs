//! Light gathered at each pixel: of quads that do not fit, or of the whole picture (`wgsl/sg_hull_per_pixel.wgsl`).

use std::mem::offset_of;

use wgpu::{
    ComputePass, ComputePipeline, PrimitiveTopology, RenderPass, RenderPipeline, ShaderStages,
};

use super::{
    bindings::{
        Bindings,
        Resource::{self, Counts, Params, Receivers},
        surface,
    },
    modules::HullStage,
    params::SgHullCounts,
    pipelines::Maker,
    plan::{Plan, Planned},
    recording::Recording,
};
use crate::{
    error::Error,
    gpu::binding::{READ, UINT_2D, UNIFORM, WRITE},
};

/// Its pipelines, each after what it binds.
#[derive(Debug)]
pub(super) struct PerPixel {
    pixels_bindings: Bindings,
    pixels: ComputePipeline,
    points_bindings: Bindings,
    points: RenderPipeline,
    cover_bindings: Bindings,
    cover: RenderPipeline,
}

impl PerPixel {
    pub fn new(make: &Maker<'_>) -> Result<Self, Error> {
        let mut pixels = vec![
            (0, Params, UNIFORM),
            (1, Receivers, UINT_2D),
            (2, Counts, READ),
            (3, Resource::PerPixel, WRITE),
        ];
        let mut points = vec![(0, Params, UNIFORM), (4, Resource::PerPixel, READ)];
        // Points are drawn with irradiance, or with what is reflected where that is more than albedo times irradiance.
        if make.variant.glossy {
            pixels.extend(surface(make.variant));
        } else {
            points.extend(surface(make.variant));
        }
        let mut cover = vec![(0, Params, UNIFORM), (1, Receivers, UINT_2D)];
        cover.extend(surface(make.variant));
        let cover_bindings = make.bindings(ShaderStages::FRAGMENT, &cover);
        let pixels_bindings = make.bindings(ShaderStages::COMPUTE, &pixels);
        let points_bindings = make.bindings(ShaderStages::VERTEX_FRAGMENT, &points);
        let module = make.module(HullStage::PerPixel)?;
        Ok(Self {
            pixels: make.gathering_kernel(&module, "gather_pixels", &pixels_bindings),
            points: make.drawing(
                &module,
                ["point", "draw_point"],
                PrimitiveTopology::PointList,
                &points_bindings,
            ),
            cover: make.gathering_drawing(
                &module,
                ["cover", "per_pixel"],
                PrimitiveTopology::TriangleList,
                &cover_bindings,
            ),
            pixels_bindings,
            points_bindings,
            cover_bindings,
        })
    }

    /// Gathers light at the listed pixels.
    pub fn gather(&self, pass: &mut ComputePass<'_>, planned: &Planned<'_>) {
        let pixels = self.pixels_bindings.group(planned.recording);
        planned.run(pass, Plan::Pixels, &[(&self.pixels, &pixels)]);
    }

    /// Draws the listed pixels.
    pub fn draw_points(&self, pass: &mut RenderPass<'_>, recording: &Recording<'_>) {
        pass.set_bind_group(0, &self.points_bindings.group(recording), &[]);
        pass.set_pipeline(&self.points);
        pass.draw_indirect(
            &recording.hull.counts,
            offset_of!(SgHullCounts, points) as u64,
        );
    }

    /// Draws every pixel, with light gathered for it.
    pub fn draw_all(&self, pass: &mut RenderPass<'_>, recording: &Recording<'_>) {
        pass.set_pipeline(&self.cover);
        pass.set_bind_group(0, &self.cover_bindings.group(recording), &[]);
        if let Some(lights) = recording.input.gather {
            pass.set_bind_group(1, &lights.group, &[]);
        }
        pass.draw(0..3, 0..1);
    }
}

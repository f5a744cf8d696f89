//! Fragment passes over the camera's viewport, into a texture of the caller's.

use wgpu::{
    BindGroupLayout, CommandEncoder, Device, PipelineCache, RenderPass, RenderPipeline,
    TextureFormat, TextureUsages,
};

use super::{Timestamps, binding::Group, shader::Shader};
use crate::{
    camera::Viewport,
    error::Error,
    texture_slice::{TextureSlice, check_slice},
};

/// [`Error::Format`] for a target that cannot be rendered to or does not hold floats.
pub(crate) fn check_format(
    device: &Device,
    name: &'static str,
    format: TextureFormat,
) -> Result<(), Error> {
    let float = matches!(
        format.sample_type(None, Some(device.features())),
        Some(wgpu::TextureSampleType::Float { .. })
    );
    let renderable = format
        .guaranteed_format_features(device.features())
        .allowed_usages
        .contains(TextureUsages::RENDER_ATTACHMENT);
    if format.has_depth_aspect() || !float || !renderable {
        return Err(Error::Format {
            name,
            format,
            accepted: "a colour format of floats that can be rendered to",
        });
    }
    Ok(())
}

/// The largest colour that a target holds, for `wgsl/common/target.wgsl`.
pub(crate) fn brightest(format: TextureFormat) -> f64 {
    match format {
        TextureFormat::R16Float | TextureFormat::Rg16Float | TextureFormat::Rgba16Float => 65504.0,
        // Blue's: it has one bit less.
        TextureFormat::Rg11b10Ufloat => 64512.0,
        _ => 3.4e38,
    }
}

/// Checks a target that such a pipeline of format `made_for` draws into.
pub(crate) fn check_target(
    name: &'static str,
    target: &TextureSlice<'_>,
    viewport: Viewport,
    made_for: TextureFormat,
) -> Result<(), Error> {
    check_slice(name, target, viewport, TextureUsages::RENDER_ATTACHMENT)?;
    let format = target.view_format();
    if format != made_for {
        return Err(Error::Mismatch {
            name,
            found: format!("{format:?}"),
            needed: format!("{made_for:?}"),
        });
    }
    Ok(())
}

/// Everything that such a pipeline is made from; the module imports `wgsl/common/screen.wgsl`.
pub(crate) struct Screen<'a> {
    pub label: &'a str,
    pub module: &'a Shader,
    pub entry: &'a str,
    pub layout: &'a BindGroupLayout,
    pub constants: &'a [(&'a str, f64)],
    pub target: TextureFormat,
    pub cache: Option<&'a PipelineCache>,
}

impl Screen<'_> {
    pub fn create(&self, device: &Device) -> RenderPipeline {
        let brightest = ("brightest", brightest(self.target));
        Drawing {
            label: self.label,
            module: self.module,
            vertex: "cover",
            fragment: self.entry,
            layouts: &[self.layout],
            constants: &[self.constants, &[brightest]].concat(),
            topology: wgpu::PrimitiveTopology::TriangleList,
            target: self.target,
            cache: self.cache,
        }
        .create(device)
    }
}

/// Everything that a pipeline is made from that draws what its vertex shader makes up.
pub(crate) struct Drawing<'a> {
    pub label: &'a str,
    pub module: &'a Shader,
    pub vertex: &'a str,
    pub fragment: &'a str,
    pub layouts: &'a [&'a BindGroupLayout],
    /// Of the fragment shader.
    pub constants: &'a [(&'a str, f64)],
    pub topology: wgpu::PrimitiveTopology,
    pub target: TextureFormat,
    pub cache: Option<&'a PipelineCache>,
}

impl Drawing<'_> {
    pub fn create(&self, device: &Device) -> RenderPipeline {
        let layouts: Vec<_> = self.layouts.iter().copied().map(Some).collect();
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(self.label),
            bind_group_layouts: &layouts,
            immediate_size: 0,
        });
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.label),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &self.module.raw,
                entry_point: Some(self.vertex),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState {
                topology: self.topology,
                ..Default::default()
            },
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &self.module.raw,
                entry_point: Some(self.fragment),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: self.constants,
                    ..Default::default()
                },
                targets: &[Some(self.target.into())],
            }),
            multiview_mask: None,
            cache: self.cache,
        })
    }
}

/// Writes the viewport of `target` and leaves the rest. `begins` says whether the begin time is this pass's to write:
/// it is not where a compute pass came first.
pub(crate) fn draw(
    encoder: &mut CommandEncoder,
    label: &str,
    (pipeline, group): (&RenderPipeline, &Group),
    target: &TextureSlice<'_>,
    viewport: Viewport,
    timestamps: Option<Timestamps<'_>>,
    begins: bool,
) {
    let writes = timestamps.map(|timestamps| (timestamps, [begins, true]));
    draw_part(encoder, label, (pipeline, group), target, viewport, writes);
}

/// One of several, of which the first may write the begin time and the last the end time: which of both it does.
pub(crate) fn draw_part(
    encoder: &mut CommandEncoder,
    label: &str,
    (pipeline, group): (&RenderPipeline, &Group),
    target: &TextureSlice<'_>,
    viewport: Viewport,
    writes: Option<(Timestamps<'_>, [bool; 2])>,
) {
    let mut pass = begin_part(encoder, label, target, viewport, writes);
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &group.raw, &group.offsets);
    pass.draw(0..3, 0..1);
}

/// A render pass that keeps what it does not write, over the viewport alone.
pub(crate) fn begin<'e>(
    encoder: &'e mut CommandEncoder,
    label: &str,
    target: &TextureSlice<'_>,
    viewport: Viewport,
    timestamps: Option<Timestamps<'_>>,
    begins: bool,
) -> RenderPass<'e> {
    let writes = timestamps.map(|timestamps| (timestamps, [begins, true]));
    begin_part(encoder, label, target, viewport, writes)
}

fn begin_part<'e>(
    encoder: &'e mut CommandEncoder,
    label: &str,
    target: &TextureSlice<'_>,
    viewport: Viewport,
    writes: Option<(Timestamps<'_>, [bool; 2])>,
) -> RenderPass<'e> {
    let writes = writes.filter(|(_, [begins, ends])| *begins || *ends);
    let target = target.view(TextureUsages::RENDER_ATTACHMENT);
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Load,
                store: wgpu::StoreOp::Store,
            },
        })],
        timestamp_writes: writes.map(|(t, [begins, ends])| wgpu::RenderPassTimestampWrites {
            query_set: t.set,
            beginning_of_pass_write_index: begins.then_some(t.begin),
            end_of_pass_write_index: ends.then_some(t.end),
        }),
        ..Default::default()
    });
    pass.set_viewport(
        viewport.x as f32,
        viewport.y as f32,
        viewport.width as f32,
        viewport.height as f32,
        0.0,
        1.0,
    );
    pass.set_scissor_rect(viewport.x, viewport.y, viewport.width, viewport.height);
    pass
}

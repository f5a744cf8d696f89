//! What raster effects test: 1 where a level lists a pixel.

use wgpu::{
    CommandEncoder, CompareFunction, Device, PipelineCache, RenderPipeline, StencilFaceState,
    StencilOperation, TextureFormat, TextureUsages, TextureView,
};

use super::LABEL;
use crate::gpu::{
    binding::{Group, Layout},
    shader::Shader,
    texture::Plane,
};

/// Its format.
pub(super) const STENCIL: TextureFormat = TextureFormat::Stencil8;

/// A stencil buffer of a level.
pub(super) fn create(device: &Device, size: [u32; 2]) -> TextureView {
    let usage =
        TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_SRC;
    let label = "deep-screen-space multi-resolution stencil";
    Plane::new(label, STENCIL, size, usage)
        .create(device)
        .create_view(&wgpu::TextureViewDescriptor::default())
}

/// The pipeline that writes stencils: nothing else is attached.
pub(super) fn pipeline(
    device: &Device,
    module: &Shader,
    layout: &Layout,
    cache: Option<&PipelineCache>,
) -> RenderPipeline {
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(LABEL),
        bind_group_layouts: &[Some(&layout.raw)],
        immediate_size: 0,
    });
    let face = StencilFaceState {
        compare: CompareFunction::Always,
        pass_op: StencilOperation::Replace,
        ..Default::default()
    };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(LABEL),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module.raw,
            entry_point: Some("cover"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: STENCIL,
            depth_write_enabled: None,
            depth_compare: None,
            stencil: wgpu::StencilState {
                front: face,
                back: face,
                read_mask: 0xff,
                write_mask: 0xff,
            },
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module.raw,
            entry_point: Some("stamp"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[],
        }),
        multiview_mask: None,
        cache,
    })
}

/// 1 where a level's mask is above 0, and 0 elsewhere.
pub(super) fn draw(
    encoder: &mut CommandEncoder,
    pipeline: &RenderPipeline,
    group: &Group,
    stencil: &TextureView,
) {
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(LABEL),
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: stencil,
            depth_ops: None,
            stencil_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(0),
                store: wgpu::StoreOp::Store,
            }),
        }),
        ..Default::default()
    });
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &group.raw, &group.offsets);
    pass.set_stencil_reference(1);
    pass.draw(0..3, 0..1);
}

//! Adds light to kiss3d's film, before it is tone-mapped.

use kiss3d::{
    context::Context,
    resource::{PipelineCache, multisample_state},
};
use wgpu::{BindGroup, BindGroupLayout, RenderPass, Texture};

/// The pass's pipelines, one a number of samples.
pub struct Composite {
    layout: BindGroupLayout,
    pipelines: PipelineCache,
}

impl Composite {
    pub fn new(context: &Context) -> Self {
        let layout = context.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("deep-screen-space-kiss3d composite"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Texture {
                    sample_type: wgpu::TextureSampleType::Float { filterable: false },
                    view_dimension: wgpu::TextureViewDimension::D2,
                    multisampled: false,
                },
                count: None,
            }],
        });
        let pipeline_layout = context.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let context = context.clone();
        let pipelines =
            PipelineCache::new(move |samples| pipeline(&context, &pipeline_layout, samples));
        Self { layout, pipelines }
    }

    /// Of a texture whose pixels are the film's.
    pub fn bind(&self, context: &Context, light: &Texture) -> BindGroup {
        context.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("deep-screen-space-kiss3d composite"),
            layout: &self.layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(
                    &light.create_view(&wgpu::TextureViewDescriptor::default()),
                ),
            }],
        })
    }

    pub fn draw(&self, pass: &mut RenderPass<'_>, light: &BindGroup, samples: u32) {
        pass.set_pipeline(&self.pipelines.get(samples));
        pass.set_bind_group(0, light, &[]);
        pass.draw(0..3, 0..1);
    }
}

fn pipeline(
    context: &Context,
    layout: &wgpu::PipelineLayout,
    samples: u32,
) -> wgpu::RenderPipeline {
    let module = context.create_shader_module(
        Some("deep-screen-space-kiss3d composite"),
        include_str!("composite.wgsl"),
    );
    let component = |src_factor| wgpu::BlendComponent {
        src_factor,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    context.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("deep-screen-space-kiss3d composite"),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        // The pass has the film's depth, of which this has no use.
        depth_stencil: Some(wgpu::DepthStencilState {
            format: Context::depth_format(),
            depth_write_enabled: Some(false),
            depth_compare: Some(wgpu::CompareFunction::Always),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: multisample_state(samples),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format: Context::render_format(),
                blend: Some(wgpu::BlendState {
                    color: component(wgpu::BlendFactor::One),
                    alpha: component(wgpu::BlendFactor::Zero),
                }),
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

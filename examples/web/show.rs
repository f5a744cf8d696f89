//! A picture on the page: the effect's texture, as a screen shows it.

use deep_screen_space::wgpu;
use support::gpu::Gpu;

use crate::frame::Effect;

const SHADER: &str = r"
@group(0) @binding(0) var picture: texture_2d<f32>;
// What light is multiplied by; 0 for what is no light, which is shown as it is.
override exposure: f32;

@vertex
fn cover(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4f {
  return vec4f(f32(corner & 1u) * 4.0 - 1.0, f32(corner >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn show(@builtin(position) place: vec4f) -> @location(0) vec4f {
  let value = textureLoad(picture, vec2i(place.xy), 0).rgb;
  // Bright light saturates softly; sRGB by its power of 2.2.
  let light = pow(1.0 - exp(-exposure * value), vec3f(1.0 / 2.2));
  return vec4f(select(light, value, exposure == 0.0), 1.0);
}
";

/// The pipeline for one effect and one surface, and the texture that it shows.
pub struct Show {
    pipeline: wgpu::RenderPipeline,
    group: wgpu::BindGroup,
}

impl Show {
    pub fn new(
        gpu: &Gpu,
        effect: Effect,
        picture: &wgpu::TextureView,
        surface: wgpu::TextureFormat,
    ) -> Self {
        let device = &gpu.device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("show"),
            source: wgpu::ShaderSource::Wgsl(SHADER.into()),
        });
        let exposure = match effect {
            Effect::Occlusion => 0.0,
            Effect::Light => 1.0,
        };
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("show"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("cover"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("show"),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &[("exposure", exposure)],
                    ..Default::default()
                },
                targets: &[Some(surface.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("show"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(picture),
            }],
        });
        Self { pipeline, group }
    }

    pub fn record(&self, encoder: &mut wgpu::CommandEncoder, to: &wgpu::TextureView) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("show"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: to,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.draw(0..3, 0..1);
    }
}

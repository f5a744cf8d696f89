//! Both sides' pictures in the window.

use deep_screen_space::wgpu::{self, BufferUsages, TextureFormat, TextureView};
use support::gpu::Gpu;

use crate::look::{Effect, Look};

/// What is shown of a side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shown {
    #[default]
    Picture,
    /// How far it is off the truth.
    Error,
    Truth,
}

/// As the shader has it.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct SideUniform {
    exposure: f32,
    grey: u32,
    direction: u32,
    shown: u32,
}

/// As the shader has it.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Uniform {
    area: [f32; 4],
    split: f32,
    gain: f32,
    line: f32,
    sides: [SideUniform; 2],
    padding: f32,
}

/// One side, as it is to be shown.
#[derive(Clone, Copy)]
pub struct Side<'a> {
    pub picture: &'a TextureView,
    pub look: &'a Look,
    pub shown: Shown,
}

/// How both are shown.
#[derive(Clone, Copy)]
pub struct Arrangement<'a> {
    pub first: Side<'a>,
    pub second: Option<Side<'a>>,
    pub truth: &'a TextureView,
    /// Of the window, pixels: left, top, width, height.
    pub area: [u32; 4],
    /// Share of the width that is the first's.
    pub split: f32,
    /// What values are multiplied by besides what suits an effect.
    pub exposure: f32,
    pub gain: f32,
}

/// What an effect's values are multiplied by to be shown.
pub fn exposure_of(look: &Look) -> f32 {
    match look.effect {
        Effect::AmbientOcclusion | Effect::BentNormals | Effect::SoftShadows => 1.0,
        // A sky is brighter than what rooms reflect, and little of that is reflected at a surface.
        Effect::DirectionalOcclusion => 0.5,
        Effect::IndirectSpecular => 1.0 / look.f0.into_iter().fold(0.04, f32::max),
        Effect::IndirectDiffuse | Effect::SubsurfaceScattering => 2.0,
    }
}

/// The pipeline.
pub struct Display {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

impl Display {
    /// Into textures of a format that does not encode by itself.
    pub fn new(gpu: &Gpu, format: TextureFormat) -> Self {
        let device = &gpu.device;
        let texture = |binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: false },
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            count: None,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("display"),
            entries: &[
                wgpu::BindGroupLayoutEntry {
                    binding: 0,
                    visibility: wgpu::ShaderStages::FRAGMENT,
                    ty: wgpu::BindingType::Buffer {
                        ty: wgpu::BufferBindingType::Storage { read_only: true },
                        has_dynamic_offset: false,
                        min_binding_size: None,
                    },
                    count: None,
                },
                texture(1),
                texture(2),
                texture(3),
            ],
        });
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("display"),
            source: wgpu::ShaderSource::Wgsl(include_str!("display.wgsl").into()),
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("display"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("display"),
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vertex"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fragment"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        Self { pipeline, layout }
    }

    /// Draws both sides into their area of a texture, and black elsewhere.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        arrangement: &Arrangement<'_>,
        target: &TextureView,
    ) {
        let Arrangement {
            first,
            second,
            truth,
            area,
            ..
        } = *arrangement;
        let side = |side: Side<'_>| SideUniform {
            exposure: arrangement.exposure * exposure_of(side.look),
            grey: u32::from(side.look.effect.is_grey()),
            direction: u32::from(side.look.effect == Effect::BentNormals),
            shown: side.shown as u32,
        };
        let [left, top, width, height] = area.map(|n| n as f32);
        let uniform = Uniform {
            area: [left, top, width, height],
            split: match second {
                Some(_) => (arrangement.split * width).round(),
                None => 2.0 * width + 8.0,
            },
            gain: arrangement.gain,
            line: 1.0,
            sides: [side(first), side(second.unwrap_or(first))],
            padding: 0.0,
        };
        let uniform = gpu.buffer(&[uniform], BufferUsages::STORAGE);
        let textures = [first.picture, second.unwrap_or(first).picture, truth];
        let mut entries = vec![wgpu::BindGroupEntry {
            binding: 0,
            resource: uniform.as_entire_binding(),
        }];
        let views = textures.map(wgpu::BindingResource::TextureView);
        entries.extend(
            (1..)
                .zip(views)
                .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }),
        );
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("display"),
            layout: &self.layout,
            entries: &entries,
        });
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("display"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        pass.set_viewport(left, top, width, height, 0.0, 1.0);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
    }
}

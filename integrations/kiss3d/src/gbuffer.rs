//! Depth, normals and albedo of what kiss3d draws. Its own prepass keeps its depth to itself, and kiss3d's film may be
//! multisampled: this has one sample per pixel in any case.

use std::{
    collections::{HashMap, HashSet},
    sync::Arc,
};

use deep_screen_space::GBuffer;
use kiss3d::{
    context::Context,
    glamx::Mat4,
    resource::{Texture, vertex_index::VERTEX_INDEX_FORMAT},
};
use wgpu::{
    BindGroup, BindGroupLayout, Buffer, BufferUsages, CommandEncoder, RenderPipeline,
    TextureFormat, TextureUsages, VertexFormat,
};

use crate::geometry::{Adopted, Drawn, Instance, Triangulation};

const NORMAL: TextureFormat = TextureFormat::Rgba16Float;
const ALBEDO: TextureFormat = TextureFormat::Rgba8Unorm;

/// The pass.
pub struct GBufferPass {
    /// With backs culled, and without.
    pipelines: [RenderPipeline; 2],
    view: Buffer,
    view_group: BindGroup,
    map_layout: BindGroupLayout,
    /// Of each texture of the last frame, which is kept so that its address stays its own.
    maps: HashMap<*const Texture, (Arc<Texture>, BindGroup)>,
}

/// Its textures.
pub struct GBufferTextures {
    depth: wgpu::Texture,
    normal: wgpu::Texture,
    albedo: wgpu::Texture,
}

/// A texture that passes write and read.
pub fn texture(
    context: &Context,
    format: TextureFormat,
    [width, height]: [u32; 2],
) -> wgpu::Texture {
    context.create_texture(&wgpu::TextureDescriptor {
        label: Some("deep-screen-space-kiss3d"),
        size: wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: TextureUsages::RENDER_ATTACHMENT
            | TextureUsages::TEXTURE_BINDING
            | TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

impl GBufferTextures {
    pub fn new(context: &Context, size: [u32; 2]) -> Self {
        Self {
            depth: texture(context, Context::depth_format(), size),
            normal: texture(context, NORMAL, size),
            albedo: texture(context, ALBEDO, size),
        }
    }

    /// As the library takes it.
    pub fn gbuffer(&self) -> GBuffer<'_> {
        GBuffer {
            albedo: Some((&self.albedo).into()),
            ..GBuffer::new(&self.depth, &self.normal)
        }
    }

    /// Bytes of GPU memory.
    pub fn memory_bytes(&self) -> u64 {
        [(&self.depth, 4), (&self.normal, 8), (&self.albedo, 4)]
            .into_iter()
            .map(|(t, bytes)| u64::from(t.width()) * u64::from(t.height()) * bytes)
            .sum()
    }
}

impl GBufferPass {
    pub fn new(context: &Context) -> Self {
        let entry = |binding, visibility, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility,
            ty,
            count: None,
        };
        let layout = |entries: &[wgpu::BindGroupLayoutEntry]| {
            context.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("deep-screen-space-kiss3d gbuffer"),
                entries,
            })
        };
        let view_layout = layout(&[entry(
            0,
            wgpu::ShaderStages::VERTEX,
            wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
        )]);
        let map_layout = layout(&[
            entry(
                0,
                wgpu::ShaderStages::FRAGMENT,
                wgpu::BindingType::Texture {
                    sample_type: wgpu::TextureSampleType::Float { filterable: true },
                    view_dimension: wgpu::TextureViewDimension::D2,
                    multisampled: false,
                },
            ),
            entry(
                1,
                wgpu::ShaderStages::FRAGMENT,
                wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
            ),
        ]);
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let view = context.create_buffer_simple(Some("deep-screen-space-kiss3d view"), 144, usage);
        let view_group = context.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &view_layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: view.as_entire_binding(),
            }],
        });
        let pipeline_layout = context.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&view_layout), Some(&map_layout)],
            immediate_size: 0,
        });
        Self {
            pipelines: [Some(wgpu::Face::Back), None]
                .map(|cull_mode| pipeline(context, &pipeline_layout, cull_mode)),
            view,
            view_group,
            map_layout,
            maps: HashMap::new(),
        }
    }

    /// Draws what is opaque.
    pub fn record(
        &mut self,
        context: &Context,
        encoder: &mut CommandEncoder,
        [view, projection]: [Mat4; 2],
        (triangulation, adopted, drawn): (&Triangulation, &[Adopted], &[Drawn]),
        targets: &GBufferTextures,
    ) {
        let mut uniform = [view, projection].map(|m| m.to_cols_array()).concat();
        uniform.extend(view.inverse().w_axis.to_array());
        context.write_buffer(&self.view, 0, bytemuck::cast_slice(&uniform));
        let met: HashSet<_> = drawn.iter().map(|drawn| Arc::as_ptr(&drawn.map)).collect();
        self.maps.retain(|map, _| met.contains(map));
        for drawn in drawn {
            let map = &drawn.map;
            self.maps.entry(Arc::as_ptr(map)).or_insert_with(|| {
                let group = context.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: None,
                    layout: &self.map_layout,
                    entries: &[
                        wgpu::BindGroupEntry {
                            binding: 0,
                            resource: wgpu::BindingResource::TextureView(&map.view),
                        },
                        wgpu::BindGroupEntry {
                            binding: 1,
                            resource: wgpu::BindingResource::Sampler(&map.sampler),
                        },
                    ],
                });
                (Arc::clone(map), group)
            });
        }

        let view_of = |t: &wgpu::Texture| t.create_view(&wgpu::TextureViewDescriptor::default());
        let colors = [&targets.normal, &targets.albedo].map(view_of);
        let depth = view_of(&targets.depth);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("deep-screen-space-kiss3d gbuffer"),
            color_attachments: &colors.each_ref().map(|view| {
                Some(wgpu::RenderPassColorAttachment {
                    view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })
            }),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(1.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        let Some(instances) = triangulation.instances() else {
            return;
        };
        pass.set_bind_group(0, &self.view_group, &[]);
        for drawn in drawn {
            let mut mesh = adopted[drawn.object].mesh.borrow_mut();
            let count = mesh.num_indices();
            // Its own buffers: what changed on the CPU is written to them now, as it would be when kiss3d draws.
            let Some((positions, faces, normals, uvs)) = mesh.ensure_on_gpu() else {
                continue;
            };
            let Some((_, map)) = self.maps.get(&Arc::as_ptr(&drawn.map)) else {
                continue;
            };
            pass.set_pipeline(&self.pipelines[usize::from(!drawn.culls_backs)]);
            pass.set_bind_group(1, map, &[]);
            let buffers = [positions, normals, uvs, instances];
            for (slot, buffer) in (0..).zip(buffers) {
                pass.set_vertex_buffer(slot, buffer.slice(..));
            }
            pass.set_index_buffer(faces.slice(..), VERTEX_INDEX_FORMAT);
            pass.draw_indexed(0..count, 0, triangulation.range(drawn.object));
        }
    }
}

fn pipeline(
    context: &Context,
    layout: &wgpu::PipelineLayout,
    cull_mode: Option<wgpu::Face>,
) -> RenderPipeline {
    let module = context.create_shader_module(
        Some("deep-screen-space-kiss3d gbuffer"),
        include_str!("gbuffer.wgsl"),
    );
    let corner = wgpu::VertexStepMode::Vertex;
    let streams = [
        (
            corner,
            12,
            wgpu::vertex_attr_array![0 => Float32x3].to_vec(),
        ),
        (
            corner,
            12,
            wgpu::vertex_attr_array![1 => Float32x3].to_vec(),
        ),
        (corner, 8, wgpu::vertex_attr_array![2 => Float32x2].to_vec()),
        (
            wgpu::VertexStepMode::Instance,
            size_of::<Instance>() as u64,
            (0..5)
                .map(|column| wgpu::VertexAttribute {
                    format: VertexFormat::Float32x4,
                    offset: u64::from(column) * 16,
                    shader_location: 3 + column,
                })
                .collect(),
        ),
    ];
    let buffers = streams
        .each_ref()
        .map(|(step_mode, array_stride, attributes)| {
            Some(wgpu::VertexBufferLayout {
                array_stride: *array_stride,
                step_mode: *step_mode,
                attributes,
            })
        });
    context.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("deep-screen-space-kiss3d gbuffer"),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &buffers,
        },
        primitive: wgpu::PrimitiveState {
            cull_mode,
            ..wgpu::PrimitiveState::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: Context::depth_format(),
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Less),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(NORMAL.into()), Some(ALBEDO.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

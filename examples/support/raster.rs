//! A small G-buffer, as an engine would have one: depth, normals, albedo.

use deep_screen_space::{
    Camera, GBuffer, Viewport,
    glam::{DMat4, Mat4},
    scenes::Scene,
    wgpu,
};

use super::{gpu::Gpu, scene::SceneBuffers};

const SHADER: &str = r"
// The eye is two floats per coordinate, high + low.
struct View { clip_from_relative: mat4x4f, eye_high: vec4f, eye_low: vec4f }
struct Material { albedo: vec3f, emission: vec3f }
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> materials: array<Material>;

struct Vertex {
  @builtin(position) clip: vec4f,
  // From the eye.
  @location(0) relative: vec3f,
  @location(1) normal: vec3f,
  @location(2) @interpolate(flat) material: u32,
}

struct Pixel {
  @location(0) normal: vec4f,
  @location(1) albedo: vec4f,
}

// A draw's instance is its material.
@vertex
fn vertex(
  @location(0) position: vec3f,
  @location(1) normal: vec3f,
  @builtin(instance_index) material: u32,
) -> Vertex {
  let relative = (position - view.eye_high.xyz) - view.eye_low.xyz;
  return Vertex(view.clip_from_relative * vec4f(relative, 1.0), relative, normal, material);
}

// The interpolated normal, on the side of the face that is seen.
@fragment
fn fragment(in: Vertex) -> Pixel {
  var face = normalize(cross(dpdx(in.relative), dpdy(in.relative)));
  face = select(face, -face, dot(face, in.relative) > 0.0);
  let n = normalize(in.normal);
  let side = select(n, -n, dot(n, face) < 0.0);
  return Pixel(vec4f(side, 0.0), vec4f(materials[in.material].albedo, 1.0));
}
";

/// A perspective projection with reversed depth and no far plane: what keeps the most precision.
pub fn perspective(vertical_fov_degrees: f64, aspect: f64, near: f64) -> DMat4 {
    let f = 1.0 / (vertical_fov_degrees.to_radians() / 2.0).tan();
    DMat4::from_cols_array(&[
        f / aspect,
        0.0,
        0.0,
        0.0, //
        0.0,
        f,
        0.0,
        0.0, //
        0.0,
        0.0,
        0.0,
        -1.0, //
        0.0,
        0.0,
        near,
        0.0,
    ])
}

/// What a vertex shader needs of a camera: the matrix from its eye space to clip space, and its eye in two floats a
/// coordinate. Rounded to one, the eye would be off by what a vertex far from the origin is off by, and differently.
pub fn view_uniform(camera: &Camera) -> Vec<f32> {
    let clip: Mat4 = (camera.projection() * DMat4::from_mat3(camera.rotation())).as_mat4();
    let high = camera.eye().as_vec3();
    let low = (camera.eye() - high.as_dvec3()).as_vec3();
    let mut uniform = clip.to_cols_array().to_vec();
    uniform.extend(high.extend(0.0).to_array());
    uniform.extend(low.extend(0.0).to_array());
    uniform
}

/// Linear and exact: what is reflected is to be compared with references.
const ALBEDO: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// The textures.
pub struct Raster {
    pub depth: wgpu::TextureView,
    pub normal: wgpu::TextureView,
    pub albedo: wgpu::TextureView,
}

/// A scene's first view, at a size.
pub fn camera_of(scene: &Scene, [width, height]: [u32; 2]) -> Camera {
    let view = &scene.views[0];
    let aspect = f64::from(width) / f64::from(height);
    Camera::look_at(
        view.eye.into(),
        view.target.into(),
        view.up.into(),
        perspective(view.vertical_fov_degrees, aspect, view.near),
        Viewport::full(width, height),
    )
    .expect("a scene's own view")
}

impl Raster {
    /// As the passes take it.
    pub fn gbuffer(&self) -> GBuffer<'_> {
        GBuffer {
            albedo: Some(self.albedo.texture().into()),
            ..GBuffer::new(self.depth.texture(), self.normal.texture())
        }
    }

    /// Draws a scene for a camera that fills its texture, with reversed depth.
    pub fn draw(gpu: &Gpu, scene: &SceneBuffers, camera: &Camera) -> Self {
        let device = &gpu.device;
        let viewport = camera.viewport();
        let (width, height) = (viewport.width, viewport.height);
        let depth = gpu.target(wgpu::TextureFormat::Depth32Float, width, height);
        let normal = gpu.target(wgpu::TextureFormat::Rgba32Float, width, height);
        let albedo = gpu.target(ALBEDO, width, height);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[
                entry(
                    0,
                    wgpu::ShaderStages::VERTEX,
                    wgpu::BufferBindingType::Uniform,
                ),
                entry(
                    1,
                    wgpu::ShaderStages::FRAGMENT,
                    wgpu::BufferBindingType::Storage { read_only: true },
                ),
            ],
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("gbuffer"),
            source: wgpu::ShaderSource::Wgsl(SHADER.into()),
        });
        let attribute = |shader_location| wgpu::VertexAttribute {
            format: wgpu::VertexFormat::Float32x3,
            offset: 0,
            shader_location,
        };
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("gbuffer"),
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vertex"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[
                    Some(wgpu::VertexBufferLayout {
                        array_stride: 12,
                        step_mode: wgpu::VertexStepMode::Vertex,
                        attributes: &[attribute(0)],
                    }),
                    Some(wgpu::VertexBufferLayout {
                        array_stride: 12,
                        step_mode: wgpu::VertexStepMode::Vertex,
                        attributes: &[attribute(1)],
                    }),
                ],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: wgpu::TextureFormat::Depth32Float,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fragment"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[
                    Some(wgpu::TextureFormat::Rgba32Float.into()),
                    Some(ALBEDO.into()),
                ],
            }),
            multiview_mask: None,
            cache: None,
        });

        let uniform = gpu.buffer(&view_uniform(camera), wgpu::BufferUsages::UNIFORM);
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: uniform.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: scene.materials.as_entire_binding(),
                },
            ],
        });
        let mut encoder = gpu.encoder();
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("gbuffer"),
            color_attachments: &[&normal, &albedo].map(|view| {
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
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        for run in &scene.runs {
            pass.set_vertex_buffer(0, run.positions.slice(..));
            pass.set_vertex_buffer(1, run.normals.slice(..));
            pass.set_index_buffer(run.indices.slice(..), wgpu::IndexFormat::Uint32);
            for part in &run.parts {
                let end = part.first_index + part.index_count;
                pass.draw_indexed(part.first_index..end, 0, part.material..part.material + 1);
            }
        }
        drop(pass);
        gpu.finish(encoder);
        Self {
            depth,
            normal,
            albedo,
        }
    }
}

fn entry(
    binding: u32,
    visibility: wgpu::ShaderStages,
    ty: wgpu::BufferBindingType,
) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    }
}

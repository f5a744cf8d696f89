//! A small G-buffer, as an engine would have one: depth, normals, albedo.

use deep_screen_space::{
    AlphaWrap, Camera, GBuffer, Material, Viewport,
    glam::{DMat4, Mat4},
    scenes::{HoleTest, Scene},
    wgpu,
};

use super::{gpu::Gpu, scene::SceneBuffers};

const SHADER: &str = r"
// The eye is two floats per coordinate, high + low.
struct View { clip_from_relative: mat4x4f, eye_high: vec4f, eye_low: vec4f }
struct Material { albedo: vec3f, emission: vec3f }
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> materials: array<Material>;
// Where triangles have holes: for each material the layer of its picture, the bits of the least alpha that is there, 0 where it
// has none, and what is beyond the picture.
@group(1) @binding(0) var<storage, read> tests: array<vec4u>;
@group(1) @binding(1) var maps: texture_2d_array<f32>;

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

fn relative_to_eye(position: vec3f) -> vec3f {
  return (position - view.eye_high.xyz) - view.eye_low.xyz;
}

// A draw's instance is its material.
@vertex
fn vertex(
  @location(0) position: vec3f,
  @location(1) normal: vec3f,
  @builtin(instance_index) material: u32,
) -> Vertex {
  let relative = relative_to_eye(position);
  return Vertex(view.clip_from_relative * vec4f(relative, 1.0), relative, normal, material);
}

struct CutVertex {
  @builtin(position) clip: vec4f,
  @location(0) relative: vec3f,
  @location(1) normal: vec3f,
  @location(2) @interpolate(flat) material: u32,
  @location(3) uv: vec2f,
}

@vertex
fn cut_vertex(
  @location(0) position: vec3f,
  @location(1) normal: vec3f,
  @location(2) uv: vec2f,
  @builtin(instance_index) material: u32,
) -> CutVertex {
  let relative = relative_to_eye(position);
  return CutVertex(view.clip_from_relative * vec4f(relative, 1.0), relative, normal, material, uv);
}

fn texel_within(i: i32, size: i32, wrap: u32) -> i32 {
  let turned = ((i % (2 * size)) + 2 * size) % (2 * size);
  let mirrored = min(turned, 2 * size - 1 - turned);
  return select(select(turned % size, clamp(i, 0, size - 1), wrap == 1u), mirrored, wrap == 2u);
}

fn alpha_at(uv: vec2f, test: vec4u) -> f32 {
  let size = vec2i(textureDimensions(maps));
  let place = uv * vec2f(size) - 0.5;
  let first = vec2i(floor(place));
  var alpha = 0.0;
  for (var k = 0; k < 4; k++) {
    let texel = first + vec2i(k & 1, k >> 1u);
    let x = texel_within(texel.x, size.x, test.z);
    let y = texel_within(texel.y, size.y, test.w);
    let weight = max(vec2f(0.0), 1.0 - abs(place - vec2f(texel)));
    alpha += weight.x * weight.y * textureLoad(maps, vec2i(x, y), test.x, 0).x;
  }
  return alpha;
}

@fragment
fn cut_fragment(in: CutVertex) -> Pixel {
  let pixel = shown(in.relative, in.normal, in.material);
  let test = tests[in.material];
  if test.y != 0u && alpha_at(in.uv, test) < bitcast<f32>(test.y) {
    discard;
  }
  return pixel;
}

// The interpolated normal, on the side of the face that is seen.
fn shown(relative: vec3f, normal: vec3f, material: u32) -> Pixel {
  var face = normalize(cross(dpdx(relative), dpdy(relative)));
  face = select(face, -face, dot(face, relative) > 0.0);
  let n = normalize(normal);
  let side = select(n, -n, dot(n, face) < 0.0);
  return Pixel(vec4f(side, 0.0), vec4f(materials[material].albedo, 1.0));
}

@fragment
fn fragment(in: Vertex) -> Pixel {
  return shown(in.relative, in.normal, in.material);
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
        let viewport = camera.viewport();
        let raster = Self::new(gpu, [viewport.width, viewport.height]);
        let mut encoder = gpu.encoder();
        Rasterizer::new(gpu, scene).record(gpu, &mut encoder, (scene, camera), &raster);
        gpu.finish(encoder);
        raster
    }

    /// Empty textures.
    pub fn new(gpu: &Gpu, [width, height]: [u32; 2]) -> Self {
        Self {
            depth: gpu.target(wgpu::TextureFormat::Depth32Float, width, height),
            normal: gpu.target(wgpu::TextureFormat::Rgba32Float, width, height),
            albedo: gpu.target(ALBEDO, width, height),
        }
    }
}

/// What draws a scene, as often as one likes.
pub struct Rasterizer {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::RenderPipeline,
    cut: Option<Cut>,
}

impl Rasterizer {
    pub fn new(gpu: &Gpu, scene: &SceneBuffers) -> Self {
        let device = &gpu.device;
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
        let cut = scene
            .holes
            .as_ref()
            .map(|holes| Cut::new(gpu, scene, holes));
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &match &cut {
                Some(cut) => vec![Some(&layout), Some(&cut.layout)],
                None => vec![Some(&layout)],
            },
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
        let attributes = [
            [attribute(0)],
            [attribute(1)],
            [wgpu::VertexAttribute {
                format: wgpu::VertexFormat::Float32x2,
                ..attribute(2)
            }],
        ];
        let vertex_buffers: Vec<_> = [12, 12, 8]
            .into_iter()
            .zip(&attributes)
            .take(if cut.is_some() { 3 } else { 2 })
            .map(|(array_stride, attributes)| {
                Some(wgpu::VertexBufferLayout {
                    array_stride,
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes,
                })
            })
            .collect();
        let [vertex, fragment] = match cut {
            Some(_) => ["cut_vertex", "cut_fragment"],
            None => ["vertex", "fragment"],
        };
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("gbuffer"),
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(vertex),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &vertex_buffers,
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
                entry_point: Some(fragment),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[
                    Some(wgpu::TextureFormat::Rgba32Float.into()),
                    Some(ALBEDO.into()),
                ],
            }),
            multiview_mask: None,
            cache: None,
        });
        Self {
            layout,
            pipeline,
            cut,
        }
    }

    /// Draws the scene that it was made for, for a camera that fills the textures, with reversed depth.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        (scene, camera): (&SceneBuffers, &Camera),
        raster: &Raster,
    ) {
        let uniform = gpu.buffer(&view_uniform(camera), wgpu::BufferUsages::UNIFORM);
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.layout,
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
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("gbuffer"),
            color_attachments: &[&raster.normal, &raster.albedo].map(|view| {
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
                view: &raster.depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        if let Some(cut) = &self.cut {
            pass.set_bind_group(1, &cut.group, &[]);
        }
        for run in &scene.runs {
            pass.set_vertex_buffer(0, run.positions.slice(..));
            pass.set_vertex_buffer(1, run.normals.slice(..));
            if let Some(tex_coords) = &run.tex_coords {
                pass.set_vertex_buffer(2, tex_coords.slice(..));
            }
            pass.set_index_buffer(run.indices.slice(..), wgpu::IndexFormat::Uint32);
            for part in &run.parts {
                let end = part.first_index + part.index_count;
                pass.draw_indexed(part.first_index..end, 0, part.material..part.material + 1);
            }
        }
    }
}

/// What tells where triangles have holes.
struct Cut {
    layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
}

impl Cut {
    fn new(
        gpu: &Gpu,
        scene: &SceneBuffers,
        (maps, tests): &(wgpu::Texture, Vec<Option<HoleTest>>),
    ) -> Self {
        let wrap = |wrap| match wrap {
            AlphaWrap::Repeat => 0,
            AlphaWrap::ClampToEdge => 1,
            AlphaWrap::MirrorRepeat => 2,
        };
        // One for each material at least.
        let mut words: Vec<[u32; 4]> = tests
            .iter()
            .map(|test| {
                test.map_or([0; 4], |test| {
                    let [u, v] = test.wrap.map(wrap);
                    [test.layer, test.threshold.to_bits(), u, v]
                })
            })
            .collect();
        let materials = scene.materials.size() as usize / size_of::<Material>();
        words.resize(words.len().max(materials), [0; 4]);
        let tests = gpu.buffer(&words, wgpu::BufferUsages::STORAGE);
        let stage = wgpu::ShaderStages::FRAGMENT;
        let kind = wgpu::BufferBindingType::Storage { read_only: true };
        let layout = gpu
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: None,
                entries: &[
                    entry(0, stage, kind),
                    wgpu::BindGroupLayoutEntry {
                        binding: 1,
                        visibility: stage,
                        ty: wgpu::BindingType::Texture {
                            sample_type: wgpu::TextureSampleType::Float { filterable: false },
                            view_dimension: wgpu::TextureViewDimension::D2Array,
                            multisampled: false,
                        },
                        count: None,
                    },
                ],
            });
        let view = maps.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: tests.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::TextureView(&view),
                },
            ],
        });
        Self { layout, group }
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

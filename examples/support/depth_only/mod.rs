//! What a depth buffer alone can do, for comparison: horizon-based ambient occlusion and marched indirect light, with
//! one cross-bilateral filter after either. A perspective camera that fills its textures; everything is at full
//! resolution.

// Each user needs a part of it.
#![allow(dead_code)]

use bytemuck::{Pod, Zeroable};
use deep_screen_space::{
    Camera, Viewport,
    glam::{DMat4, DVec3},
    wgpu::{self, BindingType, ShaderStages, TextureFormat, TextureView, util::DeviceExt},
};

/// Work and reach of the ambient occlusion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AmbientOcclusionSettings {
    /// Occluders farther than this are ignored, world units; may be infinite.
    pub radius: f32,
    /// Slices about the view ray of each pixel.
    pub slices: u32,
    /// Taps on each side of a slice, at most.
    pub taps: u32,
    /// How deep surfaces reach behind what is seen of them, world units. Infinite: whatever is lower than a horizon is
    /// hidden, as in GTAO.
    pub thickness: f32,
    /// Half width of the filter, pixels; 0 filters nothing.
    pub filter_radius: u32,
}

/// Work and reach of the indirect light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IndirectSettings {
    /// What is farther than this brings no light, world units; may be infinite.
    pub radius: f32,
    /// Rays per pixel.
    pub directions: u32,
    /// Steps along each, at most.
    pub steps: u32,
    /// How deep surfaces reach behind what is seen of them, world units.
    pub thickness: f32,
    /// Half width of the filter, pixels; 0 filters nothing.
    pub filter_radius: u32,
}

/// What both methods know of the frame: depth as the camera's projection made it and world-space normals.
#[derive(Clone, Copy)]
pub struct Frame<'a> {
    pub camera: &'a Camera,
    pub depth: &'a TextureView,
    pub normal: &'a TextureView,
}

/// `Params` of common.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    clip_from_eye: [[f32; 4]; 4],
    corner: [f32; 3],
    depth_scale: f32,
    right: [f32; 3],
    depth_offset: f32,
    down: [f32; 3],
    far_depth: f32,
    size: [u32; 2],
    count: u32,
    steps: u32,
    radius: f32,
    thickness: f32,
    filter_radius: i32,
    padding: u32,
}

impl Params {
    fn new(camera: &Camera) -> Self {
        assert!(
            camera.is_perspective(),
            "the depth-only methods take a perspective camera"
        );
        let Viewport {
            x,
            y,
            width,
            height,
        } = camera.viewport();
        assert_eq!([x, y], [0, 0], "the camera fills its textures");
        let projection = camera.projection();
        let clip_from_eye = projection * DMat4::from_mat3(camera.rotation());
        // value = (a z + b) / (c z) and w = c z.
        let (a, b) = (projection.z_axis.z, projection.w_axis.z);
        let c = projection.z_axis.w;
        // Any depth but the sky's names the ray; far from both ends it is well conditioned.
        let at = |x: f64, y: f64| {
            let p = camera
                .unproject(x, y, 0.5)
                .expect("half of the depth range is not the sky");
            p / (clip_from_eye * p.extend(1.0)).w
        };
        let (width_f, height_f) = (f64::from(width), f64::from(height));
        let corner = at(0.0, 0.0);
        let narrow = |v: DVec3| -> [f32; 3] { v.as_vec3().to_array() };
        Self {
            clip_from_eye: clip_from_eye.as_mat4().to_cols_array_2d(),
            corner: narrow(corner),
            depth_scale: b as f32,
            right: narrow((at(width_f, 0.0) - corner) / width_f),
            depth_offset: (a / c) as f32,
            down: narrow((at(0.0, height_f) - corner) / height_f),
            far_depth: camera.background_depth(),
            size: [width, height],
            count: 0,
            steps: 0,
            radius: 0.0,
            thickness: 0.0,
            filter_radius: 0,
            padding: 0,
        }
    }
}

/// Infinity never goes to a shader: its square must not overflow either.
fn finite(radius: f32) -> f32 {
    radius.min(1e18)
}

/// A compute pipeline over the uniform, some sampled textures and one that it writes, in the order of its bindings.
struct Stage {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
}

impl Stage {
    fn new(
        device: &wgpu::Device,
        entry: &str,
        source: &str,
        reads: u32,
        writes: TextureFormat,
    ) -> Self {
        let source = format!("{}{source}", include_str!("common.wgsl"));
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(entry),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let binding = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: ShaderStages::COMPUTE,
            ty,
            count: None,
        };
        let uniform = BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let sampled = BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: false },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let written = BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format: writes,
            view_dimension: wgpu::TextureViewDimension::D2,
        };
        let mut entries = vec![binding(0, uniform)];
        entries.extend((1..=reads).map(|i| binding(i, sampled)));
        entries.push(binding(reads + 1, written));
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(entry),
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(entry),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        Self { layout, pipeline }
    }

    /// Runs over all pixels. `textures` are those read and, last, the one written.
    fn run(
        &self,
        device: &wgpu::Device,
        pass: &mut wgpu::ComputePass<'_>,
        params: &wgpu::Buffer,
        textures: &[&TextureView],
    ) {
        let mut entries = vec![wgpu::BindGroupEntry {
            binding: 0,
            resource: params.as_entire_binding(),
        }];
        entries.extend(
            textures
                .iter()
                .zip(1..)
                .map(|(view, binding)| wgpu::BindGroupEntry {
                    binding,
                    resource: wgpu::BindingResource::TextureView(view),
                }),
        );
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.layout,
            entries: &entries,
        });
        let size = textures[textures.len() - 1].texture();
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(size.width().div_ceil(8), size.height().div_ceil(8), 1);
    }
}

/// The filter's two passes and what is between them.
struct Denoiser {
    rows: Stage,
    columns: Stage,
    noisy: TextureView,
    between: TextureView,
}

impl Denoiser {
    fn new(device: &wgpu::Device, size: [u32; 2], format: TextureFormat, name: &str) -> Self {
        let source = include_str!("denoise.wgsl").replace("RESULT", name);
        Self {
            rows: Stage::new(device, "rows", &source, 3, format),
            columns: Stage::new(device, "columns", &source, 3, format),
            noisy: texture(device, size, format),
            between: texture(device, size, format),
        }
    }

    fn run(
        &self,
        device: &wgpu::Device,
        pass: &mut wgpu::ComputePass<'_>,
        params: &wgpu::Buffer,
        [depths, normals]: [&TextureView; 2],
        target: &TextureView,
    ) {
        let between = &self.between;
        let textures = [depths, normals, &self.noisy, between];
        self.rows.run(device, pass, params, &textures);
        let textures = [depths, normals, between, target];
        self.columns.run(device, pass, params, &textures);
    }
}

/// The pipelines of both methods and the textures between their passes.
pub struct DepthOnly {
    size: [u32; 2],
    depths: TextureView,
    linearize: Stage,
    gtao: Stage,
    ssgi: Stage,
    modulate: Stage,
    gray: Denoiser,
    color: Denoiser,
}

impl DepthOnly {
    /// Format of the target of [`record_ambient_occlusion`](Self::record_ambient_occlusion).
    pub const GRAY: TextureFormat = TextureFormat::R32Float;
    /// Format of the target of [`record_indirect`](Self::record_indirect) and of what it reads of light and albedo.
    pub const COLOR: TextureFormat = TextureFormat::Rgba32Float;

    /// For images of one size.
    pub fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let (gray, color) = (Self::GRAY, Self::COLOR);
        let stage = |entry, source, reads, writes| Stage::new(device, entry, source, reads, writes);
        Self {
            size,
            depths: texture(device, size, gray),
            linearize: stage("linearize", include_str!("linearize.wgsl"), 1, gray),
            gtao: stage("gtao", include_str!("gtao.wgsl"), 2, gray),
            ssgi: stage("ssgi", include_str!("ssgi.wgsl"), 3, color),
            modulate: stage("modulate", include_str!("modulate.wgsl"), 2, color),
            gray: Denoiser::new(device, size, gray, "r32float"),
            color: Denoiser::new(device, size, color, "rgba32float"),
        }
    }

    /// A texture that either method can write to, and that can be read back.
    pub fn create_target(&self, device: &wgpu::Device, format: TextureFormat) -> TextureView {
        texture(device, self.size, format)
    }

    /// Visibility, 1 = open, of every pixel into `target`, a storage texture of [`Self::GRAY`]; the sky is open.
    pub fn record_ambient_occlusion(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        frame: &Frame<'_>,
        settings: &AmbientOcclusionSettings,
        target: &TextureView,
    ) {
        let params = self.params(device, frame, |params| {
            params.radius = finite(settings.radius);
            params.count = settings.slices;
            params.steps = settings.taps;
            params.thickness = finite(settings.thickness);
            params.filter_radius = settings.filter_radius as i32;
        });
        let pass = &mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        let inputs = [&self.depths, frame.normal];
        let linearized = [frame.depth, &self.depths];
        self.linearize.run(device, pass, &params, &linearized);
        let filter = settings.filter_radius > 0;
        let noisy = if filter { &self.gray.noisy } else { target };
        let textures = [&self.depths, frame.normal, noisy];
        self.gtao.run(device, pass, &params, &textures);
        if filter {
            self.gray.run(device, pass, &params, inputs, target);
        }
    }

    /// Radiance that one bounce of `lit` adds at every pixel, into `target`, a storage texture of [`Self::COLOR`]; the
    /// sky's is 0. `lit` is the radiance that leaves each pixel's surface, `albedo` what it sends back of what it gets.
    pub fn record_indirect(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        frame: &Frame<'_>,
        [lit, albedo]: [&TextureView; 2],
        settings: &IndirectSettings,
        target: &TextureView,
    ) {
        let params = self.params(device, frame, |params| {
            params.radius = finite(settings.radius);
            params.count = settings.directions;
            params.steps = settings.steps;
            params.thickness = settings.thickness;
            params.filter_radius = settings.filter_radius as i32;
        });
        let pass = &mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        let inputs = [&self.depths, frame.normal];
        let linearized = [frame.depth, &self.depths];
        self.linearize.run(device, pass, &params, &linearized);
        let incident = &self.color.noisy;
        let textures = [&self.depths, frame.normal, lit, incident];
        self.ssgi.run(device, pass, &params, &textures);
        if settings.filter_radius > 0 {
            self.color.run(device, pass, &params, inputs, incident);
        }
        let textures = [incident, albedo, target];
        self.modulate.run(device, pass, &params, &textures);
    }

    fn params(
        &self,
        device: &wgpu::Device,
        frame: &Frame<'_>,
        set: impl FnOnce(&mut Params),
    ) -> wgpu::Buffer {
        let mut params = Params::new(frame.camera);
        assert_eq!(params.size, self.size, "made for images of one size");
        set(&mut params);
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("depth only"),
            contents: bytemuck::bytes_of(&params),
            usage: wgpu::BufferUsages::UNIFORM,
        })
    }
}

fn texture(device: &wgpu::Device, [width, height]: [u32; 2], format: TextureFormat) -> TextureView {
    device
        .create_texture(&wgpu::TextureDescriptor {
            label: Some("depth only"),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::STORAGE_BINDING
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
        .create_view(&wgpu::TextureViewDescriptor::default())
}

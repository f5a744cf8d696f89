//! A scene, a camera and the G-buffer that it sees, ray-cast; and the passes wired for ambient occlusion.

use crate::testing::pipelines;
use deep_screen_space::{
    AmbientOcclusion, Camera, CloudCapacity, ClusterInput, GBuffer, Geometry, NormalEncoding,
    NormalSpace, Reconstructor, ReconstructorInput, ReconstructorSettings, ShellSplatter,
    SplatInput, SplatSettings, SurfelCounts, Surfelizer, SurfelizerInput, SurfelizerSettings,
    Viewport,
    glam::DVec3,
    reference::{
        gbuffer::{self, Pixel},
        packing::{pack_normal, unpack_normal},
        receivers::Decoder,
        shell_splatter::Receiver,
        trace::{self, Tracer},
    },
    scenes::Scene,
    wgpu,
};

use crate::{
    gpu::Gpu,
    raster::{Raster, perspective},
    scene::SceneBuffers,
    testing::frames::Decoded,
};

/// What the passes are given.
pub struct Shot {
    pub buffers: SceneBuffers,
    pub camera: Camera,
    pub pixels: Vec<Option<Pixel>>,
    pub tracer: Tracer,
    pub depth: wgpu::TextureView,
    pub normal: wgpu::TextureView,
    pub albedo: wgpu::TextureView,
}

/// One of a scene's own views.
pub fn camera_of(scene: &Scene, view: usize, [width, height]: [u32; 2]) -> Camera {
    camera_in(scene, view, Viewport::full(width, height))
}

/// The same in a part of a target.
pub fn camera_in(scene: &Scene, view: usize, viewport: Viewport) -> Camera {
    let view = &scene.views[view];
    let Viewport { width, height, .. } = viewport;
    Camera::look_at(
        view.eye.into(),
        view.target.into(),
        view.up.into(),
        perspective(
            view.vertical_fov_degrees,
            f64::from(width) / f64::from(height),
            view.near,
        ),
        viewport,
    )
    .expect("a scene's own view")
}

impl Shot {
    pub fn new(gpu: &Gpu, scene: &Scene, camera: &Camera) -> Self {
        let tracer = Tracer::of_scene(scene).expect("a scene");
        let pixels = gbuffer::cast(
            camera,
            &tracer,
            &scene.positions,
            &scene.normals,
            &scene.indices,
        );
        let depth: Vec<f32> = pixels
            .iter()
            .map(|p| p.map_or(camera.background_depth(), |p| p.depth as f32))
            .collect();
        let normal: Vec<[f32; 4]> = pixels
            .iter()
            .map(|p| {
                p.map_or([0.0; 4], |p| {
                    p.receiver.shading_normal.as_vec3().extend(0.0).to_array()
                })
            })
            .collect();
        let materials = scene.triangle_materials();
        let albedo: Vec<[f32; 4]> = pixels
            .iter()
            .map(|p| {
                let [r, g, b] = p.map_or([f32::NAN; 3], |p| materials[p.triangle].albedo);
                [r, g, b, 1.0]
            })
            .collect();
        let mut shot = Self {
            buffers: SceneBuffers::new(gpu, scene),
            camera: *camera,
            pixels,
            tracer,
            depth: gpu.target(wgpu::TextureFormat::R32Float, 1, 1),
            normal: gpu.target(wgpu::TextureFormat::R32Float, 1, 1),
            albedo: framed(
                gpu,
                camera,
                wgpu::TextureFormat::Rgba32Float,
                &albedo,
                [f32::NAN; 4],
            ),
        };
        shot.upload(gpu, &depth, &normal);
        shot
    }

    /// Replaces the G-buffer's texels: those of the viewport. Beside it nothing is sound.
    pub fn upload(&mut self, gpu: &Gpu, depth: &[f32], normal: &[[f32; 4]]) {
        let camera = &self.camera;
        self.depth = framed(gpu, camera, wgpu::TextureFormat::R32Float, depth, f32::NAN);
        self.normal = framed(
            gpu,
            camera,
            wgpu::TextureFormat::Rgba32Float,
            normal,
            [f32::NAN; 4],
        );
    }

    /// What passes make of the G-buffer's pixels, relative to a cloud's origin.
    pub fn receivers(&self, origin: DVec3) -> Vec<Option<Receiver>> {
        let decoder = Decoder {
            camera: &self.camera,
            origin,
            depth_format: wgpu::TextureFormat::R32Float,
            normal_encoding: NormalEncoding::Signed,
            normal_space: NormalSpace::World,
        };
        let width = self.camera.viewport().width;
        (0..)
            .zip(&self.pixels)
            .map(|(i, pixel)| {
                let pixel = (*pixel)?;
                let normal = pixel.receiver.shading_normal.as_vec3().as_dvec3();
                let depth = f64::from(pixel.depth as f32);
                let receiver = decoder.prepare([i % width, i / width], depth, normal)?;
                Some(Receiver {
                    normal: unpack_normal(pack_normal(receiver.normal)),
                    ..receiver
                })
            })
            .collect()
    }

    /// Where the eye's ray through each pixel meets the scene, as the ray tracer takes it.
    pub fn traced(&self) -> Vec<Option<trace::Receiver>> {
        self.pixels.iter().map(|p| p.map(|p| p.receiver)).collect()
    }

    /// Its textures.
    pub fn raster(&self) -> Raster {
        Raster {
            depth: self.depth.clone(),
            normal: self.normal.clone(),
            albedo: self.albedo.clone(),
        }
    }

    /// Leans the normals of all pixels off their surfaces, by so much aside for one along them.
    pub fn lean(&mut self, gpu: &Gpu, slope: f64) {
        let mut texels = Vec::new();
        for pixel in &mut self.pixels {
            let mut texel = [0.0; 4];
            if let Some(Pixel { receiver, .. }) = pixel {
                let aside = receiver.geometric_normal.any_orthonormal_vector();
                let leaning = (receiver.geometric_normal + slope * aside).normalize();
                receiver.shading_normal = leaning;
                texel = leaning.as_vec3().extend(0.0).to_array();
            }
            texels.push(texel);
        }
        let format = wgpu::TextureFormat::Rgba32Float;
        self.normal = framed(gpu, &self.camera, format, &texels, [0.0; 4]);
    }

    pub fn gbuffer(&self) -> GBuffer<'_> {
        GBuffer::new(self.depth.texture(), self.normal.texture())
    }

    /// The same with the albedo of what is seen.
    pub fn lit_gbuffer(&self) -> GBuffer<'_> {
        GBuffer {
            albedo: Some(self.albedo.texture().into()),
            ..self.gbuffer()
        }
    }
}

/// Texels of a camera's viewport in a texture that just reaches its end, with `beside` beside it.
fn framed<T: bytemuck::Pod>(
    gpu: &Gpu,
    camera: &Camera,
    format: wgpu::TextureFormat,
    texels: &[T],
    beside: T,
) -> wgpu::TextureView {
    let Viewport {
        x,
        y,
        width,
        height,
    } = camera.viewport();
    let mut all = vec![beside; ((x + width) * (y + height)) as usize];
    for (row, texels) in (y..).zip(texels.chunks_exact(width as usize)) {
        let start = (row * (x + width) + x) as usize;
        all[start..start + width as usize].copy_from_slice(texels);
    }
    gpu.texture(format, x + width, y + height, &all)
}

/// Settings of all passes.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    pub surfelizer: SurfelizerSettings,
    pub splat: SplatSettings,
    pub reconstructor: ReconstructorSettings,
    pub capacity: CloudCapacity,
}

impl Settings {
    pub fn new(radius_pixels: f32, splat: SplatSettings) -> Self {
        Self {
            surfelizer: SurfelizerSettings {
                radius_pixels,
                ..SurfelizerSettings::default()
            },
            splat,
            reconstructor: ReconstructorSettings::default(),
            capacity: CloudCapacity {
                surfels: 1 << 18,
                pieces: 1 << 17,
                triangles: 1 << 17,
            },
        }
    }
}

/// Pipelines for ambient occlusion into `R32Float`.
pub struct Passes {
    surfelizer: &'static Surfelizer,
    splatter: &'static ShellSplatter,
    reconstructor: &'static Reconstructor,
}

impl Passes {
    pub fn new(gpu: &Gpu, effect: AmbientOcclusion) -> Self {
        let device = &gpu.device;
        let effect = effect.effect();
        Self {
            surfelizer: pipelines::surfelizer(),
            splatter: pipelines::shell_splatter(
                &effect,
                device.features().contains(wgpu::Features::SUBGROUP),
            ),
            reconstructor: pipelines::reconstructor(&effect, wgpu::TextureFormat::R32Float),
        }
    }

    /// A frame in one submission: visibility, and what the surfelizer counted.
    pub fn render(&self, gpu: &Gpu, shot: &Shot, settings: &Settings) -> (Vec<f32>, SurfelCounts) {
        let device = &gpu.device;
        let Viewport { width, height, .. } = shot.camera.viewport();
        let levels = settings.splat.levels;
        let mut cloud = self
            .surfelizer
            .create_cloud(device, settings.capacity)
            .expect("a cloud");
        let mut clusters = self
            .splatter
            .create_clusters(device, &cloud, levels)
            .expect("clusters");
        let sums = self
            .splatter
            .create_view(device, width, height, levels)
            .expect("a view");
        let scratch = self
            .reconstructor
            .create_view(device, &sums)
            .expect("a view");
        let target = gpu.target(wgpu::TextureFormat::R32Float, width, height);
        let mut encoder = gpu.encoder();
        self.surfelizer
            .record(
                device,
                &mut encoder,
                &SurfelizerInput {
                    geometry: Geometry {
                        meshes: &shot.buffers.meshes(),
                    },
                    camera: &shot.camera,
                    cull_by: &[shot.camera],
                    timestamps: None,
                },
                &SurfelizerSettings {
                    reach: ShellSplatter::reach(&settings.splat),
                    ..settings.surfelizer
                },
                &mut cloud,
            )
            .expect("surfels");
        self.splatter
            .record_clusters(
                device,
                &mut encoder,
                &ClusterInput::new(&cloud),
                &settings.splat,
                &mut clusters,
            )
            .expect("clusters");
        let mut decoded = Decoded::of(&shot.camera);
        let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, cloud.origin());
        self.splatter
            .record(
                device,
                &mut encoder,
                &SplatInput::new(&frame, &cloud, &clusters),
                &settings.splat,
                &sums,
            )
            .expect("sums");
        self.reconstructor
            .record(
                device,
                &mut encoder,
                &ReconstructorInput::new(&frame, &sums, target.texture()),
                &settings.reconstructor,
                &scratch,
            )
            .expect("a picture");
        gpu.finish(encoder);
        let counts: Vec<SurfelCounts> = gpu.read_buffer(cloud.counters());
        (gpu.read_texture(target.texture(), 0), counts[0])
    }
}

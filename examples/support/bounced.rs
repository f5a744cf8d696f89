//! The passes wired together for effects by the bounced z-buffer.

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedView, BouncedZBuffer, Camera, CloudCapacity, Error,
    Geometry, HitLighting, HitReconstructor, HitReconstructorDescriptor, HitReconstructorInput,
    HitReconstructorView, Light, Lighting, Payload, Reach, Sampling, SenderBounds, SurfelCloud,
    SurfelCounts, Surfelizer, SurfelizerInput, wgpu,
};

use super::{gpu::Gpu, presets::BouncedPreset, raster::Raster, scene::SceneBuffers};

/// The pipelines and one view.
pub struct BouncedRenderer {
    payload: Payload,
    surfelizer: Surfelizer,
    bounced: BouncedZBuffer,
    reconstructor: HitReconstructor,
    pub cloud: SurfelCloud,
    pub bounds: SenderBounds,
    pub view: BouncedView,
    scratch: HitReconstructorView,
    target: wgpu::TextureView,
}

/// The picture and what it took.
pub struct Picture {
    /// Visibility in all channels (1 = open), or radiance.
    pub pixels: Vec<[f32; 4]>,
    /// A name and milliseconds of wall clock a pass.
    pub passes: Vec<(&'static str, f64)>,
    pub counts: SurfelCounts,
}

impl Picture {
    pub fn total_ms(&self) -> f64 {
        self.passes.iter().map(|p| p.1).sum()
    }

    pub fn visibility(&self) -> Vec<f32> {
        self.pixels.iter().map(|p| p[0]).collect()
    }

    pub fn radiance(&self) -> Vec<[f32; 3]> {
        self.pixels.iter().map(|p| [p[0], p[1], p[2]]).collect()
    }
}

impl BouncedRenderer {
    /// No surfels are made, of whatever capacity: rays meet triangles, and are lit where they do.
    pub fn new(
        gpu: &Gpu,
        payload: Payload,
        capacity: CloudCapacity,
        [width, height]: [u32; 2],
        directions: u32,
        statistics: bool,
    ) -> Result<Self, Error> {
        let device = &gpu.device;
        let format = wgpu::TextureFormat::Rgba32Float;
        let surfelizer = Surfelizer::new(device, None)?;
        let descriptor = BouncedDescriptor {
            payload,
            lighting: Lighting::Hits,
            statistics,
            ..BouncedDescriptor::default()
        };
        let bounced = BouncedZBuffer::new(device, &descriptor, None)?;
        let descriptor = HitReconstructorDescriptor {
            payload,
            sampling: Sampling::default(),
            deferred: false,
            target: format,
        };
        let reconstructor = HitReconstructor::new(device, &descriptor, None)?;
        let cloud = surfelizer.create_cloud(device, capacity)?;
        Ok(Self {
            payload,
            bounds: bounced.create_bounds(device, &cloud)?,
            view: bounced.create_view(device, width, height, directions)?,
            scratch: reconstructor.create_view(device, width, height)?,
            target: gpu.target(format, width, height),
            surfelizer,
            bounced,
            reconstructor,
            cloud,
        })
    }

    /// GPU memory of everything that the passes own, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.cloud.memory_bytes()
            + self.bounds.memory_bytes()
            + self.view.memory_bytes()
            + self.scratch.memory_bytes()
    }

    /// Renders once, a submission a pass, so that each can be timed on any driver.
    pub fn render(
        &mut self,
        gpu: &Gpu,
        raster: &Raster,
        scene: &SceneBuffers,
        camera: &Camera,
        lights: &[Light],
        preset: &BouncedPreset,
    ) -> Result<Picture, Error> {
        let device = &gpu.device;
        let mut passes = Vec::new();
        let mut settings = preset.surfelizer;
        // What lies beyond the radius is not hit, but may be what shadows what is.
        settings.reach = Reach {
            radii: f32::INFINITY,
            world: if self.payload == Payload::Radiance {
                f32::INFINITY
            } else {
                preset.bounced.radius
            },
        };
        let meshes = scene.meshes();
        let (ms, done) = gpu.time(|encoder| {
            self.surfelizer.record(
                device,
                encoder,
                &SurfelizerInput {
                    geometry: Geometry { meshes: &meshes },
                    camera,
                    cull_by: &[*camera],
                    timestamps: None,
                },
                &settings,
                &mut self.cloud,
            )
        });
        done?;
        passes.push(("surfelize", ms));
        let (ms, done) = gpu.time(|encoder| {
            self.bounced
                .record_bounds(device, encoder, &self.cloud, &self.bounds, None)
        });
        done?;
        passes.push(("bounds", ms));
        let (ms, done) = gpu.time(|encoder| {
            self.bounced.record(
                device,
                encoder,
                &BouncedInput {
                    gbuffer: raster.gbuffer(),
                    camera,
                    cloud: &self.cloud,
                    bounds: &self.bounds,
                    radiance: None,
                    lighting: (self.payload == Payload::Radiance).then_some(HitLighting {
                        materials: &scene.materials,
                        lights,
                    }),
                    roughness: None,
                    timestamps: None,
                },
                &preset.bounced,
                &self.view,
            )
        });
        done?;
        passes.push(("trace", ms));
        let (ms, done) = gpu.time(|encoder| {
            self.reconstructor.record(
                device,
                encoder,
                &HitReconstructorInput {
                    gbuffer: raster.gbuffer(),
                    roughness: None,
                    camera,
                    cloud: &self.cloud,
                    hits: &self.view,
                    traced: &preset.bounced,
                    target: &self.target,
                    timestamps: None,
                },
                &preset.reconstructor,
                &self.scratch,
            )
        });
        done?;
        passes.push(("reconstruct", ms));
        let counts: Vec<SurfelCounts> = gpu.read_buffer(self.cloud.counters());
        Ok(Picture {
            pixels: gpu.read_texture(self.target.texture(), 0),
            passes,
            counts: counts[0],
        })
    }
}

//! The passes wired together for effects by the bounced z-buffer.

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedView, BouncedZBuffer, Camera, CloudCapacity, Error,
    Geometry, HitReconstructor, HitReconstructorDescriptor, HitReconstructorInput,
    HitReconstructorView, Light, Payload, Reach, Sampling, SenderBounds, ShadedLight, Shadow,
    SurfelCloud, SurfelCounts, SurfelShader, SurfelShaderInput, SurfelShaderSettings, Surfelizer,
    SurfelizerInput, wgpu,
};

use super::{gpu::Gpu, presets::BouncedPreset, raster::Raster, scene::SceneBuffers};

/// What light needs besides.
struct Lighting {
    shader: SurfelShader,
    radiance: wgpu::Buffer,
}

/// The pipelines and one view.
pub struct BouncedRenderer {
    surfelizer: Surfelizer,
    bounced: BouncedZBuffer,
    reconstructor: HitReconstructor,
    pub cloud: SurfelCloud,
    pub bounds: SenderBounds,
    pub view: BouncedView,
    scratch: HitReconstructorView,
    lighting: Option<Lighting>,
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
    /// For ambient occlusion no surfels are made: a capacity of 0 does.
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
        let lighting = match payload {
            Payload::Occlusion => None,
            Payload::Radiance => {
                let shader = SurfelShader::new(device, None)?;
                let radiance = shader.create_radiance(device, &cloud)?;
                Some(Lighting { shader, radiance })
            }
        };
        Ok(Self {
            bounds: bounced.create_bounds(device, &cloud)?,
            view: bounced.create_view(device, width, height, directions)?,
            scratch: reconstructor.create_view(device, width, height)?,
            target: gpu.target(format, width, height),
            surfelizer,
            bounced,
            reconstructor,
            cloud,
            lighting,
        })
    }

    /// GPU memory of everything that the passes own, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.cloud.memory_bytes()
            + self.bounds.memory_bytes()
            + self.view.memory_bytes()
            + self.scratch.memory_bytes()
            + self.lighting.as_ref().map_or(0, |l| l.radiance.size())
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
            world: if self.lighting.is_some() {
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
        if let Some(lighting) = &self.lighting {
            let lights: Vec<_> = lights
                .iter()
                .map(|light| ShadedLight {
                    light: *light,
                    shadow: Shadow::Traced(&self.bounds),
                })
                .collect();
            let (ms, done) = gpu.time(|encoder| {
                lighting.shader.record(
                    device,
                    encoder,
                    &SurfelShaderInput {
                        cloud: &self.cloud,
                        materials: &scene.materials,
                        lights: &lights,
                        radiance: &lighting.radiance,
                        timestamps: None,
                    },
                    &SurfelShaderSettings {
                        samples: preset.samples,
                    },
                )
            });
            done?;
            passes.push(("light", ms));
        }
        let (ms, done) = gpu.time(|encoder| {
            self.bounced.record(
                device,
                encoder,
                &BouncedInput {
                    gbuffer: raster.gbuffer(),
                    camera,
                    cloud: &self.cloud,
                    bounds: &self.bounds,
                    radiance: self.lighting.as_ref().map(|l| &l.radiance),
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

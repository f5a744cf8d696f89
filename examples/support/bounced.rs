//! The passes wired together for effects by the bounced z-buffer.

use deep_screen_space::{
    AlphaTestedInput, BounceSettings, BouncedDescriptor, BouncedInput, BouncedSettings,
    BouncedView, BouncedZBuffer, Bvh, BvhBuilder, Camera, CloudCapacity, Emitters, EmittersBuilder,
    EmittersInput, Environment, EnvironmentLight, Error, GBuffer, Geometry, HitEstimateInput,
    HitLighting, HitRadiance, HitResolver, HitResolverDescriptor, HitResolverInput,
    HitResolverSettings, HitResolverView, Light, Payload, Primitives, RayBudget, RayBudgetInput,
    RayBudgetSettings, RayBudgetView, Reach, Sampling, ShadedLight, Shadow, SurfelCloud,
    SurfelCounts, SurfelGatherer, SurfelGathererInput, SurfelSenders, SurfelShader,
    SurfelShaderInput, SurfelShaderSettings, Surfelizer, SurfelizerInput, SurfelizerSettings, wgpu,
};

use super::{
    decoding::Decoding, gpu::Gpu, presets::BouncedPreset, raster::Raster, scene::SceneBuffers,
};

/// A name and milliseconds by `Gpu::stopwatch`.
type Timed = (&'static str, f64);

/// What light of surfels needs besides.
struct SurfelLighting {
    shader: SurfelShader,
    radiance: wgpu::Buffer,
}

/// What further bounces need besides.
struct FurtherBounces {
    gatherer: SurfelGatherer,
    /// What surfels reflect of what they gathered: after each bounce the other one.
    gathered: [wgpu::Buffer; 2],
    /// In all, that of the pixels among them.
    bounces: u32,
}

impl FurtherBounces {
    /// What hits bring besides.
    fn last(&self) -> &wgpu::Buffer {
        &self.gathered[self.bounces as usize % 2]
    }
}

/// What rays are traced among. Several [`Gatherer`]s may share it.
pub struct TracedScene {
    surfelizer: Surfelizer,
    pub cloud: SurfelCloud,
    builder: BvhBuilder,
    bvh: Bvh,
    surfel_lighting: Option<SurfelLighting>,
    further_bounces: Option<FurtherBounces>,
    /// What hits are lit by, of the last update.
    lights: Vec<Light>,
    materials: Option<wgpu::Buffer>,
    /// What shines, for gatherers that aim rays at it.
    emitters: Option<(EmittersBuilder, Emitters)>,
    /// What rays bring that meet nothing, for gatherers of an environment.
    pub environment: Option<Environment>,
}

impl TracedScene {
    /// Room for what the gatherer needs; unless it takes light from surfels none are made, and a capacity of 0 does.
    pub fn new(gpu: &Gpu, gatherer: &Gatherer, capacity: CloudCapacity) -> Result<Self, Error> {
        let device = &gpu.device;
        let surfelizer = Surfelizer::new(device)?;
        let cloud = surfelizer.create_cloud(device, capacity)?;
        let payload = gatherer.descriptor.payload;
        let surfel_lighting = if matches!(payload, Payload::Radiance | Payload::LitAndGathered) {
            let shader = SurfelShader::with_primitives(device, gatherer.primitives)?;
            let radiance = shader.create_radiance(device, &cloud)?;
            Some(SurfelLighting { shader, radiance })
        } else {
            None
        };
        let builder = BvhBuilder::new(device, gatherer.primitives)?;
        let aims = gatherer.descriptor.emitter_samples > 0;
        let emitters = aims.then(|| -> Result<_, Error> {
            let builder = EmittersBuilder::new(device)?;
            let emitters = builder.create(device, &cloud)?;
            Ok((builder, emitters))
        });
        Ok(Self {
            bvh: builder.create(device, &cloud)?,
            builder,
            surfelizer,
            cloud,
            surfel_lighting,
            further_bounces: None,
            lights: Vec::new(),
            materials: None,
            emitters: emitters.transpose()?,
            environment: None,
        })
    }

    /// The same for light that bounces so often, 2 or more, for a gatherer that takes light from surfels besides.
    pub fn with_bounces(
        gpu: &Gpu,
        gatherer: &Gatherer,
        capacity: CloudCapacity,
        bounces: u32,
    ) -> Result<Self, Error> {
        let mut scene = Self::new(gpu, gatherer, capacity)?;
        let device = &gpu.device;
        let gatherer = match scene.emitters {
            Some(_) => SurfelGatherer::with_emitters(device, gatherer.primitives)?,
            None => SurfelGatherer::with_primitives(device, gatherer.primitives)?,
        };
        let room = || gatherer.create_radiance(&gpu.device, &scene.cloud);
        scene.further_bounces = Some(FurtherBounces {
            gathered: [room()?, room()?],
            gatherer,
            bounces,
        });
        Ok(scene)
    }

    fn memory_bytes(&self) -> u64 {
        self.cloud.memory_bytes()
            + self.bvh.memory_bytes()
            + self
                .surfel_lighting
                .as_ref()
                .map_or(0, |l| l.radiance.size())
            + self
                .further_bounces
                .as_ref()
                .map_or(0, |f| f.gathered.iter().map(wgpu::Buffer::size).sum())
            + self
                .emitters
                .as_ref()
                .map_or(0, |(_, emitters)| emitters.memory_bytes())
    }

    /// Makes pieces and the hierarchy over them and, where they are to shine, lights `samples` points of each surfel; a
    /// submission a pass.
    pub fn update(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        camera: &Camera,
        lights: &[Light],
        (settings, samples): (&SurfelizerSettings, u32),
    ) -> Result<Vec<Timed>, Error> {
        let device = &gpu.device;
        self.lights = lights.to_vec();
        self.materials = Some(scene.materials.clone());
        let mut passes = Vec::new();
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
                settings,
                &mut self.cloud,
            )
        });
        done?;
        passes.push(("surfelize", ms));
        let tests = scene.tests();
        let alpha_tests = scene.alpha_tests(&tests);
        let (ms, done) = gpu.time(|encoder| match alpha_tests {
            Some(tests) => {
                let input = AlphaTestedInput {
                    geometry: Geometry { meshes: &meshes },
                    tests,
                    cloud: &self.cloud,
                    timestamps: None,
                };
                self.builder
                    .record_alpha_tested(device, encoder, &input, &mut self.bvh)
            }
            None => self
                .builder
                .record(device, encoder, &self.cloud, &self.bvh, None),
        });
        done?;
        passes.push(("bvh", ms));
        if let Some((builder, emitters)) = &self.emitters {
            let input = EmittersInput::new(&self.cloud, &scene.materials);
            let (ms, done) = gpu.time(|encoder| builder.record(device, encoder, &input, emitters));
            done?;
            passes.push(("emitters", ms));
        }
        if let Some(lighting) = &self.surfel_lighting {
            let lights: Vec<_> = lights
                .iter()
                .map(|light| ShadedLight {
                    light: *light,
                    shadow: Shadow::Traced(&self.bvh),
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
                    &SurfelShaderSettings { samples },
                )
            });
            done?;
            passes.push(("light", ms));
            if let Some(further) = &self.further_bounces {
                let (ms, done) = gpu.time(|encoder| {
                    self.bounce(
                        gpu,
                        encoder,
                        &scene.materials,
                        (further, &lighting.radiance),
                    )
                });
                done?;
                passes.push(("bounces", ms));
            }
        }
        Ok(passes)
    }
}

impl TracedScene {
    /// Bounces but the pixels' own, from what surfels send anyway.
    fn bounce(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        materials: &wgpu::Buffer,
        (further, sent): (&FurtherBounces, &wgpu::Buffer),
    ) -> Result<(), Error> {
        let (device, cloud) = (&gpu.device, &self.cloud);
        let emitters = self.emitters.as_ref().map(|(_, emitters)| emitters);
        let mut settings = BounceSettings::in_frame(further.bounces);
        if emitters.is_some() {
            settings = settings.for_emitters();
        }
        settings.validate()?;
        for bounce in 2..=further.bounces as usize {
            let [to, from] = [0, 1].map(|other| &further.gathered[(bounce + other) % 2]);
            let senders = SurfelSenders {
                cloud,
                bvh: &self.bvh,
                radiance: if bounce == 2 { sent } else { from },
            };
            let input = SurfelGathererInput {
                emitters,
                ..SurfelGathererInput::new(senders, materials, to)
            };
            further
                .gatherer
                .record(device, encoder, &input, &settings.gatherer)?;
            if bounce < further.bounces as usize {
                further.gatherer.add(device, encoder, cloud, to, sent)?;
            }
        }
        Ok(())
    }
}

/// A kind of hits, and a view of them.
pub struct Gatherer {
    primitives: Primitives,
    descriptor: HitResolverDescriptor,
    pub decoding: Decoding,
    bounced: BouncedZBuffer,
    resolver: HitResolver,
    pub view: BouncedView,
    scratch: HitResolverView,
    /// Where rays are counted.
    budget: Option<(RayBudget, RayBudgetView)>,
    /// The picture.
    pub target: wgpu::TextureView,
}

impl Gatherer {
    /// With room for this many directions per pixel.
    pub fn new(
        gpu: &Gpu,
        descriptor: HitResolverDescriptor,
        [width, height]: [u32; 2],
        rays_per_pixel: u32,
        statistics: bool,
    ) -> Result<Self, Error> {
        let size = [width, height];
        let how = (statistics, Primitives::Triangles);
        Self::among(gpu, descriptor, size, rays_per_pixel, how)
    }

    /// The same for rays that meet such primitives of a cloud.
    pub fn among(
        gpu: &Gpu,
        descriptor: HitResolverDescriptor,
        [width, height]: [u32; 2],
        rays_per_pixel: u32,
        (statistics, primitives): (bool, Primitives),
    ) -> Result<Self, Error> {
        let device = &gpu.device;
        let bounced = BouncedDescriptor {
            primitives,
            environment: descriptor.payload == Payload::Sky,
            payload: descriptor.payload,
            sampling: descriptor.sampling,
            statistics,
            counted: descriptor.counted,
            emitter_samples: descriptor.emitter_samples,
        };
        let bounced = BouncedZBuffer::new(device, &bounced)?;
        let resolver = HitResolver::new(device, &descriptor)?;
        let view = bounced.create_view(device, width, height, rays_per_pixel)?;
        let budget = descriptor.counted.then(|| -> Result<_, Error> {
            let budget = RayBudget::with_sampling(device, descriptor.sampling)?;
            let room = budget.create_view(device, width, height)?;
            Ok((budget, room))
        });
        Ok(Self {
            budget: budget.transpose()?,
            scratch: resolver.create_view(device, &view)?,
            view,
            target: gpu.target(descriptor.target, width, height),
            decoding: Decoding::new(gpu, [width, height])?,
            primitives,
            descriptor,
            bounced,
            resolver,
        })
    }

    /// Renders into the target, one submission per pass; glossy receivers need their roughness.
    pub fn render(
        &mut self,
        gpu: &Gpu,
        (raster, roughness): (&Raster, Option<&wgpu::Texture>),
        camera: &Camera,
        scene: &TracedScene,
        (traced, settings): (&BouncedSettings, &HitResolverSettings),
        further: Option<&RayBudgetSettings>,
    ) -> Result<Vec<Timed>, Error> {
        let device = &gpu.device;
        let radiance = match (self.descriptor.payload, &scene.materials) {
            (Payload::LitRadiance, Some(materials)) => HitRadiance::Lit(HitLighting {
                materials,
                lights: &scene.lights,
            }),
            (Payload::LitAndGathered, Some(materials)) => {
                let gathered = scene.further_bounces.as_ref().map(FurtherBounces::last);
                gathered.map_or(HitRadiance::None, |gathered| HitRadiance::LitAndGathered {
                    lighting: HitLighting {
                        materials,
                        lights: &scene.lights,
                    },
                    gathered,
                })
            }
            _ => scene
                .surfel_lighting
                .as_ref()
                .map_or(HitRadiance::None, |l| HitRadiance::Surfels(&l.radiance)),
        };
        let gbuffer = GBuffer {
            roughness: roughness.map(Into::into),
            ..raster.gbuffer()
        };
        let origin = scene.cloud.origin();
        let (decode_ms, frame) = self.decoding.frame(gpu, gbuffer, camera, origin)?;
        let input = BouncedInput {
            radiance,
            environment: scene.environment.as_ref().map(EnvironmentLight::new),
            emitters: scene.emitters.as_ref().map(|(_, emitters)| emitters),
            ..BouncedInput::new(&frame, &scene.cloud, &scene.bvh)
        };
        let mut passes = vec![("decode", decode_ms)];
        let (ms, done) = gpu.time(|encoder| {
            self.bounced
                .record(device, encoder, &input, traced, &self.view)
        });
        done?;
        passes.push(("trace", ms));
        if let (Some(further), Some((budget, room))) = (further, &self.budget) {
            let (ms, done) = gpu.time(|encoder| {
                let hits = HitEstimateInput::new(&frame, &self.view);
                self.resolver
                    .estimate(device, encoder, &hits, settings, &self.scratch)?;
                let input = RayBudgetInput::new(&frame, &self.view, &self.scratch, settings);
                budget.record(device, encoder, &input, further, room)
            });
            done?;
            passes.push(("budget", ms));
            let (ms, done) = gpu.time(|encoder| {
                let into = (&self.view, room);
                self.bounced
                    .record_more(device, encoder, &input, traced, into)
            });
            done?;
            passes.push(("more", ms));
        }
        let (resolve_ms, done) = gpu.time(|encoder| {
            let input = HitResolverInput::new(&frame, &self.view, self.target.texture());
            self.resolver
                .record(device, encoder, &input, settings, &self.scratch)
        });
        done?;
        passes.push(("reconstruct", resolve_ms));
        Ok(passes)
    }

    /// The picture, where the target is of four `f32`.
    pub fn pixels(&self, gpu: &Gpu) -> Vec<[f32; 4]> {
        gpu.read_texture(self.target.texture(), 0)
    }
}

/// The pipelines and one view of diffuse receivers.
pub struct BouncedRenderer {
    pub scene: TracedScene,
    pub gatherer: Gatherer,
    /// Of all pixels, where receivers are glossy.
    pub roughness: Option<wgpu::TextureView>,
}

/// The picture and what it took.
pub struct Picture {
    /// Visibility in all channels (1 = open), or radiance.
    pub pixels: Vec<[f32; 4]>,
    /// A name and milliseconds by `Gpu::stopwatch` per pass.
    pub passes: Vec<Timed>,
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

/// What a [`BouncedRenderer`] has room for.
#[derive(Clone, Copy, Debug, Default)]
pub struct RayRoom {
    pub rays_per_pixel: u32,
    /// Whether further rays go where noise is greatest.
    pub counted: bool,
    pub statistics: bool,
    /// Whether the picture is bent normals.
    pub bent_normals: bool,
    /// Of light: 0 and 1 are one.
    pub bounces: u32,
    /// What rays meet: triangles of a cloud, with holes or without.
    pub primitives: Primitives,
    /// Where rays go; of glossy receivers the renderer is given the roughness.
    pub sampling: Sampling,
    /// Rays towards what shines, beside the others.
    pub emitter_samples: u32,
}

impl BouncedRenderer {
    /// Rays meet triangles, and are lit where they do. No surfels are made, of whatever capacity, but for further bounces.
    pub fn new(
        gpu: &Gpu,
        payload: Payload,
        capacity: CloudCapacity,
        size: [u32; 2],
        room: RayRoom,
    ) -> Result<Self, Error> {
        let RayRoom {
            rays_per_pixel,
            counted,
            statistics,
            bent_normals,
            bounces,
            primitives,
            sampling,
            emitter_samples,
        } = room;
        let payload = if bounces > 1 && payload == Payload::LitRadiance {
            Payload::LitAndGathered
        } else {
            payload
        };
        let descriptor = HitResolverDescriptor {
            payload,
            sampling,
            deferred: false,
            counted,
            joined: false,
            bent_normals,
            emitter_samples,
            target: wgpu::TextureFormat::Rgba32Float,
        };
        let how = (statistics, primitives);
        let gatherer = Gatherer::among(gpu, descriptor, size, rays_per_pixel, how)?;
        Ok(Self {
            scene: if payload == Payload::LitAndGathered {
                TracedScene::with_bounces(gpu, &gatherer, capacity, bounces)?
            } else {
                TracedScene::new(gpu, &gatherer, capacity)?
            },
            gatherer,
            roughness: None,
        })
    }

    /// GPU memory of what rays traverse, bytes.
    pub fn bvh_bytes(&self) -> u64 {
        self.scene.bvh.memory_bytes()
    }

    /// GPU memory of everything that the passes own, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.scene.memory_bytes()
            + self.gatherer.decoding.memory_bytes()
            + self.gatherer.view.memory_bytes()
            + self.gatherer.scratch.memory_bytes()
            + self
                .gatherer
                .budget
                .as_ref()
                .map_or(0, |(_, room)| room.memory_bytes())
    }

    /// Renders once, one submission per pass, so that each can be timed on any driver.
    pub fn render(
        &mut self,
        gpu: &Gpu,
        raster: &Raster,
        scene: &SceneBuffers,
        camera: &Camera,
        lights: &[Light],
        preset: &BouncedPreset,
    ) -> Result<Picture, Error> {
        let mut settings = preset.surfelizer;
        // What lies beyond the radius is not hit, but may be what shadows what is.
        settings.reach = Reach {
            radii: f32::INFINITY,
            world: match self.gatherer.descriptor.payload {
                Payload::LitRadiance | Payload::LitAndGathered => f32::INFINITY,
                _ => preset.bounced.radius,
            },
        };
        let (traced, gatherer) = (&mut self.scene, &mut self.gatherer);
        let mut samples = 1;
        if let Some(further) = &traced.further_bounces {
            let bounces = BounceSettings::in_frame(further.bounces);
            settings.radius_pixels = bounces.radius_pixels;
            samples = bounces.samples;
        }
        let mut passes = traced.update(gpu, scene, camera, lights, (&settings, samples))?;
        let how = (&preset.bounced, &preset.reconstructor);
        let further = preset.further.as_ref();
        let roughness = self.roughness.as_ref().map(wgpu::TextureView::texture);
        passes.extend(gatherer.render(gpu, (raster, roughness), camera, traced, how, further)?);
        let counts: Vec<SurfelCounts> = gpu.read_buffer(traced.cloud.counters());
        Ok(Picture {
            pixels: gatherer.pixels(gpu),
            passes,
            counts: counts[0],
        })
    }
}

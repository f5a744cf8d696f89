//! The passes wired together for effects by splatting.

use deep_screen_space::{
    AlphaTests, AmbientOcclusion, Bvh, BvhBuilder, Camera, CloudCapacity, ClusterInput, Effect,
    Environment, EnvironmentLight, Error, GBuffer, Geometry, Light, Mesh, Primitives, Reach,
    Reconstructor, ReconstructorInput, ReconstructorView, ShadedLight, Shadow, ShellSplatter,
    ShellSplatterDescriptor, SplatInput, SplatView, SurfelCloud, SurfelClusters, SurfelCounts,
    SurfelCutouts, SurfelHoles, SurfelHolesInput, SurfelShader, SurfelShaderInput,
    SurfelShaderSettings, Surfelizer, SurfelizerInput, TextureSlice, wgpu,
};

use super::{
    decoding::Decoding,
    gpu::Gpu,
    presets::Preset,
    raster::Raster,
    scene::SceneBuffers,
    stages::{Stages, Timed as TimedStages},
};

/// A name and milliseconds by `Gpu::stopwatch`.
type Timed = (&'static str, f64);

/// What effects need that read what surfels send.
struct Lighting {
    shader: SurfelShader,
    radiance: wgpu::Buffer,
    builder: BvhBuilder,
    bvh: Bvh,
}

/// What surfels are lit by.
#[derive(Clone, Copy)]
pub struct Lamps<'a> {
    pub materials: &'a wgpu::Buffer,
    pub lights: &'a [Light],
}

/// What one recording works on.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    pub raster: &'a Raster,
    pub meshes: &'a [Mesh<'a>],
    pub camera: &'a Camera,
    /// Where meshes have holes, if any has.
    pub holes: Option<AlphaTests<'a>>,
    /// For effects that read what surfels send.
    pub lamps: Option<Lamps<'a>>,
}

/// The pipelines and one view.
pub struct Renderer {
    lighting: Option<Lighting>,
    surfelizer: Surfelizer,
    /// Once a scene has had holes.
    holes: Option<(SurfelHoles, SurfelCutouts)>,
    splatter: ShellSplatter,
    reconstructor: Reconstructor,
    pub cloud: SurfelCloud,
    clusters: SurfelClusters,
    pub decoding: Decoding,
    pub view: SplatView,
    scratch: ReconstructorView,
    /// What effects are under that ask for one.
    pub environment: Option<Environment>,
    /// Of all pixels, for effects that ask for it.
    pub roughness: Option<wgpu::TextureView>,
    /// One an output of the effect.
    targets: Vec<wgpu::TextureView>,
}

/// The pictures, and what they took.
pub struct Rendered {
    /// Red of the first: for ambient occlusion 1 = open.
    pub visibility: Vec<f32>,
    /// One an output, of effects of several channels; none of others.
    pub pictures: Vec<Vec<[f32; 4]>>,
    /// A name and milliseconds by `Gpu::stopwatch` per pass.
    pub passes: Vec<Timed>,
    pub counts: SurfelCounts,
}

impl Lighting {
    /// A ray from each surfel to each light.
    fn record(
        &self,
        gpu: &Gpu,
        stages: &mut impl Stages,
        cloud: &SurfelCloud,
        lamps: &Lamps<'_>,
    ) -> Result<(), Error> {
        let device = &gpu.device;
        stages.stage("bvh", |encoder| {
            self.builder.record(device, encoder, cloud, &self.bvh, None)
        })?;
        let lights = lamps.lights.iter().map(|light| ShadedLight {
            light: *light,
            shadow: Shadow::Traced(&self.bvh),
        });
        let lights: Vec<_> = lights.collect();
        let input = SurfelShaderInput::new(cloud, lamps.materials, &lights, &self.radiance);
        stages.stage("light", |encoder| {
            let settings = SurfelShaderSettings::default();
            self.shader.record(device, encoder, &input, &settings)
        })
    }
}

impl Rendered {
    pub fn total_ms(&self) -> f64 {
        self.passes.iter().map(|p| p.1).sum()
    }
}

impl Renderer {
    pub fn new(
        gpu: &Gpu,
        effect: AmbientOcclusion,
        capacity: CloudCapacity,
        [width, height]: [u32; 2],
        levels: u32,
        statistics: bool,
    ) -> Result<Self, Error> {
        Self::of(
            gpu,
            &effect.effect(),
            capacity,
            [width, height],
            levels,
            statistics,
        )
    }

    /// Of any effect.
    pub fn of(
        gpu: &Gpu,
        effect: &Effect,
        capacity: CloudCapacity,
        [width, height]: [u32; 2],
        levels: u32,
        statistics: bool,
    ) -> Result<Self, Error> {
        let device = &gpu.device;
        let surfelizer = Surfelizer::new(device)?;
        let splatter = ShellSplatter::new(
            device,
            &ShellSplatterDescriptor {
                effect,
                subgroups: device
                    .features()
                    .contains(ShellSplatter::optional_features()),
                statistics,
            },
        )?;
        let format = if effect.channels > 1 {
            wgpu::TextureFormat::Rgba32Float
        } else {
            wgpu::TextureFormat::R32Float
        };
        let reconstructor = splatter.reconstructor(device, format)?;
        let cloud = surfelizer.create_cloud(device, capacity)?;
        let view = splatter.create_view(device, width, height, levels)?;
        let lighting = effect.radiance.then(|| -> Result<_, Error> {
            let shader = SurfelShader::new(device)?;
            let builder = BvhBuilder::new(device, Primitives::Triangles)?;
            Ok(Lighting {
                radiance: shader.create_radiance(device, &cloud)?,
                bvh: builder.create(device, &cloud)?,
                shader,
                builder,
            })
        });
        let outputs = effect.outputs.iter();
        Ok(Self {
            lighting: lighting.transpose()?,
            clusters: splatter.create_clusters(device, &cloud, levels)?,
            scratch: reconstructor.create_view(device, &view)?,
            decoding: Decoding::new(gpu, [width, height])?,
            view,
            environment: None,
            roughness: None,
            targets: outputs.map(|_| gpu.target(format, width, height)).collect(),
            surfelizer,
            holes: None,
            splatter,
            reconstructor,
            cloud,
        })
    }

    /// GPU memory of everything that the passes own, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.cloud.memory_bytes()
            + self.clusters.memory_bytes()
            + self.decoding.memory_bytes()
            + self.view.memory_bytes()
            + self.scratch.memory_bytes()
            + self
                .holes
                .as_ref()
                .map_or(0, |(_, cutouts)| cutouts.memory_bytes())
            + self.lighting.as_ref().map_or(0, |lighting| {
                lighting.radiance.size() + lighting.bvh.memory_bytes()
            })
    }

    /// Renders once, one submission per pass, so that each can be timed on any driver.
    pub fn render(
        &mut self,
        gpu: &Gpu,
        raster: &Raster,
        meshes: &[Mesh<'_>],
        camera: &Camera,
        preset: &Preset,
    ) -> Result<Rendered, Error> {
        let subject = Subject {
            raster,
            meshes,
            camera,
            holes: None,
            lamps: None,
        };
        self.render_subject(gpu, &subject, preset)
    }

    /// The same of a scene with its holes; for an effect that reads what surfels send, under these lights and what shines itself.
    pub fn render_scene(
        &mut self,
        gpu: &Gpu,
        raster: &Raster,
        scene: &SceneBuffers,
        camera: &Camera,
        lights: &[Light],
        preset: &Preset,
    ) -> Result<Rendered, Error> {
        let materials = &scene.materials;
        let tests = scene.tests();
        let subject = Subject {
            raster,
            meshes: &scene.meshes(),
            camera,
            holes: scene.alpha_tests(&tests),
            lamps: self
                .lighting
                .is_some()
                .then_some(Lamps { materials, lights }),
        };
        self.render_subject(gpu, &subject, preset)
    }

    fn render_subject(
        &mut self,
        gpu: &Gpu,
        subject: &Subject<'_>,
        preset: &Preset,
    ) -> Result<Rendered, Error> {
        let mut stages = TimedStages::new(gpu);
        self.record(gpu, &mut stages, subject, preset)?;
        let counts: Vec<SurfelCounts> = gpu.read_buffer(self.cloud.counters());
        let is_of_colors = self.targets[0].texture().format() != wgpu::TextureFormat::R32Float;
        let pictures: Vec<Vec<[f32; 4]>> = if is_of_colors {
            let targets = self.targets.iter();
            targets.map(|t| gpu.read_texture(t.texture(), 0)).collect()
        } else {
            Vec::new()
        };
        Ok(Rendered {
            visibility: match pictures.first() {
                Some(first) => first.iter().map(|texel| texel[0]).collect(),
                None => gpu.read_texture(self.targets[0].texture(), 0),
            },
            pictures,
            passes: stages.passes,
            counts: counts[0],
        })
    }

    /// Surfels as large as what is there of them.
    fn fit(
        &mut self,
        gpu: &Gpu,
        stages: &mut impl Stages,
        meshes: &[Mesh<'_>],
        tests: AlphaTests<'_>,
    ) -> Result<(), Error> {
        let device = &gpu.device;
        let (fitter, cutouts) = match &mut self.holes {
            Some(made) => made,
            none => {
                let fitter = SurfelHoles::new(device)?;
                let cutouts = fitter.create_cutouts(device, &self.cloud)?;
                none.insert((fitter, cutouts))
            }
        };
        let input = SurfelHolesInput {
            geometry: Geometry { meshes },
            tests,
            timestamps: None,
        };
        stages.stage("holes", |encoder| {
            fitter.record(device, encoder, &input, cutouts, &mut self.cloud)
        })
    }

    /// One an output of the effect.
    pub fn targets(&self) -> &[wgpu::TextureView] {
        &self.targets
    }

    /// Records all passes, a stage each.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        stages: &mut impl Stages,
        subject: &Subject<'_>,
        preset: &Preset,
    ) -> Result<(), Error> {
        let Subject {
            raster,
            meshes,
            camera,
            holes,
            lamps,
        } = *subject;
        let device = &gpu.device;
        let mut settings = preset.surfelizer;
        settings.reach = if lamps.is_some() {
            // What is far may shadow what is near, and bright surfels reach farther.
            Reach::default()
        } else {
            ShellSplatter::reach(&preset.splat)
        };
        let surfelize = SurfelizerInput {
            geometry: Geometry { meshes },
            camera,
            cull_by: &[*camera],
            timestamps: None,
        };
        stages.stage("surfelize", |encoder| {
            let cloud = &mut self.cloud;
            self.surfelizer
                .record(device, encoder, &surfelize, &settings, cloud)
        })?;
        if let Some(tests) = holes {
            self.fit(gpu, stages, meshes, tests)?;
        }
        if let (Some(lighting), Some(lamps)) = (&self.lighting, &lamps) {
            lighting.record(gpu, stages, &self.cloud, lamps)?;
        }
        let radiance = self.lighting.as_ref().map(|lighting| &lighting.radiance);
        let cluster = ClusterInput {
            radiance,
            ..ClusterInput::new(&self.cloud)
        };
        stages.stage("cluster", |encoder| {
            let clusters = &mut self.clusters;
            self.splatter
                .record_clusters(device, encoder, &cluster, &preset.splat, clusters)
        })?;
        let origin = self.cloud.origin();
        let gbuffer = GBuffer {
            roughness: self.roughness.as_ref().map(|view| view.texture().into()),
            ..raster.gbuffer()
        };
        let frame = self.decoding.staged(gpu, stages, gbuffer, camera, origin)?;
        let environment = self.environment.as_ref().map(EnvironmentLight::new);
        let splat = SplatInput {
            radiance,
            environment,
            ..SplatInput::new(&frame, &self.cloud, &self.clusters)
        };
        stages.stage("splat", |encoder| {
            self.splatter
                .record(device, encoder, &splat, &preset.splat, &self.view)
        })?;
        let slices = self.targets.iter().map(|target| target.texture().into());
        let slices: Vec<TextureSlice<'_>> = slices.collect();
        let reconstruct = ReconstructorInput {
            further: &slices[1..],
            environment,
            ..ReconstructorInput::new(&frame, &self.view, slices[0])
        };
        stages.stage("reconstruct", |encoder| {
            let settings = &preset.reconstructor;
            self.reconstructor
                .record(device, encoder, &reconstruct, settings, &self.scratch)
        })
    }
}

//! One side's passes: made for an effect and a method, recorded with whatever settings.

use deep_screen_space::{
    AmbientOcclusion, BentNormals, Camera, CloudCapacity, DepthMoments, DiffuseBounce,
    DirectionalOcclusion, Environment, EnvironmentBuilder, EnvironmentLight, EnvironmentSettings,
    Error, GBuffer, GathererBinding, MotionVectors, ObscuranceInput, ObscuranceSampling,
    ObscuranceVolume, RayTracedInput, RayTracedView, RayTracedViewDescriptor, ScreenSpaceGi,
    ScreenSpaceGiInput, SgHullSize, SoftShadows, SoftShadowsInput, SoftShadowsSettings,
    SpecularBounce, SubsurfaceScattering, SurfelCounts, VolumetricObscurance,
    VolumetricObscuranceDescriptor,
    wgpu::{self, BufferUsages, TextureFormat, TextureView},
};
use support::{
    ambient_occlusion::{Lamps, Renderer, Subject},
    gpu::Gpu,
    hull::HullRenderer,
    near::{Illuminator, ShadowedLight},
    raster::{Raster, Rasterizer},
    scene::SceneBuffers,
    sky,
    stages::Stages,
};

use crate::{
    look::{Effect, Look, Method},
    place::Place,
    rays::Scenes,
};

/// What one frame's passes work on.
#[derive(Clone, Copy)]
pub struct Scenery<'a> {
    pub gpu: &'a Gpu,
    pub place: &'a Place,
    pub scenes: &'a Scenes,
    pub camera: &'a Camera,
    pub raster: &'a Raster,
    /// Drawn anew where the place's own object moves.
    pub lamp: &'a ShadowedLight,
    /// Whether the object moved since the last frame.
    pub moved: bool,
    /// Where surfaces were, of a frame in which the object moved, for passes that join frames.
    pub motion: Option<&'a TextureView>,
    /// Whether to forget earlier frames.
    pub reset: bool,
}

/// The passes, and the texture that they fill.
pub struct Passes {
    /// What cannot be changed without making them anew.
    made_for: Look,
    size: [u32; 2],
    target: TextureView,
    kind: Kind,
}

enum Kind {
    Rays {
        view: Box<RayTracedView>,
        environment: Option<Environment>,
    },
    Splats {
        renderer: Box<Renderer>,
        /// The scene in the materials of the body that scatters.
        masked: Option<(SceneBuffers, Rasterizer, Raster)>,
    },
    Obscurance {
        pass: VolumetricObscurance,
        /// Of the depth, where samples are areas.
        moments: Option<Box<DepthMoments>>,
    },
    Shadows(SoftShadows),
    Screen(Box<Screen>),
    Hull {
        renderer: Box<HullRenderer>,
        lights: GathererBinding,
    },
}

/// Light of what is on screen, and what lights that.
struct Screen {
    pass: ScreenSpaceGi,
    shadows: SoftShadows,
    illuminator: Illuminator,
    visible: TextureView,
    lit: TextureView,
}

impl Passes {
    /// # Errors
    /// What the crate finds.
    pub fn new(gpu: &Gpu, place: &Place, look: &Look, size: [u32; 2]) -> Result<Self, Error> {
        let [width, height] = size;
        let kind = match look.method {
            Method::Rays => rays(gpu, place, look)?,
            Method::Splats => splats(gpu, place, look, size)?,
            Method::Depths => match look.effect {
                Effect::SoftShadows => Kind::Shadows(SoftShadows::new(&gpu.device)?),
                Effect::IndirectDiffuse => Kind::Screen(Box::new(Screen {
                    pass: ScreenSpaceGi::new(&gpu.device)?,
                    shadows: SoftShadows::new(&gpu.device)?,
                    illuminator: Illuminator::new(gpu),
                    visible: gpu.storage(TextureFormat::R32Float, width, height),
                    lit: gpu.storage(TextureFormat::Rgba16Float, width, height),
                })),
                _ => {
                    let descriptor = VolumetricObscuranceDescriptor {
                        sampling: look.sampling,
                        volume: look.volume,
                    };
                    let pass = VolumetricObscurance::new(&gpu.device, &descriptor)?;
                    let moments = takes_areas(look.sampling)
                        .then(|| pass.create_moments(&gpu.device, width, height))
                        .transpose()?
                        .map(Box::new);
                    Kind::Obscurance { pass, moments }
                }
            },
            Method::Hull => {
                let room = SgHullSize {
                    grid: look.hull_size.grid,
                    ..SgHullSize::new(width, height)
                };
                let mut renderer = HullRenderer::new(gpu, room, look.components)?;
                let origin = place.views[0].1.eye;
                let lights = renderer.lights(gpu, &place.buffers, &place.map, origin)?;
                Kind::Hull {
                    renderer: Box::new(renderer),
                    lights,
                }
            }
        };
        let target = match &kind {
            Kind::Rays { .. } => gpu.target(TextureFormat::Rgba32Float, width, height),
            Kind::Splats { renderer, .. } => renderer.targets()[0].clone(),
            Kind::Obscurance { .. } | Kind::Shadows(_) => {
                gpu.storage(TextureFormat::R32Float, width, height)
            }
            Kind::Screen(_) => gpu.storage(TextureFormat::Rgba16Float, width, height),
            Kind::Hull { renderer, .. } => renderer.target.clone(),
        };
        Ok(Self {
            made_for: *look,
            size,
            target,
            kind,
        })
    }

    /// Takes another size; false where they have to be made anew for it.
    pub fn resize(&mut self, gpu: &Gpu, size: [u32; 2]) -> bool {
        if self.size == size {
            return true;
        }
        let [width, height] = size;
        let format = self.target.texture().format();
        match &mut self.kind {
            Kind::Rays { .. } => self.target = gpu.target(format, width, height),
            Kind::Obscurance { moments: None, .. } | Kind::Shadows(_) => {
                self.target = gpu.storage(format, width, height);
            }
            Kind::Screen(screen) => {
                self.target = gpu.storage(format, width, height);
                for view in [&mut screen.visible, &mut screen.lit] {
                    *view = gpu.storage(view.texture().format(), width, height);
                }
            }
            Kind::Obscurance { .. } | Kind::Splats { .. } | Kind::Hull { .. } => return false,
        }
        self.size = size;
        true
    }

    /// Whether they can be recorded with these settings, or have to be made anew.
    pub fn fit(&self, look: &Look) -> bool {
        let made = &self.made_for;
        let same = (made.effect, made.method) == (look.effect, look.method);
        same && match look.method {
            Method::Rays => {
                made.rays.further.is_some() == look.rays.further.is_some()
                    && made.rays.emitter_samples == look.rays.emitter_samples
                    && made.temporal == look.temporal
                    && made.further_bounces().is_some() == look.further_bounces().is_some()
                    && made.sky == look.sky
            }
            Method::Splats => {
                let effect = |look: &Look| {
                    let body = (look.material, look.millimetres, look.unit, look.f0);
                    (look.two_sided, look.overlap, body, look.sky, look.roughness)
                };
                effect(made) == effect(look)
                    && made.splats.splat.levels == look.splats.splat.levels
                    && made.surfels == look.surfels
            }
            Method::Depths => {
                look.effect != Effect::AmbientOcclusion
                    || (made.sampling, made.volume) == (look.sampling, look.volume)
            }
            Method::Hull => (made.hull_size, made.components) == (look.hull_size, look.components),
        }
    }

    /// The picture, of whatever format of floats.
    pub fn target(&self) -> &TextureView {
        &self.target
    }

    /// GPU memory that they own besides what both sides share, bytes.
    pub fn memory_bytes(&self) -> u64 {
        match &self.kind {
            Kind::Rays { view, environment } => {
                let environment = environment.as_ref();
                view.memory_bytes() + environment.map_or(0, Environment::memory_bytes)
            }
            Kind::Splats { renderer, .. } => renderer.memory_bytes(),
            Kind::Hull { renderer, .. } => renderer.view.memory_bytes(),
            Kind::Obscurance { moments, .. } => {
                moments.as_deref().map_or(0, DepthMoments::memory_bytes)
            }
            Kind::Shadows(_) | Kind::Screen(_) => 0,
        }
    }

    /// Of the last frame's surfels, where there are some: waits for it.
    pub fn counts(&self, gpu: &Gpu) -> Option<SurfelCounts> {
        let Kind::Splats { renderer, .. } = &self.kind else {
            return None;
        };
        let counts: Vec<SurfelCounts> = gpu.read_buffer(renderer.cloud.counters());
        counts.first().copied()
    }

    /// Records a frame.
    ///
    /// # Errors
    /// What the crate finds.
    pub fn record(
        &mut self,
        stages: &mut impl Stages,
        scenery: &Scenery<'_>,
        look: &Look,
    ) -> Result<(), Error> {
        let Scenery {
            gpu,
            place,
            camera,
            raster,
            ..
        } = *scenery;
        let device = &gpu.device;
        let target = self.target.texture();
        match &mut self.kind {
            Kind::Rays { view, environment } => {
                view.set_effect(look.ray_traced())?;
                view.set_rays(look.rays)?;
                let scene = scenery.scenes.of(look).ok_or(Error::Recording {
                    name: "RayTracedScene",
                    found: "not there".into(),
                })?;
                let roughness = (look.effect == Effect::IndirectSpecular)
                    .then(|| roughness(gpu, look, self.size));
                let gbuffer = GBuffer {
                    roughness: roughness.as_ref().map(|view| view.texture().into()),
                    ..raster.gbuffer()
                };
                let motion = scenery.motion.filter(|_| look.joins_frames());
                let input = RayTracedInput {
                    motion: motion.map(|vectors| MotionVectors::uv(vectors.texture())),
                    reset: scenery.reset,
                    environment: environment.as_ref().map(EnvironmentLight::new),
                    ..RayTracedInput::new(gbuffer, camera, target)
                };
                stages.stage("rays and filter", |encoder| {
                    view.record(device, encoder, scene, &input)
                })
            }
            Kind::Splats { renderer, masked } => {
                let mut splats = look.splats;
                splats.splat.radius = look.reach();
                let (buffers, raster) = match masked {
                    Some((buffers, rasterizer, raster)) => {
                        stages.stage("G-buffer", |encoder| {
                            rasterizer.record(gpu, encoder, (buffers, camera), raster);
                        });
                        (&*buffers, &*raster)
                    }
                    None => (&place.buffers, raster),
                };
                let is_body = look.effect == Effect::SubsurfaceScattering;
                let lit = look.is_lit() || is_body;
                // Of a body's materials nothing shines: without another light it has the lamp that casts shadows.
                let lamp = [scenery.lamp.light];
                let lights = if is_body && place.lights.is_empty() {
                    &lamp[..]
                } else {
                    &place.lights[..]
                };
                let tests = buffers.tests();
                let subject = Subject {
                    raster,
                    meshes: &buffers.meshes(),
                    camera,
                    holes: buffers.alpha_tests(&tests),
                    lamps: lit.then_some(Lamps {
                        materials: &buffers.materials,
                        lights,
                    }),
                };
                renderer.record(gpu, stages, &subject, &splats)
            }
            Kind::Obscurance { pass, moments } => {
                let gbuffer = raster.gbuffer();
                if let Some(moments) = moments {
                    stages.stage("moments", |encoder| {
                        pass.record_moments(device, encoder, gbuffer.depth, camera, moments, None)
                    })?;
                }
                let of_normals = look.volume != ObscuranceVolume::Sphere;
                let input = ObscuranceInput {
                    depth: gbuffer.depth,
                    normals: of_normals.then(|| gbuffer.normals()),
                    camera,
                    moments: moments.as_deref(),
                    work: None,
                    target: target.into(),
                    timestamps: None,
                };
                stages.stage("obscurance", |encoder| {
                    pass.record(device, encoder, &input, &look.obscurance)
                })
            }
            Kind::Shadows(pass) => stages.stage("soft shadows", |encoder| {
                let settings = &look.shadows;
                shadows(scenery, pass, settings, target, encoder)
            }),
            Kind::Screen(screen) => {
                let Screen {
                    pass,
                    shadows: of_light,
                    illuminator,
                    visible,
                    lit,
                } = &**screen;
                stages.stage("light", |encoder| {
                    let hard = SoftShadowsSettings::hard();
                    shadows(scenery, of_light, &hard, visible.texture(), encoder)?;
                    let what = (camera, raster, scenery.lamp.light);
                    illuminator.record(gpu, encoder, what, [visible, lit]);
                    Ok(())
                })?;
                let input = ScreenSpaceGiInput {
                    gbuffer: raster.gbuffer(),
                    camera,
                    lit: lit.texture().into(),
                    work: None,
                    target: target.into(),
                    timestamps: None,
                };
                stages.stage("screen", |encoder| {
                    pass.record(device, encoder, &input, &look.screen)
                })
            }
            Kind::Hull { renderer, lights } => {
                if scenery.moved {
                    let origin = place.views[0].1.eye;
                    *lights = renderer.lights(gpu, &place.buffers, &place.map, origin)?;
                }
                renderer.settings = look.hull;
                renderer.record(gpu, stages, (raster, camera, lights))
            }
        }
    }
}

fn shadows(
    scenery: &Scenery<'_>,
    pass: &SoftShadows,
    settings: &SoftShadowsSettings,
    target: &wgpu::Texture,
    encoder: &mut wgpu::CommandEncoder,
) -> Result<(), Error> {
    let input = SoftShadowsInput {
        gbuffer: scenery.raster.gbuffer(),
        camera: scenery.camera,
        light: &scenery.lamp.light,
        map: scenery.lamp.map(),
        work: None,
        target: target.into(),
        timestamps: None,
    };
    pass.record(&scenery.gpu.device, encoder, &input, settings)
}

fn rays(gpu: &Gpu, place: &Place, look: &Look) -> Result<Kind, Error> {
    let descriptor = RayTracedViewDescriptor {
        effect: look.ray_traced(),
        rays: look.rays,
        primitives: place.primitives(),
        environment: false,
        further_bounces: look.further_bounces().is_some(),
        temporal: look.temporal.filter(|_| look.joins_frames()),
        target: TextureFormat::Rgba32Float,
    };
    Ok(Kind::Rays {
        view: Box::new(RayTracedView::new(&gpu.device, &descriptor)?),
        environment: (look.effect == Effect::DirectionalOcclusion)
            .then(|| environment(gpu, look))
            .transpose()?,
    })
}

fn splats(gpu: &Gpu, place: &Place, look: &Look, size: [u32; 2]) -> Result<Kind, Error> {
    let (two_sided, overlap, unit) = (look.two_sided, look.overlap, look.unit);
    let effect = match look.effect {
        Effect::BentNormals => BentNormals { two_sided, overlap }.effect(),
        Effect::DirectionalOcclusion => DirectionalOcclusion { two_sided, overlap }.effect(),
        Effect::IndirectDiffuse => DiffuseBounce { two_sided, unit }.effect()?,
        Effect::IndirectSpecular => SpecularBounce {
            two_sided,
            unit,
            f0: look.f0,
        }
        .effect()?,
        Effect::SubsurfaceScattering => look.scattering().effect()?,
        Effect::AmbientOcclusion | Effect::SoftShadows => AmbientOcclusion {
            two_sided,
            overlap,
            ..AmbientOcclusion::default()
        }
        .effect(),
    };
    let triangles = place.buffers.triangles();
    let capacity = CloudCapacity {
        surfels: look.surfels,
        pieces: triangles.saturating_add(100_000).min(1 << 23),
        triangles,
    };
    let levels = look.splats.splat.levels;
    let mut renderer = Renderer::of(gpu, &effect, capacity, size, levels, false)?;
    if effect.environment {
        renderer.environment = Some(environment(gpu, look)?);
    }
    renderer.roughness = effect.roughness.then(|| roughness(gpu, look, size));
    let masked = (look.effect == Effect::SubsurfaceScattering).then(|| {
        // The first of the materials is the body's, as in the example `render`.
        let table = SubsurfaceScattering::senders(place.scene.materials.len(), |of| of == 0);
        let mut buffers = place.buffers.clone();
        buffers.materials = gpu.buffer(&table, BufferUsages::STORAGE);
        let rasterizer = Rasterizer::new(gpu, &buffers);
        (buffers, rasterizer, Raster::new(gpu, size))
    });
    Ok(Kind::Splats {
        renderer: Box::new(renderer),
        masked,
    })
}

/// The sky that was chosen, for rays and for sums.
fn environment(gpu: &Gpu, look: &Look) -> Result<Environment, Error> {
    let name = sky::NAMES[look.sky % sky::NAMES.len()];
    let builder = EnvironmentBuilder::new(&gpu.device)?;
    let settings = EnvironmentSettings {
        levels: true,
        ..EnvironmentSettings::default()
    };
    let picture = sky::by_name(name).unwrap_or_else(|| panic!("{name} is one of the skies"));
    sky::build(gpu, &builder, &picture, &settings)
}

/// That of all pixels alike.
fn roughness(gpu: &Gpu, look: &Look, [width, height]: [u32; 2]) -> TextureView {
    let texels = vec![look.roughness; (width * height) as usize];
    gpu.texture(TextureFormat::R32Float, width, height, &texels)
}

/// The tables that obscurance has.
pub const SAMPLINGS: [ObscuranceSampling; 13] = {
    use ObscuranceSampling::{Areas, Lines, OneArea, Points};
    use deep_screen_space::{BallSamples as B, DiskSamples as D};
    [
        Points(B::Six),
        Points(B::Twelve),
        Points(B::ThirtyThree),
        Points(B::SixtyFour),
        Lines(D::Five),
        Lines(D::Six),
        Lines(D::Nine),
        Lines(D::Thirteen),
        Areas(D::Five),
        Areas(D::Six),
        Areas(D::Nine),
        Areas(D::Thirteen),
        OneArea,
    ]
};

/// Whether a sampling reads the depth's moments.
fn takes_areas(sampling: ObscuranceSampling) -> bool {
    matches!(
        sampling,
        ObscuranceSampling::Areas(_) | ObscuranceSampling::OneArea
    )
}

//! One view's effect: its textures, and its recording into the caller's target.

use wgpu::{CommandEncoder, Device, Texture, TextureFormat, TextureUsages};

use super::{
    quality::{Quality, RaySettings},
    scene::RayTracedScene,
};
use crate::{
    bounced_z_buffer::{
        BouncedInput, BouncedZBuffer,
        descriptor::{BouncedDescriptor, HitRadiance, Payload},
        settings::{BouncedSettings, MAX_FRAME, Sampling},
        view::BouncedView,
    },
    bvh::Primitives,
    camera::{Camera, Viewport},
    effect::Channels,
    environment::EnvironmentLight,
    error::{Error, check_setting},
    gbuffer::GBuffer,
    gpu::compiler::Compiler,
    gpu::screen,
    hit_resolver::{
        HitEstimateInput, HitResolver, HitResolverDescriptor, HitResolverInput, HitResolverView,
        settings::HitResolverSettings,
    },
    ray_budget::{RayBudget, RayBudgetInput, view::RayBudgetView},
    receivers::{Frame, FrameInput, GBufferDecoder, Receivers, plane_bytes, plane_for},
    recorded::never,
    temporal_accumulator::{
        MotionVectors, TemporalAccumulator, TemporalHistory, TemporalInput, TemporalJoinInput,
        settings::TemporalSettings,
    },
    texture_slice::{TextureSlice, check_apart},
};

/// What a [`RayTracedView`] shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RayTracedEffect {
    /// Ambient visibility, 0 to 1 (open), in all channels.
    AmbientOcclusion {
        /// The distance beyond which nothing occludes, world units, ≥ 0; `f32::INFINITY` for none.
        radius: f32,
    },
    /// What a white diffuse surface sends on of an [`Environment`](crate::Environment), where nothing hides it: irradiance over
    /// π, W/(m² sr), linear RGB; times a surface's albedo what it reflects. The environment is [`RayTracedInput::environment`]'s.
    DirectionalOcclusion {
        /// The distance beyond which nothing occludes, world units, ≥ 0; `f32::INFINITY` for none.
        radius: f32,
    },
    /// The mean direction in which nothing is, and ambient visibility, in four channels:
    /// [`HitResolverDescriptor::bent_normals`]. Each frame for itself.
    BentNormals {
        /// The distance beyond which nothing occludes, world units, ≥ 0; `f32::INFINITY` for none.
        radius: f32,
    },
    /// Reflected radiance, W/(m² sr), of one diffuse bounce, or of [more](RayTracedViewDescriptor::further_bounces): albedo times
    /// what arrives from lit surfaces. The G-buffer has albedo.
    IndirectDiffuse {
        /// What arrives from where nothing is, linear RGB, W/(m² sr).
        sky_radiance: [f32; 3],
    },
    /// Reflected radiance, W/(m² sr), of one glossy bounce, or of [more](RayTracedViewDescriptor::further_bounces), of which the
    /// others are diffuse. The G-buffer has roughness.
    IndirectSpecular {
        /// What arrives from where nothing is, linear RGB, W/(m² sr).
        sky_radiance: [f32; 3],
    },
}

impl RayTracedEffect {
    /// What is kept of a hit.
    pub fn payload(&self) -> Payload {
        match self {
            Self::AmbientOcclusion { .. } | Self::BentNormals { .. } => Payload::Occlusion,
            Self::DirectionalOcclusion { .. } => Payload::Sky,
            Self::IndirectDiffuse { .. } | Self::IndirectSpecular { .. } => Payload::LitRadiance,
        }
    }

    /// The same, with what surfels gathered if more than one bounce is to be seen.
    fn payload_with(&self, further_bounces: bool) -> Payload {
        match self.payload() {
            Payload::LitRadiance if further_bounces => Payload::LitAndGathered,
            payload => payload,
        }
    }

    /// These rays, with the filter that suits the effect.
    pub(crate) fn suited(&self, rays: RaySettings) -> RaySettings {
        match self {
            Self::BentNormals { .. } => RaySettings {
                filter: HitResolverSettings::for_bent_normals(rays.rays_per_pixel),
                ..rays
            },
            Self::IndirectSpecular { .. } => rays.for_glossy(),
            _ => rays,
        }
    }

    /// The rays of a quality, with the filter that suits the effect.
    pub(crate) fn rays(&self, quality: Quality) -> RaySettings {
        match self {
            Self::IndirectSpecular { .. } => quality.glossy_rays(),
            _ => self.suited(quality.rays(self.payload())),
        }
    }

    pub(crate) fn sampling(&self) -> Sampling {
        match self {
            Self::IndirectSpecular { .. } => Sampling::Glossy,
            _ => Sampling::Cosine,
        }
    }

    fn channels(&self) -> Channels {
        match self {
            Self::AmbientOcclusion { .. } | Self::BentNormals { .. } => Channels::One,
            _ => Channels::Three,
        }
    }
}

/// What a [`RayTracedView`] is made for.
#[derive(Clone, Copy, Debug)]
pub struct RayTracedViewDescriptor {
    /// The effect.
    pub effect: RayTracedEffect,
    /// Rays per pixel, and the filter.
    pub rays: RaySettings,
    /// What rays meet: what the scene was made for.
    pub primitives: Primitives,
    /// Whether what arrives from where nothing is comes from [`RayTracedInput::environment`] in place of the effect's
    /// `sky_radiance`. So it does for [`RayTracedEffect::DirectionalOcclusion`] in any case, and it is of no use to
    /// [`RayTracedEffect::AmbientOcclusion`] and [`RayTracedEffect::BentNormals`].
    pub environment: bool,
    /// Whether indirect light has the further bounces that the scene was [made for](RayTracedScene::with_bounces).
    pub further_bounces: bool,
    /// How frames are joined, if they are: each then has rays of its own, and few are enough. Diffuse light with the same number
    /// of rays at every pixel is joined before it is filtered, in a window that narrows as frames come
    /// ([`TemporalAccumulator::join`]); all else after.
    pub temporal: Option<TemporalSettings>,
    /// Format of the caller's texture: any colour format of floats that can be rendered to.
    pub target: TextureFormat,
}

impl RayTracedViewDescriptor {
    /// Each frame for itself.
    pub fn new(effect: RayTracedEffect, quality: Quality, target: TextureFormat) -> Self {
        Self {
            effect,
            rays: effect.rays(quality),
            primitives: Primitives::default(),
            environment: false,
            further_bounces: false,
            temporal: None,
            target,
        }
    }
}

/// What one recording of a [`RayTracedView`] works on.
#[derive(Clone, Copy, Debug)]
pub struct RayTracedInput<'a> {
    /// The caller's G-buffer.
    pub gbuffer: GBuffer<'a>,
    /// The camera that it was drawn with.
    pub camera: &'a Camera,
    /// Where surfaces were in the last frame, for a view that joins frames; `None` where only the camera moves.
    pub motion: Option<MotionVectors<'a>>,
    /// The camera of the last recording where it is not as it was given then, as when the world's origin was moved since: in the
    /// world of now, with a viewport of the same size. Without it that of the last recording.
    pub previous_camera: Option<&'a Camera>,
    /// Whether to forget earlier frames, as a camera's cut needs.
    pub reset: bool,
    /// What comes from where nothing is, for [`RayTracedEffect::DirectionalOcclusion`] and a view that was made for
    /// [`RayTracedViewDescriptor::environment`].
    pub environment: Option<EnvironmentLight<'a>>,
    /// The caller's texture, of the view's format, usage `RENDER_ATTACHMENT`, covering the camera's viewport. Only the
    /// viewport is written.
    pub target: TextureSlice<'a>,
}

impl<'a> RayTracedInput<'a> {
    /// Of a world in which only the camera moves.
    pub fn new(
        gbuffer: GBuffer<'a>,
        camera: &'a Camera,
        target: impl Into<TextureSlice<'a>>,
    ) -> Self {
        Self {
            gbuffer,
            camera,
            motion: None,
            previous_camera: None,
            reset: false,
            environment: None,
            target: target.into(),
        }
    }
}

/// Ambient occlusion or indirect light for one camera, by rays among a [`RayTracedScene`]'s triangles: the [`GBufferDecoder`],
/// the [`BouncedZBuffer`], the [`HitResolver`] and, where frames are joined, the [`TemporalAccumulator`], with the textures that
/// they need.
///
/// Textures are made by the first recording, and made anew where the camera's viewport has another size, with which frames that
/// were joined are forgotten, or where [`RayTracedView::set_rays`] asks for more rays than before, with which they are not.
#[derive(Debug)]
pub struct RayTracedView {
    effect: RayTracedEffect,
    target: TextureFormat,
    rays: RaySettings,
    passes: Passes,
    temporal: Option<Temporal>,
    room: Option<Room>,
}

/// What each frame is made by.
#[derive(Debug)]
struct Passes {
    decoder: GBufferDecoder,
    tracer: BouncedZBuffer,
    resolver: HitResolver,
    budget: Option<RayBudget>,
}

#[derive(Debug)]
struct Temporal {
    accumulator: TemporalAccumulator,
    settings: TemporalSettings,
    /// Whether frames are joined before they are filtered.
    joins_rays: bool,
    previous: Option<Camera>,
    /// Which rays the next frame takes.
    frame: u32,
}

impl Passes {
    /// Rays, and further ones where noise is if there are any.
    fn trace(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        (frame, met): (&Frame<'_>, &BouncedInput<'_>),
        (settings, rays): (&BouncedSettings, &RaySettings),
        views: &Views,
    ) -> Result<(), Error> {
        self.tracer
            .record(device, encoder, met, settings, &views.hits)?;
        let (Some(further), Some(budget), Some(list)) =
            (&rays.further, &self.budget, &views.budget)
        else {
            return Ok(());
        };
        self.estimate(device, encoder, frame, rays, views)?;
        let noise = RayBudgetInput::new(frame, &views.hits, &views.scratch, &rays.filter);
        budget.record(device, encoder, &noise, further, list)?;
        let into = (&views.hits, list);
        self.tracer
            .record_more(device, encoder, met, settings, into)
    }

    /// What each pixel's own rays tell.
    fn estimate(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        frame: &Frame<'_>,
        rays: &RaySettings,
        views: &Views,
    ) -> Result<(), Error> {
        let hits = HitEstimateInput::new(frame, &views.hits);
        self.resolver
            .estimate(device, encoder, &hits, &rays.filter, &views.scratch)
    }

    fn resolve(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        picture: &HitResolverInput<'_>,
        rays: &RaySettings,
        views: &Views,
    ) -> Result<(), Error> {
        self.resolver
            .record(device, encoder, picture, &rays.filter, &views.scratch)
    }
}

impl Temporal {
    /// The camera of the frame before, or this one's where there was none.
    fn previous(&self, input: &RayTracedInput<'_>) -> Camera {
        let last = self.previous.as_ref();
        let last = last.map(|last| input.previous_camera.unwrap_or(last));
        *last.unwrap_or(input.camera)
    }

    /// Joins what pixels' own rays tell, before it is filtered.
    fn join(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        (frame, input): (&Frame<'_>, &RayTracedInput<'_>),
        views: &mut Views,
    ) -> Result<(), Error> {
        let Some(frames) = &mut views.frames else {
            return Ok(());
        };
        let previous = self.previous(input);
        let rays = TemporalJoinInput {
            motion: input.motion,
            reset: input.reset,
            ..TemporalJoinInput::new(frame, &previous, &views.scratch)
        };
        let into = (&self.settings, &mut frames.history);
        self.accumulator
            .join(device, encoder, &rays, into.0, into.1)
    }

    /// Joins pictures, into the caller's target.
    fn accumulate(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        (frame, input): (&Frame<'_>, &RayTracedInput<'_>),
        views: &mut Views,
    ) -> Result<(), Error> {
        let Some(Frames {
            history,
            picture: Some(picture),
        }) = &mut views.frames
        else {
            return Ok(());
        };
        let previous = self.previous(input);
        let pictures = TemporalInput {
            motion: input.motion,
            reset: input.reset,
            ..TemporalInput::new(frame, &previous, &*picture, input.target)
        };
        self.accumulator
            .record(device, encoder, &pictures, &self.settings, history)
    }
}

/// What a size asks for.
#[derive(Debug)]
struct Room {
    size: [u32; 2],
    rays_per_pixel: u32,
    receivers: Receivers,
    views: Views,
}

/// What passes write.
#[derive(Debug)]
struct Views {
    hits: BouncedView,
    scratch: HitResolverView,
    budget: Option<RayBudgetView>,
    frames: Option<Frames>,
}

impl Views {
    /// One frame's picture, for effects whose frames are filtered before they are joined.
    fn picture(&self) -> Option<&Texture> {
        self.frames.as_ref()?.picture.as_ref()
    }
}

/// What frames are joined in.
#[derive(Debug)]
struct Frames {
    history: TemporalHistory,
    /// One frame's, for effects whose frames are filtered before they are joined.
    picture: Option<Texture>,
}

/// [`BouncedSettings::frame`] has a largest value; a power of two of frames is as good as any number.
const FRAMES: u32 = MAX_FRAME;

impl RayTracedView {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// [`Error::Format`] for a target that cannot be rendered to or does not hold floats; [`Error::Setting`] for settings out of
    /// range; [`Error::Feature`] and [`Error::Limit`] for primitives that the device was not made for; [`Error::Mismatch`] for
    /// bent normals over frames.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        descriptor: &RayTracedViewDescriptor,
    ) -> Result<Self, Error> {
        let compiler = compiler.into();
        let device = compiler.device;
        let RayTracedViewDescriptor {
            effect,
            rays,
            primitives,
            environment,
            further_bounces,
            temporal,
            target,
        } = *descriptor;
        let bent_normals = matches!(effect, RayTracedEffect::BentNormals { .. });
        screen::check_format(device, "RayTracedView target", target)?;
        check_rays(&effect, &rays)?;
        check_setting(
            !further_bounces || effect.payload() == Payload::LitRadiance,
            "RayTracedViewDescriptor::further_bounces",
            f64::from(u8::from(further_bounces)),
            "true for indirect light alone",
        )?;
        let tracer = BouncedDescriptor {
            payload: effect.payload_with(further_bounces),
            sampling: effect.sampling(),
            primitives,
            counted: rays.further.is_some(),
            emitter_samples: rays.emitter_samples,
            environment: effect.payload() == Payload::Sky
                || (environment && effect.payload().is_radiance()),
            ..BouncedDescriptor::default()
        };
        let tracer = BouncedZBuffer::new(compiler, &tracer)?;
        if bent_normals && temporal.is_some() {
            return Err(Error::Mismatch {
                name: "RayTracedViewDescriptor::temporal",
                found: "frames that are joined".into(),
                needed: "none, for RayTracedEffect::BentNormals".into(),
            });
        }
        let temporal = temporal
            .map(|settings| {
                settings.validate()?;
                let channels = effect.channels();
                Ok(Temporal {
                    accumulator: TemporalAccumulator::new(compiler, channels, target)?,
                    settings,
                    joins_rays: joins_rays(&effect, &rays),
                    previous: None,
                    frame: 0,
                })
            })
            .transpose()?;
        let joined = temporal
            .as_ref()
            .is_some_and(|temporal| temporal.joins_rays);
        let resolved = match temporal {
            Some(_) if !joined => picture_format(&effect),
            _ => target,
        };
        let resolver = HitResolverDescriptor {
            joined,
            bent_normals,
            ..tracer.resolver_descriptor(resolved, false)
        };
        Ok(Self {
            passes: Passes {
                resolver: HitResolver::new(compiler, &resolver)?,
                decoder: GBufferDecoder::new(compiler)?,
                budget: rays
                    .further
                    .map(|_| RayBudget::with_sampling(compiler, effect.sampling()))
                    .transpose()?,
                tracer,
            },
            effect,
            target,
            rays,
            temporal,
            room: None,
        })
    }

    /// Changes rays and filter, from the next recording on.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings out of range, [`Error::Mismatch`] for further rays where the view was made without, and
    /// for another number of rays towards emitters; those of before stay.
    pub fn set_rays(&mut self, rays: RaySettings) -> Result<(), Error> {
        check_rays(&self.effect, &rays)?;
        if rays.further.is_some() && self.passes.budget.is_none() {
            return Err(Error::Mismatch {
                name: "RaySettings::further",
                found: "further rays".into(),
                needed: "none, as the view was made for".into(),
            });
        }
        let made_for = self.passes.tracer.descriptor().emitter_samples;
        if rays.emitter_samples != made_for {
            return Err(Error::Mismatch {
                name: "RaySettings::emitter_samples",
                found: rays.emitter_samples.to_string(),
                needed: format!("{made_for}, as the view was made for"),
            });
        }
        self.rays = rays;
        Ok(())
    }

    /// Changes the radius of ambient occlusion, or what arrives from where nothing is, from the next recording on.
    ///
    /// # Errors
    /// [`Error::Setting`] for values out of range, and for an effect of another kind; that of before stays.
    pub fn set_effect(&mut self, effect: RayTracedEffect) -> Result<(), Error> {
        let same = std::mem::discriminant(&effect) == std::mem::discriminant(&self.effect);
        check_setting(
            same,
            "RayTracedEffect",
            f64::from(u8::from(!same)),
            "one of the kind that the view was made for",
        )?;
        settings_of(&effect, &self.rays, 0).validate()?;
        self.effect = effect;
        Ok(())
    }

    /// Records the effect into the caller's texture.
    ///
    /// # Errors
    /// [`Error::Recording`] where the scene or the environment was not recorded; [`Error::Mismatch`] where it is of other
    /// primitives, where light is asked for and it was recorded without lighting, where an environment is needed and there is
    /// none, or where the G-buffer lacks the albedo or roughness that the effect needs; what [`GBuffer::validate`] finds;
    /// [`Error::Format`], [`Error::Size`] or [`Error::Usage`] for the target; [`Error::Limit`] for a viewport beyond the
    /// device's. What [`TemporalAccumulator::record`] finds of motion vectors comes after the frame's rays were recorded, and
    /// leaves the target alone.
    pub fn record(
        &mut self,
        device: &Device,
        encoder: &mut CommandEncoder,
        scene: &RayTracedScene,
        input: &RayTracedInput<'_>,
    ) -> Result<(), Error> {
        let traced = scene.traced().ok_or_else(|| never("RayTracedScene"))?;
        traced.check_primitives(self.passes.tracer.descriptor().primitives)?;
        traced.last()?;
        self.check(scene, input)?;
        let payload = self.payload();
        self.make_room(device, input.camera)?;
        let Some(room) = &mut self.room else {
            return Ok(());
        };
        let frame = FrameInput {
            origin: traced.origin(),
            ..FrameInput::new(input.gbuffer, input.camera)
        };
        let frame = self
            .passes
            .decoder
            .record(device, encoder, &frame, &mut room.receivers)?;
        let number = self.temporal.as_ref().map_or(0, |temporal| temporal.frame);
        let met = BouncedInput {
            radiance: match (payload, scene.lighting(), scene.gathered()) {
                (Payload::LitRadiance, Some(lighting), _) => HitRadiance::Lit(lighting),
                (Payload::LitAndGathered, Some(lighting), Some(gathered)) => {
                    HitRadiance::LitAndGathered { lighting, gathered }
                }
                _ => HitRadiance::None,
            },
            environment: input.environment,
            emitters: scene.emitters(),
            ..BouncedInput::of(&frame, traced)
        };
        let settings = settings_of(&self.effect, &self.rays, number);
        let (passes, rays, views) = (&self.passes, &self.rays, &mut room.views);
        passes.trace(device, encoder, (&frame, &met), (&settings, rays), views)?;
        let Some(temporal) = &mut self.temporal else {
            let picture = HitResolverInput::new(&frame, &views.hits, input.target);
            return passes.resolve(device, encoder, &picture, rays, views);
        };
        if temporal.joins_rays {
            passes.estimate(device, encoder, &frame, rays, views)?;
            temporal.join(device, encoder, (&frame, input), views)?;
            let picture = HitResolverInput {
                history: views.frames.as_ref().map(|frames| &frames.history),
                ..HitResolverInput::new(&frame, &views.hits, input.target)
            };
            passes.resolve(device, encoder, &picture, rays, views)?;
        } else if let Some(of_one_frame) = views.picture() {
            let picture = HitResolverInput::new(&frame, &views.hits, of_one_frame);
            passes.resolve(device, encoder, &picture, rays, views)?;
            temporal.accumulate(device, encoder, (&frame, input), views)?;
        }
        temporal.previous = Some(*input.camera);
        temporal.frame = (temporal.frame + 1) % FRAMES;
        Ok(())
    }

    /// GPU memory that it owns, bytes: nothing before the first recording.
    pub fn memory_bytes(&self) -> u64 {
        let Some(room) = &self.room else {
            return 0;
        };
        let frames = room.views.frames.as_ref().map_or(0, |frames| {
            let picture = frames.picture.as_ref().map_or(0, |picture| {
                plane_bytes(picture.format(), [picture.width(), picture.height()], 1)
            });
            picture + frames.history.memory_bytes()
        });
        room.receivers.memory_bytes()
            + room.views.hits.memory_bytes()
            + room.views.scratch.memory_bytes()
            + room
                .views
                .budget
                .as_ref()
                .map_or(0, RayBudgetView::memory_bytes)
            + frames
    }

    fn payload(&self) -> Payload {
        self.passes.tracer.descriptor().payload
    }

    /// What the passes would find only after others were recorded.
    fn check(&self, scene: &RayTracedScene, input: &RayTracedInput<'_>) -> Result<(), Error> {
        const TARGET: &str = "RayTracedInput::target";
        let viewport = input.camera.viewport();
        input.gbuffer.validate(viewport)?;
        match self.effect {
            RayTracedEffect::AmbientOcclusion { .. }
            | RayTracedEffect::DirectionalOcclusion { .. }
            | RayTracedEffect::BentNormals { .. } => {}
            RayTracedEffect::IndirectDiffuse { .. } => {
                input
                    .gbuffer
                    .albedo_for("RayTracedEffect::IndirectDiffuse")?;
            }
            RayTracedEffect::IndirectSpecular { .. } => {
                input
                    .gbuffer
                    .roughness_for("RayTracedEffect::IndirectSpecular")?;
            }
        }
        if self.passes.tracer.descriptor().environment {
            let Some(light) = input.environment else {
                return Err(Error::Mismatch {
                    name: "RayTracedInput::environment",
                    found: "none".into(),
                    needed: "an environment, as the view was made for".into(),
                });
            };
            light.validate()?;
        }
        if self.effect.payload() == Payload::LitRadiance && scene.lighting().is_none() {
            return Err(Error::Mismatch {
                name: "RayTracedSceneInput::lighting",
                found: "none".into(),
                needed: "materials and lights, for indirect light".into(),
            });
        }
        if self.payload() == Payload::LitAndGathered && scene.gathered().is_none() {
            return Err(Error::Mismatch {
                name: "RayTracedScene",
                found: "one bounce of light".into(),
                needed: "more, by RayTracedScene::with_bounces, for further_bounces".into(),
            });
        }
        if self.rays.emitter_samples > 0 && scene.emitters().is_none() {
            return Err(Error::Mismatch {
                name: "RayTracedScene",
                found: "no emitters".into(),
                needed: "RayTracedScene::with_emitters, for RaySettings::emitter_samples".into(),
            });
        }
        screen::check_target(TARGET, &input.target, viewport, self.target)?;
        check_apart(TARGET, &input.target, input.gbuffer.reads())
    }

    /// Makes the textures for the camera's viewport, unless they are there.
    fn make_room(&mut self, device: &Device, camera: &Camera) -> Result<(), Error> {
        let Viewport {
            x,
            y,
            width,
            height,
        } = camera.viewport();
        let rays_per_pixel = self.rays.rays_per_pixel;
        // The resolver writes the viewport's part of its target, and the accumulator reads it there.
        let extent = [x + width, y + height];
        let covers = |picture: &Texture| [picture.width(), picture.height()] == extent;
        let fits = |room: &Room| {
            room.size == [width, height]
                && room.rays_per_pixel >= rays_per_pixel
                && room.views.picture().is_none_or(covers)
        };
        if self.room.as_ref().is_some_and(fits) {
            return Ok(());
        }
        // The old textures go before there are new ones. What frames were joined to follows the size alone.
        let old = self.room.take();
        let kept = old.filter(|room| room.size == [width, height]);
        let kept = kept.and_then(|room| room.views.frames);
        let kept = kept.map(|frames| frames.history);
        let hits = self
            .passes
            .tracer
            .create_view(device, width, height, rays_per_pixel)?;
        let frames = match &mut self.temporal {
            Some(temporal) => {
                let picture = || {
                    plane_for(
                        device,
                        "deep-screen-space picture of one frame",
                        picture_format(&self.effect),
                        extent,
                        1,
                        TextureUsages::RENDER_ATTACHMENT,
                    )
                };
                let history = if let Some(history) = kept {
                    history
                } else {
                    temporal.previous = None;
                    temporal.accumulator.create_history(device, width, height)?
                };
                Some(Frames {
                    picture: (!temporal.joins_rays).then(picture).transpose()?,
                    history,
                })
            }
            None => None,
        };
        self.room = Some(Room {
            size: [width, height],
            rays_per_pixel,
            receivers: self
                .passes
                .decoder
                .create_receivers(device, width, height)?,
            views: Views {
                scratch: self.passes.resolver.create_view(device, &hits)?,
                budget: self
                    .passes
                    .budget
                    .as_ref()
                    .map(|budget| budget.create_view(device, width, height))
                    .transpose()?,
                hits,
                frames,
            },
        });
        Ok(())
    }
}

/// That rays can be had, for an effect.
fn check_rays(effect: &RayTracedEffect, rays: &RaySettings) -> Result<(), Error> {
    settings_of(effect, rays, 0).validate()?;
    rays.validate()
}

/// Whether frames are joined before they are filtered, which occlusion gains nothing by.
fn joins_rays(effect: &RayTracedEffect, rays: &RaySettings) -> bool {
    let diffuse_light = matches!(effect, RayTracedEffect::IndirectDiffuse { .. });
    diffuse_light && rays.further.is_none()
}

/// Of one frame before frames are joined.
fn picture_format(effect: &RayTracedEffect) -> TextureFormat {
    match effect.channels() {
        Channels::One => TextureFormat::R32Float,
        Channels::Three => TextureFormat::Rgba32Float,
    }
}

fn settings_of(effect: &RayTracedEffect, rays: &RaySettings, frame: u32) -> BouncedSettings {
    let (radius, sky_radiance) = match *effect {
        RayTracedEffect::AmbientOcclusion { radius }
        | RayTracedEffect::DirectionalOcclusion { radius }
        | RayTracedEffect::BentNormals { radius } => (radius, [0.0; 3]),
        RayTracedEffect::IndirectDiffuse { sky_radiance }
        | RayTracedEffect::IndirectSpecular { sky_radiance } => (f32::INFINITY, sky_radiance),
    };
    BouncedSettings {
        frame,
        sky_radiance,
        ..rays.bounced(radius)
    }
}

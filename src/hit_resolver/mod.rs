//! From hits to the caller's picture (The Bounced Z-buffer 3.3; `wgsl/hit_resolver.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use wgpu::{
    CommandEncoder, ComputePass, ComputePipeline, Device, RenderPipeline, TextureFormat,
    TextureView,
};

use self::{params::HitResolverParams, settings::HitResolverSettings};
use crate::{
    bounced_z_buffer::{
        BouncedZBuffer,
        descriptor::{BouncedDescriptor, MAX_EMITTER_SAMPLES, Payload},
        settings::Sampling,
        view::{BouncedView, Hits},
    },
    effect::{Channels, Listing},
    error::{Error, check_setting},
    gpu::compiler::Compiler,
    gpu::listing::name_of,
    gpu::{
        Timestamps,
        binding::{Groups, Kept, Layout, Named, Resource, view, whole},
        check_timestamps, compute_pass, first_pass,
        screen::{self, Screen},
        shader,
        uniforms::Uniforms,
    },
    receivers::{Frame, Place, plane, plane_bytes},
    recorded::Last,
    temporal_accumulator::TemporalHistory,
    texture_slice::{TextureSlice, check_apart},
};

const SOURCE: &str = include_str!("../../wgsl/hit_resolver.wgsl");

const LABEL: &str = "deep-screen-space hit resolver";

/// Gathers the hits of a [`BouncedZBuffer`](crate::BouncedZBuffer) over each pixel's neighbourhood, as wide as they are far away,
/// fits a plane to what it finds there, and writes its value at the pixel into the caller's texture: with [`Payload::Occlusion`]
/// ambient visibility, 1 = open, with [`Payload::Radiance`] the radiance that a diffuse surface of the G-buffer's albedo sends
/// on, linear RGB, W/(m² sr), and with [`Payload::Sky`] what a white one sends on of an environment: irradiance over π. The sky
/// is open, and dark. Made for either kind of radiance it takes the other too, with or without albedo as it was made for.
///
/// With [`Sampling::Glossy`] the surface is glossy instead: `∫ L(ω) f(ω, view) ⟨n, ω⟩ dω` with `f = D G F / (4 ⟨n, ω⟩ ⟨n,
/// view⟩)`, D and G those of Trowbridge-Reitz (GGX) with correlated heights (Heitz, *Understanding the Masking-Shadowing
/// Function in Microfacet-Based BRDFs*, 2014), and F that of [`HitResolverSettings::f0`]; albedo is not read. Visibility
/// is then weighed by `D G` alone. Without a window the mean over directions has no bias. With one a neighbour counts as far
/// as its lobe overlaps the pixel's, a mirror's own hits alone; its hits count by how much denser the pixel would draw them,
/// at most 4 times, divided by their sum, so that they are not as spread as they should be where lobes differ. What is
/// mirrored is taken to be as far away as the eye: nearer things, as at contact, are blurred by a wide window.
///
/// Holds pipelines only, for one kind of hits and one target format; one serves any number of views.
#[derive(Debug)]
pub struct HitResolver {
    descriptor: HitResolverDescriptor,
    average_layout: Layout,
    near_layout: Layout,
    uniforms: Uniforms,
    average: ComputePipeline,
    near: ComputePipeline,
    /// Of one frame's means; of those over frames, where the descriptor has them.
    reconstruct: (Layout, RenderPipeline),
    reconstruct_joined: Option<(Layout, RenderPipeline)>,
}

/// What a [`HitResolver`] is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each switches a part of the shaders"
)]
pub struct HitResolverDescriptor {
    /// The payload of the hits.
    pub payload: Payload,
    /// How their directions were drawn.
    pub sampling: Sampling,
    /// Whether neighbours' hits are weighed one by one by the receiving pixel's own cosine (The Bounced Z-buffer 3.3),
    /// so that detail of normals survives a wide window. Without, neighbours' means are: faster by about the number of
    /// directions.
    pub deferred: bool,
    /// As [`BouncedDescriptor::counted`] of the hits: pixels without rays take what they show from their neighbours.
    pub counted: bool,
    /// Whether to resolve means over frames too, where [`HitResolverInput::history`] has them; not with `deferred`.
    pub joined: bool,
    /// Whether the picture is bent normals in place of visibility: in xyz the mean of the directions in which nothing is hit,
    /// weighed by the cosine, made a unit vector of the world's axes (Landis, *Production-Ready Global Illumination*, 2002), the
    /// pixel's own normal where all is closed; in w ambient visibility, 0 to 1. Together they are a cone: one about the bent
    /// normal, of the half angle `asin(√w)`, is as open ([`HitResolver::cone_angle`]). Surfaces that have no normal, the sky, are
    /// 0 and open. With [`Payload::Occlusion`] and [`Sampling::Cosine`], and without `deferred`, `counted` and `joined`.
    pub bent_normals: bool,
    /// As [`BouncedDescriptor::emitter_samples`] of the hits; 0 with `deferred`.
    pub emitter_samples: u32,
    /// Any colour format that can be rendered to; its missing channels are dropped. For bent normals one of four channels that
    /// holds negative numbers.
    pub target: TextureFormat,
}

impl HitResolverDescriptor {
    fn glossy(&self) -> bool {
        self.sampling == Sampling::Glossy
    }

    /// Whether it multiplies by the G-buffer's albedo.
    fn albedo(&self) -> bool {
        self.payload.is_radiance() && !self.glossy() && self.payload != Payload::Sky
    }
}

/// What a [`HitResolver`] needs for a view: each pixel's own mean, and how near its hits are.
#[derive(Debug)]
pub struct HitResolverView {
    size: [u32; 2],
    pub(crate) means: TextureView,
    pub(crate) inverse_distances: TextureView,
    /// Where the hits were traced from that were last estimated.
    pub(crate) estimated: Last<Place>,
    kept: Kept,
    kept_estimate: Kept,
}

impl HitResolverView {
    pub(crate) fn size(&self) -> [u32; 2] {
        self.size
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        plane_bytes(TextureFormat::Rgba32Float, self.size, 1)
            + plane_bytes(TextureFormat::R32Float, self.size, 1)
    }
}

/// What one recording of the [`HitResolver`] works on.
#[derive(Clone, Copy, Debug)]
pub struct HitResolverInput<'a> {
    /// The frame that was traced from. With radiance its G-buffer has the albedo, unless receivers are glossy, and the roughness
    /// if they are.
    pub frame: &'a Frame<'a>,
    /// The hits, traced from this frame since their cloud was recorded. They know their settings.
    pub hits: &'a BouncedView,
    /// Means over frames to resolve in place of this frame's, which
    /// [`TemporalAccumulator::join`](crate::TemporalAccumulator::join) brought this frame's estimates into, those of the view
    /// that is recorded with. The more frames a pixel's has, the narrower is its window. For a resolver that is
    /// [joined](HitResolverDescriptor::joined), where all pixels have rays.
    pub history: Option<&'a TemporalHistory>,
    /// The caller's texture, of the descriptor's format, usage `RENDER_ATTACHMENT`, covering the camera's viewport.
    /// Only the viewport is written.
    pub target: TextureSlice<'a>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> HitResolverInput<'a> {
    /// Without timestamps.
    pub fn new(
        frame: &'a Frame<'a>,
        hits: &'a BouncedView,
        target: impl Into<TextureSlice<'a>>,
    ) -> Self {
        Self {
            frame,
            hits,
            history: None,
            target: target.into(),
            timestamps: None,
        }
    }
}

impl BouncedZBuffer {
    /// The pass that makes a picture of this one's hits, in a target of that format: [`HitResolver::new`] for the same
    /// payload and sampling. `deferred` is [`HitResolverDescriptor::deferred`].
    ///
    /// # Errors
    /// As [`HitResolver::new`].
    pub fn resolver<'a>(
        &self,
        compiler: impl Into<Compiler<'a>>,
        target: TextureFormat,
        deferred: bool,
    ) -> Result<HitResolver, Error> {
        HitResolver::new(compiler, &self.resolver_descriptor(target, deferred))
    }

    /// What that one is made for.
    pub(crate) fn resolver_descriptor(
        &self,
        target: TextureFormat,
        deferred: bool,
    ) -> HitResolverDescriptor {
        let BouncedDescriptor {
            payload,
            sampling,
            counted,
            emitter_samples,
            ..
        } = *self.descriptor();
        HitResolverDescriptor {
            payload,
            sampling,
            deferred,
            counted,
            joined: false,
            bent_normals: false,
            emitter_samples,
            target,
        }
    }
}

/// What one [`HitResolver::estimate`] works on.
#[derive(Clone, Copy, Debug)]
pub struct HitEstimateInput<'a> {
    /// As [`HitResolverInput::frame`].
    pub frame: &'a Frame<'a>,
    /// As [`HitResolverInput::hits`].
    pub hits: &'a BouncedView,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> HitEstimateInput<'a> {
    /// Without timestamps.
    pub fn new(frame: &'a Frame<'a>, hits: &'a BouncedView) -> Self {
        Self {
            frame,
            hits,
            timestamps: None,
        }
    }
}

impl HitResolver {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// [`Error::Format`] for a target that cannot be rendered to or does not hold floats, or not those of bent normals;
    /// [`Error::Setting`] for `joined` or rays towards emitters with `deferred`, and for bent normals with what they do not go
    /// with.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        descriptor: &HitResolverDescriptor,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        screen::check_format(device, "HitResolver target", descriptor.target)?;
        check_setting(
            !(descriptor.joined && descriptor.deferred),
            "HitResolverDescriptor::joined",
            f64::from(u8::from(descriptor.joined)),
            "false, with deferred",
        )?;
        let aims = descriptor.emitter_samples > 0;
        check_setting(
            descriptor.emitter_samples <= MAX_EMITTER_SAMPLES
                && (!aims || (descriptor.payload.is_radiance() && !descriptor.deferred)),
            "HitResolverDescriptor::emitter_samples",
            descriptor.emitter_samples,
            "0 to 16, as the hits'; 0 without radiance and with deferred",
        )?;
        check_bent(descriptor)?;
        let module = |stage| -> Result<_, Error> {
            Ok(shader::create(device, LABEL, source(descriptor, stage)?))
        };
        let constants = [("SAMPLING", f64::from(descriptor.sampling.code()))];
        let mut of_average = constants.to_vec();
        let samples = f64::from(descriptor.emitter_samples);
        of_average.extend(aims.then_some(("EMITTER_SAMPLES", samples)));
        let of = module(HitStage::Average)?;
        let (average_layout, average) = of.kernel(device, "average", &of_average, cache);
        let of = module(HitStage::Near)?;
        let (near_layout, near) = of.kernel(device, "near", &[], cache);
        let screen = |stage| -> Result<_, Error> {
            let of = module(stage)?;
            let layout = of.layout(device, &["reconstruct"]);
            let pipeline = Screen {
                label: LABEL,
                module: &of,
                entry: "reconstruct",
                layout: &layout.raw,
                constants: &constants,
                target: descriptor.target,
                cache,
            }
            .create(device);
            Ok((layout, pipeline))
        };
        let joined = descriptor.joined.then(|| screen(HitStage::Joined));
        Ok(Self {
            descriptor: *descriptor,
            average_layout,
            near_layout,
            uniforms: Uniforms::new(LABEL),
            average,
            near,
            reconstruct: screen(HitStage::Reconstruct)?,
            reconstruct_joined: joined.transpose()?,
        })
    }

    /// The half angle of the cone about a bent normal that is as open as the pixel, radians, 0 to π/2, of the picture's w: a cone
    /// of that half angle about the normal has the visibility sin² of it.
    pub fn cone_angle(visibility: f32) -> f32 {
        visibility.clamp(0.0, 1.0).sqrt().asin()
    }

    /// Room for the reconstruction of a view's hits.
    ///
    /// # Errors
    /// [`Error::Limit`] for more than the device can hold.
    pub fn create_view(
        &self,
        device: &Device,
        hits: &BouncedView,
    ) -> Result<HitResolverView, Error> {
        let size = hits.size();
        let texture = |label, format| -> Result<_, Error> {
            let texture = plane(device, label, format, size, 1)?;
            Ok(texture.create_view(&wgpu::TextureViewDescriptor::default()))
        };
        Ok(HitResolverView {
            size,
            estimated: Last::default(),
            kept: Kept::default(),
            kept_estimate: Kept::default(),
            means: texture(
                "deep-screen-space means of hits",
                TextureFormat::Rgba32Float,
            )?,
            inverse_distances: texture(
                "deep-screen-space inverse distances of hits",
                TextureFormat::R32Float,
            )?,
        })
    }

    /// Records the reconstruction into the caller's texture.
    ///
    /// # Errors
    /// [`Error::Setting`]; [`Error::Format`], [`Error::Size`] or [`Error::Usage`] for the target and the G-buffer;
    /// [`Error::Mismatch`] where the hits are of another kind than this was made for, or the view was made for others, and where
    /// they are deferred and there are further rays, of which sums alone are kept; [`Error::Recording`] where the hits were not
    /// recorded, or not since their cloud was.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &HitResolverInput<'_>,
        settings: &HitResolverSettings,
        scratch: &HitResolverView,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let textures = self.check(input, scratch)?;
        let frame = input.frame;
        let traced = input.hits.recorded.get("BouncedView")?;
        if self.descriptor.deferred && traced.more {
            return Err(Error::Mismatch {
                name: "HitResolverInput::hits",
                found: "further rays".into(),
                needed: "none, with HitResolverDescriptor::deferred".into(),
            });
        }
        let params = HitResolverParams::new(settings, frame, &traced.settings);
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let [roughness, albedo] = textures.map(|slice| slice.map(|slice| slice.read()));
        let roughness = roughness.as_ref().map(view);
        let params = ("params", parameters.at(params));
        let mut groups = scratch.kept.groups(device);
        let is_estimated = input.history.is_some();
        if !is_estimated {
            let gathered = (frame, input.hits, roughness.clone());
            let pass = first_pass(encoder, LABEL, input.timestamps);
            self.gather(&mut groups, pass, &params, gathered, scratch);
        }

        let mut resources = vec![
            params,
            ("receivers", view(&frame.receivers.view)),
            ("means", view(&scratch.means)),
            ("inverse_distances", view(&scratch.inverse_distances)),
        ];
        resources.extend(roughness.map(|r| ("roughness_texture", r)));
        let is_deferred = self.descriptor.deferred;
        resources.extend(is_deferred.then(|| ("hits", bits_or_colors(input.hits))));
        let albedo = albedo.as_ref().map(view);
        resources.extend(albedo.map(|albedo| ("albedo_texture", albedo)));
        let (layout, pipeline) = match (input.history, &self.reconstruct_joined) {
            (Some(history), Some(joined)) => {
                resources.push(("joined", view(history.means())));
                (&joined.0, &joined.1)
            }
            _ => (&self.reconstruct.0, &self.reconstruct.1),
        };
        let reconstruct = if self.descriptor.glossy() || self.descriptor.albedo() || is_estimated {
            layout.group(device, &resources)
        } else {
            groups.next(layout, &resources)
        };
        screen::draw(
            encoder,
            LABEL,
            (pipeline, &reconstruct),
            &input.target,
            frame.viewport(),
            input.timestamps,
            is_estimated,
        );
        Ok(())
    }

    /// Records the first half of that: each pixel's own mean and how noisy it is, and how near its hits are, which is what a
    /// [`RayBudget`](crate::RayBudget) starts from.
    ///
    /// # Errors
    /// As [`HitResolver::record`], but for the target and the albedo.
    pub fn estimate(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &HitEstimateInput<'_>,
        settings: &HitResolverSettings,
        scratch: &HitResolverView,
    ) -> Result<(), Error> {
        let HitEstimateInput {
            frame,
            hits,
            timestamps,
        } = *input;
        settings.validate()?;
        check_timestamps(timestamps)?;
        let roughness = self.check_hits((frame, hits), scratch)?;
        let traced = hits.recorded.get("BouncedView")?;
        let params = HitResolverParams::new(settings, frame, &traced.settings);
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let roughness = roughness.map(|slice| slice.read());
        let mut groups = scratch.kept_estimate.groups(device);
        let gathered = (frame, hits, roughness.as_ref().map(view));
        let pass = compute_pass(encoder, LABEL, timestamps);
        let params = ("params", parameters.at(params));
        self.gather(&mut groups, pass, &params, gathered, scratch);
        Ok(())
    }

    /// Means and inverse distances.
    fn gather<'a>(
        &self,
        groups: &mut Groups<'_>,
        mut pass: ComputePass<'_>,
        params: &Named<'a>,
        (frame, hits, roughness): (&'a Frame<'_>, &'a BouncedView, Option<Resource<'a>>),
        scratch: &'a HitResolverView,
    ) {
        scratch.estimated.set(frame.place());
        let counts = hits.counts.as_ref().map(|counts| ("counts", whole(counts)));
        let mut shared = vec![params.clone(), ("receivers", view(&frame.receivers.view))];
        shared.extend(counts);
        let mut resources = shared.clone();
        resources.push(("nearness", whole(&hits.nearness)));
        resources.push(("inverse_distances", view(&scratch.inverse_distances)));
        let near = groups.next(&self.near_layout, &resources);
        let mut resources = shared;
        resources.push(("means", view(&scratch.means)));
        resources.push(("hits", bits_or_colors(hits)));
        let average = match roughness {
            Some(roughness) => {
                resources.push(("roughness_texture", roughness));
                groups.unkept(&self.average_layout, &resources)
            }
            None => groups.next(&self.average_layout, &resources),
        };
        let viewport = frame.viewport();
        let workgroups = [viewport.width, viewport.height].map(|side| side.div_ceil(8));
        for (pipeline, group) in [(&self.average, &average), (&self.near, &near)] {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group.raw, &group.offsets);
            pass.dispatch_workgroups(workgroups[0], workgroups[1], 1);
        }
    }

    /// The roughness and the albedo, each where it is needed.
    fn check<'t>(
        &self,
        input: &HitResolverInput<'t>,
        scratch: &HitResolverView,
    ) -> Result<[Option<TextureSlice<'t>>; 2], Error> {
        const TARGET: &str = "HitResolverInput::target";
        let HitResolverInput {
            frame,
            hits,
            target,
            ..
        } = input;
        let roughness = self.check_hits((frame, hits), scratch)?;
        screen::check_target(TARGET, target, frame.viewport(), self.descriptor.target)?;
        check_apart(TARGET, target, frame.gbuffer.reads())?;
        if let Some(history) = input.history {
            self.check_history(hits, history)?;
            history.check_joined(frame)?;
            let place = scratch.estimated.get("HitResolverView")?;
            frame.check_place("HitResolverView", &place)?;
        }
        let is_needed = self.descriptor.albedo();
        let albedo = is_needed.then(|| frame.gbuffer.albedo_for("radiance of diffuse receivers"));
        Ok([roughness, albedo.transpose()?])
    }

    /// That a history is one of these hits.
    fn check_history(&self, hits: &BouncedView, history: &TemporalHistory) -> Result<(), Error> {
        let channels = if self.descriptor.payload.is_radiance() {
            Channels::Three
        } else {
            Channels::One
        };
        let traced = hits.recorded.get("BouncedView")?;
        if history.size() != hits.size()
            || history.channels() != channels
            || self.reconstruct_joined.is_none()
            || traced.listed
        {
            return Err(Error::Mismatch {
                name: "HitResolverInput::history",
                found: format!(
                    "{:?} pixels, channels: {:?}",
                    history.size(),
                    history.channels()
                ),
                needed: format!(
                    "{:?} pixels, channels: {channels:?}, HitResolverDescriptor::joined, and rays of all pixels",
                    hits.size()
                ),
            });
        }
        Ok(())
    }

    /// The roughness, where it is needed.
    fn check_hits<'t>(
        &self,
        (frame, hits): (&Frame<'t>, &BouncedView),
        scratch: &HitResolverView,
    ) -> Result<Option<TextureSlice<'t>>, Error> {
        let needed = &self.descriptor;
        let found = &hits.descriptor;
        let is_same = found.payload.is_radiance() == needed.payload.is_radiance()
            && (found.sampling, found.counted, found.emitter_samples)
                == (needed.sampling, needed.counted, needed.emitter_samples);
        if !is_same {
            let kind = |payload: Payload, sampling: Sampling, counted: bool, aimed: u32| {
                let counted = if counted { "" } else { "not " };
                format!("{payload:?}, {sampling:?}, {counted}counted, {aimed} emitter samples")
            };
            return Err(Error::Mismatch {
                name: "HitResolverInput::hits",
                found: kind(
                    found.payload,
                    found.sampling,
                    found.counted,
                    found.emitter_samples,
                ),
                needed: kind(
                    needed.payload,
                    needed.sampling,
                    needed.counted,
                    needed.emitter_samples,
                ),
            });
        }
        if needed.deferred && found.drawn_by_environment() {
            return Err(Error::Mismatch {
                name: "HitResolverInput::hits",
                found: "directions that an environment drew".into(),
                needed: "those of the settings alone, with HitResolverDescriptor::deferred".into(),
            });
        }
        let traced = hits.recorded.get("BouncedView")?;
        traced.of.check_last("BouncedView", "SurfelCloud")?;
        frame.check_place("BouncedView", &traced.place)?;
        if scratch.size != hits.size() {
            return Err(Error::Mismatch {
                name: "HitResolverView",
                found: format!("{:?} pixels", scratch.size),
                needed: format!("{:?} pixels", hits.size()),
            });
        }
        let is_glossy = needed.glossy();
        is_glossy
            .then(|| frame.gbuffer.roughness_for("Sampling::Glossy"))
            .transpose()
    }
}

/// That bent normals can be had, and the target holds them.
fn check_bent(descriptor: &HitResolverDescriptor) -> Result<(), Error> {
    if !descriptor.bent_normals {
        return Ok(());
    }
    let HitResolverDescriptor {
        payload,
        sampling,
        deferred,
        counted,
        joined,
        ..
    } = *descriptor;
    let plain = payload == Payload::Occlusion && sampling == Sampling::Cosine;
    check_setting(
        plain && !deferred && !counted && !joined,
        "HitResolverDescriptor::bent_normals",
        1.0,
        "false, unless with Payload::Occlusion, Sampling::Cosine, and without deferred, counted and joined",
    )?;
    let holds = matches!(
        descriptor.target,
        TextureFormat::Rgba8Snorm
            | TextureFormat::Rgba16Snorm
            | TextureFormat::Rgba16Float
            | TextureFormat::Rgba32Float
    );
    if !holds {
        return Err(Error::Format {
            name: "HitResolver target",
            format: descriptor.target,
            accepted: "four channels that hold negative numbers, for bent normals",
        });
    }
    Ok(())
}

/// Hits as a binding.
fn bits_or_colors(hits: &BouncedView) -> Resource<'_> {
    match &hits.hits {
        Hits::Bits(buffer) => whole(buffer),
        Hits::Colors(colors) => view(colors),
    }
}

/// The modules that it is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum HitStage {
    Average,
    Near,
    Reconstruct,
    /// Of means over frames.
    Joined,
}

/// Assembles one of them.
fn source(descriptor: &HitResolverDescriptor, stage: HitStage) -> Result<String, Error> {
    let counted = descriptor.counted;
    let mut flags = Vec::new();
    // Whatever was hit, how near it is means the same; but what counts rays is another struct.
    if stage != HitStage::Near || counted {
        flags.extend(descriptor.payload.is_radiance().then_some("RADIANCE"));
    }
    if stage != HitStage::Near || (counted && descriptor.payload.is_radiance()) {
        flags.extend(descriptor.glossy().then_some("GLOSSY"));
    }
    if stage != HitStage::Near {
        flags.extend(descriptor.albedo().then_some("ALBEDO"));
    }
    match stage {
        HitStage::Average => {
            flags.extend(["AVERAGE", "HITS"]);
            flags.extend((descriptor.emitter_samples > 0).then_some("EMITTERS"));
        }
        HitStage::Reconstruct if descriptor.deferred => flags.extend(["DEFERRED", "HITS"]),
        HitStage::Near => flags.push("NEAR"),
        HitStage::Reconstruct => {}
        HitStage::Joined => flags.push("JOINED"),
    }
    let is_bent = descriptor.bent_normals && stage != HitStage::Near;
    flags.extend(is_bent.then_some("BENT"));
    flags.extend(counted.then_some(match stage {
        HitStage::Average | HitStage::Near => "RAYS",
        HitStage::Reconstruct | HitStage::Joined => "COUNTED",
    }));
    shader::assemble("hit_resolver", SOURCE, &flags, &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    for payload in [Payload::Occlusion, Payload::Radiance, Payload::Sky] {
        for sampling in [Sampling::Cosine, Sampling::Glossy] {
            for counted in [false, true] {
                for (deferred, stage) in [
                    (false, HitStage::Near),
                    (false, HitStage::Average),
                    (false, HitStage::Reconstruct),
                    (true, HitStage::Reconstruct),
                    (false, HitStage::Joined),
                ] {
                    let descriptor = HitResolverDescriptor {
                        payload,
                        sampling,
                        deferred,
                        counted,
                        joined: false,
                        bent_normals: false,
                        emitter_samples: 0,
                        target: TextureFormat::Rgba16Float,
                    };
                    let is_glossy = sampling == Sampling::Glossy;
                    let is_near = stage == HitStage::Near;
                    // The albedo is all that tells light of the sky from other light.
                    let reads_albedo = matches!(stage, HitStage::Reconstruct | HitStage::Joined);
                    if payload == Payload::Sky && (is_glossy || deferred || !reads_albedo) {
                        continue;
                    }
                    // Without counts it is the same for all, and with those of occlusion for glossy receivers too.
                    let is_same = if counted {
                        is_glossy && payload == Payload::Occlusion
                    } else {
                        is_glossy || payload != Payload::Occlusion
                    };
                    if is_near && is_same {
                        continue;
                    }
                    let name = name_of(
                        match payload {
                            _ if is_near && !counted => "hit_resolver",
                            Payload::Occlusion => "hit_resolver occlusion",
                            Payload::Sky => "hit_resolver sky",
                            _ => "hit_resolver radiance",
                        },
                        &[
                            (is_glossy, "glossy"),
                            (counted, "counted"),
                            (is_near, "near"),
                            (stage == HitStage::Average, "average"),
                            (stage == HitStage::Reconstruct, "reconstruct"),
                            (deferred, "deferred"),
                            (stage == HitStage::Joined, "joined"),
                        ],
                    );
                    all.add(&name, source(&descriptor, stage)?);
                    if payload == Payload::Radiance && stage == HitStage::Average {
                        let descriptor = HitResolverDescriptor {
                            emitter_samples: 1,
                            ..descriptor
                        };
                        let name = format!("{name} emitters");
                        all.add(&name, source(&descriptor, stage)?);
                    }
                }
            }
        }
    }
    let bent = HitResolverDescriptor {
        payload: Payload::Occlusion,
        sampling: Sampling::Cosine,
        deferred: false,
        counted: false,
        joined: false,
        bent_normals: true,
        emitter_samples: 0,
        target: TextureFormat::Rgba16Float,
    };
    for (stage, name) in [
        (HitStage::Average, "hit_resolver bent average"),
        (HitStage::Reconstruct, "hit_resolver bent reconstruct"),
    ] {
        all.add(name, source(&bent, stage)?);
    }
    Ok(())
}

//! From hits to the caller's picture (The Bounced Z-buffer 3.3; `wgsl/hit_resolver.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use wgpu::{CommandEncoder, ComputePipeline, Device, RenderPipeline, TextureFormat, TextureView};

use self::{params::HitResolverParams, settings::HitResolverSettings};
use crate::{
    bounced_z_buffer::{
        BouncedZBuffer,
        descriptor::{BouncedDescriptor, Payload},
        settings::Sampling,
        view::{BouncedView, Hits},
    },
    effect::Listing,
    error::Error,
    gpu::compiler::Compiler,
    gpu::listing::name_of,
    gpu::{
        Kernel, Timestamps,
        binding::{Kept, Layout, Named, view, whole},
        check_timestamps, first_pass,
        screen::{self, Screen},
        shader,
        uniforms::Uniforms,
    },
    receivers::Frame,
    receivers::{plane, plane_bytes},
    texture_slice::{TextureSlice, check_apart},
};

const SOURCE: &str = include_str!("../../wgsl/hit_resolver.wgsl");

const LABEL: &str = "deep-screen-space hit resolver";

/// Gathers the hits of a [`BouncedZBuffer`](crate::BouncedZBuffer) over each pixel's neighbourhood, as wide as they are far away,
/// fits a plane to what it finds there, and writes its value at the pixel into the caller's texture: with [`Payload::Occlusion`]
/// ambient visibility, 1 = open, with [`Payload::Radiance`] the radiance that a diffuse surface of the G-buffer's albedo sends
/// on, linear RGB, W/(m² sr). The sky is open, and dark.
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
    layout: Layout,
    uniforms: Uniforms,
    average: ComputePipeline,
    near: ComputePipeline,
    reconstruct: RenderPipeline,
}

/// What a [`HitResolver`] is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HitResolverDescriptor {
    /// The payload of the hits.
    pub payload: Payload,
    /// How their directions were drawn.
    pub sampling: Sampling,
    /// Whether neighbours' hits are weighed one by one by the receiving pixel's own cosine (The Bounced Z-buffer 3.3),
    /// so that detail of normals survives a wide window. Without, neighbours' means are: faster by about the number of
    /// directions.
    pub deferred: bool,
    /// Any colour format that can be rendered to; its missing channels are dropped.
    pub target: TextureFormat,
}

impl HitResolverDescriptor {
    fn glossy(&self) -> bool {
        self.sampling == Sampling::Glossy
    }

    /// Whether it multiplies by the G-buffer's albedo.
    fn albedo(&self) -> bool {
        self.payload.is_radiance() && !self.glossy()
    }
}

/// What a [`HitResolver`] needs for a view: each pixel's own mean, and how near its hits are.
#[derive(Debug)]
pub struct HitResolverView {
    size: [u32; 2],
    means: TextureView,
    inverse_distances: TextureView,
    kept: Kept,
}

impl HitResolverView {
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
        let BouncedDescriptor {
            payload, sampling, ..
        } = *self.descriptor();
        let descriptor = HitResolverDescriptor {
            payload,
            sampling,
            deferred,
            target,
        };
        HitResolver::new(compiler, &descriptor)
    }
}

impl HitResolver {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// [`Error::Format`] for a target that cannot be rendered to or does not hold floats.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        descriptor: &HitResolverDescriptor,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        screen::check_format(device, "HitResolver target", descriptor.target)?;
        let module = |stage| -> Result<_, Error> {
            Ok(shader::create(device, LABEL, source(descriptor, stage)?))
        };
        let constants = [("SAMPLING", f64::from(descriptor.sampling.code()))];
        let of = module(HitStage::Average)?;
        let average_layout = of.layout(device, &["average"]);
        let average = Kernel {
            label: LABEL,
            module: &of,
            entry: "average",
            layouts: &[&average_layout.raw],
            constants: &constants,
            cache,
        }
        .create(device);
        let of = module(HitStage::Near)?;
        let near_layout = of.layout(device, &["near"]);
        let near = Kernel {
            label: LABEL,
            module: &of,
            entry: "near",
            layouts: &[&near_layout.raw],
            constants: &[],
            cache,
        }
        .create(device);
        let of = module(HitStage::Reconstruct)?;
        let layout = of.layout(device, &["reconstruct"]);
        let reconstruct = Screen {
            label: LABEL,
            module: &of,
            entry: "reconstruct",
            layout: &layout.raw,
            constants: &constants,
            target: descriptor.target,
            cache,
        }
        .create(device);
        Ok(Self {
            descriptor: *descriptor,
            average_layout,
            near_layout,
            layout,
            uniforms: Uniforms::new(LABEL),
            average,
            near,
            reconstruct,
        })
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
            kept: Kept::default(),
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
    /// [`Error::Mismatch`] where the hits are of another kind than this was made for, or the view was made for others;
    /// [`Error::Recording`] where the hits were not recorded, or not since their cloud was.
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
        let [roughness, albedo] = self.check(input, scratch)?;
        let frame = input.frame;
        let traced = input.hits.recorded.get("BouncedView")?;
        let viewport = frame.viewport();
        let params = HitResolverParams::new(settings, frame, &traced.settings);
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let mut groups = scratch.kept.groups(device);
        let mut group = |layout: &Layout, resources: &[Named<'_>], callers: bool| {
            if callers {
                layout.group(device, resources)
            } else {
                groups.next(layout, resources)
            }
        };
        let hits = match &input.hits.hits {
            Hits::Bits(buffer) => whole(buffer),
            Hits::Colors(colors) => view(colors),
        };
        let shared = [
            ("params", parameters.at(params)),
            ("receivers", view(&frame.receivers.view)),
        ];
        let inverse_distances = ("inverse_distances", view(&scratch.inverse_distances));
        let mut resources = shared.to_vec();
        resources.push(("nearness", whole(&input.hits.nearness)));
        resources.push(inverse_distances.clone());
        let near = group(&self.near_layout, &resources, false);
        let [roughness, albedo] = [roughness, albedo].map(|slice| slice.map(|slice| slice.read()));
        let mut resources = shared.to_vec();
        resources.push(("means", view(&scratch.means)));
        let roughness = roughness.as_ref().map(view);
        resources.extend(roughness.map(|r| ("roughness_texture", r)));
        let is_glossy = self.descriptor.glossy();
        let mut averaged = resources.clone();
        averaged.push(("hits", hits.clone()));
        let average = group(&self.average_layout, &averaged, is_glossy);
        resources.push(inverse_distances);
        resources.extend(self.descriptor.deferred.then_some(("hits", hits)));
        let albedo = albedo.as_ref().map(view);
        resources.extend(albedo.map(|albedo| ("albedo_texture", albedo)));
        let has_textures = is_glossy || self.descriptor.albedo();
        let reconstruct = group(&self.layout, &resources, has_textures);
        let mut pass = first_pass(encoder, LABEL, input.timestamps);
        pass.set_pipeline(&self.average);
        pass.set_bind_group(0, &average.raw, &average.offsets);
        let groups = [viewport.width, viewport.height].map(|side| side.div_ceil(8));
        pass.dispatch_workgroups(groups[0], groups[1], 1);
        pass.set_pipeline(&self.near);
        pass.set_bind_group(0, &near.raw, &near.offsets);
        pass.dispatch_workgroups(groups[0], groups[1], 1);
        drop(pass);

        screen::draw(
            encoder,
            LABEL,
            (&self.reconstruct, &reconstruct),
            &input.target,
            viewport,
            input.timestamps,
            false,
        );
        Ok(())
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
        let kind = |payload: Payload, sampling| (payload.is_radiance(), sampling);
        let BouncedDescriptor {
            payload, sampling, ..
        } = hits.descriptor;
        if kind(payload, sampling) != kind(self.descriptor.payload, self.descriptor.sampling) {
            return Err(Error::Mismatch {
                name: "HitResolverInput::hits",
                found: format!("{payload:?}, {sampling:?}"),
                needed: format!(
                    "{:?}, {:?}",
                    self.descriptor.payload, self.descriptor.sampling
                ),
            });
        }
        let traced = hits.recorded.get("BouncedView")?;
        traced.of.check_last("BouncedView", "SurfelCloud")?;
        frame.check_place("BouncedView", &traced.place)?;
        screen::check_target(TARGET, target, frame.viewport(), self.descriptor.target)?;
        check_apart(TARGET, target, frame.gbuffer.reads())?;
        if scratch.size != hits.size() {
            return Err(Error::Mismatch {
                name: "HitResolverView",
                found: format!("{:?} pixels", scratch.size),
                needed: format!("{:?} pixels", hits.size()),
            });
        }
        let glossy = self.descriptor.glossy();
        let albedo = self.descriptor.albedo();
        let gbuffer = &frame.gbuffer;
        Ok([
            glossy
                .then(|| gbuffer.roughness_for("Sampling::Glossy"))
                .transpose()?,
            albedo
                .then(|| gbuffer.albedo_for("radiance of diffuse receivers"))
                .transpose()?,
        ])
    }
}

/// The modules that it is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum HitStage {
    Average,
    Near,
    Reconstruct,
}

/// Assembles one of them.
fn source(descriptor: &HitResolverDescriptor, stage: HitStage) -> Result<String, Error> {
    let mut flags = Vec::new();
    // Whatever was hit, how near it is means the same.
    if stage != HitStage::Near {
        flags.extend(descriptor.payload.is_radiance().then_some("RADIANCE"));
        flags.extend(descriptor.glossy().then_some("GLOSSY"));
        flags.extend(descriptor.albedo().then_some("ALBEDO"));
    }
    match stage {
        HitStage::Average => flags.extend(["AVERAGE", "HITS"]),
        HitStage::Reconstruct if descriptor.deferred => flags.extend(["DEFERRED", "HITS"]),
        HitStage::Near => flags.push("NEAR"),
        HitStage::Reconstruct => {}
    }
    shader::assemble("hit_resolver", SOURCE, &flags, &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    let any = HitResolverDescriptor {
        payload: Payload::Occlusion,
        sampling: Sampling::Cosine,
        deferred: false,
        target: TextureFormat::Rgba16Float,
    };
    all.add("hit_resolver near", source(&any, HitStage::Near)?);
    for payload in [Payload::Occlusion, Payload::Radiance] {
        for sampling in [Sampling::Cosine, Sampling::Glossy] {
            for (deferred, stage) in [
                (false, HitStage::Average),
                (false, HitStage::Reconstruct),
                (true, HitStage::Reconstruct),
            ] {
                let descriptor = HitResolverDescriptor {
                    payload,
                    sampling,
                    deferred,
                    target: TextureFormat::Rgba16Float,
                };
                let name = name_of(
                    match payload {
                        Payload::Occlusion => "hit_resolver occlusion",
                        Payload::Radiance | Payload::LitRadiance => "hit_resolver radiance",
                    },
                    &[
                        (sampling == Sampling::Glossy, "glossy"),
                        (stage == HitStage::Average, "average"),
                        (stage == HitStage::Reconstruct, "reconstruct"),
                        (deferred, "deferred"),
                    ],
                );
                all.add(&name, source(&descriptor, stage)?);
            }
        }
    }
    Ok(())
}

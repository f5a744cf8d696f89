//! Further bounces of light: surfels gather what others send (`wgsl/surfel_gatherer.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use wgpu::{Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device, PipelineCache};

use self::{params::SurfelGathererParams, settings::SurfelGathererSettings};
use crate::{
    bvh::{Bvh, Primitives},
    effect::Listing,
    emitters::Emitters,
    error::{Error, check_limit, check_setting},
    geometry::Material,
    gpu::compiler::Compiler,
    gpu::listing::name_of,
    gpu::{
        Timestamps,
        binding::{self, Layout, Named, whole},
        check_timestamps, compute_pass, shader, storage,
        uniforms::Uniforms,
    },
    surfel::{Placement, SurfelCloud},
    surfel_shader::radiance_bytes,
};

const SOURCE: &str = include_str!("../../wgsl/surfel_gatherer.wgsl");

const LABEL: &str = "deep-screen-space surfel gatherer";

/// Brings light on by one bounce: fills a buffer with what each of a cloud's surfels reflects, from its front and its back, of
/// the light that it gathers from others along rays of its own. A [`SurfelShader`](crate::SurfelShader), or the caller, says
/// what these send.
///
/// With L₀ for what surfels send of themselves and reflect straight from lights, one recording from L₀ gives A L₀, the light of
/// one further bounce. [`SurfelGatherer::add`] makes L₁ = L₀ + A L₀ of it, of which the next recording gives that of two, and so
/// on: n further bounces are n recordings. From what the surfels of the last frame sent one recording per frame gives ever more
/// bounces. [`Payload::LitAndGathered`](crate::Payload::LitAndGathered) shows A L to pixels, whose hits find L₀ on their own, and
/// [`Payload::Radiance`](crate::Payload::Radiance) L itself.
///
/// Surfels behind the camera, hidden and in shadow gather as others do; what the cloud was culled of neither sends nor hides.
///
/// Holds pipelines only; one serves any number of clouds.
#[derive(Debug)]
pub struct SurfelGatherer {
    gather: Stage,
    /// Which those rays meet.
    primitives: Primitives,
    /// Whether they are aimed at emitters too.
    aims: bool,
    /// Where the device traces rays itself.
    #[cfg(feature = "ray-query")]
    by_device: Option<Stage>,
    add: Stage,
    uniforms: Uniforms,
}

#[derive(Debug)]
struct Stage {
    layout: Layout,
    pipeline: ComputePipeline,
}

/// What rays from surfels meet, and what that sends.
#[derive(Clone, Copy, Debug)]
pub struct SurfelSenders<'a> {
    /// A cloud whose surfels are at [`Placement::Centroid`]: that of the surfels that gather, or another of the same world, such
    /// as that of the frame before. Recorded with [`SurfelizerSettings::density`](crate::SurfelizerSettings::density) at
    /// infinity its pieces are the caller's triangles.
    pub cloud: &'a SurfelCloud,
    /// The hierarchy over its pieces, recorded since it was.
    pub bvh: &'a Bvh,
    /// A [`SurfelRadiance`](crate::SurfelRadiance) for each of its surfels, usage `STORAGE`. What is negative or not finite
    /// counts as 0.
    pub radiance: &'a Buffer,
}

/// What one recording of the [`SurfelGatherer`] works on.
#[derive(Clone, Copy, Debug)]
pub struct SurfelGathererInput<'a> {
    /// The surfels that gather, at [`Placement::Centroid`].
    pub cloud: &'a SurfelCloud,
    /// What their rays meet.
    pub senders: SurfelSenders<'a>,
    /// A storage buffer of one or more [`Material`]s. An index beyond its end takes the last one; an albedo that is negative or
    /// not finite counts as 0. With [`emitters`](Self::emitters) the table that the senders' radiance is of: what they emit of
    /// themselves is told by it from what they reflect.
    pub materials: &'a Buffer,
    /// Where the result goes: a [`SurfelRadiance`](crate::SurfelRadiance) a surfel, of which the cloud's
    /// [`SurfelCounts::stored`](crate::SurfelCounts::stored) are written. Another buffer than [`SurfelSenders::radiance`], from
    /// [`SurfelGatherer::create_radiance`], or the caller's own with usage `STORAGE`.
    pub radiance: &'a Buffer,
    /// What of the senders' cloud shines of itself, recorded since it was, for a gatherer
    /// [with emitters](SurfelGatherer::with_emitters).
    pub emitters: Option<&'a Emitters>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> SurfelGathererInput<'a> {
    /// From the surfels of the same cloud, without timestamps.
    pub fn new(senders: SurfelSenders<'a>, materials: &'a Buffer, radiance: &'a Buffer) -> Self {
        Self {
            cloud: senders.cloud,
            senders,
            materials,
            radiance,
            emitters: None,
            timestamps: None,
        }
    }
}

impl SurfelGatherer {
    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device was made with less than that.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        Self::with_primitives(compiler, Primitives::Triangles)
    }

    /// The same for rays that meet [`Primitives::AlphaTested`] in place of [`Primitives::Triangles`]; for others it is as `new`.
    ///
    /// # Errors
    /// As [`SurfelGatherer::new`].
    pub fn with_primitives<'a>(
        compiler: impl Into<Compiler<'a>>,
        primitives: Primitives,
    ) -> Result<Self, Error> {
        Self::create(compiler.into(), primitives, false)
    }

    /// The same for rays that are aimed at what shines of itself besides ([`SurfelGathererSettings::emitter_samples`]), which
    /// small lamps need. What surfels send has their own emission in it, as the [`SurfelShader`](crate::SurfelShader) fills it.
    ///
    /// # Errors
    /// As [`SurfelGatherer::new`].
    pub fn with_emitters<'a>(
        compiler: impl Into<Compiler<'a>>,
        primitives: Primitives,
    ) -> Result<Self, Error> {
        Self::create(compiler.into(), primitives, true)
    }

    fn create(
        Compiler { device, cache }: Compiler<'_>,
        primitives: Primitives,
        aims: bool,
    ) -> Result<Self, Error> {
        let primitives = primitives.of_own_traversal();
        check_limit(
            "max_storage_buffers_per_shader_stage",
            u64::from(device.limits().max_storage_buffers_per_shader_stage),
            8,
            LABEL,
        )?;
        let stage = |primitives, aims, entry| {
            let source = source(primitives, aims)?;
            Ok::<_, Error>(Stage::new(device, source, entry, cache))
        };
        Ok(Self {
            gather: stage(primitives, aims, "gather")?,
            primitives,
            aims,
            #[cfg(feature = "ray-query")]
            by_device: Primitives::RayQuery
                .validate(device)
                .is_ok()
                .then(|| stage(Primitives::RayQuery, aims, "gather"))
                .transpose()?,
            add: stage(Primitives::Triangles, false, "add")?,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Room for what the surfels of a cloud send: a [`SurfelRadiance`](crate::SurfelRadiance) each (usages
    /// `STORAGE | COPY_SRC | COPY_DST`).
    ///
    /// # Errors
    /// [`Error::Limit`] where the device cannot bind as much.
    pub fn create_radiance(&self, device: &Device, cloud: &SurfelCloud) -> Result<Buffer, Error> {
        storage(
            device,
            "deep-screen-space gathered radiance",
            radiance_bytes(cloud),
            BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
        )
    }

    /// Records one bounce.
    ///
    /// # Errors
    /// What [`SurfelGathererSettings::validate`] finds; [`Error::Mismatch`] for a hierarchy over other primitives or for another
    /// cloud's capacity; [`Error::Recording`] for clouds that were not recorded, and for a hierarchy that was not recorded from
    /// its cloud since that was; [`Error::Setting`] for surfels that are not leaves of pieces ([`Placement::Grid`] and
    /// [`Placement::Random`]); [`Error::Buffer`] for materials or radiance that are too small, lack a usage or are the same
    /// buffer as another one, [`Error::Limit`] for more than the device can bind. All before anything is recorded.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SurfelGathererInput<'_>,
        settings: &SurfelGathererSettings,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let SurfelGathererInput { cloud, senders, .. } = *input;
        cloud.last()?;
        check_placement(cloud)?;
        let (stage, traced) = self.traced(&senders)?;
        check_placement(senders.cloud)?;
        check_buffers(device, input)?;
        let emitters = self.check_emitters(input, settings)?;

        let origins = [cloud.origin, senders.cloud.origin];
        let params = SurfelGathererParams::new(settings, origins, senders.cloud.capacity);
        let (parameters, place) = self.uniforms.upload_one(device, encoder, &params);
        let mut resources = vec![
            ("params", parameters.at(place)),
            ("counters", whole(&cloud.counters)),
            ("sources", whole(&cloud.sources)),
            ("own_pieces", whole(&cloud.pieces)),
            ("materials", binding::table::<Material>(input.materials)),
            (
                "radiance",
                binding::first(input.radiance, radiance_bytes(cloud)),
            ),
            ("pieces", whole(&senders.cloud.pieces)),
            ("surfel_offsets", whole(&senders.cloud.piece_offsets.values)),
            (
                "sent",
                binding::first(senders.radiance, radiance_bytes(senders.cloud)),
            ),
        ];
        resources.extend(traced);
        resources.extend(emitters.map(|emitters| ("emitters", emitters.bound())));
        stage.record(device, encoder, cloud, &resources, input.timestamps);
        Ok(())
    }

    /// Records that what the surfels of a cloud send by `onto` becomes that and what they send by `more`, W/(m² sr) each. What is
    /// negative or not finite counts as 0.
    ///
    /// # Errors
    /// [`Error::Recording`] for a cloud that was not recorded; [`Error::Buffer`] and [`Error::Limit`] for the buffers, as
    /// [`SurfelGatherer::record`].
    pub fn add(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        cloud: &SurfelCloud,
        onto: &Buffer,
        more: &Buffer,
    ) -> Result<(), Error> {
        const ONTO: &str = "SurfelGatherer::add onto";
        cloud.last()?;
        let bytes = radiance_bytes(cloud);
        binding::check_first(device, ONTO, onto, bytes)?;
        binding::check_first(device, "SurfelGatherer::add more", more, bytes)?;
        binding::check_own(ONTO, onto, [more, &cloud.counters])?;
        let resources = [
            ("counters", whole(&cloud.counters)),
            ("radiance", binding::first(onto, bytes)),
            ("added", binding::first(more, bytes)),
        ];
        self.add.record(device, encoder, cloud, &resources, None);
        Ok(())
    }

    /// What rays are aimed at, if they are.
    fn check_emitters<'b>(
        &self,
        input: &SurfelGathererInput<'b>,
        settings: &SurfelGathererSettings,
    ) -> Result<Option<&'b Emitters>, Error> {
        if !self.aims {
            check_setting(
                settings.emitter_samples == 0,
                "SurfelGathererSettings::emitter_samples",
                settings.emitter_samples,
                "0, unless by SurfelGatherer::with_emitters",
            )?;
            return Ok(None);
        }
        let Some(emitters) = input.emitters else {
            return Err(Error::Mismatch {
                name: "SurfelGathererInput::emitters",
                found: "none".into(),
                needed: "those of the senders, for SurfelGatherer::with_emitters".into(),
            });
        };
        emitters.check_source(input.senders.cloud)?;
        Ok(Some(emitters))
    }

    /// The stage that traces such a hierarchy, and what it binds of it.
    fn traced<'b>(&self, senders: &SurfelSenders<'b>) -> Result<(&Stage, Vec<Named<'b>>), Error> {
        let SurfelSenders { cloud, bvh, .. } = senders;
        match bvh.primitives() {
            #[cfg(feature = "ray-query")]
            Primitives::RayQuery => {
                let stage = self.by_device.as_ref().ok_or_else(|| Error::Feature {
                    feature: Primitives::RayQuery.features(),
                    why: LABEL,
                })?;
                Ok((stage, bvh.pieces(cloud, Primitives::RayQuery)?))
            }
            _ => Ok((&self.gather, bvh.pieces(cloud, self.primitives)?)),
        }
    }
}

impl Stage {
    fn new(
        device: &Device,
        source: String,
        entry: &'static str,
        cache: Option<&PipelineCache>,
    ) -> Self {
        let module = shader::create(device, LABEL, source);
        let (layout, pipeline) = module.kernel(device, entry, &[], cache);
        Self { layout, pipeline }
    }

    /// One thread per surfel of a cloud.
    fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        cloud: &SurfelCloud,
        resources: &[Named<'_>],
        timestamps: Option<Timestamps<'_>>,
    ) {
        let group = self.layout.group(device, resources);
        let mut pass = compute_pass(encoder, LABEL, timestamps);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group.raw, &group.offsets);
        // As many workgroups as wrote the surfels: none for a cloud that holds none.
        pass.dispatch_workgroups_indirect(&cloud.emission, 0);
    }
}

fn check_placement(cloud: &SurfelCloud) -> Result<(), Error> {
    check_setting(
        cloud.placement == Placement::Centroid,
        "SurfelizerSettings::placement",
        f64::from(cloud.placement.code()),
        "Placement::Centroid, for surfels that gather",
    )
}

fn check_buffers(device: &Device, input: &SurfelGathererInput<'_>) -> Result<(), Error> {
    const MATERIALS: &str = "SurfelGathererInput::materials";
    const RADIANCE: &str = "SurfelGathererInput::radiance";
    const SENT: &str = "SurfelSenders::radiance";
    let SurfelGathererInput { cloud, senders, .. } = *input;
    binding::check_table::<Material>(device, MATERIALS, input.materials)?;
    binding::check_first(
        device,
        SENT,
        senders.radiance,
        radiance_bytes(senders.cloud),
    )?;
    binding::check_first(device, RADIANCE, input.radiance, radiance_bytes(cloud))?;
    // A kernel cannot read what it writes.
    let read = [
        input.materials,
        senders.radiance,
        &cloud.counters,
        &cloud.sources,
        &cloud.pieces,
        &senders.cloud.pieces,
        &senders.cloud.piece_offsets.values,
    ];
    binding::check_own(RADIANCE, input.radiance, read)
}

/// Assembles the module.
fn source(primitives: Primitives, aims: bool) -> Result<String, Error> {
    let mut flags: Vec<_> = primitives.flags().collect();
    flags.extend(aims.then_some("EMITTERS"));
    shader::assemble("surfel_gatherer", SOURCE, &flags, &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    let traced = [
        Primitives::Triangles,
        Primitives::AlphaTested,
        #[cfg(feature = "ray-query")]
        Primitives::RayQuery,
    ];
    for primitives in traced {
        for aims in [false, true] {
            let name = name_of(
                "surfel_gatherer",
                &[
                    (primitives.are_alpha_tested(), "alpha tested"),
                    (primitives.by_device(), "ray query"),
                    (aims, "emitters"),
                ],
            );
            all.add_for(primitives.features(), &name, source(primitives, aims)?);
        }
    }
    Ok(())
}

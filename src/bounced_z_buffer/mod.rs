//! What each pixel meets first along directions of its own (The Bounced Z-buffer 3, 4.2; `wgsl/bounced_z_buffer.wgsl`).

pub(crate) mod descriptor;
pub(crate) mod params;
pub(crate) mod settings;
pub(crate) mod view;

use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device, TextureFormat,
    TextureViewDimension,
};

use self::{
    descriptor::{BouncedDescriptor, HitLighting, HitRadiance, Payload},
    params::{BouncedParams, DiskParams, LightsParams, MAX_LIGHTS},
    settings::{BouncedSettings, MAX_RAYS_PER_PIXEL, Sampling},
    view::{BouncedView, Hits, Traced},
};
use crate::{
    bvh::{Bvh, Primitives},
    effect::Listing,
    error::{Error, check_setting},
    geometry::Material,
    gpu::compiler::Compiler,
    gpu::listing::name_of,
    gpu::{
        Kernel, Timestamps,
        binding::{self, Kept, Layout, whole},
        check_timestamps, compute_pass, shader, storage,
        uniforms::{Parameters, Uniforms},
    },
    receivers::{Frame, check_view_size, plane},
    recorded::Last,
    surfel::Placement,
    surfel::SurfelCloud,
    surfel_shader::radiance_bytes,
};

const SOURCE: &str = include_str!("../../wgsl/bounced_z_buffer.wgsl");

const LABEL: &str = "deep-screen-space bounced z-buffer";

/// Finds what each pixel meets first along directions of its own: exactly, whether it is hidden, off screen or edge-on,
/// among the triangles that a cloud was made of (or, for comparison, among its surfels as disks: [`Primitives`]). What lies
/// behind a hit does not count, so that light neither passes through surfaces nor is blocked twice.
///
/// Holds pipelines only; one serves any number of clouds and views.
#[derive(Debug)]
pub struct BouncedZBuffer {
    descriptor: BouncedDescriptor,
    layout: Layout,
    uniforms: Uniforms,
    trace: ComputePipeline,
}

/// What one recording of the [`BouncedZBuffer`] works on.
#[derive(Clone, Copy, Debug)]
pub struct BouncedInput<'a> {
    /// The pixels that rays start from, relative to the cloud's origin; its camera may be another than the cloud's (stereo,
    /// split screen). With [`Sampling::Glossy`] its G-buffer has roughness.
    pub frame: &'a Frame<'a>,
    /// The cloud whose pieces or surfels rays meet. Recorded with
    /// [`SurfelizerSettings::density`](crate::SurfelizerSettings::density) at infinity its pieces are the caller's triangles, and
    /// hits are exact.
    pub cloud: &'a SurfelCloud,
    /// The hierarchy over the cloud's pieces or surfels, recorded since the cloud was.
    pub bvh: &'a Bvh,
    /// Where the radiance of hits comes from, as the [`Payload`] asks.
    pub radiance: HitRadiance<'a>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> BouncedInput<'a> {
    /// For [`Payload::Occlusion`], without timestamps.
    pub fn new(frame: &'a Frame<'a>, cloud: &'a SurfelCloud, bvh: &'a Bvh) -> Self {
        Self {
            frame,
            cloud,
            bvh,
            radiance: HitRadiance::None,
            timestamps: None,
        }
    }
}

impl BouncedZBuffer {
    /// What it was compiled for.
    pub(crate) fn descriptor(&self) -> &BouncedDescriptor {
        &self.descriptor
    }

    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`, but for `Primitives::RayQuery`.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device was made with less than that; [`Error::Setting`] for levels out of range, and for what
    /// the primitives do not go with; [`Error::Feature`] for ray queries that the device was not made for.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        descriptor: &BouncedDescriptor,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        descriptor.primitives.validate(device)?;
        check_setting(
            !descriptor.lit() || !descriptor.primitives.are_disks(),
            "BouncedDescriptor::primitives",
            f64::from(u8::from(descriptor.primitives.are_disks())),
            "Primitives::Triangles, with Payload::LitRadiance",
        )?;
        check_setting(
            !(descriptor.statistics && descriptor.primitives.by_device()),
            "BouncedDescriptor::statistics",
            f64::from(u8::from(descriptor.statistics)),
            "false, with Primitives::RayQuery",
        )?;
        let module = shader::create(device, LABEL, source(descriptor)?);
        let layout = module.layout(device, &["trace"]);
        let trace = Kernel {
            label: LABEL,
            module: &module,
            entry: "trace",
            layouts: &[&layout.raw],
            constants: &[("SAMPLING", f64::from(descriptor.sampling.code()))],
            cache,
        }
        .create(device);
        Ok(Self {
            descriptor: *descriptor,
            layout,
            trace,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Room for a view of `width` × `height` pixels with up to `directions` directions each.
    ///
    /// # Errors
    /// [`Error::Setting`] for directions or a size out of range, [`Error::Limit`] for more than the device can hold.
    pub fn create_view(
        &self,
        device: &Device,
        width: u32,
        height: u32,
        rays_per_pixel: u32,
    ) -> Result<BouncedView, Error> {
        check_setting(
            rays_per_pixel <= MAX_RAYS_PER_PIXEL,
            "rays_per_pixel",
            rays_per_pixel,
            "0 to 64",
        )?;
        let size = [width, height];
        check_view_size(device, "deep-screen-space hits", size)?;
        let usage = BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let hits = match self.descriptor.payload {
            Payload::Occlusion => Hits::Bits(storage(
                device,
                "deep-screen-space hits",
                4 * u64::from(words(rays_per_pixel)) * u64::from(width) * u64::from(height),
                usage,
            )?),
            Payload::Radiance | Payload::LitRadiance => {
                let texture = plane(
                    device,
                    "deep-screen-space hits",
                    TextureFormat::R32Uint,
                    size,
                    rays_per_pixel.max(1),
                )?;
                Hits::Colors(texture.create_view(&wgpu::TextureViewDescriptor {
                    dimension: Some(TextureViewDimension::D2Array),
                    ..Default::default()
                }))
            }
        };
        let nearness = storage(
            device,
            "deep-screen-space nearness of hits",
            4 * u64::from(width) * u64::from(height),
            usage,
        )?;
        let statistics = self
            .descriptor
            .statistics
            .then(|| storage(device, "deep-screen-space hit statistics", 24, usage))
            .transpose()?;
        Ok(BouncedView {
            size,
            hits,
            nearness,
            descriptor: self.descriptor,
            rays_per_pixel,
            statistics,
            recorded: Last::default(),
            kept: Kept::default(),
        })
    }

    /// Records the tracing of a view's directions.
    ///
    /// # Errors
    /// What [`BouncedSettings::validate`] and, for lights, [`Light::validate`](crate::Light::validate) find; [`Error::Mismatch`]
    /// where the frame has another origin than the cloud, the view was made for another descriptor or size or for fewer rays, the
    /// hierarchy for another cloud's capacity, the radiance is none that the payload takes, or the G-buffer lacks the roughness
    /// that glossy rays need; [`Error::Recording`] where the hierarchy was not recorded from this cloud, since that was;
    /// [`Error::Buffer`] for radiance that is too small, or for materials; [`Error::Setting`] for too many lights, and where
    /// radiance of pieces is asked for and the surfels are not leaves of them ([`Placement::Grid`] and [`Placement::Random`]).
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &BouncedInput<'_>,
        settings: &BouncedSettings,
        view: &BouncedView,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let (frame, cloud) = (input.frame, input.cloud);
        let viewport = frame.viewport();
        self.check_view([viewport.width, viewport.height], settings, view)?;
        let (radiance, lighting) = self.check_radiance(device, input, view)?;
        let roughness = match self.descriptor.sampling {
            Sampling::Glossy => Some(frame.gbuffer.roughness_for("Sampling::Glossy")?),
            Sampling::Cosine | Sampling::Uniform => None,
        };
        let mut parameters = Parameters::new(device);
        let mut disks = None;
        let primitives = match self.descriptor.primitives {
            Primitives::Disks { levels } => {
                let bounds = input.bvh.disks(cloud, levels)?;
                disks = Some(parameters.add(&DiskParams::new(&settings.disks, bounds)));
                vec![
                    ("nodes", binding::view(&bounds.nodes)),
                    ("counters", whole(&cloud.counters)),
                    ("surfels", whole(&cloud.surfels)),
                    ("sources", whole(&cloud.sources)),
                ]
            }
            pieces => {
                let mut primitives = input.bvh.pieces(cloud, pieces)?;
                if self.descriptor.payload.is_radiance() {
                    primitives.push(("pieces", whole(&cloud.pieces)));
                }
                if radiance.is_some() {
                    primitives.extend([
                        ("counters", whole(&cloud.counters)),
                        ("surfel_offsets", whole(&cloud.piece_offsets.values)),
                    ]);
                }
                primitives
            }
        };

        frame.check_origin(cloud.origin())?;
        view.recorded.set(Traced {
            settings: *settings,
            place: frame.place(),
            of: cloud.last()?,
        });
        if let Some(statistics) = &view.statistics {
            encoder.clear_buffer(statistics, 0, None);
        }
        if let Hits::Bits(buffer) = &view.hits {
            encoder.clear_buffer(buffer, 0, None);
        }
        encoder.clear_buffer(&view.nearness, 0, None);
        let params = parameters.add(&BouncedParams::new(settings, view.size(), cloud.capacity));
        let camera = parameters.add(&frame.camera.params(frame.origin));
        let lights = lighting
            .map(|lighting| parameters.add(&LightsParams::new(lighting.lights, cloud.origin)));
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let mut resources = vec![
            ("params", parameters.at(params)),
            ("receivers", binding::view(&frame.receivers.view)),
            ("nearness", whole(&view.nearness)),
            ("camera", parameters.at(camera)),
        ];
        resources.extend(primitives);
        resources.extend(disks.map(|disks| ("disks", parameters.at(disks))));
        resources.push((
            "hits",
            match &view.hits {
                Hits::Bits(buffer) => whole(buffer),
                Hits::Colors(colors) => binding::view(colors),
            },
        ));
        let radiance = radiance.map(|radiance| binding::first(radiance, radiance_bytes(cloud)));
        resources.extend(radiance.map(|radiance| ("radiance", radiance)));
        if let (Some(lighting), Some(lights)) = (&lighting, lights) {
            resources.extend([
                ("lights", parameters.at(lights)),
                ("materials", binding::table::<Material>(lighting.materials)),
            ]);
        }
        let statistics = view.statistics.as_ref();
        resources.extend(statistics.map(|counts| ("statistics", whole(counts))));
        let roughness = roughness.map(|slice| slice.read());
        let group = if let Some(roughness) = &roughness {
            resources.push(("roughness_texture", binding::view(roughness)));
            self.layout.group(device, &resources)
        } else {
            view.kept.groups(device).next(&self.layout, &resources)
        };
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);
        // Bits were cleared; a layer of colours cannot be, and without directions gets one that meets nothing.
        let layers = match view.hits {
            Hits::Bits(_) => settings.rays_per_pixel,
            Hits::Colors(_) => settings.rays_per_pixel.max(1),
        };
        if layers > 0 {
            let [width, height] = view.size();
            pass.set_pipeline(&self.trace);
            pass.set_bind_group(0, &group.raw, &group.offsets);
            pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), layers);
        }
        Ok(())
    }

    fn check_view(
        &self,
        size: [u32; 2],
        settings: &BouncedSettings,
        view: &BouncedView,
    ) -> Result<(), Error> {
        if view.size() != size
            || view.rays_per_pixel < settings.rays_per_pixel
            || view.descriptor != self.descriptor
        {
            return Err(Error::Mismatch {
                name: "BouncedView",
                found: format!(
                    "{:?} pixels, {} rays per pixel, {:?}",
                    view.size(),
                    view.rays_per_pixel,
                    view.descriptor
                ),
                needed: format!(
                    "{size:?} pixels, {} rays per pixel, {:?}",
                    settings.rays_per_pixel, self.descriptor
                ),
            });
        }
        Ok(())
    }

    /// The radiance of surfels, or what lights hits, by the payload.
    fn check_radiance<'r>(
        &self,
        device: &Device,
        input: &BouncedInput<'r>,
        view: &BouncedView,
    ) -> Result<(Option<&'r Buffer>, Option<HitLighting<'r>>), Error> {
        match (self.descriptor.payload, input.radiance) {
            (Payload::Occlusion, _) => Ok((None, None)),
            (Payload::Radiance, HitRadiance::Surfels(radiance)) => {
                self.check_surfels(device, input.cloud, radiance, view)?;
                Ok((Some(radiance), None))
            }
            (Payload::LitRadiance, HitRadiance::Lit(lighting)) => {
                check_lighting(device, &lighting, view)?;
                Ok((None, Some(lighting)))
            }
            (payload, radiance) => Err(Error::Mismatch {
                name: "BouncedInput::radiance",
                found: match radiance {
                    HitRadiance::None => "HitRadiance::None",
                    HitRadiance::Surfels(_) => "HitRadiance::Surfels",
                    HitRadiance::Lit(_) => "HitRadiance::Lit",
                }
                .into(),
                needed: match payload {
                    Payload::LitRadiance => "HitRadiance::Lit, for Payload::LitRadiance",
                    _ => "HitRadiance::Surfels, for Payload::Radiance",
                }
                .into(),
            }),
        }
    }

    fn check_surfels(
        &self,
        device: &Device,
        cloud: &SurfelCloud,
        radiance: &Buffer,
        view: &BouncedView,
    ) -> Result<(), Error> {
        const RADIANCE: &str = "HitRadiance::Surfels";
        check_setting(
            cloud.placement == Placement::Centroid || self.descriptor.primitives.are_disks(),
            "SurfelizerSettings::placement",
            f64::from(cloud.placement.code()),
            "Placement::Centroid, for radiance of pieces",
        )?;
        binding::check_first(device, RADIANCE, radiance, radiance_bytes(cloud))?;
        binding::check_own(RADIANCE, radiance, &view.statistics)
    }
}

fn check_lighting(
    device: &Device,
    lighting: &HitLighting<'_>,
    view: &BouncedView,
) -> Result<(), Error> {
    const MATERIALS: &str = "HitLighting::materials";
    binding::check_table::<Material>(device, MATERIALS, lighting.materials)?;
    binding::check_own(MATERIALS, lighting.materials, &view.statistics)?;
    for light in lighting.lights {
        light.validate()?;
    }
    let emitting = lighting.lights.iter().filter(|l| l.is_emitting()).count();
    check_setting(
        emitting <= MAX_LIGHTS,
        "HitLighting::lights",
        emitting as f64,
        "0 to 16 lights that are not black",
    )
}

/// Words of bits per pixel.
pub(crate) fn words(rays_per_pixel: u32) -> u32 {
    rays_per_pixel.div_ceil(32)
}

/// Assembles the module.
fn source(descriptor: &BouncedDescriptor) -> Result<String, Error> {
    shader::assemble("bounced_z_buffer", SOURCE, &descriptor.flags(), &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    let traced = [
        Primitives::Triangles,
        Primitives::Disks { levels: 1 },
        #[cfg(feature = "ray-query")]
        Primitives::RayQuery,
    ];
    for payload in [Payload::Occlusion, Payload::Radiance, Payload::LitRadiance] {
        for primitives in traced {
            for sampling in [Sampling::Cosine, Sampling::Glossy] {
                for statistics in [false, true] {
                    let descriptor = BouncedDescriptor {
                        payload,
                        primitives,
                        sampling,
                        statistics,
                    };
                    let (disks, by_device) = (primitives.are_disks(), primitives.by_device());
                    if (descriptor.lit() && disks) || (statistics && by_device) {
                        continue;
                    }
                    let name = name_of(
                        match payload {
                            Payload::Occlusion => "bounced_z_buffer occlusion",
                            Payload::Radiance | Payload::LitRadiance => "bounced_z_buffer radiance",
                        },
                        &[
                            (descriptor.lit(), "lit"),
                            (disks, "disks"),
                            (by_device, "ray query"),
                            (sampling == Sampling::Glossy, "glossy"),
                            (statistics, "statistics"),
                        ],
                    );
                    all.add_for(primitives.features(), &name, source(&descriptor)?);
                }
            }
        }
    }
    Ok(())
}

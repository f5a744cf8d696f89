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
    descriptor::{BouncedDescriptor, BouncedScene, HitLighting, HitRadiance, Payload},
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
        binding::{self, Kept, Layout, Resource, whole},
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
    /// The pixels that rays start from, relative to the scene's origin; its camera may be another than the scene's (stereo,
    /// split screen). With [`Sampling::Glossy`] its G-buffer has roughness.
    pub frame: &'a Frame<'a>,
    /// What rays meet.
    pub scene: BouncedScene<'a>,
    /// Where the radiance of hits comes from, as the [`Payload`] asks.
    pub radiance: HitRadiance<'a>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> BouncedInput<'a> {
    /// Among a cloud's pieces or surfels, for [`Payload::Occlusion`], without timestamps.
    pub fn new(frame: &'a Frame<'a>, cloud: &'a SurfelCloud, bvh: &'a Bvh) -> Self {
        Self::of(frame, BouncedScene::Cloud { cloud, bvh })
    }

    /// Among whatever is given, for [`Payload::Occlusion`], without timestamps.
    pub fn of(frame: &'a Frame<'a>, scene: BouncedScene<'a>) -> Self {
        Self {
            frame,
            scene,
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

    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device was made with less than that; [`Error::Setting`] for levels out of range.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        descriptor: &BouncedDescriptor,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        descriptor.primitives.validate()?;
        check_setting(
            is_possible(descriptor),
            "BouncedDescriptor::primitives",
            f64::from(u8::from(descriptor.primitives != Primitives::Triangles)),
            "Primitives::Triangles, or Instances without Payload::Radiance, or Disks without Payload::LitRadiance",
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
    /// where the frame has another origin than the scene, the scene is none of these primitives, the view was made for another
    /// descriptor or size or for fewer rays, the hierarchy for another cloud's capacity, the radiance is none that the payload
    /// takes, or the G-buffer lacks the roughness that glossy rays need; [`Error::Recording`] where the hierarchy was not
    /// recorded, or not from this cloud since that was; [`Error::Buffer`] for radiance that is too small, or for materials;
    /// [`Error::Setting`] for too many lights, and where radiance of pieces is asked for and the surfels are not leaves of them
    /// ([`Placement::Grid`] and [`Placement::Random`]).
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
        let frame = input.frame;
        let viewport = frame.viewport();
        self.check_view([viewport.width, viewport.height], settings, view)?;
        let (radiance, lighting) = self.check_radiance(device, input, view)?;
        let roughness = match self.descriptor.sampling {
            Sampling::Glossy => Some(frame.gbuffer.roughness_for("Sampling::Glossy")?),
            Sampling::Cosine | Sampling::Uniform => None,
        };
        let mut parameters = Parameters::new(device);
        let mut disks = None;
        let (nodes, primitives) = match self.descriptor.primitives {
            Primitives::Triangles => {
                let (cloud, bvh) = input.scene.cloud()?;
                let bounds = bvh.triangles(cloud)?;
                let mut primitives = vec![("triangles", binding::view(bounds.triangles()))];
                if self.descriptor.payload.is_radiance() {
                    primitives.push(("pieces", whole(&cloud.pieces)));
                }
                if radiance.is_some() {
                    primitives.extend([
                        ("counters", whole(&cloud.counters)),
                        ("surfel_offsets", whole(&cloud.piece_offsets.values)),
                    ]);
                }
                (bounds.nodes(), primitives)
            }
            Primitives::Instances => {
                let pool = input.scene.instances()?.pool();
                let primitives = vec![("triangles", binding::view(&pool.triangles))];
                (&pool.nodes, primitives)
            }
            Primitives::Disks { levels } => {
                let (cloud, bvh) = input.scene.cloud()?;
                let bounds = bvh.disks(cloud, levels)?;
                disks = Some(parameters.add(&DiskParams::new(&settings.disks, bounds)));
                let primitives = vec![
                    ("counters", whole(&cloud.counters)),
                    ("surfels", whole(&cloud.surfels)),
                    ("sources", whole(&cloud.sources)),
                ];
                (&bounds.nodes, primitives)
            }
        };

        let origin = input.scene.origin();
        frame.check_origin(origin)?;
        let of = input.scene.last()?;
        let surfels = input
            .scene
            .cloud()
            .map_or(0, |(cloud, _)| cloud.capacity.surfels);
        view.recorded.set(Traced {
            settings: *settings,
            place: frame.place(),
            of,
        });
        if let Some(statistics) = &view.statistics {
            encoder.clear_buffer(statistics, 0, None);
        }
        if let Hits::Bits(buffer) = &view.hits {
            encoder.clear_buffer(buffer, 0, None);
        }
        encoder.clear_buffer(&view.nearness, 0, None);
        let params = parameters.add(&BouncedParams::new(settings, view.size(), surfels));
        let camera = parameters.add(&frame.camera.params(frame.origin));
        let lights =
            lighting.map(|lighting| parameters.add(&LightsParams::new(lighting.lights, origin)));
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let mut resources = vec![
            ("params", parameters.at(params)),
            ("nodes", binding::view(nodes)),
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
    ) -> Result<(Option<Resource<'r>>, Option<HitLighting<'r>>), Error> {
        match (self.descriptor.payload, input.radiance) {
            (Payload::Occlusion, _) => Ok((None, None)),
            (Payload::Radiance, HitRadiance::Surfels(radiance)) => {
                let (cloud, _) = input.scene.cloud()?;
                self.check_surfels(device, cloud, radiance, view)?;
                let bound = binding::first(radiance, radiance_bytes(cloud));
                Ok((Some(bound), None))
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
            cloud.placement == Placement::Centroid
                || self.descriptor.primitives != Primitives::Triangles,
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

/// Surfels have radiance, and triangles can be lit.
fn is_possible(descriptor: &BouncedDescriptor) -> bool {
    match descriptor.primitives {
        Primitives::Triangles => true,
        Primitives::Disks { .. } => descriptor.payload != Payload::LitRadiance,
        Primitives::Instances => descriptor.payload != Payload::Radiance,
    }
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
    for payload in [Payload::Occlusion, Payload::Radiance, Payload::LitRadiance] {
        let disks = Primitives::Disks { levels: 1 };
        for primitives in [Primitives::Triangles, disks, Primitives::Instances] {
            for sampling in [Sampling::Cosine, Sampling::Glossy] {
                for statistics in [false, true] {
                    let descriptor = BouncedDescriptor {
                        payload,
                        primitives,
                        sampling,
                        statistics,
                    };
                    if !is_possible(&descriptor) {
                        continue;
                    }
                    let name = name_of(
                        match payload {
                            Payload::Occlusion => "bounced_z_buffer occlusion",
                            Payload::Radiance | Payload::LitRadiance => "bounced_z_buffer radiance",
                        },
                        &[
                            (descriptor.lit(), "lit"),
                            (primitives == disks, "disks"),
                            (primitives == Primitives::Instances, "instances"),
                            (sampling == Sampling::Glossy, "glossy"),
                            (statistics, "statistics"),
                        ],
                    );
                    all.add(&name, source(&descriptor)?);
                }
            }
        }
    }
    Ok(())
}

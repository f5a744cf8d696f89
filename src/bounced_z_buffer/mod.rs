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
    descriptor::{
        BouncedDescriptor, BouncedScene, HitLighting, HitRadiance, MAX_EMITTER_SAMPLES,
        NEEDED_FOR_MORE, Payload,
    },
    params::{BouncedParams, DiskParams, LightsParams, MAX_LIGHTS, pixel_rays_bytes},
    settings::{BouncedSettings, MAX_RAYS_PER_PIXEL, Sampling},
    view::{BouncedView, Hits, Traced},
};
use crate::{
    bvh::{Bvh, Primitives, disks::DiskBounds},
    effect::Listing,
    emitters::Emitters,
    environment::{EnvironmentLight, params::PlacedParams},
    error::{Error, check_setting},
    geometry::Material,
    gpu::compiler::Compiler,
    gpu::listing::name_of,
    gpu::{
        Kernel, Timestamps,
        binding::{self, Kept, Layout, Named, Resource, whole},
        check_timestamps, compute_pass, shader, storage,
        uniforms::{Parameters, Place, Uniforms},
    },
    ray_budget::view::RayBudgetView,
    receivers::{Frame, check_view_size, plane},
    recorded::Last,
    surfel::Placement,
    surfel::SurfelCloud,
    surfel_shader::radiance_bytes,
    texture_slice::TextureSlice,
    work::PixelList,
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
    /// Where rays are counted: for listed pixels, and for further rays.
    listed: Option<(Layout, ComputePipeline)>,
    more: Option<(Layout, ComputePipeline)>,
}

/// Which pixels a kernel takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// All.
    All,
    /// Those of a [`PixelList`].
    Listed,
    /// Those that a [`RayBudgetView`] lists, for further rays.
    More,
}

impl Stage {
    fn flag(self) -> Option<&'static str> {
        match self {
            Self::All => None,
            Self::Listed => Some("LIST"),
            Self::More => Some("MORE"),
        }
    }

    fn entry(self) -> &'static str {
        match self {
            Self::All => "trace",
            Self::Listed => "trace_listed",
            Self::More => "trace_more",
        }
    }
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
    /// The pixels that are to have rays, if not all are, for a view whose rays are counted: those of any number of sub-images,
    /// such as [`MultiResView::works`](crate::MultiResView::works) gives. A pixel that several list is traced once. The
    /// [`HitResolver`](crate::HitResolver) takes the others' light from the neighbours, so that its window has to reach
    /// listed ones. Not of use to [`BouncedZBuffer::record_more`].
    pub pixels: Option<&'a [PixelList<'a>]>,
    /// What comes from where nothing is hit, where the [descriptor](BouncedDescriptor::environment) asks for it.
    pub environment: Option<EnvironmentLight<'a>>,
    /// What of the cloud shines of itself, recorded since it was, for a descriptor with
    /// [`emitter_samples`](BouncedDescriptor::emitter_samples).
    pub emitters: Option<&'a Emitters>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> BouncedInput<'a> {
    /// Among a cloud's pieces or surfels, for [`Payload::Occlusion`] at all pixels, without timestamps.
    pub fn new(frame: &'a Frame<'a>, cloud: &'a SurfelCloud, bvh: &'a Bvh) -> Self {
        Self::of(frame, BouncedScene::Cloud { cloud, bvh })
    }

    /// Among whatever is given, for [`Payload::Occlusion`], without timestamps.
    pub fn of(frame: &'a Frame<'a>, scene: BouncedScene<'a>) -> Self {
        Self {
            frame,
            scene,
            radiance: HitRadiance::None,
            pixels: None,
            environment: None,
            emitters: None,
            timestamps: None,
        }
    }
}

/// What one recording traces.
#[derive(Clone, Copy)]
enum Work<'a> {
    All,
    Lists(&'a [PixelList<'a>]),
    More(&'a RayBudgetView),
}

/// What rays read, checked.
struct Checked<'a> {
    radiance: Option<Resource<'a>>,
    lighting: Option<HitLighting<'a>>,
    environment: Option<EnvironmentLight<'a>>,
    emitters: Option<&'a Emitters>,
    roughness: Option<TextureSlice<'a>>,
    primitives: Vec<Named<'a>>,
    disks: Option<&'a DiskBounds>,
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
            is_possible(descriptor),
            "BouncedDescriptor::primitives",
            f64::from(u8::from(descriptor.primitives != Primitives::Triangles)),
            "Triangles or AlphaTested, or instances without radiance of surfels, or Disks without hits that are lit and Payload::Sky",
        )?;
        check_setting(
            is_environment_possible(descriptor),
            "BouncedDescriptor::environment",
            f64::from(u8::from(descriptor.environment)),
            "true with Payload::Sky and Sampling::Cosine, false with Payload::Occlusion and with Sampling::Uniform",
        )?;
        check_setting(
            can_aim(descriptor),
            "BouncedDescriptor::emitter_samples",
            descriptor.emitter_samples,
            "0 to 16; 0 with Sampling::Uniform, and unless a cloud's triangles are lit",
        )?;
        check_setting(
            can_count(descriptor),
            "BouncedDescriptor::statistics",
            f64::from(u8::from(descriptor.statistics)),
            "false, with Primitives::RayQuery and Payload::LitAndGathered",
        )?;
        let mut constants = vec![("SAMPLING", f64::from(descriptor.sampling.code()))];
        let samples = f64::from(descriptor.emitter_samples);
        constants.extend(descriptor.aims().then_some(("EMITTER_SAMPLES", samples)));
        let kernel = |stage: Stage| -> Result<_, Error> {
            let module = shader::create(device, LABEL, source(descriptor, stage)?);
            let layout = module.layout(device, &[stage.entry()]);
            let pipeline = Kernel {
                label: LABEL,
                module: &module,
                entry: stage.entry(),
                layouts: &[&layout.raw],
                constants: &constants,
                cache,
            }
            .create(device);
            Ok((layout, pipeline))
        };
        let (layout, trace) = kernel(Stage::All)?;
        let listed = descriptor.counted.then(|| kernel(Stage::Listed));
        let more = descriptor.takes_more().then(|| kernel(Stage::More));
        Ok(Self {
            descriptor: *descriptor,
            layout,
            trace,
            listed: listed.transpose()?,
            more: more.transpose()?,
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
            Payload::Radiance | Payload::LitRadiance | Payload::LitAndGathered | Payload::Sky => {
                let texture = plane(
                    device,
                    "deep-screen-space hits",
                    TextureFormat::R32Uint,
                    size,
                    rays_per_pixel.max(1) + self.descriptor.emitter_layers(),
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
        let counts = self
            .descriptor
            .counted
            .then(|| {
                let bytes = pixel_rays_bytes(&self.descriptor);
                let bytes = bytes * u64::from(width) * u64::from(height);
                storage(device, "deep-screen-space rays of pixels", bytes, usage)
            })
            .transpose()?;
        Ok(BouncedView {
            size,
            hits,
            nearness,
            descriptor: self.descriptor,
            rays_per_pixel,
            statistics,
            counts,
            recorded: Last::default(),
            kept: [Kept::default(), Kept::default()],
        })
    }

    /// Records the tracing of a view's directions.
    ///
    /// # Errors
    /// What [`BouncedSettings::validate`] and, for lights, [`Light::validate`](crate::Light::validate) find; [`Error::Mismatch`]
    /// where the frame has another origin than the scene, the scene is none of these primitives, the view was made for another
    /// descriptor or size or for fewer rays, the hierarchy for another cloud's capacity, the radiance is none that the payload
    /// takes, the G-buffer lacks the roughness that glossy rays need, or pixels are listed and rays not counted;
    /// [`Error::Recording`] where the hierarchy was not recorded, or not from this cloud since that was; [`Error::Buffer`] for
    /// radiance that is too small, for materials, or for lists;
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
        let checked = self.check(device, input, settings, view)?;
        if let Some(lists) = input.pixels {
            if !self.descriptor.counted {
                return Err(Error::Mismatch {
                    name: "BouncedInput::pixels",
                    found: "rays that are not counted".into(),
                    needed: "BouncedDescriptor::counted".into(),
                });
            }
            for list in lists {
                list.check(device, input.frame.viewport())?;
            }
        }
        view.recorded.set(Traced {
            settings: *settings,
            place: input.frame.place(),
            of: input.scene.last()?,
            listed: input.pixels.is_some(),
            more: false,
        });
        let bits = match &view.hits {
            Hits::Bits(buffer) => Some(buffer),
            Hits::Colors(_) => None,
        };
        let cleared = [
            view.statistics.as_ref(),
            view.counts.as_ref(),
            Some(&view.nearness),
            bits,
        ];
        for buffer in cleared.into_iter().flatten() {
            encoder.clear_buffer(buffer, 0, None);
        }
        let work = input.pixels.map_or(Work::All, Work::Lists);
        self.trace(device, encoder, (input, &checked), settings, view, work);
        Ok(())
    }

    /// Records further rays of the pixels that a budget gives some, for a view that was recorded with these settings. They are
    /// drawn between those that there are.
    ///
    /// # Errors
    /// As [`BouncedZBuffer::record`]; [`Error::Recording`] where the view was not recorded from this frame and cloud, or has
    /// further rays already, or the budget was not recorded for this frame; [`Error::Mismatch`] where the view was recorded with
    /// other settings, the budget is of another size, or directions are [`Sampling::Uniform`], or [`Sampling::Glossy`] with
    /// [`Payload::Occlusion`].
    pub fn record_more(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &BouncedInput<'_>,
        settings: &BouncedSettings,
        (view, budget): (&BouncedView, &RayBudgetView),
    ) -> Result<(), Error> {
        let checked = self.check(device, input, settings, view)?;
        if !self.descriptor.takes_more() {
            return Err(Error::Mismatch {
                name: "RayBudgetView",
                found: format!("{:?}", self.descriptor),
                needed: NEEDED_FOR_MORE.into(),
            });
        }
        let before = view.recorded.get("BouncedView")?;
        input.scene.check_source("BouncedView", &before.of)?;
        input.frame.check_place("BouncedView", &before.place)?;
        if before.settings != *settings {
            return Err(Error::Mismatch {
                name: "BouncedSettings",
                found: format!("{settings:?}"),
                needed: format!("{:?}, as the view was recorded with", before.settings),
            });
        }
        budget.check(view)?;
        if before.more {
            // The same rays once more would tell nothing.
            return Err(Error::Recording {
                name: "BouncedView",
                found: "recorded with further rays already".into(),
            });
        }
        view.recorded.set(Traced {
            more: true,
            ..before
        });
        let work = Work::More(budget);
        self.trace(device, encoder, (input, &checked), settings, view, work);
        Ok(())
    }

    /// All that may be refused, and what rays read.
    fn check<'a>(
        &self,
        device: &Device,
        input: &BouncedInput<'a>,
        settings: &BouncedSettings,
        view: &BouncedView,
    ) -> Result<Checked<'a>, Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let frame = input.frame;
        let viewport = frame.viewport();
        self.check_view([viewport.width, viewport.height], settings, view)?;
        let (radiance, lighting) = self.check_radiance(device, input, view)?;
        let environment = self.check_environment(input)?;
        let emitters = self.check_emitters(input)?;
        let roughness = match self.descriptor.sampling {
            Sampling::Glossy => Some(frame.gbuffer.roughness_for("Sampling::Glossy")?),
            Sampling::Cosine | Sampling::Uniform => None,
        };
        let (primitives, disks) = match self.descriptor.primitives {
            Primitives::Disks { levels } => {
                let (cloud, bvh) = input.scene.cloud()?;
                let bounds = bvh.disks(cloud, levels)?;
                let primitives = vec![
                    ("nodes", binding::view(&bounds.nodes)),
                    ("counters", whole(&cloud.counters)),
                    ("surfels", whole(&cloud.surfels)),
                    ("sources", whole(&cloud.sources)),
                ];
                (primitives, Some(bounds))
            }
            instances if instances.are_instances() => {
                (input.scene.instances()?.traced(instances)?, None)
            }
            pieces => {
                let (cloud, bvh) = input.scene.cloud()?;
                let mut primitives = bvh.pieces(cloud, pieces)?;
                if self.descriptor.payload.is_radiance() && !self.descriptor.sky() {
                    primitives.push(("pieces", whole(&cloud.pieces)));
                }
                if radiance.is_some() {
                    primitives.extend([
                        ("counters", whole(&cloud.counters)),
                        ("surfel_offsets", whole(&cloud.piece_offsets.values)),
                    ]);
                }
                (primitives, None)
            }
        };
        frame.check_origin(input.scene.origin())?;
        input.scene.last()?;
        Ok(Checked {
            radiance,
            lighting,
            environment,
            emitters,
            roughness,
            primitives,
            disks,
        })
    }

    fn trace(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        (input, checked): (&BouncedInput<'_>, &Checked<'_>),
        settings: &BouncedSettings,
        view: &BouncedView,
        work: Work<'_>,
    ) {
        let frame = input.frame;
        let cloud = input.scene.cloud();
        let surfels = cloud.map_or(0, |(cloud, _)| cloud.capacity.surfels);
        let mut parameters = Parameters::new(device);
        let level = |level| BouncedParams {
            level,
            ..BouncedParams::new(settings, view.size(), surfels)
        };
        let params: Vec<_> = match work {
            Work::Lists(lists) => lists
                .iter()
                .map(|list| parameters.add(&level(list.level)))
                .collect(),
            _ => vec![parameters.add(&level(0))],
        };
        let disks = checked
            .disks
            .map(|bounds| parameters.add(&DiskParams::new(&settings.disks, bounds)));
        let camera = parameters.add(&frame.camera.params(frame.origin));
        let origin = input.scene.origin();
        let lights = checked
            .lighting
            .map(|lighting| parameters.add(&LightsParams::new(lighting.lights, origin)));
        let environment = checked.environment.map(|light| {
            let placed = parameters.add(&PlacedParams::new(&light, settings));
            (light.environment, placed)
        });
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let mut resources = vec![
            ("receivers", binding::view(&frame.receivers.view)),
            ("nearness", whole(&view.nearness)),
            ("camera", parameters.at(camera)),
        ];
        resources.extend(checked.primitives.iter().cloned());
        resources.extend(disks.map(|disks| ("disks", parameters.at(disks))));
        let own = match work {
            Work::All => None,
            Work::Lists(_) => self.listed.as_ref(),
            Work::More(_) => self.more.as_ref(),
        };
        let (layout, pipeline) = match own {
            Some((layout, pipeline)) => (layout, pipeline),
            None => (&self.layout, &self.trace),
        };
        let is_more = matches!(work, Work::More(_));
        // Further rays leave single hits alone.
        if !is_more {
            resources.push((
                "hits",
                match &view.hits {
                    Hits::Bits(buffer) => whole(buffer),
                    Hits::Colors(colors) => binding::view(colors),
                },
            ));
        }
        resources.extend(view.counts.as_ref().map(|counts| ("counts", whole(counts))));
        let radiance = checked.radiance.clone();
        resources.extend(radiance.map(|radiance| ("radiance", radiance)));
        if let (Some(lighting), Some(lights)) = (&checked.lighting, lights) {
            resources.extend([
                ("lights", parameters.at(lights)),
                ("materials", binding::table::<Material>(lighting.materials)),
            ]);
        }
        if let Some((environment, placed)) = environment {
            resources.extend([
                ("environment", parameters.at(placed)),
                (
                    "environment_radiance",
                    binding::view(environment.radiance()),
                ),
                (
                    "environment_distribution",
                    binding::view(environment.distribution()),
                ),
            ]);
        }
        let emitters = checked.emitters;
        resources.extend(emitters.map(|emitters| ("emitters", emitters.bound())));
        let statistics = view.statistics.as_ref();
        resources.extend(statistics.map(|counts| ("statistics", whole(counts))));
        let roughness = checked.roughness.map(|slice| slice.read());
        resources.extend(
            roughness
                .iter()
                .map(|roughness| ("roughness_texture", binding::view(roughness))),
        );
        let mut kept = view.kept[usize::from(is_more)].groups(device);
        let mut group = |params: Place, list: Option<Resource<'_>>| {
            let mut resources = resources.clone();
            resources.push(("params", parameters.at(params)));
            let is_callers = roughness.is_some() || matches!(work, Work::Lists(_));
            resources.extend(list.map(|list| ("work", list)));
            if is_callers {
                layout.group(device, &resources)
            } else {
                kept.next(layout, &resources)
            }
        };
        let viewport = frame.viewport();
        let groups: Vec<_> = match work {
            Work::All => vec![group(params[0], None)],
            Work::More(budget) => vec![group(params[0], Some(whole(budget.pixels())))],
            Work::Lists(lists) => lists
                .iter()
                .zip(&params)
                .map(|(list, params)| group(*params, Some(list.list(viewport))))
                .collect(),
        };
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);
        // Bits were cleared; a layer of colours cannot be, and without directions gets one that meets nothing.
        let threads = match view.hits {
            Hits::Bits(_) => settings.rays_per_pixel,
            Hits::Colors(_) => settings.rays_per_pixel.max(1) + self.descriptor.emitter_samples,
        };
        if threads == 0 {
            return;
        }
        pass.set_pipeline(pipeline);
        for (i, group) in groups.iter().enumerate() {
            pass.set_bind_group(0, &group.raw, &group.offsets);
            match work {
                Work::All => {
                    let [width, height] = view.size();
                    pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), threads);
                }
                Work::Lists(lists) => pass.dispatch_workgroups_indirect(lists[i].dispatch, 0),
                Work::More(budget) => pass.dispatch_workgroups_indirect(budget.dispatch(), 0),
            }
        }
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
            (Payload::Occlusion | Payload::Sky, _) => Ok((None, None)),
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
            (Payload::LitAndGathered, HitRadiance::LitAndGathered { lighting, gathered }) => {
                let (cloud, _) = input.scene.cloud()?;
                check_lighting(device, &lighting, view)?;
                self.check_surfels(device, cloud, gathered, view)?;
                let bound = binding::first(gathered, radiance_bytes(cloud));
                Ok((Some(bound), Some(lighting)))
            }
            (payload, radiance) => Err(Error::Mismatch {
                name: "BouncedInput::radiance",
                found: match radiance {
                    HitRadiance::None => "HitRadiance::None",
                    HitRadiance::Surfels(_) => "HitRadiance::Surfels",
                    HitRadiance::Lit(_) => "HitRadiance::Lit",
                    HitRadiance::LitAndGathered { .. } => "HitRadiance::LitAndGathered",
                }
                .into(),
                needed: match payload {
                    Payload::LitRadiance => "HitRadiance::Lit, for Payload::LitRadiance",
                    Payload::LitAndGathered => {
                        "HitRadiance::LitAndGathered, for Payload::LitAndGathered"
                    }
                    _ => "HitRadiance::Surfels, for Payload::Radiance",
                }
                .into(),
            }),
        }
    }

    /// The environment, where it is asked for.
    fn check_environment<'r>(
        &self,
        input: &BouncedInput<'r>,
    ) -> Result<Option<EnvironmentLight<'r>>, Error> {
        if !self.descriptor.environment {
            return Ok(None);
        }
        let Some(light) = input.environment else {
            return Err(Error::Mismatch {
                name: "BouncedInput::environment",
                found: "none".into(),
                needed: "an environment, for BouncedDescriptor::environment".into(),
            });
        };
        light.validate()?;
        Ok(Some(light))
    }

    /// What shines, where rays are aimed at it.
    fn check_emitters<'r>(&self, input: &BouncedInput<'r>) -> Result<Option<&'r Emitters>, Error> {
        if !self.descriptor.aims() {
            return Ok(None);
        }
        let Some(emitters) = input.emitters else {
            return Err(Error::Mismatch {
                name: "BouncedInput::emitters",
                found: "none".into(),
                needed: "those of the cloud, for BouncedDescriptor::emitter_samples".into(),
            });
        };
        let (cloud, _) = input.scene.cloud()?;
        emitters.check_source(cloud)?;
        Ok(Some(emitters))
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

/// Surfels have radiance, and triangles can be lit.
fn is_possible(descriptor: &BouncedDescriptor) -> bool {
    match descriptor.primitives {
        Primitives::Disks { .. } => !descriptor.lit() && !descriptor.sky(),
        Primitives::Instances | Primitives::AlphaTestedInstances => !matches!(
            descriptor.payload,
            Payload::Radiance | Payload::LitAndGathered
        ),
        _ => true,
    }
}

/// Bits have no room for what an environment sends, and uniform directions are weighed afterwards, one by one.
fn is_environment_possible(descriptor: &BouncedDescriptor) -> bool {
    match descriptor.payload {
        Payload::Occlusion => !descriptor.environment,
        Payload::Sky => descriptor.drawn_by_environment(),
        _ => !descriptor.environment || descriptor.sampling != Sampling::Uniform,
    }
}

/// What is aimed at are a cloud's triangles, as they are lit, by directions whose density is weighed where they are drawn.
fn can_aim(descriptor: &BouncedDescriptor) -> bool {
    !descriptor.aims()
        || (descriptor.emitter_samples <= MAX_EMITTER_SAMPLES
            && descriptor.lit()
            && !descriptor.primitives.are_instances()
            && !descriptor.primitives.are_disks()
            && descriptor.sampling != Sampling::Uniform)
}

/// The device does not tell its steps, and of buffers there are eight.
fn can_count(descriptor: &BouncedDescriptor) -> bool {
    !(descriptor.statistics && (descriptor.primitives.by_device() || descriptor.gathered()))
}

/// Words of bits per pixel.
pub(crate) fn words(rays_per_pixel: u32) -> u32 {
    rays_per_pixel.div_ceil(32)
}

/// Assembles the module of a stage.
fn source(descriptor: &BouncedDescriptor, stage: Stage) -> Result<String, Error> {
    let mut flags = descriptor.flags();
    flags.extend(stage.flag());
    shader::assemble("bounced_z_buffer", SOURCE, &flags, &[])
}

/// All combinations of three switches.
const SWITCHES: [[bool; 3]; 8] = [
    [false, false, false],
    [false, true, false],
    [true, false, false],
    [true, true, false],
    [false, false, true],
    [false, true, true],
    [true, false, true],
    [true, true, true],
];

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    let payloads = [
        Payload::Occlusion,
        Payload::Radiance,
        Payload::LitRadiance,
        Payload::Sky,
        Payload::LitAndGathered,
    ];
    let traced = [
        Primitives::Triangles,
        Primitives::Disks { levels: 1 },
        Primitives::Instances,
        Primitives::AlphaTested,
        Primitives::AlphaTestedInstances,
        #[cfg(feature = "ray-query")]
        Primitives::RayQuery,
    ];
    for payload in payloads {
        for primitives in traced {
            for sampling in [Sampling::Cosine, Sampling::Glossy] {
                for [statistics, counted, environment] in SWITCHES {
                    for emitter_samples in [0, 1] {
                        let descriptor = BouncedDescriptor {
                            payload,
                            primitives,
                            sampling,
                            statistics,
                            counted,
                            environment,
                            emitter_samples,
                        };
                        if is_possible(&descriptor)
                            && is_environment_possible(&descriptor)
                            && can_aim(&descriptor)
                            && can_count(&descriptor)
                        {
                            list_stages(all, &descriptor)?;
                        }
                    }
                }
            }
        }
    }
    Ok(())
}

/// The modules of one descriptor.
fn list_stages(all: &mut Listing<'_>, descriptor: &BouncedDescriptor) -> Result<(), Error> {
    let stages = [
        (true, Stage::All),
        (descriptor.counted, Stage::Listed),
        (descriptor.takes_more(), Stage::More),
    ];
    for (_, stage) in stages.into_iter().filter(|(is_made, _)| *is_made) {
        let name = name_of(
            match descriptor.payload {
                Payload::Occlusion => "bounced_z_buffer occlusion",
                _ => "bounced_z_buffer radiance",
            },
            &[
                (descriptor.sky(), "sky"),
                (descriptor.lit(), "lit"),
                (descriptor.environment && !descriptor.sky(), "environment"),
                (descriptor.gathered(), "gathered"),
                (descriptor.aims(), "emitters"),
                (descriptor.primitives.are_disks(), "disks"),
                (descriptor.primitives.are_instances(), "instances"),
                (descriptor.primitives.are_alpha_tested(), "alpha tested"),
                (descriptor.primitives.by_device(), "ray query"),
                (descriptor.sampling == Sampling::Glossy, "glossy"),
                (descriptor.statistics, "statistics"),
                (descriptor.counted && stage == Stage::All, "counted"),
                (stage == Stage::Listed, "list"),
                (stage == Stage::More, "more"),
            ],
        );
        let features = descriptor.primitives.features();
        all.add_for(features, &name, source(descriptor, stage)?);
    }
    Ok(())
}

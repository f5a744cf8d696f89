//! Sums of surfels' contributions per pixel, near ones finely and far ones coarsely (Deep Screen Space 3.2;
//! `wgsl/shell_splatter.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use std::sync::{Arc, OnceLock};

use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device, Features, TextureView,
    TextureViewDimension,
};

use self::{
    params::{LevelPlace, SplatParams, ViewParams, place_levels},
    settings::{MIN_EPSILON, SplatSettings},
};
use crate::{
    effect::{Effect, Listing, SumPlanes},
    environment::{EnvironmentLight, params::PlacedParams},
    error::{Error, check_setting},
    geometry::Material,
    gpu::compiler::Compiler,
    gpu::listing::name_of,
    gpu::{
        Kernel, Timestamps,
        binding::{self, Kept, Layout, Named, whole},
        check_timestamps, compute_pass, dispatch, shader, storage,
        uniforms::{Parameters, Uniforms},
    },
    receivers::{Frame, ListedReceiversPass, Place, Receivers, plane},
    recorded::{Last, Stamp, never},
    surfel::SurfelCloud,
    surfel_shader::radiance_bytes,
    surfelizer::settings::Reach,
    work::{PixelList, level_size},
};

const SOURCE: &str = include_str!("../../wgsl/shell_splatter.wgsl");

const LABEL: &str = "deep-screen-space shell splatter";

/// Splats surfels for one [`Effect`]. Holds pipelines only; one serves any number of views.
///
/// A pixel's contributions are about its shading normal. Where that leans off the surface by an angle θ, as with a strong
/// normal map, the part of its hemisphere that the pixel's own surface hides, `(1 − cos θ) / 2`, counts as empty, unless the
/// effect says otherwise: [`AmbientOcclusion::own_surface`](crate::AmbientOcclusion::own_surface), [`Effect::own_surface`].
#[derive(Debug)]
pub struct ShellSplatter {
    effect: Arc<Effect>,
    statistics: bool,
    build_layout: Layout,
    splat_layout: Layout,
    plan_layout: Layout,
    uniforms: Uniforms,
    plan: ComputePipeline,
    build_clusters: ComputePipeline,
    build_groups: ComputePipeline,
    splat: ComputePipeline,
    listed_receivers: ListedReceiversPass,
}

/// What a [`ShellSplatter`] is compiled for.
#[derive(Clone, Copy, Debug)]
pub struct ShellSplatterDescriptor<'a> {
    /// The effect.
    pub effect: &'a Effect,
    /// Whether to use subgroup operations; see [`ShellSplatter::optional_features`].
    pub subgroups: bool,
    /// Whether to count pairs into [`SplatView::statistics`]. Slower; for measuring.
    pub statistics: bool,
}

/// Bounds of runs of a cloud's surfels on each level. Made once a cloud, for any number of views.
#[derive(Debug)]
pub struct SurfelClusters {
    pub(crate) buffer: Buffer,
    /// Two indirect dispatches per level: for the clusters, and for their groups.
    dispatches: Buffer,
    pub(crate) places: Vec<LevelPlace>,
    capacity: u32,
    /// What the bounds were last recorded for: surfels reach no farther than these settings let them.
    recorded: Option<(SplatSettings, Stamp)>,
    kept: Kept,
}

impl SurfelClusters {
    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.buffer.size() + self.dispatches.size()
    }

    /// That they were recorded with these settings from this cloud, since that was.
    pub(crate) fn check(&self, cloud: &SurfelCloud, settings: &SplatSettings) -> Result<(), Error> {
        const NAME: &str = "SurfelClusters";
        check_clusters(cloud, settings, self)?;
        cloud.last()?;
        let (recorded, of) = self.recorded.as_ref().ok_or_else(|| never(NAME))?;
        cloud.check_source(NAME, of)?;
        if *recorded != bounds_of(settings) {
            return Err(Error::Mismatch {
                name: NAME,
                found: format!("recorded with {recorded:?}"),
                needed: format!("{:?}", bounds_of(settings)),
            });
        }
        Ok(())
    }
}

/// Bytes of a `Cluster` (`wgsl/common/cluster.wgsl`).
const CLUSTER_BYTES: u64 = 32;

crate::reflection::bytes_of_wgsl!(
    clusters_are_the_shaders: CLUSTER_BYTES, as "Cluster" in [
        "shell_splatter build", "shell_splatter splat", "sg_hull_gather surfels",
    ]
);

/// Bytes of an indirect dispatch.
const DISPATCH_BYTES: u64 = 12;

/// One view's sums per level.
#[derive(Debug)]
pub struct SplatView {
    size: [u32; 2],
    /// Those of listed pixels, made by the first recording with a list.
    listed: OnceLock<Receivers>,
    pub(crate) sums: TextureView,
    planes: SumPlanes,
    levels: u32,
    statistics: Option<Buffer>,
    pub(crate) recorded: Last<Splatted>,
    kept: Kept,
}

/// What a view's sums are of.
#[derive(Clone, Debug)]
pub(crate) struct Splatted {
    pub effect: Arc<Effect>,
    /// The frame's.
    pub place: Place,
    pub levels: u32,
    /// Of a work list.
    pub sub_image: Option<u32>,
    /// The cloud's recording.
    pub of: Stamp,
}

impl SplatView {
    /// Width and height in pixels: that of the cameras' viewports, or of a sub-image of them.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// How many levels it has room for.
    pub fn levels(&self) -> u32 {
        self.levels
    }

    /// The sums: an array texture with one layer per level, or for an effect of more than four channels two, of which the first
    /// has four channels; `R32Float`, `Rg32Float` or `Rgba32Float` by their number; row 0 on top (usages `TEXTURE_BINDING |
    /// COPY_SRC`). Level sums are noisy by design; their total is the effect's sum.
    pub fn sums(&self) -> &TextureView {
        &self.sums
    }

    /// What the last recording counted, where the splatter was made to: four `u32` a level, namely pairs evaluated,
    /// those within their shell, those of them that contributed, and an unused one (usage `COPY_SRC`).
    pub fn statistics(&self) -> Option<&Buffer> {
        self.statistics.as_ref()
    }

    pub(crate) fn planes(&self) -> SumPlanes {
        self.planes
    }

    /// Those that were splatted to: the frame's, or of its sub-image those that were listed.
    pub(crate) fn receivers<'r>(&'r self, splatted: &Splatted, frame: &Frame<'r>) -> &'r Receivers {
        let listed = self.listed.get().filter(|_| splatted.sub_image.is_some());
        listed.unwrap_or(frame.receivers)
    }

    /// Room for listed ones.
    fn listed(&self, device: &Device) -> Result<&Receivers, Error> {
        if let Some(listed) = self.listed.get() {
            return Ok(listed);
        }
        let receivers = Receivers::new(device, self.size)?;
        Ok(self.listed.get_or_init(|| receivers))
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.listed.get().map_or(0, Receivers::memory_bytes)
            + self.planes.bytes(self.size(), self.levels)
            + self.statistics.as_ref().map_or(0, Buffer::size)
    }
}

/// What a recording of clusters works on.
#[derive(Clone, Copy, Debug)]
pub struct ClusterInput<'a> {
    /// The surfels.
    pub cloud: &'a SurfelCloud,
    /// As [`SplatInput::materials`].
    pub materials: Option<&'a Buffer>,
    /// As [`SplatInput::radiance`].
    pub radiance: Option<&'a Buffer>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

/// What one recording of the [`ShellSplatter`] works on.
#[derive(Clone, Copy, Debug)]
pub struct SplatInput<'a> {
    /// The pixels that surfels are splatted to, relative to the cloud's origin; its camera may be another than the cloud's
    /// (stereo, split screen).
    pub frame: &'a Frame<'a>,
    /// The surfels.
    pub cloud: &'a SurfelCloud,
    /// Their clusters, recorded for the same effect and settings.
    pub clusters: &'a SurfelClusters,
    /// A storage buffer of [`Material`](crate::Material)s, for an effect with [`Effect::materials`]. An index beyond
    /// its end takes the last one.
    pub materials: Option<&'a Buffer>,
    /// What the cloud's surfels send, for an effect with [`Effect::radiance`]: a storage buffer of
    /// [`SurfelRadiance`](crate::SurfelRadiance), 32 bytes for each surfel of the cloud's capacity.
    pub radiance: Option<&'a Buffer>,
    /// The environment, for an effect with [`Effect::environment`]: one with
    /// [`EnvironmentSettings::levels`](crate::EnvironmentSettings::levels).
    pub environment: Option<EnvironmentLight<'a>>,
    /// The pixels to compute, of a sub-image that has the view's size; all of the viewport, if left out. The others' sums
    /// are 0, and tiles without listed pixels cost next to nothing.
    pub work: Option<PixelList<'a>>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> ClusterInput<'a> {
    /// Without materials, radiance and timestamps.
    pub fn new(cloud: &'a SurfelCloud) -> Self {
        Self {
            cloud,
            materials: None,
            radiance: None,
            timestamps: None,
        }
    }
}

impl<'a> SplatInput<'a> {
    /// To all pixels, without materials, radiance, environment and timestamps.
    pub fn new(frame: &'a Frame<'a>, cloud: &'a SurfelCloud, clusters: &'a SurfelClusters) -> Self {
        Self {
            frame,
            cloud,
            clusters,
            materials: None,
            radiance: None,
            environment: None,
            work: None,
            timestamps: None,
        }
    }
}

impl ShellSplatter {
    /// What it was made for.
    pub(crate) fn effect(&self) -> &Effect {
        &self.effect
    }

    /// Features that make it faster where the device has them. None is needed.
    pub fn optional_features() -> Features {
        Features::SUBGROUP
    }

    /// Compiles the pipelines.
    ///
    /// # Errors
    /// [`Error::Feature`] where subgroups are asked for and the device lacks them, [`Error::Effect`] where the effect's source
    /// has a malformed directive or not the outputs and constants that are given, [`Error::Setting`] for a number of channels
    /// that is not 1 to 8. WGSL that does not compile is wgpu's own validation error, as for any shader.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        descriptor: &ShellSplatterDescriptor<'_>,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        let effect = descriptor.effect;
        effect.check()?;
        if descriptor.subgroups && !device.features().contains(Features::SUBGROUP) {
            return Err(Error::Feature {
                feature: Features::SUBGROUP,
                why: "ShellSplatterDescriptor::subgroups",
            });
        }
        let module = |variant| -> Result<_, Error> {
            let source = source(effect, variant)?;
            let label = label(effect, "shell splatter");
            Ok(shader::create_with(device, &label, source, &effect.source))
        };
        let build_module = module(SplatVariant::Build)?;
        let splat_module = module(SplatVariant::Splat {
            subgroups: descriptor.subgroups,
            statistics: descriptor.statistics,
        })?;
        let plan_layout = build_module.layout(device, &["plan"]);
        let build_layout = build_module.layout(device, &["build_clusters", "build_groups"]);
        let splat_layout = splat_module.layout(device, &["splat"]);
        let constants = effect.overrides();
        let kernel = |module, entry, layout: &Layout| {
            Kernel {
                label: &label(effect, entry),
                module,
                entry,
                layouts: &[&layout.raw],
                constants: &constants,
                cache,
            }
            .create(device)
        };
        Ok(Self {
            plan: kernel(&build_module, "plan", &plan_layout),
            build_clusters: kernel(&build_module, "build_clusters", &build_layout),
            build_groups: kernel(&build_module, "build_groups", &build_layout),
            splat: kernel(&splat_module, "splat", &splat_layout),
            listed_receivers: ListedReceiversPass::new(device, cache)?,
            effect: Arc::new(effect.clone()),
            statistics: descriptor.statistics,
            plan_layout,
            build_layout,
            splat_layout,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// How far surfels reach with these settings, if the effect's `max_distance` is that of a form factor,
    /// `r √(1/ε − 1)`: what to give to [`SurfelizerSettings::reach`](crate::SurfelizerSettings::reach).
    pub fn reach(settings: &SplatSettings) -> Reach {
        let epsilon = settings.epsilon.max(MIN_EPSILON);
        let radii = (1.0 / epsilon - 1.0).max(0.0).sqrt()
            * (1_u32
                << settings
                    .levels
                    .clamp(1, settings::MAX_LEVELS)
                    .saturating_sub(1)) as f32;
        Reach {
            radii: if settings.unbounded {
                f32::INFINITY
            } else {
                radii
            },
            world: settings.radius,
        }
    }

    /// Room for the clusters of a cloud.
    ///
    /// # Errors
    /// [`Error::Setting`] for levels out of range, [`Error::Limit`] where the device cannot bind as much.
    pub fn create_clusters(
        &self,
        device: &Device,
        cloud: &SurfelCloud,
        levels: u32,
    ) -> Result<SurfelClusters, Error> {
        check_levels(levels)?;
        let (places, count) = place_levels(cloud.capacity.surfels, levels);
        Ok(SurfelClusters {
            buffer: storage(
                device,
                "deep-screen-space surfel clusters",
                count.max(1) * CLUSTER_BYTES,
                BufferUsages::empty(),
            )?,
            dispatches: storage(
                device,
                "deep-screen-space cluster dispatches",
                2 * DISPATCH_BYTES * u64::from(levels),
                BufferUsages::INDIRECT,
            )?,
            places,
            capacity: cloud.capacity.surfels,
            recorded: None,
            kept: Kept::default(),
        })
    }

    /// Textures for a view of `width` × `height` pixels: a camera's viewport, or a sub-image of level l, `⌈width / 2^l⌉ ×
    /// ⌈height / 2^l⌉`.
    ///
    /// # Errors
    /// [`Error::Setting`] for levels or a size out of range, [`Error::Limit`] for a size beyond the device's.
    pub fn create_view(
        &self,
        device: &Device,
        width: u32,
        height: u32,
        levels: u32,
    ) -> Result<SplatView, Error> {
        check_levels(levels)?;
        let size = [width, height];
        let planes = self.effect.sums();
        let sums = plane(
            device,
            "deep-screen-space level sums",
            planes.format,
            size,
            levels * planes.count,
        )?;
        let statistics = self
            .statistics
            .then(|| {
                storage(
                    device,
                    "deep-screen-space splat statistics",
                    16 * u64::from(levels),
                    BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
                )
            })
            .transpose()?;
        Ok(SplatView {
            size,
            listed: OnceLock::new(),
            sums: sums.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(TextureViewDimension::D2Array),
                ..Default::default()
            }),
            planes,
            levels,
            statistics,
            recorded: Last::default(),
            kept: Kept::default(),
        })
    }

    /// Records the clustering of a cloud, after the recording that makes it and before those that splat it.
    ///
    /// # Errors
    /// [`Error::Setting`], or [`Error::Mismatch`] where the clusters were made for another cloud's capacity or fewer
    /// levels; [`Error::Recording`] for a cloud that was not recorded; [`Error::Buffer`] as [`ShellSplatter::record`].
    pub fn record_clusters(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &ClusterInput<'_>,
        settings: &SplatSettings,
        clusters: &mut SurfelClusters,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let cloud = input.cloud;
        check_clusters(cloud, settings, clusters)?;
        let of = cloud.last()?;
        let given = self.check_given(device, cloud, input.materials, input.radiance)?;
        let mut parameters = Parameters::new(device);
        let levels: Vec<_> = (0..settings.levels)
            .map(|level| {
                let place = clusters.places[level as usize];
                parameters.add(&SplatParams::new(settings, level, [1, 1], place))
            })
            .collect();
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let mut groups = clusters.kept.groups(device);
        let mut pass = compute_pass(encoder, &label(&self.effect, "clusters"), input.timestamps);
        let resources = [
            ("counters", whole(&cloud.counters)),
            ("dispatches", whole(&clusters.dispatches)),
        ];
        let plan = groups.next(&self.plan_layout, &resources);
        dispatch(&mut pass, &self.plan, &plan, 1);
        for (level, params) in (0_u32..).zip(levels) {
            let mut resources = vec![
                ("params", parameters.at(params)),
                ("surfels", whole(&cloud.surfels)),
                ("sources", whole(&cloud.sources)),
                ("counters", whole(&cloud.counters)),
                ("clusters", whole(&clusters.buffer)),
            ];
            resources.extend(given.clone());
            let group = groups.next(&self.build_layout, &resources);
            pass.push_debug_group(&format!("level {level}"));
            pass.set_bind_group(0, &group.raw, &group.offsets);
            let at = 2 * DISPATCH_BYTES * u64::from(level);
            pass.set_pipeline(&self.build_clusters);
            pass.dispatch_workgroups_indirect(&clusters.dispatches, at);
            pass.set_pipeline(&self.build_groups);
            pass.dispatch_workgroups_indirect(&clusters.dispatches, at + DISPATCH_BYTES);
            pass.pop_debug_group();
        }
        drop(groups);
        clusters.recorded = Some((bounds_of(settings), of));
        Ok(())
    }

    /// Records the splatting of a cloud into a view's sums.
    ///
    /// # Errors
    /// What [`SplatSettings::validate`] and [`PixelList::validate`] find; [`Error::Mismatch`] where the frame has another origin
    /// than the cloud, the view another size than the frame or the work's sub-image, or fewer levels than the settings, and where
    /// the clusters were last recorded with other settings (but for the seed); [`Error::Recording`] where they were not recorded
    /// from this cloud, since that was; [`Error::Buffer`] for a material table or radiance that is missing or too small;
    /// [`Error::Mismatch`] where the roughness or the environment is missing that the effect asks for.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SplatInput<'_>,
        settings: &SplatSettings,
        view: &SplatView,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let frame = input.frame;
        let viewport = frame.viewport();
        input.clusters.check(input.cloud, settings)?;
        frame.check_origin(input.cloud.origin())?;
        let given = self.check_given(device, input.cloud, input.materials, input.radiance)?;
        let environment = self
            .effect
            .environment_of("SplatInput::environment", input.environment)?;
        let roughness = self.effect.roughness_of(frame)?;
        if let Some(work) = &input.work {
            work.check(device, viewport)?;
        }
        let sub_image = input.work.as_ref().map_or(0, |work| work.level);
        let size = level_size([viewport.width, viewport.height], sub_image);
        if view.size() != size || view.levels < settings.levels || view.planes != self.effect.sums()
        {
            return Err(Error::Mismatch {
                name: "SplatView",
                found: format!(
                    "{:?} pixels, {} levels, {:?}",
                    view.size(),
                    view.levels,
                    view.planes
                ),
                needed: format!(
                    "{size:?} pixels, {} levels, {:?}",
                    settings.levels,
                    self.effect.sums()
                ),
            });
        }
        let receivers = match &input.work {
            Some(work) => {
                let listed = view.listed(device)?;
                self.listed_receivers
                    .record(device, encoder, frame, work, listed);
                listed
            }
            None => frame.receivers,
        };
        view.recorded.set(Splatted {
            effect: Arc::clone(&self.effect),
            place: frame.place(),
            levels: settings.levels,
            sub_image: input.work.as_ref().map(|work| work.level),
            of: input.cloud.last()?,
        });
        if let Some(statistics) = &view.statistics {
            encoder.clear_buffer(statistics, 0, None);
        }
        let mut parameters = Parameters::new(device);
        let levels: Vec<_> = (0..settings.levels)
            .map(|level| {
                let place = input.clusters.places[level as usize];
                let params = SplatParams::new(settings, level, view.size(), place);
                (parameters.add(&params), params.tiles_of_all_sub_buffers())
            })
            .collect();
        let seen = (self.effect.view || self.effect.roughness)
            .then(|| parameters.add(&ViewParams::new(frame, sub_image)));
        let placed = environment.map(|light| parameters.add(&PlacedParams::of(&light)));
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let roughness = roughness.map(|slice| slice.read());
        let mut besides = given;
        besides.extend(seen.map(|seen| ("view", parameters.at(seen))));
        let texture = roughness.as_ref().map(binding::view);
        besides.extend(texture.map(|texture| ("roughness_texture", texture)));
        besides.extend(placed.map(|placed| ("environment", parameters.at(placed))));
        besides.extend(
            environment
                .iter()
                .flat_map(|light| light.environment.splatted()),
        );
        // An effect may not read all that it asks for.
        besides.retain(|(name, _)| self.splat_layout.names().any(|own| own == *name));
        let mut groups = view.kept.groups(device);
        let mut pass = compute_pass(encoder, &label(&self.effect, "splat"), input.timestamps);
        for (level, (params, tiles)) in (0_u32..).zip(levels) {
            let mut resources = vec![
                ("params", parameters.at(params)),
                ("surfels", whole(&input.cloud.surfels)),
                ("sources", whole(&input.cloud.sources)),
                ("counters", whole(&input.cloud.counters)),
                ("clusters", whole(&input.clusters.buffer)),
                ("receivers", binding::view(&receivers.view)),
                ("sums", binding::view(&view.sums)),
            ];
            resources.extend(besides.clone());
            if let Some(statistics) = &view.statistics {
                resources.push(("statistics", whole(statistics)));
            }
            let group = if roughness.is_some() {
                groups.unkept(&self.splat_layout, &resources)
            } else {
                groups.next(&self.splat_layout, &resources)
            };
            pass.push_debug_group(&format!("level {level}"));
            dispatch(&mut pass, &self.splat, &group, tiles);
            pass.pop_debug_group();
        }
        Ok(())
    }

    /// What the effect is given besides surfels.
    fn check_given<'m>(
        &self,
        device: &Device,
        cloud: &SurfelCloud,
        materials: Option<&'m Buffer>,
        radiance: Option<&'m Buffer>,
    ) -> Result<Vec<Named<'m>>, Error> {
        const MATERIALS: &str = "materials";
        const RADIANCE: &str = "radiance";
        let missing = |name, needed: &str| Error::Buffer {
            name,
            found: "not been given".into(),
            needed: format!("{needed}, since the effect reads them"),
        };
        let mut given = Vec::new();
        if self.effect.materials {
            let buffer = materials.ok_or_else(|| missing(MATERIALS, "a table of materials"))?;
            binding::check_table::<Material>(device, MATERIALS, buffer)?;
            given.push((MATERIALS, binding::table::<Material>(buffer)));
        }
        if self.effect.radiance {
            let buffer = radiance.ok_or_else(|| missing(RADIANCE, "radiances of surfels"))?;
            let bytes = radiance_bytes(cloud);
            binding::check_first(device, RADIANCE, buffer, bytes)?;
            given.push((RADIANCE, binding::first(buffer, bytes)));
        }
        Ok(given)
    }
}

/// The modules that a splatter is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum SplatVariant {
    Build,
    Splat { subgroups: bool, statistics: bool },
}

/// Assembles one of them.
fn source(effect: &Effect, variant: SplatVariant) -> Result<String, Error> {
    let mut flags = effect.flags();
    match variant {
        SplatVariant::Build => flags.push("BUILD"),
        SplatVariant::Splat {
            subgroups,
            statistics,
        } => {
            flags.extend(subgroups.then_some("SUBGROUP"));
            flags.extend(statistics.then_some("STATISTICS"));
        }
    }
    shader::assemble("shell_splatter", SOURCE, &flags, &[effect.module()])
}

fn label(effect: &Effect, what: &str) -> String {
    format!("deep-screen-space {}: {what}", effect.label)
}

fn check_levels(levels: u32) -> Result<(), Error> {
    check_setting(
        (1..=settings::MAX_LEVELS).contains(&levels),
        "levels",
        levels,
        "1 to 8",
    )
}

fn check_clusters(
    cloud: &SurfelCloud,
    settings: &SplatSettings,
    clusters: &SurfelClusters,
) -> Result<(), Error> {
    if clusters.capacity != cloud.capacity.surfels
        || (clusters.places.len() as u32) < settings.levels
    {
        return Err(Error::Mismatch {
            name: "SurfelClusters",
            found: format!(
                "{} surfels, {} levels",
                clusters.capacity,
                clusters.places.len()
            ),
            needed: format!(
                "{} surfels, {} levels",
                cloud.capacity.surfels, settings.levels
            ),
        });
    }
    Ok(())
}

/// The settings that clusters' bounds depend on: all but the seed.
fn bounds_of(settings: &SplatSettings) -> SplatSettings {
    SplatSettings {
        seed: 0,
        ..*settings
    }
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    let effect = all.effect;
    let build = source(effect, SplatVariant::Build)?;
    all.add("shell_splatter build", build);
    for subgroups in [false, true] {
        for statistics in [false, true] {
            let variant = SplatVariant::Splat {
                subgroups,
                statistics,
            };
            let name = name_of(
                "shell_splatter splat",
                &[(subgroups, "subgroups"), (statistics, "statistics")],
            );
            let source = source(effect, variant)?;
            if subgroups {
                all.add_for(wgpu::Features::SUBGROUP, &name, source);
            } else {
                all.add(&name, source);
            }
        }
    }
    Ok(())
}

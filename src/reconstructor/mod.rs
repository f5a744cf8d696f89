//! From level sums to the caller's picture (Deep Screen Space 3.3; `wgsl/reconstructor.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use std::iter::once;

use wgpu::{
    CommandEncoder, ComputePipeline, Device, RenderPipeline, TextureFormat, TextureView,
    TextureViewDimension,
};

use self::{params::ReconstructorParams, settings::ReconstructorSettings};
use crate::{
    camera::Viewport,
    effect::{Effect, Listing, SumPlanes},
    environment::{EnvironmentLight, params::PlacedParams},
    error::Error,
    gpu::compiler::Compiler,
    gpu::listing::name_of,
    gpu::preprocess::Module,
    gpu::{
        Kernel, Timestamps,
        binding::{Kept, Layout, view},
        check_timestamps, first_pass,
        screen::{self, Screen},
        shader,
        uniforms::{Parameters, Uniforms},
    },
    receivers::{Frame, plane},
    shell_splatter::{ShellSplatter, SplatView, Splatted},
    texture_slice::{TextureSlice, check_apart},
    work::level_size,
};

const SOURCE: &str = include_str!("../../wgsl/reconstructor.wgsl");

const LABEL: &str = "deep-screen-space reconstructor";

/// Smooths level sums, adds them up and writes the effect into the caller's texture, or each of its outputs into one.
///
/// A sum that is not finite, since the effect overflowed or gave NaN, counts for nothing: on level 0 it is taken as 0,
/// on the others its pixel gets its neighbours' mean, or 0 where it has none. It never spreads.
///
/// Holds pipelines only, for one effect and one target format an output; one serves any number of views.
#[derive(Debug)]
pub struct Reconstructor {
    effect: Effect,
    smooth_layout: Layout,
    smooth_rows: ComputePipeline,
    smooth_columns: ComputePipeline,
    /// Without and with smoothed levels.
    reconstruct: [Pictures; 2],
    /// One an output.
    targets: Vec<TextureFormat>,
    uniforms: Uniforms,
}

/// Pipelines from sums to pictures, one an output, which bind the same.
#[derive(Debug)]
struct Pictures {
    layout: Layout,
    pipelines: Vec<RenderPipeline>,
}

/// What a [`Reconstructor`] needs for a view with more than one level.
#[derive(Debug)]
pub struct ReconstructorView {
    size: [u32; 2],
    levels: u32,
    planes: SumPlanes,
    scratch: Option<Scratch>,
    kept: Kept,
}

#[derive(Debug)]
struct Scratch {
    /// Level sums from the second on, smoothed along rows: the planes of each level.
    rows: TextureView,
    /// Their total, smoothed along columns too: the planes of one.
    total: TextureView,
}

impl ReconstructorView {
    /// GPU memory that it owns, bytes: one plane of sums per level, nothing with one level.
    pub fn memory_bytes(&self) -> u64 {
        if self.scratch.is_some() {
            self.planes.bytes(self.size, self.levels)
        } else {
            0
        }
    }
}

/// What one recording of the [`Reconstructor`] works on.
#[derive(Clone, Copy, Debug)]
pub struct ReconstructorInput<'a> {
    /// The frame that was splatted to, of whose G-buffer effects with [`Effect::albedo`] and [`Effect::roughness`] take these.
    pub frame: &'a Frame<'a>,
    /// The sums, splatted to this frame since their cloud was recorded. They know their levels and sub-image.
    pub sums: &'a SplatView,
    /// The caller's texture, of the format that the reconstructor was made for, usage `RENDER_ATTACHMENT`, covering the
    /// camera's viewport, or having a sub-image's pixels from the corner. Only these are written. What a work list left
    /// out gets what the effect makes of the sky.
    pub target: TextureSlice<'a>,
    /// The same for the effect's outputs from the second on ([`Effect::outputs`]), in their order: none for an effect of one.
    pub further: &'a [TextureSlice<'a>],
    /// As [`SplatInput::environment`](crate::SplatInput::environment), the same.
    pub environment: Option<EnvironmentLight<'a>>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> ReconstructorInput<'a> {
    /// For an effect of one output, without environment and timestamps.
    pub fn new(
        frame: &'a Frame<'a>,
        sums: &'a SplatView,
        target: impl Into<TextureSlice<'a>>,
    ) -> Self {
        Self {
            frame,
            sums,
            target: target.into(),
            further: &[],
            environment: None,
            timestamps: None,
        }
    }

    fn targets(&self) -> impl Iterator<Item = &TextureSlice<'a>> {
        once(&self.target).chain(self.further)
    }
}

/// [`Error::Mismatch`] for another number of targets than an effect has outputs.
fn check_number(name: &'static str, found: usize, effect: &Effect) -> Result<(), Error> {
    let needed = effect.outputs.len();
    if found == needed {
        return Ok(());
    }
    Err(Error::Mismatch {
        name,
        found: format!("{found} outputs"),
        needed: format!("{needed}, as the effect {} has", effect.label),
    })
}

impl ShellSplatter {
    /// The pass that makes a picture of this splatter's sums, in a target of that format: [`Reconstructor::new`] for the same
    /// effect.
    ///
    /// # Errors
    /// As [`Reconstructor::new`].
    pub fn reconstructor<'a>(
        &self,
        compiler: impl Into<Compiler<'a>>,
        target: TextureFormat,
    ) -> Result<Reconstructor, Error> {
        Reconstructor::new(compiler, self.effect(), target)
    }
}

impl Reconstructor {
    /// Compiles the pipelines. `target` is any colour format that can be rendered to (`R8Unorm`, `R16Float`,
    /// `Rgba16Float` …); its missing channels are dropped. Where the effect has several outputs it is the format of each.
    ///
    /// # Errors
    /// [`Error::Format`] for a target that cannot be rendered to or does not hold floats, [`Error::Effect`] and
    /// [`Error::Setting`] as [`ShellSplatter::new`](crate::ShellSplatter::new).
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        effect: &Effect,
        target: TextureFormat,
    ) -> Result<Self, Error> {
        Self::with_targets(compiler, effect, &vec![target; effect.outputs.len()])
    }

    /// The same with a format for each of the effect's outputs.
    ///
    /// # Errors
    /// As [`Reconstructor::new`], and [`Error::Mismatch`] for another number of formats than of outputs.
    pub fn with_targets<'a>(
        compiler: impl Into<Compiler<'a>>,
        effect: &Effect,
        targets: &[TextureFormat],
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        effect.check()?;
        check_number("Reconstructor targets", targets.len(), effect)?;
        for target in targets {
            screen::check_format(device, "Reconstructor target", *target)?;
        }
        let module = |variant| -> Result<_, Error> {
            let source = source(effect, variant)?;
            Ok(shader::create_with(device, LABEL, source, &effect.source))
        };
        let smooth_module = module(ReconstructorVariant::Smooth)?;
        let smooth_layout = smooth_module.layout(device, &["smooth_rows", "smooth_columns"]);
        let smooth = |entry| {
            Kernel {
                label: LABEL,
                module: &smooth_module,
                entry,
                layouts: &[&smooth_layout.raw],
                constants: &[],
                cache,
            }
            .create(device)
        };
        let (smooth_rows, smooth_columns) = (smooth("smooth_rows"), smooth("smooth_columns"));

        let pictures = |smoothed| -> Result<Pictures, Error> {
            let modules = (0..targets.len())
                .map(|output| module(ReconstructorVariant::Reconstruct { smoothed, output }))
                .collect::<Result<Vec<_>, _>>()?;
            let layout = modules[0].layout(device, &["reconstruct"]);
            let pipelines = modules.iter().zip(targets).map(|(module, &target)| {
                Screen {
                    label: LABEL,
                    module,
                    entry: "reconstruct",
                    layout: &layout.raw,
                    constants: &effect.overrides(),
                    target,
                    cache,
                }
                .create(device)
            });
            Ok(Pictures {
                pipelines: pipelines.collect(),
                layout,
            })
        };
        Ok(Self {
            effect: effect.clone(),
            smooth_layout,
            smooth_rows,
            smooth_columns,
            reconstruct: [pictures(false)?, pictures(true)?],
            targets: targets.to_vec(),
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Room for the reconstruction of a view's sums: nothing with one level.
    ///
    /// # Errors
    /// [`Error::Limit`] for more than the device can hold.
    pub fn create_view(
        &self,
        device: &Device,
        sums: &SplatView,
    ) -> Result<ReconstructorView, Error> {
        let (size, levels) = (sums.size(), sums.levels());
        let planes = self.effect.sums();
        let layers = |label, levels| -> Result<TextureView, Error> {
            let layers = levels * planes.count;
            let texture = plane(device, label, planes.format, size, layers)?;
            Ok(texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(TextureViewDimension::D2Array),
                ..Default::default()
            }))
        };
        let scratch = if levels > 1 {
            Some(Scratch {
                rows: layers("deep-screen-space smoothed rows", levels - 1)?,
                total: layers("deep-screen-space smoothed total", 1)?,
            })
        } else {
            None
        };
        Ok(ReconstructorView {
            size,
            levels,
            planes,
            scratch,
            kept: Kept::default(),
        })
    }

    /// Records the reconstruction into the caller's texture.
    ///
    /// # Errors
    /// [`Error::Setting`]; [`Error::Format`], [`Error::Size`] or [`Error::Usage`] for the target, [`Error::Mismatch`]
    /// where the sums are another effect's or the view was made for others, [`Error::Recording`] where the sums were not
    /// recorded, or not since their cloud was.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &ReconstructorInput<'_>,
        settings: &ReconstructorSettings,
        scratch: &ReconstructorView,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let (splatted, viewport) = self.check(input, scratch)?;
        let environment = self
            .effect
            .environment_of("ReconstructorInput::environment", input.environment)?;
        let roughness = self.effect.roughness_of(input.frame)?;
        let mut parameters = Parameters::new(device);
        let params = parameters.add(&ReconstructorParams::new(settings, input.frame, &splatted));
        let placed = environment.map(|light| parameters.add(&PlacedParams::of(&light)));
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let mut groups = scratch.kept.groups(device);
        let smoothing = scratch.scratch.as_ref().filter(|_| splatted.levels > 1);
        let receivers = input.sums.receivers(&splatted, input.frame);
        let shared = [
            ("params", parameters.at(params)),
            ("receivers", view(&receivers.view)),
        ];

        if let Some(scratch) = smoothing {
            let mut group = |from, to| {
                let mut resources = shared.to_vec();
                resources.extend([("sums", view(from)), ("means", view(to))]);
                groups.next(&self.smooth_layout, &resources)
            };
            let rows = group(input.sums.sums(), &scratch.rows);
            let columns = group(&scratch.rows, &scratch.total);
            let mut pass = first_pass(encoder, LABEL, input.timestamps);
            // A thread takes four pixels along the filter, a workgroup 8 x 8 threads.
            let Viewport { width, height, .. } = viewport;
            pass.set_pipeline(&self.smooth_rows);
            pass.set_bind_group(0, &rows.raw, &rows.offsets);
            pass.dispatch_workgroups(width.div_ceil(32), height.div_ceil(8), splatted.levels - 1);
            pass.set_pipeline(&self.smooth_columns);
            pass.set_bind_group(0, &columns.raw, &columns.offsets);
            pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(32), 1);
        }

        let Pictures { layout, pipelines } = &self.reconstruct[usize::from(smoothing.is_some())];
        let mut resources = shared.to_vec();
        resources.push(("sums", view(input.sums.sums())));
        resources.extend(smoothing.map(|scratch| ("means", view(&scratch.total))));
        let albedo = input.frame.gbuffer.albedo.filter(|_| self.effect.albedo);
        let [albedo, roughness] = [albedo, roughness].map(|slice| slice.map(|slice| slice.read()));
        let textures = [
            ("albedo_texture", &albedo),
            ("roughness_texture", &roughness),
        ];
        let textures = textures.map(|(name, texture)| Some((name, view(texture.as_ref()?))));
        resources.extend(textures.into_iter().flatten());
        resources.extend(placed.map(|placed| ("environment", parameters.at(placed))));
        resources.extend(
            environment
                .iter()
                .flat_map(|light| light.environment.splatted()),
        );
        // An effect may not read all that it asks for.
        resources.retain(|(name, _)| layout.names().any(|own| own == *name));
        let group = if albedo.is_some() || roughness.is_some() {
            layout.group(device, &resources)
        } else {
            groups.next(layout, &resources)
        };
        let last = pipelines.len() - 1;
        for (i, (pipeline, target)) in pipelines.iter().zip(input.targets()).enumerate() {
            let writes = [i == 0 && smoothing.is_none(), i == last];
            screen::draw_part(
                encoder,
                LABEL,
                (pipeline, &group),
                target,
                viewport,
                input.timestamps.map(|timestamps| (timestamps, writes)),
            );
        }
        Ok(())
    }

    /// What was splatted, and the part of the target that is to be written.
    fn check(
        &self,
        input: &ReconstructorInput<'_>,
        scratch: &ReconstructorView,
    ) -> Result<(Splatted, Viewport), Error> {
        const TARGET: &str = "ReconstructorInput::target";
        let sums = input.sums;
        let splatted = sums.recorded.get("SplatView")?;
        splatted.of.check_last("SplatView", "SurfelCloud")?;
        let frame = input.frame;
        frame.check_place("SplatView", &splatted.place)?;
        if *splatted.effect != self.effect {
            return Err(Error::Mismatch {
                name: "SplatView",
                found: format!("sums of the effect {}", splatted.effect.label),
                needed: format!("those of the very effect {}", self.effect.label),
            });
        }
        let whole = frame.viewport();
        let viewport = splatted.sub_image.map_or(whole, |level| {
            let [width, height] = level_size([whole.width, whole.height], level);
            Viewport::full(width, height)
        });
        check_number(
            "ReconstructorInput::target and further ones",
            1 + input.further.len(),
            &self.effect,
        )?;
        for (i, (target, format)) in input.targets().zip(&self.targets).enumerate() {
            screen::check_target(TARGET, target, viewport, *format)?;
            let others = input.further[i..].iter().map(|other| (TARGET, *other, 1));
            check_apart(TARGET, target, others)?;
            if self.effect.albedo || self.effect.roughness {
                check_apart(TARGET, target, frame.gbuffer.reads())?;
            }
        }
        if self.effect.albedo {
            frame
                .gbuffer
                .albedo_for(&format!("the effect {}", self.effect.label))?;
        }
        let size = sums.size();
        if scratch.size != size
            || scratch.levels < splatted.levels
            || scratch.planes != sums.planes()
        {
            return Err(Error::Mismatch {
                name: "ReconstructorView",
                found: format!(
                    "{:?} pixels, {} levels, {:?}",
                    scratch.size, scratch.levels, scratch.planes
                ),
                needed: format!(
                    "{size:?} pixels, {} levels, {:?}",
                    splatted.levels,
                    sums.planes()
                ),
            });
        }
        Ok((splatted, viewport))
    }
}

/// The modules that a reconstructor is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ReconstructorVariant {
    Smooth,
    Reconstruct { smoothed: bool, output: usize },
}

/// Assembles one of them.
fn source(effect: &Effect, variant: ReconstructorVariant) -> Result<String, Error> {
    let mut flags = effect.flags();
    let mut resolved = String::new();
    match variant {
        ReconstructorVariant::Smooth => flags.push("SMOOTH"),
        ReconstructorVariant::Reconstruct { smoothed, output } => {
            flags.extend(smoothed.then_some("SMOOTHED"));
            flags.extend(effect.albedo.then_some("ALBEDO"));
            resolved = effect.resolved(output);
        }
    }
    let output = Module {
        name: "output",
        file: &effect.label,
        text: &resolved,
    };
    let snippets = [effect.module(), output];
    shader::assemble("reconstructor", SOURCE, &flags, &snippets)
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    let effect = all.effect;
    let smooth = source(effect, ReconstructorVariant::Smooth)?;
    all.add("reconstructor smooth", smooth);
    for (output, name) in effect.outputs.iter().enumerate() {
        for smoothed in [true, false] {
            let file = if smoothed {
                "reconstructor smoothed"
            } else {
                "reconstructor"
            };
            let name = name_of(file, &[(output > 0, name)]);
            let variant = ReconstructorVariant::Reconstruct { smoothed, output };
            all.add(&name, source(effect, variant)?);
        }
    }
    Ok(())
}

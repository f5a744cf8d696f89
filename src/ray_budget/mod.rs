//! Which pixels have further rays (`wgsl/ray_budget.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;
pub(crate) mod view;

use wgpu::{BufferUsages, CommandEncoder, ComputePipeline, Device};

use self::{params::RayBudgetParams, settings::RayBudgetSettings, view::RayBudgetView};
use crate::{
    bounced_z_buffer::{descriptor::NEEDED_FOR_MORE, settings::Sampling, view::BouncedView},
    effect::Listing,
    error::Error,
    gpu::{
        Timestamps,
        binding::{Kept, Layout, view, whole},
        check_timestamps,
        compiler::Compiler,
        compute_pass, shader, storage,
        uniforms::Uniforms,
    },
    hit_resolver::{HitResolverView, settings::HitResolverSettings},
    receivers::{Frame, check_view_size},
    recorded::Last,
    texture_slice::TextureSlice,
};

const SOURCE: &str = include_str!("../../wgsl/ray_budget.wgsl");

const LABEL: &str = "deep-screen-space ray budget";

/// Bytes of the shader's `State`.
const STATE_BYTES: u64 = 1036;

crate::reflection::bytes_of_wgsl!(
    state_is_the_shaders: STATE_BYTES, as "State" in ["ray_budget"]
);

/// Decides which pixels are to have further rays: after a first recording of a [`BouncedZBuffer`](crate::BouncedZBuffer) whose
/// rays are [counted](crate::BouncedDescriptor::counted) and [`HitResolver::estimate`](crate::HitResolver::estimate), and before
/// [`BouncedZBuffer::record_more`](crate::BouncedZBuffer::record_more).
///
/// A pixel's number follows from how noisy its neighbours' rays are, and from how much of that noise the filter leaves: next to
/// nothing where hits are far, and most of it at contacts and on thin things. Its own rays have no say, so that means are what
/// they would be. Where receivers are glossy and it was [told so](Self::with_sampling), it follows besides from how much of what
/// arrives the pixel reflects, which is most where it is seen aslant.
///
/// Holds pipelines only; one serves any number of views.
#[derive(Debug)]
pub struct RayBudget {
    glossy: bool,
    stages: [(Layout, ComputePipeline); 5],
    uniforms: Uniforms,
}

/// What one recording of the [`RayBudget`] works on.
#[derive(Clone, Copy, Debug)]
pub struct RayBudgetInput<'a> {
    /// The frame that was traced from.
    pub frame: &'a Frame<'a>,
    /// The hits.
    pub hits: &'a BouncedView,
    /// What was estimated of them.
    pub estimates: &'a HitResolverView,
    /// The filter that the picture will be made with.
    pub filter: &'a HitResolverSettings,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> RayBudgetInput<'a> {
    /// Without timestamps.
    pub fn new(
        frame: &'a Frame<'a>,
        hits: &'a BouncedView,
        estimates: &'a HitResolverView,
        filter: &'a HitResolverSettings,
    ) -> Self {
        Self {
            frame,
            hits,
            estimates,
            filter,
            timestamps: None,
        }
    }
}

/// In the order in which they run.
const STAGES: [&str; 5] = ["pool", "measure", "choose", "list", "plan"];

/// As in the shader: side of a cell in pixels.
const CELL: u32 = 4;

impl RayBudget {
    /// Compiles the pipelines, for hits of any receivers. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// None that a device with these limits gives.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        Self::with_sampling(compiler, Sampling::Cosine)
    }

    /// For hits of such receivers. With [`Sampling::Glossy`] those of radiance alone; the frame's G-buffer has the roughness.
    ///
    /// # Errors
    /// None that a device with these limits gives.
    pub fn with_sampling<'a>(
        compiler: impl Into<Compiler<'a>>,
        sampling: Sampling,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        let glossy = sampling == Sampling::Glossy;
        let module = shader::create(device, LABEL, source(glossy)?);
        Ok(Self {
            glossy,
            stages: STAGES.map(|entry| module.kernel(device, entry, &[], cache)),
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Room for a view of `width` × `height` pixels.
    ///
    /// # Errors
    /// [`Error::Setting`] for a size out of range, [`Error::Limit`] for more than the device can hold.
    pub fn create_view(
        &self,
        device: &Device,
        width: u32,
        height: u32,
    ) -> Result<RayBudgetView, Error> {
        let size = [width, height];
        check_view_size(device, "deep-screen-space ray budget", size)?;
        let pixels = u64::from(width) * u64::from(height);
        let cells = size.map(|side| side.div_ceil(CELL));
        let none = BufferUsages::empty();
        Ok(RayBudgetView {
            size,
            needs: storage(device, "deep-screen-space needs of rays", 4 * pixels, none)?,
            cells: storage(
                device,
                "deep-screen-space noise of cells",
                8 * cells.map(u64::from).iter().product::<u64>(),
                none,
            )?,
            state: storage(
                device,
                "deep-screen-space ray budget",
                STATE_BYTES,
                BufferUsages::COPY_DST,
            )?,
            work: storage(
                device,
                "deep-screen-space pixels with further rays",
                8 * (1 + pixels),
                BufferUsages::COPY_SRC,
            )?,
            dispatch: storage(
                device,
                "deep-screen-space dispatch of further rays",
                12,
                BufferUsages::INDIRECT,
            )?,
            recorded: Last::default(),
            kept: Kept::default(),
        })
    }

    /// Records the decision.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings out of range; [`Error::Mismatch`] where the hits' rays are not counted, sizes differ, or
    /// it was made for glossy receivers and hits are of others or the G-buffer has no roughness;
    /// [`Error::Recording`] where the hits or the estimates were not recorded from this frame.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &RayBudgetInput<'_>,
        settings: &RayBudgetSettings,
        budget: &RayBudgetView,
    ) -> Result<(), Error> {
        settings.validate()?;
        input.filter.validate()?;
        check_timestamps(input.timestamps)?;
        let RayBudgetInput {
            frame,
            hits,
            estimates,
            ..
        } = input;
        let traced = hits.recorded.get("BouncedView")?;
        frame.check_place("BouncedView", &traced.place)?;
        let place = estimates.estimated.get("HitResolverView")?;
        frame.check_place("HitResolverView", &place)?;
        if !hits.descriptor.takes_more() {
            return Err(Error::Mismatch {
                name: "RayBudgetInput::hits",
                found: format!("{:?}", hits.descriptor),
                needed: NEEDED_FOR_MORE.into(),
            });
        }
        let roughness = self.roughness_of(input)?;
        for (name, size) in [
            ("RayBudgetInput::estimates", estimates.size()),
            ("RayBudgetView", budget.size),
        ] {
            if size != hits.size() {
                return Err(Error::Mismatch {
                    name,
                    found: format!("{size:?} pixels"),
                    needed: format!("{:?} pixels", hits.size()),
                });
            }
        }
        budget.recorded.set(frame.place());
        encoder.clear_buffer(&budget.state, 0, None);
        let of_a_set = (&traced.settings, hits.descriptor.emitter_samples);
        let params = RayBudgetParams::new(*settings, frame, input.filter, of_a_set);
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let mut all = vec![
            ("params", parameters.at(params)),
            ("receivers", view(&frame.receivers.view)),
            ("means", view(&estimates.means)),
            ("inverse_distances", view(&estimates.inverse_distances)),
            ("cells", whole(&budget.cells)),
            ("needs", whole(&budget.needs)),
            ("state", whole(&budget.state)),
            ("work", whole(&budget.work)),
            ("dispatches", whole(&budget.dispatch)),
        ];
        let roughness = roughness.map(|slice| slice.read());
        all.extend(roughness.as_ref().map(|r| ("roughness_texture", view(r))));
        let mut groups = budget.kept.groups(device);
        let groups = self.stages.each_ref().map(|(layout, _)| {
            let bound = all.iter();
            let bound = bound.filter(|(name, _)| layout.names().any(|own| own == *name));
            let bound: Vec<_> = bound.cloned().collect();
            // The roughness is the caller's.
            if bound.iter().any(|(name, _)| *name == "roughness_texture") {
                groups.unkept(layout, &bound)
            } else {
                groups.next(layout, &bound)
            }
        });
        let pixels = budget.size.map(|side| side.div_ceil(8));
        let cells = pixels.map(|side| side.div_ceil(CELL));
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);
        for ((name, group), (_, pipeline)) in STAGES.iter().zip(&groups).zip(&self.stages) {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group.raw, &group.offsets);
            match *name {
                "pool" => pass.dispatch_workgroups(cells[0], cells[1], 1),
                "measure" | "list" => pass.dispatch_workgroups(pixels[0], pixels[1], 1),
                _ => pass.dispatch_workgroups(1, 1, 1),
            }
        }
        Ok(())
    }
}

impl RayBudget {
    /// The roughness, where it is needed.
    fn roughness_of<'t>(
        &self,
        input: &RayBudgetInput<'t>,
    ) -> Result<Option<TextureSlice<'t>>, Error> {
        if !self.glossy {
            return Ok(None);
        }
        let of = &input.hits.descriptor;
        if of.sampling != Sampling::Glossy || !of.payload.is_radiance() {
            return Err(Error::Mismatch {
                name: "RayBudgetInput::hits",
                found: format!("{:?}, {:?}", of.payload, of.sampling),
                needed: "radiance of Sampling::Glossy, as the RayBudget was made for".into(),
            });
        }
        input
            .frame
            .gbuffer
            .roughness_for("Sampling::Glossy")
            .map(Some)
    }
}

fn source(glossy: bool) -> Result<String, Error> {
    let flags: &[&str] = if glossy { &["GLOSSY"] } else { &[] };
    shader::assemble("ray_budget", SOURCE, flags, &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add("ray_budget", source(false)?);
    all.add("ray_budget glossy", source(true)?);
    Ok(())
}

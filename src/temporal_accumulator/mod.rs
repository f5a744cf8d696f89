//! The mean over frames of a noisy picture (`wgsl/temporal_accumulator.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use glam::DVec3;
use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device, RenderPipeline, TextureFormat,
    TextureUsages, TextureView,
};

use self::{params::TemporalParams, settings::TemporalSettings};
use crate::{
    camera::{Camera, Viewport},
    effect::Channels,
    effect::Listing,
    error::{Error, check_setting},
    gbuffer::samples_as_float,
    gpu::compiler::Compiler,
    gpu::listing::name_of,
    gpu::{
        Timestamps,
        binding::{Kept, Layout, view, whole},
        check_timestamps, compute_pass, first_pass,
        screen::{self, Screen},
        shader, storage,
        uniforms::{Place, Uniforms, Uploaded},
    },
    hit_resolver::HitResolverView,
    receivers::{Frame, Place as FramePlace, Receivers, plane, plane_bytes},
    recorded::never,
    texture_slice::{TextureSlice, check_apart, check_slice},
};

const SOURCE: &str = include_str!("../../wgsl/temporal_accumulator.wgsl");

const LABEL: &str = "deep-screen-space temporal accumulator";

/// Averages an effect's picture over frames, and writes the mean into the caller's texture.
///
/// For what is noisy in each frame and right on average. It is the crate's only pass whose result depends on frames
/// before: without it no state survives a frame.
///
/// A pixel's history is fetched from where its surface was in the last frame, by the cameras or by the caller's motion
/// vectors (reverse reprojection: Nehab et al., *Accelerating Real-Time Shading with Reverse Reprojection Caching*,
/// 2007), bilinearly from those of the four texels there that show the same surface by their distance and normal.
/// Where none does, the pixel starts anew. With cameras that are equal, or motion of whole pixels, histories are taken
/// as they are: a still picture's mean is the arithmetic mean of its frames. Motion by fractions of a pixel smooths the
/// history by a little in each frame.
///
/// With motion vectors a pixel whose surface differs from what was there, by as little as an eighth of a pixel's side off
/// its plane, starts anew where something seen now has moved away from there, by a sixteenth of a pixel and more: nothing
/// ghosts behind a thin thing that moves. Without them, once a mover is out of sight, and where one comes out from behind a
/// thin thing that stands still, [`TemporalSettings::depth_tolerance`] alone tells the two apart.
///
/// * **Sky** holds no history: its pixels show this frame's picture.
/// * **A value that is not finite** counts as absent: the pixel keeps its history, or shows 0 where it has none.
///
/// Holds pipelines only, for one number of channels and one target format; one serves any number of views.
#[derive(Debug)]
pub struct TemporalAccumulator {
    channels: Channels,
    target: TextureFormat,
    /// Without and with motion vectors.
    accumulate: [(Layout, ComputePipeline); 2],
    claim: (Layout, ComputePipeline),
    show: (Layout, RenderPipeline),
    uniforms: Uniforms,
}

/// What one view's frames left: the last frame's receivers, and means of the last frame and of the one being recorded.
///
/// A view of another size needs a new one. Recordings swap it, so they have to be submitted in their order, and all of
/// them.
#[derive(Debug)]
pub struct TemporalHistory {
    channels: Channels,
    /// The last frame's.
    receivers: Receivers,
    /// What its positions are relative to, from its camera's focus; nothing before the first recording.
    origin: Option<DVec3>,
    means: [TextureView; 2],
    /// Which pixels moved away from where, made by the first recording with motion vectors.
    claims: Option<Buffer>,
    /// The means that were recorded last.
    last: usize,
    /// Where the frame was seen from whose single rays were joined last; nothing where a picture was.
    joined: Option<FramePlace>,
    /// By the means that recordings write.
    kept: [Kept; 2],
}

impl TemporalHistory {
    /// Width and height in pixels: that of the cameras' viewports.
    pub fn size(&self) -> [u32; 2] {
        self.receivers.size
    }

    /// The means as the last recording leaves them, and the number of frames in each, 0 where there is no history:
    /// `Rg32Float` (mean, frames) for one channel, `Rgba32Float` (mean, mean, mean, frames) for three; row 0 on top, a
    /// texel per pixel of the viewport (usages `TEXTURE_BINDING | COPY_SRC`). A filter that follows can smooth what is
    /// young more.
    pub fn means(&self) -> &TextureView {
        &self.means[self.last]
    }

    /// [`Error::Recording`] where not this frame's rays were joined last.
    pub(crate) fn check_joined(&self, frame: &Frame<'_>) -> Result<(), Error> {
        const NAME: &str = "HitResolverInput::history";
        let joined = self.joined.as_ref().ok_or_else(|| never(NAME))?;
        frame.check_place(NAME, joined)
    }

    pub(crate) fn channels(&self) -> Channels {
        self.channels
    }

    /// GPU memory that it owns, bytes: 32 per pixel with one channel, 48 with three, and 4 once there were motion vectors.
    pub fn memory_bytes(&self) -> u64 {
        self.receivers.memory_bytes()
            + 2 * plane_bytes(means_format(self.channels), self.size(), 1)
            + self.claims.as_ref().map_or(0, Buffer::size)
    }

    fn claims(&mut self, device: &Device) -> Result<Buffer, Error> {
        if let Some(claims) = &self.claims {
            return Ok(claims.clone());
        }
        let [width, height] = self.size();
        let claims = storage(
            device,
            "deep-screen-space temporal claims",
            4 * u64::from(width) * u64::from(height),
            BufferUsages::COPY_DST,
        )?;
        Ok(self.claims.insert(claims).clone())
    }
}

/// Where the pixels' surfaces were.
#[derive(Clone, Copy, Debug)]
pub struct MotionVectors<'a> {
    /// A vector a pixel in the first two components, of any float or snorm format, usage `TEXTURE_BINDING`, covering
    /// the camera's viewport. One that is not finite, or leads out of the viewport, drops the pixel's history.
    pub texture: TextureSlice<'a>,
    /// What makes a vector the pixel's position in this frame less its surface's in the last, as a share of the
    /// viewport's width and height, y down: `[1, 1]` for vectors in such units (UV), `[1 / width, 1 / height]` for
    /// those in pixels, `[0.5, -0.5]` for those in NDC, and the opposite signs for those that point into the past.
    /// Finite, not 0. What cameras are jittered by counts where it moved the picture.
    pub scale: [f32; 2],
}

impl<'a> MotionVectors<'a> {
    /// Vectors in UV.
    pub fn uv(texture: impl Into<TextureSlice<'a>>) -> Self {
        Self {
            texture: texture.into(),
            scale: [1.0, 1.0],
        }
    }
}

/// What one recording of the [`TemporalAccumulator`] works on.
#[derive(Clone, Copy, Debug)]
pub struct TemporalInput<'a> {
    /// This frame.
    pub frame: &'a Frame<'a>,
    /// The camera of the history's last recording, with a viewport of the same size; in the first frame, any. A caller
    /// that moved its world's origin gives it in the new world.
    pub previous_camera: &'a Camera,
    /// Where surfaces were; `None` where only the camera moves. A surface's distance from the previous eye is taken to
    /// be that of its present place: one that moves towards the eye by more than
    /// [`TemporalSettings::depth_tolerance`] of it in a frame starts anew.
    pub motion: Option<MotionVectors<'a>>,
    /// This frame's picture: any float, snorm or unorm format with one component or three, by the channels. Usage
    /// `TEXTURE_BINDING`, covering the camera's viewport. It may be the target.
    pub picture: TextureSlice<'a>,
    /// The caller's texture, of the format that the accumulator was made for, usage `RENDER_ATTACHMENT`, covering the
    /// camera's viewport. Only the viewport is written: one channel into all three colours, alpha 1.
    pub target: TextureSlice<'a>,
    /// Drops the history of all pixels, as a camera's cut needs.
    pub reset: bool,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> TemporalInput<'a> {
    /// Without motion vectors, reset and timestamps.
    pub fn new(
        frame: &'a Frame<'a>,
        previous_camera: &'a Camera,
        picture: impl Into<TextureSlice<'a>>,
        target: impl Into<TextureSlice<'a>>,
    ) -> Self {
        Self {
            frame,
            previous_camera,
            motion: None,
            picture: picture.into(),
            target: target.into(),
            reset: false,
            timestamps: None,
        }
    }
}

/// What one [`TemporalAccumulator::join`] works on.
#[derive(Clone, Copy, Debug)]
pub struct TemporalJoinInput<'a> {
    /// This frame.
    pub frame: &'a Frame<'a>,
    /// As [`TemporalInput::previous_camera`].
    pub previous_camera: &'a Camera,
    /// As [`TemporalInput::motion`].
    pub motion: Option<MotionVectors<'a>>,
    /// What [`HitResolver::estimate`](crate::HitResolver::estimate) found of this frame's hits.
    pub estimates: &'a HitResolverView,
    /// Drops the history of all pixels, as a camera's cut needs.
    pub reset: bool,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> TemporalJoinInput<'a> {
    /// Without motion vectors, reset and timestamps.
    pub fn new(
        frame: &'a Frame<'a>,
        previous_camera: &'a Camera,
        estimates: &'a HitResolverView,
    ) -> Self {
        Self {
            frame,
            previous_camera,
            motion: None,
            estimates,
            reset: false,
            timestamps: None,
        }
    }
}

/// What both recordings bring into a history.
struct Joined<'a> {
    frame: &'a Frame<'a>,
    previous_camera: &'a Camera,
    motion: Option<MotionVectors<'a>>,
    picture: &'a TextureView,
    picture_corner: [u32; 2],
    reset: bool,
    timestamps: Option<Timestamps<'a>>,
    /// Whether nothing follows that writes the end time.
    ends: bool,
}

impl TemporalAccumulator {
    /// Compiles the pipelines. `target` is any colour format that can be rendered to (`R8Unorm`, `R16Float`,
    /// `Rgba16Float` …); its missing channels are dropped.
    ///
    /// # Errors
    /// [`Error::Format`] for a target that cannot be rendered to or does not hold floats.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        channels: Channels,
        target: TextureFormat,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        screen::check_format(device, "TemporalAccumulator target", target)?;
        let module =
            |variant| source(channels, variant).map(|source| shader::create(device, LABEL, source));
        let kernel = |variant, entry| -> Result<_, Error> {
            let module = module(variant)?;
            Ok(module.kernel(device, entry, &[], cache))
        };
        let accumulate = |motion| kernel(TemporalVariant::Accumulate { motion }, "accumulate");
        let module = module(TemporalVariant::Show)?;
        let layout = module.layout(device, &["show"]);
        let show = Screen {
            label: LABEL,
            module: &module,
            entry: "show",
            layout: &layout.raw,
            constants: &[],
            target,
            cache,
        }
        .create(device);
        Ok(Self {
            channels,
            target,
            accumulate: [accumulate(false)?, accumulate(true)?],
            claim: kernel(TemporalVariant::Claim, "claim")?,
            show: (layout, show),
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// An empty history for a view of `width` × `height` pixels.
    ///
    /// # Errors
    /// [`Error::Setting`] for a size out of range, [`Error::Limit`] for one beyond the device's.
    pub fn create_history(
        &self,
        device: &Device,
        width: u32,
        height: u32,
    ) -> Result<TemporalHistory, Error> {
        let size = [width, height];
        let format = means_format(self.channels);
        let means = || -> Result<TextureView, Error> {
            let means = plane(device, "deep-screen-space temporal means", format, size, 1)?;
            Ok(means.create_view(&wgpu::TextureViewDescriptor::default()))
        };
        Ok(TemporalHistory {
            channels: self.channels,
            means: [means()?, means()?],
            receivers: Receivers::copied(device, size)?,
            origin: None,
            joined: None,
            claims: None,
            last: 0,
            kept: Default::default(),
        })
    }

    /// Records a frame into the history and the caller's texture.
    ///
    /// # Errors
    /// What [`TemporalSettings::validate`] finds; [`Error::Setting`] for the scale of motion
    /// vectors; [`Error::Format`], [`Error::Shape`], [`Error::Size`] or [`Error::Usage`] for the picture, the motion
    /// vectors or the target; [`Error::Mismatch`] where the history or the previous camera's viewport has another size
    /// than the camera's, the history other channels, or the target another format. The history is left alone then.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &TemporalInput<'_>,
        settings: &TemporalSettings,
        history: &mut TemporalHistory,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        self.check(input, history)?;
        let viewport = input.frame.viewport();
        let picture = input.picture.read();
        let joined = Joined {
            frame: input.frame,
            previous_camera: input.previous_camera,
            motion: input.motion,
            picture: &picture,
            picture_corner: [viewport.x, viewport.y],
            reset: input.reset,
            timestamps: input.timestamps,
            ends: false,
        };
        let (parameters, params) = self.accumulate(device, encoder, &joined, settings, history)?;
        history.joined = None;
        let (layout, pipeline) = &self.show;
        let means = &history.means[history.last];
        let resources = [("params", parameters.at(params)), ("means", view(means))];
        let group = history.kept[history.last]
            .groups(device)
            .next(layout, &resources);
        screen::draw(
            encoder,
            LABEL,
            (pipeline, &group),
            &input.target,
            viewport,
            input.timestamps,
            false,
        );
        Ok(())
    }

    /// Records what each pixel's own rays brought into the history, before any filter, for
    /// [`HitResolverInput::history`](crate::HitResolverInput::history): no window blurs it twice, and the window narrows as
    /// frames come. For light; occlusion is better filtered first. [`TemporalSettings::clamping`] then sees what single rays
    /// bring, and is best left at 0.
    ///
    /// # Errors
    /// As [`TemporalAccumulator::record`]; [`Error::Recording`] where the estimates were not recorded from this frame.
    pub fn join(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &TemporalJoinInput<'_>,
        settings: &TemporalSettings,
        history: &mut TemporalHistory,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let place = input.estimates.estimated.get("HitResolverView")?;
        input.frame.check_place("HitResolverView", &place)?;
        self.check_history(input.frame, input.previous_camera, input.motion, history)?;
        let joined = Joined {
            frame: input.frame,
            previous_camera: input.previous_camera,
            motion: input.motion,
            picture: &input.estimates.means,
            picture_corner: [0; 2],
            reset: input.reset,
            timestamps: input.timestamps,
            ends: true,
        };
        self.accumulate(device, encoder, &joined, settings, history)?;
        history.joined = Some(place);
        Ok(())
    }

    /// This frame into the history, which then is the last one.
    fn accumulate(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        joined: &Joined<'_>,
        settings: &TemporalSettings,
        history: &mut TemporalHistory,
    ) -> Result<(Uploaded, Place), Error> {
        let frame = joined.frame;
        let viewport = frame.viewport();
        let params = TemporalParams {
            picture_corner: joined.picture_corner,
            ..TemporalParams::new(
                settings,
                frame,
                (joined.previous_camera, history.origin.unwrap_or_default()),
                joined.motion.map_or([1.0, 1.0], |motion| motion.scale),
                joined.reset || history.origin.is_none(),
            )
        };
        let motion = match joined.motion {
            Some(motion) => Some((motion.texture.read(), history.claims(device)?)),
            None => None,
        };
        let last = &history.means[history.last];
        let next = &history.means[1 - history.last];
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let claiming = motion.as_ref().map(|(vectors, claims)| {
            encoder.clear_buffer(claims, 0, None);
            let resources = [
                ("params", parameters.at(params)),
                ("receivers", view(&frame.receivers.view)),
                ("motion_vectors", view(vectors)),
                ("claims", whole(claims)),
            ];
            self.claim.0.group(device, &resources)
        });
        let (layout, pipeline) = &self.accumulate[usize::from(motion.is_some())];
        let mut resources = vec![
            ("params", parameters.at(params)),
            ("receivers", view(&frame.receivers.view)),
            ("previous_receivers", view(&history.receivers.view)),
            ("previous_means", view(last)),
            ("picture", view(joined.picture)),
            ("means", view(next)),
        ];
        if let Some((vectors, claims)) = &motion {
            resources.extend([("motion_vectors", view(vectors)), ("claims", whole(claims))]);
        }
        let accumulating = layout.group(device, &resources);
        let begin = if joined.ends {
            compute_pass
        } else {
            first_pass
        };
        let mut pass = begin(encoder, LABEL, joined.timestamps);
        let claiming = claiming.as_ref().map(|group| (&self.claim.1, group));
        for (pipeline, group) in claiming.into_iter().chain([(pipeline, &accumulating)]) {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group.raw, &group.offsets);
            pass.dispatch_workgroups(viewport.width.div_ceil(8), viewport.height.div_ceil(8), 1);
        }
        drop(pass);
        frame.receivers.copy_to(encoder, &history.receivers);
        history.last = 1 - history.last;
        history.origin = Some(frame.origin - frame.camera.focus());
        Ok((parameters, params))
    }

    fn check(&self, input: &TemporalInput<'_>, history: &TemporalHistory) -> Result<(), Error> {
        const TARGET: &str = "TemporalInput::target";
        let viewport = input.frame.viewport();
        let (components, accepted) = match self.channels {
            Channels::One => (1, "a float, snorm or unorm format"),
            Channels::Three => (
                3,
                "a float, snorm or unorm format with three components or more",
            ),
        };
        check_floats(
            "TemporalInput::picture",
            &input.picture,
            viewport,
            components,
            accepted,
        )?;
        screen::check_target(TARGET, &input.target, viewport, self.target)?;
        let motion = input.motion.as_ref();
        let motion = motion.map(|motion| ("MotionVectors::texture", motion.texture, 1));
        let reads = input.frame.gbuffer.reads().chain(motion);
        check_apart(TARGET, &input.target, reads)?;
        self.check_history(input.frame, input.previous_camera, input.motion, history)
    }

    /// That a history goes on with a frame.
    fn check_history(
        &self,
        frame: &Frame<'_>,
        previous_camera: &Camera,
        motion: Option<MotionVectors<'_>>,
        history: &TemporalHistory,
    ) -> Result<(), Error> {
        let viewport = frame.viewport();
        let size = [viewport.width, viewport.height];
        if let Some(motion) = motion {
            check_floats(
                "MotionVectors::texture",
                &motion.texture,
                viewport,
                2,
                "a float, snorm or unorm format with two components or more",
            )?;
            for scale in motion.scale {
                check_setting(
                    scale.is_finite() && scale != 0.0,
                    "MotionVectors::scale",
                    scale,
                    "finite, not 0",
                )?;
            }
        }
        let previous = previous_camera.viewport();
        if [previous.width, previous.height] != size {
            return Err(Error::Mismatch {
                name: "TemporalInput::previous_camera",
                found: format!("{:?} pixels", [previous.width, previous.height]),
                needed: format!("{size:?} pixels"),
            });
        }
        if history.size() != size || history.channels != self.channels {
            return Err(Error::Mismatch {
                name: "TemporalHistory",
                found: format!(
                    "{:?} pixels, channels: {:?}",
                    history.size(),
                    history.channels
                ),
                needed: format!("{size:?} pixels, channels: {:?}", self.channels),
            });
        }
        Ok(())
    }
}

fn check_floats(
    name: &'static str,
    slice: &TextureSlice<'_>,
    viewport: Viewport,
    components: u8,
    accepted: &'static str,
) -> Result<(), Error> {
    check_slice(name, slice, viewport, TextureUsages::TEXTURE_BINDING)?;
    let format = slice.view_format();
    if !samples_as_float(format) || format.components() < components {
        return Err(Error::Format {
            name,
            format,
            accepted,
        });
    }
    Ok(())
}

/// A mean and a count: 32 bits, since a mean over thousands of frames no longer moves in 16.
fn means_format(channels: Channels) -> TextureFormat {
    match channels {
        Channels::One => TextureFormat::Rg32Float,
        Channels::Three => TextureFormat::Rgba32Float,
    }
}

/// The modules that an accumulator is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum TemporalVariant {
    Accumulate { motion: bool },
    Claim,
    Show,
}

/// Assembles one of them.
fn source(channels: Channels, variant: TemporalVariant) -> Result<String, Error> {
    let mut flags = Vec::new();
    if channels == Channels::Three {
        flags.push("COLOR");
    }
    match variant {
        TemporalVariant::Accumulate { motion } => {
            flags.push("ACCUMULATE");
            flags.extend(motion.then_some("MOTION"));
        }
        TemporalVariant::Claim => flags.extend(["CLAIM", "MOTION"]),
        TemporalVariant::Show => flags.push("SHOW"),
    }
    shader::assemble("temporal_accumulator", SOURCE, &flags, &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    for (name, variant) in [
        (
            "temporal_accumulator",
            TemporalVariant::Accumulate { motion: false },
        ),
        (
            "temporal_accumulator motion",
            TemporalVariant::Accumulate { motion: true },
        ),
        ("temporal_accumulator claim", TemporalVariant::Claim),
        ("temporal_accumulator show", TemporalVariant::Show),
    ] {
        for channels in [Channels::One, Channels::Three] {
            let name = name_of(name, &[(channels == Channels::Three, "color")]);
            all.add(&name, source(channels, variant)?);
        }
    }
    Ok(())
}

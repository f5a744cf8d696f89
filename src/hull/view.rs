//! One view's picture by the hull: its textures, and its recording into the caller's target.

use glam::DVec3;
use wgpu::{Buffer, CommandEncoder, Device};

use super::lights::HullLights;
use crate::{
    camera::{Camera, Viewport},
    error::Error,
    gbuffer::GBuffer,
    gpu::compiler::Compiler,
    receivers::{FrameInput, GBufferDecoder, Receivers},
    room::room_for,
    sg_hull::{
        SgHull, SgHullDescriptor, SgHullInput,
        bound::GathererBinding,
        settings::{SgHullSettings, SgHullSize},
        view::SgHullView,
    },
    texture_slice::TextureSlice,
};

/// What one recording of a [`HullView`] works on.
#[derive(Clone, Copy, Debug)]
pub struct HullInput<'a> {
    /// The caller's G-buffer, with albedo or roughness where the view was made for them.
    pub gbuffer: GBuffer<'a>,
    /// The camera that it was drawn with.
    pub camera: &'a Camera,
    /// What the view's gatherer bound, if it binds anything.
    pub gather: Option<&'a GathererBinding>,
    /// The point of the world that positions of what it bound are relative to.
    pub origin: DVec3,
    /// The caller's texture, of the view's format, usage `RENDER_ATTACHMENT`, covering the camera's viewport. Only the viewport
    /// is written.
    pub target: TextureSlice<'a>,
}

impl<'a> HullInput<'a> {
    /// Of a light's map, as it was recorded last.
    pub fn new(
        gbuffer: GBuffer<'a>,
        camera: &'a Camera,
        lights: &'a HullLights,
        target: impl Into<TextureSlice<'a>>,
    ) -> Self {
        let bound = lights.bound();
        Self {
            gbuffer,
            camera,
            gather: bound.map(|bound| bound.0),
            origin: bound.map_or_else(|| camera.focus(), |bound| bound.1),
            target: target.into(),
        }
    }
}

/// What a G-buffer's surfaces reflect of many lights, gathered on a sparse hull of what is seen, for one camera: the
/// [`GBufferDecoder`] and the [`SgHull`], with the textures and buffers that they need.
///
/// ```no_run
/// use deep_screen_space::*;
///
/// /// One bounce of a light into `target`, an `Rgba16Float` texture; the light's camera sees `lit`, 16 x 16 texels.
/// fn bounce(
///     device: &wgpu::Device,
///     encoder: &mut wgpu::CommandEncoder,
///     (lit, light_camera, light): (GBuffer<'_>, &Camera, Light),
///     (gbuffer, camera): (GBuffer<'_>, &Camera),
///     target: &wgpu::Texture,
/// ) -> Result<(), Error> {
///     // Once, and once per view.
///     let mut lights = HullLights::new(device)?;
///     let descriptor = SgHullDescriptor {
///         gatherer: lights.gatherer(),
///         target: wgpu::TextureFormat::Rgba16Float,
///         albedo: true,
///         glossy: false,
///         components: Components::default(),
///     };
///     let mut view = HullView::new(device, &descriptor, SgHullSettings::default())?;
///
///     // Every frame: the lights, for all views, and each view's picture.
///     let input = HullLightsInput { gbuffer: lit, camera: light_camera, light, origin: camera.focus() };
///     lights.record(device, encoder, &input)?;
///     view.record(device, encoder, &HullInput::new(gbuffer, camera, &lights, target))
/// }
/// ```
///
/// Textures and buffers are made by the first recording, and made anew where the camera's viewport has another size.
#[derive(Debug)]
pub struct HullView {
    decoder: GBufferDecoder,
    hull: SgHull,
    settings: SgHullSettings,
    room: Option<Room>,
}

/// What a size asks for.
#[derive(Debug)]
struct Room {
    size: [u32; 2],
    receivers: Receivers,
    view: SgHullView,
}

impl HullView {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// What [`SgHull::new`] and [`SgHullSettings::validate`] find.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        descriptor: &SgHullDescriptor<'_>,
        settings: SgHullSettings,
    ) -> Result<Self, Error> {
        let compiler = compiler.into();
        settings.validate()?;
        Ok(Self {
            decoder: GBufferDecoder::new(compiler)?,
            hull: SgHull::new(compiler, descriptor)?,
            settings,
            room: None,
        })
    }

    /// Changes the settings, from the next recording on.
    ///
    /// # Errors
    /// What [`SgHullSettings::validate`] finds; those of before stay.
    pub fn set_settings(&mut self, settings: SgHullSettings) -> Result<(), Error> {
        settings.validate()?;
        self.settings = settings;
        Ok(())
    }

    /// Records the picture.
    ///
    /// # Errors
    /// What [`GBufferDecoder::record`] and [`SgHull::record`] find, among which is [`Error::Mismatch`] for lights that were not
    /// recorded.
    pub fn record(
        &mut self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &HullInput<'_>,
    ) -> Result<(), Error> {
        let Viewport { width, height, .. } = input.camera.viewport();
        let size = [width, height];
        let room = room_for(
            &mut self.room,
            |room| room.size == size,
            || {
                let hull_size = SgHullSize::new(width, height);
                Ok(Room {
                    size,
                    receivers: self.decoder.create_receivers(device, width, height)?,
                    view: self.hull.create_view(device, hull_size)?,
                })
            },
        )?;
        let frame = FrameInput {
            origin: input.origin,
            ..FrameInput::new(input.gbuffer, input.camera)
        };
        let frame = self
            .decoder
            .record(device, encoder, &frame, &mut room.receivers)?;
        let picture = SgHullInput::new(&frame, input.gather, input.target);
        self.hull
            .record(device, encoder, &picture, &self.settings, &room.view)
    }

    /// [`SgHullCounts`](crate::SgHullCounts) of the last recording, as [`SgHullView::counts`] has them; `None` before the first.
    pub fn counts(&self) -> Option<&Buffer> {
        self.room.as_ref().map(|room| room.view.counts())
    }

    /// GPU memory that it owns, bytes: nothing before the first recording.
    pub fn memory_bytes(&self) -> u64 {
        self.room.as_ref().map_or(0, |room| {
            room.receivers.memory_bytes() + room.view.memory_bytes()
        })
    }
}

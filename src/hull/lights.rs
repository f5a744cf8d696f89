//! What one light lights, as lights for any number of views.

use glam::DVec3;
use wgpu::{CommandEncoder, Device};

use crate::{
    camera::{Camera, Viewport},
    error::Error,
    gbuffer::GBuffer,
    gpu::compiler::Compiler,
    light::Light,
    receivers::{FrameInput, GBufferDecoder, Receivers},
    reflective_shadow_map::{
        ReflectiveShadowMap, ReflectiveShadowMapInput, ReflectiveShadowMapView,
    },
    room::room_for,
    sg_hull::{bound::GathererBinding, gatherer::Gatherer},
};

/// The first bounce of one light, as the lights of any number of [`HullView`](crate::HullView)s: the [`GBufferDecoder`], the
/// [`ReflectiveShadowMap`] and [`Gatherer::polygons`], with the textures and buffers that they need.
///
/// They are made by the first recording, and made anew where the map has another size.
#[derive(Debug)]
pub struct HullLights {
    decoder: GBufferDecoder,
    map: ReflectiveShadowMap,
    gatherer: Gatherer,
    room: Option<Room>,
}

/// What a size asks for.
#[derive(Debug)]
struct Room {
    size: [u32; 2],
    receivers: Receivers,
    map: ReflectiveShadowMapView,
    binding: GathererBinding,
    origin: DVec3,
}

/// What one recording of [`HullLights`] works on.
#[derive(Clone, Copy, Debug)]
pub struct HullLightsInput<'a> {
    /// What the light's camera sees, with albedo: 1 to 1024 texels per side, of which each becomes a light. 16 are usual.
    pub gbuffer: GBuffer<'a>,
    /// The light's camera: where the light is for point and spot lights, along its direction for directional ones.
    pub camera: &'a Camera,
    /// The light.
    pub light: Light,
    /// A point of the world near what the views see, such as a view's [`Camera::focus`].
    pub origin: DVec3,
}

impl HullLights {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// None that a device of `Limits::default()` gives.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        let compiler = compiler.into();
        Ok(Self {
            decoder: GBufferDecoder::new(compiler)?,
            map: ReflectiveShadowMap::new(compiler)?,
            gatherer: Gatherer::polygons(compiler.device),
            room: None,
        })
    }

    /// What a view of these lights is made for.
    pub fn gatherer(&self) -> &Gatherer {
        &self.gatherer
    }

    /// What the last recording bound, and the point of the world that its positions are relative to; `None` before the first.
    pub fn bound(&self) -> Option<(&GathererBinding, DVec3)> {
        self.room.as_ref().map(|room| (&room.binding, room.origin))
    }

    /// Records the lights: once per frame where something moves that is lit, before the views.
    ///
    /// # Errors
    /// What [`GBufferDecoder::record`] and [`ReflectiveShadowMap::record`] find.
    pub fn record(
        &mut self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &HullLightsInput<'_>,
    ) -> Result<(), Error> {
        let Viewport { width, height, .. } = input.camera.viewport();
        let size = [width, height];
        let room = room_for(
            &mut self.room,
            |room| room.size == size,
            || {
                let map = self.map.create_view(device, width, height)?;
                Ok(Room {
                    size,
                    receivers: self.decoder.create_receivers(device, width, height)?,
                    binding: self.gatherer.bind_map(device, &map)?,
                    map,
                    origin: input.origin,
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
        let lights = ReflectiveShadowMapInput::new(&frame, input.light);
        self.map.record(device, encoder, &lights, &room.map)?;
        room.origin = input.origin;
        Ok(())
    }

    /// GPU memory that it owns, bytes: nothing before the first recording.
    pub fn memory_bytes(&self) -> u64 {
        self.room.as_ref().map_or(0, |room| {
            room.receivers.memory_bytes() + room.map.lights().size()
        })
    }
}

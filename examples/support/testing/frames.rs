//! G-buffers decoded for tests.

use deep_screen_space::{
    Camera, Error, Frame, FrameInput, GBuffer, GBufferDecoder, Receivers,
    glam::DVec3,
    wgpu::{CommandEncoder, Device},
};

use super::pipelines;

/// Room for the receivers of one camera's frames.
pub struct Decoded<'d> {
    device: &'d Device,
    decoder: &'d GBufferDecoder,
    pub receivers: Receivers,
}

impl Decoded<'static> {
    /// On the device that all tests share.
    pub fn of(camera: &Camera) -> Self {
        Self::on(&pipelines::gpu().device, pipelines::decoder(), camera)
    }
}

impl<'d> Decoded<'d> {
    pub fn on(device: &'d Device, decoder: &'d GBufferDecoder, camera: &Camera) -> Self {
        let viewport = camera.viewport();
        let receivers = decoder.create_receivers(device, viewport.width, viewport.height);
        Self {
            device,
            decoder,
            receivers: receivers.expect("room"),
        }
    }

    /// Positions are relative to `origin`.
    pub fn frame<'a>(
        &'a mut self,
        encoder: &mut CommandEncoder,
        gbuffer: GBuffer<'a>,
        camera: &'a Camera,
        origin: DVec3,
    ) -> Frame<'a> {
        self.record(encoder, gbuffer, camera, origin)
            .expect("a frame")
    }

    /// The same for what may be refused.
    pub fn record<'a>(
        &'a mut self,
        encoder: &mut CommandEncoder,
        gbuffer: GBuffer<'a>,
        camera: &'a Camera,
        origin: DVec3,
    ) -> Result<Frame<'a>, Error> {
        let input = FrameInput {
            origin,
            ..FrameInput::new(gbuffer, camera)
        };
        self.decoder
            .record(self.device, encoder, &input, &mut self.receivers)
    }
}

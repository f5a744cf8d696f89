//! A view's G-buffer decoded, in a submission of its own.

use deep_screen_space::{
    Camera, Error, Frame, FrameInput, GBuffer, GBufferDecoder, Receivers, glam::DVec3,
};

use super::gpu::Gpu;

/// The pass, and room for one view's frames.
pub struct Decoding {
    decoder: GBufferDecoder,
    receivers: Receivers,
}

impl Decoding {
    pub fn new(gpu: &Gpu, [width, height]: [u32; 2]) -> Result<Self, Error> {
        let decoder = GBufferDecoder::new(&gpu.device)?;
        Ok(Self {
            receivers: decoder.create_receivers(&gpu.device, width, height)?,
            decoder,
        })
    }

    /// What passes start from, and the milliseconds that it took. Positions are relative to `origin`.
    pub fn frame<'a>(
        &'a mut self,
        gpu: &Gpu,
        gbuffer: GBuffer<'a>,
        camera: &'a Camera,
        origin: DVec3,
    ) -> Result<(f64, Frame<'a>), Error> {
        let input = FrameInput {
            origin,
            ..FrameInput::new(gbuffer, camera)
        };
        let (decoder, receivers) = (&self.decoder, &mut self.receivers);
        let (ms, frame) =
            gpu.time(|encoder| decoder.record(&gpu.device, encoder, &input, receivers));
        Ok((ms, frame?))
    }

    pub fn receivers(&self) -> &Receivers {
        &self.receivers
    }

    pub fn memory_bytes(&self) -> u64 {
        self.receivers.memory_bytes()
    }
}

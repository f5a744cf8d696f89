//! A view's G-buffer decoded, in a submission of its own.

use deep_screen_space::{
    Camera, Error, Frame, FrameInput, GBuffer, GBufferDecoder, Receivers, glam::DVec3,
};

use super::{
    gpu::Gpu,
    stages::{Stages, Timed},
};

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
        let mut stages = Timed::new(gpu);
        let frame = self.staged(gpu, &mut stages, gbuffer, camera, origin)?;
        Ok((stages.passes.iter().map(|pass| pass.1).sum(), frame))
    }

    /// The same as the stage "decode".
    pub fn staged<'a>(
        &'a mut self,
        gpu: &Gpu,
        stages: &mut impl Stages,
        gbuffer: GBuffer<'a>,
        camera: &'a Camera,
        origin: DVec3,
    ) -> Result<Frame<'a>, Error> {
        let input = FrameInput {
            origin,
            ..FrameInput::new(gbuffer, camera)
        };
        let (decoder, receivers) = (&self.decoder, &mut self.receivers);
        stages.stage("decode", |encoder| {
            decoder.record(&gpu.device, encoder, &input, receivers)
        })
    }

    pub fn receivers(&self) -> &Receivers {
        &self.receivers
    }

    pub fn memory_bytes(&self) -> u64 {
        self.receivers.memory_bytes()
    }
}

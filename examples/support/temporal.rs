//! Frames joined by the temporal accumulator.

use deep_screen_space::{
    Camera, Channels, Error, TemporalAccumulator, TemporalHistory, TemporalInput, TemporalSettings,
    wgpu,
};

use super::{decoding::Decoding, gpu::Gpu, raster::Raster};

/// The mean over frames of a picture of colours, for a camera that may move through a world that stands still.
pub struct Accumulation {
    accumulator: TemporalAccumulator,
    decoding: Decoding,
    settings: TemporalSettings,
    history: TemporalHistory,
    previous: Option<Camera>,
    target: wgpu::TextureView,
}

impl Accumulation {
    pub fn new(
        gpu: &Gpu,
        [width, height]: [u32; 2],
        settings: TemporalSettings,
    ) -> Result<Self, Error> {
        let format = wgpu::TextureFormat::Rgba32Float;
        let device = &gpu.device;
        let accumulator = TemporalAccumulator::new(device, Channels::Three, format)?;
        Ok(Self {
            history: accumulator.create_history(device, width, height)?,
            target: gpu.target(format, width, height),
            previous: None,
            decoding: Decoding::new(gpu, [width, height])?,
            accumulator,
            settings,
        })
    }

    /// Adds a frame's picture, and gives the mean.
    pub fn add(
        &mut self,
        gpu: &Gpu,
        raster: &Raster,
        camera: &Camera,
        picture: &wgpu::TextureView,
    ) -> Result<Vec<[f32; 4]>, Error> {
        let origin = camera.focus();
        let (_, frame) = self.decoding.frame(gpu, raster.gbuffer(), camera, origin)?;
        let previous = self.previous.as_ref().unwrap_or(camera);
        let target = self.target.texture();
        let input = TemporalInput::new(&frame, previous, picture.texture(), target);
        let mut encoder = gpu.encoder();
        self.accumulator.record(
            &gpu.device,
            &mut encoder,
            &input,
            &self.settings,
            &mut self.history,
        )?;
        gpu.finish(encoder);
        self.previous = Some(*camera);
        Ok(gpu.read_texture(self.target.texture(), 0))
    }
}

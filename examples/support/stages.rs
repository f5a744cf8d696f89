//! Where passes are recorded, one after another, and how each is timed.

use deep_screen_space::wgpu;

use super::gpu::Gpu;

/// Takes recordings in order, and knows what each took.
pub trait Stages {
    /// Has one pass recorded.
    fn stage<R>(
        &mut self,
        name: &'static str,
        record: impl FnOnce(&mut wgpu::CommandEncoder) -> R,
    ) -> R;
}

/// A submission for each, waited for, so that each can be timed on any driver.
pub struct Timed<'g> {
    gpu: &'g Gpu,
    /// A name and milliseconds by [`Gpu::stopwatch`].
    pub passes: Vec<(&'static str, f64)>,
}

impl<'g> Timed<'g> {
    pub fn new(gpu: &'g Gpu) -> Self {
        Self {
            gpu,
            passes: Vec::new(),
        }
    }
}

impl Stages for Timed<'_> {
    fn stage<R>(
        &mut self,
        name: &'static str,
        record: impl FnOnce(&mut wgpu::CommandEncoder) -> R,
    ) -> R {
        let (ms, result) = self.gpu.time(record);
        self.passes.push((name, ms));
        result
    }
}

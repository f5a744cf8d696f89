//! Where pipelines are compiled.

use wgpu::{Device, PipelineCache};

/// Where a pass compiles its pipelines: a device, and the caller's pipeline cache if it has one. Passes take `&device` alone, or
/// `(&device, &cache)`.
#[derive(Clone, Copy, Debug)]
pub struct Compiler<'a> {
    /// The device.
    pub device: &'a Device,
    /// The caller's cache.
    pub cache: Option<&'a PipelineCache>,
}

impl<'a> From<&'a Device> for Compiler<'a> {
    fn from(device: &'a Device) -> Self {
        Self {
            device,
            cache: None,
        }
    }
}

impl<'a> From<(&'a Device, &'a PipelineCache)> for Compiler<'a> {
    fn from((device, cache): (&'a Device, &'a PipelineCache)) -> Self {
        Self {
            device,
            cache: Some(cache),
        }
    }
}

impl<'a> From<(&'a Device, Option<&'a PipelineCache>)> for Compiler<'a> {
    fn from((device, cache): (&'a Device, Option<&'a PipelineCache>)) -> Self {
        Self { device, cache }
    }
}

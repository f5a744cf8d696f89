//! What stages bind in group 0: a list of numbers that both the layout and the bind groups are made from.

use wgpu::{BindGroup, BindGroupLayout, BindingType, ShaderStages};

use super::{LABEL, modules::HullVariant, recording::Recording};
use crate::gpu::binding::{self, FLOAT_2D};

/// What there is to bind: parameters, the receivers, the G-buffer's textures, and the buffers of a view by their names.
#[derive(Clone, Copy, Debug)]
pub(super) enum Resource {
    Params,
    Receivers,
    Albedo,
    Roughness,
    SegmentOf,
    Others,
    Segments,
    Vertices,
    List,
    Splits,
    Parts,
    Rejected,
    PerPixel,
    Counts,
    Dispatch,
}

/// The number that a stage's WGSL has it at, and what it is declared as.
pub(super) type Binding = (u32, Resource, BindingType);

/// What a stage binds.
#[derive(Debug)]
pub(super) struct Bindings {
    pub layout: BindGroupLayout,
    resources: Vec<(u32, Resource)>,
}

impl Bindings {
    pub fn new(device: &wgpu::Device, visibility: ShaderStages, list: &[Binding]) -> Self {
        let entries: Vec<_> = list.iter().map(|&(at, _, ty)| (at, ty)).collect();
        Self {
            layout: binding::layout(device, LABEL, visibility, &entries),
            resources: list.iter().map(|&(at, what, _)| (at, what)).collect(),
        }
    }

    /// The bind group of a recording.
    pub fn group(&self, recording: &Recording<'_>) -> BindGroup {
        let resources: Vec<_> = self
            .resources
            .iter()
            .filter_map(|&(at, what)| Some((at, recording.resource(what)?)))
            .collect();
        binding::group(recording.device, LABEL, &self.layout, &resources)
    }
}

/// What a surface reflects depends on: the same numbers in each module that shades.
pub(super) fn surface(variant: HullVariant) -> impl Iterator<Item = Binding> {
    let albedo = (6, Resource::Albedo, FLOAT_2D);
    let roughness = (7, Resource::Roughness, FLOAT_2D);
    [
        variant.albedo.then_some(albedo),
        variant.glossy.then_some(roughness),
    ]
    .into_iter()
    .flatten()
}

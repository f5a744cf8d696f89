//! How modules, layouts and pipelines are made from a descriptor.

use wgpu::{
    BindGroupLayout, ComputePipeline, Device, PrimitiveTopology, RenderPipeline, ShaderModule,
    ShaderStages,
};

use super::{
    LABEL, SgHullDescriptor,
    bindings::{Binding, Bindings},
    modules::{HullStage, HullVariant, source},
};
use crate::{
    error::Error,
    gpu::{Kernel, screen, shader},
};

/// What makes them, on one device.
pub(super) struct Maker<'a> {
    pub device: &'a Device,
    pub descriptor: &'a SgHullDescriptor<'a>,
    pub variant: HullVariant,
    /// The gatherer's.
    constants: Vec<(&'a str, f64)>,
}

impl<'a> Maker<'a> {
    pub fn new(device: &'a Device, descriptor: &'a SgHullDescriptor<'a>) -> Self {
        let constants = &descriptor.gatherer.constants;
        Self {
            device,
            descriptor,
            variant: HullVariant {
                albedo: descriptor.albedo,
                glossy: descriptor.glossy,
            },
            constants: constants.iter().map(|(k, v)| (k.as_str(), *v)).collect(),
        }
    }

    pub fn module(&self, stage: HullStage) -> Result<ShaderModule, Error> {
        let source = source(&self.descriptor.gatherer.source, stage, self.variant)?;
        Ok(shader::create(self.device, LABEL, source))
    }

    pub fn bindings(&self, visibility: ShaderStages, list: &[Binding]) -> Bindings {
        Bindings::new(self.device, visibility, list)
    }

    pub fn kernel(
        &self,
        module: &ShaderModule,
        entry: &str,
        bindings: &Bindings,
        constants: &[(&str, f64)],
    ) -> ComputePipeline {
        self.compute(module, entry, &[&bindings.layout], constants)
    }

    /// One that gathers.
    pub fn gathering_kernel(
        &self,
        module: &ShaderModule,
        entry: &str,
        bindings: &Bindings,
    ) -> ComputePipeline {
        let layouts = self.with_gatherer(bindings);
        self.compute(module, entry, &layouts, &self.constants)
    }

    /// A pipeline of a vertex and a fragment shader.
    pub fn drawing(
        &self,
        module: &ShaderModule,
        entries: [&str; 2],
        topology: PrimitiveTopology,
        bindings: &Bindings,
    ) -> RenderPipeline {
        self.draw(module, entries, topology, &[&bindings.layout], &[])
    }

    /// One whose fragments gather.
    pub fn gathering_drawing(
        &self,
        module: &ShaderModule,
        entries: [&str; 2],
        topology: PrimitiveTopology,
        bindings: &Bindings,
    ) -> RenderPipeline {
        let layouts = self.with_gatherer(bindings);
        self.draw(module, entries, topology, &layouts, &self.constants)
    }

    /// The layouts of a pipeline that gathers.
    fn with_gatherer<'b>(&'b self, bindings: &'b Bindings) -> Vec<&'b BindGroupLayout> {
        let gatherer = &self.descriptor.gatherer.layout;
        [&bindings.layout].into_iter().chain(gatherer).collect()
    }

    fn compute(
        &self,
        module: &ShaderModule,
        entry: &str,
        layouts: &[&BindGroupLayout],
        constants: &[(&str, f64)],
    ) -> ComputePipeline {
        Kernel {
            label: LABEL,
            module,
            entry,
            layouts,
            constants,
            cache: self.descriptor.cache,
        }
        .create(self.device)
    }

    fn draw(
        &self,
        module: &ShaderModule,
        [vertex, fragment]: [&str; 2],
        topology: PrimitiveTopology,
        layouts: &[&BindGroupLayout],
        constants: &[(&str, f64)],
    ) -> RenderPipeline {
        let brightest = ("brightest", screen::brightest(self.descriptor.target));
        let constants = &[constants, &[brightest]].concat();
        screen::Drawing {
            label: LABEL,
            module,
            vertex,
            fragment,
            layouts,
            constants,
            topology,
            target: self.descriptor.target,
            cache: self.descriptor.cache,
        }
        .create(self.device)
    }
}

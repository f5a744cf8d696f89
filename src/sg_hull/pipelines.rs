//! How modules, layouts and pipelines are made from a descriptor.

use wgpu::{
    BindGroupLayout, ComputePipeline, Device, PipelineCache, PrimitiveTopology, RenderPipeline,
};

use super::{
    LABEL, SgHullDescriptor,
    modules::{HullStage, HullVariant, source},
};
use crate::{
    error::Error,
    gpu::{
        Kernel,
        binding::Layout,
        compiler::Compiler,
        screen,
        shader::{self, Shader},
    },
};

/// What makes them, on one device.
pub(super) struct Maker<'a> {
    pub device: &'a Device,
    cache: Option<&'a PipelineCache>,
    pub descriptor: &'a SgHullDescriptor<'a>,
    pub variant: HullVariant,
    /// The gatherer's.
    constants: Vec<(&'a str, f64)>,
}

impl<'a> Maker<'a> {
    pub fn new(
        Compiler { device, cache }: Compiler<'a>,
        descriptor: &'a SgHullDescriptor<'a>,
    ) -> Self {
        let constants = &descriptor.gatherer.constants;
        Self {
            device,
            cache,
            descriptor,
            variant: HullVariant {
                albedo: descriptor.albedo,
                glossy: descriptor.glossy,
            },
            constants: constants.iter().map(|(k, v)| (k.as_str(), *v)).collect(),
        }
    }

    pub fn module(&self, stage: HullStage) -> Result<Shader, Error> {
        let gatherer = &self.descriptor.gatherer.source;
        let source = source(gatherer, stage, self.variant)?;
        Ok(shader::create_with(self.device, LABEL, source, gatherer))
    }

    pub fn kernel(
        &self,
        module: &Shader,
        entry: &str,
        layout: &Layout,
        constants: &[(&str, f64)],
    ) -> ComputePipeline {
        self.compute(module, entry, &[&layout.raw], constants)
    }

    /// One that gathers.
    pub fn gathering_kernel(
        &self,
        module: &Shader,
        entry: &str,
        layout: &Layout,
    ) -> ComputePipeline {
        let layouts = self.with_gatherer(layout);
        self.compute(module, entry, &layouts, &self.constants)
    }

    /// A pipeline of a vertex and a fragment shader.
    pub fn drawing(
        &self,
        module: &Shader,
        entries: [&str; 2],
        topology: PrimitiveTopology,
        layout: &Layout,
    ) -> RenderPipeline {
        self.draw(module, entries, topology, &[&layout.raw], &[])
    }

    /// One whose fragments gather.
    pub fn gathering_drawing(
        &self,
        module: &Shader,
        entries: [&str; 2],
        topology: PrimitiveTopology,
        layout: &Layout,
    ) -> RenderPipeline {
        let layouts = self.with_gatherer(layout);
        self.draw(module, entries, topology, &layouts, &self.constants)
    }

    /// The layouts of a pipeline that gathers.
    fn with_gatherer<'b>(&'b self, layout: &'b Layout) -> Vec<&'b BindGroupLayout> {
        let gatherer = &self.descriptor.gatherer.layout;
        [&layout.raw].into_iter().chain(gatherer).collect()
    }

    fn compute(
        &self,
        module: &Shader,
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
            cache: self.cache,
        }
        .create(self.device)
    }

    fn draw(
        &self,
        module: &Shader,
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
            cache: self.cache,
        }
        .create(self.device)
    }
}

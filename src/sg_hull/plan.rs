//! Dispatches of as many workgroups as the GPU counted (`wgsl/sg_hull_plan.wgsl`).

use wgpu::{BindGroup, ComputePass, ComputePipeline, ShaderStages};

use super::{
    bindings::{
        Bindings,
        Resource::{Counts, Dispatch, Params},
    },
    modules::HullStage,
    pipelines::Maker,
    recording::Recording,
};
use crate::{
    error::Error,
    gpu::binding::{UNIFORM, WRITE},
};

/// The kernels of `wgsl/sg_hull_plan.wgsl`, by what they plan.
#[derive(Clone, Copy, Debug)]
pub(super) enum Plan {
    Vertices,
    Gather,
    Classify,
    Points,
    Divide,
    List,
    Pixels,
}

impl Plan {
    const ALL: [Self; 7] = [
        Self::Vertices,
        Self::Gather,
        Self::Classify,
        Self::Points,
        Self::Divide,
        Self::List,
        Self::Pixels,
    ];

    fn entry(self) -> &'static str {
        match self {
            Self::Vertices => "plan_vertices",
            Self::Gather => "plan_gather",
            Self::Classify => "plan_classify",
            Self::Points => "plan_points",
            Self::Divide => "plan_divide",
            Self::List => "plan_list",
            Self::Pixels => "plan_pixels",
        }
    }
}

/// All of them.
#[derive(Debug)]
pub(super) struct Plans {
    bindings: Bindings,
    kernels: [ComputePipeline; 7],
}

impl Plans {
    pub fn new(make: &Maker<'_>) -> Result<Self, Error> {
        let module = make.module(HullStage::Plan)?;
        let bindings = make.bindings(
            ShaderStages::COMPUTE,
            &[
                (0, Params, UNIFORM),
                (1, Counts, WRITE),
                (2, Dispatch, WRITE),
            ],
        );
        Ok(Self {
            kernels: Plan::ALL.map(|plan| make.kernel(&module, plan.entry(), &bindings, &[])),
            bindings,
        })
    }

    pub fn of<'a>(&'a self, recording: &'a Recording<'a>) -> Planned<'a> {
        Planned {
            plans: self,
            group: self.bindings.group(recording),
            recording,
        }
    }
}

/// The plans of one recording.
pub(super) struct Planned<'a> {
    plans: &'a Plans,
    group: BindGroup,
    pub recording: &'a Recording<'a>,
}

impl Planned<'_> {
    /// Plans, then runs each of the kernels as planned.
    pub fn run(
        &self,
        pass: &mut ComputePass<'_>,
        plan: Plan,
        kernels: &[(&ComputePipeline, &BindGroup)],
    ) {
        pass.set_pipeline(&self.plans.kernels[plan as usize]);
        pass.set_bind_group(0, &self.group, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        for (kernel, group) in kernels {
            pass.set_pipeline(kernel);
            pass.set_bind_group(0, *group, &[]);
            if let Some(lights) = self.recording.input.gather {
                pass.set_bind_group(1, &lights.group, &[]);
            }
            pass.dispatch_workgroups_indirect(&self.recording.hull.dispatch, 0);
        }
    }
}

//! Functions of `wgsl/common` run alone.

use deep_screen_space::wgpu::{self, BufferUsages};

use crate::gpu::Gpu;

/// Runs `run` of these sources, one thread per case in workgroups of `threads`: binding 0 has the cases, binding 1 takes what was
/// found.
pub fn evaluate<C: bytemuck::Pod, F: bytemuck::Pod>(
    gpu: &Gpu,
    sources: &[&str],
    cases: &[C],
    threads: u32,
) -> Vec<F> {
    let device = &gpu.device;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(sources.join("\n").into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("run"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let input = gpu.buffer(cases, BufferUsages::STORAGE);
    let output = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: (cases.len() * size_of::<F>()) as u64,
        usage: BufferUsages::STORAGE | BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let buffers = [&input, &output];
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[0, 1].map(|i| wgpu::BindGroupEntry {
            binding: i,
            resource: buffers[i as usize].as_entire_binding(),
        }),
    });
    let mut encoder = gpu.encoder();
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups((cases.len() as u32).div_ceil(threads), 1, 1);
    }
    gpu.finish(encoder);
    gpu.read_buffer(&output)
}

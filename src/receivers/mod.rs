//! The caller's G-buffer decoded once for the passes that follow (`wgsl/receivers.wgsl`).

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use wgpu::{
    CommandEncoder, ComputePipeline, Device, PipelineCache, ShaderStages, TextureFormat,
    TextureUsages, TextureView, TextureViewDimension,
};

use crate::{
    camera::{Camera, CameraParams},
    error::{Error, check_limit},
    gbuffer::GBuffer,
    gpu::{
        Kernel,
        binding::{self, FLOAT_2D, UNIFORM, view, whole},
        compute_pass, shader, uniform,
    },
};

pub(crate) const SOURCE: &str = include_str!("../../wgsl/receivers.wgsl");

const LABEL: &str = "deep-screen-space receivers";

/// Half a unit in the last place of an f32.
pub(crate) const DEPTH_RELATIVE: f32 = 6e-8;

/// Position and normal of each pixel of a view, 16 bytes a pixel.
#[derive(Debug)]
pub(crate) struct Receivers {
    pub size: [u32; 2],
    pub view: TextureView,
}

impl Receivers {
    pub fn new(device: &Device, size: [u32; 2]) -> Result<Self, Error> {
        let texture = plane(device, LABEL, TextureFormat::Rgba32Uint, size, 1)?;
        Ok(Self {
            size,
            view: texture.create_view(&wgpu::TextureViewDescriptor::default()),
        })
    }
}

/// A texture that kernels write and read, with `layers` layers.
pub(crate) fn plane(
    device: &Device,
    label: &'static str,
    format: TextureFormat,
    [width, height]: [u32; 2],
    layers: u32,
) -> Result<wgpu::Texture, Error> {
    let limits = device.limits();
    check_limit(
        "max_texture_dimension_2d",
        u64::from(limits.max_texture_dimension_2d),
        u64::from(width.max(height)),
        label,
    )?;
    crate::error::check_setting(
        width > 0 && height > 0,
        "view size",
        width.min(height),
        "at least 1x1 pixels",
    )?;
    Ok(device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: layers,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: TextureUsages::STORAGE_BINDING
            | TextureUsages::TEXTURE_BINDING
            | TextureUsages::COPY_SRC,
        view_formats: &[],
    }))
}

/// Bytes of such a texture.
pub(crate) fn plane_bytes(format: TextureFormat, size: [u32; 2], layers: u32) -> u64 {
    u64::from(format.block_copy_size(None).unwrap_or(0))
        * u64::from(size[0])
        * u64::from(size[1])
        * u64::from(layers)
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct ReceiversParams {
    pub(crate) camera: CameraParams,
    pub(crate) normals: [u32; 2],
    pub(crate) depth_step: f32,
    pub(crate) depth_relative: f32,
}

/// The pipeline.
#[derive(Debug)]
pub(crate) struct ReceiversPass {
    layout: wgpu::BindGroupLayout,
    prepare: ComputePipeline,
}

impl ReceiversPass {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let layout = binding::layout(
            device,
            LABEL,
            ShaderStages::COMPUTE,
            &[
                (0, UNIFORM),
                (1, FLOAT_2D),
                (2, FLOAT_2D),
                (
                    3,
                    binding::store(TextureFormat::Rgba32Uint, TextureViewDimension::D2),
                ),
            ],
        );
        let module = shader::create(
            device,
            LABEL,
            shader::assemble("receivers", SOURCE, &[], &[])?,
        );
        let prepare = Kernel {
            label: LABEL,
            module: &module,
            entry: "prepare",
            layouts: &[&layout],
            constants: &[],
            cache,
        }
        .create(device);
        Ok(Self { layout, prepare })
    }

    /// Records into a pass of its own; `origin` is the eye that positions shall be relative to.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        gbuffer: &GBuffer<'_>,
        camera: &Camera,
        origin: DVec3,
        receivers: &Receivers,
    ) {
        let params = uniform(
            device,
            LABEL,
            &ReceiversParams {
                camera: camera.params(origin),
                normals: gbuffer.normals().params(),
                depth_step: gbuffer.depth_step(),
                depth_relative: DEPTH_RELATIVE,
            },
        );
        let group = binding::group(
            device,
            LABEL,
            &self.layout,
            &[
                (0, whole(&params)),
                (1, view(gbuffer.depth)),
                (2, view(gbuffer.normal)),
                (3, view(&receivers.view)),
            ],
        );
        let mut pass = compute_pass(encoder, LABEL, None);
        pass.set_pipeline(&self.prepare);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(
            receivers.size[0].div_ceil(8),
            receivers.size[1].div_ceil(8),
            1,
        );
    }
}

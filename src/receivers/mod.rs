//! The caller's G-buffer decoded once for the passes that follow (`wgsl/receivers.wgsl`).

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use wgpu::{
    CommandEncoder, ComputePipeline, Device, PipelineCache, TextureFormat, TextureUsages,
    TextureView,
};

use crate::{
    camera::{Camera, CameraParams},
    error::{Error, check_limit, check_setting},
    gbuffer::GBuffer,
    gpu::{
        Kernel,
        binding::{Layout, view},
        compute_pass,
        shader::{self, Shader},
        uniforms::Uniforms,
    },
    shaders::Listing,
    work::PixelList,
};

const SOURCE: &str = include_str!("../../wgsl/receivers.wgsl");

const LABEL: &str = "deep-screen-space receivers";

/// Half a unit in the last place of an f32.
pub(crate) const DEPTH_RELATIVE: f32 = 6e-8;

/// Position and normal of each pixel of a view, 16 bytes per pixel.
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
    size: [u32; 2],
    layers: u32,
) -> Result<wgpu::Texture, Error> {
    plane_for(device, label, format, size, layers, TextureUsages::empty())
}

/// Checks a view's size against the device's, before anything is made of its pixels' number.
pub(crate) fn check_view_size(
    device: &Device,
    label: &'static str,
    [width, height]: [u32; 2],
) -> Result<(), Error> {
    check_limit(
        "max_texture_dimension_2d",
        u64::from(device.limits().max_texture_dimension_2d),
        u64::from(width.max(height)),
        label,
    )?;
    check_setting(
        width > 0 && height > 0,
        "view size",
        width.min(height),
        "at least 1x1 pixels",
    )
}

/// One with usages besides.
pub(crate) fn plane_for(
    device: &Device,
    label: &'static str,
    format: TextureFormat,
    [width, height]: [u32; 2],
    layers: u32,
    besides: TextureUsages,
) -> Result<wgpu::Texture, Error> {
    check_view_size(device, label, [width, height])?;
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
            | TextureUsages::COPY_SRC
            | besides,
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

/// What `wgsl/common/surface.wgsl` asks of its importers' parameters, first in theirs.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct ReceiversParams {
    pub(crate) camera: CameraParams,
    pub(crate) normals: [u32; 2],
    pub(crate) depth_step: f32,
    pub(crate) depth_relative: f32,
}

impl ReceiversParams {
    /// `origin` is the eye that positions shall be relative to.
    pub fn new(gbuffer: &GBuffer<'_>, camera: &Camera, origin: DVec3) -> Self {
        Self {
            camera: camera.params(origin),
            normals: gbuffer.normals().params(),
            depth_step: gbuffer.depth_step(),
            depth_relative: DEPTH_RELATIVE,
        }
    }
}

/// `Params` of `wgsl/receivers.wgsl` for a list.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct ListedReceiversParams {
    pub(crate) gbuffer: ReceiversParams,
    pub(crate) level: u32,
    padding: [u32; 3],
}

/// The pipeline.
#[derive(Debug)]
pub(crate) struct ReceiversPass {
    layout: Layout,
    prepare: ComputePipeline,
    uniforms: Uniforms,
}

impl ReceiversPass {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let module = shader::create(device, LABEL, source(false)?);
        let layout = module.layout(device, &["prepare"]);
        Ok(Self {
            prepare: kernel(device, &module, &layout, "prepare", cache),
            layout,
            uniforms: Uniforms::new(LABEL),
        })
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
        let params = ReceiversParams::new(gbuffer, camera, origin);
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let [depth, normal] = [gbuffer.depth, gbuffer.normal].map(|slice| slice.read());
        let resources = [
            ("params", parameters.at(params)),
            ("depth_texture", view(&depth)),
            ("normal_texture", view(&normal)),
            ("receivers", view(&receivers.view)),
        ];
        let group = self.layout.group(device, &resources);
        let mut pass = compute_pass(encoder, LABEL, None);
        pass.set_pipeline(&self.prepare);
        pass.set_bind_group(0, &group.raw, &group.offsets);
        pass.dispatch_workgroups(
            receivers.size[0].div_ceil(8),
            receivers.size[1].div_ceil(8),
            1,
        );
    }
}

/// The pipelines for listed pixels of a sub-image.
#[derive(Debug)]
pub(crate) struct ListedReceiversPass {
    layout: Layout,
    erase: ComputePipeline,
    prepare: ComputePipeline,
    uniforms: Uniforms,
}

impl ListedReceiversPass {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let module = shader::create(device, LABEL, source(true)?);
        let layout = module.layout(device, &["erase", "prepare"]);
        Ok(Self {
            erase: kernel(device, &module, &layout, "erase", cache),
            prepare: kernel(device, &module, &layout, "prepare", cache),
            layout,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// As [`ReceiversPass::record`]; `receivers` have the size of the list's level.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        (gbuffer, camera): (&GBuffer<'_>, &Camera),
        origin: DVec3,
        work: &PixelList<'_>,
        receivers: &Receivers,
    ) {
        let params = ListedReceiversParams {
            gbuffer: ReceiversParams::new(gbuffer, camera, origin),
            level: work.level,
            padding: [0; 3],
        };
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let [depth, normal] = [gbuffer.depth, gbuffer.normal].map(|slice| slice.read());
        let resources = [
            ("params", parameters.at(params)),
            ("depth_texture", view(&depth)),
            ("normal_texture", view(&normal)),
            ("receivers", view(&receivers.view)),
            ("work", work.list(camera.viewport())),
        ];
        let group = self.layout.group(device, &resources);
        let mut pass = compute_pass(encoder, LABEL, None);
        pass.set_bind_group(0, &group.raw, &group.offsets);
        pass.set_pipeline(&self.erase);
        pass.dispatch_workgroups(
            receivers.size[0].div_ceil(8),
            receivers.size[1].div_ceil(8),
            1,
        );
        pass.set_pipeline(&self.prepare);
        pass.dispatch_workgroups_indirect(work.dispatch, 0);
    }
}

/// The module for all pixels, or for listed ones.
fn source(listed: bool) -> Result<String, Error> {
    let flags: &[&str] = if listed { &["LIST"] } else { &[] };
    shader::assemble("receivers", SOURCE, flags, &[])
}

fn kernel(
    device: &Device,
    module: &Shader,
    layout: &Layout,
    entry: &str,
    cache: Option<&PipelineCache>,
) -> ComputePipeline {
    Kernel {
        label: LABEL,
        module,
        entry,
        layouts: &[&layout.raw],
        constants: &[],
        cache,
    }
    .create(device)
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add("receivers", source(false)?);
    all.add("receivers list", source(true)?);
    Ok(())
}

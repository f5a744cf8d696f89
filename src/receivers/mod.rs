//! The caller's G-buffer decoded once for the passes that follow (`wgsl/receivers.wgsl`).

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use wgpu::{
    CommandEncoder, ComputePipeline, Device, PipelineCache, TextureFormat, TextureUsages,
    TextureView,
};

use crate::{
    camera::{Camera, CameraParams, Viewport, check_origin},
    effect::Listing,
    error::{Error, check_limit, check_setting},
    gbuffer::GBuffer,
    gpu::compiler::Compiler,
    gpu::{
        Kernel, Timestamps,
        binding::{Layout, view},
        check_timestamps, compute_pass,
        shader::{self, Shader},
        texture::Plane,
        uniforms::Uniforms,
    },
    work::PixelList,
};

const SOURCE: &str = include_str!("../../wgsl/receivers.wgsl");

const LABEL: &str = "deep-screen-space receivers";

/// Half a unit in the last place of an f32.
pub(crate) const DEPTH_RELATIVE: f32 = 6e-8;

/// Position and normal of each pixel of a view: what receives light, or is occluded.
#[derive(Debug)]
pub struct Receivers {
    pub(crate) size: [u32; 2],
    pub(crate) view: TextureView,
}

impl Receivers {
    pub(crate) fn new(device: &Device, size: [u32; 2]) -> Result<Self, Error> {
        let texture = plane(device, LABEL, TextureFormat::Rgba32Uint, size, 1)?;
        Ok(Self {
            size,
            view: texture.create_view(&wgpu::TextureViewDescriptor::default()),
        })
    }

    /// Those that another's are copied to.
    pub(crate) fn copied(device: &Device, size: [u32; 2]) -> Result<Self, Error> {
        let usage = TextureUsages::COPY_DST;
        let texture = plane_for(device, LABEL, TextureFormat::Rgba32Uint, size, 1, usage)?;
        Ok(Self {
            size,
            view: texture.create_view(&wgpu::TextureViewDescriptor::default()),
        })
    }

    /// Copies all of them to others of the same size.
    pub(crate) fn copy_to(&self, encoder: &mut CommandEncoder, other: &Self) {
        let [from, to] = [self, other].map(|receivers| receivers.view.texture());
        encoder.copy_texture_to_texture(from.as_image_copy(), to.as_image_copy(), from.size());
    }

    /// Width and height in pixels: that of the camera's viewport.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// `Rgba32Uint`: in xyz the bits of the position relative to the frame's origin, in w the octahedral normal as two snorm16,
    /// or `0x8000_8000` for the sky; row 0 on top (usages `TEXTURE_BINDING | COPY_SRC`).
    pub fn view(&self) -> &TextureView {
        &self.view
    }

    /// GPU memory that it owns, bytes: 16 per pixel.
    pub fn memory_bytes(&self) -> u64 {
        plane_bytes(TextureFormat::Rgba32Uint, self.size, 1)
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

/// What all of them are used for.
const USAGE: TextureUsages = TextureUsages::STORAGE_BINDING
    .union(TextureUsages::TEXTURE_BINDING)
    .union(TextureUsages::COPY_SRC);

/// One with usages besides.
pub(crate) fn plane_for(
    device: &Device,
    label: &'static str,
    format: TextureFormat,
    size: [u32; 2],
    layers: u32,
    besides: TextureUsages,
) -> Result<wgpu::Texture, Error> {
    check_view_size(device, label, size)?;
    Ok(Plane {
        layers,
        ..Plane::new(label, format, size, USAGE | besides)
    }
    .create(device))
}

/// One with so many mip levels.
pub(crate) fn mipped_plane(
    device: &Device,
    label: &'static str,
    format: TextureFormat,
    size: [u32; 2],
    levels: u32,
) -> Result<wgpu::Texture, Error> {
    check_view_size(device, label, size)?;
    Ok(Plane {
        levels,
        ..Plane::new(label, format, size, USAGE)
    }
    .create(device))
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

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: ReceiversParams as "Params" in ["receivers"]
    { camera, normals, depth_step, depth_relative }
);

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

crate::reflection::same_as_wgsl!(
    listed_params_are_the_shaders: ListedReceiversParams as "Params" in ["receivers list"]
    { gbuffer.camera, gbuffer.normals, gbuffer.depth_step, gbuffer.depth_relative, level }
);

/// Decodes a G-buffer for the passes that start from the pixels' surfaces: splatting, rays, the hull, reflective shadow maps
/// and temporal accumulation. One decoding per frame and view serves all of them.
///
/// Holds a pipeline only; one serves any number of views.
#[derive(Debug)]
pub struct GBufferDecoder {
    layout: Layout,
    prepare: ComputePipeline,
    uniforms: Uniforms,
}

/// What one recording of the [`GBufferDecoder`] works on.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// The caller's G-buffer.
    pub gbuffer: GBuffer<'a>,
    /// The camera that it was drawn with.
    pub camera: &'a Camera,
    /// The point of the world that positions shall be relative to: for surfels and rays that of their cloud
    /// ([`SurfelCloud::origin`](crate::SurfelCloud::origin)), for the hull that of what its gatherer bound. Each component within
    /// ±1e18.
    pub origin: DVec3,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> FrameInput<'a> {
    /// With the camera's [focus](Camera::focus) as origin, which is that of a cloud that was recorded for this camera.
    pub fn new(gbuffer: GBuffer<'a>, camera: &'a Camera) -> Self {
        Self {
            gbuffer,
            camera,
            origin: camera.focus(),
            timestamps: None,
        }
    }
}

/// A G-buffer, its camera, and what was decoded of it: what passes start from. Made by [`GBufferDecoder::record`].
///
/// As long as it exists its [`Receivers`] cannot be recorded anew, so that passes never read those of another frame.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    pub(crate) gbuffer: GBuffer<'a>,
    pub(crate) camera: Camera,
    pub(crate) origin: DVec3,
    pub(crate) receivers: &'a Receivers,
}

/// Where a frame's pixels are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    camera: Camera,
    origin: DVec3,
}

impl<'a> Frame<'a> {
    /// The G-buffer that was decoded.
    pub fn gbuffer(&self) -> &GBuffer<'a> {
        &self.gbuffer
    }

    /// The camera that it was drawn with.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The point of the world that positions are relative to.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// What was decoded.
    pub fn receivers(&self) -> &'a Receivers {
        self.receivers
    }

    pub(crate) fn viewport(&self) -> Viewport {
        self.camera.viewport()
    }

    /// [`Error::Mismatch`] for positions that are relative to another point than those of a cloud.
    pub(crate) fn check_origin(&self, origin: DVec3) -> Result<(), Error> {
        if self.origin == origin {
            return Ok(());
        }
        Err(Error::Mismatch {
            name: "FrameInput::origin",
            found: self.origin.to_string(),
            needed: format!("{origin}, the cloud's"),
        })
    }

    /// [`Error::Recording`] for `name`, which was recorded from pixels of another place than this frame's.
    pub(crate) fn check_place(&self, name: &'static str, place: &Place) -> Result<(), Error> {
        if self.place() == *place {
            return Ok(());
        }
        Err(Error::Recording {
            name,
            found: "recorded from a Frame of another camera or origin".into(),
        })
    }

    /// What is made from the frame remembers it by this.
    pub(crate) fn place(&self) -> Place {
        Place {
            camera: self.camera,
            origin: self.origin,
        }
    }
}

impl GBufferDecoder {
    /// Compiles the pipeline. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// None today.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        let module = shader::create(device, LABEL, source(false)?);
        let layout = module.layout(device, &["prepare"]);
        Ok(Self {
            prepare: kernel(device, &module, &layout, "prepare", cache),
            layout,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Room for a view of `width` × `height` pixels.
    ///
    /// # Errors
    /// [`Error::Setting`] for a size out of range, [`Error::Limit`] for one beyond the device's.
    pub fn create_receivers(
        &self,
        device: &Device,
        width: u32,
        height: u32,
    ) -> Result<Receivers, Error> {
        Receivers::new(device, [width, height])
    }

    /// Records the decoding of a frame.
    ///
    /// # Errors
    /// What [`GBuffer::validate`] finds, also of roughness; [`Error::Setting`] for an origin out of range;
    /// [`Error::Mismatch`] where the receivers have another size than the camera's viewport.
    pub fn record<'a>(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &FrameInput<'a>,
        receivers: &'a mut Receivers,
    ) -> Result<Frame<'a>, Error> {
        check_timestamps(input.timestamps)?;
        let FrameInput {
            gbuffer,
            camera,
            origin,
            ..
        } = *input;
        let viewport = camera.viewport();
        gbuffer.validate(viewport)?;
        check_origin("FrameInput::origin", origin)?;
        let size = [viewport.width, viewport.height];
        if receivers.size != size {
            return Err(Error::Mismatch {
                name: "Receivers",
                found: format!("{:?} pixels", receivers.size),
                needed: format!("{size:?} pixels"),
            });
        }
        let params = ReceiversParams::new(&gbuffer, camera, origin);
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let [depth, normal] = [gbuffer.depth, gbuffer.normal].map(|slice| slice.read());
        let resources = [
            ("params", parameters.at(params)),
            ("depth_texture", view(&depth)),
            ("normal_texture", view(&normal)),
            ("receivers", view(&receivers.view)),
        ];
        let group = self.layout.group(device, &resources);
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);
        pass.set_pipeline(&self.prepare);
        pass.set_bind_group(0, &group.raw, &group.offsets);
        pass.dispatch_workgroups(size[0].div_ceil(8), size[1].div_ceil(8), 1);
        Ok(Frame {
            gbuffer,
            camera: *camera,
            origin,
            receivers,
        })
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

    /// As [`GBufferDecoder::record`]; `receivers` have the size of the list's level.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        frame: &Frame<'_>,
        work: &PixelList<'_>,
        receivers: &Receivers,
    ) {
        let gbuffer = &frame.gbuffer;
        let params = ListedReceiversParams {
            gbuffer: ReceiversParams::new(gbuffer, &frame.camera, frame.origin),
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
            ("work", work.list(frame.viewport())),
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

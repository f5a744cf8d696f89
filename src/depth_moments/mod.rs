//! Mean and variance of view depth over squares of pixels (Volumetric Obscurance 4.2; `wgsl/depth_moments.wgsl`).

use bytemuck::{Pod, Zeroable};
use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device, PipelineCache, TextureView,
};

use crate::{
    camera::{Camera, CameraParams},
    effect::Listing,
    error::Error,
    gpu::{
        Timestamps,
        binding::{Kept, Layout, view, whole},
        compute_pass, shader, storage,
        uniforms::{Parameters, Uniforms},
    },
    receivers::check_view_size,
    recorded::Last,
    work::level_size,
};

const SOURCE: &str = include_str!("../../wgsl/depth_moments.wgsl");

const LABEL: &str = "deep-screen-space depth moments";

/// Levels of moments: squares of 2 to 256 pixels a side.
pub(crate) const LEVELS: u32 = 8;

/// Bytes of a texel.
const TEXEL: u64 = 16;

/// Depth moments over squares of pixels, for area samples of [`VolumetricObscurance`](crate::VolumetricObscurance).
#[derive(Debug)]
pub struct DepthMoments {
    /// Of the view that they are for, pixels.
    pub(crate) size: [u32; 2],
    pub(crate) buffer: Buffer,
    /// The camera of the depth.
    pub(crate) recorded: Last<Camera>,
    /// Of the levels after the first.
    kept: Kept,
}

impl DepthMoments {
    pub(crate) fn new(device: &Device, size: [u32; 2]) -> Result<Self, Error> {
        check_view_size(device, LABEL, size)?;
        let texels = (1..=LEVELS)
            .map(|level| level_size(size, level).map(u64::from))
            .map(|[width, height]| width * height)
            .sum::<u64>();
        let usage = BufferUsages::COPY_SRC;
        Ok(Self {
            size,
            buffer: storage(device, LABEL, TEXEL * texels, usage)?,
            recorded: Last::default(),
            kept: Kept::default(),
        })
    }

    /// Level after level from squares of 2 × 2 pixels on, each ⌈width / 2^l⌉ × ⌈height / 2^l⌉ texels, rows from the top. A
    /// texel is four `f32`s: mean and variance of the view depth of what has a surface, the square's share that has one, and
    /// its share that lies in the viewport.
    pub fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// GPU memory that it owns, bytes: about 5 per pixel.
    pub fn memory_bytes(&self) -> u64 {
        self.buffer.size()
    }
}

/// `MomentLevel` of `wgsl/common/moments.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct MomentLevel {
    pub(crate) offset: u32,
    pub(crate) padding: u32,
    pub(crate) size: [u32; 2],
}

crate::reflection::same_as_wgsl!(
    levels_are_the_shaders: MomentLevel as "MomentLevel" in [
        "depth_moments", "volumetric_obscurance areas",
    ]
    { offset, size }
);

/// Where the levels of a view lie in its buffer.
pub(crate) fn levels(size: [u32; 2]) -> [MomentLevel; LEVELS as usize] {
    let mut offset = 0;
    std::array::from_fn(|i| {
        let size = level_size(size, i as u32 + 1);
        let level = MomentLevel {
            offset,
            padding: 0,
            size,
        };
        offset += size[0] * size[1];
        level
    })
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct DepthMomentsParams {
    pub(crate) camera: CameraParams,
    pub(crate) forward: [f32; 3],
    pub(crate) padding: u32,
    pub(crate) fine: MomentLevel,
    pub(crate) coarse: MomentLevel,
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: DepthMomentsParams as "Params" in ["depth_moments depth"]
    { camera, forward, fine, coarse }
);

/// The pipelines: of the first level, and of the others.
#[derive(Debug)]
pub(crate) struct DepthMomentsPass {
    first: (Layout, ComputePipeline),
    further: (Layout, ComputePipeline),
    uniforms: Uniforms,
}

impl DepthMomentsPass {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let create = |depth: bool| -> Result<_, Error> {
            let module = shader::create(device, LABEL, source(depth)?);
            Ok(module.kernel(device, "halve", &[], cache))
        };
        Ok(Self {
            first: create(true)?,
            further: create(false)?,
            uniforms: Uniforms::new(LABEL),
        })
    }

    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        depth: &TextureView,
        camera: &Camera,
        moments: &DepthMoments,
        timestamps: Option<Timestamps<'_>>,
    ) {
        let pixels = MomentLevel {
            size: moments.size,
            ..MomentLevel::default()
        };
        let mut fine = pixels;
        let mut parameters = Parameters::new(device);
        let levels = levels(moments.size).map(|coarse| {
            let params = DepthMomentsParams {
                camera: camera.params(camera.focus()),
                forward: camera.forward().as_vec3().to_array(),
                padding: 0,
                fine,
                coarse,
            };
            fine = coarse;
            (parameters.add(&params), coarse.size)
        });
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let mut groups = moments.kept.groups(device);
        let mut pass = compute_pass(encoder, LABEL, timestamps);
        for (i, (params, size)) in levels.into_iter().enumerate() {
            let (layout, pipeline) = if i == 0 { &self.first } else { &self.further };
            let mut resources = vec![
                ("params", parameters.at(params)),
                ("moments", whole(&moments.buffer)),
            ];
            let group = if i == 0 {
                resources.push(("depth_texture", view(depth)));
                layout.group(device, &resources)
            } else {
                groups.next(layout, &resources)
            };
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group.raw, &group.offsets);
            let [width, height] = size.map(|n| n.div_ceil(8));
            pass.dispatch_workgroups(width, height, 1);
        }
    }
}

/// The module, of the first level or of the others.
fn source(depth: bool) -> Result<String, Error> {
    let flags: &[&str] = if depth { &["DEPTH"] } else { &[] };
    shader::assemble("depth_moments", SOURCE, flags, &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add("depth_moments depth", source(true)?);
    all.add("depth_moments", source(false)?);
    Ok(())
}

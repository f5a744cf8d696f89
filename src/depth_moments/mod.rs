//! Mean and variance of view depth over squares of pixels (Volumetric Obscurance 4.2; `wgsl/depth_moments.wgsl`).

use bytemuck::{Pod, Zeroable};
use wgpu::{
    CommandEncoder, ComputePipeline, Device, PipelineCache, ShaderStages, TextureFormat,
    TextureUsages, TextureView, TextureViewDimension,
};

use crate::{
    camera::{Camera, CameraParams},
    error::{Error, check_limit, check_setting},
    gpu::{
        Kernel, Timestamps,
        binding::{self, FLOAT_2D, UNIFORM, view, whole},
        compute_pass, shader, uniform,
    },
};

pub(crate) const SOURCE: &str = include_str!("../../wgsl/depth_moments.wgsl");

const LABEL: &str = "deep-screen-space depth moments";

/// Levels of moments: squares of 2 to 256 pixels a side.
pub(crate) const LEVELS: u32 = 8;

const FORMAT: TextureFormat = TextureFormat::Rgba32Float;

/// A mip chain of depth moments, for area samples of [`VolumetricObscurance`](crate::VolumetricObscurance).
///
/// Mip level l holds those over squares of 2^(l + 1) pixels: mean and variance of the view depth of what has a surface, the
/// share that has one, and the share that lies in the viewport.
#[derive(Debug)]
pub struct DepthMoments {
    /// Of the view that they are for, pixels.
    pub(crate) size: [u32; 2],
    texture: wgpu::Texture,
    pub(crate) view: TextureView,
    levels: Vec<TextureView>,
}

impl DepthMoments {
    pub(crate) fn new(device: &Device, size: [u32; 2]) -> Result<Self, Error> {
        check_setting(
            size[0] > 0 && size[1] > 0,
            "view size",
            size[0].min(size[1]),
            "at least 1x1 pixels",
        )?;
        // A whole number of texels on every level: mip levels' sizes are rounded down.
        let [width, height] = size.map(|n| n.div_ceil(1 << LEVELS) << (LEVELS - 1));
        check_limit(
            "max_texture_dimension_2d",
            u64::from(device.limits().max_texture_dimension_2d),
            u64::from(width.max(height)),
            LABEL,
        )?;
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some(LABEL),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: LEVELS,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: TextureUsages::STORAGE_BINDING
                | TextureUsages::TEXTURE_BINDING
                | TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let level = |base_mip_level| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                base_mip_level,
                mip_level_count: Some(1),
                ..Default::default()
            })
        };
        Ok(Self {
            size,
            view: texture.create_view(&wgpu::TextureViewDescriptor::default()),
            levels: (0..LEVELS).map(level).collect(),
            texture,
        })
    }

    /// The moments, `Rgba32Float`.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.texture
    }

    /// GPU memory that it owns, bytes: about 5 a pixel.
    pub fn memory_bytes(&self) -> u64 {
        let texels = u64::from(self.texture.width()) * u64::from(self.texture.height());
        (0..LEVELS).map(|level| 16 * (texels >> (2 * level))).sum()
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct DepthMomentsParams {
    pub(crate) camera: CameraParams,
    pub(crate) forward: [f32; 3],
    pub(crate) padding: u32,
}

/// The pipelines: of the first level, and of the others.
#[derive(Debug)]
pub(crate) struct DepthMomentsPass {
    first: (wgpu::BindGroupLayout, ComputePipeline),
    further: (wgpu::BindGroupLayout, ComputePipeline),
}

impl DepthMomentsPass {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let create = |depth: bool| -> Result<_, Error> {
            let store = binding::store(FORMAT, TextureViewDimension::D2);
            let mut entries = vec![(0, store), (1, FLOAT_2D)];
            entries.extend(depth.then_some((2, UNIFORM)));
            let layout = binding::layout(device, LABEL, ShaderStages::COMPUTE, &entries);
            let module = shader::create(device, LABEL, source(depth)?);
            let pipeline = Kernel {
                label: LABEL,
                module: &module,
                entry: "halve",
                layouts: &[&layout],
                constants: &[],
                cache,
            }
            .create(device);
            Ok((layout, pipeline))
        };
        Ok(Self {
            first: create(true)?,
            further: create(false)?,
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
        let params = uniform(
            device,
            LABEL,
            &DepthMomentsParams {
                camera: camera.params(camera.eye()),
                forward: camera.forward().as_vec3().to_array(),
                padding: 0,
            },
        );
        let mut pass = compute_pass(encoder, LABEL, timestamps);
        for (level, coarse) in moments.levels.iter().enumerate() {
            let (layout, pipeline) = if level == 0 {
                &self.first
            } else {
                &self.further
            };
            let fine = if level == 0 {
                depth
            } else {
                &moments.levels[level - 1]
            };
            let mut resources = vec![(0, view(coarse)), (1, view(fine))];
            resources.extend((level == 0).then(|| (2, whole(&params))));
            let group = binding::group(device, LABEL, layout, &resources);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            let groups = |side: u32| (side >> level).div_ceil(8);
            pass.dispatch_workgroups(
                groups(moments.texture.width()),
                groups(moments.texture.height()),
                1,
            );
        }
    }
}

/// The module, of the first level or of the others.
pub(crate) fn source(depth: bool) -> Result<String, Error> {
    let flags: &[&str] = if depth { &["DEPTH"] } else { &[] };
    shader::assemble("depth_moments", SOURCE, flags, &[])
}

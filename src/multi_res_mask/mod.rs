//! Which pixels are computed at which resolution (Besenthal et al., *Multi-Resolution Rendering for Computationally
//! Expensive Lighting Effects*, 2019, 3.1; `wgsl/multi_res_mask.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use wgpu::{
    BindGroupLayout, Buffer, BufferUsages, CommandEncoder, CompareFunction, ComputePipeline,
    Device, PipelineCache, RenderPipeline, ShaderStages, StencilFaceState, StencilOperation,
    TextureFormat, TextureUsages, TextureView, TextureViewDimension,
};

use self::{
    params::{EdgeParams, LevelParams, levels},
    settings::MultiResMaskSettings,
};
use crate::{
    camera::Camera,
    error::Error,
    gbuffer::{GBuffer, check_plain, samples_as_float},
    gpu::{
        Kernel, Timestamps,
        binding::{self, FLOAT_2D, READ, UNIFORM, WRITE, view, whole},
        check_timestamps, compute_pass,
        scan::{Scan, ScanBuffer},
        shader, storage, uniform,
    },
    receivers::{plane, plane_bytes},
    work::{LEVELS, WorkList, level_size, list_bytes},
};

pub(crate) const SOURCE: &str = include_str!("../../wgsl/multi_res_mask.wgsl");

const LABEL: &str = "deep-screen-space multi-resolution mask";

/// Format of edges and masks.
const MASK: TextureFormat = TextureFormat::R32Float;
/// Format of what raster effects test.
const STENCIL: TextureFormat = TextureFormat::Stencil8;

/// Finds the edges of a G-buffer and divides its pixels among sub-images: near edges at full resolution, farther from
/// them at 1/2, 1/4 and 1/8. What is listed on one level is listed on all coarser ones too, and the coarsest has
/// everything, so that no pixel is without a value.
///
/// An effect then computes the [`WorkList`]s, one recording a level, and the
/// [`MultiResReconstructor`](crate::MultiResReconstructor) makes one image of the sub-images. Nothing is read back.
///
/// Holds pipelines only; one serves any number of views.
#[derive(Debug)]
pub struct MultiResMask {
    edges_layout: BindGroupLayout,
    widen_layout: BindGroupLayout,
    list_layout: BindGroupLayout,
    stamp_layout: BindGroupLayout,
    find_edges: ComputePipeline,
    widen: ComputePipeline,
    list: ComputePipeline,
    stamp: RenderPipeline,
    scan: Scan,
}

/// The masks and lists of one view.
#[derive(Debug)]
pub struct MultiResView {
    size: [u32; 2],
    edges: [TextureView; LEVELS as usize],
    levels: Vec<LevelBuffers>,
    counts: ScanBuffer,
    /// What was last recorded.
    recorded: Option<MultiResMaskSettings>,
    /// Whether edges were left out of that as not important.
    has_importance: bool,
}

#[derive(Debug)]
struct LevelBuffers {
    mask: TextureView,
    pixels: Buffer,
    dispatch: Buffer,
    stencil: Option<TextureView>,
}

impl MultiResView {
    /// Width and height in pixels: that of the cameras' viewports.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// What a level has to compute, of the last recording; `None` where that left the level out.
    ///
    /// Word 0 of its `pixels` is their number (usage `COPY_SRC`).
    pub fn work(&self, level: u32) -> Option<WorkList<'_>> {
        self.recorded_level(level).map(|buffers| WorkList {
            level,
            pixels: &buffers.pixels,
            dispatch: &buffers.dispatch,
        })
    }

    /// The work of all levels that there are, from the finest on.
    pub fn works(&self) -> impl Iterator<Item = WorkList<'_>> {
        (0..LEVELS).filter_map(|level| self.work(level))
    }

    /// A level's mask, of the last recording: `R32Float`, 0…1, above 0 where a pixel is listed (usages
    /// `TEXTURE_BINDING | COPY_SRC`).
    pub fn mask(&self, level: u32) -> Option<&TextureView> {
        self.recorded_level(level).map(|buffers| &buffers.mask)
    }

    /// A level's stencil, of the last recording, where the view was made with stencils: `Stencil8`, 1 where a pixel is
    /// listed, for effects that draw (usages `RENDER_ATTACHMENT | TEXTURE_BINDING | COPY_SRC`).
    pub fn stencil(&self, level: u32) -> Option<&TextureView> {
        self.recorded_level(level)
            .and_then(|buffers| buffers.stencil.as_ref())
    }

    /// The edges over squares of 2^level pixels, of the last recording: `R32Float`, 0…1 (usages
    /// `TEXTURE_BINDING | COPY_SRC`); `None` from level 4 on.
    pub fn edges(&self, level: u32) -> Option<&TextureView> {
        self.edges.get(level as usize)
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let levels: u64 = (0..)
            .zip(&self.levels)
            .map(|(level, buffers)| {
                let size = level_size(self.size, level);
                let stencil = buffers.stencil.as_ref();
                2 * plane_bytes(MASK, size, 1)
                    + stencil.map_or(0, |_| plane_bytes(STENCIL, size, 1))
                    + buffers.pixels.size()
                    + buffers.dispatch.size()
            })
            .sum();
        levels + self.counts.bytes()
    }

    /// The settings that it was last recorded with.
    pub(crate) fn recorded(&self) -> Option<&MultiResMaskSettings> {
        self.recorded.as_ref()
    }

    /// Whether it was recorded with an importance.
    pub(crate) fn has_importance(&self) -> bool {
        self.has_importance
    }

    fn recorded_level(&self, level: u32) -> Option<&LevelBuffers> {
        let settings = self.recorded.as_ref()?;
        settings.levels.get(level as usize)?.as_ref()?;
        self.levels.get(level as usize)
    }
}

/// What one recording of the [`MultiResMask`] works on.
///
/// The three textures of the caller's own are float or unorm formats whose first component is read, usage
/// `TEXTURE_BINDING`, and cover the camera's viewport. What is not finite in them is an edge.
#[derive(Clone, Copy, Debug)]
pub struct MultiResMaskInput<'a> {
    /// The G-buffer. Its albedo is not read.
    pub gbuffer: GBuffer<'a>,
    /// The camera that it was drawn with.
    pub camera: &'a Camera,
    /// An image whose first differences are edges too: hard shadows, for soft ones.
    pub shading: Option<&'a TextureView>,
    /// Edges of the caller's own, 0…1, such as those of motion: an edge is at least this.
    pub edges: Option<&'a TextureView>,
    /// How much detail is worth, 0…1, such as an eye tracker's: an edge is at most this. It goes before all others.
    pub importance: Option<&'a TextureView>,
    /// Where to write begin and end times, if anywhere. Stencils are not in them.
    pub timestamps: Option<Timestamps<'a>>,
}

impl MultiResMask {
    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// None that a device with these limits gives.
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let compute = ShaderStages::COMPUTE;
        let store = binding::store(MASK, TextureViewDimension::D2);
        let edges_layout = binding::layout(
            device,
            LABEL,
            compute,
            &[
                (0, UNIFORM),
                (1, FLOAT_2D),
                (2, FLOAT_2D),
                (3, FLOAT_2D),
                (4, FLOAT_2D),
                (5, FLOAT_2D),
                (6, store),
                (7, store),
                (8, store),
                (9, store),
            ],
        );
        let widen_layout = binding::layout(
            device,
            LABEL,
            compute,
            &[
                (0, UNIFORM),
                (1, FLOAT_2D),
                (2, FLOAT_2D),
                (3, store),
                (4, WRITE),
            ],
        );
        let list_layout = binding::layout(
            device,
            LABEL,
            compute,
            &[
                (0, UNIFORM),
                (1, FLOAT_2D),
                (2, READ),
                (3, WRITE),
                (4, WRITE),
            ],
        );
        let stamp_layout = binding::layout(
            device,
            LABEL,
            ShaderStages::FRAGMENT,
            &[(0, UNIFORM), (1, FLOAT_2D)],
        );
        let kernel = |stage, entry, layout: &BindGroupLayout| -> Result<_, Error> {
            let module = shader::create(device, LABEL, source(stage)?);
            Ok(Kernel {
                label: LABEL,
                module: &module,
                entry,
                layouts: &[layout],
                constants: &[],
                cache,
            }
            .create(device))
        };
        Ok(Self {
            find_edges: kernel(MaskStage::Edges, "find_edges", &edges_layout)?,
            widen: kernel(MaskStage::Widen, "widen", &widen_layout)?,
            list: kernel(MaskStage::List, "list", &list_layout)?,
            stamp: stamp(device, &stamp_layout, cache)?,
            scan: Scan::new(device, cache)?,
            edges_layout,
            widen_layout,
            list_layout,
            stamp_layout,
        })
    }

    /// Masks and lists for a view of `width` × `height` pixels, 16 bytes a pixel; with `stencils` a stencil texture for each
    /// level too.
    ///
    /// # Errors
    /// [`Error::Setting`] for a size out of range, [`Error::Limit`] for one beyond the device's.
    pub fn create_view(
        &self,
        device: &Device,
        width: u32,
        height: u32,
        stencils: bool,
    ) -> Result<MultiResView, Error> {
        let size = [width, height];
        let texture = |level| -> Result<TextureView, Error> {
            let texture = plane(device, LABEL, MASK, level_size(size, level), 1)?;
            Ok(texture.create_view(&wgpu::TextureViewDescriptor::default()))
        };
        let edges = [texture(0)?, texture(1)?, texture(2)?, texture(3)?];
        let mut tiles = 0;
        let mut levels = Vec::new();
        for level in 0..LEVELS {
            let [width, height] = level_size(size, level);
            tiles += width.div_ceil(8) * height.div_ceil(8);
            levels.push(LevelBuffers {
                mask: texture(level)?,
                pixels: storage(
                    device,
                    "deep-screen-space work list",
                    list_bytes(size, level),
                    BufferUsages::COPY_SRC,
                )?,
                dispatch: storage(
                    device,
                    "deep-screen-space work dispatch",
                    12,
                    BufferUsages::INDIRECT | BufferUsages::COPY_SRC,
                )?,
                stencil: stencils.then(|| create_stencil(device, [width, height])),
            });
        }
        Ok(MultiResView {
            size,
            edges,
            levels,
            counts: self
                .scan
                .buffer(device, "deep-screen-space listed pixels of tiles", tiles)?,
            recorded: None,
            has_importance: false,
        })
    }

    /// Records the masks and the lists of a view.
    ///
    /// # Errors
    /// What [`GBuffer::validate`] and [`MultiResMaskSettings::validate`] find; [`Error::Format`], [`Error::Usage`],
    /// [`Error::Shape`] or [`Error::Size`] for a texture of the caller's own; [`Error::Mismatch`] where the view has another
    /// size than the camera's viewport.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &MultiResMaskInput<'_>,
        settings: &MultiResMaskSettings,
        masks: &mut MultiResView,
    ) -> Result<(), Error> {
        settings.validate()?;
        check(input, masks)?;
        let levels = levels(masks.size, settings);
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);

        let params = uniform(device, LABEL, &EdgeParams::new(input, settings));
        // Where a texture is not given any other stands in its place, unread.
        let [shading, edges, importance] = [input.shading, input.edges, input.importance]
            .map(|given| view(given.unwrap_or(input.gbuffer.normal)));
        let mut resources = vec![
            (0, whole(&params)),
            (1, view(input.gbuffer.depth)),
            (2, view(input.gbuffer.normal)),
            (3, shading),
            (4, edges),
            (5, importance),
        ];
        resources.extend((6..).zip(&masks.edges).map(|(i, edges)| (i, view(edges))));
        let group = binding::group(device, LABEL, &self.edges_layout, &resources);
        pass.set_pipeline(&self.find_edges);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(masks.size[0].div_ceil(8), masks.size[1].div_ceil(8), 1);

        let uniforms: Vec<Buffer> = levels
            .iter()
            .map(|(_, params)| uniform(device, LABEL, params))
            .collect();
        pass.set_pipeline(&self.widen);
        // The finest level has no finer one; an edge texture stands in its place, unread.
        let mut finer = &masks.edges[LEVELS as usize - 1];
        for ((level, params), uniform) in levels.iter().zip(&uniforms) {
            let level = *level as usize;
            let group = binding::group(
                device,
                LABEL,
                &self.widen_layout,
                &[
                    (0, whole(uniform)),
                    (1, view(&masks.edges[level])),
                    (2, view(finer)),
                    (3, view(&masks.levels[level].mask)),
                    (4, whole(&masks.counts.values)),
                ],
            );
            dispatch_tiles(&mut pass, &group, params);
            finer = &masks.levels[level].mask;
        }

        self.scan.record(&mut pass, &masks.counts);
        pass.set_pipeline(&self.list);
        for ((level, params), uniform) in levels.iter().zip(&uniforms) {
            let buffers = &masks.levels[*level as usize];
            let group = binding::group(
                device,
                LABEL,
                &self.list_layout,
                &[
                    (0, whole(uniform)),
                    (1, view(&buffers.mask)),
                    (2, whole(&masks.counts.values)),
                    (3, whole(&buffers.pixels)),
                    (4, whole(&buffers.dispatch)),
                ],
            );
            dispatch_tiles(&mut pass, &group, params);
        }
        drop(pass);

        for ((level, _), uniform) in levels.iter().zip(&uniforms) {
            let buffers = &masks.levels[*level as usize];
            if let Some(stencil) = &buffers.stencil {
                let group = binding::group(
                    device,
                    LABEL,
                    &self.stamp_layout,
                    &[(0, whole(uniform)), (1, view(&buffers.mask))],
                );
                draw_stencil(encoder, &self.stamp, &group, stencil);
            }
        }
        masks.recorded = Some(*settings);
        masks.has_importance = input.importance.is_some();
        Ok(())
    }
}

fn check(input: &MultiResMaskInput<'_>, masks: &MultiResView) -> Result<(), Error> {
    check_timestamps(input.timestamps)?;
    let viewport = input.camera.viewport();
    input.gbuffer.validate(viewport)?;
    for (name, source) in [
        ("MultiResMaskInput::shading", input.shading),
        ("MultiResMaskInput::edges", input.edges),
        ("MultiResMaskInput::importance", input.importance),
    ] {
        let Some(source) = source else { continue };
        check_plain(name, source, viewport, TextureUsages::TEXTURE_BINDING)?;
        let format = source.texture().format();
        if !samples_as_float(format) {
            return Err(Error::Format {
                name,
                format,
                accepted: "a float or unorm format",
            });
        }
    }
    let size = [viewport.width, viewport.height];
    if masks.size != size {
        return Err(Error::Mismatch {
            name: "MultiResView",
            found: format!("{:?} pixels", masks.size),
            needed: format!("{size:?} pixels"),
        });
    }
    Ok(())
}

/// A workgroup each tile of a level.
fn dispatch_tiles(pass: &mut wgpu::ComputePass<'_>, group: &wgpu::BindGroup, params: &LevelParams) {
    pass.set_bind_group(0, group, &[]);
    pass.dispatch_workgroups(params.tiles[0], params.tiles[1], 1);
}

fn create_stencil(device: &Device, [width, height]: [u32; 2]) -> TextureView {
    device
        .create_texture(&wgpu::TextureDescriptor {
            label: Some("deep-screen-space multi-resolution stencil"),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: STENCIL,
            usage: TextureUsages::RENDER_ATTACHMENT
                | TextureUsages::TEXTURE_BINDING
                | TextureUsages::COPY_SRC,
            view_formats: &[],
        })
        .create_view(&wgpu::TextureViewDescriptor::default())
}

/// The pipeline that writes stencils: nothing else is attached.
fn stamp(
    device: &Device,
    layout: &BindGroupLayout,
    cache: Option<&PipelineCache>,
) -> Result<RenderPipeline, Error> {
    let module = shader::create(device, LABEL, source(MaskStage::Stamp)?);
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(LABEL),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    let face = StencilFaceState {
        compare: CompareFunction::Always,
        pass_op: StencilOperation::Replace,
        ..Default::default()
    };
    Ok(
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(LABEL),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("cover"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: STENCIL,
                depth_write_enabled: None,
                depth_compare: None,
                stencil: wgpu::StencilState {
                    front: face,
                    back: face,
                    read_mask: 0xff,
                    write_mask: 0xff,
                },
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("stamp"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[],
            }),
            multiview_mask: None,
            cache,
        }),
    )
}

/// 1 where a level's mask is above 0, and 0 elsewhere.
fn draw_stencil(
    encoder: &mut CommandEncoder,
    pipeline: &RenderPipeline,
    group: &wgpu::BindGroup,
    stencil: &TextureView,
) {
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(LABEL),
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: stencil,
            depth_ops: None,
            stencil_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(0),
                store: wgpu::StoreOp::Store,
            }),
        }),
        ..Default::default()
    });
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, group, &[]);
    pass.set_stencil_reference(1);
    pass.draw(0..3, 0..1);
}

/// The modules that a mask is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum MaskStage {
    Edges,
    Widen,
    List,
    Stamp,
}

/// Assembles one of them.
pub(crate) fn source(stage: MaskStage) -> Result<String, Error> {
    let flags: &[&str] = match stage {
        MaskStage::Edges => &["EDGES"],
        MaskStage::Widen => &["WIDEN"],
        MaskStage::List => &["LIST"],
        MaskStage::Stamp => &[],
    };
    shader::assemble("multi_res_mask", SOURCE, flags, &[])
}

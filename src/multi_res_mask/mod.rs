//! Which pixels are computed at which resolution (Besenthal et al., *Multi-Resolution Rendering for Computationally
//! Expensive Lighting Effects*, 2019, 3.1; `wgsl/multi_res_mask.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;
mod stencil;
pub(crate) mod view;

use wgpu::{
    BindGroup, BindGroupLayout, Buffer, CommandEncoder, ComputePipeline, Device, PipelineCache,
    RenderPassTimestampWrites, RenderPipeline, ShaderStages, TextureUsages, TextureView,
};

use self::{
    params::{EdgeParams, LevelParams, levels},
    settings::MultiResMaskSettings,
    view::{BLOCK, MultiResView},
};
use crate::{
    camera::Camera,
    error::Error,
    gbuffer::{GBuffer, samples_as_float},
    gpu::{
        Kernel, Timestamps, WORKGROUP,
        binding::{self, FLOAT_2D, UNIFORM, WRITE, view, whole},
        check_timestamps,
        scan::Scan,
        screen::Screen,
        shader, uniform,
    },
    shaders::{Listing, name_of},
    texture_slice::{TextureSlice, check_slice},
};

const SOURCE: &str = include_str!("../../wgsl/multi_res_mask.wgsl");

const LABEL: &str = "deep-screen-space multi-resolution mask";

/// Finds the edges of a G-buffer and divides its pixels among sub-images: near edges at full resolution, farther from
/// them at 1/2, 1/4 and 1/8. What is listed on one level is listed on all coarser ones too, and the coarsest has
/// everything, so that no pixel is without a value.
///
/// An effect then computes the [`PixelList`](crate::PixelList)s, one recording per level, and the
/// [`MultiResReconstructor`](crate::MultiResReconstructor) makes one image of the sub-images. Nothing is read back.
///
/// A fragment finds the edges of 2 × 2 pixels, for which it reads 12 of the G-buffer; all else is of 8 bits per pixel, or of
/// the listed pixels alone. Levels that are left out cost nothing, nor do textures of the caller's own that are not given.
///
/// Holds pipelines only; one serves any number of views.
#[derive(Debug)]
pub struct MultiResMask {
    /// By whether there is a shading, then by whether the caller gives edges or an importance.
    find_edges: [[Drawn; 2]; 2],
    coarsen: Drawn,
    /// By whether there is a finer level.
    widen: [Drawn; 2],
    stamp: Drawn,
    list_layout: BindGroupLayout,
    count: ComputePipeline,
    list: ComputePipeline,
    scan: Scan,
}

/// A pipeline that draws, and the layout of what it binds.
#[derive(Debug)]
struct Drawn {
    layout: BindGroupLayout,
    pipeline: RenderPipeline,
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
    pub shading: Option<TextureSlice<'a>>,
    /// Edges of the caller's own, 0…1, such as those of motion: an edge is at least this.
    pub edges: Option<TextureSlice<'a>>,
    /// How much detail is worth, 0…1, such as an eye tracker's: an edge is at most this. It goes before all others.
    pub importance: Option<TextureSlice<'a>>,
    /// Where to write begin and end times, if anywhere. Stencils are not in them.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> MultiResMaskInput<'a> {
    /// By the G-buffer's own edges, without timestamps.
    pub fn new(gbuffer: GBuffer<'a>, camera: &'a Camera) -> Self {
        Self {
            gbuffer,
            camera,
            shading: None,
            edges: None,
            importance: None,
            timestamps: None,
        }
    }
}

impl MultiResMask {
    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// None that a device with these limits gives.
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let drawn = |stage, entry| Drawn::new(device, stage, entry, cache);
        let edges = |shading, given| drawn(MaskStage::Edges { shading, given }, "find_edges");
        let list_layout = binding::layout(
            device,
            LABEL,
            ShaderStages::COMPUTE,
            &[
                (0, UNIFORM),
                (1, FLOAT_2D),
                (2, WRITE),
                (3, WRITE),
                (4, WRITE),
                (5, WRITE),
            ],
        );
        let module = shader::create(device, LABEL, source(MaskStage::List)?);
        let kernel = |entry| {
            Kernel {
                label: LABEL,
                module: &module,
                entry,
                layouts: &[&list_layout],
                constants: &[],
                cache,
            }
            .create(device)
        };
        let (count, list) = (kernel("count"), kernel("list"));
        let layout = MaskStage::Stamp.layout(device);
        Ok(Self {
            find_edges: [
                [edges(false, false)?, edges(false, true)?],
                [edges(true, false)?, edges(true, true)?],
            ],
            coarsen: drawn(MaskStage::Coarsen, "coarsen")?,
            widen: [
                drawn(MaskStage::Widen { finer: false }, "widen")?,
                drawn(MaskStage::Widen { finer: true }, "widen")?,
            ],
            stamp: Drawn {
                pipeline: stencil::pipeline(device, &layout, cache)?,
                layout,
            },
            list_layout,
            count,
            list,
            scan: Scan::new(device, cache)?,
        })
    }

    /// Masks and lists for a view of `width` × `height` pixels, 8 bytes per pixel; with `stencils` a stencil texture for each
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
        MultiResView::new(device, &self.scan, [width, height], stencils)
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
        self.record_edges(device, encoder, input, settings, masks);
        let levels: Vec<Level> = levels(masks.size, settings)
            .into_iter()
            .map(|(number, params)| Level {
                number,
                params,
                uniform: uniform(device, LABEL, &params),
            })
            .collect();
        self.record_masks(device, encoder, &levels, masks);
        self.record_lists(device, encoder, &levels, masks, input.timestamps);
        for level in &levels {
            let buffers = &masks.levels[level.number as usize];
            if let Some(target) = &buffers.stencil {
                let resources = [(1, view(&buffers.mask))];
                let group = binding::group(device, LABEL, &self.stamp.layout, &resources);
                stencil::draw(encoder, &self.stamp.pipeline, &group, target);
            }
        }
        masks.recorded = Some(*settings);
        masks.has_importance = input.importance.is_some();
        Ok(())
    }

    /// The edges at full resolution.
    fn record_edges(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &MultiResMaskInput<'_>,
        settings: &MultiResMaskSettings,
        masks: &MultiResView,
    ) {
        let params = uniform(device, LABEL, &EdgeParams::new(input, settings));
        let [depth, normal] = [input.gbuffer.depth, input.gbuffer.normal].map(|slice| slice.read());
        let read = |slice: Option<TextureSlice<'_>>| slice.map(|slice| slice.read());
        let shading = read(input.shading);
        let given = [read(input.edges), read(input.importance)];
        let mut resources = vec![(0, whole(&params)), (1, view(&depth)), (2, view(&normal))];
        resources.extend(shading.as_ref().map(|shading| (3, view(shading))));
        // Where one of the two is not given the other stands in its place, unread.
        if let Some(any) = given[0].as_ref().or(given[1].as_ref()) {
            let both = given
                .each_ref()
                .map(|own| view(own.as_ref().unwrap_or(any)));
            resources.extend((4..).zip(both));
        }
        let is_given = usize::from(given.iter().any(Option::is_some));
        let find = &self.find_edges[usize::from(input.shading.is_some())][is_given];
        let group = binding::group(device, LABEL, &find.layout, &resources);
        let begin = input.timestamps.map(|t| RenderPassTimestampWrites {
            query_set: t.set,
            beginning_of_pass_write_index: Some(t.begin),
            end_of_pass_write_index: None,
        });
        fill(encoder, Some((find, &group)), &masks.edges[0], begin);
    }

    /// The masks of all levels, from the finest on.
    fn record_masks(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        levels: &[Level],
        masks: &MultiResView,
    ) {
        let Some((coarsest, blurred)) = levels.split_last() else {
            return;
        };
        let mut finer: Option<&TextureView> = None;
        // Up to which level there are edges.
        let mut known = 0;
        for level in blurred {
            let own = level.number as usize;
            for coarser in known + 1..=own {
                let resources = [(0, view(&masks.edges[coarser - 1]))];
                let group = binding::group(device, LABEL, &self.coarsen.layout, &resources);
                let to = &masks.edges[coarser];
                fill(encoder, Some((&self.coarsen, &group)), to, None);
            }
            known = own;
            let widen = &self.widen[usize::from(finer.is_some())];
            let mut resources = vec![(0, whole(&level.uniform)), (1, view(&masks.edges[own]))];
            resources.extend(finer.map(|finer| (2, view(finer))));
            let group = binding::group(device, LABEL, &widen.layout, &resources);
            let mask = &masks.levels[own].mask;
            fill(encoder, Some((widen, &group)), mask, None);
            finer = Some(mask);
        }
        // It has everything.
        let mask = &masks.levels[coarsest.number as usize].mask;
        fill(encoder, None, mask, None);
    }

    /// The lists of all levels. It is the last pass with timestamps.
    fn record_lists(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        levels: &[Level],
        masks: &MultiResView,
        timestamps: Option<Timestamps<'_>>,
    ) {
        let groups: Vec<(BindGroup, u32)> = levels
            .iter()
            .map(|level| {
                let buffers = &masks.levels[level.number as usize];
                let resources = [
                    (0, whole(&level.uniform)),
                    (1, view(&buffers.mask)),
                    (2, whole(&masks.counts.values)),
                    (3, whole(&buffers.pixels)),
                    (4, whole(&buffers.dispatch)),
                    (5, whole(&buffers.blended)),
                ];
                let group = binding::group(device, LABEL, &self.list_layout, &resources);
                let [columns, rows] = level.params.tiles;
                (group, (columns * rows).div_ceil(WORKGROUP))
            })
            .collect();
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(LABEL),
            timestamp_writes: timestamps.map(|t| wgpu::ComputePassTimestampWrites {
                query_set: t.set,
                beginning_of_pass_write_index: None,
                end_of_pass_write_index: Some(t.end),
            }),
        });
        pass.set_pipeline(&self.count);
        for (group, workgroups) in &groups {
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(*workgroups, 1, 1);
        }
        self.scan.record(&mut pass, &masks.counts);
        pass.set_pipeline(&self.list);
        for (group, workgroups) in &groups {
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(*workgroups, 1, 1);
        }
    }
}

/// A level that is recorded.
struct Level {
    number: u32,
    params: LevelParams,
    uniform: Buffer,
}

impl Drawn {
    fn new(
        device: &Device,
        stage: MaskStage,
        entry: &str,
        cache: Option<&PipelineCache>,
    ) -> Result<Self, Error> {
        let layout = stage.layout(device);
        let pipeline = Screen {
            label: LABEL,
            module: &shader::create(device, LABEL, source(stage)?),
            entry,
            layout: &layout,
            constants: &[],
            target: BLOCK,
            cache,
        }
        .create(device);
        Ok(Self { layout, pipeline })
    }
}

/// Draws all of a texture, or sets all of it to 1.
fn fill(
    encoder: &mut CommandEncoder,
    drawn: Option<(&Drawn, &BindGroup)>,
    target: &TextureView,
    timestamps: Option<RenderPassTimestampWrites<'_>>,
) {
    let clear = if drawn.is_some() {
        wgpu::Color::TRANSPARENT
    } else {
        wgpu::Color::WHITE
    };
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(LABEL),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(clear),
                store: wgpu::StoreOp::Store,
            },
        })],
        timestamp_writes: timestamps,
        ..Default::default()
    });
    if let Some((drawn, group)) = drawn {
        pass.set_pipeline(&drawn.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.draw(0..3, 0..1);
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
        check_slice(name, &source, viewport, TextureUsages::TEXTURE_BINDING)?;
        let format = source.view_format();
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

/// The modules that a mask is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum MaskStage {
    Edges { shading: bool, given: bool },
    Coarsen,
    Widen { finer: bool },
    List,
    Stamp,
}

impl MaskStage {
    fn flags(self) -> Vec<&'static str> {
        match self {
            Self::Edges { shading, given } => [
                Some("EDGES"),
                shading.then_some("SHADING"),
                given.then_some("GIVEN"),
            ]
            .into_iter()
            .flatten()
            .collect(),
            Self::Coarsen => vec!["COARSEN"],
            Self::Widen { finer } => ["WIDEN"]
                .into_iter()
                .chain(finer.then_some("FINER"))
                .collect(),
            Self::List => vec!["LIST"],
            Self::Stamp => Vec::new(),
        }
    }

    /// What a stage binds that draws.
    fn layout(self, device: &Device) -> BindGroupLayout {
        let textures: &[u32] = match self {
            Self::Edges { shading, given } => match (shading, given) {
                (false, false) => &[1, 2],
                (true, false) => &[1, 2, 3],
                (false, true) => &[1, 2, 4, 5],
                (true, true) => &[1, 2, 3, 4, 5],
            },
            Self::Coarsen => &[0],
            Self::Widen { finer: true } => &[1, 2],
            _ => &[1],
        };
        let mut entries: Vec<_> = textures
            .iter()
            .map(|&binding| (binding, FLOAT_2D))
            .collect();
        if matches!(self, Self::Edges { .. } | Self::Widen { .. }) {
            entries.push((0, UNIFORM));
        }
        binding::layout(device, LABEL, ShaderStages::FRAGMENT, &entries)
    }
}

/// Assembles one of them.
fn source(stage: MaskStage) -> Result<String, Error> {
    shader::assemble("multi_res_mask", SOURCE, &stage.flags(), &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    for shading in [false, true] {
        for given in [false, true] {
            let name = name_of(
                "multi_res_mask edges",
                &[(shading, "shading"), (given, "given")],
            );
            all.add(&name, source(MaskStage::Edges { shading, given })?);
        }
    }
    for (name, stage) in [
        ("multi_res_mask coarsen", MaskStage::Coarsen),
        ("multi_res_mask widen", MaskStage::Widen { finer: false }),
        (
            "multi_res_mask widen finer",
            MaskStage::Widen { finer: true },
        ),
        ("multi_res_mask list", MaskStage::List),
        ("multi_res_mask stamp", MaskStage::Stamp),
    ] {
        all.add(name, source(stage)?);
    }
    Ok(())
}

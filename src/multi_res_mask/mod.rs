//! Which pixels are computed at which resolution (Besenthal et al., *Multi-Resolution Rendering for Computationally
//! Expensive Lighting Effects*, 2019, 3.1; `wgsl/multi_res_mask.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;
mod stencil;
pub(crate) mod view;

use wgpu::{
    CommandEncoder, ComputePipeline, Device, PipelineCache, RenderPassTimestampWrites,
    RenderPipeline, TextureUsages, TextureView,
};

use self::{
    params::{EdgeParams, LevelParams, levels},
    settings::MultiResMaskSettings,
    view::{BLOCK, MultiResView},
};
use crate::{
    camera::Camera,
    effect::Listing,
    error::Error,
    gbuffer::{GBuffer, samples_as_float},
    gpu::compiler::Compiler,
    gpu::listing::name_of,
    gpu::{
        Kernel, Timestamps, WORKGROUP,
        binding::{Group, Groups, Layout, view, whole},
        check_timestamps,
        scan::Scan,
        screen::Screen,
        shader,
        uniforms::{Parameters, Place, Uniforms, Uploaded},
    },
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
/// ```no_run
/// use deep_screen_space::*;
///
/// /// Soft shadows of a light into `target`, an `R8Unorm` texture: at full resolution about edges, and coarser elsewhere.
/// fn shadow(
///     device: &wgpu::Device,
///     encoder: &mut wgpu::CommandEncoder,
///     (gbuffer, camera): (GBuffer<'_>, &Camera),
///     (light, map): (&Light, ShadowMap<'_>),
///     target: &wgpu::Texture,
/// ) -> Result<(), Error> {
///     // Once, and what is of the view's size once per view.
///     let (mask, shadows) = (MultiResMask::new(device)?, SoftShadows::new(device)?);
///     let blend = MultiResReconstructor::new(device, Channels::One, wgpu::TextureFormat::R8Unorm)?;
///     let levels = MultiResMaskSettings::default();
///     let Viewport { width, height, .. } = camera.viewport();
///     let mut masks = mask.create_view(device, width, height, false)?;
///     let images = blend.create_images(device, width, height, &levels)?;
///
///     // Every frame: the masks, the effect on each of their levels, and one image of them.
///     let input = MultiResMaskInput::new(gbuffer, camera);
///     mask.record(device, encoder, &input, &levels, &mut masks)?;
///     for work in masks.works() {
///         let Some(image) = images.level(work.level) else { continue };
///         let input = SoftShadowsInput {
///             work: Some(work),
///             ..SoftShadowsInput::new(gbuffer, camera, light, map, image)
///         };
///         shadows.record(device, encoder, &input, &SoftShadowsSettings::default())?;
///     }
///     let input = MultiResReconstructorInput::new(gbuffer, camera, &masks, &images, target);
///     blend.record(device, encoder, &input, &MultiResReconstructorSettings::default())
/// }
/// ```
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
    list_layout: Layout,
    count: ComputePipeline,
    list: ComputePipeline,
    scan: Scan,
    uniforms: Uniforms,
}

/// A pipeline that draws, and the layout of what it binds.
#[derive(Debug)]
struct Drawn {
    layout: Layout,
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
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        let drawn = |stage, entry| Drawn::new(device, stage, entry, cache);
        let edges = |shading, given| drawn(MaskStage::Edges { shading, given }, "find_edges");
        let module = shader::create(device, LABEL, source(MaskStage::List)?);
        let list_layout = module.layout(device, &["count", "list"]);
        let kernel = |entry| {
            Kernel {
                label: LABEL,
                module: &module,
                entry,
                layouts: &[&list_layout.raw],
                constants: &[],
                cache,
            }
            .create(device)
        };
        let (count, list) = (kernel("count"), kernel("list"));
        let stamp = shader::create(device, LABEL, source(MaskStage::Stamp)?);
        let layout = stamp.layout(device, &["stamp"]);
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
                pipeline: stencil::pipeline(device, &stamp, &layout, cache),
                layout,
            },
            list_layout,
            count,
            list,
            scan: Scan::new(device, cache)?,
            uniforms: Uniforms::new(LABEL),
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
        let mut parameters = Parameters::new(device);
        let edges = parameters.add(&EdgeParams::new(input, settings));
        let levels: Vec<Level> = levels(masks.size, settings)
            .into_iter()
            .map(|(number, params)| Level {
                number,
                params,
                place: parameters.add(&params),
            })
            .collect();
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let mut groups = masks.kept.groups(device);
        self.record_edges(device, encoder, input, (&parameters, edges), masks);
        self.record_masks(encoder, &mut groups, (&parameters, &levels), masks);
        self.record_lists(
            encoder,
            &mut groups,
            (&parameters, &levels),
            masks,
            input.timestamps,
        );
        for level in &levels {
            let buffers = &masks.levels[level.number as usize];
            if let Some(target) = &buffers.stencil {
                let resources = [("mask", view(&buffers.mask))];
                let group = groups.next(&self.stamp.layout, &resources);
                stencil::draw(encoder, &self.stamp.pipeline, &group, target);
            }
        }
        drop(groups);
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
        (parameters, params): (&Uploaded, Place),
        masks: &MultiResView,
    ) {
        let [depth, normal] = [input.gbuffer.depth, input.gbuffer.normal].map(|slice| slice.read());
        let read = |slice: Option<TextureSlice<'_>>| slice.map(|slice| slice.read());
        let shading = read(input.shading);
        let given = [read(input.edges), read(input.importance)];
        let mut resources = vec![
            ("params", parameters.at(params)),
            ("depth_texture", view(&depth)),
            ("normal_texture", view(&normal)),
        ];
        resources.extend(shading.as_ref().map(|s| ("shading", view(s))));
        // Where one of the two is not given the other stands in its place, unread.
        if let Some(any) = given[0].as_ref().or(given[1].as_ref()) {
            let both = given
                .each_ref()
                .map(|own| view(own.as_ref().unwrap_or(any)));
            resources.extend(["extra", "importance"].into_iter().zip(both));
        }
        let is_given = usize::from(given.iter().any(Option::is_some));
        let find = &self.find_edges[usize::from(input.shading.is_some())][is_given];
        let group = find.layout.group(device, &resources);
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
        encoder: &mut CommandEncoder,
        groups: &mut Groups<'_>,
        (parameters, levels): (&Uploaded, &[Level]),
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
                let resources = [("edges", view(&masks.edges[coarser - 1]))];
                let group = groups.next(&self.coarsen.layout, &resources);
                let to = &masks.edges[coarser];
                fill(encoder, Some((&self.coarsen, &group)), to, None);
            }
            known = own;
            let widen = &self.widen[usize::from(finer.is_some())];
            let mut resources = vec![
                ("params", parameters.at(level.place)),
                ("edges", view(&masks.edges[own])),
            ];
            resources.extend(finer.map(|finer| ("finer", view(finer))));
            let group = groups.next(&widen.layout, &resources);
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
        encoder: &mut CommandEncoder,
        groups: &mut Groups<'_>,
        (parameters, levels): (&Uploaded, &[Level]),
        masks: &MultiResView,
        timestamps: Option<Timestamps<'_>>,
    ) {
        let groups: Vec<(Group, u32)> = levels
            .iter()
            .map(|level| {
                let buffers = &masks.levels[level.number as usize];
                let resources = [
                    ("params", parameters.at(level.place)),
                    ("mask", view(&buffers.mask)),
                    ("counts", whole(&masks.counts.values)),
                    ("pixels", whole(&buffers.pixels)),
                    ("workgroups", whole(&buffers.dispatch)),
                    ("blended", whole(&buffers.blended)),
                ];
                let group = groups.next(&self.list_layout, &resources);
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
            pass.set_bind_group(0, &group.raw, &group.offsets);
            pass.dispatch_workgroups(*workgroups, 1, 1);
        }
        self.scan.record(&mut pass, &masks.counts);
        pass.set_pipeline(&self.list);
        for (group, workgroups) in &groups {
            pass.set_bind_group(0, &group.raw, &group.offsets);
            pass.dispatch_workgroups(*workgroups, 1, 1);
        }
    }
}

/// A level that is recorded.
struct Level {
    number: u32,
    params: LevelParams,
    place: Place,
}

impl Drawn {
    fn new(
        device: &Device,
        stage: MaskStage,
        entry: &str,
        cache: Option<&PipelineCache>,
    ) -> Result<Self, Error> {
        let module = shader::create(device, LABEL, source(stage)?);
        let layout = module.layout(device, &[entry]);
        let pipeline = Screen {
            label: LABEL,
            module: &module,
            entry,
            layout: &layout.raw,
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
    drawn: Option<(&Drawn, &Group)>,
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
        pass.set_bind_group(0, &group.raw, &group.offsets);
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

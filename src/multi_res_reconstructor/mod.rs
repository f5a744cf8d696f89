//! One image of the sub-images that an effect computed (Besenthal et al., *Multi-Resolution Rendering for Computationally
//! Expensive Lighting Effects*, 2019, 3.3; `wgsl/multi_res_reconstructor.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use wgpu::{
    CommandEncoder, ComputePass, ComputePipeline, Device, RenderPipeline, TextureFormat,
    TextureUsages, TextureView,
};

use self::{
    params::{MultiResReconstructorParams, alike},
    settings::MultiResReconstructorSettings,
};
use crate::{
    camera::Camera,
    effect::Channels,
    effect::Listing,
    error::Error,
    gbuffer::GBuffer,
    gpu::compiler::Compiler,
    gpu::listing::name_of,
    gpu::{
        Kernel, Timestamps,
        binding::{Layout, Resource, view, whole},
        check_timestamps, first_pass,
        screen::{self, Screen},
        shader,
        uniforms::{Parameters, Uniforms},
    },
    multi_res_mask::{settings::MultiResMaskSettings, view::MultiResView},
    receivers::{plane_bytes, plane_for},
    texture_slice::{TextureSlice, check_apart},
    work::{LEVELS, level_size},
};

const SOURCE: &str = include_str!("../../wgsl/multi_res_reconstructor.wgsl");

const LABEL: &str = "deep-screen-space multi-resolution reconstructor";

/// Blends the sub-images of an effect, coarse to fine, into the caller's texture. Each level is completed at its own
/// resolution: its own image where that counts alone, and elsewhere bilinear among the pixels of the next coarser one that
/// lie on the pixel's own surface, or the nearest of other surfaces where none is of its own.
///
/// A value that is not finite counts as not computed.
///
/// Surfaces are compared for those listed pixels alone that are blended of two levels, where that level's blur reaches as far as
/// the next coarser level's pixels lie, thresholds are 0 and no importance was given: all presets but the finest level of
/// [`MultiResMaskSettings::INDIRECT`]. Elsewhere they are for each pixel.
///
/// Holds pipelines only, for one number of channels and one target format; one serves any number of views.
#[derive(Debug)]
pub struct MultiResReconstructor {
    channels: Channels,
    target: TextureFormat,
    level_layout: Layout,
    /// By whether all pixels about one are on its surface, unless it is listed.
    complete: [ComputePipeline; 2],
    mend: ComputePipeline,
    blend_layout: Layout,
    /// As `complete`.
    blend: [RenderPipeline; 2],
    uniforms: Uniforms,
}

/// A texture for each level: what an effect writes and the reconstructor reads; and one that it completes in.
#[derive(Debug)]
pub struct SubImages {
    size: [u32; 2],
    channels: Channels,
    levels: [Option<TextureView>; LEVELS as usize],
    /// Of all levels but the coarsest, which is complete.
    completed: [Option<TextureView>; LEVELS as usize],
}

impl SubImages {
    /// The texture of a level: `R32Float` or `Rgba16Float` by the channels (usages `STORAGE_BINDING | RENDER_ATTACHMENT |
    /// TEXTURE_BINDING | COPY_SRC`); `None` for a level that it was not made with.
    pub fn level(&self, level: u32) -> Option<&wgpu::Texture> {
        self.view(level).map(TextureView::texture)
    }

    fn view(&self, level: u32) -> Option<&TextureView> {
        self.levels.get(level as usize)?.as_ref()
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let bytes = |level| plane_bytes(format(self.channels), level_size(self.size, level), 1);
        [&self.levels, &self.completed]
            .into_iter()
            .flat_map(|views| (0..).zip(views))
            .filter_map(|(level, view)| view.as_ref().map(|_| bytes(level)))
            .sum()
    }
}

/// What one recording of the [`MultiResReconstructor`] works on.
#[derive(Clone, Copy, Debug)]
pub struct MultiResReconstructorInput<'a> {
    /// The G-buffer. Its albedo is not read.
    pub gbuffer: GBuffer<'a>,
    /// Its camera.
    pub camera: &'a Camera,
    /// The masks, recorded for this G-buffer.
    pub masks: &'a MultiResView,
    /// What the effect computed of the masks' work.
    pub images: &'a SubImages,
    /// The caller's texture, of the format that the reconstructor was made for, usage `RENDER_ATTACHMENT`, covering the
    /// camera's viewport. Only the viewport is written: one channel to red, green and blue, three as they are, alpha 1.
    pub target: TextureSlice<'a>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> MultiResReconstructorInput<'a> {
    /// Without timestamps.
    pub fn new(
        gbuffer: GBuffer<'a>,
        camera: &'a Camera,
        masks: &'a MultiResView,
        images: &'a SubImages,
        target: impl Into<TextureSlice<'a>>,
    ) -> Self {
        Self {
            gbuffer,
            camera,
            masks,
            images,
            target: target.into(),
            timestamps: None,
        }
    }
}

impl MultiResReconstructor {
    /// Compiles the pipeline. `target` is any colour format that can be rendered to; its missing channels are dropped.
    ///
    /// # Errors
    /// [`Error::Format`] for a target that cannot be rendered to or does not hold floats.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        channels: Channels,
        target: TextureFormat,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        screen::check_format(device, "MultiResReconstructor target", target)?;
        let constants = |alike: bool| [("ALIKE", f64::from(u8::from(alike)))];
        let module = shader::create(device, LABEL, source(channels, false)?);
        let level_layout = module.layout(device, &["complete", "mend"]);
        let kernel = |entry, alike| {
            Kernel {
                label: LABEL,
                module: &module,
                entry,
                layouts: &[&level_layout.raw],
                constants: &constants(alike),
                cache,
            }
            .create(device)
        };
        let screen = shader::create(device, LABEL, source(channels, true)?);
        let blend_layout = screen.layout(device, &["blend"]);
        let blend = |alike| {
            Screen {
                label: LABEL,
                module: &screen,
                entry: "blend",
                layout: &blend_layout.raw,
                constants: &constants(alike),
                target,
                cache,
            }
            .create(device)
        };
        Ok(Self {
            channels,
            target,
            complete: [kernel("complete", false), kernel("complete", true)],
            mend: kernel("mend", false),
            blend: [blend(false), blend(true)],
            level_layout,
            blend_layout,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Textures for the levels that a mask with these settings has, of a view of `width` × `height` pixels.
    ///
    /// # Errors
    /// What [`MultiResMaskSettings::validate`] finds, [`Error::Setting`] for a size out of range, [`Error::Limit`] for one
    /// beyond the device's.
    pub fn create_images(
        &self,
        device: &Device,
        width: u32,
        height: u32,
        settings: &MultiResMaskSettings,
    ) -> Result<SubImages, Error> {
        settings.validate()?;
        let size = [width, height];
        let texture = |level| -> Result<_, Error> {
            let size = level_size(size, level);
            let texture = plane_for(
                device,
                "deep-screen-space sub-image",
                format(self.channels),
                size,
                1,
                TextureUsages::RENDER_ATTACHMENT,
            )?;
            Ok(Some(
                texture.create_view(&wgpu::TextureViewDescriptor::default()),
            ))
        };
        let mut images = SubImages {
            size,
            channels: self.channels,
            levels: [const { None }; LEVELS as usize],
            completed: [const { None }; LEVELS as usize],
        };
        for (level, _) in settings.present() {
            images.levels[level as usize] = texture(level)?;
            if level != settings.coarsest() {
                images.completed[level as usize] = texture(level)?;
            }
        }
        Ok(images)
    }

    /// Records the blend into the caller's texture.
    ///
    /// # Errors
    /// What [`GBuffer::validate`] and [`MultiResReconstructorSettings::validate`] find; [`Error::Format`], [`Error::Size`],
    /// [`Error::Shape`] or [`Error::Usage`] for the target; [`Error::Mismatch`] where masks or sub-images are not the
    /// camera's viewport in size, where the masks were not recorded, and where a level of theirs has no sub-image.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &MultiResReconstructorInput<'_>,
        settings: &MultiResReconstructorSettings,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let mask = self.check(input)?;
        let images = input.images;
        let alike = alike(mask, input.masks.has_importance());
        let mut coarse = (mask.coarsest(), images.view(mask.coarsest()));
        let mut parameters = Parameters::new(device);
        let params = |levels| MultiResReconstructorParams::new(input, mask, *settings, levels);
        let mut levels = Vec::new();
        let present: Vec<u32> = mask.present().map(|(level, _)| level).collect();
        for &level in present.iter().rev().skip(1) {
            let params = params([level, coarse.0]);
            let result = images.completed[level as usize].as_ref();
            if let (Some(coarse), Some(own), Some(result)) = (coarse.1, images.view(level), result)
            {
                levels.push((params, parameters.add(&params), [coarse, own, result]));
            }
            // The finest level's other pixels are what the target has.
            if level > 0 {
                coarse = (level, result);
            }
        }
        let blended = params([0, coarse.0]);
        let place = parameters.add(&blended);
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let gbuffer = [input.gbuffer.depth, input.gbuffer.normal].map(|slice| slice.read());
        let [depth, normal] = &gbuffer;
        let mut pass = first_pass(encoder, LABEL, input.timestamps);
        for (params, place, textures) in levels {
            let is_alike = alike & (1 << params.coarser) != 0;
            let params = (&params, parameters.at(place));
            self.record_level(
                device,
                &mut pass,
                (input, &gbuffer),
                params,
                textures,
                is_alike,
            );
        }
        drop(pass);
        // Where the finest level is left out others stand in its place, unread.
        if let (Some(coarse), Some(mask)) = (
            coarse.1,
            input.masks.mask(0).or(input.masks.mask(mask.coarsest())),
        ) {
            let completed = images.completed[0].as_ref();
            let resources = [
                ("params", parameters.at(place)),
                ("depth_texture", view(depth)),
                ("normal_texture", view(normal)),
                ("coarse", view(coarse)),
                ("mask", view(mask)),
                ("own", view(images.view(0).unwrap_or(coarse))),
                ("mended", view(completed.unwrap_or(coarse))),
            ];
            let group = self.blend_layout.group(device, &resources);
            // Of one level all is listed.
            let is_alike = blended.coarser == 0 || alike & (1 << blended.coarser) != 0;
            screen::draw(
                encoder,
                LABEL,
                (&self.blend[usize::from(is_alike)], &group),
                &input.target,
                input.camera.viewport(),
                input.timestamps,
                false,
            );
        }
        Ok(())
    }

    /// Completes a level, of the finest its blended pixels alone. The textures are the next coarser level's, the level's own
    /// and the result.
    fn record_level(
        &self,
        device: &Device,
        pass: &mut ComputePass<'_>,
        (input, [depth, normal]): (&MultiResReconstructorInput<'_>, &[TextureView; 2]),
        (params, uniform): (&MultiResReconstructorParams, Resource<'_>),
        [coarse, own, result]: [&TextureView; 3],
        is_alike: bool,
    ) {
        let (Some(mask), Some(work), Some(blended)) = (
            input.masks.mask(params.level),
            input.masks.work(params.level),
            input.masks.blended(params.level),
        ) else {
            return;
        };
        let resources = [
            ("params", uniform),
            ("depth_texture", view(depth)),
            ("normal_texture", view(normal)),
            ("coarse", view(coarse)),
            ("mask", view(mask)),
            ("own", view(own)),
            ("work", work.list(input.camera.viewport())),
            ("result", view(result)),
            ("blended", whole(blended)),
        ];
        let group = self.level_layout.group(device, &resources);
        pass.set_bind_group(0, &group.raw, &group.offsets);
        if params.level > 0 {
            let [width, height] = level_size(input.masks.size(), params.level);
            pass.set_pipeline(&self.complete[usize::from(is_alike)]);
            pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        }
        pass.set_pipeline(&self.mend);
        pass.dispatch_workgroups_indirect(blended, 0);
    }

    /// The settings of the masks, after all checks.
    fn check<'a>(
        &self,
        input: &MultiResReconstructorInput<'a>,
    ) -> Result<&'a MultiResMaskSettings, Error> {
        const TARGET: &str = "MultiResReconstructorInput::target";
        let viewport = input.camera.viewport();
        let size = [viewport.width, viewport.height];
        input.gbuffer.validate(viewport)?;
        screen::check_target(TARGET, &input.target, viewport, self.target)?;
        let levels = (0..LEVELS).filter_map(|level| input.images.level(level));
        let levels = levels.map(|level| ("SubImages", TextureSlice::new(level), 1));
        check_apart(TARGET, &input.target, input.gbuffer.reads().chain(levels))?;
        let mismatch = |name, found: String, needed: String| {
            Err(Error::Mismatch {
                name,
                found,
                needed,
            })
        };
        let masks = input.masks;
        let Some(settings) = masks.recorded().filter(|_| masks.size() == size) else {
            return mismatch(
                "MultiResView",
                format!(
                    "{:?} pixels, recorded: {}",
                    masks.size(),
                    masks.recorded().is_some()
                ),
                format!("{size:?} pixels, recorded"),
            );
        };
        let images = input.images;
        let has_all = settings
            .present()
            .all(|(level, _)| images.level(level).is_some());
        if images.size != size || images.channels != self.channels || !has_all {
            let levels = |has: &dyn Fn(u32) -> bool| -> Vec<u32> {
                (0..LEVELS).filter(|&level| has(level)).collect()
            };
            return mismatch(
                "SubImages",
                format!(
                    "{:?} pixels, {:?}, levels {:?}",
                    images.size,
                    images.channels,
                    levels(&|level| images.level(level).is_some())
                ),
                format!(
                    "{size:?} pixels, {:?}, levels {:?}",
                    self.channels,
                    levels(&|level| settings.levels[level as usize].is_some())
                ),
            );
        }
        Ok(settings)
    }
}

/// Format of a sub-image.
fn format(channels: Channels) -> TextureFormat {
    match channels {
        Channels::One => TextureFormat::R32Float,
        Channels::Three => TextureFormat::Rgba16Float,
    }
}

/// Assembles the module of the levels, or that of the blend.
fn source(channels: Channels, blend: bool) -> Result<String, Error> {
    let flags: Vec<&str> = [
        (channels == Channels::Three).then_some("COLOR"),
        blend.then_some("BLEND"),
    ]
    .into_iter()
    .flatten()
    .collect();
    shader::assemble("multi_res_reconstructor", SOURCE, &flags, &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    for channels in [Channels::One, Channels::Three] {
        for blend in [false, true] {
            let name = name_of(
                "multi_res_reconstructor",
                &[(blend, "blend"), (channels == Channels::Three, "color")],
            );
            all.add(&name, source(channels, blend)?);
        }
    }
    Ok(())
}

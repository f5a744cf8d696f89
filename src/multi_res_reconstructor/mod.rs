//! One image of the sub-images that an effect computed (Besenthal et al., *Multi-Resolution Rendering for Computationally
//! Expensive Lighting Effects*, 2019, 3.3; `wgsl/multi_res_reconstructor.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use wgpu::{
    BindGroupLayout, BindingType, CommandEncoder, Device, PipelineCache, RenderPipeline,
    ShaderStages, TextureFormat, TextureUsages, TextureView,
};

use self::{params::MultiResReconstructorParams, settings::MultiResReconstructorSettings};
use crate::{
    camera::Camera,
    effect::Channels,
    error::Error,
    gbuffer::{GBuffer, check_plain},
    gpu::{
        Timestamps,
        binding::{self, FLOAT_2D, UNIFORM, view, whole},
        check_timestamps,
        screen::{self, Screen},
        shader, uniform,
    },
    multi_res_mask::{MultiResView, settings::MultiResMaskSettings},
    receivers::{plane_bytes, plane_for},
    work::{LEVELS, level_size},
};

pub(crate) const SOURCE: &str = include_str!("../../wgsl/multi_res_reconstructor.wgsl");

const LABEL: &str = "deep-screen-space multi-resolution reconstructor";

/// Blends the sub-images of an effect, coarse to fine, into the caller's texture: bilinear among the pixels that were
/// computed and lie on the pixel's own surface. A pixel of which a level has none takes the next coarser one; of the
/// coarsest, which has all, it takes the nearest of other surfaces where none is of its own.
///
/// A value that is not finite counts as not computed.
///
/// Holds a pipeline only, for one number of channels and one target format; one serves any number of views.
#[derive(Debug)]
pub struct MultiResReconstructor {
    channels: Channels,
    target: TextureFormat,
    layout: BindGroupLayout,
    blend: RenderPipeline,
}

/// A texture for each level: what an effect writes and the reconstructor reads.
#[derive(Debug)]
pub struct SubImages {
    size: [u32; 2],
    channels: Channels,
    levels: [Option<TextureView>; LEVELS as usize],
}

impl SubImages {
    /// The texture of a level: `R32Float` or `Rgba16Float` by the channels (usages `STORAGE_BINDING | RENDER_ATTACHMENT |
    /// TEXTURE_BINDING | COPY_SRC`); `None` for a level that it was not made with.
    pub fn level(&self, level: u32) -> Option<&TextureView> {
        self.levels.get(level as usize)?.as_ref()
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let bytes = |level| plane_bytes(format(self.channels), level_size(self.size, level), 1);
        (0..)
            .zip(&self.levels)
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
    pub target: &'a TextureView,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl MultiResReconstructor {
    /// Compiles the pipeline. `target` is any colour format that can be rendered to; its missing channels are dropped.
    ///
    /// # Errors
    /// [`Error::Format`] for a target that cannot be rendered to or does not hold floats.
    pub fn new(
        device: &Device,
        channels: Channels,
        target: TextureFormat,
        cache: Option<&PipelineCache>,
    ) -> Result<Self, Error> {
        screen::check_format(device, "MultiResReconstructor target", target)?;
        let entries: Vec<(u32, BindingType)> = std::iter::once((0, UNIFORM))
            .chain((1..=10).map(|binding| (binding, FLOAT_2D)))
            .collect();
        let layout = binding::layout(device, LABEL, ShaderStages::FRAGMENT, &entries);
        let module = shader::create(device, LABEL, source(channels)?);
        let blend = Screen {
            label: LABEL,
            module: &module,
            entry: "blend",
            layout: &layout,
            constants: &[],
            target,
            cache,
        }
        .create(device);
        Ok(Self {
            channels,
            target,
            layout,
            blend,
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
        let mut levels = [const { None }; LEVELS as usize];
        for (level, _) in settings.present() {
            let texture = plane_for(
                device,
                "deep-screen-space sub-image",
                format(self.channels),
                level_size(size, level),
                1,
                TextureUsages::RENDER_ATTACHMENT,
            )?;
            levels[level as usize] =
                Some(texture.create_view(&wgpu::TextureViewDescriptor::default()));
        }
        Ok(SubImages {
            size,
            channels: self.channels,
            levels,
        })
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
        let params = uniform(
            device,
            LABEL,
            &MultiResReconstructorParams::new(input, mask, *settings),
        );
        let mut resources = vec![
            (0, whole(&params)),
            (1, view(input.gbuffer.depth)),
            (2, view(input.gbuffer.normal)),
        ];
        // Where a level is left out another's textures stand, unread.
        let present = |level| {
            if mask.levels[level as usize].is_some() {
                level
            } else {
                mask.coarsest()
            }
        };
        let (masks, images) = (input.masks, input.images);
        let levels = || (0..LEVELS).map(present);
        resources.extend((3..).zip(levels().filter_map(|l| masks.mask(l)).map(view)));
        resources.extend((7..).zip(levels().filter_map(|l| images.level(l)).map(view)));
        let group = binding::group(device, LABEL, &self.layout, &resources);
        screen::draw(
            encoder,
            LABEL,
            (&self.blend, &group),
            input.target,
            input.camera.viewport(),
            input.timestamps,
            true,
        );
        Ok(())
    }

    /// The settings of the masks, after all checks.
    fn check<'a>(
        &self,
        input: &MultiResReconstructorInput<'a>,
    ) -> Result<&'a MultiResMaskSettings, Error> {
        let viewport = input.camera.viewport();
        let size = [viewport.width, viewport.height];
        input.gbuffer.validate(viewport)?;
        check_plain(
            "MultiResReconstructorInput::target",
            input.target,
            viewport,
            TextureUsages::RENDER_ATTACHMENT,
        )?;
        let mismatch = |name, found: String, needed: String| {
            Err(Error::Mismatch {
                name,
                found,
                needed,
            })
        };
        let format = input.target.texture().format();
        if format != self.target {
            return mismatch(
                "MultiResReconstructor",
                format!("{:?}", self.target),
                format!("{format:?}"),
            );
        }
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

/// Assembles the module.
pub(crate) fn source(channels: Channels) -> Result<String, Error> {
    let flags: &[&str] = match channels {
        Channels::One => &[],
        Channels::Three => &["COLOR"],
    };
    shader::assemble("multi_res_reconstructor", SOURCE, flags, &[])
}

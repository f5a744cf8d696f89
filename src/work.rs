//! Which pixels of an image an effect computes: all, or those of a list that the GPU made (`wgsl/common/work.wgsl`).

use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device, PipelineCache, TextureFormat,
    TextureUsages,
};

use crate::{
    camera::Viewport,
    error::{Error, check_setting},
    geometry::{check_size, check_usage},
    gpu::{
        Timestamps,
        binding::{Layout, Named, Resource, check_first, first},
        compute_pass, shader,
    },
    texture_slice::{TextureSlice, check_slice},
};

/// Sub-images that there can be: 1, 1/2, 1/4 and 1/8 of the image's width and height.
pub(crate) const LEVELS: u32 = 4;

/// Pixels of a sub-image to compute, listed on the GPU; [`MultiResMask`](crate::MultiResMask) makes such lists.
///
/// Level l has `⌈width / 2^l⌉ × ⌈height / 2^l⌉` pixels. Its pixel (x, y) stands for pixel
/// `min(2^l (x, y) + ⌊2^l / 2⌋, size − 1)` of the viewport: an effect reads the whole G-buffer there and computes exactly what
/// it would compute there for the whole image.
#[derive(Clone, Copy, Debug)]
pub struct PixelList<'a> {
    /// The sub-image, 0…3; 0 is the whole image.
    pub level: u32,
    /// `u32`s: how many pixels, then `x | y << 16` of each, in pixels of the sub-image; room for all of the level's pixels.
    /// Usage `STORAGE`.
    pub pixels: &'a Buffer,
    /// Three `u32`: an indirect dispatch of a workgroup each 64 pixels. Usage `INDIRECT`.
    pub dispatch: &'a Buffer,
}

const PIXELS: &str = "PixelList::pixels";

impl PixelList<'_> {
    /// Checks the level, and both buffers against it.
    ///
    /// # Errors
    /// [`Error::Setting`] for the level, [`Error::Buffer`] for a buffer that is too small or lacks a usage.
    pub fn validate(&self, viewport: Viewport) -> Result<(), Error> {
        const DISPATCH: &str = "PixelList::dispatch";
        check_setting(
            self.level < LEVELS,
            "PixelList::level",
            self.level,
            "0 to 3",
        )?;
        check_usage(PIXELS, self.pixels)?;
        check_size(PIXELS, self.pixels, self.bytes(viewport))?;
        if !self.dispatch.usage().contains(BufferUsages::INDIRECT) {
            return Err(Error::Buffer {
                name: DISPATCH,
                found: format!("usage {:?}", self.dispatch.usage()),
                needed: "usage INDIRECT".into(),
            });
        }
        check_size(DISPATCH, self.dispatch, 12)
    }

    /// The same, and that the device can bind the list.
    pub(crate) fn check(&self, device: &Device, viewport: Viewport) -> Result<(), Error> {
        self.validate(viewport)?;
        check_first(device, PIXELS, self.pixels, self.bytes(viewport))
    }

    /// The list as a binding.
    pub(crate) fn list(&self, viewport: Viewport) -> Resource<'_> {
        first(self.pixels, self.bytes(viewport))
    }

    fn bytes(&self, viewport: Viewport) -> u64 {
        list_bytes([viewport.width, viewport.height], self.level)
    }
}

/// The size of a sub-image, pixels.
pub(crate) fn level_size(size: [u32; 2], level: u32) -> [u32; 2] {
    size.map(|n| n.div_ceil(1 << level))
}

/// Bytes of a list that holds all pixels of a sub-image.
pub(crate) fn list_bytes(size: [u32; 2], level: u32) -> u64 {
    let [width, height] = level_size(size, level).map(u64::from);
    4 * (1 + width * height)
}

/// The level that work is on, after a check of the list and of the storage texture that an effect writes.
pub(crate) fn check_work(
    device: &Device,
    name: &'static str,
    work: Option<&PixelList<'_>>,
    viewport: Viewport,
    target: &TextureSlice<'_>,
    format: TextureFormat,
) -> Result<u32, Error> {
    if let Some(work) = work {
        work.check(device, viewport)?;
    }
    let level = work.map_or(0, |work| work.level);
    let [width, height] = level_size([viewport.width, viewport.height], level);
    let needed = Viewport::full(width, height);
    check_slice(name, target, needed, TextureUsages::STORAGE_BINDING)?;
    let found = target.view_format();
    if found != format {
        return Err(Error::Format {
            name,
            format: found,
            accepted: match format {
                TextureFormat::R32Float => "R32Float",
                _ => "Rgba16Float",
            },
        });
    }
    Ok(level)
}

/// A kernel of `@workgroup_size(8, 8)` that asks `work_item()` for its pixel: over all pixels, and over a list.
#[derive(Debug)]
pub(crate) struct WorkKernel {
    label: &'static str,
    /// For all pixels, and for those of a list.
    variants: [(Layout, ComputePipeline); 2],
}

/// What a [`WorkKernel`] is made of.
pub(crate) struct WorkKernelDescriptor<'a> {
    pub label: &'static str,
    pub entry: &'a str,
    pub constants: &'a [(&'a str, f64)],
    pub cache: Option<&'a PipelineCache>,
}

impl WorkKernel {
    /// `source` assembles the module, with LIST or without.
    pub fn new(
        device: &Device,
        descriptor: &WorkKernelDescriptor<'_>,
        source: impl Fn(bool) -> Result<String, Error>,
    ) -> Result<Self, Error> {
        let &WorkKernelDescriptor {
            label,
            entry,
            constants,
            cache,
        } = descriptor;
        let variant = |list: bool| -> Result<_, Error> {
            let module = shader::create(device, label, source(list)?);
            Ok(module.kernel(device, entry, constants, cache))
        };
        Ok(Self {
            label,
            variants: [variant(false)?, variant(true)?],
        })
    }

    /// Records it over a list, or over all pixels of a viewport. The list is bound besides.
    pub fn record<'a>(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        mut resources: Vec<Named<'a>>,
        work: Option<&'a PixelList<'_>>,
        viewport: Viewport,
        timestamps: Option<Timestamps<'_>>,
    ) {
        resources.extend(work.map(|work| ("work", work.list(viewport))));
        let (layout, pipeline) = &self.variants[usize::from(work.is_some())];
        let group = layout.group(device, &resources);
        let mut pass = compute_pass(encoder, self.label, timestamps);
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &group.raw, &group.offsets);
        match work {
            Some(work) => pass.dispatch_workgroups_indirect(work.dispatch, 0),
            None => {
                pass.dispatch_workgroups(
                    viewport.width.div_ceil(8),
                    viewport.height.div_ceil(8),
                    1,
                );
            }
        }
    }
}

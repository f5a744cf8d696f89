//! The masks and lists of one view.

use wgpu::{Buffer, BufferUsages, Device, TextureFormat, TextureUsages, TextureView};

use super::{
    params::all_counts,
    settings::MultiResMaskSettings,
    stencil::{self, STENCIL},
};
use crate::{
    error::Error,
    gpu::{
        binding::Kept,
        scan::{Scan, ScanBuffer},
        storage,
        texture::Plane,
    },
    receivers::{check_view_size, plane_bytes},
    work::{LEVELS, PixelList, level_size, list_bytes},
};

/// Format of edges and masks, of a texel for 2 × 2 pixels.
pub(super) const BLOCK: TextureFormat = TextureFormat::Rgba8Unorm;
/// Levels whose edges are blurred: the coarsest that there can be has everything.
pub(super) const BLURRED: u32 = LEVELS - 1;

/// The masks and lists of one view.
///
/// Edges and masks of a level are `Rgba8Unorm` textures of half its width and height, rounded up: a texel holds the 2 × 2
/// pixels from (2x, 2y) on, rows from the top. Usages `RENDER_ATTACHMENT | TEXTURE_BINDING | COPY_SRC`.
#[derive(Debug)]
pub struct MultiResView {
    pub(super) size: [u32; 2],
    pub(super) edges: Vec<TextureView>,
    pub(super) levels: Vec<LevelBuffers>,
    pub(super) counts: ScanBuffer,
    /// What was last recorded.
    pub(super) recorded: Option<MultiResMaskSettings>,
    /// Whether edges were left out of that as not important.
    pub(super) has_importance: bool,
    pub(super) kept: Kept,
}

#[derive(Debug)]
pub(super) struct LevelBuffers {
    pub mask: TextureView,
    pub pixels: Buffer,
    pub dispatch: Buffer,
    /// The dispatch for those pixels alone that are blended with the coarser level, then how many come before them.
    pub blended: Buffer,
    pub stencil: Option<TextureView>,
}

impl MultiResView {
    pub(super) fn new(
        device: &Device,
        scan: &Scan,
        size: [u32; 2],
        stencils: bool,
    ) -> Result<Self, Error> {
        // Smaller ones are within it, and so do a pixel's 16 bits hold it.
        check_view_size(device, "deep-screen-space multi-resolution mask", size)?;
        let levels = (0..LEVELS)
            .map(|level| {
                Ok(LevelBuffers {
                    mask: blocks(device, size, level),
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
                    blended: storage(
                        device,
                        "deep-screen-space blended work",
                        16,
                        BufferUsages::INDIRECT,
                    )?,
                    stencil: stencils.then(|| stencil::create(device, level_size(size, level))),
                })
            })
            .collect::<Result<_, Error>>()?;
        Ok(Self {
            size,
            edges: (0..BLURRED)
                .map(|level| blocks(device, size, level))
                .collect(),
            levels,
            counts: scan.buffer(
                device,
                "deep-screen-space listed pixels of tiles",
                all_counts(size),
            )?,
            recorded: None,
            has_importance: false,
            kept: Kept::default(),
        })
    }

    /// Width and height in pixels: that of the cameras' viewports.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// What a level has to compute, of the last recording; `None` where that left the level out.
    ///
    /// Word 0 of its `pixels` is their number (usage `COPY_SRC`).
    pub fn work(&self, level: u32) -> Option<PixelList<'_>> {
        self.recorded_level(level).map(|buffers| PixelList {
            level,
            pixels: &buffers.pixels,
            dispatch: &buffers.dispatch,
        })
    }

    /// The work of all levels that there are, from the finest on.
    pub fn works(&self) -> impl Iterator<Item = PixelList<'_>> {
        (0..LEVELS).filter_map(|level| self.work(level))
    }

    /// A level's mask, of the last recording: 0…1, above 0 where a pixel is listed. What a texel holds of pixels beyond
    /// the image has no meaning.
    pub fn mask(&self, level: u32) -> Option<&TextureView> {
        self.recorded_level(level).map(|buffers| &buffers.mask)
    }

    /// A level's stencil, of the last recording, where the view was made with stencils: `Stencil8`, 1 where a pixel is
    /// listed, for effects that draw (usages `RENDER_ATTACHMENT | TEXTURE_BINDING | COPY_SRC`).
    pub fn stencil(&self, level: u32) -> Option<&TextureView> {
        self.recorded_level(level)
            .and_then(|buffers| buffers.stencil.as_ref())
    }

    /// The edges at full resolution, 0…1, of the last recording; `None` before the first.
    pub fn edges(&self) -> Option<&TextureView> {
        self.recorded.as_ref().and_then(|_| self.edges.first())
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let levels: u64 = (0..)
            .zip(&self.levels)
            .map(|(level, buffers)| {
                let stencil = buffers.stencil.as_ref();
                block_bytes(self.size, level)
                    + stencil.map_or(0, |_| plane_bytes(STENCIL, level_size(self.size, level), 1))
                    + buffers.pixels.size()
                    + buffers.dispatch.size()
                    + buffers.blended.size()
            })
            .sum();
        let edges: u64 = (0..BLURRED)
            .map(|level| block_bytes(self.size, level))
            .sum();
        levels + edges + self.counts.bytes()
    }

    /// Of a level's work that which is blended with the coarser level: an indirect dispatch, then how many pixels come
    /// before it.
    pub(crate) fn blended(&self, level: u32) -> Option<&Buffer> {
        self.recorded_level(level).map(|buffers| &buffers.blended)
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

/// The size of a level's texture of blocks, which is that of the next coarser level.
pub(super) fn block_size(size: [u32; 2], level: u32) -> [u32; 2] {
    level_size(size, level + 1)
}

fn block_bytes(size: [u32; 2], level: u32) -> u64 {
    plane_bytes(BLOCK, block_size(size, level), 1)
}

fn blocks(device: &Device, size: [u32; 2], level: u32) -> TextureView {
    let usage =
        TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_SRC;
    let label = "deep-screen-space multi-resolution mask";
    Plane::new(label, BLOCK, block_size(size, level), usage)
        .create(device)
        .create_view(&wgpu::TextureViewDescriptor::default())
}

//! The buffers of one view.

use wgpu::{Buffer, BufferUsages, Device};

use super::{
    LABEL,
    params::{HullSegment, HullVertex, SgHullCounts},
    settings::SgHullSize,
};
use crate::{
    error::Error,
    gpu::{binding::Kept, storage},
    receivers::check_view_size,
};

/// Bytes of `Gathering`, `Split`, `Part` (`wgsl/common/sg_hull_split.wgsl`) and `RejectedQuad` (`wgsl/common/sg_hull.wgsl`).
const GATHERING_BYTES: u64 = 8;
const SPLIT_BYTES: u64 = 240;
const PART_BYTES: u64 = 80;
const REJECTED_BYTES: u64 = 16;

crate::reflection::bytes_of_wgsl!(
    gatherings_are_the_shaders: GATHERING_BYTES, as "Gathering" in [
        "sg_hull_place", "sg_hull_gather", "sg_hull_classify",
    ]
);
crate::reflection::bytes_of_wgsl!(
    splits_are_the_shaders: SPLIT_BYTES, as "Split" in [
        "sg_hull_split", "sg_hull_gather", "sg_hull_classify",
    ]
);
crate::reflection::bytes_of_wgsl!(
    parts_are_the_shaders: PART_BYTES, as "Part" in ["sg_hull_split", "sg_hull"]
);
crate::reflection::bytes_of_wgsl!(
    rejected_are_the_shaders: REJECTED_BYTES, as "RejectedQuad" in [
        "sg_hull_split", "sg_hull_classify",
    ]
);

/// The buffers of one view.
#[derive(Debug)]
pub struct SgHullView {
    pub(super) size: SgHullSize,
    pub(super) segment_of: Buffer,
    /// Pixels that are another surface than their texel's middle.
    pub(super) others: Buffer,
    pub(super) segments: Buffer,
    pub(super) vertices: Buffer,
    /// `Gathering`s: the vertices to gather at.
    pub(super) list: Buffer,
    /// Quads that do not fit, and parts of them, to be split in four.
    pub(super) splits: Buffer,
    /// Parts that fit.
    pub(super) parts: Buffer,
    /// Quads and parts whose light is gathered at each pixel.
    pub(super) rejected: Buffer,
    /// Their pixels.
    pub(super) per_pixel: Buffer,
    pub(super) counts: Buffer,
    /// Arguments of one dispatch after another. A kernel cannot write the buffer that its own come from.
    pub(super) dispatch: Buffer,
    pub(super) kept: Kept,
}

impl SgHullView {
    /// With room for splits where there are any.
    pub(super) fn new(device: &Device, size: SgHullSize, splits: bool) -> Result<Self, Error> {
        size.validate()?;
        check_view_size(device, LABEL, [size.width, size.height])?;
        let capacity = u64::from(size.capacity());
        let splits = if splits { u64::from(size.splits) } else { 0 };
        let buffer =
            |label, bytes, usage| storage(device, label, bytes, usage | BufferUsages::COPY_SRC);
        let none = BufferUsages::empty();
        let pixels = 4 * u64::from(size.width) * u64::from(size.height);
        Ok(Self {
            size,
            kept: Kept::default(),
            segment_of: buffer("deep-screen-space hull pixels", pixels, none)?,
            others: buffer("deep-screen-space hull others", pixels, none)?,
            segments: buffer(
                "deep-screen-space hull segments",
                capacity * size_of::<HullSegment>() as u64,
                none,
            )?,
            vertices: buffer(
                "deep-screen-space hull vertices",
                4 * capacity * size_of::<HullVertex>() as u64,
                none,
            )?,
            list: buffer(
                "deep-screen-space hull list",
                4 * capacity * GATHERING_BYTES,
                none,
            )?,
            splits: buffer(
                "deep-screen-space hull splits",
                splits.max(1) * SPLIT_BYTES,
                none,
            )?,
            parts: buffer(
                "deep-screen-space hull parts",
                4 * splits.max(1) * PART_BYTES,
                none,
            )?,
            rejected: buffer(
                "deep-screen-space hull rejected",
                (capacity + 4 * splits) * REJECTED_BYTES,
                none,
            )?,
            per_pixel: buffer(
                "deep-screen-space hull per pixel",
                u64::from(size.per_pixel) * 16,
                none,
            )?,
            dispatch: buffer(
                "deep-screen-space hull dispatch",
                16,
                BufferUsages::INDIRECT,
            )?,
            counts: buffer(
                "deep-screen-space hull counts",
                size_of::<SgHullCounts>() as u64,
                BufferUsages::INDIRECT | BufferUsages::COPY_DST,
            )?,
        })
    }

    /// What it was made for.
    pub fn size(&self) -> SgHullSize {
        self.size
    }

    /// One [`SgHullCounts`] (usage `COPY_SRC`).
    pub fn counts(&self) -> &Buffer {
        &self.counts
    }

    /// The segment of each pixel, a `u32` each, rows from the top; `0xffff_ffff` for the sky (usage `COPY_SRC`).
    pub fn segment_of(&self) -> &Buffer {
        &self.segment_of
    }

    /// The segments, [`HullSegment`]s of 48 bytes: first those counted as [`SgHullCounts::segments`], then, from
    /// [`SgHullSize::segments`] on, those of last resort (usage `COPY_SRC`).
    pub fn segments(&self) -> &Buffer {
        &self.segments
    }

    /// Four [`HullVertex`]es of 96 bytes per quad, without gaps (usage `COPY_SRC`).
    pub fn vertices(&self) -> &Buffer {
        &self.vertices
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.segment_of.size()
            + self.others.size()
            + self.segments.size()
            + self.vertices.size()
            + self.list.size()
            + self.splits.size()
            + self.parts.size()
            + self.rejected.size()
            + self.per_pixel.size()
            + self.counts.size()
            + self.dispatch.size()
    }
}

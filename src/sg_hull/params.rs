//! What the GPU reads: `Params`, `Segment`, `Counters` and `HullVertex` of `wgsl/common/sg_hull*.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::settings::{SgHullSettings, SgHullSize};
use crate::camera::{Camera, CameraParams, RayParams};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SgHullParams {
    pub(crate) camera: CameraParams,
    pub(crate) along: [f32; 3],
    pub(crate) capacity: u32,
    pub(crate) grid: [u32; 2],
    pub(crate) tiles: [u32; 2],
    pub(crate) f0: [f32; 3],
    pub(crate) texel: u32,
    pub(crate) per_pixel_capacity: u32,
    pub(crate) error_threshold: f32,
    pub(crate) plane_distance: f32,
    pub(crate) gap: f32,
    pub(crate) normal_cosine: f32,
    pub(crate) quad: u32,
    pub(crate) split_room: u32,
    padding: u32,
    pub(crate) rays: RayParams,
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: SgHullParams as "Params" in [
        "sg_hull_segment", "sg_hull_plan", "sg_hull_gather", "sg_hull albedo",
        "sg_hull albedo glossy",
    ] {
        camera, along, capacity, grid, tiles, f0, texel, per_pixel_capacity, error_threshold,
        plane_distance, gap, normal_cosine, quad, split_room, rays,
    }
);

impl SgHullParams {
    pub fn new(
        settings: &SgHullSettings,
        size: &SgHullSize,
        camera: &Camera,
        origin: DVec3,
        split_room: u32,
    ) -> Self {
        // Rounding must not cut a plane.
        let cosine = (settings.normal_angle.cos() - 1e-4).max(-2.0);
        Self {
            camera: camera.params(origin),
            along: camera.axis().as_vec3().to_array(),
            capacity: size.capacity(),
            grid: size.texels(),
            tiles: size.tiles(),
            f0: settings.f0,
            texel: size.texel(),
            per_pixel_capacity: size.per_pixel,
            error_threshold: settings.error_threshold.min(f32::MAX),
            plane_distance: settings.plane_distance,
            gap: settings.gap,
            normal_cosine: cosine,
            quad: settings.quad,
            split_room,
            padding: 0,
            rays: camera.rays(origin),
        }
    }
}

/// `Segment`: pixels of a tile that lie on one surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct HullSegment {
    /// The first pixel and the one past the last: x, y, x, y.
    pub rect: [u32; 4],
    /// The least distance along the camera's axis, world units.
    pub nearest: f32,
    /// The largest.
    pub farthest: f32,
    /// A pixel of it close to its middle, row by row.
    pub anchor: u32,
    /// The mean normal, octahedral in two snorm16.
    pub normal: u32,
    /// How far normals lie off it, root mean square, radians.
    pub spread: f32,
    /// 0.
    pub padding: [u32; 3],
}

crate::reflection::same_as_wgsl!(
    segments_are_the_shaders: HullSegment as "Segment" in [
        "sg_hull_segment", "sg_hull_plan", "sg_hull_gather", "sg_hull albedo",
        "sg_hull albedo glossy",
    ]
    { rect, nearest, farthest, anchor, normal, spread }
);

/// `HullVertex`: light that arrives at a corner of a segment's rectangle.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct HullVertex {
    /// Where, relative to the origin of the recording.
    pub position: [f32; 3],
    /// How far along the camera's axis.
    pub depth: f32,
    /// Moments of the red light: directions times radiance, and radiance, over the solid angle.
    pub red: [f32; 4],
    /// Of the green.
    pub green: [f32; 4],
    /// Of the blue.
    pub blue: [f32; 4],
    /// What the lobe of each channel adds to the irradiance of a surface with the vertex's normal that is not there.
    pub excess: [f32; 3],
    /// The vertex that the light was gathered at: this one, or one at the same corner of a neighbour on the same surface,
    /// or the first of a segment of eight pixels or fewer, which has no light either: that is gathered at the pixels. Moments
    /// and excess are 0 where it is another.
    pub owner: u32,
    /// What a surface with the segment's mean normal receives at the corner, whoever owns it, W/m².
    pub irradiance: [f32; 3],
    /// 0.
    pub padding: u32,
}

crate::reflection::same_as_wgsl!(
    vertices_are_the_shaders: HullVertex as "HullVertex" in [
        "sg_hull_place", "sg_hull_gather", "sg_hull_classify", "sg_hull albedo",
    ]
    { position, depth, red, green, blue, excess, owner, irradiance }
);

/// What a recording counted. The GPU writes it; the caller reads it when it likes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SgHullCounts {
    /// Segments asked for.
    pub segments: u32,
    /// Tiles with a segment of last resort besides.
    pub fallbacks: u32,
    /// Pixels in those.
    pub fallback_pixels: u32,
    /// Vertices that light was gathered at.
    pub gathered: u32,
    /// Arguments of the draw of quads: 4, quads, 0, 0.
    pub draw: [u32; 4],
    /// Quads, and parts of split ones, whose error reaches
    /// [`SgHullSettings::error_threshold`](crate::SgHullSettings::error_threshold) and that are not split, tiny ones, and those
    /// of last resort.
    pub rejected: u32,
    /// Their pixels, whose light is gathered at each of them.
    pub per_pixel: u32,
    /// The mean irradiance at the vertices, over colour channels as well, W/m².
    pub mean_irradiance: f32,
    /// Quads of one normal that do not fit, and parts of them, that are split in four, room or not
    /// ([`SgHullSize::splits`](crate::SgHullSize::splits)). Light is gathered at five points of each.
    pub splits: u32,
    /// Arguments of the draw of the pixels that found room: their number, 1, 0, 0.
    pub points: [u32; 4],
    /// Arguments of the draw of the parts that fit: 4, parts, 0, 0.
    pub parts: [u32; 4],
    /// The splits of the last round: the first, and the one past the last.
    pub round: [u32; 2],
    /// 0.
    pub padding: [u32; 2],
}

crate::reflection::same_as_wgsl!(
    counts_are_the_shaders: SgHullCounts as "Counters" in [
        "sg_hull_segment", "sg_hull_plan", "sg_hull_gather", "sg_hull albedo",
        "sg_hull albedo glossy",
    ] {
        segments, fallbacks, fallback_pixels, gathered, draw, rejected, per_pixel,
        mean_irradiance, splits, points, parts, round,
    }
);
// Stages know those alone that they count, and add to them without waiting for each other.
crate::reflection::same_as_wgsl!(
    segmenting_counts: SgHullCounts [12] as "AtomicCounters" in ["sg_hull_segment"]
    { segments, fallbacks, fallback_pixels }
);
crate::reflection::same_as_wgsl!(
    placing_counts: SgHullCounts [32] as "PlaceCounters" in ["sg_hull_place"]
    { segments, fallbacks, fallback_pixels, gathered, draw }
);
crate::reflection::same_as_wgsl!(
    classifying_counts: SgHullCounts [48] as "ClassifyCounters" in ["sg_hull_classify"] {
        segments, fallbacks, fallback_pixels, gathered, draw, rejected, per_pixel,
        mean_irradiance, splits,
    }
);
crate::reflection::bytes_of_wgsl!(
    splitting_counts: size_of::<SgHullCounts>(), as "SplitCounters" in ["sg_hull_split"]
);

impl SgHullCounts {
    /// Segments that found no room.
    pub fn overflow(&self, size: &SgHullSize) -> u32 {
        self.segments.saturating_sub(size.segments)
    }

    /// Quads drawn.
    pub fn quads(&self) -> u32 {
        self.draw[1]
    }

    /// Pixels that were to be gathered each for itself and found no room: the hull shades them.
    pub fn per_pixel_overflow(&self, size: &SgHullSize) -> u32 {
        self.per_pixel.saturating_sub(size.per_pixel)
    }

    /// Splits that found no room: their pixels are gathered each for itself.
    pub fn split_overflow(&self, size: &SgHullSize) -> u32 {
        self.splits.saturating_sub(size.splits)
    }

    /// Corners of the quads. Light is gathered at fewer points, as neighbours share theirs ([`HullVertex::owner`]).
    pub fn vertices(&self) -> u32 {
        4 * self.quads()
    }
}

//! Public settings and their validation.

use std::f32::consts::PI;

use crate::error::{Error, check_setting};

/// How the texels of a tile become segments. Both look at the same links between neighbours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Components {
    /// Connected components, by a union-find of all threads at once: no more segments than there are.
    #[default]
    UnionFind,
    /// The four sweeps of algorithm 1 of Meder and Brüderlin (2018), right, down, left and up. What no four sweeps reach,
    /// such as a spiral, falls into several segments.
    Propagation,
}

/// How large a view of the [`SgHull`](crate::SgHull) is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SgHullSize {
    /// Width of the camera's viewport in pixels.
    pub width: u32,
    /// Height of it.
    pub height: u32,
    /// Texels along the longer side of the grid that is segmented, at most, 32…4096. They are squares of whole pixels, no
    /// smaller than one; a tile has 32 × 32 of them. The paper has 1024. Default 640:
    /// texels of 2 pixels at 1280x720, of 6 at 3840x2400.
    pub grid: u32,
    /// Segments that there is room for besides one per tile, up to 2^20. With the default quads a picture of 16:9 is 14400 of
    /// them, and as many again with fine geometry. 480 bytes each. What finds no room goes, with the rest of its tile, to one
    /// segment, and is counted ([`SgHullCounts`](crate::SgHullCounts)). Default 65536.
    pub segments: u32,
    /// Pixels that there is room for whose light is gathered at each of them ([`SgHullSettings::error_threshold`]), 1…2^23, 16
    /// bytes each. The hull shades those that find none, and they are counted. Default: all, as far as the range goes.
    pub per_pixel: u32,
    /// Quads of one normal that do not fit, and parts of them, that there is room for to be split in four, 0…2^18, 624 bytes
    /// each. The pixels of those that find none are gathered each for itself, and they are counted. Of no use, and not
    /// allocated, with [`SgHullDescriptor::glossy`](crate::SgHullDescriptor::glossy). Default 32768.
    pub splits: u32,
}

/// Largest room for pixels: a binding of 128 MiB.
const MAX_PER_PIXEL: u32 = 1 << 23;

/// Side of a tile in texels.
pub(crate) const TILE: u32 = 32;

impl SgHullSize {
    /// The default grid and room for a viewport.
    pub const fn new(width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            grid: 640,
            segments: 65536,
            per_pixel: match width.saturating_mul(height) {
                0 => 1,
                pixels if pixels > MAX_PER_PIXEL => MAX_PER_PIXEL,
                pixels => pixels,
            },
            splits: 32768,
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        let smallest = self.width.min(self.height);
        check_setting(smallest > 0, "view size", smallest, "at least 1x1 pixels")?;
        let largest = self.width.max(self.height);
        check_setting(
            largest <= 8192,
            "view size",
            largest,
            "at most 8192x8192 pixels",
        )?;
        check_setting(
            (32..=4096).contains(&self.grid),
            "SgHullSize::grid",
            self.grid,
            "32 to 4096",
        )?;
        check_setting(
            self.segments <= 1 << 20,
            "SgHullSize::segments",
            self.segments,
            "0 to 2^20",
        )?;
        check_setting(
            (1..=MAX_PER_PIXEL).contains(&self.per_pixel),
            "SgHullSize::per_pixel",
            self.per_pixel,
            "1 to 2^23",
        )?;
        check_setting(
            self.splits <= 1 << 18,
            "SgHullSize::splits",
            self.splits,
            "0 to 2^18",
        )
    }

    /// Side of a texel in pixels, 1 to 256.
    pub(crate) fn texel(&self) -> u32 {
        self.width.max(self.height).div_ceil(self.grid)
    }

    /// Texels of the grid.
    pub(crate) fn texels(&self) -> [u32; 2] {
        [self.width, self.height].map(|n| n.div_ceil(self.texel()))
    }

    /// Tiles of the grid.
    pub(crate) fn tiles(&self) -> [u32; 2] {
        self.texels().map(|n| n.div_ceil(TILE))
    }

    /// Room for all segments.
    pub(crate) fn capacity(&self) -> u32 {
        let [x, y] = self.tiles();
        self.segments + x * y
    }
}

/// Settings of the [`SgHull`](crate::SgHull).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SgHullSettings {
    /// Side of the largest quad in texels of the grid: 4, 8, 16 or 32. The paper has 32 of 1024, a whole tile, 1/32 of the
    /// picture; half of it takes four times the vertices and leaves a quarter of the error where light varies smoothly.
    /// Default 4: 1/160 of the picture.
    pub quad: u32,
    /// How far a pixel may lie off its neighbour's tangent plane to be one surface with it, in widths of the view at their
    /// distance, above 0. Smaller follows finer relief with more quads. Default 0.004: two and a half texels of 640.
    pub plane_distance: f32,
    /// How far apart along the camera's axis neighbours on one plane may be to be one surface, in widths of the view at
    /// their distance, above 0. Default 0.1.
    pub gap: f32,
    /// The angle between neighbours' normals up to which they are one surface, radians, 0…π. Corners of rooms are cut
    /// where they are sharper: on either side light comes from another hemisphere. Default 0.25.
    pub normal_angle: f32,
    /// How far a quad's light may be off before it is split, in mean irradiances of the picture, 0 or more. It is judged by how
    /// far the corners' irradiances lie apart, asked for one normal, and by how far the quad's normals do. A quad of one normal
    /// is split in four, and its parts are judged by how far the light found between its corners is from what they had told; of
    /// others, and of parts narrower than 4 pixels, light is gathered at each pixel. At 0 it is at all: the picture is the truth,
    /// as slow as the truth. Infinite: only at those of quads of last resort and tiny ones. Default 0.3: over five of the crate's
    /// scenes at 1280x720 (`cargo bench --bench sg_hull`) the RMSE is at most 2.3 % of the mean, and light is gathered at 5 % of
    /// the pixels at most.
    pub error_threshold: f32,
    /// Reflectance of glossy surfaces seen straight on, linear RGB, 0…1, as
    /// [`HitResolverSettings::f0`](crate::HitResolverSettings::f0); of use with
    /// [`SgHullDescriptor::glossy`](crate::SgHullDescriptor::glossy) alone. Default 0.04, that of glass and most plastics;
    /// metals have their colour.
    pub f0: [f32; 3],
}

impl Default for SgHullSettings {
    fn default() -> Self {
        Self {
            quad: 4,
            plane_distance: 0.004,
            gap: 0.1,
            normal_angle: 0.25,
            error_threshold: 0.3,
            f0: [0.04; 3],
        }
    }
}

impl SgHullSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            [4, 8, 16, 32].contains(&self.quad),
            "SgHullSettings::quad",
            self.quad,
            "4, 8, 16 or 32",
        )?;
        for (field, value) in [
            ("SgHullSettings::plane_distance", self.plane_distance),
            ("SgHullSettings::gap", self.gap),
        ] {
            check_setting(
                value > 0.0 && value.is_finite(),
                field,
                value,
                "finite and above 0",
            )?;
        }
        check_setting(
            (0.0..=PI).contains(&self.normal_angle),
            "SgHullSettings::normal_angle",
            self.normal_angle,
            "0 to pi",
        )?;
        check_setting(
            self.error_threshold >= 0.0,
            "SgHullSettings::error_threshold",
            self.error_threshold,
            "0 or more",
        )?;
        for channel in self.f0 {
            check_setting(
                (0.0..=1.0).contains(&channel),
                "SgHullSettings::f0",
                channel,
                "0 to 1",
            )?;
        }
        Ok(())
    }
}

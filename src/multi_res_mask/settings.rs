//! Public settings and their validation.

use crate::{
    error::{Error, check_setting},
    work::LEVELS,
};

/// How wide a level's blur may reach, pixels of the level.
pub(crate) const MAX_RADIUS: u32 = 8;

/// A sub-image of a [`MultiResMask`](crate::MultiResMask).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MultiResLevel {
    /// Variance σ² of the Gaussian that widens the edges, in squared pixels of the level, 0…16. The kernel ends at
    /// `⌈2σ⌉` pixels, and so does what an edge makes listed. Of the coarsest level it has no meaning: all of it is listed.
    pub variance: f32,
    /// What the mask, of steps of 1/255, is multiplied by to give the level's share in the blend, ≥ 0; from 255 to
    /// `f32::INFINITY` nothing is blended: where a level is listed its image counts alone. Of the coarsest level it has no
    /// meaning.
    pub weight: f32,
    /// A blurred edge up to this is none, 0…1. The paper's, and the default, is 0.
    pub threshold: f32,
}

impl MultiResLevel {
    /// A level with the paper's threshold of 0.
    pub const fn new(variance: f32, weight: f32) -> Self {
        Self {
            variance,
            weight,
            threshold: 0.0,
        }
    }

    /// Half width of the blur, pixels.
    pub(crate) fn radius(&self) -> u32 {
        ((2.0 * self.variance.sqrt()).ceil() as u32).min(MAX_RADIUS)
    }
}

/// Settings of the [`MultiResMask`](crate::MultiResMask). The levels' presets are those of Multi-Resolution Rendering,
/// table 1; the thresholds of edges are this crate's, since the paper names none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MultiResMaskSettings {
    /// The sub-images at 1, 1/2, 1/4 and 1/8 of the width and height; `None` leaves one out. At least one is there, and
    /// the coarsest that is has all its pixels listed.
    pub levels: [Option<MultiResLevel>; LEVELS as usize],
    /// From which distance between the unit normals of two neighbours on there is an edge, above 0, up to infinity for
    /// none; from twice as much on it is a whole one. 2 sin of half the angle: the default of 0.1 is 6 degrees.
    pub normal_threshold: f32,
    /// From which step in depth on there is an edge, as a share of the distance (of an orthographic camera: of the height
    /// of the image in the world), above 0, up to infinity for none; from twice as much on it is a whole one. Measured
    /// by the second difference of one over the view depth, which is 0 on a plane at any angle. Default 0.01.
    pub depth_threshold: f32,
    /// From which difference between neighbours in
    /// [`MultiResMaskInput::shading`](crate::MultiResMaskInput::shading) on there is an edge, above 0, up to infinity for
    /// none; from twice as much on it is a whole one. Default 0.1.
    pub shading_threshold: f32,
}

impl MultiResMaskSettings {
    /// For ambient occlusion (SSAO).
    pub const OCCLUSION: Self = Self::with_levels([
        Some(MultiResLevel::new(0.924, 100.0)),
        Some(MultiResLevel::new(1.848, 50.0)),
        Some(MultiResLevel::new(3.696, 20.0)),
        Some(MultiResLevel::new(0.0, 1.0)),
    ]);
    /// For soft shadows (SSM); give it the hard shadows as
    /// [`MultiResMaskInput::shading`](crate::MultiResMaskInput::shading).
    pub const SHADOW: Self = Self::with_levels([
        Some(MultiResLevel::new(0.924, 1000.0)),
        Some(MultiResLevel::new(1.848, 1000.0)),
        Some(MultiResLevel::new(3.696, 1000.0)),
        Some(MultiResLevel::new(0.0, 1.0)),
    ]);
    /// For indirect light (SSGI): without the sub-image at 1/2.
    pub const INDIRECT: Self = Self::with_levels([
        Some(MultiResLevel::new(0.924, 1000.0)),
        None,
        Some(MultiResLevel::new(0.924, 100.0)),
        Some(MultiResLevel::new(0.0, 1.0)),
    ]);

    /// These levels, and the default thresholds.
    pub const fn with_levels(levels: [Option<MultiResLevel>; LEVELS as usize]) -> Self {
        Self {
            levels,
            normal_threshold: 0.1,
            depth_threshold: 0.01,
            shading_threshold: 0.1,
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.levels.iter().any(Option::is_some),
            "MultiResMaskSettings::levels",
            0,
            "at least one level",
        )?;
        for level in self.levels.iter().flatten() {
            check_setting(
                (0.0..=16.0).contains(&level.variance),
                "MultiResLevel::variance",
                level.variance,
                "0 to 16",
            )?;
            check_setting(
                level.weight >= 0.0,
                "MultiResLevel::weight",
                level.weight,
                "0 to infinity",
            )?;
            check_setting(
                (0.0..=1.0).contains(&level.threshold),
                "MultiResLevel::threshold",
                level.threshold,
                "0 to 1",
            )?;
        }
        for (field, value) in [
            (
                "MultiResMaskSettings::normal_threshold",
                self.normal_threshold,
            ),
            (
                "MultiResMaskSettings::depth_threshold",
                self.depth_threshold,
            ),
            (
                "MultiResMaskSettings::shading_threshold",
                self.shading_threshold,
            ),
        ] {
            check_setting(value > 0.0, field, value, "above 0, up to infinity")?;
        }
        Ok(())
    }

    /// The levels that there are, from the finest on.
    pub(crate) fn present(&self) -> impl Iterator<Item = (u32, MultiResLevel)> {
        (0..)
            .zip(self.levels)
            .filter_map(|(level, settings)| settings.map(|s| (level, s)))
    }

    /// From which mask on a level's image counts alone, of values in steps of 1/255 and halfway between two of them, so that
    /// all who compare with it agree.
    pub(crate) fn whole_from(&self, level: u32) -> f32 {
        let weight = match self.levels[level as usize] {
            Some(own) if level != self.coarsest() => own.weight,
            _ => f32::INFINITY,
        };
        let least = (1..=255_u8).find(|&step| f32::from(step) / 255.0 * weight >= 1.0);
        (least.map_or(256.0, f32::from) - 0.5) / 255.0
    }

    /// The coarsest of them; 0 where there is none.
    pub(crate) fn coarsest(&self) -> u32 {
        self.present().map(|(level, _)| level).last().unwrap_or(0)
    }
}

impl Default for MultiResMaskSettings {
    /// [`MultiResMaskSettings::OCCLUSION`].
    fn default() -> Self {
        Self::OCCLUSION
    }
}

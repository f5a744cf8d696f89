//! What a user turns.

use crate::error::{Error, check_setting};

/// How a pixel's directions are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Sampling {
    /// In proportion to the cosine to the normal: what a matt receiver weighs its light by.
    #[default]
    Cosine,
    /// Uniform over the hemisphere, as in the paper for ambient occlusion. The Reconstructor weighs the hits.
    Uniform,
}

impl Sampling {
    /// The shader's number for it.
    pub(crate) fn code(self) -> u32 {
        match self {
            Self::Cosine => 0,
            Self::Uniform => 1,
        }
    }
}

/// Settings of the [`BouncedZBuffer`](crate::BouncedZBuffer).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BouncedSettings {
    /// Directions a pixel, 0…64. Noise falls with the root of their number times that of the pixels that the
    /// Reconstructor gathers, and somewhat faster, since both are stratified; the time to trace grows with it. Numbers
    /// with two nearly equal factors are stratified best: 4, 6, 9, 12, 16, 20, 25, 36, 49, 64. With 0 nothing is
    /// traced and everything is open and dark. Default 16.
    pub directions: u32,
    /// The distance beyond which hits do not count, world units, ≥ 0; `f32::INFINITY` (default) for none.
    pub radius: f32,
    /// Which set of directions to take, 0…2²⁰. Another number in each frame gives directions that are independent of
    /// the old ones: the noise of a mean over frames falls with the root of their number. Default 0.
    pub frame: u32,
    /// Radiance that comes from where nothing is hit, linear RGB, W/(m² sr), each 0…1e18; of use with
    /// [`Payload::Radiance`](crate::Payload::Radiance) alone. Default black.
    pub background: [f32; 3],
}

/// The most directions.
pub(crate) const MAX_DIRECTIONS: u32 = 64;

impl Default for BouncedSettings {
    fn default() -> Self {
        Self {
            directions: 16,
            radius: f32::INFINITY,
            frame: 0,
            background: [0.0; 3],
        }
    }
}

impl BouncedSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.directions <= MAX_DIRECTIONS,
            "BouncedSettings::directions",
            self.directions,
            "0 to 64",
        )?;
        check_setting(
            self.radius >= 0.0,
            "BouncedSettings::radius",
            self.radius,
            "0 to infinity",
        )?;
        check_setting(
            self.frame <= 1 << 20,
            "BouncedSettings::frame",
            self.frame,
            "0 to 2^20",
        )?;
        for channel in self.background {
            check_setting(
                (0.0..=1e18).contains(&channel),
                "BouncedSettings::background",
                channel,
                "0 to 1e18",
            )?;
        }
        Ok(())
    }
}

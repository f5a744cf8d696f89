//! Public settings and their validation.

use crate::error::{Error, check_setting};

/// Settings of the [`ShellSplatter`](crate::ShellSplatter).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatSettings {
    /// Number of interleaved levels, 1…8. With one every surfel is evaluated at every pixel in reach; each further one
    /// doubles the reach at the price of about the level before it, and adds noise that the Reconstructor smooths.
    /// Default 5.
    pub levels: u32,
    /// The contribution of one surfel below which it moves on to the next level, > 0. Smaller is slower and less
    /// noisy: the cost of a level grows with its inverse. Values of 1 and more leave all to the last level.
    /// Default 0.01: shells of 10, 20, 40 … surfel radii.
    pub epsilon: f32,
    /// The distance beyond which nothing contributes, world units, ≥ 0; `f32::INFINITY` (default) for none. Nothing is
    /// evaluated beyond it.
    pub radius: f32,
    /// Whether the last level has no outer bound, so that everything contributes, however far. Without, the effect
    /// ends at `max_distance · 2^(levels − 1)`, as in the paper, and surfels out of reach can be left out. Default true.
    pub unbounded: bool,
    /// Which of the random permutations deals pixels to sub-buffers, 0…2²⁴. Another one in each frame makes the noise of the
    /// levels independent between frames, for a temporal filter of the caller's. Default 0.
    pub seed: u32,
}

/// The most levels that there can be: 4^7 sub-buffers.
pub(crate) const MAX_LEVELS: u32 = 8;

/// The smallest threshold that is used; below it a level reaches a million radii.
pub(crate) const MIN_EPSILON: f32 = 1e-12;

impl Default for SplatSettings {
    fn default() -> Self {
        Self {
            levels: 5,
            epsilon: 0.01,
            radius: f32::INFINITY,
            unbounded: true,
            seed: 0,
        }
    }
}

impl SplatSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            (1..=MAX_LEVELS).contains(&self.levels),
            "SplatSettings::levels",
            self.levels,
            "1 to 8",
        )?;
        check_setting(
            self.epsilon > 0.0,
            "SplatSettings::epsilon",
            self.epsilon,
            "above 0",
        )?;
        check_setting(
            self.radius >= 0.0,
            "SplatSettings::radius",
            self.radius,
            "0 to infinity",
        )?;
        check_setting(
            self.seed <= 1 << 24,
            "SplatSettings::seed",
            self.seed,
            "0 to 2^24",
        )
    }
}

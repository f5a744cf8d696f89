//! Public settings and their validation.

use crate::error::{Error, check_setting};

/// Settings of the [`TemporalAccumulator`](crate::TemporalAccumulator).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TemporalSettings {
    /// How many frames the mean is over, 1 or more: from then on a frame counts `1 / max_frames` and the mean forgets
    /// exponentially. At 1 there is no history and the picture goes through. At `u32::MAX` it is the true mean over all
    /// frames, which converges where nothing moves (up to 2²⁴ frames, beyond which a mean in f32 stands still).
    /// Smaller follows changing light sooner and leaves more noise: its standard deviation falls to
    /// `1 / √(2 max_frames − 1)` of a frame's. Default 32.
    pub max_frames: u32,
    /// How far the history's distance from the previous eye may be off the reprojected point's, as a share of it, 0 or
    /// more. An orthographic camera is taken to be as far off as its picture is high. What is off by more is another surface,
    /// unless it lies within half a pixel's side of the point's plane, as neighbours at a grazing angle do. Smaller keeps less
    /// history of what moves towards the eye; larger lets surfaces ghost on those just behind them. Default 0.02.
    pub depth_tolerance: f32,
    /// Least cosine between the pixel's normal and the history's, −1…1. At −1 normals do not matter. Default 0.9.
    pub normal_tolerance: f32,
    /// How strongly the history is held to this frame's picture, 0…100: it is drawn towards the mean of the 3 × 3
    /// pixels around to within `1 / clamping` of their standard deviations (variance clipping: Salvi, *An Excursion in
    /// Temporal Supersampling*, 2016). Larger lets changed light through sooner.
    ///
    /// It costs bias: the history is cut to what nine pixels of one frame show. A pixel that differs from those around
    /// it is drawn to them, and noise that is rare and strong to the value between its strokes. Measured at 32 frames
    /// (`cargo test --test passes clamping`): uniform noise in 0…1 leaves an RMSE of 0.038 at 0, 0.040 at
    /// 0.5 and 0.049 at 1; where one value in twenty is 1 and the others are 0, the mean is 0.050 at 0 and 0.002 at 0.5.
    /// Four frames after such a light fell to a tenth the RMSE is 0.40, 0.036 and 0.016. 0 leaves the history alone,
    /// without bias. Default 0.
    pub clamping: f32,
}

impl Default for TemporalSettings {
    fn default() -> Self {
        Self {
            max_frames: 32,
            depth_tolerance: 0.02,
            normal_tolerance: 0.9,
            clamping: 0.0,
        }
    }
}

impl TemporalSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.max_frames >= 1,
            "TemporalSettings::max_frames",
            self.max_frames,
            "1 or more",
        )?;
        check_setting(
            self.depth_tolerance >= 0.0 && self.depth_tolerance.is_finite(),
            "TemporalSettings::depth_tolerance",
            self.depth_tolerance,
            "0 or more, finite",
        )?;
        check_setting(
            (-1.0..=1.0).contains(&self.normal_tolerance),
            "TemporalSettings::normal_tolerance",
            self.normal_tolerance,
            "-1 to 1",
        )?;
        check_setting(
            (0.0..=100.0).contains(&self.clamping),
            "TemporalSettings::clamping",
            self.clamping,
            "0 to 100",
        )
    }
}

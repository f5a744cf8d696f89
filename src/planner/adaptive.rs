//! Settings that follow measured times, without swinging between two of them.

use crate::error::{Error, check_setting};

/// How an [`AdaptiveQuality`] follows times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdaptiveSettings {
    /// The time that should not be exceeded, milliseconds, above 0.
    pub budget_ms: f64,
    /// Which part of the budget the next dearer rung may be expected to take, 0.1…1. Smaller leaves more room for noise and
    /// for load that comes and goes. Default 0.85.
    pub headroom: f64,
    /// How many frames a change is thought over, 1…1000: as many in a row must be over the budget, or leave room, and their
    /// median counts. Default 8.
    pub frames: u32,
}

impl AdaptiveSettings {
    /// For a budget in milliseconds.
    pub fn new(budget_ms: f64) -> Self {
        Self {
            budget_ms,
            headroom: 0.85,
            frames: 8,
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.budget_ms > 0.0,
            "AdaptiveSettings::budget_ms",
            self.budget_ms,
            "above 0, to infinity",
        )?;
        check_setting(
            (0.1..=1.0).contains(&self.headroom),
            "AdaptiveSettings::headroom",
            self.headroom,
            "0.1 to 1",
        )?;
        check_setting(
            (1..=1000).contains(&self.frames),
            "AdaptiveSettings::frames",
            self.frames,
            "1 to 1000",
        )
    }
}

/// Chooses a rung, frame by frame, such that measured times keep within a budget: of settings from cheap to dear whose times
/// are known relative to each other, as [`Plan::weighed`](super::Plan::weighed) lists them.
///
/// A rung is left for a cheaper one when the median of the last frames is over the budget, and for a dearer one when that one is
/// expected to fit with some room. A dearer rung that turns out too dear is not tried again before twice as many frames have
/// passed as the last time, so that a load at the edge of the budget does not make it swing.
///
/// ```
/// use deep_screen_space::planner::{AdaptiveQuality, AdaptiveSettings};
///
/// // Three settings, of which each takes twice as long as the one before, within 4 ms.
/// let mut quality = AdaptiveQuality::new(AdaptiveSettings::new(4.0), &[1.0, 2.0, 4.0])?;
/// // On this device the cheapest takes half a millisecond: there is time for the dearest.
/// let mut rung = quality.rung();
/// for _frame in 0..1000 {
///     rung = quality.measured([0.5, 1.0, 2.0][rung]);
/// }
/// assert_eq!(rung, 2);
/// # Ok::<(), deep_screen_space::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct AdaptiveQuality {
    settings: AdaptiveSettings,
    /// Times of the rungs relative to each other.
    costs: Vec<f64>,
    rung: usize,
    /// Times of this rung's last frames.
    times: Vec<f64>,
    /// Frames on this rung.
    age: u32,
    /// How many frames have to pass before a dearer rung is tried.
    patience: u32,
}

/// [`AdaptiveQuality`] waits no longer than this many times its frames before it tries a dearer rung again.
const MOST_PATIENCE: u32 = 64;

impl AdaptiveQuality {
    /// Begins on the cheapest rung. `costs` are the rungs' times from the cheapest, each above 0 and at least that before it.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings out of range, for no rungs, and for costs that are not finite or do not rise.
    pub fn new(settings: AdaptiveSettings, costs: &[f64]) -> Result<Self, Error> {
        settings.validate()?;
        check_setting(
            !costs.is_empty(),
            "AdaptiveQuality costs",
            0.0,
            "at least one rung",
        )?;
        let mut before = f64::MIN_POSITIVE;
        for &cost in costs {
            check_setting(
                cost.is_finite() && cost >= before,
                "AdaptiveQuality costs",
                cost,
                "above 0, finite, and at least that of the rung before",
            )?;
            before = cost;
        }
        Ok(Self {
            patience: settings.frames,
            settings,
            costs: costs.to_vec(),
            rung: 0,
            times: Vec::new(),
            age: 0,
        })
    }

    /// The rung to render the next frame by, from 0.
    pub fn rung(&self) -> usize {
        self.rung
    }

    /// Takes the time of a frame that was rendered by [`rung`](Self::rung), milliseconds, and returns the rung of the next.
    /// Times that are not finite or negative are left out.
    pub fn measured(&mut self, milliseconds: f64) -> usize {
        if !milliseconds.is_finite() || milliseconds < 0.0 {
            return self.rung;
        }
        let frames = self.settings.frames as usize;
        if self.times.len() == frames {
            self.times.remove(0);
        }
        self.times.push(milliseconds);
        self.age = self.age.saturating_add(1);
        if self.times.len() < frames {
            return self.rung;
        }
        let median = self.median();
        if median > self.settings.budget_ms {
            self.cheaper(median);
        } else {
            self.dearer(median);
        }
        self.rung
    }

    fn median(&self) -> f64 {
        let mut times = self.times.clone();
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    }

    /// The dearest rung that is expected to fit, or the cheapest.
    fn cheaper(&mut self, median: f64) {
        if self.rung == 0 {
            return;
        }
        // It was just tried: the next try may wait.
        if self.age <= 2 * self.settings.frames {
            self.patience = self
                .patience
                .saturating_mul(2)
                .min(MOST_PATIENCE * self.settings.frames);
        }
        let fits = |&rung: &usize| median * self.expected(rung) <= self.settings.budget_ms;
        let rung = (0..self.rung).rev().find(fits).unwrap_or(0);
        self.to(rung);
    }

    fn dearer(&mut self, median: f64) {
        let next = self.rung + 1;
        if next >= self.costs.len() {
            return;
        }
        // What has held for long is forgiven.
        if self.age > 2 * MOST_PATIENCE * self.settings.frames {
            self.patience = self.settings.frames;
        }
        let room = self.settings.headroom * self.settings.budget_ms;
        if self.age >= self.patience && median * self.expected(next) <= room {
            self.to(next);
        }
    }

    /// A rung's time in units of the present one's.
    fn expected(&self, rung: usize) -> f64 {
        self.costs[rung] / self.costs[self.rung]
    }

    fn to(&mut self, rung: usize) {
        self.rung = rung;
        self.times.clear();
        self.age = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of a load that the rungs' costs are multiplied with, and noise up to a share of each.
    fn simulate(load: impl Fn(u32) -> f64, noise: f64, frames: u32) -> (Vec<usize>, Vec<f64>) {
        let costs = [1.0, 1.4, 2.0, 3.0, 5.0, 9.0];
        let mut adaptive =
            AdaptiveQuality::new(AdaptiveSettings::new(10.0), &costs).expect("valid settings");
        let mut state = 1_u32;
        let mut random = move || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            f64::from(state >> 8) / f64::from(1 << 24)
        };
        let mut rungs = Vec::new();
        let mut times = Vec::new();
        for frame in 0..frames {
            let rung = adaptive.rung();
            // Most frames are a little off, some far: a machine has other things to do.
            let hiccup = if random() < 0.03 { 3.0 } else { 1.0 };
            let time = costs[rung] * load(frame) * hiccup * (1.0 + noise * (2.0 * random() - 1.0));
            rungs.push(rung);
            times.push(time);
            adaptive.measured(time);
        }
        (rungs, times)
    }

    fn changes(rungs: &[usize]) -> usize {
        rungs.windows(2).filter(|pair| pair[0] != pair[1]).count()
    }

    #[test]
    fn a_steady_load_gets_the_dearest_rung_that_fits() {
        let (rungs, times) = simulate(|_| 2.0, 0.15, 2000);
        // 3.0 × 2 = 6 fits, 5.0 × 2 = 10 leaves no room.
        assert!(
            rungs[200..].iter().all(|&rung| rung == 3),
            "{:?}",
            &rungs[..200]
        );
        let over = times[200..].iter().filter(|&&time| time > 10.0).count();
        assert!(over < 100, "{over} of 1800 frames over the budget");
    }

    #[test]
    fn load_that_rises_and_falls_is_followed_within_frames() {
        let step = |frame: u32| {
            if (600..1200).contains(&frame) {
                6.0
            } else {
                1.2
            }
        };
        let (rungs, _) = simulate(step, 0.1, 2400);
        assert_eq!(rungs[599], 4, "6 of 10 ms, and 10.8 does not fit");
        assert!(
            rungs[620..1200].iter().all(|&rung| rung <= 1),
            "{:?}",
            &rungs[600..640]
        );
        assert!(rungs[1800..].iter().all(|&rung| rung == 4));
    }

    #[test]
    fn a_load_at_the_edge_does_not_swing() {
        // By its costs rung 3 is expected at 8.4 ms and takes 10.5: the costs that it was given are off.
        let costs = [1.0, 1.4, 2.0, 3.0];
        let truth = [2.8, 3.92, 5.6, 10.5];
        let mut adaptive =
            AdaptiveQuality::new(AdaptiveSettings::new(10.0), &costs).expect("valid settings");
        let mut rungs = Vec::new();
        for _ in 0..4000 {
            let rung = adaptive.rung();
            rungs.push(rung);
            adaptive.measured(truth[rung]);
        }
        assert!(changes(&rungs) < 30, "{} changes", changes(&rungs));
        let over = rungs.iter().filter(|&&rung| rung == 3).count();
        assert!(over < 200, "{over} of 4000 frames over the budget");
    }

    #[test]
    fn what_no_rung_meets_stays_on_the_cheapest() {
        let (rungs, _) = simulate(|_| 100.0, 0.1, 300);
        assert!(rungs.iter().all(|&rung| rung == 0));
        let (rungs, _) = simulate(|_| f64::NAN, 0.1, 300);
        assert!(rungs.iter().all(|&rung| rung == 0));
    }

    #[test]
    fn misuse_is_a_typed_error() {
        let of = |costs: &[f64]| AdaptiveQuality::new(AdaptiveSettings::new(10.0), costs);
        for costs in [
            &[][..],
            &[0.0],
            &[2.0, 1.0],
            &[1.0, f64::NAN],
            &[1.0, f64::INFINITY],
        ] {
            assert!(matches!(of(costs), Err(Error::Setting { .. })), "{costs:?}");
        }
        for budget in [0.0, -1.0, f64::NAN] {
            let settings = AdaptiveSettings::new(budget);
            assert!(AdaptiveQuality::new(settings, &[1.0]).is_err(), "{budget}");
        }
    }
}

//! How the error falls along each method's settings: `cargo bench --bench trade` measures it, and prints this table.

use super::MethodKind;

/// Rays per pixel of the rungs.
pub(super) const RAYS: [u32; 7] = [1, 2, 4, 8, 16, 32, 64];

/// What is as good as no error.
const LEAST: f64 = 1e-6;

/// One method's errors, from its cheapest rung to its dearest.
#[derive(Clone, Copy, Debug)]
pub(super) struct Curve {
    /// Root mean square errors in units of that of the first rung that a calibration renders: geometric means over scenes.
    pub errors: &'static [f64],
    /// That rung's own error where nothing is known of the scene: the geometric mean over scenes.
    pub typical: f64,
    /// The same in units of its difference from 64 rays per pixel.
    pub of_difference: f64,
}

impl Curve {
    /// The error of a setting whose work lies among those of the rungs: straight between two, both by their logarithms.
    pub fn at(&self, works: &[f64], work: f64) -> f64 {
        let above = works
            .partition_point(|&w| w < work)
            .clamp(1, works.len().max(2) - 1);
        let (x, y) = (&works[above - 1..=above], &self.errors[above - 1..=above]);
        let share = ((work / x[0]).ln() / (x[1] / x[0]).ln()).clamp(0.0, 1.0);
        y[0] * (y[1] / y[0]).powf(share)
    }

    /// The same through the errors that the calibrated rungs were found to have: the curve as steep as it takes.
    pub fn through(&self, [cheap, dear]: [f64; 2], works: &[f64], work: f64) -> f64 {
        let [cheap, dear] = [cheap, dear].map(|error| error.max(LEAST));
        let last = self.errors[self.errors.len() - 1];
        // From the cheap rung to the dear one 0 to 1.
        let along = (self.at(works, work).ln() / last.ln()).clamp(-3.0, 1.0);
        cheap * (dear / cheap).powf(along)
    }
}

/// The methods of an effect.
#[derive(Clone, Copy, Debug)]
pub(super) struct Curves {
    pub rays: Curve,
    pub splats: Option<Curve>,
    pub obscurance: Option<Curve>,
}

impl Curves {
    /// That of one method, where it was measured.
    pub fn of(&self, kind: MethodKind) -> Option<Curve> {
        match kind {
            MethodKind::Rays => Some(self.rays),
            MethodKind::Splats => self.splats,
            MethodKind::Obscurance => self.obscurance,
        }
    }
}

/// Visibility within a radius.
pub(super) const WITHIN_RADIUS: Curves = Curves {
    rays: Curve {
        errors: &[1.519, 1.324, 1.0, 0.849, 0.700, 0.598, 0.514],
        typical: 0.0268,
        of_difference: 1.403,
    },
    splats: Some(Curve {
        errors: &[1.0, 0.823, 0.783],
        typical: 0.0701,
        of_difference: 1.059,
    }),
    obscurance: Some(Curve {
        errors: &[1.0, 0.978, 0.952],
        typical: 0.1226,
        of_difference: 1.027,
    }),
};

/// Visibility without a radius.
pub(super) const UNBOUNDED: Curves = Curves {
    rays: Curve {
        errors: &[1.604, 1.391, 1.0, 0.843, 0.693, 0.595, 0.520],
        typical: 0.0255,
        of_difference: 1.296,
    },
    splats: Some(Curve {
        errors: &[1.0, 0.858, 0.830],
        typical: 0.0756,
        of_difference: 1.036,
    }),
    obscurance: None,
};

/// One diffuse bounce of light.
pub(super) const LIGHT: Curves = Curves {
    rays: Curve {
        errors: &[1.717, 1.455, 1.0, 0.826, 0.659, 0.526, 0.431],
        typical: 0.3918,
        of_difference: 1.149,
    },
    splats: None,
    obscurance: None,
};

/// What a sky gives, of rungs from 2 rays on: of one that is dim but for a sun of 1° about its middle, which gives a surface that
/// faces it about four times what the rest does; within a radius and without one.
pub(super) const SKY: Curves = Curves {
    rays: Curve {
        errors: &[1.194, 1.0, 0.833, 0.539, 0.289, 0.213],
        typical: 0.1165,
        of_difference: 1.081,
    },
    splats: Some(Curve {
        errors: &[1.0, 0.894, 0.847],
        typical: 0.2109,
        of_difference: 0.978,
    }),
    obscurance: None,
};

/// Bent normals, of rungs from 4 rays on, within a radius and without one: errors are degrees.
pub(super) const BENT: Curves = Curves {
    rays: Curve {
        errors: &[1.0, 0.852, 0.503, 0.391, 0.265],
        typical: 5.8309,
        of_difference: 1.028,
    },
    splats: Some(Curve {
        errors: &[1.0, 0.824, 0.770],
        typical: 18.0645,
        of_difference: 1.006,
    }),
    obscurance: None,
};

/// One glossy bounce of light, of roughness 0.3 and of 1, at 96 x 64 pixels.
pub(super) const GLOSSY: Curves = Curves {
    rays: Curve {
        errors: &[1.454, 1.420, 1.0, 0.703, 0.552, 0.420, 0.321],
        typical: 1.0114,
        of_difference: 1.091,
    },
    splats: Some(Curve {
        errors: &[1.0, 0.815, 0.743],
        typical: 1.2831,
        of_difference: 1.014,
    }),
    obscurance: None,
};

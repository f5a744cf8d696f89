//! Spherical Gaussians `μ e^(λ (⟨φ, ω⟩ − 1))`: light from around an axis φ, the narrower the larger the sharpness λ
//! (`wgsl/common/spherical_gaussian.wgsl`).
//!
//! All functions hold for every λ from 0 to ∞, amplitudes of 0 included: what the closed forms of Meder and Brüderlin,
//! *Screen Space Approximate Gaussian Hulls* (2018), lose to cancellation or overflow is had from series, or from forms
//! that have neither. A sharpness above [`MAX_SHARPNESS`] counts as that, one that is negative or no number as 0.
//!
//! In f32 ([`SphericalGaussian`], [`LightMoments`]) and in f64 ([`DSphericalGaussian`], [`DLightMoments`]).

/// What stands for an infinite sharpness.
pub const MAX_SHARPNESS: f64 = 1e18;

/// The sharpest lobe that an estimate from light samples gives, that of a single light: 1/e of its peak is 0.08° off its
/// axis. In f32 a resultant's length is known to 6e-8, a sharper one would be rounding.
pub const MAX_ESTIMATE: f64 = 1e6;

/// How a lobe's sharpness follows from the length r of its samples' mean direction, 0…1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Estimate {
    /// The lobe whose own mean direction has that length, `coth λ − 1/λ = r` (the estimate of a von Mises-Fisher
    /// distribution), by Kröger's closed form (*Simple, admissible, and accurate approximants of the inverse Langevin and
    /// Brillouin functions*, 2015), within 0.3 %.
    #[default]
    Moments,
    /// `λ = r / (1 − r)` (Meder and Brüderlin, equation 4, after Toksvig). Close for narrow lobes, a third of the moments'
    /// for broad ones.
    Toksvig,
}

/// One precision of all there is.
macro_rules! spherical_gaussian {
    ($module:ident, $float:ident, $vector:ty, $terms:literal, $lobe:ident, $moments:ident, $precision:literal) => {
        #[doc = concat!("A spherical Gaussian, in ", $precision, ".")]
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $lobe {
            /// φ, a unit vector.
            pub axis: $vector,
            /// λ, 0 (the same from everywhere) to ∞.
            pub sharpness: $float,
            /// μ, the radiance along the axis, at least 0.
            pub amplitude: $float,
        }

        impl $lobe {
            /// No light.
            pub const ZERO: Self = Self {
                axis: <$vector>::Z,
                sharpness: 0.0,
                amplitude: 0.0,
            };

            /// The radiance from a direction, a unit vector.
            ///
            /// From the chord between both: `1 − ⟨φ, ω⟩` has lost its digits where they are close.
            pub fn evaluate(&self, direction: $vector) -> $float {
                let versine = 0.5 * (direction - self.axis).length_squared();
                self.amplitude * (-$module::clamp_sharpness(self.sharpness) * versine).exp()
            }

            /// `∫ G dω` over the sphere, `2π μ / λ (1 − e^(−2λ))` (equation 2).
            pub fn integral(&self) -> $float {
                self.amplitude * $module::integral(self.sharpness)
            }

            /// The lobe that is the product of two, exactly (equation 3). Its amplitude's exponent `λ₃ − λ₁ − λ₂` is taken
            /// as `−2 λ₁ λ₂ (1 − ⟨φ₁, φ₂⟩) / (λ₁ + λ₂ + λ₃)`, which does not cancel.
            #[must_use]
            pub fn product(&self, other: &Self) -> Self {
                let (first, second) = (
                    $module::clamp_sharpness(self.sharpness),
                    $module::clamp_sharpness(other.sharpness),
                );
                let sum = self.axis * first + other.axis * second;
                let sharpness = sum.length();
                let versine = 0.5 * (self.axis - other.axis).length_squared();
                let total = first + second + sharpness;
                let exponent = if total > 0.0 {
                    -2.0 * first * (second / total) * versine
                } else {
                    0.0
                };
                Self {
                    axis: if sharpness > 0.0 {
                        sum / sharpness
                    } else {
                        self.axis
                    },
                    sharpness,
                    amplitude: self.amplitude * other.amplitude * exponent.exp(),
                }
            }

            /// Irradiance of a surface with a unit normal, `∫ G ⟨n, ω⟩⁺ dω`, by [`Self::cosine_integral`].
            pub fn irradiance(&self, normal: $vector) -> $float {
                self.amplitude * Self::cosine_integral(normal.dot(self.axis), self.sharpness)
            }

            /// `∫ e^(λ (⟨φ, ω⟩ − 1)) ⟨n, ω⟩⁺ dω` where `cosine` is ⟨n, φ⟩, within 3.1e-4 of its largest value over all
            /// angles, whatever λ.
            ///
            /// The part that is odd in the cosine is exact, `½ (A_u − A_b) cosine`: it is half the integral with a cosine
            /// that is not clamped. The even part, half the integral of `|⟨n, ω⟩|`, is exact along the axis and at the
            /// horizon ([`Self::horizon`]), and between them follows the convolution of |x| with a Gaussian,
            /// `x erf(t x) + (e^(−t²x²) − 1) / (t √π)`, of a width fitted to λ.
            ///
            /// Costs three exponentials, two square roots and five divisions.
            pub fn cosine_integral(cosine: $float, sharpness: $float) -> $float {
                let cosine = cosine.clamp(-1.0, 1.0);
                let sharpness = $module::clamp_sharpness(sharpness);
                let (upper, lower) = (Self::upper(sharpness), Self::lower(sharpness));
                let odd = 0.5 * (upper - lower) * cosine;
                let axial = 0.5 * (upper + lower);
                let horizon = Self::horizon(sharpness);
                let even = horizon + (axial - horizon) * $module::bend(cosine.abs(), sharpness);
                (odd + even).min(upper).max(lower)
            }

            /// The same by the closed form of Meder and Brüderlin (equations 15 to 18), within 9e-3 of its largest value.
            /// Below the horizon of a sharp lobe it is too large by a factor, 10 at λ = 50.
            ///
            /// Costs two exponentials, one square root and five divisions.
            pub fn cosine_integral_logistic(cosine: $float, sharpness: $float) -> $float {
                let cosine = cosine.clamp(-1.0, 1.0);
                let sharpness = $module::clamp_sharpness(sharpness);
                let steepness = 2.1007 * sharpness.sqrt() * (sharpness / (sharpness + 4.4653));
                let height = 1.0 / (0.2958 * steepness + 0.5033);
                let share = height / ((cosine.abs() * steepness).min(80.0).exp() + 1.0);
                let curve = share * (0.5 * cosine + 0.5) + (1.0 - share) * cosine.max(0.0);
                curve * Self::upper(sharpness) + (1.0 - curve) * Self::lower(sharpness)
            }

            /// `A_u`: the cosine integral where the normal is the axis, `2π (e^(−λ) − 1 + λ) / λ²` (equation 9).
            pub fn upper(sharpness: $float) -> $float {
                2.0 * $module::PI * $module::second_remainder($module::clamp_sharpness(sharpness))
            }

            /// `A_b`: the cosine integral where the normal is opposite to the axis, `2π e^(−2λ) (e^λ − 1 − λ) / λ²`
            /// (equation 10).
            pub fn lower(sharpness: $float) -> $float {
                let sharpness = $module::clamp_sharpness(sharpness);
                2.0 * $module::PI * (-sharpness).exp() * $module::first_moment(sharpness)
            }

            /// The cosine integral where the normal is perpendicular to the axis, `2π e^(−λ) I₁(λ) / λ`: a ring of
            /// directions of equal height contributes `2π I₀(λ s) s ds`. Within 6e-7, by the polynomials of Abramowitz and
            /// Stegun, 9.8.3 and 9.8.4.
            pub fn horizon(sharpness: $float) -> $float {
                let x = $module::clamp_sharpness(sharpness);
                2.0 * $module::PI
                    * if x < 3.75 {
                        let y = (x / 3.75) * (x / 3.75);
                        (-x).exp()
                            * $module::horner(
                                y,
                                &[
                                    0.5,
                                    0.878_905_94,
                                    0.514_988_69,
                                    0.150_849_34,
                                    0.026_587_33,
                                    0.003_015_32,
                                    0.000_324_11,
                                ],
                            )
                    } else {
                        $module::horner(
                            3.75 / x,
                            &[
                                0.398_942_3,
                                -0.039_880_24,
                                -0.003_620_18,
                                0.001_638_01,
                                -0.010_315_55,
                                0.022_829_67,
                                -0.028_953_12,
                                0.017_876_54,
                                -0.004_200_59,
                            ],
                        ) / (x * x.sqrt())
                    }
            }
        }

        /// Light samples added up: `Σ μ ω` and `Σ μ`. Any number of lights is as large as one. What is interpolated between
        /// places is best interpolated in this form: sums of light are linear, lobes are not.
        #[doc = concat!("\n\nIn ", $precision, ".")]
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $moments {
            /// The sum of directions times amounts.
            pub vector: $vector,
            /// The sum of amounts.
            pub total: $float,
        }

        impl $moments {
            /// No light.
            pub const ZERO: Self = Self {
                vector: <$vector>::ZERO,
                total: 0.0,
            };

            /// Adds an amount of light (irradiance at normal incidence, at least 0) from a direction (a unit vector).
            pub fn add(&mut self, direction: $vector, amount: $float) {
                self.vector += direction * amount;
                self.total += amount;
            }

            /// The length r of the mean direction, 0…1.
            pub fn resultant(&self) -> $float {
                if self.total > 0.0 {
                    // Divided first: squares of large sums leave the range of f32.
                    (self.vector / self.total).length().min(1.0)
                } else {
                    0.0
                }
            }

            /// The lobe with the same total, about the mean direction. No light gives a zero lobe, one light a lobe of
            /// [`MAX_ESTIMATE`], light that cancels out (r = 0) one that is the same all around.
            pub fn lobe(&self, estimate: Estimate) -> $lobe {
                if self.total <= 0.0 {
                    return $lobe::ZERO;
                }
                let r = self.resultant();
                let sharpness = $module::estimate_sharpness(r, estimate);
                $lobe {
                    axis: (self.vector / self.total).normalize_or(<$vector>::Z),
                    sharpness,
                    amplitude: self.total / $module::integral(sharpness),
                }
            }
        }

        mod $module {
            pub(super) use std::$float::consts::PI;

            use super::{Estimate, MAX_ESTIMATE, MAX_SHARPNESS};

            pub(super) fn clamp_sharpness(sharpness: $float) -> $float {
                if sharpness > 0.0 {
                    sharpness.min(MAX_SHARPNESS as $float)
                } else {
                    0.0
                }
            }

            /// `c₀ + x (c₁ + x (…))`.
            pub(super) fn horner(x: $float, coefficients: &[$float]) -> $float {
                coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
            }

            /// `(1 − e^(−x)) / x`.
            pub(super) fn first_remainder(x: $float) -> $float {
                if x > 0.0 { -(-x).exp_m1() / x } else { 1.0 }
            }

            /// `(e^(−x) − 1 + x) / x²`. Below 1, where that cancels, its Taylor series.
            pub(super) fn second_remainder(x: $float) -> $float {
                if x < 1.0 {
                    (3_u8..$terms)
                        .rev()
                        .fold(1.0, |sum, n| 1.0 - sum * x / $float::from(n))
                        / 2.0
                } else {
                    (1.0 - first_remainder(x)) / x
                }
            }

            /// `(1 − (1 + x) e^(−x)) / x² = ∫₀¹ s e^(−x s) ds`. Below 1 by the series of `e^(−x) (e^x − 1 − x) / x²`.
            pub(super) fn first_moment(x: $float) -> $float {
                if x < 1.0 {
                    let series = (3_u8..$terms)
                        .rev()
                        .fold(1.0, |sum, n| 1.0 + sum * x / $float::from(n));
                    (-x).exp() * series / 2.0
                } else {
                    (first_remainder(x) - (-x).exp()) / x
                }
            }

            /// `∫ e^(λ (⟨φ, ω⟩ − 1)) dω` over the sphere.
            pub(super) fn integral(sharpness: $float) -> $float {
                4.0 * PI * first_remainder(2.0 * clamp_sharpness(sharpness))
            }

            /// λ of a resultant's length.
            pub(super) fn estimate_sharpness(r: $float, estimate: Estimate) -> $float {
                let r = r.clamp(0.0, 1.0);
                let r2 = r * r;
                let (above, below) = match estimate {
                    Estimate::Moments => (
                        r * (3.0 - 0.2 * r2 * (6.0 + r2 * (1.0 - 2.0 * r2))),
                        1.0 - r2,
                    ),
                    Estimate::Toksvig => (r, 1.0 - r),
                };
                (above / below.max(1.0 / MAX_SHARPNESS as $float)).min(MAX_ESTIMATE as $float)
            }

            /// From 0 at the horizon to 1 along the axis: a Gaussian's width of |x|, bent at x = 0.
            pub(super) fn bend(x: $float, sharpness: $float) -> $float {
                // λ² / 12 for broad lobes, λ / 2 for narrow ones.
                let width2 = sharpness * (sharpness + 3.12)
                    / (2.0 * sharpness + 7.8 + 37.44 / sharpness.max(1e-3));
                // For less it is x² to rounding, while what the closed form subtracts is all rounding.
                let t = width2.sqrt().max(0.03);
                let rounded = |x: $float| {
                    let decay = (-(t * x) * (t * x)).exp();
                    x * erf(t * x, decay) + (decay - 1.0) / (t * PI.sqrt())
                };
                rounded(x) / rounded(1.0)
            }

            /// The error function of x ≥ 0 within 1.5e-7, given `e^(−x²)` (Abramowitz and Stegun, 7.1.26).
            pub(super) fn erf(x: $float, decay: $float) -> $float {
                let y = 1.0 / (1.0 + 0.327_591_1 * x);
                1.0 - decay
                    * y
                    * horner(
                        y,
                        &[
                            0.254_829_6,
                            -0.284_496_75,
                            1.421_413_7,
                            -1.453_152,
                            1.061_405_4,
                        ],
                    )
            }
        }
    };
}

spherical_gaussian!(
    single,
    f32,
    glam::Vec3,
    13,
    SphericalGaussian,
    LightMoments,
    "f32"
);
spherical_gaussian!(
    double,
    f64,
    glam::DVec3,
    21,
    DSphericalGaussian,
    DLightMoments,
    "f64"
);

//! Visibility of the sky from a point, estimated with rays.
//!
//! V = 1/π ∫ visible(ω) ⟨Ns, ω⟩ dω over the hemisphere about the shading normal Ns: 1 is open, 0 is
//! closed. A direction with ⟨Ng, ω⟩ ≤ 0 points into the surface, by its geometric normal Ng, and is
//! blocked. With a finite radius only what is nearer than it blocks, and blocks fully.

use std::f64::consts::FRAC_PI_4;

use glam::{DMat3, DVec2, DVec3};
use indicatif::ProgressBar;
use rayon::prelude::*;

use super::Tracer;

/// A point on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// Where it is; the estimate steps off it by [`Tracer::epsilon`] along the geometric normal.
    pub position: DVec3,
    /// The normal of the triangle, on the side that receives light.
    pub geometric_normal: DVec3,
    /// The interpolated normal, about which the cosine is taken.
    pub shading_normal: DVec3,
}

/// A mean of random samples and how far off it may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The estimated value.
    pub mean: f64,
    /// Standard deviation of `mean` over seeds, itself estimated.
    pub standard_error: f64,
}

impl Tracer {
    /// Estimates the visibility of a receiver within `radius`, which may be infinite, with at
    /// least `rays` rays. It depends on the arguments alone, `seed` included.
    ///
    /// The cosine-weighted hemisphere is cut into a grid of cells of one weight, and each cell
    /// gets two independent rays. The mean of all rays has no bias. Nor has the variance made of
    /// the differences between the two rays of each cell, since cells do not depend on each
    /// other: the standard error is its root. It is zero when both rays agree in every cell, also
    /// where an occluder smaller than a cell was missed by both. The number of rays is the next
    /// that fills a grid, at least 2.
    ///
    /// Normals need not have unit length. If one is zero or anything is not finite but `radius`,
    /// the estimate is not a number.
    pub fn ambient_occlusion(&self, at: &Receiver, radius: f64, rays: u32, seed: u64) -> Estimate {
        let Some(hemisphere) = Hemisphere::new(at, self.epsilon()) else {
            return Estimate {
                mean: f64::NAN,
                standard_error: f64::NAN,
            };
        };
        let pairs = rays.div_ceil(2).max(1);
        let rows = pairs.isqrt();
        let columns = pairs.div_ceil(rows);
        let cell = DVec2::new(f64::from(columns), f64::from(rows)).recip();

        let mut random = SplitMix64(seed);
        let mut visible = 0_u64;
        let mut disagreeing = 0_u64;
        for row in 0..rows {
            for column in 0..columns {
                let corner = DVec2::new(f64::from(column), f64::from(row));
                let [one, other] = [(); 2].map(|()| {
                    let square = (corner + random.next_vec2()) * cell;
                    let direction = hemisphere.direction(square);
                    direction.dot(hemisphere.geometric_normal) > 0.0
                        && !self.occluded(hemisphere.origin, direction, 0.0, radius)
                });
                visible += u64::from(one) + u64::from(other);
                disagreeing += u64::from(one != other);
            }
        }
        // Two samples x, y of a cell have the mean (x + y)/2, whose variance (x - y)²/4 estimates:
        // 1/4 where they disagree. The mean of n independent cells has 1/n² of their sum.
        let samples = 2.0 * f64::from(rows) * f64::from(columns);
        Estimate {
            mean: visible as f64 / samples,
            standard_error: (disagreeing as f64).sqrt() / samples,
        }
    }

    /// [`ambient_occlusion`](Self::ambient_occlusion) of many receivers, in parallel on rayon's
    /// current thread pool; where there is no receiver there is no estimate. Each place in the
    /// list draws random numbers of its own from `seed`, so that the result does not depend on
    /// the number of threads. `progress` shows a bar on standard error.
    pub fn ambient_occlusion_image(
        &self,
        receivers: &[Option<Receiver>],
        radius: f64,
        rays: u32,
        seed: u64,
        progress: bool,
    ) -> Vec<Option<Estimate>> {
        let bar = if progress {
            ProgressBar::new(receivers.len() as u64)
        } else {
            ProgressBar::hidden()
        };
        let estimates = receivers
            .par_iter()
            .enumerate()
            .map(|(index, receiver)| {
                let own_seed = SplitMix64(seed ^ SplitMix64(index as u64).next()).next();
                let estimate = receiver
                    .as_ref()
                    .map(|at| self.ambient_occlusion(at, radius, rays, own_seed));
                bar.inc(1);
                estimate
            })
            .collect();
        bar.finish_and_clear();
        estimates
    }
}

/// The directions about a receiver's shading normal.
struct Hemisphere {
    /// Where rays start: off the surface.
    origin: DVec3,
    geometric_normal: DVec3,
    /// From coordinates with z along the shading normal to those of the scene.
    to_scene: DMat3,
}

impl Hemisphere {
    fn new(at: &Receiver, epsilon: f64) -> Option<Self> {
        let geometric_normal = at.geometric_normal.try_normalize()?;
        let shading_normal = at.shading_normal.try_normalize()?;
        let (tangent, bitangent) = shading_normal.any_orthonormal_pair();
        let origin = at.position + geometric_normal * epsilon;
        origin.is_finite().then_some(Self {
            origin,
            geometric_normal,
            to_scene: DMat3::from_cols(tangent, bitangent, shading_normal),
        })
    }

    /// Takes the unit square to directions, with an area in the square becoming that share of the
    /// cosine-weighted hemisphere: first to the unit disk, then straight up to the dome.
    fn direction(&self, square: DVec2) -> DVec3 {
        let disk = concentric_disk(square);
        let height = (1.0 - disk.length_squared()).max(0.0).sqrt();
        self.to_scene * disk.extend(height)
    }
}

/// Maps the unit square to the unit disk by equal areas, keeping compact cells compact: the
/// concentric map of Shirley and Chiu, "A Low Distortion Map Between Disk and Square", 1997.
fn concentric_disk(square: DVec2) -> DVec2 {
    let DVec2 { x, y } = 2.0 * square - DVec2::ONE;
    if x == 0.0 && y == 0.0 {
        DVec2::ZERO
    } else if x.abs() > y.abs() {
        x * DVec2::from_angle(FRAC_PI_4 * y / x)
    } else {
        let (sin, cos) = (FRAC_PI_4 * x / y).sin_cos();
        y * DVec2::new(sin, cos)
    }
}

/// The generator of Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators", 2014.
struct SplitMix64(u64);

impl SplitMix64 {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Two numbers in [0, 1).
    fn next_vec2(&mut self) -> DVec2 {
        let mut unit = || (self.next() >> 11) as f64 / 2.0_f64.powi(53);
        DVec2::new(unit(), unit())
    }
}

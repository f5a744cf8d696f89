//! Integrals over the hemisphere about a receiver's shading normal, cosine-weighted, by stratified
//! random directions.

use std::f64::consts::FRAC_PI_4;

use glam::{DMat3, DVec2, DVec3};
use indicatif::ProgressBar;
use rayon::prelude::*;

use super::Tracer;

/// A point on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// Where it is; rays leave from [`Tracer::start`], along the geometric normal.
    pub position: DVec3,
    /// The normal of the triangle, on the side that receives light.
    pub geometric_normal: DVec3,
    /// The interpolated normal, about which the cosine is taken.
    pub shading_normal: DVec3,
}

/// The directions about a receiver's shading normal.
pub(super) struct Hemisphere {
    /// Where rays start: off the surface.
    pub(super) origin: DVec3,
    geometric_normal: DVec3,
    /// From coordinates with z along the shading normal to those of the scene.
    to_scene: DMat3,
}

/// Means of random samples of N values each, and the standard errors of these means.
pub(super) struct Means<const N: usize> {
    pub(super) mean: [f64; N],
    pub(super) standard_error: [f64; N],
}

impl Hemisphere {
    /// None where a normal is zero or anything is not finite.
    pub(super) fn new(at: &Receiver, tracer: &Tracer) -> Option<Self> {
        let geometric_normal = at.geometric_normal.try_normalize()?;
        let shading_normal = at.shading_normal.try_normalize()?;
        let (tangent, bitangent) = shading_normal.any_orthonormal_pair();
        let origin = tracer.start(at.position, geometric_normal);
        origin.is_finite().then_some(Self {
            origin,
            geometric_normal,
            to_scene: DMat3::from_cols(tangent, bitangent, shading_normal),
        })
    }

    /// 1/π ∫ f(ω) ⟨Ns, ω⟩ dω, with f zero where ⟨Ng, ω⟩ ≤ 0, from at least `rays` directions: the cosine-weighted hemisphere is
    /// [`stratified`].
    pub(super) fn estimate<const N: usize>(
        &self,
        rays: u32,
        seed: u64,
        mut f: impl FnMut(DVec3) -> [f64; N],
    ) -> Means<N> {
        stratified(rays, seed, |square| {
            let direction = self.direction(square);
            if self.is_above(direction) {
                f(direction)
            } else {
                [0.0; N]
            }
        })
    }

    /// Whether a direction leads off the surface.
    pub(super) fn is_above(&self, direction: DVec3) -> bool {
        direction.dot(self.geometric_normal) > 0.0
    }

    /// The shading normal, a unit vector.
    pub(super) fn normal(&self) -> DVec3 {
        self.to_scene.z_axis
    }

    /// Takes the unit square to directions, with an area in the square becoming that share of the
    /// cosine-weighted hemisphere: first to the unit disk, then straight up to the dome.
    fn direction(&self, square: DVec2) -> DVec3 {
        self.to_scene * on_dome(square)
    }
}

/// The unit square to the cosine-weighted hemisphere about z.
fn on_dome(square: DVec2) -> DVec3 {
    let disk = concentric_disk(square);
    let height = (1.0 - disk.length_squared()).max(0.0).sqrt();
    disk.extend(height)
}

/// Random directions about unit normals, by the cosine.
pub(super) struct Scatter(SplitMix64);

impl Scatter {
    pub(super) fn new(seed: u64) -> Self {
        // Not the numbers of the hemisphere of the same seed.
        Self(SplitMix64(!seed))
    }

    pub(super) fn direction(&mut self, normal: DVec3) -> DVec3 {
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        DMat3::from_cols(tangent, bitangent, normal) * on_dome(self.0.next_vec2())
    }
}

/// The mean over the unit square, from at least `rays` points.
///
/// The square is cut into a grid of cells, and each cell gets two independent points. The mean of all has no bias. Nor has the
/// variance made of the differences between the two of each cell, since cells do not depend on each other: the standard error
/// is its root.
pub(super) fn stratified<const N: usize>(
    rays: u32,
    seed: u64,
    mut f: impl FnMut(DVec2) -> [f64; N],
) -> Means<N> {
    let pairs = rays.div_ceil(2).max(1);
    let rows = pairs.isqrt();
    let columns = pairs.div_ceil(rows);
    let cell = DVec2::new(f64::from(columns), f64::from(rows)).recip();

    let mut random = SplitMix64(seed);
    let mut sum = [0.0; N];
    let mut square = [0.0; N];
    for row in 0..rows {
        for column in 0..columns {
            let corner = DVec2::new(f64::from(column), f64::from(row));
            let [one, other] = [(); 2].map(|()| f((corner + random.next_vec2()) * cell));
            for i in 0..N {
                sum[i] += one[i] + other[i];
                square[i] += (one[i] - other[i]).powi(2);
            }
        }
    }
    // Two samples x, y of a cell have the mean (x + y)/2, whose variance (x - y)²/4 estimates.
    // The mean of n independent cells has 1/n² of their sum.
    let samples = 2.0 * f64::from(rows) * f64::from(columns);
    Means {
        mean: sum.map(|sum| sum / samples),
        standard_error: square.map(|square: f64| square.sqrt() / samples),
    }
}

/// Something of each receiver, in parallel on rayon's current thread pool; where there is no
/// receiver there is nothing. Each place in the list gets a seed of its own made from `seed`, so
/// that the result does not depend on the number of threads. `progress` shows a bar on standard
/// error.
pub(super) fn of_each<R: Send>(
    receivers: &[Option<Receiver>],
    seed: u64,
    progress: bool,
    estimate: impl Fn(&Receiver, u64) -> R + Sync,
) -> Vec<Option<R>> {
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
            let estimate = receiver.as_ref().map(|at| estimate(at, own_seed));
            bar.inc(1);
            estimate
        })
        .collect();
    bar.finish_and_clear();
    estimates
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

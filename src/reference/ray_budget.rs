//! Mirror of `wgsl/ray_budget.wgsl`.

use std::f64::consts::PI;

use glam::{DVec2, IVec2};
use rayon::prelude::*;

use super::{
    bounced_z_buffer::to_camera,
    ggx::{clean_roughness, even_shares},
    hashing::{hash2, unit_float},
    hit_resolver::{HitResolution, Mean},
    shell_splatter::Receiver,
};
use crate::{
    RayBudgetSettings,
    hit_resolver::params::{falloff, per_hit_distance},
    ray_budget::params::{f0, least_share, sets},
};

const BINS: usize = 256;
const FIRST_BIN: u32 = 87 << 2;
const RADIUS: i32 = 2;
const NEIGHBOURS: f64 = 24.0;
const CELL: i32 = 4;
const CELLS: i32 = 2;
const MOST_NEED: f64 = 1e12;
const LEAST_REFLECTANCE: f64 = 1e-3;
const LEAST_SCALE: f64 = -40.0;
const COARSE_STEP: f64 = 0.5;

/// What a budget starts from.
#[derive(Clone, Copy, Debug)]
pub struct Budget<'a> {
    /// The hits, and the filter that the picture will be made with.
    pub hits: &'a HitResolution<'a>,
    /// Each pixel's own mean.
    pub means: &'a [Mean],
    /// The mean of 1 / distance of the hits about each pixel.
    pub near: &'a [f64],
    /// The settings.
    pub settings: &'a RayBudgetSettings,
    /// Of glossy receivers each pixel's roughness.
    pub roughness: Option<&'a [f64]>,
}

fn bin_of(need: f32) -> usize {
    (((need.to_bits() >> 21).max(FIRST_BIN) - FIRST_BIN) as usize).min(BINS - 1)
}

fn need_of(bin: usize) -> f64 {
    f32::from_bits(((bin as u32 + FIRST_BIN) << 21) | (1 << 20)).into()
}

impl Budget<'_> {
    fn size(&self) -> IVec2 {
        let viewport = self.hits.camera.viewport();
        IVec2::new(viewport.width as i32, viewport.height as i32)
    }

    fn place_of(&self, pixel: IVec2) -> usize {
        (pixel.y * self.size().x + pixel.x) as usize
    }

    fn cell_count(&self) -> IVec2 {
        (self.size() + CELL - 1) / CELL
    }

    fn reflectance_at(&self, at: IVec2, receiver: &Receiver) -> f64 {
        let Some(roughness) = self.roughness else {
            return 1.0;
        };
        let HitResolution { camera, origin, .. } = *self.hits;
        let to_eye = to_camera(camera, origin, receiver.position);
        let cosine = receiver.normal.dot(to_eye).clamp(0.0, 1.0);
        let shares = even_shares(cosine, clean_roughness(roughness[self.place_of(at)]));
        let f0 = f64::from(f0(self.hits.settings));
        (f0 * shares.x + shares.y).max(LEAST_REFLECTANCE)
    }

    fn variance_at(&self, at: IVec2) -> DVec2 {
        let place = self.place_of(at);
        let variance = self.means[place].variance;
        let Some(receiver) = self.hits.receivers[place].filter(|_| variance >= 0.0) else {
            return DVec2::ZERO;
        };
        let reflectance = self.reflectance_at(at, &receiver);
        DVec2::new(
            (variance / (reflectance * reflectance)).min(MOST_NEED * MOST_NEED),
            1.0,
        )
    }

    /// Of each cell of 4 × 4 pixels, rows from the top: the sum of its pixels' variances, and how many there are.
    pub fn pool(&self) -> Vec<DVec2> {
        let count = self.cell_count();
        (0..count.x * count.y)
            .map(|i| {
                let first = IVec2::new(i % count.x, i / count.x) * CELL;
                let end = (first + CELL).min(self.size());
                let pixels =
                    (first.y..end.y).flat_map(|y| (first.x..end.x).map(move |x| IVec2::new(x, y)));
                pixels.map(|pixel| self.variance_at(pixel)).sum()
            })
            .collect()
    }

    fn variance_around(&self, cells: &[DVec2], at: IVec2) -> f64 {
        let count = self.cell_count();
        let cell = at / CELL;
        let low = (cell - CELLS).max(IVec2::ZERO);
        let high = (cell + CELLS).min(count - 1);
        let mut sum = -self.variance_at(at);
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                sum += cells[(y * count.x + x) as usize];
            }
        }
        sum.x.max(0.0) / sum.y.max(1.0)
    }

    fn kin_of(&self, at: IVec2, side: f64) -> f64 {
        let Some(own) = self.hits.receivers[self.place_of(at)] else {
            return 0.0;
        };
        let per_tolerance = self.hits.per_tolerance_at(side);
        let low = (at - RADIUS).max(IVec2::ZERO);
        let high = (at + RADIUS).min(self.size() - 1);
        let mut kin = 0.0;
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                if let Some(other) = self.hits.receivers[self.place_of(IVec2::new(x, y))] {
                    let d = other.position - own.position;
                    kin += self
                        .hits
                        .kinship(own.normal, other.normal, d, per_tolerance);
                }
            }
        }
        kin
    }

    /// Of each pixel, rows from the top, how much noise one more ray would take from the picture; 0 for the sky.
    pub fn needs(&self) -> Vec<f64> {
        let cells = self.pool();
        let width = self.size().x;
        (0..self.hits.receivers.len() as i32)
            .into_par_iter()
            .map(|i| self.need_at(&cells, IVec2::new(i % width, i / width)))
            .collect()
    }

    fn need_at(&self, cells: &[DVec2], at: IVec2) -> f64 {
        let place = self.place_of(at);
        let Some(receiver) = self.hits.receivers[place] else {
            return 0.0;
        };
        if self.means[place].variance < 0.0 {
            return 0.0;
        }
        let filter = self.hits.settings;
        let side = self.hits.side(&receiver);
        let hits_aside = side * self.near[place] * f64::from(per_hit_distance(filter));
        let steep = f64::from(falloff(filter)) + hits_aside * hits_aside;
        let share = (steep / (2.0 * PI)).max(least_share(filter).into()) * NEIGHBOURS
            / self.kin_of(at, side).max(1.0);
        self.reflectance_at(at, &receiver)
            * (self.variance_around(cells, at) * share.min(1.0)).sqrt()
    }

    /// Sets per unit of need that make up the budget.
    pub fn scale(&self, needs: &[f32]) -> f64 {
        let mut bins = [0.0; BINS];
        for need in needs.iter().filter(|need| **need > 0.0) {
            bins[bin_of(*need)] += 1.0;
        }
        let [sets, most] = sets(*self.settings, self.hits.traced, 0).map(f64::from);
        let seen = self.hits.receivers.iter().flatten().count() as f64;
        let fits = |exponent: f64| {
            let of = |(bin, count)| count * (need_of(bin) * exponent.exp2()).min(most);
            bins.into_iter().enumerate().map(of).sum::<f64>() <= sets * seen
        };
        let largest = |from: f64, step: f64| {
            let exponents = (0..BINS).rev().map(|i| from + step * i as f64);
            exponents.into_iter().find(|e| fits(*e)).unwrap_or(from)
        };
        let coarse = largest(LEAST_SCALE, COARSE_STEP);
        largest(coarse, COARSE_STEP / BINS as f64).exp2()
    }

    /// How many further sets each pixel has.
    pub fn sets(&self, needs: &[f32], scale: f64) -> Vec<u32> {
        let [_, most] = sets(*self.settings, self.hits.traced, 0).map(f64::from);
        let chance = |place| unit_float(hash2(place, self.hits.traced.frame));
        (0..)
            .zip(needs)
            .map(|(place, need)| {
                if *need <= 0.0 {
                    return 0;
                }
                let sets = (f64::from(*need) * scale).min(most) + chance(place);
                (sets as u32).min(most as u32)
            })
            .collect()
    }
}

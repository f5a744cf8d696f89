//! How the tables of `src/volumetric_obscurance/samples.rs` came about (Volumetric Obscurance 4.5): points of a disk or a
//! ball that repel each other, steered so that their Voronoi cells have equal shares of it.
//!
//! Additions, products, quotients and square roots only, which IEEE 754 rounds alike everywhere: a seed gives the same
//! table on every machine.

use glam::DVec3;

use super::hashing::{hash2, unit_float};

/// What points are spread over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Domain {
    /// The unit disk (z = 0), each point of it counting by the length of the unit sphere's chord above and below it, so
    /// that a share of the disk is a share of the sphere's volume.
    Disk,
    /// The unit ball.
    Ball,
}

/// A table.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleTable {
    /// Points of the domain; the first is the centre, where it was asked for.
    pub points: Vec<DVec3>,
    /// Each point's Voronoi cell's share of the domain. They sum to 1.
    pub shares: Vec<f64>,
    /// Mean square distance to the nearest point, over the domain.
    pub energy: f64,
}

impl SampleTable {
    /// How far the worst share is off an equal one, relative to it.
    pub fn imbalance(&self) -> f64 {
        let count = self.points.len() as f64;
        let off = |share: &f64| (share * count - 1.0).abs();
        self.shares.iter().map(off).fold(0.0, f64::max)
    }
}

/// The domain cut into cells on a grid of `side` cells a side: centre and weight of each.
#[derive(Clone, Debug)]
pub struct Cells {
    domain: Domain,
    list: Vec<(DVec3, f64)>,
    total: f64,
}

impl Cells {
    /// Of a domain.
    pub fn new(domain: Domain, side: u32) -> Self {
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(side) * 2.0 - 1.0;
        let layers = if domain == Domain::Ball { side } else { 1 };
        let mut cells = Vec::new();
        for z in 0..layers {
            for y in 0..side {
                for x in 0..side {
                    let (p, weight) = match domain {
                        Domain::Disk => {
                            let p = DVec3::new(at(x), at(y), 0.0);
                            (p, (1.0 - p.length_squared()).max(0.0).sqrt())
                        }
                        Domain::Ball => {
                            let p = DVec3::new(at(x), at(y), at(z));
                            (p, f64::from(u8::from(p.length_squared() < 1.0)))
                        }
                    };
                    if weight > 0.0 {
                        cells.push((p, weight));
                    }
                }
            }
        }
        let total = cells.iter().map(|c| c.1).sum();
        Self {
            domain,
            list: cells,
            total,
        }
    }

    /// Shares of the points' Voronoi cells, their centroids, and the mean square distance to the nearest point.
    pub fn voronoi(&self, points: &[DVec3]) -> (Vec<f64>, Vec<DVec3>, f64) {
        let mut shares = vec![0.0; points.len()];
        let mut centroids = vec![DVec3::ZERO; points.len()];
        let mut energy = 0.0;
        for &(cell, weight) in &self.list {
            let (mut nearest, mut least) = (0, f64::INFINITY);
            for (i, point) in points.iter().enumerate() {
                let distance = point.distance_squared(cell);
                if distance < least {
                    (nearest, least) = (i, distance);
                }
            }
            shares[nearest] += weight;
            centroids[nearest] += weight * cell;
            energy += weight * least;
        }
        for ((centroid, share), point) in centroids.iter_mut().zip(&mut shares).zip(points) {
            *centroid = if *share > 0.0 {
                *centroid / *share
            } else {
                *point
            };
            *share /= self.total;
        }
        (shares, centroids, energy / self.total)
    }

    /// A table of these points.
    fn table(&self, points: Vec<DVec3>) -> SampleTable {
        let (shares, _, energy) = self.voronoi(&points);
        SampleTable {
            points,
            shares,
            energy,
        }
    }
}

/// Points far from each other: each the farthest of some random candidates from those before it.
fn scatter(domain: Domain, count: usize, center: bool, seed: u32) -> Vec<DVec3> {
    let mut number = 0;
    let mut draw = || {
        number += 1;
        unit_float(hash2(number, seed)) * 2.0 - 1.0
    };
    let mut candidate = || loop {
        let z = if domain == Domain::Ball { draw() } else { 0.0 };
        let p = DVec3::new(draw(), draw(), z);
        if p.length_squared() < 1.0 {
            return p;
        }
    };
    let mut points = if center {
        vec![DVec3::ZERO]
    } else {
        Vec::new()
    };
    while points.len() < count {
        let mut best = (candidate(), -1.0);
        for _ in 0..8 {
            let p = candidate();
            let gap = points
                .iter()
                .map(|q| p.distance_squared(*q))
                .fold(f64::INFINITY, f64::min);
            if gap > best.1 {
                best = (p, gap);
            }
        }
        points.push(best.0);
    }
    points
}

/// Lets points repel each other with forces that fall with the fourth power of the distance, and steers them to their
/// cells' centroids. A point whose cell is too small repels more, until shares are equal; the boundary repels too, by an
/// image of each point in it, without which all would end there.
fn relax(cells: &Cells, points: Vec<DVec3>, center: bool, rounds: u32) -> SampleTable {
    let count = points.len() as f64;
    let spacing = if cells.domain == Domain::Ball {
        1.6 / count.cbrt()
    } else {
        1.8 / count.sqrt()
    };
    let mut charges = vec![1.0; points.len()];
    let mut table = cells.table(points);
    let mut best = table.clone();
    for round in 0..rounds {
        let (shares, centroids, _) = cells.voronoi(&table.points);
        for (charge, share) in charges.iter_mut().zip(&shares) {
            *charge *= 1.0 + 0.1 * (1.0 - share * count).clamp(-0.5, 0.5);
        }
        let mean = charges.iter().sum::<f64>() / count;
        for charge in &mut charges {
            *charge /= mean;
        }
        // Later rounds move less: what is left is to settle.
        let step = 0.1 / (1.0 + 4.0 * f64::from(round) / f64::from(rounds));
        let force = |from: DVec3, charge: f64| {
            let distance = (from.length() / spacing).max(0.1);
            let square = distance * distance;
            charge * from / (square * square * distance)
        };
        let moved = table
            .points
            .iter()
            .enumerate()
            .map(|(i, &p)| {
                if center && i == 0 {
                    return p;
                }
                let others = table.points.iter().zip(&charges).enumerate();
                let mut push: DVec3 = others
                    .filter(|(j, _)| *j != i)
                    .map(|(_, (q, charge))| force(p - *q, *charge))
                    .sum();
                let length = p.length();
                if length > 1e-9 {
                    push += force(p / length * (2.0 * (length - 1.0)), charges[i]);
                }
                let limited = push / (1.0 + push.length() / spacing);
                let p = p + step * (limited + 3.0 * (centroids[i] - p));
                // Off the rim, where a chord has no length.
                p * (0.97 / p.length()).min(1.0)
            })
            .collect();
        table = cells.table(moved);
        if table.imbalance() < best.imbalance() {
            best.clone_from(&table);
        }
    }
    best
}

/// What is left after [`relax`]: kicks one point at a time, ever more softly, and keeps what makes shares more equal, until
/// no share is off by more than `wanted`.
fn settle(
    cells: &Cells,
    start: SampleTable,
    center: bool,
    kicks: u32,
    reach: f64,
    wanted: f64,
) -> SampleTable {
    let count = start.points.len() as f64;
    let spread = |table: &SampleTable| -> f64 {
        table
            .shares
            .iter()
            .map(|s| (s * count - 1.0) * (s * count - 1.0))
            .sum()
    };
    let movable = start.points.len() - usize::from(center);
    let mut best = start;
    for kick in 0..kicks {
        if best.imbalance() <= wanted {
            break;
        }
        let draw = |axis| unit_float(hash2(kick, axis)) * 2.0 - 1.0;
        let flat = f64::from(u8::from(cells.domain == Domain::Ball));
        let scale = reach * (1.0 - f64::from(kick) / f64::from(kicks));
        let mut points = best.points.clone();
        let point = &mut points[usize::from(center) + kick as usize % movable];
        *point += scale * DVec3::new(draw(1), draw(2), flat * draw(3));
        *point *= (0.97 / point.length()).min(1.0);
        let table = cells.table(points);
        if spread(&table) < spread(&best) {
            best = table;
        }
    }
    best
}

/// How many sets of points are tried for a table.
const STARTS: u32 = 16;

/// What shares may differ by, relative to an equal one, on the fine grid.
pub const TOLERANCE: f64 = 0.005;

/// The table of a seed: of all tries whose shares are equal to 2 % on a coarse grid (or that with the most equal ones, if
/// there is none) the one with the least energy, settled further on a fine grid.
///
/// # Panics
/// Never: there are tries, and their costs are finite.
pub fn generate(domain: Domain, count: usize, center: bool, seed: u32) -> SampleTable {
    let (coarse, fine) = match domain {
        Domain::Disk => (96, 512),
        Domain::Ball => (24, 64),
    };
    let cells = Cells::new(domain, coarse);
    let tries = (0..STARTS).map(|start| {
        let points = scatter(domain, count, center, hash2(start, seed));
        let relaxed = relax(&cells, points, center, 100);
        settle(&cells, relaxed, center, 1000, 0.1, 0.02)
    });
    let cost = |table: &SampleTable| (table.imbalance().max(0.02), table.energy);
    let best = tries
        .min_by(|a, b| cost(a).partial_cmp(&cost(b)).expect("finite"))
        .expect("there are starts");
    let cells = Cells::new(domain, fine);
    let fine = cells.table(best.points);
    settle(&cells, fine, center, 1500, 0.01, TOLERANCE)
}

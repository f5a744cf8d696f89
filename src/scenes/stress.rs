//! Wavy ground, 100 m by 100 m, strewn with round rocks: as many triangles as asked for.
//!
//! It tests how time and memory grow with the count of triangles while the view stays alike.

use glam::DVec3;

use super::builder::{Builder, MaterialId};
use super::hash::unit;
use super::{Scene, View};

pub(super) const NAME: &str = "stress";

/// The size [`super::all`] and [`super::by_name`] build.
pub const DEFAULT_STRESS_TRIANGLES: usize = 100_000;

/// The most triangles [`stress`] makes: a larger number asks for this many.
pub const MAX_STRESS_TRIANGLES: usize = 5_000_000;

/// Side of the ground, in metres.
const SIDE: f64 = 100.0;
const ROCK_CELLS: [usize; 2] = [16, 8];
const ROCK_TRIANGLES: usize = 2 * ROCK_CELLS[0] * (ROCK_CELLS[1] - 1);

/// Builds ground and rocks of `triangles` triangles: that number rounded down to an even one, and
/// between 2 and [`MAX_STRESS_TRIANGLES`]. A fifth goes into rocks.
pub fn stress(triangles: usize) -> Scene {
    let triangles = triangles.clamp(2, MAX_STRESS_TRIANGLES);
    let rock_count = triangles / 5 / ROCK_TRIANGLES;
    let mut builder = Builder::default();
    let soil = builder.surface([0.35, 0.4, 0.2]);
    let rock = builder.surface([0.5, 0.48, 0.45]);

    ground(
        &mut builder,
        soil,
        (triangles - rock_count * ROCK_TRIANGLES) / 2,
    );
    for number in 0..rock_count as u32 {
        let coordinate = |salt: u32| (unit(3 * number + salt) - 0.5) * (SIDE - 4.0);
        let (x, z) = (coordinate(0), coordinate(1));
        let radius = 0.2 + 1.2 * unit(3 * number + 2).powi(3);
        // Two fifths sunk in.
        let centre = DVec3::new(x, height(x, z) + 0.2 * radius, z);
        builder.sphere(rock, centre, radius, ROCK_CELLS);
    }

    let views = vec![
        View {
            name: "hill",
            eye: [0.0, 12.0, 45.0],
            target: [0.0, 0.0, 0.0],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 55.0,
            near: 0.1,
        },
        View {
            name: "ground",
            eye: [3.0, height(3.0, 20.0) + 0.6, 20.0],
            target: [0.0, height(0.0, 10.0), 10.0],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 60.0,
            near: 0.05,
        },
    ];
    builder.finish(NAME, views, 4.0)
}

/// Waves of the ground: wave numbers along x and z, in radians a metre, and height in metres.
const WAVES: [(f64, f64, f64); 5] = [
    (0.11, 0.05, 1.6),
    (-0.07, 0.16, 1.2),
    (0.31, 0.27, 0.4),
    (0.55, -0.73, 0.15),
    (1.9, 1.3, 0.04),
];

fn height(x: f64, z: f64) -> f64 {
    WAVES
        .iter()
        .map(|(kx, kz, amplitude)| amplitude * (kx * x + kz * z).sin())
        .sum()
}

fn normal(x: f64, z: f64) -> DVec3 {
    let mut normal = DVec3::Y;
    for (kx, kz, amplitude) in WAVES {
        let slope = amplitude * (kx * x + kz * z).cos();
        normal -= DVec3::new(kx, 0.0, kz) * slope;
    }
    normal.normalize()
}

/// `cells` quadrilaterals in rows of nearly a square; the last row may end early.
fn ground(builder: &mut Builder, soil: MaterialId, cells: usize) {
    let columns = cells.isqrt();
    let rows = cells.div_ceil(columns);
    let full_rows = cells / columns;
    let vertex = |i: usize, j: usize| {
        let x = SIDE * (i as f64 / columns as f64 - 0.5);
        let z = SIDE * (0.5 - j as f64 / rows as f64);
        (DVec3::new(x, height(x, z), z), normal(x, z))
    };
    builder.lattice(soil, [columns, full_rows], vertex);
    let rest = cells % columns;
    if rest > 0 {
        builder.lattice(soil, [rest, 1], |i, j| vertex(i, full_rows + j));
    }
}

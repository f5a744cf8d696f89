//! A knot of stone, 20 cm tall, on a plinth on a floor. About 10 000 triangles.
//!
//! It tests light that passes through a body: the knot's tube is 12 mm to 36 mm thick, smooth, casts shadows on itself, and its
//! far side is lit where no camera in front sees it. The knot is material 0.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use super::builder::{Base, Builder};
use super::{Scene, View};

pub(super) const NAME: &str = "statue";

/// Where the knot's middle is, in metres.
const CENTRE: DVec3 = DVec3::new(0.0, 0.155, 0.0);
/// Radii of the torus that the knot winds about, in metres.
const RING: f64 = 0.055;
const WINDING: f64 = 0.024;
/// Quadrilaterals around the tube and along it.
const CELLS: [usize; 2] = [28, 180];

/// The middle of the tube, at a share of its length: a trefoil.
fn middle(share: f64) -> DVec3 {
    let (around, across) = (2.0 * TAU * share, 3.0 * TAU * share);
    let out = RING + WINDING * across.cos();
    CENTRE
        + DVec3::new(
            out * around.cos(),
            out * around.sin(),
            WINDING * across.sin(),
        )
}

/// A point of the tube's surface.
fn surface(side: f64, share: f64) -> DVec3 {
    const STEP: f64 = 1e-5;
    let along = (middle(share + STEP) - middle(share - STEP)).normalize();
    // Away from the middle of the torus's own tube, which is smooth and closes.
    let ring = DVec2::from_angle(2.0 * TAU * share) * RING;
    let away = middle(share) - CENTRE - ring.extend(0.0);
    let normal = (away - along * away.dot(along)).normalize();
    let (sin, cos) = (TAU * side).sin_cos();
    let radius = 0.012 + 0.006 * (TAU * share).cos();
    middle(share) + radius * (normal * cos + along.cross(normal) * sin)
}

/// A translucent body for subsurface scattering, whose thickness varies.
pub fn statue() -> Scene {
    let mut builder = Builder::default();
    let stone = builder.surface([0.83, 0.79, 0.75]);
    let plinth = builder.surface([0.35, 0.33, 0.3]);
    let floor = builder.surface([0.25, 0.27, 0.3]);
    builder.lattice(stone, CELLS, |i, j| {
        const STEP: f64 = 1e-5;
        let side = (i % CELLS[0]) as f64 / CELLS[0] as f64;
        let share = (j % CELLS[1]) as f64 / CELLS[1] as f64;
        let around = surface(side + STEP, share) - surface(side - STEP, share);
        let along = surface(side, share + STEP) - surface(side, share - STEP);
        (surface(side, share), around.cross(along).normalize())
    });
    let half = DVec3::new(0.06, 0.035, 0.04);
    let low = DVec3::new(-half.x, 0.0, -half.z);
    let high = DVec3::new(half.x, 2.0 * half.y, half.z);
    builder.aligned_block(plinth, low, high, Base::Open);
    let corner = DVec3::new(-0.5, 0.0, 0.5);
    builder.grid(floor, corner, DVec3::X, -DVec3::Z, [4, 4]);
    let view = |name, eye: [f64; 3], target: [f64; 3], vertical_fov_degrees| View {
        name,
        eye,
        target,
        up: [0.0, 1.0, 0.0],
        vertical_fov_degrees,
        near: 0.02,
    };
    let views = vec![
        view("front", [0.12, 0.2, 0.5], [0.0, 0.145, 0.0], 28.0),
        view("close", [0.08, 0.22, 0.2], [0.02, 0.17, 0.0], 35.0),
    ];
    builder.finish(NAME, views, 0.05)
}

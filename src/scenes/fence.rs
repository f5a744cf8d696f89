//! A wire fence 6 m long and 2 m high over a floor, with a box behind it. The wires are 4 mm
//! thick, every 10 cm both ways, with three to eight sides each.
//!
//! It tests occluders thinner than a pixel, whose coverage a depth buffer holds or loses by
//! chance, and triangles a thousand times longer than wide.

use glam::DVec3;

use super::builder::{Base, Builder, MaterialId};
use super::{Scene, View};

pub(super) const NAME: &str = "fence";

const HALF_LENGTH: f64 = 3.0;
const HEIGHT: f64 = 2.0;
const MESH: f64 = 0.1;
const WIRE_RADIUS: f64 = 0.002;
const POST_RADIUS: f64 = 0.03;

/// Builds the fence.
pub fn fence() -> Scene {
    let mut builder = Builder::default();
    let ground = builder.surface([0.45, 0.5, 0.35]);
    let wire = builder.surface([0.5, 0.5, 0.52]);
    let crate_wood = builder.surface([0.6, 0.35, 0.15]);

    builder.grid(
        ground,
        DVec3::new(-5.0, 0.0, 5.0),
        DVec3::X * 10.0,
        DVec3::NEG_Z * 10.0,
        [10, 10],
    );
    builder.aligned_block(
        crate_wood,
        DVec3::new(-1.6, 0.0, -1.4),
        DVec3::new(-0.6, 1.0, -0.4),
        Base::Open,
    );
    posts(&mut builder, wire);
    upright_wires(&mut builder, wire);
    level_wires(&mut builder, wire);

    let views = vec![
        View {
            name: "front",
            eye: [1.5, 1.6, 4.0],
            target: [0.0, 0.8, 0.0],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 50.0,
            near: 0.1,
        },
        View {
            name: "through-the-wires",
            eye: [-0.75, 0.55, 0.25],
            target: [-0.9, 0.4, -0.4],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 60.0,
            near: 0.02,
        },
        View {
            name: "along",
            eye: [-2.8, 1.0, 0.15],
            target: [3.0, 0.7, -0.1],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 50.0,
            near: 0.02,
        },
    ];
    builder.finish(NAME, views, 0.5)
}

/// How many sides the wire of that number has: three to eight in turn.
fn sides(number: usize) -> usize {
    3 + number % 6
}

/// Four posts, 2 m apart, sunk into the ground.
fn posts(builder: &mut Builder, wire: MaterialId) {
    for x in [-HALF_LENGTH, -1.0, 1.0, HALF_LENGTH] {
        builder.cylinder(
            wire,
            DVec3::new(x, -0.1, 0.0),
            DVec3::new(x, HEIGHT + 0.05, 0.0),
            POST_RADIUS,
            16,
        );
    }
}

fn upright_wires(builder: &mut Builder, wire: MaterialId) {
    let count = (2.0 * HALF_LENGTH / MESH).round() as usize;
    // In front of the level wires by a diameter and a little, so that they do not cut each other.
    let z = 2.2 * WIRE_RADIUS;
    for number in 0..count {
        let x = (number as f64 + 0.5) * MESH - HALF_LENGTH;
        builder.cylinder(
            wire,
            DVec3::new(x, 0.03, z),
            DVec3::new(x, HEIGHT, z),
            WIRE_RADIUS,
            sides(number),
        );
    }
}

/// From end post to end post; the ends are hidden inside.
fn level_wires(builder: &mut Builder, wire: MaterialId) {
    let count = (HEIGHT / MESH).round() as usize;
    for number in 0..count {
        let y = (number as f64 + 0.5) * MESH;
        builder.cylinder(
            wire,
            DVec3::new(-HALF_LENGTH, y, 0.0),
            DVec3::new(HALF_LENGTH, y, 0.0),
            WIRE_RADIUS,
            sides(number + 1),
        );
    }
}

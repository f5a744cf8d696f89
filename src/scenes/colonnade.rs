//! A colonnade 36 m long and 5.5 m high: thirteen fluted columns under arches, a thin railing
//! between them, and a floor, a back wall and a roof. About 54 000 triangles.
//!
//! It tests curved surfaces whose shading and geometric normals differ, occluders from 2 cm
//! (railing) to 36 m (roof), thin parts in front of far ones, and a walk that is dark because of a
//! roof most views do not see.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DVec2, DVec3};

use super::builder::{Base, Builder, MaterialId, around};
use super::{Scene, View};

pub(super) const NAME: &str = "colonnade";

const COLUMNS: usize = 13;
/// Distance from one column's axis to the next, in metres.
const BAY: f64 = 3.0;
/// Heights above the floor, in metres, at which the parts of a column end.
const PLINTH_TOP: f64 = 0.15;
const BASE_TOP: f64 = 0.4;
const SHAFT_TOP: f64 = 3.4;
const CAPITAL_TOP: f64 = 3.7;
const ABACUS_TOP: f64 = 3.8;
const ROOF_UNDERSIDE: f64 = 5.3;
/// Half the width of the plinth and of the abacus, the slabs below and above a column.
const SLAB_HALF: f64 = 0.35;
const SHAFT_RADIUS: f64 = 0.25;
/// Distance of the arches' feet from the columns' axes: 2 cm within the abacus.
const FOOT: f64 = SLAB_HALF - 0.02;
const ARCH_RADIUS: f64 = BAY / 2.0 - FOOT;
const ARCH_SEGMENTS: usize = 24;
/// Half the thickness of the wall the arches pierce.
const WALL_HALF: f64 = 0.22;
const BACK_WALL_Z: f64 = -4.0;
/// How far one piece is sunk into the next, so that their faces do not coincide.
const SUNK: f64 = 0.01;

/// Builds the colonnade.
pub fn colonnade() -> Scene {
    let mut builder = Builder::default();
    let stone = builder.surface([0.62, 0.58, 0.5]);
    let paving = builder.surface([0.4, 0.38, 0.36]);
    let plaster = builder.surface([0.7, 0.45, 0.3]);
    let iron = builder.surface([0.08, 0.08, 0.09]);

    enclosure(&mut builder, paving, plaster, stone);
    for index in 0..COLUMNS {
        column(&mut builder, stone, column_x(index));
    }
    for end in [-1.0, 1.0] {
        wall_end(&mut builder, stone, end);
    }
    for index in 0..COLUMNS - 1 {
        let middle = f64::midpoint(column_x(index), column_x(index + 1));
        arch(&mut builder, stone, middle);
        railing(&mut builder, iron, middle);
    }

    let views = vec![
        View {
            name: "outside",
            eye: [7.0, 2.2, 9.0],
            target: [0.5, 2.4, -1.0],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 50.0,
            near: 0.1,
        },
        View {
            name: "walk",
            eye: [-16.0, 1.7, -2.2],
            target: [10.0, 1.8, -1.6],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 60.0,
            near: 0.1,
        },
        View {
            name: "railing",
            eye: [1.2, 0.7, 0.5],
            target: [0.2, 0.4, -0.1],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 55.0,
            near: 0.02,
        },
    ];
    builder.finish(NAME, views, 2.0)
}

fn column_x(index: usize) -> f64 {
    (index as f64 - (COLUMNS - 1) as f64 / 2.0) * BAY
}

fn enclosure(builder: &mut Builder, paving: MaterialId, plaster: MaterialId, stone: MaterialId) {
    let half_length = column_x(COLUMNS - 1) + SLAB_HALF + 0.2;
    builder.grid(
        paving,
        DVec3::new(-half_length - 2.0, 0.0, 6.0),
        DVec3::X * 2.0 * (half_length + 2.0),
        DVec3::NEG_Z * 12.0,
        [44, 12],
    );
    builder.aligned_block(
        plaster,
        DVec3::new(-half_length, 0.0, BACK_WALL_Z - 0.3),
        DVec3::new(half_length, ROOF_UNDERSIDE + SUNK, BACK_WALL_Z),
        Base::Open,
    );
    builder.aligned_block(
        stone,
        DVec3::new(-half_length - 0.3, ROOF_UNDERSIDE, BACK_WALL_Z - 0.5),
        DVec3::new(half_length + 0.3, ROOF_UNDERSIDE + 0.2, 0.6),
        Base::Closed,
    );
}

fn column(builder: &mut Builder, stone: MaterialId, x: f64) {
    let axis = DVec3::X * x;
    let slab = DVec3::new(SLAB_HALF, 0.0, SLAB_HALF);
    builder.aligned_block(
        stone,
        axis - slab,
        axis + slab + DVec3::Y * PLINTH_TOP,
        Base::Open,
    );
    builder.aligned_block(
        stone,
        axis - slab + DVec3::Y * CAPITAL_TOP,
        axis + slab + DVec3::Y * ABACUS_TOP,
        Base::Closed,
    );
    let pose = DAffine3::from_translation(axis);
    builder.lathe(stone, pose, &base_profile(), 32);
    builder.lathe(stone, pose, &capital_profile(), 32);
    shaft(builder, stone, axis);
}

/// Two rolls, the upper one smaller, as on an Attic base.
fn base_profile() -> Vec<DVec2> {
    let lower = roll(DVec2::new(0.27, PLINTH_TOP - SUNK), 0.14, 0.065);
    let upper = roll(DVec2::new(0.25, 0.28), BASE_TOP + SUNK - 0.28, 0.045);
    // Level to within the shaft, under its flutes.
    let inner = DVec2::new(0.18, BASE_TOP + SUNK);
    lower.into_iter().chain(upper).chain([inner]).collect()
}

/// A flaring bell.
fn capital_profile() -> Vec<DVec2> {
    let steps = 10;
    let (low, high) = (SHAFT_TOP - SUNK, CAPITAL_TOP + SUNK);
    let bell = (0..=steps).map(|step| {
        let t = f64::from(step) / f64::from(steps);
        DVec2::new(0.22 + 0.12 * t * t, low + (high - low) * t)
    });
    // Level from within the shaft, over its flutes.
    let inner = DVec2::new(0.16, low);
    [inner].into_iter().chain(bell).collect()
}

/// A half round of the given height bulging out by `bulge`, from `foot` up.
fn roll(foot: DVec2, height: f64, bulge: f64) -> Vec<DVec2> {
    let steps = 6;
    (0..=steps)
        .map(|step| {
            let (sin, cos) = (PI * f64::from(step) / f64::from(steps)).sin_cos();
            foot + DVec2::new(bulge * sin, height * (1.0 - cos) / 2.0)
        })
        .collect()
}

/// A shaft with twenty flutes that narrows upward.
fn shaft(builder: &mut Builder, stone: MaterialId, axis: DVec3) {
    const FLUTES: usize = 20;
    const SIDES: usize = FLUTES * 6;
    const RINGS: usize = 8;
    /// Depth of a flute as a share of the radius.
    const DEPTH: f64 = 0.08;
    /// Share of the radius lost from bottom to top.
    const TAPER: f64 = 0.16;

    let height = SHAFT_TOP - BASE_TOP;
    builder.lattice(stone, [SIDES, RINGS], |i, j| {
        let outward = around(i, SIDES);
        let onward = DVec3::Y.cross(outward);
        let phase = TAU * (i % (SIDES / FLUTES)) as f64 / (SIDES / FLUTES) as f64;
        let flute = 1.0 - DEPTH * (1.0 - phase.cos()) / 2.0;
        // Derivative of `flute` by the angle around the axis.
        let flute_slope = -DEPTH * FLUTES as f64 * phase.sin() / 2.0;
        let t = j as f64 / RINGS as f64;
        let radius = SHAFT_RADIUS * (1.0 - TAPER * t);
        let radius_slope = -SHAFT_RADIUS * TAPER / height;

        let position = outward * (radius * flute) + DVec3::Y * (BASE_TOP + height * t);
        let by_angle = outward * (radius * flute_slope) + onward * (radius * flute);
        let by_height = outward * (radius_slope * flute) + DVec3::Y;
        (axis + position, by_angle.cross(by_height).normalize())
    });
}

/// The wall above one bay, pierced by a round arch. Its top is hidden by the roof and its feet
/// stand in the abaci, so it has neither top nor bottom.
fn arch(builder: &mut Builder, stone: MaterialId, middle: f64) {
    let spring = ABACUS_TOP - SUNK;
    let arc = |step: usize| {
        let (sin, cos) = (PI * step as f64 / ARCH_SEGMENTS as f64).sin_cos();
        // From the left foot over the crown to the right one.
        DVec2::new(-cos, sin)
    };
    let mut outline = vec![DVec2::new(middle - BAY / 2.0, spring)];
    outline.extend(
        (0..=ARCH_SEGMENTS).map(|step| DVec2::new(middle, spring) + arc(step) * ARCH_RADIUS),
    );
    outline.push(DVec2::new(middle + BAY / 2.0, spring));

    let top = ROOF_UNDERSIDE + SUNK;
    let last = outline.len() - 1;
    for side in [1.0, -1.0] {
        builder.lattice(stone, [last, 1], |i, j| {
            // Seen from behind, left is right.
            let point = outline[if side > 0.0 { i } else { last - i }];
            let y = [point.y, top][j];
            (DVec3::new(point.x, y, side * WALL_HALF), DVec3::Z * side)
        });
    }
    builder.lattice(stone, [ARCH_SEGMENTS, 1], |i, j| {
        let point = outline[i + 1];
        let z = [-WALL_HALF, WALL_HALF][j];
        (point.extend(z), -arc(i).extend(0.0))
    });
}

/// The wall over the outer half of an end column; `end` is -1 or 1.
fn wall_end(builder: &mut Builder, stone: MaterialId, end: f64) {
    let axis = end * column_x(COLUMNS - 1);
    let outer = axis + end * FOOT;
    builder.aligned_block(
        stone,
        DVec3::new(axis.min(outer), ABACUS_TOP - SUNK, -WALL_HALF),
        DVec3::new(axis.max(outer), ROOF_UNDERSIDE + SUNK, WALL_HALF),
        Base::Open,
    );
}

/// Two rails and upright bars of 2.4 cm between two columns.
fn railing(builder: &mut Builder, iron: MaterialId, middle: f64) {
    const BARS: usize = 11;
    const BAR_RADIUS: f64 = 0.012;
    const RAIL_RADIUS: f64 = 0.03;
    const LOWER: f64 = 0.12;
    const UPPER: f64 = 0.95;

    // To the axes of the columns: the ends are hidden inside.
    let half = BAY / 2.0;
    for (height, radius) in [(LOWER, RAIL_RADIUS * 0.6), (UPPER, RAIL_RADIUS)] {
        builder.cylinder(
            iron,
            DVec3::new(middle - half, height, 0.0),
            DVec3::new(middle + half, height, 0.0),
            radius,
            10,
        );
    }
    let clear = 2.0 * (half - SHAFT_RADIUS);
    for bar in 0..BARS {
        let x = middle + clear * ((bar as f64 + 0.5) / BARS as f64 - 0.5);
        builder.cylinder(
            iron,
            DVec3::new(x, LOWER, 0.0),
            DVec3::new(x, UPPER, 0.0),
            BAR_RADIUS,
            8,
        );
    }
}

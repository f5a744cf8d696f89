//! Coloured dominoes half a metre tall, standing along a spiral and two waves on a floor of 13 m
//! by 13 m; the first of the spiral topples. About 280 boxes, 3 100 triangles.
//!
//! It tests occlusion between close parallel faces that hide each other, colour bleeding from
//! faces turned away from the camera, and a contact line under a leaning box.

use std::f64::consts::TAU;

use glam::{DAffine3, DQuat, DVec2, DVec3};

use super::builder::{Base, Builder, MaterialId};
use super::hash::hash;
use super::{Scene, View};

pub(super) const NAME: &str = "dominoes";

/// Thickness, height and width, in metres.
const SIZE: DVec3 = DVec3::new(0.07, 0.5, 0.25);
/// Distance between neighbours along the curve, in metres.
const SPACING: f64 = 0.2;
/// At this angle the toppling domino still clears its neighbour by about 3 cm.
const LEAN_DEGREES: f64 = 12.0;

const COLOURS: [[f32; 3]; 8] = [
    [0.72, 0.08, 0.06],
    [0.85, 0.4, 0.05],
    [0.82, 0.7, 0.08],
    [0.12, 0.5, 0.12],
    [0.06, 0.4, 0.55],
    [0.08, 0.12, 0.6],
    [0.42, 0.1, 0.5],
    [0.8, 0.8, 0.78],
];

/// Builds the dominoes.
pub fn dominoes() -> Scene {
    let mut builder = Builder::default();
    let floor = builder.surface([0.55, 0.5, 0.45]);
    let colours = COLOURS.map(|albedo| builder.surface(albedo));

    builder.grid(
        floor,
        DVec3::new(-6.5, 0.0, 6.5),
        DVec3::X * 13.0,
        DVec3::NEG_Z * 13.0,
        [13, 13],
    );
    let places = spiral().chain(wave(1.0)).chain(wave(-1.0));
    for (index, place) in places.enumerate() {
        let colour = colours[hash(index as u32) as usize % COLOURS.len()];
        if index == 0 {
            toppling(&mut builder, colour, place);
        } else {
            standing(&mut builder, colour, place);
        }
    }

    let views = vec![
        View {
            name: "above",
            eye: [0.5, 5.0, 8.5],
            target: [0.0, 0.0, 0.3],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 50.0,
            near: 0.1,
        },
        View {
            name: "toppling",
            eye: [-3.7, 0.4, -0.7],
            target: [-3.0, 0.2, 0.1],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 55.0,
            near: 0.02,
        },
    ];
    builder.finish(NAME, views, 0.5)
}

/// Inward from (-3, 0) by two and a half turns, 0.88 m apart.
fn spiral() -> impl Iterator<Item = DAffine3> {
    along(|t| DVec2::from_angle(-2.5 * TAU * (1.0 - t)) * (3.0 - 2.2 * t))
}

/// A wave beside the spiral, on the side of +Z or -Z.
fn wave(side: f64) -> impl Iterator<Item = DAffine3> {
    along(move |t| {
        let x = 10.0 * t - 5.0;
        DVec2::new(x, side * (4.5 + 0.7 * (1.5 * x).sin()))
    })
}

/// Poses every `SPACING` along a curve in the (x, z) plane whose parameter runs from 0 to 1. Local
/// X points along the curve and the origin lies on the floor.
fn along(curve: impl Fn(f64) -> DVec2) -> impl Iterator<Item = DAffine3> {
    /// Short enough (under 2 mm of curve) that a straight step is as long as the curve.
    const STEPS: u32 = 20_000;
    let mut walked = 0.0;
    let mut next = 0.0;
    (0..STEPS).filter_map(move |step| {
        let here = curve(f64::from(step) / f64::from(STEPS));
        let onward = curve(f64::from(step + 1) / f64::from(STEPS)) - here;
        let due = walked >= next;
        walked += onward.length();
        due.then(|| {
            next += SPACING;
            let turn = DQuat::from_rotation_y((-onward.y).atan2(onward.x));
            DAffine3::from_rotation_translation(turn, DVec3::new(here.x, 0.0, here.y))
        })
    })
}

fn standing(builder: &mut Builder, colour: MaterialId, place: DAffine3) {
    let upright = DAffine3::from_translation(DVec3::Y * SIZE.y / 2.0);
    builder.block(colour, place * upright, SIZE / 2.0, Base::Open);
}

/// Leans over its leading lower edge, which a tenth of a millimetre keeps off the floor.
fn toppling(builder: &mut Builder, colour: MaterialId, place: DAffine3) {
    let edge = DVec3::new(SIZE.x / 2.0, 1e-4, 0.0);
    let lean = DQuat::from_rotation_z(-LEAN_DEGREES.to_radians());
    let about_edge = DAffine3::from_rotation_translation(lean, edge);
    let from_edge = DAffine3::from_translation(DVec3::new(-SIZE.x / 2.0, SIZE.y / 2.0, 0.0));
    builder.block(
        colour,
        place * about_edge * from_edge,
        SIZE / 2.0,
        Base::Closed,
    );
}

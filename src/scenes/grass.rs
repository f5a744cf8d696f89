//! A lawn of 2 m by 2 m about a stone: 1 500 cards, each with three blades of grass in its picture.
//!
//! It tests alpha-tested triangles. The blades are triangles too, and alpha grows evenly across their edges, so that what is
//! there by the picture is what the same blades are as triangles of their own: [`grass_cut_out`].

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use super::builder::{Base, Builder};
use super::hash::unit;
use super::holes::{HoleTest, Holes};
use super::{Scene, View};
use crate::AlphaWrap;

pub(super) const NAME: &str = "grass";
pub(super) const CUT_OUT_NAME: &str = "grass-cut-out";

const CARDS: u32 = 1500;
const HALF_SIDE: f64 = 1.0;
/// Width and height of a card, in metres.
const CARD: [f64; 2] = [0.09, 0.22];
/// Texels a side of the picture, and texels across an edge in which alpha goes from 0 to 1.
const TEXELS: u32 = 128;
const RAMP: f64 = 4.0;
const THRESHOLD: f32 = 0.5;

/// Blades in a card's texture coordinates: where a blade's base begins and ends, below, and its tip.
const BLADES: [[DVec2; 3]; 3] = [
    [
        DVec2::new(0.06, 1.0),
        DVec2::new(0.30, 1.0),
        DVec2::new(0.12, 0.18),
    ],
    [
        DVec2::new(0.36, 1.0),
        DVec2::new(0.62, 1.0),
        DVec2::new(0.55, 0.06),
    ],
    [
        DVec2::new(0.68, 1.0),
        DVec2::new(0.94, 1.0),
        DVec2::new(0.90, 0.32),
    ],
];

/// Builds the lawn of cards with holes.
pub fn grass() -> Scene {
    let mut scene = build(NAME, true);
    let tests = HoleTest {
        layer: 0,
        threshold: THRESHOLD,
        wrap: [AlphaWrap::ClampToEdge; 2],
    };
    // The cards are the last material's, four vertices each.
    let first = scene.positions.len() - 4 * CARDS as usize;
    let mut tex_coords = vec![[0.0; 2]; first];
    // As a lattice of one cell has its corners.
    tex_coords.extend((0..CARDS).flat_map(|_| [[0.0, 1.0], [1.0, 1.0], [0.0, 0.0], [1.0, 0.0]]));
    scene.holes = Some(Holes {
        tex_coords,
        size: [TEXELS; 2],
        maps: vec![picture()],
        tests: vec![None, None, Some(tests)],
    });
    scene
}

/// Builds the same lawn with each blade a triangle of its own.
pub fn grass_cut_out() -> Scene {
    build(CUT_OUT_NAME, false)
}

fn build(name: &'static str, cards: bool) -> Scene {
    let mut builder = Builder::default();
    let ground = builder.surface([0.3, 0.22, 0.15]);
    let stone = builder.surface([0.5, 0.5, 0.48]);
    let blade = builder.surface([0.2, 0.45, 0.1]);
    builder.grid(
        ground,
        DVec3::new(-1.5, 0.0, 1.5),
        DVec3::X * 3.0,
        DVec3::NEG_Z * 3.0,
        [6, 6],
    );
    builder.aligned_block(
        stone,
        DVec3::new(-0.25, 0.0, -0.2),
        DVec3::new(0.2, 0.18, 0.15),
        Base::Open,
    );
    for number in 0..CARDS {
        let draw = |salt: u32| unit(number.wrapping_mul(8).wrapping_add(salt));
        let place = DVec3::new(
            HALF_SIDE * (2.0 * draw(0) - 1.0),
            // A little below the ground: nothing of the lowest row, where the picture ends, is seen.
            -0.004,
            HALF_SIDE * (2.0 * draw(1) - 1.0),
        );
        let angle = TAU * draw(2);
        let along = DVec3::new(angle.cos(), 0.0, angle.sin());
        let lean = DVec3::new(angle.sin(), 0.0, -angle.cos()) * (0.5 * draw(3));
        let size = 0.7 + 0.6 * draw(4);
        let across = along * (CARD[0] * size);
        let upward = (DVec3::Y + lean).normalize() * (CARD[1] * size);
        let corner = place - 0.5 * across;
        let at = |uv: DVec2| corner + across * uv.x + upward * (1.0 - uv.y);
        if cards {
            builder.grid(blade, corner, across, upward, [1, 1]);
        } else {
            let normal = across.cross(upward).normalize();
            for corners in BLADES {
                builder.triangle(blade, corners.map(at), normal);
            }
        }
    }
    let views = vec![
        View {
            name: "over",
            eye: [0.9, 0.75, 1.5],
            target: [0.0, 0.05, 0.0],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 45.0,
            near: 0.05,
        },
        View {
            name: "among",
            eye: [0.35, 0.2, 0.75],
            target: [0.0, 0.08, 0.0],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 55.0,
            near: 0.005,
        },
    ];
    builder.finish(name, views, 0.3)
}

/// Alpha of a card's picture: by how far a texel is within the nearest blade, in texels.
fn picture() -> Vec<u8> {
    let texels = f64::from(TEXELS);
    let mut alpha = Vec::with_capacity((TEXELS * TEXELS) as usize);
    for y in 0..TEXELS {
        for x in 0..TEXELS {
            let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) / texels;
            let within = |[a, b, tip]: [DVec2; 3]| {
                // The base is at the picture's end: two edges are left.
                let inside = |from: DVec2, to: DVec2| {
                    let way = to - from;
                    (at - from).perp_dot(way) / way.length() * texels
                };
                inside(b, tip).min(inside(tip, a))
            };
            let most = BLADES.map(within).into_iter();
            let most = most.fold(f64::NEG_INFINITY, f64::max);
            alpha.push(((0.5 + most / RAMP).clamp(0.0, 1.0) * 255.0).round() as u8);
        }
    }
    alpha
}

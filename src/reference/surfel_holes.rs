//! Mirror of `wgsl/surfel_holes.wgsl`.

use glam::DVec3;

use super::{
    alpha_test::{AlphaMaps, Cutout},
    hashing::{hash, hash2, unit_float},
    surfelizer::{Piece, SHAPE_ORDER, SHAPE_PATH_SHIFT, SHAPE_SMALL, Surfel, Triangle, leaf_of},
};
use crate::Placement;

const ROWS: f64 = 4.0;
const PARTS: u32 = 16;

/// Uniform over a part of a triangle.
fn point_in(t: Triangle, part: u32, key: u32) -> DVec3 {
    let row = u32::from(part >= 1) + u32::from(part >= 4) + u32::from(part >= 9);
    let along = part - row * row;
    let draw = hash2(key, part);
    let u = unit_float(draw).sqrt();
    let uv = u * unit_float(hash(draw ^ 0x5bd1_e995));
    let upright = along & 1 == 0;
    let down = f64::from(row) + if upright { u } else { 1.0 - u };
    let aside = f64::from(along / 2) + if upright { uv } else { 1.0 - uv };
    t.a + (t.b - t.a) * ((down - aside) / ROWS) + (t.c - t.a) * (aside / ROWS)
}

/// A surfel of a piece with holes as it is once it fits them; `cutout` is the piece's.
#[must_use]
pub fn fitted(
    surfel: &Surfel,
    piece: &Piece,
    (cutout, maps): (&Cutout, &AlphaMaps),
    placement: Placement,
) -> Surfel {
    let t = piece.corners;
    let is_there = |point: DVec3| {
        let uv = cutout.tex_coords_of(&t, point);
        maps.alpha_at(uv, cutout.layer, cutout.wrap) >= cutout.threshold
    };
    let is_small = piece.shape & SHAPE_SMALL != 0;
    let mut fitted = *surfel;
    if placement == Placement::Centroid || is_small {
        let order = if is_small {
            0
        } else {
            piece.shape & SHAPE_ORDER
        };
        let leaf = leaf_of(t, surfel.leaf, order);
        let key = hash2(
            hash2(piece.triangle, piece.shape >> SHAPE_PATH_SHIFT),
            surfel.leaf,
        );
        let mut found = 0;
        let mut middle = DVec3::ZERO;
        for part in 0..PARTS {
            let point = point_in(leaf, part, key);
            if is_there(point) {
                found += 1;
                middle += point - surfel.position;
            }
        }
        fitted.position += middle / f64::from(found.max(1));
        fitted.radius *= (f64::from(found) / f64::from(PARTS)).sqrt();
    } else if !is_there(surfel.position) {
        fitted.radius = 0.0;
    }
    fitted
}

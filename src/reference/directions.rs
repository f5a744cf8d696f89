//! Mirror of `wgsl/common/directions.wgsl`: sequences in the shader's own integers, angles in f64.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use glam::{DMat3, DVec2, DVec3};

use super::hashing::{hash, unit_float};
use crate::{
    BouncedSettings, Sampling, bounced_z_buffer::params::grid, reference::shell_splatter::Receiver,
};

/// The second coordinate of Sobol's (0,2)-sequence, its bits reversed, the lowest one being worth 1/2. The first one is the
/// index in the same way.
pub fn sobol2(index: u32) -> u32 {
    // Bit j is the sum of the bits that have all of j's.
    [0x5555_5555, 0x3333_3333, 0x0f0f_0f0f, 0x00ff_00ff, 0xffff]
        .into_iter()
        .enumerate()
        .fold(index, |v, (power, low)| v ^ ((v >> (1 << power)) & low))
}

/// Owen's scrambling of a number in reversed bits (Laine and Karras 2011).
pub fn scramble(bits: u32, key: u32) -> u32 {
    let mut v = bits ^ bits.wrapping_mul(0x3d20_adea);
    v = v.wrapping_add(key);
    v = v.wrapping_mul((key >> 16) | 1);
    v ^= v.wrapping_mul(0x0552_6c56);
    v ^ v.wrapping_mul(0x53a2_2864)
}

/// What a step to the next column and to the next row adds to x and to y, in units of 2⁻³².
pub const LATTICE: [[u32; 2]; 2] = [
    [1_784_664_572, 1_394_608_229],
    [1_036_808_364, 2_481_981_723],
];

/// By what the points of a further set are off those of the set before, in units of 2⁻³².
pub const TURN_STEP: [u32; 2] = [3_242_174_889, 2_447_445_414];

/// The fractional part of the golden ratio, in the same units.
pub const GOLDEN_STEP: u32 = 2_654_435_769;

/// Where in its cell, in those units, the point lies of a key's further set of rays.
pub(super) fn point_within(pixel: [u32; 2], [index, turn]: [u32; 2], frame: u32) -> [u32; 2] {
    let key = hash(index + 1);
    let over_frames = [scramble(frame, key), scramble(sobol2(frame), hash(key))];
    [0, 1].map(|axis: usize| {
        let [column, row] = LATTICE[axis];
        let over_pixels = column
            .wrapping_mul(pixel[0])
            .wrapping_add(row.wrapping_mul(pixel[1]));
        let within = over_pixels.wrapping_add(over_frames[axis].reverse_bits());
        within.wrapping_add(turn.wrapping_mul(TURN_STEP[axis]))
    })
}

/// A point of the unit square for one of `count` rays that no grid suits.
pub fn strewn_point(pixel: [u32; 2], [index, turn]: [u32; 2], count: u32, frame: u32) -> DVec2 {
    let [x, y] = point_within(pixel, [0, turn], frame);
    let x = unit_float(x.wrapping_add(index.wrapping_mul(GOLDEN_STEP)));
    DVec2::new(x, (f64::from(index) + unit_float(y)) / f64::from(count))
}

/// The point of cell `index` of columns × rows, in the unit square, of a pixel's first set.
pub fn cell_point(pixel: [u32; 2], index: u32, grid: [u32; 2], frame: u32) -> DVec2 {
    further_point(pixel, [index, 0], grid, frame)
}

/// That of the further set `turn`.
pub fn further_point(
    pixel: [u32; 2],
    [index, turn]: [u32; 2],
    [columns, rows]: [u32; 2],
    frame: u32,
) -> DVec2 {
    let [x, y] = point_within(pixel, [index, turn], frame).map(unit_float);
    DVec2::new(
        (f64::from(index % columns) + x) / f64::from(columns),
        (f64::from(index / columns) + y) / f64::from(rows),
    )
}

/// The unit square to the unit disk by equal areas (Shirley and Chiu 1997).
pub fn concentric_disk(square: DVec2) -> DVec2 {
    let p = 2.0 * square - 1.0;
    if p == DVec2::ZERO {
        return DVec2::ZERO;
    }
    let wide = p.x.abs() > p.y.abs();
    let (radius, angle) = if wide {
        (p.x, FRAC_PI_4 * (p.y / p.x))
    } else {
        (p.y, FRAC_PI_2 - FRAC_PI_4 * (p.x / p.y))
    };
    radius * DVec2::from_angle(angle)
}

/// Two unit vectors that complete n to a right-handed frame (Duff et al. 2017). It turns over where n.z is −0.2, where few
/// walls face: at 0, where theirs do, rounding would decide for those along an axis.
pub fn tangent_frame(n: DVec3) -> DMat3 {
    let s = if n.z >= -0.2 { 1.0 } else { -1.0 };
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    DMat3::from_cols(
        DVec3::new(1.0 + s * n.x * n.x * a, s * b, -s * n.x),
        DVec3::new(b, s + n.y * n.y * a, -n.y),
        n,
    )
}

/// A direction, and how it was drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// A unit vector.
    pub direction: DVec3,
    /// Density over solid angle with which it was drawn, 1/sr.
    pub pdf: f64,
}

/// A point of the unit square to the hemisphere about a unit normal.
pub fn hemisphere_direction(point: DVec2, normal: DVec3, sampling: Sampling) -> Direction {
    let disk = concentric_disk(point);
    let r2 = disk.length_squared();
    match sampling {
        Sampling::Uniform => {
            let height = 1.0 - r2;
            let d = (disk * (2.0 - r2).max(0.0).sqrt()).extend(height);
            Direction {
                direction: tangent_frame(normal) * d,
                pdf: 0.5 / PI,
            }
        }
        // Glossy directions are those of `ggx`.
        Sampling::Cosine | Sampling::Glossy => {
            let height = (1.0 - r2).max(0.0).sqrt();
            Direction {
                direction: tangent_frame(normal) * disk.extend(height),
                pdf: height / PI,
            }
        }
    }
}

/// All directions of a view: of each pixel, rows from the top, one after the other, as many as the settings say and one
/// at least; `None` for the sky.
pub fn directions(
    receivers: &[Option<Receiver>],
    width: u32,
    settings: &BouncedSettings,
    sampling: Sampling,
) -> Vec<Option<Direction>> {
    let grid = grid(settings.rays_per_pixel);
    (0..)
        .zip(receivers)
        .flat_map(|(i, receiver)| {
            (0..grid[0] * grid[1]).map(move |index| {
                let point = cell_point([i % width, i / width], index, grid, settings.frame);
                receiver.map(|r| hemisphere_direction(point, r.normal, sampling))
            })
        })
        .collect()
}

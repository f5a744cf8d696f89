//! What the GPU reads: `Params` of `wgsl/bounced_z_buffer.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::{settings::BouncedSettings, words};
use crate::surfel::CloudCapacity;

/// Stands for infinity; its square is finite in f32.
const UNBOUNDED: f32 = 1e18;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BouncedParams {
    pub(crate) size: [u32; 2],
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    pub(crate) frame: u32,
    pub(crate) words: u32,
    pub(crate) piece_capacity: u32,
    pub(crate) surfel_capacity: u32,
    pub(crate) background: [f32; 3],
    pub(crate) world_radius: f32,
}

impl BouncedParams {
    pub fn new(settings: &BouncedSettings, size: [u32; 2], capacity: CloudCapacity) -> Self {
        let [columns, rows] = grid(settings.directions);
        // Without directions nothing is met and nothing arrives.
        let (background, radius) = if settings.directions == 0 {
            ([0.0; 3], 0.0)
        } else {
            (settings.background, settings.radius)
        };
        Self {
            size,
            columns,
            rows,
            frame: settings.frame,
            words: words(settings.directions),
            piece_capacity: capacity.pieces,
            surfel_capacity: capacity.surfels,
            background,
            world_radius: radius.min(UNBOUNDED),
        }
    }
}

/// Columns and rows of the grid of directions: the two factors that are nearest each other.
pub(crate) fn grid(directions: u32) -> [u32; 2] {
    let n = directions.max(1);
    let rows = (1..=n.isqrt())
        .rev()
        .find(|r| n.is_multiple_of(*r))
        .unwrap_or(1);
    [n / rows, rows]
}

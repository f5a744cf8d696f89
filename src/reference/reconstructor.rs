//! Mirror of `wgsl/reconstructor.wgsl`, a pixel at a time where the shader takes four.

use std::ops::{AddAssign, Mul};

use glam::{DVec3, DVec4};
use rayon::prelude::*;

use super::shell_splatter::Receiver;
use crate::{Camera, ReconstructorSettings};

/// An effect's sum.
pub trait Sum: Copy + Default + Send + Sync + AddAssign + Mul<f64, Output = Self> {
    /// Whether it can be used: one that overflowed or is NaN counts for nothing, here and in its neighbours.
    fn is_usable(self) -> bool;
}

impl Sum for f64 {
    fn is_usable(self) -> bool {
        self.is_finite()
    }
}

impl Sum for DVec3 {
    fn is_usable(self) -> bool {
        self.is_finite()
    }
}

impl Sum for DVec4 {
    fn is_usable(self) -> bool {
        self.is_finite()
    }
}

/// What a reconstruction works on.
#[derive(Clone, Copy, Debug)]
pub struct Reconstruction<'a> {
    /// The camera of the view.
    pub camera: &'a Camera,
    /// The eye that positions are relative to.
    pub origin: DVec3,
    /// The pixels of the viewport, rows from the top; `None` for the sky.
    pub receivers: &'a [Option<Receiver>],
    /// The settings.
    pub settings: &'a ReconstructorSettings,
}

/// 1 for a pixel itself; exactly 0 across an edge in depth or between perpendicular surfaces.
fn similarity(p: &Receiver, per_tolerance: f64, q: &Receiver, power: f64) -> f64 {
    let d = q.position - p.position;
    let off_plane = p.normal.dot(d).abs().max(q.normal.dot(d).abs()) * per_tolerance;
    let in_plane = (1.0 - off_plane * off_plane).max(0.0);
    let base = (1.0 - power / 8.0 * (1.0 - p.normal.dot(q.normal))).max(0.0);
    in_plane * in_plane * base.powi(8)
}

impl Reconstruction<'_> {
    fn size(&self) -> [i32; 2] {
        let viewport = self.camera.viewport();
        [viewport.width as i32, viewport.height as i32]
    }

    fn index(&self, [x, y]: [i32; 2]) -> usize {
        (y * self.size()[0] + x) as usize
    }

    fn half_width(&self, level: u32) -> i32 {
        (self.settings.radius * (1_u32 << level) as f32).round_ties_even() as i32
    }

    /// The mean about a pixel along an axis, 0 for x and 1 for y; `None` for the sky.
    fn smoothed<S: Sum>(&self, sums: &[S], first: [i32; 2], along: usize, level: u32) -> Option<S> {
        let width = self.half_width(level);
        let p = self.receivers[self.index(first)]?;
        let footprint = self.camera.footprint();
        let pixel = footprint.at(p.position - (self.camera.eye() - self.origin));
        let tolerance = f64::from(self.settings.plane_distance) * f64::from(width) * pixel;
        let per_tolerance = 1.0 / tolerance.max(1e-30);
        let power = f64::from(self.settings.normal_power);
        let mut mean = S::default();
        let mut weights = 0.0;
        let start = first[along];
        let end = (start + width).min(self.size()[along] - 1);
        for t in (start - width).max(0)..=end {
            let mut there = first;
            there[along] = t;
            let i = self.index(there);
            let Some(q) = self.receivers[i].filter(|_| sums[i].is_usable()) else {
                continue;
            };
            let weight = if t == start {
                1.0
            } else {
                similarity(&p, per_tolerance, &q, power)
            };
            mean += sums[i] * weight;
            weights += weight;
        }
        Some(mean * (1.0 / f64::max(weights, 1e-30)))
    }

    fn smooth<S: Sum>(&self, sums: &[S], along: usize, level: u32) -> Vec<S> {
        let width = self.size()[0];
        (0..self.receivers.len() as i32)
            .into_par_iter()
            .map(|i| {
                self.smoothed(sums, [i % width, i / width], along, level)
                    .unwrap_or_default()
            })
            .collect()
    }

    /// The total of all levels, as it goes into the effect's `resolve`; `sums` holds a list a level.
    pub fn reconstruct<S: Sum>(&self, sums: &[Vec<S>]) -> Vec<S> {
        let mut total: Vec<S> = sums[0]
            .iter()
            .zip(self.receivers)
            .map(|(&finest, receiver)| {
                if receiver.is_some() && finest.is_usable() {
                    finest
                } else {
                    S::default()
                }
            })
            .collect();
        for (level, sums) in (0..).zip(sums).skip(1) {
            let rows = self.smooth(sums, 0, level);
            let means = self.smooth(&rows, 1, level);
            for (t, mean) in total.iter_mut().zip(means) {
                *t += mean;
            }
        }
        total
    }
}

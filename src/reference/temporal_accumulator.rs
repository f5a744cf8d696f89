//! Mirror of `wgsl/temporal_accumulator.wgsl`.

use glam::{DVec2, DVec3, IVec2};
use rayon::prelude::*;

use super::shell_splatter::Receiver;
use crate::{Camera, TemporalSettings};

/// What a tap that does not fit must be nearer than, off the plane of the pixel, to fit after all; in pixels' sides.
const PLANE_TOLERANCE: f64 = 0.5;
/// The same for a tap of a texel that something else moved away from.
const CLAIMED_TOLERANCE: f64 = 0.125;

/// Whether two surfaces' offsets differ by more than motion vectors in 16 bits may be off.
fn apart(a: DVec2, b: DVec2) -> bool {
    (a - b).length() > 0.0625 + 0.003_906_25 * a.length()
}

/// A pixel's mean, one channel in x, and the number of frames in it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pixel {
    /// The mean; of the sky this frame's value.
    pub mean: DVec3,
    /// 0 where there is no history.
    pub frames: f64,
}

/// What a frame leaves.
#[derive(Clone, Debug)]
pub struct History {
    /// The pixels of the viewport, rows from the top, relative to the frame's eye; `None` for the sky.
    pub receivers: Vec<Option<Receiver>>,
    /// Their means.
    pub pixels: Vec<Pixel>,
}

/// What a recording works on.
#[derive(Clone, Copy, Debug)]
pub struct Accumulation<'a> {
    /// This frame's camera.
    pub camera: &'a Camera,
    /// The last frame's.
    pub previous_camera: &'a Camera,
    /// The pixels of the viewport, rows from the top, relative to this frame's eye; `None` for the sky.
    pub receivers: &'a [Option<Receiver>],
    /// For every pixel of the viewport its position less its surface's in the last frame, in pixels, y down.
    pub motion: Option<&'a [DVec2]>,
    /// This frame's picture, one channel in x.
    pub picture: &'a [DVec3],
    /// The settings.
    pub settings: &'a TemporalSettings,
}

/// The last frame's history, and which pixels moved away from its texels.
struct Last<'a> {
    history: &'a History,
    claims: Vec<Option<usize>>,
}

impl Accumulation<'_> {
    fn size(&self) -> IVec2 {
        let viewport = self.camera.viewport();
        IVec2::new(viewport.width as i32, viewport.height as i32)
    }

    fn pixel(&self, i: usize) -> IVec2 {
        let width = self.size().x;
        IVec2::new(i as i32 % width, i as i32 / width)
    }

    fn index(&self, at: IVec2) -> Option<usize> {
        let size = self.size();
        let inside = at.cmpge(IVec2::ZERO).all() && at.cmplt(size).all();
        inside.then_some((at.y * size.x + at.x) as usize)
    }

    /// Where a surface that stands still was in the last picture, as an offset from its pixel; `position` is relative to
    /// the last eye.
    fn still_offset(&self, pixel: IVec2, position: DVec3) -> Option<DVec2> {
        if self.camera == self.previous_camera {
            return Some(DVec2::ZERO);
        }
        let there = self.previous_camera.project(position)?;
        Some(there.truncate() - (pixel.as_dvec2() + 0.5))
    }

    /// Whether an offset is finite and leads somewhere near the picture.
    fn is_near(&self, offset: DVec2) -> bool {
        offset.is_finite() && offset.abs().cmple(self.size().as_dvec2()).all()
    }

    /// One a texel of the last history: the last pixel that shows now what moved away from about there.
    fn claim(&self) -> Vec<Option<usize>> {
        let mut claims = vec![None; self.receivers.len()];
        let Some(motion) = self.motion else {
            return claims;
        };
        let eye = self.previous_camera.eye() - self.camera.eye();
        for (i, receiver) in self.receivers.iter().enumerate() {
            let pixel = self.pixel(i);
            let offset = -motion[i];
            let Some(receiver) = receiver.filter(|_| self.is_near(offset)) else {
                continue;
            };
            let still = self.still_offset(pixel, receiver.position - eye);
            if still.is_some_and(|still| !apart(offset, still)) {
                continue;
            }
            let middle = pixel + (offset + 0.5).floor().as_ivec2();
            for k in 0..9 {
                if let Some(at) = self.index(middle + IVec2::new(k % 3 - 1, k / 3 - 1)) {
                    claims[at] = Some(i);
                }
            }
        }
        claims
    }

    /// Where the pixel's surface was in the last picture, as an offset from the pixel.
    fn offset(&self, pixel: IVec2, i: usize, position: DVec3) -> Option<DVec2> {
        match self.motion {
            Some(motion) => Some(-motion[i]),
            None => self.still_offset(pixel, position),
        }
    }

    /// Whether a surface with another offset was near a texel of the last history.
    fn is_claimed(&self, last: &Last<'_>, at: usize, offset: DVec2) -> bool {
        (last.claims[at].zip(self.motion))
            .is_some_and(|(claimant, motion)| apart(-motion[claimant], offset))
    }

    /// The history at a texel, if it is of the surface at `position` with `normal`, relative to the last eye, which was
    /// at `offset`.
    fn tap(
        &self,
        last: &Last<'_>,
        at: IVec2,
        offset: DVec2,
        position: DVec3,
        normal: DVec3,
    ) -> Option<Pixel> {
        let i = self.index(at)?;
        let there = last.history.receivers[i]?;
        if normal.dot(there.normal) < f64::from(self.settings.normal_tolerance) {
            return None;
        }
        let side = self.previous_camera.footprint().at(position);
        let mut distance = position.length();
        let mut off_distance = (there.position.length() - distance).abs();
        if !self.previous_camera.is_perspective() {
            distance = side * f64::from(self.size().y);
            let axis = self.previous_camera.rotation().row(2);
            off_distance = axis.dot(there.position - position).abs();
        }
        let off_plane = normal.dot(there.position - position).abs();
        if off_distance > f64::from(self.settings.depth_tolerance) * distance
            && off_plane > PLANE_TOLERANCE * side
        {
            return None;
        }
        if off_plane > CLAIMED_TOLERANCE * side && self.is_claimed(last, i, offset) {
            return None;
        }
        Some(last.history.pixels[i]).filter(|pixel| pixel.frames > 0.0)
    }

    /// The history at an offset from a pixel: bilinear, over the taps that fit.
    fn fetch(
        &self,
        last: &Last<'_>,
        pixel: IVec2,
        offset: DVec2,
        position: DVec3,
        normal: DVec3,
    ) -> Option<Pixel> {
        if !self.is_near(offset) {
            return None;
        }
        let base = offset.floor();
        let fraction = offset - base;
        let first = pixel + base.as_ivec2();
        if fraction == DVec2::ZERO {
            return self.tap(last, first, offset, position, normal);
        }
        let mut mean = DVec3::ZERO;
        let mut weights = 0.0;
        let mut variance = 0.0;
        for corner in [IVec2::ZERO, IVec2::X, IVec2::Y, IVec2::ONE] {
            let along = DVec2::select(corner.cmpeq(IVec2::ONE), fraction, 1.0 - fraction);
            let weight = along.x * along.y;
            if let Some(tap) = self.tap(last, first + corner, offset, position, normal) {
                mean += weight * tap.mean;
                weights += weight;
                variance += weight / tap.frames;
            }
        }
        (weights > 0.0).then(|| Pixel {
            mean: mean / weights,
            frames: weights / variance,
        })
    }

    /// The history drawn towards the mean of the pixels around.
    fn clip(&self, mean: DVec3, pixel: IVec2) -> DVec3 {
        let around: Vec<DVec3> = (0..9)
            .filter_map(|i| self.index(pixel + IVec2::new(i % 3 - 1, i / 3 - 1)))
            .filter(|&i| self.receivers[i].is_some() && self.picture[i].is_finite())
            .map(|i| self.picture[i])
            .collect();
        let count = around.len() as f64;
        let centre = around.iter().sum::<DVec3>() / count;
        let squares = |v: &DVec3| (*v - centre) * (*v - centre);
        let deviation = (around.iter().map(squares).sum::<DVec3>() / count).map(f64::sqrt);
        let extent = deviation / f64::from(self.settings.clamping);
        let off = mean - centre;
        // A channel within its bound is none for the others. One that does not vary has rounding for a bound.
        let is_out = off.abs().cmpgt(extent + 1e-6 * centre.abs());
        let share = extent / off.abs().max(DVec3::splat(1e-30));
        let least = DVec3::select(is_out, share, DVec3::ONE).min_element();
        if least < 1.0 {
            centre + least * off
        } else {
            mean
        }
    }

    /// This frame's history from the last one's, if there is one.
    pub fn accumulate(&self, last: Option<&History>) -> History {
        let last = last
            .filter(|_| self.settings.max_frames > 1)
            .map(|history| Last {
                history,
                claims: self.claim(),
            });
        let eye = self.previous_camera.eye() - self.camera.eye();
        let pixels = (0..self.receivers.len())
            .into_par_iter()
            .map(|i| {
                let pixel = self.pixel(i);
                let now = Some(self.picture[i]).filter(|now| now.is_finite());
                let receiver = self.receivers[i];
                let old = receiver.zip(last.as_ref()).and_then(|(receiver, last)| {
                    let position = receiver.position - eye;
                    let offset = self.offset(pixel, i, position)?;
                    self.fetch(last, pixel, offset, position, receiver.normal)
                });
                match (old, now) {
                    (None, None) => Pixel::default(),
                    (None, Some(now)) => Pixel {
                        mean: now,
                        frames: if receiver.is_some() { 1.0 } else { 0.0 },
                    },
                    (Some(old), None) => old,
                    (Some(old), Some(now)) => {
                        let most = f64::from(self.settings.max_frames) - 1.0;
                        let frames = old.frames.min(most) + 1.0;
                        let mean = if self.settings.clamping > 0.0 {
                            self.clip(old.mean, pixel)
                        } else {
                            old.mean
                        };
                        Pixel {
                            mean: mean + (now - mean) / frames,
                            frames,
                        }
                    }
                }
            })
            .collect();
        History {
            receivers: self.receivers.to_vec(),
            pixels,
        }
    }
}

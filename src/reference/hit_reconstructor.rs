//! Mirror of `wgsl/hit_reconstructor.wgsl`.

use std::f64::consts::PI;

use glam::{DVec3, IVec2};
use rayon::prelude::*;

use super::{
    directions::{Direction, directions},
    shell_splatter::Receiver,
};
use crate::{BouncedSettings, Camera, HitReconstructorSettings, Payload, Sampling};

/// What a reconstruction works on.
#[derive(Clone, Copy, Debug)]
pub struct HitReconstruction<'a> {
    /// The camera of the view.
    pub camera: &'a Camera,
    /// The eye that positions are relative to.
    pub origin: DVec3,
    /// The pixels of the viewport, rows from the top; `None` for the sky.
    pub receivers: &'a [Option<Receiver>],
    /// What the hits were traced with.
    pub traced: &'a BouncedSettings,
    /// What was kept of them.
    pub payload: Payload,
    /// How their directions were drawn.
    pub sampling: Sampling,
    /// The settings.
    pub settings: &'a HitReconstructorSettings,
    /// As [`HitReconstructorDescriptor::deferred`](crate::HitReconstructorDescriptor::deferred).
    pub deferred: bool,
    /// What came along each direction, in the order of [`directions`]: radiance, or 1 where nothing was hit.
    pub incoming: &'a [DVec3],
}

/// A pixel's own mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mean {
    /// The mean.
    pub mean: DVec3,
    /// The variance of its luminance.
    pub variance: f64,
}

/// A receiver's cosine to a direction over the density that the direction was drawn with.
fn share(normal: DVec3, drawn: Direction) -> f64 {
    normal.dot(drawn.direction).max(0.0) / (PI * drawn.pdf.max(1e-6))
}

fn luminance(color: DVec3) -> f64 {
    color.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

impl HitReconstruction<'_> {
    fn size(&self) -> IVec2 {
        let viewport = self.camera.viewport();
        IVec2::new(viewport.width as i32, viewport.height as i32)
    }

    fn drawn(&self) -> Vec<Option<Direction>> {
        let width = self.camera.viewport().width;
        directions(self.receivers, width, self.traced, self.sampling)
    }

    /// Each pixel's own mean over its directions.
    pub fn average(&self) -> Vec<Mean> {
        let drawn = self.drawn();
        let directions = drawn.len() / self.receivers.len().max(1);
        (0..self.receivers.len())
            .map(|pixel| {
                let Some(receiver) = self.receivers[pixel] else {
                    return Mean::default();
                };
                let mut sum = DVec3::ZERO;
                let mut weights = 0.0;
                let mut squares = 0.0;
                for i in pixel * directions..(pixel + 1) * directions {
                    let mut weight = 1.0;
                    if let (Sampling::Uniform, Some(drawn)) = (self.sampling, drawn[i]) {
                        weight = share(receiver.normal, drawn);
                    }
                    let value = self.incoming[i];
                    sum += weight * value;
                    weights += weight;
                    squares += weight * luminance(value) * luminance(value);
                }
                let per_weight = 1.0 / f64::max(weights, 1e-6);
                let mean = sum * per_weight;
                let spread = (squares * per_weight - luminance(mean) * luminance(mean)).max(0.0);
                let whole = match self.payload {
                    Payload::Radiance => luminance(mean),
                    Payload::Occlusion => 1.0,
                };
                let chance = 0.5 * whole / directions as f64;
                Mean {
                    mean,
                    variance: 0.5 * spread / directions as f64 + chance * chance,
                }
            })
            .collect()
    }

    /// The mean about each pixel, before it meets the albedo; `None` for the sky.
    pub fn reconstruct(&self, means: &[Mean]) -> Vec<Option<DVec3>> {
        let drawn = self.drawn();
        let width = self.size().x;
        (0..self.receivers.len() as i32)
            .into_par_iter()
            .map(|i| self.reconstructed(means, &drawn, IVec2::new(i % width, i / width)))
            .collect()
    }

    fn reconstructed(
        &self,
        means: &[Mean],
        drawn: &[Option<Direction>],
        at: IVec2,
    ) -> Option<DVec3> {
        let index = |p: IVec2| (p.y * self.size().x + p.x) as usize;
        let directions = drawn.len() / self.receivers.len();
        let settings = self.settings;
        let Receiver { position, normal } = self.receivers[index(at)]?;
        let own = means[index(at)];
        let footprint = self.camera.footprint();
        let pixel = footprint.at(position - (self.camera.eye() - self.origin));
        let per_tolerance = 1.0 / (f64::from(settings.plane_distance) * pixel).max(1e-30);
        let radius = IVec2::splat(settings.radius as i32);
        let low = (at - radius).max(IVec2::ZERO);
        let high = (at + radius).min(self.size() - 1);
        let mut sum = DVec3::ZERO;
        let mut weights = 0.0;
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                let there = IVec2::new(x, y);
                let Some(other) = self.receivers[index(there)] else {
                    continue;
                };
                let d = other.position - position;
                let off_plane = normal.dot(d).abs().max(other.normal.dot(d).abs()) * per_tolerance;
                let in_plane = (1.0 - off_plane * off_plane).max(0.0);
                let power = f64::from(settings.normal_power);
                let alike = (1.0 - power / 8.0 * (1.0 - normal.dot(other.normal))).max(0.0);
                let mut weight = in_plane * in_plane * alike.powi(8);
                let theirs = means[index(there)];
                if settings.deviations > 0.0 {
                    let difference = luminance(theirs.mean) - luminance(own.mean);
                    let deviations = f64::from(settings.deviations);
                    let allowed =
                        deviations * deviations * (theirs.variance + own.variance) + 1e-30;
                    weight *= (-difference * difference / allowed).exp();
                }
                if there == at {
                    weight = 1.0;
                }
                if !self.deferred {
                    sum += weight * theirs.mean;
                    weights += weight;
                } else if weight > 1e-3 {
                    let theirs = index(there) * directions..(index(there) + 1) * directions;
                    for (drawn, &incoming) in
                        drawn[theirs.clone()].iter().zip(&self.incoming[theirs])
                    {
                        let own_share = weight * share(normal, (*drawn)?).min(4.0);
                        sum += own_share * incoming;
                        weights += own_share;
                    }
                }
            }
        }
        Some(sum / f64::max(weights, 1e-6))
    }
}

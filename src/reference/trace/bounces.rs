//! Light that has bounced several times, traced.
//!
//! Of n bounces the first surface q that a ray meets sends what [`one_bounce`](Tracer::one_bounce) has of it, and
//! `albedo(q)` times the cosine-weighted mean over the hemisphere about its geometric normal of what the surfaces there send
//! after n − 1 bounces. A path draws one direction of that mean at each surface.

use glam::DVec3;

use super::{
    Tracer,
    hemisphere::{Hemisphere, Receiver, Scatter, of_each},
    one_bounce::ColorEstimate,
};
use crate::{Light, Material};

impl Tracer {
    /// Estimates the light that a receiver sends on after 1 to `bounces` bounces off other surfaces, with at least `rays` paths:
    /// radiance, W/(m² sr), of a receiver with albedo 1. With one bounce that is [`one_bounce`](Self::one_bounce), with none 0.
    pub fn bounces(
        &self,
        at: &Receiver,
        materials: &[Material],
        lights: &[Light],
        bounces: u32,
        (rays, seed): (u32, u64),
    ) -> ColorEstimate {
        let Some(hemisphere) = Hemisphere::new(at, self) else {
            return ColorEstimate {
                mean: DVec3::NAN,
                standard_error: DVec3::NAN,
            };
        };
        let mut scatter = Scatter::new(seed);
        let means = hemisphere.estimate(rays, seed, |direction| {
            let (mut origin, mut direction) = (hemisphere.origin, direction);
            let (mut sum, mut share) = (DVec3::ZERO, DVec3::ONE);
            for _ in 0..bounces {
                let Some(met) = self.sent_along(origin, direction, materials, lights) else {
                    break;
                };
                sum += share * met.radiance;
                share *= met.albedo;
                origin = met.start;
                direction = scatter.direction(met.normal);
            }
            sum.to_array()
        });
        ColorEstimate {
            mean: means.mean.into(),
            standard_error: means.standard_error.into(),
        }
    }

    /// [`bounces`](Self::bounces) of many receivers, as
    /// [`ambient_occlusion_image`](Self::ambient_occlusion_image).
    pub fn bounces_image(
        &self,
        receivers: &[Option<Receiver>],
        materials: &[Material],
        lights: &[Light],
        bounces: u32,
        (rays, seed): (u32, u64),
        progress: bool,
    ) -> Vec<Option<ColorEstimate>> {
        of_each(receivers, seed, progress, |at, own_seed| {
            self.bounces(at, materials, lights, bounces, (rays, own_seed))
        })
    }
}

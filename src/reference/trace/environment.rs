//! What a point has of an environment, where nothing hides it.

use std::f64::consts::PI;

use glam::DVec3;

use super::{
    ColorEstimate, Tracer,
    hemisphere::{Hemisphere, Receiver, of_each, stratified},
};
use crate::reference::environment::Cells;

impl Tracer {
    /// Estimates what a white diffuse receiver sends on of an environment that nothing nearer than `radius` hides, irradiance
    /// over π, W/(m² sr), with at least `rays` rays: half of them by the cosine, half by the environment.
    pub fn environment(
        &self,
        at: &Receiver,
        environment: &Cells,
        radius: f64,
        rays: u32,
        seed: u64,
    ) -> ColorEstimate {
        let Some(hemisphere) = Hemisphere::new(at, self) else {
            return ColorEstimate {
                mean: DVec3::NAN,
                standard_error: DVec3::NAN,
            };
        };
        // What comes along a direction, times the cosine over π, over the mean of both densities.
        let weighed = |direction: DVec3| {
            let cosine = hemisphere.normal().dot(direction).max(0.0) / PI;
            let hidden = || self.occluded(hemisphere.origin, direction, 0.0, radius);
            if cosine <= 0.0 || !hemisphere.is_above(direction) || hidden() {
                return [0.0; 3];
            }
            let from_there = environment.at(direction);
            (from_there.radiance * (2.0 * cosine / (cosine + from_there.pdf))).to_array()
        };
        let half = rays.div_ceil(2);
        let one = hemisphere.estimate(half, seed, weighed);
        let other = stratified(half, !seed, |square| {
            weighed(environment.sample(square).direction)
        });
        let [mean, other_mean] = [one.mean, other.mean].map(DVec3::from);
        let [error, other_error] = [one.standard_error, other.standard_error].map(DVec3::from);
        let variance = error * error + other_error * other_error;
        ColorEstimate {
            mean: (mean + other_mean) / 2.0,
            standard_error: variance.map(f64::sqrt) / 2.0,
        }
    }

    /// [`environment`](Self::environment) of many receivers, as [`ambient_occlusion_image`](Self::ambient_occlusion_image).
    pub fn environment_image(
        &self,
        receivers: &[Option<Receiver>],
        environment: &Cells,
        (radius, rays): (f64, u32),
        seed: u64,
        progress: bool,
    ) -> Vec<Option<ColorEstimate>> {
        of_each(receivers, seed, progress, |at, own_seed| {
            self.environment(at, environment, radius, rays, own_seed)
        })
    }
}

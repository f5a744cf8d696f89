//! Mirror of `wgsl/effects/subsurface_scattering.wgsl`.

use glam::DVec3;

use super::{Effect, Receiver, Sender};
use crate::SubsurfaceScattering;

const STEEPEST: f64 = 0.604_599_79;
const WIDEST: f64 = 1e12;
const SHORTEST: f64 = 1e-3;

fn exp(v: DVec3) -> DVec3 {
    DVec3::new(v.x.exp(), v.y.exp(), v.z.exp())
}

fn sqrt(v: DVec3) -> DVec3 {
    DVec3::new(v.x.sqrt(), v.y.sqrt(), v.z.sqrt())
}

/// `2 π radius² e^(σ a) K(z + a)`.
fn deeper(z: DVec3, a: DVec3, sigma: DVec3, radius: f64, distance2: f64) -> DVec3 {
    let depth = z + a;
    let rho = sqrt(distance2 + depth * depth);
    let share = radius / rho;
    let decay = exp(-sigma * ((distance2 + z * (z + 2.0 * a)) / (rho + a)));
    (depth / rho) * (1.0 + sigma * rho) * decay * share * share
}

/// The same of a source at depth z whose light is spread.
fn spread(z: DVec3, sigma: DVec3, radius: f64, distance2: f64) -> DVec3 {
    let width = 2.0 * radius;
    let a = (1.0 + sigma * radius) * width * (width / (z + sqrt(z * z + width * width)));
    2.0 * deeper(z, a, sigma, radius, distance2) - deeper(z, 2.0 * a, sigma, radius, distance2)
}

impl SubsurfaceScattering {
    fn gain(&self) -> DVec3 {
        let transmittance = self.scattering.transmittance();
        DVec3::from(self.scattering.dipoles().map(|d| transmittance * d.albedo))
    }

    /// Outgoing radiance from the sum of all contributions.
    pub fn radiance(&self, sum: DVec3, albedo: DVec3) -> DVec3 {
        albedo * sum.max(DVec3::ZERO)
    }
}

impl Effect for SubsurfaceScattering {
    type Sum = DVec3;

    fn max_distance(&self, sender: &Sender, epsilon: f64) -> f64 {
        let brightest = (self.gain() * sender.front).max_element();
        let share = STEEPEST * (brightest / f64::from(self.unit)) / epsilon;
        if brightest > 0.0 {
            sender.radius * share.clamp(0.0, 1e24).sqrt()
        } else {
            -1.0
        }
    }

    fn contribution(
        &self,
        sender: &Sender,
        _receiver: &Receiver,
        _to_sender: DVec3,
        distance2: f64,
    ) -> DVec3 {
        let radius = sender.radius.min(WIDEST);
        let dipoles = self.scattering.dipoles();
        let sigma_tr = DVec3::from(dipoles.map(|d| d.sigma_tr));
        let longer = (SHORTEST * radius * sigma_tr).max(DVec3::ONE);
        let sigma = sigma_tr / longer;
        let z_r = longer * DVec3::from(dipoles.map(|d| d.z_r));
        let z_v = longer * DVec3::from(dipoles.map(|d| d.z_v));
        let sources = spread(z_r, sigma, radius, distance2) + spread(z_v, sigma, radius, distance2);
        0.25 * self.gain() * sender.front * sources
    }
}

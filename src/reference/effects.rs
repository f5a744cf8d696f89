//! Mirrors of `wgsl/effects`: what a surfel contributes, in f64.

use std::ops::{AddAssign, Mul};

use glam::DVec3;

/// What an effect knows of a surfel: `Sender` of `wgsl/common/effect_types.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sender {
    /// Radius, world units.
    pub radius: f64,
    /// Unit normal.
    pub normal: DVec3,
    /// Emitted radiosity of its material, for effects that read materials.
    pub emission: DVec3,
}

/// The three functions of an effect's WGSL.
pub trait Effect: Sync {
    /// One channel or three.
    type Sum: Copy + Default + Send + Sync + AddAssign + Mul<f64, Output = Self::Sum>;

    /// The distance from which on a contribution is below `epsilon`.
    fn max_distance(&self, sender: &Sender, epsilon: f64) -> f64;

    /// What a surfel adds to a pixel's sum.
    fn contribution(
        &self,
        sender: &Sender,
        receiver_normal: DVec3,
        to_sender: DVec3,
        distance2: f64,
    ) -> Self::Sum;

    /// What a pixel's own surface adds, for effects that leave out what is below it.
    fn own_surface(&self, _cosine: f64) -> Option<Self::Sum> {
        None
    }
}

impl Effect for crate::AmbientOcclusion {
    type Sum = f64;

    fn max_distance(&self, sender: &Sender, epsilon: f64) -> f64 {
        sender.radius * (1.0 / epsilon - 1.0).max(0.0).sqrt()
    }

    fn contribution(
        &self,
        sender: &Sender,
        receiver_normal: DVec3,
        to_sender: DVec3,
        distance2: f64,
    ) -> f64 {
        let receiver_side = receiver_normal.dot(to_sender).max(0.0);
        let facing = -sender.normal.dot(to_sender);
        let sender_side = if self.two_sided {
            facing.abs()
        } else {
            facing.max(0.0)
        };
        let ratio = distance2 / sender.radius.max(1e-18);
        receiver_side * sender_side
            / (distance2.max(1e-30) * (1.0 + ratio / sender.radius.max(1e-18)))
    }

    fn own_surface(&self, cosine: f64) -> Option<f64> {
        self.own_surface.then(|| match self.overlap {
            crate::Overlap::Add => 0.5 - 0.5 * cosine,
            crate::Overlap::Independent => -(0.5 + 0.5 * cosine).ln(),
        })
    }
}

impl crate::AmbientOcclusion {
    /// Visibility from the sum of all contributions, 0…1.
    pub fn visibility(&self, sum: f64) -> f64 {
        match self.overlap {
            crate::Overlap::Add => 1.0 - sum,
            crate::Overlap::Independent => (-sum).exp(),
        }
        .clamp(0.0, 1.0)
    }
}

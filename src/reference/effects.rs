//! Mirrors of `wgsl/effects`: what a surfel contributes, in f64.

mod subsurface_scattering;

use std::{
    f64::consts::PI,
    ops::{AddAssign, Mul},
};

use glam::DVec3;

use super::reconstructor::Sum;

/// What an effect knows of a surfel: `Sender` of `wgsl/common/effect_types.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sender {
    /// Radius, world units.
    pub radius: f64,
    /// Unit normal.
    pub normal: DVec3,
    /// Emitted radiosity of its material, for effects that read materials.
    pub emission: DVec3,
    /// What it sends from its front, for effects that read radiance.
    pub front: DVec3,
    /// And from its back; 0 for effects that are not two-sided.
    pub back: DVec3,
}

impl Sender {
    /// One that sends nothing.
    pub fn new(radius: f64, normal: DVec3) -> Self {
        Self {
            radius,
            normal,
            emission: DVec3::ZERO,
            front: DVec3::ZERO,
            back: DVec3::ZERO,
        }
    }
}

/// The functions of an effect's WGSL that the splatter calls.
pub trait Effect: Sync {
    /// Its channels.
    type Sum: Copy + Default + Send + Sync + AddAssign + Mul<f64, Output = Self::Sum>;

    /// The distance from which on a contribution is below `epsilon`; negative for a surfel that contributes nothing anywhere.
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

/// Of a disk, negative where the pixel is behind it.
fn form_factor(sender: &Sender, receiver_normal: DVec3, to_sender: DVec3, distance2: f64) -> f64 {
    let receiver_side = receiver_normal.dot(to_sender).max(0.0);
    let facing = -sender.normal.dot(to_sender);
    let ratio = distance2 / sender.radius.max(1e-18);
    receiver_side * facing / (distance2.max(1e-30) * (1.0 + ratio / sender.radius.max(1e-18)))
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
        let factor = form_factor(sender, receiver_normal, to_sender, distance2);
        if self.two_sided {
            factor.abs()
        } else {
            factor.max(0.0)
        }
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

impl Effect for crate::DiffuseBounce {
    type Sum = DVec3;

    fn max_distance(&self, sender: &Sender, epsilon: f64) -> f64 {
        let brightest = sender.front.max(sender.back).max_element();
        let share = PI * (brightest / f64::from(self.unit)) / epsilon;
        if brightest > 0.0 {
            sender.radius * (share - 1.0).clamp(0.0, 1e24).sqrt()
        } else {
            -1.0
        }
    }

    fn contribution(
        &self,
        sender: &Sender,
        receiver_normal: DVec3,
        to_sender: DVec3,
        distance2: f64,
    ) -> DVec3 {
        let factor = form_factor(sender, receiver_normal, to_sender, distance2);
        if factor > 0.0 {
            factor * sender.front
        } else {
            -factor * sender.back
        }
    }
}

impl crate::DiffuseBounce {
    /// Outgoing radiance from the sum of all contributions.
    pub fn radiance(&self, sum: DVec3, albedo: DVec3) -> DVec3 {
        albedo * sum
    }
}

/// Two effects in one: [`crate::Effect::and`].
#[derive(Clone, Copy, Debug)]
pub struct Joined<A, B>(pub A, pub B);

/// The sums of both.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Both<A, B>(pub A, pub B);

impl<A: AddAssign, B: AddAssign> AddAssign for Both<A, B> {
    fn add_assign(&mut self, other: Self) {
        self.0 += other.0;
        self.1 += other.1;
    }
}

impl<A: Mul<f64, Output = A>, B: Mul<f64, Output = B>> Mul<f64> for Both<A, B> {
    type Output = Self;
    fn mul(self, by: f64) -> Self {
        Self(self.0 * by, self.1 * by)
    }
}

impl<A: Sum, B: Sum> Sum for Both<A, B> {
    fn is_usable(self) -> bool {
        self.0.is_usable() && self.1.is_usable()
    }
}

impl<A: Effect, B: Effect> Effect for Joined<A, B> {
    type Sum = Both<A::Sum, B::Sum>;

    fn max_distance(&self, sender: &Sender, epsilon: f64) -> f64 {
        let first = self.0.max_distance(sender, epsilon);
        first.max(self.1.max_distance(sender, epsilon))
    }

    fn contribution(
        &self,
        sender: &Sender,
        receiver_normal: DVec3,
        to_sender: DVec3,
        distance2: f64,
    ) -> Self::Sum {
        let (normal, to) = (receiver_normal, to_sender);
        let first = self.0.contribution(sender, normal, to, distance2);
        Both(first, self.1.contribution(sender, normal, to, distance2))
    }

    fn own_surface(&self, cosine: f64) -> Option<Self::Sum> {
        match (self.0.own_surface(cosine), self.1.own_surface(cosine)) {
            (None, None) => None,
            (first, second) => Some(Both(first.unwrap_or_default(), second.unwrap_or_default())),
        }
    }
}

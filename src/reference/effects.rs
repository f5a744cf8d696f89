//! Mirrors of `wgsl/effects`: what a surfel contributes, in f64.

mod subsurface_scattering;

use std::{
    f64::consts::PI,
    ops::{AddAssign, Mul},
};

use glam::{DVec3, DVec4};

use super::{environment::Levels, ggx::Lobe, reconstructor::Sum, shell_splatter};
use crate::{Camera, Overlap};

/// What an effect knows of a surfel: `Sender` of `wgsl/common/effect_types.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sender {
    /// Radius, world units.
    pub radius: f64,
    /// Unit normal.
    pub normal: DVec3,
    /// How many surfels it stands for.
    pub share: f64,
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
            share: 1.0,
            emission: DVec3::ZERO,
            front: DVec3::ZERO,
            back: DVec3::ZERO,
        }
    }
}

/// What an effect knows of a pixel: `Receiver` of `wgsl/common/effect_types.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// The unit shading normal.
    pub normal: DVec3,
    /// Unit vector to the eye, for effects that ask; 0 for others.
    pub to_eye: DVec3,
    /// Perceptual roughness, for effects that ask; 1 for others.
    pub roughness: f64,
}

impl Receiver {
    /// For effects that ask for nothing else.
    pub fn new(normal: DVec3) -> Self {
        Self {
            normal,
            to_eye: DVec3::ZERO,
            roughness: 1.0,
        }
    }
}

/// The functions of an effect's WGSL that the splatter calls.
pub trait Effect: Sync {
    /// Its channels.
    type Sum: Copy + Default + Send + Sync + AddAssign + Mul<f64, Output = Self::Sum>;

    /// The distance from which on a contribution is below `epsilon`; negative for a surfel that contributes nothing anywhere.
    fn max_distance(&self, sender: &Sender, epsilon: f64) -> f64;

    /// What it knows of a pixel, counted row by row.
    fn receiver(&self, _pixel: usize, at: &shell_splatter::Receiver) -> Receiver {
        Receiver::new(at.normal)
    }

    /// What a surfel adds to a pixel's sum.
    fn contribution(
        &self,
        sender: &Sender,
        receiver: &Receiver,
        to_sender: DVec3,
        distance2: f64,
    ) -> Self::Sum;

    /// What a pixel's own surface adds, for effects that leave out what is below it.
    fn own_surface(&self, _cosine: f64) -> Option<Self::Sum> {
        None
    }
}

/// The share of the cosine-weighted hemisphere that a disk covers, negative where the pixel is behind it.
fn form_factor(sender: &Sender, receiver_normal: DVec3, to_sender: DVec3, distance2: f64) -> f64 {
    let receiver_side = receiver_normal.dot(to_sender).max(0.0);
    let facing = -sender.normal.dot(to_sender);
    let ratio = distance2 / sender.radius.max(1e-18);
    receiver_side * facing / (distance2.max(1e-30) * (1.0 + ratio / sender.radius.max(1e-18)))
}

/// What of a form factor hides something.
fn hiding(factor: f64, two_sided: bool) -> f64 {
    if two_sided {
        factor.abs()
    } else {
        factor.max(0.0)
    }
}

/// From here on a form factor is below epsilon.
fn form_factor_distance(radius: f64, epsilon: f64) -> f64 {
    radius * (1.0 / epsilon - 1.0).max(0.0).sqrt()
}

/// Unit vector to a disk's centre.
fn direction_to(to_sender: DVec3, distance2: f64) -> DVec3 {
    to_sender / distance2.max(1e-30).sqrt()
}

/// A disk's solid angle, negative where the pixel is behind it.
fn disk_solid_angle(sender: &Sender, direction: DVec3, distance2: f64) -> f64 {
    let ratio = distance2 / sender.radius.max(1e-18);
    -PI * sender.normal.dot(direction) / (1.0 + ratio / sender.radius.max(1e-18))
}

/// The irradiance of a disk is below epsilon units from here on.
fn radiant_distance(sender: &Sender, unit: f64, epsilon: f64) -> f64 {
    let brightest = sender.front.max(sender.back).max_element();
    let share = PI * (brightest / unit) / epsilon;
    if brightest > 0.0 {
        sender.radius * (share - 1.0).clamp(0.0, 1e24).sqrt()
    } else {
        -1.0
    }
}

/// What a disk sends to the side that the sign of something tells.
fn sent(sender: &Sender, side: f64) -> DVec3 {
    if side > 0.0 {
        sender.front
    } else {
        sender.back
    }
}

impl Effect for crate::AmbientOcclusion {
    type Sum = f64;

    fn max_distance(&self, sender: &Sender, epsilon: f64) -> f64 {
        form_factor_distance(sender.radius, epsilon)
    }

    fn contribution(
        &self,
        sender: &Sender,
        receiver: &Receiver,
        to_sender: DVec3,
        distance2: f64,
    ) -> f64 {
        let factor = form_factor(sender, receiver.normal, to_sender, distance2);
        hiding(factor, self.two_sided)
    }

    fn own_surface(&self, cosine: f64) -> Option<f64> {
        self.own_surface.then(|| match self.overlap {
            Overlap::Add => 0.5 - 0.5 * cosine,
            Overlap::Independent => -(0.5 + 0.5 * cosine).ln(),
        })
    }
}

impl crate::AmbientOcclusion {
    /// Visibility from the sum of all contributions, 0…1.
    pub fn visibility(&self, sum: f64) -> f64 {
        match self.overlap {
            Overlap::Add => 1.0 - sum,
            Overlap::Independent => (-sum).exp(),
        }
        .clamp(0.0, 1.0)
    }
}

impl Effect for crate::DiffuseBounce {
    type Sum = DVec3;

    fn max_distance(&self, sender: &Sender, epsilon: f64) -> f64 {
        radiant_distance(sender, self.unit.into(), epsilon)
    }

    fn contribution(
        &self,
        sender: &Sender,
        receiver: &Receiver,
        to_sender: DVec3,
        distance2: f64,
    ) -> DVec3 {
        let factor = form_factor(sender, receiver.normal, to_sender, distance2);
        factor.abs() * sent(sender, factor)
    }
}

impl crate::DiffuseBounce {
    /// Outgoing radiance from the sum of all contributions.
    pub fn radiance(&self, sum: DVec3, albedo: DVec3) -> DVec3 {
        albedo * sum
    }
}

impl Effect for crate::BentNormals {
    type Sum = DVec4;

    fn max_distance(&self, sender: &Sender, epsilon: f64) -> f64 {
        form_factor_distance(sender.radius, epsilon)
    }

    fn contribution(
        &self,
        sender: &Sender,
        receiver: &Receiver,
        to_sender: DVec3,
        distance2: f64,
    ) -> DVec4 {
        let factor = form_factor(sender, receiver.normal, to_sender, distance2);
        let hidden = hiding(factor, self.two_sided);
        hidden * direction_to(to_sender, distance2).extend(1.0)
    }
}

impl crate::BentNormals {
    /// The unit bent normal and visibility from the sum of all contributions.
    pub fn bent(&self, sum: DVec4, receiver: &Receiver) -> DVec4 {
        let hidden = match self.overlap {
            Overlap::Add => sum.w.min(1.0),
            Overlap::Independent => 1.0 - (-sum.w).exp(),
        };
        let normal = receiver.normal;
        let open = normal * (2.0 / 3.0) - sum.truncate() * (hidden / sum.w.max(1e-30));
        let above = open - normal * open.dot(normal).min(0.0);
        above.normalize_or(normal).extend(1.0 - hidden)
    }
}

/// Directional occlusion under an environment.
#[derive(Clone, Copy, Debug)]
pub struct UnderSky<'a> {
    /// The effect.
    pub effect: crate::DirectionalOcclusion,
    /// What it is under.
    pub environment: &'a Levels,
}

impl Effect for UnderSky<'_> {
    type Sum = DVec3;

    fn max_distance(&self, sender: &Sender, epsilon: f64) -> f64 {
        form_factor_distance(sender.radius, epsilon)
    }

    fn contribution(
        &self,
        sender: &Sender,
        receiver: &Receiver,
        to_sender: DVec3,
        distance2: f64,
    ) -> DVec3 {
        let factor = form_factor(sender, receiver.normal, to_sender, distance2);
        let hidden = hiding(factor, self.effect.two_sided);
        if hidden <= 0.0 {
            return DVec3::ZERO;
        }
        let direction = direction_to(to_sender, distance2);
        let solid_angle = sender.share * disk_solid_angle(sender, direction, distance2).abs();
        hidden * self.environment.mean(direction, solid_angle)
    }
}

impl UnderSky<'_> {
    /// Outgoing radiance of a white surface from the sum of all contributions.
    pub fn radiance(&self, sum: DVec3, receiver: &Receiver) -> DVec3 {
        let all = self.environment.irradiance_at(receiver.normal) / PI;
        let hidden = sum.max(DVec3::ZERO);
        match self.effect.overlap {
            Overlap::Add => (all - hidden).max(DVec3::ZERO),
            Overlap::Independent => {
                all * (-(hidden / all.max(DVec3::splat(1e-30))).min(DVec3::splat(80.0))).exp()
            }
        }
    }
}

/// A specular bounce off the pixels that a camera sees.
#[derive(Clone, Copy, Debug)]
pub struct SeenGlossy<'a> {
    /// The effect.
    pub effect: crate::SpecularBounce,
    /// The camera.
    pub camera: &'a Camera,
    /// What pixels' positions are relative to.
    pub origin: DVec3,
    /// Of each pixel, row by row.
    pub roughness: &'a [f64],
}

/// A lobe as a disk of a solid angle sees it.
fn widened(lobe: &Lobe, facet: DVec3, solid_angle: f64) -> Lobe {
    let spread = solid_angle / (8.0 * PI * lobe.view.dot(facet).max(1e-4));
    Lobe {
        alpha: (lobe.alpha * lobe.alpha + spread).sqrt().min(1.0),
        ..*lobe
    }
}

impl Effect for SeenGlossy<'_> {
    type Sum = DVec3;

    fn max_distance(&self, sender: &Sender, epsilon: f64) -> f64 {
        radiant_distance(sender, self.effect.unit.into(), epsilon)
    }

    fn receiver(&self, pixel: usize, at: &shell_splatter::Receiver) -> Receiver {
        let to_eye = if self.camera.footprint().perspective {
            self.camera.eye() - self.origin - at.position
        } else {
            self.camera.rotation().transpose() * DVec3::Z
        };
        Receiver {
            normal: at.normal,
            to_eye: to_eye.normalize(),
            roughness: self.roughness[pixel],
        }
    }

    fn contribution(
        &self,
        sender: &Sender,
        receiver: &Receiver,
        to_sender: DVec3,
        distance2: f64,
    ) -> DVec3 {
        let direction = direction_to(to_sender, distance2);
        let solid_angle = disk_solid_angle(sender, direction, distance2);
        let lobe = Lobe::new(receiver.normal, receiver.to_eye, receiver.roughness);
        let light = lobe.frame.transpose() * direction;
        let facet = lobe.facet_of(light);
        let wide = widened(&lobe, facet, solid_angle.abs() * sender.share);
        let mirrored = solid_angle.abs() * wide.pdf(facet) * lobe.share(light);
        let f0 = DVec3::from(self.effect.f0.map(f64::from));
        mirrored * lobe.schlick(f0, facet) * sent(sender, solid_angle)
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

    fn receiver(&self, pixel: usize, at: &shell_splatter::Receiver) -> Receiver {
        let [one, other] = [self.0.receiver(pixel, at), self.1.receiver(pixel, at)];
        if one.to_eye == DVec3::ZERO {
            other
        } else {
            one
        }
    }

    fn contribution(
        &self,
        sender: &Sender,
        receiver: &Receiver,
        to_sender: DVec3,
        distance2: f64,
    ) -> Self::Sum {
        let to = to_sender;
        let first = self.0.contribution(sender, receiver, to, distance2);
        Both(first, self.1.contribution(sender, receiver, to, distance2))
    }

    fn own_surface(&self, cosine: f64) -> Option<Self::Sum> {
        match (self.0.own_surface(cosine), self.1.own_surface(cosine)) {
            (None, None) => None,
            (first, second) => Some(Both(first.unwrap_or_default(), second.unwrap_or_default())),
        }
    }
}

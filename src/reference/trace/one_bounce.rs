//! Direct light and the first bounce of it, traced.
//!
//! A light without extent lights a point where a shadow ray finds nothing between them. Light that
//! has bounced once is `gi1 = albedo/π ∫ L(q(ω)) ⟨Ns, ω⟩ dω` over the hemisphere about the shading
//! normal Ns, with q(ω) the first point that a ray along ω meets, at any distance, and L what q
//! sends back along the ray:
//!
//! * Surfaces have two sides, of one albedo. The side that the ray meets counts, with the geometric
//!   normal on that side: light on the other side is not seen.
//! * L is the direct radiance of that side ([`Tracer::direct`]), and on a front, and on the back of what
//!   is double-sided, the material's emission over π too, its radiosity being π times its radiance.
//! * A ray that meets nothing brings nothing: the sky is black. So does a direction with
//!   ⟨Ng, ω⟩ ≤ 0, which points into the surface.

use std::f64::consts::PI;

use glam::DVec3;

use super::{
    Tracer,
    hemisphere::{Hemisphere, Receiver, of_each},
};
use crate::{Light, Material, reference::light::arrival};

/// A mean of random samples and how far off it may be: linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorEstimate {
    /// The estimated value.
    pub mean: DVec3,
    /// Standard deviation of `mean` over seeds, itself estimated.
    pub standard_error: DVec3,
}

impl Tracer {
    /// What a Lambertian point sends out of the light that reaches it straight from `lights`:
    /// radiance `albedo/π · E`, W/(m² sr), with hard shadows. `normal` is on the side that is lit
    /// and looked at; shadow rays start at [`start`](Self::start), and no surface that a light lies on
    /// hides it.
    ///
    /// A `normal` of any length but zero will do. What lies at a light's very position gets
    /// nothing of it; nearer than 1e-9 counts as that far.
    pub fn direct(&self, point: DVec3, normal: DVec3, albedo: DVec3, lights: &[Light]) -> DVec3 {
        let Some(normal) = normal.try_normalize() else {
            return DVec3::ZERO;
        };
        let origin = self.start(point, normal);
        self.direct_from(origin, point, normal, albedo, lights)
    }

    /// The same with the start of shadow rays.
    fn direct_from(
        &self,
        origin: DVec3,
        point: DVec3,
        normal: DVec3,
        albedo: DVec3,
        lights: &[Light],
    ) -> DVec3 {
        let irradiance: DVec3 = lights
            .iter()
            .map(|light| {
                let here = arrival(light, point);
                let cosine = normal.dot(here.to_light).max(0.0);
                // From where the ray starts: with the way from the point it would end beyond the light.
                let lit = cosine > 0.0
                    && here.irradiance != DVec3::ZERO
                    && !self.hidden(origin, &arrival(light, origin), light);
                if lit {
                    here.irradiance * cosine
                } else {
                    DVec3::ZERO
                }
            })
            .sum();
        albedo / PI * irradiance
    }

    /// Estimates the light that a receiver sends on after it has bounced off one other surface,
    /// with at least `rays` rays: radiance, W/(m² sr), of a receiver with albedo 1. That of another
    /// is its albedo times this. `materials` has one per triangle of the list that
    /// [`new`](Self::new) was given.
    ///
    /// Directions and the standard error are those of
    /// [`ambient_occlusion`](Self::ambient_occlusion), and so is what is said there of normals. A
    /// ray that meets a triangle without a material makes the estimate not a number.
    pub fn one_bounce(
        &self,
        at: &Receiver,
        materials: &[Material],
        lights: &[Light],
        rays: u32,
        seed: u64,
    ) -> ColorEstimate {
        let Some(hemisphere) = Hemisphere::new(at, self) else {
            return ColorEstimate {
                mean: DVec3::NAN,
                standard_error: DVec3::NAN,
            };
        };
        let means = hemisphere.estimate(rays, seed, |direction| {
            self.radiance_along(hemisphere.origin, direction, materials, lights)
                .to_array()
        });
        ColorEstimate {
            mean: means.mean.into(),
            standard_error: means.standard_error.into(),
        }
    }

    /// [`one_bounce`](Self::one_bounce) of many receivers, as
    /// [`ambient_occlusion_image`](Self::ambient_occlusion_image).
    pub fn one_bounce_image(
        &self,
        receivers: &[Option<Receiver>],
        materials: &[Material],
        lights: &[Light],
        rays: u32,
        seed: u64,
        progress: bool,
    ) -> Vec<Option<ColorEstimate>> {
        of_each(receivers, seed, progress, |at, own_seed| {
            self.one_bounce(at, materials, lights, rays, own_seed)
        })
    }

    /// L: what the first surface along a ray sends back along it.
    pub(super) fn radiance_along(
        &self,
        origin: DVec3,
        direction: DVec3,
        materials: &[Material],
        lights: &[Light],
    ) -> DVec3 {
        let met = self.sent_along(origin, direction, materials, lights);
        met.map_or(DVec3::ZERO, |met| met.radiance)
    }

    /// The same, with what it takes to go on from there; `None` where a ray meets nothing.
    pub(super) fn sent_along(
        &self,
        origin: DVec3,
        direction: DVec3,
        materials: &[Material],
        lights: &[Light],
    ) -> Option<Sent> {
        let (hit, triangle) = self.nearest(origin, direction, 0.0, f64::INFINITY)?;
        let Some(material) = materials.get(hit.triangle) else {
            return Some(Sent {
                radiance: DVec3::NAN,
                albedo: DVec3::NAN,
                start: origin,
                normal: -direction,
            });
        };
        let color = |c: [f32; 3]| DVec3::from(c.map(f64::from));
        let normal = triangle.normal();
        let front = normal.dot(direction) < 0.0;
        let normal = if front { normal } else { -normal };
        let emission = if front || material.double_sided != 0 {
            color(material.emission) / PI
        } else {
            DVec3::ZERO
        };
        // The hit lies on its surface as well as f64 knows it.
        let place = triangle.at(&hit);
        let start = place + normal * self.epsilon();
        let albedo = color(material.albedo);
        Some(Sent {
            radiance: emission + self.direct_from(start, place, normal, albedo, lights),
            albedo,
            start,
            normal,
        })
    }
}

/// A surface that a ray met.
pub(super) struct Sent {
    /// What it sends of itself and reflects straight from lights.
    pub(super) radiance: DVec3,
    pub(super) albedo: DVec3,
    /// Where rays start from it.
    pub(super) start: DVec3,
    /// Its unit normal, on the side of the ray.
    pub(super) normal: DVec3,
}

//! Mirror of `wgsl/common/ggx.wgsl`: glossy lobes of the isotropic Trowbridge-Reitz distribution. Directions are in the
//! normal's frame, z along it, and point away from the surface.

use std::f64::consts::PI;

use glam::{DMat3, DVec2, DVec3};

use super::directions::{concentric_disk, tangent_frame};

/// What reaches the eye of a direction's light, and how much the direction counts in a mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mirrored {
    /// Radiance.
    pub radiance: DVec3,
    /// Weight in the mean.
    pub weight: f64,
}

/// The narrowest distribution.
pub const MIN_ALPHA: f64 = 1e-3;
/// How far above the horizon a view is at least taken to be, as a cosine.
pub const MIN_COSINE: f64 = 1e-4;
/// How much denser than its neighbour a pixel may ask for a direction.
pub const MAX_RATIO: f64 = 4.0;

/// What a pixel reflects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    /// The frame's axes in the world.
    pub frame: DMat3,
    /// Unit vector to the eye, at least [`MIN_COSINE`] above the horizon.
    pub view: DVec3,
    /// Width of the distribution, at least [`MIN_ALPHA`].
    pub alpha: f64,
    /// The same without bound.
    pub width: f64,
}

/// A direction, and the microfacet normal that mirrors the view into it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlossyDirection {
    /// Where light comes from.
    pub light: DVec3,
    /// The microfacet's normal.
    pub facet: DVec3,
}

/// About what share of even light a surface of a roughness sends to an eye at a cosine to its normal: of what counts as much as
/// the reflectance straight on, and of what is mirrored besides. Fitted to the lobe's own sum, within a factor of 1.45 of it.
pub fn even_shares(cosine: f64, roughness: f64) -> DVec2 {
    let besides = (1.0 - cosine).powi(5) * (-4.6 * roughness.powf(1.4)).exp2();
    let whole = 1.0 - 0.7 * roughness.powf(2.5) * cosine.sqrt();
    DVec2::new(whole - besides, besides)
}

/// Clamped to 0…1; NaN counts as 1.
pub fn clean_roughness(roughness: f64) -> f64 {
    if roughness.is_nan() {
        return 1.0;
    }
    roughness.clamp(0.0, 1.0)
}

/// The length of a unit vector whose part in the plane is scaled by alpha.
fn stretched(alpha: f64, v: DVec3) -> f64 {
    (alpha * alpha * v.truncate().length_squared() + v.z * v.z).sqrt()
}

impl Lobe {
    /// About a unit normal, of a perceptual roughness.
    pub fn new(normal: DVec3, to_eye: DVec3, roughness: f64) -> Self {
        let frame = tangent_frame(normal);
        let v = frame.transpose() * to_eye;
        let view = v.truncate().extend(v.z.max(MIN_COSINE)).normalize();
        let clean = clean_roughness(roughness);
        let width = clean * clean;
        Self {
            frame,
            view,
            alpha: width.max(MIN_ALPHA),
            width,
        }
    }

    /// A point of the unit square to a direction. It may point below the horizon, where nothing arrives.
    pub fn direction(&self, point: DVec2) -> GlossyDirection {
        let v = (self.alpha * self.view.truncate())
            .extend(self.view.z)
            .normalize();
        let disk = concentric_disk(point);
        let r2 = (2.0 * point - 1.0).abs().max_element().powi(2);
        let c = 1.0 + v.z;
        let across = disk * (c * (2.0 - r2 * c)).max(0.0).sqrt() + v.truncate();
        let facet = (self.alpha * across)
            .extend(c * (1.0 - r2))
            .try_normalize()
            .unwrap_or(DVec3::Z);
        GlossyDirection {
            light: 2.0 * self.view.dot(facet) * facet - self.view,
            facet,
        }
    }

    /// The facet that mirrors the view into a direction.
    pub fn facet_of(&self, light: DVec3) -> DVec3 {
        (self.view + light).try_normalize().unwrap_or(DVec3::NEG_Z)
    }

    /// Density over solid angle with which a direction is drawn, from its facet: `D G1 / (4 ⟨n, v⟩)`, 1/sr.
    pub fn pdf(&self, facet: DVec3) -> f64 {
        if facet.z <= 0.0 {
            return 0.0;
        }
        let alpha2 = self.alpha * self.alpha;
        let q = facet.z * facet.z + facet.truncate().length_squared() / alpha2;
        let d = 1.0 / (PI * alpha2 * q * q);
        0.5 * d / (self.view.z + stretched(self.alpha, self.view))
    }

    /// The share of the facets towards the view that it sees: G1.
    pub fn masking(&self) -> f64 {
        2.0 * self.view.z / (self.view.z + stretched(self.alpha, self.view))
    }

    /// The BRDF times the cosine over the density of a direction, without Fresnel's factor: G2 / G1, 0…1, and 0 below
    /// the horizon.
    pub fn share(&self, light: DVec3) -> f64 {
        if light.z <= 0.0 {
            return 0.0;
        }
        let v = stretched(self.alpha, self.view);
        let l = stretched(self.alpha, light);
        (light.z * (self.view.z + v) / (light.z * v + self.view.z * l)).min(1.0)
    }

    /// Fresnel's factor (Schlick 1994) of a facet, without the reflectance straight on: how much of the way it is from that to 1.
    pub fn schlick_power(&self, facet: DVec3) -> f64 {
        (1.0 - self.view.dot(facet)).clamp(0.0, 1.0).powi(5)
    }

    /// The factor itself, of the reflectance straight on and a facet.
    pub fn schlick(&self, f0: DVec3, facet: DVec3) -> DVec3 {
        f0 + (1.0 - f0) * self.schlick_power(facet)
    }

    /// What the lobe sends on of a direction's radiance: the share that counts as much as the reflectance straight on, and the
    /// share that does so whatever that is.
    pub fn shares(&self, drawn: &GlossyDirection) -> [f64; 2] {
        let share = self.share(drawn.light);
        let power = self.schlick_power(drawn.facet);
        [share * (1.0 - power), share * power]
    }

    /// What the lobe sends on of the radiance along one of its own directions, or a neighbour's: `mirrored` of
    /// `wgsl/hit_resolver.wgsl`, with radiance.
    pub fn mirrored(&self, light: DVec3, facet: DVec3, f0: DVec3, radiance: DVec3) -> Mirrored {
        Mirrored {
            radiance: self.share(light) * self.schlick(f0, facet) * radiance,
            weight: 1.0,
        }
    }

    /// The same of a neighbour's direction, weighed by how much denser this lobe draws it: `mirrored_deferred`.
    pub fn mirrored_deferred(
        &self,
        other: &Self,
        drawn: &GlossyDirection,
        f0: DVec3,
        radiance: DVec3,
    ) -> Mirrored {
        let light = self.frame.transpose() * (other.frame * drawn.light);
        if drawn.light.z <= 0.0 && light.z > 0.0 {
            return Mirrored {
                radiance: DVec3::ZERO,
                weight: 0.0,
            };
        }
        let facet = self.facet_of(light);
        let ratio = (self.pdf(facet) / other.pdf(drawn.facet).max(1e-30)).min(MAX_RATIO);
        Mirrored {
            weight: ratio,
            ..self.mirrored(light, facet, f0, radiance)
        }
    }

    /// How much two pixels' lobes overlap, 0…1, where the pixels are an angle `parallax` apart.
    pub fn overlap(&self, other: &Self, parallax: f64) -> f64 {
        let mirrored = |lobe: &Self| lobe.frame * (lobe.view * DVec3::new(-1.0, -1.0, 1.0));
        let squares = (self.width * self.width + other.width * other.width).max(1e-30);
        let distance2 =
            mirrored(self).distance_squared(mirrored(other)) + (parallax * parallax).min(4.0);
        2.0 * self.width * other.width / squares * (-(distance2 / (8.0 * squares)).min(80.0)).exp()
    }
}

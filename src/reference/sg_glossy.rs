//! Mirror of `wgsl/common/sg_glossy.wgsl`: what a glossy surface reflects of light that is known as sums per colour channel.

use std::f64::consts::PI;

use glam::DVec3;

use super::ggx::Lobe;
use crate::spherical_gaussian::{DLightMoments, DSphericalGaussian, Estimate};

/// `sg_integral`: over the sphere, of amplitude 1.
fn integral(sharpness: f64) -> f64 {
    DSphericalGaussian {
        axis: DVec3::Z,
        sharpness,
        amplitude: 1.0,
    }
    .integral()
}

/// The lobe of GGX as a spherical Gaussian of amplitude 1 about the mirrored view.
pub fn mirrored_lobe(lobe: &Lobe) -> DSphericalGaussian {
    DSphericalGaussian {
        axis: lobe.frame * (lobe.view * DVec3::new(-1.0, -1.0, 1.0)),
        sharpness: 0.5 / (lobe.alpha * lobe.alpha * lobe.view.z),
        amplitude: 1.0,
    }
}

/// The lobe with these moments of light that comes from a hemisphere about its own mean direction.
pub fn hemisphere_lobe(moments: &DLightMoments) -> DSphericalGaussian {
    if moments.total <= 0.0 {
        return DSphericalGaussian::ZERO;
    }
    let mean = moments.vector / moments.total;
    let r = moments.resultant();
    let moved = DLightMoments {
        vector: DVec3::Z * (2.0 * r - 1.0).max(0.0),
        total: 1.0,
    };
    let sharpness = 2.0 * moved.lobe(Estimate::Moments).sharpness;
    let solid_angle = 0.5 * integral(0.5 * sharpness) + 4.0 * PI * (0.5 - r).max(0.0);
    DSphericalGaussian {
        axis: mean.normalize_or(DVec3::Z),
        sharpness,
        amplitude: moments.total / solid_angle,
    }
}

/// Fresnel's factor of light about a direction, `passed` being the sharpness of the mirrored lobe over that of the product.
fn lobe_fresnel(lobe: &Lobe, f0: f64, direction: DVec3, passed: f64) -> f64 {
    let facet = lobe.facet_of(direction);
    let at_axis = lobe.schlick(DVec3::splat(f0), facet).x;
    let wide = lobe.alpha * passed * passed.sqrt();
    f0 + (at_axis - f0) / (1.0 + 8.0 * wide * wide.sqrt())
}

/// Radiance that one colour channel reflects.
fn glossy_channel(
    lobe: &Lobe,
    mirrored: &DSphericalGaussian,
    f0: f64,
    moments: &DLightMoments,
) -> f64 {
    let light = hemisphere_lobe(moments);
    let product = mirrored.product(&light);
    let direction = lobe.frame.transpose() * product.axis;
    let masked = lobe.masking() * lobe.share(direction);
    let passed = (mirrored.sharpness / product.sharpness.max(1e-30)).min(1.0);
    let fresnel = lobe_fresnel(lobe, f0, direction, passed);
    let share = mirrored.sharpness / (2.0 * PI) * integral(product.sharpness);
    product.amplitude * share * masked * fresnel
}

/// Radiance that a pixel reflects of light with these moments, a colour channel each.
pub fn glossy_radiance(lobe: &Lobe, f0: DVec3, moments: &[DLightMoments; 3]) -> DVec3 {
    let mirrored = mirrored_lobe(lobe);
    let channel = |i: usize| glossy_channel(lobe, &mirrored, f0[i], &moments[i]);
    DVec3::new(channel(0), channel(1), channel(2))
}

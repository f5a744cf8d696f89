//! Mirror of `wgsl/common/light.wgsl`: what a light sends to a point, whatever stands between.

use glam::DVec3;

use crate::{Light, light::versine};

/// What stands for infinity in the shader.
const FAR_LIGHT: f64 = 1e18;
/// Nearer than this counts as this far: the irradiance of a light without extent has no bound.
const MIN_DISTANCE: f64 = 1e-9;
/// Nearer than this a point is at the light and has no direction to it.
const AT_LIGHT: f64 = 1e-18;

/// A light seen from a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Arrival {
    /// Unit vector to the light; zero where the point is at the light.
    pub to_light: DVec3,
    /// How far the light is; infinite for a directional one.
    pub distance: f64,
    /// Irradiance of a surface that faces the light, W/m².
    pub irradiance: DVec3,
}

/// What a light sends to a point, both in one space. At its very position that is nothing.
pub fn arrival(light: &Light, point: DVec3) -> Arrival {
    match *light {
        Light::Directional {
            direction,
            irradiance,
        } => Arrival {
            to_light: -direction.normalize_or_zero(),
            distance: f64::INFINITY,
            irradiance: color(irradiance),
        },
        Light::Point {
            position,
            intensity,
        } => from_position(position, intensity, point),
        Light::Spot {
            position,
            direction,
            intensity,
            inner,
            outer,
        } => {
            let mut arrival = from_position(position, intensity, point);
            arrival.irradiance *= cone(direction, inner, outer, -arrival.to_light);
            arrival
        }
    }
}

fn from_position(position: DVec3, intensity: [f32; 3], point: DVec3) -> Arrival {
    let offset = position - point;
    let distance = offset.length();
    if distance < AT_LIGHT {
        return Arrival::default();
    }
    let irradiance = color(intensity) / distance.max(MIN_DISTANCE).powi(2);
    Arrival {
        to_light: offset / distance,
        distance,
        irradiance: irradiance.min(DVec3::splat(FAR_LIGHT)),
    }
}

/// Share of a spot's intensity that goes along a unit vector.
fn cone(axis: DVec3, inner: f32, outer: f32, along: DVec3) -> f64 {
    let [inner, outer] = [inner, outer].map(versine);
    let here = axis.normalize_or_zero().distance_squared(along) / 2.0;
    if outer <= inner {
        return f64::from(u8::from(here < outer));
    }
    let t = ((outer - here) / (outer - inner)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn color(color: [f32; 3]) -> DVec3 {
    DVec3::from(color.map(f64::from))
}

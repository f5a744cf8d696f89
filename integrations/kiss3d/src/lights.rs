//! kiss3d's lights as the library's.

use deep_screen_space::{Light, glam::DVec3};
use kiss3d::{
    glamx::Vec3,
    light::{CollectedLight, LightCollection, LightType},
};

/// All lights of a frame.
pub fn of(lights: &LightCollection) -> Vec<Light> {
    lights.lights.iter().map(light).collect()
}

fn light(light: &CollectedLight) -> Light {
    let color = (light.color * light.intensity).max(Vec3::ZERO).to_array();
    let position = position(light.world_position);
    let direction = self::position(light.world_direction);
    match light.light_type {
        LightType::Directional(_) => Light::Directional {
            direction,
            irradiance: color,
        },
        LightType::Point { attenuation_radius } => Light::Point {
            position,
            intensity: intensity(color, attenuation_radius),
        },
        LightType::Spot {
            inner_cone_angle,
            outer_cone_angle,
            attenuation_radius,
        } => {
            let outer = outer_cone_angle.clamp(0.0, std::f32::consts::FRAC_PI_2);
            Light::Spot {
                position,
                direction,
                intensity: intensity(color, attenuation_radius),
                inner: inner_cone_angle.clamp(0.0, outer),
                outer,
            }
        }
    }
}

/// The intensity, W/sr, whose irradiance at the distance d, I/d², has the mean over the ball of radius r that kiss3d's
/// E (1 − (d/r)²)² has: ∫ E (1 − x²)² x² dx = 8/105 E over 0…1, so that I = 8/105 E r².
fn intensity(color: [f32; 3], radius: f32) -> [f32; 3] {
    color.map(|e| 8.0 / 105.0 * e * radius * radius)
}

fn position(v: Vec3) -> DVec3 {
    let [x, y, z] = v.to_array().map(f64::from);
    DVec3::new(x, y, z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_bring_a_ball_as_much_as_kiss3ds() {
        let [of_library, ..] = intensity([3.0; 3], 5.0);
        let steps = 100_000;
        let mean = |f: &dyn Fn(f64) -> f64| -> f64 {
            let step = 5.0 / f64::from(steps);
            (0..steps)
                .map(|i| (f64::from(i) + 0.5) * step)
                .map(|d| f(d) * d * d * step)
                .sum()
        };
        let kiss3d = mean(&|d| 3.0 * (1.0 - (d / 5.0).powi(2)).powi(2));
        let library = mean(&|d| f64::from(of_library) / (d * d));
        // Of the order of the steps' squares, and f32's own rounding.
        assert!((kiss3d / library - 1.0).abs() < 1e-6, "{kiss3d} {library}");
    }
}

//! What lights scenes that say nothing of it.

use deep_screen_space::{Light, glam::DVec3, scenes::Scene};

/// Whether any of a scene's surfaces shines of itself.
pub fn is_emissive(scene: &Scene) -> bool {
    let materials = &scene.materials;
    materials
        .iter()
        .any(|m| m.emission.iter().any(|e| *e > 0.0))
}

/// Late morning, for a scene without a light of its own.
pub fn sun_unless_emissive(scene: &Scene) -> Option<Light> {
    (!is_emissive(scene)).then_some(Light::Directional {
        direction: DVec3::new(0.45, -0.8, -0.4),
        irradiance: [3.2, 3.1, 2.9],
    })
}

/// Past what is looked at, from its left and above: what shines through a body.
pub fn from_behind(eye: DVec3, target: DVec3) -> Light {
    let ahead = (target - eye).with_y(0.0).normalize_or(DVec3::NEG_Z);
    Light::Directional {
        direction: 0.8 * ahead.cross(DVec3::Y) - 0.6 * ahead - 0.7 * DVec3::Y,
        irradiance: [3.2, 3.1, 2.9],
    }
}

/// A lamp beside an eye and above it.
pub fn beside(eye: DVec3, target: DVec3, up: DVec3) -> Light {
    let along = target - eye;
    let right = along.cross(up).normalize_or_zero();
    Light::Point {
        position: eye + 0.12 * along.length() * (right + up),
        intensity: [1.0; 3],
    }
}

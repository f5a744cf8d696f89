//! What planes send of lights and of their own.

use std::f64::consts::PI;

use deep_screen_space::{Light, Material, SurfelizerSettings, glam::DVec3};

use super::harness::{ALBEDO, Lab, above, color, material, point, squares, unshadowed};

/// `albedo/π · I cos θ / d²` on the side of the light and nothing on the other, on a plane; lights add.
#[test]
fn plane_has_its_closed_forms() {
    let lab = Lab::new();
    let lit = lab.cloud(
        &squares(&[(DVec3::ZERO, 2.0)]),
        &above(4.0),
        &SurfelizerSettings::default(),
    );
    let grey = [material(ALBEDO, [0.0; 3])];
    for (height, cone) in [
        (1.0_f64, None),
        (0.5, None),
        (-1.0, None),
        (1.5, Some((0.3_f64, 0.6_f64))),
    ] {
        let position = DVec3::new(0.4, height, -0.3);
        let intensity = [3.0, 2.0, 0.5];
        let light = match cone {
            None => point(position, intensity),
            Some((inner, outer)) => Light::Spot {
                position,
                direction: DVec3::NEG_Y * 9.0,
                intensity,
                inner: inner as f32,
                outer: outer as f32,
            },
        };
        let found = lab.shade(&lit, &grey, &[unshadowed(light)], 1);
        for (surfel, found) in lit.surfels.iter().zip(&found) {
            let offset = position - surfel.position;
            let mut expected =
                color(ALBEDO) / PI * color(intensity) * height.abs() / offset.length().powi(3);
            if let Some((inner, outer)) = cone {
                let cosine = height / offset.length();
                let t = ((cosine - outer.cos()) / (inner.cos() - outer.cos())).clamp(0.0, 1.0);
                expected *= t * t * (3.0 - 2.0 * t);
            }
            let (near, far) = if height > 0.0 {
                (found.front, found.back)
            } else {
                (found.back, found.front)
            };
            let off = (color(near) - expected).abs().max_element();
            assert!(
                off <= 1e-5 * (1.0 / height.powi(2)),
                "{light:?} at {}: {near:?}, expected {expected}",
                surfel.position
            );
            assert_eq!(far, [0.0; 3], "{light:?} at {}", surfel.position);
        }
    }
    let sun = |direction| {
        unshadowed(Light::Directional {
            direction,
            irradiance: [4.0, 2.0, 1.0],
        })
    };
    let down = sun(DVec3::new(0.0, -4.0, 3.0));
    let up = sun(DVec3::new(0.0, 3.0, -4.0));
    let expected = |share: f64| color(ALBEDO) / PI * color([4.0, 2.0, 1.0]) * share;
    for found in lab.shade(&lit, &grey, &[down, up, down], 1) {
        let front = (color(found.front) - expected(1.6)).abs().max_element();
        let back = (color(found.back) - expected(0.6)).abs().max_element();
        assert!(front < 1e-5 && back < 1e-5, "{found:?}");
    }
}

/// Emission is a radiosity, of the front alone, and stays exact however bright; so does what is reflected.
#[test]
fn emission_is_that_of_the_front() {
    let lab = Lab::new();
    let lit = lab.cloud(
        &squares(&[(DVec3::ZERO, 1.0)]),
        &above(3.0),
        &SurfelizerSettings::default(),
    );
    let bright = 1e6_f32;
    let emission = [bright * std::f32::consts::PI, 1.0, 0.0];
    let black = Light::Directional {
        direction: DVec3::X,
        irradiance: [0.0; 3],
    };
    let noon = Light::Directional {
        direction: DVec3::NEG_Y,
        irradiance: [bright * std::f32::consts::PI; 3],
    };
    let close = |found: f32, expected: f64| (f64::from(found) / expected - 1.0).abs() < 3e-7;
    for lights in [&[][..], &[unshadowed(black)], &[unshadowed(black); 3]] {
        for found in lab.shade(&lit, &[material([1.0; 3], emission)], lights, 4) {
            assert!(close(found.front[0], 1e6), "{found:?}");
            assert!(close(found.front[1], 1.0 / PI), "{found:?}");
            assert_eq!((found.front[2], found.back), (0.0, [0.0; 3]));
            assert_eq!((found.padding0, found.padding1), (0.0, 0.0));
        }
    }
    // The first light that shines is the one that starts from the emission.
    let lights = [unshadowed(black), unshadowed(noon), unshadowed(noon)];
    for found in lab.shade(&lit, &[material([1.0; 3], emission)], &lights, 1) {
        assert!(close(found.front[0], 3e6), "{found:?}");
        assert!(close(found.front[2], 2e6), "{found:?}");
    }
}

/// Of what is double-sided the back emits what the front does, and reflects besides; any number but 0 says so.
#[test]
fn double_sided_emission_is_that_of_both() {
    let lab = Lab::new();
    let lit = lab.cloud(
        &squares(&[(DVec3::ZERO, 1.0)]),
        &above(3.0),
        &SurfelizerSettings::default(),
    );
    let up = Light::Directional {
        direction: DVec3::Y,
        irradiance: [PI as f32; 3],
    };
    for double_sided in [1, u32::MAX] {
        let lamp = Material {
            double_sided,
            ..material([0.5; 3], [PI as f32, 0.0, 2.0])
        };
        for (lights, reflected) in [(&[][..], 0.0), (&[unshadowed(up)], 0.5)] {
            for found in lab.shade(&lit, &[lamp], lights, 1) {
                let front = DVec3::new(1.0, 0.0, 2.0 / PI);
                let back = front + reflected;
                let off = (color(found.front) - front).abs() + (color(found.back) - back).abs();
                assert!(off.max_element() < 1e-6, "{found:?}");
            }
        }
    }
}

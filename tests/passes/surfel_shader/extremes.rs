//! Brightness, places and scales far from 1, and nothing at all.

use std::f64::consts::PI;

use deep_screen_space::{
    Camera, Light, ShadedLight, Shadow, ShadowMap, SurfelizerSettings, Viewport, glam::DVec3,
    reference::surfel_shader as mirror, wgpu,
};

use support::raster::perspective;

use super::harness::{
    ALBEDO, Convention, DepthMap, Lab, above, differing, material, point, squares, unshadowed,
};

#[test]
fn extremes_stay_finite() {
    let lab = Lab::new();
    let lit = lab.cloud(
        &squares(&[(DVec3::ZERO, 1.0)]),
        &above(3.0),
        &SurfelizerSettings::default(),
    );
    let at = lit.surfels[lit.surfels.len() / 2].position;
    let odd = [f32::NAN, f32::INFINITY, -5.0];
    let huge = [3e38, 1e18, 1e30];
    let spot = |inner, outer| Light::Spot {
        position: DVec3::Y,
        direction: DVec3::NEG_Y,
        intensity: [1.0; 3],
        inner,
        outer,
    };
    let lights = [
        point(at, [1.0; 3]),
        point(at, [1e18; 3]),
        point(at + DVec3::Y * 1e-12, [1e18; 3]),
        point(at + DVec3::Y * 1e-30, [1e18; 3]),
        // The first that f32 can tell from the surfel's own place.
        point(at + DVec3::Y * 1e-6, [1e18; 3]),
        Light::Directional {
            direction: DVec3::NEG_Y,
            irradiance: [1e18; 3],
        },
        point(DVec3::splat(1e300), [1e18; 3]),
        point(DVec3::Y * 1e15, [1e18; 3]),
        point(at, [0.0; 3]),
        spot(0.0, 0.0),
        spot(1e-6, 1e-6),
        spot(0.0, std::f32::consts::FRAC_PI_2),
        Light::Directional {
            direction: DVec3::new(1e-200, 0.0, 1.0),
            irradiance: [1e18; 3],
        },
    ];
    for material in [
        material(ALBEDO, [0.0; 3]),
        material(odd, odd),
        material(huge, huge),
    ] {
        for light in lights {
            light.validate().expect("a light");
            for samples in [1, 16] {
                for found in lab.shade(&lit, &[material], &[unshadowed(light); 2], samples) {
                    let sound = found
                        .front
                        .iter()
                        .chain(&found.back)
                        .all(|c| (0.0..=1e18).contains(c));
                    assert!(sound, "{material:?} {light:?}: {found:?}");
                }
            }
        }
    }
    // An index beyond the table takes the last material, and odd components count as black.
    for odd in odd {
        let found = lab.shade(&lit, &[material([odd; 3], [odd, 0.0, 7.0])], &[], 1);
        let found = found[0];
        assert_eq!(found.front[0], 0.0, "{odd}: {found:?}");
        assert!(
            (f64::from(found.front[2]) - 7.0 / PI).abs() < 1e-6,
            "{found:?}"
        );
    }
}

/// 1e5 units from the origin, where f32 has steps of 0.008, and at scales of 1e-4 and 1e4, light is what it is at home.
#[test]
fn place_and_scale_do_not_matter() {
    let lab = Lab::new();
    let shift = DVec3::new(65536.0, -131_072.0, 32768.0);
    for (place, scale) in [(DVec3::ZERO, 1e-4), (DVec3::ZERO, 1e4), (shift, 1.0)] {
        let scene = squares(&[
            (place, 2.0 * scale),
            (place + DVec3::Y * 0.75 * scale, 0.5 * scale),
        ]);
        let camera = Camera::look_at(
            place + DVec3::Y * 4.0 * scale,
            place,
            DVec3::NEG_Z,
            perspective(60.0, 1.0, 0.1 * scale),
            Viewport::full(64, 64),
        )
        .expect("a camera");
        let lit = lab.cloud(&scene, &camera, &SurfelizerSettings::default());
        assert_eq!(lit.origin, camera.focus());
        let eye = place + DVec3::new(0.25, 2.0, 0.5) * scale;
        let cameras = [Camera::look_at(
            eye,
            place,
            DVec3::Z,
            Convention::Reversed.projection(2.0, 1.0, 0.1 * scale, 10.0 * scale),
            Viewport::full(128, 128),
        )
        .expect("a camera")];
        let map = DepthMap::draw(
            lab.gpu,
            &scene,
            &cameras,
            128,
            wgpu::TextureFormat::Depth32Float,
        );
        let light = point(eye, [(scale * scale) as f32; 3]);
        let found = lab.shade(
            &lit,
            &[material(ALBEDO, [0.0; 3])],
            &[ShadedLight {
                light,
                shadow: Shadow::Map(ShadowMap::new(&map.texture, &cameras)),
            }],
            1,
        );
        let expected = [mirror::ShadedLight {
            light,
            shadow: Some(map.mirror(&cameras)),
        }];
        print!("{place} scale {scale}: ");
        let bad = differing(&lit, &found, &[material(ALBEDO, [0.0; 3])], &expected, 1);
        let dark = found.iter().filter(|f| f.front == [0.0; 3]).count();
        assert!(
            dark > 20 && dark < found.len() / 2,
            "{place} {scale}: {dark} dark"
        );
        assert!(bad <= 2 + found.len() / 1000, "{place} {scale}: {bad}");
    }
}

#[test]
fn empty_clouds_are_valid() {
    let lab = Lab::new();
    let grey = [material(ALBEDO, [1.0; 3])];
    let light = [unshadowed(point(DVec3::Y, [1.0; 3]))];
    let none = lab.cloud(&squares(&[]), &above(3.0), &SurfelizerSettings::default());
    // `shade` checks that nothing is written.
    assert!(lab.shade(&none, &grey, &light, 4).is_empty());
    assert!(lab.shade(&none, &grey, &[], 4).is_empty());
}

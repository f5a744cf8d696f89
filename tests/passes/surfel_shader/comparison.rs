//! GPU and mirror.

use deep_screen_space::{
    Camera, Light, Placement, ShadedLight, Shadow, ShadowMap, SurfelizerSettings, Viewport,
    glam::DVec3, reference::surfel_shader as mirror, scenes, wgpu,
};

use support::testing::shot::camera_of;

use super::harness::{Convention, DepthMap, Lab, cube, differing, point};

/// All kinds of lights and shadow maps over the crate's own scenes.
#[test]
fn gpu_is_its_mirror() {
    let lab = Lab::new();
    for (name, eye) in [
        ("cornell", DVec3::new(0.3, 1.6, 0.2)),
        ("dominoes", DVec3::new(0.4, 2.0, 0.6)),
    ] {
        let scene = scenes::by_name(name).expect("a scene");
        let camera = camera_of(&scene, 0, [96, 96]);
        let materials = scene.material_table();
        let sun = DVec3::new(-0.3, -1.0, -0.4);
        let sun_cameras = [Camera::look_at(
            -sun * 10.0,
            DVec3::ZERO,
            DVec3::Z,
            Convention::Orthographic.projection(6.0, 0.0, 0.0, 30.0),
            Viewport::full(256, 256),
        )
        .expect("a camera")];
        let spot_cameras = [Camera::look_at(
            eye,
            DVec3::ZERO,
            DVec3::Z,
            Convention::Forward.projection(1.0, 1.0, 0.05, 50.0),
            Viewport {
                x: 40,
                y: 8,
                width: 200,
                height: 200,
            },
        )
        .expect("a camera")];
        let cube_cameras = cube(eye, 128, 0.02);
        let lights = [
            (
                Light::Directional {
                    direction: sun,
                    irradiance: [3.0, 2.5, 2.0],
                },
                &sun_cameras[..],
                256,
                wgpu::TextureFormat::Depth32Float,
            ),
            (
                Light::Spot {
                    position: eye,
                    direction: -eye,
                    intensity: [2.0, 4.0, 6.0],
                    inner: 0.3,
                    outer: 0.7,
                },
                &spot_cameras[..],
                256,
                wgpu::TextureFormat::Depth16Unorm,
            ),
            (
                point(eye, [5.0, 1.0, 0.5]),
                &cube_cameras[..],
                128,
                wgpu::TextureFormat::Depth32Float,
            ),
        ];
        let maps: Vec<DepthMap> = lights
            .iter()
            .map(|(_, cameras, size, format)| {
                DepthMap::draw(lab.gpu, &scene, cameras, *size, *format)
            })
            .collect();
        let shaded: Vec<ShadedLight<'_>> = lights
            .iter()
            .zip(&maps)
            .map(|((light, cameras, ..), map)| ShadedLight {
                light: *light,
                shadow: Shadow::Map(ShadowMap::new(&map.texture, cameras)),
            })
            .collect();
        let expected: Vec<mirror::ShadedLight<'_>> = lights
            .iter()
            .zip(&maps)
            .map(|((light, cameras, ..), map)| mirror::ShadedLight {
                light: *light,
                shadow: Some(map.mirror(cameras)),
            })
            .collect();
        for (placement, samples) in [
            (Placement::Centroid, 1),
            (Placement::Centroid, 8),
            (Placement::Random, 8),
        ] {
            let settings = SurfelizerSettings {
                placement,
                ..SurfelizerSettings::default()
            };
            let lit = lab.cloud(&scene, &camera, &settings);
            let count = lit.surfels.len();
            assert!(count > 1000, "{name}: {count} surfels");
            let found = lab.shade(&lit, &materials, &shaded, samples);
            print!("{name} {placement:?} {samples} samples: ");
            let bad = differing(&lit, &found, &materials, &expected, samples);
            // Look-ups that fall on another texel by rounding: at an edge of the map's texels, of which a share of 1e-4
            // is within rounding, and only where neighbours differ.
            assert!(
                bad <= 2 + count / 1000,
                "{name} {placement:?} {samples}: {bad} of {count}"
            );
            // The shadows are there: without them much would be brighter.
            let plain: Vec<mirror::ShadedLight<'_>> = expected
                .iter()
                .map(|l| mirror::ShadedLight { shadow: None, ..*l })
                .collect();
            print!("  without shadows: ");
            let shadowed = differing(&lit, &found, &materials, &plain, samples);
            assert!(
                shadowed > count / 20,
                "{name}: {shadowed} of {count} have shadows"
            );
        }
    }
}

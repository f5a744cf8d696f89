//! Lights of a closed form, and extreme ones.

use deep_screen_space::{
    Camera, Components, GBuffer, Gatherer, Light, PolygonLight, SgHullInput, SgHullSettings,
    SgHullSize, Viewport,
    glam::{DMat4, DVec3, DVec4},
    scenes,
    wgpu::{BufferUsages, TextureFormat as Format},
};

use support::testing::{
    frames::Decoded,
    pipelines,
    shot::{Shot, camera_of},
};

use super::harness::{FORMAT, LAB, Lab, check_covered, hull, record};

#[test]
fn extreme_lights() {
    let Lab {
        gpu,
        gatherer,
        hull,
    } = &*LAB;
    let scene = scenes::cornell();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [64, 64]));
    let receivers = shot.receivers(shot.camera.eye());
    let on_surface = receivers
        .iter()
        .flatten()
        .next()
        .expect("a surface")
        .position;
    let directional = |direction: DVec3, irradiance: f32| Light::Directional {
        direction,
        irradiance: [irradiance; 3],
    };
    let around: Vec<Light> = [DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .flat_map(|d| [directional(d, 1.0), directional(-d, 1.0)])
        .collect();
    let at_surface = Light::Point {
        position: shot.camera.eye() + on_surface,
        intensity: [1.0; 3],
    };
    for (name, lights) in [
        ("none", vec![]),
        ("black", vec![directional(DVec3::X, 0.0)]),
        ("one", vec![directional(DVec3::new(0.3, -1.0, -0.5), 1.0)]),
        (
            "one of 1e6",
            vec![directional(DVec3::new(0.3, -1.0, -0.5), 1e6)],
        ),
        (
            "the brightest",
            vec![directional(DVec3::new(0.3, -1.0, -0.5), 1e18)],
        ),
        ("all around", around),
        ("at a surface", vec![at_surface]),
    ] {
        let gather = gatherer
            .bind_lights(&gpu.device, &lights, shot.camera.eye())
            .expect("lights");
        let settings = SgHullSettings::default();
        let size = SgHullSize::new(64, 64);
        let recorded = record(gpu, hull, &shot, &gather, &settings, size);
        check_covered(&recorded, &shot, name);
        // Directional light is the same everywhere, and one lobe holds one light: the picture is exact.
        if let [
            Light::Directional {
                direction,
                irradiance,
            },
        ] = lights[..]
        {
            let peak = f64::from(irradiance[0]).max(1e-30);
            for (i, receiver) in receivers.iter().enumerate() {
                let Some(receiver) = receiver else { continue };
                let cosine = receiver.normal.dot(-direction.normalize()).max(0.0);
                let expected = cosine / std::f64::consts::PI;
                let found = f64::from(recorded.pixels[i][0]) / peak;
                // Normals of 16 bits, and the width of the narrowest lobe at the horizon.
                let off = if irradiance[0] > 0.0 {
                    (found - expected).abs()
                } else {
                    found
                };
                assert!(
                    off < 1e-3,
                    "{name}: pixel {i} is {found}, expected {expected}"
                );
            }
        }
    }
}

/// A square light above a point, by the form factor of a parallel square.
#[test]
fn polygons_have_their_form_factor() {
    let gpu = pipelines::gpu();
    let gatherer = Gatherer::polygons(&gpu.device);
    let hull = hull(gpu, &gatherer, Components::UnionFind);
    // A plane seen from above, orthographic: every pixel at y = 0.
    let projection = DMat4::from_cols(
        DVec4::X / 1e-3,
        DVec4::Y / 1e-3,
        DVec4::Z * 0.1,
        DVec4::W + DVec4::Z,
    );
    let camera = Camera::look_at(
        DVec3::Y * 5.0,
        DVec3::ZERO,
        DVec3::Z,
        projection,
        Viewport::full(32, 32),
    )
    .expect("a camera");
    let depth = [0.5_f32; 1024];
    let normal = [[0.0_f32, 1.0, 0.0, 0.0]; 1024];
    let depth = gpu.texture(Format::R32Float, 32, 32, &depth);
    let normal = gpu.texture(Format::Rgba32Float, 32, 32, &normal);
    // 2 x 2 at a height of 1 above the plane, that is 4 below the eye, facing down.
    let corner = |x: f32, z: f32| [x, -4.0, z];
    let corners = [
        corner(-1.0, -1.0),
        corner(1.0, -1.0),
        corner(1.0, 1.0),
        corner(-1.0, 1.0),
    ];
    let light = |a: usize, b: usize, c: usize| PolygonLight {
        a: corners[a],
        red: 1.0,
        b: corners[b],
        green: 2.0,
        c: corners[c],
        blue: 1e6,
    };
    let lights = gpu.buffer(&[light(0, 1, 2), light(0, 2, 3)], BufferUsages::STORAGE);
    let gather = gatherer
        .bind_polygons(&gpu.device, &lights)
        .expect("lights");
    let view = hull
        .create_view(&gpu.device, SgHullSize::new(32, 32))
        .expect("a view");
    let target = gpu.target(FORMAT, 32, 32);
    let gbuffer = GBuffer::new(depth.texture(), normal.texture());
    let mut decoded = Decoded::of(&camera);
    // Four quarters: F = 2 / π · a/√(1+a²) · atan(a/√(1+a²)) each of side a = 1 at height 1, over four of them.
    let s = 1.0 / 2.0_f64.sqrt();
    let expected = 4.0 * s * s.atan() / std::f64::consts::PI;
    let settings = SgHullSettings::default();
    for exact in [false, true] {
        let mut encoder = gpu.encoder();
        let frame = decoded.frame(&mut encoder, gbuffer, &camera, camera.eye());
        let input = SgHullInput::new(&frame, Some(&gather), target.texture());
        if exact {
            hull.record_per_pixel(&gpu.device, &mut encoder, &input, &settings, &view)
        } else {
            hull.record(&gpu.device, &mut encoder, &input, &settings, &view)
        }
        .expect("it fits");
        gpu.finish(encoder);
        let texels: Vec<[f32; 4]> = gpu.read_texture(target.texture(), 0);
        for (channel, radiosity) in [1.0, 2.0, 1e6].into_iter().enumerate() {
            let found = f64::from(texels[500][channel]) * std::f64::consts::PI / radiosity;
            // The angle's fit is good to 5e-4.
            assert!(
                (found - expected).abs() < 1e-3,
                "exact {exact}, channel {channel}: {found}, expected {expected}"
            );
        }
    }
}

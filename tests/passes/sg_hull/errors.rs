//! What is refused, by name.

use deep_screen_space::{
    Components, Error, Gatherer, Light, SgHullInput, SgHullSettings, SgHullSize, SgHullView,
    glam::DVec3, scenes, wgpu::TextureFormat as Format,
};

use support::testing::{
    frames::Decoded,
    pipelines,
    shot::{Shot, camera_of},
};

use super::harness::{FORMAT, hull};

#[track_caller]
fn refused<T>(result: Result<T, Error>, kind: &str, thing: &str) {
    let Err(error) = result else {
        panic!("{thing} was accepted");
    };
    assert!(format!("{error:?}").starts_with(kind), "{error:?}");
    assert!(error.to_string().contains(thing), "{error}");
}

#[test]
fn what_does_not_fit_is_refused() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let gatherer = Gatherer::lights(device);
    let hull = hull(gpu, &gatherer, Components::UnionFind);
    let with = |change: &dyn Fn(&mut SgHullSettings)| {
        let mut settings = SgHullSettings::default();
        change(&mut settings);
        settings.validate()
    };
    refused(with(&|s| s.quad = 7), "Setting", "::quad");
    refused(with(&|s| s.gap = 0.0), "Setting", "::gap");
    refused(
        with(&|s| s.plane_distance = f32::NAN),
        "Setting",
        "::plane_distance",
    );
    refused(with(&|s| s.normal_angle = 4.0), "Setting", "::normal_angle");
    refused(
        with(&|s| s.error_threshold = f32::NAN),
        "Setting",
        "::error_threshold",
    );
    refused(with(&|s| s.f0[1] = 1.1), "Setting", "::f0");
    let size = SgHullSize::new(16, 16);
    let create = |size| hull.create_view(device, size);
    refused(create(SgHullSize { width: 0, ..size }), "Setting", "size");
    refused(create(SgHullSize { grid: 31, ..size }), "Setting", "::grid");
    let many = SgHullSize {
        segments: 1 << 20,
        ..size
    };
    refused(create(many), "Limit", "max_storage_buffer_binding_size");
    let view: SgHullView = create(size).expect("a view");
    assert!(view.memory_bytes() > 65536 * 480 + 32768 * 624);
    refused(
        create(SgHullSize {
            per_pixel: 0,
            ..size
        }),
        "Setting",
        "::per_pixel",
    );
    let many = SgHullSize {
        splits: (1 << 18) + 1,
        ..size
    };
    refused(create(many), "Setting", "::splits");

    let scene = scenes::cornell();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [16, 16]));
    let target = gpu.target(FORMAT, 16, 16);
    let other = gpu.target(Format::Rgba16Float, 16, 16);
    let gather = gatherer
        .bind_lights(device, &[], shot.camera.eye())
        .expect("lights");
    let mut encoder = gpu.encoder();
    let mut decoded = Decoded::of(&shot.camera);
    let eye = shot.camera.eye();
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, eye);
    let good = SgHullInput::new(&frame, Some(&gather), target.texture());
    let settings = SgHullSettings::default();
    let record =
        |input: &SgHullInput<'_>| hull.record(device, &mut gpu.encoder(), input, &settings, &view);
    record(&good).expect("it fits");
    let input = SgHullInput {
        gather: None,
        ..good
    };
    refused(record(&input), "Mismatch", "SgHullInput::gather");
    let input = SgHullInput {
        target: other.texture().into(),
        ..good
    };
    refused(record(&input), "Mismatch", "Rgba16Float");
    let camera = camera_of(&scene, 0, [15, 16]);
    let mut narrow = Decoded::of(&camera);
    let frame = narrow.frame(&mut encoder, shot.gbuffer(), &camera, eye);
    let input = SgHullInput {
        frame: &frame,
        ..good
    };
    refused(record(&input), "Mismatch", "SgHullView");
    let bad = [Light::Point {
        position: DVec3::NAN,
        intensity: [1.0; 3],
    }];
    refused(
        gatherer.bind_lights(device, &bad, DVec3::ZERO),
        "Setting",
        "Light::position",
    );
}

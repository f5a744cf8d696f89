//! The objects on top, and what is refused.

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedZBuffer, BvhBuilder, Error, Geometry, HitLighting,
    Light, Payload, Primitives, Quality, RayTracedEffect, RayTracedInput, RayTracedScene,
    RayTracedSceneInput, RayTracedView, RayTracedViewDescriptor, Sampling,
    glam::DVec3,
    reference::objects::Objects,
    scenes,
    wgpu::{self, TextureFormat},
};
use support::{
    errors::rmse,
    gpu::{Ask, Gpu},
    testing::{frames::Decoded, rays::triangles, refusals::refused, shot::Shot},
};

use lab::{LABS, settings};

fn view_of(effect: RayTracedEffect, primitives: Primitives) -> RayTracedView {
    let format = TextureFormat::Rgba32Float;
    let descriptor = RayTracedViewDescriptor {
        primitives,
        ..RayTracedViewDescriptor::new(effect, Quality::Balanced, format)
    };
    RayTracedView::new(&LABS.gpu.device, &descriptor).expect("pipelines")
}

/// A picture of a view, of what it shows.
fn picture(
    shot: &Shot,
    effect: RayTracedEffect,
    primitives: Primitives,
    size: u32,
) -> Vec<[f32; 4]> {
    let (gpu, device) = (LABS.gpu, &LABS.gpu.device);
    let mut scene = RayTracedScene::with_primitives(device, primitives).expect("pipelines");
    let mut view = view_of(effect, primitives);
    let target = gpu.target(TextureFormat::Rgba32Float, size, size);
    let meshes = shot.buffers.meshes();
    let lights = [Light::Point {
        position: DVec3::new(0.3, 1.5, 0.2),
        intensity: [4.0, 3.0, 2.0],
    }];
    let input = RayTracedSceneInput {
        lighting: Some(HitLighting {
            materials: &shot.buffers.materials,
            lights: &lights,
        }),
        ..RayTracedSceneInput::new(Geometry { meshes: &meshes }, &shot.camera)
    };
    // The second frame has what the first one kept.
    for _ in 0..2 {
        let mut encoder = gpu.encoder();
        scene.record(device, &mut encoder, &input).expect("a scene");
        let input = RayTracedInput::new(shot.lit_gbuffer(), &shot.camera, target.texture());
        view.record(device, &mut encoder, &scene, &input)
            .expect("a picture");
        gpu.finish(encoder);
    }
    assert!(scene.memory_bytes() > 0);
    gpu.read_texture(target.texture(), 0)
}

/// Pictures of a whole frame are those of the crate's own traversal. Occlusion's hits are any, and how near the one found was
/// guides the filter; of light the nearest hit counts, and what differs is a ray in a thousand that passes an edge. Half of
/// light's rays go where noise is, so that one which differs moves those of the pixels about it: the pictures differ by their
/// noise there.
#[test]
fn pictures_are_those_of_the_crates_own_rays() {
    let size = 48;
    let effects = [
        (
            "occlusion",
            RayTracedEffect::AmbientOcclusion { radius: 2.0 },
            0.02,
        ),
        (
            "light",
            RayTracedEffect::IndirectDiffuse {
                sky_radiance: [0.5, 0.25, 0.125],
            },
            0.02,
        ),
    ];
    for scene in [scenes::cornell(), scenes::dominoes()] {
        let shot = LABS.shot(&scene, 0, size);
        for (name, effect, most) in effects {
            let [device, own] = [Primitives::RayQuery, Primitives::Triangles]
                .map(|primitives| picture(&shot, effect, primitives, size));
            let off = rmse(device.as_flattened(), own.as_flattened());
            let mean = own.iter().map(|p| f64::from(p[1])).sum::<f64>() / own.len() as f64;
            println!(
                "{} {name}: RMSE {off:.1e} of a mean of {mean:.3}",
                scene.name
            );
            assert!(
                mean > 0.0 && off <= most * mean,
                "{} {name}: {off}",
                scene.name
            );
        }
    }
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let device = &LABS.gpu.device;
    let statistics = BouncedDescriptor {
        primitives: Primitives::RayQuery,
        statistics: true,
        ..BouncedDescriptor::default()
    };
    refused(
        BouncedZBuffer::new(device, &statistics),
        "Setting",
        "BouncedDescriptor::statistics",
        "Primitives::RayQuery",
    );
    refused(
        RayTracedScene::with_primitives(device, Primitives::Disks { levels: 1 }),
        "Setting",
        "RayTracedScene::with_primitives",
        "triangles",
    );

    // Hierarchies of another kind, both ways.
    let shot = LABS.shot(&scenes::cornell(), 0, 8);
    let senders = LABS.senders(&shot, &triangles());
    let mut decoded = Decoded::of(&shot.camera);
    let mut encoder = LABS.gpu.encoder();
    let origin = senders[0].cloud.origin();
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, origin);
    for (of, other, needed) in [(0, 1, "by ray queries"), (1, 0, "triangles")] {
        let tracer = LABS.both[of].tracer(Default::default(), Default::default());
        let view = tracer.create_view(device, 8, 8, 1).expect("a view");
        let record = |of: usize| {
            let input = BouncedInput::new(&frame, &senders[of].cloud, &senders[of].bounds);
            tracer.record(device, &mut LABS.gpu.encoder(), &input, &settings(1), &view)
        };
        assert_eq!(record(of), Ok(()));
        refused(record(other), "Mismatch", "Bvh", needed);
        let builder = BvhBuilder::new(device, LABS.both[of].primitives).expect("pipelines");
        let (cloud, bvh) = (&senders[other].cloud, &senders[other].bounds);
        let recorded = builder.record(device, &mut LABS.gpu.encoder(), cloud, bvh, None);
        refused(recorded, "Mismatch", "Bvh", needed);
    }

    // Objects of another kind.
    let mut scene = RayTracedScene::new(device).expect("pipelines");
    let meshes = shot.buffers.meshes();
    let input = RayTracedSceneInput::new(Geometry { meshes: &meshes }, &shot.camera);
    scene.record(device, &mut encoder, &input).expect("a scene");
    let effect = RayTracedEffect::AmbientOcclusion { radius: 1.0 };
    let mut view = view_of(effect, Primitives::RayQuery);
    let target = LABS.gpu.target(TextureFormat::Rgba32Float, 8, 8);
    let input = RayTracedInput::new(shot.gbuffer(), &shot.camera, target.texture());
    refused(
        view.record(device, &mut encoder, &scene, &input),
        "Mismatch",
        "Bvh",
        "by ray queries",
    );
}

/// A device that was made with the feature, and with less room than it takes.
#[test]
fn limits_are_typed_errors() {
    let feature = wgpu::Features::EXPERIMENTAL_RAY_QUERY;
    assert!(LABS.gpu.device.features().contains(feature));
    let floor = wgpu::Limits::default();
    let enough = floor
        .clone()
        .using_minimum_supported_acceleration_structure_values();
    let open = |limits| lab::open(Some(limits)).device;
    let device = open(floor);
    let new = |device: &wgpu::Device| BvhBuilder::new(device, Primitives::RayQuery);
    refused(
        new(&device),
        "Limit",
        "max_acceleration_structures_per_shader_stage",
        "1",
    );
    // What has no use for it works on such a device as on any.
    assert!(BvhBuilder::new(&device, Primitives::Triangles).is_ok());
    assert!(deep_screen_space::SurfelShader::new(&device).is_ok());
    let device = open(wgpu::Limits {
        max_blas_primitive_count: 3 * 100,
        ..enough
    });
    let builder = new(&device).expect("pipelines");
    let surfelizer = deep_screen_space::Surfelizer::new(&device).expect("pipelines");
    let cloud = |pieces| {
        let capacity = deep_screen_space::CloudCapacity {
            surfels: 0,
            pieces,
            triangles: 100,
        };
        surfelizer.create_cloud(&device, capacity).expect("a cloud")
    };
    assert!(builder.create(&device, &cloud(100)).is_ok());
    refused(
        builder.create(&device, &cloud(101)),
        "Limit",
        "max_blas_primitive_count",
        "303",
    );
    let plain = Gpu::open(Ask::Floor).expect("the same adapter");
    let error = new(&plain.device).err();
    assert!(
        matches!(error, Some(Error::Feature { feature: f, .. }) if f == feature),
        "{error:?}"
    );
}

/// What traces a structure keeps its bind group for the next recording. Other tests make objects beside: the fewest of many.
#[test]
fn recordings_again_make_nothing() {
    let device = &LABS.gpu.device;
    let shot = LABS.shot(&scenes::cornell(), 0, 8);
    let senders = &LABS.senders(&shot, &triangles())[0];
    let lab = &LABS.both[0];
    let tracer = lab.tracer(Payload::Occlusion, Sampling::Cosine);
    let builder = BvhBuilder::new(device, lab.primitives).expect("pipelines");
    let view = tracer.create_view(device, 8, 8, 1).expect("a view");
    let mut encoder = LABS.gpu.encoder();
    let mut decoded = Decoded::of(&shot.camera);
    let origin = senders.cloud.origin();
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, origin);
    let fewest = (0..100)
        .map(|_| {
            let before = Objects::made();
            builder
                .record(device, &mut encoder, &senders.cloud, &senders.bounds, None)
                .expect("a hierarchy");
            let input = BouncedInput::new(&frame, &senders.cloud, &senders.bounds);
            tracer
                .record(device, &mut encoder, &input, &settings(1), &view)
                .expect("hits");
            Objects::made().since(before).bind_groups
        })
        .min();
    assert_eq!(fewest, Some(0));
}

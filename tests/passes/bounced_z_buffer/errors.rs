//! What is refused, by name.

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedScene, BouncedSettings, BouncedView, BouncedZBuffer,
    BvhBuilder, CloudCapacity, Error, HitLighting, HitRadiance, Payload, Placement, Primitives,
    RayTracedScene, Sampling, SurfelRadiance, SurfelizerSettings, Timestamps, glam::DVec3, scenes,
    wgpu,
};

use support::testing::{
    frames::Decoded,
    pipelines,
    rays::{lab, triangles},
    refusals::fields_refused,
};

use super::harness::{senders_of, settings, shot_of};

#[test]
fn settings_out_of_range_are_typed_errors() {
    let good = BouncedSettings::default();
    assert_eq!(good.validate(), Ok(()));
    for good in [
        BouncedSettings {
            rays_per_pixel: 0,
            ..good
        },
        BouncedSettings {
            rays_per_pixel: 64,
            ..good
        },
        BouncedSettings {
            radius: 0.0,
            ..good
        },
        BouncedSettings {
            frame: 1 << 20,
            ..good
        },
        BouncedSettings {
            sky_radiance: [0.0, 1.0, 1e18],
            ..good
        },
    ] {
        assert_eq!(good.validate(), Ok(()), "{good:?}");
    }
    let bad = [
        (
            BouncedSettings {
                rays_per_pixel: 65,
                ..good
            },
            "BouncedSettings::rays_per_pixel",
        ),
        (
            BouncedSettings {
                radius: -0.1,
                ..good
            },
            "BouncedSettings::radius",
        ),
        (
            BouncedSettings {
                radius: f32::NAN,
                ..good
            },
            "BouncedSettings::radius",
        ),
        (
            BouncedSettings {
                frame: (1 << 20) + 1,
                ..good
            },
            "BouncedSettings::frame",
        ),
        (
            BouncedSettings {
                sky_radiance: [0.0, -1.0, 0.0],
                ..good
            },
            "BouncedSettings::sky_radiance",
        ),
        (
            BouncedSettings {
                sky_radiance: [0.0, 0.0, f32::NAN],
                ..good
            },
            "BouncedSettings::sky_radiance",
        ),
        (
            BouncedSettings {
                sky_radiance: [2e18, 0.0, 0.0],
                ..good
            },
            "BouncedSettings::sky_radiance",
        ),
    ];
    fields_refused(bad, BouncedSettings::validate);
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let lab = lab();
    let device = &lab.gpu.device;
    let scene = scenes::cornell();
    let shot = shot_of(&scene, 0, [16, 8]);
    let senders = senders_of(&shot, &triangles());
    let small = CloudCapacity {
        surfels: 16,
        pieces: 64,
        triangles: 1 << 12,
    };
    let other = lab.senders(&[], &shot.camera, &triangles(), small);
    let tracer = lab.tracer(Payload::Radiance, Sampling::Cosine);
    let (radiance, _) = lab.motley(&senders);
    let view = lab.view(&shot, Payload::Radiance, Sampling::Cosine, 4);
    let mut encoder = lab.gpu.encoder();
    let mut decoded = Decoded::of(&shot.camera);
    let origin = senders.cloud.origin();
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, origin);
    let input = BouncedInput {
        radiance: HitRadiance::Surfels(&radiance),
        ..BouncedInput::new(&frame, &senders.cloud, &senders.bounds)
    };
    let record = |input: &BouncedInput<'_>, settings: &BouncedSettings, view: &BouncedView| {
        tracer.record(device, &mut lab.gpu.encoder(), input, settings, view)
    };
    let named = |result: Result<(), Error>| match result {
        Err(
            Error::Mismatch { name, .. }
            | Error::Buffer { name, .. }
            | Error::Size { name, .. }
            | Error::Format { name, .. }
            | Error::Setting { field: name, .. },
        ) => name,
        other => panic!("{other:?}"),
    };
    assert_eq!(record(&input, &settings(4), &view), Ok(()));
    assert_eq!(record(&input, &settings(0), &view), Ok(()));

    // Settings and views.
    assert_eq!(
        named(record(&input, &settings(65), &view)),
        "BouncedSettings::rays_per_pixel"
    );
    assert_eq!(named(record(&input, &settings(5), &view)), "BouncedView");
    for view in [
        tracer.create_view(device, 15, 8, 4).expect("a view"),
        lab.view(&shot, Payload::Occlusion, Sampling::Cosine, 4),
        lab.view(&shot, Payload::Radiance, Sampling::Uniform, 4),
    ] {
        assert_eq!(named(record(&input, &settings(4), &view)), "BouncedView");
    }
    for (width, height, rays_per_pixel, field) in [
        (16, 8, 65, "rays_per_pixel"),
        (0, 8, 4, "view size"),
        (16, 0, 4, "view size"),
    ] {
        for payload in [Payload::Occlusion, Payload::Radiance] {
            let made = lab.tracer(payload, Sampling::Cosine).create_view(
                device,
                width,
                height,
                rays_per_pixel,
            );
            assert_eq!(
                named(made.map(|_| ())),
                field,
                "{width}x{height} {payload:?}"
            );
        }
    }
    let limit = device.limits().max_texture_dimension_2d;
    assert!(matches!(
        tracer.create_view(device, limit + 1, 8, 4),
        Err(Error::Limit { .. })
    ));
    // Bits of more pixels than one binding holds.
    let occlusion = lab.tracer(Payload::Occlusion, Sampling::Cosine);
    if device.limits().max_storage_buffer_binding_size < 8 * u64::from(limit).pow(2) {
        assert!(matches!(
            occlusion.create_view(device, limit, limit, 64),
            Err(Error::Limit { .. })
        ));
    }

    // Bounds, and what they are recorded for.
    let bad = BouncedInput {
        scene: BouncedScene::Cloud {
            cloud: &senders.cloud,
            bvh: &other.bounds,
        },
        ..input
    };
    assert_eq!(named(record(&bad, &settings(4), &view)), "Bvh");
    let mut encoder = lab.gpu.encoder();
    let wrong = pipelines::bvh_builder(Primitives::Triangles).record(
        device,
        &mut encoder,
        &senders.cloud,
        &other.bounds,
        None,
    );
    assert_eq!(named(wrong), "Bvh");

    // Radiance.
    let capacity = u64::from(senders.cloud.capacity().surfels);
    let buffer = |bytes: u64, usage| {
        device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes,
            usage,
            mapped_at_creation: false,
        })
    };
    let needed = capacity * size_of::<SurfelRadiance>() as u64;
    let [short, unbound] = [
        buffer(needed - 4, wgpu::BufferUsages::STORAGE),
        buffer(needed, wgpu::BufferUsages::VERTEX),
    ];
    let materials = &shot.buffers.materials;
    let lit = HitLighting {
        materials,
        lights: &[],
    };
    for (radiance, name) in [
        (HitRadiance::None, "BouncedInput::radiance"),
        (HitRadiance::Lit(lit), "BouncedInput::radiance"),
        (HitRadiance::Surfels(&short), "HitRadiance::Surfels"),
        (HitRadiance::Surfels(&unbound), "HitRadiance::Surfels"),
    ] {
        let bad = BouncedInput { radiance, ..input };
        assert_eq!(named(record(&bad, &settings(4), &view)), name);
    }
    for placement in [Placement::Grid, Placement::Random] {
        let mut senders = senders_of(&shot, &triangles());
        let cloud = SurfelizerSettings {
            placement,
            ..triangles()
        };
        lab.record_senders(&mut senders, &shot.buffers.meshes(), &shot.camera, &cloud);
        let bad = BouncedInput {
            scene: BouncedScene::Cloud {
                cloud: &senders.cloud,
                bvh: &senders.bounds,
            },
            ..input
        };
        assert_eq!(
            named(record(&bad, &settings(4), &view)),
            "SurfelizerSettings::placement"
        );
        // For occlusion pieces are enough.
        let view = lab.view(&shot, Payload::Occlusion, Sampling::Cosine, 4);
        let mut encoder = lab.gpu.encoder();
        assert_eq!(
            occlusion.record(device, &mut encoder, &bad, &settings(4), &view),
            Ok(())
        );
    }

    // The frame: of another size, relative to another point than the cloud, and its G-buffer.
    let narrow = shot_of(&scene, 0, [8, 8]);
    let mut other = Decoded::of(&narrow.camera);
    let wrong = other.record(&mut encoder, shot.gbuffer(), &shot.camera, origin);
    assert_eq!(named(wrong.map(|_| ())), "Receivers");
    let frame = other.frame(&mut encoder, narrow.gbuffer(), &narrow.camera, origin);
    let bad = BouncedInput {
        frame: &frame,
        ..input
    };
    assert_eq!(named(record(&bad, &settings(4), &view)), "BouncedView");
    let mut other = Decoded::of(&shot.camera);
    let aside = origin + DVec3::X;
    let frame = other.frame(&mut encoder, shot.gbuffer(), &shot.camera, aside);
    let bad = BouncedInput {
        frame: &frame,
        ..input
    };
    assert_eq!(
        named(record(&bad, &settings(4), &view)),
        "FrameInput::origin"
    );
    let wrong = other.record(&mut encoder, narrow.gbuffer(), &shot.camera, origin);
    assert_eq!(named(wrong.map(|_| ())), "GBuffer::depth");
    for aside in [f64::NAN, 1e30] {
        let wrong = other.record(&mut encoder, shot.gbuffer(), &shot.camera, DVec3::X * aside);
        assert_eq!(named(wrong.map(|_| ())), "FrameInput::origin");
    }

    // A scene is not traced from times that begin where they end.
    if device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
        let set = device.create_query_set(&wgpu::QuerySetDescriptor {
            label: None,
            ty: wgpu::QueryType::Timestamp,
            count: 2,
        });
        let timestamps = Some(Timestamps {
            set: &set,
            begin: 1,
            end: 1,
        });
        let bad = BouncedInput {
            timestamps,
            ..input
        };
        assert_eq!(named(record(&bad, &settings(4), &view)), "Timestamps::end");
        let mut encoder = lab.gpu.encoder();
        let wrong = pipelines::bvh_builder(Primitives::Triangles).record(
            device,
            &mut encoder,
            &senders.cloud,
            &senders.bounds,
            timestamps,
        );
        assert_eq!(named(wrong), "Timestamps::end");
    }
}

/// A device that was not made for rays of its own refuses them by the name of what it lacks.
#[test]
fn ray_queries_need_a_device_for_them() {
    let device = &lab().gpu.device;
    let primitives = Primitives::RayQuery;
    let descriptor = BouncedDescriptor {
        primitives,
        ..BouncedDescriptor::default()
    };
    for refused in [
        BvhBuilder::new(device, primitives).err(),
        BouncedZBuffer::new(device, &descriptor).err(),
        RayTracedScene::with_primitives(device, primitives).err(),
    ] {
        assert!(
            matches!(
                refused,
                Some(Error::Feature { feature, why: "Primitives::RayQuery" })
                    if feature == wgpu::Features::EXPERIMENTAL_RAY_QUERY
            ),
            "{refused:?}"
        );
    }
}

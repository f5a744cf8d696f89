//! What it costs, as ratios within one run.

use deep_screen_space::{
    BouncedSettings, BvhBuilder, CloudCapacity, Payload, Sampling, Timestamps, scenes, wgpu,
};
use support::testing::{frames::Decoded, rays::triangles};

use crate::{LABS, settings};

/// Prints the time of building and of rays by the device, over the crate's own; the fastest of a few runs.
#[test]
#[ignore = "it measures, and tests nothing"]
fn times_over_the_crates_own() {
    const RUNS: usize = 5;
    println!(
        "{}: {:>12} {:>9} {:>9} {:>9} {:>9}",
        LABS.gpu.name(),
        "scene",
        "triangles",
        "build",
        "any",
        "nearest"
    );
    for scene in [
        scenes::cornell(),
        scenes::closed_room(),
        scenes::dominoes(),
        scenes::colonnade(),
    ] {
        let shot = LABS.shot(&scene, 0, 256);
        let pieces = shot.buffers.triangles() + 10_000;
        let capacity = CloudCapacity {
            surfels: 0,
            pieces,
            triangles: pieces,
        };
        let settings = BouncedSettings {
            rays_per_pixel: 16,
            ..settings(16)
        };
        let senders = LABS.senders_in(&shot, &triangles(), capacity);
        let fastest =
            |time: &dyn Fn() -> f64| (0..=RUNS).map(|_| time()).fold(f64::INFINITY, f64::min);
        let [device, own] = [0, 1].map(|i| {
            let (lab, senders) = (&LABS.both[i], &senders[i]);
            let builder = BvhBuilder::new(&LABS.gpu.device, lab.primitives).expect("pipelines");
            let build = fastest(&|| {
                LABS.gpu
                    .time(|encoder| {
                        builder
                            .record(
                                &LABS.gpu.device,
                                encoder,
                                &senders.cloud,
                                &senders.bounds,
                                None,
                            )
                            .expect("a hierarchy");
                    })
                    .0
            });
            let radiance = lab.motley(senders).0;
            let trace = |payload| {
                let view = lab.view(&shot, payload, Sampling::Cosine, 16);
                let tracer = lab.tracer(payload, Sampling::Cosine);
                let mut decoded = Decoded::of(&shot.camera);
                let mut encoder = LABS.gpu.encoder();
                let frame = decoded.frame(
                    &mut encoder,
                    shot.gbuffer(),
                    &shot.camera,
                    senders.cloud.origin(),
                );
                LABS.gpu.finish(encoder);
                let input = deep_screen_space::BouncedInput {
                    radiance: match payload {
                        Payload::Occlusion => deep_screen_space::HitRadiance::None,
                        _ => deep_screen_space::HitRadiance::Surfels(&radiance),
                    },
                    ..deep_screen_space::BouncedInput::new(&frame, &senders.cloud, &senders.bounds)
                };
                fastest(&|| {
                    LABS.gpu
                        .time(|encoder| {
                            tracer
                                .record(&LABS.gpu.device, encoder, &input, &settings, &view)
                                .expect("hits");
                        })
                        .0
                })
            };
            [build, trace(Payload::Occlusion), trace(Payload::Radiance)]
        });
        println!(
            "{:>20} {:>9} {:>9.2} {:>9.2} {:>9.2}   (own: {:.1}, {:.1}, {:.1} ms)",
            scene.name,
            shot.buffers.triangles(),
            device[0] / own[0],
            device[1] / own[1],
            device[2] / own[2],
            own[0],
            own[1],
            own[2],
        );
    }
}

/// The building's begin and end are written.
#[test]
fn building_writes_its_times() {
    let gpu = LABS.gpu;
    if !gpu
        .device
        .features()
        .contains(wgpu::Features::TIMESTAMP_QUERY)
    {
        println!("this adapter has no timestamps");
        return;
    }
    let shot = LABS.shot(&scenes::cornell(), 0, 8);
    let senders = &LABS.senders(&shot, &triangles())[0];
    let set = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
        label: None,
        ty: wgpu::QueryType::Timestamp,
        count: 2,
    });
    let resolved = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 16,
        usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let builder = BvhBuilder::new(&gpu.device, LABS.both[0].primitives).expect("pipelines");
    let mut encoder = gpu.encoder();
    let stamps = Timestamps {
        set: &set,
        begin: 0,
        end: 1,
    };
    builder
        .record(
            &gpu.device,
            &mut encoder,
            &senders.cloud,
            &senders.bounds,
            Some(stamps),
        )
        .expect("a hierarchy");
    encoder.resolve_query_set(&set, 0..2, &resolved, 0);
    gpu.finish(encoder);
    let times: Vec<u64> = gpu.read_buffer(&resolved);
    println!("{times:?}");
    assert!(times[0] > 0 && times[1] >= times[0], "{times:?}");
}

//! Prints what the device takes over what the crate takes, as ratios within one run: `scripts/ray_query.sh --times`.

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedZBuffer, BvhBuilder, CloudCapacity, HitLighting,
    HitRadiance, Light, Payload,
    glam::DVec3,
    scenes::{self, Scene},
    wgpu,
};
use support::testing::{
    frames::Decoded,
    rays::{Lab, Senders, triangles},
    shot::Shot,
};

use lab::{LABS, settings};

/// Best of this many runs, after one that compiles the pipelines: a shared machine only ever adds time.
const RUNS: usize = 3;
const SIZE: u32 = 256;
const RAYS_PER_PIXEL: u32 = 16;

/// Milliseconds that recordings take.
fn fastest(record: impl Fn(&mut wgpu::CommandEncoder)) -> f64 {
    let _ = LABS.gpu.time(&record);
    let times = (0..RUNS).map(|_| LABS.gpu.time(&record).0);
    times.fold(f64::INFINITY, f64::min)
}

/// Of building; of occlusion's rays, which end at any hit; of those that ask for the nearest; of these with a lamp's shadows.
fn times(lab: &Lab, shot: &Shot, senders: &Senders, scene: &Scene) -> [f64; 4] {
    let device = &lab.gpu.device;
    let builder = BvhBuilder::new(device, lab.primitives).expect("pipelines");
    let build = fastest(|encoder| {
        builder
            .record(device, encoder, &senders.cloud, &senders.bounds, None)
            .expect("a hierarchy");
    });
    let mut encoder = lab.gpu.encoder();
    let mut decoded = Decoded::of(&shot.camera);
    let origin = senders.cloud.origin();
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, origin);
    lab.gpu.finish(encoder);
    let table = scene.material_table();
    let materials = lab.gpu.buffer(&table, wgpu::BufferUsages::STORAGE);
    let lamp = Light::Point {
        position: shot.camera.eye() + DVec3::Y,
        intensity: [4.0; 3],
    };
    let trace = |payload, lights: &[Light]| {
        let descriptor = BouncedDescriptor {
            payload,
            primitives: lab.primitives,
            ..BouncedDescriptor::default()
        };
        let tracer = BouncedZBuffer::new(device, &descriptor).expect("pipelines");
        let view = tracer
            .create_view(device, SIZE, SIZE, RAYS_PER_PIXEL)
            .expect("a view");
        let materials = &materials;
        let input = BouncedInput {
            radiance: match payload {
                Payload::Occlusion => HitRadiance::None,
                _ => HitRadiance::Lit(HitLighting { materials, lights }),
            },
            ..BouncedInput::new(&frame, &senders.cloud, &senders.bounds)
        };
        fastest(|encoder| {
            tracer
                .record(device, encoder, &input, &settings(RAYS_PER_PIXEL), &view)
                .expect("hits");
        })
    };
    [
        build,
        trace(Payload::Occlusion, &[]),
        trace(Payload::LitRadiance, &[]),
        trace(Payload::LitRadiance, &[lamp]),
    ]
}

fn main() {
    println!(
        "{}, {SIZE}x{SIZE} pixels, {RAYS_PER_PIXEL} rays per pixel",
        LABS.gpu.name()
    );
    println!(
        "{:12} {:>9} {:>8} {:>8} {:>8} {:>8} {:>12}",
        "scene", "triangles", "build", "any", "nearest", "lit", "build + any"
    );
    for scene in [
        scenes::cornell(),
        scenes::closed_room(),
        scenes::dominoes(),
        scenes::colonnade(),
    ] {
        let shot = LABS.shot(&scene, 0, SIZE);
        let count = shot.buffers.triangles();
        // As much room as a scene's objects take.
        let capacity = CloudCapacity {
            surfels: 0,
            pieces: count + count / 4 + 256,
            triangles: count,
        };
        let senders = LABS.senders_in(&shot, &triangles(), capacity);
        let [device, own] = [0, 1].map(|i| times(&LABS.both[i], &shot, &senders[i], &scene));
        let [build, any, nearest, lit] = [0, 1, 2, 3].map(|i| device[i] / own[i]);
        let frame = (device[0] + device[1]) / (own[0] + own[1]);
        println!(
            "{:12} {count:>9} {build:>8.2} {any:>8.2} {nearest:>8.2} {lit:>8.2} {frame:>12.2}",
            scene.name
        );
    }
}

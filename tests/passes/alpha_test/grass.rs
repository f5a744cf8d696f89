//! Grass by pictures beside the same blades cut out in triangles.

use deep_screen_space::{
    AlphaTestedInput, Geometry, HitResolverSettings, Payload, Primitives, RaySettings, Sampling,
    glam::DVec3,
    reference::{
        hashing::{hash2, unit_float},
        trace::Tracer,
    },
    scenes::{self, Scene},
};

use support::testing::{
    pipelines,
    rays::{Lab, triangles},
    shot::{Shot, camera_of},
};

use super::harness::ROOM;

/// The noise of the truth taken out: RMSE, and steps of the slowest rays per pixel.
fn occlusion(scene: &Scene, rays: u32) -> [f64; 2] {
    let gpu = pipelines::gpu();
    let camera = camera_of(scene, 0, [72, 48]);
    let primitives = match scene.holes {
        Some(_) => Primitives::AlphaTested,
        None => Primitives::Triangles,
    };
    let lab = Lab::of(primitives);
    let shot = Shot::new(gpu, scene, &camera);
    let meshes = shot.buffers.meshes();
    let mut senders = lab.senders(&meshes, &camera, &triangles(), ROOM);
    let tests = shot.buffers.tests();
    if let Some(tests) = shot.buffers.alpha_tests(&tests) {
        let mut encoder = gpu.encoder();
        let input = AlphaTestedInput {
            geometry: Geometry { meshes: &meshes },
            tests,
            cloud: &senders.cloud,
            timestamps: None,
        };
        pipelines::bvh_builder(primitives)
            .record_alpha_tested(&gpu.device, &mut encoder, &input, &mut senders.bounds)
            .expect("a hierarchy");
        gpu.finish(encoder);
    }
    let rays = RaySettings::new(rays, Payload::Occlusion);
    let traced = rays.bounced(scene.ao_radius);
    let view = lab.trace(&shot, &senders, None, &traced, Sampling::Cosine);
    let resolver = lab.reconstructor(Payload::Occlusion, Sampling::Cosine, false);
    let filter: HitResolverSettings = rays.filter;
    let picture = lab.reconstruct(resolver, &shot, &view, &filter);
    let receivers = shot.traced();
    let tracer: &Tracer = &shot.tracer;
    let reach = f64::from(scene.ao_radius);
    let truth = tracer.ambient_occlusion_image(&receivers, reach, 256, 1, false);
    let values: Vec<f32> = picture.iter().map(|p| p[0]).collect();
    let (rmse, bias) = support::stage::compare(&values, &truth);
    [rmse, bias]
}

/// The bar of alpha-tested grass: as near to its truth as the same blades cut out in triangles are to theirs, plus 0.01.
#[test]
fn errors_of_grass_in_pictures_are_near_the_truth_as_in_triangles() {
    let [cards, card_bias] = occlusion(&scenes::grass(), 16);
    let [blades, blade_bias] = occlusion(&scenes::grass_cut_out(), 16);
    println!("cards {cards:.4} ({card_bias:+.4}), blades {blades:.4} ({blade_bias:+.4})");
    assert!(blades > 0.005 && blades < 0.08, "{blades}");
    assert!(cards <= blades + 0.01, "{cards} and {blades}");
}

/// Whether both lawns are one: rays from the same places meet the same.
#[test]
fn both_lawns_are_the_same() {
    let [cards, blades] = [scenes::grass(), scenes::grass_cut_out()];
    let tracers = [&cards, &blades].map(|scene| Tracer::of_scene(scene).expect("triangles"));
    let mut differ = 0;
    for i in 0..4000 {
        let draw = |salt| unit_float(hash2(i, salt));
        let origin = DVec3::new(
            1.6 * draw(1) - 0.8,
            0.02 + 0.2 * draw(2),
            1.6 * draw(3) - 0.8,
        );
        let direction = DVec3::new(draw(4) - 0.5, draw(5) - 0.5, draw(6) - 0.5).normalize();
        let [a, b] = [0, 1].map(|t: usize| {
            let hit = tracers[t].first_hit(origin, direction, 0.0, f64::INFINITY);
            hit.map_or(f64::INFINITY, |hit| hit.t)
        });
        differ += usize::from((a - b).abs() > 1e-6 && a != b);
    }
    // Alpha is rounded to 1/255, a hundredth of a texel, and tips are rounder.
    println!("{differ} of 4000 rays differ");
    assert!(differ < 40, "{differ}");
}

//! What a bounded reach leaves out.

use std::collections::HashSet;

use deep_screen_space::{
    Camera, Reach, SurfelizerSettings,
    glam::DVec3,
    reference::{gbuffer, surfelizer::Surfel, trace::Tracer},
    scenes::{self, Scene},
};

use super::{
    comparison::assert_alike,
    harness::{Soup, Task, fixture, scene_camera},
};

/// A surfel that culling drops lies farther than its reach from every point that the camera sees; one that it keeps is
/// as it was. The bound is loose by more than f32's 1e-6.
#[test]
fn what_is_dropped_reaches_nothing_visible() {
    let no = f32::INFINITY;
    for (scene, view, radii, world) in [
        (scenes::cornell(), 1, 6.0, no),
        (scenes::cornell(), 1, no, 0.5),
        (scenes::dominoes(), 1, 10.0, 0.3),
        (scenes::fence(), 1, 3.0, 1.0),
        (scenes::closed_room(), 1, 5.0, no),
        (scenes::stress(4000), 1, 2.0, 5.0),
        (scenes::stress(4000), 0, 0.0, 0.0),
    ] {
        let reach = Reach { radii, world };
        let inputs = format!("{} {reach:?}", scene.name);
        let camera = scene_camera(&scene, view);
        let settings = SurfelizerSettings {
            reach,
            density: 1.0,
            ..SurfelizerSettings::default()
        };
        let soup = Soup::of_scene(&scene);
        let views = [camera];
        let mut task = Task::new(&camera, settings);
        let all = fixture().record_soup(&soup, &task);
        task.cull_by = &views;
        let kept = fixture().record_soup(&soup, &task);
        assert_alike(&kept, &soup.mirrored(&task), &inputs);

        let bits = |s: &Surfel| s.position.as_vec3().to_array().map(f32::to_bits);
        let known: HashSet<_> = kept.surfels.iter().map(bits).collect();
        let before: HashSet<_> = all.surfels.iter().map(bits).collect();
        assert!(known.is_subset(&before), "{inputs}: culling made surfels");
        let dropped: Vec<&Surfel> = all
            .surfels
            .iter()
            .filter(|s| !known.contains(&bits(s)))
            .collect();
        println!(
            "{inputs}: {} of {} dropped",
            dropped.len(),
            all.surfels.len()
        );
        assert!(dropped.len() > 1000, "{inputs}: {} dropped", dropped.len());
        let visible = visible_points(&scene, &camera);
        for surfel in dropped {
            let reach = (f64::from(radii) * surfel.radius).min(f64::from(world));
            let nearest = visible
                .iter()
                .map(|p| p.distance_squared(surfel.position))
                .fold(f64::INFINITY, f64::min)
                .sqrt();
            assert!(
                nearest > reach,
                "{inputs}: {surfel:?} is dropped, {nearest} from a visible point, and reaches {reach}"
            );
        }
    }
}

/// What the pixels show, in eye space.
fn visible_points(scene: &Scene, camera: &Camera) -> Vec<DVec3> {
    let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a scene");
    let points: Vec<DVec3> = gbuffer::receivers(
        camera,
        &tracer,
        &scene.positions,
        &scene.normals,
        &scene.indices,
    )
    .into_iter()
    .flatten()
    .map(|r| r.position - camera.focus())
    .collect();
    assert!(points.len() > 100, "{}", scene.name);
    points
}

/// Either of two views keeps what is near it, and an unbounded reach keeps all.
#[test]
fn views_add_up() {
    let scene = scenes::dominoes();
    let soup = Soup::of_scene(&scene);
    let views = [scene_camera(&scene, 0), scene_camera(&scene, 1)];
    let settings = |radii: f32| SurfelizerSettings {
        reach: Reach {
            radii,
            world: f32::INFINITY,
        },
        density: 1.0,
        ..SurfelizerSettings::default()
    };
    let stored = |cull_by: &[Camera], radii| {
        let mut task = Task::new(&views[1], settings(radii));
        task.cull_by = cull_by;
        fixture().record_soup(&soup, &task).counts.stored
    };
    let [first, second, both] = [&views[..1], &views[1..], &views[..]].map(|v| stored(v, 2.0));
    println!("stored: {first}, {second}, both {both}");
    assert!(both > first.max(second) && both <= first + second);
    assert_eq!(stored(&views, f32::INFINITY), stored(&[], 2.0));
}

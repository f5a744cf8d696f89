//! What a bounded reach leaves out.

use std::collections::HashSet;

use deep_screen_space::{
    Reach, SurfelizerSettings,
    glam::DVec3,
    reference::{gbuffer, trace::Tracer},
    scenes,
};

use crate::harness::{Soup, Task, fixture, scene_camera};

/// A surfel that culling drops lies farther than its reach from every point that the camera sees; one that it keeps is
/// as it was. Without rounding's help: the bound is loose by more than the 1e-6 of f32.
#[test]
fn what_is_dropped_reaches_nothing_visible() {
    let mut dropped_at_all = 0;
    for (scene, view, reach) in [
        (scenes::cornell(), 1, Reach { radii: 6.0, world: f32::INFINITY }),
        (scenes::cornell(), 1, Reach { radii: f32::INFINITY, world: 0.5 }),
        (scenes::dominoes(), 1, Reach { radii: 10.0, world: 0.3 }),
        (scenes::fence(), 1, Reach { radii: 3.0, world: 1.0 }),
        (scenes::closed_room(), 1, Reach { radii: 5.0, world: f32::INFINITY }),
        (scenes::stress(4000), 1, Reach { radii: 2.0, world: 5.0 }),
        (scenes::stress(4000), 0, Reach { radii: 0.0, world: 0.0 }),
    ] {
        let camera = scene_camera(&scene, view);
        let eye = camera.eye();
        let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a scene");
        let visible: Vec<DVec3> =
            gbuffer::receivers(&camera, &tracer, &scene.positions, &scene.normals, &scene.indices)
                .into_iter()
                .flatten()
                .map(|r| r.position - eye)
                .collect();
        assert!(visible.len() > 100, "{}", scene.name);
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
        crate::comparison::assert_alike(&kept, &soup.mirrored(&task), scene.name);

        let bits = |p: DVec3| p.as_vec3().to_array().map(f32::to_bits);
        let known: HashSet<_> = kept.surfels.iter().map(|s| bits(s.position)).collect();
        let before: HashSet<_> = all.surfels.iter().map(|s| bits(s.position)).collect();
        assert!(known.is_subset(&before), "{}: culling made surfels", scene.name);
        let mut dropped = 0;
        for surfel in all.surfels.iter().filter(|s| !known.contains(&bits(s.position))) {
            dropped += 1;
            let reach = (f64::from(reach.radii) * surfel.radius).min(f64::from(reach.world));
            let nearest = visible
                .iter()
                .map(|p| p.distance_squared(surfel.position))
                .fold(f64::INFINITY, f64::min)
                .sqrt();
            assert!(
                nearest > reach,
                "{}: {surfel:?} is dropped, {nearest} from a visible point, and reaches {reach}",
                scene.name
            );
        }
        println!("{} {reach:?}: {dropped} of {} dropped", scene.name, all.surfels.len());
        dropped_at_all += dropped;
        assert!(dropped > 0, "{} {reach:?}: nothing was dropped", scene.name);
    }
    assert!(dropped_at_all > 1000, "{dropped_at_all}");
}

/// Either of two views keeps what is near it, and an unbounded reach keeps all.
#[test]
fn views_add_up() {
    let scene = scenes::dominoes();
    let soup = Soup::of_scene(&scene);
    let views = [scene_camera(&scene, 0), scene_camera(&scene, 1)];
    let settings = |radii: f32| SurfelizerSettings {
        reach: Reach { radii, world: f32::INFINITY },
        density: 1.0,
        ..SurfelizerSettings::default()
    };
    let stored = |cull_by: &[deep_screen_space::Camera], radii| {
        let mut task = Task::new(&views[1], settings(radii));
        task.cull_by = cull_by;
        fixture().record_soup(&soup, &task).counts.stored
    };
    let [first, second, both] = [&views[..1], &views[1..], &views[..]].map(|v| stored(v, 2.0));
    println!("stored: {first}, {second}, both {both}");
    assert!(both >= first.max(second) && both <= first + second);
    assert_eq!(stored(&views, f32::INFINITY), stored(&[], 2.0));
}

//! The same input gives the same cloud, and nearly the same input nearly the same one.

use std::collections::HashSet;

use deep_screen_space::{
    Placement, Surfel, SurfelSource, SurfelizerSettings,
    glam::{DVec3, I64Vec3},
    reference::surfelizer as mirror,
    scenes,
};

use super::harness::{Soup, Task, fixture, look_at, scene_camera};
use support::raster::perspective;

#[test]
fn two_runs_agree_in_every_bit() {
    let scene = scenes::dominoes();
    let soup = fixture().upload(&Soup::of_scene(&scene));
    let camera = scene_camera(&scene, 1);
    let mut task = Task::new(&camera, SurfelizerSettings::default());
    // Both with room, and with an overflow of surfels and pieces.
    for (surfels, pieces) in [(1 << 16, 1 << 13), (3000, 500)] {
        task.capacity.surfels = surfels;
        task.capacity.pieces = pieces;
        let runs = [(); 2].map(|()| {
            let cloud = fixture().try_record(&[soup.mesh()], &task).expect("valid");
            let gpu = &fixture().gpu;
            let surfels: Vec<Surfel> = gpu.read_buffer(cloud.surfels());
            let sources: Vec<SurfelSource> = gpu.read_buffer(cloud.sources());
            let counts = fixture().counts(&cloud);
            assert!(counts.stored > 2000, "{counts:?}");
            (counts, surfels, sources)
        });
        assert!(runs[0] == runs[1], "{surfels} surfels, {pieces} pieces");
    }
}

/// A cloud that is recorded again holds nothing of before.
#[test]
fn a_cloud_is_used_again() {
    let scene = scenes::cornell();
    let all = fixture().upload(&Soup::of_scene(&scene));
    let camera = scene_camera(&scene, 0);
    let task = Task::new(&camera, SurfelizerSettings::default());
    let mut cloud = fixture().try_record(&[all.mesh()], &task).expect("valid");
    let mut few = all.mesh();
    few.count = 30;
    let input = deep_screen_space::SurfelizerInput {
        geometry: deep_screen_space::Geometry { meshes: &[few] },
        camera: &camera,
        cull_by: &[],
        timestamps: None,
    };
    let gpu = &fixture().gpu;
    let mut encoder = gpu.encoder();
    // Twice in one encoder: the second recording must not change what the first one reads.
    for _ in 0..2 {
        fixture()
            .surfelizer
            .record(
                &gpu.device,
                &mut encoder,
                &input,
                &task.settings,
                &mut cloud,
            )
            .expect("valid");
    }
    gpu.finish(encoder);
    assert!(fixture().read(&cloud) == fixture().record(&[few], &task));
}

/// Positions in the world, in cells of a tenth of a millimetre: f32 holds those of one leaf for two eyes within 2e-6,
/// and leaves are millimetres apart.
fn cells(cloud: &mirror::Cloud, eye: DVec3) -> Vec<I64Vec3> {
    cloud
        .surfels
        .iter()
        .map(|s| ((s.position + eye) * 1e4).round().as_i64vec3())
        .collect()
}

fn share_that_moved(before: &[I64Vec3], after: &[I64Vec3]) -> f64 {
    let known: HashSet<I64Vec3> = before.iter().copied().collect();
    let near = |cell: &I64Vec3| {
        (-1..=1).any(|x| {
            (-1..=1).any(|y| (-1..=1).any(|z| known.contains(&(*cell + I64Vec3::new(x, y, z)))))
        })
    };
    after.iter().filter(|cell| !near(cell)).count() as f64 / after.len() as f64
}

/// A step of 0.1 % of the distance changes relative areas by 0.2 %, and so the number of bisections of log2(1.002), 0.3 %
/// of the pieces; a piece that does is all changed. Pieces differ in their surfels, so single steps scatter.
#[test]
fn a_small_step_of_the_camera_keeps_the_surfels() {
    const SHARE_A_STEP: f64 = 0.03;
    const SHARE_ON_AVERAGE: f64 = 0.008;
    for (scene, placement) in [
        (scenes::cornell(), Placement::Centroid),
        (scenes::dominoes(), Placement::Centroid),
        (scenes::dominoes(), Placement::Random),
        (scenes::closed_room(), Placement::Centroid),
        (scenes::stress(4000), Placement::Centroid),
    ] {
        let soup = Soup::of_scene(&scene);
        let view = &scene.views[0];
        let [eye, target] = [DVec3::from(view.eye), DVec3::from(view.target)];
        let at = |steps: i32| {
            let eye = eye + (target - eye) * (1e-3 * f64::from(steps));
            let camera = look_at(
                eye,
                target,
                perspective(view.vertical_fov_degrees, 1.0, view.near),
            );
            let settings = SurfelizerSettings {
                placement,
                ..SurfelizerSettings::default()
            };
            let cloud = fixture().record_soup(&soup, &Task::new(&camera, settings));
            cells(&cloud, eye)
        };
        let steps: Vec<Vec<I64Vec3>> = (0..=5).map(at).collect();
        let shares: Vec<f64> = steps
            .windows(2)
            .map(|w| share_that_moved(&w[0], &w[1]))
            .collect();
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        let worst = shares.iter().copied().fold(0.0, f64::max);
        println!(
            "{} {placement:?}: mean {mean:.4}, worst {worst:.4} of {}",
            scene.name,
            steps[0].len()
        );
        assert!(
            worst <= SHARE_A_STEP && mean <= SHARE_ON_AVERAGE,
            "{} {placement:?}: {shares:?}",
            scene.name
        );
    }
}

//! Segments are components, and cover every pixel.

use std::collections::{BTreeMap, BTreeSet};

use deep_screen_space::{
    Camera, Components, Gatherer, SgHullSettings, SgHullSize, Viewport,
    glam::{DMat4, DVec4},
    reference::{sg_hull::Hull, shell_splatter::Receiver},
    scenes,
};

use support::{
    raster::perspective,
    testing::{
        pipelines,
        shot::{Shot, camera_of},
    },
};

use super::harness::{LAB, Lab, SKY, check_covered, hull, lamps, record};

fn quad_sides(
    camera: &Camera,
    receivers: &[Option<Receiver>],
    settings: &SgHullSettings,
    widened: f64,
) -> Vec<Option<u32>> {
    Hull {
        camera,
        receivers,
        settings,
    }
    .components(widened)
}

#[test]
fn segments_are_components() {
    let gpu = pipelines::gpu();
    let gatherer = Gatherer::lights(&gpu.device);
    let both = [Components::UnionFind, Components::Propagation]
        .map(|components| (components, hull(gpu, &gatherer, components)));
    for (name, view) in [("colonnade", 0), ("fence", 1)] {
        let scene = scenes::by_name(name).expect("a scene");
        let shot = Shot::new(gpu, &scene, &camera_of(&scene, view, [128, 90]));
        let gather = gatherer
            .bind_lights(&gpu.device, &lamps(), shot.camera.eye())
            .expect("lights");
        let receivers = shot.receivers(shot.camera.eye());
        for quad in [8, 32] {
            let settings = SgHullSettings {
                quad,
                ..SgHullSettings::default()
            };
            // Rounding of positions and of packed normals moves what is close to a threshold either way.
            let [tight, loose] =
                [0.97, 1.03].map(|w| quad_sides(&shot.camera, &receivers, &settings, w));
            let count = |c: &[Option<u32>]| c.iter().flatten().collect::<BTreeSet<_>>().len();
            for (components, hull) in &both {
                let inputs = format!("{name} {view}, quad {quad}, {components:?}");
                let recorded = record(
                    gpu,
                    hull,
                    &shot,
                    &gather,
                    &settings,
                    SgHullSize::new(128, 90),
                );
                let found = recorded.counts.segments as usize;
                println!(
                    "{inputs}: {found} segments, {} components, {} pixels of last resort",
                    count(&tight),
                    recorded.counts.fallback_pixels
                );
                // No segment joins two components.
                let mut component_of = BTreeMap::new();
                for (i, slot) in recorded.segment_of.iter().enumerate() {
                    if *slot != SKY && *slot < recorded.size.segments {
                        let here = loose[i];
                        let there = *component_of.entry(*slot).or_insert(here);
                        assert_eq!(here, there, "{inputs}: segment {slot} at pixel {i}");
                    }
                }
                match components {
                    Components::UnionFind if recorded.counts.fallbacks == 0 => assert!(
                        (count(&loose)..=count(&tight)).contains(&found),
                        "{inputs}: {found} segments, {} to {} components",
                        count(&loose),
                        count(&tight)
                    ),
                    _ => assert!(
                        found >= count(&loose) || recorded.counts.fallbacks > 0,
                        "{inputs}: {found} segments, {} components",
                        count(&loose)
                    ),
                }
            }
        }
    }
}

#[test]
fn every_pixel_is_covered() {
    let Lab {
        gpu,
        gatherer,
        hull,
    } = &*LAB;
    let settings = SgHullSettings::default();
    let half = 4.0;
    let (near, far) = (1.0, 40.0);
    let f = 1.0 / 0.5;
    let a = -far / (far - near);
    let orthographic = DMat4::from_cols(
        DVec4::X / half,
        DVec4::Y / half,
        DVec4::Z * (1.0 / (far - near)),
        DVec4::new(0.0, 0.0, far / (far - near), 1.0),
    );
    let forward = DMat4::from_cols(
        DVec4::X * f,
        DVec4::Y * f,
        DVec4::new(0.0, 0.0, a, -1.0),
        DVec4::Z * (a * near),
    );
    let off_axis = DMat4::from_cols(
        DVec4::X * f,
        DVec4::Y * f,
        DVec4::new(0.4, -0.2, 0.0, -1.0),
        DVec4::Z * 0.1,
    );
    let projections = [
        ("reversed", perspective(50.0, 1.0, 0.05)),
        ("forward", forward),
        ("off-axis", off_axis),
        ("orthographic", orthographic),
    ];
    let mut fallbacks = 0;
    {
        let scene_name = "fence";
        let scene = scenes::by_name(scene_name).expect("a scene");
        let view = &scene.views[0];
        for (name, projection) in projections {
            for (viewport, grid, segments) in [
                (Viewport::full(97, 61), 1024, 4096),
                (
                    Viewport {
                        x: 5,
                        y: 3,
                        width: 90,
                        height: 110,
                    },
                    32,
                    4096,
                ),
                (Viewport::full(64, 64), 64, 5),
                (Viewport::full(1, 1), 32, 0),
                (Viewport::full(3, 70), 33, 100),
            ] {
                let camera = Camera::look_at(
                    view.eye.into(),
                    view.target.into(),
                    view.up.into(),
                    projection,
                    viewport,
                )
                .expect("a camera");
                let shot = Shot::new(gpu, &scene, &camera);
                let gather = gatherer
                    .bind_lights(&gpu.device, &lamps(), camera.eye())
                    .expect("lights");
                let size = SgHullSize {
                    grid,
                    segments,
                    ..SgHullSize::new(viewport.width, viewport.height)
                };
                let recorded = record(gpu, hull, &shot, &gather, &settings, size);
                let inputs = format!("{scene_name}, {name}, {viewport:?}, {size:?}");
                check_covered(&recorded, &shot, &inputs);
                fallbacks += recorded.counts.fallbacks;
            }
        }
    }
    assert!(fallbacks > 0, "the last resort was not among the cases");
}

/// A pixel in two is something else: segments of one pixel, in a picture finer than the grid as well.
#[test]
fn foliage_is_covered() {
    let Lab {
        gpu,
        gatherer,
        hull,
    } = &*LAB;
    let scene = scenes::cornell();
    let mut shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [72, 72]));
    let hash = |i: u32| deep_screen_space::reference::hashing::hash(i);
    // Reversed depth: any value above 0 is somewhere.
    let depth: Vec<f32> = (0..72 * 72)
        .map(|i| match hash(i) % 8 {
            0 => 0.0,
            k => 0.002 * k as f32,
        })
        .collect();
    let normal: Vec<[f32; 4]> = (0..72 * 72)
        .map(|i| match hash(i + 9999) % 5 {
            0 => [0.0; 4],
            1 => [f32::NAN; 4],
            2 => [1.0, 0.0, 0.2, 0.0],
            3 => [0.0, -1.0, 0.1, 0.0],
            _ => [0.0, 0.1, 1.0, 0.0],
        })
        .collect();
    shot.upload(gpu, &depth, &normal);
    let gather = gatherer
        .bind_lights(&gpu.device, &lamps(), shot.camera.eye())
        .expect("lights");
    for (grid, segments) in [(1024, 10000), (36, 10000), (36, 40)] {
        let size = SgHullSize {
            grid,
            segments,
            ..SgHullSize::new(72, 72)
        };
        let recorded = record(gpu, hull, &shot, &gather, &SgHullSettings::default(), size);
        println!("grid {grid}, room {segments}: {:?}", recorded.counts);
        let untouched = recorded.pixels.iter().filter(|p| p[3] != 1.0).count();
        assert_eq!(untouched, 0, "grid {grid}, room {segments}");
        let finite = |p: &[f32; 4]| p.iter().all(|c| c.is_finite());
        assert!(recorded.pixels.iter().all(finite), "grid {grid}");
    }
}

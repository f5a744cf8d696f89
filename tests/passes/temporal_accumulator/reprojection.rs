//! Where a history is found, by the camera and by motion vectors.

use deep_screen_space::{
    Camera, Channels, MotionVectors, TemporalInput, TemporalSettings, Viewport,
    glam::{DVec2, DVec3},
    wgpu::TextureFormat as Format,
};

use support::testing::{frames::Decoded, pipelines};

use super::{
    harness::{Frame, RUNNING, Rig},
    room::{
        CURVATURE, EYE, Projection, ROOM, Shot, Surface, World, look, noise, painted, straight,
    },
};

/// Where the surface of each pixel of `now` was in `before`, in pixels, if it was in its picture by a pixel.
fn places(now: &Shot, before: &Camera, world: World) -> Vec<Option<DVec2>> {
    let viewport = before.viewport();
    let size = DVec2::new(f64::from(viewport.width), f64::from(viewport.height));
    now.hits
        .iter()
        .map(|hit| {
            let relative = (*hit)?.point - (before.eye() - world.origin);
            let at = before.project(relative)?.truncate();
            (at.cmpgt(DVec2::splat(1.5)).all() && at.cmplt(size - 1.5).all()).then_some(at)
        })
        .collect()
}

#[test]
fn a_moving_camera_finds_the_history_of_each_point() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(96, 64);
    for origin in [0.0, 1e5] {
        for projection in [
            Projection::Reversed,
            Projection::Forward,
            Projection::Orthographic,
        ] {
            let world = World {
                origin: DVec3::new(origin, -origin, origin),
                ..ROOM
            };
            let shot = |eye: DVec3, toward| {
                Shot::new(
                    gpu,
                    world,
                    &look(world.origin + eye, toward, projection, viewport),
                )
            };
            let first = shot(EYE, DVec3::new(0.0, 0.2, -1.0));
            let second = shot(
                EYE + DVec3::new(0.17, 0.05, -0.3),
                DVec3::new(-0.05, 0.22, -1.0),
            );
            let mut rig = Rig::new(gpu, Channels::One, [96, 64], RUNNING);
            let picture = first.paint(|_, hit| hit.map_or(0.0, |hit| painted(hit.point)));
            rig.step(
                &first,
                Frame {
                    picture: &picture,
                    ..Frame::default()
                },
            );
            let absent = second.paint(|_, _| f64::NAN);
            let found = rig.step(
                &second,
                Frame {
                    picture: &absent,
                    ..Frame::default()
                },
            );

            let inside = places(&second, &first.camera, world);
            let mut compared = 0;
            let (mut worst, mut unmoved) = (0.0_f64, 0.0_f64);
            for (i, at) in inside.iter().enumerate() {
                let (Some(_), Some(hit)) = (at, second.hits[i]) else {
                    continue;
                };
                // Where the wall ends the taps are of fewer than four.
                let near_edge = [1, 96].iter().any(|&k| {
                    [i.checked_sub(k), i.checked_add(k)].iter().any(|&other| {
                        let other = other.and_then(|k| *second.hits.get(k)?);
                        other.is_none_or(|other| other.surface != hit.surface)
                    })
                });
                if hit.surface != Surface::Wall || near_edge {
                    continue;
                }
                assert_eq!(found[i].frames, 1.0, "{projection:?}, {origin}, pixel {i}");
                let truth = painted(hit.point);
                worst = worst.max((found[i].mean.x - truth).abs());
                unmoved = unmoved.max((picture[i].x - truth).abs());
                compared += 1;
            }
            // A bilinear interpolation is off by an eighth of the second derivative times the squared step, an axis. The
            // steps are a pixel's on the wall, seen at 20° at most of an angle of 30°.
            let step = first.camera.footprint().at(DVec3::NEG_Z * 8.0) / 0.85;
            let bound = 2.0 * CURVATURE * step * step / 8.0 + 1e-5;
            println!(
                "{projection:?}, {origin}: {compared} pixels off by up to {worst:.1e}, bound {bound:.1e}; unmoved {unmoved:.1e}"
            );
            assert!(
                compared > 1000,
                "{projection:?}, {origin}: {compared} pixels"
            );
            assert!(
                worst <= bound,
                "{projection:?}, {origin}: {worst}, bound {bound}"
            );
            assert!(unmoved > 10.0 * bound, "it did move: {unmoved}");
        }
    }
}

/// A floor seen almost edge-on is another distance away from pixel to pixel, and keeps its history all the same.
#[test]
fn grazing_surfaces_keep_their_history() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(64, 64);
    let floor = |eye: DVec3| {
        let camera = look(
            eye,
            DVec3::new(0.0, -0.02, -1.0),
            Projection::Reversed,
            viewport,
        );
        Shot::new(gpu, ROOM, &camera)
    };
    // Two units in front of the wall's end of the floor, and a tenth above it.
    let (first, second) = (
        floor(DVec3::new(0.0, -0.8, 0.0)),
        floor(DVec3::new(0.01, -0.79, -0.05)),
    );
    let mut rig = Rig::new(gpu, Channels::One, [64, 64], RUNNING);
    let picture = first.paint(|i, _| noise(i, 0));
    rig.step(
        &first,
        Frame {
            picture: &picture,
            ..Frame::default()
        },
    );
    let picture = second.paint(|i, _| noise(i, 1));
    let found = rig.step(
        &second,
        Frame {
            picture: &picture,
            ..Frame::default()
        },
    );
    let inside = places(&second, &first.camera, ROOM);
    let (mut all, mut kept) = (0, 0);
    for ((pixel, hit), at) in found.iter().zip(&second.hits).zip(&inside) {
        if at.is_some() && hit.is_some_and(|hit| hit.surface == Surface::Floor) {
            all += 1;
            kept += i32::from(pixel.frames == 2.0);
        }
    }
    println!("{kept} of {all} kept");
    assert!(all > 500 && kept == all, "{kept} of {all} kept");
}

/// What lay behind the last eye would be projected into its picture, upside down.
#[test]
fn what_was_behind_the_eye_has_no_history() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(32, 24);
    // No distance and no normal stands in the way.
    let settings = TemporalSettings {
        depth_tolerance: 1e30,
        normal_tolerance: -1.0,
        ..RUNNING
    };
    let toward = |z: f64| {
        let toward = DVec3::new(0.0, 0.1 * z, z);
        Shot::new(
            gpu,
            ROOM,
            &look(EYE, toward, Projection::Reversed, viewport),
        )
    };
    let (ahead, back) = (toward(-1.0), toward(1.0));
    let mut rig = Rig::new(gpu, Channels::One, [32, 24], settings);
    for shot in [&ahead, &back] {
        let picture = shot.paint(|i, _| noise(i, 0));
        let found = rig.step(
            shot,
            Frame {
                picture: &picture,
                ..Frame::default()
            },
        );
        let surfaces = found.iter().filter(|pixel| pixel.frames > 0.0);
        assert!(surfaces.count() > 100);
        assert!(found.iter().all(|pixel| pixel.frames <= 1.0));
    }
}

#[test]
fn vectors_that_lead_nowhere_drop_the_history() {
    let gpu = pipelines::gpu();
    let size = [19, 13];
    let viewport = Viewport::full(size[0], size[1]);
    let shot = Shot::new(gpu, ROOM, &straight(EYE, viewport));
    let out = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        3e38,
        -3e38,
        1e10,
        -1e10,
        19.0,
        -19.0,
        20.5,
        -20.5,
        4.3e9,
        -4.3e9,
    ];
    let mut rig = Rig::new(gpu, Channels::One, size, RUNNING);
    for axis in 0..2 {
        for far in out {
            let motion: Vec<DVec2> = (0..shot.hits.len())
                .map(|_| {
                    let mut v = DVec2::ZERO;
                    v[axis] = far;
                    v
                })
                .collect();
            let picture = shot.paint(|i, _| noise(i, 0));
            rig.step(
                &shot,
                Frame {
                    picture: &picture,
                    motion: None,
                    reset: true,
                },
            );
            let picture = shot.paint(|i, _| noise(i, 1));
            let found = rig.step(
                &shot,
                Frame {
                    picture: &picture,
                    motion: Some(&motion),
                    reset: false,
                },
            );
            for ((pixel, hit), value) in found.iter().zip(&shot.hits).zip(&picture) {
                let expected = if hit.is_some() { 1.0 } else { 0.0 };
                assert_eq!(pixel.frames, expected, "{far} along {axis}");
                assert_eq!(pixel.mean.x as f32, value.x as f32, "{far} along {axis}");
            }
        }
    }
}

#[test]
fn vectors_in_other_units_are_scaled() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(24, 16);
    let shot = Shot::new(gpu, ROOM, &straight(EYE, viewport));
    let picture = shot.paint(|i, _| noise(i, 0));
    // Two pixels to the right and one down since the last frame.
    let moved = DVec2::new(2.0, 1.0);
    let motion = vec![moved; shot.hits.len()];
    let mut rig = Rig::new(gpu, Channels::One, [24, 16], RUNNING);
    rig.step(
        &shot,
        Frame {
            picture: &picture,
            ..Frame::default()
        },
    );
    let absent = shot.paint(|_, _| f64::NAN);
    let uv = rig.step(
        &shot,
        Frame {
            picture: &absent,
            motion: Some(&motion),
            reset: false,
        },
    );
    for (i, pixel) in uv.iter().enumerate() {
        let [x, y] = [i % 24, i / 24];
        let same = x >= 2
            && y >= 1
            && shot.hits[i].is_some_and(|hit| {
                shot.hits[i - 26].is_some_and(|other| other.surface == hit.surface)
            });
        if same {
            let expected = picture[i - 26].x;
            assert!(
                (pixel.mean.x - expected).abs() < 1e-6,
                "{x}, {y}: {pixel:?}, {expected}"
            );
        }
    }
    // In pixels, in NDC, and pointing into the past.
    for (vector, scale) in [
        ([2.0_f32, 1.0], [1.0 / 24.0, 1.0 / 16.0]),
        ([4.0 / 24.0, -2.0 / 16.0], [0.5, -0.5]),
        ([-2.0, -1.0], [-1.0 / 24.0, -1.0 / 16.0]),
    ] {
        let mut rig = Rig::new(gpu, Channels::One, [24, 16], RUNNING);
        rig.step(
            &shot,
            Frame {
                picture: &picture,
                ..Frame::default()
            },
        );
        let view = gpu.texture(Format::Rg32Float, 24, 16, &vec![vector; 24 * 16]);
        let nothing = gpu.texture(Format::R32Float, 24, 16, &vec![f32::NAN; 24 * 16]);
        let target = gpu.target(Format::R32Float, 24, 16);
        let mut encoder = gpu.encoder();
        let mut decoded = Decoded::of(&shot.camera);
        let frame = decoded.frame(
            &mut encoder,
            shot.gbuffer(),
            &shot.camera,
            shot.camera.focus(),
        );
        let input = TemporalInput {
            motion: Some(MotionVectors {
                texture: view.texture().into(),
                scale,
            }),
            ..TemporalInput::new(&frame, &shot.camera, nothing.texture(), target.texture())
        };
        rig.accumulator
            .record(
                &gpu.device,
                &mut encoder,
                &input,
                &RUNNING,
                &mut rig.history,
            )
            .expect("a frame");
        gpu.finish(encoder);
        // Units differ by a rounding, and so may a fraction of a pixel.
        for (i, (found, uv)) in rig.kept().iter().zip(&uv).enumerate() {
            let off = (found.mean.x - uv.mean.x).abs();
            assert!(off < 1e-5, "{scale:?}, pixel {i}: {found:?}, {uv:?}");
        }
    }
}

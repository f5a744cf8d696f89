//! GPU and mirror, frame by frame.

use deep_screen_space::{
    Channels, TemporalSettings, Viewport,
    glam::{DVec2, DVec3},
    reference::temporal_accumulator::Accumulation,
};

use support::testing::pipelines;

use super::{
    harness::{EXCEPTIONS, Frame, RUNNING, Rig, TOLERANCE, differences},
    room::{EYE, Projection, Shot, World, look, noise, painted},
};

#[test]
fn histories_match_the_mirror() {
    use Channels::{One, Three};
    use Projection::{Forward, Orthographic, Reversed};

    let gpu = pipelines::gpu();
    let full = Viewport::full;
    let moved = Viewport {
        x: 3,
        y: 5,
        width: 61,
        height: 43,
    };
    let tight = TemporalSettings {
        max_frames: 3,
        ..RUNNING
    };
    let clamped = TemporalSettings {
        clamping: 0.8,
        ..RUNNING
    };
    let strict = TemporalSettings {
        depth_tolerance: 0.003,
        normal_tolerance: 0.99,
        ..TemporalSettings::default()
    };
    for (viewport, channels, projection, with_motion, settings, origin) in [
        (full(96, 64), One, Reversed, false, RUNNING, 0.0),
        (full(96, 64), One, Forward, false, tight, 0.0),
        (full(96, 64), One, Orthographic, false, RUNNING, 0.0),
        (full(96, 64), One, Reversed, true, strict, 0.0),
        (full(96, 64), Three, Reversed, false, clamped, 0.0),
        (full(96, 64), One, Reversed, true, clamped, 0.0),
        (moved, Three, Forward, true, RUNNING, 0.0),
        (moved, One, Reversed, false, strict, 1e5),
        (full(1, 1), One, Reversed, false, RUNNING, 0.0),
        (full(1, 7), Three, Orthographic, true, clamped, 0.0),
        (full(127, 89), Three, Reversed, false, RUNNING, 0.0),
    ] {
        let inputs = format!(
            "{viewport:?}, {channels:?}, {projection:?}, motion {with_motion}, {settings:?}, {origin}"
        );
        let mut rig = Rig::new(gpu, channels, [viewport.width, viewport.height], settings);
        // Per setting that is turned: pixels that then differ in the last frame.
        let mut last = None;
        for frame in 0..5 {
            let t = f64::from(frame);
            let world = World {
                origin: DVec3::splat(origin),
                block: Some(-0.5 + 0.15 * t),
                slab: None,
                hills: 0.3,
            };
            let toward = DVec3::new(0.02 * t, -0.01 * t, -1.0);
            let eye = world.origin + EYE + t * DVec3::new(0.03, 0.02, -0.05);
            let shot = Shot::new(gpu, world, &look(eye, toward, projection, viewport));
            let picture: Vec<DVec3> = (0..)
                .zip(&shot.hits)
                .map(|(i, hit)| {
                    let smooth = hit.map_or(0.3, |hit| painted(hit.point));
                    smooth + 0.1 * DVec3::new(noise(i, frame), noise(i, frame + 99), 0.5)
                })
                .collect();
            let motion: Vec<DVec2> = (0..)
                .zip(&shot.hits)
                .map(|(i, _)| {
                    let wave = 0.1 * f64::from(i % 96) + t;
                    3.0 * DVec2::new(wave.sin(), (0.7 * wave).cos())
                })
                .collect();
            let before = (rig.mirror.clone(), rig.previous);
            let found = rig.step(
                &shot,
                Frame {
                    picture: &picture,
                    motion: with_motion.then_some(&motion),
                    reset: false,
                },
            );
            let (count, worst) = differences(&found, rig.expected());
            println!(
                "{inputs}, frame {frame}: {count} of {} beyond {TOLERANCE}, the farthest of the rest {worst:.1e}",
                found.len()
            );
            assert!(
                count as f64 <= EXCEPTIONS * found.len() as f64,
                "{inputs}, frame {frame}: {count} of {} are off by more than {TOLERANCE}",
                found.len()
            );
            last = Some((before, shot, picture, found, count));
        }

        // The comparison sees settings that are off.
        let Some(((Some(before), Some(previous)), shot, picture, found, same)) = last else {
            panic!("five frames were drawn");
        };
        if with_motion || viewport.width < 96 || channels == Three {
            continue;
        }
        for other in [
            TemporalSettings {
                depth_tolerance: 10.0,
                ..settings
            },
            TemporalSettings {
                normal_tolerance: settings.normal_tolerance + 0.08,
                ..settings
            },
            TemporalSettings {
                max_frames: if settings.max_frames > 3 { 3 } else { 4 },
                ..settings
            },
            TemporalSettings {
                clamping: 1.0,
                ..settings
            },
        ] {
            let seen: Vec<DVec3> = (picture.iter())
                .map(|v| DVec3::new(f64::from(v.x as f32), 0.0, 0.0))
                .collect();
            let expected = Accumulation {
                camera: &shot.camera,
                previous_camera: &previous,
                receivers: &shot.receivers,
                motion: None,
                picture: &seen,
                settings: &other,
            }
            .accumulate(Some(&before));
            let (count, _) = differences(&found, &expected.pixels);
            println!("{inputs}, {other:?}: {count} differ");
            assert!(
                count > same + 10,
                "{inputs}, {other:?}: {count} differ, {same} without"
            );
        }
    }
}

//! What is no number, no surface, or very large.

use deep_screen_space::{
    Channels, TemporalSettings, Viewport,
    glam::{DVec2, DVec3},
    reference::{hashing, temporal_accumulator::Pixel},
};

use support::testing::pipelines;

use super::{
    harness::{Frame, RUNNING, Rig, differences},
    room::{EYE, Projection, ROOM, Shot, look, noise, straight},
};

#[test]
fn what_is_not_finite_counts_as_absent() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(32, 24);
    let shot = Shot::new(gpu, ROOM, &straight(EYE, viewport));
    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    for channels in [Channels::One, Channels::Three] {
        for clamping in [0.0, 1.0] {
            let settings = TemporalSettings {
                clamping,
                ..RUNNING
            };
            let mut rig = Rig::new(gpu, channels, [32, 24], settings);
            for frame in 0..4 {
                // In frame 0 a third of the pixels is absent, in frame 2 a fourth.
                let absent = |i: u32| {
                    (frame == 0 && i.is_multiple_of(3)) || (frame == 2 && i.is_multiple_of(4))
                };
                let picture: Vec<DVec3> = (0..shot.hits.len() as u32)
                    .map(|i| {
                        let value = DVec3::splat(noise(i, frame));
                        if absent(i) {
                            // One channel is enough.
                            let mut value = value;
                            value[0] = bad[i as usize % 3];
                            value
                        } else {
                            value
                        }
                    })
                    .collect();
                let before = (frame > 0).then(|| rig.kept());
                let found = rig.step(
                    &shot,
                    Frame {
                        picture: &picture,
                        ..Frame::default()
                    },
                );
                let (count, worst) = differences(&found, rig.expected());
                assert_eq!(count, 0, "{channels:?}, {clamping}, frame {frame}: {worst}");
                for (i, pixel) in (0..).zip(&found) {
                    assert!(pixel.mean.is_finite());
                    if absent(i) {
                        let expected = match (&before, shot.hits[i as usize]) {
                            (Some(before), Some(_)) => before[i as usize],
                            _ => Pixel::default(),
                        };
                        assert_eq!(*pixel, expected, "frame {frame}, pixel {i}");
                    }
                }
            }
        }
    }
}

#[test]
fn the_sky_shows_this_frame_and_keeps_nothing() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(32, 24);
    // The second looks up, from aside: what was wall becomes sky. Then back.
    let down = Shot::new(gpu, ROOM, &straight(EYE, viewport));
    let camera = look(
        EYE + DVec3::X,
        DVec3::Y * 0.9 - DVec3::Z,
        Projection::Reversed,
        viewport,
    );
    let up = Shot::new(gpu, ROOM, &camera);
    // Nothing but the sky itself tells it from a surface.
    let settings = TemporalSettings {
        depth_tolerance: 1e30,
        normal_tolerance: -1.0,
        ..RUNNING
    };
    // Vectors that say that nothing moved: the sky's would be found where the wall was.
    let still = vec![DVec2::ZERO; down.hits.len()];
    let mut rig = Rig::new(gpu, Channels::One, [32, 24], settings);
    let mut seen = 0;
    for (frame, shot) in [&down, &up, &up, &down].into_iter().enumerate() {
        let picture = shot.paint(|i, _| noise(i, frame as u32));
        let found = rig.step(
            shot,
            Frame {
                picture: &picture,
                motion: Some(&still),
                reset: false,
            },
        );
        for (i, pixel) in found.iter().enumerate() {
            if shot.hits[i].is_none() {
                assert_eq!(
                    pixel.mean.x as f32, picture[i].x as f32,
                    "frame {frame}, {i}"
                );
                assert_eq!(pixel.frames, 0.0, "frame {frame}, {i}");
                seen += 1;
            } else if frame == 3 && up.hits[i].is_none() {
                assert_eq!(pixel.frames, 1.0, "where sky was, {i}");
            }
        }
    }
    assert!(seen > 500, "{seen} pixels of sky");
}

#[test]
fn extreme_values_stay_finite() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(16, 12);
    // Nearer by an eighth: fractions of all kinds.
    let shots = [EYE, EYE + DVec3::new(0.02, 0.03, -1.0)]
        .map(|eye| Shot::new(gpu, ROOM, &straight(eye, viewport)));
    let extremes = [f32::MAX, -f32::MAX, 1e-38, 0.0, -1e30, 1e19];
    for channels in [Channels::One, Channels::Three] {
        for clamping in [0.0, 1e-30, 1.0, 100.0] {
            let settings = TemporalSettings {
                clamping,
                max_frames: 4,
                ..RUNNING
            };
            let mut rig = Rig::new(gpu, channels, [16, 12], settings);
            for frame in 0..12 {
                let shot = &shots[frame as usize / 2 % 2];
                let picture: Vec<DVec3> = (0..shot.hits.len() as u32)
                    .map(|i| {
                        DVec3::from([0, 1, 2].map(|c| {
                            // From frame 8 on all are the largest: weights that sum to more than 1 overflow.
                            let which = if frame < 8 {
                                hashing::hash2(i, 3 * frame + c) as usize % 6
                            } else {
                                0
                            };
                            f64::from(extremes[which])
                        }))
                    })
                    .collect();
                let found = rig.step(
                    shot,
                    Frame {
                        picture: &picture,
                        motion: None,
                        reset: frame == 8,
                    },
                );
                for pixel in found {
                    assert!(
                        pixel.mean.is_finite(),
                        "{channels:?}, {clamping}, frame {frame}: {pixel:?}"
                    );
                    assert!((0.0..=4.0).contains(&pixel.frames), "{pixel:?}");
                }
            }
        }
    }
}

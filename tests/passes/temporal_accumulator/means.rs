//! What a history's mean is of.

use deep_screen_space::{
    Channels, TemporalInput, TemporalSettings, Viewport,
    glam::{DVec2, DVec3},
    reference::{hashing, temporal_accumulator::Pixel},
    wgpu::TextureFormat as Format,
};

use support::testing::{frames::Decoded, pipelines};

use super::{
    harness::{EXCEPTIONS, Frame, RUNNING, Rig, clear, differences},
    room::{EYE, ROOM, Shot, noise, straight},
};

#[test]
fn a_still_picture_s_mean_is_the_arithmetic_mean() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(32, 24);
    let camera = straight(EYE, viewport);
    let shot = Shot::new(gpu, ROOM, &camera);
    let still = vec![DVec2::ZERO; shot.hits.len()];
    for (motion, frames) in [(None, 256_u32), (Some(still.as_slice()), 16)] {
        let mut rig = Rig::new(gpu, Channels::One, [32, 24], RUNNING);
        let mut sums = vec![0.0; shot.hits.len()];
        let mut errors = Vec::new();
        for frame in 0..frames {
            let picture = shot.paint(|i, _| noise(i, frame));
            let found = rig.step(
                &shot,
                Frame {
                    picture: &picture,
                    motion,
                    reset: false,
                },
            );
            let mut squares = 0.0;
            let mut seen = 0.0;
            for (i, hit) in shot.hits.iter().enumerate() {
                sums[i] += picture[i].x;
                if hit.is_none() {
                    continue;
                }
                let mean = sums[i] / f64::from(frame + 1);
                let off = (found[i].mean.x - mean).abs();
                assert!(
                    off <= 1e-6,
                    "frame {frame}, pixel {i}: {} is off by {off}",
                    found[i].mean.x
                );
                assert_eq!(found[i].frames, f64::from(frame + 1));
                squares += (found[i].mean.x - 0.5).powi(2);
                seen += 1.0;
            }
            if (frame + 1).is_power_of_two() {
                errors.push((squares / seen).sqrt());
            }
        }
        // Uniform noise has a standard deviation of 1/√12; some 600 pixels give it to a few hundredths, and here to a
        // tenth.
        for (doublings, error) in errors.iter().enumerate() {
            let expected = 1.0 / (12.0 * f64::from(1 << doublings)).sqrt();
            println!(
                "{} frames: {error:.4}, expected {expected:.4}",
                1 << doublings
            );
            assert!(
                (error / expected - 1.0).abs() < 0.1,
                "{doublings}: {error}, expected {expected}"
            );
        }
    }
}

/// A channel that is the same at all pixels and in all frames keeps nothing of the others' history back, 0 or not: with clamping
/// noise in one channel falls as it does in three alike.
#[test]
fn channels_that_do_not_vary_bound_none() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(32, 24);
    let shot = Shot::new(gpu, ROOM, &straight(EYE, viewport));
    let settings = TemporalSettings {
        clamping: 0.5,
        ..RUNNING
    };
    let errors = [None, Some(0.0), Some(0.3)].map(|constant| {
        let mut rig = Rig::new(gpu, Channels::Three, [32, 24], settings);
        let mut found = Vec::new();
        for frame in 0..24 {
            let color = |i| {
                let noise = noise(i, frame);
                let other = constant.unwrap_or(noise);
                DVec3::new(noise, other, other)
            };
            let picture: Vec<DVec3> = (0..shot.hits.len() as u32).map(color).collect();
            found = rig.step(
                &shot,
                Frame {
                    picture: &picture,
                    ..Frame::default()
                },
            );
        }
        let (count, worst) = differences(&found, rig.expected());
        assert!(
            count as f64 <= EXCEPTIONS * found.len() as f64,
            "{constant:?}: {count} differ, by {worst}"
        );
        let off = |pixel: &Pixel| (pixel.mean.x - 0.5).powi(2);
        (found.iter().map(off).sum::<f64>() / found.len() as f64).sqrt()
    });
    println!("{errors:?}");
    assert!(errors[1..].iter().all(|e| *e < 1.01 * errors[0]));
}

#[test]
fn the_mean_forgets_what_is_older_than_its_frames() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(16, 12);
    let shot = Shot::new(gpu, ROOM, &straight(EYE, viewport));
    let settings = TemporalSettings {
        max_frames: 8,
        ..RUNNING
    };
    let mut rig = Rig::new(gpu, Channels::One, [16, 12], settings);
    for frame in 0..100 {
        let lit = shot.paint(|_, _| if frame < 60 { 1.0 } else { 0.0 });
        let found = rig.step(
            &shot,
            Frame {
                picture: &lit,
                ..Frame::default()
            },
        );
        for (pixel, hit) in found.iter().zip(&shot.hits) {
            let after = f64::from((frame - 59).max(0));
            let expected = match hit {
                Some(_) => (7.0_f64 / 8.0).powf(after),
                None => lit[0].x,
            };
            assert!(
                (pixel.mean.x - expected).abs() < 1e-6,
                "frame {frame}: {pixel:?}, {expected}"
            );
        }
    }
}

#[test]
fn a_reset_drops_everything() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(32, 24);
    let shot = Shot::new(gpu, ROOM, &straight(EYE, viewport));
    let mut rig = Rig::new(gpu, Channels::Three, [32, 24], RUNNING);
    for frame in 0..6 {
        let picture = shot.paint(|i, _| noise(i, frame));
        let found = rig.step(
            &shot,
            Frame {
                picture: &picture,
                motion: None,
                reset: frame == 3,
            },
        );
        let young = frame % 3;
        for ((pixel, hit), value) in found.iter().zip(&shot.hits).zip(&picture) {
            let expected = if hit.is_some() {
                f64::from(young + 1)
            } else {
                0.0
            };
            assert_eq!(pixel.frames, expected, "frame {frame}");
            if young == 0 {
                assert_eq!(pixel.mean.as_vec3(), value.as_vec3(), "frame {frame}");
            }
        }
    }
}

#[test]
fn one_frame_is_the_picture_bit_for_bit() {
    let gpu = pipelines::gpu();
    let viewport = Viewport {
        x: 2,
        y: 1,
        width: 33,
        height: 21,
    };
    let settings = TemporalSettings {
        max_frames: 1,
        ..TemporalSettings::default()
    };
    for channels in [Channels::One, Channels::Three] {
        let mut rig = Rig::new(gpu, channels, [33, 21], settings);
        for frame in 0..3 {
            let eye = EYE + f64::from(frame) * 0.01;
            let shot = Shot::new(gpu, ROOM, &straight(eye, viewport));
            // All normal floats of either sign.
            let picture = shot.paint(|i, _| {
                let bits = hashing::hash2(i, frame);
                let exponent = 1 + (bits >> 23 & 0xff) % 254;
                f64::from(f32::from_bits(bits & 0x807f_ffff | exponent << 23))
            });
            let found = rig.step(
                &shot,
                Frame {
                    picture: &picture,
                    ..Frame::default()
                },
            );
            for (pixel, value) in found.iter().zip(&picture) {
                assert_eq!((pixel.mean.x as f32).to_bits(), (value.x as f32).to_bits());
                assert!(pixel.frames <= 1.0);
            }
        }
    }
}

#[test]
fn the_picture_may_be_the_target() {
    let gpu = pipelines::gpu();
    let shot = Shot::new(gpu, ROOM, &straight(EYE, Viewport::full(16, 12)));
    let mut rig = Rig::new(gpu, Channels::One, [16, 12], RUNNING);
    let target = gpu.target(Format::R32Float, 16, 12);
    let mut encoder = gpu.encoder();
    // Nines in both frames, so a mean of nine; and with no frame lost in an encoder of two.
    clear(&mut encoder, &target);
    for _ in 0..2 {
        let mut decoded = Decoded::of(&shot.camera);
        let frame = decoded.frame(
            &mut encoder,
            shot.gbuffer(),
            &shot.camera,
            shot.camera.focus(),
        );
        let input = TemporalInput::new(&frame, &shot.camera, target.texture(), target.texture());
        rig.accumulator
            .record(
                &gpu.device,
                &mut encoder,
                &input,
                &RUNNING,
                &mut rig.history,
            )
            .expect("a frame");
    }
    gpu.finish(encoder);
    assert_eq!(
        gpu.read_texture::<f32>(target.texture(), 0),
        vec![9.0; 16 * 12]
    );
    for (pixel, hit) in rig.kept().iter().zip(&shot.hits) {
        assert_eq!(pixel.frames, if hit.is_some() { 2.0 } else { 0.0 });
    }
}

/// What clamping is for, and what it costs; `TemporalSettings::clamping` and the changelog quote the figures.
#[test]
fn clamping_follows_the_light_and_costs_bias() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(64, 48);
    let shot = Shot::new(gpu, ROOM, &straight(EYE, viewport));
    let surfaces = shot.hits.iter().filter(|hit| hit.is_some()).count() as f64;
    let statistics = |found: &[Pixel], truth: f64| {
        let all = || {
            found
                .iter()
                .zip(&shot.hits)
                .filter(|(_, hit)| hit.is_some())
        };
        let bias = all().map(|(p, _)| p.mean.x - truth).sum::<f64>() / surfaces;
        let square = all().map(|(p, _)| (p.mean.x - truth).powi(2)).sum::<f64>() / surfaces;
        (bias, square.sqrt())
    };
    let run = |clamping: f32, value: &dyn Fn(f64) -> f64, truth: f64| {
        let settings = TemporalSettings {
            clamping,
            max_frames: 32,
            ..RUNNING
        };
        let mut rig = Rig::new(gpu, Channels::One, [64, 48], settings);
        let mut found = Vec::new();
        for frame in 0..64 {
            let picture = shot.paint(|i, _| value(noise(i, frame)));
            found = rig.step(
                &shot,
                Frame {
                    picture: &picture,
                    ..Frame::default()
                },
            );
        }
        let still = statistics(&found, truth);
        // The light goes out, but for the noise.
        for frame in 64..68 {
            let picture = shot.paint(|i, _| 0.1 * value(noise(i, frame)));
            found = rig.step(
                &shot,
                Frame {
                    picture: &picture,
                    ..Frame::default()
                },
            );
        }
        let late = statistics(&found, 0.1 * truth);
        (still, late)
    };
    let uniform = |v: f64| v;
    let rare = |v: f64| if v < 0.05 { 1.0 } else { 0.0 };
    let mut all = Vec::new();
    for (name, value, truth) in [
        ("uniform", &uniform as &dyn Fn(f64) -> f64, 0.5),
        ("one in twenty", &rare, 0.05),
    ] {
        for clamping in [0.0, 0.5, 1.0] {
            let (still, late) = run(clamping, value, truth);
            println!(
                "{name}, clamping {clamping}: still bias {:+.4}, RMSE {:.4}; 4 frames after the light: RMSE {:.4}",
                still.0, still.1, late.1
            );
            all.push((still, late));
        }
    }
    // Without it there is no bias, beyond what chance leaves of 2300 pixels' means; and the light lags.
    for k in [0, 3] {
        assert!(all[k].0.0.abs() < 0.003, "{:?}", all[k]);
    }
    assert!(all[0].1.1 > 0.3, "{:?}", all[0]);
    // With it the light is followed, and rare noise loses a part of its mean.
    assert!(all[2].1.1 < 0.1, "{:?}", all[2]);
    assert!(all[5].0.0 < -0.005, "{:?}", all[5]);
}

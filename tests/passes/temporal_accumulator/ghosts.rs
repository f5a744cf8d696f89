//! What something uncovers starts anew.

use deep_screen_space::{
    Channels, TemporalSettings, Viewport,
    glam::{DVec2, DVec3},
};

use support::testing::pipelines;

use super::{
    harness::{EXCEPTIONS, Frame, RUNNING, Rig, differences},
    room::{
        EYE, Hit, Projection, ROOM, Shot, Surface, World, look, noise, orthographic_from, pixels,
        straight,
    },
};

/// An orthographic camera may stand anywhere along its axis: what the block uncovers starts anew from near and from far, and the
/// rest goes on.
#[test]
fn nothing_ghosts_before_orthographic_cameras() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(96, 64);
    for back in [0.0, 30.0, 1000.0] {
        let camera = orthographic_from(back, viewport);
        let [first, second] = [-0.3, 0.2].map(|x| {
            let world = World {
                block: Some(x),
                ..ROOM
            };
            Shot::new(gpu, world, &camera)
        });
        let mut rig = Rig::new(gpu, Channels::One, [96, 64], RUNNING);
        let mut found = Vec::new();
        for (shot, frame) in [(&first, 0), (&second, 1)] {
            let picture = shot.paint(|i, _| noise(i, frame));
            found = rig.step(
                shot,
                Frame {
                    picture: &picture,
                    ..Frame::default()
                },
            );
        }
        let (count, worst) = differences(&found, rig.expected());
        assert!(
            count as f64 <= EXCEPTIONS * found.len() as f64,
            "{back}: {count} differ, by {worst}"
        );
        let (mut uncovered, mut kept) = (0, 0);
        for (i, pixel) in found.iter().enumerate() {
            let (Some(was), Some(is)) = (first.hits[i], second.hits[i]) else {
                continue;
            };
            match (was.surface, is.surface) {
                (Surface::Block, Surface::Wall) => {
                    assert_eq!(pixel.frames, 1.0, "{back}: pixel {i}");
                    uncovered += 1;
                }
                (Surface::Wall, Surface::Wall) => {
                    assert_eq!(pixel.frames, 2.0, "{back}: pixel {i}");
                    kept += 1;
                }
                _ => {}
            }
        }
        println!("{back}: uncovered {uncovered}, kept {kept}");
        assert!(uncovered > 40 && kept > 1000, "{uncovered}, {kept}");
    }
}

#[test]
fn nothing_ghosts_where_a_block_was() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(96, 64);
    let camera = straight(EYE, viewport);
    let before = World {
        block: Some(-0.3),
        ..ROOM
    };
    // By three pixels and a half.
    let step = 3.5 * camera.footprint().pixel * 5.0;
    let after = World {
        block: Some(-0.3 + step),
        ..ROOM
    };
    let (first, second) = (
        Shot::new(gpu, before, &camera),
        Shot::new(gpu, after, &camera),
    );
    let paint = |shot: &Shot, frame| {
        shot.paint(|i, hit| match hit {
            Some(hit) if hit.surface == Surface::Block => 1.0,
            _ => 0.2 * noise(i, frame),
        })
    };
    let motion: Vec<DVec2> = (second.hits.iter())
        .map(|hit| match hit {
            Some(hit) if hit.surface == Surface::Block => DVec2::new(3.5, 0.0),
            _ => DVec2::ZERO,
        })
        .collect();
    for motion in [None, Some(motion.as_slice())] {
        let mut rig = Rig::new(gpu, Channels::One, [96, 64], RUNNING);
        for frame in 0..8 {
            let picture = paint(&first, frame);
            rig.step(
                &first,
                Frame {
                    picture: &picture,
                    ..Frame::default()
                },
            );
        }
        let picture = paint(&second, 8);
        let found = rig.step(
            &second,
            Frame {
                picture: &picture,
                motion,
                reset: false,
            },
        );
        let (mut uncovered, mut kept, mut followed, mut edge) = (0, 0, 0, 0);
        for (i, pixel) in found.iter().enumerate() {
            let (Some(was), Some(is)) = (first.hits[i], second.hits[i]) else {
                continue;
            };
            match (was.surface, is.surface) {
                (Surface::Block, Surface::Wall | Surface::Floor) => {
                    assert_eq!(pixel.frames, 1.0, "pixel {i}");
                    assert_eq!(pixel.mean.x as f32, picture[i].x as f32, "pixel {i}");
                    uncovered += 1;
                }
                (_, Surface::Block) if motion.is_some() => {
                    // Of four taps those on the block count: the mean of ones is one.
                    assert!((pixel.mean.x - 1.0).abs() < 1e-6, "pixel {i}: {pixel:?}");
                    if (pixel.frames - 9.0).abs() < 1e-4 {
                        followed += 1;
                    } else {
                        edge += 1;
                    }
                }
                (Surface::Wall, Surface::Wall) | (Surface::Floor, Surface::Floor) => {
                    assert_eq!(pixel.frames, 9.0, "pixel {i}");
                    kept += 1;
                }
                _ => {}
            }
        }
        println!("uncovered {uncovered}, kept {kept}, followed {followed}, edge {edge}");
        assert!(uncovered > 40 && kept > 1000);
        assert!(motion.is_none() || (followed > 150 && edge == 0));

        // The history is there to ghost: with the depths' tolerance as wide as the room it does.
        let mut loose = Rig::new(
            gpu,
            Channels::One,
            [96, 64],
            TemporalSettings {
                depth_tolerance: 10.0,
                ..RUNNING
            },
        );
        let picture = paint(&first, 0);
        loose.step(
            &first,
            Frame {
                picture: &picture,
                ..Frame::default()
            },
        );
        let picture = paint(&second, 1);
        let leaky = loose.step(
            &second,
            Frame {
                picture: &picture,
                ..Frame::default()
            },
        );
        let ghosts = leaky
            .iter()
            .zip(&picture)
            .filter(|(p, now)| p.mean.x - now.x > 0.3);
        assert!(ghosts.count() > 40);
    }
}

/// The surface that all texels show from which a pixel that moved by so much fetches its history.
fn surface_of_taps(before: &Shot, index: usize, motion: DVec2) -> Option<Surface> {
    let viewport = before.camera.viewport();
    let [x, y] = [index as u32 % viewport.width, index as u32 / viewport.width].map(f64::from);
    let place = DVec2::new(x, y) - motion;
    let base = place.floor();
    let mut found = None;
    for corner in [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE] {
        let at = base + corner;
        let weight = DVec2::ONE - (place - at).abs();
        let end = DVec2::new(f64::from(viewport.width), f64::from(viewport.height));
        if weight.x * weight.y <= 0.0 {
            continue;
        }
        if at.cmplt(DVec2::ZERO).any() || at.cmpge(end).any() {
            return None;
        }
        let surface = before.hits[at.y as usize * viewport.width as usize + at.x as usize]?.surface;
        if found.is_some_and(|found| found != surface) {
            return None;
        }
        found = Some(surface);
    }
    found
}

/// A slab 5 cm high that slides over a floor 5.7 m away, under a camera that stands or moves: what it uncovers starts anew at
/// the default settings, from the frame on in which it begins to move, and the floor beside it keeps its history.
#[test]
fn nothing_ghosts_behind_a_thin_mover() {
    let gpu = pipelines::gpu();
    let viewport = Viewport::full(240, 160);
    let eye = DVec3::new(0.0, 2.5, 4.0);
    let toward = DVec3::new(0.0, -2.5, -5.0);
    // How far it goes in a frame: many pixels, one or two, and a fifth of one; to the side, away and nearer.
    for (step, what) in [
        (DVec3::new(0.4, 0.0, 0.0), "fast"),
        (DVec3::new(0.05, 0.0, -0.02), "slow"),
        (DVec3::new(0.0, 0.0, -0.4), "away"),
        (DVec3::new(-0.1, 0.0, 0.3), "nearer"),
        (DVec3::new(0.005, 0.0, 0.0), "hardly"),
    ] {
        let mut in_all = 0;
        for drift in [DVec3::ZERO, DVec3::new(0.02, 0.01, -0.03)] {
            let mut rig = Rig::new(gpu, Channels::One, [240, 160], TemporalSettings::default());
            let mut before: Option<Shot> = None;
            let (mut uncovered, mut ghosts) = (0, 0);
            let (mut floor, mut anew) = (0, 0);
            let (mut followed, mut lost) = (0, 0);
            for frame in 0..8 {
                // It stands for some frames, and then begins to move at once.
                let moves = |frame: u32| f64::from(frame.max(4) - 4);
                let at = |frame| DVec3::new(0.0, 0.0, -0.8) + step * moves(frame);
                let world = World {
                    slab: Some(at(frame)),
                    ..ROOM
                };
                let camera = look(
                    eye + drift * f64::from(frame),
                    toward,
                    Projection::Reversed,
                    viewport,
                );
                let shot = Shot::new(gpu, world, &camera);
                let last = rig.previous.unwrap_or(camera);
                let moved = if frame > 0 {
                    at(frame) - at(frame - 1)
                } else {
                    DVec3::ZERO
                };
                let was = |hit: Hit| match hit.surface {
                    Surface::Block => hit.point - moved,
                    _ => hit.point,
                };
                let motion: Vec<DVec2> = (pixels(viewport).zip(&shot.hits))
                    .map(|([x, y], hit)| {
                        let place = hit.and_then(|hit| last.project(was(hit) - last.eye()));
                        let here = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                        place.map_or(DVec2::ZERO, |place| {
                            // What stands still under a camera that does is where it was, exactly.
                            let off = here - place.truncate();
                            if off.length() < 1e-9 {
                                DVec2::ZERO
                            } else {
                                off
                            }
                        })
                    })
                    .collect();
                let picture = shot.paint(|i, hit| match hit {
                    Some(hit) if hit.surface == Surface::Block => 1.0,
                    _ => 0.2 * noise(i, frame),
                });
                let found = rig.step(
                    &shot,
                    Frame {
                        picture: &picture,
                        motion: Some(&motion),
                        reset: false,
                    },
                );
                let (beyond, worst) = differences(&found, rig.expected());
                assert!(
                    beyond as f64 <= EXCEPTIONS * found.len() as f64,
                    "{what}, frame {frame}: {beyond} differ, others by up to {worst}"
                );
                if let Some(before) = &before {
                    for (i, (pixel, hit)) in found.iter().zip(&shot.hits).enumerate() {
                        let Some(hit) = hit else { continue };
                        let Some(was) = surface_of_taps(before, i, motion[i]) else {
                            continue;
                        };
                        let young = usize::from(pixel.frames <= 1.0);
                        match (hit.surface, was) {
                            (Surface::Floor, Surface::Block) => {
                                uncovered += 1;
                                ghosts += 1 - young;
                            }
                            (Surface::Floor, Surface::Floor) => {
                                floor += 1;
                                anew += young;
                            }
                            (Surface::Block, Surface::Block) => {
                                followed += 1;
                                lost += young;
                            }
                            _ => {}
                        }
                    }
                }
                before = Some(shot);
            }
            println!(
                "{what}, camera by {drift}: {ghosts} of {uncovered} uncovered keep a history; {anew} of {floor} of the floor \
                 and {lost} of {followed} of the slab lose it"
            );
            assert!(floor > 50_000 && followed > 1000, "{what}");
            assert_eq!([ghosts, anew, lost], [0; 3], "{what}, camera by {drift}");
            in_all += uncovered;
        }
        assert!(in_all > 0, "{what}: nothing was uncovered");
    }
}

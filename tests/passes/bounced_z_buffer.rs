//! The `BouncedZBuffer`: directions by themselves, GPU against the f64 mirror, nothing that leaks, and typed errors.

use std::f64::consts::PI;
use support::testing::pipelines;

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, BouncedView, BouncedZBuffer, BvhBuilder,
    Camera, CloudCapacity, Error, HitLighting, HitRadiance, Payload, Placement, Primitives,
    RayTracedScene, Sampling, SurfelRadiance, SurfelizerSettings, Timestamps, Viewport,
    glam::{DMat4, DVec2, DVec3, DVec4},
    reference::{
        bounced_z_buffer::{Senders, Tracing},
        directions::{cell_point, concentric_disk, hemisphere_direction, tangent_frame},
        hashing::{hash2, unit_float},
        packing::{pack_color, unpack_color},
        surfelizer::{Triangle, leaf_at, leaf_of},
    },
    scenes::{self, Scene},
    wgpu,
};
use support::testing::frames::Decoded;
use support::testing::rays;
use support::testing::rays::{AMPLE, differing_bits, lab, moved, scene_of, triangles};
use support::testing::refusals::fields_refused;
use support::testing::shot::{Shot, camera_of};
use support::{raster::perspective, scene::SceneBuffers};

const SAMPLINGS: [Sampling; 2] = [Sampling::Cosine, Sampling::Uniform];

/// Share of rays for which f32 may find otherwise than f64: those that pass an edge by less than rounding. Directions are
/// off by some 1e-6 where a driver's sine is good and by up to 2^-11 where it is as WGSL allows; of random rays about
/// that share, times the length of the edges in sight over their extent (some tens), passes an edge as closely. The
/// octahedral normal of a curved surface may also be rounded to the next step, which turns all rays of a pixel by 3e-5.
const ODD_RAYS: f64 = 2e-3;

fn settings(rays_per_pixel: u32) -> BouncedSettings {
    BouncedSettings {
        rays_per_pixel,
        ..BouncedSettings::default()
    }
}

/// A shot's hits by GPU and by mirror; returns the share of rays that differ.
fn compare(
    name: &str,
    shot: &Shot,
    senders: &rays::Senders,
    settings: &BouncedSettings,
    sampling: Sampling,
) -> f64 {
    let lab = lab();
    let view = lab.trace(shot, senders, None, settings, sampling);
    let found = lab.blocked(&view, settings);
    let receivers = shot.receivers(senders.cloud.origin());
    let tracing = Tracing {
        receivers: &receivers,
        camera: &shot.camera,
        origin: senders.cloud.origin(),
        settings,
        sampling,
        pieces: &senders.pieces,
    };
    let rays = (receivers.iter().flatten().count() * settings.rays_per_pixel as usize).max(1);
    let odd = differing_bits(&found, &tracing.blocked());
    let blocked: u32 = found.iter().map(|word| word.count_ones()).sum();
    println!("{name}: {odd} of {rays} rays differ, {blocked} blocked");
    // Any hit will do: none is nearer than the nearest, and where there is one it is somewhere.
    let words = settings.rays_per_pixel.div_ceil(32).max(1) as usize;
    let near: Vec<u32> = lab.gpu.read_buffer(view.nearness());
    let most = tracing.nearness().into_iter().map(f64::from);
    let nearer = near
        .iter()
        .zip(most)
        .filter(|&(&near, most)| f64::from(near) > most + NEARNESS_OFF)
        .count();
    assert!(nearer <= odd as usize, "{name}: {nearer} pixels are nearer");
    for (near, bits) in near.iter().zip(found.chunks(words)) {
        assert_eq!(*near > 0, bits.iter().any(|word| *word > 0), "{name}");
    }
    f64::from(odd) / rays as f64
}

/// How far a pixel's nearness may be off, where one is 2^24: of hits within the pixel itself distances are short, positions are
/// rounded to 1e-6 of theirs, and a driver's sines turn the ray. Measured at 1e-4 on lavapipe, 3e-4 on `SwiftShader`.
const NEARNESS_OFF: f64 = 1e-3 * 16_777_216.0;

/// How far nearness is off the mirror's, which is that of nearest hits: the share of pixels that are off by more than
/// [`NEARNESS_OFF`].
fn compare_nearness(name: &str, view: &BouncedView, tracing: &Tracing<'_>) -> f64 {
    let found: Vec<u32> = lab().gpu.read_buffer(view.nearness());
    let expected = tracing.nearness();
    let off = |(a, b): (&u32, &u32)| (f64::from(*a) - f64::from(*b)).abs();
    let odd = found.iter().zip(&expected).map(off);
    let worst = odd.clone().fold(0.0, f64::max) / 16_777_216.0;
    let odd = odd.filter(|&off| off > NEARNESS_OFF).count();
    println!("{name}: nearness of {odd} pixels differs, worst by {worst:.1e}");
    odd as f64 / found.len() as f64
}

/// The same for colours, with a radiance of its own for each surfel.
fn compare_colors(
    name: &str,
    shot: &Shot,
    senders: &rays::Senders,
    settings: &BouncedSettings,
    sampling: Sampling,
) -> f64 {
    let lab = lab();
    let (_, mut radiance) = lab.motley(senders);
    // What a caller's own buffer may hold.
    for (sent, i) in radiance.iter_mut().zip(0_usize..) {
        match i % 16 {
            3 => sent.front[i % 3] = f32::NAN,
            5 => sent.back = [f32::NAN; 3],
            7 => sent.front[i % 3] = f32::INFINITY,
            9 => sent.back[i % 3] = -1.0,
            11 => sent.front = [1e30, 3e38, 1e18],
            13 => sent.front = [1e-38, -0.0, 1e-40],
            _ => {}
        }
    }
    let buffer = lab.gpu.buffer(&radiance, wgpu::BufferUsages::STORAGE);
    let view = lab.trace(shot, senders, Some(&buffer), settings, sampling);
    let found = lab.colors(&view, settings);
    let receivers = shot.receivers(senders.cloud.origin());
    let tracing = Tracing {
        receivers: &receivers,
        camera: &shot.camera,
        origin: senders.cloud.origin(),
        settings,
        sampling,
        pieces: &senders.pieces,
    };
    let expected = tracing.colors(&Senders {
        counts: senders.counts,
        capacity: senders.cloud.capacity(),
        radiance: &radiance,
    });
    assert_eq!(found.len(), expected.len(), "{name}");
    assert!(found.iter().all(|bits| unpack_color(*bits).is_finite()));
    let odd = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
    let rays = (receivers.iter().flatten().count() * settings.rays_per_pixel as usize).max(1);
    println!(
        "{name}: {odd} of {rays} colours differ, {:?}",
        senders.counts
    );
    // A pixel is odd where one of its rays is.
    let odd_pixels = compare_nearness(name, &view, &tracing);
    let allowed = ODD_RAYS * f64::from(settings.rays_per_pixel);
    assert!(odd_pixels <= allowed, "{name}: {odd_pixels}");
    odd as f64 / rays as f64
}

fn shot_of(scene: &Scene, view: usize, size: [u32; 2]) -> Shot {
    Shot::new(lab().gpu, scene, &camera_of(scene, view, size))
}

fn senders_of(shot: &Shot, settings: &SurfelizerSettings) -> rays::Senders {
    lab().senders(&shot.buffers.meshes(), &shot.camera, settings, AMPLE)
}

#[test]
fn hits_are_the_mirrors() {
    let thinned = SurfelizerSettings {
        radius_pixels: 3.0,
        density: 1.0,
        ..SurfelizerSettings::default()
    };
    for (scene, size, cases) in [
        (
            scenes::closed_room(),
            32,
            &[
                (1, 0, f32::INFINITY),
                (5, 3, 1.0),
                (64, 0, 0.3),
                (4, 1 << 20, 2.0),
            ][..],
        ),
        (
            scenes::cornell(),
            32,
            &[(4, 1, f32::INFINITY), (16, 0, 0.5), (33, 7, f32::INFINITY)],
        ),
        (scenes::colonnade(), 8, &[(4, 2, f32::INFINITY)]),
        (
            scenes::dominoes(),
            24,
            &[(5, 0, 0.1), (4, 9, f32::INFINITY)],
        ),
    ] {
        // The first view of some is symmetric: its diagonal pixels lie on the very edge of wall and ceiling.
        let shot = shot_of(&scene, 1, [size, size]);
        for cloud in [triangles(), thinned] {
            let senders = senders_of(&shot, &cloud);
            assert_eq!(senders.counts.piece_overflow(AMPLE), 0, "{}", scene.name);
            for (&(rays_per_pixel, frame, radius), sampling) in
                cases.iter().zip(SAMPLINGS.into_iter().cycle())
            {
                let settings = BouncedSettings {
                    frame,
                    radius,
                    ..settings(rays_per_pixel)
                };
                let name = format!(
                    "{} density {}: {rays_per_pixel} rays per pixel, frame {frame}, radius {radius}, {sampling:?}, {} pieces",
                    scene.name,
                    cloud.density,
                    senders.pieces.len()
                );
                let odd = compare(&name, &shot, &senders, &settings, sampling);
                // Of the few rays of a small image four may be odd, whatever share that is.
                let few = 4.0 / (shot.pixels.len() as f64 * f64::from(rays_per_pixel));
                assert!(odd <= ODD_RAYS.max(few), "{name}: {odd}");
            }
        }
    }
}

/// A leaf's edges are edges too where each surfel has a colour of its own: many more of them. Measured beside.
const ODD_COLORS: f64 = 3e-3;

#[test]
fn colors_are_the_mirrors() {
    for (scene, size, rays_per_pixel, sampling) in [
        (scenes::closed_room(), 32, 5, Sampling::Uniform),
        (scenes::cornell(), 48, 4, Sampling::Cosine),
        (scenes::dominoes(), 24, 16, Sampling::Cosine),
    ] {
        let shot = shot_of(&scene, 1, [size, size]);
        let cloud = SurfelizerSettings {
            radius_pixels: 4.0,
            ..triangles()
        };
        let senders = senders_of(&shot, &cloud);
        assert_eq!(senders.counts.overflow(), 0, "{:?}", senders.counts);
        for radius in [f32::INFINITY, 0.4] {
            let settings = BouncedSettings {
                radius,
                sky_radiance: [0.1, 20.0, 3e-4],
                ..settings(rays_per_pixel)
            };
            let name = format!("{} radius {radius}", scene.name);
            let odd = compare_colors(&name, &shot, &senders, &settings, sampling);
            assert!(odd <= ODD_COLORS, "{name}: {odd}");
        }
    }
}

/// Pieces and surfels without room are left out evenly, and a piece's surfels are the nearest that stayed.
#[test]
fn overflow_is_the_mirrors() {
    let scene = scenes::dominoes();
    let shot = shot_of(&scene, 0, [24, 24]);
    for (pieces, surfels) in [(1 << 15, 1000), (300, 1 << 15), (257, 100), (1, 1), (5, 3)] {
        let capacity = CloudCapacity {
            surfels,
            pieces,
            ..AMPLE
        };
        let cloud = SurfelizerSettings {
            radius_pixels: 4.0,
            ..triangles()
        };
        let senders = lab().senders(&shot.buffers.meshes(), &shot.camera, &cloud, capacity);
        let name = format!("{pieces} pieces, {surfels} surfels");
        let overflow = (
            senders.counts.piece_overflow(capacity) > 0,
            senders.counts.overflow() > 0,
        );
        assert!(overflow.0 || overflow.1, "{name}: {:?}", senders.counts);
        let odd = compare(&name, &shot, &senders, &settings(16), Sampling::Cosine);
        assert!(odd <= ODD_RAYS, "{name}: {odd}");
        let odd = compare_colors(&name, &shot, &senders, &settings(4), Sampling::Cosine);
        assert!(odd <= ODD_COLORS, "{name}: {odd}");
    }
}

fn orthographic(half: f64, far: f64) -> DMat4 {
    DMat4::from_cols(
        DVec4::X / half,
        DVec4::Y / half,
        DVec4::Z / far,
        DVec4::new(0.0, 0.0, 1.0, 1.0),
    )
}

#[test]
fn cameras_of_all_kinds() {
    let scene = scenes::dominoes();
    let view = &scene.views[0];
    let look = |eye: DVec3, projection, viewport| {
        Camera::look_at(eye, view.target.into(), DVec3::Y, projection, viewport).expect("a camera")
    };
    let eye = DVec3::from(view.eye);
    let lens = perspective(view.vertical_fov_degrees, 1.0, view.near);
    let window = Viewport {
        x: 5,
        y: 3,
        width: 29,
        height: 23,
    };
    let own = look(eye, lens, Viewport::full(24, 24));
    let other = look(
        eye + DVec3::new(0.3, 0.2, -0.1),
        lens,
        Viewport::full(24, 24),
    );
    let ortho = look(eye, orthographic(1.5, 40.0), Viewport::full(24, 24));
    for (name, camera, of_cloud) in [
        ("orthographic", ortho, ortho),
        ("a part of the image", look(eye, lens, window), own),
        ("another eye than the cloud's", other, own),
        ("orthographic cloud", own, ortho),
        ("one pixel", look(eye, lens, Viewport::full(1, 1)), own),
        ("one row", look(eye, lens, Viewport::full(53, 1)), own),
    ] {
        let shot = Shot::new(lab().gpu, &scene, &camera);
        let meshes = shot.buffers.meshes();
        let senders = lab().senders(&meshes, &of_cloud, &triangles(), AMPLE);
        for sampling in SAMPLINGS {
            let odd = compare(name, &shot, &senders, &settings(16), sampling);
            // Of the few rays of a small image one may be odd.
            let one = 1.0 / (16 * shot.pixels.len()) as f64;
            assert!(odd <= ODD_RAYS.max(one), "{name}: {odd}");
        }
        let odd = compare_colors(name, &shot, &senders, &settings(5), Sampling::Cosine);
        let one = 1.0 / (5 * shot.pixels.len()) as f64;
        assert!(odd <= ODD_COLORS.max(one), "{name}: {odd}");
    }
}

#[test]
fn nothing_to_hit() {
    let scene = scenes::cornell();
    let shot = shot_of(&scene, 0, [32, 32]);
    let lab = lab();
    let senders = senders_of(&shot, &triangles());
    // Radius 0 and no directions.
    for nothing in [
        BouncedSettings {
            radius: 0.0,
            ..settings(16)
        },
        settings(0),
    ] {
        let view = lab.trace(&shot, &senders, None, &nothing, Sampling::Cosine);
        assert!(
            lab.blocked(&view, &nothing).iter().all(|word| *word == 0),
            "{nothing:?}"
        );
    }
    // No triangles; a cloud that was never recorded.
    let mut none = lab.senders(&[], &shot.camera, &triangles(), AMPLE);
    assert_eq!(none.counts.pieces, 0);
    let (buffer, _) = lab.motley(&none);
    let sky = BouncedSettings {
        sky_radiance: [1.0, 2.0, 3.0],
        ..settings(4)
    };
    let check = |none: &rays::Senders| {
        let view = lab.trace(&shot, none, None, &settings(16), Sampling::Uniform);
        assert!(lab.blocked(&view, &settings(16)).iter().all(|w| *w == 0));
        let view = lab.trace(&shot, none, Some(&buffer), &sky, Sampling::Uniform);
        let expected = pack_color([1.0, 2.0, 3.0]);
        for (i, color) in lab.colors(&view, &sky).into_iter().enumerate() {
            let seen = shot.pixels[i / 4].is_some();
            assert_eq!(color, if seen { expected } else { 0 }, "pixel {}", i / 4);
        }
    };
    check(&none);
    // All of a scene, then nothing: what was there before is not hit.
    let meshes = shot.buffers.meshes();
    lab.record_senders(&mut none, &meshes, &shot.camera, &triangles());
    assert!(none.counts.pieces > 0);
    lab.record_senders(&mut none, &[], &shot.camera, &triangles());
    assert_eq!(none.counts.pieces, 0);
    check(&none);
}

/// A cloud recorded smaller after a larger one: every number of pieces about the sizes of runs, none of them stale.
#[test]
fn stale_pieces_are_not_hit() {
    let base = scenes::cornell();
    let lab = lab();
    let shot = shot_of(&scenes::dominoes(), 0, [24, 24]);
    let mut senders = senders_of(&shot, &triangles());
    assert!(senders.counts.pieces > 500, "{:?}", senders.counts);
    // Small triangles in a row over the dominoes.
    let row = |count: usize| -> Vec<[DVec3; 3]> {
        (0..count)
            .map(|i| {
                let at = DVec3::new(0.15 * (i % 16) as f64 - 1.0, 1.2, 0.2 * (i / 16) as f64);
                [at, at + DVec3::X * 0.12, at + DVec3::Z * 0.12]
            })
            .collect()
    };
    for count in [65, 64, 63, 17, 16, 15, 5, 4, 3, 1] {
        let scene = scene_of(&row(count), &base);
        let buffers = SceneBuffers::new(lab.gpu, &scene);
        lab.record_senders(&mut senders, &buffers.meshes(), &shot.camera, &triangles());
        assert!(senders.counts.pieces >= count as u32);
        let name = format!("{count} triangles after many");
        let odd = compare(&name, &shot, &senders, &settings(16), Sampling::Cosine);
        assert!(odd <= ODD_RAYS, "{name}: {odd}");
        let fresh = lab.senders(&buffers.meshes(), &shot.camera, &triangles(), AMPLE);
        let [stale, fresh] = [&senders, &fresh].map(|senders| {
            let view = lab.trace(&shot, senders, None, &settings(16), Sampling::Cosine);
            lab.blocked(&view, &settings(16))
        });
        assert_eq!(stale, fresh, "{name}");
    }
}

/// Rays of a view that met nothing.
fn escaped(shot: &Shot, senders: &rays::Senders, settings: &BouncedSettings) -> (usize, usize) {
    let lab = lab();
    let view = lab.trace(shot, senders, None, settings, Sampling::Uniform);
    let bits = lab.blocked(&view, settings);
    let rays = shot.pixels.iter().flatten().count() * settings.rays_per_pixel as usize;
    let blocked: u32 = bits.iter().map(|word| word.count_ones()).sum();
    (rays - blocked as usize, rays)
}

/// No ray leaves a closed room: from any pixel, whatever the size of the pieces, at any scale and place.
#[test]
fn no_ray_escapes() {
    let room = scenes::closed_room();
    let far = DVec3::new(65536.0, -131_072.0, 32768.0);
    for (scale, shift) in [
        (1.0, DVec3::ZERO),
        (1e-4, DVec3::ZERO),
        (1e5, DVec3::ZERO),
        (1.0, far),
    ] {
        let scene = moved(&room, scale, shift);
        let corner = Camera::look_at(
            DVec3::new(-2.97, 0.03, -2.47) * scale + shift,
            DVec3::new(1.0, 1.5, 1.0) * scale + shift,
            DVec3::Y,
            perspective(80.0, 1.0, 0.01 * scale),
            Viewport::full(40, 40),
        )
        .expect("a camera");
        let cameras = [
            corner,
            camera_of(&scene, 0, [40, 40]),
            camera_of(&scene, 1, [40, 40]),
        ];
        for (index, camera) in cameras.iter().enumerate() {
            let shot = Shot::new(lab().gpu, &scene, camera);
            let sizes = [4.0, 1.0, 50.0];
            // Larger pieces than triangles or smaller ones are the same at any scale.
            for &radius_pixels in &sizes[..if scale == 1.0 && shift == DVec3::ZERO {
                3
            } else {
                1
            }] {
                let cloud = SurfelizerSettings {
                    radius_pixels,
                    ..triangles()
                };
                let senders = senders_of(&shot, &cloud);
                assert_eq!(senders.counts.piece_overflow(AMPLE), 0);
                let (escaped, rays) = escaped(&shot, &senders, &settings(36));
                println!(
                    "scale {scale}, at {shift}, camera {index}, {radius_pixels} pixels: {escaped} of {rays}"
                );
                assert_eq!(
                    escaped, 0,
                    "scale {scale}, at {shift}, camera {index}, {radius_pixels} pixels, of {rays}"
                );
            }
        }
    }
}

/// Nor where only rays are traced and pieces are the triangles, or where large triangles were left uncut for want of room.
#[test]
fn no_ray_escapes_whole_triangles() {
    let room = scenes::closed_room();
    let count = room.indices.len() as u32 / 3;
    let alone = CloudCapacity {
        surfels: 0,
        ..AMPLE
    };
    let tight = CloudCapacity {
        pieces: count,
        ..AMPLE
    };
    for (name, capacity) in [("rays alone", alone), ("merged", tight)] {
        for view in 0..2 {
            let camera = camera_of(&room, view, [40, 40]);
            let shot = Shot::new(lab().gpu, &room, &camera);
            let senders =
                lab().senders(&shot.buffers.meshes(), &shot.camera, &triangles(), capacity);
            let (escaped, rays) = escaped(&shot, &senders, &settings(36));
            println!(
                "{name}, view {view}: {:?}, {escaped} of {rays}",
                senders.counts
            );
            assert_eq!(senders.counts.lost_area, 0, "{name}, view {view}");
            assert_eq!(escaped, 0, "{name}, view {view}, of {rays}");
            if capacity.surfels == 0 {
                assert_eq!(senders.counts.pieces, count, "{name}, view {view}");
            } else {
                assert!(senders.counts.merged > 100, "{:?}", senders.counts);
            }
            let odd = compare(name, &shot, &senders, &settings(16), Sampling::Cosine);
            assert!(odd <= ODD_RAYS, "{name}, view {view}: {odd}");
        }
    }
}

/// A tilted ground and a ceiling over it, up to a million times as large as what is seen of them: rays between them are as
/// exact as where they are small.
#[test]
fn huge_triangles_are_as_exact_as_small_ones() {
    let lab = lab();
    let tilt = DMat4::from_rotation_x(0.3) * DMat4::from_rotation_z(-0.2);
    for side in [1e2, 1e4, 1e6] {
        let square = |height: f64| {
            let at = |x: f64, z: f64| tilt.transform_point3(DVec3::new(side * x, height, side * z));
            let [a, b, c, d] = [at(-1.1, -1.0), at(-1.0, 1.2), at(1.0, 1.1), at(1.2, -0.9)];
            [[a, b, c], [a, c, d]]
        };
        let walls = [square(0.0), square(3.0)].concat();
        let scene = scene_of(&walls, &scenes::closed_room());
        let camera = Camera::look_at(
            tilt.transform_point3(DVec3::new(0.0, 1.7, 0.0)),
            tilt.transform_point3(DVec3::new(0.7, 0.9, -2.0)),
            DVec3::Y,
            perspective(70.0, 1.0, 0.01),
            Viewport::full(40, 40),
        )
        .expect("a camera");
        let shot = Shot::new(lab.gpu, &scene, &camera);
        let capacity = CloudCapacity {
            surfels: 0,
            ..AMPLE
        };
        let senders = lab.senders(&shot.buffers.meshes(), &camera, &triangles(), capacity);
        println!("side {side}: {:?}", senders.counts);
        assert!(senders.counts.pieces < 6000, "{:?}", senders.counts);
        // All rays but those that leave between the two, within 3 / side of the horizon.
        let (escaped, rays) = escaped(&shot, &senders, &settings(36));
        let odd = compare("", &shot, &senders, &settings(36), Sampling::Uniform);
        println!("side {side}: {escaped} of {rays} escape, {odd} differ");
        assert!(odd <= ODD_RAYS, "side {side}: {odd}");
        assert!(
            escaped as f64 <= (ODD_RAYS + 6.0 / side) * rays as f64,
            "side {side}: {escaped} of {rays}"
        );
    }
}

/// Nor where pixels look right into the edges of a room: a position there is rounded to behind one of the two walls as often
/// as not.
#[test]
fn no_ray_escapes_at_an_edge() {
    let corner =
        |i: u32| DVec3::from([i, i >> 1, i >> 2].map(|bit| f64::from(bit & 1) * 2.0 - 1.0));
    let quads = [
        [0, 1, 3, 2],
        [4, 6, 7, 5],
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 5, 7, 3],
    ];
    let mut rays = 0;
    for (scale, shift) in [(2.75, DVec3::ZERO), (0.37, DVec3::new(0.1, 20.3, -7.7))] {
        let at = |i: u32| corner(i) * scale + shift;
        let walls: Vec<[DVec3; 3]> = quads
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]].map(|t| t.map(at)))
            .collect();
        let scene = scene_of(&walls, &scenes::closed_room());
        for step in 0..6 {
            // The diagonals of the picture are edges of the cube.
            let eye = shift - DVec3::Z * scale * (0.97 - 0.31 * f64::from(step));
            let camera = Camera::look_at(
                eye,
                eye + DVec3::Z,
                DVec3::Y,
                perspective(110.0 - f64::from(step), 1.0, 0.01 * scale),
                Viewport::full(32, 32),
            )
            .expect("a camera");
            let shot = Shot::new(lab().gpu, &scene, &camera);
            let senders = senders_of(&shot, &triangles());
            let (escaped, all) = escaped(&shot, &senders, &settings(16));
            println!("scale {scale}, step {step}: {escaped} of {all}");
            assert_eq!(escaped, 0, "scale {scale}, step {step}, of {all}");
            rays += all;
        }
    }
    assert!(rays > 0);
}

/// What a convex body's own surface hides from it: nothing. The facets of a sphere lie below each other's planes, so a
/// ray about the facet's own normal meets none.
#[test]
fn convex_bodies_do_not_hit_themselves() {
    let base = scenes::cornell();
    let ball = |rings: u32| {
        let at = |side: u32, ring: u32| {
            let (sin, cos) = (PI * f64::from(ring) / f64::from(rings)).sin_cos();
            let around = DVec2::from_angle(PI * f64::from(side) / f64::from(rings)) * sin;
            DVec3::new(around.x, cos, around.y)
        };
        let mut faces = Vec::new();
        for ring in 0..rings {
            for side in 0..2 * rings {
                let [a, b] = [at(side, ring), at(side + 1, ring)];
                let [c, d] = [at(side + 1, ring + 1), at(side, ring + 1)];
                if ring > 0 {
                    faces.push([a, b, c]);
                }
                if ring + 1 < rings {
                    faces.push([a, c, d]);
                }
            }
        }
        faces
    };
    for distance in [2.0, 40.0] {
        let camera = Camera::look_at(
            DVec3::new(0.6, 0.7, 0.4).normalize() * distance,
            DVec3::ZERO,
            DVec3::Y,
            perspective(2.0 * (1.1 / distance).atan().to_degrees(), 1.0, 0.1),
            Viewport::full(48, 48),
        )
        .expect("a camera");
        let scene = scene_of(&ball(48), &base);
        let shot = Shot::new(lab().gpu, &scene, &camera);
        let senders = senders_of(&shot, &triangles());
        let (open, rays) = escaped(&shot, &senders, &settings(16));
        let blocked = rays - open;
        println!("at {distance}: {blocked} of {rays} rays met the ball they left");
        // Where two facets meet, a ray that leaves one within the rounding of positions (1e-6 of the distance to the eye,
        // on each side of each of three edges 0.065 long) may meet the other, which is grown by as much. Grazing ones do.
        let rounding = 3.0 * 2e-6 * distance / 0.065;
        assert!(
            (blocked as f64) < (1e-4 + 4.0 * rounding) * rays as f64,
            "at {distance}: {blocked} of {rays}"
        );
    }
}

/// Two boxes that touch, and quads in one plane that overlap: rays see what the ray tracer sees.
#[test]
fn touching_and_coplanar_surfaces() {
    let base = scenes::cornell();
    let quad = |corner: DVec3, u: DVec3, v: DVec3| {
        [
            [corner, corner + u, corner + u + v],
            [corner, corner + u + v, corner + v],
        ]
    };
    let block = |low: DVec3, size: DVec3| -> Vec<[DVec3; 3]> {
        let [x, y, z] = [DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z];
        let high = low + size;
        [
            quad(low, x, z),
            quad(low, y, x),
            quad(low, z, y),
            quad(high, -z, -x),
            quad(high, -x, -y),
            quad(high, -y, -z),
        ]
        .concat()
    };
    let one = DVec3::ONE;
    let floor = quad(DVec3::new(-4.0, 0.0, -4.0), DVec3::Z * 8.0, DVec3::X * 8.0);
    let boxes = [
        floor.to_vec(),
        block(DVec3::ZERO, one),
        block(DVec3::X, one),
    ]
    .concat();
    let overlapping = [
        floor.to_vec(),
        quad(DVec3::new(-1.0, 0.0, -1.0), DVec3::Z * 3.0, DVec3::X * 2.0).to_vec(),
        quad(DVec3::new(-2.0, 0.0, 0.3), DVec3::X * 3.0, DVec3::Z * 0.7).to_vec(),
    ]
    .concat();
    for (name, faces) in [("boxes", boxes), ("quads", overlapping)] {
        let scene = scene_of(&faces, &base);
        let camera = Camera::look_at(
            DVec3::new(3.0, 2.5, 4.0),
            DVec3::new(0.7, 0.3, 0.3),
            DVec3::Y,
            perspective(50.0, 1.0, 0.1),
            Viewport::full(40, 40),
        )
        .expect("a camera");
        let shot = Shot::new(lab().gpu, &scene, &camera);
        let senders = senders_of(&shot, &triangles());
        let odd = compare(name, &shot, &senders, &settings(16), Sampling::Cosine);
        assert!(odd <= ODD_RAYS, "{name}: {odd}");
        let (open, rays) = escaped(&shot, &senders, &settings(16));
        if name == "quads" {
            // All lie in one plane, and nothing above it. A direction whose cosine is 0 to rounding may meet it.
            assert!(rays - open <= rays / 4000, "{name}: {open} of {rays}");
        }
        // Against the tracer's own rays: the share that is open.
        let receivers: Vec<_> = shot.pixels.iter().map(|p| p.map(|p| p.receiver)).collect();
        let lab = lab();
        let view = lab.trace(&shot, &senders, None, &settings(16), Sampling::Cosine);
        let blocked: u32 = lab
            .blocked(&view, &settings(16))
            .iter()
            .map(|word| word.count_ones())
            .sum();
        let mean = 1.0 - f64::from(blocked) / rays as f64;
        let truth = shot
            .tracer
            .ambient_occlusion_image(&receivers, f64::INFINITY, 64, 5, false);
        let seen: Vec<_> = truth.iter().flatten().collect();
        let expected = seen.iter().map(|e| e.mean).sum::<f64>() / seen.len() as f64;
        println!("{name}: {mean} open, {expected} traced");
        // 25 000 rays that are stratified: at most 0.5 / 158 if they were not.
        assert!((mean - expected).abs() < 2e-3, "{name}: {mean}, {expected}");
    }
}

#[test]
fn statistics_count() {
    let lab = lab();
    let scene = scenes::dominoes();
    let shot = shot_of(&scene, 0, [24, 24]);
    let senders = senders_of(&shot, &triangles());
    let descriptor = BouncedDescriptor {
        statistics: true,
        ..BouncedDescriptor::default()
    };
    let device = &lab.gpu.device;
    let tracer = pipelines::bounced(&descriptor);
    let view = tracer.create_view(device, 24, 24, 16).expect("a view");
    // Twice: each recording counts for itself.
    for _ in 0..2 {
        let mut encoder = lab.gpu.encoder();
        let mut decoded = Decoded::of(&shot.camera);
        let origin = senders.cloud.origin();
        let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, origin);
        let input = BouncedInput::new(&frame, &senders.cloud, &senders.bounds);
        tracer
            .record(device, &mut encoder, &input, &settings(16), &view)
            .expect("hits");
        lab.gpu.finish(encoder);
    }
    let counts: Vec<u32> = lab.gpu.read_buffer(view.statistics().expect("asked for"));
    let blocked: u32 = lab
        .blocked(&view, &settings(16))
        .iter()
        .map(|word| word.count_ones())
        .sum();
    let rays = 16 * shot.pixels.iter().flatten().count() as u32;
    println!("{counts:?}");
    assert_eq!((counts[0], counts[3]), (rays, blocked));
    // A ray that hits met one run of triangles at least, and bounds spare nearly all.
    assert!(counts[2] >= blocked && counts[1] >= rays);
    assert!(
        counts[2] < rays * senders.counts.pieces / 4 / 4,
        "{counts:?}"
    );
}

/// A sampler's points fall into cells of the hemisphere as its density says: chi-square, and the density's integral.
#[test]
fn directions_have_their_density() {
    let normal = DVec3::new(0.3, -0.5, 0.81).normalize();
    let frame = tangent_frame(normal);
    for sampling in SAMPLINGS {
        // Cells of equal height and azimuth. A pixel a block: points of one block depend on each other.
        let (rings, sides) = (8, 16);
        let mut counts = vec![0_u32; rings * sides];
        let mut total = 0;
        for block in 0..6400 {
            for index in 0..5 {
                for part in 0..2 {
                    let corner = [block % 80 * 16, block / 80 * 16];
                    let pixel = [corner[0] + block % 16, corner[1] + block / 16 % 16];
                    let point = cell_point(pixel, index, [5, 1], part * (1 + block));
                    let drawn = hemisphere_direction(point, normal, sampling);
                    let local = frame.transpose() * drawn.direction;
                    assert!((drawn.direction.length() - 1.0).abs() < 1e-12);
                    assert!(local.z >= -1e-12, "{sampling:?}: {local}");
                    let expected = match sampling {
                        Sampling::Uniform => 0.5 / PI,
                        _ => local.z / PI,
                    };
                    assert!(
                        (drawn.pdf - expected).abs() < 1e-9,
                        "{sampling:?}: {drawn:?}"
                    );
                    let ring = ((local.z * rings as f64) as usize).min(rings - 1);
                    let turn = local.y.atan2(local.x) / (2.0 * PI) + 0.5;
                    let side = ((turn * sides as f64) as usize).min(sides - 1);
                    counts[ring * sides + side] += 1;
                    total += 1;
                }
            }
        }
        let mut chi2 = 0.0;
        let mut integral = 0.0;
        for (cell, &count) in counts.iter().enumerate() {
            let low = (cell / sides) as f64 / rings as f64;
            let high = low + 1.0 / rings as f64;
            let share = match sampling {
                Sampling::Uniform => high - low,
                _ => high * high - low * low,
            } / sides as f64;
            integral += share;
            let expected = share * f64::from(total);
            chi2 += (f64::from(count) - expected).powi(2) / expected;
        }
        println!("{sampling:?}: chi-square {chi2} of {} cells", counts.len());
        assert!((integral - 1.0).abs() < 1e-12);
        // 127 degrees of freedom: mean 127, deviation 16. The five cells make the points more even, if anything.
        assert!(chi2 < 127.0 + 4.0 * 16.0, "{sampling:?}: {chi2}");
    }
    // The integral of the densities over directions, with the other sampler's points: 1.
    let points = 4096;
    let mean: f64 = (0..points)
        .map(|i| {
            let p = [i % 16, i / 16 % 16];
            let drawn =
                hemisphere_direction(cell_point(p, 0, [1, 1], i / 256), normal, Sampling::Uniform);
            normal.dot(drawn.direction) / PI / drawn.pdf
        })
        .sum::<f64>()
        / f64::from(points);
    // Sixteen nets of 256 points, independent of each other; measured at 1e-3.
    assert!((mean - 1.0).abs() < 5e-3, "{mean}");
}

/// The concentric map keeps areas and order, and reaches the rim.
#[test]
fn disk_keeps_areas() {
    assert_eq!(concentric_disk(DVec2::splat(0.5)), DVec2::ZERO);
    let n = 200;
    let mut inner = 0;
    for i in 0..n * n {
        let cell = DVec2::new(f64::from(i % n) + 0.5, f64::from(i / n) + 0.5) / f64::from(n);
        let p = concentric_disk(cell);
        assert!(p.length() < 1.0, "{cell}");
        inner += i32::from(p.length_squared() < 0.25);
    }
    let share = f64::from(inner) / f64::from(n * n);
    assert!((share - 0.25).abs() < 0.002, "{share}");
    for edge in [0.0, 0.3, 1.0] {
        for p in [DVec2::new(edge, 0.0), DVec2::new(1.0, edge)] {
            assert!((concentric_disk(p).length() - 1.0).abs() < 1e-12, "{p}");
        }
    }
    for n in [DVec3::X, DVec3::NEG_Z, DVec3::new(0.6, 0.0, -0.8), DVec3::Z] {
        let frame = tangent_frame(n);
        assert!((frame.determinant() - 1.0).abs() < 1e-12, "{n}");
        let unit = frame.transpose() * frame;
        assert!(
            unit.abs_diff_eq(deep_screen_space::glam::DMat3::IDENTITY, 1e-12),
            "{n}"
        );
    }
}

/// The point of a pixel within its cell of 2 x 2.
fn within_cell(pixel: [u32; 2], index: u32, frame: u32) -> DVec2 {
    let cell = DVec2::new(f64::from(index % 2), f64::from(index / 2));
    cell_point(pixel, index, [2, 2], frame) * 2.0 - cell
}

/// How many points more or fewer than its area says any rectangle has that ends at eighths of the square.
fn unevenness(points: &[DVec2]) -> f64 {
    let edges = || (0..=8).map(|i| f64::from(i) / 8.0);
    let mut worst = 0.0_f64;
    for (left, right) in edges().flat_map(|l| edges().map(move |r| (l, r))) {
        for (low, high) in edges().flat_map(|l| edges().map(move |h| (l, h))) {
            let area = (right - left).max(0.0) * (high - low).max(0.0);
            let inside = |p: &&DVec2| (left..right).contains(&p.x) && (low..high).contains(&p.y);
            let found = points.iter().filter(inside).count() as f64;
            worst = worst.max((found - points.len() as f64 * area).abs());
        }
    }
    worst
}

/// Of any window of pixels the points within a cell lie evenly, wherever it is and in any frame.
#[test]
fn windows_of_pixels_are_stratified() {
    for [width, height] in [[5_u32, 5], [9, 9], [16, 16], [3, 40], [40, 1]] {
        let (mut even, mut random) = (0.0_f64, 0.0_f64);
        for (corner, frame) in [([0, 0], 0), ([333, 18], 1), ([4097, 2050], 1 << 20)] {
            for index in 0..4 {
                let of_pixels = |point: &dyn Fn([u32; 2]) -> DVec2| -> Vec<DVec2> {
                    (0..width * height)
                        .map(|i| point([corner[0] + i % width, corner[1] + i / width]))
                        .collect()
                };
                let points = of_pixels(&|pixel| within_cell(pixel, index, frame));
                even = even.max(unevenness(&points));
                let drawn = |pixel: [u32; 2], axis| {
                    unit_float(hash2(pixel[0] ^ (pixel[1] << 16), 2 * index + axis))
                };
                let points = of_pixels(&|pixel| DVec2::new(drawn(pixel, 0), drawn(pixel, 1)));
                random = random.max(unevenness(&points));
            }
        }
        println!("{width} x {height}: {even:.1} points off, random ones {random:.1}");
        // Measured at 0.31 to 0.52.
        assert!(
            even < 0.7 * random,
            "{width} x {height}: {even}, random {random}"
        );
    }
}

/// Of one pixel and cell, the points of 2^k frames in a row from a multiple of 2^k are one in each of 2^k subcells of every
/// shape, which lie where those of the first pixel do, moved by what does not depend on the frame.
#[test]
fn frames_are_stratified() {
    for count in [2_u32, 4, 8, 16, 64, 256] {
        for (pixel, index) in [([0, 0], 0), ([7, 12], 1), ([333, 18], 3)] {
            let moved = within_cell(pixel, index, 0) - within_cell([0, 0], index, 0);
            for start in [0, 5 * count, (1 << 20) - count] {
                for columns in (0..=count.ilog2()).map(|power| 1_u32 << power) {
                    let rows = count / columns;
                    let mut taken = vec![false; count as usize];
                    for frame in start..start + count {
                        // Twice the rounding of a coordinate, 2^-24, so that none falls below where it was.
                        let within = within_cell(pixel, index, frame) - moved + 2e-7;
                        let within = within - within.floor();
                        let x = (within.x * f64::from(columns)) as u32;
                        let y = (within.y * f64::from(rows)) as u32;
                        let at = (y * columns + x) as usize;
                        assert!(
                            !taken[at],
                            "{count} frames from {start}, pixel {pixel:?}, cell {index}: two points in {columns}x{rows}"
                        );
                        taken[at] = true;
                    }
                }
            }
        }
    }
}

/// One pixel's points over frames fill its cells evenly: chi-square over 8 x 8 subcells.
#[test]
fn frames_fill_the_cells() {
    for (pixel, index) in [([0, 0], 0), ([7, 12], 1), ([333, 18], 3)] {
        let mut counts = [0_u32; 64];
        let frames = 6400;
        for frame in 0..frames {
            let within = within_cell(pixel, index, frame);
            let [x, y] = [within.x, within.y].map(|v| ((v * 8.0) as usize).min(7));
            counts[y * 8 + x] += 1;
        }
        let expected = f64::from(frames) / 64.0;
        let chi2: f64 = counts
            .iter()
            .map(|&count| (f64::from(count) - expected).powi(2) / expected)
            .sum();
        println!("pixel {pixel:?}, cell {index}: chi-square {chi2}");
        // 63 degrees of freedom: mean 63, deviation 11.2.
        assert!(
            chi2 < 63.0 + 4.0 * 11.2,
            "pixel {pixel:?}, cell {index}: {chi2}"
        );
    }
}

/// Every leaf of a piece contains the points that are said to be in it.
#[test]
fn leaves_are_found() {
    let piece = Triangle {
        a: DVec3::new(0.1, 2.0, -3.0),
        b: DVec3::new(1.7, 1.1, -2.0),
        c: DVec3::new(0.4, 0.3, -1.2),
    };
    for order in [0, 1, 2, 5, 10] {
        for leaf in 0..1 << order {
            let t = leaf_of(piece, leaf, order);
            for share in [
                DVec3::splat(1.0 / 3.0),
                DVec3::new(0.9, 0.05, 0.05),
                DVec3::new(0.02, 0.9, 0.08),
            ] {
                let point = t.a * share.x + t.b * share.y + t.c * share.z;
                assert_eq!(leaf_at(piece, point, order), leaf, "order {order}, {share}");
            }
        }
    }
}

#[test]
fn colors_survive_packing() {
    for (color, tolerance) in [
        ([0.0; 3], 0.0),
        ([1.0, 0.5, 0.25], 0.0),
        ([1e18, 3e17, 1.0], 1.0 / 255.0),
        ([0.999_999, 0.1, 0.7], 1.0 / 255.0),
        ([255.5, 127.0, 3.0], 1.0 / 255.0),
        ([1e-20, 3e-20, 2e-21], 1.0 / 255.0),
        ([1e30; 3], 1.0 / 255.0),
    ] {
        let back = unpack_color(pack_color(color));
        let expected = DVec3::from(color.map(f64::from));
        let off = (back - expected).abs().max_element();
        let bound = tolerance * expected.max_element();
        assert!(off <= bound, "{color:?}: {back}");
    }
    assert_eq!(pack_color([f32::NAN, 0.0, 0.0]), 0);
    assert_eq!(pack_color([-1.0, -0.0, 0.0]), 0);
    assert_eq!(
        pack_color([f32::INFINITY, 0.0, 0.0]),
        pack_color([1e30, 0.0, 0.0])
    );
}

#[test]
fn settings_out_of_range_are_typed_errors() {
    let good = BouncedSettings::default();
    assert_eq!(good.validate(), Ok(()));
    for good in [
        BouncedSettings {
            rays_per_pixel: 0,
            ..good
        },
        BouncedSettings {
            rays_per_pixel: 64,
            ..good
        },
        BouncedSettings {
            radius: 0.0,
            ..good
        },
        BouncedSettings {
            frame: 1 << 20,
            ..good
        },
        BouncedSettings {
            sky_radiance: [0.0, 1.0, 1e18],
            ..good
        },
    ] {
        assert_eq!(good.validate(), Ok(()), "{good:?}");
    }
    let bad = [
        (
            BouncedSettings {
                rays_per_pixel: 65,
                ..good
            },
            "BouncedSettings::rays_per_pixel",
        ),
        (
            BouncedSettings {
                radius: -0.1,
                ..good
            },
            "BouncedSettings::radius",
        ),
        (
            BouncedSettings {
                radius: f32::NAN,
                ..good
            },
            "BouncedSettings::radius",
        ),
        (
            BouncedSettings {
                frame: (1 << 20) + 1,
                ..good
            },
            "BouncedSettings::frame",
        ),
        (
            BouncedSettings {
                sky_radiance: [0.0, -1.0, 0.0],
                ..good
            },
            "BouncedSettings::sky_radiance",
        ),
        (
            BouncedSettings {
                sky_radiance: [0.0, 0.0, f32::NAN],
                ..good
            },
            "BouncedSettings::sky_radiance",
        ),
        (
            BouncedSettings {
                sky_radiance: [2e18, 0.0, 0.0],
                ..good
            },
            "BouncedSettings::sky_radiance",
        ),
    ];
    fields_refused(bad, BouncedSettings::validate);
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let lab = lab();
    let device = &lab.gpu.device;
    let scene = scenes::cornell();
    let shot = shot_of(&scene, 0, [16, 8]);
    let senders = senders_of(&shot, &triangles());
    let small = CloudCapacity {
        surfels: 16,
        pieces: 64,
        triangles: 1 << 12,
    };
    let other = lab.senders(&[], &shot.camera, &triangles(), small);
    let tracer = lab.tracer(Payload::Radiance, Sampling::Cosine);
    let (radiance, _) = lab.motley(&senders);
    let view = lab.view(&shot, Payload::Radiance, Sampling::Cosine, 4);
    let mut encoder = lab.gpu.encoder();
    let mut decoded = Decoded::of(&shot.camera);
    let origin = senders.cloud.origin();
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, origin);
    let input = BouncedInput {
        radiance: HitRadiance::Surfels(&radiance),
        ..BouncedInput::new(&frame, &senders.cloud, &senders.bounds)
    };
    let record = |input: &BouncedInput<'_>, settings: &BouncedSettings, view: &BouncedView| {
        tracer.record(device, &mut lab.gpu.encoder(), input, settings, view)
    };
    let named = |result: Result<(), Error>| match result {
        Err(
            Error::Mismatch { name, .. }
            | Error::Buffer { name, .. }
            | Error::Size { name, .. }
            | Error::Format { name, .. }
            | Error::Setting { field: name, .. },
        ) => name,
        other => panic!("{other:?}"),
    };
    assert_eq!(record(&input, &settings(4), &view), Ok(()));
    assert_eq!(record(&input, &settings(0), &view), Ok(()));

    // Settings and views.
    assert_eq!(
        named(record(&input, &settings(65), &view)),
        "BouncedSettings::rays_per_pixel"
    );
    assert_eq!(named(record(&input, &settings(5), &view)), "BouncedView");
    for view in [
        tracer.create_view(device, 15, 8, 4).expect("a view"),
        lab.view(&shot, Payload::Occlusion, Sampling::Cosine, 4),
        lab.view(&shot, Payload::Radiance, Sampling::Uniform, 4),
    ] {
        assert_eq!(named(record(&input, &settings(4), &view)), "BouncedView");
    }
    for (width, height, rays_per_pixel, field) in [
        (16, 8, 65, "rays_per_pixel"),
        (0, 8, 4, "view size"),
        (16, 0, 4, "view size"),
    ] {
        for payload in [Payload::Occlusion, Payload::Radiance] {
            let made = lab.tracer(payload, Sampling::Cosine).create_view(
                device,
                width,
                height,
                rays_per_pixel,
            );
            assert_eq!(
                named(made.map(|_| ())),
                field,
                "{width}x{height} {payload:?}"
            );
        }
    }
    let limit = device.limits().max_texture_dimension_2d;
    assert!(matches!(
        tracer.create_view(device, limit + 1, 8, 4),
        Err(Error::Limit { .. })
    ));
    // Bits of more pixels than one binding holds.
    let occlusion = lab.tracer(Payload::Occlusion, Sampling::Cosine);
    if device.limits().max_storage_buffer_binding_size < 8 * u64::from(limit).pow(2) {
        assert!(matches!(
            occlusion.create_view(device, limit, limit, 64),
            Err(Error::Limit { .. })
        ));
    }

    // Bounds, and what they are recorded for.
    let bad = BouncedInput {
        bvh: &other.bounds,
        ..input
    };
    assert_eq!(named(record(&bad, &settings(4), &view)), "Bvh");
    let mut encoder = lab.gpu.encoder();
    let wrong = pipelines::bvh_builder(Primitives::Triangles).record(
        device,
        &mut encoder,
        &senders.cloud,
        &other.bounds,
        None,
    );
    assert_eq!(named(wrong), "Bvh");

    // Radiance.
    let capacity = u64::from(senders.cloud.capacity().surfels);
    let buffer = |bytes: u64, usage| {
        device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes,
            usage,
            mapped_at_creation: false,
        })
    };
    let needed = capacity * size_of::<SurfelRadiance>() as u64;
    let [short, unbound] = [
        buffer(needed - 4, wgpu::BufferUsages::STORAGE),
        buffer(needed, wgpu::BufferUsages::VERTEX),
    ];
    let materials = &shot.buffers.materials;
    let lit = HitLighting {
        materials,
        lights: &[],
    };
    for (radiance, name) in [
        (HitRadiance::None, "BouncedInput::radiance"),
        (HitRadiance::Lit(lit), "BouncedInput::radiance"),
        (HitRadiance::Surfels(&short), "HitRadiance::Surfels"),
        (HitRadiance::Surfels(&unbound), "HitRadiance::Surfels"),
    ] {
        let bad = BouncedInput { radiance, ..input };
        assert_eq!(named(record(&bad, &settings(4), &view)), name);
    }
    for placement in [Placement::Grid, Placement::Random] {
        let mut senders = senders_of(&shot, &triangles());
        let cloud = SurfelizerSettings {
            placement,
            ..triangles()
        };
        lab.record_senders(&mut senders, &shot.buffers.meshes(), &shot.camera, &cloud);
        let bad = BouncedInput {
            cloud: &senders.cloud,
            bvh: &senders.bounds,
            ..input
        };
        assert_eq!(
            named(record(&bad, &settings(4), &view)),
            "SurfelizerSettings::placement"
        );
        // For occlusion pieces are enough.
        let view = lab.view(&shot, Payload::Occlusion, Sampling::Cosine, 4);
        let mut encoder = lab.gpu.encoder();
        assert_eq!(
            occlusion.record(device, &mut encoder, &bad, &settings(4), &view),
            Ok(())
        );
    }

    // The frame: of another size, relative to another point than the cloud, and its G-buffer.
    let narrow = shot_of(&scene, 0, [8, 8]);
    let mut other = Decoded::of(&narrow.camera);
    let wrong = other.record(&mut encoder, shot.gbuffer(), &shot.camera, origin);
    assert_eq!(named(wrong.map(|_| ())), "Receivers");
    let frame = other.frame(&mut encoder, narrow.gbuffer(), &narrow.camera, origin);
    let bad = BouncedInput {
        frame: &frame,
        ..input
    };
    assert_eq!(named(record(&bad, &settings(4), &view)), "BouncedView");
    let mut other = Decoded::of(&shot.camera);
    let aside = origin + DVec3::X;
    let frame = other.frame(&mut encoder, shot.gbuffer(), &shot.camera, aside);
    let bad = BouncedInput {
        frame: &frame,
        ..input
    };
    assert_eq!(
        named(record(&bad, &settings(4), &view)),
        "FrameInput::origin"
    );
    let wrong = other.record(&mut encoder, narrow.gbuffer(), &shot.camera, origin);
    assert_eq!(named(wrong.map(|_| ())), "GBuffer::depth");
    for aside in [f64::NAN, 1e30] {
        let wrong = other.record(&mut encoder, shot.gbuffer(), &shot.camera, DVec3::X * aside);
        assert_eq!(named(wrong.map(|_| ())), "FrameInput::origin");
    }

    // A scene is not traced from times that begin where they end.
    if device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
        let set = device.create_query_set(&wgpu::QuerySetDescriptor {
            label: None,
            ty: wgpu::QueryType::Timestamp,
            count: 2,
        });
        let timestamps = Some(Timestamps {
            set: &set,
            begin: 1,
            end: 1,
        });
        let bad = BouncedInput {
            timestamps,
            ..input
        };
        assert_eq!(named(record(&bad, &settings(4), &view)), "Timestamps::end");
        let mut encoder = lab.gpu.encoder();
        let wrong = pipelines::bvh_builder(Primitives::Triangles).record(
            device,
            &mut encoder,
            &senders.cloud,
            &senders.bounds,
            timestamps,
        );
        assert_eq!(named(wrong), "Timestamps::end");
    }
}

/// A device that was not made for rays of its own refuses them by the name of what it lacks.
#[test]
fn ray_queries_need_a_device_for_them() {
    let device = &lab().gpu.device;
    let primitives = Primitives::RayQuery;
    let descriptor = BouncedDescriptor {
        primitives,
        ..BouncedDescriptor::default()
    };
    for refused in [
        BvhBuilder::new(device, primitives).err(),
        BouncedZBuffer::new(device, &descriptor).err(),
        RayTracedScene::with_primitives(device, primitives).err(),
    ] {
        assert!(
            matches!(
                refused,
                Some(Error::Feature { feature, why: "Primitives::RayQuery" })
                    if feature == wgpu::Features::EXPERIMENTAL_RAY_QUERY
            ),
            "{refused:?}"
        );
    }
}

//! No ray passes through what is closed, and none is held up by what it starts from.

use std::f64::consts::PI;

use deep_screen_space::{
    BouncedSettings, Camera, CloudCapacity, Sampling, SurfelizerSettings, Viewport,
    glam::{DMat4, DVec2, DVec3},
    scenes,
};

use support::{
    raster::perspective,
    testing::{
        rays::{self, AMPLE, lab, moved, scene_of, triangles},
        shot::{Shot, camera_of},
    },
};

use super::harness::{ODD_RAYS, compare, senders_of, settings};

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
        let receivers = shot.traced();
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

//! GPU and mirror, of every kind of camera, and where there is little or nothing to hit.

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, BouncedView, Camera, CloudCapacity, Sampling,
    SurfelizerSettings, Viewport,
    glam::{DMat4, DVec3, DVec4},
    reference::{
        bounced_z_buffer::{Senders, Tracing},
        packing::{pack_color, unpack_color},
    },
    scenes, wgpu,
};

use support::{
    raster::perspective,
    scene::SceneBuffers,
    testing::{
        frames::Decoded,
        pipelines,
        rays::{self, AMPLE, lab, scene_of, triangles},
        shot::Shot,
    },
};

use super::harness::{NEARNESS_OFF, ODD_RAYS, SAMPLINGS, compare, senders_of, settings, shot_of};

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

//! Every pass that measures by the camera, with near planes that are oblique and with eyes that are far away: what it shows is
//! what it shows with an ordinary camera that sees the same.

use std::sync::LazyLock;
use support::testing::pipelines;

use deep_screen_space::{
    AmbientOcclusion, BouncedSettings, Camera, Channels, Components, DiskSamples, Error, Gatherer,
    Light, MultiResMask, MultiResMaskSettings, ObscuranceInput, ObscuranceSampling,
    ObscuranceSettings, ObscuranceVolume, Payload, Sampling, ScreenSpaceGi, ScreenSpaceGiInput,
    ScreenSpaceGiSettings, SgHull, SgHullDescriptor, SgHullInput, SgHullSettings, SgHullSize,
    ShadowMap, SoftShadows, SoftShadowsInput, SoftShadowsSettings, SplatSettings,
    TemporalAccumulator, TemporalInput, TemporalSettings, Viewport, VolumetricObscurance,
    VolumetricObscuranceDescriptor,
    glam::{DMat4, DVec3, DVec4, dcamera::rh::proj::directx as right},
    scenes,
    wgpu::TextureFormat as Format,
};
use support::testing::frames::Decoded;
use support::testing::multi_res;
use support::testing::multi_res::Frame;
use support::testing::rays::{AMPLE, lab, triangles};
use support::testing::shot::{Passes, Settings, Shot};

const SIZE: [u32; 2] = [44, 36];
const RAYS_PER_PIXEL: u32 = 32;
/// How far the eye is beside the room's middle: there, pixels would be on its very edges.
const ASIDE: f64 = 0.0137;
/// Now, before, and from the light.
const PLACES: [f64; 3] = [ASIDE, ASIDE + 0.03, ASIDE + 0.9];

struct All {
    splat: Passes,
    lines: VolumetricObscurance,
    areas: VolumetricObscurance,
    mask: &'static MultiResMask,
    gi: &'static ScreenSpaceGi,
    history: TemporalAccumulator,
    shadows: &'static SoftShadows,
    gatherer: Gatherer,
    hull: SgHull,
}

static ALL: LazyLock<All> = LazyLock::new(|| {
    let device = &lab().gpu.device;
    let obscurance = |sampling| {
        let descriptor = VolumetricObscuranceDescriptor {
            sampling,
            volume: ObscuranceVolume::Hemisphere,
        };
        VolumetricObscurance::new(device, &descriptor).expect("pipelines")
    };
    let gatherer = Gatherer::lights(device);
    let hull = SgHullDescriptor {
        gatherer: &gatherer,
        target: Format::Rgba32Float,
        albedo: false,
        glossy: false,
        components: Components::default(),
    };
    All {
        shadows: pipelines::soft_shadows(),
        hull: SgHull::new(device, &hull).expect("pipelines"),
        gatherer,
        splat: Passes::new(lab().gpu, AmbientOcclusion::default()),
        lines: obscurance(ObscuranceSampling::Lines(DiskSamples::Six)),
        areas: obscurance(ObscuranceSampling::OneArea),
        mask: pipelines::multi_res_mask(),
        gi: pipelines::screen_space_gi(),
        history: TemporalAccumulator::new(device, Channels::One, Format::R32Float)
            .expect("pipelines"),
    }
});

/// A picture a pass, rows from the top.
///
/// `before` is seen from a little beside, and `lamp` from the light of the soft shadows.
fn pictures([shot, before, lamp]: &[Shot; 3]) -> Vec<(&'static str, Vec<f32>)> {
    let gpu = &lab().gpu;
    let device = &gpu.device;
    let all = &*ALL;
    let camera = &shot.camera;
    let [width, height] = SIZE;
    let settings = BouncedSettings {
        rays_per_pixel: RAYS_PER_PIXEL,
        ..BouncedSettings::default()
    };
    let senders = lab().senders(&shot.buffers.meshes(), camera, &triangles(), AMPLE);
    let view = lab().trace(shot, &senders, None, &settings, Sampling::Cosine);
    let rays = lab()
        .blocked(&view, &settings)
        .iter()
        .map(|bits| 1.0 - bits.count_ones() as f32 / RAYS_PER_PIXEL as f32)
        .collect();
    let splat = SplatSettings {
        levels: 2,
        ..SplatSettings::default()
    };
    let (splat, counts) = all.splat.render(gpu, shot, &Settings::new(2.0, splat));
    assert_eq!(counts.overflow(), 0);

    let obscurance = |pass: &VolumetricObscurance, areas: bool| {
        let target = gpu.storage(Format::R32Float, width, height);
        let gbuffer = shot.gbuffer();
        let mut encoder = gpu.encoder();
        let moments = areas.then(|| {
            let moments = pass.create_moments(device, width, height).expect("moments");
            pass.record_moments(device, &mut encoder, gbuffer.depth, camera, &moments, None)
                .expect("moments");
            moments
        });
        let input = ObscuranceInput {
            depth: gbuffer.depth,
            normals: Some(gbuffer.normals()),
            camera,
            moments: moments.as_ref(),
            work: None,
            target: target.texture().into(),
            timestamps: None,
        };
        let settings = ObscuranceSettings {
            radius: 0.3,
            ..ObscuranceSettings::default()
        };
        pass.record(device, &mut encoder, &input, &settings)
            .expect("obscurance");
        gpu.finish(encoder);
        gpu.read_texture::<f32>(target.texture(), 0)
    };

    let frame = Frame::of_shot(gpu, shot);
    let masks = multi_res::record(
        gpu,
        all.mask,
        &frame.input(),
        &MultiResMaskSettings::OCCLUSION,
    );
    let mask = multi_res::read_mask(gpu, &masks, 0);

    let white = gpu.texture(
        Format::R32Float,
        width,
        height,
        &vec![1.0_f32; (width * height) as usize],
    );
    let lit = gpu.texture(
        Format::Rgba32Float,
        width,
        height,
        &vec![[1.0_f32; 4]; (width * height) as usize],
    );
    let target = gpu.storage(Format::Rgba16Float, width, height);
    let mut encoder = gpu.encoder();
    let input = ScreenSpaceGiInput {
        gbuffer: shot.gbuffer(),
        camera,
        lit: lit.texture().into(),
        work: None,
        target: target.texture().into(),
        timestamps: None,
    };
    let settings = ScreenSpaceGiSettings {
        radius: 1.0,
        ..ScreenSpaceGiSettings::default()
    };
    all.gi
        .record(device, &mut encoder, &input, &settings)
        .expect("light");
    gpu.finish(encoder);
    let gi = multi_res::read_image(gpu, &target)
        .iter()
        .map(|c| c.x as f32)
        .collect();

    let (back, middle) = sight();
    let light = if lamp.camera.is_perspective() {
        Light::Point {
            position: lamp.camera.eye(),
            intensity: [1.0; 3],
        }
    } else {
        Light::Directional {
            direction: -back,
            irradiance: [1.0; 3],
        }
    };
    let visible = gpu.storage(Format::R32Float, width, height);
    let input = SoftShadowsInput {
        gbuffer: shot.gbuffer(),
        camera,
        light: &light,
        map: ShadowMap::new(lamp.gbuffer().depth, std::slice::from_ref(&lamp.camera)),
        work: None,
        target: visible.texture().into(),
        timestamps: None,
    };
    let settings = SoftShadowsSettings {
        extent: 0.3,
        max_penumbra: 0.4,
        ..SoftShadowsSettings::default()
    };
    let mut encoder = gpu.encoder();
    all.shadows
        .record(device, &mut encoder, &input, &settings)
        .expect("shadows");
    let gathered = gpu.target(Format::Rgba32Float, width, height);
    let lights = [Light::Point {
        position: middle + DVec3::Y,
        intensity: [3.0; 3],
    }];
    let lights = all
        .gatherer
        .bind_lights(device, &lights, camera.focus())
        .expect("lights");
    let view = all
        .hull
        .create_view(device, SgHullSize::new(width, height))
        .expect("a view");
    let mut decoded = Decoded::of(camera);
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), camera, camera.focus());
    let input = SgHullInput::new(&frame, Some(&lights), gathered.texture());
    let settings = SgHullSettings::default();
    all.hull
        .record(device, &mut encoder, &input, &settings, &view)
        .expect("light");
    gpu.finish(encoder);
    let shadows = gpu.read_texture(visible.texture(), 0);
    let hull = gpu
        .read_texture::<[f32; 4]>(gathered.texture(), 0)
        .iter()
        .map(|texel| texel[0])
        .collect();

    // A black frame, then a white one from elsewhere: a half where the history stays, and 1 where it does not.
    let black = gpu.texture(
        Format::R32Float,
        width,
        height,
        &vec![0.0_f32; (width * height) as usize],
    );
    let mut history = all
        .history
        .create_history(device, width, height)
        .expect("a history");
    let target = gpu.target(Format::R32Float, width, height);
    for (shot, previous, picture) in [(before, before, &black), (shot, before, &white)] {
        let mut encoder = gpu.encoder();
        let camera = &shot.camera;
        let mut decoded = Decoded::of(camera);
        let frame = decoded.frame(&mut encoder, shot.gbuffer(), camera, camera.focus());
        let target = target.texture();
        let input = TemporalInput::new(&frame, &previous.camera, picture.texture(), target);
        let settings = TemporalSettings {
            clamping: 0.0,
            ..TemporalSettings::default()
        };
        all.history
            .record(device, &mut encoder, &input, &settings, &mut history)
            .expect("a frame");
        gpu.finish(encoder);
    }
    vec![
        ("rays", rays),
        ("splat", splat),
        ("lines", obscurance(&all.lines, false)),
        ("areas", obscurance(&all.areas, true)),
        ("mask", mask),
        ("light", gi),
        ("shadows", shadows),
        ("hull", hull),
        ("history", gpu.read_texture(target.texture(), 0)),
    ]
}

/// What may be off: by more than the first, the second share of the pixels; and the means by the third. Rays pass edges and
/// discontinuities of depth by roundings; a splat's clouds differ by their pieces; samples of the screen fall on the next
/// pixel; a mask is all or nothing.
fn accepted(pass: &str) -> (f32, f64, f64) {
    match pass {
        "rays" => (1.5 / RAYS_PER_PIXEL as f32, 0.005, 0.001),
        "splat" => (0.03, 0.02, 0.003),
        // The hull's irradiances are about 1.
        "lines" | "areas" | "hull" => (0.01, 0.02, 0.002),
        "mask" => (0.01, 0.03, 0.01),
        "light" => (0.01, 0.03, 0.002),
        // One look-up of a penumbra may pass the map's edges by a rounding.
        "shadows" => (0.09, 0.01, 0.003),
        _ => (0.01, 0.01, 0.005),
    }
}

fn compare(
    name: &str,
    found: &[(&'static str, Vec<f32>)],
    expected: &[(&'static str, Vec<f32>)],
    counts: &[bool],
    failures: &mut Vec<String>,
) {
    for ((pass, found), (_, expected)) in found.iter().zip(expected) {
        let (off, share, mean_off) = accepted(pass);
        let pairs: Vec<(f32, f32)> = found
            .iter()
            .zip(expected)
            .zip(counts)
            .filter_map(|((a, b), counts)| counts.then_some((*a, *b)))
            .collect();
        let n = pairs.len() as f64;
        let beyond = pairs
            .iter()
            .filter(|(a, b)| (a - b).abs() > off || a.is_nan())
            .count();
        let mean = pairs.iter().map(|(a, b)| f64::from(a - b)).sum::<f64>() / n;
        let line = format!("{name}, {pass}: {beyond} of {n} beyond {off}, mean off {mean:+.5}");
        println!("{line}");
        if beyond as f64 > share * n || mean.is_nan() || mean.abs() > mean_off {
            failures.push(line);
        }
    }
}

/// A projection with another near plane: what is before it, where `plane` of view space is 0 and greater beyond, is not seen
/// (Lengyel 2005, for depth of 0 to 1). `farthest` is a point that still is.
fn oblique(projection: DMat4, plane: DVec4, reversed: bool, farthest: DVec4) -> DMat4 {
    let last = projection.row(3);
    let scale = last.dot(farthest) / plane.dot(farthest);
    let forward = plane * scale;
    let z = if reversed { last - forward } else { forward };
    let mut rows = [0, 1, 2, 3].map(|i| projection.row(i));
    rows[2] = z;
    DMat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose()
}

fn room() -> scenes::Scene {
    scenes::cornell()
}

/// The direction from which the room is seen, and what is in its middle.
fn sight() -> (DVec3, DVec3) {
    let view = &room().views[0];
    let target = DVec3::from(view.target);
    ((DVec3::from(view.eye) - target).normalize(), target)
}

fn look(eye: DVec3, aside: f64, projection: DMat4) -> Result<Camera, Error> {
    let (back, _) = sight();
    let eye = eye + DVec3::Y.cross(back).normalize() * aside;
    let viewport = Viewport::full(SIZE[0], SIZE[1]);
    Camera::look_at(eye, eye - back, DVec3::Y, projection, viewport)
}

fn seen(shot: &Shot) -> Vec<bool> {
    shot.pixels.iter().map(Option::is_some).collect()
}

/// Where two cameras see the same. A plane may show what it cuts open.
fn seen_alike(a: &Shot, b: &Shot) -> Vec<bool> {
    (a.pixels.iter().zip(&b.pixels))
        .map(|pair| match pair {
            (Some(a), Some(b)) => a.receiver.position.distance(b.receiver.position) < 1e-6,
            _ => false,
        })
        .collect()
}

/// Planes that leave all of the room, but are tilted to all sides; so far that some lines of sight never meet them.
#[test]
fn oblique_near_planes_change_nothing() {
    let gpu = &lab().gpu;
    let scene = room();
    let (back, target) = sight();
    let distance = DVec3::from(scene.views[0].eye).distance(target);
    let eye = target + back * distance;
    let aspect = f64::from(SIZE[0]) / f64::from(SIZE[1]);
    let fov = scene.views[0].vertical_fov_degrees.to_radians();
    let ortho = |near, far| right::orthographic(-3.0, 3.0, -2.5, 2.5, near, far);
    let (near, far) = (0.05, 4.0 * distance);
    let mut failures = Vec::new();
    for (name, projection, reversed) in [
        (
            "reversed, infinite",
            right::perspective_infinite_reverse(fov, aspect, near),
            true,
        ),
        ("forward", right::perspective(fov, aspect, near, far), false),
        ("reversed", right::perspective(fov, aspect, far, near), true),
        ("forward orthographic", ortho(near, far), false),
        ("reversed orthographic", ortho(far, near), true),
    ] {
        let shots = |projection| {
            PLACES.map(|aside| Shot::new(gpu, &scene, &look(eye, aside, projection).expect(name)))
        };
        let ordinary = shots(projection);
        let expected = pictures(&ordinary);
        let plain = &ordinary[0];
        for (tilt, steps) in [(0.6, 4), (1.3, 3)] {
            for step in 0..steps {
                let angle = std::f64::consts::TAU * (f64::from(step) + 0.3) / f64::from(steps);
                let across = DVec3::new(angle.cos(), angle.sin(), 0.0);
                // Through a point on the middle line of sight, near the eye.
                let normal = across * f64::sin(tilt) - DVec3::Z * f64::cos(tilt);
                let through = -DVec3::Z * 0.4;
                let plane = normal.extend(-normal.dot(through));
                // The corner of the picture that is farthest along the plane's normal, or beyond.
                let corner = DVec3::new(normal.x.signum() * 2.0, normal.y.signum() * 2.0, -1.0);
                let farthest = (corner * far).extend(1.0);
                let tilted = oblique(projection, plane, reversed, farthest);
                let oblique = shots(tilted);
                let shot = &oblique[0];
                let name = format!("{name}, tilted by {tilt} to {angle:.1}");
                assert!(shot.camera.footprint().near.is_finite(), "{name}");
                let both = seen_alike(shot, plain);
                let left = both.iter().filter(|b| **b).count();
                let all = seen(plain).iter().filter(|b| **b).count();
                println!("{name}: {left} of {all} pixels are left");
                assert!(left > all / 5, "{name}: {left} of {all}");
                let found = pictures(&oblique);
                let lamps = [&oblique[2], &ordinary[2]];
                let count = |list: Vec<bool>| list.iter().filter(|b| **b).count();
                let alike = count(seen_alike(lamps[0], lamps[1]));
                let whole = left == all && lamps.map(|lamp| count(seen(lamp))) == [alike; 2];
                // Where the plane takes part of a picture, what reads neighbours, or the light's, reads less.
                let few = if whole { found.len() } else { 1 };
                compare(&name, &found[..few], &expected[..few], &both, &mut failures);
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// A near plane behind everything that is seen leaves nothing.
#[test]
fn a_near_plane_behind_the_picture_is_refused() {
    let projection = right::perspective_infinite_reverse(1.0, 1.0, 0.1);
    let behind = DVec4::new(0.0, 0.0, 1.0, -1.0);
    let farthest = DVec4::new(0.0, 0.0, -1.0, 0.0);
    for reversed in [false, true] {
        let bad = oblique(projection, behind, reversed, farthest);
        let made = look(DVec3::ZERO, 0.0, bad);
        assert!(
            matches!(made, Err(Error::Camera { field, .. }) if field == "projection"),
            "{made:?}"
        );
    }
}

/// Where an orthographic camera stands along its axis changes nothing.
#[test]
fn orthographic_eyes_may_be_anywhere() {
    let gpu = &lab().gpu;
    let scene = room();
    let (back, target) = sight();
    let mut failures = Vec::new();
    let shots = |distance: f64, reversed: bool| {
        PLACES.map(|aside| {
            let [near, far] = [distance - 8.0, distance + 8.0];
            let projection = if reversed {
                right::orthographic(-3.0, 3.0, -2.5, 2.5, far, near)
            } else {
                right::orthographic(-3.0, 3.0, -2.5, 2.5, near, far)
            };
            let camera = look(target + back * distance, aside, projection).expect("a camera");
            Shot::new(gpu, &scene, &camera)
        })
    };
    for reversed in [false, true] {
        let expected = pictures(&shots(10.0, reversed));
        for distance in [-10.0, 1e4, 1e5, 1e6] {
            let shots = shots(distance, reversed);
            let name = format!("{distance} away, reversed {reversed}");
            let found = pictures(&shots);
            compare(&name, &found, &expected, &seen(&shots[0]), &mut failures);
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// Rays of a camera against the tracer: bias, and the worst pixel.
fn ray_errors(shot: &Shot) -> (f64, f64) {
    let settings = BouncedSettings {
        rays_per_pixel: 64,
        ..BouncedSettings::default()
    };
    let senders = lab().senders(&shot.buffers.meshes(), &shot.camera, &triangles(), AMPLE);
    let view = lab().view(shot, Payload::Occlusion, Sampling::Cosine, 64);
    lab().trace_into(shot, &senders, None, &settings, Sampling::Cosine, &view);
    let bits = lab().blocked(&view, &settings);
    let receivers = shot.traced();
    let truth = shot
        .tracer
        .ambient_occlusion_image(&receivers, f64::INFINITY, 256, 1, false);
    let errors: Vec<f64> = truth
        .iter()
        .zip(bits.chunks(2))
        .filter_map(|(truth, bits)| {
            let blocked = bits[0].count_ones() + bits[1].count_ones();
            truth.map(|t| 1.0 - f64::from(blocked) / 64.0 - t.mean)
        })
        .collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    (mean, errors.iter().fold(0.0, |a, e| f64::max(a, e.abs())))
}

/// A telephoto's picture is as good as one from near: 64 directions per pixel have a standard error of 0.04 or less, 0.001 of the
/// mean; near and far planes enclose the room, or the focus is said and depth is reversed.
#[test]
fn narrow_views_from_afar_are_right() {
    let gpu = &lab().gpu;
    let scene = room();
    let (back, target) = sight();
    let aspect = f64::from(SIZE[0]) / f64::from(SIZE[1]);
    let mut failures = Vec::new();
    for distance in [12.0, 1e3, 1e4, 1e5] {
        let fov = 2.0 * f64::atan(2.5 / distance);
        let [near, far] = [distance - 8.0, distance + 8.0];
        for (name, projection, focus) in [
            ("forward", right::perspective(fov, aspect, near, far), false),
            (
                "reversed",
                right::perspective(fov, aspect, far, near),
                false,
            ),
            (
                "reversed, infinite",
                right::perspective_infinite_reverse(fov, aspect, near),
                false,
            ),
            (
                "loose, with a focus",
                right::perspective_infinite_reverse(fov, aspect, 0.5 * distance),
                true,
            ),
        ] {
            let mut camera = look(target + back * distance, ASIDE, projection).expect("a camera");
            if focus {
                camera = camera.with_focus(target).expect("a finite focus");
            }
            let (bias, worst) = ray_errors(&Shot::new(gpu, &scene, &camera));
            let line = format!("{name}, {distance} away: bias {bias:+.4}, worst {worst:.3}");
            println!("{line}");
            if bias.abs() > 0.004 || worst > 0.15 {
                failures.push(line);
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

//! Hits that are lit where they are (`Payload::LitRadiance`): against the mirror, and the picture against the tracer.

use std::{f64::consts::PI, sync::LazyLock};

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, BouncedView, BouncedZBuffer, Camera,
    CloudCapacity, Error, Frame, HitLighting, HitRadiance, Light, Payload, Primitives, Sampling,
    Viewport,
    glam::DVec3,
    reference::{bounced_z_buffer::Tracing, light::arrival, packing::unpack_color},
    scenes::{self, Scene},
    wgpu,
};
use support::raster::perspective;
use support::testing::frames::Decoded;
use support::testing::rays;
use support::testing::rays::{AMPLE, lab, lights, moved, relative, triangles};
use support::testing::shot::{Shot, camera_of};

/// A colour is packed into steps of 1/256 of its largest component at most; the rest is f32's rounding.
const OFF: f64 = 1.0 / 200.0;
/// Share of rays that may differ more: see `ODD_RAYS` of the bounced z-buffer, twice as many here for the shadow rays; and a
/// light's cosine near its horizon has lost its digits.
const FARTHER: f64 = 4e-3;

static LIT: LazyLock<BouncedZBuffer> =
    LazyLock::new(|| BouncedZBuffer::new(&lab().gpu.device, &descriptor()).expect("pipelines"));

fn descriptor() -> BouncedDescriptor {
    BouncedDescriptor {
        payload: Payload::LitRadiance,
        ..BouncedDescriptor::default()
    }
}

struct Case {
    shot: Shot,
    senders: rays::Senders,
    materials: wgpu::Buffer,
}

impl Case {
    fn new(scene: &Scene, camera: &Camera, capacity: CloudCapacity) -> Self {
        let lab = lab();
        let shot = Shot::new(lab.gpu, scene, camera);
        Self {
            senders: lab.senders(&shot.buffers.meshes(), camera, &triangles(), capacity),
            materials: lab
                .gpu
                .buffer(&scene.material_table(), wgpu::BufferUsages::STORAGE),
            shot,
        }
    }

    fn frame<'a>(
        &'a self,
        encoder: &mut wgpu::CommandEncoder,
        decoded: &'a mut Decoded<'_>,
    ) -> Frame<'a> {
        let (shot, origin) = (&self.shot, self.senders.cloud.origin());
        decoded.frame(encoder, shot.gbuffer(), &shot.camera, origin)
    }

    fn input<'a>(&'a self, frame: &'a Frame<'a>, lights: &'a [Light]) -> BouncedInput<'a> {
        BouncedInput {
            radiance: HitRadiance::Lit(HitLighting {
                materials: &self.materials,
                lights,
            }),
            ..BouncedInput::new(frame, &self.senders.cloud, &self.senders.bounds)
        }
    }

    fn trace(&self, lights: &[Light], settings: &BouncedSettings) -> BouncedView {
        let device = &lab().gpu.device;
        let [width, height] = {
            let viewport = self.shot.camera.viewport();
            [viewport.width, viewport.height]
        };
        let view = LIT
            .create_view(device, width, height, settings.rays_per_pixel)
            .expect("a view");
        let mut encoder = lab().gpu.encoder();
        let mut decoded = Decoded::of(&self.shot.camera);
        let frame = self.frame(&mut encoder, &mut decoded);
        let input = self.input(&frame, lights);
        LIT.record(device, &mut encoder, &input, settings, &view)
            .expect("hits");
        lab().gpu.finish(encoder);
        view
    }

    /// Compares all rays' colours with the mirror's.
    fn compare(&self, name: &str, scene: &Scene, lights: &[Light], settings: &BouncedSettings) {
        let found = lab().colors(&self.trace(lights, settings), settings);
        let origin = self.senders.cloud.origin();
        let receivers = self.shot.receivers(origin);
        let lights: Vec<Light> = lights.iter().map(|l| relative(l, origin)).collect();
        let expected = Tracing {
            receivers: &receivers,
            camera: &self.shot.camera,
            origin: self.senders.cloud.origin(),
            settings,
            sampling: Sampling::Cosine,
            pieces: &self.senders.pieces,
        }
        .lit(&scene.material_table(), &lights);
        assert_eq!(found.len(), expected.len(), "{name}");
        let mut farther = 0;
        let mut lit = 0;
        for (found, expected) in found.iter().zip(&expected) {
            let off = (unpack_color(*found) - *expected).abs().max_element();
            assert!(off.is_finite(), "{name}: {found:x}");
            farther += usize::from(off > OFF * expected.max_element());
            lit += usize::from(expected.max_element() > 0.0);
        }
        println!("{name}: {farther} of {} differ, {lit} lit", found.len());
        assert!(lit > 0, "{name}: all is dark");
        assert!(
            farther as f64 <= FARTHER * found.len() as f64,
            "{name}: {farther} of {} differ",
            found.len()
        );
    }
}

fn settings(rays_per_pixel: u32) -> BouncedSettings {
    BouncedSettings {
        rays_per_pixel,
        sky_radiance: [0.3, 0.2, 0.1],
        ..BouncedSettings::default()
    }
}

#[test]
fn light_is_the_mirrors() {
    for (scene, view, size) in [
        (scenes::cornell(), 0, [32, 32]),
        (scenes::closed_room(), 0, [31, 17]),
        (scenes::dominoes(), 0, [24, 24]),
    ] {
        let case = Case::new(&scene, &camera_of(&scene, view, size), AMPLE);
        let all = lights(&scene, 1.0, DVec3::ZERO);
        case.compare(scene.name, &scene, &all, &settings(5));
        case.compare(
            &format!("{} radius", scene.name),
            &scene,
            &all,
            &BouncedSettings {
                radius: 0.5,
                frame: 3,
                ..settings(4)
            },
        );
    }
}

/// Small, large and far away; and without room for a surfel, which this asks for none of.
#[test]
fn extremes_are_the_mirrors() {
    let base = scenes::cornell();
    for (scale, shift) in [
        (1e-4, DVec3::ZERO),
        (1e5, DVec3::ZERO),
        (1.0, DVec3::new(1e5, -2e4, 3e4)),
    ] {
        let scene = moved(&base, scale, shift);
        let without = CloudCapacity {
            surfels: 0,
            ..AMPLE
        };
        let case = Case::new(&scene, &camera_of(&scene, 0, [16, 16]), without);
        // A scene far away has lost the digits of its own shapes: the mirror has the same pieces.
        let name = format!("scale {scale} shift {shift}");
        let all = lights(&base, scale, shift);
        case.compare(&name, &scene, &all, &settings(4));
    }
    // Nothing shines but the surfaces themselves.
    let case = Case::new(&base, &camera_of(&base, 0, [16, 16]), AMPLE);
    case.compare("no lights", &base, &[], &settings(4));
    // The brightest that a light may be.
    let blinding = Light::Point {
        position: DVec3::new(0.1, 1.5, 0.0),
        intensity: [1e18; 3],
    };
    let view = case.trace(&[blinding], &settings(4));
    for color in lab().colors(&view, &settings(4)) {
        let color = unpack_color(color);
        assert!(color.is_finite() && color.min_element() >= 0.0, "{color}");
    }
}

/// Lamps on and near the surfaces of a hall that hides nothing from them, from near and from far: each hit has the light
/// that would reach it were there no shadows. 1 in 500 may lie beyond a corner by a rounding.
#[test]
fn lamps_on_surfaces_lose_no_light() {
    let scene = rays::hall(&scenes::cornell());
    let materials = scene.material_table();
    let albedo = DVec3::from(materials[0].albedo.map(f64::from));
    for (distance, vfov) in [(-2.0, 60.0), (1e3, 0.5), (1e4, 0.05)] {
        let viewport = Viewport::full(12, 9);
        let near = f64::max(distance - 10.0, 0.1);
        let eye = DVec3::new(0.0, 1.7, 20.0 + distance);
        let projection = perspective(vfov, 12.0 / 9.0, near);
        let camera = Camera::look_at(
            eye,
            DVec3::new(0.0, 3.0, 0.0),
            DVec3::Y,
            projection,
            viewport,
        )
        .expect("a camera");
        let case = Case::new(&scene, &camera, AMPLE);
        let origin = case.senders.cloud.origin();
        let receivers = case.shot.receivers(origin);
        let settings = BouncedSettings {
            rays_per_pixel: 16,
            ..BouncedSettings::default()
        };
        let tracing = Tracing {
            receivers: &receivers,
            camera: &case.shot.camera,
            origin,
            settings: &settings,
            sampling: Sampling::Cosine,
            pieces: &case.senders.pieces,
        };
        let rays = tracing.rays();
        let hits = tracing.hits();
        for lamp in rays::lamps() {
            let found = lab().colors(&case.trace(&[lamp], &settings), &settings);
            let near_light = relative(&lamp, origin);
            let (mut lit, mut dark) = (0, 0);
            for ((ray, hit), found) in rays.iter().zip(&hits).zip(&found) {
                let (Some(ray), Some(hit)) = (ray, hit) else {
                    continue;
                };
                let corners = case.senders.pieces[hit.piece].corners;
                let normal = (corners.b - corners.a)
                    .cross(corners.c - corners.a)
                    .normalize();
                let place = ray.origin + ray.direction * hit.t;
                let arrival = arrival(&near_light, place);
                let cosine = normal.dot(arrival.to_light) * -normal.dot(ray.direction).signum();
                // A lamp within some roundings of a surface's plane may be behind it.
                if cosine > 1e-3 {
                    let expected = albedo * arrival.irradiance * cosine / PI;
                    lit += usize::from(expected.max_element() > 0.0);
                    // Less than half: places rounded from afar move the edges of cones.
                    let found = unpack_color(*found).max_element();
                    dark += usize::from(found < 0.5 * expected.max_element() - 1e-3);
                }
            }
            println!("{distance} {lamp:?}: {dark} of {lit}");
            assert!(lit > 200, "{distance} {lamp:?}: {lit} lit");
            assert!(dark <= lit / 500, "{distance} {lamp:?}: {dark} of {lit}");
        }
    }
}

/// What a lamp on the ceiling does not lie on still hides it: a shade 2 mm below it leaves the hall dark.
#[test]
fn a_shade_below_a_lamp_hides_it() {
    let base = scenes::cornell();
    let mut scene = rays::hall(&base);
    let [a, b, c, d] =
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, z]| DVec3::new(x, 7.998, z));
    let shade = rays::scene_of(&[[a, b, c], [a, c, d]], &base);
    let first = scene.positions.len() as u32;
    scene.positions.extend(&shade.positions);
    scene.normals.extend(&shade.normals);
    scene
        .indices
        .extend(shade.indices.iter().map(|i| i + first));
    scene.parts[0].index_count += 6;
    let camera = Camera::look_at(
        DVec3::new(0.0, 1.7, 18.0),
        DVec3::new(0.0, 1.0, 0.0),
        DVec3::Y,
        perspective(60.0, 4.0 / 3.0, 0.1),
        Viewport::full(16, 12),
    )
    .expect("a camera");
    let case = Case::new(&scene, &camera, AMPLE);
    let lamp = Light::Point {
        position: DVec3::new(0.0, 8.0, 0.0),
        intensity: [100.0; 3],
    };
    let settings = BouncedSettings {
        rays_per_pixel: 16,
        ..BouncedSettings::default()
    };
    let found = lab().colors(&case.trace(&[lamp], &settings), &settings);
    let lit = found
        .iter()
        .filter(|c| unpack_color(**c).max_element() > 1e-4);
    // Within 2 cm of the ceiling at 10 m the shade's edge lets light by.
    let lit = lit.count();
    println!("{lit} of {}", found.len());
    assert!(lit <= found.len() / 200, "{lit} of {}", found.len());
}

/// A double-sided lamp turned around is as bright, and as the mirror has it; one that is not goes dark.
#[test]
fn double_sided_lamps_emit_from_both_sides() {
    let settings = BouncedSettings {
        rays_per_pixel: 16,
        sky_radiance: [0.0; 3],
        ..BouncedSettings::default()
    };
    let mean = |double_sided: bool, turned: bool| {
        let mut scene = scenes::cornell();
        for material in &mut scene.materials {
            material.double_sided = double_sided;
        }
        if turned {
            for triangle in scene.indices.chunks_exact_mut(3) {
                triangle.swap(1, 2);
            }
        }
        let case = Case::new(&scene, &camera_of(&scene, 0, [32, 32]), AMPLE);
        if double_sided {
            case.compare("double-sided", &scene, &[], &settings);
        }
        let colors = lab().colors(&case.trace(&[], &settings), &settings);
        let sum: DVec3 = colors.iter().map(|c| unpack_color(*c)).sum();
        sum.element_sum() / colors.len() as f64
    };
    let [front, back, both] =
        [(false, false), (false, true), (true, true)].map(|(a, b)| mean(a, b));
    println!("front {front:.5}, turned {back:.5}, turned and double-sided {both:.5}");
    assert!(front > 0.01 && back < 0.5 * front, "{front} {back}");
    // The lamp of the box is closed: all that is seen of it is one side.
    assert!((both / front - 1.0).abs() < 1e-3, "{front} {both}");
}

/// The picture's mean over pixels is that of the tracer within three of the error's own standard errors; and pixel by pixel
/// the error is what the directions' noise is.
#[test]
fn one_bounce_has_no_bias() {
    one_bounce_is_unbiased(0.0);
}

/// Nor where normals lean 40° and 60° off the surface, as smooth ones and those of maps do: rays below the surface's horizon
/// bring nothing of its own light.
#[test]
fn leaning_normals_do_not_see_their_own_surface() {
    for slope in [0.84, 1.73] {
        one_bounce_is_unbiased(slope);
    }
}

fn one_bounce_is_unbiased(slope: f64) {
    let mut scene = scenes::cornell();
    for material in &mut scene.materials {
        material.emission = [0.0; 3];
    }
    let mut case = Case::new(&scene, &camera_of(&scene, 0, [40, 40]), AMPLE);
    case.shot.lean(lab().gpu, slope);
    let all = lights(&scene, 1.0, DVec3::ZERO);
    let settings = BouncedSettings {
        rays_per_pixel: 64,
        ..BouncedSettings::default()
    };
    let colors = lab().colors(&case.trace(&all, &settings), &settings);
    let receivers = case.shot.traced();
    let materials = scene.triangle_materials();
    let truth = case
        .shot
        .tracer
        .one_bounce_image(&receivers, &materials, &all, 1024, 5, false);
    let errors: Vec<f64> = truth
        .iter()
        .enumerate()
        .filter_map(|(i, truth)| {
            let mean = colors[64 * i..64 * (i + 1)]
                .iter()
                .map(|c| unpack_color(*c))
                .sum::<DVec3>()
                / 64.0;
            truth.map(|truth| (mean - truth.mean).element_sum() / 3.0)
        })
        .collect();
    let level = truth
        .iter()
        .flatten()
        .map(|t| t.mean.element_sum() / 3.0)
        .sum::<f64>()
        / errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    let standard = rms / (errors.len() as f64).sqrt();
    println!("bias {mean:+.2e}, standard error {standard:.2e}, RMSE {rms:.3} of {level:.3}");
    assert!(mean.abs() <= 3.0 * standard, "{mean} against {standard}");
    // The noise of 64 directions where lights are within the scene, and near some of its surfaces: measured 0.18.
    assert!(rms <= 0.25 * level, "{rms} of {level}");
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let device = &lab().gpu.device;
    let scene = scenes::cornell();
    let case = Case::new(&scene, &camera_of(&scene, 0, [8, 8]), AMPLE);
    let disks = BouncedDescriptor {
        primitives: Primitives::Disks { levels: 1 },
        ..descriptor()
    };
    assert!(matches!(
        BouncedZBuffer::new(device, &disks),
        Err(Error::Setting { field, .. }) if field == "BouncedDescriptor::primitives"
    ));
    let view = LIT.create_view(device, 8, 8, 1).expect("a view");
    let record = |input: &BouncedInput<'_>| {
        LIT.record(device, &mut lab().gpu.encoder(), input, &settings(1), &view)
    };
    let shining = Light::Directional {
        direction: DVec3::NEG_Y,
        irradiance: [1.0; 3],
    };
    let mut decoded = Decoded::of(&case.shot.camera);
    let frame = case.frame(&mut lab().gpu.encoder(), &mut decoded);
    let good = case.input(&frame, &[]);
    assert_eq!(record(&good), Ok(()));
    for radiance in [HitRadiance::None, HitRadiance::Surfels(&case.materials)] {
        let missing = BouncedInput { radiance, ..good };
        assert!(matches!(
            record(&missing),
            Err(Error::Mismatch { name, .. }) if name == "BouncedInput::radiance"
        ));
    }
    assert_eq!(record(&case.input(&frame, &[shining; 16])), Ok(()));
    assert!(matches!(
        record(&case.input(&frame, &[shining; 17])),
        Err(Error::Setting { field, .. }) if field == "HitLighting::lights"
    ));
    let nowhere = Light::Point {
        position: DVec3::NAN,
        intensity: [1.0; 3],
    };
    assert!(matches!(
        record(&case.input(&frame, &[nowhere])),
        Err(Error::Setting { field, .. }) if field == "Light::position"
    ));
    let plain = lab().gpu.buffer(&[0_u32; 16], wgpu::BufferUsages::VERTEX);
    let short = lab().gpu.buffer(&[0_u32; 4], wgpu::BufferUsages::STORAGE);
    for materials in [&plain, &short] {
        let bad = BouncedInput {
            radiance: HitRadiance::Lit(HitLighting {
                materials,
                lights: &[],
            }),
            ..good
        };
        assert!(matches!(
            record(&bad),
            Err(Error::Buffer { name, .. } | Error::Usage { name, .. }) if name == "HitLighting::materials"
        ));
    }
}

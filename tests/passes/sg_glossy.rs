//! Glossy surfaces on the hull: against the f64 mirror and closed values, how far the mirror is off GGX, and what must hold
//! whatever is asked for.

use std::{
    collections::BTreeMap,
    f64::consts::{PI, TAU},
    sync::LazyLock,
};
use support::testing::pipelines;

use deep_screen_space::{
    Components, Error, GBuffer, Gatherer, HullSegment, HullVertex, Light, SgHull, SgHullCounts,
    SgHullDescriptor, SgHullInput, SgHullSettings, SgHullSize, Viewport,
    glam::{DVec2, DVec3},
    reference::{
        ggx::Lobe,
        sg_glossy::{glossy_radiance, mirrored_lobe},
        sg_hull::{Corner, Lobes, gather_lights, is_tiny, moments_at, shade},
        shell_splatter::Receiver,
    },
    scenes,
    spherical_gaussian::DLightMoments,
    wgpu::{self, TextureFormat as Format, TextureView},
};
use support::gpu::Gpu;
use support::testing::frames::Decoded;
use support::testing::shot::{Shot, camera_in, camera_of};

const FORMAT: Format = Format::Rgba32Float;

/// Drivers compile for seconds.
struct Lab {
    gpu: &'static Gpu,
    gatherer: Gatherer,
    /// Without gloss, and with.
    hulls: [SgHull; 2],
}

static LAB: LazyLock<Lab> = LazyLock::new(|| {
    let gpu = pipelines::gpu();
    let gatherer = Gatherer::lights(&gpu.device);
    let hulls = [false, true].map(|glossy| {
        let descriptor = SgHullDescriptor {
            gatherer: &gatherer,
            target: FORMAT,
            albedo: true,
            glossy,
            components: Components::default(),
        };
        SgHull::new(&gpu.device, &descriptor).expect("pipelines")
    });
    Lab {
        gpu,
        gatherer,
        hulls,
    }
});

/// What one recording is of.
struct Job<'a> {
    shot: &'a Shot,
    gbuffer: GBuffer<'a>,
    lights: &'a [Light],
    roughness: Option<&'a TextureView>,
    settings: SgHullSettings,
}

/// All that it left.
struct Recorded {
    segment_of: Vec<u32>,
    counts: SgHullCounts,
    segments: Vec<HullSegment>,
    vertices: Vec<HullVertex>,
    /// Of the viewport.
    pixels: Vec<DVec3>,
    /// Their fourth channels.
    alphas: Vec<f32>,
}

/// Without gloss there are no parts either, so that pixels gathered each for itself are the same.
fn size_of_view(shot: &Shot) -> SgHullSize {
    let viewport = shot.camera.viewport();
    SgHullSize {
        splits: 0,
        ..SgHullSize::new(viewport.width, viewport.height)
    }
}

impl Job<'_> {
    fn record(&self, glossy: bool, exact: bool) -> Recorded {
        let Lab {
            gpu,
            gatherer,
            hulls,
        } = &*LAB;
        let device = &gpu.device;
        let hull = &hulls[usize::from(glossy)];
        let camera = &self.shot.camera;
        let Viewport {
            x,
            y,
            width,
            height,
        } = camera.viewport();
        let view = hull
            .create_view(device, size_of_view(self.shot))
            .expect("a view");
        let gather = gatherer
            .bind_lights(device, self.lights, camera.eye())
            .expect("lights");
        let target = gpu.target(FORMAT, x + width, y + height);
        let mut encoder = gpu.encoder();
        let gbuffer = GBuffer {
            roughness: self.roughness.map(|view| view.texture().into()),
            ..self.gbuffer
        };
        let mut decoded = Decoded::of(camera);
        let frame = decoded.frame(&mut encoder, gbuffer, camera, camera.eye());
        let input = SgHullInput::new(&frame, Some(&gather), target.texture());
        if exact {
            hull.record_per_pixel(device, &mut encoder, &input, &self.settings, &view)
        } else {
            hull.record(device, &mut encoder, &input, &self.settings, &view)
        }
        .expect("it fits");
        gpu.finish(encoder);
        let texels: Vec<[f32; 4]> = gpu.read_texture(target.texture(), 0);
        let inside = |i: u32| texels[((i / width + y) * (x + width) + i % width + x) as usize];
        let counts: Vec<SgHullCounts> = gpu.read_buffer(view.counts());
        Recorded {
            segment_of: gpu.read_buffer(view.segment_of()),
            counts: counts[0],
            segments: gpu.read_buffer(view.segments()),
            vertices: gpu.read_buffer(view.vertices()),
            pixels: (0..width * height)
                .map(|i| {
                    let [r, g, b, _] = inside(i).map(f64::from);
                    DVec3::new(r, g, b)
                })
                .collect(),
            alphas: (0..width * height).map(|i| inside(i)[3]).collect(),
        }
    }
}

fn lamps() -> Vec<Light> {
    vec![
        Light::Point {
            position: DVec3::new(0.4, 2.6, 0.7),
            intensity: [9.0, 7.0, 5.0],
        },
        Light::Point {
            position: DVec3::new(-1.1, 1.9, 2.0),
            intensity: [1.0, 2.0, 4.0],
        },
        directional(DVec3::new(0.4, -1.0, -0.3), [0.3, 0.5, 0.2]),
    ]
}

fn directional(direction: DVec3, irradiance: [f32; 3]) -> Light {
    Light::Directional {
        direction,
        irradiance,
    }
}

/// Points of the sphere, each for an equal share of it.
fn sphere(count: u32) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let angle = f64::from(i) * PI * (1.0 + 5.0_f64.sqrt());
        let across = (1.0 - z * z).sqrt();
        DVec3::new(across * angle.cos(), across * angle.sin(), z)
    })
}

/// Light of radiance 1 from everywhere.
fn uniform_light(count: u32) -> Vec<Light> {
    let irradiance = (4.0 * PI / f64::from(count)) as f32;
    sphere(count)
        .map(|d| directional(-d, [irradiance; 3]))
        .collect()
}

/// A value a pixel of the viewport, in a texture with what is not a number beside it.
fn roughness_of(shot: &Shot, value: impl Fn(u32) -> f32) -> TextureView {
    let Viewport {
        x,
        y,
        width,
        height,
    } = shot.camera.viewport();
    let mut all = vec![f32::NAN; ((x + width) * (y + height)) as usize];
    for i in 0..width * height {
        all[((i / width + y) * (x + width) + i % width + x) as usize] = value(i);
    }
    LAB.gpu
        .texture(Format::R32Float, x + width, y + height, &all)
}

/// What no diffuse light comes from.
fn black(shot: &Shot) -> TextureView {
    let Viewport {
        x,
        y,
        width,
        height,
    } = shot.camera.viewport();
    let texels = vec![[0.0_f32; 4]; ((x + width) * (y + height)) as usize];
    LAB.gpu.texture(FORMAT, x + width, y + height, &texels)
}

fn lobe_at(receiver: &Receiver, roughness: f32) -> Lobe {
    // Positions are relative to the eye.
    let to_eye = -receiver.position.normalize();
    Lobe::new(receiver.normal, to_eye, f64::from(roughness))
}

/// What the mirror makes of the corners that the GPU has, by segment; of those that are not tiny nor of last resort.
fn corners_of(recorded: &Recorded, size: &SgHullSize) -> BTreeMap<u32, [Corner; 4]> {
    let wide = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let moments = |m: [f32; 4]| DLightMoments {
        vector: wide([m[0], m[1], m[2]]),
        total: m[3].into(),
    };
    (0..recorded.counts.segments.min(size.segments))
        .filter(|slot| !is_tiny(&recorded.segments[*slot as usize]))
        .map(|slot| {
            let corners = [0, 1, 2, 3].map(|corner| {
                let own = recorded.vertices[(4 * slot + corner) as usize];
                let light = recorded.vertices[own.owner as usize];
                Corner {
                    moments: [light.red, light.green, light.blue].map(moments),
                    excess: wide(light.excess),
                    depth: own.depth.into(),
                }
            });
            (slot, corners)
        })
        .collect()
}

/// By the hull alone, gathered at each pixel that the hull lists, and by `record_per_pixel`; in a part of the target, with a
/// roughness that differs from pixel to pixel.
#[test]
fn pixels_are_those_of_the_mirror() {
    let f0 = DVec3::new(0.04, 0.5, 1.0);
    let viewport = Viewport {
        x: 5,
        y: 3,
        width: 96,
        height: 64,
    };
    for name in ["cornell", "colonnade"] {
        let scene = scenes::by_name(name).expect("a scene");
        let shot = Shot::new(LAB.gpu, &scene, &camera_in(&scene, 0, viewport));
        let eye = shot.camera.eye();
        let receivers = shot.receivers(eye);
        let values = [0.1, 0.3, 0.6, 1.0, f32::NAN, 2.0, f32::INFINITY];
        let value = |i: u32| values[(i % 7) as usize];
        let roughness = roughness_of(&shot, value);
        let lights = lamps();
        let materials = scene.triangle_materials();
        for (how, exact, error_threshold) in [
            ("hull", false, f32::INFINITY),
            ("listed", false, 0.0),
            ("exact", true, 0.3),
        ] {
            let job = Job {
                shot: &shot,
                gbuffer: shot.lit_gbuffer(),
                lights: &lights,
                roughness: Some(&roughness),
                settings: SgHullSettings {
                    error_threshold,
                    f0: f0.as_vec3().to_array(),
                    ..SgHullSettings::default()
                },
            };
            let recorded = job.record(true, exact);
            let corners = if how == "hull" {
                corners_of(&recorded, &size_of_view(&shot))
            } else {
                BTreeMap::new()
            };
            let mean = recorded.pixels.iter().sum::<DVec3>() / recorded.pixels.len() as f64;
            let (mut off, mut of_corners, mut gloss) = (0, 0, 0.0);
            for (i, receiver) in receivers.iter().enumerate() {
                let Some(receiver) = receiver else { continue };
                let at = [i as u32 % 96, i as u32 / 96];
                let slot = recorded.segment_of[i];
                let lobe = lobe_at(receiver, value(i as u32));
                let (diffuse, moments) = if let Some(corners) = corners.get(&slot) {
                    of_corners += 1;
                    let segment = &recorded.segments[slot as usize];
                    (
                        shade(segment, corners, at, receiver.normal),
                        moments_at(segment, corners, at),
                    )
                } else {
                    let light = gather_lights(&lights, receiver.position + eye, receiver.normal);
                    (light.irradiance / PI, light.moments)
                };
                let albedo = shot.pixels[i].map_or([0.0; 3], |p| materials[p.triangle].albedo);
                let glossy = glossy_radiance(&lobe, f0, &moments);
                let expected = DVec3::from(albedo.map(f64::from)) * diffuse + glossy;
                gloss += glossy.element_sum() / (3 * receivers.len()) as f64;
                let found = recorded.pixels[i];
                // At grazing angles positions of f32 move a lobe of roughness 0.1 by 1e-3 of its peak, and a rasteriser's
                // weights are as far off; the dark counts as a share of the picture.
                let slack = 3e-3 * expected.length() + 3e-4 * mean.length();
                if found.is_nan() || found.distance(expected) > slack {
                    off += 1;
                    if off < 4 {
                        println!(
                            "{name}, {how}: pixel {at:?} of {lobe:?} is {found}, expected {expected} with {glossy}"
                        );
                    }
                }
            }
            println!(
                "{name}, {how}: {off} of {} pixels are off, {of_corners} of corners; mean {mean}, glossy {gloss}",
                receivers.len()
            );
            assert!(gloss > 0.05 * mean.element_sum() / 3.0, "{name}, {how}");
            assert!(how != "hull" || of_corners > 2000, "{name}: {of_corners}");
            // Silhouettes, where a corner's own point lies behind the camera's resolution.
            assert!(off * 500 <= receivers.len(), "{name}, {how}: {off} are off");
        }
    }
}

/// One light: D, masking, shadowing and Fresnel's factor are those of its own direction.
#[test]
fn a_directional_light_has_its_closed_value() {
    let scene = scenes::cornell();
    let shot = Shot::new(LAB.gpu, &scene, &camera_of(&scene, 0, [64, 64]));
    let receivers = shot.receivers(shot.camera.eye());
    let albedo = black(&shot);
    let lights = [directional(DVec3::new(0.3, -1.0, -0.5), [2.0; 3])];
    let to_light = DVec3::new(-0.3, 1.0, 0.5).normalize();
    for value in [0.5, 1.0] {
        let roughness = roughness_of(&shot, |_| value);
        let alpha = f64::from(value * value);
        let expected: Vec<f64> = receivers
            .iter()
            .map(|receiver| {
                let Some(receiver) = receiver else { return 0.0 };
                let n = receiver.normal;
                let v = -receiver.position.normalize();
                let (nv, nl) = (n.dot(v).max(1e-4), n.dot(to_light));
                if nl <= 0.0 {
                    return 0.0;
                }
                let h = (v + to_light).normalize();
                let mirrored = 2.0 * n.dot(v) * n - v;
                let exponent = (mirrored.dot(to_light) - 1.0) / (2.0 * alpha * alpha * nv);
                let d = exponent.exp() / (PI * alpha * alpha);
                // Heights correlated (Heitz 2014).
                let root = |c: f64| (alpha * alpha * (1.0 - c * c) + c * c).sqrt();
                let g = 2.0 * nl * nv / (nl * root(nv) + nv * root(nl));
                let fresnel = 0.04 + 0.96 * (1.0 - v.dot(h)).powi(5);
                2.0 * d * g * fresnel / (4.0 * nv)
            })
            .collect();
        let peak = expected.iter().copied().fold(0.0, f64::max);
        assert!(peak > 1e-3, "roughness {value}: no light");
        for exact in [false, true] {
            let job = Job {
                shot: &shot,
                gbuffer: GBuffer {
                    albedo: Some(albedo.texture().into()),
                    ..shot.gbuffer()
                },
                lights: &lights,
                roughness: Some(&roughness),
                settings: SgHullSettings::default(),
            };
            let recorded = job.record(true, exact);
            let worst = (0..expected.len())
                .map(|i| ((recorded.pixels[i].x - expected[i]).abs() / peak, i))
                .fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a });
            println!("roughness {value}, exact {exact}: {worst:?} of {peak}");
            // Of the light's lobe, 1e6 or what rounding leaves of it, some 3e5, the surface's share of 30 to 1000.
            assert!(
                worst.0 < 5e-3,
                "roughness {value}, exact {exact}: pixel {} is {}, expected {}",
                worst.1,
                recorded.pixels[worst.1],
                expected[worst.1]
            );
        }
    }
}

/// Under the same light from everywhere no surface shows more than that, whatever it reflects; nor all of it go.
#[test]
fn uniform_light_is_not_exceeded() {
    let scene = scenes::by_name("colonnade").expect("a scene");
    let shot = Shot::new(LAB.gpu, &scene, &camera_of(&scene, 0, [64, 64]));
    let receivers = shot.receivers(shot.camera.eye());
    let albedo = black(&shot);
    let lights = uniform_light(400);
    for (value, least) in [(0.0, 0.85), (0.5, 0.7), (1.0, 0.3)] {
        let roughness = roughness_of(&shot, |_| value);
        for exact in [false, true] {
            let job = Job {
                shot: &shot,
                gbuffer: GBuffer {
                    albedo: Some(albedo.texture().into()),
                    ..shot.gbuffer()
                },
                lights: &lights,
                roughness: Some(&roughness),
                settings: SgHullSettings {
                    f0: [1.0; 3],
                    ..SgHullSettings::default()
                },
            };
            let recorded = job.record(true, exact);
            let (mut most, mut sum, mut count) = (0.0_f64, 0.0, 0.0);
            for (found, receiver) in recorded.pixels.iter().zip(&receivers) {
                if receiver.is_some() {
                    most = most.max(found.x);
                    sum += found.x;
                    count += 1.0;
                }
            }
            let mean = sum / count;
            println!("roughness {value}, exact {exact}: at most {most}, mean {mean}");
            // 400 lights are as even as that.
            assert!(
                most < 1.01 && mean > least,
                "roughness {value}, exact {exact}: at most {most}, mean {mean}"
            );
        }
    }
}

#[test]
fn extremes_are_numbers() {
    let scene = scenes::cornell();
    let mut shot = Shot::new(LAB.gpu, &scene, &camera_of(&scene, 0, [64, 64]));
    let eye = shot.camera.eye();
    let on_surface = shot
        .receivers(eye)
        .iter()
        .flatten()
        .next()
        .expect("a surface")
        .position;
    // Normals across the view and away from it, in places.
    let depth: Vec<f32> = shot
        .pixels
        .iter()
        .map(|p| p.map_or(0.0, |p| p.depth as f32))
        .collect();
    let normals: Vec<[f32; 4]> = (0..)
        .zip(&shot.pixels)
        .map(|(i, pixel)| {
            let Some(pixel) = pixel else {
                return [0.0; 4];
            };
            let forward = pixel.receiver.position - eye;
            let across = forward.any_orthonormal_vector();
            let normal = match (i / 8) % 4 {
                0 => across,
                1 => forward.normalize(),
                2 => -forward.normalize(),
                _ => pixel.receiver.shading_normal,
            };
            normal.as_vec3().extend(0.0).to_array()
        })
        .collect();
    shot.upload(LAB.gpu, &depth, &normals);
    let values = [
        0.0,
        1e-30,
        0.03,
        1.0,
        -1.0,
        f32::NAN,
        f32::NEG_INFINITY,
        0.3,
    ];
    let roughness = roughness_of(&shot, |i| values[(i % 8) as usize]);
    let direction = DVec3::new(0.3, -1.0, -0.5);
    for (name, lights) in [
        ("none", vec![]),
        ("black", vec![directional(direction, [0.0; 3])]),
        ("one of 1e6", vec![directional(direction, [1e6; 3])]),
        ("the brightest", vec![directional(direction, [1e18; 3])]),
        ("the dimmest", vec![directional(direction, [1e-30; 3])]),
        ("all around", uniform_light(64)),
        (
            "at a surface",
            vec![Light::Point {
                position: eye + on_surface,
                intensity: [1.0; 3],
            }],
        ),
    ] {
        for (exact, error_threshold) in [(false, 0.3), (false, f32::INFINITY), (true, 0.3)] {
            let job = Job {
                shot: &shot,
                gbuffer: shot.lit_gbuffer(),
                lights: &lights,
                roughness: Some(&roughness),
                settings: SgHullSettings {
                    error_threshold,
                    f0: [0.04, 0.0, 1.0],
                    ..SgHullSettings::default()
                },
            };
            let recorded = job.record(true, exact);
            for (i, found) in recorded.pixels.iter().enumerate() {
                assert!(
                    found.is_finite() && found.min_element() >= 0.0 && recorded.alphas[i] == 1.0,
                    "{name}, exact {exact}, error_threshold {error_threshold}: pixel {i} is {found}, roughness {}",
                    values[i % 8]
                );
                assert!(
                    !["none", "black"].contains(&name) || *found == DVec3::ZERO,
                    "{name}: pixel {i} is {found}"
                );
            }
        }
    }
}

/// Off, a roughness changes nothing, and what the second lobe adds is never less than nothing.
#[test]
fn it_is_added() {
    let scene = scenes::cornell();
    let shot = Shot::new(LAB.gpu, &scene, &camera_of(&scene, 0, [64, 64]));
    let roughness = roughness_of(&shot, |_| 0.4);
    let lights = lamps();
    let job = |roughness| Job {
        shot: &shot,
        gbuffer: shot.lit_gbuffer(),
        lights: &lights,
        roughness,
        settings: SgHullSettings::default(),
    };
    for exact in [false, true] {
        let without = job(None).record(false, exact);
        let unread = job(Some(&roughness)).record(false, exact);
        assert_eq!(without.pixels, unread.pixels, "exact {exact}");
        let glossy = job(Some(&roughness)).record(true, exact);
        let mut more = 0;
        for (i, (diffuse, both)) in without.pixels.iter().zip(&glossy.pixels).enumerate() {
            // Other pipelines may round otherwise.
            assert!(
                (*both - *diffuse * (1.0 - 1e-5)).min_element() >= 0.0,
                "exact {exact}: pixel {i} is {both}, {diffuse} without"
            );
            more += usize::from(both.x > 1.01 * diffuse.x);
        }
        assert!(more > 500, "exact {exact}: {more} pixels shine");
    }
}

/// The light of a test: radiance by direction, and how far off its axis there is any.
#[derive(Clone, Copy, Debug)]
enum Source {
    /// A spherical Gaussian of sharpness 8.
    Gaussian,
    /// Even, up to this many degrees off its axis.
    Patch(f64),
}

impl Source {
    fn radiance(self, cosine: f64) -> f64 {
        match self {
            Self::Gaussian => (8.0 * (cosine - 1.0)).exp(),
            Self::Patch(degrees) => f64::from(u8::from(cosine >= degrees.to_radians().cos())),
        }
    }
}

/// How far the mirror is off GGX, integrated by brute force over the same light: root mean square over four views and where
/// the light is, of the root mean square of what is right. `cargo test --test passes off_ggx -- --nocapture` prints it.
#[test]
fn how_far_it_is_off_ggx() {
    const SIDE: u32 = 96;
    let normal = DVec3::Z;
    let f0 = DVec3::splat(0.04);
    let everywhere: Vec<DVec3> = sphere(20_000).collect();
    let solid_angle = 4.0 * PI / everywhere.len() as f64;
    let sources = [
        Source::Gaussian,
        Source::Patch(10.0),
        Source::Patch(30.0),
        Source::Patch(60.0),
        Source::Patch(180.0),
    ];
    // What is measured, and a tenth, by source and roughness.
    let bars = [
        [0.085, 0.12, 0.32, 0.34],
        [0.26, 0.33, 0.73, 0.27],
        [0.56, 0.53, 0.51, 0.36],
        [0.39, 0.40, 0.34, 0.40],
        [0.018, 0.10, 0.24, 0.72],
    ];
    for (source, bars) in sources.iter().zip(bars) {
        for (value, bar) in [0.1, 0.3, 0.6, 1.0].into_iter().zip(bars) {
            let (mut squares, mut right, mut sum, mut total) = (0.0, 0.0, 0.0, 0.0);
            for degrees in [0.0_f64, 30.0, 60.0, 80.0] {
                let (sine, cosine) = degrees.to_radians().sin_cos();
                let to_eye = DVec3::new(sine, 0.0, cosine);
                let lobe = Lobe::new(normal, to_eye, value);
                let drawn: Vec<(DVec3, f64)> = (0..SIDE * SIDE)
                    .map(|i| {
                        let point = DVec2::new(f64::from(i % SIDE), f64::from(i / SIDE)) + 0.5;
                        let drawn = lobe.direction(point / f64::from(SIDE));
                        let share = lobe.share(drawn.light) * lobe.schlick(f0, drawn.facet).x;
                        (lobe.frame * drawn.light, share / f64::from(SIDE * SIDE))
                    })
                    .collect();
                // The light's axis: evenly over 50 degrees about the mirrored view, above the horizon.
                let mirrored = mirrored_lobe(&lobe).axis;
                let axes = (0..24).map(|i| {
                    let (u, v) = ((f64::from(i) + 0.5) / 24.0, f64::from(i) * 0.618_034);
                    let height = 1.0 - u * (1.0 - 50.0_f64.to_radians().cos());
                    let x = mirrored.any_orthonormal_vector();
                    let across = x * (TAU * v).cos() + mirrored.cross(x) * (TAU * v).sin();
                    mirrored * height + across * (1.0 - height * height).sqrt()
                });
                for axis in axes.filter(|axis| axis.z > 0.0) {
                    let mut light = Lobes::ZERO;
                    for direction in &everywhere {
                        let radiance = source.radiance(direction.dot(axis));
                        light.add_light(normal, *direction, DVec3::splat(radiance * solid_angle));
                    }
                    let found = glossy_radiance(&lobe, f0, &light.moments).x;
                    let expected: f64 = drawn
                        .iter()
                        .map(|(direction, share)| share * source.radiance(direction.dot(axis)))
                        .sum();
                    squares += (found - expected).powi(2);
                    right += expected.powi(2);
                    sum += found;
                    total += expected;
                }
            }
            let (off, energy) = ((squares / right).sqrt(), sum / total - 1.0);
            println!("{source:?}, roughness {value}: off by {off:.3}, energy {energy:+.3}");
            assert!(
                off <= bar,
                "{source:?}, roughness {value}: off by {off}, bar {bar}"
            );
        }
    }
}

#[track_caller]
fn refused<T>(result: Result<T, Error>, kind: &str, thing: &str) {
    let Err(error) = result else {
        panic!("{thing} was accepted");
    };
    assert!(format!("{error:?}").starts_with(kind), "{error:?}");
    assert!(error.to_string().contains(thing), "{error}");
}

#[test]
fn what_does_not_fit_is_refused() {
    let Lab {
        gpu,
        gatherer,
        hulls,
    } = &*LAB;
    let device = &gpu.device;
    let scene = scenes::cornell();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [16, 16]));
    let target = gpu.target(FORMAT, 16, 16);
    let gather = gatherer
        .bind_lights(device, &[], shot.camera.eye())
        .expect("lights");
    let texture = |format, side, usage| {
        let descriptor = wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d {
                width: side,
                height: side,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        };
        let texture = device.create_texture(&descriptor);
        texture.create_view(&wgpu::TextureViewDescriptor::default())
    };
    let bound = wgpu::TextureUsages::TEXTURE_BINDING;
    let good = texture(Format::R8Unorm, 16, bound);
    let whole = texture(Format::R8Uint, 16, bound);
    let small = texture(Format::R8Unorm, 15, bound);
    let unbound = texture(Format::R8Unorm, 16, wgpu::TextureUsages::COPY_SRC);
    let settings = SgHullSettings::default();
    let record = |glossy: bool, roughness, settings: &SgHullSettings| {
        let hull = &hulls[usize::from(glossy)];
        let view = hull
            .create_view(device, size_of_view(&shot))
            .expect("a view");
        let encoder = &mut gpu.encoder();
        let gbuffer = GBuffer {
            roughness,
            ..shot.lit_gbuffer()
        };
        let mut decoded = Decoded::of(&shot.camera);
        let frame = decoded.record(encoder, gbuffer, &shot.camera, shot.camera.eye())?;
        let input = SgHullInput::new(&frame, Some(&gather), target.texture());
        hull.record_per_pixel(device, encoder, &input, settings, &view)?;
        hull.record(device, encoder, &input, settings, &view)
    };
    record(true, Some(good.texture().into()), &settings).expect("it fits");
    let name = "GBuffer::roughness";
    refused(record(true, None, &settings), "Mismatch", name);
    let by = "SgHullDescriptor::glossy";
    refused(record(true, None, &settings), "Mismatch", by);
    // One that is not needed is not read, but is looked at.
    record(false, Some(good.texture().into()), &settings).expect("it fits");
    for glossy in [false, true] {
        refused(
            record(glossy, Some(whole.texture().into()), &settings),
            "Format",
            name,
        );
        refused(
            record(glossy, Some(small.texture().into()), &settings),
            "Size",
            name,
        );
        refused(
            record(glossy, Some(unbound.texture().into()), &settings),
            "Usage",
            name,
        );
    }
    for channel in [-0.1, 1.1, f32::NAN] {
        let settings = SgHullSettings {
            f0: [0.0, channel, 1.0],
            ..settings
        };
        refused(
            record(true, Some(good.texture().into()), &settings),
            "Setting",
            "::f0",
        );
    }
}

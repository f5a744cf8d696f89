//! Screen-space indirect light: GPU against the f64 mirror, a closed form, and what must hold of any image.

use deep_screen_space::{
    Camera, Error, PixelList, ScreenSpaceGi, ScreenSpaceGiInput, ScreenSpaceGiSettings, Viewport,
    glam::{DVec3, dcamera::rh::proj::directx as right},
    reference::screen_space_gi as mirror,
    scenes,
    wgpu::{self, TextureFormat as Format},
};
use support::gpu::Gpu;
use support::testing::multi_res;
use support::testing::multi_res::{Frame, check_work, framed, random, read_image};
use support::testing::pipelines;

/// A frame with a radiance a pixel.
struct Lit {
    frame: Frame,
    radiance: Vec<DVec3>,
    view: wgpu::TextureView,
}

impl Lit {
    fn new(gpu: &Gpu, frame: Frame, radiance: impl Fn(u32) -> DVec3) -> Self {
        let [width, height] = frame.size();
        let texels: Vec<[f32; 4]> = (0..width * height)
            .map(|i| radiance(i).as_vec3().extend(1.0).to_array())
            .collect();
        Self {
            view: framed(
                gpu,
                &frame.camera,
                Format::Rgba32Float,
                &texels,
                [f32::NAN; 4],
            ),
            radiance: texels
                .iter()
                .map(|&[r, g, b, _]| DVec3::new(r.into(), g.into(), b.into()))
                .collect(),
            frame,
        }
    }

    fn input<'a>(
        &'a self,
        work: Option<PixelList<'a>>,
        target: &'a wgpu::TextureView,
    ) -> ScreenSpaceGiInput<'a> {
        ScreenSpaceGiInput {
            gbuffer: self.frame.gbuffer(),
            camera: &self.frame.camera,
            lit: self.view.texture().into(),
            work,
            target: target.texture().into(),
            timestamps: None,
        }
    }

    fn record(
        &self,
        gpu: &Gpu,
        pass: &ScreenSpaceGi,
        settings: &ScreenSpaceGiSettings,
    ) -> Vec<DVec3> {
        let [width, height] = self.frame.size();
        let target = gpu.storage(Format::Rgba16Float, width, height);
        let mut encoder = gpu.encoder();
        pass.record(
            &gpu.device,
            &mut encoder,
            &self.input(None, &target),
            settings,
        )
        .expect("light");
        gpu.finish(encoder);
        read_image(gpu, &target)
    }

    fn mirror(&self, settings: &ScreenSpaceGiSettings) -> Vec<DVec3> {
        mirror::ScreenSpaceGi {
            decoder: self.frame.decoder(),
            depth: &self.frame.depth,
            normal: &self.frame.normal,
            lit: &self.radiance,
            settings,
        }
        .image()
    }
}

fn colors(i: u32) -> DVec3 {
    DVec3::from([0, 1, 2].map(|k| random(i / 3, k)))
}

/// A sample may fall on another pixel by rounding, or to the other side of a surface: of the pixels 2 % may be off by more
/// than 2 % of the brightest, and a half holds 1/2048 of itself.
#[test]
fn gpu_is_its_mirror() {
    let gpu = pipelines::gpu();
    let pass = pipelines::screen_space_gi();
    for (name, radius) in [("cornell", 0.5), ("dominoes", 0.3), ("colonnade", 2.0)] {
        let scene = scenes::by_name(name).expect("a scene");
        let lit = Lit::new(gpu, Frame::of_scene(gpu, &scene, [73, 47]), colors);
        for (samples, turn) in [(1, false), (64, false), (100, true)] {
            let settings = ScreenSpaceGiSettings {
                radius,
                samples,
                turn,
            };
            let found = lit.record(gpu, pass, &settings);
            let expected = lit.mirror(&settings);
            let brightest = expected
                .iter()
                .fold(0.0, |m: f64, v| m.max(v.max_element()));
            assert!(brightest > 0.01, "{name}, {samples}: {brightest}");
            let differ = found
                .iter()
                .zip(&expected)
                .filter(|(f, e)| (**f - **e).abs().max_element() > 0.02 * brightest)
                .count();
            println!(
                "{name}, {samples} samples: {differ} of {} differ",
                found.len()
            );
            assert!(
                differ <= found.len() / 50,
                "{name}, {samples}: {differ} differ"
            );
        }
    }
}

/// A floor and a wall that meet, seen from above and before: only the wall sends.
fn corner(gpu: &Gpu, camera: &Camera, radiance: DVec3) -> Lit {
    let is_wall = |from: DVec3, along: DVec3| {
        let floor = (-1.0 - from.y) / along.y;
        let wall = (-4.0 - from.z) / along.z;
        (wall > 0.0 && (floor < 0.0 || wall < floor)).then_some(wall)
    };
    let frame = Frame::cast(gpu, camera, Format::R32Float, |_, from, along| {
        if let Some(t) = is_wall(from, along) {
            return Some((from + t * along, DVec3::Z));
        }
        let t = (-1.0 - from.y) / along.y;
        (t > 0.0).then(|| (from + t * along, DVec3::Y))
    });
    let on_wall: Vec<bool> = frame.normal.iter().map(|n| *n == DVec3::Z).collect();
    Lit::new(gpu, frame, |i| {
        if on_wall[i as usize] {
            radiance
        } else {
            DVec3::ZERO
        }
    })
}

/// The floor at distance d of a wall with radius r about it gets of a wall without end (1 − cos of the elevation …) / 2;
/// with what is farther than r left out, at most that. One area for all senders is a guess: half to twice as much is near.
#[test]
fn a_wall_lights_the_floor() {
    let gpu = pipelines::gpu();
    let pass = pipelines::screen_space_gi();
    let camera = Camera::look_at(
        DVec3::new(0.0, 1.5, 0.0),
        DVec3::new(0.0, -0.6, -4.0),
        DVec3::Y,
        right::perspective_infinite_reverse(1.2, 1.5, 0.1),
        Viewport::full(96, 64),
    )
    .expect("a camera");
    let settings = ScreenSpaceGiSettings {
        radius: 1.0,
        samples: 256,
        turn: false,
    };
    let color = DVec3::new(1.0, 0.5, 0.0);
    let lit = corner(gpu, &camera, color);
    let found = lit.record(gpu, pass, &settings);
    let receivers = lit.frame.receivers();
    let mut compared = 0;
    let mut ratios = Vec::new();
    for (i, (found, receiver)) in found.iter().zip(&receivers).enumerate() {
        let Some(receiver) = receiver else { continue };
        let world = receiver.position + camera.eye();
        // What is 1 and 0.5 in the wall's light is so in the floor's.
        assert!(
            (found.y - 0.5 * found.x).abs() < 2e-3 && found.z == 0.0,
            "pixel {i}: {found}"
        );
        if receiver.normal == DVec3::Z {
            assert_eq!(*found, DVec3::ZERO, "the wall does not see itself");
            continue;
        }
        let distance = world.z + 4.0;
        if distance > 1.05 {
            assert_eq!(*found, DVec3::ZERO, "pixel {i} at {distance}");
        } else if (0.2..0.6).contains(&distance) && world.x.abs() < 1.0 {
            // The form factor of the part of the wall within the radius, by a sum.
            let mut expected = 0.0;
            let steps = 60;
            for sx in -steps..steps {
                for sy in 0..steps {
                    let cell = 1.0 / f64::from(steps);
                    let to = DVec3::new(
                        (f64::from(sx) + 0.5) * cell,
                        (f64::from(sy) + 0.5) * cell,
                        -distance,
                    );
                    let d2 = to.length_squared();
                    if d2 < 1.0 {
                        expected +=
                            to.y * distance / (d2 * d2) * cell * cell / std::f64::consts::PI;
                    }
                }
            }
            compared += 1;
            ratios.push(found.x / expected);
            assert!(
                (0.5 * expected..2.0 * expected).contains(&found.x),
                "pixel {i} at {distance}: {}, {expected}",
                found.x
            );
        }
    }
    let mean = ratios.iter().sum::<f64>() / f64::from(compared);
    let range = |f: fn(f64, f64) -> f64| ratios.iter().copied().fold(mean, f);
    println!(
        "{compared} pixels: {mean:.2} of the truth, {:.2} to {:.2}",
        range(f64::min),
        range(f64::max)
    );
    assert!(compared >= 40, "{compared}");
    // Linear in the light, and nothing comes of nothing.
    let twice = corner(gpu, &camera, 2.0 * color).record(gpu, pass, &settings);
    for (i, (one, two)) in found.iter().zip(&twice).enumerate() {
        assert!(
            (2.0 * *one - *two).abs().max_element() < 2e-3,
            "pixel {i}: {one}, {two}"
        );
    }
    let dark = corner(gpu, &camera, DVec3::ZERO).record(gpu, pass, &settings);
    assert!(dark.iter().all(|v| *v == DVec3::ZERO));
}

/// Light that is not finite counts for nothing, and what would overflow a half is as bright as one holds.
#[test]
fn garbage_is_dark_and_glare_is_finite() {
    let gpu = pipelines::gpu();
    let pass = pipelines::screen_space_gi();
    let scene = scenes::cornell();
    let settings = ScreenSpaceGiSettings::default();
    for bad in [f64::NAN, f64::INFINITY, -1.0, 1e30] {
        let lit = Lit::new(gpu, Frame::of_scene(gpu, &scene, [48, 32]), |_| {
            DVec3::splat(bad)
        });
        let found = lit.record(gpu, pass, &settings);
        assert!(
            found
                .iter()
                .all(|v| v.is_finite() && v.min_element() >= 0.0),
            "{bad}"
        );
        let lights = found.iter().any(|v| *v != DVec3::ZERO);
        assert_eq!(lights, bad == 1e30, "{bad}");
    }
    // Sky alone, and a single pixel.
    for size in [[1, 1], [9, 7]] {
        let camera = multi_res::camera(
            right::perspective_infinite_reverse(1.0, 1.5, 0.1),
            Viewport::full(size[0], size[1]),
        );
        let sky = Frame::cast(gpu, &camera, Format::R32Float, |_, _, _| None);
        let lit = Lit::new(gpu, sky, |_| DVec3::ONE);
        let found = lit.record(gpu, pass, &settings);
        assert!(found.iter().all(|v| *v == DVec3::ZERO));
    }
}

#[test]
fn lists_compute_what_the_whole_image_has() {
    let gpu = pipelines::gpu();
    let pass = pipelines::screen_space_gi();
    let lit = Lit::new(
        gpu,
        Frame::of_scene(gpu, &scenes::cornell(), [77, 53]),
        colors,
    );
    let settings = ScreenSpaceGiSettings {
        samples: 16,
        turn: true,
        ..ScreenSpaceGiSettings::default()
    };
    check_work(
        gpu,
        &lit.frame,
        Format::Rgba16Float,
        |encoder, work, target| {
            pass.record(&gpu.device, encoder, &lit.input(work, target), &settings)
                .expect("light");
        },
    );
}

#[test]
fn what_cannot_be_is_refused() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let pass = pipelines::screen_space_gi();
    let camera = multi_res::camera(
        right::perspective_infinite_reverse(1.0, 1.0, 0.1),
        Viewport::full(16, 8),
    );
    let sky = Frame::cast(gpu, &camera, Format::R32Float, |_, _, _| None);
    let mut lit = Lit::new(gpu, sky, |_| DVec3::ONE);
    let good = ScreenSpaceGiSettings::default();
    for (field, settings) in [
        (
            "radius",
            ScreenSpaceGiSettings {
                radius: 0.0,
                ..good
            },
        ),
        (
            "radius",
            ScreenSpaceGiSettings {
                radius: f32::INFINITY,
                ..good
            },
        ),
        ("samples", ScreenSpaceGiSettings { samples: 0, ..good }),
        (
            "samples",
            ScreenSpaceGiSettings {
                samples: 16385,
                ..good
            },
        ),
    ] {
        let refused = settings.validate();
        assert!(
            matches!(&refused, Err(Error::Setting { field: f, .. }) if f.ends_with(field)),
            "{field}: {refused:?}"
        );
    }
    let refused = |lit: &Lit, format, width| {
        let target = gpu.storage(format, width, 8);
        pass.record(device, &mut gpu.encoder(), &lit.input(None, &target), &good)
    };
    assert_eq!(refused(&lit, Format::Rgba16Float, 16), Ok(()));
    let other = refused(&lit, Format::R32Float, 16);
    assert!(matches!(other, Err(Error::Format { .. })), "{other:?}");
    let other = refused(&lit, Format::Rgba16Float, 15);
    assert!(matches!(other, Err(Error::Size { .. })), "{other:?}");
    lit.view = gpu.texture(Format::R32Float, 16, 8, &[0.0_f32; 128]);
    let other = refused(&lit, Format::Rgba16Float, 16);
    assert!(
        matches!(
            other,
            Err(Error::Format {
                name: "ScreenSpaceGiInput::lit",
                ..
            })
        ),
        "{other:?}"
    );
}

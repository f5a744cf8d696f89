//! Environments: tables and rays against the mirror, light against ray tracing.

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, BouncedView, BouncedZBuffer, Environment,
    EnvironmentBuilder, EnvironmentInput, EnvironmentLight, EnvironmentSettings, EnvironmentSource,
    Error, Frame, HitLighting, HitRadiance, HitResolverDescriptor, HitResolverInput,
    HitResolverSettings, Light, Payload, Quality, Sampling,
    glam::{DQuat, DVec2, DVec3},
    reference::{
        bounced_z_buffer::Tracing,
        environment::{Cells, Picture, clean, direction_at, harmonics_at, polynomials_at},
        packing::unpack_color,
        trace::{ColorEstimate, Receiver},
    },
    scenes::{self, Scene},
    spherical_gaussian::SphericalGaussian,
    wgpu,
};
use support::sky;
use support::testing::{
    frames::Decoded,
    pipelines,
    rays::{self, AMPLE, lab, lights, relative, triangles},
    shot::{Shot, camera_of},
};

fn builder() -> &'static EnvironmentBuilder {
    pipelines::once(&(), |gpu| {
        EnvironmentBuilder::new(&gpu.device).expect("pipelines")
    })
}

/// An environment on the GPU of what `source` shows.
fn built(size: [u32; 2], source: EnvironmentSource<'_>) -> Environment {
    let gpu = lab().gpu;
    let settings = EnvironmentSettings {
        size,
        ..EnvironmentSettings::default()
    };
    let environment = builder().create(&gpu.device, &settings).expect("room");
    let mut encoder = gpu.encoder();
    let input = EnvironmentInput::new(source);
    builder()
        .record(&gpu.device, &mut encoder, &input, &environment)
        .expect("an environment");
    gpu.finish(encoder);
    environment
}

/// The same of a picture of `f32`.
fn pictured(picture: &Picture, size: [u32; 2]) -> Environment {
    let texels: Vec<[f32; 4]> = picture
        .texels
        .iter()
        .map(|t| t.as_vec3().extend(1.0).to_array())
        .collect();
    let [width, height] = picture.size.map(|n| n as u32);
    let format = wgpu::TextureFormat::Rgba32Float;
    let texture = lab().gpu.texture(format, width, height, &texels);
    built(
        size,
        EnvironmentSource::Equirectangular(texture.texture().into()),
    )
}

/// What is on the GPU, for the mirror.
fn read(environment: &Environment, rotation: DQuat) -> Cells {
    let gpu = lab().gpu;
    let size = environment.size().map(|n| n as usize);
    let cells: Vec<[f32; 4]> = gpu.read_texture(environment.radiance().texture(), 0);
    let mut tables: Vec<f32> = gpu.read_texture(environment.distribution().texture(), 0);
    let over_rows = tables.split_off(size[0] * size[1]);
    Cells {
        radiance: Picture {
            size,
            texels: cells
                .iter()
                .map(|[r, g, b, _]| DVec3::new((*r).into(), (*g).into(), (*b).into()))
                .collect(),
        },
        in_rows: tables.into_iter().map(f64::from).collect(),
        over_rows: over_rows[..size[1]].iter().map(|v| f64::from(*v)).collect(),
        rotation,
    }
}

/// The dim sky with a bright sun wide enough for coarse pictures.
fn sunny(d: DVec3) -> DVec3 {
    let sun = DVec3::new(0.5, 0.7, 0.4).normalize();
    let is_sun = d.dot(sun) > 8.0_f64.to_radians().cos();
    sky::dim(d) + DVec3::new(1.0, 0.9, 0.7) * if is_sun { 100.0 } else { 0.0 }
}

/// Software drivers' sines are off by up to 2e-4; the rounding of some hundred additions is less. None may be farther.
const TABLE_OFF: f64 = 5e-4;

fn near(found: &[f64], expected: &[f64], scale: f64, name: &str) {
    assert_eq!(found.len(), expected.len(), "{name}");
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let off = (found - expected).abs();
        assert!(
            off <= TABLE_OFF * scale.max(expected.abs()),
            "{name} {i}: {found} for {expected}"
        );
    }
}

fn compare_tables(name: &str, environment: &Environment, radiance: &Picture) {
    compare_sums((name, 0.0), environment, radiance);
}

/// The same where radiance is a sum of terms as large as `terms`, which may cancel.
fn compare_sums((name, terms): (&str, f64), environment: &Environment, radiance: &Picture) {
    let found = read(environment, DQuat::IDENTITY);
    let expected = Cells::new(radiance.clone(), DQuat::IDENTITY);
    let flat = |p: &Picture| {
        p.texels
            .iter()
            .flat_map(DVec3::to_array)
            .collect::<Vec<_>>()
    };
    near(
        &flat(&found.radiance),
        &flat(radiance),
        terms,
        &format!("{name} radiance"),
    );
    near(
        &found.in_rows,
        &expected.in_rows,
        1.0,
        &format!("{name} rows"),
    );
    near(
        &found.over_rows,
        &expected.over_rows,
        1.0,
        &format!("{name} columns"),
    );
    assert!(
        found.in_rows.is_sorted_by(|a, b| a <= b || *b <= 1.0),
        "{name}"
    );
    let irradiance: Vec<[f32; 4]> = lab().gpu.read_buffer(environment.irradiance());
    let found: Vec<f64> = irradiance
        .iter()
        .flat_map(|c| [c[0], c[1], c[2]].map(f64::from))
        .collect();
    let expected: Vec<f64> = expected
        .irradiance()
        .iter()
        .flat_map(DVec3::to_array)
        .collect();
    let scale = expected.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
    near(&found, &expected, scale, &format!("{name} irradiance"));
}

#[test]
fn tables_are_the_mirrors() {
    let seen = Picture::of([30, 20], sunny);
    // Smaller, larger and as large as the picture's own texels.
    for size in [[16, 8], [64, 32], [32, 20]] {
        let cells = seen.resampled(size.map(|n| n as usize));
        compare_tables(&format!("{size:?}"), &pictured(&seen, size), &cells);
    }
    // One texel, black, and what a file may hold by mistake.
    let one = Picture {
        size: [1, 1],
        texels: vec![DVec3::new(1e-12, 2e17, 3.0)],
    };
    compare_tables("one", &pictured(&one, [16, 8]), &one.resampled([16, 8]));
    let black = Picture {
        size: [3, 2],
        texels: vec![DVec3::ZERO; 6],
    };
    compare_tables(
        "black",
        &pictured(&black, [16, 8]),
        &black.resampled([16, 8]),
    );
    let mut broken = Picture::of([16, 8], sky::dim);
    for (i, value) in [f64::NAN, -3.0, f64::INFINITY, f64::NEG_INFINITY]
        .into_iter()
        .enumerate()
    {
        broken.texels[20 * i][i % 3] = value;
    }
    let cleaned = broken.resampled([16, 8]);
    assert!(
        cleaned
            .texels
            .iter()
            .all(|t| t.is_finite() && t.min_element() >= 0.0)
    );
    compare_tables("broken", &pictured(&broken, [16, 8]), &cleaned);
    // Sums of harmonics and lobes.
    let harmonics: [[f32; 3]; 9] =
        std::array::from_fn(|i| [2.0, 0.3, -0.2].map(|c| if i == 0 { 2.0 } else { c / i as f32 }));
    let size = [32, 16];
    let expected = Picture::of([32, 16], |d| {
        let basis = harmonics_at(d);
        clean(
            (0..9)
                .map(|i| DVec3::from(harmonics[i].map(f64::from)) * basis[i])
                .sum(),
        )
    });
    compare_sums(
        ("harmonics", 2.0),
        &built(size, EnvironmentSource::SphericalHarmonics(&harmonics)),
        &expected,
    );
    let lobe = |axis: DVec3, sharpness| SphericalGaussian {
        axis: axis.as_vec3(),
        sharpness,
        amplitude: 2.0,
    };
    let lobes = [
        (lobe(DVec3::new(0.6, 0.0, 0.8), 8.0), [1.0, 0.5, 0.2]),
        (lobe(DVec3::Y, 0.0), [0.1, 0.2, 0.3]),
    ];
    let expected = Picture::of([32, 16], |d| {
        let value = |(lobe, color): &(SphericalGaussian, [f32; 3])| {
            DVec3::from(color.map(f64::from)) * f64::from(lobe.evaluate(d.as_vec3()))
        };
        lobes.iter().map(value).sum()
    });
    compare_tables(
        "lobes",
        &built(size, EnvironmentSource::SphericalGaussians(&lobes)),
        &expected,
    );
}

/// Directions are as often where the density says, and looking one up gives the density that it was drawn with.
#[test]
fn samples_follow_their_density() {
    let rotation = DQuat::from_euler(deep_screen_space::glam::EulerRot::YXZ, 0.7, -0.4, 1.1);
    let cells = Cells::new(Picture::of([32, 16], sunny), rotation);
    let n = 256;
    let (mut integral, mut counted) = (DVec3::ZERO, 0.0);
    for i in 0..n * n {
        let point = DVec2::new(f64::from(i % n) + 0.5, f64::from(i / n) + 0.5) / f64::from(n);
        let drawn = cells.sample(point);
        assert!((drawn.direction.length() - 1.0).abs() < 1e-9);
        let there = cells.at(drawn.direction);
        // A direction on the edge of a cell may be the neighbour's.
        counted += f64::from(u8::from((there.pdf / drawn.pdf - 1.0).abs() < 1e-6));
        integral += drawn.radiance / drawn.pdf;
    }
    let all = f64::from(n * n);
    assert!(counted >= 0.999 * all, "{counted} of {all}");
    // The flux over the sphere, in two ways.
    let flux: DVec3 = (0..32 * 16)
        .map(|i| cells.radiance.texels[i] * cells.radiance.solid_angle(i / 32))
        .sum();
    let off = (integral / all / flux - 1.0).abs().max_element();
    assert!(off < 0.01, "{off}");
}

/// Of slow skies spherical harmonics give the irradiance within a hundredth of its mean, of a sun within a tenth of its peak.
#[test]
fn irradiance_is_the_integral() {
    for (name, shown, bound) in [
        ("dim", sky::dim as fn(DVec3) -> DVec3, 0.03),
        ("sunny", sunny, 0.11),
    ] {
        let picture = Picture::of([64, 32], shown);
        let environment = pictured(&picture, [64, 32]);
        let found: Vec<[f32; 4]> = lab().gpu.read_buffer(environment.irradiance());
        let (mut worst, mut most) = (0.0_f64, 0.0_f64);
        for i in 0..60 {
            let normal = direction_at(f64::from(i) * 0.618_034 % 1.0, (f64::from(i) + 0.5) / 60.0);
            let of_harmonics: DVec3 = polynomials_at(normal)
                .iter()
                .zip(&found)
                .map(|(p, [r, g, b, _])| *p * DVec3::new((*r).into(), (*g).into(), (*b).into()))
                .sum();
            let truth = picture.irradiance(normal);
            worst = worst.max((of_harmonics - truth).abs().max_element());
            most = most.max(truth.max_element());
        }
        println!("{name}: {worst:.4} of {most:.4}");
        assert!(worst <= bound * most, "{name}: {worst} of {most}");
    }
}

/// A colour is packed into steps of 1/256 of its largest component at most; weights are from sines and tables in f32.
const OFF: f64 = 1.0 / 100.0;
/// Share of rays that may differ more: see `ODD_RAYS` of the bounced z-buffer; and a direction at the edge of a cell may be the
/// neighbour's, where the radiance is another.
const FARTHER: f64 = 0.01;

struct Case {
    shot: Shot,
    senders: rays::Senders,
    materials: wgpu::Buffer,
}

impl Case {
    fn new(scene: &Scene, view: usize, size: [u32; 2]) -> Self {
        let lab = lab();
        let camera = camera_of(scene, view, size);
        let shot = Shot::new(lab.gpu, scene, &camera);
        Self {
            senders: lab.senders(&shot.buffers.meshes(), &camera, &triangles(), AMPLE),
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
        let origin = self.senders.cloud.origin();
        decoded.frame(encoder, self.shot.lit_gbuffer(), &self.shot.camera, origin)
    }

    fn input<'a>(
        &'a self,
        frame: &'a Frame<'a>,
        payload: Payload,
        lights: &'a [Light],
        environment: Option<EnvironmentLight<'a>>,
    ) -> BouncedInput<'a> {
        BouncedInput {
            radiance: match payload {
                Payload::LitRadiance => HitRadiance::Lit(HitLighting {
                    materials: &self.materials,
                    lights,
                }),
                _ => HitRadiance::None,
            },
            environment,
            ..BouncedInput::new(frame, &self.senders.cloud, &self.senders.bounds)
        }
    }

    fn view(&self, descriptor: &BouncedDescriptor, rays_per_pixel: u32) -> BouncedView {
        let viewport = self.shot.camera.viewport();
        pipelines::bounced(descriptor)
            .create_view(
                &lab().gpu.device,
                viewport.width,
                viewport.height,
                rays_per_pixel,
            )
            .expect("a view")
    }

    fn trace(
        &self,
        descriptor: &BouncedDescriptor,
        lights: &[Light],
        environment: Option<EnvironmentLight<'_>>,
        settings: &BouncedSettings,
    ) -> BouncedView {
        let view = self.view(descriptor, settings.rays_per_pixel);
        let mut encoder = lab().gpu.encoder();
        let mut decoded = Decoded::of(&self.shot.camera);
        let frame = self.frame(&mut encoder, &mut decoded);
        let input = self.input(&frame, descriptor.payload, lights, environment);
        pipelines::bounced(descriptor)
            .record(&lab().gpu.device, &mut encoder, &input, settings, &view)
            .expect("hits");
        lab().gpu.finish(encoder);
        view
    }

    /// The picture of hits, of a white surface.
    fn resolve(&self, hits: &BouncedView, settings: &HitResolverSettings) -> Vec<DVec3> {
        let resolver = pipelines::hit_resolver(&HitResolverDescriptor {
            payload: Payload::Sky,
            sampling: Sampling::Cosine,
            deferred: false,
            counted: false,
            joined: false,
            bent_normals: false,
            emitter_samples: 0,
            target: wgpu::TextureFormat::Rgba32Float,
        });
        let device = &lab().gpu.device;
        let viewport = self.shot.camera.viewport();
        let scratch = resolver.create_view(device, hits).expect("a view");
        let target = lab().gpu.target(
            wgpu::TextureFormat::Rgba32Float,
            viewport.width,
            viewport.height,
        );
        let mut encoder = lab().gpu.encoder();
        let mut decoded = Decoded::of(&self.shot.camera);
        let frame = self.frame(&mut encoder, &mut decoded);
        let input = HitResolverInput::new(&frame, hits, target.texture());
        resolver
            .record(device, &mut encoder, &input, settings, &scratch)
            .expect("a picture");
        lab().gpu.finish(encoder);
        let texels: Vec<[f32; 4]> = lab().gpu.read_texture(target.texture(), 0);
        texels
            .iter()
            .map(|[r, g, b, _]| DVec3::new((*r).into(), (*g).into(), (*b).into()))
            .collect()
    }

    fn truth(&self, environment: &Cells, radius: f64, rays: u32) -> Vec<Option<ColorEstimate>> {
        let receivers = sampled(&self.shot);
        self.shot
            .tracer
            .environment_image(&receivers, environment, (radius, rays), 3, false)
    }
}

/// Every third pixel of every third row: pixels a power of two apart would share their directions' points.
fn sampled(shot: &Shot) -> Vec<Option<Receiver>> {
    let width = shot.camera.viewport().width as usize;
    let is_taken = |i: usize| i % width % 3 == 1 && i / width % 3 == 1;
    let pixels = shot.pixels.iter().enumerate();
    pixels
        .map(|(i, p)| p.filter(|_| is_taken(i)).map(|p| p.receiver))
        .collect()
}

fn descriptor(payload: Payload) -> BouncedDescriptor {
    BouncedDescriptor {
        payload,
        environment: true,
        ..BouncedDescriptor::default()
    }
}

fn turned() -> DQuat {
    DQuat::from_rotation_y(2.1) * DQuat::from_rotation_x(0.3)
}

#[test]
fn rays_are_the_mirrors() {
    let environment = pictured(&Picture::of([32, 16], sunny), [32, 16]);
    for (scene, payload, rays_per_pixel, radius, share) in [
        (scenes::cornell(), Payload::Sky, 5, f32::INFINITY, 0.5),
        (scenes::dominoes(), Payload::Sky, 6, 0.3, 1.0),
        (
            scenes::dominoes(),
            Payload::LitRadiance,
            4,
            f32::INFINITY,
            0.5,
        ),
    ] {
        let case = Case::new(&scene, 0, [24, 20]);
        let all = if payload == Payload::Sky {
            Vec::new()
        } else {
            lights(&scene, 1.0, DVec3::ZERO)
        };
        let settings = BouncedSettings {
            rays_per_pixel,
            radius,
            environment_share: share,
            frame: 3,
            ..BouncedSettings::default()
        };
        let light = EnvironmentLight {
            environment: &environment,
            rotation: turned(),
        };
        let found = lab().colors(
            &case.trace(&descriptor(payload), &all, Some(light), &settings),
            &settings,
        );
        let origin = case.senders.cloud.origin();
        let receivers = case.shot.receivers(origin);
        let tracing = Tracing {
            receivers: &receivers,
            camera: &case.shot.camera,
            origin,
            settings: &settings,
            sampling: Sampling::Cosine,
            pieces: &case.senders.pieces,
        };
        let materials = scene.material_table();
        let near_lights: Vec<Light> = all.iter().map(|l| relative(l, origin)).collect();
        let expected = tracing.under(&read(&environment, turned()), |ray, hit| match payload {
            Payload::Sky => DVec3::ZERO,
            _ => tracing.lit_at(ray, hit, &materials, &near_lights),
        });
        assert_eq!(found.len(), expected.len());
        let (mut farther, mut lit) = (0, 0);
        for (found, expected) in found.iter().zip(&expected) {
            let off = (unpack_color(*found) - *expected).abs().max_element();
            assert!(off.is_finite(), "{found:x}");
            farther += usize::from(off > OFF * expected.max_element());
            lit += usize::from(expected.max_element() > 0.0);
        }
        println!(
            "{} {payload:?}: {farther} of {} differ, {lit} lit",
            scene.name,
            found.len()
        );
        assert!(lit * 10 > found.len(), "{lit} of {}", found.len());
        assert!(
            farther as f64 <= FARTHER * found.len() as f64,
            "{farther} of {}",
            found.len()
        );
    }
}

/// Root of the mean squared error over the truth's mean, with the truth's own noise taken out, and the mean error over it.
fn off(found: &[DVec3], truth: &[Option<ColorEstimate>]) -> [f64; 2] {
    let (mut squares, mut bias, mut mean, mut n) = (0.0, 0.0, 0.0, 0.0);
    for (found, truth) in found.iter().zip(truth) {
        if let Some(truth) = truth {
            let error = *found - truth.mean;
            squares += (error.length_squared() - truth.standard_error.length_squared()) / 3.0;
            bias += error.element_sum() / 3.0;
            mean += truth.mean.element_sum() / 3.0;
            n += 1.0;
        }
    }
    [(squares / n).max(0.0).sqrt() / (mean / n), bias / mean]
}

/// Relative errors against traced rays are those of the quality, under a dim sky and under one with a small sun, at a size where
/// pixels are coarse beside the shadows; and the mean over the picture is the truth's.
#[test]
fn light_of_skies_is_near_the_traced() {
    let scene = scenes::dominoes();
    let case = Case::new(&scene, 0, [128, 80]);
    for name in sky::NAMES {
        let picture = sky::by_name(name).expect("a sky");
        let environment = pictured(&picture, EnvironmentSettings::default().size);
        let cells = Cells::new(picture, DQuat::IDENTITY);
        let truth = case.truth(&cells, f64::INFINITY, 512);
        for (quality, bound) in [(Quality::Balanced, 0.10), (Quality::Accurate, 0.05)] {
            let rays = quality.rays(Payload::Sky);
            let light = EnvironmentLight::new(&environment);
            let settings = rays.bounced(f32::INFINITY);
            let hits = case.trace(&descriptor(Payload::Sky), &[], Some(light), &settings);
            let [error, bias] = off(&case.resolve(&hits, &rays.filter), &truth);
            println!("{name} {quality:?}: {error:.4}, bias {bias:+.4}");
            assert!(error <= bound, "{name} {quality:?}: {error}");
            // The filter's, and that a cell is wider than the sun's edge.
            assert!(bias.abs() <= 0.01, "{name} {quality:?}: {bias}");
        }
    }
}

/// Without a filter the mean over all pixels is the truth's within the noise of both, whatever share of the rays is drawn by
/// the environment: what the rays are weighed by adds up to one.
#[test]
fn light_of_skies_has_no_bias() {
    let scene = scenes::dominoes();
    let case = Case::new(&scene, 0, [48, 32]);
    let picture = Picture::of([64, 32], sunny);
    let environment = pictured(&picture, [64, 32]);
    let cells = Cells::new(picture, turned());
    let truth = case.truth(&cells, 0.5, 2048);
    let unfiltered = HitResolverSettings {
        radius: 0,
        ..HitResolverSettings::default()
    };
    for share in [0.0, 0.3, 0.5, 1.0] {
        let settings = BouncedSettings {
            rays_per_pixel: 64,
            radius: 0.5,
            environment_share: share,
            ..BouncedSettings::default()
        };
        let light = EnvironmentLight {
            environment: &environment,
            rotation: turned(),
        };
        let hits = case.trace(&descriptor(Payload::Sky), &[], Some(light), &settings);
        let [error, bias] = off(&case.resolve(&hits, &unfiltered), &truth);
        println!("share {share}: {error:.4}, bias {bias:+.4}");
        // Pixels' noise over the root of some hundred and seventy of them; twice that.
        assert!(
            bias.abs() <= f64::max(0.15 * error, 0.003),
            "{share}: {bias} of {error}"
        );
    }
}

/// A mirror, and what light meets, show an even sky as they show one colour, bit for bit.
#[test]
fn even_skies_are_one_color() {
    let scene = scenes::cornell();
    let case = Case::new(&scene, 0, [16, 12]);
    let color = [0.5, 0.25, 0.125];
    let even = Picture {
        size: [1, 1],
        texels: vec![DVec3::from(color)],
    };
    let environment = pictured(&even, [16, 8]);
    let settings = BouncedSettings {
        rays_per_pixel: 4,
        sky_radiance: color.map(|c| c as f32),
        environment_share: 0.0,
        ..BouncedSettings::default()
    };
    let all = lights(&scene, 1.0, DVec3::ZERO);
    let one = BouncedDescriptor {
        environment: false,
        ..descriptor(Payload::LitRadiance)
    };
    let expected = lab().colors(&case.trace(&one, &all, None, &settings), &settings);
    let light = EnvironmentLight::new(&environment);
    let found = case.trace(
        &descriptor(Payload::LitRadiance),
        &all,
        Some(light),
        &settings,
    );
    let found = lab().colors(&found, &settings);
    for (found, expected) in found.iter().zip(&expected) {
        let off = (unpack_color(*found) - unpack_color(*expected))
            .abs()
            .max_element();
        // A weight of one but for a rounding may pack to the next step.
        assert!(
            off <= 0.01 * unpack_color(*expected).max_element(),
            "{found:x} {expected:x}"
        );
    }
}

/// What recording a source says.
fn refused(environment: &Environment, source: EnvironmentSource<'_>) -> Result<(), Error> {
    let gpu = lab().gpu;
    let input = EnvironmentInput::new(source);
    builder().record(&gpu.device, &mut gpu.encoder(), &input, environment)
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let device = &lab().gpu.device;
    let setting = |result: Result<(), Error>, name: &str| {
        assert!(
            matches!(&result, Err(Error::Setting { field, .. }) if *field == name),
            "{name}: {result:?}"
        );
    };
    // What an environment does not go with.
    for bad in [
        BouncedDescriptor {
            environment: false,
            ..descriptor(Payload::Sky)
        },
        BouncedDescriptor {
            sampling: Sampling::Glossy,
            ..descriptor(Payload::Sky)
        },
        BouncedDescriptor {
            sampling: Sampling::Uniform,
            ..descriptor(Payload::LitRadiance)
        },
        descriptor(Payload::Occlusion),
    ] {
        let made = BouncedZBuffer::new(device, &bad).map(|_| ());
        setting(made, "BouncedDescriptor::environment");
    }
    for (size, name) in [
        ([15, 8], "EnvironmentSettings::size[0]"),
        ([2049, 8], "EnvironmentSettings::size[0]"),
        ([0, 0], "EnvironmentSettings::size[0]"),
        ([32, 7], "EnvironmentSettings::size[1]"),
        ([32, 33], "EnvironmentSettings::size[1]"),
    ] {
        setting(
            builder()
                .create(
                    device,
                    &EnvironmentSettings {
                        size,
                        ..EnvironmentSettings::default()
                    },
                )
                .map(|_| ()),
            name,
        );
    }
    let settings = EnvironmentSettings {
        size: [16, 8],
        ..EnvironmentSettings::default()
    };
    let environment = builder().create(device, &settings).expect("room");
    let lobe = SphericalGaussian {
        axis: DVec3::Y.as_vec3(),
        sharpness: 1.0,
        amplitude: 1.0,
    };
    let lobes = [(lobe, [1.0; 3]); 17];
    setting(
        refused(&environment, EnvironmentSource::SphericalGaussians(&lobes)),
        "EnvironmentSource::SphericalGaussians",
    );
    let target = |format, width| lab().gpu.storage(format, width, 4);
    let picture = |view: &wgpu::TextureView| {
        refused(
            &environment,
            EnvironmentSource::Equirectangular(view.texture().into()),
        )
    };
    let words = target(wgpu::TextureFormat::R32Uint, 8);
    assert!(matches!(picture(&words), Err(Error::Format { .. })));
    let wide = target(wgpu::TextureFormat::Rgba32Float, 2049);
    assert!(matches!(picture(&wide), Err(Error::Mismatch { .. })));
    let depth = lab().gpu.target(wgpu::TextureFormat::Depth32Float, 8, 8);
    assert!(picture(&depth).is_err());
    // Single hits of directions that an environment drew cannot be weighed anew.
    let case = Case::new(&scenes::cornell(), 0, [8, 8]);
    let bounced = BouncedSettings {
        rays_per_pixel: 2,
        ..BouncedSettings::default()
    };
    let view = case.view(&descriptor(Payload::Sky), 2);
    let mut decoded = Decoded::of(&case.shot.camera);
    let frame = case.frame(&mut lab().gpu.encoder(), &mut decoded);
    let trace = |environment| {
        let input = case.input(&frame, Payload::Sky, &[], environment);
        let mut encoder = lab().gpu.encoder();
        let tracer = pipelines::bounced(&descriptor(Payload::Sky));
        tracer.record(device, &mut encoder, &input, &bounced, &view)
    };
    assert!(matches!(
        trace(None),
        Err(Error::Mismatch { name, .. }) if name == "BouncedInput::environment"
    ));
    let light = EnvironmentLight::new(&environment);
    assert!(matches!(
        trace(Some(light)),
        Err(Error::Recording { name, .. }) if name == "Environment"
    ));
    let harmonics = [[1.0; 3]; 9];
    let even = EnvironmentSource::SphericalHarmonics(&harmonics);
    assert_eq!(refused(&environment, even), Ok(()));
    for rotation in [
        DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0),
        DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0),
    ] {
        setting(
            trace(Some(EnvironmentLight { rotation, ..light })),
            "EnvironmentLight::rotation",
        );
    }
    assert_eq!(trace(Some(light)), Ok(()));
    let share = BouncedSettings {
        environment_share: 1.5,
        ..bounced
    };
    setting(share.validate(), "BouncedSettings::environment_share");
    let deferred = pipelines::hit_resolver(&HitResolverDescriptor {
        payload: Payload::Sky,
        sampling: Sampling::Cosine,
        deferred: true,
        counted: false,
        joined: false,
        bent_normals: false,
        emitter_samples: 0,
        target: wgpu::TextureFormat::Rgba32Float,
    });
    let scratch = deferred.create_view(device, &view).expect("a view");
    let target = lab().gpu.target(wgpu::TextureFormat::Rgba32Float, 8, 8);
    let input = HitResolverInput::new(&frame, &view, target.texture());
    let filter = HitResolverSettings::default();
    let mut encoder = lab().gpu.encoder();
    assert!(matches!(
        deferred.record(device, &mut encoder, &input, &filter, &scratch),
        Err(Error::Mismatch { name, .. }) if name == "HitResolverInput::hits"
    ));
}

/// What is compiled without an environment has nothing of one.
#[test]
fn nothing_is_bound_without_an_environment() {
    let effect = deep_screen_space::AmbientOcclusion::default().effect();
    let all = deep_screen_space::shaders(&effect).expect("modules");
    let rays = all
        .iter()
        .filter(|s| s.name.starts_with("bounced_z_buffer"));
    let (with, without): (Vec<_>, Vec<_>) =
        rays.partition(|s| s.name.contains("sky") || s.name.contains("environment"));
    assert!(with.len() > 10 && without.len() > 10);
    for shader in without {
        let text: Vec<_> = shader
            .source
            .lines()
            .filter(|l| !l.trim_start().starts_with("//"))
            .collect();
        assert!(
            !text.iter().any(|line| line.contains("environment")),
            "{}",
            shader.name
        );
    }
    for shader in with {
        assert!(
            shader.source.contains("environment_radiance"),
            "{}",
            shader.name
        );
    }
}

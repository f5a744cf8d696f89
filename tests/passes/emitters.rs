//! Rays towards what shines of itself: the table and the rays against the mirror, that their mean is that of rays by chance, and
//! what is refused.

use std::f64::consts::PI;

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, BouncedView, BouncedZBuffer, Emitters,
    EmittersBuilder, EmittersInput, Error, Frame, GBuffer, HitEstimateInput, HitLighting,
    HitRadiance, HitResolver, HitResolverDescriptor, HitResolverInput, HitResolverSettings, Light,
    Payload, Primitives, RayBudget, RayBudgetInput, RayBudgetSettings, Sampling,
    glam::DVec3,
    reference::{
        bounced_z_buffer::Tracing,
        emitters::{self as mirror, Aiming},
        hashing::{hash2, unit_float},
        packing::unpack_color,
    },
    scenes::{self, Part, Scene},
    wgpu,
};
use support::testing::{
    frames::Decoded,
    pipelines,
    rays::{self, AMPLE, lab, lights, relative, triangles},
    refusals::refused,
    shot::{Shot, camera_of},
};

fn builder() -> &'static EmittersBuilder {
    pipelines::once(&(), |gpu| {
        EmittersBuilder::new(&gpu.device).expect("pipelines")
    })
}

fn descriptor(sampling: Sampling, emitter_samples: u32) -> BouncedDescriptor {
    BouncedDescriptor {
        payload: Payload::LitRadiance,
        sampling,
        emitter_samples,
        ..BouncedDescriptor::default()
    }
}

/// Of all glossy receivers here.
const ROUGHNESS: f64 = 0.4;

struct Case {
    shot: Shot,
    senders: rays::Senders,
    materials: wgpu::Buffer,
    roughness: wgpu::TextureView,
    emitters: Emitters,
}

impl Case {
    fn new(scene: &Scene, view: usize, size: [u32; 2]) -> Self {
        let lab = lab();
        let camera = camera_of(scene, view, size);
        let shot = Shot::new(lab.gpu, scene, &camera);
        let senders = lab.senders(&shot.buffers.meshes(), &camera, &triangles(), AMPLE);
        let usage = wgpu::BufferUsages::STORAGE;
        let materials = lab.gpu.buffer(&scene.material_table(), usage);
        let rough = vec![ROUGHNESS as f32; (size[0] * size[1]) as usize];
        let format = wgpu::TextureFormat::R32Float;
        let device = &lab.gpu.device;
        let case = Self {
            roughness: lab.gpu.texture(format, size[0], size[1], &rough),
            emitters: builder().create(device, &senders.cloud).expect("room"),
            shot,
            senders,
            materials,
        };
        case.find();
        case
    }

    /// Records what shines.
    fn find(&self) {
        let gpu = lab().gpu;
        let mut encoder = gpu.encoder();
        let input = EmittersInput::new(&self.senders.cloud, &self.materials);
        builder()
            .record(&gpu.device, &mut encoder, &input, &self.emitters)
            .expect("emitters");
        gpu.finish(encoder);
    }

    fn table(&self) -> Vec<u32> {
        lab().gpu.read_texture(self.emitters.table().texture(), 0)
    }

    /// The mirror with the table as it is.
    fn read(&self) -> mirror::Emitters {
        let mut before = self.table();
        before.truncate(self.senders.pieces.len() + 1);
        mirror::Emitters { before }
    }

    fn frame<'a>(
        &'a self,
        encoder: &mut wgpu::CommandEncoder,
        decoded: &'a mut Decoded<'_>,
    ) -> Frame<'a> {
        let gbuffer = GBuffer {
            roughness: Some(self.roughness.texture().into()),
            ..self.shot.lit_gbuffer()
        };
        let origin = self.senders.cloud.origin();
        decoded.frame(encoder, gbuffer, &self.shot.camera, origin)
    }

    fn input<'a>(&'a self, frame: &'a Frame<'a>, lights: &'a [Light]) -> BouncedInput<'a> {
        BouncedInput {
            radiance: HitRadiance::Lit(HitLighting {
                materials: &self.materials,
                lights,
            }),
            emitters: Some(&self.emitters),
            ..BouncedInput::new(frame, &self.senders.cloud, &self.senders.bounds)
        }
    }

    fn view(&self, descriptor: &BouncedDescriptor, rays_per_pixel: u32) -> BouncedView {
        let viewport = self.shot.camera.viewport();
        let (width, height) = (viewport.width, viewport.height);
        pipelines::bounced(descriptor)
            .create_view(&lab().gpu.device, width, height, rays_per_pixel)
            .expect("a view")
    }

    fn trace(
        &self,
        descriptor: &BouncedDescriptor,
        lights: &[Light],
        settings: &BouncedSettings,
    ) -> BouncedView {
        let view = self.view(descriptor, settings.rays_per_pixel);
        let mut encoder = lab().gpu.encoder();
        let mut decoded = Decoded::of(&self.shot.camera);
        let frame = self.frame(&mut encoder, &mut decoded);
        let input = self.input(&frame, lights);
        pipelines::bounced(descriptor)
            .record(&lab().gpu.device, &mut encoder, &input, settings, &view)
            .expect("hits");
        lab().gpu.finish(encoder);
        view
    }

    /// The unfiltered picture of one frame, with further rays if rays are counted.
    fn picture(&self, descriptor: &BouncedDescriptor, settings: &BouncedSettings) -> Vec<DVec3> {
        let (gpu, device) = (lab().gpu, &lab().gpu.device);
        let tracer = pipelines::bounced(descriptor);
        let resolver = pipelines::hit_resolver(&HitResolverDescriptor {
            payload: descriptor.payload,
            sampling: descriptor.sampling,
            deferred: false,
            counted: descriptor.counted,
            joined: false,
            bent_normals: false,
            emitter_samples: descriptor.emitter_samples,
            target: wgpu::TextureFormat::Rgba32Float,
        });
        let view = self.view(descriptor, settings.rays_per_pixel);
        let [width, height] = view.size();
        let scratch = resolver.create_view(device, &view).expect("a view");
        let target = gpu.target(wgpu::TextureFormat::Rgba32Float, width, height);
        let mut encoder = gpu.encoder();
        let mut decoded = Decoded::of(&self.shot.camera);
        let frame = self.frame(&mut encoder, &mut decoded);
        let input = self.input(&frame, &[]);
        tracer
            .record(device, &mut encoder, &input, settings, &view)
            .expect("hits");
        if descriptor.counted {
            let budget =
                pipelines::once(&(), |gpu| RayBudget::new(&gpu.device).expect("pipelines"));
            let room = budget.create_view(device, width, height).expect("a view");
            let hits = HitEstimateInput::new(&frame, &view);
            resolver
                .estimate(device, &mut encoder, &hits, &UNFILTERED, &scratch)
                .expect("means");
            let wanted = RayBudgetInput::new(&frame, &view, &scratch, &UNFILTERED);
            let further = RayBudgetSettings {
                rays_per_pixel: 20.0,
                ..RayBudgetSettings::default()
            };
            budget
                .record(device, &mut encoder, &wanted, &further, &room)
                .expect("a budget");
            tracer
                .record_more(device, &mut encoder, &input, settings, (&view, &room))
                .expect("further rays");
        }
        let input = HitResolverInput::new(&frame, &view, target.texture());
        resolver
            .record(device, &mut encoder, &input, &UNFILTERED, &scratch)
            .expect("a picture");
        gpu.finish(encoder);
        let texels: Vec<[f32; 4]> = gpu.read_texture(target.texture(), 0);
        let color = |t: [f32; 4]| DVec3::new(t[0].into(), t[1].into(), t[2].into());
        texels.into_iter().map(color).collect()
    }
}

const UNFILTERED: HitResolverSettings = HitResolverSettings {
    radius: 0,
    spread: 1.0,
    hit_distances: 1.0,
    damping: 1.0,
    plane_distance: 1.0,
    normal_power: 8.0,
    variance_clamp: 0.0,
    narrowing: 0.0,
    frames: 1.0,
    f0: [0.5; 3],
};

/// All colours of a view, those of a pixel together: of its rays, then of those towards emitters.
fn colors(view: &BouncedView, layers: u32) -> Vec<Vec<u32>> {
    let texture = view.radiance().expect("colours").texture();
    let layers: Vec<Vec<u32>> = (0..layers)
        .map(|layer| lab().gpu.read_texture(texture, layer))
        .collect();
    (0..layers[0].len())
        .map(|pixel| layers.iter().map(|layer| layer[pixel]).collect())
        .collect()
}

/// The Cornell box, without its lamp, with `count` small triangles in the air, whose radiosities are spread over so many decades
/// about 10; every other one shines from both sides.
fn strewn(count: u32, decades: f64, side: f64) -> Scene {
    let mut scene = scenes::cornell();
    for material in &mut scene.materials {
        material.emission = [0.0; 3];
    }
    for i in 0..count {
        let draw = |salt| unit_float(hash2(i, salt));
        let centre = DVec3::new(
            4.0 * draw(1) - 2.0,
            0.5 + 4.0 * draw(2),
            4.0 * draw(3) - 2.0,
        );
        let corner = |salt: u32| {
            let off = DVec3::new(draw(salt), draw(salt + 1), draw(salt + 2)) - 0.5;
            (centre + side * off).as_vec3().to_array()
        };
        let bright = 10_f64.powf(1.0 + decades * (draw(30) - 0.5)) as f32;
        let corners = [corner(10), corner(14), corner(18)].map(|c| DVec3::from(c.map(f64::from)));
        add(&mut scene, corners, bright, i % 2 == 0);
    }
    scene
}

/// Adds a triangle of such a radiosity.
fn add(scene: &mut Scene, corners: [DVec3; 3], bright: f32, double_sided: bool) {
    let material = scene.materials.len() as u32;
    scene.materials.push(scenes::Material {
        albedo: [0.5; 3],
        emission: [bright, 0.8 * bright, 0.5 * bright],
        double_sided,
    });
    scene.parts.push(Part {
        first_index: scene.indices.len() as u32,
        index_count: 3,
        material,
    });
    let first = scene.positions.len() as u32;
    scene.indices.extend(first..first + 3);
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let normal = normal.normalize_or(DVec3::Y).as_vec3().to_array();
    for corner in corners {
        scene.positions.push(corner.as_vec3().to_array());
        scene.normals.push(normal);
    }
}

/// The Cornell box lit by a lamp whose back lies right above its front, nearer than a hit is exact or in the same place: the back
/// shines up, or either shines to both sides.
fn thin_lamp(thickness: f64, double_sided: bool) -> Scene {
    let mut scene = strewn(0, 0.0, 0.0);
    let front = [
        DVec3::new(-0.5, 4.5, -0.5),
        DVec3::new(0.5, 4.5, -0.5),
        DVec3::new(0.0, 4.5, 0.5),
    ];
    let back = [front[0], front[2], front[1]].map(|corner| corner + thickness * DVec3::Y);
    add(&mut scene, front, 20.0, double_sided);
    add(&mut scene, back, 20.0, double_sided);
    scene
}

/// Weights are those of the mirror, and all of them in a table, for one lamp and for thousands over twelve decades.
#[test]
fn the_table_is_the_mirrors() {
    for (name, scene) in [
        ("cornell", scenes::cornell()),
        ("thousands", strewn(3000, 12.0, 0.05)),
        ("alike", strewn(3000, 0.0, 0.05)),
    ] {
        let case = Case::new(&scene, 0, [8, 8]);
        let table = case.table();
        let pieces = &case.senders.pieces;
        let expected = mirror::weights(pieces, &scene.material_table());
        assert_eq!(table[0], 0, "{name}");
        let (mut shining, mut off) = (0, 0);
        for (i, expected) in expected.iter().enumerate() {
            let found = table[i + 1] - table[i];
            // Of a logarithm near 1024 the last bit is 1.2e-4; a fraction may be rounded either way.
            let near = 1.0 + 5e-4 * f64::from(*expected);
            off += usize::from((f64::from(found) - f64::from(*expected)).abs() > near);
            shining += usize::from(found > 0);
        }
        let all = table[pieces.len()];
        println!("{name}: {shining} of {} shine, {all} in all", pieces.len());
        assert_eq!(off, 0, "{name}: {off} differ");
        assert!(shining > 1 && all > 1 << 20, "{name}: {shining}, {all}");
        assert!(
            table[pieces.len()..].iter().all(|sum| *sum == all),
            "{name}"
        );
    }
}

/// A colour is packed into steps of 1/256 of its largest component at most; the rest is f32's rounding.
const OFF: f64 = 1.0 / 100.0;
/// Share of rays that may differ more, as for lit hits; a ray that is aimed at an edge may meet what is beside it.
const FARTHER: f64 = 8e-3;

/// What both kinds of rays bring is the mirror's, to diffuse and to glossy receivers, with lights and without.
#[test]
fn rays_are_the_mirrors() {
    const RAYS: u32 = 6;
    const SAMPLES: u32 = 3;
    for (scene, view) in [(scenes::cornell(), 0), (strewn(40, 3.0, 0.4), 1)] {
        let case = Case::new(&scene, view, [48, 40]);
        let lights = lights(&scene, 1.0, DVec3::ZERO);
        let origin = case.senders.cloud.origin();
        let near_lights: Vec<Light> = lights.iter().map(|l| relative(l, origin)).collect();
        let materials = scene.material_table();
        let receivers = case.shot.receivers(origin);
        let emitters = case.read();
        for sampling in [Sampling::Cosine, Sampling::Glossy] {
            let settings = BouncedSettings {
                rays_per_pixel: RAYS,
                frame: 3,
                sky_radiance: [0.3, 0.2, 0.1],
                ..BouncedSettings::default()
            };
            let tracing = Tracing {
                receivers: &receivers,
                camera: &case.shot.camera,
                origin,
                settings: &settings,
                sampling,
                pieces: &case.senders.pieces,
            };
            let aiming = Aiming {
                tracing: &tracing,
                emitters: &emitters,
                samples: SAMPLES,
                lighting: (&materials, &near_lights),
                roughness: ROUGHNESS,
            };
            let per_sample = if sampling == Sampling::Glossy { 2 } else { 1 };
            let found = case.trace(&descriptor(sampling, SAMPLES), &lights, &settings);
            let found = colors(&found, RAYS + SAMPLES * per_sample);
            let by_chance_alone = Aiming {
                samples: 0,
                ..aiming
            };
            let (mut farther, mut all, mut shone) = (0, 0, 0);
            // Rays that met by chance what others are aimed at, and those of them that differ.
            let (mut met, mut met_off) = (0, 0);
            for (pixel, found) in found.iter().enumerate() {
                let mut expected: Vec<DVec3> =
                    (0..RAYS).map(|i| aiming.look(pixel, i, 0)).collect();
                for i in 0..SAMPLES {
                    let parts = aiming.shine(pixel, i, 0);
                    shone += usize::from(parts[0] != DVec3::ZERO);
                    expected.extend(&parts[..per_sample as usize]);
                }
                for (i, (found, expected)) in (0..).zip(found.iter().zip(&expected)) {
                    let off = (unpack_color(*found) - *expected).abs().max_element();
                    assert!(off.is_finite(), "{found:x}");
                    let is_off = off > OFF * expected.max_element();
                    farther += usize::from(is_off);
                    all += 1;
                    if i < RAYS {
                        let whole = by_chance_alone.look(pixel, i, 0);
                        let is_met = whole.max_element() > 1.1 * expected.max_element();
                        met += u32::from(is_met);
                        met_off += u32::from(is_met && is_off);
                    }
                }
            }
            let name = scene.name;
            println!("{name} {sampling:?}: {farther} of {all} differ, {shone} shone, {met} met");
            assert!(shone * 20 > all, "{shone} of {all}");
            assert!(met > 8 && met_off * 5 < met, "{met_off} of {met}");
            assert!(
                farther as f64 <= FARTHER * f64::from(all as u32),
                "{farther} of {all}"
            );
        }
    }
}

/// Over frames the mean of a picture.
fn over_frames(case: &Case, descriptor: &BouncedDescriptor, rays: u32, frames: u32) -> [f64; 2] {
    let means: Vec<f64> = (0..frames)
        .map(|frame| {
            let settings = BouncedSettings {
                rays_per_pixel: rays,
                frame,
                ..BouncedSettings::default()
            };
            let picture = case.picture(descriptor, &settings);
            let sum: f64 = picture.iter().map(|c| c.element_sum() / 3.0).sum();
            sum / picture.len() as f64
        })
        .collect();
    let n = f64::from(frames);
    let mean = means.iter().sum::<f64>() / n;
    let squares: f64 = means.iter().map(|m| (m - mean).powi(2)).sum();
    [mean, (squares / (n - 1.0) / n).sqrt()]
}

/// With rays towards emitters and without the mean is the same, within three times what frames differ by: they are stratified,
/// and their mean is off by less. Where one lamp shines they differ by so little that a twentieth would be seen.
#[test]
fn aimed_rays_have_no_bias() {
    const BOTH: &[Sampling] = &[Sampling::Cosine, Sampling::Glossy];
    // What is met of lamps in one another is the same for all receivers.
    const ONE: &[Sampling] = &[Sampling::Cosine];
    for (name, scene, most, samplings) in [
        ("cornell", scenes::cornell(), 0.015, BOTH),
        ("strewn", strewn(8, 1.0, 0.7), 0.03, BOTH),
        ("thin lamp", thin_lamp(1e-5, false), 0.03, BOTH),
        ("thin lamp, double-sided", thin_lamp(1e-5, true), 0.03, ONE),
        ("one lamp twice", thin_lamp(0.0, true), 0.03, ONE),
    ] {
        let case = Case::new(&scene, 0, [48, 32]);
        for &sampling in samplings {
            let plain = over_frames(&case, &descriptor(sampling, 0), 64, 40);
            for (samples, counted) in [(1, false), (4, true)] {
                let aimed = BouncedDescriptor {
                    counted,
                    ..descriptor(sampling, samples)
                };
                let aimed = over_frames(&case, &aimed, 6, 32);
                let off = (aimed[0] - plain[0]).abs();
                let noise = aimed[1].hypot(plain[1]);
                println!(
                    "{name} {sampling:?} {samples} {counted}: {:.5} ± {:.5}, without {:.5} ± {:.5}",
                    aimed[0], aimed[1], plain[0], plain[1]
                );
                assert!(noise < most * plain[0], "{noise} of {}", plain[0]);
                assert!(off <= 3.0 * noise, "{off}, noise {noise}");
            }
        }
    }
}

/// In a closed room all of which shines alike every pixel sees that light, however its rays are divided.
#[test]
fn a_room_that_shines_is_even() {
    let mut scene = scenes::closed_room();
    for material in &mut scene.materials {
        material.emission = [PI as f32, 0.5 * PI as f32, 2.0 * PI as f32];
        material.albedo = [1.0; 3];
        material.double_sided = true;
    }
    let case = Case::new(&scene, 0, [32, 24]);
    let expected = DVec3::new(1.0, 0.5, 2.0);
    for samples in [1, 4] {
        let settings = BouncedSettings {
            rays_per_pixel: 60,
            ..BouncedSettings::default()
        };
        let picture = case.picture(&descriptor(Sampling::Cosine, samples), &settings);
        let mean = picture.iter().sum::<DVec3>() / picture.len() as f64;
        let worst = picture
            .iter()
            .map(|c| (*c / expected - 1.0).abs().max_element());
        let worst = worst.fold(0.0, f64::max);
        println!("{samples}: {mean}, a pixel is off by up to {worst:.3}");
        // Aimed rays bring a twentieth of the light, with the noise of few.
        assert!(
            (mean / expected - 1.0).abs().max_element() < 0.005,
            "{mean}"
        );
        assert!(worst < 0.5, "{worst}");
    }
}

/// Where nothing shines what rays bring is bit for bit what it is without emitters, and those towards emitters bring nothing.
#[test]
fn without_emitters_rays_are_as_they_were() {
    let scene = strewn(0, 0.0, 0.0);
    let case = Case::new(&scene, 0, [16, 16]);
    let lights = lights(&scene, 1.0, DVec3::ZERO);
    let settings = BouncedSettings {
        rays_per_pixel: 5,
        ..BouncedSettings::default()
    };
    for sampling in [Sampling::Cosine, Sampling::Glossy] {
        let plain = case.trace(&descriptor(sampling, 0), &lights, &settings);
        let aimed = case.trace(&descriptor(sampling, 2), &lights, &settings);
        let layers = if sampling == Sampling::Glossy { 4 } else { 2 };
        let (plain, aimed) = (colors(&plain, 5), colors(&aimed, 5 + layers));
        let mut lit = 0;
        for (plain, aimed) in plain.iter().zip(&aimed) {
            assert_eq!(plain[..], aimed[..5], "{sampling:?}");
            assert!(aimed[5..].iter().all(|color| *color == 0), "{sampling:?}");
            lit += usize::from(plain.iter().any(|color| *color != 0));
        }
        assert!(lit > 100, "{lit} lit");
    }
}

/// Twelve decades of brightness in one scene, pieces without area, without a place and out of all bounds, receivers on lamps:
/// what comes of it is finite.
#[test]
fn extremes_are_finite() {
    for (side, brightness) in [(1e-4, 1e12), (0.3, 1e30), (3.0, 1.0), (0.3, 1e-30)] {
        let mut scene = strewn(60, 12.0, side);
        for material in &mut scene.materials {
            material.emission = material.emission.map(|e| e * brightness);
        }
        let lamps = scene.materials.len() - 60;
        scene.materials[lamps].emission = [f32::NAN, f32::INFINITY, -1.0];
        scene.materials[lamps + 1].emission = [f32::MAX; 3];
        let first = scene.positions.len() - 180;
        // A point, a line, and what is farther than a square can be.
        scene.positions[first + 7] = scene.positions[first + 6];
        scene.positions[first + 8] = scene.positions[first + 6];
        scene.positions[first + 11] = scene.positions[first + 10];
        scene.positions[first + 14] = [1e18, 1.0, 1e18];
        let case = Case::new(&scene, 1, [20, 16]);
        for sampling in [Sampling::Cosine, Sampling::Glossy] {
            let settings = BouncedSettings {
                rays_per_pixel: 4,
                ..BouncedSettings::default()
            };
            let picture = case.picture(&descriptor(sampling, 8), &settings);
            let sound = |c: &DVec3| c.is_finite() && c.min_element() >= 0.0;
            assert!(
                picture.iter().all(sound),
                "{side} {brightness} {sampling:?}"
            );
            let mean = picture.iter().sum::<DVec3>() / picture.len() as f64;
            println!("{side} {brightness} {sampling:?}: {mean}");
        }
    }
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    const SAMPLES: &str = "BouncedDescriptor::emitter_samples";
    let (gpu, device) = (lab().gpu, &lab().gpu.device);
    for bad in [
        descriptor(Sampling::Cosine, 17),
        descriptor(Sampling::Uniform, 1),
        BouncedDescriptor {
            payload: Payload::Radiance,
            ..descriptor(Sampling::Cosine, 1)
        },
        BouncedDescriptor {
            payload: Payload::Occlusion,
            ..descriptor(Sampling::Cosine, 1)
        },
        BouncedDescriptor {
            primitives: Primitives::Instances,
            ..descriptor(Sampling::Cosine, 1)
        },
    ] {
        refused(
            BouncedZBuffer::new(device, &bad),
            "Setting",
            SAMPLES,
            "0 to 16",
        );
    }
    let good = descriptor(Sampling::Cosine, 2);
    let tracer = pipelines::bounced(&good);
    let format = wgpu::TextureFormat::Rgba32Float;
    refused(
        tracer.resolver(device, format, true),
        "Setting",
        "HitResolverDescriptor::emitter_samples",
        "0 without radiance",
    );
    let case = Case::new(&scenes::cornell(), 0, [8, 8]);
    let settings = BouncedSettings::default();
    let view = case.view(&good, settings.rays_per_pixel);
    let mut decoded = Decoded::of(&case.shot.camera);
    let frame = case.frame(&mut gpu.encoder(), &mut decoded);
    let trace = |emitters| {
        let input = BouncedInput {
            emitters,
            ..case.input(&frame, &[])
        };
        tracer.record(device, &mut gpu.encoder(), &input, &settings, &view)
    };
    refused(
        trace(None),
        "Mismatch",
        "BouncedInput::emitters",
        "those of the cloud",
    );
    // Not recorded, and of another cloud's size.
    let unrecorded = builder().create(device, &case.senders.cloud).expect("room");
    refused(
        trace(Some(&unrecorded)),
        "Recording",
        "Emitters",
        "not recorded",
    );
    let small = deep_screen_space::CloudCapacity {
        pieces: 512,
        ..AMPLE
    };
    let other = lab()
        .surfelizer
        .create_cloud(device, small)
        .expect("a cloud");
    let of_other = builder().create(device, &other).expect("room");
    refused(
        trace(Some(&of_other)),
        "Mismatch",
        "Emitters",
        "room for 512 pieces",
    );
    let find = |input: &EmittersInput<'_>, emitters| {
        builder().record(device, &mut gpu.encoder(), input, emitters)
    };
    let input = EmittersInput::new(&case.senders.cloud, &case.materials);
    refused(
        find(&input, &of_other),
        "Mismatch",
        "Emitters",
        "that of the cloud",
    );
    let empty = EmittersInput::new(&other, &case.materials);
    refused(
        find(&empty, &of_other),
        "Recording",
        "SurfelCloud",
        "not recorded",
    );
    let tiny = gpu.buffer(&[0_u32; 4], wgpu::BufferUsages::STORAGE);
    let without = EmittersInput::new(&case.senders.cloud, &tiny);
    refused(
        find(&without, &case.emitters),
        "Buffer",
        "EmittersInput::materials",
        "bytes",
    );
    assert_eq!(trace(Some(&case.emitters)), Ok(()));
    // Hits with layers that the resolver knows nothing of.
    let plain = pipelines::bounced(&descriptor(Sampling::Cosine, 0));
    let resolver: HitResolver = plain.resolver(device, format, false).expect("pipelines");
    let scratch = resolver.create_view(device, &view).expect("a view");
    let target = gpu.target(format, 8, 8);
    let input = HitResolverInput::new(&frame, &view, target.texture());
    let resolved: Result<(), Error> =
        resolver.record(device, &mut gpu.encoder(), &input, &UNFILTERED, &scratch);
    refused(
        resolved,
        "Mismatch",
        "HitResolverInput::hits",
        "0 emitter samples",
    );
}

/// What is compiled without emitters has nothing of them.
#[test]
fn nothing_is_bound_without_emitters() {
    let effect = deep_screen_space::AmbientOcclusion::default().effect();
    let all = deep_screen_space::shaders(&effect).expect("modules");
    let passes = ["bounced_z_buffer", "hit_resolver"];
    let rays = all
        .iter()
        .filter(|s| passes.iter().any(|pass| s.name.starts_with(pass)));
    let (with, without): (Vec<_>, Vec<_>) = rays.partition(|s| s.name.contains("emitters"));
    assert!(with.len() > 10 && without.len() > 10);
    for shader in without {
        let mut code = shader
            .source
            .lines()
            .filter(|l| !l.trim_start().starts_with("//"));
        assert!(
            !code.any(|line| line.to_lowercase().contains("emitter")),
            "{}",
            shader.name
        );
    }
}

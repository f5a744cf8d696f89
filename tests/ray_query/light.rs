//! Light that shadow rays let through.

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, HitLighting, HitRadiance, Light, Payload,
    Sampling, ShadedLight, Shadow, SurfelRadiance, SurfelShaderInput, SurfelShaderSettings,
    SurfelizerSettings,
    glam::DVec3,
    reference::{bounced_z_buffer::Tracing, packing::unpack_color},
    scenes, wgpu,
};
use support::testing::{
    frames::Decoded,
    pipelines,
    rays::{self, Lab, Senders, lights, relative, triangles},
    shot::Shot,
};

use lab::{LABS, settings};

/// As in the tests of lit hits: how far a packed colour may be off, and the share of rays that may be farther.
const OFF: f64 = 1.0 / 200.0;
const FARTHER: f64 = 4e-3;

/// The colours of a view's hits, lit where they are.
fn lit_hits(
    lab: &Lab,
    shot: &Shot,
    senders: &Senders,
    (materials, lights): (&wgpu::Buffer, &[Light]),
    settings: &BouncedSettings,
) -> Vec<u32> {
    let device = &lab.gpu.device;
    let tracer = pipelines::bounced(&BouncedDescriptor {
        payload: Payload::LitRadiance,
        primitives: lab.primitives,
        ..BouncedDescriptor::default()
    });
    let [width, height] = [shot.camera.viewport().width, shot.camera.viewport().height];
    let view = tracer
        .create_view(device, width, height, settings.rays_per_pixel)
        .expect("a view");
    let mut encoder = lab.gpu.encoder();
    let mut decoded = Decoded::of(&shot.camera);
    let origin = senders.cloud.origin();
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, origin);
    let input = BouncedInput {
        radiance: HitRadiance::Lit(HitLighting { materials, lights }),
        ..BouncedInput::new(&frame, &senders.cloud, &senders.bounds)
    };
    tracer
        .record(device, &mut encoder, &input, settings, &view)
        .expect("hits");
    lab.gpu.finish(encoder);
    lab.colors(&view, settings)
}

#[test]
fn lit_hits_are_the_mirrors() {
    for (scene, size) in [
        (scenes::cornell(), 32),
        (scenes::closed_room(), 24),
        (scenes::dominoes(), 24),
    ] {
        let shot = LABS.shot(&scene, 0, size);
        let senders = LABS.senders(&shot, &triangles());
        let table = scene.material_table();
        let materials = LABS.gpu.buffer(&table, wgpu::BufferUsages::STORAGE);
        let all = lights(&scene, 1.0, DVec3::ZERO);
        let origin = senders[0].cloud.origin();
        let settings = BouncedSettings {
            sky_radiance: [0.3, 0.2, 0.1],
            ..settings(5)
        };
        let receivers = shot.receivers(origin);
        let own: Vec<Light> = all.iter().map(|light| relative(light, origin)).collect();
        let expected = Tracing {
            receivers: &receivers,
            camera: &shot.camera,
            origin,
            settings: &settings,
            sampling: Sampling::Cosine,
            pieces: &senders[0].pieces,
        }
        .lit(&table, &own);
        let farther = [0, 1].map(|i| {
            let lit = lit_hits(
                &LABS.both[i],
                &shot,
                &senders[i],
                (&materials, &all),
                &settings,
            );
            let off = |(found, expected): &(&u32, &DVec3)| {
                let off = (unpack_color(**found) - **expected).abs().max_element();
                off.is_nan() || off > OFF * expected.max_element()
            };
            lit.iter().zip(&expected).filter(off).count()
        });
        let rays = expected.len();
        println!(
            "{}: of {rays} colours {farther:?} differ, by the device and by the crate",
            scene.name
        );
        assert!(
            farther[0] as f64 <= FARTHER * rays as f64,
            "{}: {farther:?} of {rays}",
            scene.name
        );
    }
}

/// What surfels send of a light.
fn shade(
    lab: &Lab,
    senders: &Senders,
    light: Light,
    shadow: Shadow<'_>,
    samples: u32,
) -> Vec<SurfelRadiance> {
    let device = &lab.gpu.device;
    let materials = lab.gpu.buffer(
        &scenes::cornell().material_table(),
        wgpu::BufferUsages::STORAGE,
    );
    let shader = pipelines::surfel_shader();
    let radiance = shader
        .create_radiance(device, &senders.cloud)
        .expect("room");
    let mut encoder = lab.gpu.encoder();
    let lights = [ShadedLight { light, shadow }];
    let input = SurfelShaderInput::new(&senders.cloud, &materials, &lights, &radiance);
    shader
        .record(
            device,
            &mut encoder,
            &input,
            &SurfelShaderSettings { samples },
        )
        .expect("light");
    lab.gpu.finish(encoder);
    let mut all: Vec<SurfelRadiance> = lab.gpu.read_buffer(&radiance);
    all.truncate(senders.counts.stored as usize);
    all
}

/// The crate's own traversal, which is held to the mirror elsewhere, and the device's leave the same surfels in the dark.
#[test]
fn shadows_of_surfels_are_the_crates() {
    for scene in [scenes::cornell(), scenes::closed_room(), scenes::dominoes()] {
        let shot = LABS.shot(&scene, 0, 64);
        let cloud = SurfelizerSettings {
            radius_pixels: 2.0,
            ..triangles()
        };
        let senders = LABS.senders(&shot, &cloud);
        for light in lights(&scene, 1.0, DVec3::ZERO) {
            for samples in [1, 4] {
                let [device, own] = [0, 1].map(|i| {
                    let (lab, senders) = (&LABS.both[i], &senders[i]);
                    shade(
                        lab,
                        senders,
                        light,
                        Shadow::Traced(&senders.bounds),
                        samples,
                    )
                });
                let differ = device.iter().zip(&own).filter(|(a, b)| a != b).count();
                println!(
                    "{} {samples} samples: {differ} of {}",
                    scene.name,
                    own.len()
                );
                // As of the crate's own against the tracer.
                assert!(
                    differ <= 1 + own.len() / 200,
                    "{}: {differ} of {}",
                    scene.name,
                    own.len()
                );
            }
        }
    }
}

/// Lamps on and near the surfaces of a hall that hides nothing from them lose no light: what a light lies on casts no shadow.
#[test]
fn lamps_on_surfaces_lose_nothing() {
    let scene = rays::hall(&scenes::cornell());
    let shot = Shot::new(LABS.gpu, &scene, &hall_camera());
    let senders = LABS.senders(&shot, &SurfelizerSettings::default());
    let (mut lit, mut dark) = ([0, 0], [0, 0]);
    for light in rays::lamps() {
        for (i, senders) in senders.iter().enumerate() {
            let lab = &LABS.both[i];
            let all = shade(lab, senders, light, Shadow::None, 1);
            let traced = shade(lab, senders, light, Shadow::Traced(&senders.bounds), 1);
            for (all, traced) in all.iter().zip(&traced) {
                // A lamp within some roundings of a surface's plane may be behind it; its light is faint there.
                if all.front.iter().sum::<f32>() > 1e-2 {
                    lit[i] += 1;
                    dark[i] += usize::from(traced.front != all.front);
                }
            }
        }
    }
    println!("of {lit:?} lit {dark:?} are dark, by the device and by the crate");
    assert!(
        lit[0] > 10_000 && dark[0] <= lit[0] / 500,
        "{dark:?} of {lit:?}"
    );
}

fn hall_camera() -> deep_screen_space::Camera {
    deep_screen_space::Camera::look_at(
        DVec3::new(0.0, 1.7, 18.0),
        DVec3::new(0.0, 3.0, 0.0),
        DVec3::Y,
        support::raster::perspective(60.0, 1.0, 0.1),
        deep_screen_space::Viewport::full(48, 48),
    )
    .expect("a camera")
}

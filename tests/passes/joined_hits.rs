//! Means over frames resolved by the `HitResolver`: what the `TemporalAccumulator` joined, in a window that narrows.

use crate::hit_resolver::{rms, shot_of};
use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, Channels, HitEstimateInput, HitLighting,
    HitRadiance, HitResolver, HitResolverDescriptor, HitResolverInput, HitResolverSettings, Light,
    Payload, Sampling, TemporalAccumulator, TemporalJoinInput, TemporalSettings, Viewport,
    glam::DVec3,
    reference::{hit_resolver::HitResolution, packing::unpack_color, temporal_accumulator::Pixel},
    scenes::{self, Scene},
    wgpu,
};
use support::testing::{
    frames::Decoded,
    pipelines,
    rays::{AMPLE, Senders, lab, triangles},
    refusals::refused,
    shot::Shot,
};

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

fn channels(payload: Payload) -> Channels {
    match payload {
        Payload::Occlusion => Channels::One,
        _ => Channels::Three,
    }
}

fn accumulator(payload: Payload) -> &'static TemporalAccumulator {
    pipelines::once(&payload, |gpu| {
        TemporalAccumulator::new(&gpu.device, channels(payload), FORMAT).expect("pipelines")
    })
}

fn resolver(payload: Payload) -> &'static HitResolver {
    pipelines::hit_resolver(&HitResolverDescriptor {
        payload,
        sampling: Sampling::Cosine,
        deferred: false,
        counted: false,
        joined: true,
        bent_normals: false,
        emitter_samples: 0,
        target: FORMAT,
    })
}

fn lamp() -> [Light; 1] {
    [Light::Point {
        position: DVec3::new(0.3, 1.6, 0.2),
        intensity: [4.0; 3],
    }]
}

/// A scene as it is seen, and what its rays meet.
struct Stage {
    shot: Shot,
    senders: Senders,
    materials: wgpu::Buffer,
}

/// What some frames left.
struct Joined {
    picture: Vec<DVec3>,
    /// Of the last frame.
    incoming: Vec<DVec3>,
    nearness: Vec<u32>,
    pixels: Vec<Pixel>,
}

impl Stage {
    fn new(scene: &Scene, view: usize, size: [u32; 2]) -> Self {
        let lab = lab();
        let shot = shot_of(scene, view, size);
        let materials = scene.material_table();
        Self {
            senders: lab.senders(&shot.buffers.meshes(), &shot.camera, &triangles(), AMPLE),
            materials: lab.gpu.buffer(&materials, wgpu::BufferUsages::STORAGE),
            shot,
        }
    }

    /// Frames joined and resolved, or each one's alone where `joined` is false: then the picture is the last one's.
    fn render(
        &self,
        payload: Payload,
        (rays_per_pixel, first, count): (u32, u32, u32),
        filter: &HitResolverSettings,
        joined: bool,
    ) -> Joined {
        let lab = lab();
        let device = &lab.gpu.device;
        let Viewport {
            x,
            y,
            width,
            height,
        } = self.shot.camera.viewport();
        let tracer = pipelines::bounced(&BouncedDescriptor {
            payload,
            ..BouncedDescriptor::default()
        });
        let (resolver, accumulator) = (resolver(payload), accumulator(payload));
        let hits = tracer
            .create_view(device, width, height, rays_per_pixel)
            .expect("a view");
        let scratch = resolver.create_view(device, &hits).expect("a view");
        let mut history = accumulator
            .create_history(device, width, height)
            .expect("a history");
        let target = lab.gpu.target(FORMAT, x + width, y + height);
        let lights = lamp();
        let mut traced = BouncedSettings::default();
        for frame in first..first + count {
            traced = BouncedSettings {
                rays_per_pixel,
                frame,
                ..traced
            };
            let camera = &self.shot.camera;
            let mut encoder = lab.gpu.encoder();
            let mut decoded = Decoded::of(camera);
            let origin = self.senders.cloud.origin();
            let gbuffer = self.shot.lit_gbuffer();
            let frame = decoded.frame(&mut encoder, gbuffer, camera, origin);
            let input = BouncedInput {
                radiance: match payload {
                    Payload::Occlusion => HitRadiance::None,
                    _ => HitRadiance::Lit(HitLighting {
                        materials: &self.materials,
                        lights: &lights,
                    }),
                },
                ..BouncedInput::new(&frame, &self.senders.cloud, &self.senders.bounds)
            };
            tracer
                .record(device, &mut encoder, &input, &traced, &hits)
                .expect("hits");
            resolver
                .estimate(
                    device,
                    &mut encoder,
                    &HitEstimateInput::new(&frame, &hits),
                    filter,
                    &scratch,
                )
                .expect("means");
            let input = TemporalJoinInput::new(&frame, camera, &scratch);
            let settings = TemporalSettings {
                max_frames: u32::MAX,
                ..TemporalSettings::default()
            };
            accumulator
                .join(device, &mut encoder, &input, &settings, &mut history)
                .expect("a frame");
            let input = HitResolverInput {
                history: joined.then_some(&history),
                ..HitResolverInput::new(&frame, &hits, target.texture())
            };
            resolver
                .record(device, &mut encoder, &input, filter, &scratch)
                .expect("a picture");
            lab.gpu.finish(encoder);
        }
        let pixel = |mean: [f32; 3], frames: f32| Pixel {
            mean: DVec3::from(mean.map(f64::from)),
            frames: frames.into(),
        };
        let (incoming, pixels) = if payload == Payload::Occlusion {
            let n = rays_per_pixel as usize;
            let words = lab.blocked(&hits, &traced);
            let open =
                |i: usize| 1 - ((words[(i / n) * n.div_ceil(32) + i % n / 32] >> (i % n % 32)) & 1);
            let pixels = (width * height) as usize;
            let incoming = (0..pixels * n).map(|i| DVec3::splat(f64::from(open(i))));
            let means: Vec<[f32; 2]> = lab.gpu.read_texture(history.means().texture(), 0);
            let means = means
                .into_iter()
                .map(|[mean, frames]| pixel([mean; 3], frames));
            (incoming.collect(), means.collect())
        } else {
            let incoming = lab.colors(&hits, &traced).into_iter().map(unpack_color);
            let means: Vec<[f32; 4]> = lab.gpu.read_texture(history.means().texture(), 0);
            let means = means.into_iter();
            let means = means.map(|[r, g, b, frames]| pixel([r, g, b], frames));
            (incoming.collect(), means.collect())
        };
        let all: Vec<[f32; 4]> = lab.gpu.read_texture(target.texture(), 0);
        let row = (x + width) as usize;
        let inside = all
            .into_iter()
            .enumerate()
            .filter(|(i, _)| i / row >= y as usize && i % row >= x as usize);
        Joined {
            picture: inside
                .map(|(_, t)| DVec3::new(t[0].into(), t[1].into(), t[2].into()))
                .collect(),
            incoming,
            nearness: lab.gpu.read_buffer(hits.nearness()),
            pixels,
        }
    }
}

/// The same tolerance as for one frame (`hit_resolver::OFF`), and the power that narrows besides.
const OFF: f64 = 1e-4;

#[test]
fn joined_pictures_are_the_mirrors() {
    let scene = scenes::dominoes();
    let stage = Stage::new(&scene, 0, [31, 26]);
    let receivers = stage.shot.receivers(stage.senders.cloud.origin());
    for payload in [Payload::Occlusion, Payload::LitRadiance] {
        for (rays_per_pixel, frames, filter) in [
            (1, 3, HitResolverSettings::for_occlusion(1)),
            (2, 5, HitResolverSettings::for_light(2)),
            (
                4,
                2,
                HitResolverSettings {
                    narrowing: 1.0,
                    variance_clamp: 2.0,
                    ..HitResolverSettings::default()
                },
            ),
        ] {
            let found = stage.render(payload, (rays_per_pixel, 0, frames), &filter, true);
            let mut seen = found.pixels.iter().zip(&receivers);
            assert!(seen.all(|(p, r)| r.is_none() || p.frames == f64::from(frames)));
            let traced = BouncedSettings {
                rays_per_pixel,
                frame: frames - 1,
                ..BouncedSettings::default()
            };
            let mirror = HitResolution {
                camera: &stage.shot.camera,
                origin: stage.senders.cloud.origin(),
                receivers: &receivers,
                traced: &traced,
                payload,
                sampling: Sampling::Cosine,
                settings: &filter,
                deferred: false,
                incoming: &found.incoming,
                nearness: &found.nearness,
                counts: None,
                joined: Some(&found.pixels),
            };
            let expected = mirror.reconstruct(&mirror.average(), &mirror.near());
            let brightest = found.pixels.iter().map(|p| p.mean.max_element());
            let brightest = brightest.fold(1e-3, f64::max);
            let mut worst = 0.0_f64;
            for (i, (found, expected)) in found.picture.iter().zip(&expected).enumerate() {
                let expected = match (*expected, payload) {
                    (None, Payload::Occlusion) => DVec3::ONE,
                    (None, _) => DVec3::ZERO,
                    (Some(mean), Payload::Occlusion) => DVec3::splat(mean.x),
                    (Some(mean), _) => {
                        let triangle = stage.shot.pixels[i].expect("seen").triangle;
                        let albedo = scene.triangle_materials()[triangle].albedo;
                        mean * DVec3::from(albedo.map(f64::from))
                    }
                };
                worst = worst.max((*found - expected).abs().max_element() / brightest);
            }
            println!("{payload:?} {rays_per_pixel} rays, {frames} frames: worst {worst:.1e}");
            assert!(worst <= OFF, "{payload:?} {rays_per_pixel}: {worst:.1e}");
        }
    }
}

/// Eight frames of one ray of light are about as good as eight rays at once: no window blurs what another has blurred, and it
/// narrows as frames come. Over sixteen pictures of either kind, since single ones differ by half; the truth is a mean of 4096
/// rays. (Of occlusion the error is 1.16 times as large, and 1.06 times where pictures are filtered first and then joined.)
#[test]
fn frames_of_one_ray_are_as_good_as_their_rays_at_once() {
    let payload = Payload::LitRadiance;
    for scene in [scenes::cornell(), scenes::closed_room()] {
        let stage = Stage::new(&scene, 0, [64, 64]);
        let filter = HitResolverSettings::for_light;
        let alone = HitResolverSettings {
            radius: 0,
            ..HitResolverSettings::default()
        };
        let truth = stage.render(payload, (64, 0, 64), &alone, true).picture;
        let error = |rays, filter: &HitResolverSettings| {
            let found = stage.render(payload, rays, filter, true).picture;
            let off = found.iter().zip(&truth);
            let off: Vec<f64> = off.map(|(f, t)| (*f - *t).element_sum() / 3.0).collect();
            rms(&off)
        };
        let frames: Vec<_> = (0..16).map(|i| error((1, 8 * i, 8), &filter(1))).collect();
        let at_once: Vec<_> = (0..16).map(|i| error((8, i, 1), &filter(8))).collect();
        let ratio = rms(&frames) / rms(&at_once);
        println!("{}: {frames:.4?}, {at_once:.4?}: {ratio:.2}", scene.name);
        assert!(ratio <= 1.1, "{}: {ratio}", scene.name);
    }
}

/// A history of another size or kind, and estimates of another frame.
#[test]
fn what_does_not_fit_is_refused() {
    let lab = lab();
    let device = &lab.gpu.device;
    let stage = Stage::new(&scenes::cornell(), 0, [8, 8]);
    let tracer = pipelines::bounced(&BouncedDescriptor::default());
    let resolver = resolver(Payload::Occlusion);
    let hits = tracer.create_view(device, 8, 8, 1).expect("a view");
    let scratch = resolver.create_view(device, &hits).expect("a view");
    let camera = &stage.shot.camera;
    let mut encoder = lab.gpu.encoder();
    let mut decoded = Decoded::of(camera);
    let origin = stage.senders.cloud.origin();
    let frame = decoded.frame(&mut encoder, stage.shot.gbuffer(), camera, origin);
    let settings = TemporalSettings::default();
    let one = accumulator(Payload::Occlusion);
    let mut history = one.create_history(device, 8, 8).expect("a history");
    let input = TemporalJoinInput::new(&frame, camera, &scratch);
    let early = one.join(device, &mut encoder, &input, &settings, &mut history);
    refused(early, "Recording", "HitResolverView", "");
    let traced = BouncedSettings {
        rays_per_pixel: 1,
        ..BouncedSettings::default()
    };
    let rays = BouncedInput::new(&frame, &stage.senders.cloud, &stage.senders.bounds);
    tracer
        .record(device, &mut encoder, &rays, &traced, &hits)
        .expect("hits");
    let filter = HitResolverSettings::default();
    resolver
        .estimate(
            device,
            &mut encoder,
            &HitEstimateInput::new(&frame, &hits),
            &filter,
            &scratch,
        )
        .expect("means");
    let mut small = one.create_history(device, 4, 8).expect("a history");
    let found = one.join(device, &mut encoder, &input, &settings, &mut small);
    refused(found, "Mismatch", "TemporalHistory", "[8, 8] pixels");
    let colored = accumulator(Payload::LitRadiance);
    let colored = colored.create_history(device, 8, 8).expect("a history");
    let target = lab.gpu.target(FORMAT, 8, 8);
    for history in [&small, &colored] {
        let input = HitResolverInput {
            history: Some(history),
            ..HitResolverInput::new(&frame, &hits, target.texture())
        };
        let found = resolver.record(device, &mut encoder, &input, &filter, &scratch);
        refused(found, "Mismatch", "HitResolverInput::history", "One");
    }
    // One that nothing was joined into would be black.
    let input = HitResolverInput {
        history: Some(&history),
        ..HitResolverInput::new(&frame, &hits, target.texture())
    };
    let found = resolver.record(device, &mut encoder, &input, &filter, &scratch);
    refused(found, "Recording", "HitResolverInput::history", "");
    let found = HitResolver::new(
        device,
        &HitResolverDescriptor {
            payload: Payload::Occlusion,
            sampling: Sampling::Cosine,
            deferred: true,
            counted: false,
            joined: true,
            bent_normals: false,
            emitter_samples: 0,
            target: FORMAT,
        },
    );
    refused(
        found,
        "Setting",
        "HitResolverDescriptor::joined",
        "deferred",
    );
}

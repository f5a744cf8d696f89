//! Bent normals: against the mirror, against ray tracing, and what is refused.

use deep_screen_space::{
    BouncedSettings, BouncedView, Error, HitResolver, HitResolverDescriptor, HitResolverSettings,
    Payload, Sampling,
    glam::{DVec3, DVec4},
    reference::{
        directions::directions, hit_resolver::HitResolution, shell_splatter::Receiver, trace,
    },
    scenes::{self, Scene},
    wgpu,
};
use support::testing::{
    pipelines,
    rays::{self, AMPLE, lab, scene_of, triangles},
    shot::{Shot, camera_of},
};

const DESCRIPTOR: HitResolverDescriptor = HitResolverDescriptor {
    payload: Payload::Occlusion,
    sampling: Sampling::Cosine,
    deferred: false,
    counted: false,
    joined: false,
    bent_normals: true,
    emitter_samples: 0,
    target: wgpu::TextureFormat::Rgba32Float,
};

struct Case {
    shot: Shot,
    senders: rays::Senders,
    hits: BouncedView,
    traced: BouncedSettings,
}

impl Case {
    fn new(scene: &Scene, view: usize, size: [u32; 2], traced: BouncedSettings) -> Self {
        let lab = lab();
        let camera = camera_of(scene, view, size);
        let shot = Shot::new(lab.gpu, scene, &camera);
        let senders = lab.senders(&shot.buffers.meshes(), &camera, &triangles(), AMPLE);
        let hits = lab.trace(&shot, &senders, None, &traced, Sampling::Cosine);
        Self {
            shot,
            senders,
            hits,
            traced,
        }
    }

    fn picture(
        &self,
        descriptor: &HitResolverDescriptor,
        settings: &HitResolverSettings,
    ) -> Vec<DVec4> {
        let resolver = pipelines::hit_resolver(descriptor);
        lab()
            .reconstruct(resolver, &self.shot, &self.hits, settings)
            .iter()
            .map(|texel| DVec4::from_array(texel.map(f64::from)))
            .collect()
    }

    fn mirror(&self, settings: &HitResolverSettings) -> Vec<Option<DVec4>> {
        let origin = self.senders.cloud.origin();
        let receivers: Vec<Option<Receiver>> = self.shot.receivers(origin);
        let width = self.shot.camera.viewport().width;
        let per_pixel = self.traced.rays_per_pixel as usize;
        let words = lab().blocked(&self.hits, &self.traced);
        let each = per_pixel.div_ceil(32);
        let drawn = directions(&receivers, width, &self.traced, Sampling::Cosine);
        let incoming: Vec<DVec3> = (0..drawn.len())
            .map(|i| {
                let (pixel, index) = (i / per_pixel, i % per_pixel);
                let blocked = words[pixel * each + index / 32] >> (index % 32) & 1;
                DVec3::splat(f64::from(1 - blocked))
            })
            .collect();
        let mut nearness: Vec<u32> = lab().gpu.read_buffer(self.hits.nearness());
        nearness.truncate(receivers.len());
        let resolution = HitResolution {
            camera: &self.shot.camera,
            origin,
            receivers: &receivers,
            traced: &self.traced,
            payload: Payload::Occlusion,
            sampling: Sampling::Cosine,
            settings,
            deferred: false,
            incoming: &incoming,
            nearness: &nearness,
            counts: None,
            joined: None,
        };
        resolution.bent(&resolution.lean(), &resolution.near())
    }
}

fn traced(rays_per_pixel: u32, radius: f32) -> BouncedSettings {
    BouncedSettings {
        rays_per_pixel,
        radius,
        frame: 2,
        ..BouncedSettings::default()
    }
}

#[test]
fn bent_normals_are_the_mirrors() {
    for (scene, rays_per_pixel, radius) in [
        (scenes::cornell(), 6, f32::INFINITY),
        (scenes::dominoes(), 40, 0.5),
        (scenes::fence(), 1, f32::INFINITY),
    ] {
        let case = Case::new(&scene, 0, [28, 20], traced(rays_per_pixel, radius));
        let settings = HitResolverSettings::for_occlusion(rays_per_pixel);
        let found = case.picture(&DESCRIPTOR, &settings);
        let expected = case.mirror(&settings);
        let (mut worst, mut farther) = (0.0_f64, 0);
        for (found, expected) in found.iter().zip(&expected) {
            assert!(found.is_finite(), "{found}");
            let Some(expected) = expected else {
                assert_eq!(*found, DVec4::new(0.0, 0.0, 0.0, 1.0));
                continue;
            };
            let off = (*found - *expected).abs().max_element();
            worst = worst.max(off);
            // Weights are known to some roundings of positions; where little is open the mean direction is theirs.
            farther += usize::from(off > 1e-3);
            assert!((found.truncate().length() - 1.0).abs() < 1e-5, "{found}");
        }
        println!("{}: worst {worst:.2e}, {farther} farther", scene.name);
        assert!(farther * 100 <= found.len(), "{farther} of {}", found.len());
    }
}

/// A floor with nothing above it has its own normal, to rounding, however few the rays.
#[test]
fn open_floors_keep_their_normals() {
    let base = scenes::dominoes();
    let [a, b, c, d] = [[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]]
        .map(|[x, z]| DVec3::new(x, 0.0, z));
    let floor = scene_of(&[[a, c, b], [a, d, c]], &base);
    let case = Case::new(&floor, 0, [16, 12], traced(3, f32::INFINITY));
    let found = case.picture(&DESCRIPTOR, &HitResolverSettings::for_occlusion(3));
    let seen = found.iter().filter(|texel| texel.truncate() != DVec3::ZERO);
    let off = seen.map(|texel| {
        (*texel - DVec4::new(0.0, 1.0, 0.0, 1.0))
            .abs()
            .max_element()
    });
    let off: Vec<f64> = off.collect();
    assert!(off.len() > 50, "{}", off.len());
    let worst = off.iter().copied().fold(0.0, f64::max);
    assert!(worst < 1e-4, "{worst}");
}

/// Within 3° of the traced mean where the cone is narrower than 60°, at 64 rays per pixel; and in w is the picture of ambient
/// occlusion.
#[test]
fn bent_normals_are_near_the_traced_ones() {
    let scene = scenes::dominoes();
    let size = [256, 160];
    let case = Case::new(&scene, 0, size, traced(64, scene.ao_radius));
    let filter = HitResolverSettings::for_bent_normals(64);
    let found = case.picture(&DESCRIPTOR, &filter);
    // Every fifth pixel of every fifth row, among which each point of a direction's cell has its share.
    let width = size[0] as usize;
    let is_taken = |i: usize| i % width % 5 == 2 && i / width % 5 == 2;
    let pixels = case.shot.pixels.iter().enumerate();
    let receivers: Vec<Option<trace::Receiver>> = pixels
        .map(|(i, p)| p.filter(|_| is_taken(i)).map(|p| p.receiver))
        .collect();
    let tracer = &case.shot.tracer;
    let truth = tracer.bent_normal_image(&receivers, f64::from(scene.ao_radius), 1024, 9, false);
    let (mut narrow, mut count) = (0.0, 0.0);
    for (found, truth) in found.iter().zip(&truth) {
        let Some(truth) = truth else { continue };
        let cone = HitResolver::cone_angle(truth.visibility as f32).to_degrees();
        if truth.visibility > 0.0 && cone < 60.0 {
            narrow += found.truncate().angle_between(truth.mean).to_degrees();
            count += 1.0;
        }
    }
    println!("{:.2}° over {count} pixels", narrow / count);
    assert!(count > 200.0, "{count}");
    assert!(narrow / count <= 3.0, "{}", narrow / count);
    let plain = HitResolverDescriptor {
        bent_normals: false,
        ..DESCRIPTOR
    };
    let filter = HitResolverSettings {
        variance_clamp: 0.0,
        ..filter
    };
    let found = case.picture(&DESCRIPTOR, &filter);
    let visibility = case.picture(&plain, &filter);
    for (found, plain) in found.iter().zip(&visibility) {
        assert!((found.w - plain.x).abs() < 1e-4, "{found} {plain}");
    }
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let device = &lab().gpu.device;
    let with = |change: fn(&mut HitResolverDescriptor)| {
        let mut descriptor = DESCRIPTOR;
        change(&mut descriptor);
        HitResolver::new(device, &descriptor).map(|_| ())
    };
    for change in [
        (|d| d.payload = Payload::Radiance) as fn(&mut HitResolverDescriptor),
        |d| d.sampling = Sampling::Glossy,
        |d| d.sampling = Sampling::Uniform,
        |d| d.deferred = true,
        |d| d.counted = true,
        |d| d.joined = true,
    ] {
        let refused = with(change);
        assert!(
            matches!(&refused, Err(Error::Setting { field, .. }) if *field == "HitResolverDescriptor::bent_normals"),
            "{refused:?}"
        );
    }
    for change in [
        (|d| d.target = wgpu::TextureFormat::Rgba8Unorm) as fn(&mut HitResolverDescriptor),
        |d| d.target = wgpu::TextureFormat::R32Float,
    ] {
        let refused = with(change);
        assert!(matches!(&refused, Err(Error::Format { .. })), "{refused:?}");
    }
    assert_eq!(
        with(|d| d.target = wgpu::TextureFormat::Rgba16Float),
        Ok(())
    );
    assert_eq!(HitResolver::cone_angle(-1.0), 0.0);
    assert!((HitResolver::cone_angle(0.75).to_degrees() - 60.0).abs() < 1e-3);
    assert!((HitResolver::cone_angle(7.0).to_degrees() - 90.0).abs() < 1e-3);
}

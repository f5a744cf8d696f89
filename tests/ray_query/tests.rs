//! Rays that the device traces (`Primitives::RayQuery`): against the mirrors, beside the crate's own traversal, and what is
//! refused. `scripts/ray_query.sh` runs them on a driver that has such rays.

use std::sync::LazyLock;

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, BouncedZBuffer, BvhBuilder, Camera,
    CloudCapacity, Error, HitLighting, HitRadiance, Light, Mesh, Payload, Primitives, Sampling,
    ShadedLight, Shadow, SurfelRadiance, SurfelShaderInput, SurfelShaderSettings,
    SurfelizerSettings, Timestamps, Viewport,
    glam::DVec3,
    reference::{
        bounced_z_buffer::{Senders as Sent, Tracing},
        light::arrival,
        packing::unpack_color,
    },
    scenes::{self, Scene},
    wgpu,
};
use support::{
    gpu::Gpu,
    raster::perspective,
    testing::{
        frames::Decoded,
        pipelines,
        rays::{self, AMPLE, Lab, Senders, differing_bits, hall, moved, scene_of, triangles},
        shot::{Shot, camera_of},
    },
};

/// The device and both ways to trace.
struct Labs {
    gpu: &'static Gpu,
    by_device: Lab,
    own: Lab,
}

static LABS: LazyLock<Labs> = LazyLock::new(|| {
    let gpu = pipelines::gpu_or(|| {
        // Safety: the token says that bugs of wgpu's experimental features are known to be possible. It is what a test of
        // them is for.
        #[expect(unsafe_code, reason = "wgpu has no other way to ask for ray queries")]
        let token = unsafe { wgpu::ExperimentalFeatures::enabled() };
        Gpu::open_for_ray_queries(token).expect("ray queries; scripts/ray_query.sh has a driver")
    });
    println!("{}", gpu.name());
    Labs {
        gpu,
        by_device: Lab::of(Primitives::RayQuery),
        own: Lab::of(Primitives::Triangles),
    }
});

/// As in the tests of the bounced z-buffer: the share of rays that may pass an edge by less than rounding.
const ODD_RAYS: f64 = 2e-3;
/// And with a colour of its own for each surfel, whose edges are edges too.
const ODD_COLORS: f64 = 3e-3;

fn settings(rays_per_pixel: u32) -> BouncedSettings {
    BouncedSettings {
        rays_per_pixel,
        ..BouncedSettings::default()
    }
}

fn shot_of(scene: &Scene, view: usize, size: u32) -> Shot {
    Shot::new(LABS.gpu, scene, &camera_of(scene, view, [size, size]))
}

fn senders_of(lab: &Lab, shot: &Shot, settings: &SurfelizerSettings) -> Senders {
    lab.senders(&shot.buffers.meshes(), &shot.camera, settings, AMPLE)
}

/// How many rays are otherwise than the mirror's, by the device and by the crate's own traversal; and of how many.
fn odd_rays(shot: &Shot, senders: &[Senders; 2], settings: &BouncedSettings) -> ([u32; 2], f64) {
    let receivers = shot.receivers(senders[0].cloud.origin());
    let expected = Tracing {
        receivers: &receivers,
        camera: &shot.camera,
        origin: senders[0].cloud.origin(),
        settings,
        sampling: Sampling::Cosine,
        pieces: &senders[0].pieces,
    }
    .blocked();
    let labs = [&LABS.by_device, &LABS.own];
    let odd = [0, 1].map(|i| {
        let view = labs[i].trace(shot, &senders[i], None, settings, Sampling::Cosine);
        differing_bits(&labs[i].blocked(&view, settings), &expected)
    });
    let rays = receivers.iter().flatten().count() * settings.rays_per_pixel as usize;
    (odd, rays.max(1) as f64)
}

fn both(shot: &Shot, settings: &SurfelizerSettings) -> [Senders; 2] {
    [&LABS.by_device, &LABS.own].map(|lab| senders_of(lab, shot, settings))
}

#[test]
fn hits_are_the_mirrors() {
    for (scene, size, cases) in [
        (
            scenes::closed_room(),
            32,
            &[(1, f32::INFINITY), (5, 1.0), (64, 0.3)][..],
        ),
        (
            scenes::cornell(),
            32,
            &[(4, f32::INFINITY), (16, 0.5), (33, f32::INFINITY)],
        ),
        (scenes::colonnade(), 16, &[(4, f32::INFINITY), (16, 2.0)]),
        (scenes::dominoes(), 24, &[(5, 0.1), (4, f32::INFINITY)]),
        (scenes::fence(), 24, &[(4, f32::INFINITY)]),
    ] {
        let shot = shot_of(&scene, 0, size);
        let senders = both(&shot, &triangles());
        for &(rays_per_pixel, radius) in cases {
            let settings = BouncedSettings {
                radius,
                ..settings(rays_per_pixel)
            };
            let (odd, rays) = odd_rays(&shot, &senders, &settings);
            let name = format!("{} {rays_per_pixel} rays, radius {radius}", scene.name);
            println!(
                "{name}: of {rays} rays differ {} by the device, {} by the crate's own traversal",
                odd[0], odd[1]
            );
            // Of the few rays of a small image four may be odd, whatever share that is.
            assert!(
                f64::from(odd[0]) <= (ODD_RAYS * rays).max(4.0),
                "{name}: {odd:?}"
            );
        }
    }
}

/// Far and near, large and small.
#[test]
fn scales_make_no_difference() {
    let scene = scenes::cornell();
    for (scale, shift) in [
        (1e-4, DVec3::ZERO),
        (1e6, DVec3::ZERO),
        (1.0, DVec3::new(1e4, -3e3, 2e4)),
    ] {
        let scene = moved(&scene, scale, shift);
        let shot = shot_of(&scene, 0, 32);
        let senders = both(&shot, &triangles());
        let (odd, rays) = odd_rays(&shot, &senders, &settings(16));
        println!("scale {scale}, shift {shift}: of {rays} rays differ {odd:?}");
        assert!(
            f64::from(odd[0]) <= ODD_RAYS * rays,
            "scale {scale}: {odd:?} of {rays}"
        );
    }
}

#[test]
fn probe() {
    for scene in [scenes::cornell(), scenes::closed_room()] {
    let shot = shot_of(&scene, 0, 16);
    let n = shot.buffers.triangles();
    for extra in [0, 1, 10, 100, 1000, 60000] {
        for radius in [f32::INFINITY, 1.0, 1e6] {
            let cap = CloudCapacity { surfels: 1000, pieces: n + extra, triangles: 1 << 17 };
            let s = [&LABS.by_device, &LABS.own].map(|lab| lab.senders(&shot.buffers.meshes(), &shot.camera, &triangles(), cap));
            let settings = BouncedSettings { radius, ..settings(4) };
            println!("{} {n} + {extra}, radius {radius}: {:?} {:?}", scene.name, odd_rays(&shot, &s, &settings), s[0].counts);
        }
    }
    }
}

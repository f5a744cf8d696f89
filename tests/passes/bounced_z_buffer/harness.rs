//! A shot's hits by GPU and by mirror.

use deep_screen_space::{
    BouncedSettings, Sampling, SurfelizerSettings, reference::bounced_z_buffer::Tracing,
    scenes::Scene,
};

use support::testing::{
    rays::{self, AMPLE, differing_bits, lab},
    shot::{Shot, camera_of},
};

pub const SAMPLINGS: [Sampling; 2] = [Sampling::Cosine, Sampling::Uniform];

/// Share of rays for which f32 may find otherwise than f64: those that pass an edge by less than rounding. Directions are
/// off by some 1e-6 where a driver's sine is good and by up to 2^-11 where it is as WGSL allows; of random rays about
/// that share, times the length of the edges in sight over their extent (some tens), passes an edge as closely. The
/// octahedral normal of a curved surface may also be rounded to the next step, which turns all rays of a pixel by 3e-5.
pub const ODD_RAYS: f64 = 2e-3;

pub fn settings(rays_per_pixel: u32) -> BouncedSettings {
    BouncedSettings {
        rays_per_pixel,
        ..BouncedSettings::default()
    }
}

/// A shot's hits by GPU and by mirror; returns the share of rays that differ.
pub fn compare(
    name: &str,
    shot: &Shot,
    senders: &rays::Senders,
    settings: &BouncedSettings,
    sampling: Sampling,
) -> f64 {
    let lab = lab();
    let view = lab.trace(shot, senders, None, settings, sampling);
    let found = lab.blocked(&view, settings);
    let receivers = shot.receivers(senders.cloud.origin());
    let tracing = Tracing {
        receivers: &receivers,
        camera: &shot.camera,
        origin: senders.cloud.origin(),
        settings,
        sampling,
        pieces: &senders.pieces,
    };
    let rays = (receivers.iter().flatten().count() * settings.rays_per_pixel as usize).max(1);
    let odd = differing_bits(&found, &tracing.blocked());
    let blocked: u32 = found.iter().map(|word| word.count_ones()).sum();
    println!("{name}: {odd} of {rays} rays differ, {blocked} blocked");
    // Any hit will do: none is nearer than the nearest, and where there is one it is somewhere.
    let words = settings.rays_per_pixel.div_ceil(32).max(1) as usize;
    let near: Vec<u32> = lab.gpu.read_buffer(view.nearness());
    let most = tracing.nearness().into_iter().map(f64::from);
    let nearer = near
        .iter()
        .zip(most)
        .filter(|&(&near, most)| f64::from(near) > most + NEARNESS_OFF)
        .count();
    assert!(nearer <= odd as usize, "{name}: {nearer} pixels are nearer");
    for (near, bits) in near.iter().zip(found.chunks(words)) {
        assert_eq!(*near > 0, bits.iter().any(|word| *word > 0), "{name}");
    }
    f64::from(odd) / rays as f64
}

/// How far a pixel's nearness may be off, where one is 2^24: of hits within the pixel itself distances are short, positions are
/// rounded to 1e-6 of theirs, and a driver's sines turn the ray. Measured at 1e-4 on lavapipe, 3e-4 on `SwiftShader`.
pub const NEARNESS_OFF: f64 = 1e-3 * 16_777_216.0;

pub fn shot_of(scene: &Scene, view: usize, size: [u32; 2]) -> Shot {
    Shot::new(lab().gpu, scene, &camera_of(scene, view, size))
}

pub fn senders_of(shot: &Shot, settings: &SurfelizerSettings) -> rays::Senders {
    lab().senders(&shot.buffers.meshes(), &shot.camera, settings, AMPLE)
}

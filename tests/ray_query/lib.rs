//! The device that rays are traced by, and the two ways to trace them: its own, and the crate's.

use std::sync::LazyLock;

use deep_screen_space::{
    BouncedSettings, CloudCapacity, Primitives, SurfelizerSettings, scenes::Scene, wgpu,
};
use support::{
    gpu::Gpu,
    testing::{
        pipelines,
        rays::{AMPLE, Lab, Senders},
        shot::{Shot, camera_of},
    },
};

/// The device, and the two ways to trace: its own, and the crate's.
pub struct Labs {
    /// The device.
    pub gpu: &'static Gpu,
    /// By the device, and by the crate.
    pub both: [Lab; 2],
}

/// A device for ray queries, with limits or with all that it may need.
#[expect(
    unsafe_code,
    reason = "wgpu can be asked for ray queries in no other way"
)]
pub fn open(limits: Option<wgpu::Limits>) -> Gpu {
    // SAFETY: this says that bugs of wgpu's experimental features are known to be possible, which is what tests are for.
    let token = unsafe { wgpu::ExperimentalFeatures::enabled() };
    let gpu = Gpu::open_for_ray_queries(token, limits);
    gpu.expect("ray queries; scripts/ray_query.sh has a driver")
}

/// Made once.
pub static LABS: LazyLock<Labs> = LazyLock::new(|| {
    let gpu = pipelines::gpu_or(|| open(None));
    Labs {
        gpu,
        both: [Primitives::RayQuery, Primitives::Triangles].map(Lab::of),
    }
});

impl Labs {
    /// A scene seen by one of its cameras.
    pub fn shot(&self, scene: &Scene, view: usize, size: u32) -> Shot {
        Shot::new(self.gpu, scene, &camera_of(scene, view, [size, size]))
    }

    /// The same triangles twice.
    pub fn senders(&self, shot: &Shot, settings: &SurfelizerSettings) -> [Senders; 2] {
        self.senders_in(shot, settings, AMPLE)
    }

    /// With room for so much.
    pub fn senders_in(
        &self,
        shot: &Shot,
        settings: &SurfelizerSettings,
        capacity: CloudCapacity,
    ) -> [Senders; 2] {
        let meshes = shot.buffers.meshes();
        [0, 1].map(|i| self.both[i].senders(&meshes, &shot.camera, settings, capacity))
    }
}

/// The defaults with so many rays.
pub fn settings(rays_per_pixel: u32) -> BouncedSettings {
    BouncedSettings {
        rays_per_pixel,
        ..BouncedSettings::default()
    }
}

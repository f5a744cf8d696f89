//! What the GPU reads: `Params` of `wgsl/bounced_z_buffer.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::{
    descriptor::BouncedDescriptor,
    settings::{BouncedSettings, DiskSettings, Sampling},
    words,
};
use crate::{
    bvh::disks::DiskBounds,
    bvh::disks::MAX_LEVELS,
    light::{Light, LightParams},
};

/// Stands for infinity; its square is finite in f32.
const UNBOUNDED: f32 = 1e18;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BouncedParams {
    pub(crate) size: [u32; 2],
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    pub(crate) frame: u32,
    pub(crate) words: u32,
    pub(crate) surfel_capacity: u32,
    pub(crate) level: u32,
    pub(crate) sky_radiance: [f32; 3],
    pub(crate) world_radius: f32,
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: BouncedParams as "Params" in [
        "bounced_z_buffer occlusion", "bounced_z_buffer radiance",
        "bounced_z_buffer occlusion glossy", "bounced_z_buffer radiance glossy",
        "bounced_z_buffer occlusion list", "bounced_z_buffer radiance more",
    ]
    { size, columns, rows, frame, words, surfel_capacity, level, sky_radiance, world_radius }
);

impl BouncedParams {
    pub fn new(settings: &BouncedSettings, size: [u32; 2], surfel_capacity: u32) -> Self {
        let [columns, rows] = grid(settings.rays_per_pixel);
        // Without directions nothing is met and nothing arrives.
        let (sky_radiance, radius) = if settings.rays_per_pixel == 0 {
            ([0.0; 3], 0.0)
        } else {
            (settings.sky_radiance, settings.radius)
        };
        Self {
            size,
            columns,
            rows,
            frame: settings.frame,
            words: words(settings.rays_per_pixel),
            surfel_capacity,
            level: 0,
            sky_radiance,
            world_radius: radius.min(UNBOUNDED),
        }
    }
}

/// Bytes of the shader's `PixelRays`.
pub(crate) fn pixel_rays_bytes(descriptor: &BouncedDescriptor) -> u64 {
    match (descriptor.payload.is_radiance(), descriptor.sampling) {
        (false, _) => OCCLUSION_RAYS_BYTES,
        (true, Sampling::Glossy) => GLOSSY_RAYS_BYTES,
        (true, _) => RADIANCE_RAYS_BYTES,
    }
}

const OCCLUSION_RAYS_BYTES: u64 = 8;
const RADIANCE_RAYS_BYTES: u64 = 16;
const GLOSSY_RAYS_BYTES: u64 = 32;

crate::reflection::bytes_of_wgsl!(
    occlusion_rays_are_the_shaders: OCCLUSION_RAYS_BYTES, as "PixelRays" in [
        "bounced_z_buffer occlusion more", "hit_resolver occlusion counted average",
    ]
);
crate::reflection::bytes_of_wgsl!(
    radiance_rays_are_the_shaders: RADIANCE_RAYS_BYTES, as "PixelRays" in [
        "bounced_z_buffer radiance more", "hit_resolver radiance counted average",
    ]
);
crate::reflection::bytes_of_wgsl!(
    glossy_rays_are_the_shaders: GLOSSY_RAYS_BYTES, as "PixelRays" in [
        "bounced_z_buffer radiance glossy more", "hit_resolver radiance glossy counted average",
        "hit_resolver radiance glossy counted near",
    ]
);

/// Lights that hits can have.
pub(crate) const MAX_LIGHTS: usize = 16;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct LightsParams {
    pub(crate) lights: [LightParams; MAX_LIGHTS],
    pub(crate) count: u32,
    pub(crate) padding: [u32; 3],
}

crate::reflection::same_as_wgsl!(
    lights_are_the_shaders: LightsParams as "Lights" in ["bounced_z_buffer radiance lit"]
    { lights, count }
);

impl LightsParams {
    /// Of those that shine, [`MAX_LIGHTS`] at most, relative to `origin`.
    pub fn new(lights: &[Light], origin: DVec3) -> Self {
        let mut params = Self {
            lights: [LightParams::default(); MAX_LIGHTS],
            count: 0,
            padding: [0; 3],
        };
        for (to, light) in params
            .lights
            .iter_mut()
            .zip(lights.iter().filter(|l| l.is_emitting()))
        {
            *to = LightParams::new(light, origin);
            params.count += 1;
        }
        params
    }
}

/// What rays among disks read: `DiskParams` of `wgsl/common/disk_bvh_traverse.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct DiskParams {
    pub(crate) levels: u32,
    pub(crate) merge: u32,
    pub(crate) seed: u32,
    pub(crate) capacity: u32,
    pub(crate) level_first: [u32; MAX_LEVELS as usize],
    pub(crate) shell_radii: f32,
    pub(crate) padding: [u32; 3],
}

crate::reflection::same_as_wgsl!(
    disks_are_the_shaders: DiskParams as "DiskParams" in ["bounced_z_buffer occlusion disks"]
    { levels, merge, seed, capacity, level_first, shell_radii }
);

impl DiskParams {
    pub fn new(settings: &DiskSettings, bounds: &DiskBounds) -> Self {
        let mut level_first = [0; MAX_LEVELS as usize];
        for (to, first) in level_first.iter_mut().zip(bounds.level_first()) {
            *to = first;
        }
        Self {
            levels: bounds.levels(),
            merge: settings.merge.code(),
            seed: settings.seed,
            capacity: bounds.capacity,
            level_first,
            shell_radii: settings.shell_radii.min(UNBOUNDED),
            padding: [0; 3],
        }
    }
}

/// Columns and rows of the grid of directions: the two factors that are nearest each other.
pub(crate) fn grid(rays_per_pixel: u32) -> [u32; 2] {
    let n = rays_per_pixel.max(1);
    let rows = (1..=n.isqrt())
        .rev()
        .find(|r| n.is_multiple_of(*r))
        .unwrap_or(1);
    [n / rows, rows]
}

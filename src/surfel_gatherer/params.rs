//! What the GPU reads: `Params` of `wgsl/surfel_gatherer.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::settings::SurfelGathererSettings;
use crate::{bounced_z_buffer::params::grid, surfel::CloudCapacity};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SurfelGathererParams {
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    pub(crate) frame: u32,
    pub(crate) backs: u32,
    pub(crate) sky_radiance: [f32; 3],
    pub(crate) most_albedo: f32,
    pub(crate) shift: [f32; 3],
    pub(crate) surfel_capacity: u32,
    pub(crate) piece_capacity: u32,
    pub(crate) emitter_samples: u32,
    pub(crate) padding: [u32; 2],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: SurfelGathererParams as "Params" in ["surfel_gatherer"]
    { columns, rows, frame, backs, sky_radiance, most_albedo, shift, surfel_capacity, piece_capacity,
      emitter_samples }
);

impl SurfelGathererParams {
    /// For surfels relative to the first origin, among a cloud of this capacity relative to the second.
    pub fn new(
        settings: &SurfelGathererSettings,
        [own, met]: [DVec3; 2],
        capacity: CloudCapacity,
    ) -> Self {
        let [columns, rows] = grid(settings.rays_per_surfel);
        // Beyond this nothing is met.
        let most = DVec3::splat(1e18);
        Self {
            columns,
            rows,
            frame: settings.frame,
            backs: u32::from(settings.backs),
            sky_radiance: settings.sky_radiance,
            most_albedo: settings.most_albedo,
            shift: (own - met).clamp(-most, most).as_vec3().to_array(),
            surfel_capacity: capacity.surfels,
            piece_capacity: capacity.pieces,
            emitter_samples: settings.emitter_samples,
            padding: [0; 2],
        }
    }
}

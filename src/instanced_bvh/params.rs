//! What the GPU reads: `Place` of `wgsl/instanced_bvh.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct PlaceParams {
    pub(crate) origin_high: [f32; 3],
    pub(crate) first_node: u32,
    pub(crate) origin_low: [f32; 3],
    pub(crate) first_triangle: u32,
    pub(crate) mesh: u32,
    pub(crate) first_instance: u32,
    pub(crate) instances: u32,
    pub(crate) padding: u32,
}

crate::reflection::same_as_wgsl!(
    places_are_the_shaders: PlaceParams as "Place" in ["instanced_bvh"] {
        origin_high, first_node, origin_low, first_triangle, mesh, first_instance, instances,
    }
);

impl PlaceParams {
    /// A place relative to `origin`; the rest is the mesh's.
    pub fn new(origin: DVec3) -> Self {
        let high = origin.as_vec3();
        Self {
            origin_high: high.to_array(),
            origin_low: (origin - high.as_dvec3()).as_vec3().to_array(),
            first_node: 0,
            first_triangle: 0,
            mesh: 0,
            first_instance: 0,
            instances: 0,
            padding: 0,
        }
    }
}

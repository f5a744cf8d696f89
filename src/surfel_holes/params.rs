//! What the GPU reads: `Params` of `wgsl/surfel_holes.wgsl`.

use bytemuck::{Pod, Zeroable};

use crate::surfel::Placement;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SurfelHolesParams {
    pub(crate) at_centroids: u32,
    pub(crate) padding: [u32; 3],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: SurfelHolesParams as "Params" in ["surfel_holes"]
    { at_centroids }
);

impl SurfelHolesParams {
    pub fn new(placement: Placement) -> Self {
        Self {
            at_centroids: u32::from(placement == Placement::Centroid),
            padding: [0; 3],
        }
    }
}

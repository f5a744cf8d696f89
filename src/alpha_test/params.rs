//! What the GPU reads: `AlphaTest` of `wgsl/common/tex_coords.wgsl` and `Params` of `wgsl/alpha_test.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::settings::{AlphaTest, AlphaTests};
use crate::{mesh_binding::Window, surfel::CloudCapacity};

/// Bytes of the shaders' `Cutout`.
pub(crate) const CUTOUT_BYTES: u64 = 32;

crate::reflection::bytes_of_wgsl!(
    cutouts_are_the_shaders: CUTOUT_BYTES, as "Cutout" in ["alpha_test", "instanced_bvh alpha tested"]
);

/// The test of a mesh; all zero for one without holes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct AlphaTestParams {
    pub(crate) offset: u32,
    pub(crate) stride: u32,
    pub(crate) format: u32,
    pub(crate) threshold: f32,
    pub(crate) map: u32,
    pub(crate) padding: [u32; 3],
}

crate::reflection::same_as_wgsl!(
    tests_are_the_shaders: AlphaTestParams as "AlphaTest" in ["alpha_test", "instanced_bvh alpha tested"]
    { offset, stride, format, threshold, map }
);

impl AlphaTestParams {
    /// `window` is what is bound of its texture coordinates.
    pub fn new(tests: &AlphaTests<'_>, test: &AlphaTest<'_>, window: Window) -> Self {
        Self {
            offset: window.inside / 4,
            stride: test.tex_coords.stride / 4,
            format: test.tex_coords.format.code(),
            threshold: test.threshold,
            map: tests.map(test),
            padding: [0; 3],
        }
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct CutParams {
    pub(crate) origin_high: [f32; 3],
    pub(crate) triangle_count: u32,
    pub(crate) origin_low: [f32; 3],
    pub(crate) piece_capacity: u32,
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: CutParams as "Params" in ["alpha_test"]
    { origin_high, triangle_count, origin_low, piece_capacity }
);

impl CutParams {
    /// Of a cloud relative to `origin`.
    pub fn new(origin: DVec3, capacity: CloudCapacity) -> Self {
        let high = origin.as_vec3();
        Self {
            origin_high: high.to_array(),
            triangle_count: capacity.triangles,
            origin_low: (origin - high.as_dvec3()).as_vec3().to_array(),
            piece_capacity: capacity.pieces,
        }
    }
}

//! What the GPU reads: `Params` and `Shadow` of `wgsl/surfel_shader.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::{MAX_SHADOW_CAMERAS, ShadowMap};
use crate::{
    camera::Camera,
    gbuffer::depth_step,
    light::{Light, LightParams},
    surfel::SurfelCloud,
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SurfelShaderParams {
    pub(crate) light: LightParams,
    pub(crate) first: u32,
    pub(crate) splits: u32,
    pub(crate) padding: [u32; 2],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: SurfelShaderParams as "Params" in ["surfel_shader shadow map samples"]
    { light, first, splits }
);

impl SurfelShaderParams {
    /// Without a light, surfels are given their emission alone. `samples` is a power of two.
    pub fn new(light: Option<&Light>, cloud: &SurfelCloud, first: bool, samples: u32) -> Self {
        Self {
            light: light.map_or_else(LightParams::default, |l| LightParams::new(l, cloud.origin)),
            first: u32::from(first),
            splits: samples.trailing_zeros(),
            padding: [0; 2],
        }
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct ShadowCameraParams {
    pub(crate) clip: [[f32; 4]; 4],
    pub(crate) viewport: [f32; 4],
    pub(crate) texel: f32,
    pub(crate) depth_scale: f32,
    pub(crate) per_w: f32,
    pub(crate) perspective: u32,
    pub(crate) far_depth: f32,
    pub(crate) padding: u32,
    pub(crate) tilt: [f32; 2],
}

crate::reflection::same_as_wgsl!(
    shadow_cameras_are_the_shaders: ShadowCameraParams as "ShadowCamera" in [
        "surfel_shader shadow map samples",
    ]
    { clip, viewport, texel, depth_scale, per_w, perspective, far_depth, tilt }
);

impl ShadowCameraParams {
    fn new(camera: &Camera, origin: DVec3) -> Self {
        let viewport = camera.viewport();
        Self {
            clip: camera.clip_matrix(origin).as_mat4().to_cols_array_2d(),
            viewport: [viewport.x, viewport.y, viewport.width, viewport.height].map(|n| n as f32),
            texel: texel(camera) as f32,
            depth_scale: depth_scale(camera) as f32,
            per_w: camera.projection().row(3).z.abs().recip().min(1e18) as f32,
            perspective: u32::from(camera.is_perspective()),
            far_depth: camera.background_depth(),
            padding: 0,
            tilt: camera.tilt().as_vec2().to_array(),
        }
    }
}

/// Side of a texel, the longer one, in world units for each unit of the clip space's w.
pub(crate) fn texel(camera: &Camera) -> f64 {
    let side = |row: usize, texels: u32| {
        2.0 / (camera.projection().row(row).truncate().truncate().length() * f64::from(texels))
    };
    let viewport = camera.viewport();
    side(0, viewport.width).max(side(1, viewport.height))
}

/// Along a ray of a perspective camera depth is this over the distance along its axis, but for a constant, which is the ray's
/// own where the near plane is oblique. A ray of another is this longer for each unit of depth.
pub(crate) fn depth_scale(camera: &Camera) -> f64 {
    if camera.is_perspective() {
        // depth = (z.xyz v + z.w) / (last.z v.z) of a view-space v.
        return camera.projection().row(2).w / camera.projection().row(3).z.abs();
    }
    camera.linear_slope()
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct ShadowParams {
    pub(crate) cameras: [ShadowCameraParams; MAX_SHADOW_CAMERAS],
    pub(crate) count: u32,
    pub(crate) bias: f32,
    pub(crate) depth_step: f32,
    pub(crate) padding: f32,
}

crate::reflection::same_as_wgsl!(
    shadows_are_the_shaders: ShadowParams as "Shadow" in [
        "surfel_shader shadow map samples", "soft_shadows",
    ]
    { cameras, count, bias, depth_step }
);

impl ShadowParams {
    /// In the eye space of `origin`.
    pub fn new(map: &ShadowMap<'_>, origin: DVec3) -> Self {
        let mut cameras = [ShadowCameraParams::default(); MAX_SHADOW_CAMERAS];
        for (to, camera) in cameras.iter_mut().zip(map.cameras) {
            *to = ShadowCameraParams::new(camera, origin);
        }
        Self {
            cameras,
            count: map.cameras.len() as u32,
            bias: map.bias,
            // The stored depth was rounded, and so was the vertices' interpolation before it.
            depth_step: 2.0 * depth_step(map.depth.view_format()),
            padding: 0.0,
        }
    }
}

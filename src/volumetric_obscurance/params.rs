//! What the GPU reads: `Params` of `wgsl/volumetric_obscurance.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::{
    ObscuranceInput,
    samples::{DiskSamples, MOST},
    settings::{Combine, ObscuranceSampling, ObscuranceSettings, ObscuranceVolume},
};
use crate::{
    camera::CameraParams,
    depth_moments::{LEVELS, MomentLevel, levels},
    gbuffer::depth_step,
    receivers::DEPTH_RELATIVE,
};

/// What stands for infinity.
const FAR: f32 = 1e18;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ObscuranceParams {
    pub(crate) camera: CameraParams,
    pub(crate) to_pixel: [[f32; 4]; 4],
    pub(crate) from_pixel: [[f32; 4]; 4],
    pub(crate) forward: [f32; 3],
    pub(crate) level: u32,
    pub(crate) normals: [u32; 2],
    pub(crate) depth_step: f32,
    pub(crate) depth_relative: f32,
    pub(crate) radii: [f32; 2],
    pub(crate) radius_count: u32,
    pub(crate) combine: u32,
    pub(crate) max_pixels: f32,
    pub(crate) thickness: f32,
    pub(crate) seed: u32,
    pub(crate) box_half_width: f32,
    pub(crate) count: u32,
    pub(crate) turn: u32,
    pub(crate) uphill: u32,
    pub(crate) padding: u32,
    pub(crate) moment_levels: [MomentLevel; LEVELS as usize],
    pub(crate) samples: [[f32; 4]; MOST],
}

impl ObscuranceParams {
    pub fn new(
        settings: &ObscuranceSettings,
        sampling: ObscuranceSampling,
        volume: ObscuranceVolume,
        input: &ObscuranceInput<'_>,
        level: u32,
    ) -> Self {
        let camera = input.camera;
        let viewport = camera.viewport();
        let samples = entries(sampling);
        let mut table = [[0.0; 4]; MOST];
        table[..samples.len()].copy_from_slice(&samples);
        let second = settings.second;
        Self {
            camera: camera.params(camera.eye()),
            to_pixel: camera.pixel_matrix().as_mat4().to_cols_array_2d(),
            from_pixel: camera.unpixel_matrix().as_mat4().to_cols_array_2d(),
            forward: camera.forward().as_vec3().to_array(),
            level,
            normals: input.normals.map_or([0, 0], |normals| normals.params()),
            depth_step: depth_step(input.depth.texture().format()),
            depth_relative: DEPTH_RELATIVE,
            radii: [settings.radius, second.map_or(0.0, |s| s.radius)].map(|r| r.min(FAR)),
            radius_count: 1 + u32::from(second.is_some()),
            combine: u32::from(second.is_some_and(|s| s.combine == Combine::Minimum)),
            max_pixels: settings.max_pixels,
            thickness: settings.thickness.min(FAR),
            seed: settings.seed,
            box_half_width: settings.box_half_width,
            count: samples.len() as u32,
            turn: u32::from(settings.turn),
            uphill: u32::from(turns_uphill(sampling, volume)),
            padding: 0,
            moment_levels: levels([viewport.width, viewport.height]),
            samples: table,
        }
    }
}

/// Whether lines are turned to the side where the half sphere is. That takes a table of which no two samples are opposite,
/// since these would fall on one place, and pays where there are few: measured by the bench `obscurance`.
pub(crate) fn turns_uphill(sampling: ObscuranceSampling, volume: ObscuranceVolume) -> bool {
    let lines = ObscuranceSampling::Lines(DiskSamples::FiveAround);
    sampling == lines && volume == ObscuranceVolume::Hemisphere
}

/// A table as the shader reads it.
pub(crate) fn entries(sampling: ObscuranceSampling) -> Vec<[f32; 4]> {
    // Of an area, that of a square with the sample's share of the disk.
    let log_side = |share: f32| 0.5 * (share * std::f32::consts::PI).log2();
    let area = |&[x, y, share]: &[f32; 3]| [x, y, log_side(share), share];
    let line = |&[x, y, share]: &[f32; 3]| [x, y, (1.0 - x * x - y * y).sqrt(), share];
    match sampling {
        ObscuranceSampling::Points(samples) => {
            let table = samples.table();
            let share = 1.0 / table.len() as f32;
            table.iter().map(|&[x, y, z]| [x, y, z, share]).collect()
        }
        ObscuranceSampling::Lines(samples) => samples.table().iter().map(line).collect(),
        ObscuranceSampling::Areas(samples) => samples.table().iter().map(area).collect(),
        ObscuranceSampling::OneArea => vec![area(&[0.0, 0.0, 1.0])],
    }
}

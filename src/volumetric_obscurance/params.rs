//! What the GPU reads: `Params` of `wgsl/volumetric_obscurance.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::{
    ObscuranceInput,
    samples::{DiskSamples, MOST},
    settings::{Combine, ObscuranceSampling, ObscuranceSettings, ObscuranceVolume},
};
use crate::{
    camera::{Camera, CameraParams, RayParams},
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
    pub(crate) rays: RayParams,
    pub(crate) right: [f32; 3],
    pub(crate) level: u32,
    pub(crate) up: [f32; 3],
    pub(crate) center: f32,
    pub(crate) back: [f32; 3],
    pub(crate) thickness: f32,
    pub(crate) normals: [u32; 2],
    pub(crate) depth_step: f32,
    pub(crate) depth_relative: f32,
    pub(crate) radii: [f32; 2],
    pub(crate) radius_count: u32,
    pub(crate) combine: u32,
    pub(crate) max_pixels: f32,
    pub(crate) box_half_width: f32,
    pub(crate) seed: u32,
    pub(crate) turn: u32,
    pub(crate) moment_levels: [MomentLevel; LEVELS as usize],
    pub(crate) samples: [[f32; 4]; MOST],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: ObscuranceParams as "Params" in [
        "volumetric_obscurance", "volumetric_obscurance normals areas list",
    ] {
        camera, to_pixel, from_pixel, rays, right, level, up, center, back, thickness, normals,
        depth_step, depth_relative, radii, radius_count, combine, max_pixels, box_half_width,
        seed, turn, moment_levels, samples,
    }
);

impl ObscuranceParams {
    pub fn new(
        settings: &ObscuranceSettings,
        sampling: ObscuranceSampling,
        volume: ObscuranceVolume,
        input: &ObscuranceInput<'_>,
        level: u32,
    ) -> Self {
        let camera = input.camera;
        let focus = camera.focus();
        let viewport = camera.viewport();
        let (center, samples) = split(sampling, volume);
        let mut table = [[0.0; 4]; MOST];
        for (entry, line) in table.iter_mut().zip(&samples) {
            *entry = over_chord(*line, sampling, volume);
        }
        let [right, up, back] = frame(camera).map(|axis| axis.as_vec3().to_array());
        let second = settings.second;
        Self {
            camera: camera.params(focus),
            to_pixel: camera.pixel_matrix(focus).as_mat4().to_cols_array_2d(),
            from_pixel: camera.unpixel_matrix(focus).as_mat4().to_cols_array_2d(),
            rays: camera.rays(focus),
            right,
            level,
            up,
            center: center.map_or(0.0, |line| over_chord(line, sampling, volume)[3]),
            back,
            thickness: settings.thickness.min(FAR),
            normals: input.normals.map_or([0, 0], |normals| normals.params()),
            depth_step: depth_step(input.depth.view_format()),
            depth_relative: DEPTH_RELATIVE,
            radii: [settings.radius, second.map_or(0.0, |s| s.radius)].map(|r| r.min(FAR)),
            radius_count: 1 + u32::from(second.is_some()),
            combine: u32::from(second.is_some_and(|s| s.combine == Combine::Minimum)),
            max_pixels: settings.max_pixels,
            box_half_width: settings.box_half_width,
            seed: settings.seed,
            turn: u32::from(settings.turn),
            moment_levels: levels([viewport.width, viewport.height]),
            samples: table,
        }
    }
}

/// The camera's right, its up, and the unit vector along which view depth falls.
pub(crate) fn frame(camera: &Camera) -> [DVec3; 3] {
    let back = -camera.forward();
    // An oblique projection looks along another vector than the view's axis.
    let right = camera.rotation().row(0).reject_from_normalized(back);
    let right = right.normalize_or(back.any_orthonormal_vector());
    [right, back.cross(right), back]
}

/// Whether lines are turned to the side where the half sphere is. That takes a table of which no two samples are opposite,
/// since these would fall on one place, and pays where there are few: measured by the bench `obscurance`.
pub(crate) fn turns_uphill(sampling: ObscuranceSampling, volume: ObscuranceVolume) -> bool {
    let lines = ObscuranceSampling::Lines(DiskSamples::Six);
    sampling == lines && volume == ObscuranceVolume::Hemisphere
}

/// The samples that are looked at, and the line through the centre where it is none of them: it sees the point itself,
/// unless the sphere is another one's.
pub(crate) fn split(
    sampling: ObscuranceSampling,
    volume: ObscuranceVolume,
) -> (Option<[f32; 4]>, Vec<[f32; 4]>) {
    let mut samples = entries(sampling);
    let known = matches!(sampling, ObscuranceSampling::Lines(_))
        && volume != ObscuranceVolume::TangentSphere
        && samples[0][..2] == [0.0; 2];
    (known.then(|| samples.remove(0)), samples)
}

/// A line's entry with its share over its chord's length, unless lines are turned uphill and count alike.
fn over_chord(
    [x, y, half_chord, share]: [f32; 4],
    sampling: ObscuranceSampling,
    volume: ObscuranceVolume,
) -> [f32; 4] {
    let whole = matches!(sampling, ObscuranceSampling::Lines(_)) && !turns_uphill(sampling, volume);
    let length = if whole { 2.0 * half_chord } else { 1.0 };
    [x, y, half_chord, share / length]
}

/// A table: of each sample what the shader reads, and its share.
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

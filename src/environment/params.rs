//! What the GPU reads: `Params` and `Lobes` of `wgsl/environment.wgsl`, `Environment` of `wgsl/common/environment.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::EnvironmentLight;
use crate::{
    bounced_z_buffer::{params::grid, settings::BouncedSettings},
    spherical_gaussian::SphericalGaussian,
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct EnvironmentParams {
    pub(crate) size: [u32; 2],
    pub(crate) source_size: [u32; 2],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: EnvironmentParams as "Params" in ["environment"]
    { size, source_size }
);

/// Lobes that an environment can have.
pub(crate) const MAX_LOBES: usize = 16;

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct LobeParams {
    pub(crate) axis: [f32; 3],
    pub(crate) sharpness: f32,
    pub(crate) amplitude: [f32; 3],
    pub(crate) padding: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct LobesParams {
    pub(crate) harmonics: [[f32; 4]; 9],
    pub(crate) lobes: [LobeParams; MAX_LOBES],
    pub(crate) count: u32,
    pub(crate) padding: [u32; 3],
}

crate::reflection::same_as_wgsl!(
    lobe_is_the_shaders: LobeParams as "Lobe" in ["environment summed"]
    { axis, sharpness, amplitude }
);
crate::reflection::same_as_wgsl!(
    lobes_are_the_shaders: LobesParams as "Lobes" in ["environment summed"]
    { harmonics, lobes, count }
);

impl LobesParams {
    /// Of coefficients, and of the first [`MAX_LOBES`] lobes, each a shape and what its amplitude is multiplied by.
    pub fn new(harmonics: &[[f32; 3]; 9], lobes: &[(SphericalGaussian, [f32; 3])]) -> Self {
        let mut params = Self {
            harmonics: harmonics.map(|[r, g, b]| [r, g, b, 0.0]),
            lobes: [LobeParams::default(); MAX_LOBES],
            count: 0,
            padding: [0; 3],
        };
        for (to, (lobe, color)) in params.lobes.iter_mut().zip(lobes) {
            *to = LobeParams {
                axis: lobe.axis.to_array(),
                sharpness: lobe.sharpness,
                amplitude: color.map(|c| c * lobe.amplitude),
                padding: 0,
            };
            params.count += 1;
        }
        params
    }
}

/// What rays read of an environment.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct PlacedParams {
    pub(crate) to_world: [[f32; 4]; 3],
    pub(crate) size: [u32; 2],
    pub(crate) columns: u32,
    pub(crate) rows: u32,
}

crate::reflection::same_as_wgsl!(
    placed_is_the_shaders: PlacedParams as "Environment" in [
        "bounced_z_buffer radiance sky", "shell_splatter splat", "reconstructor",
    ]
    { to_world, size, columns, rows }
);

/// How many of a pixel's rays are drawn by the cosine; the others are drawn by the environment.
pub(crate) fn cosine_rays(settings: &BouncedSettings) -> u32 {
    let all = settings.rays_per_pixel.max(1);
    let drawn = (all as f32 * settings.environment_share).floor() as u32;
    all - drawn.min(all - 1)
}

impl PlacedParams {
    pub fn new(light: &EnvironmentLight<'_>, settings: &BouncedSettings) -> Self {
        let [columns, rows] = grid(cosine_rays(settings));
        Self {
            columns,
            rows,
            ..Self::of(light)
        }
    }

    /// For what draws no directions.
    pub fn of(light: &EnvironmentLight<'_>) -> Self {
        let to_world = glam::DMat3::from_quat(light.rotation.normalize()).as_mat3();
        Self {
            to_world: to_world.to_cols_array_2d().map(|[x, y, z]| [x, y, z, 0.0]),
            size: light.environment.size(),
            columns: 0,
            rows: 0,
        }
    }
}

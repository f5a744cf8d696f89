//! Every WGSL module of the crate as it goes to the device.

use crate::{
    alpha_test, bounced_z_buffer, bvh, depth_moments,
    effect::{Effect, Listing},
    emitters, environment,
    error::Error,
    gpu::{listing::Shader, scan, sort},
    hit_resolver, instanced_bvh, multi_res_mask, multi_res_reconstructor, ray_budget, receivers,
    reconstructor, reflective_shadow_map, screen_space_gi, sg_hull, shell_splatter, soft_shadows,
    surfel_gatherer, surfel_holes, surfel_shader, surfelizer, temporal_accumulator,
    volumetric_obscurance,
};

/// How a pass adds its modules to the listing.
type List = fn(&mut Listing<'_>) -> Result<(), Error>;

/// Every pass.
const PASSES: &[List] = &[
    sort::list,
    scan::list,
    receivers::list,
    surfelizer::list,
    surfel_holes::list,
    surfel_shader::list,
    surfel_gatherer::list,
    shell_splatter::list,
    reconstructor::list,
    bvh::list,
    alpha_test::list,
    instanced_bvh::list,
    environment::list,
    emitters::list,
    bounced_z_buffer::list,
    hit_resolver::list,
    ray_budget::list,
    temporal_accumulator::list,
    multi_res_mask::list,
    multi_res_reconstructor::list,
    soft_shadows::list,
    screen_space_gi::list,
    reflective_shadow_map::list,
    sg_hull::modules::list,
    depth_moments::list,
    volumetric_obscurance::list,
];

/// Every module that the passes make for an effect: for validating an effect of one's own without a GPU, or in a
/// browser's compiler.
///
/// # Errors
/// [`Error::Effect`] where its source has a malformed directive.
pub fn shaders(effect: &Effect) -> Result<Vec<Shader>, Error> {
    let mut all = Listing {
        effect,
        shaders: Vec::new(),
    };
    for list in PASSES {
        list(&mut all)?;
    }
    Ok(all.shaders)
}

//! Every WGSL module of the crate as it goes to the device.

use wgpu::Features;

use crate::{
    bounced_z_buffer, bvh, depth_moments,
    effect::Effect,
    error::Error,
    gpu::{scan, sort},
    hit_resolver, multi_res_mask, multi_res_reconstructor, receivers, reconstructor,
    reflective_shadow_map, screen_space_gi, sg_hull, shell_splatter, soft_shadows, surfel_shader,
    surfelizer, temporal_accumulator, volumetric_obscurance,
};

/// How a pass adds its modules to the listing.
type List = fn(&mut Listing<'_>) -> Result<(), Error>;

/// Every pass.
const PASSES: &[List] = &[
    sort::list,
    scan::list,
    receivers::list,
    surfelizer::list,
    surfel_shader::list,
    shell_splatter::list,
    reconstructor::list,
    bvh::list,
    bounced_z_buffer::list,
    hit_resolver::list,
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

/// One module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shader {
    /// The file in `wgsl/` that it is assembled from, then the variant.
    pub name: String,
    /// The text.
    pub source: String,
    /// What the device must offer for it.
    pub features: Features,
}

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

/// What the passes add their modules to.
pub(crate) struct Listing<'a> {
    /// The effect that modules which import one are assembled for.
    pub effect: &'a Effect,
    shaders: Vec<Shader>,
}

impl Listing<'_> {
    /// A module that every device can run.
    pub fn add(&mut self, name: &str, source: String) {
        self.add_for(Features::empty(), name, source);
    }

    /// A module that needs features of the device.
    pub fn add_for(&mut self, features: Features, name: &str, source: String) {
        self.shaders.push(Shader {
            name: name.into(),
            source,
            features,
        });
    }
}

/// The name of a variant: that of the file and the words for what it has.
pub(crate) fn name_of(file: &str, has: &[(bool, &str)]) -> String {
    let mut name = file.to_owned();
    for (_, word) in has.iter().filter(|(has, _)| *has) {
        name.push(' ');
        name.push_str(word);
    }
    name
}

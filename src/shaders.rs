//! Every WGSL module of the crate as it goes to the device.

use crate::{
    effect::Effect,
    error::Error,
    gpu::{scan, shader::assemble},
    receivers,
    reconstructor::{self, ReconstructorVariant},
    shell_splatter::{self, SplatVariant},
    surfel_shader::{self, ShadeVariant},
    surfelizer,
    temporal_accumulator::{self, TemporalVariant},
};

/// One module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shader {
    /// The file in `wgsl/` that it is assembled from, then the variant.
    pub name: String,
    /// The text.
    pub source: String,
    /// What the device must offer for it.
    pub features: wgpu::Features,
}

/// Every module that the passes make for an effect: for validating an effect of one's own without a GPU, or in a
/// browser's compiler.
///
/// # Errors
/// [`Error::Effect`] where its source has a malformed directive.
pub fn shaders(effect: &Effect) -> Result<Vec<Shader>, Error> {
    let none = wgpu::Features::empty();
    let shader = |name: &str, source: String, features| Shader {
        name: name.into(),
        source,
        features,
    };
    let mut all = vec![
        shader("scan", assemble("scan", scan::SOURCE, &[], &[])?, none),
        shader(
            "surfelizer",
            assemble("surfelizer", surfelizer::SOURCE, &[], &[])?,
            none,
        ),
        shader(
            "receivers",
            assemble("receivers", receivers::SOURCE, &[], &[])?,
            none,
        ),
        shader(
            "shell_splatter build",
            shell_splatter::source(effect, SplatVariant::Build)?,
            none,
        ),
        shader(
            "reconstructor smooth",
            reconstructor::source(effect, ReconstructorVariant::Smooth)?,
            none,
        ),
    ];
    for subgroups in [false, true] {
        for statistics in [false, true] {
            let variant = SplatVariant::Splat {
                subgroups,
                statistics,
            };
            let name = format!(
                "shell_splatter splat{}{}",
                if subgroups { " subgroups" } else { "" },
                if statistics { " statistics" } else { "" }
            );
            let features = if subgroups {
                wgpu::Features::SUBGROUP
            } else {
                none
            };
            all.push(shader(
                &name,
                shell_splatter::source(effect, variant)?,
                features,
            ));
        }
    }
    for shadow_map in [false, true] {
        for samples in [false, true] {
            let name = format!(
                "surfel_shader{}{}",
                if shadow_map { " shadow map" } else { "" },
                if samples { " samples" } else { "" }
            );
            let variant = ShadeVariant {
                shadow_map,
                samples,
            };
            all.push(shader(&name, surfel_shader::source(variant)?, none));
        }
    }
    for smoothed in [false, true] {
        let name = if smoothed {
            "reconstructor smoothed"
        } else {
            "reconstructor"
        };
        let source = reconstructor::source(effect, ReconstructorVariant::Reconstruct { smoothed })?;
        all.push(shader(name, source, none));
    }
    for (name, variant) in [
        (
            "temporal_accumulator",
            TemporalVariant::Accumulate { motion: false },
        ),
        (
            "temporal_accumulator motion",
            TemporalVariant::Accumulate { motion: true },
        ),
        ("temporal_accumulator show", TemporalVariant::Show),
    ] {
        let source = temporal_accumulator::source(effect.channels, variant)?;
        all.push(shader(name, source, none));
    }
    Ok(all)
}

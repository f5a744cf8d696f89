//! Every WGSL module of the crate as it goes to the device.

use crate::{
    bounced_z_buffer::{
        self,
        descriptor::{BouncedDescriptor, Lighting, Payload, Senders},
        settings::Sampling,
    },
    depth_moments, disk_bounds,
    effect::{Channels, Effect},
    error::Error,
    gpu::{scan, shader::assemble, sort},
    hit_reconstructor::{self, HitReconstructorDescriptor, HitStage},
    multi_res_mask::{self, MaskStage},
    multi_res_reconstructor, receivers,
    reconstructor::{self, ReconstructorVariant},
    reflective_shadow_map, screen_space_gi, sender_bounds,
    sg_hull::{
        self, HullStage, HullVariant,
        gatherer::{LIGHTS, POLYGONS},
        surfels::SURFELS,
    },
    shell_splatter::{self, SplatVariant},
    soft_shadows,
    surfel_shader::{self, ShadeVariant, ShadowKind},
    surfelizer,
    temporal_accumulator::{self, TemporalVariant},
    volumetric_obscurance::{self, ObscuranceVariant},
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
        shader("sort", assemble("sort", sort::SOURCE, &[], &[])?, none),
        shader("scan", assemble("scan", scan::SOURCE, &[], &[])?, none),
        shader(
            "surfelizer",
            assemble("surfelizer", surfelizer::SOURCE, &[], &[])?,
            none,
        ),
        shader("receivers", receivers::source(false)?, none),
        shader("receivers list", receivers::source(true)?, none),
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
    for (shadow, shadow_name) in [
        (ShadowKind::None, ""),
        (ShadowKind::Map, " shadow map"),
        (ShadowKind::Traced, " shadow traced"),
    ] {
        for samples in [false, true] {
            let samples_name = if samples { " samples" } else { "" };
            let name = format!("surfel_shader{shadow_name}{samples_name}");
            let variant = ShadeVariant { shadow, samples };
            all.push(shader(&name, surfel_shader::source(variant)?, none));
        }
    }
    for (plan, name) in [(true, "sender_bounds plan"), (false, "sender_bounds build")] {
        all.push(shader(name, sender_bounds::source(plan)?, none));
    }
    all.push(shader("disk_bounds", disk_bounds::source()?, none));
    for (payload, payload_name) in [
        (Payload::Occlusion, "occlusion"),
        (Payload::Radiance, "radiance"),
    ] {
        for (senders, sampling, variant_name) in [
            (Senders::Pieces, Sampling::Cosine, ""),
            (Senders::Pieces, Sampling::Glossy, " glossy"),
            (Senders::Disks { levels: 1 }, Sampling::Cosine, " disks"),
            (
                Senders::Disks { levels: 1 },
                Sampling::Glossy,
                " disks glossy",
            ),
        ] {
            for (lighting, lighting_name) in [(Lighting::Surfels, ""), (Lighting::Hits, " lit")] {
                for statistics in [false, true] {
                    let descriptor = BouncedDescriptor {
                        payload,
                        senders,
                        sampling,
                        lighting,
                        statistics,
                    };
                    if lighting == Lighting::Hits
                        && !(descriptor.lit() && senders == Senders::Pieces)
                    {
                        continue;
                    }
                    let statistics_name = if statistics { " statistics" } else { "" };
                    let name = format!(
                        "bounced_z_buffer {payload_name}{lighting_name}{variant_name}{statistics_name}"
                    );
                    all.push(shader(&name, bounced_z_buffer::source(&descriptor)?, none));
                }
            }
        }
        for (sampling, sampling_name) in [(Sampling::Cosine, ""), (Sampling::Glossy, " glossy")] {
            for (deferred, stage, stage_name) in [
                (false, HitStage::Average, "average"),
                (false, HitStage::Reconstruct, "reconstruct"),
                (true, HitStage::Reconstruct, "reconstruct deferred"),
            ] {
                let descriptor = HitReconstructorDescriptor {
                    payload,
                    sampling,
                    deferred,
                    target: wgpu::TextureFormat::Rgba16Float,
                };
                let name = format!("hit_reconstructor {payload_name}{sampling_name} {stage_name}");
                let source = hit_reconstructor::source(&descriptor, stage)?;
                all.push(shader(&name, source, none));
            }
        }
    }
    for (stage, name) in [
        (HullStage::Segment, "sg_hull_segment"),
        (HullStage::Plan, "sg_hull_plan"),
        (HullStage::Place, "sg_hull_place"),
        (HullStage::Judge, "sg_hull_judge"),
        (HullStage::Split, "sg_hull_split"),
    ] {
        all.push(shader(
            name,
            sg_hull::source("", stage, HullVariant::default())?,
            none,
        ));
    }
    all.push(shader(
        "reflective_shadow_map",
        assemble(
            "reflective_shadow_map",
            reflective_shadow_map::SOURCE,
            &[],
            &[],
        )?,
        none,
    ));
    let variants = [
        (false, false, ""),
        (true, false, " albedo"),
        (false, true, " glossy"),
        (true, true, " albedo glossy"),
    ]
    .map(|(albedo, glossy, name)| (HullVariant { albedo, glossy }, name));
    for (gatherer, gatherer_name) in [
        (POLYGONS, "polygons"),
        (LIGHTS, "lights"),
        (SURFELS, "surfels"),
    ] {
        let source = sg_hull::source(gatherer, HullStage::Gather, HullVariant::default())?;
        all.push(shader(
            &format!("sg_hull_gather {gatherer_name}"),
            source,
            none,
        ));
        for (variant, variant_name) in &variants {
            let source = sg_hull::source(gatherer, HullStage::Exact, *variant)?;
            let name = format!("sg_hull_exact {gatherer_name}{variant_name}");
            all.push(shader(&name, source, none));
        }
    }
    for (variant, variant_name) in variants {
        let source = sg_hull::source("", HullStage::Shade, variant)?;
        all.push(shader(&format!("sg_hull{variant_name}"), source, none));
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
        ("temporal_accumulator claim", TemporalVariant::Claim),
        ("temporal_accumulator show", TemporalVariant::Show),
    ] {
        let source = temporal_accumulator::source(effect.channels, variant)?;
        all.push(shader(name, source, none));
    }
    for shading in [false, true] {
        for given in [false, true] {
            let name = format!(
                "multi_res_mask edges{}{}",
                if shading { " shading" } else { "" },
                if given { " given" } else { "" }
            );
            let source = multi_res_mask::source(MaskStage::Edges { shading, given })?;
            all.push(shader(&name, source, none));
        }
    }
    for (name, stage) in [
        ("multi_res_mask coarsen", MaskStage::Coarsen),
        ("multi_res_mask widen", MaskStage::Widen { finer: false }),
        (
            "multi_res_mask widen finer",
            MaskStage::Widen { finer: true },
        ),
        ("multi_res_mask list", MaskStage::List),
        ("multi_res_mask stamp", MaskStage::Stamp),
    ] {
        all.push(shader(name, multi_res_mask::source(stage)?, none));
    }
    for (channels, channels_name) in [(Channels::One, ""), (Channels::Three, " color")] {
        for (blend, blend_name) in [(false, ""), (true, " blend")] {
            let name = format!("multi_res_reconstructor{blend_name}{channels_name}");
            let source = multi_res_reconstructor::source(channels, blend)?;
            all.push(shader(&name, source, none));
        }
    }
    for (list, list_name) in [(false, ""), (true, " list")] {
        let shadows = soft_shadows::source(list)?;
        all.push(shader(&format!("soft_shadows{list_name}"), shadows, none));
        let bounce = screen_space_gi::source(list)?;
        all.push(shader(&format!("screen_space_gi{list_name}"), bounce, none));
    }
    for (depth, name) in [(true, "depth_moments depth"), (false, "depth_moments")] {
        all.push(shader(name, depth_moments::source(depth)?, none));
    }
    for normals in [false, true] {
        for areas in [false, true] {
            for list in [false, true] {
                let name = format!(
                    "volumetric_obscurance{}{}{}",
                    if normals { " normals" } else { "" },
                    if areas { " areas" } else { "" },
                    if list { " list" } else { "" }
                );
                let variant = ObscuranceVariant {
                    normals,
                    areas,
                    list,
                };
                let source = volumetric_obscurance::source(variant)?;
                all.push(shader(&name, source, none));
            }
        }
    }
    Ok(all)
}

//! The WGSL of each stage, assembled for a gatherer.

use super::{gatherer, surfels};
use crate::{
    effect::Listing,
    error::Error,
    gpu::listing::name_of,
    gpu::{preprocess::Module, shader},
};

/// The modules that a hull is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum HullStage {
    Segment,
    Plan,
    Place,
    Gather,
    Classify,
    Split,
    Shade,
    PerPixel,
}

/// What a surface reflects depends on.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct HullVariant {
    pub(crate) albedo: bool,
    pub(crate) glossy: bool,
}

/// Assembles one of them.
pub(super) fn source(
    gatherer: &str,
    stage: HullStage,
    variant: HullVariant,
) -> Result<String, Error> {
    let (name, text) = match stage {
        HullStage::Segment => (
            "sg_hull_segment",
            include_str!("../../wgsl/sg_hull_segment.wgsl"),
        ),
        HullStage::Plan => ("sg_hull_plan", include_str!("../../wgsl/sg_hull_plan.wgsl")),
        HullStage::Place => (
            "sg_hull_place",
            include_str!("../../wgsl/sg_hull_place.wgsl"),
        ),
        HullStage::Classify => (
            "sg_hull_classify",
            include_str!("../../wgsl/sg_hull_classify.wgsl"),
        ),
        HullStage::Split => (
            "sg_hull_split",
            include_str!("../../wgsl/sg_hull_split.wgsl"),
        ),
        HullStage::Gather => (
            "sg_hull_gather",
            include_str!("../../wgsl/sg_hull_gather.wgsl"),
        ),
        HullStage::Shade => ("sg_hull", include_str!("../../wgsl/sg_hull.wgsl")),
        HullStage::PerPixel => (
            "sg_hull_per_pixel",
            include_str!("../../wgsl/sg_hull_per_pixel.wgsl"),
        ),
    };
    let flags: Vec<&str> = [(variant.albedo, "ALBEDO"), (variant.glossy, "GLOSSY")]
        .into_iter()
        .filter_map(|(on, flag)| on.then_some(flag))
        .collect();
    let gatherer = Module {
        name: "gatherer",
        file: "the gatherer",
        text: gatherer,
    };
    shader::assemble(name, text, &flags, &[gatherer])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    let plain = HullVariant::default();
    for (name, stage) in [
        ("sg_hull_segment", HullStage::Segment),
        ("sg_hull_plan", HullStage::Plan),
        ("sg_hull_place", HullStage::Place),
        ("sg_hull_classify", HullStage::Classify),
        ("sg_hull_split", HullStage::Split),
    ] {
        all.add(name, source("", stage, plain)?);
    }
    let gatherers = [
        (gatherer::POLYGONS, "polygons"),
        (gatherer::LIGHTS, "lights"),
        (surfels::SURFELS, "surfels"),
    ];
    for (gatherer, name) in gatherers {
        let source = source(gatherer, HullStage::Gather, plain)?;
        all.add(&format!("sg_hull_gather {name}"), source);
    }
    for albedo in [false, true] {
        for glossy in [false, true] {
            let variant = HullVariant { albedo, glossy };
            let flags = [(albedo, "albedo"), (glossy, "glossy")];
            for (gatherer, name) in gatherers {
                let name = name_of(&format!("sg_hull_per_pixel {name}"), &flags);
                all.add(&name, source(gatherer, HullStage::PerPixel, variant)?);
            }
            let name = name_of("sg_hull", &flags);
            all.add(&name, source("", HullStage::Shade, variant)?);
        }
    }
    Ok(())
}

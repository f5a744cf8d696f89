//! Assembly of WGSL modules from the files in `wgsl/`.
//!
//! Two directives, each alone on its line: `#import name` puts in a file of `wgsl/common` (once), and
//! `#if FLAG` … `#else` … `#endif` keeps the lines that a variant needs. A flag decides what is *bound*; whatever only
//! changes a value is an `override` constant.

use std::{borrow::Cow, collections::BTreeSet};

use crate::error::Error;

const COMMON: &[(&str, &str)] = &[
    ("math", include_str!("../../wgsl/common/math.wgsl")),
    ("packing", include_str!("../../wgsl/common/packing.wgsl")),
    ("hashing", include_str!("../../wgsl/common/hashing.wgsl")),
    ("camera", include_str!("../../wgsl/common/camera.wgsl")),
    ("gbuffer", include_str!("../../wgsl/common/gbuffer.wgsl")),
    ("surface", include_str!("../../wgsl/common/surface.wgsl")),
    ("dispatch", include_str!("../../wgsl/common/dispatch.wgsl")),
    ("moments", include_str!("../../wgsl/common/moments.wgsl")),
    ("albedo", include_str!("../../wgsl/common/albedo.wgsl")),
    ("receiver", include_str!("../../wgsl/common/receiver.wgsl")),
    ("surfel", include_str!("../../wgsl/common/surfel.wgsl")),
    ("triangle", include_str!("../../wgsl/common/triangle.wgsl")),
    ("light", include_str!("../../wgsl/common/light.wgsl")),
    (
        "shadow_map",
        include_str!("../../wgsl/common/shadow_map.wgsl"),
    ),
    ("material", include_str!("../../wgsl/common/material.wgsl")),
    ("levels", include_str!("../../wgsl/common/levels.wgsl")),
    ("cluster", include_str!("../../wgsl/common/cluster.wgsl")),
    ("screen", include_str!("../../wgsl/common/screen.wgsl")),
    (
        "sub_image",
        include_str!("../../wgsl/common/sub_image.wgsl"),
    ),
    ("work", include_str!("../../wgsl/common/work.wgsl")),
    ("block", include_str!("../../wgsl/common/block.wgsl")),
    ("rooms", include_str!("../../wgsl/common/rooms.wgsl")),
    (
        "walk_tree",
        include_str!("../../wgsl/common/walk_tree.wgsl"),
    ),
    ("walk", include_str!("../../wgsl/common/walk.wgsl")),
    (
        "node_boxes",
        include_str!("../../wgsl/common/node_boxes.wgsl"),
    ),
    (
        "meet_triangles",
        include_str!("../../wgsl/common/meet_triangles.wgsl"),
    ),
    (
        "shadow_ray",
        include_str!("../../wgsl/common/shadow_ray.wgsl"),
    ),
    (
        "disk_tree",
        include_str!("../../wgsl/common/disk_tree.wgsl"),
    ),
    (
        "disk_walk",
        include_str!("../../wgsl/common/disk_walk.wgsl"),
    ),
    (
        "directions",
        include_str!("../../wgsl/common/directions.wgsl"),
    ),
    (
        "spherical_gaussian",
        include_str!("../../wgsl/common/spherical_gaussian.wgsl"),
    ),
    (
        "sg_glossy",
        include_str!("../../wgsl/common/sg_glossy.wgsl"),
    ),
    ("lobes", include_str!("../../wgsl/common/lobes.wgsl")),
    ("sg_hull", include_str!("../../wgsl/common/sg_hull.wgsl")),
    (
        "sg_hull_corner",
        include_str!("../../wgsl/common/sg_hull_corner.wgsl"),
    ),
    (
        "sg_hull_split",
        include_str!("../../wgsl/common/sg_hull_split.wgsl"),
    ),
    (
        "sg_hull_misfit",
        include_str!("../../wgsl/common/sg_hull_misfit.wgsl"),
    ),
    (
        "sg_hull_vertex",
        include_str!("../../wgsl/common/sg_hull_vertex.wgsl"),
    ),
    ("ggx", include_str!("../../wgsl/common/ggx.wgsl")),
    (
        "effect_types",
        include_str!("../../wgsl/common/effect_types.wgsl"),
    ),
];

/// Assembles a module. `snippets` are further imports, such as an effect's own code.
pub(crate) fn assemble(
    name: &str,
    text: &str,
    flags: &[&str],
    snippets: &[(&str, &str)],
) -> Result<String, Error> {
    let mut out = String::with_capacity(text.len() * 2);
    let mut imported = BTreeSet::new();
    append(name, text, flags, snippets, &mut imported, &mut out)?;
    Ok(out)
}

fn append(
    name: &str,
    text: &str,
    flags: &[&str],
    snippets: &[(&str, &str)],
    imported: &mut BTreeSet<String>,
    out: &mut String,
) -> Result<(), Error> {
    let bad = |problem: String| Error::Effect {
        label: name.into(),
        problem,
    };
    // One entry per open #if: whether its lines are kept, given that the enclosing ones are.
    let mut open: Vec<bool> = Vec::new();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        let kept = open.iter().all(|&k| k);
        match (words.next(), words.next()) {
            (Some("#if"), Some(flag)) => open.push(flags.contains(&flag)),
            (Some("#else"), None) => {
                let last = open
                    .last_mut()
                    .ok_or_else(|| bad("has #else without #if".into()))?;
                *last = !*last;
            }
            (Some("#endif"), None) => {
                open.pop()
                    .ok_or_else(|| bad("has #endif without #if".into()))?;
            }
            (Some("#import"), Some(module)) if kept => {
                let (key, body) = snippets
                    .iter()
                    .chain(COMMON)
                    .find(|(key, _)| *key == module)
                    .copied()
                    .ok_or_else(|| bad(format!("imports {module}, which does not exist")))?;
                if imported.insert(key.to_owned()) {
                    append(key, body, flags, snippets, imported, out)?;
                }
            }
            _ if kept => {
                out.push_str(line);
                out.push('\n');
            }
            _ => {}
        }
    }
    if open.is_empty() {
        Ok(())
    } else {
        Err(bad("has #if without #endif".into()))
    }
}

/// A shader module with the crate's label.
pub(crate) fn create(device: &wgpu::Device, label: &str, source: String) -> wgpu::ShaderModule {
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(Cow::Owned(source)),
    })
}

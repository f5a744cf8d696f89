//! WGSL modules of the crate from the files in `wgsl/`; see [`super::preprocess`] for the directives in them.

use std::borrow::Cow;

use super::{
    Kernel,
    binding::Layout,
    interface::Interface,
    preprocess::{Mistake, Module, preprocess},
};
use crate::error::Error;

/// The modules of `wgsl/common` by name.
macro_rules! common {
    ($($name:ident),* $(,)?) => {
        &[$(Module {
            name: stringify!($name),
            file: concat!("wgsl/common/", stringify!($name), ".wgsl"),
            text: include_str!(concat!("../../wgsl/common/", stringify!($name), ".wgsl")),
        }),*]
    };
}

const COMMON: &[Module<'static>] = common![
    math,
    packing,
    hashing,
    camera,
    gbuffer,
    surface,
    dispatch,
    moments,
    albedo,
    roughness,
    receiver,
    surfel,
    target,
    triangle,
    light,
    shadow_map,
    material,
    levels,
    cluster,
    screen,
    sub_image,
    work,
    block,
    slots,
    ray,
    mesh,
    placed,
    cutout,
    cutout_at,
    tex_coords,
    map_alpha,
    instance,
    bvh_layout,
    bvh_build,
    bvh_traverse,
    ray_query_traverse,
    sound_piece,
    bvh4_layout,
    bvh4_traverse,
    bvh4_boxes,
    shadow_ray,
    disk_bvh_layout,
    disk_bvh_traverse,
    directions,
    environment_cells,
    environment,
    environment_levels,
    emitters,
    kinship,
    spherical_gaussian,
    sg_glossy,
    lobes,
    sg_hull,
    sg_hull_corner,
    sg_hull_split,
    sg_hull_error,
    sg_hull_vertex,
    ggx,
    form_factor,
    sums,
    effect_types,
];

/// Assembles the module `wgsl/{name}.wgsl`. `snippets` are further modules: the caller's code, whose `file` is its label.
pub(crate) fn assemble(
    name: &str,
    text: &str,
    flags: &[&str],
    snippets: &[Module<'_>],
) -> Result<String, Error> {
    let file = format!("wgsl/{name}.wgsl");
    let root = Module {
        name,
        file: &file,
        text,
    };
    let modules = [snippets, COMMON].concat();
    preprocess(root, &modules, flags).map_err(|mistake| {
        let Mistake {
            file,
            line,
            problem,
        } = mistake;
        if snippets.iter().any(|snippet| snippet.file == file) {
            Error::Effect {
                label: file,
                problem: format!("{problem}, in line {line}"),
            }
        } else {
            Error::Shader {
                file,
                line,
                problem,
            }
        }
    })
}

/// A module on a device, and what it binds.
#[derive(Debug)]
pub(crate) struct Shader {
    pub raw: wgpu::ShaderModule,
    label: String,
    interface: Interface,
    /// What the caller's code in it binds.
    foreign: Interface,
}

/// A shader module with the crate's label.
pub(crate) fn create(device: &wgpu::Device, label: &str, source: String) -> Shader {
    create_with(device, label, source, "")
}

/// One that has the caller's code in it.
pub(crate) fn create_with(
    device: &wgpu::Device,
    label: &str,
    source: String,
    callers: &str,
) -> Shader {
    Shader {
        label: label.into(),
        interface: Interface::of(&source),
        foreign: Interface::of(callers),
        raw: device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(label),
            source: wgpu::ShaderSource::Wgsl(Cow::Owned(source)),
        }),
    }
}

impl Shader {
    /// What some of its entry points bind in group 0.
    pub fn layout(&self, device: &wgpu::Device, entries: &[&str]) -> Layout {
        self.layout_of(device, 0, entries)
    }

    /// The same in any group.
    pub fn layout_of(&self, device: &wgpu::Device, group: u32, entries: &[&str]) -> Layout {
        let (own, foreign) = (&self.interface, &self.foreign);
        Layout::new(device, &self.label, own, group, entries, foreign)
    }

    /// An entry point that shares its bindings with no other: what it binds, and its pipeline.
    pub fn kernel(
        &self,
        device: &wgpu::Device,
        entry: &str,
        constants: &[(&str, f64)],
        cache: Option<&wgpu::PipelineCache>,
    ) -> (Layout, wgpu::ComputePipeline) {
        let layout = self.layout(device, &[entry]);
        let pipeline = Kernel {
            label: &self.label,
            module: self,
            entry,
            layouts: &[&layout.raw],
            constants,
            cache,
        }
        .create(device);
        (layout, pipeline)
    }
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeSet, fs, path::Path};

    use super::*;
    use crate::gpu::preprocess::FLAGS;

    #[test]
    fn all_of_common_is_listed() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("wgsl/common");
        let files: BTreeSet<_> = fs::read_dir(folder)
            .expect("the folder")
            .map(|e| {
                let path = e.expect("an entry").path();
                path.file_stem()
                    .expect("a name")
                    .to_string_lossy()
                    .into_owned()
            })
            .collect();
        let listed: BTreeSet<_> = COMMON.iter().map(|m| m.name.to_owned()).collect();
        assert_eq!(files, listed);
    }

    #[test]
    fn no_flag_is_without_use() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut text = String::new();
        for folder in ["wgsl", "wgsl/common", "wgsl/effects", "wgsl/gatherers"] {
            for entry in fs::read_dir(root.join(folder)).expect("the folder") {
                let path = entry.expect("an entry").path();
                if path.is_file() {
                    text += &fs::read_to_string(path).expect("a text");
                }
            }
        }
        let asked: BTreeSet<_> = text
            .lines()
            .filter_map(|line| line.strip_prefix("#if "))
            .flat_map(|condition| condition.split([' ', '!', '&', '|']))
            .filter(|word| !word.is_empty())
            .collect();
        for flag in FLAGS {
            assert!(asked.contains(flag), "{flag} is in no condition");
        }
    }
}

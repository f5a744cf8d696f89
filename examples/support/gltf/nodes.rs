//! The tree of nodes: what is in the scene, and where.

use deep_screen_space::glam::{DMat4, DQuat, DVec3};
use gltf::{Document, json};

use super::{
    File,
    accessors::{Role, Values},
};

const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// All nodes of a file.
pub struct Nodes {
    /// From each node's space to the world's.
    pub to_world: Vec<DMat4>,
    /// Those of the scene.
    pub visible: Vec<usize>,
}

impl Nodes {
    pub fn new(document: &Document) -> Result<Self, String> {
        let nodes = &document.as_json().nodes;
        let mut parents = vec![None; nodes.len()];
        for (i, node) in nodes.iter().enumerate() {
            for child in node.children.iter().flatten() {
                let parent = &mut parents[child.value()];
                if let Some(other) = parent {
                    return Err(format!(
                        "node {} has two parents, {other} and {i}",
                        child.value()
                    ));
                }
                *parent = Some(i);
            }
        }
        let roots: Vec<usize> = (0..nodes.len()).filter(|i| parents[*i].is_none()).collect();
        let mut to_world = vec![None; nodes.len()];
        below(nodes, &roots, |i| {
            let above = parents[i].and_then(|p: usize| to_world[p]);
            to_world[i] = Some(above.unwrap_or(DMat4::IDENTITY) * local(&nodes[i]));
        });
        // What no root leads to is a ring.
        let to_world = to_world
            .into_iter()
            .enumerate()
            .map(|(i, m)| m.ok_or_else(|| format!("node {i} is below itself")))
            .collect::<Result<Vec<_>, _>>()?;
        let scene = document
            .default_scene()
            .or_else(|| document.scenes().next());
        let tops = match scene {
            None => roots,
            Some(scene) => {
                let tops: Vec<usize> = scene.nodes().map(|n| n.index()).collect();
                let mut listed = vec![false; nodes.len()];
                for &top in &tops {
                    if let Some(parent) = parents[top] {
                        return Err(format!("node {top} of the scene is below node {parent}"));
                    }
                    if std::mem::replace(&mut listed[top], true) {
                        return Err(format!("node {top} is in the scene twice"));
                    }
                }
                tops
            }
        };
        let mut visible = Vec::new();
        below(nodes, &tops, |i| visible.push(i));
        Ok(Self { to_world, visible })
    }

    /// From a node's space to the world's, once for each time that it is shown, `most` times at most.
    pub fn instances(
        &self,
        file: &File<'_>,
        node: &gltf::Node<'_>,
        most: usize,
    ) -> Result<Vec<DMat4>, String> {
        let own = self.to_world[node.index()];
        let Some(attributes) = node
            .extension_value(INSTANCING)
            .and_then(|extension| extension.get("attributes"))
        else {
            return Ok(vec![own]);
        };
        if node.skin().is_some() {
            file.notes.add("instances of skinned meshes are left out");
            return Ok(vec![own]);
        }
        let fail = |e: String| format!("node {}, {INSTANCING}: {e}", node.index());
        let open = |name: &str, role: Role| -> Result<Option<Values<'_>>, String> {
            let Some(index) = attributes.get(name) else {
                return Ok(None);
            };
            let accessor = index
                .as_u64()
                .and_then(|index| file.document.accessors().nth(index as usize))
                .ok_or_else(|| format!("there is no accessor {index}"))?;
            Values::open(file, &accessor, role).map(Some)
        };
        let translations = open("TRANSLATION", Role::Translations).map_err(fail)?;
        let rotations = open("ROTATION", Role::Rotations).map_err(fail)?;
        let scales = open("SCALE", Role::Scales).map_err(fail)?;
        let mut counts = [&translations, &rotations, &scales]
            .into_iter()
            .flatten()
            .map(|values| values.count);
        let Some(count) = counts.next() else {
            return Ok(vec![own]);
        };
        if let Some(other) = counts.find(|other| *other != count) {
            return Err(fail(format!(
                "attributes of {count} and of {other} instances"
            )));
        }
        if count > most {
            return Err(fail(format!("{count} instances, there is room for {most}")));
        }
        (0..count as u32)
            .map(|i| {
                let translation = match &translations {
                    Some(values) => DVec3::from(values.finite(i)?),
                    None => DVec3::ZERO,
                };
                let rotation = match &rotations {
                    Some(values) => unit(values.finite(i)?),
                    None => DQuat::IDENTITY,
                };
                let scale = match &scales {
                    Some(values) => DVec3::from(values.finite(i)?),
                    None => DVec3::ONE,
                };
                Ok(own * DMat4::from_scale_rotation_translation(scale, rotation, translation))
            })
            .collect::<Result<_, _>>()
            .map_err(fail)
    }
}

/// Visits nodes and all below them, parents first.
fn below(nodes: &[json::Node], tops: &[usize], mut visit: impl FnMut(usize)) {
    let mut open: Vec<usize> = tops.iter().rev().copied().collect();
    while let Some(i) = open.pop() {
        visit(i);
        let children = nodes[i].children.iter().flatten();
        open.extend(children.rev().map(json::Index::value));
    }
}

/// A rotation of unit length; none where it has no direction.
fn unit(rotation: [f64; 4]) -> DQuat {
    let rotation = DQuat::from_array(rotation);
    if rotation.length() > 1e-12 {
        rotation.normalize()
    } else {
        DQuat::IDENTITY
    }
}

fn local(node: &json::Node) -> DMat4 {
    if let Some(matrix) = node.matrix {
        return DMat4::from_cols_array(&matrix.map(f64::from));
    }
    let translation = node.translation.unwrap_or([0.0; 3]);
    let rotation = node.rotation.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |r| r.0);
    let scale = node.scale.unwrap_or([1.0; 3]);
    DMat4::from_scale_rotation_translation(
        DVec3::from(scale.map(f64::from)),
        unit(rotation.map(f64::from)),
        DVec3::from(translation.map(f64::from)),
    )
}

//! What moves vertices before a node's place does: morph targets at the file's weights, joints where the file has them.

use deep_screen_space::glam::{DMat4, DVec3};
use gltf::{Mesh, Node, Primitive, Semantic};

use super::{
    File,
    accessors::{Role, Values},
    primitives::check_count,
};

/// A primitive's morph targets.
pub struct Morph<'a> {
    targets: Vec<Target<'a>>,
}

struct Target<'a> {
    weight: f64,
    positions: Option<Values<'a>>,
    normals: Option<Values<'a>>,
}

impl<'a> Morph<'a> {
    pub fn open(
        file: &File<'a>,
        node: &Node<'_>,
        mesh: &Mesh<'_>,
        primitive: &Primitive<'a>,
        vertices: usize,
    ) -> Result<Self, String> {
        let weights = node.weights().or(mesh.weights());
        let open = |accessor: Option<gltf::Accessor<'a>>| -> Result<_, String> {
            let Some(accessor) = accessor else {
                return Ok(None);
            };
            let values = Values::open(file, &accessor, Role::Displacements)?;
            check_count(&values, "a morph target", vertices)?;
            Ok(Some(values))
        };
        let mut targets = Vec::new();
        for (i, target) in primitive.morph_targets().enumerate() {
            let weight = weights.map_or(Some(0.0), |w| w.get(i).copied());
            let weight = weight
                .filter(|w| w.is_finite())
                .ok_or_else(|| format!("morph target {i} has no weight that is a number"))?;
            targets.push(Target {
                weight: f64::from(weight),
                positions: open(target.positions())?,
                normals: open(target.normals())?,
            });
        }
        Ok(Self { targets })
    }

    /// What is added to a vertex's position.
    pub fn position(&self, vertex: u32) -> Result<DVec3, String> {
        self.targets
            .iter()
            .filter(|target| target.weight != 0.0)
            .filter_map(|target| Some((target.weight, target.positions.as_ref()?)))
            .map(|(weight, values)| Ok(weight * DVec3::from(values.finite(vertex)?)))
            .sum()
    }

    /// What is added to a vertex's normal.
    pub fn normal(&self, vertex: u32) -> DVec3 {
        self.targets
            .iter()
            .filter(|target| target.weight != 0.0)
            .filter_map(|target| Some((target.weight, target.normals.as_ref()?)))
            .map(|(weight, values)| weight * DVec3::from(values.get(vertex)))
            .sum()
    }
}

/// The joints that move a primitive's vertices.
pub struct Skin<'a> {
    /// From the mesh's space at rest to the world's.
    to_world: Vec<DMat4>,
    /// Up to four joints of a vertex each, and their weights.
    sets: Vec<[Values<'a>; 2]>,
}

impl<'a> Skin<'a> {
    /// None for a primitive that does not say which joints move it.
    pub fn open(
        file: &File<'a>,
        skin: &gltf::Skin<'a>,
        open: impl Fn(&Semantic, Role) -> Result<Option<Values<'a>>, String>,
    ) -> Result<Option<Self>, String> {
        let mut sets = Vec::new();
        for set in 0.. {
            let joints = open(&Semantic::Joints(set), Role::Joints)?;
            let weights = open(&Semantic::Weights(set), Role::Weights)?;
            match (joints, weights) {
                (Some(joints), Some(weights)) => sets.push([joints, weights]),
                (None, None) => break,
                _ => return Err(format!("JOINTS_{set} and WEIGHTS_{set} belong together")),
            }
        }
        if sets.is_empty() {
            file.notes
                .add("a primitive of a skinned node has no joints: its node moves it");
            return Ok(None);
        }
        let joints: Vec<usize> = skin.joints().map(|joint| joint.index()).collect();
        if joints.is_empty() {
            return Err(format!("skin {} has no joints", skin.index()));
        }
        let to_joint = skin
            .inverse_bind_matrices()
            .map(|accessor| Values::open(file, &accessor, Role::Matrices))
            .transpose()?;
        if let Some(to_joint) = &to_joint
            && to_joint.count < joints.len()
        {
            return Err(format!(
                "skin {} has {} inverse bind matrices for {} joints",
                skin.index(),
                to_joint.count,
                joints.len()
            ));
        }
        let to_world = joints
            .iter()
            .zip(0..)
            .map(|(&joint, i)| {
                let to_joint = match &to_joint {
                    Some(values) => DMat4::from_cols_array(&values.finite(i)?),
                    None => DMat4::IDENTITY,
                };
                Ok(file.nodes.to_world[joint] * to_joint)
            })
            .collect::<Result<_, String>>()?;
        Ok(Some(Self { to_world, sets }))
    }

    /// From a vertex's place at rest to the world.
    pub fn matrix(&self, vertex: u32) -> Result<DMat4, String> {
        let (mut sum, mut total) = (DMat4::ZERO, 0.0);
        for [joints, weights] in &self.sets {
            let joints = joints.get::<4>(vertex);
            let weights = weights.finite::<4>(vertex)?;
            for (joint, weight) in joints.into_iter().zip(weights) {
                let matrix = self.to_world.get(joint as usize).ok_or_else(|| {
                    format!(
                        "vertex {vertex} has joint {joint}, the skin has {}",
                        self.to_world.len()
                    )
                })?;
                sum += *matrix * weight;
                total += weight;
            }
        }
        // Weights are to sum to one; the first joint has what none has.
        if total > 0.0 {
            Ok(sum * (1.0 / total))
        } else {
            Ok(self.to_world[0])
        }
    }
}

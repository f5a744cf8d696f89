//! A primitive as triangles in its own space, or where its joints put it.

use deep_screen_space::glam::{DMat3, DVec3};
use gltf::{Mesh, Node, Primitive, Semantic, mesh::Mode};

use super::{
    File,
    accessors::{Role, Values},
    deform::{Morph, Skin},
    materials::{self, Group},
    triangles::{cofactors, corners, direction, left_over},
};

/// Triangles of a primitive, with the vertices that they have.
pub struct Shape {
    pub positions: Vec<DVec3>,
    /// Of unit length, or zero where there is none.
    pub normals: Vec<DVec3>,
    /// Group after group.
    pub triangles: Vec<[u32; 3]>,
    /// Which triangles the joints mirror.
    pub turned: Vec<bool>,
    pub groups: Vec<Group>,
    /// Where it is alpha-tested: one to a position.
    pub tex_coords: Vec<[f32; 2]>,
    /// Whether positions are the world's.
    pub skinned: bool,
}

/// Reads a primitive; none where it has no triangles. `room` is how many corners there may be.
pub fn read(
    file: &File<'_>,
    node: &Node<'_>,
    mesh: &Mesh<'_>,
    primitive: &Primitive<'_>,
    room: usize,
) -> Result<Option<Shape>, String> {
    let mode = primitive.mode();
    let Some(positions) = primitive.get(&Semantic::Positions) else {
        file.notes.add("a primitive without positions is left out");
        return Ok(None);
    };
    let positions = Values::open(file, &positions, Role::Positions)?;
    let indices = read_indices(file, primitive, positions.count, room)?;
    let Some(mut triangles) = corners(mode, &indices) else {
        file.notes
            .add(format!("a primitive of {} is left out", name(mode)));
        return Ok(None);
    };
    let rest = left_over(mode, indices.len());
    if rest > 0 {
        file.notes.add(format!(
            "{rest} indices at the end of a primitive make no triangle"
        ));
    }
    if triangles.is_empty() {
        return Ok(None);
    }

    // The vertices that triangles have, in the file's order.
    let mut used: Vec<u32> = triangles.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    let all = used
        .last()
        .is_some_and(|last| *last as usize + 1 == used.len());
    if !all {
        for corner in triangles.as_flattened_mut() {
            // Each is there.
            *corner = used.binary_search(corner).unwrap_or_default() as u32;
        }
    }

    let open = |semantic: &Semantic, role: Role| {
        open_attribute(file, primitive, semantic, role, positions.count)
    };
    let normals = open(&Semantic::Normals, Role::Normals)?;
    let morph = Morph::open(file, node, mesh, primitive, positions.count)?;
    let skin = match node.skin() {
        Some(skin) => Skin::open(file, &skin, open)?,
        None => None,
    };
    let mut shape = Shape {
        positions: Vec::with_capacity(used.len()),
        normals: Vec::with_capacity(used.len()),
        triangles,
        turned: Vec::new(),
        groups: Vec::new(),
        tex_coords: Vec::new(),
        skinned: skin.is_some(),
    };
    let mut mirrored = Vec::new();
    for &i in &used {
        let mut position = DVec3::from(positions.finite(i)?) + morph.position(i)?;
        let mut normal = match &normals {
            Some(normals) => DVec3::from(normals.get(i)) + morph.normal(i),
            None => DVec3::ZERO,
        };
        if let Some(skin) = &skin {
            let to_world = skin.matrix(i)?;
            let linear = DMat3::from_mat4(to_world);
            let side = if linear.determinant() < 0.0 {
                -1.0
            } else {
                1.0
            };
            position = to_world.transform_point3(position);
            normal = cofactors(linear) * normal * side;
            mirrored.push(side < 0.0);
        }
        shape.positions.push(position);
        shape.normals.push(direction(normal).unwrap_or(DVec3::ZERO));
    }
    materials::group(file, primitive, &used, &mut shape, open)?;
    let is_turned = |t: &[u32; 3]| mirrored.get(t[0] as usize).is_some_and(|m| *m);
    shape.turned = shape.triangles.iter().map(is_turned).collect();
    Ok(Some(shape))
}

/// Opens an attribute that has a value for each vertex.
fn open_attribute<'a>(
    file: &File<'a>,
    primitive: &Primitive<'a>,
    semantic: &Semantic,
    role: Role,
    vertices: usize,
) -> Result<Option<Values<'a>>, String> {
    let Some(accessor) = primitive.get(semantic) else {
        return Ok(None);
    };
    let values = Values::open(file, &accessor, role)?;
    check_count(&values, semantic.to_string().as_str(), vertices)?;
    Ok(Some(values))
}

pub fn check_count(values: &Values<'_>, name: &str, vertices: usize) -> Result<(), String> {
    if values.count == vertices {
        Ok(())
    } else {
        Err(format!(
            "{} of {name} for {vertices} positions",
            values.count
        ))
    }
}

fn read_indices(
    file: &File<'_>,
    primitive: &Primitive<'_>,
    vertices: usize,
    room: usize,
) -> Result<Vec<u32>, String> {
    let indices = primitive
        .indices()
        .map(|indices| Values::open(file, &indices, Role::Indices))
        .transpose()?;
    let count = indices.as_ref().map_or(vertices, |indices| indices.count);
    if count > room {
        return Err(format!("{count} indices, there is room for {room}"));
    }
    let Some(indices) = indices else {
        return Ok((0..vertices as u32).collect());
    };
    (0..count as u32)
        .map(|i| {
            let index = indices.get::<1>(i)[0] as u32;
            if (index as usize) < vertices {
                Ok(index)
            } else {
                Err(format!(
                    "index {i} is {index}, there are {vertices} vertices"
                ))
            }
        })
        .collect()
}

fn name(mode: Mode) -> &'static str {
    match mode {
        Mode::Points => "points",
        Mode::Lines | Mode::LineLoop | Mode::LineStrip => "lines",
        Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan => "triangles",
    }
}

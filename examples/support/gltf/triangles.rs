//! Lists, strips and fans as triangles, and triangles as they are placed in the world.

use deep_screen_space::glam::{DMat3, DMat4, DVec3};
use gltf::mesh::Mode;

use super::primitives::Shape;

/// Corners of each triangle out of a run of indices; those that are a line, as where a strip jumps, are left out. None for
/// what has no triangles.
pub fn corners(mode: Mode, indices: &[u32]) -> Option<Vec<[u32; 3]>> {
    let all: Vec<[u32; 3]> = match mode {
        Mode::Triangles => indices.as_chunks().0.to_vec(),
        Mode::TriangleStrip => indices
            .windows(3)
            .enumerate()
            .map(|(i, w)| {
                if i % 2 == 0 {
                    [w[0], w[1], w[2]]
                } else {
                    [w[0], w[2], w[1]]
                }
            })
            .collect(),
        Mode::TriangleFan => {
            let first = indices.first().copied().unwrap_or(0);
            let rim = indices.get(1..).unwrap_or(&[]);
            rim.windows(2).map(|w| [w[0], w[1], first]).collect()
        }
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => return None,
    };
    let is_triangle = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
    Some(all.into_iter().filter(is_triangle).collect())
}

/// How many corners the triangles of so many indices have at most.
pub fn most_corners(mode: Mode, count: usize) -> usize {
    match mode {
        Mode::Triangles => count,
        Mode::TriangleStrip | Mode::TriangleFan => count.saturating_sub(2).saturating_mul(3),
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => 0,
    }
}

/// How many indices at the end make no triangle.
pub fn left_over(mode: Mode, count: usize) -> usize {
    match mode {
        Mode::Triangles => count % 3,
        _ if count < 3 => count,
        _ => 0,
    }
}

/// A shape in the world.
pub struct Placed {
    pub positions: Vec<DVec3>,
    pub normals: Vec<DVec3>,
    /// As the shape's: none, or one to a position.
    pub tex_coords: Vec<[f32; 2]>,
    pub triangles: Vec<[u32; 3]>,
}

/// Moves a shape. What mirrors it turns its triangles around, so that fronts stay fronts, and a corner without a normal has
/// that of its triangle.
pub fn place(shape: &Shape, to_world: DMat4) -> Result<Placed, String> {
    let linear = DMat3::from_mat4(to_world);
    let mirrors = linear.determinant() < 0.0;
    let to_normal = cofactors(linear) * if mirrors { -1.0 } else { 1.0 };
    let mut positions: Vec<DVec3> = shape
        .positions
        .iter()
        .map(|&p| to_world.transform_point3(p))
        .collect();
    let beyond = |p: &DVec3| !p.is_finite() || p.abs().max_element() > f64::from(f32::MAX);
    if positions.iter().any(beyond) {
        return Err("a position is beyond what f32 can say".into());
    }
    let mut normals: Vec<DVec3> = shape
        .normals
        .iter()
        .map(|&n| direction(to_normal * n).unwrap_or(DVec3::ZERO))
        .collect();
    let mut tex_coords = shape.tex_coords.clone();
    let mut triangles = shape.triangles.clone();
    for (triangle, turned) in triangles.iter_mut().zip(&shape.turned) {
        if mirrors != *turned {
            triangle.swap(1, 2);
        }
        let [a, b, c] = triangle.map(|i| positions[i as usize]);
        let face = (b - a).cross(c - a);
        for corner in triangle {
            if normals[*corner as usize] == DVec3::ZERO {
                positions.push(positions[*corner as usize]);
                if !tex_coords.is_empty() {
                    tex_coords.push(tex_coords[*corner as usize]);
                }
                // Of a triangle without an area nothing is seen.
                normals.push(direction(face).unwrap_or(DVec3::Y));
                *corner = positions.len() as u32 - 1;
            }
        }
    }
    Ok(compact(&Placed {
        positions,
        normals,
        tex_coords,
        triangles,
    }))
}

/// Of unit length, where it has a direction. Taken by its largest component first: squares of f64's ends are not f64's.
pub fn direction(v: DVec3) -> Option<DVec3> {
    let largest = v.abs().max_element();
    (largest > 0.0 && v.is_finite()).then(|| (v / largest).normalize())
}

/// What turns normals as a matrix turns surfaces, but for its sign: the inverse's transpose times the determinant, which a
/// matrix that flattens has too.
pub fn cofactors(m: DMat3) -> DMat3 {
    DMat3::from_cols(
        m.y_axis.cross(m.z_axis),
        m.z_axis.cross(m.x_axis),
        m.x_axis.cross(m.y_axis),
    )
}

/// Leaves out vertices that no triangle has.
fn compact(all: &Placed) -> Placed {
    let mut rooms = vec![u32::MAX; all.positions.len()];
    for &i in all.triangles.as_flattened() {
        rooms[i as usize] = 0;
    }
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    let mut tex_coords = Vec::new();
    for (i, room) in rooms.iter_mut().enumerate() {
        if *room == 0 {
            *room = positions.len() as u32;
            positions.push(all.positions[i]);
            normals.push(all.normals[i]);
            tex_coords.extend(all.tex_coords.get(i));
        }
    }
    Placed {
        positions,
        normals,
        tex_coords,
        triangles: all
            .triangles
            .iter()
            .map(|t| t.map(|i| rooms[i as usize]))
            .collect(),
    }
}

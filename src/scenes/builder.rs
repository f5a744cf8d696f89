//! A small mesh builder: shapes go in by material, a [`Scene`] with one part a material comes out.
//!
//! Shapes are worked out in `f64` and rounded to `f32` once, when a vertex is stored. Where one
//! shape stands on another, scenes leave the hidden face away or sink the end in a little: two
//! faces in one plane would leave it to rounding which of them a ray meets.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DQuat, DVec2, DVec3, Vec3};

use super::{Material, Part, Scene, View};

/// A material the builder knows.
#[derive(Clone, Copy)]
pub(super) struct MaterialId(usize);

/// Whether a block has a bottom face. One that stands on a floor goes without.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Base {
    Closed,
    Open,
}

/// The triangles of one material.
#[derive(Default)]
struct Group {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    indices: Vec<u32>,
}

impl Group {
    fn push_vertex(&mut self, position: DVec3, normal: DVec3) {
        self.positions.push(position.as_vec3().to_array());
        self.normals.push(normal.as_vec3().to_array());
    }

    /// Adds a triangle unless two of its corners fell together, as they do at a sphere's pole.
    fn push_triangle(&mut self, corners: [u32; 3]) {
        let [a, b, c] = corners.map(|corner| Vec3::from(self.positions[corner as usize]));
        if a != b && b != c && c != a {
            self.indices.extend(corners);
        }
    }
}

/// Collects shapes.
#[derive(Default)]
pub(super) struct Builder {
    materials: Vec<Material>,
    groups: Vec<Group>,
}

impl Builder {
    /// Adds a surface that only reflects.
    pub(super) fn surface(&mut self, albedo: [f32; 3]) -> MaterialId {
        self.material(albedo, [0.0; 3])
    }

    /// Adds a surface that reflects `albedo` and emits `emission`, in W/m².
    pub(super) fn material(&mut self, albedo: [f32; 3], emission: [f32; 3]) -> MaterialId {
        self.materials.push(Material {
            albedo,
            emission,
            double_sided: false,
        });
        self.groups.push(Group::default());
        MaterialId(self.materials.len() - 1)
    }

    /// A sheet of `cells[0]` by `cells[1]` quadrilaterals over the lattice points that `vertex`
    /// gives a position and a unit normal to, both ends included. With i growing along one edge
    /// and j along the other, (d/di) x (d/dj) must point to the side of the normals.
    pub(super) fn lattice(
        &mut self,
        material: MaterialId,
        cells: [usize; 2],
        vertex: impl Fn(usize, usize) -> (DVec3, DVec3),
    ) {
        let group = &mut self.groups[material.0];
        let first = group.positions.len() as u32;
        for j in 0..=cells[1] {
            for i in 0..=cells[0] {
                let (position, normal) = vertex(i, j);
                group.push_vertex(position, normal);
            }
        }
        let [columns, rows] = cells.map(|count| count as u32);
        for j in 0..rows {
            for i in 0..columns {
                let a = first + j * (columns + 1) + i;
                let (b, c, d) = (a + 1, a + columns + 2, a + columns + 1);
                group.push_triangle([a, b, c]);
                group.push_triangle([a, c, d]);
            }
        }
    }

    /// A flat quadrilateral; its corners run counter-clockwise seen from its front.
    pub(super) fn quad(&mut self, material: MaterialId, corners: [DVec3; 4]) {
        let [a, b, c, d] = corners;
        let normal = (b - a).cross(c - a).normalize();
        let rows = [[a, b], [d, c]];
        self.lattice(material, [1, 1], |i, j| (rows[j][i], normal));
    }

    /// A triangle; its corners run counter-clockwise seen from the side of its normal.
    pub(super) fn triangle(&mut self, material: MaterialId, corners: [DVec3; 3], normal: DVec3) {
        let group = &mut self.groups[material.0];
        let first = group.positions.len() as u32;
        for corner in corners {
            group.push_vertex(corner, normal);
        }
        group.push_triangle([first, first + 1, first + 2]);
    }

    /// A flat parallelogram from `corner` along `u` and `v`, cut into cells; its front is to the
    /// side of `u` x `v`.
    pub(super) fn grid(
        &mut self,
        material: MaterialId,
        corner: DVec3,
        u: DVec3,
        v: DVec3,
        cells: [usize; 2],
    ) {
        let normal = u.cross(v).normalize();
        self.lattice(material, cells, |i, j| {
            let along_u = u * (i as f64 / cells[0] as f64);
            let along_v = v * (j as f64 / cells[1] as f64);
            (corner + along_u + along_v, normal)
        });
    }

    /// A box about the origin of `pose`, a rigid motion, with the given half extents.
    pub(super) fn block(&mut self, material: MaterialId, pose: DAffine3, half: DVec3, base: Base) {
        // Corner k has the high side of x, y, z where bit 0, 1, 2 of k is set.
        const BOTTOM: [usize; 4] = [0, 1, 5, 4];
        const SIDES_AND_TOP: [[usize; 4]; 5] = [
            [0, 4, 6, 2],
            [5, 1, 3, 7],
            [1, 0, 2, 3],
            [4, 5, 7, 6],
            [2, 6, 7, 3],
        ];
        let corner = |k: usize| {
            let sign = |bit: usize| if k & bit == 0 { -1.0 } else { 1.0 };
            pose.transform_point3(half * DVec3::new(sign(1), sign(2), sign(4)))
        };
        for face in SIDES_AND_TOP {
            self.quad(material, face.map(corner));
        }
        if base == Base::Closed {
            self.quad(material, BOTTOM.map(corner));
        }
    }

    /// A box square to the axes between two opposite corners.
    pub(super) fn aligned_block(
        &mut self,
        material: MaterialId,
        low: DVec3,
        high: DVec3,
        base: Base,
    ) {
        let pose = DAffine3::from_translation((low + high) / 2.0);
        self.block(material, pose, (high - low) / 2.0, base);
    }

    /// A profile of (radius, height) points turned about the Y axis of `pose`, a rigid motion.
    /// Normals are smooth around and creased at each point of the profile. The surface's front is
    /// to the right of the profile's way: up along a side is outward.
    pub(super) fn lathe(
        &mut self,
        material: MaterialId,
        pose: DAffine3,
        profile: &[DVec2],
        sides: usize,
    ) {
        for ends in profile.windows(2) {
            let along = ends[1] - ends[0];
            let slope = DVec2::new(along.y, -along.x).normalize();
            self.lattice(material, [sides, 1], |i, j| {
                let outward = around(i, sides);
                let position = outward * ends[j].x + DVec3::Y * ends[j].y;
                let normal = outward * slope.x + DVec3::Y * slope.y;
                (
                    pose.transform_point3(position),
                    pose.transform_vector3(normal),
                )
            });
        }
    }

    /// A cylinder closed at both ends.
    pub(super) fn cylinder(
        &mut self,
        material: MaterialId,
        from: DVec3,
        to: DVec3,
        radius: f64,
        sides: usize,
    ) {
        let axis = to - from;
        let height = axis.length();
        let turn = DQuat::from_rotation_arc(DVec3::Y, axis / height);
        let profile = [
            DVec2::new(0.0, 0.0),
            DVec2::new(radius, 0.0),
            DVec2::new(radius, height),
            DVec2::new(0.0, height),
        ];
        let pose = DAffine3::from_rotation_translation(turn, from);
        self.lathe(material, pose, &profile, sides);
    }

    /// A sphere of 2 · `sides` · (`rings` - 1) triangles.
    pub(super) fn sphere(
        &mut self,
        material: MaterialId,
        centre: DVec3,
        radius: f64,
        [sides, rings]: [usize; 2],
    ) {
        self.lattice(material, [sides, rings], |i, j| {
            let outward = match j {
                0 => DVec3::NEG_Y,
                // The sine of pi is not quite zero: the pole is one point by decree.
                _ if j == rings => DVec3::Y,
                _ => {
                    let (sin, cos) = (PI * j as f64 / rings as f64).sin_cos();
                    around(i, sides) * sin - DVec3::Y * cos
                }
            };
            (centre + outward * radius, outward)
        });
    }

    /// Puts the materials' triangles one after the other.
    pub(super) fn finish(self, name: &'static str, views: Vec<View>, ao_radius: f32) -> Scene {
        let mut scene = Scene {
            name,
            positions: Vec::new(),
            normals: Vec::new(),
            indices: Vec::new(),
            parts: Vec::new(),
            materials: self.materials,
            views,
            ao_radius,
            holes: None,
        };
        for (material, group) in self.groups.into_iter().enumerate() {
            let first_vertex = scene.positions.len() as u32;
            scene.parts.push(Part {
                first_index: scene.indices.len() as u32,
                index_count: group.indices.len() as u32,
                material: material as u32,
            });
            scene.positions.extend(group.positions);
            scene.normals.extend(group.normals);
            scene
                .indices
                .extend(group.indices.iter().map(|index| first_vertex + index));
        }
        scene
    }
}

/// The unit vector `step` of `steps` of the way around the Y axis, from +X by way of -Z. The last
/// step gives the very numbers of the first, so that a turned surface closes without a gap.
pub(super) fn around(step: usize, steps: usize) -> DVec3 {
    let angle = TAU * (step % steps) as f64 / steps as f64;
    DVec3::new(angle.cos(), 0.0, -angle.sin())
}

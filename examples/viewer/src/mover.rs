//! An object that moves through the scene: a box whose vertices are written anew.

use std::f32::consts::TAU;

use deep_screen_space::{
    glam::{DMat4, DVec3, Mat3, Vec3},
    scenes::{Material, Part, Scene},
    wgpu,
};
use support::scene::SceneBuffers;

/// The last vertices of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mover {
    /// What it circles about.
    center: Vec3,
    radius: f32,
    half: f32,
}

/// Corners of six sides.
const VERTICES: usize = 24;

impl Mover {
    /// Adds a box to a scene, which circles about a point in this distance from it. It is without extent until it is placed.
    pub fn add(scene: &mut Scene, center: DVec3, radius: f64) -> Self {
        let mover = Self {
            center: center.as_vec3(),
            radius: radius as f32,
            half: 0.35 * radius as f32,
        };
        let first = scene.positions.len() as u32;
        let first_index = scene.indices.len() as u32;
        scene.positions.extend([mover.center.to_array(); VERTICES]);
        scene.normals.extend(mover.at(Some(0.0)).1);
        if let Some(holes) = &mut scene.holes {
            holes.tex_coords.extend([[0.0; 2]; VERTICES]);
            holes.tests.resize(scene.materials.len() + 1, None);
        }
        for side in (first..).step_by(4).take(VERTICES / 4) {
            scene.indices.extend([0, 1, 2, 0, 2, 3].map(|k| side + k));
        }
        scene.parts.push(Part {
            first_index,
            index_count: (VERTICES / 4 * 6) as u32,
            material: scene.materials.len() as u32,
        });
        scene.materials.push(Material {
            albedo: [0.8, 0.35, 0.1],
            emission: [0.0; 3],
            double_sided: false,
        });
        mover
    }

    /// Positions and normals, after so many rounds; as small as a point where there is no number.
    pub fn at(&self, rounds: Option<f32>) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
        let half = if rounds.is_some() { self.half } else { 0.0 };
        let (place, turn) = self.turned(rounds.unwrap_or_default());
        let (mut positions, mut normals) = (Vec::new(), Vec::new());
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let [mut normal, mut u, mut v] = [Vec3::ZERO; 3];
                normal[axis] = sign;
                u[(axis + 1) % 3] = 1.0;
                // Counter-clockwise from outside.
                v[(axis + 2) % 3] = sign;
                for [a, b] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
                    positions.push((place + half * (turn * (normal + a * u + b * v))).to_array());
                    normals.push((turn * normal).to_array());
                }
            }
        }
        (positions, normals)
    }

    /// Where its middle is after so many rounds, and how it is turned.
    fn turned(&self, rounds: f32) -> (Vec3, Mat3) {
        let angle = TAU * rounds;
        let place = self.center
            + Vec3::new(
                self.radius * angle.cos(),
                self.half * (1.2 + (2.0 * angle).sin()),
                self.radius * angle.sin(),
            );
        let turn = Mat3::from_rotation_y(2.0 * angle) * Mat3::from_rotation_x(angle);
        (place, turn)
    }

    /// From its own space, in which it reaches from -1 to 1, to the world.
    pub fn world_from_box(&self, rounds: f32) -> DMat4 {
        let (place, turn) = self.turned(rounds);
        let turn = DMat4::from_mat3(turn.as_dmat3());
        let half = DVec3::splat(self.half.into());
        DMat4::from_translation(place.as_dvec3()) * turn * DMat4::from_scale(half)
    }

    /// Writes it to the GPU. It is in the last run, unless that was cut within it.
    pub fn write(&self, queue: &wgpu::Queue, buffers: &SceneBuffers, rounds: Option<f32>) {
        let (positions, normals) = self.at(rounds);
        let Some(run) = buffers.runs.last() else {
            return;
        };
        for (buffer, values) in [(&run.positions, positions), (&run.normals, normals)] {
            let bytes: &[u8] = bytemuck::cast_slice(&values);
            if let Some(offset) = buffer.size().checked_sub(bytes.len() as u64) {
                queue.write_buffer(buffer, offset, bytes);
            }
        }
    }

    /// Writes it to the scene that it was added to, for the ray tracer.
    pub fn place(&self, scene: &mut Scene, rounds: Option<f32>) {
        let (positions, normals) = self.at(rounds);
        let at = scene.positions.len() - VERTICES;
        scene.positions[at..].copy_from_slice(&positions);
        scene.normals[at..].copy_from_slice(&normals);
    }
}

#[cfg(test)]
mod tests {
    use deep_screen_space::{glam::DVec3, scenes};

    use super::*;

    #[test]
    fn its_triangles_look_outward() {
        let mut scene = scenes::cornell();
        let before = scene.triangle_count();
        let mover = Mover::add(&mut scene, DVec3::new(1.0, 2.0, 3.0), 2.0);
        assert_eq!(scene.triangle_count(), before + 12);
        mover.place(&mut scene, Some(0.3));
        for corners in scene.indices[3 * before..].chunks_exact(3) {
            let at = |k: usize| Vec3::from(scene.positions[corners[k] as usize]);
            let normal = Vec3::from(scene.normals[corners[0] as usize]);
            let face = (at(1) - at(0)).cross(at(2) - at(0)).normalize();
            assert!(face.dot(normal) > 0.999, "{face} and {normal}");
        }
        // Its corners are those of its own space.
        let own = mover.world_from_box(0.3).inverse();
        for position in &scene.positions[scene.positions.len() - VERTICES..] {
            let corner = own.transform_point3(Vec3::from(*position).as_dvec3());
            assert!((corner.abs() - 1.0).abs().max_element() < 1e-5, "{corner}");
        }
        // Away, it is a point, which nothing sees.
        mover.place(&mut scene, None);
        let last = scene.positions.len() - VERTICES;
        assert!(
            scene.positions[last..]
                .iter()
                .all(|p| *p == scene.positions[last])
        );
    }
}

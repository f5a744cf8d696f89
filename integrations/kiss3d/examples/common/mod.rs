//! A scene of the library's in kiss3d.

use std::{cell::RefCell, rc::Rc};

use deep_screen_space_kiss3d::deep_screen_space::scenes::{Part, Scene};
use kiss3d::{
    camera::OrbitCamera3d, color::Color, glamx::Vec3, light::Light, resource::GpuMesh3d,
    scene::SceneNode3d,
};

/// Adds a scene, an object a part. kiss3d's lights are the caller's to add.
pub fn add(scene: &Scene, to: &mut SceneNode3d) {
    for part in &scene.parts {
        let material = &scene.materials[part.material as usize];
        let mesh = Rc::new(RefCell::new(mesh(scene, part)));
        let [r, g, b] = material.albedo;
        // Emission is radiosity in the library, radiance in kiss3d.
        let [er, eg, eb] = material.emission.map(|e| e / std::f32::consts::PI);
        let mut node = to.add_mesh(mesh, Vec3::ONE);
        node.set_color(Color::new(r, g, b, 1.0));
        node.apply_to_objects_mut_recursive(&mut |object| {
            object.set_emissive(Color::new(er, eg, eb, 1.0));
            object.set_roughness(1.0);
            object.set_reflectance(0.0);
            // The scenes have single sheets, which are seen from either side.
            object.enable_backface_culling(false);
        });
    }
}

/// The vertices of a part alone.
fn mesh(scene: &Scene, part: &Part) -> GpuMesh3d {
    let range = part.first_index as usize..(part.first_index + part.index_count) as usize;
    let mut place = vec![None; scene.positions.len()];
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    let corners: Vec<u32> = scene.indices[range]
        .iter()
        .map(|&index| {
            let index = index as usize;
            *place[index].get_or_insert_with(|| {
                positions.push(Vec3::from(scene.positions[index]));
                normals.push(Vec3::from(scene.normals[index]));
                positions.len() as u32 - 1
            })
        })
        .collect();
    let faces = corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]);
    GpuMesh3d::new(positions, faces.collect(), Some(normals), None, false)
}

/// A scene's first view.
pub fn camera(scene: &Scene) -> OrbitCamera3d {
    let view = &scene.views[0];
    let [eye, target] = [view.eye, view.target].map(|p| Vec3::from(p.map(|x| x as f32)));
    let fov = view.vertical_fov_degrees.to_radians() as f32;
    // kiss3d's projection is OpenGL's, of whose depth wgpu cuts off the half before 0: what is nearer than twice this.
    let near = view.near as f32 / 2.0;
    OrbitCamera3d::new_with_frustum(fov, near, 1000.0, eye, target)
}

/// Light from above, that comes in sideways.
#[allow(dead_code)] // not of use to all that share this file
pub fn sun() -> Light {
    Light::directional(Vec3::new(-0.5, -1.0, -0.4)).with_intensity(4.0)
}

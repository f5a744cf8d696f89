//! What every scene promises.

use std::collections::{HashMap, HashSet};

use glam::{DVec3, Vec3};

use super::closed_room::SHELL_MATERIALS;
use super::{
    MAX_STRESS_TRIANGLES, Scene, all, by_name, closed_room, grass, grass_cut_out, statue, stress,
};

/// The corner positions of a triangle, in `f64`.
fn corners(scene: &Scene, triangle: usize) -> [DVec3; 3] {
    vertices(scene, triangle).map(|index| position(scene, index))
}

fn vertices(scene: &Scene, triangle: usize) -> [usize; 3] {
    [0, 1, 2].map(|corner| scene.indices[3 * triangle + corner] as usize)
}

fn position(scene: &Scene, index: usize) -> DVec3 {
    Vec3::from(scene.positions[index]).as_dvec3()
}

/// All scenes, with the stress scene at sizes that do and do not fill its rows too.
fn examined() -> impl Iterator<Item = Scene> {
    let sizes = [0, 7, 100, 1_001, 12_345];
    let of_one_purpose = [grass(), grass_cut_out(), statue()];
    all()
        .into_iter()
        .chain(of_one_purpose)
        .chain(sizes.into_iter().map(stress))
}

#[test]
fn meshes_are_well_formed() {
    for scene in examined() {
        let name = scene.name;
        assert_eq!(scene.positions.len(), scene.normals.len(), "{name}");
        assert_eq!(scene.indices.len() % 3, 0, "{name}");
        for (index, normal) in scene.normals.iter().enumerate() {
            let length = Vec3::from(*normal).length();
            assert!(
                (length - 1.0).abs() < 1e-5,
                "{name}: normal {index} has length {length}"
            );
        }
        for position in &scene.positions {
            assert!(Vec3::from(*position).is_finite(), "{name}: {position:?}");
        }
        let count = scene.positions.len();
        assert!(
            scene.indices.iter().all(|index| (*index as usize) < count),
            "{name}"
        );
    }
}

#[test]
fn triangles_have_area_and_face_their_normals() {
    for scene in examined() {
        let name = scene.name;
        for triangle in 0..scene.triangle_count() {
            let [a, b, c] = corners(&scene, triangle);
            let normal = (b - a).cross(c - a);
            let longest = (b - a).length().max((c - b).length()).max((a - c).length());
            assert!(
                normal.length() > 1e-6 * longest * longest,
                "{name}: triangle {triangle} is degenerate: {a} {b} {c}"
            );
            for index in vertices(&scene, triangle) {
                let shading = Vec3::from(scene.normals[index]).as_dvec3();
                assert!(
                    normal.dot(shading) > 0.0,
                    "{name}: triangle {triangle} {a} {b} {c} faces away from normal {shading}"
                );
            }
        }
    }
}

#[test]
fn parts_tile_the_indices() {
    for scene in examined() {
        let name = scene.name;
        let mut next = 0;
        for part in &scene.parts {
            assert_eq!(part.first_index, next, "{name}");
            assert_eq!(part.index_count % 3, 0, "{name}");
            assert!((part.material as usize) < scene.materials.len(), "{name}");
            next += part.index_count;
        }
        assert_eq!(next as usize, scene.indices.len(), "{name}");
    }
}

#[test]
fn materials_conserve_energy() {
    for scene in examined() {
        for material in &scene.materials {
            assert!(
                material.albedo.iter().all(|a| (0.0..1.0).contains(a)),
                "{material:?}"
            );
            assert!(material.emission.iter().all(|e| *e >= 0.0), "{material:?}");
        }
    }
}

#[test]
fn views_are_usable() {
    for scene in examined() {
        let name = scene.name;
        let names: HashSet<_> = scene.views.iter().map(|view| view.name).collect();
        assert!(
            scene.views.len() >= 2 && names.len() == scene.views.len(),
            "{name}"
        );
        assert!(scene.ao_radius > 0.0, "{name}");
        for view in &scene.views {
            let ahead = DVec3::from(view.target) - DVec3::from(view.eye);
            assert!(
                ahead.cross(DVec3::from(view.up)).length() > 1e-3,
                "{name}: {view:?}"
            );
            assert!(view.near > 0.0, "{name}: {view:?}");
            assert!(
                (1.0..120.0).contains(&view.vertical_fov_degrees),
                "{name}: {view:?}"
            );
        }
    }
}

#[test]
fn names_find_their_scenes() {
    for scene in all().into_iter().chain([statue()]) {
        assert_eq!(by_name(scene.name).as_ref(), Some(&scene));
    }
    assert_eq!(by_name("nowhere"), None);
}

#[test]
fn triangle_counts_are_as_promised() {
    let count = |name| by_name(name).map_or(0, |scene| scene.triangle_count());
    assert_eq!(count("cornell"), 32);
    let colonnade = count("colonnade");
    assert!((45_000..=55_000).contains(&colonnade), "{colonnade}");
    let dominoes = count("dominoes");
    assert!((2_500..=4_000).contains(&dominoes), "{dominoes}");
}

#[test]
fn stress_has_the_count_asked_for() {
    for asked in [2, 3, 500, 4_999, 70_000, 1_000_000] {
        assert_eq!(stress(asked).triangle_count(), asked / 2 * 2);
    }
    assert_eq!(stress(0).triangle_count(), 2);
    assert_eq!(stress(usize::MAX).triangle_count(), MAX_STRESS_TRIANGLES);
}

#[test]
fn closed_room_shell_is_watertight() {
    let scene = closed_room();
    // Vertices are shared within a wall only: weld the walls by position.
    let key = |index: u32| scene.positions[index as usize].map(f32::to_bits);
    let mut edges = HashMap::new();
    for part in scene
        .parts
        .iter()
        .filter(|part| part.material < SHELL_MATERIALS)
    {
        let range = part.first_index as usize..(part.first_index + part.index_count) as usize;
        for triangle in scene.indices[range].chunks_exact(3) {
            for corner in 0..3 {
                let edge = (key(triangle[corner]), key(triangle[(corner + 1) % 3]));
                *edges.entry(edge).or_insert(0) += 1;
            }
        }
    }
    assert!(!edges.is_empty());
    // In a closed mesh with one winding, each edge runs once each way.
    for ((from, to), count) in &edges {
        let back = edges.get(&(*to, *from));
        assert_eq!(
            (*count, back),
            (1, Some(&1)),
            "{:?}",
            from.map(f32::from_bits)
        );
    }
}

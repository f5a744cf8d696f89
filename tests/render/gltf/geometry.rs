//! Triangles, normals and the types of their numbers.

use deep_screen_space::glam::{DVec3, Vec3};
use serde_json::json;

use super::files::{
    BYTE, CORNERS, File, SHORT, SQUARE, UNSIGNED_BYTE, UNSIGNED_INT, UNSIGNED_SHORT, area,
    assert_sound, near_origin, square, triangles,
};

/// Five points in a zigzag, and the three triangles of their strip.
const ZIGZAG: [[f32; 3]; 5] = [
    [0.0, 0.0, 0.0],
    [0.5, 1.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.5, 1.0, 0.0],
    [2.0, 0.0, 0.0],
];

fn of_mode(mode: u32, positions: &[[f32; 3]], indices: Option<&[u16]>) -> File {
    let mut file = File::new();
    let positions = file.floats(positions);
    let mut primitive = json!({ "attributes": { "POSITION": positions }, "mode": mode });
    if let Some(indices) = indices {
        primitive["indices"] = json!(file.indices(indices));
    }
    file.show(&primitive);
    file
}

#[test]
fn strips_and_fans_are_the_triangles_that_the_specification_has() {
    let strip_as_list = of_mode(4, &ZIGZAG, Some(&[0, 1, 2, 1, 3, 2, 2, 3, 4])).scene();
    for file in [
        of_mode(5, &ZIGZAG, None),
        of_mode(5, &ZIGZAG, Some(&[0, 1, 2, 3, 4])),
        // A strip that jumps has triangles that are lines.
        of_mode(5, &ZIGZAG, Some(&[0, 1, 2, 3, 4, 4])),
    ] {
        assert_eq!(triangles(&file.scene()), triangles(&strip_as_list));
    }
    let fan_as_list = of_mode(4, &CORNERS, Some(&[0, 1, 2, 0, 2, 3])).scene();
    for file in [
        of_mode(6, &CORNERS, None),
        of_mode(6, &CORNERS, Some(&[0, 1, 2, 3])),
    ] {
        assert_eq!(triangles(&file.scene()), triangles(&fan_as_list));
    }
    let list = [0, 1, 2, 1, 3, 2].map(|i: usize| ZIGZAG[i]);
    let without_indices = of_mode(4, &list, None).scene();
    let with_indices = of_mode(4, &ZIGZAG, Some(&[0, 1, 2, 1, 3, 2])).scene();
    assert_eq!(triangles(&without_indices), triangles(&with_indices));
}

/// What is left out is said.
#[test]
fn what_makes_no_triangle_is_noted() {
    for (mode, what) in [(0, "points"), (1, "lines"), (2, "lines"), (3, "lines")] {
        let alone = of_mode(mode, &ZIGZAG, None);
        let problem = alone.read().err().expect("nothing to draw");
        assert!(
            problem.contains("nothing to draw") && problem.contains(what),
            "{problem}"
        );
        let mut beside = square();
        let positions = beside.floats(&ZIGZAG);
        for _ in 0..2 {
            beside.show(&json!({ "attributes": { "POSITION": positions }, "mode": mode }));
        }
        let loaded = beside.read().expect("a square");
        assert_eq!(near_origin(loaded.world).triangle_count(), 2);
        assert_eq!(
            loaded.notes,
            [format!("a primitive of {what} is left out (2 times)")]
        );
    }
    let loaded = of_mode(4, &ZIGZAG, None).read().expect("a triangle");
    assert_eq!(near_origin(loaded.world).triangle_count(), 1);
    assert!(
        loaded.notes[0].starts_with("2 indices"),
        "{:?}",
        loaded.notes
    );
    let mut none = square();
    none.json["meshes"][0]["primitives"][0]["attributes"] = json!({ "NORMAL": 1 });
    let problem = none.read().err().expect("nothing to draw");
    assert!(problem.contains("without positions"), "{problem}");
}

/// Two faces of a roof: without normals, and with ones of no direction, each corner has its own face's.
#[test]
fn a_corner_without_a_normal_has_its_faces() {
    let roof = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 1.0],
        [0.0, -1.0, 1.0],
    ];
    let normals: [Option<[f32; 3]>; 4] = [
        None,
        Some([0.0; 3]),
        Some([f32::NAN; 3]),
        Some([0.0, f32::INFINITY, 0.0]),
    ];
    for normal in normals {
        let mut file = of_mode(4, &roof, Some(&[0, 1, 2, 1, 0, 3]));
        if let Some(normal) = normal {
            let accessor = file.floats(&[normal; 4]);
            file.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(accessor);
        }
        let scene = file.scene();
        assert_sound(&scene);
        for corners in scene.indices.as_chunks::<3>().0 {
            let [a, b, c] = corners.map(|i| Vec3::from(scene.positions[i as usize]));
            let face = (b - a).cross(c - a).normalize();
            for i in corners {
                let off = Vec3::from(scene.normals[*i as usize]) - face;
                assert!(off.length() < 1e-6, "{normal:?}: {off}");
            }
        }
    }
    // One of four is missing: its two triangles are in one plane, the others keep theirs.
    let mut file = square();
    let tilted = [0.6, 0.0, 0.8];
    let normals = file.floats(&[[0.0; 3], tilted, tilted, tilted]);
    file.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
    let scene = file.scene();
    for (position, normal) in scene.positions.iter().zip(&scene.normals) {
        let expected = if *position == CORNERS[0] {
            [0.0, 0.0, 1.0]
        } else {
            tilted
        };
        let off = Vec3::from(*normal) - Vec3::from(expected);
        assert!(off.length() < 1e-6, "{position:?}: {normal:?}");
    }
}

/// Vertices that no triangle has are left out: they are not part of the scene's bounds.
#[test]
fn vertices_of_no_triangle_are_left_out() {
    let mut positions = CORNERS.to_vec();
    positions.insert(1, [1e6; 3]);
    positions.push([-1e6; 3]);
    let file = of_mode(4, &positions, Some(&[0, 2, 3, 0, 3, 4]));
    let scene = file.scene();
    assert_eq!(triangles(&scene), triangles(&square().scene()));
    assert!(scene.positions.iter().all(|p| p[0].abs() <= 1.0));
}

#[test]
fn indices_of_every_size() {
    let wide: Vec<u8> = SQUARE
        .iter()
        .flat_map(|i| u32::from(*i).to_le_bytes())
        .collect();
    for (component, bytes) in [
        (UNSIGNED_BYTE, SQUARE.map(|i| i as u8).to_vec()),
        (UNSIGNED_INT, wide),
    ] {
        let mut file = square();
        let indices = file.accessor(component, "SCALAR", 6, &bytes);
        file.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
        assert_eq!(triangles(&file.scene()), triangles(&square().scene()));
    }
}

/// `KHR_mesh_quantization`: positions and normals in whole numbers, normalised or not; refused where the file does not use it.
#[test]
fn quantized_positions_and_normals() {
    let scale = 0.5_f32;
    for (component, normalized, one) in [
        (BYTE, false, 2_i32),
        (UNSIGNED_BYTE, false, 2),
        (SHORT, false, 2),
        (UNSIGNED_SHORT, false, 2),
        (BYTE, true, 127),
        (UNSIGNED_BYTE, true, 255),
        (SHORT, true, 32767),
        (UNSIGNED_SHORT, true, 65535),
    ] {
        let wide = matches!(component, SHORT | UNSIGNED_SHORT);
        let encode = |values: &[[i32; 3]; 4]| -> Vec<u8> {
            // Each element begins at a multiple of four bytes.
            let element = |v: &[i32; 3]| -> Vec<u8> {
                let all = [v[0], v[1], v[2], 0];
                if wide {
                    all.iter().flat_map(|c| (*c as u16).to_le_bytes()).collect()
                } else {
                    all.iter().map(|c| *c as u8).collect()
                }
            };
            values.iter().flat_map(element).collect()
        };
        let stride = if wide { 8 } else { 4 };
        let mut file = square();
        file.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
        file.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
        let corners = CORNERS.map(|p| p.map(|c| c as i32 * one));
        let positions = file.accessor(component, "VEC3", 4, &encode(&corners));
        let view = file.json["accessors"][positions]["bufferView"]
            .as_u64()
            .expect("an index");
        file.json["bufferViews"][view as usize]["byteStride"] = json!(stride);
        file.json["accessors"][positions]["normalized"] = json!(normalized);
        let primitive = &mut file.json["meshes"][0]["primitives"][0];
        primitive["attributes"]["POSITION"] = json!(positions);
        // Normals are normalised and have a sign.
        if normalized && matches!(component, BYTE | SHORT) {
            let normals = file.accessor(component, "VEC3", 4, &encode(&[[0, 0, one]; 4]));
            let view = file.json["accessors"][normals]["bufferView"]
                .as_u64()
                .expect("an index");
            file.json["bufferViews"][view as usize]["byteStride"] = json!(stride);
            file.json["accessors"][normals]["normalized"] = json!(true);
            file.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
        }
        if !normalized {
            file.json["nodes"][0]["scale"] = json!([scale, scale, scale]);
        }
        let scene = file.scene();
        assert_sound(&scene);
        assert_eq!(
            triangles(&scene),
            triangles(&square().scene()),
            "{component} {normalized}"
        );
        file.json["extensionsUsed"] = json!([]);
        let problem = file.read().err().expect("not declared");
        assert!(problem.contains("accessor 3 of positions"), "{problem}");
    }
}

/// What a sparse accessor replaces is what counts, with a buffer view below it and without.
#[test]
fn sparse_accessors() {
    let mut file = square();
    let places = file.view(&[1, 2]);
    let far: Vec<u8> = [5.0_f32, 0.0, 0.0, 5.0, 1.0, 0.0]
        .iter()
        .flat_map(|c| c.to_le_bytes())
        .collect();
    let values = file.view(&far);
    file.json["accessors"][0]["sparse"] = json!({
        "count": 2,
        "indices": { "bufferView": places, "componentType": UNSIGNED_BYTE },
        "values": { "bufferView": values },
    });
    assert!((area(&file.scene()) - DVec3::new(0.0, 0.0, 5.0)).length() < 1e-9);
    // All but two are zero: one of the two triangles has an area.
    file.json["accessors"][0]
        .as_object_mut()
        .expect("an object")
        .remove("bufferView");
    assert!((area(&file.scene()) - DVec3::new(0.0, 0.0, 2.5)).length() < 1e-9);
}

/// Positions and normals side by side in one view.
#[test]
fn interleaved_attributes() {
    let mut file = square();
    let both: Vec<u8> = CORNERS
        .iter()
        .flat_map(|p| [p[0], p[1], p[2], 0.0, 0.0, 1.0])
        .flat_map(f32::to_le_bytes)
        .collect();
    let view = file.view(&both);
    file.json["bufferViews"][view]["byteStride"] = json!(24);
    for (accessor, offset) in [(0, 0), (1, 12)] {
        file.json["accessors"][accessor]["bufferView"] = json!(view);
        file.json["accessors"][accessor]["byteOffset"] = json!(offset);
    }
    let scene = file.scene();
    assert_eq!(triangles(&scene), triangles(&square().scene()));
    assert!(scene.normals.iter().all(|n| *n == [0.0, 0.0, 1.0]));
}

/// Names of one's own for attributes, and bounds that are missing, are no faults.
#[test]
fn what_is_not_used_is_not_asked_for() {
    let mut file = square();
    file.json["meshes"][0]["primitives"][0]["attributes"]["_TEMPERATURE"] = json!(0);
    file.json["accessors"][0]["min"] = json!(["low"]);
    file.scene();
}

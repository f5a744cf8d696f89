//! Where meshes are: trees of nodes, joints, morph targets, instances; and what else nodes carry.

use deep_screen_space::{
    Light,
    glam::{DVec3, Vec3},
};
use serde_json::json;

use super::files::{
    BYTE, CORNERS, File, SHORT, UNSIGNED_BYTE, area, assert_sound, near_origin, square, triangles,
};

fn moved(by: [f32; 3]) -> Vec<[[f32; 3]; 3]> {
    let mut file = square();
    file.json["nodes"][0]["translation"] = json!(by);
    triangles(&file.scene())
}

#[test]
fn nodes_move_what_is_below_them() {
    let mut file = square();
    file.json["nodes"][0]["translation"] = json!([1, 2, 3]);
    let above = file.push("nodes", json!({ "children": [0], "scale": [2, 2, 2] }));
    file.json["scenes"][0]["nodes"] = json!([above]);
    let low = file.scene().positions[0];
    assert_eq!(low, [2.0, 4.0, 6.0]);
    // A quarter turn about y: what looked along z looks along x.
    let half = std::f32::consts::FRAC_1_SQRT_2;
    file.json["nodes"][0]["rotation"] = json!([0.0, half, 0.0, half]);
    assert!((area(&file.scene()) - DVec3::new(4.0, 0.0, 0.0)).length() < 1e-6);
    file.json["nodes"][above] = json!({
        "children": [0],
        "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 7, 0, 1],
    });
    assert!((area(&file.scene()) - DVec3::new(1.0, 0.0, 0.0)).length() < 1e-6);
    assert_eq!(file.scene().positions[0], [1.0, 9.0, 3.0]);
}

/// Fronts stay fronts where a node mirrors, and normals stay on their side; what flattens has normals too.
#[test]
fn mirrored_and_flattened_nodes() {
    for (scale, expected) in [
        ([-1.0, 1.0, 1.0], DVec3::Z),
        ([1.0, 1.0, -1.0], DVec3::NEG_Z),
        ([-2.0, -1.0, -1.0], 2.0 * DVec3::NEG_Z),
        ([1.0, 1.0, 0.0], DVec3::Z),
        ([1e-15, 1e-15, 1e-15], 1e-30 * DVec3::Z),
    ] {
        let mut file = square();
        file.json["nodes"][0]["scale"] = json!(scale);
        let scene = file.scene();
        assert_sound(&scene);
        let off = (area(&scene) - expected).length();
        assert!(
            off <= 1e-5 * expected.length(),
            "{scale:?}: {}",
            area(&scene)
        );
        for normal in &scene.normals {
            let cosine = Vec3::from(*normal).as_dvec3().dot(expected.normalize());
            assert!(cosine > 0.999, "{scale:?}: {normal:?}");
        }
    }
}

/// A slope of one in one, made four times as long and mirrored: its normal stays square to it, on its front.
#[test]
fn stretched_nodes_keep_normals_square() {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let mut file = square();
    let slope = file.floats(&[
        [0.0, 0.0, 0.0],
        [1.0, 0.0, -1.0],
        [1.0, 1.0, -1.0],
        [0.0, 1.0, 0.0],
    ]);
    let normals = file.floats(&[[half, 0.0, half]; 4]);
    file.json["meshes"][0]["primitives"][0]["attributes"] =
        json!({ "POSITION": slope, "NORMAL": normals });
    for stretch in [4.0_f64, -4.0] {
        file.json["nodes"][0]["scale"] = json!([stretch, 1, 1]);
        let scene = file.scene();
        let expected = area(&scene).normalize();
        assert!((expected.x - stretch.signum() / 17.0_f64.sqrt()).abs() < 1e-6);
        for normal in &scene.normals {
            let off = Vec3::from(*normal).as_dvec3() - expected;
            assert!(off.length() < 1e-6, "{stretch}: {normal:?}, not {expected}");
        }
    }
}

/// Without a list of scenes what no node is above is in the scene, and what is below that.
#[test]
fn a_file_without_scenes_shows_all() {
    let mut file = square();
    file.push(
        "nodes",
        json!({ "children": [0], "translation": [0, 0, 1] }),
    );
    let json = file.json.as_object_mut().expect("an object");
    json.remove("scene");
    json.remove("scenes");
    assert_eq!(triangles(&file.scene()), moved([0.0, 0.0, 1.0]));
    // A list without a default: the first.
    let mut file = square();
    file.json
        .as_object_mut()
        .expect("an object")
        .remove("scene");
    assert_eq!(triangles(&file.scene()), triangles(&square().scene()));
}

/// A scene farther away than `f32` can say in whole is kept near its own origin.
#[test]
fn far_scenes_keep_their_digits() {
    let mut file = square();
    file.json["nodes"][0]["scale"] = json!([0.25, 0.25, 0.25]);
    let away = file.push(
        "nodes",
        json!({ "children": [0], "translation": [16_777_216, -3, 0] }),
    );
    file.json["scenes"][0]["nodes"] = json!([away]);
    let world = file.read().expect("a square").world;
    assert_eq!(world.positions[0], DVec3::new(16_777_216.0, -3.0, 0.0));
    assert!((area(&near_origin(world)) - 0.0625 * DVec3::Z).length() < 1e-9);
}

/// Joints alone place a skinned mesh: where its node is does not matter.
#[test]
fn joints_move_skinned_meshes() {
    let mut file = square();
    let joints = file.accessor(UNSIGNED_BYTE, "VEC4", 4, &[0, 1, 0, 0].repeat(4));
    let weights = file.floats(&[[0.25, 0.75, 0.0, 0.0]; 4]);
    let at_rest = |z: f32| {
        let mut matrix = [0.0; 16];
        for i in [0, 5, 10, 15] {
            matrix[i] = 1.0;
        }
        matrix[14] = z;
        matrix
    };
    let to_joints = file.floats(&[at_rest(0.0), at_rest(-8.0)]);
    let first = file.node(json!({ "translation": [0, 4, 0] }));
    let second = file.push("nodes", json!({ "translation": [0, 0, 8] }));
    file.json["nodes"][first]["children"] = json!([second]);
    let attributes = &mut file.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_0"] = json!(joints);
    attributes["WEIGHTS_0"] = json!(weights);
    file.push(
        "skins",
        json!({ "joints": [first, second], "inverseBindMatrices": to_joints }),
    );
    file.json["nodes"][0]["skin"] = json!(0);
    file.json["nodes"][0]["translation"] = json!([100, 100, 100]);
    // At rest but for the first joint's step of 4, which moves the second too.
    assert_eq!(triangles(&file.scene()), moved([0.0, 4.0, 0.0]));
    // The second moves by 4 more: three quarters of that are seen.
    file.json["nodes"][second]["translation"] = json!([0, 0, 12]);
    assert_eq!(triangles(&file.scene()), moved([0.0, 4.0, 3.0]));
    // Weights need not sum to one.
    let halved = file.floats(&[[0.125, 0.375, 0.0, 0.0]; 4]);
    file.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(halved);
    assert_eq!(triangles(&file.scene()), moved([0.0, 4.0, 3.0]));
    // Joints that mirror.
    file.json["nodes"][first]["scale"] = json!([-1, 1, 1]);
    let scene = file.scene();
    assert!((area(&scene) - DVec3::Z).length() < 1e-6);
    assert!(
        scene.normals.iter().all(|n| (n[2] - 1.0).abs() < 1e-6),
        "{:?}",
        scene.normals
    );
    // Without matrices the joints are as they are at rest.
    file.json["nodes"][first]["scale"] = json!([1, 1, 1]);
    file.json["skins"][0]
        .as_object_mut()
        .expect("an object")
        .remove("inverseBindMatrices");
    assert_eq!(triangles(&file.scene()), moved([0.0, 4.0, 9.0]));
    // A primitive that names no joints is its node's.
    let attributes = &mut file.json["meshes"][0]["primitives"][0]["attributes"];
    attributes
        .as_object_mut()
        .expect("an object")
        .retain(|name, _| !name.ends_with("_0"));
    let loaded = file.read().expect("a square");
    assert_eq!(triangles(&near_origin(loaded.world)), moved([100.0; 3]));
    assert!(loaded.notes[0].contains("no joints"), "{:?}", loaded.notes);
}

/// Morph targets at the mesh's weights, or at the node's where it has its own.
#[test]
fn morph_targets_at_their_weights() {
    let mut file = square();
    let up = file.floats(&[[0.0, 0.0, 4.0]; 4]);
    let aside = file.floats(&[[2.0, 0.0, 0.0]; 4]);
    let turn = file.floats(&[[1.0, 0.0, -1.0]; 4]);
    file.json["meshes"][0]["primitives"][0]["targets"] =
        json!([{ "POSITION": up, "NORMAL": turn }, { "POSITION": aside }]);
    assert_eq!(triangles(&file.scene()), triangles(&square().scene()));
    file.json["meshes"][0]["weights"] = json!([0.5, 1.0]);
    let scene = file.scene();
    assert_eq!(triangles(&scene), moved([2.0, 0.0, 2.0]));
    let half = std::f32::consts::FRAC_1_SQRT_2;
    assert!(
        scene
            .normals
            .iter()
            .all(|n| (n[0] - half).abs() < 1e-6 && (n[2] - half).abs() < 1e-6)
    );
    file.json["nodes"][0]["weights"] = json!([1.0, -0.5]);
    assert_eq!(triangles(&file.scene()), moved([-1.0, 0.0, 4.0]));
    // Whole numbers too.
    file.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    let steps: Vec<u8> = [0_i16, 0, 4, 0]
        .repeat(4)
        .iter()
        .flat_map(|c| c.to_le_bytes())
        .collect();
    let whole = file.accessor(SHORT, "VEC3", 4, &steps);
    let view = file.json["accessors"][whole]["bufferView"]
        .as_u64()
        .expect("an index");
    file.json["bufferViews"][view as usize]["byteStride"] = json!(8);
    file.json["meshes"][0]["primitives"][0]["targets"][0]["POSITION"] = json!(whole);
    assert_eq!(triangles(&file.scene()), moved([-1.0, 0.0, 4.0]));
}

#[test]
fn instances_of_a_mesh() {
    let mut file = square();
    let places = file.floats(&[[0.0_f32, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 5.0, 0.0]]);
    let sizes = file.floats(&[[1.0_f32; 3], [2.0; 3], [-1.0, 1.0, 1.0]]);
    // About z, a half turn each, in normalised bytes.
    let turns = file.accessor(BYTE, "VEC4", 3, &[0, 0, 127, 0].repeat(3));
    file.json["accessors"][turns]["normalized"] = json!(true);
    file.json["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    file.json["nodes"][0]["scale"] = json!([10, 10, 10]);
    file.json["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": {
        "attributes": { "TRANSLATION": places, "SCALE": sizes, "ROTATION": turns },
    } });
    let scene = file.scene();
    assert_sound(&scene);
    assert_eq!(scene.triangle_count(), 6);
    assert!(
        (area(&scene) - DVec3::new(0.0, 0.0, 600.0)).length() < 1e-3,
        "{}",
        area(&scene)
    );
    // The second is two units wide, to the left of and below its place, times ten.
    let (low, high) = scene.positions[4..8]
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| {
            (low.min(Vec3::from(*p)), high.max(Vec3::from(*p)))
        });
    assert!((low - Vec3::new(10.0, -20.0, 0.0)).length() < 1e-4, "{low}");
    assert!((high - Vec3::new(30.0, 0.0, 0.0)).length() < 1e-4, "{high}");
    // All of one material are one draw.
    assert_eq!(scene.parts.len(), 1);
}

#[test]
fn lights_of_the_file() {
    let mut file = square();
    file.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    file.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "directional", "color": [1.0, 0.5, 0.25], "intensity": 4.0 },
        { "type": "point", "intensity": 3.0 },
        { "type": "spot", "spot": { "innerConeAngle": 0.25, "outerConeAngle": 0.5 } },
    ] } });
    let carry = |light: u32| json!({ "KHR_lights_punctual": { "light": light } });
    let half = std::f32::consts::FRAC_1_SQRT_2;
    // −z turned about x by a quarter is −y... of the other sign: it looks down.
    file.node(json!({ "extensions": carry(0), "rotation": [-half, 0.0, 0.0, half] }));
    file.node(json!({ "extensions": carry(1), "translation": [1, 2, 3] }));
    file.node(json!({ "extensions": carry(2), "translation": [0, 0, 9] }));
    let lights = file.read().expect("a square").lights;
    let [sun, bulb, lamp] = lights[..] else {
        panic!("{lights:?}");
    };
    assert!(
        matches!(sun, Light::Directional { direction, irradiance: [4.0, 2.0, 1.0] }
        if (direction - DVec3::NEG_Y).length() < 1e-6),
        "{sun:?}"
    );
    assert!(
        matches!(bulb, Light::Point { position, intensity: [3.0, 3.0, 3.0] }
        if position == DVec3::new(1.0, 2.0, 3.0)),
        "{bulb:?}"
    );
    assert!(
        matches!(lamp, Light::Spot { position, direction, inner: 0.25, outer: 0.5, .. }
        if position == DVec3::new(0.0, 0.0, 9.0) && direction == DVec3::NEG_Z),
        "{lamp:?}"
    );
}

#[test]
fn cameras_of_the_file() {
    let mut file = square();
    let lens = json!({ "yfov": 1.0, "znear": 0.125 });
    file.push(
        "cameras",
        json!({ "name": "front", "type": "perspective", "perspective": lens }),
    );
    let flat = json!({ "xmag": 1, "ymag": 1, "znear": 0, "zfar": 9 });
    file.push(
        "cameras",
        json!({ "name": "plan", "type": "orthographic", "orthographic": flat }),
    );
    file.node(json!({ "camera": 0, "translation": [0, 1, 8] }));
    file.node(json!({ "camera": 1 }));
    let loaded = file.read().expect("a square");
    let [camera] = &loaded.cameras[..] else {
        panic!("{:?}", loaded.cameras);
    };
    assert_eq!(camera.name, "front");
    assert_eq!(camera.eye, DVec3::new(0.0, 1.0, 8.0));
    assert_eq!(camera.target, DVec3::new(0.0, 1.0, 7.0));
    assert_eq!(camera.up, DVec3::Y);
    assert!((camera.vertical_fov_degrees - 57.295_779_5).abs() < 1e-6);
    assert_eq!(camera.near, 0.125);
    assert!(
        loaded.notes[0].contains("orthographic"),
        "{:?}",
        loaded.notes
    );
}

/// Of many squares in one place, each once.
#[test]
fn meshes_that_nodes_share() {
    let mut file = square();
    for x in 1..4 {
        file.node(json!({ "mesh": 0, "translation": [2 * x, 0, 0] }));
    }
    let scene = file.scene();
    assert_eq!(scene.triangle_count(), 8);
    assert_eq!(scene.positions.len(), 4 * CORNERS.len());
    let all = File::clone(&file).scene();
    assert_eq!(triangles(&all), triangles(&scene));
}

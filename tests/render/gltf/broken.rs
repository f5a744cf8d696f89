//! Broken files: one line each that says what is wrong.

use serde_json::{Value, json};

use super::files::{FLOAT, File, UNSIGNED_BYTE, UNSIGNED_SHORT, binary, read, square};

/// A name, what is done to a good file, and words of the error.
type Case = (&'static str, &'static dyn Fn(&mut File), &'static str);

fn primitive(file: &mut File) -> &mut Value {
    &mut file.json["meshes"][0]["primitives"][0]
}

/// Reading has an error of one line, with these words.
#[track_caller]
fn refused(name: &str, found: Result<support::gltf::Loaded, String>, words: &str) {
    let problem = found.err().unwrap_or_else(|| panic!("{name}: read"));
    assert!(problem.contains(words), "{name}: {problem}");
    assert!(
        !problem.contains('\n') && problem.chars().count() <= 401,
        "{name}: {problem}"
    );
}

#[test]
fn broken_accessors() {
    let cases: &[Case] = &[
        (
            "an index beyond",
            &|f| {
                let i = f.indices(&[0, 1, 2, 0, 2, 4]);
                primitive(f)["indices"] = json!(i);
            },
            "index 5 is 4, there are 4 vertices",
        ),
        (
            "a count beyond the view",
            &|f| f.json["accessors"][0]["count"] = json!(5),
            "accessor 0 of positions: 5 elements",
        ),
        (
            "an absurd count",
            &|f| f.json["accessors"][2]["count"] = json!(1_u64 << 40),
            "corners",
        ),
        (
            "an absurd count of bytes",
            &|f| f.json["accessors"][1]["count"] = json!(u64::MAX),
            "accessor 1",
        ),
        (
            "an absurd offset",
            &|f| f.json["accessors"][0]["byteOffset"] = json!(u64::MAX),
            "accessor 0",
        ),
        (
            "an absurd view",
            &|f| f.json["bufferViews"][0]["byteOffset"] = json!(u64::MAX),
            "buffer view 0",
        ),
        (
            "a view beyond its buffer",
            &|f| f.json["bufferViews"][0]["byteLength"] = json!(1000),
            "buffer view 0: 1000 bytes",
        ),
        (
            "a buffer beyond its file",
            &|f| f.json["buffers"] = json!([{ "byteLength": 4000 }]),
            "buffer 0: 4000 bytes",
        ),
        (
            "fewer normals",
            &|f| f.json["accessors"][1]["count"] = json!(3),
            "3 of NORMAL for 4 positions",
        ),
        (
            "more normals",
            &|f| {
                let n = f.floats(&[[0.0, 0.0, 1.0]; 5]);
                primitive(f)["attributes"]["NORMAL"] = json!(n);
            },
            "5 of NORMAL for 4 positions",
        ),
        (
            "a small stride",
            &|f| f.json["bufferViews"][0]["byteStride"] = json!(4),
            "a byte stride of 4 for elements of 12 bytes",
        ),
        (
            "an odd stride",
            &|f| f.json["bufferViews"][0]["byteStride"] = json!(13),
            "a byte stride of 13",
        ),
        (
            "no stride",
            &|f| f.json["bufferViews"][0]["byteStride"] = json!(0),
            "byteStride",
        ),
        (
            "float indices",
            &|f| {
                let i = f.floats(&[[0.0], [1.0], [2.0]]);
                primitive(f)["indices"] = json!(i);
            },
            "of indices: they cannot be F32 Scalar",
        ),
        (
            "signed indices",
            &|f| f.json["accessors"][2]["componentType"] = json!(5122),
            "of indices: they cannot be I16",
        ),
        (
            "normalised indices",
            &|f| f.json["accessors"][2]["normalized"] = json!(true),
            "normalized U16 Scalar",
        ),
        (
            "indices of VEC3",
            &|f| {
                f.json["accessors"][2]["type"] = json!("VEC3");
                f.json["accessors"][2]["count"] = json!(2);
            },
            "of indices: they cannot be U16 Vec3",
        ),
        (
            "positions of VEC2",
            &|f| f.json["accessors"][0]["type"] = json!("VEC2"),
            "of positions: they cannot be F32 Vec2",
        ),
        (
            "positions of whole numbers",
            &|f| f.json["accessors"][0]["componentType"] = json!(UNSIGNED_SHORT),
            "of positions: they cannot be U16",
        ),
        (
            "normals of VEC4",
            &|f| {
                let n = f.floats(&[[0.0; 4]; 4]);
                primitive(f)["attributes"]["NORMAL"] = json!(n);
            },
            "of normals: they cannot be F32 Vec4",
        ),
        (
            "an unknown type",
            &|f| f.json["accessors"][0]["componentType"] = json!(5130),
            "componentType",
        ),
        (
            "no accessor of positions",
            &|f| primitive(f)["attributes"]["POSITION"] = json!(77),
            "no accessor of its positions",
        ),
        (
            "no accessor of indices",
            &|f| primitive(f)["indices"] = json!(77),
            "out of bounds",
        ),
        (
            "no bytes",
            &|f| {
                f.json["accessors"][2]
                    .as_object_mut()
                    .expect("an object")
                    .remove("bufferView");
            },
            "bufferView",
        ),
        (
            "a position that is no number",
            &|f| {
                let p = f.floats(&[[0.0, f32::NAN, 0.0]; 4]);
                primitive(f)["attributes"]["POSITION"] = json!(p);
            },
            "element 0 is [0.0, NaN, 0.0]",
        ),
        (
            "an infinite position",
            &|f| {
                let p = f.floats(&[[0.0, 0.0, f32::INFINITY]; 4]);
                primitive(f)["attributes"]["POSITION"] = json!(p);
            },
            "accessor 3 of positions",
        ),
        (
            "no such image",
            &|f| {
                f.push(
                    "materials",
                    json!({ "emissiveTexture": { "index": 0 }, "emissiveFactor": [1, 1, 1] }),
                );
                let png = [0x89, b'P', b'N', b'G', 0x0d, 0x0a, 0x1a, 0x0a];
                let view = f.view(&png);
                f.push(
                    "images",
                    json!({ "bufferView": view, "mimeType": "image/png" }),
                );
                f.push("textures", json!({ "source": 5 }));
                primitive(f)["material"] = json!(0);
            },
            "textures[0].source",
        ),
    ];
    for (name, spoil, words) in cases {
        let mut file = square();
        spoil(&mut file);
        refused(name, file.read(), words);
    }
}

#[test]
fn broken_sparse_accessors() {
    let sparse = |places: &[u8], values: usize, count: usize| {
        let mut file = square();
        let places = file.view(places);
        let values = file.view(&vec![0; 12 * values]);
        file.json["accessors"][0]["sparse"] = json!({
            "count": count,
            "indices": { "bufferView": places, "componentType": UNSIGNED_BYTE },
            "values": { "bufferView": values },
        });
        file
    };
    refused(
        "an index beyond",
        sparse(&[1, 4], 2, 2).read(),
        "sparse index 4, there are 4",
    );
    refused(
        "out of order",
        sparse(&[2, 1], 2, 2).read(),
        "do not increase",
    );
    refused("twice", sparse(&[1, 1], 2, 2).read(), "do not increase");
    refused(
        "few indices",
        sparse(&[1], 2, 2).read(),
        "2 elements 1 bytes apart",
    );
    refused(
        "few values",
        sparse(&[1, 2], 1, 2).read(),
        "2 elements 12 bytes apart",
    );
    refused(
        "an absurd count",
        sparse(&[1, 2], 2, 1 << 50).read(),
        "accessor 0",
    );
    let mut zeros = sparse(&[1, 2], 2, 2);
    zeros.json["accessors"][0]
        .as_object_mut()
        .expect("an object")
        .remove("bufferView");
    zeros.json["accessors"][0]["count"] = json!(4_000_000_000_u32);
    refused("absurd zeros", zeros.read(), "zeros");
    primitive(&mut zeros)
        .as_object_mut()
        .expect("an object")
        .remove("indices");
    refused("absurd zeros without indices", zeros.read(), "corners");
}

#[test]
fn broken_nodes() {
    let cases: &[Case] = &[
        (
            "a node below itself",
            &|f| f.json["nodes"][0]["children"] = json!([0]),
            "node 0",
        ),
        (
            "a ring beside the scene",
            &|f| {
                let a = f.push("nodes", json!({ "children": [2] }));
                f.push("nodes", json!({ "children": [a] }));
            },
            "node 1 is below itself",
        ),
        (
            "two parents",
            &|f| {
                f.node(json!({ "children": [3] }));
                f.node(json!({ "children": [3] }));
                f.push("nodes", json!({}));
            },
            "node 3 has two parents, 1 and 2",
        ),
        (
            "a child twice",
            &|f| {
                f.node(json!({ "children": [2, 2] }));
                f.push("nodes", json!({}));
            },
            "node 2 has two parents",
        ),
        (
            "a scene's node with a parent",
            &|f| {
                f.node(json!({ "children": [0] }));
            },
            "node 0 of the scene is below node 1",
        ),
        (
            "a scene's node twice",
            &|f| f.json["scenes"][0]["nodes"] = json!([0, 0]),
            "in the scene twice",
        ),
        (
            "no such mesh",
            &|f| f.json["nodes"][0]["mesh"] = json!(9),
            "nodes[0].mesh",
        ),
        (
            "a place beyond f32",
            &|f| {
                f.json["nodes"][0]["scale"] = json!([1e38, 1.0, 1.0]);
                f.json["nodes"][0]["translation"] = json!([3.4e38, 0.0, 0.0]);
            },
            "beyond what f32 can say",
        ),
        (
            "no joint of that number",
            &|f| {
                let joints = f.accessor(UNSIGNED_BYTE, "VEC4", 4, &[9, 0, 0, 0].repeat(4));
                let weights = f.floats(&[[1.0, 0.0, 0.0, 0.0]; 4]);
                primitive(f)["attributes"]["JOINTS_0"] = json!(joints);
                primitive(f)["attributes"]["WEIGHTS_0"] = json!(weights);
                f.push("skins", json!({ "joints": [0] }));
                f.json["nodes"][0]["skin"] = json!(0);
            },
            "joint 9, the skin has 1",
        ),
        (
            "few matrices",
            &|f| {
                let joints = f.accessor(UNSIGNED_BYTE, "VEC4", 4, &[0; 16]);
                let weights = f.floats(&[[1.0, 0.0, 0.0, 0.0]; 4]);
                let matrices = f.accessor(FLOAT, "MAT4", 0, &[]);
                primitive(f)["attributes"]["JOINTS_0"] = json!(joints);
                primitive(f)["attributes"]["WEIGHTS_0"] = json!(weights);
                f.push(
                    "skins",
                    json!({ "joints": [0], "inverseBindMatrices": matrices }),
                );
                f.json["nodes"][0]["skin"] = json!(0);
            },
            "0 inverse bind matrices for 1 joints",
        ),
        (
            "weights of fewer targets",
            &|f| {
                primitive(f)["targets"] = json!([{ "POSITION": 0 }, { "POSITION": 0 }]);
                f.json["meshes"][0]["weights"] = json!([1.0]);
            },
            "morph target 1 has no weight",
        ),
        (
            "instances of two counts",
            &|f| {
                let (places, sizes) = (f.floats(&[[0.0; 3]; 2]), f.floats(&[[1.0; 3]; 3]));
                f.json["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": places, "SCALE": sizes } } });
            },
            "of 2 and of 3 instances",
        ),
        (
            "instances of no accessor",
            &|f| {
                f.json["nodes"][0]["extensions"] =
                    json!({ "EXT_mesh_gpu_instancing": { "attributes": { "SCALE": 99 } } });
            },
            "there is no accessor 99",
        ),
        (
            "a light of negative brightness",
            &|f| {
                f.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "point", "intensity": -1.0 }] } });
                f.node(json!({ "extensions": { "KHR_lights_punctual": { "light": 0 } } }));
            },
            "Light::intensity",
        ),
        (
            "no such light",
            &|f| {
                f.node(json!({ "extensions": { "KHR_lights_punctual": { "light": 0 } } }));
            },
            "out of bounds",
        ),
    ];
    for (name, spoil, words) in cases {
        let mut file = square();
        spoil(&mut file);
        refused(name, file.read(), words);
    }
    // A node that two parents share, again and again: as many paths as there are grains of sand.
    let mut file = square();
    for _ in 0..60 {
        let next = file.json["nodes"].as_array().expect("a list").len();
        file.push("nodes", json!({ "children": [next + 1, next + 1] }));
    }
    file.push("nodes", json!({}));
    refused("sixty deep", file.read(), "two parents");
}

#[test]
fn broken_containers() {
    let good = square().binary();
    let cut = |length: usize| read(&good[..length]);
    refused("nothing", read(&[]), "not a glTF file");
    refused("text", read(b"hello"), "not a glTF file");
    refused("an empty object", read(b"{}"), "not a glTF file");
    for length in [4, 8, 11] {
        refused("a part of a header", cut(length), "without a header");
    }
    for length in [12, 20, 100, good.len() - 1] {
        refused("truncated", cut(length), "truncated");
    }
    let with = |at: usize, word: u32| {
        let mut file = good.clone();
        file[at..at + 4].copy_from_slice(&word.to_le_bytes());
        read(&file)
    };
    refused("no length", with(8, 0), "of 0 bytes");
    refused("a length beyond", with(8, u32::MAX), "truncated");
    refused(
        "version 1",
        with(4, 1),
        "not a glTF file: unsupported version",
    );
    refused("a chunk beyond", with(12, u32::MAX), "not a glTF file");
    refused("not JSON first", with(16, 0), "not a glTF file");
    refused(
        "JSON that is none",
        read(&binary(b"{\"asset\": ", &[])),
        "not a glTF file",
    );
    let deep = [b"[".repeat(100_000), b"]".repeat(100_000)].concat();
    refused("deep JSON", read(&deep), "not a glTF file");
}

/// What cannot be read because of an extension says which.
#[test]
fn extensions_that_are_required() {
    for name in [
        "KHR_draco_mesh_compression",
        "EXT_meshopt_compression",
        "VENDOR_unheard_of",
        "two\nlines",
    ] {
        let mut file = square();
        file.json["extensionsUsed"] = json!([name]);
        file.scene();
        file.json["extensionsRequired"] = json!([name]);
        refused(name, file.read(), &name.replace('\n', " "));
    }
    let mut file = square();
    file.json["extensionsRequired"] =
        json!(["KHR_materials_emissive_strength", "KHR_texture_transform"]);
    file.scene();
    file.json["asset"]["version"] = json!("1.0");
    refused("version", file.read(), "version \"1.0\"");
    file.json["asset"] = json!({ "version": "2.1", "minVersion": "2.1" });
    refused("version", file.read(), "version \"2.1\"");
}

/// A file with nothing to draw says why.
#[test]
fn nothing_to_draw() {
    let cases: &[Case] = &[
        (
            "no nodes",
            &|f| f.json["scenes"][0]["nodes"] = json!([]),
            "no node is in the scene",
        ),
        (
            "no mesh",
            &|f| f.json["nodes"][0] = json!({}),
            "no node of the scene has a mesh",
        ),
        (
            "no indices",
            &|f| {
                let i = f.indices(&[]);
                primitive(f)["indices"] = json!(i);
            },
            "no triangles",
        ),
        (
            "lines of triangles",
            &|f| {
                let i = f.indices(&[0, 0, 1, 2, 2, 2]);
                primitive(f)["indices"] = json!(i);
            },
            "no triangles",
        ),
        ("points", &|f| primitive(f)["mode"] = json!(0), "of points"),
    ];
    for (name, spoil, words) in cases {
        let mut file = square();
        spoil(&mut file);
        refused(name, file.read(), "nothing to draw");
        refused(name, file.read(), words);
    }
}

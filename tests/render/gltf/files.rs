//! Small glTF files, made in code.

use std::path::Path;

use deep_screen_space::{
    glam::{DVec3, Vec3},
    scenes::Scene,
};
use serde_json::{Value, json};

use support::{
    gltf::{Loaded, read_gltf},
    world::World,
};

/// Corners of triangles that a test's file may have.
pub const ROOM: usize = 1 << 16;

pub const BYTE: u32 = 5120;
pub const UNSIGNED_BYTE: u32 = 5121;
pub const SHORT: u32 = 5122;
pub const UNSIGNED_SHORT: u32 = 5123;
pub const UNSIGNED_INT: u32 = 5125;
pub const FLOAT: u32 = 5126;

/// A file in the making: its JSON and its only buffer.
#[derive(Clone)]
pub struct File {
    pub json: Value,
    pub bytes: Vec<u8>,
}

impl File {
    pub fn new() -> Self {
        Self {
            json: json!({
                "asset": { "version": "2.0" },
                "scene": 0,
                "scenes": [{ "nodes": [] }],
                "nodes": [],
                "meshes": [],
                "accessors": [],
                "bufferViews": [],
            }),
            bytes: Vec::new(),
        }
    }

    /// Appends to one of the lists, which is made where there is none, and returns the index.
    pub fn push(&mut self, list: &str, value: Value) -> usize {
        let list = &mut self.json[list];
        if list.is_null() {
            *list = json!([]);
        }
        let list = list.as_array_mut().expect("a list");
        list.push(value);
        list.len() - 1
    }

    /// A buffer view of these bytes.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        while !self.bytes.len().is_multiple_of(4) {
            self.bytes.push(0);
        }
        let view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() });
        self.push("bufferViews", view)
    }

    pub fn accessor(&mut self, component: u32, kind: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let accessor =
            json!({ "bufferView": view, "componentType": component, "type": kind, "count": count });
        self.push("accessors", accessor)
    }

    pub fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values
            .as_flattened()
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"]
            .get(N - 1)
            .unwrap_or(&"MAT4");
        self.accessor(FLOAT, kind, values.len(), &bytes)
    }

    pub fn indices(&mut self, indices: &[u16]) -> usize {
        let bytes: Vec<u8> = indices.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(UNSIGNED_SHORT, "SCALAR", indices.len(), &bytes)
    }

    /// A node of the scene that shows a mesh of one primitive; returns the node.
    pub fn show(&mut self, primitive: &Value) -> usize {
        let mesh = self.push("meshes", json!({ "primitives": [primitive] }));
        self.node(json!({ "mesh": mesh }))
    }

    /// A node of the scene.
    pub fn node(&mut self, node: Value) -> usize {
        let index = self.push("nodes", node);
        self.json["scenes"][0]["nodes"]
            .as_array_mut()
            .expect("a list")
            .push(json!(index));
        index
    }

    /// As a binary file.
    pub fn binary(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        if json.get("buffers").is_none() {
            json["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        }
        binary(json.to_string().as_bytes(), &self.bytes)
    }

    pub fn read(&self) -> Result<Loaded, String> {
        read(&self.binary())
    }

    pub fn scene(&self) -> Scene {
        near_origin(self.read().expect("a good file").world)
    }
}

/// About the world's origin, or about its own middle where it lies far away.
pub fn near_origin(world: World) -> Scene {
    let (low, high) = world.bounds();
    let middle = (low + high) / 2.0;
    let is_far = middle.length() > 16.0 * (high - low).length();
    let origin = if is_far { middle.round() } else { DVec3::ZERO };
    world.relative_to(origin).expect("finite places")
}

pub fn read(bytes: &[u8]) -> Result<Loaded, String> {
    read_gltf(bytes, Path::new(env!("CARGO_TARGET_TMPDIR")), ROOM)
}

/// The container.
pub fn binary(json: &[u8], bytes: &[u8]) -> Vec<u8> {
    let pad = |bytes: &[u8], with: u8| {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let (json, bytes) = (pad(json, b' '), pad(bytes, 0));
    let word = |n: usize| (n as u32).to_le_bytes();
    let mut file = b"glTF".to_vec();
    file.extend(word(2));
    file.extend(word(12 + 8 + json.len() + 8 + bytes.len()));
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", bytes)] {
        file.extend(word(chunk.len()));
        file.extend(kind);
        file.extend(chunk);
    }
    file
}

/// A square of side 1 in the plane z = 0 that looks along +z: its corners, then those of its two triangles.
pub const CORNERS: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
];
pub const SQUARE: [u16; 6] = [0, 1, 2, 0, 2, 3];

/// A file of that square, with normals, in node 0: accessors 0 positions, 1 normals, 2 indices.
pub fn square() -> File {
    let mut file = File::new();
    let positions = file.floats(&CORNERS);
    let normals = file.floats(&[[0.0, 0.0, 1.0]; 4]);
    let indices = file.indices(&SQUARE);
    file.show(&json!({
        "attributes": { "POSITION": positions, "NORMAL": normals },
        "indices": indices,
    }));
    file
}

/// The corners of each triangle, of each the smallest first and in their order, sorted.
pub fn triangles(scene: &Scene) -> Vec<[[f32; 3]; 3]> {
    let smaller = |a: &[f32; 3], b: &[f32; 3]| a.partial_cmp(b).expect("numbers");
    let mut all: Vec<[[f32; 3]; 3]> = scene
        .indices
        .as_chunks()
        .0
        .iter()
        .map(|corners: &[u32; 3]| {
            let mut corners = corners.map(|i| scene.positions[i as usize]);
            let first = (0..3).min_by(|&i, &k| smaller(&corners[i], &corners[k]));
            corners.rotate_left(first.unwrap_or(0));
            corners
        })
        .collect();
    all.sort_by(|a, b| a.partial_cmp(b).expect("numbers"));
    all
}

/// Half the sum of the triangles' cross products.
pub fn area(scene: &Scene) -> DVec3 {
    let vector = |[a, b, c]: [[f32; 3]; 3]| {
        let [a, b, c] = [a, b, c].map(|p| DVec3::from(p.map(f64::from)));
        (b - a).cross(c - a) / 2.0
    };
    triangles(scene).into_iter().map(vector).sum()
}

/// What a scene always is, whatever the file.
#[track_caller]
pub fn assert_sound(scene: &Scene) {
    assert_eq!(scene.positions.len(), scene.normals.len());
    assert!(!scene.indices.is_empty() && scene.indices.len().is_multiple_of(3));
    assert!(
        scene
            .indices
            .iter()
            .all(|i| (*i as usize) < scene.positions.len())
    );
    assert!(scene.positions.as_flattened().iter().all(|c| c.is_finite()));
    let unit = |n: &[f32; 3]| (Vec3::from(*n).length() - 1.0).abs() < 1e-4;
    assert!(scene.normals.iter().all(unit));
    let mut next = 0;
    for part in &scene.parts {
        assert!(part.first_index == next && part.index_count > 0);
        assert!((part.material as usize) < scene.materials.len());
        next += part.index_count;
    }
    assert_eq!(next as usize, scene.indices.len());
    for material in &scene.materials {
        assert!(material.albedo.iter().all(|c| (0.0..=1.0).contains(c)));
        assert!(material.emission.iter().all(|c| (0.0..=1e18).contains(c)));
    }
}

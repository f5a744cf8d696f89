//! Small glTF files.

use std::path::PathBuf;

use serde_json::{Value, json};

/// Triangles, with the normals of their faces.
#[derive(Default)]
pub struct Triangles(pub Vec<[[f32; 3]; 3]>);

impl Triangles {
    /// A rectangle: a corner, and its sides. Seen from where the second side lies to the left of the first.
    pub fn rectangle(mut self, corner: [f32; 3], u: [f32; 3], v: [f32; 3]) -> Self {
        let at = |a: f32, b: f32| [0, 1, 2].map(|k| corner[k] + a * u[k] + b * v[k]);
        self.0.push([at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0)]);
        self.0.push([at(0.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)]);
        self
    }

    /// A box between two corners, its faces outward.
    pub fn block(self, low: [f32; 3], high: [f32; 3]) -> Self {
        let [x, y, z] = [0, 1, 2].map(|k| {
            let mut side = [0.0; 3];
            side[k] = high[k] - low[k];
            side
        });
        let minus = |side: [f32; 3]| side.map(|v| -v);
        self.rectangle(low, z, y)
            .rectangle(low, x, z)
            .rectangle(low, y, x)
            .rectangle(high, minus(y), minus(z))
            .rectangle(high, minus(z), minus(x))
            .rectangle(high, minus(x), minus(y))
    }

    /// A corner of a room, 4 across, that holds a box: from its middle it is seen from +x, +y and +z.
    pub fn corner() -> Self {
        Self::default()
            .rectangle([-2.0, 0.0, -2.0], [0.0, 0.0, 4.0], [4.0, 0.0, 0.0])
            .rectangle([-2.0, 0.0, -2.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0])
            .rectangle([-2.0, 0.0, -2.0], [0.0, 3.0, 0.0], [0.0, 0.0, 4.0])
            .block([-0.5, 0.0, -0.5], [0.5, 1.0, 0.5])
    }

    /// A cube about the origin, its faces inward.
    pub fn sky(half: f32) -> Self {
        let mut sky = Self::default().block([-half; 3], [half; 3]);
        for [_, b, c] in &mut sky.0 {
            std::mem::swap(b, c);
        }
        sky
    }
}

/// A binary file of meshes; `nodes` is the JSON of its nodes, the first of which is the scene's.
pub fn glb(name: &str, meshes: &[Triangles], nodes: &Value) -> PathBuf {
    let mut bytes = Vec::new();
    let (mut views, mut accessors, mut primitives) = (vec![], vec![], vec![]);
    for mesh in meshes {
        let positions: Vec<[f32; 3]> = mesh.0.as_flattened().to_vec();
        let normals: Vec<[f32; 3]> = mesh.0.iter().flat_map(|&t| [normal(t); 3]).collect();
        primitives.push(json!({ "primitives": [{ "attributes": {
            "POSITION": accessors.len(), "NORMAL": accessors.len() + 1,
        } }] }));
        let least = |least: f32, k: usize| positions.iter().fold(least, |m, p| m.min(p[k]));
        let most = |most: f32, k: usize| positions.iter().fold(most, |m, p| m.max(p[k]));
        for list in [&positions, &normals] {
            accessors.push(json!({
                "bufferView": views.len(), "componentType": 5126, "count": list.len(), "type": "VEC3",
                "min": ([0, 1, 2].map(|k| least(f32::MAX, k))), "max": ([0, 1, 2].map(|k| most(f32::MIN, k))),
            }));
            views.push(
                json!({ "buffer": 0, "byteOffset": bytes.len(), "byteLength": 12 * list.len() }),
            );
            bytes.extend(list.iter().flatten().flat_map(|v| v.to_le_bytes()));
        }
    }
    let mut text = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": nodes,
        "meshes": primitives, "accessors": accessors, "bufferViews": views,
        "buffers": [{ "byteLength": bytes.len() }],
    })
    .to_string()
    .into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = Vec::new();
    let total = 28 + text.len() + bytes.len();
    for word in [0x4654_6C67, 2, total as u32, text.len() as u32, 0x4E4F_534A] {
        file.extend(u32::to_le_bytes(word));
    }
    file.extend(text);
    for word in [bytes.len() as u32, 0x004E_4942] {
        file.extend(u32::to_le_bytes(word));
    }
    file.extend(bytes);
    let path = super::folder("files").join(name);
    std::fs::write(&path, file).expect("a file");
    path
}

fn normal([a, b, c]: [[f32; 3]; 3]) -> [f32; 3] {
    use deep_screen_space::glam::Vec3;
    let [a, b, c] = [a, b, c].map(Vec3::from);
    (b - a).cross(c - a).normalize().to_array()
}

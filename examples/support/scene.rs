//! Scenes for the examples: the crate's own, or any glTF 2.0 binary, and their buffers.

use std::path::Path;

use deep_screen_space::{
    IndexFormat, Indices, Mesh, PositionFormat, Vertices,
    glam::{Mat3, Mat4, Vec3},
    scenes::{Material, Part, Scene},
    wgpu::{self, BufferUsages},
};

use super::gpu::Gpu;

/// Reads every triangle of a glTF file's default scene, in world space. Textures are not read: a material's base colour
/// factor is its albedo.
pub fn load_gltf(path: &Path) -> Result<Scene, String> {
    let name = path.display();
    if !path.is_file() {
        return Err(format!("{name}: no such file"));
    }
    let gltf = gltf::Gltf::open(path).map_err(|e| format!("{name}: not a glTF file: {e}"))?;
    let blob = gltf.blob.as_deref();
    let external: Vec<Option<Vec<u8>>> = gltf
        .buffers()
        .map(|buffer| match buffer.source() {
            gltf::buffer::Source::Bin => Ok(None),
            gltf::buffer::Source::Uri(uri) => {
                let file = path.parent().unwrap_or(Path::new(".")).join(uri);
                std::fs::read(&file)
                    .map(Some)
                    .map_err(|e| format!("{name}: buffer {}: {e}", file.display()))
            }
        })
        .collect::<Result<_, _>>()?;
    let mut scene = Scene {
        name: "gltf",
        positions: Vec::new(),
        normals: Vec::new(),
        indices: Vec::new(),
        parts: Vec::new(),
        materials: gltf
            .materials()
            .map(|m| Material {
                albedo: first_three(m.pbr_metallic_roughness().base_color_factor()),
                emission: m.emissive_factor(),
                double_sided: m.double_sided(),
            })
            .chain([Material {
                albedo: [1.0; 3],
                emission: [0.0; 3],
                double_sided: false,
            }])
            .collect(),
        views: Vec::new(),
        ao_radius: f32::INFINITY,
    };
    let data = BufferData { external, blob };
    let mut open: Vec<(gltf::Node<'_>, Mat4)> = gltf
        .default_scene()
        .or_else(|| gltf.scenes().next())
        .map(|s| s.nodes().map(|n| (n, Mat4::IDENTITY)).collect())
        .unwrap_or_default();
    while let Some((node, parent)) = open.pop() {
        let world = parent * Mat4::from_cols_array_2d(&node.transform().matrix());
        open.extend(node.children().map(|child| (child, world)));
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            append(&mut scene, &primitive, world, &data);
        }
    }
    if scene.indices.is_empty() {
        return Err(format!("{name}: holds no triangles"));
    }
    Ok(scene)
}

fn first_three(v: [f32; 4]) -> [f32; 3] {
    [v[0], v[1], v[2]]
}

/// A file's buffers: those beside it, and the one inside it.
struct BufferData<'b> {
    external: Vec<Option<Vec<u8>>>,
    blob: Option<&'b [u8]>,
}

fn append(scene: &mut Scene, primitive: &gltf::Primitive<'_>, world: Mat4, data: &BufferData<'_>) {
    let reader = primitive.reader(|buffer| data.external[buffer.index()].as_deref().or(data.blob));
    let Some(positions) = reader.read_positions() else {
        return;
    };
    if primitive.mode() != gltf::mesh::Mode::Triangles {
        return;
    }
    let base = scene.positions.len();
    let positions: Vec<Vec3> = positions
        .map(|p| world.transform_point3(p.into()))
        .collect();
    let indices: Vec<usize> = match reader.read_indices() {
        Some(indices) => indices.into_u32().map(|i| i as usize).collect(),
        None => (0..positions.len()).collect(),
    };
    let to_normal = Mat3::from_mat4(world).inverse().transpose();
    let normals: Vec<Vec3> = match reader.read_normals() {
        Some(normals) => normals
            .map(|n| (to_normal * Vec3::from(n)).normalize_or_zero())
            .collect(),
        None => smooth_normals(&positions, &indices),
    };
    let first_index = scene.indices.len() as u32;
    let mirrored = world.determinant() < 0.0;
    for corner in indices.chunks_exact(3) {
        let [a, b, c] = [corner[0], corner[1], corner[2]].map(|i| (base + i) as u32);
        scene
            .indices
            .extend(if mirrored { [a, c, b] } else { [a, b, c] });
    }
    scene.positions.extend(positions.iter().map(Vec3::to_array));
    scene.normals.extend(normals.iter().map(Vec3::to_array));
    scene.parts.push(Part {
        first_index,
        index_count: scene.indices.len() as u32 - first_index,
        material: primitive
            .material()
            .index()
            .unwrap_or(scene.materials.len() - 1) as u32,
    });
}

fn smooth_normals(positions: &[Vec3], indices: &[usize]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for t in indices.chunks_exact(3) {
        let n = (positions[t[1]] - positions[t[0]]).cross(positions[t[2]] - positions[t[0]]);
        for &i in t {
            normals[i] += n;
        }
    }
    normals.into_iter().map(Vec3::normalize_or_zero).collect()
}

/// A scene's triangles on the GPU.
pub struct SceneBuffers {
    pub positions: wgpu::Buffer,
    pub normals: wgpu::Buffer,
    pub indices: wgpu::Buffer,
    pub index_count: u32,
    /// The material table.
    pub materials: wgpu::Buffer,
    pub parts: Vec<Part>,
    vertex_count: u32,
}

impl SceneBuffers {
    pub fn new(gpu: &Gpu, scene: &Scene) -> Self {
        let vertex = BufferUsages::VERTEX | BufferUsages::STORAGE;
        Self {
            positions: gpu.buffer(&scene.positions, vertex),
            normals: gpu.buffer(&scene.normals, BufferUsages::VERTEX),
            indices: gpu.buffer(&scene.indices, BufferUsages::INDEX | BufferUsages::STORAGE),
            index_count: scene.indices.len() as u32,
            materials: gpu.buffer(&scene.material_table(), BufferUsages::STORAGE),
            vertex_count: scene.positions.len() as u32,
            parts: scene.parts.clone(),
        }
    }

    pub fn triangles(&self) -> u32 {
        self.index_count / 3
    }

    /// The draws, a part each.
    pub fn meshes(&self) -> Vec<Mesh<'_>> {
        self.parts
            .iter()
            .map(|part| Mesh {
                vertices: Vertices {
                    buffer: &self.positions,
                    offset: 0,
                    stride: 12,
                    format: PositionFormat::Float32x3,
                    count: self.vertex_count,
                },
                indices: Some(Indices {
                    buffer: &self.indices,
                    offset: 0,
                    format: IndexFormat::Uint32,
                }),
                first: part.first_index,
                count: part.index_count,
                base_vertex: 0,
                instances: None,
                material: part.material,
            })
            .collect()
    }
}

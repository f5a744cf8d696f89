//! Scenes for the examples: the crate's own, or any glTF 2.0 binary, and their buffers.

use std::path::Path;

use deep_screen_space::{
    IndexFormat, Indices, Mesh, PositionFormat, Vertices,
    glam::{DMat3, DMat4, DQuat, DVec3},
    scenes::{Material, Part, Scene},
    wgpu::{self, BufferUsages},
};

use super::{gpu::Gpu, world::World};

/// Reads every triangle of a glTF file's default scene. Nodes' transforms are joined in f64. Textures are not read: a material's base colour
/// factor is its albedo.
pub fn load_gltf(path: &Path) -> Result<World, String> {
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
    let mut positions = Vec::new();
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
            })
            .chain([Material {
                albedo: [1.0; 3],
                emission: [0.0; 3],
            }])
            .collect(),
        views: Vec::new(),
        ao_radius: f32::INFINITY,
    };
    let data = BufferData { external, blob };
    let mut open: Vec<(gltf::Node<'_>, DMat4)> = gltf
        .default_scene()
        .or_else(|| gltf.scenes().next())
        .map(|s| s.nodes().map(|n| (n, DMat4::IDENTITY)).collect())
        .unwrap_or_default();
    while let Some((node, parent)) = open.pop() {
        let world = parent * local(&node.transform());
        open.extend(node.children().map(|child| (child, world)));
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            append(&mut scene, &mut positions, &primitive, world, &data);
        }
    }
    if scene.indices.is_empty() {
        return Err(format!("{name}: holds no triangles"));
    }
    Ok(World { scene, positions })
}

/// A node's transform in f64, as the specification has it.
fn local(transform: &gltf::scene::Transform) -> DMat4 {
    match transform {
        gltf::scene::Transform::Matrix { matrix } => {
            DMat4::from_cols_array_2d(&matrix.map(|column| column.map(f64::from)))
        }
        gltf::scene::Transform::Decomposed {
            translation,
            rotation,
            scale,
        } => DMat4::from_scale_rotation_translation(
            DVec3::from(scale.map(f64::from)),
            DQuat::from_array(rotation.map(f64::from)).normalize(),
            DVec3::from(translation.map(f64::from)),
        ),
    }
}

fn first_three(v: [f32; 4]) -> [f32; 3] {
    [v[0], v[1], v[2]]
}

/// A file's buffers: those beside it, and the one inside it.
struct BufferData<'b> {
    external: Vec<Option<Vec<u8>>>,
    blob: Option<&'b [u8]>,
}

fn append(
    scene: &mut Scene,
    placed: &mut Vec<DVec3>,
    primitive: &gltf::Primitive<'_>,
    world: DMat4,
    data: &BufferData<'_>,
) {
    let reader = primitive.reader(|buffer| data.external[buffer.index()].as_deref().or(data.blob));
    let Some(positions) = reader.read_positions() else {
        return;
    };
    if primitive.mode() != gltf::mesh::Mode::Triangles {
        return;
    }
    let base = placed.len();
    let positions: Vec<DVec3> = positions
        .map(|p| world.transform_point3(DVec3::from(p.map(f64::from))))
        .collect();
    let indices: Vec<usize> = match reader.read_indices() {
        Some(indices) => indices.into_u32().map(|i| i as usize).collect(),
        None => (0..positions.len()).collect(),
    };
    let to_normal = DMat3::from_mat4(world).inverse().transpose();
    let normals: Vec<DVec3> = match reader.read_normals() {
        Some(normals) => normals
            .map(|n| (to_normal * DVec3::from(n.map(f64::from))).normalize_or_zero())
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
    placed.extend(positions);
    scene
        .normals
        .extend(normals.iter().map(|n| n.as_vec3().to_array()));
    scene.parts.push(Part {
        first_index,
        index_count: scene.indices.len() as u32 - first_index,
        material: primitive
            .material()
            .index()
            .unwrap_or(scene.materials.len() - 1) as u32,
    });
}

fn smooth_normals(positions: &[DVec3], indices: &[usize]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; positions.len()];
    for t in indices.chunks_exact(3) {
        let n = (positions[t[1]] - positions[t[0]]).cross(positions[t[2]] - positions[t[0]]);
        for &i in t {
            normals[i] += n;
        }
    }
    normals.into_iter().map(DVec3::normalize_or_zero).collect()
}

/// A scene's triangles on the GPU.
pub struct SceneBuffers {
    pub runs: Vec<RunBuffers>,
    /// The material table.
    pub materials: wgpu::Buffer,
    triangles: u32,
}

/// As many of a scene's triangles as fit buffers that the device can make and bind.
pub struct RunBuffers {
    pub positions: wgpu::Buffer,
    pub normals: wgpu::Buffer,
    pub indices: wgpu::Buffer,
    pub index_count: u32,
    pub parts: Vec<Part>,
    vertex_count: u32,
}

impl SceneBuffers {
    pub fn new(gpu: &Gpu, scene: &Scene) -> Self {
        let limits = gpu.device.limits();
        let bytes = limits.max_buffer_size;
        let bytes = bytes.min(limits.max_storage_buffer_binding_size) as usize;
        Self::with_room(gpu, scene, bytes / 12, bytes / 4)
    }

    /// With at most so many vertices, and so many indices, in a buffer.
    pub fn with_room(gpu: &Gpu, scene: &Scene, vertices: usize, indices: usize) -> Self {
        let fits = scene.positions.len() <= vertices && scene.indices.len() <= indices;
        Self {
            runs: if fits {
                vec![RunBuffers::new(gpu, scene)]
            } else {
                runs(scene, vertices, indices)
                    .iter()
                    .map(|run| RunBuffers::new(gpu, run))
                    .collect()
            },
            materials: gpu.buffer(&scene.material_table(), BufferUsages::STORAGE),
            triangles: scene.triangle_count() as u32,
        }
    }

    pub fn triangles(&self) -> u32 {
        self.triangles
    }

    /// The draws, one a part of each run.
    pub fn meshes(&self) -> Vec<Mesh<'_>> {
        self.runs.iter().flat_map(RunBuffers::meshes).collect()
    }
}

impl RunBuffers {
    fn new(gpu: &Gpu, scene: &Scene) -> Self {
        let vertex = BufferUsages::VERTEX | BufferUsages::STORAGE;
        Self {
            positions: gpu.buffer(&scene.positions, vertex),
            normals: gpu.buffer(&scene.normals, BufferUsages::VERTEX),
            indices: gpu.buffer(&scene.indices, BufferUsages::INDEX | BufferUsages::STORAGE),
            index_count: scene.indices.len() as u32,
            vertex_count: scene.positions.len() as u32,
            parts: scene.parts.clone(),
        }
    }

    fn meshes(&self) -> impl Iterator<Item = Mesh<'_>> {
        self.parts.iter().map(|part| Mesh {
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
    }
}

/// Cuts a scene into runs of triangles, in order, of at most so many vertices and indices each. Materials are left out.
pub fn runs(scene: &Scene, vertices: usize, indices: usize) -> Vec<Scene> {
    let (vertices, indices) = (vertices.max(3), indices.max(3));
    let empty = || Scene {
        positions: Vec::new(),
        normals: Vec::new(),
        indices: Vec::new(),
        parts: Vec::new(),
        materials: Vec::new(),
        views: Vec::new(),
        ..*scene
    };
    let mut runs = vec![empty()];
    // A vertex's run, counted from 1, and its index in it.
    let mut moved = vec![(0, 0); scene.positions.len()];
    for part in &scene.parts {
        let range = part.first_index as usize..(part.first_index + part.index_count) as usize;
        let mut begun = 0;
        for corners in scene.indices[range].chunks_exact(3) {
            let run = &runs[runs.len() - 1];
            let new = corners
                .iter()
                .filter(|&&i| moved[i as usize].0 != runs.len());
            if run.indices.len() + 3 > indices || run.positions.len() + new.count() > vertices {
                runs.push(empty());
            }
            let number = runs.len();
            let run = &mut runs[number - 1];
            if begun != number {
                begun = number;
                run.parts.push(Part {
                    first_index: run.indices.len() as u32,
                    index_count: 0,
                    material: part.material,
                });
            }
            for &corner in corners {
                let corner = corner as usize;
                if moved[corner].0 != number {
                    moved[corner] = (number, run.positions.len() as u32);
                    run.positions.push(scene.positions[corner]);
                    run.normals.push(scene.normals[corner]);
                }
                run.indices.push(moved[corner].1);
            }
            if let Some(part) = run.parts.last_mut() {
                part.index_count += 3;
            }
        }
    }
    runs
}

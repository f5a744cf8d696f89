//! The buffers of a scene.

use deep_screen_space::{
    IndexFormat, Indices, Mesh, PositionFormat, Vertices,
    scenes::{Part, Scene},
    wgpu::{self, BufferUsages},
};

use super::gpu::Gpu;

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

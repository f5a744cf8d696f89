//! The buffers of a scene.

use deep_screen_space::{
    IndexFormat, Indices, Mesh, PositionFormat, Vertices,
    scenes::{Part, Scene},
    wgpu::{self, BufferUsages},
};

use super::gpu::Gpu;

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

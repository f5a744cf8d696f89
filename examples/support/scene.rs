//! The buffers of a scene.

use deep_screen_space::{
    AlphaChannel, AlphaTest, AlphaTests, IndexFormat, Indices, Mesh, PositionFormat,
    TexCoordFormat, TexCoords, Vertices,
    scenes::{HoleTest, Holes, Part, Scene},
    wgpu::{self, BufferUsages},
};

use super::gpu::Gpu;

/// A scene's triangles on the GPU; clones share them.
#[derive(Clone)]
pub struct SceneBuffers {
    pub runs: Vec<RunBuffers>,
    /// The material table.
    pub materials: wgpu::Buffer,
    /// The pictures of alpha-tested triangles and each material's test, if there are any.
    pub holes: Option<(wgpu::Texture, Vec<Option<HoleTest>>)>,
    triangles: u32,
}

/// As many of a scene's triangles as fit buffers that the device can make and bind.
#[derive(Clone)]
pub struct RunBuffers {
    pub positions: wgpu::Buffer,
    pub normals: wgpu::Buffer,
    pub indices: wgpu::Buffer,
    /// Where triangles are alpha-tested.
    pub tex_coords: Option<wgpu::Buffer>,
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
            holes: scene
                .holes
                .as_ref()
                .map(|holes| (maps(gpu, holes), holes.tests.clone())),
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

    /// The test of each draw.
    pub fn tests(&self) -> Vec<Option<AlphaTest<'_>>> {
        let all = self.runs.iter();
        all.flat_map(|run| run.parts.iter().map(|part| self.test_of(run, part)))
            .collect()
    }

    fn test_of<'a>(&'a self, run: &'a RunBuffers, part: &Part) -> Option<AlphaTest<'a>> {
        let (_, tests) = self.holes.as_ref()?;
        let test = tests.get(part.material as usize).copied().flatten()?;
        Some(AlphaTest {
            tex_coords: TexCoords {
                buffer: run.tex_coords.as_ref()?,
                offset: 0,
                stride: 8,
                format: TexCoordFormat::Float32x2,
            },
            layer: test.layer,
            threshold: test.threshold,
            wrap: test.wrap,
        })
    }

    /// What has holes, if anything has; `tests` are [`SceneBuffers::tests`].
    pub fn alpha_tests<'a>(&'a self, tests: &'a [Option<AlphaTest<'a>>]) -> Option<AlphaTests<'a>> {
        let (maps, _) = self.holes.as_ref()?;
        Some(AlphaTests {
            maps: maps.into(),
            channel: AlphaChannel::Red,
            meshes: tests,
        })
    }
}

/// A layer for each picture.
fn maps(gpu: &Gpu, holes: &Holes) -> wgpu::Texture {
    let [width, height] = holes.size;
    let size = wgpu::Extent3d {
        width,
        height,
        depth_or_array_layers: holes.maps.len() as u32,
    };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("alpha maps"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::R8Unorm,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(width),
        rows_per_image: Some(height),
    };
    gpu.queue
        .write_texture(texture.as_image_copy(), &holes.maps.concat(), layout, size);
    texture
}

impl RunBuffers {
    fn new(gpu: &Gpu, scene: &Scene) -> Self {
        // What moves is written anew.
        let vertex = BufferUsages::VERTEX | BufferUsages::STORAGE | BufferUsages::COPY_DST;
        Self {
            positions: gpu.buffer(&scene.positions, vertex),
            normals: gpu.buffer(&scene.normals, vertex),
            indices: gpu.buffer(&scene.indices, BufferUsages::INDEX | BufferUsages::STORAGE),
            tex_coords: scene
                .holes
                .as_ref()
                .map(|holes| gpu.buffer(&holes.tex_coords, vertex)),
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
        holes: scene.holes.as_ref().map(|holes| Holes {
            tex_coords: Vec::new(),
            maps: Vec::new(),
            tests: Vec::new(),
            ..*holes
        }),
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
                    if let (Some(to), Some(from)) = (&mut run.holes, &scene.holes) {
                        to.tex_coords.push(from.tex_coords[corner]);
                    }
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

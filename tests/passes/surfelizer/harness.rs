//! A device, triangles on it, and the cloud that comes back, in the terms of the mirror.

use std::sync::LazyLock;
use support::testing::pipelines;

use deep_screen_space::{
    Camera, CloudCapacity, Error, Geometry, Mesh, Piece, PositionFormat, Surfel, SurfelCloud,
    SurfelCounts, SurfelSource, Surfelizer, SurfelizerInput, SurfelizerSettings, Vertices,
    Viewport,
    glam::{DMat4, DVec3, Vec3},
    reference::surfelizer as mirror,
    scenes::Scene,
    wgpu::{self, BufferUsages},
};

use support::{gpu::Gpu, raster::perspective};

/// The device and the pipelines, made once for all tests.
pub struct Fixture {
    pub gpu: &'static Gpu,
    pub surfelizer: &'static Surfelizer,
}

static FIXTURE: LazyLock<Fixture> = LazyLock::new(|| Fixture {
    gpu: pipelines::gpu(),
    surfelizer: pipelines::surfelizer(),
});

pub fn fixture() -> &'static Fixture {
    &FIXTURE
}

/// What a recording is asked for beside its triangles.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    pub camera: &'a Camera,
    pub cull_by: &'a [Camera],
    pub settings: SurfelizerSettings,
    pub capacity: CloudCapacity,
}

impl<'a> Task<'a> {
    /// Without culling and with room for everything that these tests make.
    pub fn new(camera: &'a Camera, settings: SurfelizerSettings) -> Self {
        Self {
            camera,
            cull_by: &[],
            settings,
            capacity: CloudCapacity {
                surfels: 1 << 16,
                pieces: 1 << 13,
                triangles: 1 << 13,
            },
        }
    }
}

impl Fixture {
    pub fn try_record(&self, meshes: &[Mesh<'_>], task: &Task<'_>) -> Result<SurfelCloud, Error> {
        let device = &self.gpu.device;
        let mut cloud = self.surfelizer.create_cloud(device, task.capacity)?;
        let mut encoder = self.gpu.encoder();
        self.surfelizer.record(
            device,
            &mut encoder,
            &SurfelizerInput {
                geometry: Geometry { meshes },
                camera: task.camera,
                cull_by: task.cull_by,
                timestamps: None,
            },
            &task.settings,
            &mut cloud,
        )?;
        self.gpu.finish(encoder);
        Ok(cloud)
    }

    pub fn record(&self, meshes: &[Mesh<'_>], task: &Task<'_>) -> mirror::Cloud {
        let cloud = self
            .try_record(meshes, task)
            .unwrap_or_else(|e| panic!("{e}; {task:?}"));
        assert_eq!(cloud.origin(), task.camera.focus());
        self.read(&cloud)
    }

    pub fn counts(&self, cloud: &SurfelCloud) -> SurfelCounts {
        self.gpu.read_buffer(cloud.counters())[0]
    }

    /// What a cloud holds, in the mirror's f64.
    pub fn read(&self, cloud: &SurfelCloud) -> mirror::Cloud {
        let counts = self.counts(cloud);
        let [surfels, pieces] = [cloud.capacity().surfels, cloud.capacity().pieces];
        assert!(counts.stored <= surfels, "{counts:?} in {surfels}");
        let point = |p: [f32; 3]| Vec3::from(p).as_dvec3();
        let found: Vec<Surfel> = self.read_part(cloud.surfels(), counts.stored);
        let sources: Vec<SurfelSource> = self.read_part(cloud.sources(), counts.stored);
        mirror::Cloud {
            pieces: self
                .read_part::<Piece>(cloud.pieces(), counts.pieces.min(pieces))
                .iter()
                .map(|p| mirror::Piece {
                    corners: mirror::Triangle {
                        a: point(p.a),
                        b: point(p.b),
                        c: point(p.c),
                    },
                    material: p.material,
                    shape: p.shape,
                    triangle: p.triangle,
                })
                .collect(),
            surfels: found
                .iter()
                .zip(&sources)
                .map(|(surfel, source)| mirror::Surfel {
                    position: point(surfel.position),
                    radius: f64::from(surfel.radius),
                    normal: source.normal,
                    piece: source.piece,
                    leaf: source.leaf,
                    material: source.material,
                })
                .collect(),
            counts,
        }
    }

    /// The first items of a buffer.
    fn read_part<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer, count: u32) -> Vec<T> {
        let bytes = u64::from(count) * size_of::<T>() as u64;
        if bytes == 0 {
            return Vec::new();
        }
        let part = self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes,
            usage: BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.gpu.encoder();
        encoder.copy_buffer_to_buffer(buffer, 0, &part, 0, bytes);
        self.gpu.finish(encoder);
        self.gpu.read_buffer(&part)
    }

    /// Triangles on the device, without indices.
    pub fn upload(&self, soup: &Soup) -> Uploaded {
        Uploaded {
            buffer: self.gpu.buffer(&soup.0, BufferUsages::STORAGE),
            vertices: 3 * soup.0.len() as u32,
        }
    }

    pub fn record_soup(&self, soup: &Soup, task: &Task<'_>) -> mirror::Cloud {
        self.record(&[self.upload(soup).mesh()], task)
    }
}

/// World-space triangles as a vertex buffer holds them.
#[derive(Clone, Debug, Default)]
pub struct Soup(pub Vec<[[f32; 3]; 3]>);

impl Soup {
    pub fn of(triangles: &[[DVec3; 3]]) -> Self {
        Self(
            triangles
                .iter()
                .map(|t| t.map(|p| p.as_vec3().to_array()))
                .collect(),
        )
    }

    pub fn of_scene(scene: &Scene) -> Self {
        Self(
            scene
                .indices
                .chunks_exact(3)
                .map(|t| [0, 1, 2].map(|k| scene.positions[t[k] as usize]))
                .collect(),
        )
    }

    pub fn triangles(&self) -> Vec<[DVec3; 3]> {
        self.0
            .iter()
            .map(|t| t.map(|p| Vec3::from(p).as_dvec3()))
            .collect()
    }

    pub fn area(&self) -> f64 {
        self.triangles().iter().map(|&t| area(t)).sum()
    }

    /// What the mirror makes of it.
    pub fn mirrored(&self, task: &Task<'_>) -> mirror::Cloud {
        mirror::surfelize(
            &task.settings,
            task.camera,
            task.cull_by,
            task.capacity,
            &self.triangles(),
            &vec![0; self.0.len()],
        )
    }
}

/// A [`Soup`] on the device.
pub struct Uploaded {
    pub buffer: wgpu::Buffer,
    pub vertices: u32,
}

impl Uploaded {
    pub fn mesh(&self) -> Mesh<'_> {
        plain_mesh(&self.buffer, self.vertices)
    }
}

/// Three f32 a vertex, in order.
pub fn plain_mesh(buffer: &wgpu::Buffer, vertices: u32) -> Mesh<'_> {
    Mesh {
        vertices: Vertices {
            buffer,
            offset: 0,
            stride: 12,
            format: PositionFormat::Float32x3,
            count: vertices,
        },
        indices: None,
        first: 0,
        count: vertices,
        base_vertex: 0,
        instances: None,
        material: 0,
    }
}

pub fn area([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

/// The area of all disks.
pub fn disk_area(cloud: &mirror::Cloud) -> f64 {
    cloud
        .surfels
        .iter()
        .map(|s| std::f64::consts::PI * s.radius * s.radius)
        .sum()
}

pub fn corners(piece: &mirror::Piece) -> [DVec3; 3] {
    [piece.corners.a, piece.corners.b, piece.corners.c]
}

pub const SIDE: u32 = 96;

/// A scene's own view.
pub fn scene_camera(scene: &Scene, view: usize) -> Camera {
    let view = &scene.views[view];
    look_at(
        view.eye.into(),
        view.target.into(),
        perspective(view.vertical_fov_degrees, 1.0, view.near),
    )
}

/// A square image.
pub fn look_at(eye: DVec3, target: DVec3, projection: DMat4) -> Camera {
    let up = if (target - eye).cross(DVec3::Y).length() > 1e-6 * (target - eye).length() {
        DVec3::Y
    } else {
        DVec3::Z
    };
    Camera::look_at(eye, target, up, projection, Viewport::full(SIDE, SIDE))
        .expect("a plain camera")
}

/// Straight down on the xz plane with an orthographic camera that sees `half` to each side: a pixel is
/// 2 · `half` / [`SIDE`] everywhere.
pub fn from_above(half: f64) -> Camera {
    let projection = DMat4::from_scale(DVec3::new(1.0 / half, 1.0 / half, -0.1 / half));
    look_at(DVec3::Y * half, DVec3::ZERO, projection)
}

/// Latitude and longitude triangles, facing outward.
pub fn sphere(centre: DVec3, radius: f64, rings: u32) -> Vec<[DVec3; 3]> {
    let at = |side: u32, ring: u32| {
        let (sin, cos) = (std::f64::consts::PI * f64::from(ring) / f64::from(rings)).sin_cos();
        let turn = std::f64::consts::PI * f64::from(side) / f64::from(rings);
        centre + radius * DVec3::new(turn.cos() * sin, cos, turn.sin() * sin)
    };
    let mut triangles = Vec::new();
    for ring in 0..rings {
        for side in 0..2 * rings {
            let [a, b] = [at(side, ring), at(side + 1, ring)];
            let [c, d] = [at(side + 1, ring + 1), at(side, ring + 1)];
            if ring > 0 {
                triangles.push([a, b, c]);
            }
            if ring + 1 < rings {
                triangles.push([a, c, d]);
            }
        }
    }
    triangles
}

//! Surfels of random triangles, lit by random lights: what the splatter, the rays and the hull start from.

use std::rc::Rc;

use deep_screen_space::{
    Bvh, BvhBuilder, Camera, CloudCapacity, Geometry, IndexFormat, Indices, Instances, Mesh,
    Placement, PositionFormat, Primitives, Reach, ShadedLight, Shadow, ShadowMap, SurfelCloud,
    SurfelGatherer, SurfelGathererInput, SurfelGathererSettings, SurfelSenders, SurfelShader,
    SurfelShaderInput, SurfelShaderSettings, Surfelizer, SurfelizerInput, SurfelizerSettings,
    TransformFormat, Vertices,
    wgpu::{Buffer, BufferUsages},
};

use super::{
    case::{Case, Kind},
    inputs::{self, Part},
};

/// The buffers of a mesh.
pub struct Buffers {
    pub vertices: Buffer,
    indices: Buffer,
    instances: Buffer,
}

pub fn buffers(case: &mut Case<'_>, camera: &Camera) -> Buffers {
    let eye = camera.eye().as_vec3().to_array();
    let extent = case.random.one_of(&[1e-3, 1.0, 10.0, 1e4]);
    let points: Vec<f32> = (0..40 * 3)
        .map(|_| case.random.between(-extent, extent) as f32)
        .collect();
    let vertices = inputs::table(case, "vertices", points.len(), |i| points[i] + eye[i % 3]);
    let words: Vec<u32> = (0..64)
        .map(|_| match case.random.below(20) {
            0 => case.random.bits() as u32,
            _ => case.random.below(40) | case.random.below(40) << 16,
        })
        .collect();
    let indices = case.world.gpu.buffer(&words, BufferUsages::STORAGE);
    let instances = inputs::table(case, "instances", 16 * 4, |i| match i % 16 {
        0 | 5 | 10 | 15 => 1.0 + (i / 16) as f32 * 0.5,
        _ => 0.0,
    });
    Buffers {
        vertices,
        indices,
        instances,
    }
}

pub fn mesh<'a>(case: &mut Case<'_>, buffers: &'a Buffers) -> Mesh<'a> {
    let random = &mut case.random;
    let format = random.one_of(&[
        PositionFormat::Float32x3,
        PositionFormat::Float32x3,
        PositionFormat::Float16x4,
    ]);
    let (offset, stride) = random.one_of(&[(0, 12), (0, 16), (12, 12), (4, 24)]);
    let fit = (120 * 4 - offset - 12) / stride + 1;
    let index_format = random.one_of(&[IndexFormat::Uint16, IndexFormat::Uint32]);
    let has_indices = random.chance(0.6);
    let has_instances = random.chance(0.3);
    let mesh = Mesh {
        vertices: Vertices {
            buffer: &buffers.vertices,
            offset: offset.into(),
            stride,
            format,
            count: random.count(0, fit),
        },
        indices: has_indices.then(|| Indices {
            buffer: &buffers.indices,
            offset: random.one_of(&[0, 4, 8]),
            format: index_format,
        }),
        first: random.count(0, 8),
        count: random.count(0, 48),
        base_vertex: random.one_of(&[0, 0, 1, -3, i32::MAX, i32::MIN]),
        instances: has_instances.then(|| Instances {
            buffer: &buffers.instances,
            offset: random.one_of(&[0, 16]),
            stride: 64,
            format: TransformFormat::Rows3x4,
            count: random.count(0, 3),
        }),
        material: random.one_of(&[0, 1, 7, u32::MAX]),
    };
    let indices = mesh.indices.map(|i| (i.offset, i.format));
    let instances = mesh.instances.map(|i| (i.offset, i.count));
    let vertices = (offset, stride, format, mesh.vertices.count);
    case.note(
        "mesh: vertices, indices, instances",
        (vertices, indices, instances),
    );
    case.note(
        "  draw",
        (mesh.first, mesh.count, mesh.base_vertex, mesh.material),
    );
    mesh
}

/// A recorded cloud.
pub struct Surfels {
    pub cloud: SurfelCloud,
}

/// A cloud of random meshes for a camera.
pub fn record(case: &mut Case<'_>, camera: &Camera, placement: &[Placement]) -> Option<Surfels> {
    let surfelizer = case.once("", |device| Surfelizer::new(device))?;
    let few = [0, 1, 2, 3, 64, 65, 1000];
    let random = &mut case.random;
    let mut capacity = CloudCapacity {
        surfels: random.one_of(&few),
        pieces: random.one_of(&few[1..]),
        triangles: 400,
    };
    if random.chance(0.7) {
        capacity.surfels = 4096;
        capacity.pieces = 2048;
    }
    if random.breaks() {
        capacity = random.one_of(&[
            CloudCapacity {
                triangles: 0,
                ..capacity
            },
            CloudCapacity {
                pieces: 0,
                ..capacity
            },
            CloudCapacity {
                pieces: u32::MAX,
                ..capacity
            },
            CloudCapacity {
                surfels: u32::MAX,
                ..capacity
            },
            CloudCapacity {
                triangles: u32::MAX,
                ..capacity
            },
        ]);
    }
    case.note("capacity", capacity);
    let cloud = surfelizer.create_cloud(case.device(), capacity);
    let mut cloud = case.accept(cloud)?;
    let settings = SurfelizerSettings {
        radius_pixels: case.random.scale(0.05, 1000.0),
        placement: case.random.one_of(placement),
        density: case.random.scale(0.01, f32::INFINITY),
        reach: Reach {
            radii: case.random.scale(0.0, f32::INFINITY),
            world: case.random.scale(0.0, f32::INFINITY),
        },
    };
    case.note("surfelizer", settings);
    let buffers: Vec<_> = (0..2).map(|_| buffers(case, camera)).collect();
    let count = case.random.below(4);
    let meshes: Vec<_> = (0..count)
        .map(|i| mesh(case, &buffers[i as usize % 2]))
        .collect();
    let cull_by: Vec<_> = (0..case.random.count(0, 4).min(9))
        .map(|_| *camera)
        .collect();
    let input = SurfelizerInput {
        geometry: Geometry { meshes: &meshes },
        camera,
        cull_by: &cull_by,
        timestamps: case.timestamps(),
    };
    let done = surfelizer.record(
        case.device(),
        &mut case.encoder,
        &input,
        &settings,
        &mut cloud,
    );
    case.accept(done)?;
    case.buffer("surfels", cloud.surfels(), Kind::Floats);
    case.buffer("sources", cloud.sources(), Kind::Bits);
    case.buffer("pieces", cloud.pieces(), Kind::Bits);
    case.buffer("counters", cloud.counters(), Kind::Bits);
    Some(Surfels { cloud })
}

/// What a cloud's surfels send: from the shader, or a caller's own numbers.
pub fn radiance(
    case: &mut Case<'_>,
    cloud: &SurfelCloud,
    camera: &Camera,
    bounds: Option<&Bvh>,
) -> Option<Buffer> {
    if case.random.chance(0.2) {
        let numbers = 8 * cloud.capacity().surfels.max(1) as usize;
        return Some(inputs::table(case, "radiance", numbers, |i| (i % 7) as f32));
    }
    let shader: Rc<SurfelShader> = case.once("", |device| SurfelShader::new(device))?;
    let radiance = shader.create_radiance(case.device(), cloud);
    let radiance = case.accept(radiance)?;
    let materials = inputs::materials(case);
    let count = case.random.below(4);
    let lights: Vec<_> = (0..count)
        .map(|_| inputs::light(case, camera.eye()))
        .collect();
    let maps: Vec<Option<Map>> = lights
        .iter()
        .map(|_| case.random.chance(0.4).then(|| Map::new(case)))
        .collect();
    let lights: Vec<_> = lights
        .into_iter()
        .zip(&maps)
        .map(|(light, map)| ShadedLight {
            light,
            shadow: match (map, bounds) {
                (Some(map), _) => Shadow::Map(map.map()),
                (None, Some(bounds)) => Shadow::Traced(bounds),
                (None, None) => Shadow::None,
            },
        })
        .collect();
    let settings = SurfelShaderSettings {
        samples: if case.random.breaks() {
            case.random.bits() as u32
        } else {
            case.random.one_of(&[1, 2, 4, 8, 16])
        },
    };
    case.note("surfel shader", settings);
    let input = SurfelShaderInput {
        cloud,
        materials: &materials,
        lights: &lights,
        radiance: &radiance,
        timestamps: case.timestamps(),
    };
    let done = shader.record(case.device(), &mut case.encoder, &input, &settings);
    case.accept(done)?;
    case.buffer("radiance", &radiance, Kind::Floats);
    Some(radiance)
}

/// What surfels reflect of what they gather from each other.
pub fn gathered(
    case: &mut Case<'_>,
    cloud: &SurfelCloud,
    camera: &Camera,
    bvh: &Bvh,
) -> Option<Buffer> {
    let sent = radiance(case, cloud, camera, Some(bvh))?;
    let gatherer: Rc<SurfelGatherer> = case.once("", |device| SurfelGatherer::new(device))?;
    let gathered = gatherer.create_radiance(case.device(), cloud);
    let gathered = case.accept(gathered)?;
    let materials = inputs::materials(case);
    let settings = SurfelGathererSettings {
        rays_per_surfel: case.random.count(1, 64),
        emitter_samples: 0,
        backs: case.random.chance(0.5),
        most_albedo: case.random.scale(0.0, 1.0),
        sky_radiance: std::array::from_fn(|_| case.random.scale(0.0, 1e18)),
        frame: case.random.count(0, 1 << 20),
    };
    case.note("surfel gatherer", settings);
    let senders = SurfelSenders {
        cloud,
        bvh,
        radiance: &sent,
    };
    let input = SurfelGathererInput {
        timestamps: case.timestamps(),
        ..SurfelGathererInput::new(senders, &materials, &gathered)
    };
    let done = gatherer.record(case.device(), &mut case.encoder, &input, &settings);
    case.accept(done)?;
    case.buffer("gathered", &gathered, Kind::Floats);
    Some(gathered)
}

/// A shadow map of one layer.
pub struct Map {
    depth: Part,
    cameras: Vec<Camera>,
    bias: f32,
}

impl Map {
    pub fn new(case: &mut Case<'_>) -> Self {
        let viewport = inputs::size(case);
        let camera = inputs::camera_of(case, viewport);
        let seed = case.random.bits();
        let depth = inputs::depth(case, "shadow map", &camera, seed);
        // All look at the one layer that there is, or at the layers of an array from the first on.
        let layers = depth.texture.depth_or_array_layers();
        let first = depth.slice().layer;
        let most = layers.saturating_sub(first).clamp(1, 6);
        let count = case.random.count(1, most).min(9);
        let cameras = (0..count)
            .map(|i| {
                if i == 0 {
                    camera
                } else {
                    inputs::camera_of(case, viewport)
                }
            })
            .collect();
        Self {
            depth,
            cameras,
            bias: case.random.setting(0.0, 100.0),
        }
    }

    pub fn map(&self) -> ShadowMap<'_> {
        ShadowMap {
            bias: self.bias,
            ..ShadowMap::new(self.depth.slice(), &self.cameras)
        }
    }
}

/// The hierarchy over a cloud.
pub fn bvh(case: &mut Case<'_>, primitives: Primitives, cloud: &SurfelCloud) -> Option<Bvh> {
    let key = format!("{primitives:?}");
    let builder = case.once(key, |device| BvhBuilder::new(device, primitives))?;
    let bvh = builder.create(case.device(), cloud);
    let bvh = case.accept(bvh)?;
    let timestamps = case.timestamps();
    let done = builder.record(case.device(), &mut case.encoder, cloud, &bvh, timestamps);
    case.accept(done)?;
    Some(bvh)
}

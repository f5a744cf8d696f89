//! One level beside two: forests of one tree, from ten thousand to ten million triangles.
//!
//! `cargo bench --bench rays -- --instances [--quick]`. Each forest is one mesh, turned and scaled anew for each tree, on a
//! ground whose pixels send the rays. Rows by structure: memory of all that it needs (of one level the cloud too),
//! milliseconds of building all and of building what other transforms ask for, and for any hit and the nearest milliseconds
//! and, per ray, nodes, triangles, bytes and steps of the slowest of 32. A structure that the device's limits do not hold is
//! refused, with why.

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedScene, BouncedSettings, BouncedZBuffer, BvhBuilder,
    Camera, ChangedMeshes, CloudCapacity, Error, Frame, Geometry, HitLighting, HitRadiance,
    InstancedBvhBuilder, InstancedBvhInput, Instances, Mesh, Payload, PositionFormat, Primitives,
    Surfelizer, SurfelizerInput, SurfelizerSettings, TransformFormat, Vertices, Viewport,
    glam::{DVec3, Mat4, Quat, Vec3},
    reference::hashing::{hash2, unit_float},
    scenes::{self, Part, Scene},
    wgpu::{self, BufferUsages},
};
use serde_json::{Value, json};
use support::{
    decoding::Decoding,
    gpu::Gpu,
    raster::{Raster, perspective},
    scene::SceneBuffers,
};

use super::{RAYS_PER_PIXEL, RUNS, count};

/// Triangles of a tree.
const LEAVES: usize = 1000;

/// How rays' structures are built.
#[derive(Clone, Copy)]
enum Structure {
    OneLevel,
    TwoLevels,
}

struct Forest {
    vertices: wgpu::Buffer,
    transforms: [wgpu::Buffer; 2],
    trees: u32,
    ground: SceneBuffers,
    raster: Raster,
    camera: Camera,
}

fn random(i: usize, salt: u32) -> f32 {
    unit_float(hash2(i as u32, salt)) as f32
}

/// Leaves at random in a cone.
fn tree() -> Vec<[f32; 3]> {
    let mut corners = Vec::with_capacity(3 * LEAVES);
    for i in 0..LEAVES {
        let height = 1.0 - random(i, 1).sqrt();
        let angle = random(i, 2) * std::f32::consts::TAU;
        let radius = 0.3 * (1.0 - height) * random(i, 3).sqrt();
        let at = Vec3::new(radius * angle.cos(), 0.2 + height, radius * angle.sin());
        for k in 0..3_u32 {
            let draw = |axis| random(i, 10 + 3 * k + axis) - 0.5;
            let corner = at + 0.08 * Vec3::new(draw(0), draw(1), draw(2));
            corners.push(corner.to_array());
        }
    }
    corners
}

/// Trees in a square, as dense however many.
fn transforms(trees: u32, salt: u32) -> Vec<[f32; 16]> {
    let side = side_of(trees);
    (0..trees as usize)
        .map(|i| {
            let draw = |n| random(i, salt + n);
            let place = Vec3::new(draw(0) - 0.5, 0.0, draw(1) - 0.5) * side;
            let turn = Quat::from_rotation_y(draw(2) * std::f32::consts::TAU);
            let size = Vec3::splat(0.6 + 0.8 * draw(3));
            Mat4::from_scale_rotation_translation(size, turn, place).to_cols_array()
        })
        .collect()
}

fn side_of(trees: u32) -> f32 {
    0.5 * (trees as f32).sqrt()
}

impl Forest {
    fn new(gpu: &Gpu, trees: u32, [width, height]: [u32; 2]) -> Self {
        let half = 0.5 * side_of(trees);
        let corner = |x: f32, z: f32| [x * half, 0.0, z * half];
        let positions = vec![
            corner(-1.0, -1.0),
            corner(-1.0, 1.0),
            corner(1.0, 1.0),
            corner(1.0, -1.0),
        ];
        let scene = Scene {
            normals: vec![[0.0, 1.0, 0.0]; 4],
            positions,
            indices: vec![0, 1, 2, 0, 2, 3],
            parts: vec![Part {
                first_index: 0,
                index_count: 6,
                material: 0,
            }],
            ..scenes::cornell()
        };
        let far = f64::from(half);
        let camera = Camera::look_at(
            DVec3::new(0.3, 1.6, 2.4) * far,
            DVec3::ZERO,
            DVec3::Y,
            perspective(40.0, f64::from(width) / f64::from(height), 0.01 * far),
            Viewport::full(width, height),
        )
        .expect("a camera");
        let ground = SceneBuffers::new(gpu, &scene);
        let raster = Raster::draw(gpu, &ground, &camera);
        let usage = BufferUsages::STORAGE;
        Self {
            vertices: gpu.buffer(&tree(), usage),
            transforms: [7, 70].map(|salt| gpu.buffer(&transforms(trees, salt), usage)),
            trees,
            ground,
            raster,
            camera,
        }
    }

    /// Its meshes: the ground, and the tree where one of the sets of transforms says.
    fn meshes(&self, set: usize) -> Vec<Mesh<'_>> {
        let mut meshes = self.ground.meshes();
        meshes.push(Mesh {
            vertices: Vertices {
                buffer: &self.vertices,
                offset: 0,
                stride: 12,
                format: PositionFormat::Float32x3,
                count: 3 * LEAVES as u32,
            },
            indices: None,
            first: 0,
            count: 3 * LEAVES as u32,
            base_vertex: 0,
            instances: Some(Instances {
                buffer: &self.transforms[set],
                offset: 0,
                stride: 64,
                format: TransformFormat::Mat4,
                count: self.trees,
            }),
            material: 0,
        });
        meshes
    }

    /// Statistics of rays for a payload, and the fastest of a few runs' milliseconds.
    fn trace(
        &self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        scene: BouncedScene<'_>,
        payload: Payload,
    ) -> (Vec<u32>, f64) {
        let device = &gpu.device;
        let primitives = match scene {
            BouncedScene::Cloud { .. } => Primitives::Triangles,
            BouncedScene::Instances(_) => Primitives::Instances,
        };
        let Viewport { width, height, .. } = self.camera.viewport();
        let settings = BouncedSettings {
            rays_per_pixel: RAYS_PER_PIXEL,
            ..BouncedSettings::default()
        };
        let input = BouncedInput {
            radiance: match payload {
                Payload::Occlusion => HitRadiance::None,
                _ => HitRadiance::Lit(HitLighting {
                    materials: &self.ground.materials,
                    lights: &[],
                }),
            },
            ..BouncedInput::of(frame, scene)
        };
        let [counted, timed] = [true, false].map(|statistics| {
            let descriptor = BouncedDescriptor {
                payload,
                primitives,
                statistics,
                ..BouncedDescriptor::default()
            };
            let pass = BouncedZBuffer::new(device, &descriptor).expect("pipelines");
            let view = pass.create_view(device, width, height, RAYS_PER_PIXEL);
            let view = view.expect("a view");
            let run = || {
                let record = |e: &mut _| pass.record(device, e, &input, &settings, &view);
                let (ms, done) = gpu.time(record);
                done.expect("hits");
                ms
            };
            // The first compiles the pipeline.
            run();
            let runs = if statistics { 0 } else { RUNS };
            let fastest = (0..runs).map(|_| run()).fold(f64::INFINITY, f64::min);
            let counts = view.statistics().map(|buffer| gpu.read_buffer(buffer));
            (counts, fastest)
        });
        (counted.0.unwrap_or_default(), timed.1)
    }
}

/// What a structure took: bytes, and milliseconds of the first building, and of one for other transforms.
struct Built {
    bytes: u64,
    first: f64,
    again: f64,
}

/// Builds one level, and traces it.
fn one_level(
    gpu: &Gpu,
    forest: &Forest,
    rays: &mut dyn FnMut(BouncedScene<'_>),
) -> Result<Built, Error> {
    let device = &gpu.device;
    let surfelizer = Surfelizer::new(device)?;
    let builder = BvhBuilder::new(device, Primitives::Triangles)?;
    let triangles = Geometry {
        meshes: &forest.meshes(0),
    }
    .triangles();
    let capacity = CloudCapacity {
        surfels: 0,
        pieces: triangles,
        triangles,
    };
    let mut cloud = surfelizer.create_cloud(device, capacity)?;
    let bvh = builder.create(device, &cloud)?;
    let settings = SurfelizerSettings {
        density: f32::INFINITY,
        ..SurfelizerSettings::default()
    };
    let mut build = |set| {
        let meshes = forest.meshes(set);
        let input = SurfelizerInput::new(Geometry { meshes: &meshes }, &forest.camera);
        let (ms, done) = gpu.time(|encoder| {
            surfelizer.record(device, encoder, &input, &settings, &mut cloud)?;
            builder.record(device, encoder, &cloud, &bvh, None)
        });
        done.map(|()| ms)
    };
    // The first compiles the pipelines.
    build(0)?;
    let [again, first] = fastest(&mut build)?;
    rays(BouncedScene::Cloud {
        cloud: &cloud,
        bvh: &bvh,
    });
    Ok(Built {
        bytes: cloud.memory_bytes() + bvh.memory_bytes(),
        first,
        again,
    })
}

/// The fastest buildings of either set of transforms.
fn fastest(build: &mut dyn FnMut(usize) -> Result<f64, Error>) -> Result<[f64; 2], Error> {
    let mut fastest = [f64::INFINITY; 2];
    for _ in 0..RUNS {
        for set in [1, 0] {
            fastest[1 - set] = fastest[1 - set].min(build(set)?);
        }
    }
    Ok(fastest)
}

/// The same with two.
fn two_levels(
    gpu: &Gpu,
    forest: &Forest,
    rays: &mut dyn FnMut(BouncedScene<'_>),
) -> Result<Built, Error> {
    let device = &gpu.device;
    let builder = InstancedBvhBuilder::new(device)?;
    let meshes = [0, 1].map(|set| forest.meshes(set));
    let geometry = |set: usize| Geometry {
        meshes: &meshes[set],
    };
    let mut bvh = builder.create(device, &geometry(0))?;
    let mut build = |set: usize, changed| {
        let input = InstancedBvhInput {
            changed,
            ..InstancedBvhInput::new(geometry(set), &forest.camera)
        };
        let (ms, done) = gpu.time(|encoder| builder.record(device, encoder, &input, &mut bvh));
        done.map(|()| ms)
    };
    build(0, ChangedMeshes::All)?;
    let [mut first, mut again] = [f64::INFINITY; 2];
    for _ in 0..RUNS {
        first = first.min(build(0, ChangedMeshes::All)?);
        again = again.min(build(1, ChangedMeshes::None)?);
    }
    build(0, ChangedMeshes::None)?;
    rays(BouncedScene::Instances(&bvh));
    Ok(Built {
        bytes: bvh.memory_bytes(),
        first,
        again,
    })
}

/// Prints a forest's rows.
fn measure(gpu: &Gpu, trees: u32, size: [u32; 2]) -> Vec<Value> {
    let forest = Forest::new(gpu, trees, size);
    let triangles = Geometry {
        meshes: &forest.meshes(0),
    }
    .triangles();
    println!("{trees} trees, {triangles} triangles");
    let mut rows = Vec::new();
    for structure in [Structure::OneLevel, Structure::TwoLevels] {
        let mut counted = Vec::new();
        let mut decoding = Decoding::new(gpu, size).expect("room");
        let origin = forest.camera.focus();
        let (_, frame) = decoding
            .frame(gpu, forest.raster.gbuffer(), &forest.camera, origin)
            .expect("a frame");
        let mut rays = |scene: BouncedScene<'_>| {
            for (name, payload) in [
                ("any", Payload::Occlusion),
                ("nearest", Payload::LitRadiance),
            ] {
                counted.push((name, forest.trace(gpu, &frame, scene, payload)));
            }
        };
        let built = match structure {
            Structure::OneLevel => one_level(gpu, &forest, &mut rays),
            Structure::TwoLevels => two_levels(gpu, &forest, &mut rays),
        };
        let name = match structure {
            Structure::OneLevel => "one level",
            Structure::TwoLevels => "two levels",
        };
        let mut row = json!({ "structure": name, "trees": trees, "triangles": triangles });
        match built {
            Ok(built) => {
                let megabytes = built.bytes as f64 / 1e6;
                println!(
                    " {name:10} {megabytes:9.2} MB, built in {:9.2} ms, for other transforms in {:9.2} ms",
                    built.first, built.again
                );
                let counts: Vec<Value> = counted
                    .iter()
                    .map(|(kind, (counts, ms))| {
                        let mut counts = count(&format!("{kind}, {ms:.1} ms"), counts);
                        counts["ms"] = json!(ms);
                        counts
                    })
                    .collect();
                row["bytes"] = json!(built.bytes);
                row["build_ms"] = json!(built.first);
                row["again_ms"] = json!(built.again);
                row["counts"] = json!(counts);
            }
            Err(refusal) => {
                println!(" {name:10} {refusal}");
                row["refused"] = json!(refusal.to_string());
            }
        }
        rows.push(row);
    }
    rows
}

/// All forests.
pub fn run(gpu: &Gpu, quick: bool) -> Vec<Value> {
    let size = if quick { [96, 96] } else { [256, 256] };
    let sizes: &[u32] = if quick {
        &[10, 100, 1000]
    } else {
        &[10, 100, 1000, 10_000]
    };
    println!(
        "{}, {size:?} pixels, {RAYS_PER_PIXEL} rays per pixel",
        gpu.name()
    );
    sizes
        .iter()
        .flat_map(|&trees| measure(gpu, trees, size))
        .collect()
}

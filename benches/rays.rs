//! Rays of the bounced z-buffer: time by what is asked of them, beside a ray tracer on the CPU.
//!
//! `cargo bench --bench rays [-- --quick] [-- SCENE...]` prints a table and writes `target/bench/rays.json`. SCENE is one of
//! the crate's scenes or a glTF file. All rows trace the same directions of the same pixels:
//! * `any`: whether there is a hit, of ambient occlusion without a radius;
//! * `nearest`: the nearest hit, with its surface's emission and no light;
//! * `lit`: the same with one light, and so a ray more from most hits;
//! * `cpu`: whether there is a hit, by the crate's own tracer, all threads: a bounding volume hierarchy of good quality,
//!   built before (`build`), where the bounds of the GPU's rays are made anew from the triangles each time (`bounds`).
//!
//! A time is the fastest of a few runs, and counts only beside the others of its row.

#[path = "../examples/support/mod.rs"]
mod support;

use std::{path::Path, time::Instant};

use deep_screen_space::{
    Camera, CloudCapacity, Light, Payload, Sampling, Viewport,
    glam::DVec3,
    reference::{
        directions::{cell_point, hemisphere_direction},
        gbuffer,
        trace::{Receiver, Tracer},
    },
    scenes::{self, Scene},
};
use rayon::prelude::*;
use support::{
    bounced::BouncedRenderer,
    gltf::load_gltf,
    gpu::{Ask, Gpu},
    presets::bounced_preset,
    raster::{Raster, perspective},
    scene::SceneBuffers,
    world::bounds_of,
};

/// Best of this many runs: a shared machine only ever adds time.
const RUNS: usize = 3;
const DIRECTIONS: u32 = 16;
/// Columns and rows of the grid of that many directions.
const GRID: [u32; 2] = [4, 4];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let size = if arguments.iter().any(|a| a == "--quick") {
        [128, 128]
    } else {
        [512, 512]
    };
    let mut names: Vec<&str> = arguments
        .iter()
        .map(String::as_str)
        .filter(|a| !a.starts_with("--"))
        .collect();
    if names.is_empty() {
        names = vec!["cornell", "colonnade", "dominoes", "closed_room"];
    }
    let gpu = Gpu::open(Ask::All).expect("a graphics adapter");
    let [width, height] = size;
    println!(
        "{}, {width}x{height} pixels, {DIRECTIONS} directions",
        gpu.name()
    );
    println!(
        "{:16} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>7} {:>7}",
        "scene",
        "triangles",
        "bounds",
        "any",
        "nearest",
        "lit",
        "build",
        "cpu",
        "near/any",
        "any/cpu",
        "Mrays/s",
        "nodes",
        "leaves"
    );
    let rows: Vec<_> = names
        .iter()
        .map(|name| {
            let scene = scenes::by_name(name)
                .map_or_else(|| from_file(name.as_ref()), Ok)
                .expect("a scene or a glTF file");
            measure(&gpu, &scene, name, size)
        })
        .collect();
    let folder = Path::new("target/bench");
    std::fs::create_dir_all(folder).expect("target can be written");
    let text = serde_json::to_string_pretty(&rows).expect("rows are plain");
    std::fs::write(folder.join("rays.json"), text).expect("target can be written");
}

/// A file's scene, about the middle of its box.
fn from_file(path: &Path) -> Result<Scene, String> {
    let world = load_gltf(path)?.world;
    let (low, high) = world.bounds();
    world.relative_to(0.5 * (low + high))
}

/// The scene's own first view, or one from a corner of its bounds to their middle.
fn camera_of(scene: &Scene, [width, height]: [u32; 2]) -> Camera {
    let aspect = f64::from(width) / f64::from(height);
    let viewport = Viewport::full(width, height);
    let (eye, target, up, projection) = if let Some(view) = scene.views.first() {
        let projection = perspective(view.vertical_fov_degrees, aspect, view.near);
        (view.eye, view.target, view.up, projection)
    } else {
        let (low, high) = bounds_of(scene);
        let eye = high + 0.3 * (high - low);
        let near = 1e-3 * (high - low).length();
        let projection = perspective(40.0, aspect, near);
        let target = 0.5 * (low + high);
        (
            eye.to_array(),
            target.to_array(),
            [0.0, 1.0, 0.0],
            projection,
        )
    };
    Camera::look_at(eye.into(), target.into(), up.into(), projection, viewport).expect("a camera")
}

fn measure(gpu: &Gpu, scene: &Scene, name: &str, size: [u32; 2]) -> serde_json::Value {
    let camera = camera_of(scene, size);
    let buffers = SceneBuffers::new(gpu, scene);
    let raster = Raster::draw(gpu, &buffers, &camera);
    let triangles = buffers.triangles();
    let capacity = CloudCapacity {
        surfels: 0,
        pieces: triangles + 200_000,
        triangles,
    };
    let light = Light::Directional {
        direction: DVec3::new(0.3, -1.0, 0.2),
        irradiance: [3.0; 3],
    };
    let trace = |payload, statistics, lights: &[Light]| {
        let mut preset =
            bounced_preset("balanced", payload, f32::INFINITY).expect("a preset of that name");
        preset.bounced.directions = DIRECTIONS;
        let mut renderer =
            BouncedRenderer::new(gpu, payload, capacity, size, DIRECTIONS, statistics)
                .expect("within limits");
        let mut best: Option<Vec<(&str, f64)>> = None;
        // The first compiles the pipelines.
        for _ in 0..=RUNS {
            let picture = renderer
                .render(gpu, &raster, &buffers, &camera, lights, &preset)
                .expect("valid settings");
            let faster = best
                .as_ref()
                .is_none_or(|best| of(&picture.passes, "trace") < of(best, "trace"));
            if faster {
                best = Some(picture.passes);
            }
        }
        let counts: Option<Vec<u32>> = renderer
            .gatherer
            .view
            .statistics()
            .map(|buffer| gpu.read_buffer(buffer));
        (best.expect("several runs"), counts)
    };
    let (any, _) = trace(Payload::Occlusion, false, &[]);
    let (_, counts) = trace(Payload::Occlusion, true, &[]);
    let (nearest, _) = trace(Payload::Radiance, false, &[]);
    let (lit, _) = trace(Payload::Radiance, false, &[light]);
    let counts = counts.expect("asked for");
    let rays = f64::from(counts[0]);

    let start = Instant::now();
    let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a scene");
    let build = milliseconds(start);
    let receivers = gbuffer::receivers(
        &camera,
        &tracer,
        &scene.positions,
        &scene.normals,
        &scene.indices,
    );
    let cpu = (0..RUNS)
        .map(|_| {
            let start = Instant::now();
            let blocked = cpu_hits(&tracer, &receivers, size[0]);
            assert!(blocked <= rays as usize);
            milliseconds(start)
        })
        .fold(f64::INFINITY, f64::min);

    let [bounds, any, nearest, lit] = [
        of(&any, "bounds"),
        of(&any, "trace"),
        of(&nearest, "trace"),
        of(&lit, "trace"),
    ];
    println!(
        "{:16} {triangles:>9} {bounds:>8.1} {any:>8.1} {nearest:>8.1} {lit:>8.1} {build:>8.1} {cpu:>8.1} {:>8.2} {:>8.2} {:>8.2} \
         {:>7.1} {:>7.1}",
        name.rsplit('/').next().unwrap_or(name),
        nearest / any,
        any / cpu,
        rays / any / 1e3,
        f64::from(counts[1]) / rays,
        f64::from(counts[2]) / rays,
    );
    serde_json::json!({
        "adapter": gpu.name(), "scene": name, "width": size[0], "height": size[1], "triangles": triangles,
        "rays": counts[0], "nodes": counts[1], "leaves": counts[2], "hits": counts[3],
        "bounds_ms": bounds, "any_ms": any, "nearest_ms": nearest, "lit_ms": lit,
        "build_ms": build, "cpu_ms": cpu,
    })
}

/// How many of the same rays are blocked.
fn cpu_hits(tracer: &Tracer, receivers: &[Option<Receiver>], width: u32) -> usize {
    receivers
        .par_iter()
        .enumerate()
        .map(|(i, at)| {
            let Some(at) = at else { return 0 };
            let pixel = [i as u32 % width, i as u32 / width];
            let origin = tracer.start(at.position, at.geometric_normal);
            (0..DIRECTIONS)
                .filter(|&index| {
                    let point = cell_point(pixel, index, GRID, 0);
                    let drawn = hemisphere_direction(point, at.shading_normal, Sampling::Cosine);
                    tracer.occluded(origin, drawn.direction, 0.0, f64::INFINITY)
                })
                .count()
        })
        .sum()
}

fn of(passes: &[(&str, f64)], name: &str) -> f64 {
    passes
        .iter()
        .find(|pass| pass.0 == name)
        .expect("a pass of that name")
        .1
}

fn milliseconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

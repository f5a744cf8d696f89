//! Rays of the bounced z-buffer: time by what is asked of them, beside a ray tracer on the CPU.
//!
//! `cargo bench --bench rays -- [--quick] [--size WxH] [--cameras FILE] [--radius R] [SCENE...]` prints a table and
//! writes `target/bench/rays.json`. SCENE is one of the crate's scenes or a glTF file, whose cameras FILE may have (as the
//! example `render` reads them). All rows trace the same directions of the same pixels:
//! * `any`: whether there is a hit, of ambient occlusion without a radius;
//! * `nearest`: the nearest hit, with its surface's emission and no light;
//! * `lit`: the same with one light, and so a ray more from most hits;
//! * `cpu`: whether there is a hit, by the crate's own tracer in `f64`, all threads, with a hierarchy that was built before
//!   (`build`), where that of the GPU's rays is made anew from the triangles each time (`bounds`, and its memory in `MB`);
//! * `obvhs`: the same in `f32`, with the best tree that `obvhs` builds, nodes of eight children as here;
//! * `4 rays`: how many times as long as four of the `any` rays per pixel it takes to make the hierarchy anew.
//!
//! A time is the fastest of a few runs, and counts only beside the others of its row.
//!
//! Below each row stand counts, which are the same on any machine: for any hit, without a radius and with R, and for the
//! nearest one, per ray, nodes visited, triangles tested, bytes of both, and steps of the slowest of 32 rays (8 × 4 pixels,
//! one direction), each a node or a triangle; *even* is a ray's mean number of steps over that. Beside them stand those of
//! `obvhs`, whose children are in the order of the ray's octant. `--counts` measures nothing else. `--instances` has tables of
//! its own (`instances.rs`).

mod instances;
mod obvhs_rays;

use std::{
    cell::Cell,
    collections::BTreeMap,
    fs::File,
    path::{Path, PathBuf},
};

use clap::Parser;
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
use obvhs_rays::Best;
use rayon::prelude::*;
use serde::Deserialize;
use support::{
    arguments, bench,
    bounced::{BouncedRenderer, RayRoom},
    gltf::load_gltf,
    gpu::{Ask, Gpu},
    presets::bounced_preset,
    raster::{Raster, perspective},
    scene::SceneBuffers,
    world::bounds_of,
};

/// Best of this many runs: a shared machine only ever adds time.
const RUNS: usize = 3;
const RAYS_PER_PIXEL: u32 = 16;
/// Columns and rows of the grid of that many directions.
const GRID: [u32; 2] = [4, 4];

/// Bytes that a ray fetches of a node and of a triangle.
const NODE_BYTES: f64 = 80.0;
const TRIANGLE_BYTES: f64 = 48.0;

/// Rays of the bounced z-buffer: time by what is asked of them, beside a ray tracer on the CPU.
#[derive(Parser)]
#[expect(clippy::struct_excessive_bools, reason = "flags of a command line")]
struct Options {
    /// The crate's scenes or glTF files; without, cornell, colonnade, dominoes and `closed_room`.
    scenes: Vec<String>,
    /// Small pictures.
    #[arg(long)]
    quick: bool,
    /// Size of the pictures, `WxH`, in place of 512x512.
    #[arg(long, value_parser = arguments::parse_size)]
    size: Option<[u32; 2]>,
    /// Counts, and no times.
    #[arg(long)]
    counts: bool,
    /// Forests of instances, in one level and in two, within the limits that `DSS_LIMITS` asks for; nothing else.
    #[arg(long)]
    instances: bool,
    /// Of ambient occlusion, world units; without, what suits the crate's own scene.
    #[arg(long)]
    radius: Option<f32>,
    /// A JSON file of cameras by scene, as the example `render` reads them.
    #[arg(long)]
    cameras: Option<PathBuf>,
    /// What cargo adds; without a meaning here.
    #[arg(long, hide = true)]
    bench: bool,
}

impl Options {
    fn size(&self) -> [u32; 2] {
        let usual = if self.quick { [128, 128] } else { [512, 512] };
        self.size.unwrap_or(usual)
    }
}

/// A camera of a file of them.
#[derive(Clone, Deserialize)]
struct Shot {
    name: String,
    eye: [f64; 3],
    target: [f64; 3],
    up: [f64; 3],
    vfov_deg: f64,
    near: f64,
}

fn main() {
    let mut options = Options::parse();
    if options.instances {
        let gpu = Gpu::open(Ask::from_env()).expect("a graphics adapter");
        let rows = instances::run(&gpu, options.quick);
        bench::write_rows("rays-instances", &rows).expect("target can be written");
        return;
    }
    if options.scenes.is_empty() {
        options.scenes = ["cornell", "colonnade", "dominoes", "closed_room"]
            .map(String::from)
            .into();
    }
    let cameras: BTreeMap<String, Vec<Shot>> = options
        .cameras
        .as_ref()
        .map(|path| {
            let file = File::open(path).expect("a file");
            serde_json::from_reader(file).expect("cameras by scene")
        })
        .unwrap_or_default();
    let gpu = Gpu::open(Ask::All).expect("a graphics adapter");
    let [width, height] = options.size();
    println!(
        "{}, {width}x{height} pixels, {RAYS_PER_PIXEL} rays per pixel",
        gpu.name()
    );
    println!(
        "{:24} {:>9} {:>6} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8}",
        "scene",
        "triangles",
        "MB",
        "bvh",
        "any",
        "nearest",
        "lit",
        "build",
        "cpu",
        "obvhs",
        "near/any",
        "any/obvhs",
        "4 rays",
        "Mrays/s"
    );
    let mut rows = Vec::new();
    let bar = bench::progress(options.scenes.len());
    for name in &options.scenes {
        let (scene, origin) = scenes::by_name(name)
            .map_or_else(
                || from_file(name.as_ref()),
                |scene| Ok((scene, DVec3::ZERO)),
            )
            .expect("a scene or a glTF file");
        let path: &Path = name.as_ref();
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        bar.suspend(|| match cameras.get(&*stem) {
            Some(shots) => {
                for shot in shots {
                    let label = format!("{stem}/{}", shot.name);
                    let camera = aimed(shot, origin, options.size());
                    rows.push(measure(&gpu, &scene, &label, &camera, &options));
                }
            }
            None => rows.push(measure(
                &gpu,
                &scene,
                &stem,
                &camera_of(&scene, options.size()),
                &options,
            )),
        });
        bar.inc(1);
    }
    bar.finish_and_clear();
    bench::write_rows("rays", &rows).expect("target can be written");
}

/// A camera relative to an origin.
fn aimed(shot: &Shot, origin: DVec3, [width, height]: [u32; 2]) -> Camera {
    let aspect = f64::from(width) / f64::from(height);
    let projection = perspective(shot.vfov_deg, aspect, shot.near);
    Camera::look_at(
        DVec3::from(shot.eye) - origin,
        DVec3::from(shot.target) - origin,
        shot.up.into(),
        projection,
        Viewport::full(width, height),
    )
    .expect("a camera")
}

/// A file's scene, about the middle of its box, which is the origin.
fn from_file(path: &Path) -> Result<(Scene, DVec3), String> {
    let world = load_gltf(path)?.world;
    let (low, high) = world.bounds();
    let origin = 0.5 * (low + high);
    Ok((world.relative_to(origin)?, origin))
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

/// What rays of one kind took each.
fn count(name: &str, counts: &[u32]) -> serde_json::Value {
    if counts[0] == 0 {
        return serde_json::Value::Null;
    }
    let rays = f64::from(counts[0]);
    let [nodes, triangles] = [1, 2].map(|i| f64::from(counts[i]) / rays);
    let steps = f64::from(counts[4]) / f64::from(counts[5]);
    let bytes = NODE_BYTES * nodes + TRIANGLE_BYTES * triangles;
    let even = (nodes + triangles) / steps;
    println!(
        "  {name:20} {nodes:6.2} nodes {triangles:6.2} triangles {bytes:7.0} bytes {steps:6.1} steps of 32, {even:.2} even"
    );
    serde_json::json!({
        "rays": name, "nodes": nodes, "triangles": triangles, "bytes": bytes, "lockstep": steps, "hits": counts[3],
    })
}

fn measure(
    gpu: &Gpu,
    scene: &Scene,
    name: &str,
    camera: &Camera,
    options: &Options,
) -> serde_json::Value {
    let size = options.size();
    let buffers = SceneBuffers::new(gpu, scene);
    let raster = Raster::draw(gpu, &buffers, camera);
    let triangles = buffers.triangles();
    let capacity = CloudCapacity {
        surfels: 0,
        pieces: triangles,
        triangles,
    };
    let light = Light::Directional {
        direction: DVec3::new(0.3, -1.0, 0.2),
        irradiance: [3.0; 3],
    };
    let bvh_bytes = Cell::new(0);
    let trace = |payload, radius, statistics, lights: &[Light]| {
        let mut preset = bounced_preset("balanced", payload, radius).expect("a preset");
        preset.bounced.rays_per_pixel = RAYS_PER_PIXEL;
        let room = RayRoom {
            rays_per_pixel: RAYS_PER_PIXEL,
            statistics,
            ..RayRoom::default()
        };
        let mut renderer =
            BouncedRenderer::new(gpu, payload, capacity, size, room).expect("within limits");
        let mut best: Option<Vec<(&str, f64)>> = None;
        // The first compiles the pipelines.
        let runs = if statistics { 0 } else { RUNS };
        for _ in 0..=runs {
            let picture = renderer
                .render(gpu, &raster, &buffers, camera, lights, &preset)
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
        bvh_bytes.set(renderer.bvh_bytes());
        (best.expect("several runs"), counts)
    };
    let infinite = f32::INFINITY;
    let asked = || {
        [
            ("any", Payload::Occlusion, Some(infinite)),
            ("any, radius", Payload::Occlusion, options.radius),
            ("nearest", Payload::LitRadiance, Some(infinite)),
        ]
        .into_iter()
        .filter(|(_, _, radius)| radius.is_some())
    };
    let counts: Vec<_> = asked()
        .filter_map(|(name, payload, radius)| Some((name, trace(payload, radius?, true, &[]).1?)))
        .collect();
    let stopwatch = gpu.stopwatch();
    let tracer = Tracer::of_scene(scene).expect("a scene");
    let build = stopwatch.milliseconds();
    let receivers = gbuffer::receivers(
        camera,
        &tracer,
        &scene.positions,
        &scene.normals,
        &scene.indices,
    );
    let best = Best::new(scene);
    let on_cpu = (&tracer, receivers.as_slice());
    let print_counts = || -> Vec<_> {
        let mut all = Vec::new();
        for ((name, counts), (_, payload, radius)) in counts.iter().zip(asked()) {
            all.push(count(name, counts));
            let how = (radius.unwrap_or(infinite), payload == Payload::Occlusion);
            let counts = best.count(on_cpu, size[0], GRID, how);
            all.push(count(&format!("{name}, obvhs"), &counts));
        }
        all
    };
    if options.counts {
        println!("{name:24} {triangles:>9}");
        return serde_json::json!({ "scene": name, "triangles": triangles, "counts": print_counts() });
    }
    let rays = f64::from(counts[0].1[0]);
    let (any, _) = trace(Payload::Occlusion, infinite, false, &[]);
    let (nearest, _) = trace(Payload::LitRadiance, infinite, false, &[]);
    let (lit, _) = trace(Payload::LitRadiance, infinite, false, &[light]);

    let cpu = (0..RUNS)
        .map(|_| {
            let stopwatch = gpu.stopwatch();
            let blocked = cpu_hits(&tracer, &receivers, size[0]);
            assert!(blocked <= rays as usize);
            stopwatch.milliseconds()
        })
        .fold(f64::INFINITY, f64::min);

    let obvhs = (0..RUNS)
        .map(|_| {
            let stopwatch = gpu.stopwatch();
            best.count(on_cpu, size[0], GRID, (infinite, true));
            stopwatch.milliseconds()
        })
        .fold(f64::INFINITY, f64::min);
    let megabytes = bvh_bytes.get() as f64 / 1e6;

    let [bounds, any, nearest, lit] = [
        of(&any, "bvh"),
        of(&any, "trace"),
        of(&nearest, "trace"),
        of(&lit, "trace"),
    ];
    println!(
        "{name:24} {triangles:>9} {megabytes:>6.1} {bounds:>8.1} {any:>8.1} {nearest:>8.1} {lit:>8.1} {build:>8.1} {cpu:>8.1} \
         {obvhs:>8.1} {:>8.2} {:>8.2} {:>8.2} {:>8.2}",
        nearest / any,
        any / obvhs,
        bounds / (any * 4.0 / f64::from(RAYS_PER_PIXEL)),
        rays / any / 1e3,
    );
    serde_json::json!({
        "adapter": gpu.name(), "scene": name, "width": size[0], "height": size[1], "triangles": triangles, "rays": rays,
        "bounds_ms": bounds, "any_ms": any, "nearest_ms": nearest, "lit_ms": lit,
        "bvh_bytes": bvh_bytes.get(), "build_ms": build, "cpu_ms": cpu, "obvhs_ms": obvhs,
        "obvhs_build_ms": best.build.as_secs_f64() * 1e3, "counts": print_counts(),
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
            (0..RAYS_PER_PIXEL)
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

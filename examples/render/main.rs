//! The whole on any scene: `cargo run --release --example render -- SCENE.glb --out DIR`.
//!
//! Writes `ao.exr` (one channel `Y`, 1 = open), `ao.png` and `stats.json`; with `--reference` also the ray-traced truth
//! and how far off the picture is.

mod view;

#[path = "../support/mod.rs"]
mod support;

use std::{path::PathBuf, process::ExitCode};

use clap::Parser;
use deep_screen_space::{
    AmbientOcclusion, CloudCapacity, Overlap,
    glam::DVec3,
    reference::trace::{Receiver, Tracer},
    scenes,
};
use support::{
    ambient_occlusion::{Rendered, Renderer},
    files,
    gpu::{Ask, Gpu},
    presets::{self, Preset},
    raster::Raster,
    scene::{SceneBuffers, load_gltf},
};

/// Ambient occlusion of a scene from its surfels.
#[derive(Parser)]
#[command(about)]
struct Options {
    /// A glTF 2.0 file, or the name of one of the crate's scenes; the colonnade if left out.
    scene: Option<String>,
    /// A JSON file of cameras by scene, each with name, eye, target, up, `vfov_deg`, near, width and height.
    #[arg(long)]
    cameras: Option<PathBuf>,
    /// Which camera of the file, or which view of the crate's scene.
    #[arg(long)]
    camera: Option<String>,
    /// The eye, x,y,z.
    #[arg(long, value_parser = view::parse_point, requires = "target", allow_hyphen_values = true)]
    eye: Option<DVec3>,
    /// What the eye looks at, x,y,z.
    #[arg(long, value_parser = view::parse_point, requires = "eye", allow_hyphen_values = true)]
    target: Option<DVec3>,
    /// Vertical field of view in degrees.
    #[arg(long)]
    vfov: Option<f64>,
    /// Size of the picture in pixels, `WxH`.
    #[arg(long, value_parser = view::parse_size)]
    size: Option<[u32; 2]>,
    /// What to compute.
    #[arg(long, default_value = "ao", value_parser = ["ao"])]
    effect: String,
    /// How to compute it.
    #[arg(long, default_value = "splat", value_parser = ["splat"])]
    method: String,
    /// How exactly.
    #[arg(long, default_value = "balanced", value_parser = presets::NAMES)]
    preset: String,
    /// Distance beyond which nothing occludes, world units, or inf; if left out, what suits the crate's own scene, and
    /// inf for a file.
    #[arg(long, value_parser = view::parse_radius)]
    radius: Option<f32>,
    /// Whether surfaces occlude behind their backs too.
    #[arg(long)]
    two_sided: bool,
    /// Combine occluders as if they lay independently of each other.
    #[arg(long)]
    independent: bool,
    /// Surfels that there is room for.
    #[arg(long, default_value_t = 4_000_000)]
    surfels: u32,
    /// Trace the truth too, with this many rays a pixel.
    #[arg(long, num_args = 0..=1, default_missing_value = "256")]
    reference: Option<u32>,
    /// Where to write.
    #[arg(long, default_value = "out")]
    out: PathBuf,
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("render: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    let scene = match options.scene.as_deref() {
        None => scenes::by_name("colonnade").ok_or("the colonnade is missing")?,
        Some(name) => match scenes::by_name(name) {
            Some(scene) => scene,
            None => load_gltf(name.as_ref())?,
        },
    };
    let shot = view::choose(options, &scene)?;
    let camera = shot.camera()?;
    let radius = options.radius.unwrap_or(scene.ao_radius);
    let preset = presets::preset(&options.preset, radius).ok_or("no such preset")?;

    std::fs::create_dir_all(&options.out).map_err(|e| format!("{}: {e}", options.out.display()))?;
    let gpu = Gpu::open(Ask::from_env())?;
    let buffers = SceneBuffers::new(&gpu, &scene);
    let raster = Raster::draw(&gpu, &buffers, &camera);
    let capacity = CloudCapacity {
        surfels: options.surfels,
        pieces: (buffers.triangles() + 200_000).min(2_700_000),
        triangles: buffers.triangles(),
    };
    let effect = AmbientOcclusion {
        two_sided: options.two_sided,
        overlap: if options.independent {
            Overlap::Independent
        } else {
            Overlap::Add
        },
    };
    let size = [shot.width, shot.height];
    let mut renderer = Renderer::new(&gpu, effect, capacity, size, preset.splat.levels, false)
        .map_err(|e| e.to_string())?;
    let meshes = buffers.meshes();
    let mut render = || {
        renderer
            .render(&gpu, &raster, &meshes, &camera, &preset)
            .map_err(|e| e.to_string())
    };
    // Drivers compile a pipeline when it first runs: the second time is the one to report.
    render()?;
    let rendered = render()?;
    let memory = renderer.memory_bytes();

    let path = |name: &str| options.out.join(name);
    files::write_exr(&path("ao.exr"), size[0], size[1], &rendered.visibility)?;
    files::write_png(&path("ao.png"), size[0], size[1], &rendered.visibility)?;
    let stats = stats(
        &gpu,
        options,
        &rendered,
        &preset,
        size,
        buffers.triangles(),
        memory,
    );
    let text = serde_json::to_string_pretty(&stats).map_err(|e| e.to_string())?;
    std::fs::write(path("stats.json"), text).map_err(|e| format!("stats.json: {e}"))?;
    println!(
        "{}: {} surfels of {} triangles, {:.1} ms on {}",
        path("ao.png").display(),
        rendered.counts.stored,
        buffers.triangles(),
        rendered.total_ms(),
        gpu.name()
    );
    if rendered.counts.overflow() > 0 {
        println!(
            "{} surfels more found no room: --surfels sets how many do",
            rendered.counts.overflow()
        );
    }
    if let Some(rays) = options.reference {
        compare(options, &scene, &shot, &rendered.visibility, radius, rays)?;
    }
    Ok(())
}

fn stats(
    gpu: &Gpu,
    options: &Options,
    rendered: &Rendered,
    preset: &Preset,
    [width, height]: [u32; 2],
    triangles: u32,
    memory_bytes: u64,
) -> serde_json::Value {
    let passes: Vec<_> = rendered
        .passes
        .iter()
        .map(|(name, ms)| serde_json::json!({ "name": name, "ms": ms }))
        .collect();
    serde_json::json!({
        "adapter": gpu.adapter.name,
        "driver": gpu.adapter.driver_info,
        "width": width,
        "height": height,
        "triangles": triangles,
        "triangles_rejected": rendered.counts.rejected,
        "pieces": rendered.counts.pieces,
        "surfels": rendered.counts.stored,
        "surfel_overflow": rendered.counts.overflow(),
        "levels": preset.splat.levels,
        "total_ms": rendered.total_ms(),
        "passes": passes,
        "memory_bytes": memory_bytes,
        "settings": {
            "effect": options.effect,
            "method": options.method,
            "preset": options.preset,
            "radius": if preset.splat.radius.is_finite() { Some(preset.splat.radius) } else { None },
            "two_sided": options.two_sided,
            "overlap": if options.independent { "independent" } else { "add" },
            "radius_pixels": preset.surfelizer.radius_pixels,
            "density": preset.surfelizer.density,
            "epsilon": preset.splat.epsilon,
            "unbounded": preset.splat.unbounded,
            "filter_radius": preset.reconstructor.radius,
            "plane_distance": preset.reconstructor.plane_distance,
            "normal_power": preset.reconstructor.normal_power,
        },
    })
}

fn compare(
    options: &Options,
    scene: &scenes::Scene,
    shot: &view::Shot,
    visibility: &[f32],
    radius: f32,
    rays: u32,
) -> Result<(), String> {
    let tracer = Tracer::new(&scene.positions, &scene.indices).map_err(|e| e.to_string())?;
    let receivers: Vec<Option<Receiver>> = shot.receivers(scene, &tracer);
    let truth = tracer.ambient_occlusion_image(&receivers, f64::from(radius), rays, 1, true);
    let mut sum = 0.0;
    let mut bias = 0.0;
    let mut count = 0_u32;
    let mut image = vec![1.0; visibility.len()];
    let mut difference = vec![0.0; visibility.len()];
    for (i, estimate) in truth.iter().enumerate() {
        if let Some(estimate) = estimate {
            let error = f64::from(visibility[i]) - estimate.mean;
            image[i] = estimate.mean as f32;
            difference[i] = 4.0 * error.abs() as f32;
            sum += error * error;
            bias += error;
            count += 1;
        }
    }
    let path = |name: &str| options.out.join(name);
    let [width, height] = [shot.width, shot.height];
    files::write_exr(&path("ao_reference.exr"), width, height, &image)?;
    files::write_png(&path("ao_reference.png"), width, height, &image)?;
    files::write_png(&path("ao_difference_x4.png"), width, height, &difference)?;
    let n = f64::from(count.max(1));
    println!(
        "against {rays} rays a pixel: RMSE {:.4}, bias {:+.4} over {count} pixels",
        (sum / n).sqrt(),
        bias / n
    );
    Ok(())
}

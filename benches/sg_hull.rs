//! The hull against gathering the same 256 lights at every pixel, in one run.
//!
//! `cargo bench --bench sg_hull [-- WIDTHxHEIGHT …] [--scene NAME …]` (`--help`) prints a table and writes
//! `target/bench/sg_hull.json`: rows of scene, width, height, `per_pixel_ms`, `hull_ms`, speedup, `rel_rmse`, energy,
//! `ratio_p9999`, ssim, vertices, gathered (points that light is gathered at for quads and for their parts), splits, exact (the
//! share of pixels that are gathered each for itself), uncovered, `fallback_pixels`. `--error-threshold X` sets the bound,
//! `--runs N` of how many the best counts (2; one more goes first). Without sizes those of the paper are taken, 1280x720 to
//! 3840x2400; a software driver needs minutes for the largest.

use std::{hint::black_box, time::Instant};

use clap::Parser;
use deep_screen_space::{
    Components, SgHullSettings, SgHullSize, scenes, spherical_gaussian::SphericalGaussian,
};
use support::{
    bench,
    gpu::{Ask, Gpu},
    hull::{HullRenderer, LightSource, difference},
    raster::{Raster, camera_of},
    scene::SceneBuffers,
};

/// Of the paper, and the least speed-up over its scenes.
const SIZES: [([u32; 2], f64); 4] = [
    ([1280, 720], 5.0),
    ([1920, 1080], 9.5),
    ([2560, 1600], 11.9),
    ([3840, 2400], 16.8),
];

/// The hull against gathering the same 256 lights at every pixel, in one run.
#[derive(Parser)]
struct Options {
    /// `WIDTHxHEIGHT`, any number of times; without, those of the paper, 1280x720 to 3840x2400.
    #[arg(value_parser = bench::parse_size)]
    sizes: Vec<[u32; 2]>,
    /// One of the crate's scenes, any number of times; without, cornell, colonnade and dominoes.
    #[arg(long)]
    scene: Vec<String>,
    /// `SgHullSettings::error_threshold`.
    #[arg(long)]
    error_threshold: Option<f32>,
    /// Of how many runs the fastest counts; one more goes first.
    #[arg(long, default_value_t = 2)]
    runs: usize,
    /// What cargo adds; without a meaning here.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() {
    let mut options = Options::parse();
    if options.sizes.is_empty() {
        options.sizes = SIZES.iter().map(|(size, _)| *size).collect();
    }
    if options.scene.is_empty() {
        options.scene = ["cornell", "colonnade", "dominoes"]
            .map(String::from)
            .into();
    }
    let mut settings = SgHullSettings::default();
    settings.error_threshold = options.error_threshold.unwrap_or(settings.error_threshold);
    integrals();
    let gpu = Gpu::open(Ask::from_env()).expect("a graphics adapter");
    println!("{}", gpu.name());
    println!(
        "{:12} {:>5} {:>5} {:>12} {:>8} {:>7} {:>5} {:>8} {:>7} {:>6} {:>7} {:>8} {:>8} {:>7} {:>9} {:>8}",
        "scene",
        "width",
        "height",
        "per_pixel_ms",
        "hull_ms",
        "speedup",
        "bar",
        "rel_rmse",
        "energy",
        "ratio",
        "ssim",
        "vertices",
        "gathered",
        "exact",
        "uncovered",
        "fallback"
    );
    let mut rows = Vec::new();
    let bar = bench::progress(options.sizes.len() * options.scene.len());
    for size in &options.sizes {
        for name in &options.scene {
            rows.push(bar.suspend(|| measure(&gpu, name, *size, settings, options.runs)));
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    bench::write_rows("sg_hull", &rows).expect("target can be written");
}

/// Time of one cosine integral in f32 on one core, by either closed form.
fn integrals() {
    const COUNT: u32 = 1_000_000;
    let time = |f: fn(f32, f32) -> f32| {
        let start = Instant::now();
        let sum: f32 = (0..COUNT)
            .map(|i| f((i % 200) as f32 * 0.01 - 1.0, (i % 977) as f32 * 0.1))
            .sum();
        black_box(sum);
        start.elapsed().as_secs_f64() * 1e9 / f64::from(COUNT)
    };
    println!(
        "cosine integral: {:.1} ns, the paper's form {:.1} ns",
        time(SphericalGaussian::cosine_integral),
        time(SphericalGaussian::cosine_integral_logistic)
    );
}

fn measure(
    gpu: &Gpu,
    name: &str,
    [width, height]: [u32; 2],
    settings: SgHullSettings,
    runs: usize,
) -> serde_json::Value {
    let scene = scenes::by_name(name).expect("a scene");
    let camera = camera_of(&scene, [width, height]);
    let buffers = SceneBuffers::new(gpu, &scene);
    let raster = Raster::draw(gpu, &buffers, &camera);
    let size = SgHullSize::new(width, height);
    let mut renderer = HullRenderer::new(gpu, size, Components::default()).expect("it fits");
    renderer.settings = settings;
    let lights = renderer
        .lights(
            gpu,
            &buffers,
            &LightSource::of(&scene).expect("a lamp"),
            camera.eye(),
        )
        .expect("lights");
    // The first run compiles the pipelines.
    let (mut hull_ms, mut per_pixel_ms) = (f64::INFINITY, f64::INFINITY);
    let (mut found, mut truth) = (Vec::new(), Vec::new());
    for run in 0..=runs {
        let ms;
        (ms, found) = renderer
            .render(gpu, &raster, &camera, &lights)
            .expect("a picture");
        let exact;
        (exact, truth) = renderer
            .render_per_pixel(gpu, &raster, &camera, &lights)
            .expect("a picture");
        if run > 0 {
            hull_ms = hull_ms.min(ms);
            per_pixel_ms = per_pixel_ms.min(exact);
        }
    }
    let counts = renderer.counts(gpu);
    // Pixels that no quad wrote kept the truth of the run before, which has 1 in alpha too: count by assignment.
    let segment_of: Vec<u32> = gpu.read_buffer(renderer.view.segment_of());
    let uncovered = segment_of.iter().filter(|s| **s == 0xffff_fffe).count();
    let exact = f64::from(counts.per_pixel) / f64::from(width * height);
    let off = difference(&found, &truth, width);
    let bar = SIZES
        .iter()
        .find(|(size, _)| *size == [width, height])
        .map(|(_, bar)| *bar);
    let speedup = per_pixel_ms / hull_ms;
    println!(
        "{name:12} {width:5} {height:5} {per_pixel_ms:12.1} {hull_ms:8.1} {speedup:7.1} {:>5} {:8.4} {:+7.4} {:6.2} {:7.4} \
         {:8} {:8} {exact:7.4} {uncovered:9} {:8}",
        bar.map_or(String::from("-"), |b| b.to_string()),
        off.rmse,
        off.energy,
        off.ratio,
        off.ssim,
        counts.vertices(),
        counts.gathered + 5 * counts.splits,
        counts.fallback_pixels,
    );
    serde_json::json!({
        "scene": name,
        "width": width,
        "height": height,
        "per_pixel_ms": per_pixel_ms,
        "hull_ms": hull_ms,
        "speedup": speedup,
        "speedup_bar": bar,
        "rel_rmse": off.rmse,
        "energy": off.energy,
        "ratio_p9999": off.ratio,
        "ssim": off.ssim,
        "vertices": counts.vertices(),
        "gathered": counts.gathered + 5 * counts.splits,
        "splits": counts.splits,
        "exact": exact,
        "uncovered": uncovered,
        "fallback_pixels": counts.fallback_pixels,
    })
}

//! Light gathered on a sparse hull, beside the same gathered at every pixel:
//! `cargo run --release --example hull -- [SCENE] [WIDTHxHEIGHT] [FOLDER] [--glossy ROUGHNESS]`.
//!
//! The light is one bounce from a reflective shadow map of 16 × 16 texels, as polygons. Writes `hull.png` (the quads'
//! edges), `result.png`, `truth.png` and `difference.png` (four times enlarged: red where the hull is too bright, blue
//! where it is too dark). With a roughness all surfaces are glossy besides.

use std::path::Path;

use deep_screen_space::{
    Camera, Components, HullSegment, SgHullSize, Viewport,
    glam::DVec3,
    scenes::{self, Scene},
};
use support::{
    files,
    gpu::{Ask, Gpu},
    hull::{HullRenderer, LightSource, difference},
    raster::{Raster, perspective},
    scene::SceneBuffers,
};

fn main() -> Result<(), String> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let roughness = match arguments.iter().position(|a| a == "--glossy") {
        Some(at) => {
            let value = arguments.drain(at..).nth(1).and_then(|v| v.parse().ok());
            Some(value.ok_or("--glossy takes a roughness, and comes last")?)
        }
        None => None,
    };
    if let Some(option) = arguments.iter().find(|a| a.starts_with("--")) {
        return Err(format!("there is no option {option}"));
    }
    let name = arguments.first().map_or("colonnade", String::as_str);
    let scene = scenes::by_name(name).ok_or_else(|| format!("there is no scene {name}"))?;
    let size = arguments.get(1).map_or("960x540", String::as_str);
    let [width, height] = size
        .split_once('x')
        .and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]))
        .filter(|s: &[u32; 2]| s.iter().all(|n| (1..=8192).contains(n)))
        .ok_or("the size is WIDTHxHEIGHT, 1 to 8192 each")?;
    let folder = Path::new(arguments.get(2).map_or("target/hull", String::as_str));
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let error = |e: deep_screen_space::Error| e.to_string();

    let gpu = Gpu::open(Ask::from_env())?;
    let camera = camera(&scene, width, height).map_err(error)?;
    let buffers = SceneBuffers::new(&gpu, &scene);
    let raster = Raster::draw(&gpu, &buffers, &camera);
    let size = SgHullSize::new(width, height);
    let mut renderer = HullRenderer::with_roughness(&gpu, size, Components::default(), roughness)
        .map_err(error)?;
    let lamp = LightSource::of(&scene).map_err(error)?;
    let lights = renderer
        .lights(&gpu, &buffers, &lamp, camera.eye())
        .map_err(error)?;
    let mut times = [0.0; 2];
    let (mut found, mut truth) = (Vec::new(), Vec::new());
    // Drivers compile a pipeline when it first runs.
    for _ in 0..2 {
        (times[0], found) = renderer
            .render(&gpu, &raster, &camera, &lights)
            .map_err(error)?;
        (times[1], truth) = renderer
            .render_per_pixel(&gpu, &raster, &camera, &lights)
            .map_err(error)?;
    }
    let counts = renderer.counts(&gpu);
    let off = difference(&found, &truth, size.width);
    println!(
        "{name} {width}x{height} on {}: {:.1} ms, at every pixel {:.1} ms; {} vertices, {} pixels of last resort; RMSE \
         {:.2} %, energy {:+.2} %, 99.99th percentile of the ratio {:.2}",
        gpu.name(),
        times[0],
        times[1],
        counts.vertices(),
        counts.fallback_pixels,
        100.0 * off.rmse,
        100.0 * off.energy,
        off.ratio
    );

    let rgb = |pixels: &[[f32; 4]]| -> Vec<[f32; 3]> {
        pixels.iter().map(|p| [p[0], p[1], p[2]]).collect()
    };
    let mean: f32 =
        truth.iter().map(|p| p[0] + p[1] + p[2]).sum::<f32>() / (3 * truth.len()) as f32;
    let exposure = 0.25 / mean.max(1e-30);
    let write = |file: &str, pixels: &[[f32; 3]], exposure| {
        files::write_png_rgb(&folder.join(file), width, height, pixels, exposure)
    };
    write("result.png", &rgb(&found), exposure)?;
    write("truth.png", &rgb(&truth), exposure)?;
    let enlarged: Vec<[f32; 3]> = found
        .iter()
        .zip(&truth)
        .map(|(f, t)| {
            let d = 4.0 * (f[0] + f[1] + f[2] - t[0] - t[1] - t[2]) / 3.0;
            [d.max(0.0), 0.0, (-d).max(0.0)]
        })
        .collect();
    write("difference.png", &enlarged, exposure)?;

    let mut edges = rgb(&found);
    let segments: Vec<HullSegment> = gpu.read_buffer(renderer.view.segments());
    let fallbacks = size.segments as usize..(size.segments + counts.fallbacks) as usize;
    let regular = segments[..counts.segments.min(size.segments) as usize]
        .iter()
        .map(|s| (s, [0.0, 0.6, 0.1]));
    let last = segments[fallbacks].iter().map(|s| (s, [0.9, 0.0, 0.0]));
    for (segment, color) in regular.chain(last) {
        let [left, top, right, bottom] = segment.rect;
        for y in top..bottom {
            for x in left..right {
                if x == left || y == top || x + 1 == right || y + 1 == bottom {
                    edges[(y * width + x) as usize] = color.map(|c| c / exposure);
                }
            }
        }
    }
    write("hull.png", &edges, exposure)
}

fn camera(scene: &Scene, width: u32, height: u32) -> Result<Camera, deep_screen_space::Error> {
    let view = &scene.views[0];
    Camera::look_at(
        view.eye.into(),
        view.target.into(),
        DVec3::from(view.up),
        perspective(
            view.vertical_fov_degrees,
            f64::from(width) / f64::from(height),
            view.near,
        ),
        Viewport::full(width, height),
    )
}

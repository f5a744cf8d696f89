//! `--effect sg`: one bounce from a reflective shadow map, gathered on the hull.

use std::path::PathBuf;

use deep_screen_space::{Components, SgHullSize, scenes::Scene};
use serde_json::json;

use super::{Options, view::Shot};
use support::{
    files,
    gpu::Gpu,
    hull::{HullRenderer, LightSource, difference},
    raster::Raster,
    scene::SceneBuffers,
};

/// Writes `sg.exr`, `sg.png` and `stats.json`; with `--reference` the light gathered at every pixel too.
pub fn render(gpu: &Gpu, options: &Options, scene: &Scene, shot: &Shot) -> Result<(), String> {
    let error = |e: deep_screen_space::Error| e.to_string();
    let camera = shot.camera()?;
    let buffers = SceneBuffers::new(gpu, scene);
    let raster = Raster::draw(gpu, &buffers, &camera);
    let size = SgHullSize::new(shot.width, shot.height);
    let mut renderer = HullRenderer::new(gpu, size, Components::default()).map_err(error)?;
    let looks = [shot.eye, shot.target];
    let lamp = LightSource::seen(scene, shot.lights.first(), looks).map_err(error)?;
    let lights = renderer
        .lights(gpu, &buffers, &lamp, camera.eye())
        .map_err(error)?;
    let mut picture = (0.0, Vec::new());
    // Drivers compile a pipeline when it first runs.
    for _ in 0..2 {
        picture = renderer
            .render(gpu, &raster, &camera, &lights)
            .map_err(error)?;
    }
    let (ms, pixels) = picture;
    let png = write(options, shot, &pixels, "")?;
    let counts = renderer.counts(gpu);
    println!(
        "{}: {} vertices, {ms:.1} ms on {}",
        png.display(),
        counts.vertices(),
        gpu.name()
    );
    let overflow = counts.overflow(&size);
    if overflow > 0 {
        println!("{overflow} segments more found no room");
    }
    let stats = json!({
        "adapter": gpu.adapter.name,
        "driver": gpu.adapter.driver_info,
        "width": shot.width,
        "height": shot.height,
        "effect": options.effect,
        "total_ms": ms,
        "segments": counts.segments,
        "segment_overflow": overflow,
        "vertices": counts.vertices(),
        "fallback_pixels": counts.fallback_pixels,
        "memory_bytes": renderer.view.memory_bytes(),
    });
    let path = options.out.join("stats.json");
    let text = serde_json::to_string_pretty(&stats).map_err(|e| e.to_string())?;
    std::fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
    if options.reference.is_some() {
        let (ms, truth) = renderer
            .render_per_pixel(gpu, &raster, &camera, &lights)
            .map_err(error)?;
        write(options, shot, &truth, "_reference")?;
        let off = difference(&pixels, &truth, shot.width);
        println!(
            "against every pixel ({ms:.1} ms): RMSE {:.2} % of the mean, energy {:+.2} %, 99.99th percentile of the ratio \
             {:.2}, SSIM {:.4}",
            100.0 * off.rmse,
            100.0 * off.energy,
            off.ratio,
            off.ssim
        );
    }
    Ok(())
}

fn write(
    options: &Options,
    shot: &Shot,
    pixels: &[[f32; 4]],
    suffix: &str,
) -> Result<PathBuf, String> {
    let path = |kind: &str| options.out.join(format!("sg{suffix}.{kind}"));
    let colors: Vec<_> = pixels.iter().map(|p| [p[0], p[1], p[2]]).collect();
    files::write_exr_rgb(&path("exr"), shot.width, shot.height, &colors)?;
    let png = path("png");
    files::write_png_rgb(&png, shot.width, shot.height, &colors, 2.0)?;
    Ok(png)
}

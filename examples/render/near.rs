//! Effects of the near field, which read the G-buffer alone.

use deep_screen_space::{CloudCapacity, Error, SurfelCounts, scenes::Scene};
use serde_json::{Value, json};

use super::{
    Options,
    methods::{Rendered, twice},
    view::Shot,
};
use support::{
    errors::rmse,
    gpu::Gpu,
    lights::beside,
    multires::{Masked, read_image},
    near::{Effect, Passes, Stage},
    scene::SceneBuffers,
};

/// Of what reads the G-buffer alone: there is no cloud.
fn rendered(
    pixels: Vec<[f32; 3]>,
    buffers: &SceneBuffers,
    passes: Vec<(&'static str, f64)>,
    settings: Value,
) -> Rendered {
    Rendered {
        pixels,
        triangles: buffers.triangles(),
        capacity: CloudCapacity {
            surfels: 0,
            pieces: 0,
            triangles: 0,
        },
        counts: SurfelCounts::default(),
        surfels_made: false,
        passes,
        memory_bytes: 0,
        settings,
        sky: None,
    }
}

/// How many samples per pixel an effect takes: of obscurance the preset says it, of the others the paper.
fn samples(effect: Effect, preset: &str) -> u32 {
    match (effect, preset) {
        (Effect::Obscurance, "fast") => 12,
        (Effect::Obscurance, "balanced") => 33,
        _ => effect.samples(),
    }
}

/// An effect at full resolution, or with `--multires` the same by sub-images.
pub fn of_pixels(
    gpu: &Gpu,
    options: &Options,
    scene: &Scene,
    shot: &Shot,
    effect: Effect,
) -> Result<Rendered, String> {
    let error = |e: Error| e.to_string();
    let camera = shot.camera()?;
    let buffers = SceneBuffers::new(gpu, scene);
    // Where there is no light, one beside the camera.
    let light = shot
        .lights
        .first()
        .copied()
        .unwrap_or_else(|| beside(shot.eye, shot.target, shot.up));
    let passes = Passes::new(&gpu.device).map_err(error)?;
    let mut stage = Stage::of(gpu, &passes, scene, &buffers, &camera, light).map_err(error)?;
    if let Some(radius) = options.radius {
        stage.reach = radius;
        stage.obscurance_radius = radius;
    }
    let size = stage.size();
    let samples = samples(effect, &options.preset);
    let what = (effect, samples);
    let full = gpu.storage(effect.format(), size[0], size[1]);
    let of_all = || {
        let (ms, done) =
            gpu.time(|encoder| passes.record(&stage, encoder, what, None, full.texture()));
        done.map(|()| ms)
    };
    let full_ms = twice(of_all, |ms| *ms)?;
    let image = read_image(gpu, full.texture());
    let radius = match effect {
        Effect::Obscurance => stage.obscurance_radius,
        _ => stage.reach,
    };
    if !options.multires {
        let settings = json!({ "samples": samples, "radius": radius });
        return Ok(rendered(
            image,
            &buffers,
            vec![(effect.name(), full_ms)],
            settings,
        ));
    }
    let mut masked = Masked::new(gpu, &passes, effect, effect.mask(), size).map_err(error)?;
    let of_parts = || {
        let (mask_ms, done) = gpu.time(|e| masked.record_masks(&passes, &stage, e));
        done?;
        let (images_ms, done) = gpu.time(|e| masked.record_images(&passes, &stage, e, samples));
        done?;
        let (blend_ms, done) = gpu.time(|e| masked.record_blend(&stage, e));
        done?;
        Ok(vec![
            ("masks", mask_ms),
            ("sub-images", images_ms),
            ("blend", blend_ms),
        ])
    };
    let times = twice(of_parts, |times| times.iter().map(|t| t.1).sum())?;
    let computed: u32 = masked.counts(gpu).iter().sum();
    let share = f64::from(computed) / f64::from(size[0] * size[1]);
    let pixels = read_image(gpu, masked.target.texture());
    let off = rmse(image.as_flattened(), pixels.as_flattened());
    println!(
        "{:.1} % of the pixels computed; at full resolution {full_ms:.1} ms, RMSE {off:.4}",
        100.0 * share
    );
    let settings = json!({
        "samples": samples,
        "radius": radius,
        "computed_share": share,
        "full_ms": full_ms,
        "rmse": off,
    });
    Ok(rendered(pixels, &buffers, times, settings))
}

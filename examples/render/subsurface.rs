//! Subsurface scattering of one of a scene's materials.

use deep_screen_space::{
    Scattering, SubsurfaceScattering,
    glam::DVec3,
    reference::{
        light::arrival,
        trace::{ColorEstimate, Receiver, Tracer},
    },
    scenes::{Material, Scene},
};
use serde_json::json;

use super::{
    Options,
    methods::{Rendered, Splat, splat_of},
    view::Shot,
};
use support::{gpu::Gpu, presets};

/// Points of the body for each ray per pixel that `--reference` asks for: 2 million for the usual 256.
const POINTS: u32 = 8192;

/// The share of what comes out that is farther from where it entered than what the truth takes in.
const LEFT_OUT: f64 = 1e-4;

fn scattering(options: &Options) -> Result<Scattering, String> {
    let named = Scattering::by_name(&options.material);
    let scattering = named.ok_or_else(|| format!("there is no material {}", options.material))?;
    let scattering = scattering.scaled(options.millimetres);
    scattering.validate().map_err(|e| e.to_string())?;
    Ok(scattering)
}

/// How strong the brightest light is where the camera looks, W/m².
fn unit(shot: &Shot) -> f32 {
    let lights = shot.lights.iter();
    let brightest = lights.map(|light| arrival(light, shot.target).irradiance.max_element());
    brightest.fold(0.0, f64::max).clamp(1e-18, 1e18) as f32
}

/// The scene with its materials white where they scatter, and black elsewhere: what surfels send, and what pixels receive.
fn masked(options: &Options, scene: &Scene) -> Result<Scene, String> {
    let number = options.scatters as usize;
    if number >= scene.materials.len() {
        return Err(format!(
            "--scatters is {number}, but there are {} materials",
            scene.materials.len()
        ));
    }
    let table = SubsurfaceScattering::senders(scene.materials.len(), |of| of == number);
    let materials = table.into_iter().map(|material| Material {
        albedo: material.albedo,
        emission: [0.0; 3],
        double_sided: false,
    });
    Ok(Scene {
        materials: materials.collect(),
        ..scene.clone()
    })
}

/// Splats what comes out of the body, where the camera sees it.
pub fn render(
    gpu: &Gpu,
    options: &Options,
    scene: &Scene,
    shot: &Shot,
) -> Result<Rendered, String> {
    let effect = SubsurfaceScattering {
        unit: unit(shot),
        ..SubsurfaceScattering::new(scattering(options)?)
    };
    let camera = shot.camera()?;
    let pixel = camera.footprint().at(shot.target - camera.eye());
    let quality = presets::quality(&options.preset).ok_or("no such preset")?;
    let what = Splat {
        effect: &effect.effect().map_err(|e| e.to_string())?,
        preset: effect.splats(quality, pixel as f32),
    };
    let settings = json!({ "material": options.material, "pixel": pixel });
    splat_of(
        gpu,
        options,
        &masked(options, scene)?,
        shot,
        (what, settings),
    )
}

/// The brute-force dipole at each pixel that shows the material.
pub fn truth(
    options: &Options,
    scene: &Scene,
    shot: &Shot,
    (tracer, receivers): (&Tracer, &[Option<Receiver>]),
    rays: u32,
) -> Result<Vec<Option<ColorEstimate>>, String> {
    let scattering = scattering(options)?;
    let masked = masked(options, scene)?;
    let materials = masked.triangle_materials();
    let scatters = |triangle: usize| materials[triangle].albedo[0] > 0.0;
    let points = tracer.lit_points(scatters, &shot.lights, rays.saturating_mul(POINTS));
    let shown = shot.albedo(&masked, tracer);
    let receivers: Vec<Option<Receiver>> = receivers
        .iter()
        .zip(&shown)
        .map(|(receiver, shown)| receiver.filter(|_| shown.x > 0.0))
        .collect();
    let reach = scattering.reach(LEFT_OUT);
    let image = Tracer::subsurface_scattering_image(&receivers, &points, &scattering, reach, true);
    let exact = |mean: DVec3| ColorEstimate {
        mean,
        standard_error: DVec3::ZERO,
    };
    Ok(image.into_iter().map(|mean| mean.map(exact)).collect())
}

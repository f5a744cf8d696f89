//! Which method and settings meet an error or a time, here and in this scene:
//! `cargo run --release --example plan -- [SCENE] (--error 0.03 | --milliseconds 50) [--effect ao|do|bent|gi|specular]
//! [--size 640x400]`.
//!
//! SCENE is one of the crate's. Renders a few pictures of it to see what this machine takes and how hard the scene is, and
//! prints all that was weighed, errors, times and memory, with a mark at what was chosen.

use std::process::ExitCode;

use clap::Parser;
use deep_screen_space::{
    Light, RayTracedEffect,
    glam::DVec3,
    planner::{Budget, PlanRequest, SceneCounts, plan},
    scenes,
};
use support::{
    bench::parse_size,
    calibration::{Subject, calibrate},
    gpu::{Ask, Gpu},
    raster::{Raster, camera_of},
    scene::SceneBuffers,
    sky,
};

/// Which method and settings meet an error or a time, here and in this scene.
#[derive(Parser)]
struct Options {
    /// One of the crate's scenes.
    #[arg(default_value = "colonnade")]
    scene: String,
    /// The largest error: root mean square of visibility, 0 to 1, or of light in units of its mean; of bent normals the mean
    /// angle in degrees, where their cone is narrower than 60°.
    #[arg(
        long,
        conflicts_with = "milliseconds",
        required_unless_present = "milliseconds"
    )]
    error: Option<f64>,
    /// The longest time of a frame.
    #[arg(long)]
    milliseconds: Option<f64>,
    /// Ambient occlusion, directional occlusion, bent normals, or one bounce of diffuse or of glossy light.
    #[arg(long, default_value = "ao", value_parser = ["ao", "do", "bent", "gi", "specular"])]
    effect: String,
    /// The sky of `--effect do`: `dim`, `sunny` or a file, as the example `render` takes it.
    #[arg(long, default_value = "sunny")]
    sky: String,
    /// Perceptual roughness of all surfaces, 0 to 1, for `--effect specular`.
    #[arg(long, default_value_t = 0.3)]
    roughness: f32,
    /// Beyond it nothing occludes; without, what suits the scene.
    #[arg(long)]
    radius: Option<f32>,
    /// Of the picture to plan for.
    #[arg(long, default_value = "640x400", value_parser = parse_size)]
    size: [u32; 2],
}

/// Pictures that a calibration renders.
const SIZE: [u32; 2] = [320, 200];

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("plan: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    let name = &options.scene;
    let scene = scenes::by_name(name).ok_or_else(|| format!("there is no scene {name}"))?;
    if !(0.0..=1.0).contains(&options.roughness) {
        return Err(format!("--roughness is {}, not 0 to 1", options.roughness));
    }
    let radius = options.radius.unwrap_or(scene.ao_radius);
    let sky_radiance = [0.0; 3];
    let effect = match options.effect.as_str() {
        "do" => RayTracedEffect::DirectionalOcclusion { radius },
        "bent" => RayTracedEffect::BentNormals { radius },
        "gi" => RayTracedEffect::IndirectDiffuse { sky_radiance },
        "specular" => RayTracedEffect::IndirectSpecular { sky_radiance },
        _ => RayTracedEffect::AmbientOcclusion { radius },
    };
    let budget = match (options.error, options.milliseconds) {
        (Some(error), _) => Budget::Error(error),
        (_, milliseconds) => Budget::Milliseconds(milliseconds.unwrap_or_default()),
    };
    let gpu = Gpu::open(Ask::room_from_env()?)?;
    let most = gpu.device.limits().max_texture_dimension_2d;
    let sky = (options.effect == "do").then(|| sky::open(&options.sky, most));
    let sky = sky.transpose()?;
    let buffers = SceneBuffers::new(&gpu, &scene);
    let camera = camera_of(&scene, SIZE);
    let sun = Light::Directional {
        direction: DVec3::new(0.3, -1.0, 0.2),
        irradiance: [3.0; 3],
    };
    let calibration = calibrate(
        &Subject {
            gpu: &gpu,
            size: SIZE,
            camera: &camera,
            buffers: &buffers,
            drawn: &Raster::draw(&gpu, &buffers, &camera),
            lights: &[sun],
            sky: sky.as_ref(),
            roughness: options.roughness,
        },
        &effect,
    )?;
    let plan = plan(&PlanRequest {
        limits: &gpu.device.limits(),
        size: options.size,
        scene: SceneCounts::once(buffers.triangles().into()),
        effect,
        budget,
        calibration: Some(&calibration),
    })
    .map_err(|e| e.to_string())?;
    println!("{}, {}x{}", gpu.name(), options.size[0], options.size[1]);
    print!("{plan}");
    Ok(())
}

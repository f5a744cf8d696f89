//! Which method and settings meet an error or a time, here and in this scene:
//! `cargo run --release --example plan -- [SCENE] (--error 0.03 | --milliseconds 50) [--effect ao|gi] [--size 640x400]`.
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
};

/// Which method and settings meet an error or a time, here and in this scene.
#[derive(Parser)]
#[command(about)]
struct Options {
    /// One of the crate's scenes.
    #[arg(default_value = "colonnade")]
    scene: String,
    /// The largest root mean square error: of visibility, 0 to 1; of light in units of its mean.
    #[arg(
        long,
        conflicts_with = "milliseconds",
        required_unless_present = "milliseconds"
    )]
    error: Option<f64>,
    /// The longest time of a frame.
    #[arg(long)]
    milliseconds: Option<f64>,
    /// Ambient occlusion, or one bounce of light.
    #[arg(long, default_value = "ao", value_parser = ["ao", "gi"])]
    effect: String,
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
    let effect = match options.effect.as_str() {
        "gi" => RayTracedEffect::IndirectDiffuse {
            sky_radiance: [0.0; 3],
        },
        _ => RayTracedEffect::AmbientOcclusion {
            radius: options.radius.unwrap_or(scene.ao_radius),
        },
    };
    let budget = match (options.error, options.milliseconds) {
        (Some(error), _) => Budget::Error(error),
        (_, milliseconds) => Budget::Milliseconds(milliseconds.unwrap_or_default()),
    };
    let gpu = Gpu::open(Ask::room_from_env()?)?;
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

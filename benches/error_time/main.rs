//! Error against time of ambient occlusion and of indirect light, method by method and a knob at a time:
//! `cargo bench --bench error_time`.
//!
//! Renders one view of each of the crate's scenes, within the scene's radius and without one: by splatting with the preset
//! `balanced`, with one setting after the other turned away from it, by the bounced z-buffer likewise, and by what a depth buffer
//! alone allows, with ever more slices and taps. Errors are against rays traced through the same pixels, with the rays' own noise
//! taken out. Times are of one submission per pass, the fastest of a few runs: the processor's where the driver is software
//! (`examples/support/stopwatch.rs`), or else wall clock. They count only beside each other, so
//! every one is given as a ratio to `balanced` in the same view too. Each row's `work` is the part of the cost that is the same
//! on every machine: for splatting the surfel-pixel pairs that were evaluated, for the bounced z-buffer the bounds and runs of
//! triangles that rays were tested against.
//!
//! `depth_alone_rmse` is what exact rays find against the surface that the pixels themselves form, with nothing behind it.
//! It bounds no method that guesses what is behind: horizons take all of it for solid, and are right where it is.
//!
//! Light that has bounced once is measured likewise, in units of its mean over the picture: by the bounced z-buffer, its
//! hits lit where they are, and by rays marched through the depth buffer of a picture whose direct light is given exactly.
//! Where anything shines of itself the knob `at lamps` has as many rays, a part of them aimed there. Times are in units of the
//! bounced z-buffer's `balanced` there.
//!
//! Prints a table and writes the same rows to `target/bench/error-time.json` and `target/bench/error-time.csv` (in JSON, null is
//! infinity), and pictures of means over scenes: `error-time-radius.png` and `error-time-unbounded.png`, one line per method,
//! `error-time-light.png` for light, and `error-time-settings.png`, one line per knob of the splatter.

mod bounced;
mod canvas;
mod chart;
mod checks;
mod horizon;
mod light;
mod method;
mod splat;
mod table;

use std::{path::Path, process::ExitCode};

use bounced::Bounced;
use clap::Parser;
use deep_screen_space::scenes;
use horizon::Horizon;
use light::{AimedLight, BouncedLight, Marched, SplatLight};
use method::{Measurement, Method};
use splat::Splat;
use support::bench;
use support::gpu::{Ask, Gpu};
use support::lights::is_emissive;
use support::stage::{Effect, Effort, Stage};
use table::Row;

/// Error against time of ambient occlusion, method by method and a knob at a time.
#[derive(Parser)]
// Switches of a command line.
#[allow(clippy::struct_excessive_bools)]
struct Options {
    /// Two scenes, small pictures, fewer rays and one run per setting: to see that it works.
    #[arg(long)]
    quick: bool,
    /// One of the crate's scenes in place of all.
    #[arg(long)]
    scene: Option<String>,
    /// One bounce of light alone, without occlusion: its picture, and no other file.
    #[arg(long)]
    light: bool,
    /// All combinations of surfel radius, epsilon and levels too, and which of them no other beats. Takes long.
    #[arg(long)]
    grid: bool,
    /// What cargo adds; without a meaning here.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("error_time: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    let effort = if options.quick {
        Effort {
            size: [144, 96],
            rays: 16,
            runs: 1,
        }
    } else {
        Effort {
            size: [256, 160],
            rays: 32,
            runs: 2,
        }
    };
    let scenes = match &options.scene {
        Some(name) => {
            vec![scenes::by_name(name).ok_or_else(|| format!("there is no scene {name}"))?]
        }
        None if options.quick => ["cornell", "dominoes"]
            .iter()
            .filter_map(|n| scenes::by_name(n))
            .collect(),
        None => scenes::all(),
    };
    let gpu = Gpu::open(Ask::from_env())?;
    checks::run(&gpu)?;
    let [width, height] = effort.size;
    let rays = effort.rays;
    println!(
        "{}, {width}x{height} pixels, {rays} rays per pixel\n",
        gpu.name()
    );
    Row::print_header();
    let mut rows = Vec::new();
    for scene in &scenes {
        let stage = Stage::new(&gpu, &effort, (scene, &scene.views[0]))?;
        if !options.light {
            occlusion(&stage, options, &mut rows)?;
        }
        let truth = stage.light_truth();
        let level = truth.level;
        let mut bounced = BouncedLight::new(&stage, level)?;
        let mut splat = SplatLight::new(&stage, level)?;
        let mut marched = Marched::new(&stage, level);
        let mut measurement = Measurement {
            stage: &stage,
            effect: Effect::Gi,
            radius: f32::INFINITY,
            truth,
            grid: options.grid,
            unit_ms: None,
            rows: &mut rows,
        };
        measurement.of(&mut bounced)?;
        measurement.of(&mut splat)?;
        measurement.of(&mut marched)?;
        if is_emissive(scene) {
            measurement.of(&mut AimedLight::new(level))?;
        }
    }
    if options.light {
        return report_light(&rows);
    }
    report(&rows)
}

/// Of a view, within the scene's radius and without one.
fn occlusion(stage: &Stage<'_>, options: &Options, rows: &mut Vec<Row>) -> Result<(), String> {
    let mut splat = Splat::new(stage)?;
    let mut bounced = Bounced::new(stage)?;
    let mut horizon = Horizon::new(stage);
    for radius in [stage.scene.ao_radius, f32::INFINITY] {
        let mut measurement = Measurement {
            stage,
            effect: Effect::Ao,
            radius,
            truth: stage.truth(radius)?,
            grid: options.grid,
            unit_ms: None,
            rows,
        };
        // All times are relative to the first.
        measurement.of(&mut splat)?;
        measurement.of(&mut bounced)?;
        measurement.of(&mut horizon)?;
    }
    Ok(())
}

/// Writes the files, and prints what no other setting beats.
fn report(rows: &[Row]) -> Result<(), String> {
    let folder = bench::folder()?;
    bench::write_rows("error-time", rows)?;
    save(&folder.join("error-time.csv"), &table::csv(rows)?)?;
    let mut knobs = Vec::new();
    for (title, name, bounded) in [
        ("occluders within each scene's radius", "radius", true),
        ("occluders at any distance", "unbounded", false),
    ] {
        let belongs = |r: &&Row| r.effect == Effect::Ao && r.ao_radius.is_finite() == bounded;
        let rows: Vec<&Row> = rows.iter().filter(belongs).collect();
        let methods = table::method_panel(title, &rows);
        println!();
        table::print_best(&methods);
        table::print_scenes(&rows);
        let path = folder.join(format!("error-time-{name}.png"));
        chart::write(&path, &[methods])?;
        println!("{}", path.display());
        let panel = table::knob_panel(title, &rows, Splat::NAME);
        println!("\nsplat alone");
        table::print_best(&panel);
        knobs.push(panel);
    }
    report_light(rows)?;
    chart::write(&folder.join("error-time-settings.png"), &knobs)?;
    println!("{}", folder.join("error-time-settings.png").display());
    Ok(())
}

/// The picture of light.
fn report_light(rows: &[Row]) -> Result<(), String> {
    let rows: Vec<&Row> = rows.iter().filter(|r| r.effect == Effect::Gi).collect();
    let light = table::method_panel("one bounce of light, relative to its mean", &rows);
    println!();
    table::print_best(&light);
    table::print_scenes(&rows);
    let path = bench::folder()?.join("error-time-light.png");
    chart::write(&path, &[light])?;
    println!("{}", path.display());
    Ok(())
}

fn save(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))
}

//! The curves that `deep_screen_space::planner` plans by, and how well it does: `cargo bench --bench trade`.
//!
//! Renders the rungs that plans choose among, by each method, in each view; errors are against traced rays, times the processor's
//! on software drivers. Prints what `src/planner/curves.rs` holds, fitted to the crate's own scenes, and then, on scenes that it
//! was not fitted on, what plans predict beside what was measured: `cargo bench --bench trade -- SCENE.glb --cameras FILE` takes
//! those of the files with the table that the crate has; without files each of the crate's scenes is predicted by a table of the
//! others (errors alone, as times need no table). Writes `target/bench/trade.json`, view by view.
//!
//! `--effect` takes one curve alone, with a file of its own: `within` and `unbounded` of ambient occlusion, `light` of one
//! diffuse bounce, `sky` of what a sky with a small sun gives, `bent` of bent normals, and `glossy` of a glossy bounce of
//! roughness 0.3 and of 1. The last three are told with a reference that the passes render themselves
//! (`support::calibration::Reference`), and their errors are of a third of the pixels, but for those drawn and cast apart.

mod check;
mod fit;
mod measure;

use std::{collections::BTreeMap, fs::File, path::PathBuf, process::ExitCode};

use clap::Parser;
use deep_screen_space::{
    glam::DVec3,
    scenes::{self, Scene, View},
};
use measure::Measured;
use serde::Deserialize;
use support::{
    bench,
    gltf::load_gltf,
    gpu::{Ask, Gpu},
    stage::{Effort, Stage},
};

/// What plans are made of, and how good they are.
#[derive(Parser)]
struct Options {
    /// glTF files whose views are predicted by the table that the crate has; without, the crate's own scenes, which a table is
    /// fitted to.
    scenes: Vec<PathBuf>,
    /// A JSON file of cameras by scene, as the example `render` reads them.
    #[arg(long)]
    cameras: Option<PathBuf>,
    /// One curve in place of all, with its rows in `target/bench/trade-CURVE.json`.
    #[arg(long, value_parser = measure::CURVES)]
    effect: Option<String>,
    /// Of the pictures.
    #[arg(long, default_value = "256x160", value_parser = bench::parse_size)]
    size: [u32; 2],
    /// Two scenes and small pictures: to see that it works.
    #[arg(long)]
    quick: bool,
    /// What cargo adds; without a meaning here.
    #[arg(long, hide = true)]
    bench: bool,
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
    ao_radius: BTreeMap<String, Option<f32>>,
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("trade: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    let gpu = Gpu::open(Ask::room_from_env()?)?;
    let effort = Effort {
        size: if options.quick {
            [96, 64]
        } else {
            options.size
        },
        rays: if options.quick { 16 } else { 64 },
        runs: 2,
    };
    println!("{}, {:?} pixels", gpu.name(), effort.size);
    let views = if options.scenes.is_empty() {
        own(options.quick)
    } else {
        from_files(options)?
    };
    let asked = |curve: &&str| options.effect.as_ref().is_none_or(|only| only == curve);
    let curves: Vec<&str> = measure::CURVES.into_iter().filter(asked).collect();
    let rows = options.effect.as_ref();
    let rows = rows.map_or_else(|| "trade".into(), |curve| format!("trade-{curve}"));
    let bar = bench::progress(views.len());
    let mut all: Vec<Measured> = Vec::new();
    for (name, scene, view) in &views {
        let stage = Stage::new(&gpu, &effort, (scene, view))?;
        let measured = bar.suspend(|| measure::measure(&stage, name, &curves))?;
        all.extend(measured);
        bench::write_rows(&rows, &all)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    if options.scenes.is_empty() {
        fit::print(&all);
        check::left_out(&all);
    } else {
        check::errors(&all, None);
    }
    check::times(&all);
    check::budgets(&all);
    Ok(())
}

type Named = (String, Scene, View);

/// The crate's scenes, seen by their first view.
fn own(quick: bool) -> Vec<Named> {
    let all = if quick {
        ["cornell", "dominoes"]
            .iter()
            .filter_map(|name| scenes::by_name(name))
            .collect()
    } else {
        scenes::all()
    };
    all.into_iter()
        .map(|scene| {
            let view = scene.views[0];
            (scene.name.to_owned(), scene, view)
        })
        .collect()
}

/// Files' scenes, about the middle of their boxes, seen by each of their cameras.
fn from_files(options: &Options) -> Result<Vec<Named>, String> {
    let path = options.cameras.as_ref().ok_or("files need --cameras")?;
    let file = File::open(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let cameras: BTreeMap<String, Vec<Shot>> =
        serde_json::from_reader(file).map_err(|e| format!("{}: {e}", path.display()))?;
    let mut views = Vec::new();
    for path in &options.scenes {
        let world = load_gltf(path)?.world;
        let (low, high) = world.bounds();
        let origin = 0.5 * (low + high);
        let whole = world.relative_to(origin)?;
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let shots = cameras
            .get(&*stem)
            .ok_or_else(|| format!("there are no cameras of {stem}"))?;
        for shot in shots {
            let mut scene = whole.clone();
            let finite = shot.ao_radius.values().flatten().copied();
            scene.ao_radius = finite.fold(f32::INFINITY, f32::min);
            let relative = |point: [f64; 3]| (DVec3::from(point) - origin).to_array();
            let view = View {
                name: "",
                eye: relative(shot.eye),
                target: relative(shot.target),
                up: shot.up,
                vertical_fov_degrees: shot.vfov_deg,
                near: shot.near,
            };
            views.push((format!("{stem}/{}", shot.name), scene, view));
        }
    }
    Ok(views)
}

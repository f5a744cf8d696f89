//! Error against time of splatted ambient occlusion, a knob at a time: `cargo bench --bench trade`.
//!
//! Renders one view of each of the crate's scenes, within the scene's radius and without one, and turns one setting after
//! the other away from the preset `balanced`. Errors are against rays traced through the same pixels, with the rays' own
//! noise taken out. Times are wall clock, a submission a pass, the fastest of a few runs; they count only beside each
//! other, so every one is given as a ratio to `balanced` in the same view too. The count of surfel-pixel pairs that were
//! evaluated is the part of the cost that is the same on every machine.
//!
//! `depth_alone_rmse` is the best that a method could do which knows the depth buffer and nothing else: rays traced
//! against the surface that the pixels themselves form.
//!
//! Prints a table and writes the same rows to `target/bench/trade.json` and `target/bench/trade.csv` (in JSON, null is
//! infinity), and the picture `target/bench/trade.png`: means over scenes.

#[path = "support/canvas.rs"]
mod canvas;
#[path = "support/chart.rs"]
mod chart;
#[path = "../examples/support/mod.rs"]
mod support;

use std::{collections::HashMap, fmt::Write as _, path::Path, process::ExitCode};

use chart::{Panel, Point};
use clap::Parser;
use deep_screen_space::{
    AmbientOcclusion, Camera, CloudCapacity, Overlap, Viewport,
    reference::{
        gbuffer,
        trace::{Estimate, Receiver, Tracer},
    },
    scenes::{self, Scene},
};
use serde::Serialize;
use support::{
    ambient_occlusion::{Rendered, Renderer},
    gpu::{Ask, Gpu},
    presets::{self, Preset},
    raster::{self, Raster},
    scene::SceneBuffers,
};

/// Room for the finest settings at these sizes; a row says if it was too little.
const CAPACITY: u32 = 1 << 18;

/// The most levels that a variant asks for.
const MAX_LEVELS: u32 = 6;

/// Error against time of splatted ambient occlusion.
#[derive(Parser)]
#[command(about)]
struct Options {
    /// Two scenes, small pictures, fewer rays and one run a setting: to see that it works.
    #[arg(long)]
    quick: bool,
    /// One of the crate's scenes in place of all.
    #[arg(long)]
    scene: Option<String>,
    /// All combinations of surfel radius, epsilon and levels too, and which of them no other beats. Takes long.
    #[arg(long)]
    grid: bool,
    /// What cargo adds; without a meaning here.
    #[arg(long, hide = true)]
    bench: bool,
}

/// How much work to put into the figures.
struct Effort {
    size: [u32; 2],
    rays: u32,
    runs: u32,
}

/// One setting of everything.
#[derive(Clone)]
struct Variant {
    knob: &'static str,
    value: String,
    preset: Preset,
    overlap: Overlap,
}

/// One line of the table.
#[derive(Clone, Serialize)]
struct Row {
    adapter: String,
    scene: &'static str,
    view: &'static str,
    width: u32,
    height: u32,
    ao_radius: f32,
    knob: &'static str,
    value: String,
    radius_pixels: f32,
    density: f32,
    epsilon: f32,
    levels: u32,
    overlap: String,
    surfels: u32,
    surfel_overflow: u32,
    pairs: u32,
    rmse: f64,
    bias: f64,
    depth_alone_rmse: f64,
    ms: f64,
    ms_of_balanced: f64,
    surfelize_ms: f64,
    cluster_ms: f64,
    splat_ms: f64,
    reconstruct_ms: f64,
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
    println!(
        "{}, {}x{} pixels, {} rays a pixel\n",
        gpu.name(),
        effort.size[0],
        effort.size[1],
        effort.rays
    );
    println!(
        "{:12} {:>6} {:>8} {:>12} {:>8} {:>8} {:>8} {:>9} {:>9} {:>11}",
        "scene",
        "radius",
        "knob",
        "value",
        "surfels",
        "RMSE",
        "bias",
        "Mpairs",
        "ms",
        "of balanced"
    );
    let mut rows = Vec::new();
    for scene in &scenes {
        let mut stage = Stage::new(&gpu, &effort, scene)?;
        for radius in [scene.ao_radius, f32::INFINITY] {
            stage.measure(radius, options.grid, &mut rows)?;
        }
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/bench");
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let json = serde_json::to_string_pretty(&rows).map_err(|e| e.to_string())?;
    save(&folder.join("trade.json"), &json)?;
    save(&folder.join("trade.csv"), &csv(&rows)?)?;
    let panels = [
        panel("occluders within each scene's radius", &rows, |r| {
            r.ao_radius.is_finite()
        }),
        panel("occluders at any distance", &rows, |r| {
            r.ao_radius.is_infinite()
        }),
    ];
    chart::write(&folder.join("trade.png"), &panels)?;
    println!();
    for panel in &panels {
        summarize(panel);
    }
    println!("{}", folder.join("trade.png").display());
    Ok(())
}

/// A scene's first view with its G-buffer, renderers and rays.
struct Stage<'g> {
    gpu: &'g Gpu,
    effort: &'g Effort,
    scene: &'g Scene,
    camera: Camera,
    buffers: SceneBuffers,
    drawn: Raster,
    tracer: Tracer,
    receivers: Vec<Option<Receiver>>,
    add: Renderer,
    independent: Renderer,
    /// Counts pairs, and is slower for it.
    counting: Renderer,
}

/// The traced truth of a view within a radius.
struct Truth {
    estimates: Vec<Option<Estimate>>,
    depth_alone_rmse: f64,
}

impl<'g> Stage<'g> {
    fn new(gpu: &'g Gpu, effort: &'g Effort, scene: &'g Scene) -> Result<Self, String> {
        let view = &scene.views[0];
        let [width, height] = effort.size;
        let aspect = f64::from(width) / f64::from(height);
        let camera = Camera::look_at(
            view.eye.into(),
            view.target.into(),
            view.up.into(),
            raster::perspective(view.vertical_fov_degrees, aspect, view.near),
            Viewport::full(width, height),
        )
        .map_err(|e| e.to_string())?;
        let buffers = SceneBuffers::new(gpu, scene);
        let tracer = Tracer::new(&scene.positions, &scene.indices).map_err(|e| e.to_string())?;
        let capacity = CloudCapacity {
            surfels: CAPACITY,
            pieces: buffers.triangles() + 100_000,
            triangles: buffers.triangles(),
        };
        let renderer = |overlap, counting| {
            let effect = AmbientOcclusion {
                overlap,
                ..AmbientOcclusion::default()
            };
            Renderer::new(gpu, effect, capacity, effort.size, MAX_LEVELS, counting)
                .map_err(|e| e.to_string())
        };
        Ok(Self {
            gpu,
            effort,
            scene,
            drawn: Raster::draw(gpu, &buffers, &camera),
            receivers: gbuffer::receivers(
                &camera,
                &tracer,
                &scene.positions,
                &scene.normals,
                &scene.indices,
            ),
            add: renderer(Overlap::Add, false)?,
            independent: renderer(Overlap::Independent, false)?,
            counting: renderer(Overlap::Add, true)?,
            camera,
            buffers,
            tracer,
        })
    }

    /// Renders all variants, each that several knobs have in common once.
    fn measure(&mut self, radius: f32, grid: bool, rows: &mut Vec<Row>) -> Result<(), String> {
        let truth = self.truth(radius)?;
        let mut known: HashMap<String, Row> = HashMap::new();
        let mut balanced_ms = None;
        for variant in variants(radius, grid) {
            let key = format!("{:?} {:?}", variant.preset, variant.overlap);
            let mut row = if let Some(row) = known.get(&key) {
                row.clone()
            } else {
                // The first run of all compiles the pipelines.
                let runs = self.effort.runs + u32::from(known.is_empty());
                let (rendered, pairs) = self.render(&variant, runs)?;
                let balanced = *balanced_ms.get_or_insert(rendered.total_ms());
                self.row(&variant, &truth, &rendered, pairs, balanced)
            };
            known.entry(key).or_insert_with(|| row.clone());
            row.knob = variant.knob;
            row.value.clone_from(&variant.value);
            print_row(&row);
            rows.push(row);
        }
        Ok(())
    }

    /// The fastest of some runs, and how many pairs it evaluated.
    fn render(&mut self, variant: &Variant, runs: u32) -> Result<(Rendered, u32), String> {
        let meshes = self.buffers.meshes();
        let renderer = match variant.overlap {
            Overlap::Add => &mut self.add,
            Overlap::Independent => &mut self.independent,
        };
        let mut fastest: Option<Rendered> = None;
        for _ in 0..runs {
            let rendered = renderer
                .render(
                    self.gpu,
                    &self.drawn,
                    &meshes,
                    &self.camera,
                    &variant.preset,
                )
                .map_err(|e| e.to_string())?;
            if fastest
                .as_ref()
                .is_none_or(|f| rendered.total_ms() < f.total_ms())
            {
                fastest = Some(rendered);
            }
        }
        self.counting
            .render(
                self.gpu,
                &self.drawn,
                &meshes,
                &self.camera,
                &variant.preset,
            )
            .map_err(|e| e.to_string())?;
        let counted = self
            .counting
            .view
            .statistics()
            .ok_or("nothing was counted")?;
        let counts: Vec<u32> = self.gpu.read_buffer(counted);
        // Rows of four a level, the pairs evaluated first.
        let pairs = counts.iter().step_by(4).sum();
        Ok((fastest.ok_or("a setting needs a run at least")?, pairs))
    }

    fn truth(&self, radius: f32) -> Result<Truth, String> {
        let rays = self.effort.rays;
        let trace = |tracer: &Tracer, rays, seed| {
            tracer.ambient_occlusion_image(&self.receivers, f64::from(radius), rays, seed, false)
        };
        let estimates = trace(&self.tracer, rays, 1);
        let mut depth_alone_rmse = f64::INFINITY;
        for steepest in [1.1, f64::INFINITY] {
            let (positions, indices) = self.pixel_surface(steepest);
            let tracer = Tracer::new(&positions, &indices).map_err(|e| e.to_string())?;
            let visibility: Vec<f32> = trace(&tracer, rays, 2)
                .iter()
                .map(|e| e.map_or(1.0, |e| e.mean as f32))
                .collect();
            depth_alone_rmse = depth_alone_rmse.min(compare(&visibility, &estimates).0);
        }
        Ok(Truth {
            estimates,
            depth_alone_rmse,
        })
    }

    /// The surface through all pixels, two triangles between four neighbours. Across an edge in depth, where one neighbour
    /// is more than `steepest` times as far as another, there is none.
    fn pixel_surface(&self, steepest: f64) -> (Vec<[f32; 3]>, Vec<u32>) {
        let [width, height] = self.effort.size;
        let positions = self
            .receivers
            .iter()
            .map(|r| r.map_or([f32::NAN; 3], |r| r.position.as_vec3().to_array()))
            .collect();
        let distance =
            |i: u32| self.receivers[i as usize].map(|r| r.position.distance(self.camera.eye()));
        let mut indices = Vec::new();
        for y in 0..height - 1 {
            for x in 0..width - 1 {
                let a = y * width + x;
                let corners = [a, a + 1, a + width, a + width + 1];
                let distances: Option<Vec<f64>> = corners.iter().map(|&i| distance(i)).collect();
                let Some(distances) = distances else { continue };
                let near = distances.iter().copied().fold(f64::INFINITY, f64::min);
                let far = distances.iter().copied().fold(0.0, f64::max);
                if far <= steepest * near {
                    let [a, b, c, d] = corners;
                    indices.extend([a, c, b, b, c, d]);
                }
            }
        }
        (positions, indices)
    }

    fn row(
        &self,
        variant: &Variant,
        truth: &Truth,
        rendered: &Rendered,
        pairs: u32,
        balanced_ms: f64,
    ) -> Row {
        let (rmse, bias) = compare(&rendered.visibility, &truth.estimates);
        let preset = &variant.preset;
        let pass = |name| {
            let found = rendered.passes.iter().find(|p| p.0 == name);
            found.map_or(0.0, |p| p.1)
        };
        Row {
            adapter: self.gpu.name(),
            scene: self.scene.name,
            view: self.scene.views[0].name,
            width: self.effort.size[0],
            height: self.effort.size[1],
            ao_radius: preset.splat.radius,
            knob: variant.knob,
            value: variant.value.clone(),
            radius_pixels: preset.surfelizer.radius_pixels,
            density: preset.surfelizer.density,
            epsilon: preset.splat.epsilon,
            levels: preset.splat.levels,
            overlap: format!("{:?}", variant.overlap).to_lowercase(),
            surfels: rendered.counts.stored,
            surfel_overflow: rendered.counts.overflow(),
            pairs,
            rmse,
            bias,
            depth_alone_rmse: truth.depth_alone_rmse,
            ms: rendered.total_ms(),
            ms_of_balanced: rendered.total_ms() / balanced_ms,
            surfelize_ms: pass("surfelize"),
            cluster_ms: pass("cluster"),
            splat_ms: pass("splat"),
            reconstruct_ms: pass("reconstruct"),
        }
    }
}

/// The presets, `balanced` first since all times are relative to it, then `balanced` with one knob turned.
fn variants(radius: f32, grid: bool) -> Vec<Variant> {
    let preset = |name| presets::preset(name, radius).expect("a preset of that name");
    let balanced = preset("balanced");
    let mut all = Vec::new();
    let mut push = |knob, value: String, preset, overlap| {
        all.push(Variant {
            knob,
            value,
            preset,
            overlap,
        });
    };
    for name in ["balanced", "fast", "accurate"] {
        push("preset", name.into(), preset(name), Overlap::Add);
    }
    for epsilon in [0.32, 0.16, 0.08, 0.04, 0.02, 0.01, 0.005, 0.0025] {
        let mut preset = balanced;
        preset.splat.epsilon = epsilon;
        push("epsilon", epsilon.to_string(), preset, Overlap::Add);
    }
    for pixels in [8.0, 4.0, 3.0, 2.0, 1.5, 1.0] {
        let mut preset = balanced;
        preset.surfelizer.radius_pixels = pixels;
        push("pixels", pixels.to_string(), preset, Overlap::Add);
    }
    for levels in 1..=MAX_LEVELS {
        let mut preset = balanced;
        preset.splat.levels = levels;
        push("levels", levels.to_string(), preset, Overlap::Add);
    }
    for density in [1.0, 4.0, 16.0, f32::INFINITY] {
        let mut preset = balanced;
        preset.surfelizer.density = density;
        push("density", density.to_string(), preset, Overlap::Add);
    }
    for (value, overlap) in [("add", Overlap::Add), ("independent", Overlap::Independent)] {
        push("overlap", value.into(), balanced, overlap);
    }
    if grid {
        for pixels in [4.0, 3.0, 2.0, 1.5, 1.0] {
            for epsilon in [0.16, 0.08, 0.04, 0.02, 0.01] {
                for levels in 3..=MAX_LEVELS {
                    let mut preset = balanced;
                    preset.surfelizer.radius_pixels = pixels;
                    preset.splat.epsilon = epsilon;
                    preset.splat.levels = levels;
                    push(
                        "grid",
                        format!("{pixels}/{epsilon}/{levels}"),
                        preset,
                        Overlap::Add,
                    );
                }
            }
        }
    }
    all
}

/// Root of the mean squared error, less the truth's own variance, and the mean error, over pixels with a surface.
fn compare(visibility: &[f32], truth: &[Option<Estimate>]) -> (f64, f64) {
    let (mut square, mut sum, mut count) = (0.0, 0.0, 0_u32);
    for (&v, estimate) in visibility.iter().zip(truth) {
        if let Some(estimate) = estimate {
            let error = f64::from(v) - estimate.mean;
            square += error * error - estimate.standard_error * estimate.standard_error;
            sum += error;
            count += 1;
        }
    }
    let n = f64::from(count.max(1));
    ((square.max(0.0) / n).sqrt(), sum / n)
}

fn print_row(row: &Row) {
    println!(
        "{:12} {:>6} {:>8} {:>12} {:>8} {:>8.4} {:>+8.4} {:>9.2} {:>9.1} {:>11.2}{}",
        row.scene,
        row.ao_radius,
        row.knob,
        row.value,
        row.surfels,
        row.rmse,
        row.bias,
        f64::from(row.pairs) / 1e6,
        row.ms,
        row.ms_of_balanced,
        if row.surfel_overflow > 0 {
            "  more surfels than room"
        } else {
            ""
        }
    );
}

/// Means over scenes: of errors the arithmetic one, of times the geometric one of their ratios.
fn panel(title: &str, rows: &[Row], belongs: impl Fn(&Row) -> bool) -> Panel {
    // Knobs and their values, in the order of the rows.
    let mut curves: Vec<(String, Vec<Point>)> = Vec::new();
    let mut counts: HashMap<(&str, &str), f64> = HashMap::new();
    for row in rows.iter().filter(|r| belongs(r)) {
        *counts.entry((row.knob, &row.value)).or_default() += 1.0;
    }
    for row in rows.iter().filter(|r| belongs(r)) {
        let share = counts[&(row.knob, row.value.as_str())].recip();
        let at = curves.iter().position(|c| c.0 == row.knob);
        let at = at.unwrap_or_else(|| {
            curves.push((row.knob.into(), Vec::new()));
            curves.len() - 1
        });
        let curve = &mut curves[at].1;
        let time = row.ms_of_balanced.powf(share);
        let error = row.rmse * share;
        match curve.iter_mut().find(|p| p.label == row.value) {
            Some(point) => {
                point.time *= time;
                point.error += error;
            }
            None => curve.push(Point {
                label: row.value.clone(),
                time,
                error,
            }),
        }
    }
    let presets = curves
        .iter()
        .position(|c| c.0 == "preset")
        .map_or(Vec::new(), |at| curves.remove(at).1);
    // Once a scene, not once a row.
    let balanced = |r: &&Row| belongs(r) && r.knob == "preset" && r.value == "balanced";
    let alone: Vec<f64> = rows
        .iter()
        .filter(balanced)
        .map(|r| r.depth_alone_rmse)
        .collect();
    Panel {
        title: title.into(),
        curves,
        presets,
        depth_alone: alone.iter().sum::<f64>() / alone.len().max(1) as f64,
    }
}

/// The presets' means, and of all settings those that none beats in time and error both.
fn summarize(panel: &Panel) {
    println!("{}: mean RMSE, time of balanced", panel.title);
    println!("  depth alone, at best  {:.4}", panel.depth_alone);
    for preset in &panel.presets {
        println!(
            "  preset {:14} {:.4} {:6.2}",
            preset.label, preset.error, preset.time
        );
    }
    let mut all: Vec<(&str, &Point)> = panel
        .curves
        .iter()
        .flat_map(|(knob, curve)| curve.iter().map(move |p| (knob.as_str(), p)))
        .collect();
    all.sort_by(|a, b| a.1.time.total_cmp(&b.1.time));
    println!(" none beats");
    let mut best = f64::INFINITY;
    for (knob, point) in all {
        if point.error < best {
            best = point.error;
            println!(
                "  {knob:10} {:10} {:.4} {:6.2}",
                point.label, point.error, point.time
            );
        }
    }
}

fn csv(rows: &[Row]) -> Result<String, String> {
    let mut text = String::new();
    for row in rows {
        let serde_json::Value::Object(fields) =
            serde_json::to_value(row).map_err(|e| e.to_string())?
        else {
            return Err("a row is not an object".into());
        };
        if text.is_empty() {
            let names: Vec<_> = fields.keys().map(String::as_str).collect();
            let _ = writeln!(text, "{}", names.join(","));
        }
        let values: Vec<String> = fields
            .values()
            .map(|v| match v {
                serde_json::Value::Null => "inf".into(),
                // Adapters' names may hold commas.
                serde_json::Value::String(s) => format!("\"{}\"", s.replace('"', "\"\"")),
                other => other.to_string(),
            })
            .collect();
        let _ = writeln!(text, "{}", values.join(","));
    }
    Ok(text)
}

fn save(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))
}

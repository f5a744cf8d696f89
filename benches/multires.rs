//! Effects by sub-images of a multi-resolution mask beside the same effects at full resolution, in one run:
//! `cargo bench --bench multires [-- --size 1280x720 --scene cornell --effect ssgi --samples 288 --views 1 --runs 1 --quick]`.
//!
//! Prints a row for each of the crate's own views, and their mean for each effect, size and number of samples, and writes
//! the rows to `target/bench/multires.json`:
//! * `full_ms`, `masked_ms`, `speedup`: time of a submission, the fastest of a few runs. Masked is all of it: the masks,
//!   with the hard shadows that those of shadows need, the sub-images and the blend;
//! * `mask_ms`, `blend_ms`: the masks' share and the blend's of it, each in a submission of its own;
//! * `rmse`: the root of the mean squared difference of both images, whose values are 0 to 1;
//! * `computed_share`: pixels that were computed, of all levels, over the pixels of the image; `level_shares`: of each
//!   level, over that level's own.

use std::process::ExitCode;

use clap::Parser;
use deep_screen_space::scenes;
use serde::Serialize;
use support::{
    bench,
    errors::rmse,
    gpu::{Ask, Gpu},
    multires::{Masked, read_image},
    near::{Effect, Passes, Stage},
};

/// Effects by sub-images beside the same effects at full resolution.
#[derive(Parser)]
struct Options {
    /// `WIDTHxHEIGHT`, any number of times; without, 1280x720, 1920x1080 and 3840x2160.
    #[arg(long, value_parser = bench::parse_size)]
    size: Vec<[u32; 2]>,
    /// One of the crate's scenes, any number of times; without, all.
    #[arg(long)]
    scene: Vec<String>,
    /// `vo`, `shadow` or `ssgi`, any number of times; without, all.
    #[arg(long)]
    effect: Vec<String>,
    /// Samples a pixel, any number of times; without, as many as the paper compares with: 64, 196 and 288.
    /// `vo` takes 6, 12, 33 or 64, and leaves others out.
    #[arg(long)]
    samples: Vec<u32>,
    /// How many views of each scene, from the first on; without, all.
    #[arg(long)]
    views: Option<usize>,
    /// Of how many runs the fastest counts.
    #[arg(long, default_value_t = 3)]
    runs: u32,
    /// As `--views 1 --runs 1`, 640x360 unless --size says otherwise.
    #[arg(long)]
    quick: bool,
    /// What cargo adds; without a meaning here.
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Serialize)]
struct Row {
    effect: &'static str,
    scene: &'static str,
    view: &'static str,
    samples: u32,
    width: u32,
    height: u32,
    full_ms: f64,
    masked_ms: f64,
    speedup: f64,
    rmse: f64,
    computed_share: f64,
    mask_ms: f64,
    blend_ms: f64,
    level_shares: [f64; 4],
}

impl Row {
    fn print_header() {
        println!(
            "{:9} {:22} {:>7} {:>9} {:>9} {:>9} {:>7} {:>8} {:>8} {:>8} {:>7}  shares of 1, 1/2, 1/4, 1/8",
            "effect",
            "view",
            "samples",
            "size",
            "full ms",
            "masked ms",
            "speedup",
            "mask ms",
            "blend ms",
            "rmse",
            "share"
        );
    }

    fn print(&self) {
        let size = format!("{}x{}", self.width, self.height);
        let shares: Vec<String> = self
            .level_shares
            .iter()
            .map(|s| format!("{s:.3}"))
            .collect();
        println!(
            "{:9} {:22} {:>7} {size:>9} {:>9.1} {:>9.1} {:>7.2} {:>8.1} {:>8.1} {:>8.4} {:>7.3}  {}",
            self.effect,
            format!("{} {}", self.scene, self.view),
            self.samples,
            self.full_ms,
            self.masked_ms,
            self.speedup,
            self.mask_ms,
            self.blend_ms,
            self.rmse,
            self.computed_share,
            shares.join(" ")
        );
    }
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("multires: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    let sizes = match (options.size.as_slice(), options.quick) {
        ([], true) => vec![[640, 360]],
        ([], false) => vec![[1280, 720], [1920, 1080], [3840, 2160]],
        (sizes, _) => sizes.to_vec(),
    };
    let scenes = if options.scene.is_empty() {
        scenes::all()
    } else {
        let find = |name: &String| {
            scenes::by_name(name).ok_or_else(|| format!("there is no scene {name}"))
        };
        options.scene.iter().map(find).collect::<Result<_, _>>()?
    };
    let effects = if options.effect.is_empty() {
        Effect::ALL.to_vec()
    } else {
        let find = |name: &String| {
            Effect::by_name(name).ok_or_else(|| format!("there is no effect {name}"))
        };
        options.effect.iter().map(find).collect::<Result<_, _>>()?
    };
    let gpu = Gpu::open(Ask::from_env())?;
    println!("{}", gpu.name());
    Row::print_header();
    let passes = Passes::new(&gpu.device).map_err(|e| e.to_string())?;
    let runs = if options.quick { 1 } else { options.runs };
    let mut rows = Vec::new();
    for size in sizes {
        for scene in &scenes {
            let views = if options.quick {
                Some(1)
            } else {
                options.views
            };
            let views = views.map_or(scene.views.len(), |most| most.min(scene.views.len()));
            for view in 0..views {
                let stage =
                    Stage::new(&gpu, &passes, scene, view, size).map_err(|e| e.to_string())?;
                for &effect in &effects {
                    let own = [effect.samples()];
                    let counts = if options.samples.is_empty() {
                        &own[..]
                    } else {
                        &options.samples
                    };
                    for &samples in counts.iter().filter(|&&n| effect.takes(n)) {
                        let mut row = measure(&passes, &stage, effect, samples, runs)?;
                        row.scene = scene.name;
                        row.view = scene.views[view].name;
                        row.print();
                        rows.push(row);
                    }
                }
            }
        }
    }
    print_means(&rows);
    bench::write_rows("multires", &rows)
}

fn measure(
    passes: &Passes,
    stage: &Stage<'_>,
    effect: Effect,
    samples: u32,
    runs: u32,
) -> Result<Row, String> {
    let gpu = stage.gpu;
    let [width, height] = stage.size();
    let full = gpu.storage(effect.format(), width, height);
    let refuse = |e: deep_screen_space::Error| e.to_string();
    let mut masked =
        Masked::new(gpu, passes, effect, effect.mask(), stage.size()).map_err(refuse)?;
    let mut best = [f64::INFINITY; 4];
    for _ in 0..runs {
        let times = [
            gpu.time(|e| passes.record(stage, e, (effect, samples), None, full.texture())),
            gpu.time(|e| {
                masked.record_masks(passes, stage, e)?;
                masked.record_images(passes, stage, e, samples)?;
                masked.record_blend(stage, e)
            }),
            gpu.time(|e| masked.record_masks(passes, stage, e)),
            gpu.time(|e| masked.record_blend(stage, e)),
        ];
        for (best, (ms, result)) in best.iter_mut().zip(times) {
            result.map_err(refuse)?;
            *best = best.min(ms);
        }
    }
    let [full_ms, masked_ms, mask_ms, blend_ms] = best;
    let counts = masked.counts(gpu);
    let pixels = |level: u32| {
        let [width, height] = [width, height].map(|n| f64::from(n.div_ceil(1 << level)));
        width * height
    };
    Ok(Row {
        effect: effect.name(),
        scene: "",
        view: "",
        samples,
        width,
        height,
        full_ms,
        masked_ms,
        speedup: full_ms / masked_ms,
        rmse: rmse(
            read_image(gpu, full.texture()).as_flattened(),
            read_image(gpu, masked.target.texture()).as_flattened(),
        ),
        computed_share: counts.iter().map(|&n| f64::from(n)).sum::<f64>() / pixels(0),
        mask_ms,
        blend_ms,
        level_shares: [0, 1, 2, 3].map(|level| f64::from(counts[level as usize]) / pixels(level)),
    })
}

/// The mean over views of each effect, size and number of samples.
fn print_means(rows: &[Row]) {
    println!("\nmeans over views");
    let key = |r: &Row| (r.effect, r.samples, [r.width, r.height]);
    let mut done = Vec::new();
    for row in rows {
        if done.contains(&key(row)) {
            continue;
        }
        done.push(key(row));
        let same: Vec<&Row> = rows.iter().filter(|r| key(r) == key(row)).collect();
        let mean =
            |of: &dyn Fn(&Row) -> f64| same.iter().map(|r| of(r)).sum::<f64>() / same.len() as f64;
        Row {
            scene: "mean",
            view: "",
            full_ms: mean(&|r| r.full_ms),
            masked_ms: mean(&|r| r.masked_ms),
            speedup: mean(&|r| r.speedup),
            rmse: mean(&|r| r.rmse),
            computed_share: mean(&|r| r.computed_share),
            mask_ms: mean(&|r| r.mask_ms),
            blend_ms: mean(&|r| r.blend_ms),
            level_shares: [0, 1, 2, 3].map(|level| mean(&|r| r.level_shares[level])),
            ..*row
        }
        .print();
    }
}

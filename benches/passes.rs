//! Time of each pass, and pairs of surfels and pixels per second, beside the same work in a Rust loop.
//!
//! `cargo bench --bench passes [-- --quick] [--floor]` prints a table and writes `target/bench/passes.json`. Pairs are counted as
//! * covered: pixels under the square that bounds a surfel's shell on screen, what a rasteriser would shade;
//! * evaluated: what is left of them by culling clusters, surfels and units of 8×8 pixels;
//! * in shell, and contributing: of those evaluated, what lies in the shell, and what adds anything.
//!
//! The loop is f32, multi-threaded and vectorised by the compiler over the 64 pixels of a unit. It is handed the surfels
//! of each unit, binned beforehand: its time has no culling in it, that of the splat has.
//!
//! `-- --joined` prints instead what two effects in one splat cost, beside each of them alone.

use clap::Parser;
use deep_screen_space::{
    AmbientOcclusion, Camera, CloudCapacity, DiffuseBounce, Error, Light, SplatSettings,
    glam::{DVec3, Vec3},
    reference::{packing::unpack_normal, shell_splatter::pixel_of},
    scenes,
};
use rayon::prelude::*;
use support::{
    ambient_occlusion::Renderer,
    bench,
    gpu::{Ask, Gpu},
    presets,
    raster::{Raster, camera_of},
    scene::SceneBuffers,
};

/// Best of this many runs: a shared machine only ever adds time.
const RUNS: usize = 3;

struct Disk {
    position: Vec3,
    radius: f32,
    normal: Vec3,
}

#[derive(Clone, Copy)]
struct Receiver {
    position: Vec3,
    normal: Vec3,
}

/// A unit of 8×8 pixels of a sub-buffer, as separate coordinates for the compiler to vectorise over, and its surfels
/// with the squares of their shells' radii.
struct Unit {
    position: [[f32; 64]; 3],
    normal: [[f32; 64]; 3],
    surfels: Vec<(u32, f32, f32)>,
}

/// Time of each pass, and pairs of surfels and pixels per second, beside the same work in a Rust loop.
#[derive(Parser)]
// Switches of a command line.
#[allow(clippy::struct_excessive_bools)]
struct Options {
    /// Two scenes, and small pictures.
    #[arg(long)]
    quick: bool,
    /// The portable floor, which has no subgroups, in place of all that the adapter offers.
    #[arg(long)]
    floor: bool,
    /// What ambient occlusion and a bounce of diffuse light cost in one splat, beside each alone.
    #[arg(long)]
    joined: bool,
    /// What cargo adds; without a meaning here.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() {
    let Options {
        quick,
        floor,
        joined,
        ..
    } = Options::parse();
    let gpu = Gpu::open(if floor { Ask::Floor } else { Ask::All }).expect("a graphics adapter");
    println!("{}", gpu.name());
    let size = if quick { [256, 256] } else { [512, 512] };
    if joined {
        let names = ["cornell", "dominoes"];
        let rows = names.map(|name| two_in_one(&gpu, name, size).expect("valid settings"));
        bench::write_rows("joined", &rows).expect("target can be written");
        return;
    }
    println!(
        "{:12} {:9} {:>8} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8} {:>7} {:>7} {:>7} {:>7} {:>9} {:>8} {:>8}",
        "scene",
        "preset",
        "surfels",
        "surfelize",
        "cluster",
        "splat",
        "reconstr",
        "loop ms",
        "loop/gpu",
        "covered",
        "eval",
        "shell",
        "contrib",
        "covered/s",
        "shell/s",
        "eval/s"
    );
    let names = if quick {
        &["cornell", "colonnade"][..]
    } else {
        &["cornell", "closed_room", "fence", "colonnade"]
    };
    let mut rows = Vec::new();
    let bar = bench::progress(names.len() * presets::NAMES.len());
    for &name in names {
        for preset in presets::NAMES {
            rows.push(bar.suspend(|| measure(&gpu, name, preset, size)));
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    bench::write_rows("passes", &rows).expect("target can be written");
}

/// Milliseconds from clusters to pictures of occlusion, of a bounce of light, and of both in one splat, with the preset
/// `balanced` without a radius. Making and lighting surfels is the same for all.
fn two_in_one(gpu: &Gpu, name: &str, size: [u32; 2]) -> Result<serde_json::Value, Error> {
    let scene = scenes::by_name(name).expect("a scene of the crate");
    let camera = camera_of(&scene, size);
    let preset = presets::preset("balanced", f32::INFINITY).expect("a preset");
    let buffers = SceneBuffers::new(gpu, &scene);
    let raster = Raster::draw(gpu, &buffers, &camera);
    let capacity = CloudCapacity {
        surfels: 1 << 20,
        pieces: buffers.triangles() + 100_000,
        triangles: buffers.triangles(),
    };
    let lights = [Light::Directional {
        direction: DVec3::new(0.45, -0.8, -0.4),
        irradiance: [3.2, 3.1, 2.9],
    }];
    let occlusion = AmbientOcclusion::default().effect();
    let light = DiffuseBounce::default().effect()?;
    let effects = [occlusion.clone(), light.clone(), occlusion.and(&light)?];
    let levels = preset.splat.levels;
    let renderers = effects.map(|e| Renderer::of(gpu, &e, capacity, size, levels, false));
    let mut best = [f64::INFINITY; 3];
    let mut renderers = renderers.into_iter().collect::<Result<Vec<_>, _>>()?;
    // In turns, since the machine is not idle. The first run compiles.
    for _ in 0..=RUNS {
        for (best, renderer) in best.iter_mut().zip(&mut renderers) {
            let rendered =
                renderer.render_scene(gpu, &raster, &buffers, &camera, &lights, &preset)?;
            let shared = ["surfelize", "bvh", "light", "decode"];
            let own = rendered.passes.iter().filter(|p| !shared.contains(&p.0));
            *best = best.min(own.map(|p| p.1).sum());
        }
    }
    let [occlusion, light, both] = best;
    let ratio = both / occlusion.max(light);
    println!(
        "{name:12} occlusion {occlusion:.1} ms, light {light:.1} ms, both {both:.1} ms: {ratio:.2} of the dearer"
    );
    Ok(serde_json::json!({
        "adapter": gpu.adapter.name,
        "scene": name,
        "width": size[0],
        "height": size[1],
        "occlusion_ms": occlusion,
        "light_ms": light,
        "joined_ms": both,
        "joined_over_dearer": ratio,
    }))
}

fn measure(
    gpu: &Gpu,
    name: &str,
    preset_name: &str,
    [width, height]: [u32; 2],
) -> serde_json::Value {
    let scene = scenes::by_name(name).expect("a scene of the crate");
    let camera = camera_of(&scene, [width, height]);
    // Bounded, so that there is a square to cover.
    let mut preset = presets::preset(preset_name, f32::INFINITY).expect("a preset");
    preset.splat.unbounded = false;
    let buffers = SceneBuffers::new(gpu, &scene);
    let raster = Raster::draw(gpu, &buffers, &camera);
    let capacity = CloudCapacity {
        surfels: 1 << 20,
        pieces: buffers.triangles() + 100_000,
        triangles: buffers.triangles(),
    };
    let renderer = |statistics| {
        Renderer::new(
            gpu,
            AmbientOcclusion::default(),
            capacity,
            [width, height],
            preset.splat.levels,
            statistics,
        )
        .expect("within limits")
    };
    let meshes = buffers.meshes();
    let mut counting = renderer(true);
    let counted = counting
        .render(gpu, &raster, &meshes, &camera, &preset)
        .expect("valid settings");
    let statistics: Vec<u32> =
        gpu.read_buffer(counting.view.statistics().expect("a counting splatter"));
    let count = |k: usize| -> f64 {
        statistics
            .iter()
            .skip(k)
            .step_by(4)
            .map(|&n| f64::from(n))
            .sum()
    };
    let [evaluated, in_shell, contributing] = [count(0), count(1), count(2)];

    let mut timed = renderer(false);
    let named = ["surfelize", "cluster", "splat", "reconstruct"];
    let mut best = named.map(|_| f64::INFINITY);
    // The first run compiles.
    for _ in 0..=RUNS {
        let rendered = timed
            .render(gpu, &raster, &meshes, &camera, &preset)
            .expect("valid settings");
        for (best, name) in best.iter_mut().zip(named) {
            let mut passes = rendered.passes.iter();
            let (_, ms) = passes.find(|pass| pass.0 == name).expect("a pass");
            *best = best.min(*ms);
        }
    }

    let disks = disks(gpu, &timed, counted.counts.stored as usize);
    let receivers = receivers(gpu, &timed);
    let mut covered = 0.0;
    let mut units = Vec::new();
    for level in 0..preset.splat.levels {
        covered += covered_pairs(&camera, &disks, level, &preset.splat, [width, height]);
        units.extend(bin(
            &disks,
            &receivers,
            level,
            &preset.splat,
            [width, height],
        ));
    }
    let looped: f64 = units.iter().map(|u| 64.0 * u.surfels.len() as f64).sum();
    let loop_ms = (0..RUNS)
        .map(|_| {
            let stopwatch = gpu.stopwatch();
            let sum: f32 = units.par_iter().map(|unit| splat_unit(unit, &disks)).sum();
            assert!(sum.is_finite());
            stopwatch.milliseconds()
        })
        .fold(f64::INFINITY, f64::min);
    let [surfelize, cluster, splat, reconstruct] = best;
    let per_second = |pairs: f64| pairs / (splat * 1e-3);
    // The same pairs in the loop: its units were culled by the same tests, in f64.
    let ratio = (loop_ms / looped.max(1.0)) / (splat / evaluated.max(1.0));
    println!(
        "{name:12} {preset_name:9} {:8} {surfelize:9.1} {cluster:8.1} {splat:8.1} {reconstruct:8.1} {loop_ms:8.1} {ratio:8.2} {:6.0}M {:6.3} {:7.3} {:7.4} {:8.2}G {:7.2}G {:7.2}G",
        disks.len(),
        covered / 1e6,
        evaluated / covered,
        in_shell / covered,
        contributing / covered,
        per_second(covered) / 1e9,
        per_second(in_shell) / 1e9,
        per_second(evaluated) / 1e9,
    );
    serde_json::json!({
        "adapter": gpu.adapter.name,
        "scene": name,
        "preset": preset_name,
        "width": width,
        "height": height,
        "surfels": disks.len(),
        "surfelize_ms": surfelize,
        "cluster_ms": cluster,
        "splat_ms": splat,
        "reconstruct_ms": reconstruct,
        "loop_ms": loop_ms,
        "loop_time_over_splat_time_per_pair": ratio,
        "covered_pairs": covered,
        "evaluated_over_covered": evaluated / covered,
        "in_shell_over_covered": in_shell / covered,
        "contributing_over_covered": contributing / covered,
        "covered_pairs_per_second": per_second(covered),
        "in_shell_pairs_per_second": per_second(in_shell),
        "evaluated_pairs_per_second": per_second(evaluated),
    })
}

fn disks(gpu: &Gpu, renderer: &Renderer, stored: usize) -> Vec<Disk> {
    let surfels: Vec<deep_screen_space::Surfel> = gpu.read_buffer(renderer.cloud.surfels());
    let sources: Vec<deep_screen_space::SurfelSource> = gpu.read_buffer(renderer.cloud.sources());
    surfels[..stored]
        .iter()
        .zip(&sources)
        .map(|(surfel, source)| Disk {
            position: surfel.position.into(),
            radius: surfel.radius,
            normal: unpack_normal(source.normal).as_vec3(),
        })
        .collect()
}

fn receivers(gpu: &Gpu, renderer: &Renderer) -> Vec<Option<Receiver>> {
    let texels: Vec<[u32; 4]> = gpu.read_texture(renderer.decoding.receivers().view().texture(), 0);
    texels
        .iter()
        .map(|&[x, y, z, n]| {
            (n != 0x8000_8000).then(|| Receiver {
                position: Vec3::from([x, y, z].map(f32::from_bits)),
                normal: unpack_normal(n).as_vec3(),
            })
        })
        .collect()
}

/// Inner and outer radius of a surfel's shell.
fn shell(radius: f32, level: u32, settings: &SplatSettings) -> [f32; 2] {
    let reach = radius * (1.0 / settings.epsilon - 1.0).max(0.0).sqrt() * (1_u32 << level) as f32;
    [if level == 0 { 0.0 } else { 0.5 * reach }, reach]
}

/// Pixels of the sub-buffer under each surfel's square, in all.
fn covered_pairs(
    camera: &Camera,
    disks: &[Disk],
    level: u32,
    settings: &SplatSettings,
    size: [u32; 2],
) -> f64 {
    let sub = size.map(|n| f64::from(n.div_ceil(1 << level)));
    disks
        .par_iter()
        .map(|disk| {
            let position: DVec3 = disk.position.as_dvec3();
            let outer = f64::from(shell(disk.radius, level, settings)[1]);
            // About the eye, or behind it: the square is the whole picture.
            let Some(at) = camera
                .project(position)
                .filter(|_| position.length() > outer)
            else {
                return sub[0] * sub[1];
            };
            let scale = f64::from(1_u32 << level);
            let half = outer / camera.footprint().at(position) / scale;
            let side = |center: f64, size: f64| {
                let (low, high) = (center / scale - half, center / scale + half);
                (high.min(size) - low.max(0.0)).max(0.0)
            };
            side(at.x, sub[0]) * side(at.y, sub[1])
        })
        .sum()
}

/// The units of all sub-buffers of a level that have surfels, culled as the shader does.
fn bin(
    disks: &[Disk],
    receivers: &[Option<Receiver>],
    level: u32,
    settings: &SplatSettings,
    [width, height]: [u32; 2],
) -> Vec<Unit> {
    let sub_buffers = 1_u32 << (2 * level);
    let sub = [width, height].map(|n| n.div_ceil(1 << level));
    let blocks = sub.map(|n| n.div_ceil(8));
    (0..sub_buffers * blocks[0] * blocks[1])
        .into_par_iter()
        .filter_map(|i| {
            let sub_buffer = i % sub_buffers;
            let corner = [
                i / sub_buffers % blocks[0] * 8,
                i / sub_buffers / blocks[0] * 8,
            ];
            let mut unit = Unit {
                position: [[1e18; 64]; 3],
                normal: [[0.0; 64]; 3],
                surfels: Vec::new(),
            };
            let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            for k in 0..64 {
                let block = [corner[0] + k % 8, corner[1] + k / 8];
                let [x, y] = pixel_of(block, sub_buffer, level, settings.seed);
                if block[0] >= sub[0] || block[1] >= sub[1] || x >= width || y >= height {
                    continue;
                }
                if let Some(receiver) = receivers[(y * width + x) as usize] {
                    low = low.min(receiver.position);
                    high = high.max(receiver.position);
                    for axis in 0..3 {
                        unit.position[axis][k as usize] = receiver.position[axis];
                        unit.normal[axis][k as usize] = receiver.normal[axis];
                    }
                }
            }
            if low.x > high.x {
                return None;
            }
            for at in (sub_buffer as usize..disks.len()).step_by(sub_buffers as usize) {
                let disk = &disks[at];
                let [inner, outer] = shell(disk.radius, level, settings);
                let gap = (low - disk.position)
                    .max(disk.position - high)
                    .max(Vec3::ZERO);
                let farthest = Vec3::select(disk.normal.cmpgt(Vec3::ZERO), high, low);
                let scale =
                    low.abs().max(high.abs()).max_element() + disk.position.abs().max_element();
                if gap.length_squared() <= outer * outer
                    && disk.normal.dot(farthest - disk.position) > 1e-6 * scale
                {
                    unit.surfels.push((at as u32, inner * inner, outer * outer));
                }
            }
            (!unit.surfels.is_empty()).then_some(unit)
        })
        .collect()
}

/// The sums of a unit's pixels, added up so that none can be optimised away.
fn splat_unit(unit: &Unit, disks: &[Disk]) -> f32 {
    let mut sums = [0.0_f32; 64];
    let ([px, py, pz], [nx, ny, nz]) = (&unit.position, &unit.normal);
    for &(at, inner2, outer2) in &unit.surfels {
        let disk = &disks[at as usize];
        let (d, n) = (disk.position, disk.normal);
        let per_area = 1.0 / (disk.radius * disk.radius);
        for k in 0..64 {
            let (x, y, z) = (d.x - px[k], d.y - py[k], d.z - pz[k]);
            let distance2 = x * x + y * y + z * z;
            let receiver_side = (nx[k] * x + ny[k] * y + nz[k] * z).max(0.0);
            let sender_side = (-(n.x * x + n.y * y + n.z * z)).max(0.0);
            let value =
                receiver_side * sender_side / (distance2.max(1e-30) * (1.0 + distance2 * per_area));
            let inside = distance2 >= inner2 && distance2 < outer2;
            sums[k] += if inside { value } else { 0.0 };
        }
    }
    sums.iter().sum()
}

//! The whole on any scene: `cargo run --release --example render -- SCENE.glb --out DIR`.
//!
//! Ambient occlusion (`--effect ao`) is written to `ao.exr` (one channel `Y`, 1 = open) and `ao.png`, indirect light
//! (`--effect gi`) to `gi.exr` (R, G, B: outgoing radiance of `--bounces` diffuse bounces, 1 by default) and `gi.png`,
//! one bounce off glossy surfaces (`--effect specular`, of `--roughness` and `--f0`) to `specular.exr` and `specular.png`,
//! directional occlusion (`--effect do`, what white surfaces send on of a sky) to `do.exr` and `do.png`, bent normals
//! (`--effect bent`, their x, y and z, in the PNG from -1 to 1) to `bent.exr` and `bent.png`, subsurface scattering
//! (`--effect sss`, outgoing radiance of what `--scatters` of `--material`) to `sss.exr` and `sss.png`, volumetric obscurance
//! (`--effect vo`) to `vo.exr` and `vo.png` as ambient occlusion, soft shadows of the first light (`--effect shadow`) to
//! `shadow.exr` and `shadow.png` (1 = lit), screen-space indirect light (`--effect ssgi`, of a white surface) to `ssgi.exr` and
//! `ssgi.png`, and what it took to `stats.json`. `--multires` computes these three by sub-images. `--effect sg` writes
//! `sg.exr` and `sg.png`: a bounce from a reflective shadow map, without shadows, gathered on the sparse hull of what is
//! seen. With `--reference` the ray-traced truth comes too (for `sg` the same light gathered at every pixel), how far off the
//! picture is, and picture, truth and four times their difference side by side (`_compared.png`).

mod hull;
mod methods;
mod near;
mod subsurface;
mod view;

use std::{path::PathBuf, process::ExitCode};

use clap::Parser;
use deep_screen_space::{
    HitResolver,
    glam::{DQuat, DVec3},
    reference::{
        environment::Cells,
        trace::{BentEstimate, ColorEstimate, Estimate, Gloss, Receiver, Tracer},
    },
    scenes::{self, Scene},
};
use methods::Rendered;
use serde::Serialize;
use serde_json::json;
use support::{
    arguments, files,
    gltf::{Loaded, load_gltf},
    gpu::{Ask, Gpu},
    near::Effect,
    presets,
};
use view::Shot;

/// Ambient occlusion or indirect light of a scene, with all that is hidden or off screen.
#[derive(Parser)]
pub(crate) struct Options {
    /// A glTF 2.0 file, or the name of one of the crate's scenes; the colonnade if left out.
    scene: Option<String>,
    /// A JSON file of cameras by scene, each with name, eye, target, up, `vfov_deg`, near, width, height and light.
    #[arg(long)]
    cameras: Option<PathBuf>,
    /// Which camera of the file of cameras or else of the glTF file, or which view of the crate's scene.
    #[arg(long)]
    camera: Option<String>,
    /// The eye, x,y,z.
    #[arg(long, value_parser = view::parse_point, requires = "target", allow_hyphen_values = true)]
    eye: Option<DVec3>,
    /// What the eye looks at, x,y,z.
    #[arg(long, value_parser = view::parse_point, requires = "eye", allow_hyphen_values = true)]
    target: Option<DVec3>,
    /// A direction that is up in the picture, x,y,z; if left out, y, or -z for a view straight down.
    #[arg(long, value_parser = view::parse_point, allow_hyphen_values = true)]
    up: Option<DVec3>,
    /// Distance of the near plane; if left out, or if the eye is given, before all that is seen.
    #[arg(long, allow_negative_numbers = true)]
    near: Option<f64>,
    /// Vertical field of view in degrees.
    #[arg(long, allow_negative_numbers = true)]
    vfov: Option<f64>,
    /// Size of the picture in pixels, `WxH`.
    #[arg(long, value_parser = arguments::parse_size)]
    size: Option<[u32; 2]>,
    /// What to compute: ambient occlusion, one bounce of diffuse light or of glossy light, directional occlusion, bent
    /// normals, subsurface scattering, volumetric obscurance, soft shadows or indirect light from the G-buffer alone, or a
    /// bounce from a reflective shadow map on a hull.
    #[arg(long, default_value = "ao", value_parser = [
        "ao", "gi", "specular", "do", "bent", "sss", "vo", "shadow", "ssgi", "sg",
    ])]
    pub(crate) effect: String,
    /// What scatters light below its surface, for `--effect sss`: apple, chicken1, chicken2, cream, ketchup, marble, potato,
    /// skimmilk, skin1, skin2, spectralon or wholemilk.
    #[arg(long, default_value = "marble")]
    pub(crate) material: String,
    /// Which of the scene's materials, from 0, is of it.
    #[arg(long, default_value_t = 0)]
    pub(crate) scatters: u32,
    /// How many millimetres a world unit is, for `--effect sss`.
    #[arg(long, default_value_t = 1000.0)]
    pub(crate) millimetres: f32,
    /// Radius of a surfel in pixels in place of the preset's, for splatting.
    #[arg(long)]
    pub(crate) radius_pixels: Option<f32>,
    /// The contribution below which a surfel moves on to the next level in place of the preset's, for splatting.
    #[arg(long)]
    pub(crate) epsilon: Option<f32>,
    /// Compute `vo`, `shadow` or `ssgi` at the resolution that each part of the picture needs, by a multi-resolution mask, and
    /// say how far that is from all of it at full resolution.
    #[arg(long)]
    multires: bool,
    /// The sky of `--effect do`: `dim`, `sunny`, which is the same with a small bright sun, or a file (EXR, HDR, PNG or JPEG)
    /// whose columns are longitudes and whose rows are latitudes, from the top.
    #[arg(long, default_value = "sunny")]
    sky: String,
    /// Perceptual roughness of all surfaces, 0 to 1, for `--effect specular`.
    #[arg(long, default_value_t = 0.3, value_parser = view::parse_share)]
    roughness: f32,
    /// Their reflectance seen straight on, 0 to 1.
    #[arg(long, default_value_t = 0.04, value_parser = view::parse_share)]
    f0: f32,
    /// How to compute it: by the bounced z-buffer, which knows what hides what, or by splatting, which adds up.
    #[arg(long, default_value = "bounced", value_parser = ["bounced", "splat"])]
    method: String,
    /// How exactly.
    #[arg(long, default_value = "balanced", value_parser = presets::NAMES)]
    preset: String,
    /// Distance beyond which nothing occludes, world units, or inf; if left out, what suits the crate's own scene, and
    /// inf for a file. Light comes from any distance.
    #[arg(long, value_parser = view::parse_radius, allow_negative_numbers = true)]
    radius: Option<f32>,
    /// Rays per pixel in place of the preset's, and the filter that suits them, for the bounced z-buffer.
    #[arg(long)]
    rays_per_pixel: Option<u32>,
    /// So many further rays per pixel on average, which go where noise is greatest, and the filter that suits all of them, for
    /// the bounced z-buffer.
    #[arg(long)]
    further_rays: Option<f32>,
    /// How many of these rays go to surfaces that shine, up to 16, for light by the bounced z-buffer; if left out, one in five
    /// where materials emit.
    #[arg(long, value_parser = clap::value_parser!(u32).range(0..=16))]
    pub(crate) emitter_samples: Option<u32>,
    /// How often light bounces on its way to the eye, for `gi` by the bounced z-buffer: beyond 1 surfels gather light from each
    /// other. So often in the reference too.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=16))]
    pub(crate) bounces: u32,
    /// Half width of the filter's window in pixels in place of what suits the number of rays, for the bounced z-buffer.
    #[arg(long)]
    window: Option<u32>,
    /// Whether surfaces occlude and shine behind their backs too, for splatting.
    #[arg(long)]
    two_sided: bool,
    /// Combine occluders as if they lay independently of each other, for splatting.
    #[arg(long)]
    independent: bool,
    /// Surfels that there is room for, for splatting and for more than one bounce.
    #[arg(long, default_value_t = 4_000_000)]
    surfels: u32,
    /// Pieces of triangles that there is room for; if left out, as many as the scene comes to, if the device can hold them.
    #[arg(long)]
    pieces: Option<u32>,
    /// Trace the truth too, with this many rays per pixel.
    #[arg(long, num_args = 0..=1, default_missing_value = "256", value_parser = clap::value_parser!(u32).range(1..))]
    reference: Option<u32>,
    /// Where to write.
    #[arg(long, default_value = "out")]
    out: PathBuf,
}

impl Options {
    fn gi(&self) -> bool {
        self.effect == "gi"
    }

    /// Whether it is light, which comes from any distance.
    fn light(&self) -> bool {
        self.gi() || self.effect == "specular"
    }

    /// Whether the picture has colours.
    fn colors(&self) -> bool {
        matches!(
            self.effect.as_str(),
            "gi" | "specular" | "do" | "bent" | "sss" | "ssgi"
        )
    }
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("render: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    let (scene, shot) = prepare(options)?;
    let gpu = Gpu::open(Ask::room_from_env()?)?;
    gpu.end_on_error("render");
    draw(&gpu, options, &scene, &shot)
}

/// Reads the scene, and finds the place to look from.
pub(crate) fn prepare(options: &Options) -> Result<(Scene, Shot), String> {
    let loaded: Loaded = match options.scene.as_deref() {
        None => scenes::colonnade().into(),
        Some(name) => match scenes::by_name(name) {
            Some(scene) => scene.into(),
            None => load_gltf(name.as_ref())?,
        },
    };
    for note in &loaded.notes {
        eprintln!("render: {note}");
    }
    view::choose(options, loaded)
}

/// Renders, and writes what comes of it.
pub(crate) fn draw(gpu: &Gpu, options: &Options, scene: &Scene, shot: &Shot) -> Result<(), String> {
    let radius = if options.light() {
        f32::INFINITY
    } else {
        options.radius.unwrap_or(scene.ao_radius)
    };
    std::fs::create_dir_all(&options.out).map_err(|e| format!("{}: {e}", options.out.display()))?;
    if options.effect == "sg" {
        return hull::render(gpu, options, scene, shot);
    }
    if options.bounces > 1 && !options.gi() {
        return Err("--bounces is for --effect gi".into());
    }
    if options.bounces > 1 && options.method == "splat" {
        return Err("--bounces is for rays: splatting makes one".into());
    }
    let by_sub_images = Effect::by_name(&options.effect);
    if options.multires && by_sub_images.is_none() {
        return Err("--multires is for --effect vo, shadow and ssgi".into());
    }
    if options.reference.is_some()
        && by_sub_images.is_some_and(|effect| effect != Effect::Obscurance)
    {
        return Err("--reference has nothing to say of this effect".into());
    }
    let rendered = match (by_sub_images, options.method.as_str()) {
        (Some(effect), _) => near::of_pixels(gpu, options, scene, shot, effect)?,
        _ if options.effect == "sss" => subsurface::render(gpu, options, scene, shot)?,
        (_, "splat") => methods::splat(gpu, options, scene, shot, radius)?,
        _ => methods::bounced(gpu, options, scene, shot, radius)?,
    };

    let picture = write(options, shot, &rendered.pixels, "")?;
    let mut stats = rendered.stats(gpu, options, shot, radius);
    let off = options
        .reference
        .map(|rays| compare(options, scene, shot, &rendered, radius, rays))
        .transpose()?;
    stats["reference"] = json!(off);
    let text = serde_json::to_string_pretty(&stats).map_err(|e| e.to_string())?;
    let path = options.out.join("stats.json");
    std::fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
    println!(
        "{}: {} triangles, {:.1} ms on {}",
        picture.display(),
        rendered.triangles,
        rendered.total_ms(),
        gpu.name()
    );
    report_overflow(&rendered);
    if let Some(off) = off {
        println!(
            "against {} rays per pixel: RMSE {:.4} (theirs {:.4}), bias {:+.4}, mean {:.4} over {} pixels",
            off.rays, off.rmse, off.noise, off.bias, off.mean, off.pixels
        );
    }
    Ok(())
}

fn report_overflow(rendered: &Rendered) {
    if rendered.surfels_made && rendered.counts.overflow() > 0 {
        println!(
            "{} surfels more found no room: --surfels sets how many do",
            rendered.counts.overflow()
        );
    }
    let pieces = rendered.counts.piece_overflow(rendered.capacity);
    if pieces > 0 {
        println!("{pieces} pieces of triangles more found no room");
    }
}

/// Writes a picture as EXR and PNG, and says where the PNG is.
fn write(
    options: &Options,
    shot: &Shot,
    pixels: &[[f32; 3]],
    suffix: &str,
) -> Result<PathBuf, String> {
    let path = |kind: &str| {
        options
            .out
            .join(format!("{}{suffix}.{kind}", options.effect))
    };
    let (width, height) = (shot.width, shot.height);
    let png = path("png");
    if options.colors() {
        files::write_exr_rgb(&path("exr"), width, height, pixels)?;
        files::write_png_rgb(&png, width, height, &shown(options, pixels), 1.0)?;
    } else {
        let grey: Vec<f32> = pixels.iter().map(|p| p[0]).collect();
        files::write_exr(&path("exr"), width, height, &grey)?;
        files::write_png(&png, width, height, &grey)?;
    }
    Ok(png)
}

/// What a PNG shows of a picture, 0 to 1, linear.
fn shown(options: &Options, pixels: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let scale = match options.effect.as_str() {
        // As normals are drawn: -1 to 1 in what the eye takes for equal steps.
        "bent" => {
            let shown = |n: f32| (0.5 * n + 0.5).clamp(0.0, 1.0).powf(2.2);
            return pixels.iter().map(|n| n.map(shown)).collect();
        }
        // A sky is brighter than what rooms reflect, and little of that is reflected at a surface.
        "do" => 0.5,
        "specular" => 1.0 / f32::max(options.f0, 0.04),
        _ if options.colors() => 2.0,
        _ => 1.0,
    };
    let scaled = |pixel: &[f32; 3]| pixel.map(|v| v * scale);
    pixels.iter().map(scaled).collect()
}

/// Pictures side by side, as a PNG.
fn write_beside(options: &Options, shot: &Shot, pictures: &[&[[f32; 3]]]) -> Result<(), String> {
    let path = options.out.join(format!("{}_compared.png", options.effect));
    let width = shot.width as usize;
    let shown: Vec<_> = pictures.iter().map(|p| shown(options, p)).collect();
    let rows = 0..shot.height as usize;
    let pixels: Vec<[f32; 3]> = rows
        .flat_map(|y| shown.iter().flat_map(move |p| &p[y * width..][..width]))
        .copied()
        .collect();
    let wide = shot.width * pictures.len() as u32;
    files::write_png_rgb(&path, wide, shot.height, &pixels, 1.0)
}

/// By how much bent normals are turned off the traced ones.
fn report_angles(truth: &[Option<BentEstimate>], pixels: &[[f32; 3]]) {
    let (mut sums, mut counts) = ([0.0; 2], [0_u32; 2]);
    for (truth, pixel) in truth.iter().zip(pixels) {
        if let Some(truth) = truth.filter(|truth| truth.visibility > 0.0) {
            let cone = HitResolver::cone_angle(truth.visibility as f32).to_degrees();
            let wide = usize::from(cone >= 60.0);
            let found = DVec3::from(pixel.map(f64::from));
            // Rasterised, an edge may be the sky's where a ray meets what it is of.
            if found == DVec3::ZERO {
                continue;
            }
            sums[wide] += found.angle_between(truth.mean).to_degrees();
            counts[wide] += 1;
        }
    }
    for (which, i) in [("narrower than 60°", 0), ("wider", 1)] {
        let mean = sums[i] / f64::from(counts[i].max(1));
        println!("cones {which}: off by {mean:.2}° over {} pixels", counts[i]);
    }
}

/// The truth of each pixel; for ambient occlusion in all channels. Of bent normals it says how far off `rendered` is.
fn truth(
    options: &Options,
    scene: &Scene,
    (shot, rendered): (&Shot, &Rendered),
    radius: f32,
    rays: u32,
) -> Result<Vec<Option<ColorEstimate>>, String> {
    let tracer = Tracer::of_scene(scene).map_err(|e| e.to_string())?;
    let receivers: Vec<Option<Receiver>> = shot.receivers(scene, &tracer);
    let reach = f64::from(radius);
    if let Some(sky) = &rendered.sky {
        let cells = Cells::new(sky.clone(), DQuat::IDENTITY);
        return Ok(tracer.environment_image(&receivers, &cells, (reach, rays), 1, true));
    }
    match options.effect.as_str() {
        "bent" => {
            let truth = tracer.bent_normal_image(&receivers, reach, rays, 1, true);
            report_angles(&truth, &rendered.pixels);
            let bent = |e: BentEstimate| ColorEstimate {
                mean: e.mean.normalize_or_zero(),
                standard_error: DVec3::ZERO,
            };
            Ok(truth.into_iter().map(|e| e.map(bent)).collect())
        }
        "sss" => subsurface::truth(options, scene, shot, (&tracer, &receivers), rays),
        "specular" => {
            let materials = scene.triangle_materials();
            let gloss = Gloss {
                eye: shot.eye,
                roughness: options.roughness.into(),
                f0: DVec3::splat(options.f0.into()),
            };
            let sources = (&materials[..], &shot.lights[..]);
            Ok(tracer.glossy_image(&receivers, &gloss, sources, (rays, 1), true))
        }
        "gi" => {
            let materials = scene.triangle_materials();
            let albedo = shot.albedo(scene, &tracer);
            let (lights, how) = (&shot.lights, (rays, 1));
            let bounces = options.bounces;
            let truth = tracer.bounces_image(&receivers, &materials, lights, bounces, how, true);
            let sent = |(estimate, albedo): (Option<ColorEstimate>, DVec3)| {
                estimate.map(|e| ColorEstimate {
                    mean: e.mean * albedo,
                    standard_error: e.standard_error * albedo,
                })
            };
            Ok(truth.into_iter().zip(albedo).map(sent).collect())
        }
        _ => {
            let truth = tracer.ambient_occlusion_image(&receivers, reach, rays, 1, true);
            let grey = |e: Estimate| ColorEstimate {
                mean: DVec3::splat(e.mean),
                standard_error: DVec3::splat(e.standard_error),
            };
            Ok(truth.into_iter().map(|e| e.map(grey)).collect())
        }
    }
}

/// How far a picture is off the truth, over the pixels that show something.
#[derive(Serialize)]
struct Off {
    rays: u32,
    rmse: f64,
    /// Root mean square of the truth's own standard errors, which is in `rmse`.
    noise: f64,
    bias: f64,
    /// Of the truth.
    mean: f64,
    pixels: u32,
}

/// How far a picture is off the truth, which it writes.
fn compare(
    options: &Options,
    scene: &Scene,
    shot: &Shot,
    rendered: &Rendered,
    radius: f32,
    rays: u32,
) -> Result<Off, String> {
    let truth = truth(options, scene, (shot, rendered), radius, rays)?;
    let pixels = &rendered.pixels[..];
    let (mut squares, mut noise, mut bias, mut mean) = (0.0, 0.0, 0.0, 0.0);
    let mut count = 0_u32;
    let empty = if options.colors() { [0.0; 3] } else { [1.0; 3] };
    let mut image = vec![empty; pixels.len()];
    let mut difference = vec![[0.0; 3]; pixels.len()];
    for (i, truth) in truth.iter().enumerate() {
        if let Some(truth) = truth {
            let error = DVec3::from(pixels[i].map(f64::from)) - truth.mean;
            image[i] = truth.mean.as_vec3().to_array();
            difference[i] = (4.0 * error.abs()).as_vec3().to_array();
            squares += error.length_squared() / 3.0;
            bias += error.element_sum() / 3.0;
            mean += truth.mean.element_sum() / 3.0;
            noise += truth.standard_error.length_squared() / 3.0;
            count += 1;
        }
    }
    write(options, shot, &image, "_reference")?;
    write(options, shot, &difference, "_difference_x4")?;
    write_beside(options, shot, &[pixels, &image, &difference])?;
    let n = f64::from(count.max(1));
    Ok(Off {
        rays,
        rmse: (squares / n).sqrt(),
        noise: (noise / n).sqrt(),
        bias: bias / n,
        mean: mean / n,
        pixels: count,
    })
}

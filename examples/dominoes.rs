//! One bounce of light, diffuse and glossy: `cargo run --release --example dominoes -- --out DIR`.
//!
//! Dominoes under a lamp stand on tiles that are polished and honed in turn (The Bounced Z-buffer, figure 1, shows the like).
//! Written are `direct.png`, `diffuse.png` and `glossy.png` (one bounce of what the surfels send), their sum `composed.png`,
//! and `glossy_difference_x4.png`, how far the glossy part is off one of many directions.
//!
//! `--frames N` joins N frames of few directions each by the temporal accumulator, says how far their mean is off many
//! directions after each doubling of N, and writes the sums `one_frame.png`, of the last frame alone, and `accumulated.png`.
//! With `--step` the camera moves.

use std::{
    f64::consts::PI,
    path::{Path, PathBuf},
};

use clap::Parser;
use deep_screen_space::{
    BouncedSettings, Camera, CloudCapacity, HitResolverDescriptor, HitResolverSettings, Light,
    Payload, Sampling, SurfelizerSettings, TemporalSettings, Viewport,
    glam::{DVec3, Vec3},
    reference::{
        gbuffer::{self, Pixel},
        ggx::Lobe,
        trace::Tracer,
    },
    scenes::{self, Scene},
    wgpu::{TextureFormat, TextureView},
};
use support::{
    arguments,
    bounced::{Gatherer, TracedScene},
    errors::rmse,
    files,
    gpu::{Ask, Gpu},
    raster::{Raster, perspective},
    scene::SceneBuffers,
    temporal::Accumulation,
};

const LIGHT: Light = Light::Point {
    position: DVec3::new(-2.4, 2.1, 2.5),
    intensity: [30.0, 28.0, 24.0],
};
const SKY: [f32; 3] = [0.08, 0.11, 0.16];
/// Of all surfaces: between lacquer and metal, so that the glossy part is well seen.
const F0: [f32; 3] = [0.2; 3];
const POLISHED: f32 = 0.08;
const HONED: f32 = 0.3;
const DOMINO: f32 = 0.6;
const EXPOSURE: f32 = 1.6;
/// The most that a pixel takes at once.
const MANY: u32 = 64;

type Picture = Vec<[f32; 3]>;
type Failure = Box<dyn std::error::Error>;

/// Dominoes on glossy tiles.
#[derive(Parser)]
struct Options {
    /// Where pictures go.
    #[arg(long, default_value = "out")]
    out: PathBuf,
    /// Size of the pictures in pixels, `WxH`.
    #[arg(long, default_value = "384x256", value_parser = arguments::parse_size)]
    size: [u32; 2],
    /// Rays per pixel, of each of the two kinds.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=64))]
    rays_per_pixel: u32,
    /// Half width of the window that shares hits, in pixels.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=16))]
    window: u32,
    /// How many frames to accumulate.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1 << 16))]
    frames: u32,
    /// Rays per pixel in each of them.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    frame_directions: u32,
    /// The same for the frames.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=16))]
    frame_window: u32,
    /// How far the camera moves from frame to frame, to where the other pictures are taken from, in millimetres.
    #[arg(long, default_value_t = 0.0)]
    step: f64,
    /// How many times 64 directions the truth has.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1 << 10))]
    truth: u32,
}

fn main() -> Result<(), Failure> {
    let options = Options::parse();
    std::fs::create_dir_all(&options.out)?;
    let mut studio = Studio::new(Gpu::open(Ask::from_env())?, options.size, &options.out)?;
    let shot = studio.shot(0.0)?;
    studio.light(&shot)?;

    let direct = studio.direct(&shot);
    let diffuse = studio.gather(Kind::Diffuse, &shot, options.rays_per_pixel, options.window)?;
    let glossy = studio.gather(Kind::Glossy, &shot, options.rays_per_pixel, options.window)?;
    studio.write("direct", &direct)?;
    studio.write("diffuse", &diffuse)?;
    studio.write("glossy", &glossy)?;
    studio.write("composed", &sum(&sum(&direct, &diffuse), &glossy))?;
    let truths = [
        studio.truth(Kind::Diffuse, &shot, options.truth)?,
        studio.truth(Kind::Glossy, &shot, options.truth)?,
    ];
    let difference = glossy.iter().zip(&truths[1]).map(|(found, truth)| {
        let difference = Vec3::from(*found) - Vec3::from(*truth);
        (4.0 * difference.abs()).to_array()
    });
    studio.write("glossy_difference_x4", &difference.collect::<Picture>())?;
    for (kind, found, truth) in [
        ("diffuse", &diffuse, &truths[0]),
        ("glossy", &glossy, &truths[1]),
    ] {
        println!(
            "{kind}: mean {:.4}, RMSE of {} rays per pixel with window {} {:.4}",
            mean(truth),
            options.rays_per_pixel,
            options.window,
            error(found, truth)
        );
    }
    if options.frames > 0 {
        let [one, all] = studio.accumulate(&options, &truths)?;
        studio.write("one_frame", &sum(&direct, &one))?;
        studio.write("accumulated", &sum(&direct, &all))?;
    }
    Ok(())
}

#[derive(Clone, Copy)]
enum Kind {
    Diffuse,
    Glossy,
}

/// What a camera sees.
struct Shot {
    camera: Camera,
    raster: Raster,
    pixels: Vec<Option<Pixel>>,
    roughness: Vec<f32>,
    roughness_texture: TextureView,
}

/// The scene, and the passes for one size of pictures.
struct Studio<'o> {
    gpu: Gpu,
    scene: Scene,
    buffers: SceneBuffers,
    tracer: Tracer,
    size: [u32; 2],
    senders: TracedScene,
    /// By [`Kind`].
    gatherers: [Gatherer; 2],
    out: &'o Path,
}

impl<'o> Studio<'o> {
    fn new(gpu: Gpu, size: [u32; 2], out: &'o Path) -> Result<Self, Failure> {
        let mut scene = scenes::dominoes();
        // A dark floor shows best what it mirrors.
        scene.materials[0].albedo = [0.12, 0.11, 0.1];
        let buffers = SceneBuffers::new(&gpu, &scene);
        let gatherer = |sampling, deferred| {
            let descriptor = HitResolverDescriptor {
                payload: Payload::Radiance,
                sampling,
                deferred,
                counted: false,
                joined: false,
                bent_normals: false,
                emitter_samples: 0,
                target: TextureFormat::Rgba32Float,
            };
            Gatherer::new(&gpu, descriptor, size, MANY, false)
        };
        let gatherers = [
            gatherer(Sampling::Cosine, false)?,
            gatherer(Sampling::Glossy, true)?,
        ];
        let triangles = buffers.triangles();
        let capacity = CloudCapacity {
            surfels: 1 << 20,
            pieces: triangles + 200_000,
            triangles,
        };
        Ok(Self {
            tracer: Tracer::of_scene(&scene)?,
            senders: TracedScene::new(&gpu, &gatherers[0], capacity)?,
            gatherers,
            gpu,
            scene,
            buffers,
            size,
            out,
        })
    }

    /// From `aside` metres beside the place of the pictures.
    fn shot(&self, aside: f64) -> Result<Shot, Failure> {
        let [width, height] = self.size;
        let camera = Camera::look_at(
            DVec3::new(-4.5 + aside, 0.72, 1.1),
            DVec3::new(-2.7, 0.1, -0.15),
            DVec3::Y,
            perspective(45.0, f64::from(width) / f64::from(height), 0.05),
            Viewport::full(width, height),
        )?;
        let Scene {
            positions,
            normals,
            indices,
            ..
        } = &self.scene;
        let pixels = gbuffer::cast(&camera, &self.tracer, positions, normals, indices);
        // An engine has it in its G-buffer.
        let roughness: Vec<f32> = pixels
            .iter()
            .map(|pixel| pixel.map_or(1.0, |p| roughness(p.receiver.position)))
            .collect();
        let format = TextureFormat::R32Float;
        Ok(Shot {
            raster: Raster::draw(&self.gpu, &self.buffers, &camera),
            roughness_texture: self.gpu.texture(format, width, height, &roughness),
            camera,
            pixels,
            roughness,
        })
    }

    /// Makes and lights the surfels for a camera.
    fn light(&mut self, shot: &Shot) -> Result<(), Failure> {
        let settings = SurfelizerSettings {
            radius_pixels: 2.0,
            // Small triangles whole: hits are exact.
            density: f32::INFINITY,
            ..SurfelizerSettings::default()
        };
        self.senders.update(
            &self.gpu,
            &self.buffers,
            &shot.camera,
            &[LIGHT],
            (&settings, 4),
        )?;
        Ok(())
    }

    /// Directly from the lamp, by one shadow ray per pixel, as an engine has it from its shadow map; the sky itself.
    fn direct(&self, shot: &Shot) -> Picture {
        let materials = self.scene.triangle_materials();
        let f0 = Vec3::from(F0).as_dvec3();
        let Light::Point { position, .. } = LIGHT else {
            unreachable!("the lamp is a point")
        };
        let pixels = shot.pixels.iter().zip(&shot.roughness);
        let picture = pixels.map(|(pixel, &roughness)| {
            let Some(pixel) = pixel else {
                return SKY;
            };
            let (at, normal) = (pixel.receiver.position, pixel.receiver.shading_normal);
            let to_light = (position - at).normalize();
            let lit = self.tracer.direct(at, normal, DVec3::ONE, &[LIGHT]);
            if lit == DVec3::ZERO {
                return [0.0; 3];
            }
            let to_eye = (shot.camera.eye() - at).normalize();
            let lobe = Lobe::new(normal, to_eye, f64::from(roughness));
            let light = lobe.frame.transpose() * to_light;
            let facet = lobe.facet_of(light);
            // The BRDF times the cosine, since the density times the share is that.
            let mirrored = lobe.pdf(facet) * lobe.share(light) * lobe.schlick(f0, facet);
            let albedo = Vec3::from(materials[pixel.triangle].albedo).as_dvec3();
            let reflectance = albedo + PI / normal.dot(to_light) * mirrored;
            (lit * reflectance).as_vec3().to_array()
        });
        picture.collect()
    }

    fn render(
        &mut self,
        kind: Kind,
        shot: &Shot,
        (rays_per_pixel, window, frame): (u32, u32, u32),
    ) -> Result<&Gatherer, Failure> {
        let gatherer = &mut self.gatherers[kind as usize];
        let traced = BouncedSettings {
            rays_per_pixel,
            frame,
            sky_radiance: SKY,
            ..BouncedSettings::default()
        };
        let settings = HitResolverSettings {
            radius: window,
            variance_clamp: if window > 0 { 4.0 } else { 0.0 },
            f0: F0,
            ..HitResolverSettings::default()
        };
        let roughness = match kind {
            Kind::Diffuse => None,
            Kind::Glossy => Some(shot.roughness_texture.texture()),
        };
        gatherer.render(
            &self.gpu,
            (&shot.raster, roughness),
            &shot.camera,
            &self.senders,
            (&traced, &settings),
            None,
        )?;
        Ok(gatherer)
    }

    /// What was rendered last.
    fn shown(&self, kind: Kind) -> Picture {
        colors(&self.gatherers[kind as usize].pixels(&self.gpu))
    }

    /// One bounce.
    fn gather(
        &mut self,
        kind: Kind,
        shot: &Shot,
        rays_per_pixel: u32,
        window: u32,
    ) -> Result<Picture, Failure> {
        self.render(kind, shot, (rays_per_pixel, window, 0))?;
        Ok(self.shown(kind))
    }

    /// The mean of many directions, without a window: what all others converge to. Its frames are none of theirs.
    fn truth(&mut self, kind: Kind, shot: &Shot, frames: u32) -> Result<Picture, Failure> {
        let mut sums = vec![DVec3::ZERO; shot.pixels.len()];
        for frame in 0..frames {
            self.render(kind, shot, (MANY, 0, (1 << 19) + frame))?;
            for (sum, color) in sums.iter_mut().zip(self.shown(kind)) {
                *sum += Vec3::from(color).as_dvec3();
            }
        }
        let means = sums.iter().map(|sum| *sum / f64::from(frames));
        Ok(means.map(|mean| mean.as_vec3().to_array()).collect())
    }

    /// The sum of both kinds over frames: of the last frame alone, and of the mean of all.
    fn accumulate(
        &mut self,
        options: &Options,
        truths: &[Picture; 2],
    ) -> Result<[Picture; 2], Failure> {
        let settings = TemporalSettings {
            max_frames: u32::MAX,
            ..TemporalSettings::default()
        };
        let history = || Accumulation::new(&self.gpu, self.size, settings);
        let mut histories = [history()?, history()?];
        let mut one = [Picture::new(), Picture::new()];
        let mut all = one.clone();
        for frame in 0..options.frames {
            let count = frame + 1;
            let left = f64::from(options.frames - count);
            let shot = self.shot(1e-3 * options.step * left)?;
            self.light(&shot)?;
            for kind in [Kind::Diffuse, Kind::Glossy] {
                let i = kind as usize;
                let how = (options.frame_directions, options.frame_window, frame);
                self.render(kind, &shot, how)?;
                one[i] = self.shown(kind);
                let (gpu, picture) = (&self.gpu, &self.gatherers[i].target);
                all[i] = colors(&histories[i].add(gpu, &shot.raster, &shot.camera, picture)?);
            }
            // The truth is that of where the camera stands in the end.
            let there = options.step == 0.0 || count == options.frames;
            if there && (count.is_power_of_two() || count == options.frames) {
                let [diffuse, glossy] = [0, 1].map(|i| {
                    let [one, all] = [&one, &all].map(|picture| error(&picture[i], &truths[i]));
                    format!("{all:.4} (one alone {one:.4})")
                });
                println!(
                    "{count} frames of {} rays per pixel: RMSE diffuse {diffuse}, glossy {glossy}",
                    options.frame_directions
                );
            }
        }
        Ok([one, all].map(|[diffuse, glossy]| sum(&diffuse, &glossy)))
    }

    fn write(&self, name: &str, picture: &[[f32; 3]]) -> Result<(), Failure> {
        let path = self.out.join(format!("{name}.png"));
        let [width, height] = self.size;
        files::write_png_rgb(
            &path,
            width,
            height,
            &files::tone_map(picture, EXPOSURE),
            1.0,
        )?;
        println!("{}", path.display());
        Ok(())
    }
}

/// Tiles of half a metre on the floor, and the dominoes.
fn roughness(at: DVec3) -> f32 {
    if at.y > 1e-3 {
        return DOMINO;
    }
    let tile = (2.0 * at.x).floor() + (2.0 * at.z).floor();
    if tile.rem_euclid(2.0) < 1.0 {
        POLISHED
    } else {
        HONED
    }
}

fn colors(pixels: &[[f32; 4]]) -> Picture {
    pixels.iter().map(|&[r, g, b, _]| [r, g, b]).collect()
}

fn sum(a: &[[f32; 3]], b: &[[f32; 3]]) -> Picture {
    a.iter()
        .zip(b)
        .map(|(a, b)| (Vec3::from(*a) + Vec3::from(*b)).to_array())
        .collect()
}

fn error(picture: &[[f32; 3]], truth: &[[f32; 3]]) -> f64 {
    rmse(picture.as_flattened(), truth.as_flattened())
}

fn mean(picture: &[[f32; 3]]) -> f64 {
    let values = picture.as_flattened();
    values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64
}

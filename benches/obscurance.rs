//! Volumetric obscurance by lines, points and areas: error and time of each beside the others, in one run:
//! `cargo bench --bench obscurance [-- --quick]`.
//!
//! Errors are root mean squares over pixels of all of the crate's scenes, against the integral itself: over the same depth
//! buffer, and over the geometry as the eye sees it, by some thousands of points per pixel. Times are wall clock over a
//! submission at the full size, the fastest of many that take turns. Prints a table and writes
//! `target/bench/obscurance.json`.

use std::process::ExitCode;

use clap::Parser;
use deep_screen_space::{
    BallSamples, Camera, DepthMoments, DiskSamples, NormalEncoding, NormalSpace, Normals,
    ObscuranceInput, ObscuranceSampling, ObscuranceSettings, ObscuranceVolume,
    VolumetricObscurance, VolumetricObscuranceDescriptor,
    glam::DVec3,
    reference::{
        gbuffer::{Pixel, cast},
        receivers::Decoder,
        trace::Tracer,
        volumetric_obscurance::{DepthBuffer, integral_of_geometry},
    },
    scenes::{self, Scene},
    wgpu::{self, TextureFormat},
};
use rayon::prelude::*;
use support::{
    bench,
    gpu::{Ask, Gpu},
    raster::camera_of,
};

/// What is compared, and the box's half width where it has one.
const METHODS: [(&str, ObscuranceSampling, f32); 17] = {
    use ObscuranceSampling::{Areas, Lines, OneArea, Points};
    const ROOT_3: f32 = 1.732_050_8;
    [
        ("points", Points(BallSamples::Six), ROOT_3),
        ("points", Points(BallSamples::Twelve), ROOT_3),
        ("points", Points(BallSamples::ThirtyThree), ROOT_3),
        ("lines", Lines(DiskSamples::Five), ROOT_3),
        ("lines", Lines(DiskSamples::Six), ROOT_3),
        ("lines", Lines(DiskSamples::Seven), ROOT_3),
        ("lines", Lines(DiskSamples::Nine), ROOT_3),
        ("lines, around", Lines(DiskSamples::TwelveAround), ROOT_3),
        ("lines", Lines(DiskSamples::Thirteen), ROOT_3),
        ("lines, around", Lines(DiskSamples::ThirteenAround), ROOT_3),
        ("lines, around", Lines(DiskSamples::FifteenAround), ROOT_3),
        ("lines", Lines(DiskSamples::Sixteen), ROOT_3),
        ("area, sqrt(3) sigma", OneArea, ROOT_3),
        ("area, sigma", OneArea, 1.0),
        ("areas, sqrt(3) sigma", Areas(DiskSamples::Five), ROOT_3),
        ("areas, sigma", Areas(DiskSamples::Five), 1.0),
        ("areas, sqrt(3) sigma", Areas(DiskSamples::Nine), ROOT_3),
    ]
};

const TWELVE_POINTS: usize = 1;

/// Six, of which the one in the centre looks nothing up.
const FIVE_LINES: usize = 4;

/// A scene's first view with what the passes read, and the truth of some of its pixels.
struct Stage {
    camera: Camera,
    radius: f32,
    depth: wgpu::TextureView,
    normal: wgpu::TextureView,
    target: wgpu::TextureView,
    /// Pixels, and their integrals over the depth buffer and over the geometry.
    truth: Vec<([u32; 2], [f64; 2])>,
}

/// How much of it.
struct Effort {
    size: [u32; 2],
    /// Every n-th column and row is compared.
    stride: u32,
    /// Points a side of the grid about a pixel's sphere.
    side: u32,
    runs: usize,
}

impl Stage {
    fn new(gpu: &Gpu, scene: &Scene, volume: ObscuranceVolume, effort: &Effort) -> Self {
        let [width, height] = effort.size;
        let camera = camera_of(scene, [width, height]);
        let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a valid mesh");
        let pixels: Vec<Option<Pixel>> = cast(
            &camera,
            &tracer,
            &scene.positions,
            &scene.normals,
            &scene.indices,
        );
        let depths: Vec<f32> = pixels
            .iter()
            .map(|p| p.map_or(0.0, |p| p.depth as f32))
            .collect();
        let normal = |p: &Option<Pixel>| p.map_or(DVec3::ZERO, |p| p.receiver.shading_normal);
        let normals: Vec<[f32; 3]> = pixels
            .iter()
            .map(|p| normal(p).as_vec3().to_array())
            .collect();
        let texels: Vec<[f32; 4]> = normals.iter().map(|n| [n[0], n[1], n[2], 0.0]).collect();
        let radius = 0.25 * scene.ao_radius;
        let settings = settings(radius, 1.0);
        let buffer = DepthBuffer {
            decoder: Decoder {
                camera: &camera,
                origin: DVec3::ZERO,
                depth_format: TextureFormat::R32Float,
                normal_encoding: NormalEncoding::Signed,
                normal_space: NormalSpace::World,
            },
            depths: &depths,
            normals: &normals,
        };
        let [columns, rows] = effort.size.map(|n| n / effort.stride);
        let truth = (0..columns * rows)
            .into_par_iter()
            .filter_map(|i| {
                let pixel = [i % columns, i / columns].map(|n| n * effort.stride);
                let seen = pixels[(pixel[1] * width + pixel[0]) as usize]?;
                let of_depth = buffer.integral(pixel, volume, &settings, effort.side);
                let of_geometry = integral_of_geometry(
                    &camera,
                    &tracer,
                    &seen.receiver,
                    volume,
                    &settings,
                    effort.side,
                );
                Some((pixel, [of_depth, of_geometry]))
            })
            .collect();
        Self {
            depth: gpu.texture(TextureFormat::R32Float, width, height, &depths),
            normal: gpu.texture(TextureFormat::Rgba32Float, width, height, &texels),
            camera,
            radius,
            target: gpu.storage(TextureFormat::R32Float, width, height),
            truth,
        }
    }

    /// Milliseconds of one run.
    fn run(
        &self,
        gpu: &Gpu,
        pass: &VolumetricObscurance,
        moments: &DepthMoments,
        at: usize,
    ) -> f64 {
        let (_, sampling, half_width) = METHODS[at];
        let areas = matches!(
            sampling,
            ObscuranceSampling::Areas(_) | ObscuranceSampling::OneArea
        );
        let input = ObscuranceInput {
            depth: self.depth.texture().into(),
            normals: Some(Normals {
                texture: self.normal.texture().into(),
                encoding: NormalEncoding::Signed,
                space: NormalSpace::World,
            }),
            camera: &self.camera,
            moments: areas.then_some(moments),
            work: None,
            target: self.target.texture().into(),
            timestamps: None,
        };
        let (ms, recorded) = gpu.time(|encoder| {
            if areas {
                pass.record_moments(
                    &gpu.device,
                    encoder,
                    self.depth.texture().into(),
                    &self.camera,
                    moments,
                    None,
                )?;
            }
            pass.record(
                &gpu.device,
                encoder,
                &input,
                &settings(self.radius, half_width),
            )
        });
        recorded.expect("valid input");
        ms
    }

    /// Sums of squares of errors against both truths, and of the errors against the second.
    fn errors(&self, gpu: &Gpu) -> [f64; 3] {
        let width = self.camera.viewport().width;
        let image: Vec<f32> = gpu.read_texture(self.target.texture(), 0);
        let mut sums = [0.0; 3];
        for (pixel, truth) in &self.truth {
            let open = f64::from(image[(pixel[1] * width + pixel[0]) as usize]);
            for (sum, truth) in sums.iter_mut().zip(truth) {
                *sum += (open - truth) * (open - truth);
            }
            sums[2] += open - truth[1];
        }
        sums
    }
}

fn settings(radius: f32, box_half_width: f32) -> ObscuranceSettings {
    ObscuranceSettings {
        radius,
        box_half_width,
        ..ObscuranceSettings::default()
    }
}

/// Volumetric obscurance by lines, points and areas: error and time of each beside the others, in one run.
#[derive(Parser)]
struct Options {
    /// Few scenes, small pictures, and times that are not asserted.
    #[arg(long)]
    quick: bool,
    /// What cargo adds; without a meaning here.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> ExitCode {
    let Options { quick, .. } = Options::parse();
    let gpu = Gpu::open(Ask::All).expect("a graphics adapter");
    println!("{}", gpu.name());
    let effort = if quick {
        Effort {
            size: [256, 256],
            stride: 16,
            side: 16,
            runs: 3,
        }
    } else {
        Effort {
            size: [1024, 1024],
            stride: 32,
            side: 24,
            runs: 15,
        }
    };
    let names = if quick {
        &["cornell", "colonnade"][..]
    } else {
        &["cornell", "closed_room", "colonnade", "dominoes", "fence"]
    };
    let mut rows = Vec::new();
    let mut holds = true;
    for volume in [ObscuranceVolume::Sphere, ObscuranceVolume::Hemisphere] {
        let mut squares = vec![[0.0; 3]; METHODS.len()];
        let mut times = vec![0.0; METHODS.len()];
        let mut count = 0;
        let passes: Vec<_> = METHODS
            .iter()
            .map(|&(_, sampling, _)| {
                let descriptor = VolumetricObscuranceDescriptor { sampling, volume };
                VolumetricObscurance::new(&gpu.device, &descriptor).expect("pipelines")
            })
            .collect();
        let moments = passes[0]
            .create_moments(&gpu.device, effort.size[0], effort.size[1])
            .expect("within limits");
        for name in names {
            let scene = scenes::by_name(name).expect("a scene of the crate");
            let stage = Stage::new(&gpu, &scene, volume, &effort);
            count += stage.truth.len();
            let mut best = vec![f64::INFINITY; METHODS.len()];
            // The first run compiles.
            for run in 0..=effort.runs {
                for (at, pass) in passes.iter().enumerate() {
                    let ms = stage.run(&gpu, pass, &moments, at);
                    if run == 0 {
                        let sums = stage.errors(&gpu);
                        for (total, sum) in squares[at].iter_mut().zip(sums) {
                            *total += sum;
                        }
                    } else {
                        best[at] = best[at].min(ms);
                    }
                }
            }
            for (total, ms) in times.iter_mut().zip(best) {
                *total += ms / names.len() as f64;
            }
        }
        println!(
            "{volume:?}, {}x{}, means over {names:?}",
            effort.size[0], effort.size[1]
        );
        println!(
            "{:22} {:>7} {:>9} {:>9} {:>11} {:>14} {:>9}",
            "method", "looks", "ms", "/12 pts", "RMSE depth", "RMSE geometry", "bias"
        );
        let rmse = |at: usize| [0, 1].map(|truth| (squares[at][truth] / count as f64).sqrt());
        for (at, &(name, sampling, _)) in METHODS.iter().enumerate() {
            let looks = match sampling {
                ObscuranceSampling::Points(table) => table.table().len(),
                // The line through the centre sees the point itself.
                ObscuranceSampling::Lines(table) => {
                    table.table().iter().filter(|p| p[..2] != [0.0; 2]).count()
                }
                ObscuranceSampling::Areas(table) => table.table().len(),
                ObscuranceSampling::OneArea => 1,
            };
            let ratio = times[at] / times[TWELVE_POINTS];
            let [of_depth, of_geometry] = rmse(at);
            let bias = squares[at][2] / count as f64;
            println!(
                "{name:22} {looks:>7} {:>9.3} {ratio:>9.2} {of_depth:>11.4} {of_geometry:>14.4} {bias:>+9.4}",
                times[at]
            );
            rows.push(serde_json::json!({
                "adapter": gpu.adapter.name,
                "volume": format!("{volume:?}"),
                "method": name,
                "table": format!("{sampling:?}"),
                "looks": looks,
                "width": effort.size[0],
                "height": effort.size[1],
                "ms": times[at],
                "time_over_12_points": ratio,
                "rmse_depth": of_depth,
                "rmse_geometry": of_geometry,
                "bias_geometry": bias,
            }));
        }
        let better = rmse(FIVE_LINES)[0] <= rmse(TWELVE_POINTS)[0];
        let faster = times[FIVE_LINES] <= 0.6 * times[TWELVE_POINTS];
        println!(
            "5 lines: error no larger than that of 12 points: {better}; time at most 0.6 of theirs: {faster}"
        );
        // On a shared machine the time of a small picture says little.
        holds &= better && (faster || quick);
    }
    bench::write_rows("obscurance", &rows).expect("target can be written");
    if holds {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

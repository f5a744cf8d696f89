//! What a frame of each method costs on the CPU: `cargo bench --bench recording [-- --quick]`.
//!
//! Prints microseconds of recording a frame, of finishing its encoder and submitting it, the fastest of many, since a shared
//! machine only ever adds time; and how many buffers, bind groups and texture views the recording made, as in most frames. The
//! view stays: what is kept from frame to frame is there by then. Pictures are small, since what the GPU does is not measured.
//! Writes `target/bench/recording.json`.

use std::time::{Duration, Instant};

use clap::Parser;
use deep_screen_space::{
    AmbientOcclusion, BouncedDescriptor, BouncedInput, BouncedSettings, BouncedZBuffer, BvhBuilder,
    Camera, Channels, CloudCapacity, ClusterInput, Components, DiskSamples, Error, FrameInput,
    GBuffer, GBufferDecoder, Gatherer, Geometry, HitLighting, HitRadiance, HitResolverInput,
    HitResolverSettings, Light, Mesh, MultiResMask, MultiResMaskInput, MultiResMaskSettings,
    MultiResReconstructor, MultiResReconstructorInput, MultiResReconstructorSettings,
    ObscuranceInput, ObscuranceSampling, ObscuranceSettings, ObscuranceVolume, Payload, Primitives,
    ReconstructorInput, ReconstructorSettings, SgHull, SgHullDescriptor, SgHullInput,
    SgHullSettings, SgHullSize, ShadedLight, Shadow, ShellSplatter, ShellSplatterDescriptor,
    SplatInput, SplatSettings, SurfelShader, SurfelShaderInput, SurfelShaderSettings, Surfelizer,
    SurfelizerInput, SurfelizerSettings, TemporalAccumulator, TemporalInput, TemporalSettings,
    Viewport, VolumetricObscurance, VolumetricObscuranceDescriptor,
    reference::objects::Objects,
    scenes,
    wgpu::{self, CommandEncoder, TextureFormat as Format},
};
use support::{
    bench,
    gpu::{Ask, Gpu},
    raster::{Raster, perspective},
    scene::SceneBuffers,
};

const SIDE: u32 = 64;

/// Draws that the scene is cut into where it is cut into many.
const DRAWS: u32 = 256;

/// Frames after which what is kept is there.
const WARM: usize = 8;

/// Room that a scene of an engine might need: what is recorded depends on it, not on the scene.
const CAPACITY: CloudCapacity = CloudCapacity {
    surfels: 1 << 16,
    pieces: 1 << 16,
    triangles: 1 << 16,
};

/// What all methods work on.
struct Bench {
    gpu: Gpu,
    frames: usize,
    camera: Camera,
    buffers: SceneBuffers,
    raster: Raster,
    lamp: Light,
}

type Rows = Vec<serde_json::Value>;

/// What a frame of each method costs on the CPU.
#[derive(Parser)]
struct Options {
    /// Few frames.
    #[arg(long)]
    quick: bool,
    /// What cargo adds; without a meaning here.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() {
    let Options { quick, .. } = Options::parse();
    let gpu = Gpu::open(Ask::Floor).expect("a graphics adapter");
    println!("{}", gpu.name());
    println!(
        "{:24} {:>9} {:>9} {:>8} {:>7} {:>6}",
        "method", "record us", "submit us", "buffers", "groups", "views"
    );
    let scene = scenes::cornell();
    let view = &scene.views[0];
    let camera = Camera::look_at(
        view.eye.into(),
        view.target.into(),
        view.up.into(),
        perspective(view.vertical_fov_degrees, 1.0, view.near),
        Viewport::full(SIDE, SIDE),
    )
    .expect("a scene's own view");
    let buffers = SceneBuffers::new(&gpu, &scene);
    let bench = Bench {
        raster: Raster::draw(&gpu, &buffers, &camera),
        frames: if quick { 20 } else { 100 },
        lamp: Light::Point {
            position: camera.eye(),
            intensity: [1.0; 3],
        },
        camera,
        buffers,
        gpu,
    };
    let mut rows = Rows::new();
    for method in [
        surfels,
        splatted,
        bounced,
        obscurance,
        multi_resolution,
        hull,
        temporal,
    ] {
        method(&bench, &mut rows).expect("what is right is accepted");
    }
    bench::write_rows("recording", &rows).expect("target can be written");
}

impl Bench {
    fn device(&self) -> &wgpu::Device {
        &self.gpu.device
    }

    fn gbuffer(&self) -> GBuffer<'_> {
        self.raster.gbuffer()
    }

    fn frame(&self) -> FrameInput<'_> {
        FrameInput::new(self.gbuffer(), &self.camera)
    }

    /// Times a method's frames.
    fn measure(
        &self,
        rows: &mut Rows,
        name: &str,
        mut record: impl FnMut(&mut CommandEncoder) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let mut frames: Vec<(Duration, Duration, Objects)> = Vec::new();
        for frame in 0..self.frames + WARM {
            let before = Objects::made();
            let mut encoder = self.gpu.encoder();
            let start = Instant::now();
            record(&mut encoder)?;
            let recorded = start.elapsed();
            let start = Instant::now();
            self.gpu.queue.submit([encoder.finish()]);
            let submitted = start.elapsed();
            self.device()
                .poll(wgpu::PollType::wait_indefinitely())
                .expect("the device answers");
            if frame >= WARM {
                frames.push((recorded, submitted, Objects::made().since(before)));
            }
        }
        let fastest = |time: &dyn Fn(&(Duration, Duration, Objects)) -> f64| {
            frames.iter().map(time).fold(f64::INFINITY, f64::min)
        };
        let median = |number: &dyn Fn(&(Duration, Duration, Objects)) -> f64| {
            let mut numbers: Vec<f64> = frames.iter().map(number).collect();
            numbers.sort_by(f64::total_cmp);
            numbers[numbers.len() / 2]
        };
        let recorded = fastest(&|frame| frame.0.as_secs_f64() * 1e6);
        let submitted = fastest(&|frame| frame.1.as_secs_f64() * 1e6);
        let buffers = median(&|frame| frame.2.buffers as f64);
        let groups = median(&|frame| frame.2.bind_groups as f64);
        let views = median(&|frame| frame.2.texture_views as f64);
        println!("{name:24} {recorded:9.0} {submitted:9.0} {buffers:8} {groups:7} {views:6}");
        rows.push(serde_json::json!({
            "adapter": self.gpu.adapter.name,
            "method": name,
            "record_us": recorded,
            "submit_us": submitted,
            "buffers": buffers,
            "bind_groups": groups,
            "texture_views": views,
        }));
        Ok(())
    }
}

/// One draw, and many of a few triangles each.
fn surfels(bench: &Bench, rows: &mut Rows) -> Result<(), Error> {
    let surfelizer = Surfelizer::new(bench.device())?;
    let all = bench.buffers.meshes()[0];
    let each = (all.count / 3).div_ceil(DRAWS) * 3;
    let many: Vec<Mesh<'_>> = (0..DRAWS)
        .map(|draw| Mesh {
            first: all.first + draw * each % (all.count - each + 1) / 3 * 3,
            count: each,
            ..all
        })
        .collect();
    let cut = format!("surfels, {DRAWS} draws");
    for (name, meshes) in [("surfels, 1 draw", &[all][..]), (&cut, &many)] {
        let mut cloud = surfelizer.create_cloud(bench.device(), CAPACITY)?;
        let input = SurfelizerInput {
            geometry: Geometry { meshes },
            camera: &bench.camera,
            cull_by: &[bench.camera],
            timestamps: None,
        };
        let settings = SurfelizerSettings::default();
        bench.measure(rows, name, |encoder| {
            surfelizer.record(bench.device(), encoder, &input, &settings, &mut cloud)
        })?;
    }
    Ok(())
}

/// Ambient occlusion by splatting, on all levels.
fn splatted(bench: &Bench, rows: &mut Rows) -> Result<(), Error> {
    let device = bench.device();
    let camera = &bench.camera;
    let effect = AmbientOcclusion::default().effect();
    let settings = SplatSettings::default();
    let surfelizer = Surfelizer::new(device)?;
    let descriptor = ShellSplatterDescriptor {
        effect: &effect,
        subgroups: false,
        statistics: false,
    };
    let splatter = ShellSplatter::new(device, &descriptor)?;
    let reconstructor = splatter.reconstructor(device, Format::R32Float)?;
    let decoder = GBufferDecoder::new(device)?;
    let mut receivers = decoder.create_receivers(device, SIDE, SIDE)?;
    let mut cloud = surfelizer.create_cloud(device, CAPACITY)?;
    let mut clusters = splatter.create_clusters(device, &cloud, settings.levels)?;
    let sums = splatter.create_view(device, SIDE, SIDE, settings.levels)?;
    let scratch = reconstructor.create_view(device, &sums)?;
    let target = bench.gpu.target(Format::R32Float, SIDE, SIDE);
    let meshes = bench.buffers.meshes();
    bench.measure(rows, "occlusion, splatted", |encoder| {
        let input = SurfelizerInput {
            geometry: Geometry { meshes: &meshes },
            camera,
            cull_by: &[*camera],
            timestamps: None,
        };
        let surfels = SurfelizerSettings {
            reach: ShellSplatter::reach(&settings),
            ..SurfelizerSettings::default()
        };
        surfelizer.record(device, encoder, &input, &surfels, &mut cloud)?;
        let input = ClusterInput::new(&cloud);
        splatter.record_clusters(device, encoder, &input, &settings, &mut clusters)?;
        let frame = decoder.record(device, encoder, &bench.frame(), &mut receivers)?;
        let input = SplatInput::new(&frame, &cloud, &clusters);
        splatter.record(device, encoder, &input, &settings, &sums)?;
        let input = ReconstructorInput::new(&frame, &sums, target.texture());
        let settings = ReconstructorSettings::default();
        reconstructor.record(device, encoder, &input, &settings, &scratch)
    })
}

/// Occlusion and light by rays, of hits that are lit themselves and of lit surfels.
fn bounced(bench: &Bench, rows: &mut Rows) -> Result<(), Error> {
    let device = bench.device();
    let camera = &bench.camera;
    let surfelizer = Surfelizer::new(device)?;
    let builder = BvhBuilder::new(device, Primitives::Triangles)?;
    let shader = SurfelShader::new(device)?;
    let meshes = bench.buffers.meshes();
    let decoder = GBufferDecoder::new(device)?;
    let mut receivers = decoder.create_receivers(device, SIDE, SIDE)?;
    for (name, payload) in [
        ("occlusion, bounced", Payload::Occlusion),
        ("light, bounced", Payload::LitRadiance),
        ("light, lit surfels", Payload::Radiance),
    ] {
        let descriptor = BouncedDescriptor {
            payload,
            ..BouncedDescriptor::default()
        };
        let has_surfels = payload == Payload::Radiance;
        let tracer = BouncedZBuffer::new(device, &descriptor)?;
        let resolver = tracer.resolver(device, Format::Rgba16Float, false)?;
        let mut cloud = surfelizer.create_cloud(
            device,
            CloudCapacity {
                surfels: if has_surfels { CAPACITY.surfels } else { 0 },
                ..CAPACITY
            },
        )?;
        let radiance = shader.create_radiance(device, &cloud)?;
        let bvh = builder.create(device, &cloud)?;
        let rays = BouncedSettings::default();
        let hits = tracer.create_view(device, SIDE, SIDE, rays.rays_per_pixel)?;
        let scratch = resolver.create_view(device, &hits)?;
        let target = bench.gpu.target(Format::Rgba16Float, SIDE, SIDE);
        let lights = [bench.lamp];
        bench.measure(rows, name, |encoder| {
            let input = SurfelizerInput {
                geometry: Geometry { meshes: &meshes },
                camera,
                cull_by: &[*camera],
                timestamps: None,
            };
            let settings = SurfelizerSettings::default();
            surfelizer.record(device, encoder, &input, &settings, &mut cloud)?;
            builder.record(device, encoder, &cloud, &bvh, None)?;
            if has_surfels {
                let input = SurfelShaderInput {
                    cloud: &cloud,
                    materials: &bench.buffers.materials,
                    lights: &lights.map(|light| ShadedLight {
                        light,
                        shadow: Shadow::Traced(&bvh),
                    }),
                    radiance: &radiance,
                    timestamps: None,
                };
                shader.record(device, encoder, &input, &SurfelShaderSettings::default())?;
            }
            let frame = decoder.record(device, encoder, &bench.frame(), &mut receivers)?;
            let input = BouncedInput {
                radiance: match payload {
                    Payload::Occlusion | Payload::Sky => HitRadiance::None,
                    Payload::Radiance => HitRadiance::Surfels(&radiance),
                    _ => HitRadiance::Lit(HitLighting {
                        materials: &bench.buffers.materials,
                        lights: &lights,
                    }),
                },
                ..BouncedInput::new(&frame, &cloud, &bvh)
            };
            tracer.record(device, encoder, &input, &rays, &hits)?;
            let input = HitResolverInput::new(&frame, &hits, target.texture());
            let settings = HitResolverSettings::default();
            resolver.record(device, encoder, &input, &settings, &scratch)
        })?;
    }
    Ok(())
}

/// Obscurance by lines with normals, and by areas.
fn obscurance(bench: &Bench, rows: &mut Rows) -> Result<(), Error> {
    let device = bench.device();
    let target = bench.gpu.storage(Format::R32Float, SIDE, SIDE);
    for (name, sampling, volume) in [
        (
            "obscurance, lines",
            ObscuranceSampling::Lines(DiskSamples::Five),
            ObscuranceVolume::Hemisphere,
        ),
        (
            "obscurance, areas",
            ObscuranceSampling::Areas(DiskSamples::Five),
            ObscuranceVolume::Sphere,
        ),
    ] {
        let descriptor = VolumetricObscuranceDescriptor { sampling, volume };
        let pass = VolumetricObscurance::new(device, &descriptor)?;
        let has_moments = volume == ObscuranceVolume::Sphere;
        let moments = pass.create_moments(device, SIDE, SIDE)?;
        let gbuffer = bench.gbuffer();
        let depth = gbuffer.depth;
        bench.measure(rows, name, |encoder| {
            if has_moments {
                pass.record_moments(device, encoder, depth, &bench.camera, &moments, None)?;
            }
            let input = ObscuranceInput {
                depth,
                normals: Some(gbuffer.normals()),
                camera: &bench.camera,
                moments: has_moments.then_some(&moments),
                work: None,
                target: target.texture().into(),
                timestamps: None,
            };
            pass.record(device, encoder, &input, &ObscuranceSettings::default())
        })?;
    }
    Ok(())
}

/// Obscurance on all levels of a mask, and the picture of them.
fn multi_resolution(bench: &Bench, rows: &mut Rows) -> Result<(), Error> {
    let device = bench.device();
    let camera = &bench.camera;
    let mask = MultiResMask::new(device)?;
    let settings = MultiResMaskSettings::OCCLUSION;
    let descriptor = VolumetricObscuranceDescriptor {
        sampling: ObscuranceSampling::Lines(DiskSamples::Five),
        volume: ObscuranceVolume::Sphere,
    };
    let effect = VolumetricObscurance::new(device, &descriptor)?;
    let blend = MultiResReconstructor::new(device, Channels::One, Format::R32Float)?;
    let mut masks = mask.create_view(device, SIDE, SIDE, false)?;
    let images = blend.create_images(device, SIDE, SIDE, &settings)?;
    let target = bench.gpu.target(Format::R32Float, SIDE, SIDE);
    bench.measure(rows, "multi-resolution", |encoder| {
        let input = MultiResMaskInput {
            gbuffer: bench.gbuffer(),
            camera,
            shading: None,
            edges: None,
            importance: None,
            timestamps: None,
        };
        mask.record(device, encoder, &input, &settings, &mut masks)?;
        for level in 0..4 {
            let (Some(work), Some(image)) = (masks.work(level), images.level(level)) else {
                continue;
            };
            let input = ObscuranceInput {
                depth: bench.gbuffer().depth,
                normals: None,
                camera,
                moments: None,
                work: Some(work),
                target: image.into(),
                timestamps: None,
            };
            effect.record(device, encoder, &input, &ObscuranceSettings::default())?;
        }
        let input = MultiResReconstructorInput {
            gbuffer: bench.gbuffer(),
            camera,
            masks: &masks,
            images: &images,
            target: target.texture().into(),
            timestamps: None,
        };
        let settings = MultiResReconstructorSettings::default();
        blend.record(device, encoder, &input, &settings)
    })
}

/// The hull with a light.
fn hull(bench: &Bench, rows: &mut Rows) -> Result<(), Error> {
    let device = bench.device();
    let origin = bench.camera.focus();
    let gatherer = Gatherer::lights(device);
    let descriptor = SgHullDescriptor {
        gatherer: &gatherer,
        target: Format::Rgba16Float,
        albedo: false,
        glossy: false,
        components: Components::default(),
    };
    let decoder = GBufferDecoder::new(device)?;
    let mut receivers = decoder.create_receivers(device, SIDE, SIDE)?;
    let hull = SgHull::new(device, &descriptor)?;
    let view = hull.create_view(device, SgHullSize::new(SIDE, SIDE))?;
    let lights = gatherer.bind_lights(device, &[bench.lamp], origin)?;
    let target = bench.gpu.target(Format::Rgba16Float, SIDE, SIDE);
    bench.measure(rows, "hull", |encoder| {
        let frame = decoder.record(device, encoder, &bench.frame(), &mut receivers)?;
        let input = SgHullInput {
            frame: &frame,
            gather: Some(&lights),
            target: target.texture().into(),
            timestamps: None,
        };
        hull.record(device, encoder, &input, &SgHullSettings::default(), &view)
    })
}

/// The mean over frames of a picture.
fn temporal(bench: &Bench, rows: &mut Rows) -> Result<(), Error> {
    let device = bench.device();
    let decoder = GBufferDecoder::new(device)?;
    let mut receivers = decoder.create_receivers(device, SIDE, SIDE)?;
    let frames = TemporalAccumulator::new(device, Channels::Three, Format::Rgba16Float)?;
    let mut history = frames.create_history(device, SIDE, SIDE)?;
    let target = bench.gpu.target(Format::Rgba16Float, SIDE, SIDE);
    bench.measure(rows, "temporal", |encoder| {
        let frame = decoder.record(device, encoder, &bench.frame(), &mut receivers)?;
        let input = TemporalInput {
            frame: &frame,
            previous_camera: &bench.camera,
            motion: None,
            picture: bench.raster.albedo.texture().into(),
            target: target.texture().into(),
            reset: false,
            timestamps: None,
        };
        let settings = TemporalSettings::default();
        frames.record(device, encoder, &input, &settings, &mut history)
    })
}

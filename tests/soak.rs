//! Memory while what belongs to a view is made, recorded and dropped over and over, as an engine does that resizes its window
//! or changes its scene: it stays where it is, pass by pass.
//!
//! But for lavapipe of Mesa 22.3. It puts the values of uniforms that branches and loops depend on into a copy of the shader at
//! each dispatch and, where less than half of the shader is left, keeps the copy until the pipeline is dropped. `keeps_copies` is
//! the smallest program that shows it, without this crate: 0.13 MB per dispatch. Passes whose loops end at a setting grow by
//! as much there, by each recording, whether anything is made anew or not. What is told of them is then not held against them.
//!
//! `DSS_SOAK_CYCLES` is how many cycles each pass has, and `DSS_SOAK_PASS` the name of the one pass to run. Linux alone tells how
//! much memory a process has.
#![cfg(target_os = "linux")]

use deep_screen_space::{
    AmbientOcclusion, BouncedDescriptor, BouncedInput, BouncedSettings, BouncedZBuffer, BvhBuilder,
    Channels, CloudCapacity, ClusterInput, Components, DiskSamples, Error, FrameInput,
    GBufferDecoder, Gatherer, Geometry, HitResolver, HitResolverDescriptor, HitResolverInput,
    HitResolverSettings, Light, MultiResMask, MultiResMaskInput, MultiResMaskSettings,
    MultiResReconstructor, MultiResReconstructorInput, MultiResReconstructorSettings,
    ObscuranceInput, ObscuranceSampling, ObscuranceSettings, ObscuranceVolume, Payload, Primitives,
    Reconstructor, ReconstructorInput, ReconstructorSettings, Sampling, ScreenSpaceGi,
    ScreenSpaceGiInput, ScreenSpaceGiSettings, SgHull, SgHullDescriptor, SgHullInput,
    SgHullSettings, SgHullSize, ShadedLight, Shadow, ShadowMap, ShellSplatter,
    ShellSplatterDescriptor, SoftShadows, SoftShadowsInput, SoftShadowsSettings, SplatInput,
    SplatSettings, SurfelShader, SurfelShaderInput, SurfelShaderSettings, Surfelizer,
    SurfelizerInput, SurfelizerSettings, TemporalAccumulator, TemporalInput, TemporalSettings,
    VolumetricObscurance, VolumetricObscuranceDescriptor,
    glam::DVec3,
    scenes,
    wgpu::{self, CommandEncoder, TextureFormat as Format},
};
use support::gpu::{Ask, Gpu};
use support::testing::frames::Decoded;
use support::testing::shot::{Shot, camera_of};

const SIDE: u32 = 24;

/// Resident memory of the process, bytes.
fn resident() -> f64 {
    let statm = std::fs::read_to_string("/proc/self/statm").expect("a Linux process");
    let pages = statm.split(' ').nth(1).and_then(|n| n.parse::<f64>().ok());
    4096.0 * pages.expect("a number of pages")
}

struct Soak<'a> {
    gpu: &'a Gpu,
    cycles: u32,
    only: Option<String>,
    /// Whether the driver keeps copies of shaders that loop as often as a uniform says.
    driver_keeps: bool,
    failed: Vec<String>,
}

impl Soak<'_> {
    /// Runs a pass's cycles, after as many as it takes for pools and caches to fill.
    fn pass(
        &mut self,
        name: &str,
        mut cycle: impl FnMut(&mut CommandEncoder) -> Result<(), Error>,
    ) {
        if self.only.as_ref().is_some_and(|only| only != name) {
            return;
        }
        let mut run = |count| {
            for _ in 0..count {
                let mut encoder = self.gpu.encoder();
                cycle(&mut encoder).expect("what is right is accepted");
                self.gpu.finish(encoder);
            }
        };
        run(self.cycles.clamp(50, 500));
        let before = resident();
        let start = std::time::Instant::now();
        run(self.cycles);
        let ms = start.elapsed().as_secs_f64() * 1e3 / f64::from(self.cycles);
        let grown = (resident() - before) / 1e6;
        println!(
            "{name:<16} {grown:8.2} MB in {} cycles, {:.3} a thousand; {ms:.1} ms each",
            self.cycles,
            1e3 * grown / f64::from(self.cycles)
        );
        // Pages that allocators keep, and what they fragment.
        if grown > 4.0 + 0.001 * f64::from(self.cycles) {
            if self.driver_keeps && LOOPS.contains(&name) {
                println!("  (the driver's)");
            } else {
                self.failed.push(format!("{name} {grown} MB"));
            }
        }
    }
}

/// Passes that loop as often as a uniform says.
const LOOPS: [&str; 6] = [
    "lit surfels",
    "blend",
    "soft shadows",
    "screen-space gi",
    "obscurance",
    "hull",
];

/// Whether memory grows by dispatches of a kernel with a loop that a uniform lets run 0 times, without this crate.
fn keeps_copies(gpu: &Gpu) -> bool {
    const KERNEL: &str = "
@group(0) @binding(0) var<uniform> times: vec4u;
@group(0) @binding(1) var<storage, read_write> result: array<vec4f>;
@compute @workgroup_size(64)
fn sum(@builtin(global_invocation_id) id: vec3u) {
  var s = vec4f(f32(id.x));
  for (var i = 0u; i < times.x; i++) {
    s += sin(s.yzwx * 1.5) * cos(s.zwxy + f32(id.x));
    s += sin(s.yzwx * 2.5) * cos(s.zwxy + f32(id.x));
    s += sin(s.yzwx * 3.5) * cos(s.zwxy + f32(id.x));
    s += sin(s.yzwx * 4.5) * cos(s.zwxy + f32(id.x));
    s += sin(s.yzwx * 5.5) * cos(s.zwxy + f32(id.x));
    s += sin(s.yzwx * 6.5) * cos(s.zwxy + f32(id.x));
  }
  result[id.x] = s;
}
";
    let device = &gpu.device;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(KERNEL.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: None,
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let times = gpu.buffer(&[0_u32; 4], wgpu::BufferUsages::UNIFORM);
    let result = gpu.buffer(&[0_u32; 256], wgpu::BufferUsages::STORAGE);
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry {
                binding: 0,
                resource: times.as_entire_binding(),
            },
            wgpu::BindGroupEntry {
                binding: 1,
                resource: result.as_entire_binding(),
            },
        ],
    });
    let run = || {
        for _ in 0..100 {
            let mut encoder = gpu.encoder();
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(1, 1, 1);
            drop(pass);
            gpu.finish(encoder);
        }
    };
    run();
    let before = resident();
    run();
    let grown = (resident() - before) / 1e6;
    println!("{:<16} {grown:8.2} MB in 100 dispatches", "a plain loop");
    grown > 2.0
}

#[test]
fn memory_stays() {
    let gpu = Gpu::open(Ask::from_env()).expect("a graphics adapter; scripts/test.sh installs one");
    println!("{}", gpu.name());
    let cycles = std::env::var("DSS_SOAK_CYCLES").map_or(100, |n| n.parse().expect("a number"));
    let mut soak = Soak {
        gpu: &gpu,
        cycles,
        only: std::env::var("DSS_SOAK_PASS").ok(),
        driver_keeps: keeps_copies(&gpu),
        failed: Vec::new(),
    };
    let device = &gpu.device;
    let scene = scenes::cornell();
    let shot = Shot::new(&gpu, &scene, &camera_of(&scene, 0, [SIDE; 2]));
    let camera = &shot.camera;
    let gbuffer = shot.lit_gbuffer();
    let meshes = shot.buffers.meshes();
    let surfelizer = Surfelizer::new(device).expect("pipelines");
    let capacity = CloudCapacity {
        surfels: 4096,
        pieces: 4096,
        triangles: 4096,
    };
    let input = SurfelizerInput {
        geometry: Geometry { meshes: &meshes },
        camera,
        cull_by: &[],
        timestamps: None,
    };
    let settings = SurfelizerSettings::default();
    soak.pass("surfels", |encoder| {
        let mut cloud = surfelizer.create_cloud(device, capacity)?;
        surfelizer.record(device, encoder, &input, &settings, &mut cloud)
    });

    // What the others work on.
    let mut cloud = surfelizer.create_cloud(device, capacity).expect("a cloud");
    let mut encoder = gpu.encoder();
    surfelizer
        .record(device, &mut encoder, &input, &settings, &mut cloud)
        .expect("surfels");
    let bounced = BouncedDescriptor {
        payload: Payload::Occlusion,
        ..BouncedDescriptor::default()
    };
    let tracer = BouncedZBuffer::new(device, &bounced).expect("pipelines");
    let builder = BvhBuilder::new(device, Primitives::Triangles).expect("pipelines");
    let bvh = builder.create(device, &cloud).expect("room");
    builder
        .record(device, &mut encoder, &cloud, &bvh, None)
        .expect("a hierarchy");
    let shader = SurfelShader::new(device).expect("pipelines");
    let lamp = Light::Point {
        position: DVec3::new(0.5, 0.9, 0.5),
        intensity: [1.0; 3],
    };
    let lights = [ShadedLight {
        light: lamp,
        shadow: Shadow::Traced(&bvh),
    }];
    soak.pass("lit surfels", |encoder| {
        let input = SurfelShaderInput {
            cloud: &cloud,
            materials: &shot.buffers.materials,
            lights: &lights,
            radiance: &shader.create_radiance(device, &cloud)?,
            timestamps: None,
        };
        shader.record(device, encoder, &input, &SurfelShaderSettings::default())
    });

    let effect = AmbientOcclusion::default().effect();
    let descriptor = ShellSplatterDescriptor {
        effect: &effect,
        subgroups: false,
        statistics: false,
    };
    let splatter = ShellSplatter::new(device, &descriptor).expect("pipelines");
    let splat = SplatSettings::default();
    let levels = splat.levels;
    let input = ClusterInput::new(&cloud);
    soak.pass("clusters", |encoder| {
        let mut clusters = splatter.create_clusters(device, &cloud, levels)?;
        splatter.record_clusters(device, encoder, &input, &splat, &mut clusters)
    });
    let mut clusters = splatter
        .create_clusters(device, &cloud, levels)
        .expect("clusters");
    splatter
        .record_clusters(device, &mut encoder, &input, &splat, &mut clusters)
        .expect("clusters");
    let decoder = GBufferDecoder::new(device).expect("pipelines");
    let frame_input = FrameInput {
        origin: cloud.origin(),
        ..FrameInput::new(gbuffer, camera)
    };
    soak.pass("receivers", |encoder| {
        let mut receivers = decoder.create_receivers(device, SIDE, SIDE)?;
        decoder.record(device, encoder, &frame_input, &mut receivers)?;
        Ok(())
    });
    let mut decoded = Decoded::on(device, &decoder, camera);
    let frame = decoded.frame(&mut encoder, gbuffer, camera, cloud.origin());
    let input = SplatInput::new(&frame, &cloud, &clusters);
    soak.pass("splats", |encoder| {
        let sums = splatter.create_view(device, SIDE, SIDE, levels)?;
        splatter.record(device, encoder, &input, &splat, &sums)
    });
    let sums = splatter
        .create_view(device, SIDE, SIDE, levels)
        .expect("a view");
    splatter
        .record(device, &mut encoder, &input, &splat, &sums)
        .expect("sums");
    let format = Format::R32Float;
    let reconstructor = Reconstructor::new(device, &effect, format).expect("pipelines");
    let target = gpu.storage(format, SIDE, SIDE);
    let target = target.texture();
    let input = ReconstructorInput::new(&frame, &sums, target);
    soak.pass("reconstructor", |encoder| {
        let scratch = reconstructor.create_view(device, &sums)?;
        let settings = ReconstructorSettings::default();
        reconstructor.record(device, encoder, &input, &settings, &scratch)
    });

    soak.pass("bvh", |encoder| {
        let bvh = builder.create(device, &cloud)?;
        builder.record(device, encoder, &cloud, &bvh, None)
    });
    let traced = BouncedSettings::default();
    let input = BouncedInput::new(&frame, &cloud, &bvh);
    soak.pass("rays", |encoder| {
        let hits = tracer.create_view(device, SIDE, SIDE, traced.rays_per_pixel)?;
        tracer.record(device, encoder, &input, &traced, &hits)
    });
    let hits = tracer
        .create_view(device, SIDE, SIDE, traced.rays_per_pixel)
        .expect("a view");
    tracer
        .record(device, &mut encoder, &input, &traced, &hits)
        .expect("hits");
    let descriptor = HitResolverDescriptor {
        payload: Payload::Occlusion,
        sampling: Sampling::Cosine,
        deferred: false,
        counted: false,
        joined: false,
        bent_normals: false,
        emitter_samples: 0,
        target: format,
    };
    let gatherer = HitResolver::new(device, &descriptor).expect("pipelines");
    let input = HitResolverInput::new(&frame, &hits, target);
    soak.pass("hits", |encoder| {
        let means = gatherer.create_view(device, &hits)?;
        let settings = HitResolverSettings::default();
        gatherer.record(device, encoder, &input, &settings, &means)
    });
    gpu.finish(encoder);
    screen_passes(&mut soak, &shot);
    hulls(&mut soak, &shot, lamp);
    assert!(soak.failed.is_empty(), "memory grew: {:?}", soak.failed);
}

fn screen_passes(soak: &mut Soak<'_>, shot: &Shot) {
    let gpu = soak.gpu;
    let device = &gpu.device;
    let (camera, gbuffer) = (&shot.camera, shot.lit_gbuffer());
    let mask = MultiResMask::new(device).expect("pipelines");
    let settings = MultiResMaskSettings::OCCLUSION;
    let input = MultiResMaskInput {
        gbuffer,
        camera,
        shading: None,
        edges: None,
        importance: None,
        timestamps: None,
    };
    for (name, stencils) in [("mask", false), ("mask, stencils", true)] {
        soak.pass(name, |encoder| {
            let mut masks = mask.create_view(device, SIDE, SIDE, stencils)?;
            mask.record(device, encoder, &input, &settings, &mut masks)
        });
    }
    let mut masks = mask.create_view(device, SIDE, SIDE, false).expect("a view");
    let mut encoder = gpu.encoder();
    mask.record(device, &mut encoder, &input, &settings, &mut masks)
        .expect("masks");
    gpu.finish(encoder);
    let format = Format::R32Float;
    let target = gpu.storage(format, SIDE, SIDE);
    let target = target.texture().into();
    let blend = MultiResReconstructor::new(device, Channels::One, format).expect("pipelines");
    soak.pass("blend", |encoder| {
        let images = blend.create_images(device, SIDE, SIDE, &settings)?;
        let input = MultiResReconstructorInput {
            gbuffer,
            camera,
            masks: &masks,
            images: &images,
            target,
            timestamps: None,
        };
        let settings = MultiResReconstructorSettings::default();
        blend.record(device, encoder, &input, &settings)
    });
    let shadows = SoftShadows::new(device).expect("pipelines");
    let light = Light::Point {
        position: camera.eye(),
        intensity: [1.0; 3],
    };
    let input = SoftShadowsInput {
        gbuffer,
        camera,
        light: &light,
        map: ShadowMap::new(gbuffer.depth, std::slice::from_ref(camera)),
        work: masks.work(0),
        target,
        timestamps: None,
    };
    soak.pass("soft shadows", |encoder| {
        shadows.record(device, encoder, &input, &SoftShadowsSettings::default())
    });
    let bounce = ScreenSpaceGi::new(device).expect("pipelines");
    let colors = gpu.storage(Format::Rgba16Float, SIDE, SIDE);
    let input = ScreenSpaceGiInput {
        gbuffer,
        camera,
        lit: shot.albedo.texture().into(),
        work: None,
        target: colors.texture().into(),
        timestamps: None,
    };
    soak.pass("screen-space gi", |encoder| {
        bounce.record(device, encoder, &input, &ScreenSpaceGiSettings::default())
    });
    let descriptor = VolumetricObscuranceDescriptor {
        sampling: ObscuranceSampling::Areas(DiskSamples::Five),
        volume: ObscuranceVolume::Sphere,
    };
    let obscurance = VolumetricObscurance::new(device, &descriptor).expect("pipelines");
    soak.pass("obscurance", |encoder| {
        let moments = obscurance.create_moments(device, SIDE, SIDE)?;
        obscurance.record_moments(device, encoder, gbuffer.depth, camera, &moments, None)?;
        let input = ObscuranceInput {
            depth: gbuffer.depth,
            normals: None,
            camera,
            moments: Some(&moments),
            work: None,
            target,
            timestamps: None,
        };
        obscurance.record(device, encoder, &input, &ObscuranceSettings::default())
    });
    let frames = TemporalAccumulator::new(device, Channels::Three, format).expect("pipelines");
    let decoder = GBufferDecoder::new(device).expect("pipelines");
    let mut encoder = gpu.encoder();
    let mut decoded = Decoded::on(device, &decoder, camera);
    let frame = decoded.frame(&mut encoder, gbuffer, camera, camera.focus());
    gpu.finish(encoder);
    let input = TemporalInput::new(&frame, camera, shot.albedo.texture(), target);
    soak.pass("frames", |encoder| {
        let mut history = frames.create_history(device, SIDE, SIDE)?;
        frames.record(
            device,
            encoder,
            &input,
            &TemporalSettings::default(),
            &mut history,
        )
    });
}

fn hulls(soak: &mut Soak<'_>, shot: &Shot, lamp: Light) {
    let gpu = soak.gpu;
    let device = &gpu.device;
    let camera = &shot.camera;
    let gatherer = Gatherer::lights(device);
    let descriptor = SgHullDescriptor {
        gatherer: &gatherer,
        target: Format::Rgba16Float,
        albedo: false,
        glossy: false,
        components: Components::default(),
    };
    let hull = SgHull::new(device, &descriptor).expect("pipelines");
    let target = gpu.target(Format::Rgba16Float, SIDE, SIDE);
    let size = SgHullSize {
        segments: 512,
        splits: 256,
        ..SgHullSize::new(SIDE, SIDE)
    };
    let decoder = GBufferDecoder::new(device).expect("pipelines");
    let mut encoder = gpu.encoder();
    let mut decoded = Decoded::on(device, &decoder, camera);
    let frame = decoded.frame(&mut encoder, shot.lit_gbuffer(), camera, camera.eye());
    gpu.finish(encoder);
    soak.pass("hull", |encoder| {
        let view = hull.create_view(device, size)?;
        let lights = gatherer.bind_lights(device, &[lamp], camera.eye())?;
        let input = SgHullInput::new(&frame, Some(&lights), target.texture());
        hull.record(device, encoder, &input, &SgHullSettings::default(), &view)
    });
}

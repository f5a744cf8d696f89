//! Surfels' pieces, or the surfels as disks, traced and reconstructed.

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedScene, BouncedSettings, BouncedZBuffer, DiskSettings,
    EmittersBuilder, EmittersInput, Environment, EnvironmentBuilder, EnvironmentInput,
    EnvironmentLight, EnvironmentSettings, EnvironmentSource, GBuffer, HitEstimateInput,
    HitLighting, HitRadiance, HitResolver, HitResolverDescriptor, HitResolverInput,
    HitResolverSettings, Merge, Payload, Placement, Primitives, RayBudget, RayBudgetInput,
    RayBudgetSettings, Sampling,
    glam::DQuat,
    wgpu::{TextureFormat, TextureUsages},
};

use super::{
    case::{Case, Kind},
    inputs::{self, Part},
    surfels,
};

/// What tracers are made for: each takes pipelines of its own.
fn descriptor(case: &mut Case<'_>) -> BouncedDescriptor {
    let pieces = |payload, sampling| BouncedDescriptor {
        payload,
        primitives: Primitives::Triangles,
        sampling,
        statistics: false,
        counted: false,
        environment: false,
        emitter_samples: 0,
    };
    let disks = |payload, levels| BouncedDescriptor {
        primitives: Primitives::Disks { levels },
        ..pieces(payload, Sampling::Cosine)
    };
    let counted = |payload| BouncedDescriptor {
        counted: true,
        ..pieces(payload, Sampling::Cosine)
    };
    let under = |payload, sampling, counted| BouncedDescriptor {
        environment: true,
        counted,
        ..pieces(payload, sampling)
    };
    let kinds = [
        under(Payload::Sky, Sampling::Cosine, false),
        under(Payload::LitRadiance, Sampling::Cosine, true),
        under(Payload::LitRadiance, Sampling::Glossy, false),
        counted(Payload::Occlusion),
        counted(Payload::LitRadiance),
        pieces(Payload::Occlusion, Sampling::Cosine),
        pieces(Payload::Occlusion, Sampling::Glossy),
        pieces(Payload::Radiance, Sampling::Uniform),
        pieces(Payload::Radiance, Sampling::Glossy),
        pieces(Payload::LitRadiance, Sampling::Cosine),
        BouncedDescriptor {
            counted: true,
            ..pieces(Payload::LitRadiance, Sampling::Glossy)
        },
        pieces(Payload::LitAndGathered, Sampling::Cosine),
        BouncedDescriptor {
            emitter_samples: 3,
            ..under(Payload::LitAndGathered, Sampling::Cosine, true)
        },
        BouncedDescriptor {
            emitter_samples: 2,
            ..pieces(Payload::LitRadiance, Sampling::Glossy)
        },
        disks(Payload::Occlusion, 1),
        disks(Payload::Radiance, 5),
    ];
    let mut descriptor = case.usual("tracer", &kinds);
    if case.random.breaks() {
        descriptor.primitives = Primitives::Disks {
            levels: case.random.one_of(&[0, 9, u32::MAX]),
        };
    }
    descriptor.statistics = descriptor.primitives != Primitives::Triangles;
    case.note("traced for", descriptor);
    descriptor
}

pub fn roughness(case: &mut Case<'_>, viewport: deep_screen_space::Viewport) -> Part {
    let formats = [
        TextureFormat::R32Float,
        TextureFormat::R8Unorm,
        TextureFormat::Rgba16Float,
    ];
    let format = case.usual("roughness", &formats);
    inputs::image(case, "roughness", format, viewport, |x, y| {
        [(x + y) as f32 * 0.04, 0.0, 0.0, 0.0]
    })
}

fn settings(case: &mut Case<'_>) -> BouncedSettings {
    let settings = BouncedSettings {
        rays_per_pixel: case.random.count(0, 64),
        radius: case.random.scale(0.0, f32::INFINITY),
        frame: case.random.count(0, 1 << 20),
        sky_radiance: std::array::from_fn(|_| case.random.scale(0.0, 1e18)),
        environment_share: case.random.setting(0.0, 1.0),
        disks: DiskSettings {
            shell_radii: case.random.scale(f32::MIN_POSITIVE, f32::INFINITY),
            merge: case.random.one_of(&[Merge::Nearest, Merge::Finest]),
            seed: case.random.count(0, 1 << 24),
        },
    };
    case.note("bounced", settings);
    settings
}

/// A sky of spherical harmonics, which are below 0 in places.
pub fn sky(case: &mut Case<'_>, levels: bool) -> Option<Environment> {
    let builder = case.once("environment", |device| EnvironmentBuilder::new(device))?;
    let settings = EnvironmentSettings {
        size: [32, 16],
        levels,
    };
    let environment = case.accept(builder.create(case.device(), &settings))?;
    let harmonics: [[f32; 3]; 9] =
        std::array::from_fn(|_| std::array::from_fn(|_| case.random.scale(0.0, 1e18)));
    case.note("harmonics", harmonics);
    let input = EnvironmentInput {
        source: EnvironmentSource::SphericalHarmonics(&harmonics),
        timestamps: case.timestamps(),
    };
    let device = case.device();
    let done = builder.record(device, &mut case.encoder, &input, &environment);
    case.accept(done)?;
    case.texture("sky", environment.radiance().texture());
    case.buffer("irradiance", environment.irradiance(), Kind::Floats);
    Some(environment)
}

pub fn record(case: &mut Case<'_>) {
    let _ = steps(case);
}

fn steps(case: &mut Case<'_>) -> Option<()> {
    let device = case.device();
    let camera = inputs::camera(case);
    let viewport = camera.viewport();
    let descriptor = descriptor(case);
    let tracer = case.once(descriptor, |device| {
        BouncedZBuffer::new(device, &descriptor)
    })?;
    let placements = [Placement::Centroid, Placement::Random, Placement::Grid];
    let of_surfels = matches!(
        descriptor.payload,
        Payload::Radiance | Payload::LitAndGathered
    );
    let from_leaves = of_surfels && descriptor.primitives == Primitives::Triangles;
    let accepted = if from_leaves && !case.random.breaks() {
        1
    } else {
        3
    };
    let surfels = surfels::record(case, &camera, &placements[..accepted])?;
    let cloud = &surfels.cloud;
    let bounds = surfels::bvh(case, descriptor.primitives, cloud)?;
    let traced = (descriptor.primitives == Primitives::Triangles).then_some(&bounds);
    let radiance = match descriptor.payload {
        Payload::Radiance => Some(surfels::radiance(case, cloud, &camera, traced)?),
        Payload::LitAndGathered => Some(surfels::gathered(case, cloud, &camera, &bounds)?),
        _ => None,
    };
    let materials = inputs::materials(case);
    let count = case.random.count(0, 16).min(40);
    let lights: Vec<_> = (0..count)
        .map(|_| inputs::light(case, camera.eye()))
        .collect();
    let eye = camera.eye();
    let camera = if case.random.chance(0.2) {
        inputs::camera_at(case, viewport, eye)
    } else {
        camera
    };
    let is_glossy = descriptor.sampling == Sampling::Glossy;
    let needs_albedo = descriptor.payload != Payload::Occlusion && !is_glossy;
    let gbuffer = inputs::gbuffer(case, &camera, needs_albedo);
    let roughness = (is_glossy && !case.random.breaks()).then(|| roughness(case, viewport));
    let roughness = roughness.as_ref().map(Part::slice);
    let settings = settings(case);
    let room = settings.rays_per_pixel.max(case.random.count(0, 64));
    let view = tracer.create_view(device, viewport.width, viewport.height, room);
    let view = case.accept(view)?;
    let lighting = HitLighting {
        materials: &materials,
        lights: &lights,
    };
    let radiance = if case.random.breaks() {
        HitRadiance::None
    } else {
        match (&radiance, descriptor.payload) {
            (None, _) => HitRadiance::Lit(lighting),
            (Some(gathered), Payload::LitAndGathered) => {
                HitRadiance::LitAndGathered { lighting, gathered }
            }
            (Some(radiance), _) => HitRadiance::Surfels(radiance),
        }
    };
    let gbuffer = GBuffer {
        roughness,
        ..gbuffer.gbuffer()
    };
    let mut decoding = inputs::Decoding::new(case, viewport)?;
    let frame = decoding.frame(case, gbuffer, &camera, cloud.origin())?;
    let sky = if descriptor.environment && !case.random.breaks() {
        Some(sky(case, false)?)
    } else {
        None
    };
    let environment = sky.as_ref().map(|environment| EnvironmentLight {
        environment,
        rotation: DQuat::from_rotation_x(case.random.between(-4.0, 4.0)),
    });
    let emitters = if descriptor.emitter_samples > 0 && !case.random.breaks() {
        let builder = case.once("emitters", |device| EmittersBuilder::new(device))?;
        let emitters = case.accept(builder.create(device, cloud))?;
        let input = EmittersInput {
            timestamps: case.timestamps(),
            ..EmittersInput::new(cloud, &materials)
        };
        let done = builder.record(device, &mut case.encoder, &input, &emitters);
        case.accept(done)?;
        Some(emitters)
    } else {
        None
    };
    let input = BouncedInput {
        frame: &frame,
        scene: BouncedScene::Cloud {
            cloud,
            bvh: &bounds,
        },
        radiance,
        pixels: case.random.breaks().then_some(&[]),
        environment,
        emitters: emitters.as_ref(),
        timestamps: case.timestamps(),
    };
    let done = tracer.record(device, &mut case.encoder, &input, &settings, &view);
    case.accept(done)?;
    if let Some(blocked) = view.blocked() {
        case.buffer("blocked", blocked, Kind::Bits);
    }
    if let Some(radiance) = view.radiance() {
        case.texture("arriving", radiance.texture());
    }
    if let Some(statistics) = view.statistics() {
        case.buffer("statistics", statistics, Kind::Bits);
    }

    let target_format = inputs::target_format(case);
    let descriptor = HitResolverDescriptor {
        payload: descriptor.payload,
        sampling: descriptor.sampling,
        deferred: !descriptor.environment
            && descriptor.emitter_samples == 0
            && case.usual("deferred", &[true, false]),
        counted: descriptor.counted,
        joined: false,
        bent_normals: false,
        emitter_samples: descriptor.emitter_samples,
        target: target_format,
    };
    let reconstructor = case.once(descriptor, |device| HitResolver::new(device, &descriptor))?;
    let scratch = reconstructor.create_view(device, &view);
    let scratch = case.accept(scratch)?;
    let target = inputs::target(
        case,
        target_format,
        viewport,
        TextureUsages::RENDER_ATTACHMENT,
    );
    let filter = HitResolverSettings {
        radius: case.random.count(0, 16),
        spread: case.random.scale(f32::MIN_POSITIVE, f32::INFINITY),
        hit_distances: case.random.scale(f32::MIN_POSITIVE, f32::INFINITY),
        damping: case.random.scale(0.01, f32::INFINITY),
        plane_distance: case.random.scale(f32::MIN_POSITIVE, f32::MAX),
        normal_power: case.random.scale(8.0, 1000.0),
        variance_clamp: case.random.setting(0.0, 100.0),
        narrowing: case.random.setting(0.0, 1.0),
        frames: case.random.setting(1.0, 1000.0),
        f0: std::array::from_fn(|_| case.random.setting(0.0, 1.0)),
    };
    case.note("hit resolver", filter);
    if descriptor.counted && case.random.chance(0.7) {
        let settings_of_budget = RayBudgetSettings {
            rays_per_pixel: case.random.setting(0.0, 255.0),
            most: case.random.count(0, 255),
        };
        case.note("budget", settings_of_budget);
        let sampling = if descriptor.payload == Payload::Occlusion {
            Sampling::Cosine
        } else {
            descriptor.sampling
        };
        let budget = case.once(sampling, |device| {
            RayBudget::with_sampling(device, sampling)
        })?;
        let list = budget.create_view(device, viewport.width, viewport.height);
        let list = case.accept(list)?;
        let hits = HitEstimateInput {
            timestamps: case.timestamps(),
            ..HitEstimateInput::new(&frame, &view)
        };
        let done = reconstructor.estimate(device, &mut case.encoder, &hits, &filter, &scratch);
        case.accept(done)?;
        let noise = RayBudgetInput {
            timestamps: case.timestamps(),
            ..RayBudgetInput::new(&frame, &view, &scratch, &filter)
        };
        let done = budget.record(
            device,
            &mut case.encoder,
            &noise,
            &settings_of_budget,
            &list,
        );
        case.accept(done)?;
        let into = (&view, &list);
        let done = tracer.record_more(device, &mut case.encoder, &input, &settings, into);
        case.accept(done)?;
    }
    if let Some(counts) = view.counts() {
        case.buffer("counts", counts, Kind::Bits);
    }
    let input = HitResolverInput {
        frame: &frame,
        hits: &view,
        history: None,
        target: target.slice(),
        timestamps: case.timestamps(),
    };
    let done = reconstructor.record(device, &mut case.encoder, &input, &filter, &scratch);
    case.accept(done)?;
    case.texture("traced", &target.texture);
    Some(())
}

//! Surfels splatted and reconstructed, on whole images and listed pixels.

use deep_screen_space::{
    AmbientOcclusion, BentNormals, ClusterInput, DiffuseBounce, DirectionalOcclusion, Effect,
    EnvironmentLight, GBuffer, Overlap, Placement, Reconstructor, ReconstructorInput,
    ReconstructorSettings, Scattering, ShellSplatter, ShellSplatterDescriptor, SpecularBounce,
    SplatInput, SplatSettings, SubsurfaceScattering, SurfelClusters, Viewport,
    wgpu::{Buffer, Features, TextureUsages},
};

use super::{
    case::{Case, Kind},
    inputs::{self, OwnWork},
    rays,
    surfels::{self, Surfels},
};

/// Light that emitting surfaces send on, with all that an effect can ask for.
const COLOR: &str = "
fn max_distance(sender: Sender, epsilon: f32) -> f32 {
  let brightest = max(max(sender.material.emission.x, sender.material.emission.y), sender.material.emission.z);
  return sender.radius * sqrt(clamp(brightest / epsilon - 1.0, 0.0, 1e12));
}
fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> vec3f {
  let cosines = max(dot(receiver_normal, to_sender), 0.0) * abs(dot(sender.normal, to_sender));
  let area = min(sender.radius * sender.radius, 1e18);
  return clamp(sender.material.emission, vec3f(0.0), vec3f(1e4)) * (cosines / max(distance2, 1e-18)) *
    (area / (distance2 + area + 1e-18));
}
fn resolve(sum: vec3f, albedo: vec3f) -> vec4f {
  return vec4f(min(sum * albedo, vec3f(6e4)), 1.0);
}
";

/// Effects that pipelines are made for.
fn effect(case: &mut Case<'_>) -> Effect {
    match case.usual("effect", &[0, 1, 2, 3, 4, 5]) {
        0 => Effect {
            channels: 3,
            materials: true,
            albedo: true,
            two_sided: true,
            ..Effect::new("color", COLOR)
        },
        1 => AmbientOcclusion {
            two_sided: true,
            overlap: Overlap::Independent,
            own_surface: true,
        }
        .effect(),
        2 => AmbientOcclusion::default().effect(),
        3 => below_surfaces(),
        4 => glossy_under_sky(),
        _ => light_and_occlusion(),
    }
}

/// Light that passes through bodies, far, near and hardly.
fn below_surfaces() -> Effect {
    let scattering = Scattering {
        sigma_a: [1e-6, 1.0, 1e12],
        sigma_s_prime: [1e-6, 10.0, 1e12],
        eta: 1.3,
    };
    let effect = SubsurfaceScattering::new(scattering).effect();
    effect.expect("a material")
}

/// Of two outputs, the first of which reads radiance and albedo.
fn light_and_occlusion() -> Effect {
    let bounce = DiffuseBounce {
        two_sided: true,
        unit: 3.0,
    };
    let light = bounce.effect().expect("a unit");
    let both = light.and(&AmbientOcclusion::default().effect());
    both.expect("four channels")
}

/// Of all that effects can ask for of a pixel.
fn glossy_under_sky() -> Effect {
    let glossy = SpecularBounce {
        two_sided: true,
        unit: 3.0,
        ..SpecularBounce::default()
    };
    let glossy = glossy.effect().expect("a unit");
    let sky = DirectionalOcclusion::default().effect();
    let both = sky.and(&glossy).expect("six channels");
    // Its four channels would be ten.
    assert!(both.and(&BentNormals::default().effect()).is_err());
    both
}

pub fn settings(case: &mut Case<'_>) -> SplatSettings {
    let settings = SplatSettings {
        levels: case.random.count(1, 8),
        epsilon: case.random.scale(1e-12, 1e12),
        radius: case.random.scale(0.0, f32::INFINITY),
        unbounded: case.random.chance(0.5),
        seed: case.random.count(0, 1 << 24),
    };
    case.note("splat", settings);
    settings
}

/// A splatter, and clusters of a cloud.
pub fn clusters(
    case: &mut Case<'_>,
    splatter: &ShellSplatter,
    surfels: &Surfels,
    settings: &SplatSettings,
    (materials, radiance): (&Buffer, Option<&Buffer>),
) -> Option<SurfelClusters> {
    let levels = settings.levels.max(case.random.count(1, 8));
    let cloud = &surfels.cloud;
    let clusters = splatter.create_clusters(case.device(), cloud, levels);
    let mut clusters = case.accept(clusters)?;
    let input = ClusterInput {
        cloud,
        materials: Some(materials),
        radiance,
        timestamps: case.timestamps(),
    };
    let done = splatter.record_clusters(
        case.device(),
        &mut case.encoder,
        &input,
        settings,
        &mut clusters,
    );
    case.accept(done)?;
    Some(clusters)
}

pub fn splatter(case: &mut Case<'_>, effect: &Effect) -> Option<std::rc::Rc<ShellSplatter>> {
    let able = case.device().features().contains(Features::SUBGROUP);
    let variant = if case.random.breaks() {
        2
    } else {
        case.usual("splatter", &[0, 1, 2, 3, 4, 5])
    };
    let (subgroups, statistics) = (variant == 2 && (able || case.random.breaks()), variant == 0);
    let key = (effect, subgroups, statistics);
    case.once(key, |device| {
        let descriptor = ShellSplatterDescriptor {
            effect,
            subgroups,
            statistics,
        };
        ShellSplatter::new(device, &descriptor)
    })
}

pub fn record(case: &mut Case<'_>) {
    let _ = steps(case);
}

fn steps(case: &mut Case<'_>) -> Option<()> {
    let device = case.device();
    let camera = inputs::camera(case);
    let viewport = camera.viewport();
    let placements = [Placement::Centroid, Placement::Random, Placement::Grid];
    let surfels = surfels::record(case, &camera, &placements)?;
    let cloud = &surfels.cloud;
    let effect = effect(case);
    let radiance = if effect.radiance || case.random.chance(0.3) {
        surfels::radiance(case, cloud, &camera, None)
    } else {
        None
    };
    let splatter = splatter(case, &effect)?;
    let materials = inputs::materials(case);
    let settings = settings(case);
    let given = (&materials, radiance.as_ref());
    let clusters = clusters(case, &splatter, &surfels, &settings, given)?;
    // Another eye, not far off.
    let camera = if case.random.chance(0.2) {
        inputs::camera_at(case, viewport, camera.eye())
    } else {
        camera
    };
    let gbuffer = inputs::gbuffer(case, &camera, effect.albedo);
    let roughness =
        (effect.roughness && !case.random.breaks()).then(|| rays::roughness(case, viewport));
    let sky = if effect.environment && !case.random.breaks() {
        Some(rays::sky(case, true)?)
    } else {
        None
    };
    let environment = sky.as_ref().map(EnvironmentLight::new);
    let work = case
        .random
        .chance(0.3)
        .then(|| OwnWork::new(case, viewport));
    let work = work.as_ref().map(OwnWork::list);
    let level = work.as_ref().map_or(0, |work| work.level.min(31));
    let [width, height] = [viewport.width, viewport.height].map(|n| n.div_ceil(1 << level));
    let levels = settings.levels.max(case.random.count(1, 8));
    let sums = splatter.create_view(device, width, height, levels);
    let sums = case.accept(sums)?;
    let mut decoding = inputs::Decoding::new(case, viewport)?;
    let gbuffer = GBuffer {
        roughness: roughness.as_ref().map(inputs::Part::slice),
        ..gbuffer.gbuffer()
    };
    let frame = decoding.frame(case, gbuffer, &camera, cloud.origin())?;
    let input = SplatInput {
        frame: &frame,
        cloud,
        clusters: &clusters,
        materials: Some(&materials),
        radiance: radiance.as_ref(),
        environment,
        work,
        timestamps: case.timestamps(),
    };
    let done = splatter.record(device, &mut case.encoder, &input, &settings, &sums);
    case.accept(done)?;
    case.texture("sums", sums.sums().texture());
    if let Some(statistics) = sums.statistics() {
        case.buffer("statistics", statistics, Kind::Bits);
    }

    let format = inputs::target_format(case);
    let reconstructor = case.once((&effect, format), |device| {
        Reconstructor::new(device, &effect, format)
    })?;
    let scratch = reconstructor.create_view(device, &sums);
    let scratch = case.accept(scratch)?;
    let written = match work {
        Some(_) => Viewport::full(width, height),
        None => viewport,
    };
    let mut target = || inputs::target(case, format, written, TextureUsages::RENDER_ATTACHMENT);
    let targets: Vec<_> = effect.outputs.iter().map(|_| target()).collect();
    let slices: Vec<_> = targets.iter().map(|target| target.slice()).collect();
    let settings = ReconstructorSettings {
        radius: case.random.setting(0.0, 8.0),
        plane_distance: case.random.scale(f32::MIN_POSITIVE, f32::MAX),
        normal_power: case.random.scale(8.0, 1000.0),
    };
    case.note("reconstructor", settings);
    let input = ReconstructorInput {
        frame: &frame,
        sums: &sums,
        target: slices[0],
        further: &slices[1..],
        environment,
        timestamps: case.timestamps(),
    };
    let done = reconstructor.record(device, &mut case.encoder, &input, &settings, &scratch);
    case.accept(done)?;
    for target in &targets {
        case.texture("splatted", &target.texture);
    }
    Some(())
}

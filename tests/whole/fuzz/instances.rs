//! Instances of random meshes in two levels, traced twice: as they are, and with some of them built anew.

use deep_screen_space::{
    AlphaChannel, AlphaTest, AlphaTests, AlphaWrap, BouncedDescriptor, BouncedInput, BouncedScene,
    BouncedSettings, BouncedZBuffer, ChangedMeshes, Geometry, HitLighting, HitRadiance,
    InstancedBvhBuilder, InstancedBvhInput, Payload, Primitives, TexCoordFormat, TexCoords,
};

use super::{
    case::{Case, Kind},
    inputs, surfels,
};

pub fn record(case: &mut Case<'_>) {
    let _ = steps(case);
}

fn steps(case: &mut Case<'_>) -> Option<()> {
    let device = case.device();
    let camera = inputs::camera(case);
    let viewport = camera.viewport();
    let descriptor = BouncedDescriptor {
        payload: case.usual("payload", &[Payload::Occlusion, Payload::LitRadiance]),
        primitives: case.usual(
            "primitives",
            &[Primitives::Instances, Primitives::AlphaTestedInstances],
        ),
        statistics: true,
        ..BouncedDescriptor::default()
    };
    let tracer = case.once(descriptor, |device| {
        BouncedZBuffer::new(device, &descriptor)
    })?;
    let has_holes = descriptor.primitives == Primitives::AlphaTestedInstances;
    let builder = case.once(has_holes, |device| {
        if has_holes {
            InstancedBvhBuilder::alpha_tested(device)
        } else {
            InstancedBvhBuilder::new(device)
        }
    })?;
    let buffers: Vec<_> = (0..2).map(|_| surfels::buffers(case, &camera)).collect();
    let count = case.random.below(5) as usize;
    let meshes: Vec<_> = (0..count)
        .map(|i| surfels::mesh(case, &buffers[i % 2]))
        .collect();
    let geometry = Geometry { meshes: &meshes };
    let bvh = builder.create(device, &geometry);
    let mut bvh = case.accept(bvh)?;
    let materials = inputs::materials(case);
    let lights: Vec<_> = (0..case.random.below(4))
        .map(|_| inputs::light(case, camera.eye()))
        .collect();
    let gbuffer = inputs::gbuffer(case, &camera, false);
    let tests: Vec<_> = (0..if has_holes { count } else { 0 })
        .map(|i| test(case, &buffers[i % 2]))
        .collect();
    let alpha_tests = has_holes.then(|| AlphaTests {
        maps: gbuffer.gbuffer().normal,
        channel: AlphaChannel::Red,
        meshes: &tests,
    });
    let settings = BouncedSettings {
        rays_per_pixel: case.random.count(0, 16),
        radius: case.random.scale(0.0, f32::INFINITY),
        ..BouncedSettings::default()
    };
    case.note("bounced", settings);
    let view = tracer.create_view(device, viewport.width, viewport.height, 16);
    let view = case.accept(view)?;
    let mut decoding = inputs::Decoding::new(case, viewport)?;
    let frame = decoding.frame(case, gbuffer.gbuffer(), &camera, camera.focus())?;
    let some = [case.random.below(5) as usize; 1];
    let some = if count > 0 && !case.random.breaks() {
        [some[0] % count]
    } else {
        some
    };
    for changed in [
        ChangedMeshes::None,
        ChangedMeshes::Some(&some),
        ChangedMeshes::All,
    ] {
        if count == 0 && changed == ChangedMeshes::Some(&some) {
            continue;
        }
        let input = InstancedBvhInput {
            changed,
            alpha_tests,
            timestamps: case.timestamps(),
            ..InstancedBvhInput::new(geometry, &camera)
        };
        let done = builder.record(device, &mut case.encoder, &input, &mut bvh);
        case.accept(done)?;
        let input = BouncedInput {
            radiance: match descriptor.payload {
                Payload::LitRadiance => HitRadiance::Lit(HitLighting {
                    materials: &materials,
                    lights: &lights,
                }),
                _ => HitRadiance::None,
            },
            timestamps: case.timestamps(),
            ..BouncedInput::of(&frame, BouncedScene::Instances(&bvh))
        };
        let done = tracer.record(device, &mut case.encoder, &input, &settings, &view);
        case.accept(done)?;
    }
    case.buffer("counts", bvh.counts(), Kind::Bits);
    case.buffer("nearness", view.nearness(), Kind::Bits);
    if let Some(blocked) = view.blocked() {
        case.buffer("blocked", blocked, Kind::Bits);
    }
    if let Some(radiance) = view.radiance() {
        case.texture("arriving", radiance.texture());
    }
    if let Some(statistics) = view.statistics() {
        case.buffer("statistics", statistics, Kind::Bits);
    }
    Some(())
}

/// Holes of a mesh, if it is to have any: by whatever its vertices are.
fn test<'a>(case: &mut Case<'_>, buffers: &'a surfels::Buffers) -> Option<AlphaTest<'a>> {
    let random = &mut case.random;
    let wraps = [
        AlphaWrap::Repeat,
        AlphaWrap::ClampToEdge,
        AlphaWrap::MirrorRepeat,
    ];
    let test = random.chance(0.7).then(|| AlphaTest {
        tex_coords: TexCoords {
            buffer: &buffers.vertices,
            offset: 0,
            stride: 8,
            format: random.one_of(&[
                TexCoordFormat::Float32x2,
                TexCoordFormat::Float16x2,
                TexCoordFormat::Unorm16x2,
            ]),
        },
        layer: 0,
        threshold: random.setting(0.0, 1.0),
        wrap: [random.one_of(&wraps), random.one_of(&wraps)],
    });
    case.note("holes", test.map(|test| (test.threshold, test.wrap)));
    test
}

//! Times that the caller asks for, on devices that have them.

use deep_screen_space::{
    AmbientOcclusion, BouncedDescriptor, BouncedInput, BouncedSettings, Camera, Channels,
    CloudCapacity, ClusterInput, Components, Error, FrameInput, Gatherer, Geometry,
    HitEstimateInput, HitResolverDescriptor, HitResolverInput, HitResolverSettings,
    InstancedBvhBuilder, InstancedBvhInput, Light, MultiResMaskInput, MultiResMaskSettings,
    MultiResReconstructor, MultiResReconstructorInput, MultiResReconstructorSettings,
    ObscuranceInput, ObscuranceSampling, ObscuranceSettings, ObscuranceVolume, Payload, Primitives,
    ReconstructorInput, ReconstructorSettings, ReflectiveShadowMap, ReflectiveShadowMapInput,
    Sampling, ScreenSpaceGiInput, ScreenSpaceGiSettings, SgHull, SgHullDescriptor, SgHullInput,
    SgHullSettings, SgHullSize, ShadowMap, SoftShadowsInput, SoftShadowsSettings, SplatInput,
    SplatSettings, SurfelShaderInput, SurfelShaderSettings, SurfelizerInput, SurfelizerSettings,
    TemporalAccumulator, TemporalInput, TemporalJoinInput, TemporalSettings, Timestamps, Viewport,
    VolumetricObscurance, VolumetricObscuranceDescriptor,
    glam::{DVec3, dcamera::rh::proj::directx},
    scenes, wgpu,
};
use support::gpu::{Ask, Gpu};
use support::testing::frames::Decoded;
use support::testing::pipelines;
use support::testing::shot::{Shot, camera_of};

/// A begin and an end for each of some recordings. What the times are is the driver's affair: lavapipe's are wrong once a
/// render pass has run.
struct Times {
    set: wgpu::QuerySet,
    count: u32,
}

impl Times {
    /// `None` where the adapter has no such queries. Then nothing of it is used: the other tests run without.
    fn of(gpu: &Gpu, recordings: u32) -> Option<Self> {
        let features = gpu.device.features();
        if !features.contains(wgpu::Features::TIMESTAMP_QUERY) {
            assert_ne!(Ask::from_env(), Ask::All, "this adapter has no timestamps");
            return None;
        }
        let count = 2 * recordings;
        let set = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: None,
            ty: wgpu::QueryType::Timestamp,
            count,
        });
        Some(Self { set, count })
    }

    fn stamps(&self, recording: u32) -> Timestamps<'_> {
        Timestamps {
            set: &self.set,
            begin: 2 * recording,
            end: 2 * recording + 1,
        }
    }

    /// Submits, and finds all of them written.
    fn check(&self, gpu: &Gpu, mut encoder: wgpu::CommandEncoder) {
        let resolved = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 8 * u64::from(self.count),
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        encoder.resolve_query_set(&self.set, 0..self.count, &resolved, 0);
        gpu.finish(encoder);
        let times: Vec<u64> = gpu.read_buffer(&resolved);
        println!("{times:?}");
        assert!(
            times.iter().all(|t| *t > 0),
            "not all were written: {times:?}"
        );
    }
}

#[test]
fn recordings_from_surfels_write_their_times() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let Some(times) = Times::of(gpu, 14) else {
        return;
    };
    let scene = scenes::cornell();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [16, 16]));
    let effect = AmbientOcclusion::default().effect();
    let settings = SplatSettings::default();
    let surfelizer = pipelines::surfelizer();
    let splatter = pipelines::shell_splatter(&effect, false);
    let shader = pipelines::surfel_shader();
    let format = wgpu::TextureFormat::R32Float;
    let reconstructor = pipelines::reconstructor(&effect, format);
    let capacity = CloudCapacity {
        surfels: 1 << 12,
        pieces: 1 << 12,
        triangles: 1 << 12,
    };
    let mut cloud = surfelizer.create_cloud(device, capacity).expect("a cloud");
    let mut clusters = splatter
        .create_clusters(device, &cloud, 5)
        .expect("clusters");
    let sums = splatter.create_view(device, 16, 16, 5).expect("a view");
    let scratch = reconstructor.create_view(device, &sums).expect("a view");
    let target = gpu.target(format, 16, 16);

    let mut encoder = gpu.encoder();
    let meshes = shot.buffers.meshes();
    let mut surfelize = |encoder: &mut wgpu::CommandEncoder, timestamps| {
        let input = SurfelizerInput {
            geometry: Geometry { meshes: &meshes },
            camera: &shot.camera,
            cull_by: &[],
            timestamps,
        };
        surfelizer.record(
            device,
            encoder,
            &input,
            &SurfelizerSettings::default(),
            &mut cloud,
        )
    };
    let same = Timestamps {
        set: &times.set,
        begin: 3,
        end: 3,
    };
    assert!(matches!(
        surfelize(&mut encoder, Some(same)),
        Err(Error::Setting {
            field: "Timestamps::end",
            ..
        })
    ));
    surfelize(&mut encoder, Some(times.stamps(0))).expect("surfels");
    let materials = gpu.buffer(&scene.material_table(), wgpu::BufferUsages::STORAGE);
    let radiance = shader.create_radiance(device, &cloud).expect("room");
    let input = SurfelShaderInput {
        cloud: &cloud,
        materials: &materials,
        lights: &[],
        radiance: &radiance,
        timestamps: Some(times.stamps(4)),
    };
    shader
        .record(
            device,
            &mut encoder,
            &input,
            &SurfelShaderSettings::default(),
        )
        .expect("light");
    let input = ClusterInput {
        timestamps: Some(times.stamps(1)),
        ..ClusterInput::new(&cloud)
    };
    splatter
        .record_clusters(device, &mut encoder, &input, &settings, &mut clusters)
        .expect("clusters");
    let input = FrameInput {
        origin: cloud.origin(),
        timestamps: Some(times.stamps(9)),
        ..FrameInput::new(shot.gbuffer(), &shot.camera)
    };
    let mut decoded = Decoded::of(&shot.camera);
    let frame = pipelines::decoder()
        .record(device, &mut encoder, &input, &mut decoded.receivers)
        .expect("a frame");
    let input = SplatInput {
        timestamps: Some(times.stamps(2)),
        ..SplatInput::new(&frame, &cloud, &clusters)
    };
    splatter
        .record(device, &mut encoder, &input, &settings, &sums)
        .expect("sums");
    let input = ReconstructorInput {
        timestamps: Some(times.stamps(3)),
        ..ReconstructorInput::new(&frame, &sums, target.texture())
    };
    reconstructor
        .record(
            device,
            &mut encoder,
            &input,
            &ReconstructorSettings::default(),
            &scratch,
        )
        .expect("a picture");
    let accumulator = TemporalAccumulator::new(device, Channels::One, format).expect("pipelines");
    let mut history = accumulator
        .create_history(device, 16, 16)
        .expect("a history");
    let picture = target.texture();
    let input = TemporalInput {
        timestamps: Some(times.stamps(5)),
        ..TemporalInput::new(&frame, &shot.camera, picture, picture)
    };
    let settings = TemporalSettings::default();
    accumulator
        .record(device, &mut encoder, &input, &settings, &mut history)
        .expect("a mean");
    let tracer = pipelines::bounced(&BouncedDescriptor::default());
    let bounds = pipelines::bvh_builder(Primitives::Triangles)
        .create(device, &cloud)
        .expect("bounds");
    let hits = tracer.create_view(device, 16, 16, 16).expect("a view");
    pipelines::bvh_builder(Primitives::Triangles)
        .record(device, &mut encoder, &cloud, &bounds, Some(times.stamps(6)))
        .expect("bounds");
    let input = BouncedInput {
        timestamps: Some(times.stamps(7)),
        ..BouncedInput::new(&frame, &cloud, &bounds)
    };
    let traced = BouncedSettings::default();
    tracer
        .record(device, &mut encoder, &input, &traced, &hits)
        .expect("hits");
    let descriptor = HitResolverDescriptor {
        payload: Payload::Occlusion,
        sampling: Sampling::Cosine,
        deferred: false,
        counted: false,
        joined: true,
        bent_normals: false,
        emitter_samples: 0,
        target: format,
    };
    let reconstructor = pipelines::hit_resolver(&descriptor);
    let scratch = reconstructor.create_view(device, &hits).expect("a view");
    let input = HitResolverInput {
        timestamps: Some(times.stamps(8)),
        ..HitResolverInput::new(&frame, &hits, target.texture())
    };
    let settings = HitResolverSettings::default();
    reconstructor
        .record(device, &mut encoder, &input, &settings, &scratch)
        .expect("a picture");
    let input = HitEstimateInput {
        timestamps: Some(times.stamps(11)),
        ..HitEstimateInput::new(&frame, &hits)
    };
    reconstructor
        .estimate(device, &mut encoder, &input, &settings, &scratch)
        .expect("means");
    let input = TemporalJoinInput {
        timestamps: Some(times.stamps(12)),
        ..TemporalJoinInput::new(&frame, &shot.camera, &scratch)
    };
    let mean = TemporalSettings::default();
    accumulator
        .join(device, &mut encoder, &input, &mean, &mut history)
        .expect("a mean");
    let input = HitResolverInput {
        timestamps: Some(times.stamps(13)),
        history: Some(&history),
        ..HitResolverInput::new(&frame, &hits, target.texture())
    };
    reconstructor
        .record(device, &mut encoder, &input, &settings, &scratch)
        .expect("a picture");
    let builder = InstancedBvhBuilder::new(device).expect("pipelines");
    let geometry = Geometry { meshes: &meshes };
    let mut bvh = builder.create(device, &geometry).expect("room");
    let input = InstancedBvhInput {
        timestamps: Some(times.stamps(10)),
        ..InstancedBvhInput::new(geometry, &shot.camera)
    };
    builder
        .record(device, &mut encoder, &input, &mut bvh)
        .expect("a hierarchy");
    times.check(gpu, encoder);
}

#[test]
fn recordings_from_the_gbuffer_alone_write_their_times() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let Some(times) = Times::of(gpu, 8) else {
        return;
    };
    let scene = scenes::cornell();
    let camera = camera_of(&scene, 0, [32, 32]);
    let shot = Shot::new(gpu, &scene, &camera);
    let gbuffer = shot.lit_gbuffer();
    let mut encoder = gpu.encoder();

    let mask = pipelines::multi_res_mask();
    let mut masks = mask.create_view(device, 32, 32, false).expect("a view");
    let levels = MultiResMaskSettings::OCCLUSION;
    let input = MultiResMaskInput {
        gbuffer,
        camera: &camera,
        shading: None,
        edges: None,
        importance: None,
        timestamps: Some(times.stamps(0)),
    };
    mask.record(device, &mut encoder, &input, &levels, &mut masks)
        .expect("masks");

    let format = wgpu::TextureFormat::R32Float;
    let target = gpu.storage(format, 32, 32);
    let descriptor = VolumetricObscuranceDescriptor {
        sampling: ObscuranceSampling::OneArea,
        volume: ObscuranceVolume::Sphere,
    };
    let obscurance = VolumetricObscurance::new(device, &descriptor).expect("pipelines");
    let moments = obscurance.create_moments(device, 32, 32).expect("room");
    obscurance
        .record_moments(
            device,
            &mut encoder,
            gbuffer.depth,
            &camera,
            &moments,
            Some(times.stamps(1)),
        )
        .expect("moments");
    let input = ObscuranceInput {
        depth: gbuffer.depth,
        normals: None,
        camera: &camera,
        moments: Some(&moments),
        work: None,
        target: target.texture().into(),
        timestamps: Some(times.stamps(2)),
    };
    obscurance
        .record(device, &mut encoder, &input, &ObscuranceSettings::default())
        .expect("obscurance");

    let light = Light::Directional {
        direction: DVec3::NEG_Y,
        irradiance: [1.0; 3],
    };
    let above = Camera::look_at(
        DVec3::new(0.0, 20.0, 0.0),
        DVec3::ZERO,
        DVec3::X,
        directx::orthographic(-5.0, 5.0, -5.0, 5.0, 1.0, 30.0),
        Viewport::full(1, 1),
    )
    .expect("a camera");
    let cameras = [above];
    let layer = gpu.texture(format, 1, 1, &[1.0_f32]);
    let input = SoftShadowsInput {
        gbuffer,
        camera: &camera,
        light: &light,
        map: ShadowMap::new(layer.texture(), &cameras),
        work: None,
        target: target.texture().into(),
        timestamps: Some(times.stamps(3)),
    };
    pipelines::soft_shadows()
        .record(
            device,
            &mut encoder,
            &input,
            &SoftShadowsSettings::default(),
        )
        .expect("shadows");

    let color = wgpu::TextureFormat::Rgba16Float;
    let light_of = gpu.storage(color, 32, 32);
    let input = ScreenSpaceGiInput {
        gbuffer,
        camera: &camera,
        lit: shot.albedo.texture().into(),
        work: None,
        target: light_of.texture().into(),
        timestamps: Some(times.stamps(4)),
    };
    pipelines::screen_space_gi()
        .record(
            device,
            &mut encoder,
            &input,
            &ScreenSpaceGiSettings::default(),
        )
        .expect("light");

    let blend = MultiResReconstructor::new(device, Channels::One, format).expect("pipelines");
    let images = blend
        .create_images(device, 32, 32, &levels)
        .expect("images");
    let picture = gpu.target(format, 32, 32);
    let input = MultiResReconstructorInput {
        gbuffer,
        camera: &camera,
        masks: &masks,
        images: &images,
        target: picture.texture().into(),
        timestamps: Some(times.stamps(5)),
    };
    blend
        .record(
            device,
            &mut encoder,
            &input,
            &MultiResReconstructorSettings::default(),
        )
        .expect("a picture");

    let map = ReflectiveShadowMap::new(device).expect("pipelines");
    let lights = map.create_view(device, 32, 32).expect("a view");
    let mut decoded = Decoded::of(&camera);
    let frame = decoded.frame(&mut encoder, gbuffer, &camera, camera.eye());
    let input = ReflectiveShadowMapInput {
        timestamps: Some(times.stamps(6)),
        ..ReflectiveShadowMapInput::new(&frame, light)
    };
    map.record(device, &mut encoder, &input, &lights)
        .expect("lights");
    let gatherer = Gatherer::polygons(device);
    let target = gpu.target(color, 32, 32);
    let hull = SgHull::new(
        device,
        &SgHullDescriptor {
            gatherer: &gatherer,
            target: color,
            albedo: false,
            glossy: false,
            components: Components::default(),
        },
    )
    .expect("pipelines");
    let view = hull
        .create_view(device, SgHullSize::new(32, 32))
        .expect("a view");
    let gather = gatherer
        .bind_polygons(device, lights.lights())
        .expect("lights");
    let input = SgHullInput {
        timestamps: Some(times.stamps(7)),
        ..SgHullInput::new(&frame, Some(&gather), target.texture())
    };
    hull.record(
        device,
        &mut encoder,
        &input,
        &SgHullSettings::default(),
        &view,
    )
    .expect("a picture");
    times.check(gpu, encoder);
}

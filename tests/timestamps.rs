//! Times that the caller asks for, on devices that have them.

mod shot;

#[path = "../examples/support/mod.rs"]
mod support;

use deep_screen_space::{
    AmbientOcclusion, BouncedDescriptor, BouncedInput, BouncedSettings, BouncedZBuffer, Channels,
    CloudCapacity, ClusterInput, Error, Geometry, HitReconstructor, HitReconstructorDescriptor,
    HitReconstructorInput, HitReconstructorSettings, Payload, Reconstructor, ReconstructorInput,
    ReconstructorSettings, Sampling, ShellSplatter, ShellSplatterDescriptor, SplatInput,
    SplatSettings, SurfelShader, SurfelShaderInput, SurfelShaderSettings, Surfelizer,
    SurfelizerInput, SurfelizerSettings, TemporalAccumulator, TemporalInput, TemporalSettings,
    Timestamps, scenes, wgpu,
};
use shot::{Shot, camera_of};
use support::gpu::{Ask, Gpu};

/// Each recording writes the two indices that it was given. What the times are is the driver's affair: lavapipe's are
/// wrong once a render pass has run.
#[test]
fn recordings_write_their_times() {
    let gpu = Gpu::open(Ask::from_env()).expect("a graphics adapter");
    let device = &gpu.device;
    if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
        // Then no such query set can be made, and nothing of it is used: the other tests run without.
        assert_ne!(Ask::from_env(), Ask::All, "this adapter has no timestamps");
        return;
    }
    let set = device.create_query_set(&wgpu::QuerySetDescriptor {
        label: None,
        ty: wgpu::QueryType::Timestamp,
        count: 18,
    });
    let stamps = |begin| {
        Some(Timestamps {
            set: &set,
            begin,
            end: begin + 1,
        })
    };
    let scene = scenes::cornell();
    let shot = Shot::new(&gpu, &scene, &camera_of(&scene, 0, [16, 16]));
    let effect = AmbientOcclusion::default().effect();
    let settings = SplatSettings::default();
    let surfelizer = Surfelizer::new(device, None).expect("pipelines");
    let splatter = ShellSplatter::new(
        device,
        &ShellSplatterDescriptor {
            effect: &effect,
            subgroups: false,
            statistics: false,
            cache: None,
        },
    )
    .expect("pipelines");
    let shader = SurfelShader::new(device, None).expect("pipelines");
    let format = wgpu::TextureFormat::R32Float;
    let reconstructor = Reconstructor::new(device, &effect, format, None).expect("pipelines");
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
    let scratch = reconstructor
        .create_view(device, 16, 16, 5)
        .expect("a view");
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
        set: &set,
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
    surfelize(&mut encoder, stamps(0)).expect("surfels");
    let materials = gpu.buffer(&scene.material_table(), wgpu::BufferUsages::STORAGE);
    let radiance = shader.create_radiance(device, &cloud).expect("room");
    let input = SurfelShaderInput {
        cloud: &cloud,
        materials: &materials,
        lights: &[],
        radiance: &radiance,
        timestamps: stamps(8),
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
        cloud: &cloud,
        materials: None,
        timestamps: stamps(2),
    };
    splatter
        .record_clusters(device, &mut encoder, &input, &settings, &mut clusters)
        .expect("clusters");
    let input = SplatInput {
        gbuffer: shot.gbuffer(),
        camera: &shot.camera,
        cloud: &cloud,
        clusters: &clusters,
        materials: None,
        work: None,
        timestamps: stamps(4),
    };
    splatter
        .record(device, &mut encoder, &input, &settings, &sums)
        .expect("sums");
    let input = ReconstructorInput {
        gbuffer: shot.gbuffer(),
        camera: &shot.camera,
        cloud: &cloud,
        sums: &sums,
        levels: 5,
        target: &target,
        sub_image: None,
        timestamps: stamps(6),
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
    let accumulator =
        TemporalAccumulator::new(device, Channels::One, format, None).expect("pipelines");
    let mut history = accumulator
        .create_history(device, 16, 16)
        .expect("a history");
    let input = TemporalInput {
        gbuffer: shot.gbuffer(),
        camera: &shot.camera,
        previous_camera: &shot.camera,
        motion: None,
        picture: &target,
        target: &target,
        reset: false,
        timestamps: stamps(10),
    };
    let settings = TemporalSettings::default();
    accumulator
        .record(device, &mut encoder, &input, &settings, &mut history)
        .expect("a mean");
    let tracer =
        BouncedZBuffer::new(device, &BouncedDescriptor::default(), None).expect("pipelines");
    let bounds = tracer.create_bounds(device, &cloud).expect("bounds");
    let hits = tracer.create_view(device, 16, 16, 16).expect("a view");
    tracer
        .record_bounds(device, &mut encoder, &cloud, &bounds, stamps(12))
        .expect("bounds");
    let input = BouncedInput {
        lighting: None,
        gbuffer: shot.gbuffer(),
        camera: &shot.camera,
        cloud: &cloud,
        bounds: &bounds,
        radiance: None,
        timestamps: stamps(14),
        roughness: None,
    };
    let traced = BouncedSettings::default();
    tracer
        .record(device, &mut encoder, &input, &traced, &hits)
        .expect("hits");
    let descriptor = HitReconstructorDescriptor {
        payload: Payload::Occlusion,
        sampling: Sampling::Cosine,
        deferred: true,
        target: format,
    };
    let reconstructor = HitReconstructor::new(device, &descriptor, None).expect("pipelines");
    let scratch = reconstructor.create_view(device, 16, 16).expect("a view");
    let input = HitReconstructorInput {
        gbuffer: shot.gbuffer(),
        camera: &shot.camera,
        cloud: &cloud,
        hits: &hits,
        traced: &traced,
        target: &target,
        timestamps: stamps(16),
        roughness: None,
    };
    let settings = HitReconstructorSettings::default();
    reconstructor
        .record(device, &mut encoder, &input, &settings, &scratch)
        .expect("a picture");
    let resolved = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 144,
        usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    encoder.resolve_query_set(&set, 0..18, &resolved, 0);
    gpu.finish(encoder);
    let times: Vec<u64> = gpu.read_buffer(&resolved);
    println!("{times:?}");
    assert!(
        times.iter().all(|t| *t > 0),
        "not all were written: {times:?}"
    );
}

//! Objects that were not recorded, or not from what they are used with, or not since that was.

use deep_screen_space::{
    Components, Gatherer, HitResolver, HitResolverDescriptor, HitResolverInput,
    HitResolverSettings, Payload, PolygonLight, Reconstructor, ReconstructorInput,
    ReconstructorSettings, Sampling, SgHull, SgHullDescriptor, SgHullInput, SgHullSettings,
    SgHullSize, ShadedLight, Shadow, SurfelShader, SurfelShaderInput, SurfelShaderSettings,
};

use super::*;
use support::testing::refusals::refused;

#[test]
fn clusters_and_sums_are_those_of_the_cloud() {
    let lab = &*LAB;
    let device = &lab.gpu.device;
    let mut encoder = lab.gpu.encoder();
    let e = &mut encoder;
    let mut cloud = lab.cloud(ROOM);
    let mut clusters = lab.clusters(&cloud);
    let view = lab.splat_view();
    let never = "not recorded";
    let kind = "Recording";
    refused(
        lab.record_clusters(e, &cloud, &mut clusters),
        kind,
        "SurfelCloud",
        never,
    );
    lab.record_cloud(e, &mut cloud);
    refused(
        lab.splat(e, (&cloud, &clusters), &view),
        kind,
        "SurfelClusters",
        never,
    );
    lab.record_clusters(e, &cloud, &mut clusters)
        .expect("clusters");
    let other = lab.recorded(e, ROOM);
    refused(
        lab.splat(e, (&other, &clusters), &view),
        kind,
        "SurfelClusters",
        "another SurfelCloud",
    );

    let effect = AmbientOcclusion::default().effect();
    let pass = Reconstructor::new(device, &effect, Format::R32Float).expect("pipelines");
    let scratch = pass.create_view(device, &view).expect("a view");
    let target = lab.gpu.target(Format::R32Float, SIDE, SIDE);
    let resolve = |e: &mut wgpu::CommandEncoder| {
        let mut decoded = lab.decoded();
        let frame = decoded.frame(e, lab.gbuffer(), &lab.camera, lab.camera.focus());
        let input = ReconstructorInput::new(&frame, &view, target.texture());
        pass.record(
            device,
            e,
            &input,
            &ReconstructorSettings::default(),
            &scratch,
        )
    };
    refused(resolve(e), kind, "SplatView", never);
    lab.splat(e, (&cloud, &clusters), &view).expect("sums");
    resolve(e).expect("a picture");

    lab.record_cloud(e, &mut cloud);
    let before = "before the last recording";
    refused(
        lab.splat(e, (&cloud, &clusters), &view),
        kind,
        "SurfelClusters",
        before,
    );
    refused(resolve(e), kind, "SplatView", before);
    lab.record_clusters(e, &cloud, &mut clusters)
        .expect("clusters");
    lab.splat(e, (&cloud, &clusters), &view).expect("sums");
    resolve(e).expect("a picture");
    submit(lab, encoder);
}

#[test]
fn bounds_and_hits_are_those_of_the_cloud() {
    let lab = &*LAB;
    let device = &lab.gpu.device;
    let mut encoder = lab.gpu.encoder();
    let e = &mut encoder;
    let mut cloud = lab.cloud(ROOM);
    let bounds = lab.bvh(&cloud);
    let hits = lab.hits(&lab.bounced);
    let (kind, never, before) = ("Recording", "not recorded", "before the last recording");
    let trace = |e: &mut wgpu::CommandEncoder, cloud: &SurfelCloud| {
        lab.trace(e, &lab.bounced, (cloud, &bounds), &lab.materials, &hits)
    };
    refused(
        lab.record_bvh(e, &cloud, &bounds),
        kind,
        "SurfelCloud",
        never,
    );
    lab.record_cloud(e, &mut cloud);
    refused(trace(e, &cloud), kind, "Bvh", never);
    lab.record_bvh(e, &cloud, &bounds).expect("a hierarchy");
    let other = lab.recorded(e, ROOM);
    refused(trace(e, &other), kind, "Bvh", "another SurfelCloud");

    let shader = SurfelShader::new(device).expect("pipelines");
    let radiance = shader.create_radiance(device, &other).expect("room");
    let lights = [ShadedLight {
        light: deep_screen_space::Light::Point {
            position: DVec3::ZERO,
            intensity: [1.0; 3],
        },
        shadow: Shadow::Traced(&bounds),
    }];
    let input = SurfelShaderInput {
        cloud: &other,
        materials: &lab.materials,
        lights: &lights,
        radiance: &radiance,
        timestamps: None,
    };
    let settings = SurfelShaderSettings::default();
    let shaded = shader.record(device, e, &input, &settings);
    refused(shaded, kind, "Bvh", "another SurfelCloud");

    let descriptor = HitResolverDescriptor {
        payload: Payload::Occlusion,
        sampling: Sampling::default(),
        deferred: false,
        counted: false,
        joined: false,
        bent_normals: false,
        emitter_samples: 0,
        target: Format::R32Float,
    };
    let pass = HitResolver::new(device, &descriptor).expect("pipelines");
    let scratch = pass.create_view(device, &hits).expect("a view");
    let target = lab.gpu.target(Format::R32Float, SIDE, SIDE);
    let resolve = |e: &mut wgpu::CommandEncoder| {
        let mut decoded = lab.decoded();
        let frame = decoded.frame(e, lab.gbuffer(), &lab.camera, lab.camera.focus());
        let input = HitResolverInput::new(&frame, &hits, target.texture());
        let settings = HitResolverSettings::default();
        pass.record(device, e, &input, &settings, &scratch)
    };
    refused(resolve(e), kind, "BouncedView", never);
    trace(e, &cloud).expect("hits");
    resolve(e).expect("a picture");

    lab.record_cloud(e, &mut cloud);
    refused(trace(e, &cloud), kind, "Bvh", before);
    refused(resolve(e), kind, "BouncedView", before);
    submit(lab, encoder);
}

#[test]
fn gatherers_bind_for_themselves() {
    let lab = &*LAB;
    let device = &lab.gpu.device;
    let (polygons, lights) = (Gatherer::polygons(device), Gatherer::lights(device));
    let eye = lab.camera.eye();
    let kind = "Mismatch";
    let buffer = lab
        .gpu
        .buffer(&[PolygonLight::default()], BufferUsages::STORAGE);
    refused(
        lights.bind_polygons(device, &buffer),
        kind,
        "Gatherer",
        "Gatherer::polygons",
    );
    refused(
        polygons.bind_lights(device, &[], eye),
        kind,
        "Gatherer",
        "Gatherer::lights",
    );
    for bad in [f64::NAN, 1e30] {
        let bound = lights.bind_lights(device, &[], DVec3::X * bad);
        refused(bound, "Setting", "origin", "finite");
    }

    let descriptor = SgHullDescriptor {
        gatherer: &lights,
        target: Format::Rgba16Float,
        albedo: false,
        glossy: false,
        components: Components::default(),
    };
    let hull = SgHull::new(device, &descriptor).expect("pipelines");
    let view = hull
        .create_view(device, SgHullSize::new(SIDE, SIDE))
        .expect("a view");
    let target = lab.gpu.target(Format::Rgba16Float, SIDE, SIDE);
    let mut encoder = lab.gpu.encoder();
    let mut record = |gather, origin| {
        let mut decoded = lab.decoded();
        let frame = decoded.record(&mut encoder, lab.gbuffer(), &lab.camera, origin)?;
        let input = SgHullInput::new(&frame, Some(gather), target.texture());
        let settings = SgHullSettings::default();
        hull.record(device, &mut encoder, &input, &settings, &view)
    };
    let own = lights.bind_lights(device, &[], eye).expect("lights");
    let others = polygons.bind_polygons(device, &buffer).expect("lights");
    record(&own, eye).expect("a picture");
    refused(
        record(&others, eye),
        kind,
        "SgHullInput::gather",
        "another gatherer",
    );
    refused(
        record(&own, eye + DVec3::X),
        kind,
        "SgHullInput::gather",
        "FrameInput::origin",
    );
    for bad in [f64::NAN, 1e30] {
        let recorded = record(&own, DVec3::X * bad);
        refused(recorded, "Setting", "FrameInput::origin", "finite");
    }
    submit(lab, encoder);
}

#[test]
fn unknown_constants_are_refused() {
    let lab = &*LAB;
    let device = &lab.gpu.device;
    let constants = vec![("NO_SUCH".to_owned(), 1.0)];
    let mut effect = AmbientOcclusion::default().effect();
    effect.constants.extend(constants.clone());
    let splatter = ShellSplatterDescriptor {
        effect: &effect,
        subgroups: false,
        statistics: false,
    };
    refused(
        ShellSplatter::new(device, &splatter),
        "Effect",
        "NO_SUCH",
        "TWO_SIDED",
    );
    let made = Reconstructor::new(device, &effect, Format::R32Float);
    refused(made, "Effect", "NO_SUCH", "TWO_SIDED");
    let gatherer = Gatherer {
        constants,
        ..Gatherer::lights(device)
    };
    let descriptor = SgHullDescriptor {
        gatherer: &gatherer,
        target: Format::Rgba16Float,
        albedo: false,
        glossy: false,
        components: Components::default(),
    };
    refused(
        SgHull::new(device, &descriptor),
        "Effect",
        "NO_SUCH",
        "no override",
    );
}

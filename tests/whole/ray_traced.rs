//! `RayTracedScene` and `RayTracedView`: the same as the passes by hand, over sizes, scenes that grow, and what is not there.

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, Camera, CloudCapacity, Error, GBuffer, Geometry, HitLighting,
    HitRadiance, HitResolverInput, Light, Mesh, Payload, Primitives, Quality, RayBudget,
    RayBudgetInput, RaySettings, RayTracedEffect, RayTracedInput, RayTracedScene,
    RayTracedSceneInput, RayTracedView, RayTracedViewDescriptor, SurfelizerInput,
    SurfelizerSettings, TemporalSettings, Viewport,
    glam::DVec3,
    scenes,
    wgpu::{self, TextureFormat as Format},
};
use support::testing::{
    frames::Decoded,
    pipelines,
    refusals::refused,
    shot::{Shot, camera_of},
};

const OCCLUSION: RayTracedEffect = RayTracedEffect::AmbientOcclusion { radius: 2.0 };
const DIFFUSE: RayTracedEffect = RayTracedEffect::IndirectDiffuse {
    sky_radiance: [0.5, 0.25, 0.125],
};

fn view_of(effect: RayTracedEffect, target: Format) -> RayTracedView {
    let device = &pipelines::gpu().device;
    let descriptor = RayTracedViewDescriptor::new(effect, Quality::Fast, target);
    RayTracedView::new(device, &descriptor).expect("pipelines")
}

fn scene() -> RayTracedScene {
    RayTracedScene::new(&pipelines::gpu().device).expect("pipelines")
}

fn lamp() -> [Light; 1] {
    [Light::Point {
        position: DVec3::new(0.0, 3.5, 0.0),
        intensity: [4.0, 3.0, 2.0],
    }]
}

/// One frame of a view.
fn render(
    scene: &mut RayTracedScene,
    view: &mut RayTracedView,
    shot: &Shot,
    meshes: &[Mesh<'_>],
    target: &wgpu::TextureView,
) -> Result<(), Error> {
    let gpu = pipelines::gpu();
    let mut encoder = gpu.encoder();
    let lights = lamp();
    let input = RayTracedSceneInput {
        lighting: Some(HitLighting {
            materials: &shot.buffers.materials,
            lights: &lights,
        }),
        ..RayTracedSceneInput::new(Geometry { meshes }, &shot.camera)
    };
    scene.record(&gpu.device, &mut encoder, &input)?;
    let input = RayTracedInput::new(shot.lit_gbuffer(), &shot.camera, target.texture());
    view.record(&gpu.device, &mut encoder, scene, &input)?;
    gpu.finish(encoder);
    Ok(())
}

fn picture(target: &wgpu::TextureView) -> Vec<[f32; 4]> {
    pipelines::gpu().read_texture(target.texture(), 0)
}

/// The passes by hand.
fn by_hand(shot: &Shot, payload: Payload) -> Vec<[f32; 4]> {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let Viewport { width, height, .. } = shot.camera.viewport();
    let capacity = CloudCapacity {
        surfels: 0,
        pieces: 1 << 16,
        triangles: 1 << 16,
    };
    let mut cloud = pipelines::surfelizer()
        .create_cloud(device, capacity)
        .expect("room");
    let builder = pipelines::bvh_builder(Primitives::Triangles);
    let bvh = builder.create(device, &cloud).expect("room");
    let rays: RaySettings = Quality::Fast.rays(payload);
    let tracer = pipelines::bounced(&BouncedDescriptor {
        payload,
        counted: rays.further.is_some(),
        ..BouncedDescriptor::default()
    });
    let resolver = tracer
        .resolver(device, Format::Rgba32Float, false)
        .expect("pipelines");
    let hits = tracer
        .create_view(device, width, height, rays.rays_per_pixel)
        .expect("room");
    let scratch = resolver.create_view(device, &hits).expect("room");
    let target = gpu.target(Format::Rgba32Float, width, height);
    let mut encoder = gpu.encoder();
    let meshes = shot.buffers.meshes();
    let input = SurfelizerInput::new(Geometry { meshes: &meshes }, &shot.camera);
    let settings = SurfelizerSettings {
        density: f32::INFINITY,
        ..SurfelizerSettings::default()
    };
    pipelines::surfelizer()
        .record(device, &mut encoder, &input, &settings, &mut cloud)
        .expect("triangles");
    builder
        .record(device, &mut encoder, &cloud, &bvh, None)
        .expect("a hierarchy");
    let mut decoded = Decoded::of(&shot.camera);
    let frame = decoded.frame(
        &mut encoder,
        shot.lit_gbuffer(),
        &shot.camera,
        cloud.origin(),
    );
    let lights = lamp();
    let lit = HitRadiance::Lit(HitLighting {
        materials: &shot.buffers.materials,
        lights: &lights,
    });
    let input = BouncedInput {
        radiance: lit,
        ..BouncedInput::new(&frame, &cloud, &bvh)
    };
    let mut traced = rays.bounced(2.0);
    if payload != Payload::Occlusion {
        traced.radius = f32::INFINITY;
        traced.sky_radiance = [0.5, 0.25, 0.125];
    }
    tracer
        .record(device, &mut encoder, &input, &traced, &hits)
        .expect("hits");
    if let Some(further) = &rays.further {
        let budget = RayBudget::new(device).expect("pipelines");
        let list = budget.create_view(device, width, height).expect("room");
        resolver
            .estimate(
                device,
                &mut encoder,
                (&frame, &hits),
                &rays.filter,
                &scratch,
            )
            .expect("means");
        let noise = RayBudgetInput::new(&frame, &hits, &scratch, &rays.filter);
        budget
            .record(device, &mut encoder, &noise, further, &list)
            .expect("a budget");
        tracer
            .record_more(device, &mut encoder, &input, &traced, (&hits, &list))
            .expect("further rays");
    }
    let input = HitResolverInput::new(&frame, &hits, target.texture());
    resolver
        .record(device, &mut encoder, &input, &rays.filter, &scratch)
        .expect("a picture");
    gpu.finish(encoder);
    picture(&target)
}

#[test]
fn pictures_are_those_of_the_passes() {
    let gpu = pipelines::gpu();
    let cornell = scenes::cornell();
    let mut traced = scene();
    for (effect, payload) in [
        (OCCLUSION, Payload::Occlusion),
        (DIFFUSE, Payload::LitRadiance),
    ] {
        let mut view = view_of(effect, Format::Rgba32Float);
        assert_eq!(view.memory_bytes(), 0);
        // Larger, smaller, and of one pixel.
        for size in [[40, 24], [48, 32], [1, 1]] {
            let shot = Shot::new(gpu, &cornell, &camera_of(&cornell, 0, size));
            let target = gpu.target(Format::Rgba32Float, size[0], size[1]);
            let meshes = shot.buffers.meshes();
            render(&mut traced, &mut view, &shot, &meshes, &target).expect("a picture");
            assert_eq!(
                picture(&target),
                by_hand(&shot, payload),
                "{effect:?}, {size:?}"
            );
        }
    }
}

/// A scene's room follows its triangles, and an encoder that is never submitted leaves nothing behind that waits for it.
#[test]
fn rooms_grow_with_their_scene() {
    let gpu = pipelines::gpu();
    let cornell = scenes::cornell();
    let shot = Shot::new(gpu, &cornell, &camera_of(&cornell, 0, [24, 16]));
    let target = gpu.target(Format::Rgba32Float, 24, 16);
    let meshes = shot.buffers.meshes();
    let mut traced = scene();
    let mut view = view_of(OCCLUSION, Format::Rgba32Float);
    // An empty scene: all is open.
    render(&mut traced, &mut view, &shot, &[], &target).expect("a picture");
    assert!(picture(&target).iter().all(|v| v[0] == 1.0));
    let empty = traced.memory_bytes();
    drop({
        let mut encoder = gpu.encoder();
        let input = RayTracedSceneInput::new(Geometry { meshes: &meshes }, &shot.camera);
        traced
            .record(&gpu.device, &mut encoder, &input)
            .expect("a scene");
        encoder
    });
    for _ in 0..3 {
        render(&mut traced, &mut view, &shot, &meshes, &target).expect("a picture");
        assert_eq!(picture(&target), by_hand(&shot, Payload::Occlusion));
    }
    let counts = traced.counts().expect("counts of a frame before");
    assert!(counts.pieces > 0 && counts.lost_area == 0, "{counts:?}");
    let one = traced.memory_bytes();
    let many: Vec<Mesh<'_>> = meshes
        .iter()
        .cycle()
        .take(400 * meshes.len())
        .copied()
        .collect();
    render(&mut traced, &mut view, &shot, &many, &target).expect("a picture");
    // The same triangles many times over hide the same; how near the first hit found was differs, and with it the filter.
    let [found, expected] = [picture(&target), by_hand(&shot, Payload::Occlusion)];
    let off = support::errors::rmse(found.as_flattened(), expected.as_flattened());
    assert!(off < 0.02, "{off}");
    assert!(empty <= one && one < traced.memory_bytes());
}

/// Frames of few rays come nearer to many than one does.
#[test]
fn frames_are_joined() {
    let gpu = pipelines::gpu();
    let cornell = scenes::cornell();
    let size = [48, 32];
    let shot = Shot::new(gpu, &cornell, &camera_of(&cornell, 0, size));
    let meshes = shot.buffers.meshes();
    let mut traced = scene();
    let mut mean = |rays: u32, frames: u32, temporal| {
        let descriptor = RayTracedViewDescriptor {
            rays: RaySettings::new(rays, OCCLUSION.payload()),
            temporal,
            ..RayTracedViewDescriptor::new(OCCLUSION, Quality::Fast, Format::Rgba32Float)
        };
        let mut view = RayTracedView::new(&gpu.device, &descriptor).expect("pipelines");
        let target = gpu.target(Format::Rgba32Float, size[0], size[1]);
        for _ in 0..frames {
            render(&mut traced, &mut view, &shot, &meshes, &target).expect("a picture");
        }
        picture(&target)
    };
    let joined = Some(TemporalSettings {
        max_frames: 64,
        ..TemporalSettings::default()
    });
    let truth = mean(64, 1, None);
    let rmse =
        |picture: &[[f32; 4]]| support::errors::rmse(picture.as_flattened(), truth.as_flattened());
    let [one, eight] = [mean(1, 1, joined), mean(1, 8, joined)].map(|picture| rmse(&picture));
    println!("one frame {one:.4}, eight {eight:.4}");
    assert!(eight < 0.7 * one, "one frame {one}, eight {eight}");
}

#[test]
fn what_is_not_there_is_a_typed_error() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let cornell = scenes::cornell();
    let shot = Shot::new(gpu, &cornell, &camera_of(&cornell, 0, [8, 8]));
    let target = gpu.target(Format::Rgba32Float, 8, 8);
    let meshes = shot.buffers.meshes();
    let mut traced = scene();
    let mut view = view_of(DIFFUSE, Format::Rgba32Float);
    let mut encoder = gpu.encoder();
    let with = |gbuffer: GBuffer<'_>,
                camera: &Camera,
                view: &mut RayTracedView,
                traced: &RayTracedScene| {
        let input = RayTracedInput::new(gbuffer, camera, target.texture());
        view.record(device, &mut gpu.encoder(), traced, &input)
    };
    let lit = shot.lit_gbuffer();
    let camera = &shot.camera;
    refused(
        with(lit, camera, &mut view, &traced),
        "Recording",
        "RayTracedScene",
        "not recorded",
    );
    let input = RayTracedSceneInput::new(Geometry { meshes: &meshes }, camera);
    traced
        .record(device, &mut encoder, &input)
        .expect("a scene");
    refused(
        with(lit, camera, &mut view, &traced),
        "Mismatch",
        "RayTracedSceneInput::lighting",
        "indirect light",
    );
    let lights = lamp();
    let input = RayTracedSceneInput {
        lighting: Some(HitLighting {
            materials: &shot.buffers.materials,
            lights: &lights,
        }),
        ..input
    };
    traced
        .record(device, &mut encoder, &input)
        .expect("a scene");
    with(lit, camera, &mut view, &traced).expect("a picture");
    refused(
        with(shot.gbuffer(), camera, &mut view, &traced),
        "Mismatch",
        "GBuffer::albedo",
        "none",
    );
    let mut glossy = view_of(
        RayTracedEffect::IndirectSpecular {
            sky_radiance: [0.0; 3],
        },
        Format::Rgba32Float,
    );
    refused(
        with(lit, camera, &mut glossy, &traced),
        "Mismatch",
        "GBuffer::roughness",
        "none",
    );
    let other = view_of(DIFFUSE, Format::Rgba16Float);
    let mut other = other;
    refused(
        with(lit, camera, &mut other, &traced),
        "Mismatch",
        "RayTracedInput::target",
        "Rgba16Float",
    );

    // Settings.
    let bad = RayTracedEffect::AmbientOcclusion { radius: f32::NAN };
    let descriptor = RayTracedViewDescriptor::new(bad, Quality::Fast, Format::R8Unorm);
    refused(
        RayTracedView::new(device, &descriptor),
        "Setting",
        "BouncedSettings::radius",
        "0",
    );
    let descriptor = RayTracedViewDescriptor::new(OCCLUSION, Quality::Fast, Format::R32Uint);
    refused(
        RayTracedView::new(device, &descriptor),
        "Format",
        "RayTracedView target",
        "a colour format",
    );
    let mut rays = Quality::Fast.rays(Payload::Occlusion);
    rays.rays_per_pixel = 65;
    refused(view.set_rays(rays), "Setting", "rays_per_pixel", "64");
    refused(
        view.set_effect(OCCLUSION),
        "Setting",
        "RayTracedEffect",
        "kind",
    );
    let input = RayTracedSceneInput {
        reach: f32::NAN,
        ..input
    };
    refused(
        traced.record(device, &mut encoder, &input),
        "Setting",
        "RayTracedSceneInput::reach",
        "0 to infinity",
    );
}

//! What an effect that needs nothing else takes: passes, dispatches, objects, bindings and bytes of ambient occlusion alone, by
//! count, so that what is added for other effects is seen not to be added to it.

use deep_screen_space::{
    AmbientOcclusion, Geometry, Quality, RayTracedEffect, RayTracedInput, RayTracedScene,
    RayTracedSceneInput, RayTracedView, RayTracedViewDescriptor, scenes, shaders,
    wgpu::TextureFormat as Format,
};
use support::testing::{
    calls::{self, Calls},
    pipelines,
    shot::{Shot, camera_of},
};

const SIZE: [u32; 2] = [24, 16];

#[test]
fn occlusion_alone_takes_what_it_took() {
    let gpu = pipelines::gpu();
    let cornell = scenes::cornell();
    let shot = Shot::new(gpu, &cornell, &camera_of(&cornell, 0, SIZE));
    let target = gpu.target(Format::R8Unorm, SIZE[0], SIZE[1]);
    let meshes = shot.buffers.meshes();
    let (made, (mut scene, mut view)) = calls::of(|| {
        let effect = RayTracedEffect::AmbientOcclusion { radius: 2.0 };
        let descriptor = RayTracedViewDescriptor::new(effect, Quality::Balanced, Format::R8Unorm);
        let scene = RayTracedScene::new(&gpu.device).expect("pipelines");
        let view = RayTracedView::new(&gpu.device, &descriptor).expect("pipelines");
        (scene, view)
    });
    let mut frame = || {
        calls::of(|| {
            let mut encoder = gpu.encoder();
            let input = RayTracedSceneInput::new(Geometry { meshes: &meshes }, &shot.camera);
            scene
                .record(&gpu.device, &mut encoder, &input)
                .expect("a scene");
            let input = RayTracedInput::new(shot.gbuffer(), &shot.camera, target.texture());
            view.record(&gpu.device, &mut encoder, &scene, &input)
                .expect("a view");
            gpu.finish(encoder);
        })
        .0
    };
    let [first, second] = [frame(), frame()];
    let passes = [
        ("surfelizer", 16),
        ("bvh", 45),
        ("receivers", 1),
        ("bounced z-buffer", 1),
        ("hit resolver", 2),
        ("hit resolver", 1),
    ]
    .map(|(label, count)| (format!("deep-screen-space {label}"), count));
    let of = |made: &[(&str, u32)]| made.iter().map(|&(name, n)| (name.to_owned(), n)).collect();
    let pipelines = [
        ("bind_group_layout", 16),
        ("compute_pipeline", 21),
        ("pipeline_layout", 22),
        ("render_pipeline", 1),
        ("shader_module", 12),
    ];
    let expected = Calls {
        made: of(&pipelines),
        ..Calls::default()
    };
    assert_eq!(made, expected);
    let room = [
        ("bind_group", 27),
        ("buffer", 33),
        ("command_encoder", 1),
        ("texture", 5),
    ];
    let expected = Calls {
        passes: passes.to_vec(),
        made: of(&room),
        transfers: 11,
    };
    assert_eq!(first, expected);
    // A frame like the one before makes nothing but what is bound of the caller's.
    let expected = Calls {
        made: of(&[("bind_group", 1), ("command_encoder", 1)]),
        ..expected
    };
    assert_eq!(second, expected);
    assert_eq!(
        [scene.memory_bytes(), view.memory_bytes()],
        [165_164, 16_896]
    );
}

#[test]
fn occlusion_alone_binds_what_it_bound() {
    let all = shaders(&AmbientOcclusion::default().effect()).expect("well-formed directives");
    for (name, bindings) in [
        ("surfelizer", 13),
        ("sort", 5),
        ("scan", 4),
        ("bvh_order", 6),
        ("bvh_cluster", 7),
        ("bvh_collapse", 7),
        ("receivers", 5),
        ("bounced_z_buffer occlusion", 8),
        ("hit_resolver occlusion average", 4),
        ("hit_resolver near", 4),
        ("hit_resolver occlusion reconstruct", 4),
    ] {
        let shader = all.iter().find(|shader| shader.name == name).expect(name);
        assert_eq!(
            shader.source.matches("@binding").count(),
            bindings,
            "{name}"
        );
    }
}

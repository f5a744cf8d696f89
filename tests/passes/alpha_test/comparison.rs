//! GPU and mirror, in one level and in two.

use deep_screen_space::{
    AlphaWrap, ChangedMeshes, Geometry, InstancedBvhInput, TexCoordFormat,
    glam::{DMat4, DQuat, DVec3},
    reference::alpha_test::AlphaMaps,
};

use support::testing::pipelines;

use super::{
    harness::{World, builder, camera, settings, sheets},
    sheets::{Sheet, ground, sheet, test_of},
};

#[test]
fn holes_are_the_mirrors() {
    let world = sheets();
    world.compare_flat("sheets", &settings(9));
    world.compare_instances("sheets", &settings(9));
}

/// Placed by transforms that mirror, stretch and shear; both levels, and normals by lit hits.
#[test]
fn mirrored_instances_have_the_holes_of_their_mesh() {
    let base = sheet(
        [
            DVec3::new(-0.5, 0.0, 0.5),
            DVec3::X,
            DVec3::new(0.0, 0.2, -1.0),
        ],
        [[-0.25, 0.0], [1.5, 2.0]],
        test_of(1, 0.5, [AlphaWrap::Repeat; 2]),
        TexCoordFormat::Float32x2,
    );
    let place = |scale: [f64; 3], turn: f64, shift: [f64; 3]| {
        let scale = DVec3::from(scale);
        let turn = DQuat::from_rotation_y(turn);
        DMat4::from_scale_rotation_translation(scale, turn, shift.into()).as_mat4()
    };
    let transforms = vec![
        place([1.0, 1.0, 1.0], 0.3, [-1.1, 0.3, 0.2]),
        place([-1.2, 1.0, 1.0], 0.7, [0.2, 0.4, 0.3]),
        place([0.9, -1.5, 1.3], 2.0, [1.2, 0.5, -0.2]),
        place([-0.8, -1.0, -1.1], 1.0, [0.1, 0.7, -1.1]),
    ];
    let world = World::new(
        vec![
            ground(),
            Sheet {
                transforms: Some(transforms),
                ..base
            },
        ],
        &camera(),
    );
    world.compare_flat("mirrored", &settings(9));
    world.compare_instances("mirrored", &settings(9));
}

/// What a mesh's coordinates become is for `changed` to say.
#[test]
fn changed_coordinates_are_built() {
    let world = sheets();
    let settings = settings(4);
    let gpu = pipelines::gpu();
    let meshes = world.meshes();
    let mut bvh = builder()
        .create(&gpu.device, &Geometry { meshes: &meshes })
        .expect("room");
    world.record(&mut bvh, &world.tests());
    let before = world.blocked(&bvh, &settings);
    let buffer = &world.buffers[1].tex_coords;
    gpu.queue
        .write_buffer(buffer, 0, &vec![0_u8; buffer.size() as usize]);
    world.record(&mut bvh, &world.tests());
    assert_eq!(world.blocked(&bvh, &settings), before);
    let mut encoder = gpu.encoder();
    let tests = world.tests();
    let input = InstancedBvhInput {
        changed: ChangedMeshes::Some(&[1]),
        ..world.input(&meshes, &tests)
    };
    builder()
        .record(&gpu.device, &mut encoder, &input, &mut bvh)
        .expect("a hierarchy");
    gpu.finish(encoder);
    assert_ne!(world.blocked(&bvh, &settings), before);
}

#[test]
fn maps_are_read_as_textures_are() {
    let maps = AlphaMaps {
        size: [2, 1],
        layers: vec![vec![0.0, 1.0]],
    };
    let at = |u: f64, wrap| maps.alpha_at([u, 0.5].into(), 0, [wrap; 2]);
    for (u, repeat, clamp, mirror) in [
        (0.25, 0.0, 0.0, 0.0),
        (0.5, 0.5, 0.5, 0.5),
        (0.75, 1.0, 1.0, 1.0),
        (0.0, 0.5, 0.0, 0.0),
        (1.0, 0.5, 1.0, 1.0),
        (1.25, 0.0, 1.0, 1.0),
        (-0.25, 1.0, 0.0, 0.0),
        (1.75, 1.0, 1.0, 0.0),
    ] {
        assert_eq!(at(u, AlphaWrap::Repeat), repeat, "repeat {u}");
        assert_eq!(at(u, AlphaWrap::ClampToEdge), clamp, "clamp {u}");
        assert_eq!(at(u, AlphaWrap::MirrorRepeat), mirror, "mirror {u}");
    }
}

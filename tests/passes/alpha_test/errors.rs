//! What is refused, by name.

use deep_screen_space::{
    AlphaChannel, AlphaTest, AlphaTestedInput, AlphaTests, BvhBuilder, Geometry,
    InstancedBvhBuilder, InstancedBvhInput, Primitives, TextureSlice,
    wgpu::{BufferUsages, TextureFormat},
};

use support::testing::{pipelines, refusals::refused};

use super::{
    harness::{builder, sheets},
    sheets::{LAYERS, layers_of, pictures},
};

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let world = sheets();
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let meshes = world.meshes();
    let tests = world.tests();
    let good = world.alpha_tests(&tests);
    good.validate(device, &meshes).expect("sound");
    let with = |change: &dyn Fn(&mut AlphaTest<'_>)| {
        let mut tests = world.tests();
        change(tests[1].as_mut().expect("a test"));
        world.alpha_tests(&tests).validate(device, &meshes)
    };
    for threshold in [f32::NAN, -0.1, 1.1, f32::INFINITY] {
        let result = with(&|test| test.threshold = threshold);
        refused(result, "Setting", "AlphaTest::threshold", "0 to 1");
    }
    for layer in [LAYERS, u32::MAX] {
        let result = with(&|test| test.layer = layer);
        refused(result, "Setting", "AlphaTest::layer", "AlphaTests::maps");
    }
    for (offset, stride) in [(2, 20), (0, 4), (0, 22), (u64::MAX - 3, 20), (4096, 20)] {
        let result = with(&|test| {
            test.tex_coords.offset = offset;
            test.tex_coords.stride = stride;
        });
        refused(result, "Buffer", "AlphaTest::tex_coords", "");
    }
    let uniform = gpu.buffer(&[0_u32; 256], BufferUsages::UNIFORM);
    let mut of_uniform = world.tests();
    if let Some(test) = &mut of_uniform[1] {
        test.tex_coords.buffer = &uniform;
    }
    let result = world.alpha_tests(&of_uniform).validate(device, &meshes);
    refused(result, "Buffer", "AlphaTest::tex_coords", "STORAGE");
    let many = [tests.clone(), tests.clone()].concat();
    refused(
        world.alpha_tests(&many).validate(device, &meshes),
        "Setting",
        "AlphaTests::meshes",
        "as many",
    );
    // Pictures of another kind, and a channel that they lack.
    let depth = gpu.target(TextureFormat::Depth32Float, 4, 4);
    let integers = gpu.target(TextureFormat::R32Uint, 4, 4);
    let red = layers_of(TextureFormat::R8Unorm, &pictures().concat());
    for (texture, accepted) in [
        (depth.texture(), "floats"),
        (integers.texture(), "floats"),
        (&red, "channel"),
    ] {
        let result = AlphaTests {
            maps: texture.into(),
            channel: AlphaChannel::Green,
            meshes: &[],
        };
        refused(
            result.validate(device, &meshes),
            "Format",
            "AlphaTests::maps",
            accepted,
        );
    }
    let beyond = AlphaTests {
        maps: TextureSlice::new(&world.maps).mip(1),
        ..good
    };
    refused(
        beyond.validate(device, &meshes),
        "Shape",
        "AlphaTests::maps",
        "mip",
    );

    // Of the wrong primitives.
    refused(
        BvhBuilder::new(device, Primitives::AlphaTestedInstances),
        "Mismatch",
        "BvhBuilder",
        "InstancedBvhBuilder",
    );
    let (mut senders, _) = world.flat();
    let plain = BvhBuilder::new(device, Primitives::Triangles).expect("pipelines");
    let mut encoder = gpu.encoder();
    let input = AlphaTestedInput {
        geometry: Geometry { meshes: &meshes },
        tests: good,
        cloud: &senders.cloud,
        timestamps: None,
    };
    refused(
        plain.record_alpha_tested(device, &mut encoder, &input, &mut senders.bounds),
        "Mismatch",
        "BvhBuilder",
        "Primitives::AlphaTested",
    );
    let instanced = InstancedBvhBuilder::new(device).expect("pipelines");
    let geometry = Geometry { meshes: &meshes };
    let mut bvh = instanced.create(device, &geometry).expect("room");
    refused(
        instanced.record(
            device,
            &mut encoder,
            &world.input(&meshes, &tests),
            &mut bvh,
        ),
        "Mismatch",
        "InstancedBvhInput::alpha_tests",
        "AlphaTestedInstances",
    );
    refused(
        builder().record(
            device,
            &mut encoder,
            &InstancedBvhInput::new(geometry, &world.shot.camera),
            &mut bvh,
        ),
        "Mismatch",
        "InstancedBvh",
        "AlphaTestedInstances",
    );
    gpu.finish(encoder);
}

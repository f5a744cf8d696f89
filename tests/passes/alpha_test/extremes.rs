//! Coordinates and pictures of anything.

use std::cell::RefCell;

use deep_screen_space::{
    AlphaChannel, AlphaTest, AlphaTestedInput, AlphaTests, Geometry, Primitives, Sampling,
    TexCoordFormat, TexCoords,
    wgpu::{self, BufferUsages, TextureFormat},
};

use support::testing::pipelines;

use super::{
    harness::{alpha_lab, settings, sheets},
    sheets::{LAYERS, SIDE, layers_of},
};

/// Coordinates that are no numbers leave a triangle whole; far ones repeat all the same, and pictures of anything are within 0…1.
#[test]
fn extremes_have_defined_values() {
    let world = sheets();
    let settings = settings(4);
    let coords = |[u, v]: [f32; 2]| {
        let gpu = pipelines::gpu();
        let words: Vec<u32> = (0..200)
            .flat_map(|i| [u.to_bits(), v.to_bits()][i % 2..=i % 2].to_vec())
            .collect();
        gpu.buffer(&words, BufferUsages::STORAGE)
    };
    let senders = RefCell::new(world.flat().0);
    let count = |tests: &[Option<AlphaTest<'_>>], maps: &wgpu::Texture, channel| {
        let lab = alpha_lab();
        let senders = &mut *senders.borrow_mut();
        let meshes = world.meshes();
        let mut encoder = lab.gpu.encoder();
        let input = AlphaTestedInput {
            geometry: Geometry { meshes: &meshes },
            tests: AlphaTests {
                maps: maps.into(),
                channel,
                meshes: tests,
            },
            cloud: &senders.cloud,
            timestamps: None,
        };
        pipelines::bvh_builder(Primitives::AlphaTested)
            .record_alpha_tested(&lab.gpu.device, &mut encoder, &input, &mut senders.bounds)
            .expect("a hierarchy");
        lab.gpu.finish(encoder);
        let view = lab.trace(&world.shot, senders, None, &settings, Sampling::Cosine);
        let bits = lab.blocked(&view, &settings);
        bits.iter().map(|w| w.count_ones()).sum::<u32>()
    };
    let solid = count(&[], &world.maps, AlphaChannel::Green);
    let holed = count(&world.tests(), &world.maps, AlphaChannel::Green);
    assert!(holed + 100 < solid, "{holed} and {solid}");
    let replaced = |buffer: &wgpu::Buffer, threshold| {
        let mut tests = world.tests();
        for test in tests.iter_mut().flatten() {
            test.tex_coords = TexCoords {
                buffer,
                offset: 0,
                stride: 8,
                format: TexCoordFormat::Float32x2,
            };
            test.threshold = threshold;
        }
        count(&tests, &world.maps, AlphaChannel::Green)
    };
    for bad in [
        [f32::NAN, 0.0],
        [0.0, f32::INFINITY],
        [f32::NEG_INFINITY; 2],
    ] {
        assert_eq!(replaced(&coords(bad), 0.5), solid, "{bad:?}");
    }
    // All of a sheet is one place of the picture, which has little alpha or not.
    for far in [[1e30, -1e30], [-3e38, 3e38], [1e-40, -1e-40]] {
        assert_eq!(replaced(&coords(far), 0.0), solid, "{far:?}");
        assert!(replaced(&coords(far), 1.0) < solid, "{far:?}");
    }
    // What is no number counts as 0, what is beyond 1 as 1.
    let texels = |value: f32| {
        let all = vec![value; (SIDE * SIDE * LAYERS) as usize];
        layers_of(TextureFormat::R32Float, bytemuck::cast_slice(&all))
    };
    let red = AlphaChannel::Red;
    let tests = world.tests();
    let none = count(&tests, &texels(0.0), red);
    for (value, expected) in [
        (f32::NAN, none),
        (-1.0, none),
        (f32::NEG_INFINITY, none),
        (1e30, solid),
        (f32::INFINITY, solid),
    ] {
        assert_eq!(count(&tests, &texels(value), red), expected, "{value}");
    }
}

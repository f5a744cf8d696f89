//! The `MultiResReconstructor`: GPU against the f64 mirror, and what must hold of any blend.

use deep_screen_space::{
    Channels, Error, MultiResLevel, MultiResMask, MultiResMaskSettings, MultiResReconstructor,
    MultiResReconstructorInput, MultiResReconstructorSettings, MultiResView, SubImages, Viewport,
    glam::{DVec3, dcamera::rh::proj::directx as right},
    reference::multi_res_reconstructor::{Blend, stands_for},
    scenes,
    wgpu::{self, TextureFormat as Format},
};
use support::gpu::Gpu;
use support::testing::multi_res::{Frame, camera, framed, random, read_mask, record};
use support::testing::pipelines;

fn size_of([width, height]: [u32; 2], level: u32) -> [u32; 2] {
    [width, height].map(|n| n.div_ceil(1 << level))
}

/// The passes for one number of channels.
struct Wired<'g> {
    gpu: &'g Gpu,
    mask: &'static MultiResMask,
    blend: MultiResReconstructor,
    channels: Channels,
    /// Copies a texture to a storage texture of the channels.
    fill: wgpu::ComputePipeline,
}

fn fill_pipeline(device: &wgpu::Device, channels: Channels) -> wgpu::ComputePipeline {
    let name = match channels {
        Channels::One => "r32float",
        Channels::Three => "rgba16float",
    };
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(
            format!(
                "@group(0) @binding(0) var given: texture_2d<f32>;
@group(0) @binding(1) var result: texture_storage_2d<{name}, write>;
@compute @workgroup_size(8, 8) fn fill(@builtin(global_invocation_id) id: vec3u) {{
  if all(id.xy < textureDimensions(result)) {{
textureStore(result, id.xy, textureLoad(given, id.xy, 0));
  }}
}}"
            )
            .into(),
        ),
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("fill"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    })
}

impl<'g> Wired<'g> {
    fn new(gpu: &'g Gpu, channels: Channels) -> Self {
        Self {
            gpu,
            mask: pipelines::multi_res_mask(),
            blend: MultiResReconstructor::new(&gpu.device, channels, Format::Rgba32Float)
                .expect("a pipeline"),
            channels,
            fill: fill_pipeline(&gpu.device, channels),
        }
    }

    /// Sub-images of a function of the level and its pixel, NaN where a level does not list it; as the shader reads them.
    fn images(
        &self,
        masks: &MultiResView,
        settings: &MultiResMaskSettings,
        value: impl Fn(u32, [u32; 2]) -> DVec3,
    ) -> (SubImages, [Option<Vec<DVec3>>; 4]) {
        let [width, height] = masks.size();
        let images = self
            .blend
            .create_images(&self.gpu.device, width, height, settings)
            .expect("images");
        let mut held = [const { None }; 4];
        for level in 0..4 {
            let Some(image) = images.level(level) else {
                continue;
            };
            let [width, height] = size_of(masks.size(), level);
            let texels: Vec<DVec3> = (0..)
                .zip(read_mask(self.gpu, masks, level))
                .map(|(i, m)| {
                    if m == 0.0 {
                        return DVec3::NAN;
                    }
                    value(level, [i % width, i / width])
                })
                .collect();
            held[level as usize] = Some(match self.channels {
                Channels::One => {
                    let texels: Vec<f32> = texels.iter().map(|v| v.x as f32).collect();
                    self.fill(image, width, height, &texels);
                    texels.iter().map(|&v| DVec3::splat(v.into())).collect()
                }
                Channels::Three => {
                    let halves: Vec<[u16; 4]> = texels
                        .iter()
                        .map(|v| [half(v.x), half(v.y), half(v.z), 0])
                        .collect();
                    self.fill(image, width, height, &halves);
                    texels
                }
            });
        }
        (images, held)
    }

    /// A storage texture's texels, by a compute pass: it cannot be copied to.
    fn fill<T: bytemuck::Pod>(&self, image: &wgpu::Texture, width: u32, height: u32, texels: &[T]) {
        let device = &self.gpu.device;
        let given = self.gpu.texture(image.format(), width, height, texels);
        let view = image.create_view(&wgpu::TextureViewDescriptor::default());
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.fill.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&given),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::TextureView(&view),
                },
            ],
        });
        let mut encoder = self.gpu.encoder();
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.fill);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        drop(pass);
        self.gpu.finish(encoder);
    }

    /// The blend of the viewport, rows from the top; what is beside it stays 0.
    fn image(&self, frame: &Frame, masks: &MultiResView, images: &SubImages) -> Vec<DVec3> {
        let v = frame.camera.viewport();
        let target = self
            .gpu
            .target(Format::Rgba32Float, v.x + v.width + 2, v.y + v.height + 1);
        let mut encoder = self.gpu.encoder();
        self.blend
            .record(
                &self.gpu.device,
                &mut encoder,
                &MultiResReconstructorInput {
                    gbuffer: frame.gbuffer(),
                    camera: &frame.camera,
                    masks,
                    images,
                    target: target.texture().into(),
                    timestamps: None,
                },
                &MultiResReconstructorSettings::default(),
            )
            .expect("a picture");
        self.gpu.finish(encoder);
        let texels: Vec<[f32; 4]> = self.gpu.read_texture(target.texture(), 0);
        let width = v.x + v.width + 2;
        let mut inside = Vec::new();
        for (i, texel) in (0..).zip(texels) {
            let [x, y] = [i % width, i / width];
            if x >= v.x && y >= v.y && x < v.x + v.width && y < v.y + v.height {
                assert_eq!(texel[3], 1.0);
                inside.push(DVec3::new(
                    texel[0].into(),
                    texel[1].into(),
                    texel[2].into(),
                ));
            } else {
                assert_eq!(texel, [0.0; 4], "beside the viewport: {x}, {y}");
            }
        }
        inside
    }
}

/// The half of a multiple of 1/1024 in 0…1, exactly.
fn half(v: f64) -> u16 {
    if !v.is_finite() {
        return 0x7e00;
    }
    if v == 0.0 {
        return 0;
    }
    let exponent = v.log2().floor().max(-14.0);
    let mantissa = (v / exponent.exp2() - 1.0) * 1024.0;
    assert_eq!(mantissa.fract(), 0.0, "{v}");
    (((exponent + 15.0) as u16) << 10) | mantissa as u16
}

/// A value of a level's pixel that a half holds exactly.
fn noise(level: u32, [x, y]: [u32; 2]) -> DVec3 {
    DVec3::from([0, 1, 2].map(|k| (random(x + 8192 * y, 4 * level + k) * 255.0).floor() / 256.0))
}

#[test]
fn gpu_is_its_mirror() {
    let gpu = pipelines::gpu();
    for channels in [Channels::One, Channels::Three] {
        let wired = Wired::new(gpu, channels);
        for (name, size) in [("cornell", [96, 64]), ("colonnade", [77, 51])] {
            let scene = scenes::by_name(name).expect("a scene");
            let frame = Frame::of_scene(gpu, &scene, size);
            let receivers = frame.receivers();
            for settings in [
                MultiResMaskSettings::OCCLUSION,
                MultiResMaskSettings::SHADOW,
                MultiResMaskSettings::INDIRECT,
            ] {
                let masks = record(gpu, wired.mask, &frame.input(), &settings);
                let (images, held) = wired.images(&masks, &settings, noise);
                let found = wired.image(&frame, &masks, &images);
                let read = [0, 1, 2, 3].map(|level| {
                    settings.levels[level as usize]?;
                    Some(
                        read_mask(gpu, &masks, level)
                            .into_iter()
                            .map(f64::from)
                            .collect(),
                    )
                });
                let expected = Blend {
                    camera: &frame.camera,
                    receivers: &receivers,
                    mask_settings: &settings,
                    masks: &read,
                    images: &held,
                    has_importance: false,
                    settings: &MultiResReconstructorSettings::default(),
                }
                .image();
                // A neighbour just within reach of a plane counts by a square that f32 has to 1e-4 there, times a noise of
                // which each pixel differs; nothing is farther off.
                let worst = found
                    .iter()
                    .zip(&expected)
                    .map(|(f, e)| (*f - *e).abs().max_element())
                    .fold(0.0, f64::max);
                println!("{name}, {channels:?}: off by up to {worst:.1e}");
                assert!(worst < 2e-3, "{name}, {channels:?}: {worst}");
            }
        }
    }
}

/// A level in which what is listed counts alone.
const WHOLE: MultiResLevel = MultiResLevel::new(1.0, f32::INFINITY);

/// With a full mask and weights without end the image of full resolution comes out, bit by bit; with an empty mask the
/// coarsest.
#[test]
fn full_and_empty_masks() {
    let gpu = pipelines::gpu();
    let wired = Wired::new(gpu, Channels::One);
    let viewport = Viewport {
        x: 5,
        y: 3,
        width: 61,
        height: 43,
    };
    let camera = camera(right::perspective_infinite_reverse(1.0, 1.4, 0.1), viewport);
    let frame = scene(gpu, &camera);
    let count = (viewport.width * viewport.height) as usize;
    let [full, empty] =
        [1.0_f32, 0.0].map(|v| framed(gpu, &camera, Format::R32Float, &vec![v; count], f32::NAN));
    let settings = MultiResMaskSettings::with_levels([Some(WHOLE); 4]);
    let value = |level: u32, at: [u32; 2]| noise(level, at) / 3.0;
    let mut input = frame.input();
    input.edges = Some(full.texture().into());
    let masks = record(gpu, wired.mask, &input, &settings);
    let (images, held) = wired.images(&masks, &settings, value);
    let found = wired.image(&frame, &masks, &images);
    assert_eq!(Some(found), held[0]);

    // Between two levels the coarser one's own pixels are what they were.
    let mut two = settings;
    (two.levels[1], two.levels[2]) = (None, None);
    let mut input = frame.input();
    input.importance = Some(empty.texture().into());
    let masks = record(gpu, wired.mask, &input, &two);
    let (images, held) = wired.images(&masks, &two, value);
    let found = wired.image(&frame, &masks, &images);
    let coarsest = held[3].as_ref().expect("the coarsest");
    let [columns, rows] = size_of(frame.size(), 3);
    let mut exact = 0;
    for (i, own) in (0..columns * rows).zip(coarsest) {
        let [x, y] = stands_for([i % columns, i / columns], 3, frame.size());
        let off = (found[(y * viewport.width + x) as usize] - *own)
            .abs()
            .max_element();
        assert!(off < 1e-6, "{x}, {y}: {off}");
        exact += 1;
    }
    assert_eq!(exact, 48);

    // By steps corners are cut, and nothing is beyond what the coarsest level has.
    let masks = record(gpu, wired.mask, &input, &settings);
    let (images, held) = wired.images(&masks, &settings, value);
    let found = wired.image(&frame, &masks, &images);
    let coarsest = held[3].as_ref().expect("the coarsest");
    let range = |values: &[DVec3]| {
        let least = values.iter().fold(f64::MAX, |m, v| m.min(v.x));
        (least, values.iter().fold(f64::MIN, |m, v| m.max(v.x)))
    };
    let (low, high) = range(coarsest);
    assert!(
        found
            .iter()
            .all(|v| (low - 1e-6..=high + 1e-6).contains(&v.x))
    );
}

/// A ramp over the image comes out of the coarsest level as it went in: steps between levels move nothing.
#[test]
fn ramps_stay() {
    let gpu = pipelines::gpu();
    let wired = Wired::new(gpu, Channels::One);
    let size = [64, 48];
    let camera = camera(
        right::perspective_infinite_reverse(1.0, 1.4, 0.1),
        Viewport::full(size[0], size[1]),
    );
    // A wall without an edge.
    let frame = Frame::cast(gpu, &camera, Format::R32Float, |_, from, along| {
        Some((from + (-5.0 - from.z) / along.z * along, DVec3::Z))
    });
    let settings = MultiResMaskSettings::OCCLUSION;
    let masks = record(gpu, wired.mask, &frame.input(), &settings);
    let ramp = |[x, y]: [u32; 2]| f64::from(x) / 64.0 + f64::from(y) / 256.0;
    let (images, _) = wired.images(&masks, &settings, |level, at| {
        DVec3::splat(ramp(stands_for(at, level, size)))
    });
    let found = wired.image(&frame, &masks, &images);
    // As far from the border as the coarsest level's outermost pixels, and as a step cuts their corners.
    for [x, y] in (0..64 * 48).map(|i| [i % 64, i / 64]) {
        if (8..52).contains(&x) && (8..36).contains(&y) {
            let off = (found[(y * 64 + x) as usize].x - ramp([x, y])).abs();
            assert!(off < 1e-6, "{x}, {y}: {off}");
        }
    }
}

/// A floor, a wall behind it, a thin pole before it, and sky above.
fn scene(gpu: &Gpu, camera: &deep_screen_space::Camera) -> Frame {
    Frame::cast(gpu, camera, Format::R32Float, |_, from, along| {
        let hit = |offset: f64, normal: DVec3| {
            let t = (offset - from.dot(normal)) / along.dot(normal);
            (t > 0.0).then(|| (from + t * along, normal))
        };
        if let Some((p, n)) = hit(-2.0, DVec3::Z)
            && p.x.abs() < 0.05
        {
            return Some((p, n));
        }
        if let Some((p, n)) = hit(-1.0, DVec3::Y)
            && p.z > -6.0
        {
            return Some((p, n));
        }
        hit(-6.0, DVec3::Z).filter(|(p, _)| p.y < 1.0)
    })
}

/// Where an effect is the same everywhere so is its image, whatever levels there are: no pixel is dead, and what was not
/// computed, here NaN, is not seen.
#[test]
fn no_pixel_is_dead() {
    let gpu = pipelines::gpu();
    let wired = Wired::new(gpu, Channels::Three);
    for size in [[1, 1], [9, 8], [27, 14]] {
        let camera = camera(
            right::perspective_infinite_reverse(1.0, 1.4, 0.1),
            Viewport::full(size[0], size[1]),
        );
        let frame = scene(gpu, &camera);
        for chosen in 1..16_u32 {
            for preset in [
                MultiResMaskSettings::OCCLUSION,
                MultiResMaskSettings::with_levels([Some(WHOLE); 4]),
            ] {
                let mut settings = preset;
                for (level, own) in settings.levels.iter_mut().enumerate() {
                    *own = own.filter(|_| chosen & 1 << level != 0);
                }
                let masks = record(gpu, wired.mask, &frame.input(), &settings);
                let value = DVec3::new(0.25, 0.5, 0.75);
                let (images, _) = wired.images(&masks, &settings, |_, _| value);
                for (i, found) in wired.image(&frame, &masks, &images).iter().enumerate() {
                    let off = (*found - value).abs().max_element();
                    assert!(
                        off < 1e-6,
                        "{size:?}, levels {chosen:04b}, pixel {i}: {found}"
                    );
                }
            }
        }
    }
}

/// Across an edge in depth nothing is blended: a level's pixels count on their own surface alone.
#[test]
fn surfaces_do_not_mix() {
    let gpu = pipelines::gpu();
    let wired = Wired::new(gpu, Channels::One);
    let camera = camera(
        right::perspective_infinite_reverse(1.0, 1.4, 0.1),
        Viewport::full(64, 48),
    );
    // The left half is near and 0, the right half far and 1.
    let frame = Frame::cast(gpu, &camera, Format::R32Float, |[x, _], from, along| {
        let distance = if x < 29 { 2.0 } else { 5.0 };
        let t = (-distance - from.z) / along.z;
        Some((from + t * along, DVec3::Z))
    });
    // Without the finer levels, whose place the edge is.
    let settings = MultiResMaskSettings::with_levels([None, None, None, Some(WHOLE)]);
    let masks = record(gpu, wired.mask, &frame.input(), &settings);
    let (images, _) = wired.images(&masks, &settings, |level, at| {
        let [x, _] = stands_for(at, level, [64, 48]);
        DVec3::splat(f64::from(u8::from(x >= 29)))
    });
    for (i, found) in (0..).zip(wired.image(&frame, &masks, &images)) {
        let expected = f64::from(u8::from(i % 64 >= 29));
        // Strangers count 1e-4 of what neighbours do, and next to a corner of the grid there is 1/8 of these.
        assert!((found.x - expected).abs() < 2e-3, "pixel {i}: {found}");
    }
}

/// What is not finite is as good as not computed.
#[test]
fn garbage_does_not_spread() {
    let gpu = pipelines::gpu();
    let wired = Wired::new(gpu, Channels::One);
    let camera = camera(
        right::perspective_infinite_reverse(1.0, 1.4, 0.1),
        Viewport::full(40, 24),
    );
    let frame = scene(gpu, &camera);
    let settings = MultiResMaskSettings::OCCLUSION;
    let masks = record(gpu, wired.mask, &frame.input(), &settings);
    for bad in [f64::NAN, f64::INFINITY] {
        let (images, _) = wired.images(&masks, &settings, |level, [x, y]| {
            let spoilt = level < 3 && (x + y).is_multiple_of(3);
            DVec3::splat(if spoilt { bad } else { 0.5 })
        });
        for (i, found) in wired.image(&frame, &masks, &images).iter().enumerate() {
            assert!((found.x - 0.5).abs() < 1e-6, "{bad}, pixel {i}: {found}");
        }
        let (images, _) = wired.images(&masks, &settings, |_, _| DVec3::splat(bad));
        let all = wired.image(&frame, &masks, &images);
        assert!(all.iter().all(|v| *v == DVec3::ZERO), "{bad}");
    }
}

#[test]
fn what_cannot_be_is_refused() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let wired = Wired::new(gpu, Channels::One);
    let depth = MultiResReconstructor::new(device, Channels::One, Format::Depth32Float);
    assert!(matches!(depth, Err(Error::Format { .. })), "{depth:?}");
    let camera = camera(
        right::perspective_infinite_reverse(1.0, 1.4, 0.1),
        Viewport::full(16, 8),
    );
    let frame = scene(gpu, &camera);
    let settings = MultiResMaskSettings::OCCLUSION;
    let masks = record(gpu, wired.mask, &frame.input(), &settings);
    let images = |width, settings: &MultiResMaskSettings| {
        wired
            .blend
            .create_images(device, width, 8, settings)
            .expect("images")
    };
    let good = images(16, &settings);
    let target = gpu.target(Format::Rgba32Float, 16, 8);
    let other_format = gpu.target(Format::R32Float, 16, 8);
    let small = gpu.target(Format::Rgba32Float, 15, 8);
    let fresh = wired
        .mask
        .create_view(device, 16, 8, false)
        .expect("a view");
    let fewer = images(16, &MultiResMaskSettings::INDIRECT);
    let narrow = images(15, &settings);
    let colored = MultiResReconstructor::new(device, Channels::Three, Format::Rgba32Float)
        .expect("a pipeline")
        .create_images(device, 16, 8, &settings)
        .expect("images");
    let record = |masks, images, target, settings: &MultiResReconstructorSettings| {
        let input = MultiResReconstructorInput {
            gbuffer: frame.gbuffer(),
            camera: &camera,
            masks,
            images,
            target,
            timestamps: None,
        };
        wired
            .blend
            .record(device, &mut gpu.encoder(), &input, settings)
    };
    let plain = MultiResReconstructorSettings::default();
    assert_eq!(
        record(&masks, &good, target.texture().into(), &plain),
        Ok(())
    );
    for (name, refused) in [
        (
            "MultiResView",
            record(&fresh, &good, target.texture().into(), &plain),
        ),
        (
            "SubImages",
            record(&masks, &fewer, target.texture().into(), &plain),
        ),
        (
            "SubImages",
            record(&masks, &narrow, target.texture().into(), &plain),
        ),
        (
            "SubImages",
            record(&masks, &colored, target.texture().into(), &plain),
        ),
        (
            "MultiResReconstructorInput::target",
            record(&masks, &good, other_format.texture().into(), &plain),
        ),
    ] {
        assert!(
            matches!(&refused, Err(Error::Mismatch { name: n, .. }) if *n == name),
            "{name}: {refused:?}"
        );
    }
    let refused = record(&masks, &good, small.texture().into(), &plain);
    assert!(matches!(refused, Err(Error::Size { .. })), "{refused:?}");
    for bad in [
        MultiResReconstructorSettings {
            plane_distance: 0.0,
            ..plain
        },
        MultiResReconstructorSettings {
            normal_power: 7.0,
            ..plain
        },
    ] {
        let refused = record(&masks, &good, target.texture().into(), &bad);
        assert!(matches!(refused, Err(Error::Setting { .. })), "{refused:?}");
    }
}

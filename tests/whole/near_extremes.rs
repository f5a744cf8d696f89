//! The passes that work from the G-buffer alone at the extremes: any scale, place and projection gives the same picture, and
//! no garbage gives a value that is not a number.

use std::sync::LazyLock;

use deep_screen_space::{
    Camera, Components, DiskSamples, Gatherer, Light, MultiResMask, MultiResMaskSettings,
    ObscuranceInput, ObscuranceSampling, ObscuranceSettings, ObscuranceVolume, ScreenSpaceGi,
    ScreenSpaceGiInput, ScreenSpaceGiSettings, SgHull, SgHullDescriptor, SgHullInput,
    SgHullSettings, SgHullSize, ShadowMap, SoftShadows, SoftShadowsInput, SoftShadowsSettings,
    Viewport, VolumetricObscurance, VolumetricObscuranceDescriptor,
    glam::{DMat4, DVec3, dcamera::rh::proj::directx as right},
    wgpu::{self, TextureFormat as Format},
};
use support::gpu::Gpu;
use support::testing::frames::Decoded;
use support::testing::multi_res::{Frame, framed, random, read_image, read_mask, record};
use support::testing::pipelines;

const MAP: u32 = 64;

/// The pipelines.
struct Passes {
    gpu: &'static Gpu,
    obscurance: VolumetricObscurance,
    shadows: &'static SoftShadows,
    light: &'static ScreenSpaceGi,
    mask: &'static MultiResMask,
    gatherer: Gatherer,
    hull: SgHull,
}

/// A picture a pass, three channels each.
type Pictures = Vec<(&'static str, Vec<DVec3>)>;

/// What is seen, how large it is and where.
struct World {
    frame: Frame,
    scale: f64,
    map: wgpu::TextureView,
    map_camera: Camera,
    light: Light,
}

static PASSES: LazyLock<Passes> = LazyLock::new(Passes::new);

impl Passes {
    fn new() -> Self {
        let gpu = pipelines::gpu();
        let device = &gpu.device;
        let descriptor = VolumetricObscuranceDescriptor {
            sampling: ObscuranceSampling::Lines(DiskSamples::Nine),
            volume: ObscuranceVolume::Hemisphere,
        };
        let gatherer = Gatherer::lights(device);
        let hull = SgHullDescriptor {
            gatherer: &gatherer,
            target: Format::Rgba32Float,
            albedo: false,
            glossy: false,
            components: Components::default(),
        };
        Self {
            obscurance: VolumetricObscurance::new(device, &descriptor).expect("pipelines"),
            shadows: pipelines::soft_shadows(),
            light: pipelines::screen_space_gi(),
            mask: pipelines::multi_res_mask(),
            hull: SgHull::new(device, &hull).expect("pipelines"),
            gatherer,
            gpu,
        }
    }

    /// All pictures of a world, for lengths that are `scale` times 1; `lit` is what each pixel sends.
    fn render(&self, world: &World, lit: impl Fn(u32) -> [f32; 4]) -> Pictures {
        let Self { gpu, .. } = self;
        let device = &gpu.device;
        let World { frame, scale, .. } = world;
        let camera = &frame.camera;
        let gbuffer = frame.gbuffer();
        let [width, height] = frame.size();
        let length = *scale as f32;
        let mut encoder = gpu.encoder();

        let open = gpu.storage(Format::R32Float, width, height);
        let input = ObscuranceInput {
            depth: gbuffer.depth,
            normals: Some(gbuffer.normals()),
            camera,
            moments: None,
            work: None,
            target: open.texture().into(),
            timestamps: None,
        };
        let settings = ObscuranceSettings {
            radius: length,
            ..ObscuranceSettings::default()
        };
        self.obscurance
            .record(device, &mut encoder, &input, &settings)
            .expect("obscurance");

        let visible = gpu.storage(Format::R32Float, width, height);
        let input = SoftShadowsInput {
            gbuffer,
            camera,
            light: &world.light,
            map: ShadowMap::new(world.map.texture(), std::slice::from_ref(&world.map_camera)),
            work: None,
            target: visible.texture().into(),
            timestamps: None,
        };
        let settings = SoftShadowsSettings {
            extent: 0.2 * length,
            max_penumbra: 0.3 * length,
            ..SoftShadowsSettings::default()
        };
        self.shadows
            .record(device, &mut encoder, &input, &settings)
            .expect("shadows");

        let indirect = gpu.storage(Format::Rgba16Float, width, height);
        let texels: Vec<[f32; 4]> = (0..width * height).map(lit).collect();
        let lit = framed(gpu, camera, Format::Rgba32Float, &texels, [f32::NAN; 4]);
        let input = ScreenSpaceGiInput {
            gbuffer,
            camera,
            lit: lit.texture().into(),
            work: None,
            target: indirect.texture().into(),
            timestamps: None,
        };
        let settings = ScreenSpaceGiSettings {
            radius: 1.5 * length,
            ..ScreenSpaceGiSettings::default()
        };
        self.light
            .record(device, &mut encoder, &input, &settings)
            .expect("light");

        let gathered = gpu.target(Format::Rgba32Float, width, height);
        let lights = self
            .gatherer
            .bind_lights(device, &[world.light], camera.eye())
            .expect("lights");
        let view = self
            .hull
            .create_view(device, SgHullSize::new(width, height))
            .expect("a view");
        let mut decoded = Decoded::of(camera);
        let decoded = decoded.frame(&mut encoder, gbuffer, camera, camera.eye());
        let input = SgHullInput::new(&decoded, Some(&lights), gathered.texture());
        self.hull
            .record(
                device,
                &mut encoder,
                &input,
                &SgHullSettings::default(),
                &view,
            )
            .expect("light");
        gpu.finish(encoder);

        let masks = record(
            gpu,
            self.mask,
            &frame.input(),
            &MultiResMaskSettings::OCCLUSION,
        );
        let mask = read_mask(gpu, &masks, 0);
        vec![
            ("obscurance", read_image(gpu, &open)),
            ("shadows", read_image(gpu, &visible)),
            ("light", read_image(gpu, &indirect)),
            (
                "hull",
                gpu.read_texture::<[f32; 4]>(gathered.texture(), 0)
                    .iter()
                    .map(|&[r, g, b, _]| DVec3::new(r.into(), g.into(), b.into()))
                    .collect(),
            ),
            (
                "mask",
                mask.into_iter().map(|m| DVec3::splat(m.into())).collect(),
            ),
        ]
    }
}

/// A floor, a wall and a ball, in a room of 1.
fn see(from: DVec3, along: DVec3) -> Option<(DVec3, DVec3)> {
    let plane = |point: DVec3, normal: DVec3| {
        let t = (point - from).dot(normal) / along.dot(normal);
        (t > 0.0 && t < 100.0).then_some((t, normal))
    };
    let center = DVec3::new(0.2, -0.4, -4.0);
    let ball = {
        let (b, c) = (
            (from - center).dot(along),
            (from - center).length_squared() - 0.36,
        );
        let root = b * b - c;
        let t = -b - root.max(0.0).sqrt();
        (root > 0.0 && t > 0.0).then(|| (t, (from + t * along - center) / 0.6))
    };
    [
        plane(DVec3::new(0.0, -1.0, 0.0), DVec3::Y),
        plane(DVec3::new(0.0, 0.0, -6.0), DVec3::Z),
        ball,
    ]
    .into_iter()
    .flatten()
    .min_by(|a, b| a.0.total_cmp(&b.0))
    .map(|(t, normal)| (from + t * along, normal))
}

/// The room, so many times as large, with its origin at `place`.
fn world(gpu: &Gpu, projection: DMat4, size: [u32; 2], scale: f64, place: DVec3) -> World {
    let [width, height] = size;
    let looking = |from: DVec3, to: DVec3, up: DVec3, projection: DMat4, viewport: Viewport| {
        Camera::look_at(
            place + scale * from,
            place + scale * to,
            up,
            projection,
            viewport,
        )
        .expect("a camera")
    };
    // What a camera sees, relative to its eye.
    let cast = |camera: &Camera, eye: DVec3| {
        Frame::cast(gpu, camera, Format::R32Float, |_, from, along| {
            see(eye + from / scale, along).map(|(point, normal)| (scale * (point - eye), normal))
        })
    };
    let camera = looking(
        DVec3::ZERO,
        DVec3::NEG_Z,
        DVec3::Y,
        projection,
        Viewport::full(width, height),
    );
    let lamp = DVec3::new(1.5, 2.0, -2.5);
    let map_camera = looking(
        lamp,
        DVec3::new(0.0, -0.8, -4.0),
        DVec3::X,
        right::perspective_infinite_reverse(1.6, 1.0, 0.1 * scale),
        Viewport::full(MAP, MAP),
    );
    let map = cast(&map_camera, lamp).depth_view;
    World {
        frame: cast(&camera, DVec3::ZERO),
        scale,
        map,
        map_camera,
        light: Light::Point {
            position: place + scale * lamp,
            intensity: [(20.0 * scale * scale) as f32; 3],
        },
    }
}

fn stripes(i: u32) -> [f32; 4] {
    let on = f32::from(u8::from((i / 5).is_multiple_of(2)));
    [on, 1.0 - on, 0.5, 1.0]
}

/// Of two pictures, the pixels that are farther apart than rounding brings them.
fn off(a: &[DVec3], b: &[DVec3]) -> usize {
    a.iter()
        .zip(b)
        .filter(|(a, b)| a.distance(**b) > 2e-3 * (1.0 + a.length()))
        .count()
}

#[test]
fn scale_and_place_change_nothing() {
    let passes = &*PASSES;
    let size = [64, 48];
    let projection = |scale: f64| right::perspective_infinite_reverse(1.0, 4.0 / 3.0, 0.1 * scale);
    let pictures = |scale: f64, place: DVec3| {
        let world = world(passes.gpu, projection(scale), size, scale, place);
        passes.render(&world, stripes)
    };
    let standard = pictures(1.0, DVec3::ZERO);
    for (name, image) in &standard {
        let lit = image.iter().filter(|v| v.x > 0.0).count();
        assert!(
            lit * 50 > image.len(),
            "{name} is black: {lit} pixels are not"
        );
    }
    let far = DVec3::new(1e5, -1e5, 1e5);
    for (scale, place) in [
        (1e-4, DVec3::ZERO),
        (1e5, DVec3::ZERO),
        (1.0, far),
        (0.01, far),
    ] {
        for ((name, expected), (_, found)) in standard.iter().zip(pictures(scale, place)) {
            let off = off(expected, &found);
            println!(
                "{name} at {scale} and {place}: {off} of {} are off",
                found.len()
            );
            // None are, here. What is at a threshold (the edge of a shadow, a sample at a step of depth) rounding may put on
            // either side.
            assert!(off * 500 <= found.len(), "{name}, {scale}, {place}: {off}");
        }
    }
}

#[test]
fn projections_agree() {
    let passes = &*PASSES;
    let pictures = |projection: DMat4| {
        let world = world(passes.gpu, projection, [64, 48], 1.0, DVec3::ZERO);
        passes.render(&world, stripes)
    };
    let aspect = 4.0 / 3.0;
    let standard = pictures(right::perspective_infinite_reverse(1.0, aspect, 0.1));
    for (projection_name, projection) in [
        ("reversed", right::perspective(1.0, aspect, 100.0, 0.1)),
        ("forward", right::perspective(1.0, aspect, 0.1, 100.0)),
        ("1e-3 to 1e6", right::perspective(1.0, aspect, 1e6, 1e-3)),
    ] {
        for ((name, expected), (_, found)) in standard.iter().zip(pictures(projection)) {
            let off = off(expected, &found);
            println!(
                "{name}, {projection_name}: {off} of {} are off",
                found.len()
            );
            assert!(off * 500 <= found.len(), "{name}, {projection_name}: {off}");
        }
    }
}

/// Any bits in any texture, of any size.
#[test]
fn garbage_gives_numbers() {
    let passes = &*PASSES;
    let gpu = &passes.gpu;
    let odd = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        0.0,
        1e-40,
        -1.0,
        0.5,
        2.0,
        1e30,
        -1e30,
    ];
    let pick = |i: u32, k: u32| odd[(random(i, k) * odd.len() as f64) as usize];
    for size in [[1, 1], [1, 9], [13, 17], [64, 3]] {
        for (projection_name, projection) in [
            (
                "perspective",
                right::perspective_infinite_reverse(1.0, 1.0, 0.1),
            ),
            (
                "orthographic",
                right::orthographic(-2.0, 2.0, -2.0, 2.0, 0.1, 100.0),
            ),
        ] {
            let count = size[0] * size[1];
            let garbage = |k: u32| -> Vec<f64> { (0..count).map(|i| pick(i, k).into()).collect() };
            let normals: Vec<DVec3> = garbage(1)
                .iter()
                .zip(garbage(2))
                .zip(garbage(3))
                .map(|((&x, y), z)| DVec3::new(x, y, z))
                .collect();
            let mut world = world(gpu, projection, size, 1.0, DVec3::ZERO);
            let camera = world.frame.camera;
            let (sound, whole) = (world.frame.depth.clone(), world.frame.normal.clone());
            let sky = vec![f64::from(camera.background_depth()); count as usize];
            // A pixel in four is garbage.
            let is_sound = |i: usize| random(i as u32, 9) > 0.25;
            let some = |all: Vec<f64>| -> Vec<f64> {
                let pixels = (0..).zip(all.iter().zip(&sound));
                pixels
                    .map(|(i, (bad, good))| *if is_sound(i) { good } else { bad })
                    .collect()
            };
            let some_normals: Vec<DVec3> = (0..)
                .zip(normals.iter().zip(&whole))
                .map(|(i, (bad, good))| *if is_sound(i) { good } else { bad })
                .collect();
            for (what, depth, normals) in [
                ("garbage", garbage(0), &normals),
                ("garbage in part", some(garbage(0)), &some_normals),
                ("normals", sound.clone(), &normals),
                ("sky", sky, &normals),
            ] {
                world.frame = Frame::new(gpu, &camera, Format::R32Float, depth, normals);
                let texels: Vec<f32> = (0..MAP * MAP).map(|i| pick(i, 4)).collect();
                let map = framed(gpu, &world.map_camera, Format::R32Float, &texels, 0.0);
                world.map = map;
                let lit = |i: u32| [5, 6, 7, 8].map(|k| pick(i, k));
                for (name, image) in passes.render(&world, lit) {
                    let bad = image
                        .iter()
                        .position(|v| !v.is_finite() || v.min_element() < 0.0);
                    assert!(
                        bad.is_none(),
                        "{name} of {what}, {size:?}, {projection_name}: {:?} at {bad:?}",
                        image[bad.unwrap_or(0)]
                    );
                    let shares = ["obscurance", "shadows", "mask"].contains(&name);
                    assert!(
                        !shares || image.iter().all(|v| v.x <= 1.0),
                        "{name} of {what}, {size:?}, {projection_name}"
                    );
                }
            }
        }
    }
}

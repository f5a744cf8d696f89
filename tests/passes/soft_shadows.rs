//! Soft shadows: GPU against the f64 mirror, closed forms, and what must hold of any map.

use deep_screen_space::{
    Camera, Error, Light, PixelList, ShadowMap, SoftShadows, SoftShadowsInput, SoftShadowsSettings,
    Viewport,
    glam::{DMat4, DVec3, dcamera::rh::proj::directx as right},
    reference::{
        gbuffer, shell_splatter::Receiver, soft_shadows as mirror, surfel_shader, trace::Tracer,
    },
    scenes::{self, Scene},
    wgpu::{self, TextureFormat as Format},
};
use support::gpu::Gpu;
use support::testing::multi_res::{Frame, camera, check_work};
use support::testing::pipelines;

/// A shadow map by rays: a layer a camera, all of one size.
struct Map {
    texture: wgpu::Texture,
    cameras: Vec<Camera>,
    layers: Vec<Vec<f32>>,
    side: u32,
}

impl Map {
    fn new(gpu: &Gpu, cameras: Vec<Camera>, layers: Vec<Vec<f32>>) -> Self {
        let side = cameras[0].viewport().width;
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d {
                width: side,
                height: side,
                depth_or_array_layers: cameras.len() as u32,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: Format::R32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        for (layer, texels) in (0..).zip(&layers) {
            gpu.queue.write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture: &texture,
                    mip_level: 0,
                    origin: wgpu::Origin3d {
                        x: 0,
                        y: 0,
                        z: layer,
                    },
                    aspect: wgpu::TextureAspect::All,
                },
                bytemuck::cast_slice(texels),
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(4 * side),
                    rows_per_image: None,
                },
                wgpu::Extent3d {
                    width: side,
                    height: side,
                    depth_or_array_layers: 1,
                },
            );
        }
        Self {
            texture,
            cameras,
            layers,
            side,
        }
    }

    fn of_scene(gpu: &Gpu, scene: &Scene, cameras: Vec<Camera>) -> Self {
        let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a scene");
        let layers = cameras
            .iter()
            .map(|camera| {
                gbuffer::cast(
                    camera,
                    &tracer,
                    &scene.positions,
                    &scene.normals,
                    &scene.indices,
                )
                .iter()
                .map(|p| p.map_or(camera.background_depth(), |p| p.depth as f32))
                .collect()
            })
            .collect();
        Self::new(gpu, cameras, layers)
    }

    fn map(&self) -> ShadowMap<'_> {
        ShadowMap::new(&self.texture, &self.cameras)
    }

    fn mirror<'a>(
        &'a self,
        light: &'a Light,
        settings: &'a SoftShadowsSettings,
    ) -> mirror::SoftShadows<'a> {
        mirror::SoftShadows {
            light,
            map: surfel_shader::ShadowMap {
                depth: &self.layers,
                width: self.side,
                cameras: &self.cameras,
                bias: 1.0,
                depth_step: 0.0,
            },
            settings,
        }
    }
}

fn point(position: DVec3) -> Light {
    Light::Point {
        position,
        intensity: [1.0; 3],
    }
}

fn looking(eye: DVec3, along: DVec3, projection: DMat4, side: u32) -> Camera {
    let up = if along.x.abs() < 0.5 {
        DVec3::X
    } else {
        DVec3::Y
    };
    Camera::look_at(eye, eye + along, up, projection, Viewport::full(side, side)).expect("a camera")
}

fn record(
    gpu: &Gpu,
    pass: &SoftShadows,
    frame: &Frame,
    (light, map): (&Light, &Map),
    settings: &SoftShadowsSettings,
) -> Vec<f32> {
    let [width, height] = frame.size();
    let target = gpu.storage(Format::R32Float, width, height);
    let mut encoder = gpu.encoder();
    let input = input(frame, light, map, None, &target);
    pass.record(&gpu.device, &mut encoder, &input, settings)
        .expect("shadows");
    gpu.finish(encoder);
    gpu.read_texture(target.texture(), 0)
}

fn input<'a>(
    frame: &'a Frame,
    light: &'a Light,
    map: &'a Map,
    work: Option<PixelList<'a>>,
    target: &'a wgpu::TextureView,
) -> SoftShadowsInput<'a> {
    SoftShadowsInput {
        gbuffer: frame.gbuffer(),
        camera: &frame.camera,
        light,
        map: map.map(),
        work,
        target: target.texture().into(),
        timestamps: None,
    }
}

/// The lights of the comparison: one of each kind, with their maps.
fn lights(gpu: &Gpu, scene: &Scene, eye: DVec3) -> Vec<(&'static str, Light, Map)> {
    let reversed = right::perspective_infinite_reverse(1.571, 1.0, 0.02);
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let cube = axes
        .into_iter()
        .flat_map(|a| [a, -a])
        .map(|a| looking(eye, a, reversed, 96))
        .collect();
    let sun = DVec3::new(-0.3, -1.0, -0.4).normalize();
    vec![
        ("point", point(eye), Map::of_scene(gpu, scene, cube)),
        (
            "spot",
            Light::Spot {
                position: eye,
                direction: -DVec3::Y,
                intensity: [1.0; 3],
                inner: 0.3,
                outer: 0.9,
            },
            Map::of_scene(
                gpu,
                scene,
                vec![looking(
                    eye,
                    -DVec3::Y,
                    right::perspective(2.0, 1.0, 0.05, 50.0),
                    128,
                )],
            ),
        ),
        (
            "sun",
            Light::Directional {
                direction: sun,
                irradiance: [1.0; 3],
            },
            Map::of_scene(
                gpu,
                scene,
                vec![looking(
                    -10.0 * sun,
                    sun,
                    right::orthographic(-3.0, 3.0, -3.0, 3.0, 0.1, 30.0),
                    128,
                )],
            ),
        ),
    ]
}

/// Lights of all kinds over the crate's own scenes. Every look-up may fall on another texel by rounding, which changes a
/// blocker's distance or one of the samples; of the pixels 1 % may differ by more than two samples.
#[test]
fn gpu_is_its_mirror() {
    let gpu = pipelines::gpu();
    let pass = pipelines::soft_shadows();
    for (name, eye) in [
        ("cornell", DVec3::new(0.3, 1.6, 0.2)),
        ("dominoes", DVec3::new(0.4, 2.0, 0.6)),
    ] {
        let scene = scenes::by_name(name).expect("a scene");
        let frame = Frame::of_scene(gpu, &scene, [64, 48]);
        let world: Vec<Option<Receiver>> = frame
            .receivers()
            .into_iter()
            .map(|r| {
                r.map(|r| Receiver {
                    position: r.position + frame.camera.eye(),
                    ..r
                })
            })
            .collect();
        for (kind, light, map) in lights(gpu, &scene, eye) {
            for settings in [
                SoftShadowsSettings::default(),
                SoftShadowsSettings {
                    extent: 0.3,
                    turn: true,
                    blockers: 16,
                    samples: 24,
                    ..SoftShadowsSettings::default()
                },
                SoftShadowsSettings::hard(),
            ] {
                let found = record(gpu, pass, &frame, (&light, &map), &settings);
                let mirror = map.mirror(&light, &settings);
                let mut differ = 0;
                let mut between = 0;
                for (i, (&found, &receiver)) in (0..).zip(found.iter().zip(&world)) {
                    let expected = mirror.visibility(receiver, [i % 64, i / 64]);
                    let off = (f64::from(found) - expected).abs();
                    differ += usize::from(off > 2.01 / f64::from(settings.samples));
                    between += usize::from(found > 0.0 && found < 1.0);
                    assert!((0.0..=1.0).contains(&found), "{name}, {kind}: {found}");
                }
                println!(
                    "{name}, {kind}, extent {}: {differ} differ, {between} in penumbrae",
                    settings.extent
                );
                assert!(
                    differ <= world.len() / 100,
                    "{name}, {kind}: {differ} differ"
                );
                assert_eq!(
                    between > 0,
                    settings.extent > 0.0,
                    "{name}, {kind}: {between}"
                );
            }
        }
    }
}

/// A floor at y = −1 seen from above, and a half plane over it, x < 0 at y = −0.5, that only the map knows. The light is
/// at y = 1: it casts the edge's shadow on the floor at x = 0, with a penumbra of half width `extent · gap / (distance − gap)`.
#[test]
fn an_edge_has_the_penumbra_of_similar_triangles() {
    let gpu = pipelines::gpu();
    let pass = pipelines::soft_shadows();
    let eye = DVec3::new(0.0, 1.0, 0.0);
    let side = 512;
    let light_camera = looking(
        eye,
        -DVec3::Y,
        right::perspective_infinite_reverse(1.0, 1.0, 0.1),
        side,
    );
    let layer = (0..side * side)
        .map(|i| {
            let ray = light_camera
                .unproject(f64::from(i % side) + 0.5, f64::from(i / side) + 0.5, 0.5)
                .expect("a ray");
            let at = |height: f64| ray * (height / ray.y);
            let blocker = at(-1.5);
            let seen = if blocker.x < 0.0 { blocker } else { at(-2.0) };
            light_camera.project(seen).expect("below").z as f32
        })
        .collect();
    let map = Map::new(gpu, vec![light_camera], vec![layer]);
    let light = point(eye);
    let camera = Camera::look_at(
        DVec3::new(0.0, 0.0, 0.0),
        -DVec3::Y,
        -DVec3::Z,
        right::orthographic(-0.5, 0.5, -0.05, 0.05, 0.1, 10.0),
        Viewport::full(200, 4),
    )
    .expect("a camera");
    let frame = Frame::cast(gpu, &camera, Format::R32Float, |_, from, along| {
        let t = (-1.0 - from.y) / along.y;
        Some((from + t * along, DVec3::Y))
    });
    for extent in [0.1_f32, 0.3] {
        let settings = SoftShadowsSettings {
            extent,
            max_penumbra: 0.2,
            blockers: 64,
            samples: 256,
            turn: false,
        };
        let found = record(gpu, pass, &frame, (&light, &map), &settings);
        let half_width = f64::from(extent) * 0.5 / 1.5;
        for (i, &v) in found[..200].iter().enumerate() {
            let x = (i as f64 + 0.5) / 200.0 - 0.5;
            // The share of a disk on one side of a line.
            let t = (x / half_width).clamp(-1.0, 1.0);
            let expected = 1.0 - (t.acos() - t * (1.0 - t * t).sqrt()) / std::f64::consts::PI;
            // A texel of the map is 0.004 here, of a penumbra of 0.033 and more on either side; and where the last
            // of the searched points are beyond the edge no blocker is found.
            assert!(
                (f64::from(v) - expected).abs() < 0.09,
                "extent {extent}, x {x}: {v}, {expected}"
            );
        }
        assert!(found[0] == 0.0 && found[199] == 1.0, "extent {extent}");
    }
}

/// An open plane does not shadow itself: at any angle to the light, of any extent.
#[test]
fn planes_do_not_shadow_themselves() {
    let gpu = pipelines::gpu();
    let pass = pipelines::soft_shadows();
    let view = camera(
        right::perspective_infinite_reverse(1.0, 1.0, 0.1),
        Viewport::full(48, 48),
    );
    for slope in [0.0, 1.0, 3.0, 8.0] {
        let normal = DVec3::new(0.0, slope, 1.0).normalize();
        let see = |from: DVec3, along: DVec3| {
            let t = (DVec3::new(0.0, 0.0, -3.0) - from).dot(normal) / along.dot(normal);
            (t > 0.0).then(|| from + t * along)
        };
        let frame = Frame::cast(gpu, &view, Format::R32Float, |_, from, along| {
            see(from, along).map(|p| (p, normal))
        });
        let eye = DVec3::new(0.5, 0.2, 0.3);
        let light_camera = looking(
            eye,
            -DVec3::Z,
            right::perspective_infinite_reverse(2.4, 1.0, 0.05),
            128,
        );
        let layer = (0..128 * 128)
            .map(|i| {
                let ray = light_camera
                    .unproject(f64::from(i % 128) + 0.5, f64::from(i / 128) + 0.5, 0.5)
                    .expect("a ray");
                see(eye, ray).map_or(0.0, |p| {
                    light_camera.project(p - eye).map_or(0.0, |p| p.z as f32)
                })
            })
            .collect();
        let map = Map::new(gpu, vec![light_camera], vec![layer]);
        for extent in [0.0, 0.1, 1.0] {
            let settings = SoftShadowsSettings {
                extent,
                max_penumbra: 0.5,
                ..SoftShadowsSettings::default()
            };
            let found = record(gpu, pass, &frame, (&point(eye), &map), &settings);
            let shadowed = found
                .iter()
                .zip(&frame.depth)
                .filter(|(v, d)| **d > 0.0 && **v < 1.0);
            assert_eq!(shadowed.count(), 0, "slope {slope}, extent {extent}");
        }
    }
}

/// Where a floor and a wall meet, texels that hold the one do not shadow the other.
#[test]
fn inner_edges_are_not_shadowed() {
    let gpu = pipelines::gpu();
    let pass = pipelines::soft_shadows();
    let view = camera(
        right::perspective_infinite_reverse(1.0, 1.0, 0.1),
        Viewport::full(64, 64),
    );
    let planes = [
        (DVec3::new(0.0, -1.0, 0.0), DVec3::Y),
        (
            DVec3::new(0.0, 0.0, -3.0),
            DVec3::new(0.3, 0.0, 1.0).normalize(),
        ),
    ];
    let see = |from: DVec3, along: DVec3| {
        planes
            .iter()
            .map(|(p, n)| ((*p - from).dot(*n) / along.dot(*n), *n))
            .filter(|(t, _)| *t > 0.0)
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(t, n)| (from + t * along, n))
    };
    let frame = Frame::cast(gpu, &view, Format::R32Float, |_, from, along| {
        see(from, along)
    });
    let eye = DVec3::new(0.5, 0.2, -1.0);
    let light_camera = looking(
        eye,
        -DVec3::Z,
        right::perspective_infinite_reverse(2.4, 1.0, 0.05),
        128,
    );
    let layer = (0..128 * 128)
        .map(|i| {
            let ray = light_camera
                .unproject(f64::from(i % 128) + 0.5, f64::from(i / 128) + 0.5, 0.5)
                .expect("a ray");
            see(eye, ray).map_or(0.0, |(p, _)| {
                light_camera.project(p - eye).map_or(0.0, |p| p.z as f32)
            })
        })
        .collect();
    let map = Map::new(gpu, vec![light_camera], vec![layer]);
    for extent in [0.0, 0.1] {
        let settings = SoftShadowsSettings {
            extent,
            ..SoftShadowsSettings::default()
        };
        let found = record(gpu, pass, &frame, (&point(eye), &map), &settings);
        let shadowed = found
            .iter()
            .zip(&frame.depth)
            .filter(|(v, d)| **d > 0.0 && **v < 1.0);
        // The edge is 64 pixels long.
        let shadowed = shadowed.count();
        println!("extent {extent}: {shadowed}");
        assert!(shadowed <= 1, "extent {extent}: {shadowed}");
    }
}

#[test]
fn lists_compute_what_the_whole_image_has() {
    let gpu = pipelines::gpu();
    let pass = pipelines::soft_shadows();
    let scene = scenes::cornell();
    let frame = Frame::of_scene(gpu, &scene, [77, 53]);
    let (_, light, map) = lights(gpu, &scene, DVec3::new(0.3, 1.6, 0.2)).remove(1);
    let settings = SoftShadowsSettings {
        turn: true,
        ..SoftShadowsSettings::default()
    };
    check_work(gpu, &frame, Format::R32Float, |encoder, work, target| {
        pass.record(
            &gpu.device,
            encoder,
            &input(&frame, &light, &map, work, target),
            &settings,
        )
        .expect("shadows");
    });
}

#[test]
fn what_cannot_be_is_refused() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let pass = pipelines::soft_shadows();
    let view = camera(
        right::perspective_infinite_reverse(1.0, 1.0, 0.1),
        Viewport::full(16, 8),
    );
    let frame = Frame::cast(gpu, &view, Format::R32Float, |_, _, _| None);
    let light = point(DVec3::Y);
    let map = Map::new(
        gpu,
        vec![looking(
            DVec3::Y,
            -DVec3::Y,
            right::perspective_infinite_reverse(1.0, 1.0, 0.1),
            8,
        )],
        vec![vec![0.0; 64]],
    );
    let good = SoftShadowsSettings::default();
    for (field, settings) in [
        (
            "extent",
            SoftShadowsSettings {
                extent: -1.0,
                ..good
            },
        ),
        (
            "extent",
            SoftShadowsSettings {
                extent: f32::INFINITY,
                ..good
            },
        ),
        (
            "max_penumbra",
            SoftShadowsSettings {
                max_penumbra: 0.0,
                ..good
            },
        ),
        (
            "max_penumbra",
            SoftShadowsSettings {
                max_penumbra: f32::NAN,
                ..good
            },
        ),
        (
            "blockers",
            SoftShadowsSettings {
                blockers: 0,
                ..good
            },
        ),
        (
            "samples",
            SoftShadowsSettings {
                samples: 1025,
                ..good
            },
        ),
    ] {
        let refused = settings.validate();
        assert!(
            matches!(&refused, Err(Error::Setting { field: f, .. }) if f.ends_with(field)),
            "{field}: {refused:?}"
        );
    }
    let list = gpu.buffer(&[0_u32; 129], wgpu::BufferUsages::STORAGE);
    let dispatch = gpu.buffer(&[0_u32; 3], wgpu::BufferUsages::INDIRECT);
    let work = PixelList {
        level: 0,
        pixels: &list,
        dispatch: &dispatch,
    };
    let refused = |work, format, width| {
        let target = gpu.storage(format, width, 8);
        pass.record(
            device,
            &mut gpu.encoder(),
            &input(&frame, &light, &map, work, &target),
            &good,
        )
    };
    assert_eq!(refused(Some(work), Format::R32Float, 16), Ok(()));
    let other = refused(None, Format::Rgba16Float, 16);
    assert!(matches!(other, Err(Error::Format { .. })), "{other:?}");
    let other = refused(None, Format::R32Float, 15);
    assert!(matches!(other, Err(Error::Size { .. })), "{other:?}");
    let other = refused(Some(PixelList { level: 4, ..work }), Format::R32Float, 16);
    assert!(
        matches!(
            other,
            Err(Error::Setting {
                field: "PixelList::level",
                ..
            })
        ),
        "{other:?}"
    );
    let other = refused(
        Some(PixelList {
            pixels: &dispatch,
            ..work
        }),
        Format::R32Float,
        16,
    );
    assert!(
        matches!(
            other,
            Err(Error::Buffer {
                name: "PixelList::pixels",
                ..
            })
        ),
        "{other:?}"
    );
    let other = refused(
        Some(PixelList {
            dispatch: &list,
            ..work
        }),
        Format::R32Float,
        16,
    );
    assert!(
        matches!(
            other,
            Err(Error::Buffer {
                name: "PixelList::dispatch",
                ..
            })
        ),
        "{other:?}"
    );
}

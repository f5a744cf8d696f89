//! The `SurfelShader`: GPU against the f64 mirror, against closed forms and traced shadows, and at the extremes.

use std::f64::consts::PI;
use support::testing::pipelines;

use deep_screen_space::{
    Camera, CloudCapacity, Error, Geometry, Light, Material, Piece, Placement, Primitives,
    ShadedLight, Shadow, ShadowMap, Surfel, SurfelCloud, SurfelCounts, SurfelRadiance,
    SurfelShader, SurfelShaderInput, SurfelShaderSettings, SurfelSource, Surfelizer,
    SurfelizerInput, SurfelizerSettings, Timestamps, Viewport,
    glam::{DMat4, DVec3},
    reference::{self, packing::unpack_normal, surfel_shader as mirror, trace::Tracer},
    scenes::{self, Part, Scene},
    wgpu,
};
use support::testing::rays;
use support::testing::shot::camera_of;
use support::{gpu::Gpu, raster::perspective, scene::SceneBuffers, shadow};

const ALBEDO: [f32; 3] = [0.2, 0.5, 1.0];

/// A device and the pipelines.
struct Lab {
    gpu: &'static Gpu,
    surfelizer: &'static Surfelizer,
    shader: &'static SurfelShader,
}

/// A cloud, and what it holds.
struct Lit {
    cloud: SurfelCloud,
    origin: DVec3,
    surfels: Vec<mirror::Surfel>,
}

impl Lab {
    fn new() -> Self {
        let gpu = pipelines::gpu();
        Self {
            surfelizer: pipelines::surfelizer(),
            shader: pipelines::surfel_shader(),
            gpu,
        }
    }

    fn empty_cloud(&self) -> SurfelCloud {
        let capacity = CloudCapacity {
            surfels: 1 << 15,
            pieces: 1 << 15,
            triangles: 1 << 15,
        };
        self.surfelizer
            .create_cloud(&self.gpu.device, capacity)
            .expect("a cloud")
    }

    fn cloud(&self, scene: &Scene, camera: &Camera, settings: &SurfelizerSettings) -> Lit {
        let mut cloud = self.empty_cloud();
        let buffers = SceneBuffers::new(self.gpu, scene);
        let mut encoder = self.gpu.encoder();
        let input = SurfelizerInput {
            geometry: Geometry {
                meshes: &buffers.meshes(),
            },
            camera,
            cull_by: &[],
            timestamps: None,
        };
        self.surfelizer
            .record(&self.gpu.device, &mut encoder, &input, settings, &mut cloud)
            .expect("surfels");
        self.gpu.finish(encoder);
        let counts: SurfelCounts = self.gpu.read_buffer(cloud.counters())[0];
        let stored = counts.stored as usize;
        let disks: Vec<Surfel> = self.gpu.read_buffer(cloud.surfels());
        let sources: Vec<SurfelSource> = self.gpu.read_buffer(cloud.sources());
        let pieces: Vec<Piece> = self.gpu.read_buffer(cloud.pieces());
        let origin = cloud.origin();
        let world = |p: [f32; 3]| DVec3::from(p.map(f64::from)) + origin;
        let surfels = disks[..stored]
            .iter()
            .zip(&sources)
            .map(|(disk, source)| {
                let piece = pieces[source.piece as usize];
                let piece_corners = reference::surfelizer::Triangle {
                    a: world(piece.a),
                    b: world(piece.b),
                    c: world(piece.c),
                };
                let order = piece.shape & 0xfff;
                mirror::Surfel {
                    position: world(disk.position),
                    normal: unpack_normal(source.normal),
                    material: source.material,
                    leaf: (settings.placement == Placement::Centroid)
                        .then(|| reference::surfelizer::leaf_of(piece_corners, source.leaf, order)),
                }
            })
            .collect();
        Lit {
            cloud,
            origin,
            surfels,
        }
    }

    /// What the surfels of a cloud send.
    fn shade(
        &self,
        lit: &Lit,
        materials: &[Material],
        lights: &[ShadedLight<'_>],
        samples: u32,
    ) -> Vec<SurfelRadiance> {
        let device = &self.gpu.device;
        let materials = self.gpu.buffer(materials, wgpu::BufferUsages::STORAGE);
        let radiance = self
            .shader
            .create_radiance(device, &lit.cloud)
            .expect("room");
        // What was there before must not matter.
        let old = vec![f32::NAN; radiance.size() as usize / 4];
        self.gpu
            .queue
            .write_buffer(&radiance, 0, bytemuck::cast_slice(&old));
        let input = SurfelShaderInput {
            cloud: &lit.cloud,
            materials: &materials,
            lights,
            radiance: &radiance,
            timestamps: None,
        };
        let mut encoder = self.gpu.encoder();
        let settings = SurfelShaderSettings { samples };
        self.shader
            .record(device, &mut encoder, &input, &settings)
            .expect("light");
        self.gpu.finish(encoder);
        let all: Vec<SurfelRadiance> = self.gpu.read_buffer(&radiance);
        let (written, rest) = all.split_at(lit.surfels.len());
        assert!(
            rest.iter()
                .all(|r| r.front[0].is_nan() && r.back[0].is_nan()),
            "written beyond the surfels"
        );
        written.to_vec()
    }
}

fn color(c: [f32; 3]) -> DVec3 {
    DVec3::from(c.map(f64::from))
}

fn material(albedo: [f32; 3], emission: [f32; 3]) -> Material {
    Material {
        albedo,
        emission,
        ..Material::default()
    }
}

fn unshadowed(light: Light) -> ShadedLight<'static> {
    ShadedLight {
        light,
        shadow: Shadow::None,
    }
}

fn point(position: DVec3, intensity: [f32; 3]) -> Light {
    Light::Point {
        position,
        intensity,
    }
}

/// Quadrilaterals of material 0; their corners run counter-clockwise seen from the front.
fn quads(list: &[[DVec3; 4]]) -> Scene {
    let positions: Vec<[f32; 3]> = list
        .iter()
        .flatten()
        .map(|p| p.as_vec3().to_array())
        .collect();
    let indices: Vec<u32> = (0..list.len() as u32)
        .flat_map(|quad| [0, 1, 2, 0, 2, 3].map(|corner| 4 * quad + corner))
        .collect();
    Scene {
        holes: None,
        name: "quads",
        normals: vec![[0.0, 1.0, 0.0]; positions.len()],
        parts: vec![Part {
            first_index: 0,
            index_count: indices.len() as u32,
            material: 0,
        }],
        positions,
        indices,
        materials: Vec::new(),
        views: Vec::new(),
        ao_radius: f32::INFINITY,
    }
}

/// Level squares, each a centre and half a side; fronts look up.
fn squares(list: &[(DVec3, f64)]) -> Scene {
    let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)];
    let quad = |(centre, half): &(DVec3, f64)| {
        corners.map(|(x, z)| *centre + DVec3::new(x, 0.0, z) * *half)
    };
    quads(&list.iter().map(quad).collect::<Vec<_>>())
}

/// The inside of a cube of half the side `half`.
fn room(half: f64) -> Vec<[DVec3; 4]> {
    let wall = |axis: DVec3| {
        let (u, v) = axis.any_orthonormal_pair();
        [-u - v, v - u, u + v, u - v].map(|across| (axis + across) * half)
    };
    let axes = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    axes.map(wall).collect()
}

fn above(height: f64) -> Camera {
    Camera::look_at(
        DVec3::Y * height,
        DVec3::ZERO,
        DVec3::NEG_Z,
        perspective(60.0, 1.0, 0.1),
        Viewport::full(64, 64),
    )
    .expect("a camera")
}

/// How depth is stored.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Convention {
    Forward,
    Reversed,
    InfiniteReversed,
    Orthographic,
    OrthographicReversed,
}

impl Convention {
    /// A projection that sees `half` to all sides at distance `at`, from `near` to `far`.
    fn projection(self, half: f64, at: f64, near: f64, far: f64) -> DMat4 {
        // Depth in terms of the distance z: a + b / z, or a + b z.
        let slope = at / half;
        let flip = |m: DMat4| {
            DMat4::from_cols_array(&[
                1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0, 1.0,
            ]) * m
        };
        let perspective = |a: f64, b: f64| {
            DMat4::from_cols_array(&[
                slope, 0.0, 0.0, 0.0, 0.0, slope, 0.0, 0.0, 0.0, 0.0, -a, -1.0, 0.0, 0.0, b, 0.0,
            ])
        };
        let finite = perspective(far / (far - near), -far * near / (far - near));
        let orthographic = DMat4::from_cols_array(&[
            1.0 / half,
            0.0,
            0.0,
            0.0,
            0.0,
            1.0 / half,
            0.0,
            0.0,
            0.0,
            0.0,
            -1.0 / (far - near),
            0.0,
            0.0,
            0.0,
            -near / (far - near),
            1.0,
        ]);
        match self {
            Self::Forward => finite,
            Self::Reversed => flip(finite),
            Self::InfiniteReversed => perspective(0.0, near),
            Self::Orthographic => orthographic,
            Self::OrthographicReversed => flip(orthographic),
        }
    }
}

/// Six cameras about a point, 90° each.
fn cube(eye: DVec3, texels: u32, near: f64) -> Vec<Camera> {
    let projection = Convention::InfiniteReversed.projection(1.0, 1.0, near, 0.0);
    DVec3::AXES
        .into_iter()
        .flat_map(|axis| [axis, -axis])
        .map(|axis| {
            let up = if axis.y == 0.0 { DVec3::Y } else { DVec3::Z };
            Camera::look_at(
                eye,
                eye + axis,
                up,
                projection,
                Viewport::full(texels, texels),
            )
            .expect("a face")
        })
        .collect()
}

/// A shadow map, and its texels where they can be read.
struct DepthMap {
    texture: wgpu::Texture,
    size: u32,
    depth: Vec<Vec<f32>>,
    step: f64,
}

impl DepthMap {
    /// As an engine would draw it: a layer a camera, both sides of all triangles, no bias.
    fn draw(
        gpu: &Gpu,
        scene: &Scene,
        cameras: &[Camera],
        size: u32,
        format: wgpu::TextureFormat,
    ) -> Self {
        let texture = shadow::draw(gpu, &SceneBuffers::new(gpu, scene), cameras, size, format);
        let layers = 0..cameras.len() as u32;
        let (depth, step) = match format {
            wgpu::TextureFormat::Depth32Float => {
                (layers.map(|l| gpu.read_texture(&texture, l)).collect(), 0.0)
            }
            wgpu::TextureFormat::Depth16Unorm => (
                layers
                    .map(|l| {
                        let texels: Vec<u16> = gpu.read_texture(&texture, l);
                        texels.iter().map(|d| f32::from(*d) / 65535.0).collect()
                    })
                    .collect(),
                1.0 / 65535.0,
            ),
            // Not to be read back.
            _ => (Vec::new(), 0.0),
        };
        Self {
            texture,
            size,
            depth,
            step,
        }
    }

    fn mirror<'a>(&'a self, cameras: &'a [Camera]) -> mirror::ShadowMap<'a> {
        mirror::ShadowMap {
            depth: &self.depth,
            width: self.size,
            cameras,
            bias: 1.0,
            depth_step: self.step,
        }
    }
}

/// How many surfels differ from the mirror by more than 1e-5 of what they would send if they faced all lights: f32 has
/// 1e-7 relative to the distance from the eye, and these scenes' lights are not much nearer.
fn differing(
    lit: &Lit,
    found: &[SurfelRadiance],
    materials: &[Material],
    lights: &[mirror::ShadedLight<'_>],
    samples: u32,
) -> usize {
    let mut worst = 0.0_f64;
    let mut differing = 0;
    for (surfel, found) in lit.surfels.iter().zip(found) {
        let expected = mirror::shade(surfel, materials, lights, samples);
        let facing: f64 = lights
            .iter()
            .map(|l| {
                reference::light::arrival(&l.light, surfel.position)
                    .irradiance
                    .max_element()
            })
            .sum();
        let scale = facing / PI + expected.front.max_element();
        let off = (color(found.front) - expected.front)
            .abs()
            .max((color(found.back) - expected.back).abs())
            .max_element();
        assert!(found.front.iter().chain(&found.back).all(|c| c.is_finite()));
        if off <= 1e-5 * scale {
            worst = worst.max(off / scale);
        } else {
            differing += 1;
        }
    }
    println!(
        "{} surfels, {differing} differ; the others by up to {worst:.1e}",
        lit.surfels.len()
    );
    differing
}

/// All kinds of lights and shadow maps over the crate's own scenes.
#[test]
fn gpu_is_its_mirror() {
    let lab = Lab::new();
    for (name, eye) in [
        ("cornell", DVec3::new(0.3, 1.6, 0.2)),
        ("dominoes", DVec3::new(0.4, 2.0, 0.6)),
    ] {
        let scene = scenes::by_name(name).expect("a scene");
        let camera = camera_of(&scene, 0, [96, 96]);
        let materials = scene.material_table();
        let sun = DVec3::new(-0.3, -1.0, -0.4);
        let sun_cameras = [Camera::look_at(
            -sun * 10.0,
            DVec3::ZERO,
            DVec3::Z,
            Convention::Orthographic.projection(6.0, 0.0, 0.0, 30.0),
            Viewport::full(256, 256),
        )
        .expect("a camera")];
        let spot_cameras = [Camera::look_at(
            eye,
            DVec3::ZERO,
            DVec3::Z,
            Convention::Forward.projection(1.0, 1.0, 0.05, 50.0),
            Viewport {
                x: 40,
                y: 8,
                width: 200,
                height: 200,
            },
        )
        .expect("a camera")];
        let cube_cameras = cube(eye, 128, 0.02);
        let lights = [
            (
                Light::Directional {
                    direction: sun,
                    irradiance: [3.0, 2.5, 2.0],
                },
                &sun_cameras[..],
                256,
                wgpu::TextureFormat::Depth32Float,
            ),
            (
                Light::Spot {
                    position: eye,
                    direction: -eye,
                    intensity: [2.0, 4.0, 6.0],
                    inner: 0.3,
                    outer: 0.7,
                },
                &spot_cameras[..],
                256,
                wgpu::TextureFormat::Depth16Unorm,
            ),
            (
                point(eye, [5.0, 1.0, 0.5]),
                &cube_cameras[..],
                128,
                wgpu::TextureFormat::Depth32Float,
            ),
        ];
        let maps: Vec<DepthMap> = lights
            .iter()
            .map(|(_, cameras, size, format)| {
                DepthMap::draw(lab.gpu, &scene, cameras, *size, *format)
            })
            .collect();
        let shaded: Vec<ShadedLight<'_>> = lights
            .iter()
            .zip(&maps)
            .map(|((light, cameras, ..), map)| ShadedLight {
                light: *light,
                shadow: Shadow::Map(ShadowMap::new(&map.texture, cameras)),
            })
            .collect();
        let expected: Vec<mirror::ShadedLight<'_>> = lights
            .iter()
            .zip(&maps)
            .map(|((light, cameras, ..), map)| mirror::ShadedLight {
                light: *light,
                shadow: Some(map.mirror(cameras)),
            })
            .collect();
        for (placement, samples) in [
            (Placement::Centroid, 1),
            (Placement::Centroid, 8),
            (Placement::Random, 8),
        ] {
            let settings = SurfelizerSettings {
                placement,
                ..SurfelizerSettings::default()
            };
            let lit = lab.cloud(&scene, &camera, &settings);
            let count = lit.surfels.len();
            assert!(count > 1000, "{name}: {count} surfels");
            let found = lab.shade(&lit, &materials, &shaded, samples);
            print!("{name} {placement:?} {samples} samples: ");
            let bad = differing(&lit, &found, &materials, &expected, samples);
            // Look-ups that fall on another texel by rounding: at an edge of the map's texels, of which a share of 1e-4
            // is within rounding, and only where neighbours differ.
            assert!(
                bad <= 2 + count / 1000,
                "{name} {placement:?} {samples}: {bad} of {count}"
            );
            // The shadows are there: without them much would be brighter.
            let plain: Vec<mirror::ShadedLight<'_>> = expected
                .iter()
                .map(|l| mirror::ShadedLight { shadow: None, ..*l })
                .collect();
            print!("  without shadows: ");
            let shadowed = differing(&lit, &found, &materials, &plain, samples);
            assert!(
                shadowed > count / 20,
                "{name}: {shadowed} of {count} have shadows"
            );
        }
    }
}

/// `albedo/π · I cos θ / d²` on the side of the light and nothing on the other, on a plane; lights add.
#[test]
fn plane_has_its_closed_forms() {
    let lab = Lab::new();
    let lit = lab.cloud(
        &squares(&[(DVec3::ZERO, 2.0)]),
        &above(4.0),
        &SurfelizerSettings::default(),
    );
    let grey = [material(ALBEDO, [0.0; 3])];
    for (height, cone) in [
        (1.0_f64, None),
        (0.5, None),
        (-1.0, None),
        (1.5, Some((0.3_f64, 0.6_f64))),
    ] {
        let position = DVec3::new(0.4, height, -0.3);
        let intensity = [3.0, 2.0, 0.5];
        let light = match cone {
            None => point(position, intensity),
            Some((inner, outer)) => Light::Spot {
                position,
                direction: DVec3::NEG_Y * 9.0,
                intensity,
                inner: inner as f32,
                outer: outer as f32,
            },
        };
        let found = lab.shade(&lit, &grey, &[unshadowed(light)], 1);
        for (surfel, found) in lit.surfels.iter().zip(&found) {
            let offset = position - surfel.position;
            let mut expected =
                color(ALBEDO) / PI * color(intensity) * height.abs() / offset.length().powi(3);
            if let Some((inner, outer)) = cone {
                let cosine = height / offset.length();
                let t = ((cosine - outer.cos()) / (inner.cos() - outer.cos())).clamp(0.0, 1.0);
                expected *= t * t * (3.0 - 2.0 * t);
            }
            let (near, far) = if height > 0.0 {
                (found.front, found.back)
            } else {
                (found.back, found.front)
            };
            let off = (color(near) - expected).abs().max_element();
            assert!(
                off <= 1e-5 * (1.0 / height.powi(2)),
                "{light:?} at {}: {near:?}, expected {expected}",
                surfel.position
            );
            assert_eq!(far, [0.0; 3], "{light:?} at {}", surfel.position);
        }
    }
    let sun = |direction| {
        unshadowed(Light::Directional {
            direction,
            irradiance: [4.0, 2.0, 1.0],
        })
    };
    let down = sun(DVec3::new(0.0, -4.0, 3.0));
    let up = sun(DVec3::new(0.0, 3.0, -4.0));
    let expected = |share: f64| color(ALBEDO) / PI * color([4.0, 2.0, 1.0]) * share;
    for found in lab.shade(&lit, &grey, &[down, up, down], 1) {
        let front = (color(found.front) - expected(1.6)).abs().max_element();
        let back = (color(found.back) - expected(0.6)).abs().max_element();
        assert!(front < 1e-5 && back < 1e-5, "{found:?}");
    }
}

/// Emission is a radiosity, of the front alone, and stays exact however bright; so does what is reflected.
#[test]
fn emission_is_that_of_the_front() {
    let lab = Lab::new();
    let lit = lab.cloud(
        &squares(&[(DVec3::ZERO, 1.0)]),
        &above(3.0),
        &SurfelizerSettings::default(),
    );
    let bright = 1e6_f32;
    let emission = [bright * std::f32::consts::PI, 1.0, 0.0];
    let black = Light::Directional {
        direction: DVec3::X,
        irradiance: [0.0; 3],
    };
    let noon = Light::Directional {
        direction: DVec3::NEG_Y,
        irradiance: [bright * std::f32::consts::PI; 3],
    };
    let close = |found: f32, expected: f64| (f64::from(found) / expected - 1.0).abs() < 3e-7;
    for lights in [&[][..], &[unshadowed(black)], &[unshadowed(black); 3]] {
        for found in lab.shade(&lit, &[material([1.0; 3], emission)], lights, 4) {
            assert!(close(found.front[0], 1e6), "{found:?}");
            assert!(close(found.front[1], 1.0 / PI), "{found:?}");
            assert_eq!((found.front[2], found.back), (0.0, [0.0; 3]));
            assert_eq!((found.padding0, found.padding1), (0.0, 0.0));
        }
    }
    // The first light that shines is the one that starts from the emission.
    let lights = [unshadowed(black), unshadowed(noon), unshadowed(noon)];
    for found in lab.shade(&lit, &[material([1.0; 3], emission)], &lights, 1) {
        assert!(close(found.front[0], 3e6), "{found:?}");
        assert!(close(found.front[2], 2e6), "{found:?}");
    }
}

/// Of what is double-sided the back emits what the front does, and reflects besides; any number but 0 says so.
#[test]
fn double_sided_emission_is_that_of_both() {
    let lab = Lab::new();
    let lit = lab.cloud(
        &squares(&[(DVec3::ZERO, 1.0)]),
        &above(3.0),
        &SurfelizerSettings::default(),
    );
    let up = Light::Directional {
        direction: DVec3::Y,
        irradiance: [PI as f32; 3],
    };
    for double_sided in [1, u32::MAX] {
        let lamp = Material {
            double_sided,
            ..material([0.5; 3], [PI as f32, 0.0, 2.0])
        };
        for (lights, reflected) in [(&[][..], 0.0), (&[unshadowed(up)], 0.5)] {
            for found in lab.shade(&lit, &[lamp], lights, 1) {
                let front = DVec3::new(1.0, 0.0, 2.0 / PI);
                let back = front + reflected;
                let off = (color(found.front) - front).abs() + (color(found.back) - back).abs();
                assert!(off.max_element() < 1e-6, "{found:?}");
            }
        }
    }
}

/// A square between a light and the ground: a shadow of known size, whatever the map's depth convention and format, and
/// none of a surface on itself.
#[test]
fn shadow_maps_of_all_conventions() {
    let lab = Lab::new();
    let scene = squares(&[(DVec3::ZERO, 3.0), (DVec3::new(0.2, 2.0, 0.0), 0.5)]);
    let fine = SurfelizerSettings {
        radius_pixels: 0.7,
        ..SurfelizerSettings::default()
    };
    let lit = lab.cloud(&scene, &above(6.0), &fine);
    let grey = [material(ALBEDO, [0.0; 3])];
    let from = DVec3::new(1.0, 4.0, 0.5);
    for convention in [
        Convention::Forward,
        Convention::Reversed,
        Convention::InfiniteReversed,
        Convention::Orthographic,
        Convention::OrthographicReversed,
    ] {
        let parallel = matches!(
            convention,
            Convention::Orthographic | Convention::OrthographicReversed
        );
        for (format, bias) in [
            (wgpu::TextureFormat::Depth32Float, 1.0),
            (wgpu::TextureFormat::Depth24Plus, 1.0),
            (wgpu::TextureFormat::Depth16Unorm, 1.0),
            (wgpu::TextureFormat::Depth32Float, 0.0),
        ] {
            let half = if parallel { 5.0 } else { 4.5 };
            let camera = Camera::look_at(
                from,
                DVec3::ZERO,
                DVec3::Z,
                convention.projection(half, from.length(), 0.5, 20.0),
                Viewport {
                    x: 16,
                    y: 32,
                    width: 200,
                    height: 200,
                },
            )
            .expect("a camera");
            let cameras = [camera];
            let map = DepthMap::draw(lab.gpu, &scene, &cameras, 240, format);
            let light = if parallel {
                Light::Directional {
                    direction: -from,
                    irradiance: [1.0; 3],
                }
            } else {
                point(from, [20.0; 3])
            };
            let shaded = |shadow| ShadedLight { light, shadow };
            let shadow = Shadow::Map(ShadowMap {
                bias,
                ..ShadowMap::new(&map.texture, &cameras)
            });
            let with = lab.shade(&lit, &grey, &[shaded(shadow)], 1);
            let without = lab.shade(&lit, &grey, &[shaded(Shadow::None)], 1);
            let inputs = format!("{convention:?} {format:?} bias {bias}");
            let (mut dark, mut wrong) = (0, 0);
            for ((surfel, with), without) in lit.surfels.iter().zip(&with).zip(&without) {
                // Where the ray to the light passes the blocker's plane, in units of its half side.
                let p = surfel.position;
                let to_light = if parallel { from } else { from - p };
                let crossing =
                    p + to_light * ((2.0 - p.y) / to_light.y) - DVec3::new(0.2, 2.0, 0.0);
                let inside = crossing.x.abs().max(crossing.z.abs()) / 0.5;
                // The edge is known to a texel, and the bias moves it by another: 0.1 of the half side.
                if p.y < 1.0 && (inside - 1.0).abs() < 0.2 {
                    continue;
                }
                let shadowed = p.y < 1.0 && inside < 1.0;
                let expected = if shadowed {
                    SurfelRadiance::default()
                } else {
                    *without
                };
                dark += usize::from(shadowed);
                wrong += usize::from(*with != expected);
            }
            println!(
                "{inputs}: {dark} in shadow, {wrong} wrong of {}",
                with.len()
            );
            assert!(dark > 30, "{inputs}: {dark} in shadow");
            if bias > 0.0 {
                assert_eq!(wrong, 0, "{inputs}");
            } else {
                // What the bias is for: a slanted plane lies partly behind its own texels.
                assert!(wrong > with.len() / 10, "{inputs}: {wrong} wrong");
            }
        }
    }
}

/// A point light's six maps leave no seams: in a cube all surfels are lit, off the middle and turned against the faces
/// too. What no map knows of is lit.
#[test]
fn maps_meet_without_seams() {
    let lab = Lab::new();
    let scene = quads(&room(2.0));
    let lit = lab.cloud(&scene, &above(1.0), &SurfelizerSettings::default());
    let grey = [material(ALBEDO, [0.0; 3])];
    for eye in [DVec3::ZERO, DVec3::new(0.3, -1.2, 0.9)] {
        // Next to the room's edges a texel can hold the depth of the other wall, nearer by any amount where the light
        // grazes that: a strip of less than a texel.
        for (size, accepted) in [(64, 0.005), (256, 0.0)] {
            let cameras = cube(eye, size, 0.01);
            let format = wgpu::TextureFormat::Depth32Float;
            let map = DepthMap::draw(lab.gpu, &scene, &cameras, size, format);
            let by = |shadow| {
                let light = point(eye, [1.0; 3]);
                lab.shade(&lit, &grey, &[ShadedLight { light, shadow }], 4)
            };
            let whole = by(Shadow::None);
            let found = by(Shadow::Map(ShadowMap::new(&map.texture, &cameras)));
            assert!(whole.iter().all(|r| r.front[0] > 0.0), "{eye} {size}");
            let dark = found.iter().zip(&whole).filter(|(a, b)| a != b).count();
            println!("{eye} {size} texels: {dark} of {}", whole.len());
            let accepted = (accepted * whole.len() as f64) as usize;
            assert!(dark <= accepted, "{eye} {size}: {dark}");
        }
    }

    // Nor do they let light out of a closed box: what lies between two maps would count as lit.
    let closed = quads(&[room(2.0), room(0.5)].concat());
    for eye in [DVec3::ZERO, DVec3::new(0.1, -0.3, 0.2)] {
        let cameras = cube(eye, 64, 0.01);
        let format = wgpu::TextureFormat::Depth32Float;
        let map = DepthMap::draw(lab.gpu, &closed, &cameras, 64, format);
        let shaded = ShadedLight {
            light: point(eye, [1.0; 3]),
            shadow: Shadow::Map(ShadowMap::new(&map.texture, &cameras)),
        };
        let found = lab.shade(&lit, &grey, &[shaded], 4);
        let lit = found.iter().filter(|r| r.front != [0.0; 3]).count();
        assert_eq!(lit, 0, "{eye}: {lit} of {}", found.len());
    }

    // A near plane beyond the walls.
    let blind = [Camera::look_at(
        DVec3::ZERO,
        DVec3::X,
        DVec3::Y,
        Convention::Forward.projection(1.0, 1.0, 1e4, 1e5),
        Viewport::full(64, 64),
    )
    .expect("a camera")];
    let format = wgpu::TextureFormat::Depth32Float;
    let map = DepthMap::draw(lab.gpu, &scene, &blind, 64, format);
    let by = |shadow| {
        let light = point(DVec3::ZERO, [1.0; 3]);
        lab.shade(&lit, &grey, &[ShadedLight { light, shadow }], 1)
    };
    let map = Shadow::Map(ShadowMap::new(&map.texture, &blind));
    assert_eq!(by(map), by(Shadow::None));
}

/// Shadow maps against traced shadows, in a room with furniture: what differs lies at the edges of shadows, and becomes
/// less with the size of a texel.
#[test]
fn maps_come_near_traced_shadows() {
    let lab = Lab::new();
    let scene = scenes::closed_room();
    let camera = camera_of(&scene, 0, [64, 64]);
    let materials = scene.material_table();
    let lit = lab.cloud(&scene, &camera, &SurfelizerSettings::default());
    let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a scene");
    let eye = DVec3::from(scene.views[0].eye);
    let light = point(eye, [1.0; 3]);
    for (size, accepted) in [(64, 0.025), (512, 0.005)] {
        let cameras = cube(eye, size, 0.01);
        let format = wgpu::TextureFormat::Depth32Float;
        let map = DepthMap::draw(lab.gpu, &scene, &cameras, size, format);
        let shadow = Shadow::Map(ShadowMap::new(&map.texture, &cameras));
        let found = lab.shade(&lit, &materials, &[ShadedLight { light, shadow }], 1);
        let mut wrong = 0;
        for (surfel, found) in lit.surfels.iter().zip(&found) {
            let material = materials[surfel.material as usize];
            let sides = [
                (surfel.normal, found.front, color(material.emission) / PI),
                (-surfel.normal, found.back, DVec3::ZERO),
            ];
            wrong += usize::from(sides.into_iter().any(|(normal, found, emission)| {
                let direct =
                    tracer.direct(surfel.position, normal, color(material.albedo), &[light]);
                let off = (color(found) - emission - direct).abs().max_element();
                off > 1e-4 * (direct + emission).max_element() + 1e-7
            }));
        }
        println!("{size} texels: {wrong} of {} differ", found.len());
        let accepted = (accepted * found.len() as f64) as usize;
        assert!(wrong <= accepted, "{size}: {wrong} of {}", found.len());
    }
}

/// Shadows by rays are the ray tracer's but for surfels at a shadow's very edge, and for those on a crease, where the ray
/// starts off the surface by some 1e-6 of its distance. Bounds of another cloud are refused.
#[test]
fn traced_shadows_are_the_tracers() {
    let lab = Lab::new();
    let device = &lab.gpu.device;
    for (scene, light) in [
        (
            scenes::cornell(),
            point(DVec3::new(0.6, 4.3, 0.4), [20.0, 18.0, 14.0]),
        ),
        (
            scenes::closed_room(),
            point(DVec3::new(-0.83, 2.1, 0.52), [5.0; 3]),
        ),
        (
            scenes::dominoes(),
            Light::Directional {
                direction: DVec3::new(0.31, -1.0, 0.17),
                irradiance: [3.0, 2.0, 1.0],
            },
        ),
    ] {
        let settings = SurfelizerSettings {
            radius_pixels: 2.0,
            density: f32::INFINITY,
            ..SurfelizerSettings::default()
        };
        let lit = lab.cloud(&scene, &camera_of(&scene, 0, [64, 64]), &settings);
        let bounds = pipelines::bvh_builder(Primitives::Triangles)
            .create(device, &lit.cloud)
            .expect("bounds");
        let mut encoder = lab.gpu.encoder();
        pipelines::bvh_builder(Primitives::Triangles)
            .record(device, &mut encoder, &lit.cloud, &bounds, None)
            .expect("bounds");
        lab.gpu.finish(encoder);
        let materials = scene.material_table();
        let shaded = ShadedLight {
            light,
            shadow: Shadow::Traced(&bounds),
        };
        let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a scene");
        for samples in [1, 4] {
            let found = lab.shade(&lit, &materials, &[shaded], samples);
            let (mut wrong, mut dark) = (0, 0);
            for (surfel, found) in lit.surfels.iter().zip(&found) {
                let material = materials[surfel.material as usize];
                let points: Vec<DVec3> = match surfel.leaf {
                    Some(leaf) if samples > 1 => (0..samples)
                        .map(|k| {
                            let t = reference::surfelizer::leaf_of(leaf, k, samples.ilog2());
                            (t.a + t.b + t.c) / 3.0
                        })
                        .collect(),
                    _ => vec![surfel.position],
                };
                let direct = |normal| {
                    let each =
                        |p: &DVec3| tracer.direct(*p, normal, color(material.albedo), &[light]);
                    points.iter().map(each).sum::<DVec3>() / points.len() as f64
                };
                let front = direct(surfel.normal) + color(material.emission) / PI;
                let back = direct(-surfel.normal);
                dark += usize::from(front == DVec3::ZERO && back == DVec3::ZERO);
                // A packed normal is off by 5e-5, which counts where light grazes.
                wrong += usize::from([(found.front, front), (found.back, back)].into_iter().any(
                    |(found, expected)| {
                        (color(found) - expected).abs().max_element()
                            > 1e-3 * expected.max_element() + 1e-5
                    },
                ));
            }
            let name = format!("{}, {samples} samples", scene.name);
            println!("{name}: {wrong} of {} differ, {dark} are dark", found.len());
            assert!(dark > found.len() / 100, "{name}: {dark} dark");
            assert!(
                wrong <= 1 + found.len() / 200,
                "{name}: {wrong} of {}",
                found.len()
            );
        }
        let small = lab
            .surfelizer
            .create_cloud(
                device,
                CloudCapacity {
                    surfels: 1,
                    pieces: 1,
                    triangles: 1,
                },
            )
            .expect("a cloud");
        let others = pipelines::bvh_builder(Primitives::Triangles)
            .create(device, &small)
            .expect("bounds");
        let table = lab.gpu.buffer(&materials, wgpu::BufferUsages::STORAGE);
        let radiance = lab
            .shader
            .create_radiance(device, &lit.cloud)
            .expect("room");
        let refused = lab.shader.record(
            device,
            &mut lab.gpu.encoder(),
            &SurfelShaderInput {
                cloud: &lit.cloud,
                materials: &table,
                lights: &[ShadedLight {
                    light,
                    shadow: Shadow::Traced(&others),
                }],
                radiance: &radiance,
                timestamps: None,
            },
            &SurfelShaderSettings { samples: 1 },
        );
        assert!(matches!(refused, Err(Error::Mismatch { name: "Bvh", .. })));
    }
}

/// Lamps on and near the surfaces of a hall that hides nothing from them, from near and from far, lose no light to shadows
/// along rays. 1 surfel in 500 may lie beyond a corner by a rounding.
#[test]
fn traced_shadows_of_lamps_on_surfaces_take_nothing() {
    let lab = Lab::new();
    let device = &lab.gpu.device;
    let scene = rays::hall(&scenes::cornell());
    let materials = scene.material_table();
    for (distance, vfov) in [(-2.0, 60.0), (1e3, 0.5), (1e4, 0.05)] {
        let camera = Camera::look_at(
            DVec3::new(0.0, 1.7, 20.0 + distance),
            DVec3::new(0.0, 3.0, 0.0),
            DVec3::Y,
            perspective(vfov, 1.0, f64::max(distance - 10.0, 0.1)),
            Viewport::full(48, 48),
        )
        .expect("a camera");
        let lit = lab.cloud(&scene, &camera, &SurfelizerSettings::default());
        let bounds = pipelines::bvh_builder(Primitives::Triangles)
            .create(device, &lit.cloud)
            .expect("bounds");
        let mut encoder = lab.gpu.encoder();
        pipelines::bvh_builder(Primitives::Triangles)
            .record(device, &mut encoder, &lit.cloud, &bounds, None)
            .expect("bounds");
        lab.gpu.finish(encoder);
        for light in rays::lamps() {
            for samples in [1, 4] {
                let shade =
                    |shadow| lab.shade(&lit, &materials, &[ShadedLight { light, shadow }], samples);
                let all = shade(Shadow::None);
                let found = shade(Shadow::Traced(&bounds));
                let (mut facing, mut dark) = (0, 0);
                for (surfel, (found, all)) in lit.surfels.iter().zip(found.iter().zip(&all)) {
                    let to_light = reference::light::arrival(&light, surfel.position).to_light;
                    // A lamp within some roundings of a surface's plane may be behind it.
                    if surfel.normal.dot(to_light) > 1e-2 && all.front != [0.0; 3] {
                        facing += 1;
                        dark += usize::from(found.front != all.front);
                    }
                }
                assert!(facing > 500, "{distance} {light:?}: {facing} lit");
                assert!(
                    dark <= facing / 500,
                    "{distance} {light:?}, {samples} samples: {dark} of {facing}"
                );
            }
        }
    }
}

/// Several points per surfel average a shadow's edge: the light that a coarse cloud sends comes nearer to the truth, and a
/// share of it is a multiple of 1/n.
#[test]
fn samples_average_edges() {
    let lab = Lab::new();
    let scene = squares(&[(DVec3::ZERO, 2.0), (DVec3::new(0.1, 1.5, 0.05), 0.7)]);
    let settings = SurfelizerSettings {
        radius_pixels: 2.0,
        ..SurfelizerSettings::default()
    };
    let lit = lab.cloud(&scene, &above(5.0), &settings);
    let light = Light::Directional {
        direction: DVec3::new(0.2, -1.0, 0.3),
        irradiance: [PI as f32; 3],
    };
    let cameras = [Camera::look_at(
        DVec3::new(-1.0, 5.0, -1.5),
        DVec3::ZERO,
        DVec3::X,
        Convention::Orthographic.projection(3.0, 0.0, 0.0, 20.0),
        Viewport::full(1024, 1024),
    )
    .expect("a camera")];
    let map = DepthMap::draw(
        lab.gpu,
        &scene,
        &cameras,
        1024,
        wgpu::TextureFormat::Depth32Float,
    );
    let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a scene");
    // The truth of a surfel: the mean over many points of its triangle.
    let truth: Vec<f64> = lit
        .surfels
        .iter()
        .map(|surfel| {
            let leaf = surfel.leaf.expect("a triangle");
            let at = |k| {
                let t = reference::surfelizer::leaf_of(leaf, k, 8);
                let p = (t.a + t.b + t.c) / 3.0;
                tracer.direct(p, surfel.normal, DVec3::ONE, &[light]).x
            };
            (0..256).map(at).sum::<f64>() / 256.0
        })
        .collect();
    let whole = truth.iter().copied().fold(0.0, f64::max);
    let mut errors = Vec::new();
    for samples in [1, 2, 4, 8, 16] {
        let shaded = ShadedLight {
            light,
            shadow: Shadow::Map(ShadowMap::new(&map.texture, &cameras)),
        };
        let found = lab.shade(&lit, &[material([1.0; 3], [0.0; 3])], &[shaded], samples);
        let error = (found
            .iter()
            .zip(&truth)
            .map(|(f, t)| (f64::from(f.front[0]) - t).powi(2))
            .sum::<f64>()
            / truth.len() as f64)
            .sqrt();
        println!(
            "{samples} samples: RMSE {error:.4} of {whole:.4}, {} surfels",
            truth.len()
        );
        errors.push(error);
        for found in found {
            let steps = f64::from(found.front[0]) / whole * f64::from(samples);
            assert!((steps - steps.round()).abs() < 1e-4, "{samples}: {found:?}");
        }
    }
    // Down to what the map's texels and the bias leave.
    assert!(
        errors[1] < 0.75 * errors[0] && errors[2] < 0.5 * errors[0] && errors[3] < 0.25 * errors[0],
        "{errors:?}"
    );
    assert!(errors[4] < 1.1 * errors[3], "{errors:?}");
}

#[test]
fn extremes_stay_finite() {
    let lab = Lab::new();
    let lit = lab.cloud(
        &squares(&[(DVec3::ZERO, 1.0)]),
        &above(3.0),
        &SurfelizerSettings::default(),
    );
    let at = lit.surfels[lit.surfels.len() / 2].position;
    let odd = [f32::NAN, f32::INFINITY, -5.0];
    let huge = [3e38, 1e18, 1e30];
    let spot = |inner, outer| Light::Spot {
        position: DVec3::Y,
        direction: DVec3::NEG_Y,
        intensity: [1.0; 3],
        inner,
        outer,
    };
    let lights = [
        point(at, [1.0; 3]),
        point(at, [1e18; 3]),
        point(at + DVec3::Y * 1e-12, [1e18; 3]),
        point(at + DVec3::Y * 1e-30, [1e18; 3]),
        // The first that f32 can tell from the surfel's own place.
        point(at + DVec3::Y * 1e-6, [1e18; 3]),
        Light::Directional {
            direction: DVec3::NEG_Y,
            irradiance: [1e18; 3],
        },
        point(DVec3::splat(1e300), [1e18; 3]),
        point(DVec3::Y * 1e15, [1e18; 3]),
        point(at, [0.0; 3]),
        spot(0.0, 0.0),
        spot(1e-6, 1e-6),
        spot(0.0, std::f32::consts::FRAC_PI_2),
        Light::Directional {
            direction: DVec3::new(1e-200, 0.0, 1.0),
            irradiance: [1e18; 3],
        },
    ];
    for material in [
        material(ALBEDO, [0.0; 3]),
        material(odd, odd),
        material(huge, huge),
    ] {
        for light in lights {
            light.validate().expect("a light");
            for samples in [1, 16] {
                for found in lab.shade(&lit, &[material], &[unshadowed(light); 2], samples) {
                    let sound = found
                        .front
                        .iter()
                        .chain(&found.back)
                        .all(|c| (0.0..=1e18).contains(c));
                    assert!(sound, "{material:?} {light:?}: {found:?}");
                }
            }
        }
    }
    // An index beyond the table takes the last material, and odd components count as black.
    for odd in odd {
        let found = lab.shade(&lit, &[material([odd; 3], [odd, 0.0, 7.0])], &[], 1);
        let found = found[0];
        assert_eq!(found.front[0], 0.0, "{odd}: {found:?}");
        assert!(
            (f64::from(found.front[2]) - 7.0 / PI).abs() < 1e-6,
            "{found:?}"
        );
    }
}

/// 1e5 units from the origin, where f32 has steps of 0.008, and at scales of 1e-4 and 1e4, light is what it is at home.
#[test]
fn place_and_scale_do_not_matter() {
    let lab = Lab::new();
    let shift = DVec3::new(65536.0, -131_072.0, 32768.0);
    for (place, scale) in [(DVec3::ZERO, 1e-4), (DVec3::ZERO, 1e4), (shift, 1.0)] {
        let scene = squares(&[
            (place, 2.0 * scale),
            (place + DVec3::Y * 0.75 * scale, 0.5 * scale),
        ]);
        let camera = Camera::look_at(
            place + DVec3::Y * 4.0 * scale,
            place,
            DVec3::NEG_Z,
            perspective(60.0, 1.0, 0.1 * scale),
            Viewport::full(64, 64),
        )
        .expect("a camera");
        let lit = lab.cloud(&scene, &camera, &SurfelizerSettings::default());
        assert_eq!(lit.origin, camera.focus());
        let eye = place + DVec3::new(0.25, 2.0, 0.5) * scale;
        let cameras = [Camera::look_at(
            eye,
            place,
            DVec3::Z,
            Convention::Reversed.projection(2.0, 1.0, 0.1 * scale, 10.0 * scale),
            Viewport::full(128, 128),
        )
        .expect("a camera")];
        let map = DepthMap::draw(
            lab.gpu,
            &scene,
            &cameras,
            128,
            wgpu::TextureFormat::Depth32Float,
        );
        let light = point(eye, [(scale * scale) as f32; 3]);
        let found = lab.shade(
            &lit,
            &[material(ALBEDO, [0.0; 3])],
            &[ShadedLight {
                light,
                shadow: Shadow::Map(ShadowMap::new(&map.texture, &cameras)),
            }],
            1,
        );
        let expected = [mirror::ShadedLight {
            light,
            shadow: Some(map.mirror(&cameras)),
        }];
        print!("{place} scale {scale}: ");
        let bad = differing(&lit, &found, &[material(ALBEDO, [0.0; 3])], &expected, 1);
        let dark = found.iter().filter(|f| f.front == [0.0; 3]).count();
        assert!(
            dark > 20 && dark < found.len() / 2,
            "{place} {scale}: {dark} dark"
        );
        assert!(bad <= 2 + found.len() / 1000, "{place} {scale}: {bad}");
    }
}

#[test]
fn empty_clouds_are_valid() {
    let lab = Lab::new();
    let grey = [material(ALBEDO, [1.0; 3])];
    let light = [unshadowed(point(DVec3::Y, [1.0; 3]))];
    let none = lab.cloud(&squares(&[]), &above(3.0), &SurfelizerSettings::default());
    // `shade` checks that nothing is written.
    assert!(lab.shade(&none, &grey, &light, 4).is_empty());
    assert!(lab.shade(&none, &grey, &[], 4).is_empty());
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let lab = Lab::new();
    let device = &lab.gpu.device;
    let none = lab.cloud(&squares(&[]), &above(3.0), &SurfelizerSettings::default());
    let cloud = none.cloud;
    let storage = wgpu::BufferUsages::STORAGE;
    let materials = lab.gpu.buffer(&[material(ALBEDO, [0.0; 3])], storage);
    let radiance = lab.shader.create_radiance(device, &cloud).expect("room");
    assert!(
        radiance
            .usage()
            .contains(storage | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST)
    );
    assert_eq!(radiance.size(), 32 << 15);
    let input = SurfelShaderInput {
        cloud: &cloud,
        materials: &materials,
        lights: &[],
        radiance: &radiance,
        timestamps: None,
    };
    let record = |input: &SurfelShaderInput<'_>, samples| {
        lab.shader.record(
            device,
            &mut lab.gpu.encoder(),
            input,
            &SurfelShaderSettings { samples },
        )
    };
    assert_eq!(record(&input, 1), Ok(()));
    for samples in [0, 3, 12, 32, u32::MAX] {
        match record(&input, samples) {
            Err(Error::Setting { field, .. }) => {
                assert_eq!(field, "SurfelShaderSettings::samples");
            }
            other => panic!("{samples}: {other:?}"),
        }
    }

    let short = lab.gpu.buffer(&[0_u32; 7], storage);
    let unusable = lab.gpu.buffer(&[0_u32; 64], wgpu::BufferUsages::VERTEX);
    let one_short = lab.gpu.buffer(&vec![0_u8; (32 << 15) - 4], storage);
    for (input, named) in [
        (
            SurfelShaderInput {
                materials: &short,
                ..input
            },
            "SurfelShaderInput::materials",
        ),
        (
            SurfelShaderInput {
                materials: &unusable,
                ..input
            },
            "SurfelShaderInput::materials",
        ),
        (
            SurfelShaderInput {
                radiance: &one_short,
                ..input
            },
            "SurfelShaderInput::radiance",
        ),
        (
            SurfelShaderInput {
                radiance: &unusable,
                ..input
            },
            "SurfelShaderInput::radiance",
        ),
        (
            SurfelShaderInput {
                materials: &radiance,
                ..input
            },
            "SurfelShaderInput::radiance",
        ),
        (
            SurfelShaderInput {
                radiance: cloud.pieces(),
                ..input
            },
            "SurfelShaderInput::radiance",
        ),
    ] {
        match record(&input, 1) {
            Err(Error::Buffer { name, .. }) => assert_eq!(name, named, "{input:?}"),
            other => panic!("{input:?}: {other:?}"),
        }
    }

    let lights = [unshadowed(point(DVec3::NAN, [1.0; 3]))];
    let bad = SurfelShaderInput {
        lights: &lights,
        ..input
    };
    assert!(matches!(
        record(&bad, 1),
        Err(Error::Setting {
            field: "Light::position",
            ..
        })
    ));

    let texture = |format, layers, samples, usage| {
        device
            .create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d {
                    width: 64,
                    height: 64,
                    depth_or_array_layers: layers,
                },
                mip_level_count: 1,
                sample_count: samples,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
            .create_view(&wgpu::TextureViewDescriptor::default())
    };
    let bound = wgpu::TextureUsages::TEXTURE_BINDING;
    let target = wgpu::TextureUsages::RENDER_ATTACHMENT;
    let depth32 = wgpu::TextureFormat::Depth32Float;
    let good = texture(depth32, 2, 1, bound);
    let cameras = cube(DVec3::ZERO, 64, 0.1);
    let large = [above(1.0), cube(DVec3::ZERO, 65, 0.1)[0]];
    for (depth, cameras, bias, named) in [
        (&good, &cameras[..0], 1.0, "ShadowMap::cameras"),
        (&good, &[cameras[0]; 7][..], 1.0, "ShadowMap::cameras"),
        (&good, &cameras[..1], -0.1, "ShadowMap::bias"),
        (&good, &cameras[..1], f32::NAN, "ShadowMap::bias"),
        (&good, &cameras[..3], 1.0, "ShadowMap::depth"),
        (&good, &large, 1.0, "ShadowMap::depth"),
        (
            &texture(wgpu::TextureFormat::R16Float, 2, 1, bound),
            &cameras[..1],
            1.0,
            "ShadowMap::depth",
        ),
        (
            &texture(depth32, 2, 1, target),
            &cameras[..1],
            1.0,
            "ShadowMap::depth",
        ),
        (
            &texture(depth32, 1, 4, bound | target),
            &cameras[..1],
            1.0,
            "ShadowMap::depth",
        ),
    ] {
        let lights = [ShadedLight {
            light: point(DVec3::Y, [1.0; 3]),
            shadow: Shadow::Map(ShadowMap {
                depth: depth.texture().into(),
                cameras,
                bias,
            }),
        }];
        let input = SurfelShaderInput {
            lights: &lights,
            ..input
        };
        let found = match record(&input, 1) {
            Err(Error::Setting { field, .. }) => field,
            Err(
                Error::Format { name, .. }
                | Error::Usage { name, .. }
                | Error::Shape { name, .. }
                | Error::Size { name, .. },
            ) => name,
            other => panic!("{lights:?}: {other:?}"),
        };
        assert_eq!(found, named, "{lights:?}");
    }

    if device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
        let set = device.create_query_set(&wgpu::QuerySetDescriptor {
            label: None,
            ty: wgpu::QueryType::Timestamp,
            count: 2,
        });
        let bad = SurfelShaderInput {
            timestamps: Some(Timestamps {
                set: &set,
                begin: 1,
                end: 1,
            }),
            ..input
        };
        assert!(matches!(record(&bad, 1), Err(Error::Setting { .. })));
    }
}

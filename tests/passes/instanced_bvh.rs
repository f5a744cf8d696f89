//! The `InstancedBvh`: hits of two levels against the f64 mirror and against those of one level, what is built anew, what is left
//! out, and typed errors.

use std::{
    f64::consts::{FRAC_PI_2, PI, TAU},
    sync::LazyLock,
};

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedScene, BouncedSettings, BouncedView, BouncedZBuffer,
    Camera, ChangedMeshes, Error, Geometry, HitLighting, HitRadiance, IndexFormat, Indices,
    InstancedBvh, InstancedBvhBuilder, InstancedBvhInput, InstancedCounts, Instances, Light,
    Material, Mesh, Payload, PositionFormat, Primitives, Sampling, TransformFormat, Vertices,
    Viewport,
    glam::{DMat4, DQuat, DVec3, EulerRot, Mat4, Vec4},
    reference::{
        bounced_z_buffer::Tracing,
        hashing::{hash2, unit_float},
        instanced_bvh::{Instance, hits, lit, own_triangles},
        packing::unpack_color,
        surfelizer::Triangle,
    },
    scenes,
    wgpu::{self, BufferUsages},
};
use support::raster::perspective;
use support::testing::frames::Decoded;
use support::testing::pipelines;
use support::testing::rays::{AMPLE, Senders, differing_bits, lab, scene_of, triangles};
use support::testing::shot::Shot;

/// Share of rays for which f32 may find otherwise than f64: as of the bounced z-buffer.
const ODD_RAYS: f64 = 2e-3;
/// And than one level does: either may err.
const ODD_PAIRS: f64 = 4e-3;
/// Colours as of lit hits.
const OFF: f64 = 1.0 / 200.0;
const ODD_COLORS: f64 = 4e-3;

static BUILDER: LazyLock<InstancedBvhBuilder> =
    LazyLock::new(|| InstancedBvhBuilder::new(&lab().gpu.device).expect("pipelines"));

fn tracer(payload: Payload) -> &'static BouncedZBuffer {
    pipelines::bounced(&BouncedDescriptor {
        payload,
        primitives: Primitives::Instances,
        ..BouncedDescriptor::default()
    })
}

/// A mesh by its triangles, and where its instances are; without any it is in world space.
#[derive(Clone)]
struct Part {
    triangles: Vec<[DVec3; 3]>,
    transforms: Option<Vec<Mat4>>,
    material: u32,
    /// Halves, indices of 16 bits and rows of transforms, with something between them.
    compact: bool,
}

impl Part {
    fn new(triangles: Vec<[DVec3; 3]>, transforms: Option<Vec<Mat4>>, material: u32) -> Self {
        Self {
            triangles,
            transforms,
            material,
            compact: false,
        }
    }

    /// Its corners as a vertex has them.
    fn given(&self) -> Vec<[DVec3; 3]> {
        let half = |x: f64| f64::from(f16(x as f32).1);
        let given = |p: DVec3| {
            if self.compact {
                DVec3::new(half(p.x), half(p.y), half(p.z))
            } else {
                p.as_vec3().as_dvec3()
            }
        };
        self.triangles.iter().map(|t| t.map(given)).collect()
    }

    fn matrices(&self) -> Vec<DMat4> {
        match &self.transforms {
            Some(transforms) => transforms.iter().map(Mat4::as_dmat4).collect(),
            None => vec![DMat4::IDENTITY],
        }
    }

    /// In world space.
    fn placed(&self) -> Vec<[DVec3; 3]> {
        let given = self.given();
        let at = |m: DMat4| move |t: &[DVec3; 3]| t.map(|p| m.transform_point3(p));
        self.matrices()
            .into_iter()
            .filter(DMat4::is_finite)
            .flat_map(|m| given.iter().map(at(m)).collect::<Vec<_>>())
            .collect()
    }
}

/// The bits of a half, and what it is: for numbers in its normal range.
fn f16(x: f32) -> (u16, f32) {
    if x.abs() < 6.2e-5 {
        return (0, 0.0);
    }
    let bits = x.to_bits();
    let rounded = bits & 0xffff_e000;
    let exponent = ((bits >> 23) & 0xff) - 112;
    let half = ((bits >> 16) & 0x8000) | (exponent << 10) | ((bits >> 13) & 0x3ff);
    (half as u16, f32::from_bits(rounded))
}

/// A part's buffers.
struct Buffers {
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    transforms: Option<wgpu::Buffer>,
}

const ODD_STRIDE: u32 = 60;
const ODD_OFFSET: u64 = 20;

impl Buffers {
    fn new(part: &Part) -> Self {
        let gpu = lab().gpu;
        let corners = part.triangles.iter().flatten();
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let numbers = 0..3 * part.triangles.len() as u32;
        let words: Vec<u32> = if part.compact {
            let half = |x: f64| u32::from(f16(x as f32).0);
            corners
                .flat_map(|p| [half(p.x) | (half(p.y) << 16), half(p.z), 7])
                .collect()
        } else {
            corners
                .flat_map(|p| p.as_vec3().to_array().map(f32::to_bits))
                .collect()
        };
        let transforms = part.transforms.as_ref().map(|transforms| {
            let words: Vec<f32> = if part.compact {
                let mut words = vec![0.0; ODD_OFFSET as usize / 4];
                for m in transforms {
                    let rows = [m.row(0), m.row(1), m.row(2)];
                    words.extend(rows.iter().flat_map(Vec4::to_array));
                    words.extend([0.0; ODD_STRIDE as usize / 4 - 12]);
                }
                words
            } else {
                transforms.iter().flat_map(Mat4::to_cols_array).collect()
            };
            gpu.buffer(&padded(words, 4), usage)
        });
        Self {
            vertices: gpu.buffer(&padded(words, 4), usage),
            indices: if part.compact {
                let numbers: Vec<u16> = numbers.rev().map(|i| i as u16).collect();
                gpu.buffer(&padded(numbers, 8), usage)
            } else {
                gpu.buffer(&padded(numbers.collect::<Vec<_>>(), 4), usage)
            },
            transforms,
        }
    }

    fn mesh<'a>(&'a self, part: &Part) -> Mesh<'a> {
        let (stride, format) = if part.compact {
            (12, PositionFormat::Float16x4)
        } else {
            (12, PositionFormat::Float32x3)
        };
        let count = 3 * part.triangles.len() as u32;
        Mesh {
            vertices: Vertices {
                buffer: &self.vertices,
                offset: 0,
                stride,
                format,
                count,
            },
            indices: part.compact.then_some(Indices {
                buffer: &self.indices,
                offset: 0,
                format: IndexFormat::Uint16,
            }),
            first: 0,
            count,
            base_vertex: 0,
            instances: self.transforms.as_ref().map(|buffer| Instances {
                buffer,
                offset: if part.compact { ODD_OFFSET } else { 0 },
                stride: if part.compact { ODD_STRIDE } else { 64 },
                format: if part.compact {
                    TransformFormat::Rows3x4
                } else {
                    TransformFormat::Mat4
                },
                count: part.transforms.as_ref().map_or(0, |t| t.len() as u32),
            }),
            material: part.material,
        }
    }
}

/// Buffers may not be empty.
fn padded<T: Default>(mut all: Vec<T>, least: usize) -> Vec<T> {
    while all.len() < least || !(all.len() * size_of::<T>()).is_multiple_of(4) {
        all.push(T::default());
    }
    all
}

/// Parts, their buffers, and what a camera sees of them.
struct World {
    parts: Vec<Part>,
    buffers: Vec<Buffers>,
    shot: Shot,
    /// Where it is, if not above what is seen.
    lamp: Option<DVec3>,
}

impl World {
    fn new(parts: Vec<Part>, camera: &Camera) -> Self {
        let all: Vec<_> = parts.iter().flat_map(Part::placed).collect();
        let scene = scene_of(&all, &scenes::cornell());
        Self {
            buffers: parts.iter().map(Buffers::new).collect(),
            shot: Shot::new(lab().gpu, &scene, camera),
            lamp: None,
            parts,
        }
    }

    fn meshes(&self) -> Vec<Mesh<'_>> {
        let pairs = self.buffers.iter().zip(&self.parts);
        pairs.map(|(buffers, part)| buffers.mesh(part)).collect()
    }

    fn create(&self) -> InstancedBvh {
        let geometry = Geometry {
            meshes: &self.meshes(),
        };
        BUILDER.create(&lab().gpu.device, &geometry).expect("room")
    }

    fn record(&self, bvh: &mut InstancedBvh, changed: ChangedMeshes<'_>) -> InstancedCounts {
        let meshes = self.meshes();
        let input = InstancedBvhInput {
            changed,
            ..InstancedBvhInput::new(Geometry { meshes: &meshes }, &self.shot.camera)
        };
        let mut encoder = lab().gpu.encoder();
        BUILDER
            .record(&lab().gpu.device, &mut encoder, &input, bvh)
            .expect("a hierarchy");
        lab().gpu.finish(encoder);
        lab().gpu.read_buffer(bvh.counts())[0]
    }

    fn built(&self) -> InstancedBvh {
        let mut bvh = self.create();
        self.record(&mut bvh, ChangedMeshes::None);
        bvh
    }

    fn trace(
        &self,
        bvh: &InstancedBvh,
        payload: Payload,
        radiance: HitRadiance<'_>,
        settings: &BouncedSettings,
    ) -> BouncedView {
        let gpu = lab().gpu;
        let camera = &self.shot.camera;
        let Viewport { width, height, .. } = camera.viewport();
        let pass = tracer(payload);
        let view = pass
            .create_view(&gpu.device, width, height, settings.rays_per_pixel)
            .expect("a view");
        let mut encoder = gpu.encoder();
        let mut decoded = Decoded::of(camera);
        let frame = decoded.frame(&mut encoder, self.shot.gbuffer(), camera, bvh.origin());
        let input = BouncedInput {
            radiance,
            ..BouncedInput::of(&frame, BouncedScene::Instances(bvh))
        };
        pass.record(&gpu.device, &mut encoder, &input, settings, &view)
            .expect("hits");
        gpu.finish(encoder);
        view
    }

    fn blocked(&self, bvh: &InstancedBvh, settings: &BouncedSettings) -> Vec<u32> {
        let view = self.trace(bvh, Payload::Occlusion, HitRadiance::None, settings);
        lab().blocked(&view, settings)
    }

    /// The same triangles in one level.
    fn flat(&self) -> Senders {
        lab().senders(&self.meshes(), &self.shot.camera, &triangles(), AMPLE)
    }

    /// Compares occlusion, and lit hits, with the mirror's and with those of one level.
    fn compare(&self, name: &str, settings: &BouncedSettings) {
        let lab = lab();
        let bvh = self.built();
        let found = self.blocked(&bvh, settings);
        let flat = self.flat();
        let own: Vec<(DVec3, Vec<Triangle>)> = self
            .parts
            .iter()
            .map(|part| {
                let mut given = part.given();
                if part.compact {
                    // Its indices count down.
                    given.reverse();
                    for corners in &mut given {
                        corners.reverse();
                    }
                }
                own_triangles(&given)
            })
            .collect();
        let instances: Vec<Instance<'_>> = self
            .parts
            .iter()
            .zip(&own)
            .flat_map(|(part, (anchor, own))| {
                part.matrices().into_iter().filter_map(move |m| {
                    let mesh = (*anchor, own.as_slice());
                    Instance::new(&m, self.shot.camera.focus(), mesh, part.material as usize)
                })
            })
            .collect();
        let receivers = self.shot.receivers(bvh.origin());
        let tracing = Tracing {
            receivers: &receivers,
            camera: &self.shot.camera,
            origin: bvh.origin(),
            settings,
            sampling: Sampling::Cosine,
            pieces: &flat.pieces,
        };
        let rays = settings.rays_per_pixel as usize;
        let seen = receivers.iter().flatten().count() * rays;
        assert!(seen > 1000, "{name}: {seen} rays");
        let mirror = hits(&tracing, &instances);
        let bit = |i: usize| found[i / rays] >> (i % rays) & 1 != 0;
        let odd = (0..mirror.len())
            .filter(|&i| bit(i) != mirror[i].is_some())
            .count();
        let view = lab.trace(&self.shot, &flat, None, settings, Sampling::Cosine);
        let one = lab.blocked(&view, settings);
        let pairs = differing_bits(&found, &one);
        let blocked: u32 = found.iter().map(|word| word.count_ones()).sum();
        println!(
            "{name}: of {seen} rays {blocked} blocked, {odd} not as the mirror's, {pairs} not as in one level"
        );
        let share = |n: f64| n / seen as f64;
        assert!(share(odd as f64) <= ODD_RAYS, "{name}: {odd} of {seen}");
        assert!(
            share(f64::from(pairs)) <= ODD_PAIRS,
            "{name}: {pairs} of {seen}"
        );

        let (lights, relative) = self.lights(bvh.origin());
        let table = materials();
        let buffer = lab.gpu.buffer(&table, BufferUsages::STORAGE);
        let radiance = HitRadiance::Lit(HitLighting {
            materials: &buffer,
            lights: &lights,
        });
        let view = self.trace(&bvh, Payload::LitRadiance, radiance, settings);
        let colors = lab.colors(&view, settings);
        let two = lit(&tracing, &instances, &table, &relative);
        let one = tracing.lit(&table, &relative);
        for (of, expected, allowed) in [
            ("mirror", two, ODD_COLORS),
            ("one level", one, 2.0 * ODD_COLORS),
        ] {
            // A lamp in a surface's own plane shines on it by a cosine that is rounding's.
            let mean =
                expected.iter().map(|c| c.max_element()).sum::<f64>() / expected.len() as f64;
            let faint = 1e-2 * mean;
            let farther = colors.iter().zip(&expected).filter(|(found, expected)| {
                let off = (unpack_color(**found) - **expected).abs().max_element();
                assert!(off.is_finite(), "{name}: {found:x}");
                off > OFF * expected.max_element().max(faint)
            });
            let farther = farther.count();
            let bright = expected.iter().filter(|c| c.max_element() > 0.0).count();
            println!("{name}: {farther} colours not as of {of}, {bright} bright");
            assert!(
                share(farther as f64) <= allowed,
                "{name}, {of}: {farther} of {seen}"
            );
        }
    }

    /// A sun and a lamp, and the same relative to an origin.
    fn lights(&self, origin: DVec3) -> (Vec<Light>, Vec<Light>) {
        let camera = &self.shot.camera;
        let reach = self.reach();
        let lamp = |position| Light::Point {
            position,
            intensity: [1.0, 0.5, 0.2].map(|c| c * (reach * reach) as f32),
        };
        let sun = Light::Directional {
            direction: DVec3::new(0.3, -1.0, 0.2),
            irradiance: [1.0, 0.5, 0.25],
        };
        let above = camera.eye() + DVec3::new(0.1, 0.5, 0.2) * reach;
        let at = self.lamp.unwrap_or(above);
        (vec![sun, lamp(at)], vec![sun, lamp(at - origin)])
    }

    /// How far what is seen is.
    fn reach(&self) -> f64 {
        let seen = self.shot.pixels.iter().flatten();
        let eye = self.shot.camera.eye();
        let far = |most: f64, at: DVec3| most.max((at - eye).length());
        seen.map(|pixel| pixel.receiver.position).fold(1e-9, far)
    }
}

fn materials() -> Vec<Material> {
    (0..4)
        .map(|i| Material {
            albedo: [0.2 + 0.2 * i as f32, 0.5, 0.9 - 0.2 * i as f32],
            emission: [0.0, if i == 3 { 0.7 } else { 0.0 }, 0.0],
            ..Material::default()
        })
        .collect()
}

fn camera(eye: DVec3, target: DVec3, scale: f64) -> Camera {
    Camera::look_at(
        eye,
        target,
        DVec3::Y,
        perspective(50.0, 1.0, 0.01 * scale),
        Viewport::full(24, 24),
    )
    .expect("a camera")
}

fn random(i: usize, salt: u32) -> f64 {
    unit_float(hash2(i as u32, salt))
}

fn quad(corner: DVec3, u: DVec3, v: DVec3) -> [[DVec3; 3]; 2] {
    [
        [corner, corner + u, corner + u + v],
        [corner, corner + u + v, corner + v],
    ]
}

/// A closed box, whose front sides face outward.
fn cuboid(low: DVec3, high: DVec3) -> Vec<[DVec3; 3]> {
    let d = high - low;
    let [x, y, z] = [DVec3::X * d.x, DVec3::Y * d.y, DVec3::Z * d.z];
    [
        quad(low, y, x),
        quad(low + z, x, y),
        quad(low, x, z),
        quad(low + y, z, x),
        quad(low, z, y),
        quad(low + x, y, z),
    ]
    .concat()
}

/// A cone of many sides on a thin trunk, about 1 high.
fn tree(sides: usize) -> Vec<[DVec3; 3]> {
    let mut all = cuboid(DVec3::new(-0.03, 0.0, -0.03), DVec3::new(0.03, 0.35, 0.03));
    let rim = |i: usize| {
        let angle = TAU * i as f64 / sides as f64;
        DVec3::new(0.3 * angle.cos(), 0.3, 0.3 * angle.sin())
    };
    for i in 0..sides {
        all.push([rim(i + 1), rim(i), DVec3::Y]);
        all.push([rim(i), rim(i + 1), DVec3::Y * 0.3]);
    }
    all
}

fn ground(side: f64) -> Vec<[DVec3; 3]> {
    quad(
        DVec3::new(-side, 0.0, -side),
        DVec3::Z * 2.0 * side,
        DVec3::X * 2.0 * side,
    )
    .into()
}

/// Turned, scaled and mirrored at random, each its own way; `stretch` is how different the axes' scales are.
fn scattered(count: usize, side: f64, stretch: f64, seed: u32) -> Vec<Mat4> {
    (0..count)
        .map(|i| {
            let draw = |salt| random(i, salt + seed);
            let turn =
                DQuat::from_euler(EulerRot::YXZ, TAU * draw(1), 0.3 * draw(2), 0.3 * draw(3));
            let mut scale = DVec3::splat(0.7 + 0.6 * draw(4));
            scale[i % 3] *= stretch.powf(draw(5) - 0.5);
            if i % 3 == 1 {
                scale[i % 2] *= -1.0;
            }
            let at = DVec3::new(draw(6) - 0.5, 0.0, draw(7) - 0.5) * side;
            DMat4::from_scale_rotation_translation(scale, turn, at).as_mat4()
        })
        .collect()
}

/// Trees of two kinds on a ground that is in world space.
fn forest() -> Vec<Part> {
    vec![
        Part::new(ground(5.0), None, 0),
        Part::new(tree(9), Some(scattered(60, 8.0, 2.0, 0)), 1),
        Part {
            compact: true,
            ..Part::new(tree(24), Some(scattered(40, 8.0, 1.5, 100)), 2)
        },
        Part::new(
            cuboid(DVec3::splat(-0.2), DVec3::splat(0.2)),
            Some(scattered(3, 3.0, 1.0, 200)),
            3,
        ),
    ]
}

fn over_forest() -> Camera {
    camera(DVec3::new(0.5, 1.6, 4.0), DVec3::new(0.0, 0.4, 0.0), 1.0)
}

fn moved(parts: &[Part], by: DMat4) -> Vec<Part> {
    let mut moved = parts.to_vec();
    for part in &mut moved {
        match &mut part.transforms {
            Some(transforms) => {
                for m in transforms {
                    *m = (by * m.as_dmat4()).as_mat4();
                }
            }
            None => {
                for p in part.triangles.iter_mut().flatten() {
                    *p = by.transform_point3(*p);
                }
            }
        }
    }
    moved
}

fn settings(rays_per_pixel: u32) -> BouncedSettings {
    BouncedSettings {
        rays_per_pixel,
        sky_radiance: [0.3, 0.2, 0.1],
        ..BouncedSettings::default()
    }
}

#[test]
fn hits_are_the_mirrors_and_those_of_one_level() {
    let forest = World::new(forest(), &over_forest());
    forest.compare("forest", &settings(9));
    forest.compare(
        "forest, radius",
        &BouncedSettings {
            radius: 0.4,
            frame: 3,
            ..settings(16)
        },
    );
    // A room whose walls are instances of one quad: nothing leaks between them.
    let wall: Vec<_> = quad(DVec3::new(-1.0, -1.0, -1.0), DVec3::X * 2.0, DVec3::Y * 2.0).into();
    let walls = [
        DQuat::IDENTITY,
        DQuat::from_rotation_y(FRAC_PI_2),
        DQuat::from_rotation_y(PI),
        DQuat::from_rotation_y(-FRAC_PI_2),
        DQuat::from_rotation_x(FRAC_PI_2),
        DQuat::from_rotation_x(-FRAC_PI_2),
    ];
    let at = |turn: &DQuat| {
        DMat4::from_scale_rotation_translation(
            DVec3::new(3.0, 3.0, 3.0),
            *turn,
            DVec3::new(0.7, 0.2, 0.1),
        )
    };
    let room = Part::new(
        wall,
        Some(walls.iter().map(|t| at(t).as_mat4()).collect()),
        1,
    );
    let inside = camera(DVec3::new(0.9, 0.3, 1.5), DVec3::new(0.0, -1.0, -2.0), 1.0);
    let mut room = World::new(vec![room], &inside);
    room.compare("room", &settings(16));
    // On the ceiling, which casts no shadow on the walls below it.
    for (name, lamp) in [
        ("lamp", DVec3::new(0.7, 3.2, 0.1)),
        ("lamp in a corner", DVec3::new(-2.3, 3.2, -2.9)),
    ] {
        room.lamp = Some(lamp);
        room.compare(name, &settings(16));
    }
    let bvh = room.built();
    let bits = room.blocked(&bvh, &settings(16));
    let open: u32 = bits.iter().map(|word| 16 - word.count_ones()).sum();
    assert_eq!(open, 0, "rays that escape a closed room");
}

#[test]
fn few_of_anything() {
    let over = over_forest();
    let parts = |transforms| {
        vec![
            Part::new(ground(5.0), None, 0),
            Part::new(tree(9)[12..13].to_vec(), transforms, 1),
        ]
    };
    let wide = DMat4::from_scale(DVec3::new(5.0, 2.0, 3.0)).as_mat4();
    World::new(parts(Some(vec![wide])), &over).compare("one triangle", &settings(9));
    World::new(parts(None), &over).compare("one triangle in the world", &settings(9));
    World::new(parts(Some(vec![])), &over).compare("no instance", &settings(9));
    let one = vec![Part::new(ground(5.0), None, 0)];
    World::new(one, &over).compare("one mesh", &settings(9));
    let mut parts = forest();
    parts.insert(1, Part::new(vec![], Some(scattered(5, 1.0, 1.0, 0)), 0));
    parts.push(Part::new(vec![], None, 0));
    World::new(parts, &over).compare("empty meshes", &settings(9));
}

/// Small, large, far away, stretched, and meshes that are far from the origin of their own space.
#[test]
fn extremes_are_those_of_one_level() {
    for (name, scale, shift) in [
        ("small", 1e-4, DVec3::ZERO),
        ("large", 1e5, DVec3::ZERO),
        ("far", 1.0, DVec3::new(1e4, -2e3, 3e3)),
    ] {
        let by =
            DMat4::from_scale_rotation_translation(DVec3::splat(scale), DQuat::IDENTITY, shift);
        let place = |p| by.transform_point3(p);
        let near = camera(
            place(DVec3::new(0.5, 1.6, 4.0)),
            place(DVec3::Y * 0.4),
            scale,
        );
        World::new(moved(&forest(), by), &near).compare(name, &settings(9));
    }
    let mut stretched = forest();
    stretched[1].transforms = Some(scattered(60, 8.0, 1e6, 7));
    World::new(stretched, &over_forest()).compare("stretched", &settings(9));
    // A mesh a thousand units from its own origin, which its transform takes back; and one in units of a millionth.
    let mut offset = forest();
    for (part, by) in [
        (1, DMat4::from_translation(DVec3::new(900.0, 50.0, -400.0))),
        (3, DMat4::from_scale(DVec3::splat(1e6))),
    ] {
        for p in offset[part].triangles.iter_mut().flatten() {
            *p = by.transform_point3(*p).as_vec3().as_dvec3();
        }
        for m in offset[part].transforms.iter_mut().flatten() {
            *m = (m.as_dmat4() * by.inverse()).as_mat4();
        }
    }
    World::new(offset, &over_forest()).compare("offset", &settings(9));
}

/// Slopes of kilometres, seen from as near as a metre and far from their meshes' first vertices, where a ray's start is known to
/// centimetres: nothing is above them, and they do not hide the sky from themselves.
#[test]
fn large_meshes_do_not_meet_their_own_rays() {
    for side in [1e3, 1e4, 1e5] {
        for (name, turn) in [
            ("slope", DQuat::from_rotation_z(0.3)),
            ("steep slope", DQuat::from_rotation_x(1.1)),
        ] {
            let place = DMat4::from_quat(turn).as_mat4();
            let at = |p: DVec3| place.as_dmat4().transform_point3(p);
            let near = at(DVec3::new(0.11 * side, 0.0, 0.07 * side));
            let eye = near + turn * DVec3::new(0.3, 1.0, 1.3);
            let parts = vec![Part::new(ground(side), Some(vec![place]), 0)];
            let world = World::new(parts, &camera(eye, near, 1.0));
            let bits = world.blocked(&world.built(), &settings(16));
            let blocked: u32 = bits.iter().map(|word| word.count_ones()).sum();
            assert_eq!(blocked, 0, "{name} of {side}");
        }
    }
}

/// Transforms alone move the hierarchy over instances; a mesh is built anew where it is said to have changed, and only there.
#[test]
fn what_changed_is_built() {
    let gpu = lab().gpu;
    let before = World::new(forest(), &over_forest());
    let mut bvh = before.built();
    let first = before.blocked(&bvh, &settings(16));

    let mut parts = forest();
    parts[1].transforms = Some(scattered(60, 8.0, 2.0, 50));
    let animated = World::new(parts.clone(), &over_forest());
    animated.record(&mut bvh, ChangedMeshes::None);
    let moved = animated.blocked(&bvh, &settings(16));
    assert_ne!(moved, first);
    assert_eq!(moved, animated.blocked(&animated.built(), &settings(16)));

    // Other vertices of one mesh, in the same buffer.
    for part in [1, 3] {
        for p in parts[part].triangles.iter_mut().flatten() {
            *p *= DVec3::new(1.5, 0.4, 1.0);
        }
    }
    let deformed = World::new(parts, &over_forest());
    // It looks for meshes' boxes where they were built.
    deformed.record(&mut bvh, ChangedMeshes::None);
    assert_eq!(moved, {
        let unchanged = World {
            lamp: None,
            parts: deformed.parts.clone(),
            buffers: deformed.parts.iter().map(Buffers::new).collect(),
            shot: Shot::new(
                gpu,
                &scene_of(
                    &animated
                        .parts
                        .iter()
                        .flat_map(Part::placed)
                        .collect::<Vec<_>>(),
                    &scenes::cornell(),
                ),
                &over_forest(),
            ),
        };
        unchanged.blocked(&bvh, &settings(16))
    });
    let fresh = deformed.blocked(&deformed.built(), &settings(16));
    deformed.record(&mut bvh, ChangedMeshes::Some(&[1]));
    assert_ne!(
        fresh,
        deformed.blocked(&bvh, &settings(16)),
        "one of two is old"
    );
    deformed.record(&mut bvh, ChangedMeshes::Some(&[3]));
    assert_eq!(fresh, deformed.blocked(&bvh, &settings(16)));
    before.record(&mut bvh, ChangedMeshes::All);
    assert_eq!(first, before.blocked(&bvh, &settings(16)));
}

#[test]
fn what_cannot_be_met_is_left_out_and_counted() {
    let mut parts = forest();
    let mut odd = Vec::new();
    let usable = DMat4::from_translation(DVec3::new(0.5, 0.0, 0.5)).as_mat4();
    for (column, row, value) in [
        (0, 0, 0.0),
        (1, 1, f32::NAN),
        (2, 2, f32::INFINITY),
        (3, 1, f32::NAN),
        (3, 0, 3e38),
        (1, 1, 1e-20),
        (2, 2, 1e20),
    ] {
        let mut m = usable.to_cols_array_2d();
        m[column][row] = value;
        odd.push(Mat4::from_cols_array_2d(&m));
        odd.push(usable);
    }
    // Axes of one plane.
    odd.push(Mat4::from_cols(
        usable.x_axis,
        usable.x_axis + usable.z_axis,
        usable.z_axis,
        usable.w_axis,
    ));
    odd.push(Mat4::ZERO);
    parts.push(Part::new(tree(5), Some(odd), 1));
    let count = |parts: &[Part]| {
        let all = parts.iter().map(|part| part.matrices().len() as u32);
        all.sum::<u32>()
    };
    let mut few = parts.clone();
    few[4].transforms = Some(vec![usable; 7]);
    let [all, few] = [parts, few].map(|parts| World::new(parts, &over_forest()));
    let mut bvh = all.create();
    let counts = all.record(&mut bvh, ChangedMeshes::None);
    let expected = InstancedCounts {
        instances: count(&all.parts),
        left_out: 9,
    };
    assert_eq!(counts, expected);
    let bits = all.blocked(&bvh, &settings(16));
    let mut rest = few.create();
    let counts = few.record(&mut rest, ChangedMeshes::None);
    let expected = InstancedCounts {
        instances: count(&few.parts),
        left_out: 0,
    };
    assert_eq!(counts, expected);
    // The pixels are those of either, as of what is in the same place.
    let few = World {
        shot: all.shot,
        ..few
    };
    assert_eq!(bits, few.blocked(&rest, &settings(16)));

    // Nothing at all, and nothing that is usable.
    let nothing = vec![Part::new(tree(5), Some(vec![Mat4::ZERO; 70]), 1)];
    for parts in [vec![], nothing] {
        let world = World {
            lamp: None,
            buffers: parts.iter().map(Buffers::new).collect(),
            parts,
            shot: Shot::new(
                lab().gpu,
                &scene_of(&ground(5.0), &scenes::cornell()),
                &over_forest(),
            ),
        };
        let bits = world.blocked(&world.built(), &settings(16));
        assert!(bits.iter().all(|word| *word == 0));
    }
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let gpu = lab().gpu;
    let device = &gpu.device;
    let world = World::new(forest(), &over_forest());
    let mut bvh = world.create();
    let meshes = world.meshes();
    let record = |input: &InstancedBvhInput<'_>, bvh: &mut InstancedBvh| {
        let mut encoder = gpu.encoder();
        BUILDER.record(device, &mut encoder, input, bvh)
    };
    let geometry = Geometry { meshes: &meshes };
    let good = InstancedBvhInput::new(geometry, &world.shot.camera);
    let mismatch = |found: Result<(), Error>| {
        assert!(
            matches!(&found, Err(Error::Mismatch { name, .. }) if *name == "InstancedBvh"),
            "{found:?}"
        );
    };
    let of = |meshes| InstancedBvhInput {
        geometry: Geometry { meshes },
        ..good
    };
    mismatch(record(&of(&meshes[..3]), &mut bvh));
    let mut more = meshes.clone();
    more[0].count = 3;
    more[2].count -= 3;
    record(&of(&more), &mut bvh).expect("less is in order");
    let mut larger = more.clone();
    larger[0] = meshes[1];
    mismatch(record(&of(&larger), &mut bvh));
    let unknown = record(
        &InstancedBvhInput {
            changed: ChangedMeshes::Some(&[0, 4]),
            ..good
        },
        &mut bvh,
    );
    let is_field = |found: &Result<(), Error>, name: &str| matches!(found, Err(Error::Setting { field, .. }) if *field == name);
    assert!(
        is_field(&unknown, "InstancedBvhInput::changed"),
        "{unknown:?}"
    );
    let mut bad = meshes.clone();
    bad[1].vertices.stride = 6;
    let found = record(&of(&bad), &mut bvh);
    assert!(matches!(&found, Err(Error::Buffer { name, .. }) if *name == "Mesh::vertices"));

    // More triangles, or instances, than can be bound, with what is needed.
    let bytes = device.limits().max_storage_buffer_binding_size;
    let mut large = meshes.clone();
    large[2].count = 3 * u32::try_from(bytes / 48 + 1).expect("a count");
    let found = BUILDER.create(device, &Geometry { meshes: &large });
    assert!(
        matches!(&found, Err(Error::Limit { needed, .. }) if *needed > bytes),
        "{found:?}"
    );
    let mut large = meshes.clone();
    if let Some(instances) = &mut large[1].instances {
        instances.count = u32::try_from(bytes / 96 + 1).expect("a count");
    }
    let found = BUILDER.create(device, &Geometry { meshes: &large });
    assert!(matches!(found, Err(Error::Limit { .. })), "{found:?}");

    // What rays are traced among, and what they may bring.
    let fresh = world.create();
    let flat = world.flat();
    let camera = &world.shot.camera;
    let mut encoder = gpu.encoder();
    let mut decoded = Decoded::of(camera);
    let frame = decoded.frame(&mut encoder, world.shot.gbuffer(), camera, camera.focus());
    let pass = tracer(Payload::Occlusion);
    let view = pass.create_view(device, 24, 24, 4).expect("a view");
    let mut trace = |pass: &BouncedZBuffer, view: &BouncedView, scene| {
        let input = BouncedInput::of(&frame, scene);
        pass.record(device, &mut encoder, &input, &settings(4), view)
    };
    let cloud = BouncedScene::Cloud {
        cloud: &flat.cloud,
        bvh: &flat.bounds,
    };
    let found = trace(pass, &view, cloud);
    assert!(
        matches!(&found, Err(Error::Mismatch { name, .. }) if *name == "BouncedInput::scene"),
        "{found:?}"
    );
    let other = lab().tracer(Payload::Occlusion, Sampling::Cosine);
    let other_view = other.create_view(device, 24, 24, 4).expect("a view");
    let found = trace(other, &other_view, BouncedScene::Instances(&bvh));
    assert!(
        matches!(&found, Err(Error::Mismatch { name, .. }) if *name == "BouncedInput::scene"),
        "{found:?}"
    );
    // Never recorded, its origin is that of the world.
    let found = trace(pass, &view, BouncedScene::Instances(&fresh));
    assert!(found.is_err(), "{found:?}");
    let found = BouncedZBuffer::new(
        device,
        &BouncedDescriptor {
            payload: Payload::Radiance,
            primitives: Primitives::Instances,
            ..BouncedDescriptor::default()
        },
    );
    assert!(
        matches!(found, Err(Error::Setting { field, .. }) if field == "BouncedDescriptor::primitives")
    );
    let found = deep_screen_space::BvhBuilder::new(device, Primitives::Instances);
    assert!(matches!(found, Err(Error::Mismatch { name, .. }) if name == "BvhBuilder"));
}

//! Alpha-tested triangles: hits against the f64 mirror in one level and in two, by mirrored instances too, against the same shape
//! cut out in triangles, what it costs where nothing has holes, and typed errors.

use std::cell::RefCell;

use deep_screen_space::{
    AlphaChannel, AlphaTest, AlphaTestedInput, AlphaTests, AlphaWrap, AmbientOcclusion,
    BouncedDescriptor, BouncedInput, BouncedScene, BouncedSettings, BvhBuilder, Camera,
    ChangedMeshes, CloudCapacity, Geometry, HitLighting, HitRadiance, HitResolverSettings,
    InstancedBvh, InstancedBvhBuilder, InstancedBvhInput, Instances, Light, Material, Mesh,
    Payload, PositionFormat, Primitives, RaySettings, Sampling, TexCoordFormat, TexCoords,
    TextureSlice, TransformFormat, Vertices, Viewport,
    glam::{DMat4, DQuat, DVec3, Mat4},
    reference::{
        alpha_test::{self, AlphaMaps, Cutout, Holes},
        bounced_z_buffer::Tracing,
        hashing::{hash2, unit_float},
        instanced_bvh::{Instance, own_triangles},
        packing::unpack_color,
        surfelizer::Triangle,
        trace::Tracer,
    },
    scenes::{self, HoleTest, Part, Scene},
    shaders,
    wgpu::{self, BufferUsages, TextureFormat, TextureUsages},
};
use support::{
    raster::perspective,
    testing::{
        frames::Decoded,
        pipelines,
        rays::{AMPLE, Lab, Senders, lab, scene_of, triangles},
        refusals::refused,
        shot::{Shot, camera_of},
    },
};

/// Room for all of these.
const ROOM: CloudCapacity = CloudCapacity {
    surfels: 1 << 12,
    pieces: 1 << 13,
    triangles: 1 << 13,
};

/// Share of rays for which f32 may find otherwise than f64: twice that of triangles alone, as rays pass by the edges of holes
/// too. Measured at 1e-3 at most.
const ODD_RAYS: f64 = 4e-3;
/// Colours, which have a shadow ray to each light besides; how far off, relative to the brightest channel, and how many.
const OFF: f64 = 1.0 / 200.0;
const ODD_COLORS: f64 = 8e-3;

fn alpha_lab() -> Lab {
    Lab::of(Primitives::AlphaTested)
}

/// Sheets of triangles with texture coordinates, which instances may place.
#[derive(Clone)]
struct Sheet {
    triangles: Vec<[DVec3; 3]>,
    tex_coords: Vec<[[f32; 2]; 3]>,
    transforms: Option<Vec<Mat4>>,
    test: Option<HoleTest>,
    format: TexCoordFormat,
}

/// Two triangles from `corner` along `u` and `v`, with texture coordinates from `low` to `high`.
fn sheet(
    [corner, u, v]: [DVec3; 3],
    [low, high]: [[f32; 2]; 2],
    test: impl Into<Option<HoleTest>>,
    format: TexCoordFormat,
) -> Sheet {
    let corners = [corner, corner + u, corner + u + v, corner + v];
    let uvs = [low, [high[0], low[1]], high, [low[0], high[1]]];
    Sheet {
        triangles: [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| corners[i])).into(),
        tex_coords: [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| uvs[i])).into(),
        transforms: None,
        test: test.into(),
        format,
    }
}

impl Sheet {
    fn matrices(&self) -> Vec<DMat4> {
        match &self.transforms {
            Some(transforms) => transforms.iter().map(Mat4::as_dmat4).collect(),
            None => vec![DMat4::IDENTITY],
        }
    }

    /// In world space: corners and texture coordinates, the other way around where they are mirrored.
    fn placed(&self) -> Vec<([DVec3; 3], [[f32; 2]; 3])> {
        let each = |m: DMat4| {
            let mirrored = m.determinant() < 0.0;
            let all = self.triangles.iter().zip(&self.tex_coords);
            all.map(move |(t, uv)| {
                let t = t.map(|p| m.transform_point3(p));
                if mirrored {
                    ([t[0], t[2], t[1]], [uv[0], uv[2], uv[1]])
                } else {
                    (t, *uv)
                }
            })
            .collect::<Vec<_>>()
        };
        self.matrices().into_iter().flat_map(each).collect()
    }

    /// The holes of its triangles.
    fn cutouts(&self) -> Vec<Option<Cutout>> {
        let of = |uv: &[[f32; 2]; 3]| {
            self.test.map(|test| Cutout {
                tex_coords: uv.map(|c| c.map(f64::from).into()),
                layer: test.layer as usize,
                threshold: f64::from(test.threshold),
                wrap: test.wrap,
            })
        };
        self.tex_coords.iter().map(of).collect()
    }
}

const SIDE: u32 = 16;
const LAYERS: u32 = 3;

/// Random alpha of three pictures.
fn pictures() -> Vec<Vec<u8>> {
    let alpha = |layer, i| (255.0 * unit_float(hash2(i, 11 + layer))) as u8;
    (0..LAYERS)
        .map(|layer| (0..SIDE * SIDE).map(|i| alpha(layer, i)).collect())
        .collect()
}

/// The pictures' alpha in the green channel, other numbers in the others.
fn texture() -> wgpu::Texture {
    let texels: Vec<[u8; 4]> = pictures()
        .concat()
        .into_iter()
        .map(|alpha| [255 - alpha, alpha, 0, 255])
        .collect();
    layers_of(TextureFormat::Rgba8Unorm, bytemuck::cast_slice(&texels))
}

fn layers_of(format: TextureFormat, texels: &[u8]) -> wgpu::Texture {
    let gpu = pipelines::gpu();
    let size = wgpu::Extent3d {
        width: SIDE,
        height: SIDE,
        depth_or_array_layers: LAYERS,
    };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(texels.len() as u32 / (SIDE * LAYERS)),
        rows_per_image: Some(SIDE),
    };
    gpu.queue
        .write_texture(texture.as_image_copy(), texels, layout, size);
    texture
}

/// A sheet's buffers.
struct Buffers {
    positions: wgpu::Buffer,
    tex_coords: wgpu::Buffer,
    transforms: Option<wgpu::Buffer>,
}

/// Where texture coordinates are in a vertex of theirs.
const OFFSET: u64 = 12;
const STRIDE: u32 = 20;

impl Buffers {
    fn new(sheet: &Sheet) -> Self {
        let gpu = pipelines::gpu();
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let positions: Vec<[f32; 3]> = sheet
            .triangles
            .iter()
            .flatten()
            .map(|p| p.as_vec3().to_array())
            .collect();
        let mut words = vec![0x7fc0_0000; OFFSET as usize / 4];
        for [u, v] in sheet.tex_coords.iter().flatten() {
            let own = match sheet.format {
                TexCoordFormat::Float32x2 => [u.to_bits(), v.to_bits()],
                TexCoordFormat::Float16x2 => [u32::from(half(*u)) | (u32::from(half(*v)) << 16), 0],
                TexCoordFormat::Unorm16x2 => {
                    let unorm = |x: f32| (x * 65535.0).round() as u32;
                    [unorm(*u) | (unorm(*v) << 16), 0]
                }
            };
            words.extend(own);
            words.extend([0x7fc0_0000; STRIDE as usize / 4 - 2]);
        }
        Self {
            positions: gpu.buffer(&positions, usage),
            tex_coords: gpu.buffer(&words, usage),
            transforms: sheet.transforms.as_ref().map(|transforms| {
                let all: Vec<f32> = transforms.iter().flat_map(Mat4::to_cols_array).collect();
                gpu.buffer(&all, usage)
            }),
        }
    }

    fn mesh(&self, sheet: &Sheet, material: u32) -> Mesh<'_> {
        let count = 3 * sheet.triangles.len() as u32;
        Mesh {
            vertices: Vertices {
                buffer: &self.positions,
                offset: 0,
                stride: 12,
                format: PositionFormat::Float32x3,
                count,
            },
            indices: None,
            first: 0,
            count,
            base_vertex: 0,
            instances: self.transforms.as_ref().map(|buffer| Instances {
                buffer,
                offset: 0,
                stride: 64,
                format: TransformFormat::Mat4,
                count: sheet.matrices().len() as u32,
            }),
            material,
        }
    }

    fn test(&self, sheet: &Sheet) -> Option<AlphaTest<'_>> {
        let HoleTest {
            layer,
            threshold,
            wrap,
        } = sheet.test?;
        Some(AlphaTest {
            tex_coords: TexCoords {
                buffer: &self.tex_coords,
                offset: OFFSET,
                stride: STRIDE,
                format: sheet.format,
            },
            layer,
            threshold,
            wrap,
        })
    }
}

/// The bits of a half: for 0 and numbers in its normal range that it holds exactly.
fn half(x: f32) -> u16 {
    if x == 0.0 {
        return 0;
    }
    let bits = x.to_bits();
    let exponent = ((bits >> 23) & 0xff) - 112;
    (((bits >> 16) & 0x8000) | (exponent << 10) | ((bits >> 13) & 0x3ff)) as u16
}

/// Sheets, their buffers, and what a camera sees of them.
struct World {
    sheets: Vec<Sheet>,
    buffers: Vec<Buffers>,
    maps: wgpu::Texture,
    scene: Scene,
    shot: Shot,
}

impl World {
    fn new(sheets: Vec<Sheet>, camera: &Camera) -> Self {
        let placed: Vec<Vec<_>> = sheets.iter().map(Sheet::placed).collect();
        let all: Vec<[DVec3; 3]> = placed.concat().iter().map(|(t, _)| *t).collect();
        let mut scene = scene_of(&all, &scenes::cornell());
        let mut first_index = 0;
        scene.parts.clear();
        scene.materials.resize(sheets.len(), scene.materials[0]);
        for (material, placed) in placed.iter().enumerate() {
            let index_count = 3 * placed.len() as u32;
            scene.parts.push(Part {
                first_index,
                index_count,
                material: material as u32,
            });
            first_index += index_count;
        }
        scene.holes = Some(scenes::Holes {
            tex_coords: placed.concat().iter().flat_map(|(_, uv)| *uv).collect(),
            size: [SIDE; 2],
            maps: pictures(),
            tests: sheets.iter().map(|sheet| sheet.test).collect(),
        });
        Self {
            buffers: sheets.iter().map(Buffers::new).collect(),
            maps: texture(),
            shot: Shot::new(pipelines::gpu(), &scene, camera),
            scene,
            sheets,
        }
    }

    fn meshes(&self) -> Vec<Mesh<'_>> {
        let pairs = self.buffers.iter().zip(&self.sheets);
        (0..).zip(pairs).map(|(i, (b, s))| b.mesh(s, i)).collect()
    }

    fn tests(&self) -> Vec<Option<AlphaTest<'_>>> {
        let pairs = self.buffers.iter().zip(&self.sheets);
        pairs.map(|(buffers, sheet)| buffers.test(sheet)).collect()
    }

    /// One level: pieces, and the holes of each.
    fn flat(&self) -> (Senders, Vec<Option<Cutout>>) {
        let lab = alpha_lab();
        let meshes = self.meshes();
        let mut senders = lab.senders(&meshes, &self.shot.camera, &triangles(), ROOM);
        let mut encoder = lab.gpu.encoder();
        let tests = self.tests();
        let input = AlphaTestedInput {
            geometry: Geometry { meshes: &meshes },
            tests: self.alpha_tests(&tests),
            cloud: &senders.cloud,
            timestamps: None,
        };
        pipelines::bvh_builder(Primitives::AlphaTested)
            .record_alpha_tested(&lab.gpu.device, &mut encoder, &input, &mut senders.bounds)
            .expect("a hierarchy");
        lab.gpu.finish(encoder);
        let (cutouts, _) = alpha_test::of_scene(&self.scene).expect("holes");
        let origin = senders.cloud.origin();
        let whole = |triangle: u32| {
            let corner = |i: usize| {
                let p = self.scene.positions[3 * triangle as usize + i];
                DVec3::from(p.map(f64::from)) - origin
            };
            Triangle {
                a: corner(0),
                b: corner(1),
                c: corner(2),
            }
        };
        let pieces = senders.pieces.iter();
        let cutouts = pieces.map(|piece| {
            let own = cutouts[piece.triangle as usize]?;
            Some(own.of_piece(&whole(piece.triangle), &piece.corners))
        });
        let cutouts = cutouts.collect();
        (senders, cutouts)
    }

    fn alpha_tests<'a>(&'a self, tests: &'a [Option<AlphaTest<'a>>]) -> AlphaTests<'a> {
        AlphaTests {
            maps: (&self.maps).into(),
            channel: AlphaChannel::Green,
            meshes: tests,
        }
    }

    /// Compares occlusion and lit hits in one level with the mirror's.
    fn compare_flat(&self, name: &str, settings: &BouncedSettings) {
        let lab = alpha_lab();
        let (senders, cutouts) = self.flat();
        let whole = senders.pieces.len() == self.scene.triangle_count();
        let maps = alpha_test::of_scene(&self.scene).expect("holes").1;
        let holes = Holes {
            cutouts: &cutouts,
            maps: &maps,
        };
        let receivers = self.shot.receivers(senders.cloud.origin());
        let tracing = Tracing {
            receivers: &receivers,
            camera: &self.shot.camera,
            origin: senders.cloud.origin(),
            settings,
            sampling: Sampling::Cosine,
            pieces: &senders.pieces,
        };
        let view = lab.trace(&self.shot, &senders, None, settings, Sampling::Cosine);
        let found = lab.blocked(&view, settings);
        let mirror = alpha_test::hits(&tracing, &holes);
        let solid = tracing.hits();
        let differ = |hits: &[Option<_>]| odd_bits(&found, settings, hits);
        let seen = receivers.iter().flatten().count() * settings.rays_per_pixel as usize;
        let (odd, through) = (differ(&mirror), differ(&solid));
        println!(
            "{name}: of {seen} rays {odd} not as the mirror's, {through} through holes, {} pieces, whole {whole}",
            senders.pieces.len()
        );
        assert!(
            seen > 1000 && through > seen / 20,
            "{name}: {through} of {seen}"
        );
        assert!(
            odd as f64 <= ODD_RAYS * seen as f64,
            "{name}: {odd} of {seen}"
        );

        let lights = lights();
        let origin = senders.cloud.origin();
        let relative: Vec<Light> = lights.iter().map(|light| at(light, origin)).collect();
        let table = materials();
        let buffer = lab.gpu.buffer(&table, BufferUsages::STORAGE);
        let colors = self.lit(&senders, settings, (&buffer, &lights));
        let expected = alpha_test::lit(&tracing, &holes, &table, &relative);
        compare_colors(name, &colors, &expected, seen);
    }

    /// Packed colours of lit hits.
    fn lit(
        &self,
        senders: &Senders,
        settings: &BouncedSettings,
        (materials, lights): (&wgpu::Buffer, &[Light]),
    ) -> Vec<u32> {
        let lab = alpha_lab();
        let view = lab.view(
            &self.shot,
            Payload::LitRadiance,
            Sampling::Cosine,
            settings.rays_per_pixel,
        );
        let mut encoder = lab.gpu.encoder();
        let mut decoded = Decoded::of(&self.shot.camera);
        let origin = senders.cloud.origin();
        let camera = &self.shot.camera;
        let frame = decoded.frame(&mut encoder, self.shot.gbuffer(), camera, origin);
        let input = BouncedInput {
            radiance: HitRadiance::Lit(HitLighting { materials, lights }),
            ..BouncedInput::new(&frame, &senders.cloud, &senders.bounds)
        };
        lab.tracer(Payload::LitRadiance, Sampling::Cosine)
            .record(&lab.gpu.device, &mut encoder, &input, settings, &view)
            .expect("hits");
        lab.gpu.finish(encoder);
        lab.colors(&view, settings)
    }

    fn input<'a>(
        &'a self,
        meshes: &'a [Mesh<'a>],
        tests: &'a [Option<AlphaTest<'a>>],
    ) -> InstancedBvhInput<'a> {
        InstancedBvhInput {
            alpha_tests: Some(self.alpha_tests(tests)),
            ..InstancedBvhInput::new(Geometry { meshes }, &self.shot.camera)
        }
    }

    fn record(&self, bvh: &mut InstancedBvh, tests: &[Option<AlphaTest<'_>>]) {
        let lab = lab();
        let meshes = self.meshes();
        let mut encoder = lab.gpu.encoder();
        let input = self.input(&meshes, tests);
        builder()
            .record(&lab.gpu.device, &mut encoder, &input, bvh)
            .expect("a hierarchy");
        lab.gpu.finish(encoder);
    }

    fn blocked(&self, bvh: &InstancedBvh, settings: &BouncedSettings) -> Vec<u32> {
        let lab = lab();
        let camera = &self.shot.camera;
        let Viewport { width, height, .. } = camera.viewport();
        let pass = pipelines::bounced(&BouncedDescriptor {
            primitives: Primitives::AlphaTestedInstances,
            ..BouncedDescriptor::default()
        });
        let view = pass
            .create_view(&lab.gpu.device, width, height, settings.rays_per_pixel)
            .expect("a view");
        let mut encoder = lab.gpu.encoder();
        let mut decoded = Decoded::of(camera);
        let frame = decoded.frame(&mut encoder, self.shot.gbuffer(), camera, bvh.origin());
        let input = BouncedInput::of(&frame, BouncedScene::Instances(bvh));
        pass.record(&lab.gpu.device, &mut encoder, &input, settings, &view)
            .expect("hits");
        lab.gpu.finish(encoder);
        lab.blocked(&view, settings)
    }

    /// Compares occlusion in two levels with the mirror's.
    fn compare_instances(&self, name: &str, settings: &BouncedSettings) {
        let meshes = self.meshes();
        let mut bvh = builder()
            .create(&lab().gpu.device, &Geometry { meshes: &meshes })
            .expect("room");
        self.record(&mut bvh, &self.tests());
        let found = self.blocked(&bvh, settings);
        let own: Vec<_> = self
            .sheets
            .iter()
            .map(|sheet| (own_triangles(&sheet.triangles), sheet.cutouts()))
            .collect();
        let maps = alpha_test::of_scene(&self.scene).expect("holes").1;
        let (mut instances, mut holes) = (Vec::new(), Vec::new());
        for (sheet, ((anchor, own), cutouts)) in self.sheets.iter().zip(&own) {
            for m in sheet.matrices() {
                let mesh = (*anchor, own.as_slice());
                instances.push(Instance::new(&m, bvh.origin(), mesh, 0).expect("sound"));
                holes.push(Holes {
                    cutouts,
                    maps: &maps,
                });
            }
        }
        let receivers = self.shot.receivers(bvh.origin());
        let tracing = Tracing {
            receivers: &receivers,
            camera: &self.shot.camera,
            origin: bvh.origin(),
            settings,
            sampling: Sampling::Cosine,
            pieces: &[],
        };
        let mirror = alpha_test::hits_of_instances(&tracing, &instances, &holes);
        let odd = odd_bits(&found, settings, &mirror);
        let seen = receivers.iter().flatten().count() * settings.rays_per_pixel as usize;
        println!("{name}: of {seen} rays {odd} not as the mirror's in two levels");
        assert!(
            odd as f64 <= ODD_RAYS * seen as f64,
            "{name}: {odd} of {seen}"
        );
        // What changes by itself is built anew, and what does not is not.
        let mut solid = self.tests();
        for test in solid.iter_mut().flatten() {
            test.threshold = 0.0;
        }
        self.record(&mut bvh, &solid);
        let without = self.blocked(&bvh, settings);
        let count = |bits: &[u32]| bits.iter().map(|w| w.count_ones()).sum::<u32>();
        assert!(count(&without) > count(&found) + 100, "{name}");
        self.record(&mut bvh, &self.tests());
        assert_eq!(self.blocked(&bvh, settings), found, "{name}");
    }
}

fn builder() -> &'static InstancedBvhBuilder {
    pipelines::once(&"alpha tested", |gpu| {
        InstancedBvhBuilder::alpha_tested(&gpu.device).expect("pipelines")
    })
}

/// How many bits are not as hits are.
fn odd_bits<T>(bits: &[u32], settings: &BouncedSettings, hits: &[Option<T>]) -> usize {
    let rays = settings.rays_per_pixel as usize;
    let bit = |i: usize| bits[i / rays] >> (i % rays) & 1 != 0;
    (0..hits.len())
        .filter(|&i| bit(i) != hits[i].is_some())
        .count()
}

fn compare_colors(name: &str, colors: &[u32], expected: &[DVec3], seen: usize) {
    let mean = expected.iter().map(|c| c.max_element()).sum::<f64>() / expected.len() as f64;
    let farther = colors.iter().zip(expected).filter(|(found, expected)| {
        let off = (unpack_color(**found) - **expected).abs().max_element();
        assert!(off.is_finite(), "{name}: {found:x}");
        off > OFF * expected.max_element().max(1e-2 * mean)
    });
    let farther = farther.count();
    println!("{name}: {farther} colours of {seen} not as the mirror's");
    assert!(mean > 0.01, "{name}: black");
    assert!(
        farther as f64 <= ODD_COLORS * seen as f64,
        "{name}: {farther} of {seen}"
    );
}

fn lights() -> Vec<Light> {
    vec![
        Light::Directional {
            direction: DVec3::new(0.3, -1.0, 0.2),
            irradiance: [1.0, 0.5, 0.25],
        },
        Light::Point {
            position: DVec3::new(0.2, 1.9, 0.3),
            intensity: [0.5, 1.0, 2.0],
        },
    ]
}

fn at(light: &Light, origin: DVec3) -> Light {
    support::testing::rays::relative(light, origin)
}

fn materials() -> Vec<Material> {
    (0..4)
        .map(|i| Material {
            albedo: [0.2 + 0.2 * i as f32, 0.5, 0.9 - 0.2 * i as f32],
            ..Material::default()
        })
        .collect()
}

fn settings(rays_per_pixel: u32) -> BouncedSettings {
    BouncedSettings {
        rays_per_pixel,
        sky_radiance: [0.3, 0.2, 0.1],
        ..BouncedSettings::default()
    }
}

fn test_of(layer: u32, threshold: f32, wrap: [AlphaWrap; 2]) -> HoleTest {
    HoleTest {
        layer,
        threshold,
        wrap,
    }
}

fn camera() -> Camera {
    Camera::look_at(
        DVec3::new(0.4, 2.3, 2.8),
        DVec3::new(0.0, 0.3, 0.0),
        DVec3::Y,
        perspective(50.0, 1.5, 0.05),
        Viewport::full(36, 24),
    )
    .expect("a camera")
}

fn ground() -> Sheet {
    let corner = DVec3::new(-4.0, 0.0, 4.0);
    let edges = [corner, DVec3::X * 8.0, DVec3::NEG_Z * 8.0];
    sheet(
        edges,
        [[0.0; 2], [1.0; 2]],
        None::<HoleTest>,
        TexCoordFormat::default(),
    )
}

/// Three sheets over a ground, with coordinates of each kind that leave the pictures.
fn sheets() -> World {
    use AlphaWrap::{ClampToEdge, MirrorRepeat, Repeat};
    let over = |x: f64, y: f64, side: f64| {
        let corner = DVec3::new(x, y, 0.9);
        [corner, DVec3::X * side, DVec3::new(0.0, 0.4, -1.8)]
    };
    World::new(
        vec![
            ground(),
            sheet(
                over(-1.6, 0.3, 1.0),
                [[-1.25, -3.5], [2.75, 1.5]],
                test_of(1, 0.45, [Repeat, MirrorRepeat]),
                TexCoordFormat::Float32x2,
            ),
            sheet(
                over(-0.5, 0.4, 1.0),
                [[-0.5, 0.25], [1.5, 0.75]],
                test_of(2, 0.5, [ClampToEdge, Repeat]),
                TexCoordFormat::Float16x2,
            ),
            sheet(
                over(0.6, 0.5, 1.1),
                [[0.0, 0.0], [1.0, 1.0]],
                test_of(0, 0.55, [MirrorRepeat, ClampToEdge]),
                TexCoordFormat::Unorm16x2,
            ),
        ],
        &camera(),
    )
}

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

/// The noise of the truth taken out: RMSE, and steps of the slowest rays per pixel.
fn occlusion(scene: &Scene, rays: u32) -> [f64; 2] {
    let gpu = pipelines::gpu();
    let camera = camera_of(scene, 0, [72, 48]);
    let primitives = match scene.holes {
        Some(_) => Primitives::AlphaTested,
        None => Primitives::Triangles,
    };
    let lab = Lab::of(primitives);
    let shot = Shot::new(gpu, scene, &camera);
    let meshes = shot.buffers.meshes();
    let mut senders = lab.senders(&meshes, &camera, &triangles(), ROOM);
    let tests = shot.buffers.tests();
    if let Some(tests) = shot.buffers.alpha_tests(&tests) {
        let mut encoder = gpu.encoder();
        let input = AlphaTestedInput {
            geometry: Geometry { meshes: &meshes },
            tests,
            cloud: &senders.cloud,
            timestamps: None,
        };
        pipelines::bvh_builder(primitives)
            .record_alpha_tested(&gpu.device, &mut encoder, &input, &mut senders.bounds)
            .expect("a hierarchy");
        gpu.finish(encoder);
    }
    let rays = RaySettings::new(rays, Payload::Occlusion);
    let traced = rays.bounced(scene.ao_radius);
    let view = lab.trace(&shot, &senders, None, &traced, Sampling::Cosine);
    let resolver = lab.reconstructor(Payload::Occlusion, Sampling::Cosine, false);
    let filter: HitResolverSettings = rays.filter;
    let picture = lab.reconstruct(resolver, &shot, &view, &filter);
    let receivers: Vec<_> = shot.pixels.iter().map(|p| p.map(|p| p.receiver)).collect();
    let tracer: &Tracer = &shot.tracer;
    let reach = f64::from(scene.ao_radius);
    let truth = tracer.ambient_occlusion_image(&receivers, reach, 256, 1, false);
    let values: Vec<f32> = picture.iter().map(|p| p[0]).collect();
    let (rmse, bias) = support::stage::compare(&values, &truth);
    [rmse, bias]
}

/// The bar of alpha-tested grass: as near to its truth as the same blades cut out in triangles are to theirs, plus 0.01.
#[test]
fn errors_of_grass_in_pictures_are_near_the_truth_as_in_triangles() {
    let [cards, card_bias] = occlusion(&scenes::grass(), 16);
    let [blades, blade_bias] = occlusion(&scenes::grass_cut_out(), 16);
    println!("cards {cards:.4} ({card_bias:+.4}), blades {blades:.4} ({blade_bias:+.4})");
    assert!(blades > 0.005 && blades < 0.08, "{blades}");
    assert!(cards <= blades + 0.01, "{cards} and {blades}");
}

/// Whether both lawns are one: rays from the same places meet the same.
#[test]
fn both_lawns_are_the_same() {
    let [cards, blades] = [scenes::grass(), scenes::grass_cut_out()];
    let tracers = [&cards, &blades].map(|scene| Tracer::of_scene(scene).expect("triangles"));
    let mut differ = 0;
    for i in 0..4000 {
        let draw = |salt| unit_float(hash2(i, salt));
        let origin = DVec3::new(
            1.6 * draw(1) - 0.8,
            0.02 + 0.2 * draw(2),
            1.6 * draw(3) - 0.8,
        );
        let direction = DVec3::new(draw(4) - 0.5, draw(5) - 0.5, draw(6) - 0.5).normalize();
        let [a, b] = [0, 1].map(|t: usize| {
            let hit = tracers[t].first_hit(origin, direction, 0.0, f64::INFINITY);
            hit.map_or(f64::INFINITY, |hit| hit.t)
        });
        differ += usize::from((a - b).abs() > 1e-6 && a != b);
    }
    // Alpha is rounded to 1/255, a hundredth of a texel, and tips are rounder.
    println!("{differ} of 4000 rays differ");
    assert!(differ < 40, "{differ}");
}

/// Bindings of the shaders of ambient occlusion alone, by number, and sizes of what it has: as they were before triangles could
/// have holes.
#[test]
fn nothing_of_it_is_there_where_unused() {
    let all = shaders(&AmbientOcclusion::default().effect()).expect("shaders");
    let bindings = |name: &str| {
        let shader = all.iter().find(|s| s.name == name).expect(name);
        let module = naga::front::wgsl::parse_str(&shader.source).expect("a module");
        let mut numbers: Vec<u32> = module
            .global_variables
            .iter()
            .filter_map(|(_, v)| v.binding.map(|b| b.binding))
            .collect();
        numbers.sort_unstable();
        numbers
    };
    assert_eq!(
        bindings("bounced_z_buffer occlusion"),
        [0, 1, 2, 3, 4, 5, 9, 11]
    );
    assert_eq!(
        bindings("bounced_z_buffer occlusion alpha tested"),
        [0, 1, 2, 3, 4, 5, 9, 11, 35]
    );
    assert_eq!(bindings("bvh_collapse"), [0, 1, 2, 3, 4, 5, 6]);
    assert_eq!(
        bindings("instanced_bvh"),
        (0..12).collect::<Vec<_>>(),
        "of meshes"
    );
    for shader in &all {
        let own = shader.name.contains("alpha tested") || shader.name == "alpha_test";
        let is_code = |line: &&str| !line.trim_start().starts_with("//");
        let code: Vec<&str> = shader.source.lines().filter(is_code).collect();
        let code = code.join("\n");
        for word in ["alpha_maps", "cutout", "HAS_HOLES"] {
            assert!(own || !code.contains(word), "{} has {word}", shader.name);
        }
    }
    // 151 bytes a piece, of which the textures are 16 * (3 + 5 * 8 / 21); with holes 64 more.
    let gpu = pipelines::gpu();
    let cloud = pipelines::surfelizer()
        .create_cloud(&gpu.device, AMPLE)
        .expect("a cloud");
    let bytes = |primitives| {
        let builder = pipelines::bvh_builder(primitives);
        let bvh = builder.create(&gpu.device, &cloud).expect("room");
        bvh.memory_bytes() as f64 / f64::from(AMPLE.pieces)
    };
    let (plain, holed) = (bytes(Primitives::Triangles), bytes(Primitives::AlphaTested));
    println!("{plain:.1} bytes a triangle, {holed:.1} with holes");
    assert!((plain - 151.0).abs() < 2.0, "{plain}");
    assert!((holed - plain - 64.0).abs() < 2.0, "{holed}");
}

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

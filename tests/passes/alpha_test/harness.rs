//! What is traced of sheets, by GPU and by mirror.

use deep_screen_space::{
    AlphaChannel, AlphaTest, AlphaTestedInput, AlphaTests, AlphaWrap, BouncedDescriptor,
    BouncedInput, BouncedScene, BouncedSettings, Camera, CloudCapacity, Geometry, HitLighting,
    HitRadiance, InstancedBvh, InstancedBvhBuilder, InstancedBvhInput, Light, Material, Mesh,
    Payload, Primitives, Sampling, TexCoordFormat, Viewport,
    glam::DVec3,
    reference::{
        alpha_test::{self, Cutout, Holes},
        bounced_z_buffer::Tracing,
        instanced_bvh::{Instance, own_triangles},
        packing::unpack_color,
        surfelizer::Triangle,
    },
    scenes::{self, Part, Scene},
    wgpu::{self, BufferUsages},
};

use support::{
    raster::perspective,
    testing::{
        frames::Decoded,
        pipelines,
        rays::{Lab, Senders, lab, scene_of, triangles},
        shot::Shot,
    },
};

use super::sheets::{Buffers, SIDE, Sheet, ground, pictures, sheet, test_of, texture};

/// Room for all of these.
pub const ROOM: CloudCapacity = CloudCapacity {
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

pub fn alpha_lab() -> Lab {
    Lab::of(Primitives::AlphaTested)
}

/// Sheets, their buffers, and what a camera sees of them.
pub struct World {
    pub sheets: Vec<Sheet>,
    pub buffers: Vec<Buffers>,
    pub maps: wgpu::Texture,
    pub scene: Scene,
    pub shot: Shot,
}

impl World {
    pub fn new(sheets: Vec<Sheet>, camera: &Camera) -> Self {
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

    pub fn meshes(&self) -> Vec<Mesh<'_>> {
        let pairs = self.buffers.iter().zip(&self.sheets);
        (0..).zip(pairs).map(|(i, (b, s))| b.mesh(s, i)).collect()
    }

    pub fn tests(&self) -> Vec<Option<AlphaTest<'_>>> {
        let pairs = self.buffers.iter().zip(&self.sheets);
        pairs.map(|(buffers, sheet)| buffers.test(sheet)).collect()
    }

    /// One level: pieces, and the holes of each.
    pub fn flat(&self) -> (Senders, Vec<Option<Cutout>>) {
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
            Some(own.of_piece(&whole(piece.triangle), piece))
        });
        let cutouts = cutouts.collect();
        (senders, cutouts)
    }

    pub fn alpha_tests<'a>(&'a self, tests: &'a [Option<AlphaTest<'a>>]) -> AlphaTests<'a> {
        AlphaTests {
            maps: (&self.maps).into(),
            channel: AlphaChannel::Green,
            meshes: tests,
        }
    }

    /// Compares occlusion and lit hits in one level with the mirror's.
    pub fn compare_flat(&self, name: &str, settings: &BouncedSettings) {
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

    pub fn input<'a>(
        &'a self,
        meshes: &'a [Mesh<'a>],
        tests: &'a [Option<AlphaTest<'a>>],
    ) -> InstancedBvhInput<'a> {
        InstancedBvhInput {
            alpha_tests: Some(self.alpha_tests(tests)),
            ..InstancedBvhInput::new(Geometry { meshes }, &self.shot.camera)
        }
    }

    pub fn record(&self, bvh: &mut InstancedBvh, tests: &[Option<AlphaTest<'_>>]) {
        let lab = lab();
        let meshes = self.meshes();
        let mut encoder = lab.gpu.encoder();
        let input = self.input(&meshes, tests);
        builder()
            .record(&lab.gpu.device, &mut encoder, &input, bvh)
            .expect("a hierarchy");
        lab.gpu.finish(encoder);
    }

    pub fn blocked(&self, bvh: &InstancedBvh, settings: &BouncedSettings) -> Vec<u32> {
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
    pub fn compare_instances(&self, name: &str, settings: &BouncedSettings) {
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

pub fn builder() -> &'static InstancedBvhBuilder {
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

pub fn at(light: &Light, origin: DVec3) -> Light {
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

pub fn settings(rays_per_pixel: u32) -> BouncedSettings {
    BouncedSettings {
        rays_per_pixel,
        sky_radiance: [0.3, 0.2, 0.1],
        ..BouncedSettings::default()
    }
}

pub fn camera() -> Camera {
    Camera::look_at(
        DVec3::new(0.4, 2.3, 2.8),
        DVec3::new(0.0, 0.3, 0.0),
        DVec3::Y,
        perspective(50.0, 1.5, 0.05),
        Viewport::full(36, 24),
    )
    .expect("a camera")
}

/// Three sheets over a ground, with coordinates of each kind that leave the pictures.
pub fn sheets() -> World {
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

//! The `SurfelGatherer`: GPU against the f64 mirror, white furnaces, energy from bounce to bounce, and what it refuses.

use std::f64::consts::PI;

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, Camera, CloudCapacity, Emitters,
    EmittersBuilder, EmittersInput, HitLighting, HitRadiance, Material, Mesh, Payload, Placement,
    Primitives, Sampling, SurfelGatherer, SurfelGathererInput, SurfelGathererSettings,
    SurfelRadiance, SurfelSenders, SurfelSource, SurfelizerSettings,
    glam::DVec3,
    reference::{
        bounced_z_buffer::{Senders as PixelSenders, Tracing},
        emitters as mirror_of_emitters,
        packing::unpack_color,
        surfel_gatherer as mirror,
        surfelizer::area_root,
    },
    scenes::{self, Scene},
    wgpu,
};
use support::scene::SceneBuffers;
use support::testing::frames::Decoded;
use support::testing::pipelines;
use support::testing::rays::{Senders, lab, lights, moved, relative, scene_of, triangles};
use support::testing::refusals::refused;
use support::testing::shot::{Shot, camera_of};

/// Off by more than f32's rounding are surfels of which a ray met another one than in f64: at most `ODD` of them.
const OFF: f64 = 1e-4;
/// Share of surfels with such a ray: see `ODD_RAYS` of the bounced z-buffer, times the rays of both sides of a surfel. Of few
/// surfels three may have one.
const ODD: f64 = 0.02;

const SMALL: CloudCapacity = CloudCapacity {
    surfels: 1 << 13,
    pieces: 1 << 13,
    triangles: 1 << 13,
};

fn gatherer() -> &'static SurfelGatherer {
    pipelines::once(&(), |gpu| {
        SurfelGatherer::new(&gpu.device).expect("pipelines")
    })
}

/// The same for rays that are aimed at what shines.
fn aiming() -> &'static SurfelGatherer {
    pipelines::once(&"aiming", |gpu| {
        SurfelGatherer::with_emitters(&gpu.device, Primitives::Triangles).expect("pipelines")
    })
}

fn upload(sent: &[SurfelRadiance]) -> wgpu::Buffer {
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    lab().gpu.buffer(sent, usage)
}

/// Coarse surfels on the caller's own triangles.
fn coarse() -> SurfelizerSettings {
    SurfelizerSettings {
        radius_pixels: 4.0,
        ..triangles()
    }
}

/// A cloud and its surfels.
struct Case {
    senders: Senders,
    sources: Vec<SurfelSource>,
    materials: Vec<Material>,
}

impl Case {
    fn new(scene: &Scene, camera: &Camera, capacity: CloudCapacity) -> Self {
        let buffers = SceneBuffers::new(lab().gpu, scene);
        Self::of(&buffers.meshes(), scene.material_table(), camera, capacity)
    }

    fn of(
        meshes: &[Mesh<'_>],
        materials: Vec<Material>,
        camera: &Camera,
        capacity: CloudCapacity,
    ) -> Self {
        let lab = lab();
        let senders = lab.senders(meshes, camera, &coarse(), capacity);
        let mut sources: Vec<SurfelSource> = lab.gpu.read_buffer(senders.cloud.sources());
        sources.truncate(senders.counts.stored as usize);
        Self {
            senders,
            sources,
            materials,
        }
    }

    /// What each surfel sends of itself.
    fn emitted(&self) -> Vec<SurfelRadiance> {
        let mut sent = vec![SurfelRadiance::default(); self.capacity().surfels as usize];
        for (sent, source) in sent.iter_mut().zip(&self.sources) {
            let material = self.materials[source.material as usize];
            sent.front = material.emission.map(|c| c / PI as f32);
        }
        sent
    }

    fn capacity(&self) -> CloudCapacity {
        self.senders.cloud.capacity()
    }

    /// The area of each surfel's triangle.
    fn areas(&self) -> Vec<f64> {
        let area = |source: &SurfelSource| {
            let piece = self.senders.pieces[source.piece as usize];
            area_root(piece.corners).powi(2) / f64::from(1 << (piece.shape & 0xfff))
        };
        self.sources.iter().map(area).collect()
    }

    /// What of the cloud shines by a table of materials.
    fn emitters(&self, materials: &wgpu::Buffer) -> Emitters {
        let builder = pipelines::once(&(), |gpu| {
            EmittersBuilder::new(&gpu.device).expect("pipelines")
        });
        let (gpu, cloud) = (lab().gpu, &self.senders.cloud);
        let emitters = builder.create(&gpu.device, cloud).expect("room");
        let mut encoder = gpu.encoder();
        let input = EmittersInput::new(cloud, materials);
        builder
            .record(&gpu.device, &mut encoder, &input, &emitters)
            .expect("emitters");
        gpu.finish(encoder);
        emitters
    }

    /// What the surfels reflect of what those of another cloud send.
    fn gather_from(
        &self,
        from: &Self,
        sent: &wgpu::Buffer,
        settings: &SurfelGathererSettings,
    ) -> wgpu::Buffer {
        let lab = lab();
        let device = &lab.gpu.device;
        let materials = lab.gpu.buffer(&self.materials, wgpu::BufferUsages::STORAGE);
        let radiance = gatherer()
            .create_radiance(device, &self.senders.cloud)
            .expect("room");
        // What was there before must not matter.
        let old = vec![f32::NAN; radiance.size() as usize / 4];
        lab.gpu
            .queue
            .write_buffer(&radiance, 0, bytemuck::cast_slice(&old));
        let senders = SurfelSenders {
            cloud: &from.senders.cloud,
            bvh: &from.senders.bounds,
            radiance: sent,
        };
        let emitters = (settings.emitter_samples > 0).then(|| from.emitters(&materials));
        let input = SurfelGathererInput {
            cloud: &self.senders.cloud,
            emitters: emitters.as_ref(),
            ..SurfelGathererInput::new(senders, &materials, &radiance)
        };
        let mut encoder = lab.gpu.encoder();
        let gatherer = emitters.as_ref().map_or_else(gatherer, |_| aiming());
        gatherer
            .record(device, &mut encoder, &input, settings)
            .expect("light");
        lab.gpu.finish(encoder);
        radiance
    }

    fn gather(&self, sent: &wgpu::Buffer, settings: &SurfelGathererSettings) -> wgpu::Buffer {
        self.gather_from(self, sent, settings)
    }

    fn add(&self, onto: &wgpu::Buffer, more: &wgpu::Buffer) {
        let lab = lab();
        let mut encoder = lab.gpu.encoder();
        let cloud = &self.senders.cloud;
        gatherer()
            .add(&lab.gpu.device, &mut encoder, cloud, onto, more)
            .expect("light");
        lab.gpu.finish(encoder);
    }

    fn read(&self, radiance: &wgpu::Buffer) -> Vec<SurfelRadiance> {
        let mut all: Vec<SurfelRadiance> = lab().gpu.read_buffer(radiance);
        all.truncate(self.sources.len());
        all
    }

    /// Compares with the mirror what is gathered of motley surfels.
    fn compare(&self, name: &str, from: &Self, settings: &SurfelGathererSettings) {
        let (_, sent) = lab().motley(&from.senders);
        self.compare_sent(name, from, &sent, settings);
    }

    /// The same of what these send.
    fn compare_sent(
        &self,
        name: &str,
        from: &Self,
        sent: &[SurfelRadiance],
        settings: &SurfelGathererSettings,
    ) {
        let found = self.read(&self.gather_from(from, &upload(sent), settings));
        let materials = lab()
            .gpu
            .buffer(&self.materials, wgpu::BufferUsages::STORAGE);
        let table = from.emitters(&materials);
        let mut before: Vec<u32> = lab().gpu.read_texture(table.table().texture(), 0);
        before.truncate(from.senders.pieces.len() + 1);
        let emitters = mirror_of_emitters::Emitters { before };
        let expected = mirror::Gathering {
            emitters: (settings.emitter_samples > 0).then_some(&emitters),
            sources: &self.sources,
            own_pieces: &self.senders.pieces,
            materials: &self.materials,
            senders: mirror::Senders {
                pieces: &from.senders.pieces,
                capacity: from.capacity(),
                radiance: sent,
            },
            shift: self.senders.cloud.origin() - from.senders.cloud.origin(),
            settings,
        }
        .gather();
        assert_eq!(found.len(), expected.len(), "{name}");
        let mut odd = 0;
        let mut lit = 0;
        for (found, expected) in found.iter().zip(&expected) {
            let off = |found: [f32; 3], expected: DVec3| {
                let found = DVec3::from(found.map(f64::from));
                assert!(found.is_finite(), "{name}: {found}");
                (found - expected).abs().max_element() > OFF * expected.max_element()
            };
            let is_odd = off(found.front, expected.front) || off(found.back, expected.back);
            odd += usize::from(is_odd);
            lit += usize::from(expected.front != DVec3::ZERO);
        }
        println!("{name}: {odd} of {} differ, {lit} lit", found.len());
        assert!(lit > 0, "{name}: all is dark");
        assert!(
            odd as f64 <= (ODD * found.len() as f64).max(3.0),
            "{name}: {odd} of {} differ",
            found.len()
        );
    }
}

fn few() -> SurfelGathererSettings {
    SurfelGathererSettings {
        rays_per_surfel: 4,
        sky_radiance: [0.3, 0.2, 0.1],
        ..SurfelGathererSettings::default()
    }
}

#[test]
fn light_is_the_mirrors() {
    for (scene, size) in [
        (scenes::cornell(), [32, 32]),
        (scenes::closed_room(), [16, 12]),
    ] {
        let case = Case::new(&scene, &camera_of(&scene, 0, size), SMALL);
        case.compare(scene.name, &case, &few());
        let settings = SurfelGathererSettings {
            backs: false,
            most_albedo: 0.5,
            frame: 3,
            rays_per_surfel: 3,
            ..few()
        };
        case.compare(&format!("{} fronts", scene.name), &case, &settings);
    }
    // Aimed at what shines, which is all of the box, the lamp most: each hit counts by its weight.
    let scene = scenes::cornell();
    let mut case = Case::new(&scene, &camera_of(&scene, 0, [32, 32]), SMALL);
    for material in &mut case.materials {
        material.emission = material.emission.map(|c| c + 0.5);
    }
    let settings = SurfelGathererSettings {
        emitter_samples: 3,
        sky_radiance: [0.0; 3],
        ..few()
    };
    case.compare_sent("aimed", &case, &case.emitted(), &settings);
    // With less room than surfels.
    let scene = scenes::cornell();
    let camera = camera_of(&scene, 0, [32, 32]);
    let crowded = CloudCapacity {
        surfels: 30,
        ..SMALL
    };
    let case = Case::new(&scene, &camera, crowded);
    assert!(case.senders.counts.overflow() > 0);
    case.compare("crowded", &case, &few());
    // The light of a frame before, which was seen from elsewhere.
    let case = Case::new(&scene, &camera, SMALL);
    let before = Case::new(&scene, &camera_of(&scene, 1, [24, 24]), SMALL);
    assert!(case.senders.cloud.origin() != before.senders.cloud.origin());
    case.compare("before", &before, &few());
}

/// Small, large and far away.
#[test]
fn extremes_are_the_mirrors() {
    let base = scenes::cornell();
    for (scale, shift) in [
        (1e-4, DVec3::ZERO),
        (1e5, DVec3::ZERO),
        (1.0, DVec3::new(1e5, -2e4, 3e4)),
    ] {
        let scene = moved(&base, scale, shift);
        let case = Case::new(&scene, &camera_of(&scene, 0, [16, 16]), SMALL);
        case.compare(&format!("scale {scale} shift {shift}"), &case, &few());
    }
}

/// A closed box, 12 triangles, whose fronts look inward, and a camera within.
fn furnace(albedo: f32, emission: f32) -> Case {
    let corner = |i: usize| {
        let side = |bit: usize| if i & bit == 0 { -1.0 } else { 1.0 };
        DVec3::new(side(1), side(2), side(4))
    };
    let quads = [
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 5, 7, 3],
        [0, 1, 3, 2],
        [4, 6, 7, 5],
    ];
    let triangles: Vec<[DVec3; 3]> = quads
        .iter()
        .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
        .map(|face| face.map(corner))
        .collect();
    let mut base = scenes::cornell();
    for view in &mut base.views {
        view.eye = [0.5, 0.25, 0.125];
        view.target = [-1.0, 0.0, 0.0];
        view.near = 0.05;
    }
    let scene = scene_of(&triangles, &base);
    let camera = camera_of(&scene, 0, [16, 16]);
    let buffers = SceneBuffers::new(lab().gpu, &scene);
    let material = Material {
        albedo: [albedo, albedo / 2.0, 0.0],
        emission: [emission; 3],
        ..Material::default()
    };
    let materials = vec![material; scene.material_table().len()];
    Case::of(&buffers.meshes(), materials, &camera, SMALL)
}

/// Rays towards emitters and those by chance bring together what many by chance bring, within three times what frames differ by,
/// and differ less than as many by chance do.
#[test]
fn aimed_light_is_what_comes_by_chance() {
    let scene = scenes::cornell();
    // Single surfels' rays start from few places, and only of many all.
    let case = Case::new(&scene, &camera_of(&scene, 0, [112, 112]), SMALL);
    let sent = upload(&case.emitted());
    let areas = case.areas();
    // What all surfels reflect in a frame, its mean and how far that is known.
    let power = |rays_per_surfel, emitter_samples, frames: u32| {
        let powers: Vec<f64> = (0..frames)
            .map(|frame| {
                let settings = SurfelGathererSettings {
                    rays_per_surfel,
                    emitter_samples,
                    backs: false,
                    frame,
                    ..SurfelGathererSettings::default()
                };
                let light = case.read(&case.gather(&sent, &settings));
                let each = light.iter().zip(&areas);
                each.map(|(sent, area)| f64::from(sent.front[0]) * area)
                    .sum()
            })
            .collect();
        let n = f64::from(frames);
        let mean = powers.iter().sum::<f64>() / n;
        let squares: f64 = powers.iter().map(|power| (power - mean).powi(2)).sum();
        [mean, (squares / (n - 1.0) / n).sqrt()]
    };
    let (aimed, plain) = (power(13, 3, 16), power(16, 0, 16));
    let many = power(64, 0, 24);
    println!("aimed {aimed:?}, by chance {plain:?}, {many:?}");
    let noise = aimed[1].hypot(many[1]);
    assert!(noise < 0.02 * many[0], "{noise} of {}", many[0]);
    assert!((aimed[0] - many[0]).abs() <= 3.0 * noise, "{noise}");
    assert!(aimed[1] < 0.5 * plain[1], "{} of {}", aimed[1], plain[1]);
}

/// In a closed box of albedo ρ that emits the radiosity E everywhere, the radiosity after n bounces is
/// E (1 + ρ + … + ρⁿ), and with ever more E / (1 − ρ).
#[test]
fn white_furnaces_glow() {
    let emission = 2.0;
    let settings = SurfelGathererSettings {
        rays_per_surfel: 4,
        backs: false,
        ..SurfelGathererSettings::default()
    };
    for (albedo, bounces) in [(0.5_f32, 8), (0.8, 20)] {
        let case = furnace(albedo, emission);
        let own = upload(&case.emitted());
        let mut sent = upload(&case.emitted());
        for bounce in 1..=bounces {
            let more = case.gather(&sent, &settings);
            case.add(&more, &own);
            sent = more;
            if bounce % 4 != 0 {
                continue;
            }
            let radiance = case.read(&sent);
            let (mut sum, mut farthest) = (DVec3::ZERO, 0.0_f64);
            let rho = DVec3::new(f64::from(albedo), f64::from(albedo) / 2.0, 0.0);
            let limit = f64::from(emission) / (1.0 - rho);
            let expected = limit * (1.0 - rho.powf(f64::from(bounce + 1)));
            for surfel in &radiance {
                let radiosity = DVec3::from(surfel.front.map(f64::from)) * PI;
                farthest = farthest.max(((radiosity - expected) / expected).abs().max_element());
                sum += radiosity;
                assert_eq!(surfel.back, [0.0; 3]);
            }
            let mean = sum / radiance.len() as f64;
            let off = ((mean - limit) / limit).abs().max_element();
            println!("albedo {albedo}, {bounce} bounces: farthest {farthest:.1e}, limit {off:.4}");
            // Nothing leaks, so that all rays of all surfels bring the same: what is left is f32's rounding.
            assert!(farthest < 1e-5, "albedo {albedo}, {bounce}: {farthest}");
            assert!(bounce < bounces || off < 0.02, "albedo {albedo}: {off}");
        }
    }
}

/// No surfel is brighter than the brightest of the bounce before times the largest albedo, whatever rays find; nor is the power
/// of all of them, but for noise.
#[test]
fn energy_does_not_grow() {
    for (scene, size) in [
        (scenes::cornell(), [32, 32]),
        (scenes::closed_room(), [32, 24]),
    ] {
        let case = Case::new(&scene, &camera_of(&scene, 0, size), SMALL);
        let areas = case.areas();
        let most = case.materials.iter().flat_map(|m| m.albedo);
        let most = f64::from(most.fold(0.0_f32, f32::max));
        let mut sent = upload(&case.emitted());
        let sums = |radiance: &[SurfelRadiance]| {
            let sides =
                |s: &SurfelRadiance| [s.front, s.back].map(|c| DVec3::from(c.map(f64::from)));
            let brightest = radiance
                .iter()
                .flat_map(sides)
                .fold(DVec3::ZERO, DVec3::max);
            let power = radiance.iter().zip(&areas);
            let power = power.map(|(s, area)| sides(s).into_iter().sum::<DVec3>() * *area * PI);
            (brightest, power.sum::<DVec3>())
        };
        let (mut brightest, mut power) = sums(&case.emitted()[..areas.len()]);
        for bounce in 1..=6 {
            sent = case.gather(&sent, &SurfelGathererSettings::default());
            let (now, watts) = sums(&case.read(&sent));
            println!("{} bounce {bounce}: {now:.4}, {watts:.3} W", scene.name);
            assert!(now.min_element() > 0.0, "{}: dark", scene.name);
            let bound = brightest * (most * (1.0 + 1e-6));
            assert!(
                now.cmple(bound).all(),
                "{}: {now} after {brightest}",
                scene.name
            );
            assert!(
                watts.cmplt(power).all(),
                "{}: {watts} after {power}",
                scene.name
            );
            (brightest, power) = (now, watts);
        }
    }
}

/// Nothing is reflected without surfels, without light and without albedo; what is no number counts as 0, and what is brightest
/// stays finite.
#[test]
fn extremes_are_finite() {
    let scene = scenes::cornell();
    let camera = camera_of(&scene, 0, [16, 16]);
    let mut case = Case::new(&scene, &camera, SMALL);
    let settings = SurfelGathererSettings::default();
    let dark = upload(&vec![SurfelRadiance::default(); 1 << 13]);
    let bright = SurfelRadiance {
        front: [1e18, f32::INFINITY, f32::NAN],
        back: [f32::NEG_INFINITY, -1.0, 3e38],
        ..SurfelRadiance::default()
    };
    let bright = upload(&vec![bright; 1 << 13]);
    for (albedo, sent, expected) in [
        ([1.0; 3], &dark, Some([0.0; 3])),
        ([0.0; 3], &bright, Some([0.0; 3])),
        ([f32::NAN, f32::NEG_INFINITY, -1.0], &bright, Some([0.0; 3])),
        ([1.0; 3], &bright, None),
        ([3e38; 3], &bright, None),
    ] {
        for material in &mut case.materials {
            material.albedo = albedo;
        }
        let mut brightest = 0.0_f32;
        for surfel in case.read(&case.gather(sent, &settings)) {
            for side in [surfel.front, surfel.back] {
                assert!(side.iter().all(|c| (0.0..=1e18).contains(c)), "{side:?}");
                assert!(expected.is_none_or(|e| side == e), "{albedo:?}: {side:?}");
                brightest = side.into_iter().fold(brightest, f32::max);
            }
        }
        assert_eq!(brightest > 0.0, expected.is_none(), "{albedo:?}");
    }
    let sum = upload(&vec![
        SurfelRadiance {
            front: [2.0; 3],
            back: [1e18; 3],
            ..SurfelRadiance::default()
        };
        1 << 13
    ]);
    case.add(&sum, &bright);
    for surfel in case.read(&sum) {
        assert_eq!(surfel.front, [1e18, 2.0, 2.0]);
        assert_eq!(surfel.back, [1e18; 3]);
    }
    // No surfels, no triangles: nothing is written, and nothing breaks.
    let empty = Case::of(&[], scene.material_table(), &camera, SMALL);
    let written = empty.gather(&dark, &settings);
    let all: Vec<SurfelRadiance> = lab().gpu.read_buffer(&written);
    assert!(all.iter().all(|s| s.front[0].is_nan()));
    let sky = case.gather_from(&empty, &dark, &few());
    assert!(case.read(&sky).iter().all(|s| {
        s.front
            .iter()
            .zip([0.3, 0.2, 0.1])
            .all(|(a, b)| (a / b - 1.0).abs() < 1e-5)
    }));
}

/// Hits that are lit where they are, and bring what their surfels gathered besides.
#[test]
fn hits_are_the_mirrors() {
    let lab = lab();
    let device = &lab.gpu.device;
    for (scene, size) in [
        (scenes::cornell(), [24, 24]),
        (scenes::closed_room(), [17, 11]),
    ] {
        let camera = camera_of(&scene, 0, size);
        let shot = Shot::new(lab.gpu, &scene, &camera);
        let case = Case::new(&scene, &camera, SMALL);
        let (gathered, sent) = lab.motley(&case.senders);
        let settings = BouncedSettings {
            rays_per_pixel: 4,
            sky_radiance: [0.3, 0.2, 0.1],
            ..BouncedSettings::default()
        };
        let tracer = lab.tracer(Payload::LitAndGathered, Sampling::Cosine);
        let view = lab.view(&shot, Payload::LitAndGathered, Sampling::Cosine, 4);
        let all = lights(&scene, 1.0, DVec3::ZERO);
        let origin = case.senders.cloud.origin();
        let mut encoder = lab.gpu.encoder();
        let mut decoded = Decoded::of(&camera);
        let frame = decoded.frame(&mut encoder, shot.gbuffer(), &camera, origin);
        let input = BouncedInput {
            radiance: HitRadiance::LitAndGathered {
                lighting: HitLighting {
                    materials: &shot.buffers.materials,
                    lights: &all,
                },
                gathered: &gathered,
            },
            ..BouncedInput::new(&frame, &case.senders.cloud, &case.senders.bounds)
        };
        tracer
            .record(device, &mut encoder, &input, &settings, &view)
            .expect("hits");
        lab.gpu.finish(encoder);
        let near: Vec<_> = all.iter().map(|l| relative(l, origin)).collect();
        let receivers = shot.receivers(origin);
        let expected = Tracing {
            receivers: &receivers,
            camera: &camera,
            origin,
            settings: &settings,
            sampling: Sampling::Cosine,
            pieces: &case.senders.pieces,
        }
        .lit_and_gathered(
            &scene.material_table(),
            &near,
            &PixelSenders {
                counts: case.senders.counts,
                capacity: case.capacity(),
                radiance: &sent,
            },
        );
        let found = lab.colors(&view, &settings);
        assert_eq!(found.len(), expected.len());
        // As in `lit_hits`: packing's steps, and rays and shadow rays that pass an edge on its other side, or a surfel's.
        let odd = found.iter().zip(&expected).filter(|(found, expected)| {
            let off = (unpack_color(**found) - **expected).abs().max_element();
            off.is_nan() || off > expected.max_element() / 200.0
        });
        let odd = odd.count();
        println!("{}: {odd} of {} differ", scene.name, found.len());
        assert!(
            odd as f64 <= 8e-3 * found.len() as f64,
            "{}: {odd}",
            scene.name
        );
    }
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let lab = lab();
    let device = &lab.gpu.device;
    let scene = scenes::cornell();
    let camera = camera_of(&scene, 0, [8, 8]);
    let case = Case::new(&scene, &camera, SMALL);
    let sent = upload(&case.emitted());
    let radiance = gatherer()
        .create_radiance(device, &case.senders.cloud)
        .expect("room");
    let materials = lab.gpu.buffer(&case.materials, wgpu::BufferUsages::STORAGE);
    let senders = SurfelSenders {
        cloud: &case.senders.cloud,
        bvh: &case.senders.bounds,
        radiance: &sent,
    };
    let good = SurfelGathererInput::new(senders, &materials, &radiance);
    let record = |input: &SurfelGathererInput<'_>, settings: &SurfelGathererSettings| {
        gatherer().record(device, &mut lab.gpu.encoder(), input, settings)
    };
    let usual = SurfelGathererSettings::default();
    record(&good, &usual).expect("light");
    for (settings, field) in [
        (
            SurfelGathererSettings {
                rays_per_surfel: 0,
                ..usual
            },
            "rays_per_surfel",
        ),
        (
            SurfelGathererSettings {
                rays_per_surfel: 65,
                ..usual
            },
            "rays_per_surfel",
        ),
        (
            SurfelGathererSettings {
                emitter_samples: 17,
                ..usual
            },
            "emitter_samples",
        ),
        (
            SurfelGathererSettings {
                most_albedo: -0.1,
                ..usual
            },
            "most_albedo",
        ),
        (
            SurfelGathererSettings {
                most_albedo: 1.1,
                ..usual
            },
            "most_albedo",
        ),
        (
            SurfelGathererSettings {
                most_albedo: f32::NAN,
                ..usual
            },
            "most_albedo",
        ),
        (
            SurfelGathererSettings {
                sky_radiance: [0.0, -1.0, 0.0],
                ..usual
            },
            "sky_radiance",
        ),
        (
            SurfelGathererSettings {
                sky_radiance: [f32::NAN; 3],
                ..usual
            },
            "sky_radiance",
        ),
        (
            SurfelGathererSettings {
                frame: (1 << 20) + 1,
                ..usual
            },
            "frame",
        ),
    ] {
        refused(record(&good, &settings), "Setting", field, "to");
    }
    // Rays towards emitters by a gatherer without, and by one with but not with any.
    let aimed = SurfelGathererSettings {
        emitter_samples: 1,
        ..usual
    };
    refused(
        record(&good, &aimed),
        "Setting",
        "emitter_samples",
        "with_emitters",
    );
    refused(
        aiming().record(device, &mut lab.gpu.encoder(), &good, &aimed),
        "Mismatch",
        "SurfelGathererInput::emitters",
        "those of the senders",
    );
    let short = lab.gpu.buffer(&[0_u32; 8], wgpu::BufferUsages::STORAGE);
    let unbound = lab
        .gpu
        .buffer(&case.emitted(), wgpu::BufferUsages::COPY_SRC);
    let with_sent = |sent| SurfelGathererInput {
        senders: SurfelSenders {
            radiance: sent,
            ..senders
        },
        ..good
    };
    let to = |radiance| SurfelGathererInput { radiance, ..good };
    let of = |materials| SurfelGathererInput { materials, ..good };
    let tiny = lab.gpu.buffer(&[0_u32; 4], wgpu::BufferUsages::STORAGE);
    for (input, name) in [
        (with_sent(&short), "SurfelSenders::radiance"),
        (with_sent(&unbound), "SurfelSenders::radiance"),
        (to(&short), "SurfelGathererInput::radiance"),
        (to(&unbound), "SurfelGathererInput::radiance"),
        (to(&sent), "SurfelGathererInput::radiance"),
        (of(&tiny), "SurfelGathererInput::materials"),
        (of(&unbound), "SurfelGathererInput::materials"),
        (
            SurfelGathererInput {
                materials: &radiance,
                ..good
            },
            "SurfelGathererInput::radiance",
        ),
    ] {
        refused(record(&input, &usual), "Buffer", name, "");
    }
    let add = |onto, more| {
        gatherer().add(
            device,
            &mut lab.gpu.encoder(),
            &case.senders.cloud,
            onto,
            more,
        )
    };
    add(&radiance, &sent).expect("light");
    refused(
        add(&sent, &sent),
        "Buffer",
        "SurfelGatherer::add onto",
        "its own",
    );
    refused(
        add(&short, &sent),
        "Buffer",
        "SurfelGatherer::add onto",
        "bytes",
    );
    refused(
        add(&sent, &unbound),
        "Buffer",
        "SurfelGatherer::add more",
        "STORAGE",
    );

    // Clouds and hierarchies.
    let new = lab.surfelizer.create_cloud(device, SMALL).expect("room");
    let unrecorded = SurfelGathererInput {
        cloud: &new,
        ..good
    };
    refused(
        record(&unrecorded, &usual),
        "Recording",
        "SurfelCloud",
        "not recorded",
    );
    refused(
        gatherer().add(device, &mut lab.gpu.encoder(), &new, &radiance, &sent),
        "Recording",
        "SurfelCloud",
        "not recorded",
    );
    let buffers = SceneBuffers::new(lab.gpu, &scene);
    let settings = SurfelizerSettings {
        placement: Placement::Random,
        ..coarse()
    };
    let random = lab.senders(&buffers.meshes(), &camera, &settings, SMALL);
    let scattered = SurfelGathererInput {
        cloud: &random.cloud,
        ..good
    };
    refused(
        record(&scattered, &usual),
        "Setting",
        "SurfelizerSettings::placement",
        "Centroid",
    );
    let disks = pipelines::bvh_builder(Primitives::Disks { levels: 1 })
        .create(device, &case.senders.cloud)
        .expect("room");
    let among = |bvh| SurfelGathererInput {
        senders: SurfelSenders { bvh, ..senders },
        ..good
    };
    refused(
        record(&among(&disks), &usual),
        "Mismatch",
        "Bvh",
        "triangles",
    );
    refused(
        record(&among(&random.bounds), &usual),
        "Recording",
        "Bvh",
        "another",
    );

    // What hits bring.
    for descriptor in [
        BouncedDescriptor {
            primitives: Primitives::Instances,
            ..gathered()
        },
        BouncedDescriptor {
            primitives: Primitives::Disks { levels: 1 },
            ..gathered()
        },
    ] {
        refused(
            deep_screen_space::BouncedZBuffer::new(device, &descriptor),
            "Setting",
            "BouncedDescriptor::primitives",
            "Triangles",
        );
    }
    let counting = BouncedDescriptor {
        statistics: true,
        ..gathered()
    };
    refused(
        deep_screen_space::BouncedZBuffer::new(device, &counting),
        "Setting",
        "BouncedDescriptor::statistics",
        "false",
    );
}

fn gathered() -> BouncedDescriptor {
    BouncedDescriptor {
        payload: Payload::LitAndGathered,
        ..BouncedDescriptor::default()
    }
}

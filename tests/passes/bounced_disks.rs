//! The `BouncedZBuffer` with disks for senders: GPU against the f64 mirror, the rules that levels are merged by, and how
//! far disks are from the surfaces that they stand for.

use std::collections::BTreeSet;
use support::testing::pipelines;

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, BouncedView, BouncedZBuffer, Camera,
    CloudCapacity, DiskSettings, Error, Geometry, HitRadiance, Merge, Payload, Placement,
    Primitives, Sampling, Surfel, SurfelCloud, SurfelCounts, SurfelRadiance, SurfelSource,
    SurfelizerInput, SurfelizerSettings, Viewport,
    glam::DVec3,
    reference::{
        bounced_disks::PixelRay,
        bounced_z_buffer::offset_origin,
        directions::directions,
        effects::Sender,
        hashing::hash,
        packing::unpack_normal,
        shell_splatter::{Disk, Receiver, permute, pixel_of, sub_buffer_of, unpermute},
    },
    scenes::{self, Scene},
    wgpu,
};
use rayon::prelude::*;
use support::testing::frames::Decoded;
use support::testing::shot::{Shot, camera_of};
use support::{gpu::Gpu, raster::perspective};

fn shot(gpu: &Gpu, name: &str, view: usize, size: [u32; 2]) -> Shot {
    let scene = scenes::by_name(name).expect("a scene");
    Shot::new(gpu, &scene, &camera_of(&scene, view, size))
}

/// A cloud of a shot, and what the GPU made of it.
struct Cloud {
    cloud: SurfelCloud,
    disks: Vec<Disk>,
}

fn cloud_of(gpu: &Gpu, shot: &Shot, settings: &SurfelizerSettings) -> Cloud {
    let surfelizer = pipelines::surfelizer();
    let capacity = CloudCapacity {
        surfels: 1 << 17,
        pieces: 1 << 17,
        triangles: 1 << 16,
    };
    let mut cloud = surfelizer
        .create_cloud(&gpu.device, capacity)
        .expect("a cloud");
    let mut encoder = gpu.encoder();
    let input = SurfelizerInput {
        geometry: Geometry {
            meshes: &shot.buffers.meshes(),
        },
        camera: &shot.camera,
        cull_by: &[],
        timestamps: None,
    };
    surfelizer
        .record(&gpu.device, &mut encoder, &input, settings, &mut cloud)
        .expect("surfels");
    gpu.finish(encoder);
    let counts: SurfelCounts = gpu.read_buffer(cloud.counters())[0];
    assert_eq!(counts.overflow(), 0, "{counts:?}");
    assert_eq!(counts.piece_overflow(capacity), 0, "{counts:?}");
    let stored = counts.stored as usize;
    let surfels: Vec<Surfel> = gpu.read_buffer(cloud.surfels());
    let sources: Vec<SurfelSource> = gpu.read_buffer(cloud.sources());
    let disks = surfels[..stored]
        .iter()
        .zip(&sources)
        .map(|(surfel, source)| Disk {
            position: DVec3::from(surfel.position.map(f64::from)),
            sender: Sender::new(f64::from(surfel.radius), unpack_normal(source.normal)),
        })
        .collect();
    Cloud { cloud, disks }
}

/// Surfels of so many pixels; pieces are the scene's own triangles.
fn surfels(radius_pixels: f32, placement: Placement) -> SurfelizerSettings {
    SurfelizerSettings {
        radius_pixels,
        placement,
        density: f32::INFINITY,
        ..SurfelizerSettings::default()
    }
}

/// The pipelines for one kind of primitives, and these.
type Pass = (&'static BouncedZBuffer, Primitives);

fn pass(payload: Payload, primitives: Primitives) -> Pass {
    let descriptor = BouncedDescriptor {
        payload,
        primitives,
        ..BouncedDescriptor::default()
    };
    (pipelines::bounced(&descriptor), primitives)
}

fn trace(
    gpu: &Gpu,
    shot: &Shot,
    cloud: &SurfelCloud,
    (pass, primitives): Pass,
    settings: &BouncedSettings,
    radiance: Option<&wgpu::Buffer>,
) -> (Decoded<'static>, BouncedView) {
    let device = &gpu.device;
    let Viewport { width, height, .. } = shot.camera.viewport();
    let builder = pipelines::bvh_builder(primitives);
    let bvh = builder.create(device, cloud).expect("a hierarchy");
    let view = pass
        .create_view(device, width, height, settings.rays_per_pixel)
        .expect("a view");
    let mut encoder = gpu.encoder();
    builder
        .record(device, &mut encoder, cloud, &bvh, None)
        .expect("a hierarchy");
    let mut decoded = Decoded::of(&shot.camera);
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, cloud.origin());
    let input = BouncedInput {
        radiance: radiance.map_or(HitRadiance::None, HitRadiance::Surfels),
        ..BouncedInput::new(&frame, cloud, &bvh)
    };
    pass.record(device, &mut encoder, &input, settings, &view)
        .expect("hits");
    gpu.finish(encoder);
    (decoded, view)
}

fn receivers(gpu: &Gpu, decoded: &Decoded<'_>) -> Vec<Option<Receiver>> {
    let texels: Vec<[u32; 4]> = gpu.read_texture(decoded.receivers.view().texture(), 0);
    texels
        .iter()
        .map(|&[x, y, z, n]| {
            (n != 0x8000_8000).then(|| Receiver {
                position: DVec3::from([x, y, z].map(|b| f64::from(f32::from_bits(b)))),
                normal: unpack_normal(n),
            })
        })
        .collect()
}

/// Whether each ray hits: pixel after pixel, the directions of each in order; `None` for the sky.
fn blocked(
    gpu: &Gpu,
    (decoded, view): (&Decoded<'_>, &BouncedView),
    settings: &BouncedSettings,
) -> Vec<Option<bool>> {
    let words: Vec<u32> = gpu.read_buffer(view.blocked().expect("bits"));
    let each = settings.rays_per_pixel.div_ceil(32) as usize;
    receivers(gpu, decoded)
        .iter()
        .zip(words.chunks(each))
        .flat_map(|(receiver, words)| {
            let seen = receiver.is_some();
            (0..settings.rays_per_pixel as usize)
                .map(move |i| seen.then(|| words[i / 32] >> (i % 32) & 1 != 0))
        })
        .collect()
}

/// Radiance by which a hit tells its surfel's index and side: four bytes keep three channels below 256 exactly.
fn radiance_of_indices(gpu: &Gpu, capacity: u32) -> wgpu::Buffer {
    let color = |code: u32| [0, 8, 16].map(|shift| (code >> shift & 255) as f32);
    let all: Vec<SurfelRadiance> = (0..capacity)
        .map(|i| SurfelRadiance {
            front: color(2 * i + 2),
            back: color(2 * i + 3),
            ..SurfelRadiance::default()
        })
        .collect();
    gpu.buffer(&all, wgpu::BufferUsages::STORAGE)
}

/// The surfel that each ray hits, and whether its front, in the order of [`blocked`].
fn surfels_hit(
    gpu: &Gpu,
    view: &BouncedView,
    settings: &BouncedSettings,
) -> Vec<Option<(usize, bool)>> {
    let texture = view.radiance().expect("colours").texture();
    let layers: Vec<Vec<u32>> = (0..settings.rays_per_pixel)
        .map(|layer| gpu.read_texture(texture, layer))
        .collect();
    (0..layers[0].len())
        .flat_map(|pixel| layers.iter().map(move |layer| layer[pixel]))
        .map(|bits| {
            // Bits of each channel times 2^(e - 136).
            let shift = 136 - (bits >> 24) as i32;
            let code: u32 = [0, 8, 16]
                .map(|at| ((bits >> at & 255) >> shift.clamp(0, 8)) << at)
                .iter()
                .sum();
            (bits != 0).then(|| ((code / 2 - 1) as usize, code.is_multiple_of(2)))
        })
        .collect()
}

fn settings(rays_per_pixel: u32, disks: DiskSettings) -> BouncedSettings {
    BouncedSettings {
        rays_per_pixel,
        disks,
        ..BouncedSettings::default()
    }
}

/// Of a view whose cloud was made for its own eye.
fn rays(
    receivers: &[Option<Receiver>],
    camera: &Camera,
    settings: &BouncedSettings,
) -> Vec<PixelRay> {
    let width = camera.viewport().width;
    let each = settings.rays_per_pixel as usize;
    directions(receivers, width, settings, Sampling::Cosine)
        .iter()
        .enumerate()
        .filter_map(|(i, drawn)| {
            let pixel = (i / each) as u32;
            let receiver = receivers[i / each]?;
            Some(PixelRay {
                pixel: [pixel % width, pixel / width],
                receiver,
                origin: offset_origin(camera, camera.focus(), receiver.position, receiver.normal),
                direction: drawn.as_ref()?.direction,
            })
        })
        .collect()
}

/// Rays whose hit may be another one in f32 than in f64: those that pass a disk's edge, a shell's bound or a bound of the
/// rule for a pixel's own surface within rounding. Positions and directions are off by some 1e-7 of the distance, which is
/// 1e-5 of a surfel's radius or less, and a ray passes tens of edges; and drivers may take sines and cosines of directions
/// to no more than 2^-11 (WGSL 15.7.4).
const EXCEPTIONS: f64 = 2e-3;
/// Disks of one wall overlap, and rounding decides which is met first: distances this close, relative, count as equal.
const TIE: f64 = 1e-5;

/// Compares which surfel each ray hits with the mirror, and whether any.
fn compare(gpu: &Gpu, shot: &Shot, cloud: &Cloud, levels: u32, settings: &BouncedSettings) {
    let senders = Primitives::Disks { levels };
    let inputs = format!("{} disks, {levels} levels, {settings:?}", cloud.disks.len());
    let radiance = radiance_of_indices(gpu, cloud.cloud.capacity().surfels);
    let by_radiance = pass(Payload::Radiance, senders);
    let (_, colors) = trace(
        gpu,
        shot,
        &cloud.cloud,
        by_radiance,
        settings,
        Some(&radiance),
    );
    let by_occlusion = pass(Payload::Occlusion, senders);
    let (decoded, bits) = trace(gpu, shot, &cloud.cloud, by_occlusion, settings, None);

    let receivers = receivers(gpu, &decoded);
    let all_hits = surfels_hit(gpu, &colors, settings);
    let all_bits = blocked(gpu, (&decoded, &bits), settings);
    let seen: Vec<_> = all_hits
        .iter()
        .zip(&all_bits)
        .filter_map(|(hit, bit)| Some((*hit, (*bit)?)))
        .collect();
    let rays = rays(&receivers, &shot.camera, settings);
    assert_eq!(rays.len(), seen.len(), "{inputs}");
    let (mut ties, mut off) = (0, Vec::new());
    let expected: Vec<_> = rays
        .par_iter()
        .map(|ray| ray.first(&cloud.disks, levels, settings))
        .collect();
    for ((ray, first), (hit, bit)) in rays.iter().zip(&expected).zip(&seen) {
        let side = |surfel: usize| {
            let normal = cloud.disks[surfel].sender.normal;
            (surfel, normal.dot(ray.direction) < 0.0)
        };
        let is_tie = |[found, first]: [usize; 2], t: f64| {
            let on = |level| ray.meet(&cloud.disks[found], level, levels, settings);
            found != first
                && (0..levels)
                    .filter_map(on)
                    .any(|other| (other - t).abs() < TIE * t)
        };
        if first.is_some() == *bit && first.map(|first| side(first.surfel)) == *hit {
            continue;
        }
        match (first, hit) {
            (Some(first), Some((found, _))) if *bit && is_tie([*found, first.surfel], first.t) => {
                ties += 1;
            }
            _ => off.push(format!(
                "{ray:?}: GPU {hit:?}, blocked {bit}, mirror {first:?}"
            )),
        }
    }
    println!(
        "{inputs}: of {} rays {ties} are ties and {} differ",
        rays.len(),
        off.len()
    );
    assert!(
        off.len() as f64 <= EXCEPTIONS * rays.len() as f64,
        "{inputs}: {} of {} rays differ, such as {:#?}",
        off.len(),
        rays.len(),
        &off[..off.len().min(5)]
    );
}

#[test]
fn hits_match_the_mirror() {
    let gpu = pipelines::gpu();
    let disks = |shell_radii, merge, seed| DiskSettings {
        shell_radii,
        merge,
        seed,
    };
    for (name, view, size, radius_pixels, placement, levels, bounced) in [
        (
            "cornell",
            1,
            [41, 31],
            1.5,
            Placement::Random,
            4,
            settings(6, disks(10.0, Merge::Nearest, 0)),
        ),
        (
            "cornell",
            0,
            [32, 48],
            1.0,
            Placement::Centroid,
            1,
            BouncedSettings {
                frame: 3,
                ..settings(4, DiskSettings::default())
            },
        ),
        (
            "colonnade",
            0,
            [48, 32],
            2.0,
            Placement::Centroid,
            6,
            settings(6, disks(3.0, Merge::Finest, 5)),
        ),
        (
            "closed_room",
            0,
            [40, 33],
            1.5,
            Placement::Grid,
            8,
            BouncedSettings {
                radius: 1.0,
                ..settings(4, disks(4.0, Merge::Finest, 1 << 24))
            },
        ),
        (
            "dominoes",
            1,
            [32, 32],
            1.5,
            Placement::Centroid,
            3,
            BouncedSettings {
                radius: 0.3,
                ..settings(6, disks(f32::INFINITY, Merge::Nearest, 9))
            },
        ),
    ] {
        let shot = shot(gpu, name, view, size);
        let cloud = cloud_of(gpu, &shot, &surfels(radius_pixels, placement));
        print!("{name}: ");
        compare(gpu, &shot, &cloud, levels, &bounced);
    }
}

#[test]
fn pixels_find_the_sub_buffer_that_has_them() {
    for level in 0..8 {
        let count = 1_u32 << (2 * level);
        for key in (0..20).map(hash).chain([0, u32::MAX]) {
            let inverse: Vec<u32> = (0..count)
                .map(|value| unpermute(permute(value, key, level), key, level))
                .collect();
            assert!(
                inverse.iter().copied().eq(0..count),
                "level {level}, key {key:#x}"
            );
        }
        for seed in [0, 1, 1 << 24] {
            for pixel in (0..500).map(|i| [hash(i) % 4096, hash(i + 1000) % 4096]) {
                let block = pixel.map(|p| p >> level);
                let sub_buffer = sub_buffer_of(pixel, level, seed);
                assert!(sub_buffer < count);
                assert_eq!(
                    pixel_of(block, sub_buffer, level, seed),
                    pixel,
                    "level {level}, seed {seed}"
                );
            }
        }
    }
}

/// Shells of no size leave all hits to the last level, where a pixel meets the surfels of its own sub-buffer and none
/// else; and of those in reach all are met by some pixel.
#[test]
fn every_surfel_is_in_one_sub_buffer_a_level() {
    let gpu = pipelines::gpu();
    // A roof of few surfels over the floor that is seen: each is met from many pixels.
    let mut mesh = Vec::new();
    for i in 0..64 {
        let [x, z] = [i % 8, i / 8].map(|i| (f64::from(i) - 3.5) * 0.5);
        mesh.push((DVec3::new(x, 1.0, z), 0.2));
    }
    let (shot, cloud) = over_a_floor(gpu, &mesh, 32);
    for levels in 1..=4 {
        let disks = DiskSettings {
            shell_radii: 1e-9,
            seed: 3,
            ..DiskSettings::default()
        };
        let settings = settings(64, disks);
        let level = levels - 1;
        let pass = pass(Payload::Radiance, Primitives::Disks { levels });
        let radiance = radiance_of_indices(gpu, cloud.cloud.capacity().surfels);
        let (_, view) = trace(gpu, &shot, &cloud.cloud, pass, &settings, Some(&radiance));
        let mut met = BTreeSet::new();
        for (i, hit) in surfels_hit(gpu, &view, &settings).iter().enumerate() {
            if let Some((surfel, _)) = hit {
                let pixel = i as u32 / settings.rays_per_pixel;
                let pixel = [pixel % view.size()[0], pixel / view.size()[0]];
                let sub_buffer = sub_buffer_of(pixel, level, disks.seed);
                assert_eq!(
                    *surfel as u32 % (1 << (2 * level)),
                    sub_buffer,
                    "level {level}, pixel {pixel:?}, surfel {surfel}"
                );
                met.insert(*surfel);
            }
        }
        assert!(
            (0..64).all(|surfel| met.contains(&surfel)),
            "level {level}: only {met:?} are met"
        );
    }
}

/// Triangles over a patch of floor around the origin that fills the view, each of which becomes one surfel, in their
/// order and then the floor: (centre, radius of its disk), level, and all seen from below.
fn over_a_floor(gpu: &Gpu, triangles: &[(DVec3, f64)], pixels: u32) -> (Shot, Cloud) {
    // The circumradius of an equilateral triangle with the area of a disk of radius 1.
    let circumradius = (std::f64::consts::PI / (0.75 * 3.0_f64.sqrt())).sqrt();
    let corners = |center: DVec3, radius: f64| {
        [0.0_f64, 120.0, 240.0].map(|degrees| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            (center + DVec3::new(cos, 0.0, sin) * radius * circumradius)
                .as_vec3()
                .to_array()
        })
    };
    let positions: Vec<[f32; 3]> = triangles
        .iter()
        .copied()
        .chain([(DVec3::ZERO, 3.0)])
        .flat_map(|(center, radius)| {
            let mut corners = corners(center, radius);
            if center.y == 0.0 {
                corners.reverse();
            }
            corners
        })
        .collect();
    let count = positions.len() as u32;
    let scene = Scene {
        name: "over a floor",
        normals: vec![[0.0, 1.0, 0.0]; positions.len()],
        indices: (0..count).collect(),
        parts: vec![scenes::Part {
            first_index: 0,
            index_count: count,
            material: 0,
        }],
        positions,
        ..scenes::by_name("cornell").expect("a scene")
    };
    // From the side and from afar: triangles that are large against their distance would be split.
    let camera = Camera::look_at(
        DVec3::new(0.0, 12.0, 36.0),
        DVec3::ZERO,
        DVec3::Y,
        perspective(0.8, 1.0, 0.1),
        Viewport::full(pixels, pixels),
    )
    .expect("a camera");
    let shot = Shot::new(gpu, &scene, &camera);
    assert!(
        shot.pixels
            .iter()
            .all(|pixel| pixel.is_some_and(|p| p.triangle == triangles.len())),
        "the floor fills the view"
    );
    // Every triangle is smaller than such a surfel, and all are kept.
    let cloud = cloud_of(gpu, &shot, &surfels(1000.0, Placement::Centroid));
    let radii: Vec<f64> = cloud.disks.iter().map(|d| d.sender.radius).collect();
    assert_eq!(radii.len(), triangles.len() + 1, "{radii:?}");
    for (radius, (_, expected)) in radii.iter().zip(triangles) {
        assert!((radius / expected - 1.0).abs() < 1e-3, "{radii:?}");
    }
    (shot, cloud)
}

/// A large disk hangs behind a small one. With shells of 3 radii the small one is hit on level 1, and the large one,
/// though farther, on level 0: "the finest level wins" takes the far one, and for a radius between the two finds nothing.
#[test]
fn the_finest_level_may_hide_the_nearest_hit() {
    let gpu = pipelines::gpu();
    // Four times the small one, so that each sub-buffer of level 1 has it.
    let small = (DVec3::Y * 2.0, 0.6);
    let large = (DVec3::Y * 4.0, 3.0);
    let (shot, cloud) = over_a_floor(gpu, &[small, small, small, small, large], 16);
    let levels = 2;
    let run = |merge, radius| {
        let disks = DiskSettings {
            shell_radii: 3.0,
            merge,
            ..DiskSettings::default()
        };
        let settings = BouncedSettings {
            radius,
            ..settings(16, disks)
        };
        let senders = Primitives::Disks { levels };
        let radiance = radiance_of_indices(gpu, cloud.cloud.capacity().surfels);
        let colors = pass(Payload::Radiance, senders);
        let (_, colors) = trace(gpu, &shot, &cloud.cloud, colors, &settings, Some(&radiance));
        let bits = pass(Payload::Occlusion, senders);
        let (decoded, bits) = trace(gpu, &shot, &cloud.cloud, bits, &settings, None);
        let hits = surfels_hit(gpu, &colors, &settings);
        for (i, (hit, bit)) in hits
            .iter()
            .zip(blocked(gpu, (&decoded, &bits), &settings))
            .enumerate()
        {
            assert_eq!(
                Some(hit.is_some()),
                bit,
                "ray {i}, {merge:?}, radius {radius}"
            );
        }
        hits
    };
    let nearest = run(Merge::Nearest, f32::INFINITY);
    let finest = run(Merge::Finest, f32::INFINITY);
    let mut hidden = 0;
    for (i, (nearest, finest)) in nearest.iter().zip(&finest).enumerate() {
        let [nearest, finest] = [nearest, finest].map(|hit| hit.map(|(surfel, _)| surfel));
        assert_eq!(nearest.is_some(), finest.is_some(), "ray {i}");
        assert!(
            nearest == finest || (nearest < Some(4) && finest == Some(4)),
            "ray {i}: nearest {nearest:?}, finest {finest:?}"
        );
        hidden += usize::from(nearest != finest);
    }
    println!("{hidden} of {} rays", nearest.len());
    // The small disk, 1.2 on level 1 at height 2, covers a share 1.2²/(1.2² + 2²), 0.26, of the cosine over the middle.
    assert!(hidden * 5 > nearest.len(), "{hidden} of {}", nearest.len());
    let nearest = run(Merge::Nearest, 3.0);
    let finest = run(Merge::Finest, 3.0);
    let count = |hits: &[Option<(usize, bool)>]| hits.iter().flatten().count();
    assert!(count(&nearest) >= hidden, "{}", count(&nearest));
    assert_eq!(count(&finest) + hidden, count(&nearest));
}

fn share(rays: &[Option<bool>], of: bool) -> f64 {
    let seen = rays.iter().flatten().count();
    rays.iter().flatten().filter(|r| **r == of).count() as f64 / seen as f64
}

/// Within a closed room every ray ends at a triangle. Disks with the area of the walls do not cover them, and some rays
/// pass between them.
#[test]
fn closed_rooms_leak_through_disks_and_not_through_pieces() {
    let gpu = pipelines::gpu();
    let shot = shot(gpu, "closed_room", 0, [48, 36]);
    let bounced = settings(16, DiskSettings::default());
    let pieces = pass(Payload::Occlusion, Primitives::Triangles);
    for placement in [Placement::Random, Placement::Centroid] {
        let cloud = cloud_of(gpu, &shot, &surfels(2.0, placement)).cloud;
        let (decoded, exact) = trace(gpu, &shot, &cloud, pieces, &bounced, None);
        let exact = share(&blocked(gpu, (&decoded, &exact), &bounced), false);
        assert_eq!(exact, 0.0, "{placement:?}");
        for levels in [1, 5] {
            let disks = pass(Payload::Occlusion, Primitives::Disks { levels });
            let (decoded, view) = trace(gpu, &shot, &cloud, disks, &bounced, None);
            let leaks = share(&blocked(gpu, (&decoded, &view), &bounced), false);
            println!(
                "{placement:?}, {levels} levels: {:.1} % escape",
                100.0 * leaks
            );
            assert!(leaks > 0.0, "{placement:?}, {levels} levels: {leaks}");
        }
    }
}

/// What the ray tracer finds along the same rays.
fn traced(shot: &Shot, rays: &[PixelRay], radius: f32) -> Vec<bool> {
    rays.par_iter()
        .map(|ray| {
            let origin = ray.origin + shot.camera.focus();
            shot.tracer
                .occluded(origin, ray.direction, 0.0, f64::from(radius))
        })
        .collect()
}

/// Share of rays that hit nothing and should; share that hit something and should not; and the root mean square error of
/// pixels' means.
fn errors(found: &[bool], truth: &[bool], rays_per_pixel: usize) -> [f64; 3] {
    let rays = found.len() as f64;
    let count = |of: [bool; 2]| {
        let pairs = found.iter().zip(truth);
        pairs.filter(|(f, t)| [**f, **t] == of).count() as f64 / rays
    };
    let squares: f64 = found
        .chunks(rays_per_pixel)
        .zip(truth.chunks(rays_per_pixel))
        .map(|(found, truth)| {
            let blocked = |rays: &[bool]| rays.iter().filter(|b| **b).count() as f64;
            ((blocked(found) - blocked(truth)) / rays_per_pixel as f64).powi(2)
        })
        .sum();
    let rmse = (squares / (rays / rays_per_pixel as f64)).sqrt();
    [count([false, true]), count([true, false]), rmse]
}

/// What disks block beyond the surface that they stand for falls with their size. What they let through does not: it is
/// the share of the surface that they leave bare, whatever their size.
#[test]
fn smaller_disks_block_less_that_is_open() {
    let gpu = pipelines::gpu();
    let shot = shot(gpu, "cornell", 1, [64, 48]);
    let pass = pass(Payload::Occlusion, Primitives::Disks { levels: 1 });
    let bounced = settings(16, DiskSettings::default());
    for placement in [Placement::Centroid, Placement::Random] {
        let [coarse, fine] = [4.0, 0.7].map(|radius_pixels| {
            let cloud = cloud_of(gpu, &shot, &surfels(radius_pixels, placement));
            let (decoded, view) = trace(gpu, &shot, &cloud.cloud, pass, &bounced, None);
            let found: Vec<bool> = blocked(gpu, (&decoded, &view), &bounced)
                .into_iter()
                .flatten()
                .collect();
            let rays = rays(&receivers(gpu, &decoded), &shot.camera, &bounced);
            let truth = traced(&shot, &rays, f32::INFINITY);
            let errors = errors(&found, &truth, 16);
            println!(
                "{placement:?}, {radius_pixels} px, {} disks: leaks, over-occlusion, RMSE {errors:.4?}",
                cloud.disks.len(),
            );
            errors
        });
        let inputs = format!("{placement:?}: {coarse:?}, {fine:?}");
        // What sticks out goes with the size, or slower where triangles are smaller than a surfel.
        assert!(fine[1] < 0.4 * coarse[1], "{inputs}");
        assert!(fine[0] > 0.8 * coarse[0] && fine[0] > 0.05, "{inputs}");
    }
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    for levels in [0, 9, u32::MAX] {
        let descriptor = BouncedDescriptor {
            primitives: Primitives::Disks { levels },
            ..BouncedDescriptor::default()
        };
        let error = BouncedZBuffer::new(device, &descriptor).map(|_| ());
        assert!(
            matches!(
                error,
                Err(Error::Setting {
                    field: "Primitives::Disks::levels",
                    ..
                })
            ),
            "{levels} levels: {error:?}"
        );
    }
    let good = DiskSettings::default();
    for (disks, named) in [
        (
            DiskSettings {
                shell_radii: 0.0,
                ..good
            },
            "DiskSettings::shell_radii",
        ),
        (
            DiskSettings {
                shell_radii: f32::NAN,
                ..good
            },
            "DiskSettings::shell_radii",
        ),
        (
            DiskSettings {
                seed: (1 << 24) + 1,
                ..good
            },
            "DiskSettings::seed",
        ),
    ] {
        match settings(1, disks).validate() {
            Err(Error::Setting { field, .. }) => assert_eq!(field, named, "{disks:?}"),
            other => panic!("{disks:?}: {other:?}"),
        }
    }

    let shot = shot(gpu, "cornell", 0, [8, 8]);
    let cloud = cloud_of(gpu, &shot, &surfels(4.0, Placement::Random)).cloud;
    let kinds = [
        Primitives::Triangles,
        Primitives::Disks { levels: 2 },
        Primitives::Disks { levels: 3 },
    ];
    for primitives in kinds {
        let (pass, _) = pass(Payload::Occlusion, primitives);
        let view = pass.create_view(device, 8, 8, 1).expect("a view");
        for of in kinds {
            let bvh = pipelines::bvh_builder(of).create(device, &cloud);
            let bvh = bvh.expect("a hierarchy");
            let mut encoder = gpu.encoder();
            let mut decoded = Decoded::of(&shot.camera);
            let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, cloud.origin());
            let input = BouncedInput::new(&frame, &cloud, &bvh);
            let settings = settings(1, good);
            let recorded = [
                pipelines::bvh_builder(primitives).record(device, &mut encoder, &cloud, &bvh, None),
                pass.record(device, &mut encoder, &input, &settings, &view),
            ];
            for result in recorded {
                if primitives == of {
                    assert_eq!(result, Ok(()), "{primitives:?}");
                } else {
                    assert!(
                        matches!(result, Err(Error::Mismatch { name: "Bvh", .. })),
                        "{primitives:?} with {of:?}: {result:?}"
                    );
                }
            }
        }
    }
}

/// An empty cloud, and a cloud of one disk, on all numbers of levels.
#[test]
fn few_surfels_are_no_trouble() {
    let gpu = pipelines::gpu();
    let disk = (DVec3::Y, 0.5);
    for (count, expected) in [(0, false), (1, true), (5, true)] {
        let (shot, cloud) = over_a_floor(gpu, &vec![disk; count], 8);
        for levels in 1..=8 {
            let pass = pass(Payload::Occlusion, Primitives::Disks { levels });
            let bounced = settings(16, DiskSettings::default());
            let (decoded, view) = trace(gpu, &shot, &cloud.cloud, pass, &bounced, None);
            let blocked = share(&blocked(gpu, (&decoded, &view), &bounced), true);
            assert_eq!(
                blocked > 0.0,
                expected,
                "{count} disks, {levels} levels: {blocked}"
            );
        }
    }
}

//! Volumetric obscurance: the shader against its mirror, both against the integral that they estimate, and what must hold at
//! extremes.

use std::{
    collections::HashMap,
    sync::{Arc, LazyLock, Mutex, PoisonError},
};
use support::testing::pipelines;

use deep_screen_space::{
    BallSamples, Camera, Combine, DepthMoments, DiskSamples, Error, NormalEncoding, NormalSpace,
    Normals, ObscuranceInput, ObscuranceSampling, ObscuranceSettings, ObscuranceVolume, PixelList,
    SecondRadius, Viewport, VolumetricObscurance, VolumetricObscuranceDescriptor,
    glam::{DMat4, DVec3},
    reference::{
        depth_moments::Pyramid,
        gbuffer::{Pixel, cast},
        receivers::Decoder,
        sample_tables::{Cells, Domain, TOLERANCE, generate},
        trace::Tracer,
        volumetric_obscurance::{DepthBuffer, integral_of_geometry},
    },
    scenes::{self, Scene},
    wgpu::{self, TextureFormat, TextureUsages},
};
use support::{gpu::Gpu, raster::perspective};

const LINES: ObscuranceSampling = ObscuranceSampling::Lines(DiskSamples::Five);
const POINTS: ObscuranceSampling = ObscuranceSampling::Points(BallSamples::ThirtyThree);

/// A picture's depth and normals, cast in f64.
struct Shot {
    camera: Camera,
    depths: Vec<f32>,
    normals: Vec<[f32; 3]>,
    /// What was cast, in the world.
    pixels: Vec<Option<Pixel>>,
}

impl Shot {
    fn new(camera: &Camera, scene: &Scene, tracer: &Tracer) -> Self {
        let pixels = cast(
            camera,
            tracer,
            &scene.positions,
            &scene.normals,
            &scene.indices,
        );
        let sky = f64::from(camera.background_depth());
        let normal = |p: &Option<Pixel>| p.map_or(DVec3::ZERO, |p| p.receiver.shading_normal);
        Self {
            camera: *camera,
            depths: pixels
                .iter()
                .map(|p| p.map_or(sky, |p| p.depth) as f32)
                .collect(),
            normals: pixels
                .iter()
                .map(|p| normal(p).as_vec3().to_array())
                .collect(),
            pixels,
        }
    }

    /// The first view of a scene of the crate.
    fn of(scene: &Scene, tracer: &Tracer, [width, height]: [u32; 2]) -> Self {
        Self::new(
            &camera_of(scene, DVec3::ZERO, [width, height]),
            scene,
            tracer,
        )
    }

    fn size(&self) -> [u32; 2] {
        let viewport = self.camera.viewport();
        [viewport.width, viewport.height]
    }

    fn mirror(&self) -> DepthBuffer<'_> {
        DepthBuffer {
            decoder: Decoder {
                camera: &self.camera,
                origin: DVec3::ZERO,
                depth_format: TextureFormat::R32Float,
                normal_encoding: NormalEncoding::Signed,
                normal_space: NormalSpace::World,
            },
            depths: &self.depths,
            normals: &self.normals,
        }
    }

    fn pixels(&self) -> impl Iterator<Item = [u32; 2]> + use<> {
        let [width, height] = self.size();
        (0..width * height).map(move |i| [i % width, i / width])
    }

    /// The mirror's picture.
    fn mirrored(&self, case: &Case) -> Vec<f64> {
        let mirror = self.mirror();
        let pyramid = Pyramid::new(self.size(), &mirror.view_depths());
        let pyramid = Some(&pyramid);
        self.pixels()
            .map(|p| mirror.openness(p, case.sampling, case.volume, &case.settings, pyramid))
            .collect()
    }
}

/// The first view of a scene, its eye moved along the camera's axes.
fn camera_of(scene: &Scene, shift: DVec3, [width, height]: [u32; 2]) -> Camera {
    let view = &scene.views[0];
    let aspect = f64::from(width) / f64::from(height);
    Camera::look_at(
        DVec3::from(view.eye) + shift,
        DVec3::from(view.target) + shift,
        view.up.into(),
        perspective(view.vertical_fov_degrees, aspect, view.near),
        Viewport::full(width, height),
    )
    .expect("a scene's own view")
}

/// What to compute.
#[derive(Clone, Copy, Debug)]
struct Case {
    sampling: ObscuranceSampling,
    volume: ObscuranceVolume,
    settings: ObscuranceSettings,
}

type Passes = HashMap<(ObscuranceSampling, ObscuranceVolume), Arc<VolumetricObscurance>>;

/// Pipelines, compiled once for all tests.
static PASSES: LazyLock<Mutex<Passes>> = LazyLock::new(Mutex::default);

impl Case {
    fn pass(&self) -> Arc<VolumetricObscurance> {
        let create = || {
            let descriptor = VolumetricObscuranceDescriptor {
                sampling: self.sampling,
                volume: self.volume,
            };
            Arc::new(
                VolumetricObscurance::new(&pipelines::gpu().device, &descriptor)
                    .expect("pipelines"),
            )
        };
        // What it guards is whole after a panic of another test too.
        let mut passes = PASSES.lock().unwrap_or_else(PoisonError::into_inner);
        passes
            .entry((self.sampling, self.volume))
            .or_insert_with(create)
            .clone()
    }

    fn takes_areas(&self) -> bool {
        matches!(
            self.sampling,
            ObscuranceSampling::Areas(_) | ObscuranceSampling::OneArea
        )
    }
}

/// A texture to compute into, filled with -1 so that what is not written shows.
fn target(gpu: &Gpu, [width, height]: [u32; 2]) -> wgpu::Texture {
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: TextureFormat::R32Float,
        usage: TextureUsages::STORAGE_BINDING | TextureUsages::COPY_SRC | TextureUsages::COPY_DST,
        view_formats: &[],
    });
    gpu.queue.write_texture(
        texture.as_image_copy(),
        bytemuck::cast_slice(&vec![-1.0_f32; (width * height) as usize]),
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(4 * width),
            rows_per_image: None,
        },
        texture.size(),
    );
    texture
}

/// The `pipelines::gpu()`'s picture.
fn rendered(shot: &Shot, case: &Case) -> Vec<f32> {
    let gpu = pipelines::gpu();
    let [width, height] = shot.size();
    let normals: Vec<[f32; 4]> = shot
        .normals
        .iter()
        .map(|n| [n[0], n[1], n[2], 0.0])
        .collect();
    let depth = gpu.texture(TextureFormat::R32Float, width, height, &shot.depths);
    let normal = gpu.texture(TextureFormat::Rgba32Float, width, height, &normals);
    let pass = case.pass();
    let moments = case.takes_areas().then(|| {
        pass.create_moments(&gpu.device, width, height)
            .expect("moments")
    });
    let texture = target(gpu, [width, height]);
    record(
        gpu,
        &pass,
        shot,
        &depth,
        &normal,
        moments.as_ref(),
        &texture,
        &case.settings,
    )
    .expect("valid input");
    gpu.read_texture(&texture, 0)
}

#[allow(clippy::too_many_arguments)]
fn record(
    gpu: &Gpu,
    pass: &VolumetricObscurance,
    shot: &Shot,
    depth: &wgpu::TextureView,
    normal: &wgpu::TextureView,
    moments: Option<&DepthMoments>,
    target: &wgpu::Texture,
    settings: &ObscuranceSettings,
) -> Result<(), Error> {
    let mut encoder = gpu.encoder();
    if let Some(moments) = moments {
        pass.record_moments(
            &gpu.device,
            &mut encoder,
            depth.texture().into(),
            &shot.camera,
            moments,
            None,
        )?;
    }
    let input = ObscuranceInput {
        depth: depth.texture().into(),
        normals: Some(Normals {
            texture: normal.texture().into(),
            encoding: NormalEncoding::Signed,
            space: NormalSpace::World,
        }),
        camera: &shot.camera,
        moments,
        work: None,
        target: target.into(),
        timestamps: None,
    };
    pass.record(&gpu.device, &mut encoder, &input, settings)?;
    gpu.finish(encoder);
    Ok(())
}

const VOLUMES: [ObscuranceVolume; 3] = [
    ObscuranceVolume::Sphere,
    ObscuranceVolume::Hemisphere,
    ObscuranceVolume::TangentSphere,
];

/// How many items may be further off than `tolerance`: a share.
fn check(what: &str, gpu: &[f32], mirror: &[f64], tolerance: f64, share: f64) {
    assert_eq!(gpu.len(), mirror.len(), "{what}");
    let off = |(a, b): (&f32, &f64)| (f64::from(*a) - b).abs();
    let beyond = gpu
        .iter()
        .zip(mirror)
        .filter(|&pair| off(pair) > tolerance || off(pair).is_nan())
        .count();
    let worst = gpu.iter().zip(mirror).map(off).fold(0.0, f64::max);
    println!(
        "{what}: {beyond} of {} beyond {tolerance}, worst {worst}",
        gpu.len()
    );
    assert!(
        beyond as f64 <= share * gpu.len() as f64,
        "{what}: {beyond} of {} are further off than {tolerance}, the worst {worst}",
        gpu.len()
    );
    assert!(
        gpu.iter().all(|v| (0.0..=1.0).contains(v)),
        "{what}: not all in 0...1"
    );
}

fn scene(name: &str) -> (Scene, Tracer) {
    let scene = scenes::by_name(name).expect("a scene of the crate");
    let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a valid mesh");
    (scene, tracer)
}

fn settings(radius: f32) -> ObscuranceSettings {
    ObscuranceSettings {
        radius,
        ..ObscuranceSettings::default()
    }
}

#[test]
fn the_shader_agrees_with_its_mirror() {
    let (scene, tracer) = scene("colonnade");
    let shot = Shot::of(&scene, &tracer, [75, 50]);
    let plain = settings(0.5 * scene.ao_radius);
    let thick = ObscuranceSettings {
        thickness: 0.3 * scene.ao_radius,
        second: Some(SecondRadius {
            radius: 0.2 * scene.ao_radius,
            combine: Combine::Minimum,
        }),
        max_pixels: 9.0,
        seed: 7,
        ..plain
    };
    let still = ObscuranceSettings {
        turn: false,
        ..plain
    };
    // Tables of a kind are read by the same code, so one of them takes the plain settings and the other the rest.
    let cases = [
        (POINTS, plain),
        (POINTS, thick),
        (ObscuranceSampling::Points(BallSamples::SixtyFour), still),
        (LINES, plain),
        (ObscuranceSampling::Lines(DiskSamples::Six), thick),
        (ObscuranceSampling::Lines(DiskSamples::TwelveAround), thick),
        (ObscuranceSampling::Areas(DiskSamples::Seven), thick),
        (ObscuranceSampling::OneArea, plain),
    ];
    for (sampling, settings) in cases {
        for volume in VOLUMES {
            let case = Case {
                sampling,
                volume,
                settings,
            };
            // A sample within rounding of a pixel's edge falls to either side of it. Of an area the deviation is the root
            // of how much a neighbouring pixel counts: f32's 1e-7 of one beside a jump of 10 radii shows as 0.005.
            let tolerance = if case.takes_areas() { 1e-2 } else { 1e-4 };
            let (gpu, mirror) = (rendered(&shot, &case), shot.mirrored(&case));
            check(&format!("{case:?}"), &gpu, &mirror, tolerance, 0.002);
        }
    }
}

#[test]
fn moments_agree_with_their_mirror() {
    let gpu = pipelines::gpu();
    let (scene, tracer) = scene("colonnade");
    let size = [75, 50];
    let shot = Shot::of(&scene, &tracer, size);
    let case = Case {
        sampling: ObscuranceSampling::OneArea,
        volume: ObscuranceVolume::Sphere,
        settings: settings(1.0),
    };
    let pass = case.pass();
    let moments = pass
        .create_moments(&gpu.device, size[0], size[1])
        .expect("moments");
    let depth = gpu.texture(TextureFormat::R32Float, size[0], size[1], &shot.depths);
    let mut encoder = gpu.encoder();
    pass.record_moments(
        &gpu.device,
        &mut encoder,
        depth.texture().into(),
        &shot.camera,
        &moments,
        None,
    )
    .expect("valid input");
    gpu.finish(encoder);
    let texels: Vec<[f32; 4]> = gpu.read_buffer(moments.buffer());
    let pyramid = Pyramid::new(size, &shot.mirror().view_depths());
    let mut at = 0;
    for level in 1..=8 {
        let [width, height] = size.map(|n| n.div_ceil(1 << level));
        for i in 0..width * height {
            let [mean, variance, covered, inside] = texels[at].map(f64::from);
            at += 1;
            let truth = pyramid.at([i64::from(i % width), i64::from(i / width)], level);
            // Depths are of up to 20 units: 2e-6 is a rounding of theirs, which a small variance shows as one of twice its
            // root times as much.
            let tolerance = 1e-5 * (truth.variance.sqrt() + 1e-5) + 1e-5 * truth.variance;
            let fits = (mean - truth.mean).abs() <= 1e-5
                && (variance - truth.variance).abs() <= tolerance
                && (covered, inside) == (truth.covered, truth.inside);
            assert!(
                fits,
                "level {level}, texel {i}: {:?}, {truth:?}",
                texels[at - 1]
            );
        }
    }
    assert_eq!(at, texels.len());
}

#[test]
fn tables_come_from_their_seed_and_have_equal_shares() {
    for (domain, side, tables) in [
        (
            Domain::Disk,
            512,
            DiskSamples::ALL
                .into_iter()
                .filter(|table| *table != DiskSamples::Six)
                .map(DiskSamples::table)
                .collect::<Vec<_>>(),
        ),
        (
            Domain::Ball,
            64,
            BallSamples::ALL.map(BallSamples::table).to_vec(),
        ),
    ] {
        let cells = Cells::new(domain, side);
        for table in tables {
            let point = |p: &[f32; 3]| {
                let z = if domain == Domain::Ball { p[2] } else { 0.0 };
                DVec3::from([p[0], p[1], z].map(f64::from))
            };
            let points: Vec<DVec3> = table.iter().map(point).collect();
            let (shares, ..) = cells.voronoi(&points);
            for (i, share) in shares.iter().enumerate() {
                // A cell of the grid may change hands by the tables' six digits: 1e-5 of the domain each.
                let off = share * table.len() as f64 - 1.0;
                let imbalance = TOLERANCE + 1e-3;
                assert!(
                    off.abs() <= imbalance,
                    "{domain:?} of {}, {i}: {off}",
                    table.len()
                );
                if domain == Domain::Disk {
                    assert!(
                        (share - f64::from(table[i][2])).abs() < 1e-4,
                        "{}, {i}",
                        table.len()
                    );
                }
            }
        }
    }
    let made = generate(Domain::Disk, 5, true, 1);
    for (made, stored) in made.points.iter().zip(DiskSamples::Five.table()) {
        let stored = DVec3::new(stored[0].into(), stored[1].into(), 0.0);
        assert!(made.distance(stored) < 2e-6, "{made}, {stored}");
    }
}

#[test]
fn six_lines_are_a_centre_and_a_regular_pentagon() {
    let [center, ring @ ..] = DiskSamples::Six.table() else {
        panic!("no samples");
    };
    assert_eq!(center[..2], [0.0; 2]);
    let sum: f32 = ring.iter().map(|p| p[2]).sum();
    // The digits of the table.
    assert!((center[2] + sum - 1.0).abs() < 1e-6, "{center:?}, {ring:?}");
    for (i, p) in ring.iter().enumerate() {
        let angle = std::f64::consts::TAU * i as f64 / 5.0;
        let apart = DVec3::new(p[0].into(), p[1].into(), 0.0)
            - 0.67 * DVec3::new(angle.cos(), angle.sin(), 0.0);
        assert!(apart.length() < 1e-6 && p[2] == ring[0][2], "{i}: {p:?}");
    }
}

/// Projections of all kinds, with the same field of view.
fn projections(near: f64, far: f64) -> Vec<(&'static str, DMat4)> {
    let flip = DMat4::from_cols_array(&[
        1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0, 1.0,
    ]);
    let side = 0.7 * far.sqrt() * near.sqrt();
    let depth = near - far;
    let columns = |x: f64, y: f64, z: [f64; 2], w: [f64; 2]| {
        DMat4::from_cols_array(&[
            x, 0.0, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, 0.0, z[0], w[0], 0.0, 0.0, z[1], w[1],
        ])
    };
    let forward = columns(1.6, 2.4, [far / depth, near * far / depth], [-1.0, 0.0]);
    let orthographic = columns(
        1.0 / (1.5 * side),
        1.0 / side,
        [1.0 / depth, near / depth],
        [0.0, 1.0],
    );
    vec![
        ("reversed, infinite", perspective(45.0, 1.5, near)),
        ("forward", forward),
        ("reversed", flip * forward),
        ("orthographic", orthographic),
        ("orthographic, reversed", flip * orthographic),
    ]
}

/// A picture of planes, each given by a point and a normal relative to the eye: the nearest counts.
fn planes(camera: &Camera, planes: &[(DVec3, DVec3)]) -> Shot {
    let viewport = camera.viewport();
    let near = 1.0 - f64::from(camera.background_depth());
    let mut shot = Shot {
        camera: *camera,
        depths: Vec::new(),
        normals: Vec::new(),
        pixels: Vec::new(),
    };
    for i in 0..viewport.width * viewport.height {
        let x = f64::from(i % viewport.width) + 0.5;
        let y = f64::from(i / viewport.width) + 0.5;
        let from = camera.unproject(x, y, near).expect("the near plane");
        let direction = camera.unproject(x, y, 0.5).expect("a point") - from;
        let hit = planes
            .iter()
            .map(|(p, n)| ((*p - from).dot(*n) / direction.dot(*n), *n))
            .filter(|(t, _)| *t > 0.0)
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let depth = hit.and_then(|(t, _)| camera.project(from + t * direction));
        let sky = f64::from(camera.background_depth());
        shot.depths.push(depth.map_or(sky, |d| d.z) as f32);
        let n = hit.map_or(DVec3::ZERO, |(_, n)| n);
        shot.normals.push(n.as_vec3().to_array());
    }
    shot
}

/// Looks down −z.
fn camera(projection: DMat4, eye: DVec3, size: [u32; 2]) -> Camera {
    let viewport = Viewport::full(size[0], size[1]);
    Camera::look_at(eye, eye - DVec3::Z, DVec3::Y, projection, viewport).expect("valid matrices")
}

#[test]
fn a_plane_is_open_and_a_corner_is_not() {
    for scale in [1e-4, 1e5] {
        for (name, projection) in projections(0.1 * scale, 50.0 * scale) {
            // Far from the world's origin too: only the eye is there.
            let camera = camera(projection, DVec3::new(1e5, -3e4, 7e4), [48, 32]);
            let oblique = DVec3::new(0.5, 0.3, 0.8).normalize();
            let wall = (DVec3::new(0.0, 0.0, -2.0 * scale), oblique);
            let side = (
                DVec3::new(0.0, 0.0, -2.0 * scale),
                DVec3::new(-0.8, 0.1, 0.5).normalize(),
            );
            for volume in VOLUMES {
                let case = Case {
                    sampling: LINES,
                    volume,
                    settings: settings(0.3 * scale as f32),
                };
                let what = format!("{name}, scale {scale}: {case:?}");
                let flat = planes(&camera, &[wall]);
                let open = rendered(&flat, &case);
                // Without normals a slope's chords balance, but for what their pixels' places round to, and not at
                // the picture's edge, beyond which nothing is known.
                let sphere = volume == ObscuranceVolume::Sphere;
                let (least, edge) = if sphere { (0.9, 12) } else { (0.999, 0) };
                let inner = |[x, y]: &[u32; 2]| {
                    (edge..48 - edge).contains(x) && (edge..32 - edge).contains(y)
                };
                let pixels = flat.pixels().zip(&open).filter(|(p, _)| inner(p));
                let low = pixels.map(|(_, v)| *v).fold(1.0, f32::min);
                assert!(low >= least, "{what}: a plane is {low} open");
                let corner = planes(&camera, &[wall, side]);
                let open = rendered(&corner, &case);
                let low = open.iter().copied().fold(1.0, f32::min);
                assert!(low < 0.8, "{what}: a corner is {low} open");
                // f32 knows forward depths to 1e-5 of their distance here.
                check(&what, &open, &corner.mirrored(&case), 2e-3, 0.01);
            }
        }
    }
}

#[test]
fn a_viewport_may_lie_off_the_corner() {
    let gpu = pipelines::gpu();
    let (scene, tracer) = scene("cornell");
    let size = [40, 28];
    let mut shot = Shot::of(&scene, &tracer, size);
    let case = Case {
        sampling: LINES,
        volume: ObscuranceVolume::Hemisphere,
        settings: settings(0.2 * scene.ao_radius),
    };
    let areas = Case {
        sampling: ObscuranceSampling::Areas(DiskSamples::Five),
        volume: ObscuranceVolume::Sphere,
        ..case
    };
    let wanted = [case, areas].map(|case| rendered(&shot, &case));
    let ([x, y], around) = ([5, 3], [50, 40]);
    let within = |i: u32| {
        let [column, row] = [i % around[0], i / around[0]];
        let inside = (x..x + size[0]).contains(&column) && (y..y + size[1]).contains(&row);
        inside.then(|| ((row - y) * size[0] + column - x) as usize)
    };
    // What lies around it would obscure all that sees it.
    let depths: Vec<f32> = (0..around[0] * around[1])
        .map(|i| within(i).map_or(0.9, |at| shot.depths[at]))
        .collect();
    let normals: Vec<[f32; 4]> = (0..around[0] * around[1])
        .map(|i| {
            within(i).map_or([0.0; 4], |at| {
                DVec3::from(shot.normals[at].map(f64::from))
                    .extend(0.0)
                    .as_vec4()
                    .to_array()
            })
        })
        .collect();
    let depth = gpu.texture(TextureFormat::R32Float, around[0], around[1], &depths);
    let normal = gpu.texture(TextureFormat::Rgba32Float, around[0], around[1], &normals);
    let view = &scene.views[0];
    shot.camera = Camera::look_at(
        view.eye.into(),
        view.target.into(),
        view.up.into(),
        shot.camera.projection(),
        Viewport {
            x,
            y,
            ..Viewport::full(size[0], size[1])
        },
    )
    .expect("a scene's own view");
    for (case, wanted) in [case, areas].iter().zip(wanted) {
        let pass = case.pass();
        let moments = case.takes_areas().then(|| {
            pass.create_moments(&gpu.device, size[0], size[1])
                .expect("moments")
        });
        let texture = target(gpu, size);
        record(
            gpu,
            &pass,
            &shot,
            &depth,
            &normal,
            moments.as_ref(),
            &texture,
            &case.settings,
        )
        .expect("valid input");
        let found: Vec<f32> = gpu.read_texture(&texture, 0);
        assert!(found == wanted, "{case:?}");
    }
}

#[test]
fn sixteen_bits_of_depth_shade_no_plane() {
    let gpu = pipelines::gpu();
    let size = [48, 32];
    let (_, projection) = projections(0.02, 40.0).remove(1);
    let camera = camera(projection, DVec3::ZERO, size);
    let wall = (
        DVec3::new(0.0, 0.0, -18.0),
        DVec3::new(0.5, 0.3, 0.8).normalize(),
    );
    let side = (
        DVec3::new(0.0, 0.0, -18.0),
        DVec3::new(-0.8, 0.1, 0.5).normalize(),
    );
    let case = Case {
        sampling: LINES,
        volume: ObscuranceVolume::Hemisphere,
        settings: settings(3.0),
    };
    for (surfaces, flat) in [(&[wall][..], true), (&[wall, side][..], false)] {
        let mut shot = planes(&camera, surfaces);
        let steps: Vec<u16> = shot
            .depths
            .iter()
            .map(|d| (d * 65535.0).round() as u16)
            .collect();
        shot.depths = steps.iter().map(|d| f32::from(*d) / 65535.0).collect();
        let depth = gpu.texture(TextureFormat::Depth16Unorm, size[0], size[1], &steps);
        let normals: Vec<[f32; 4]> = shot
            .normals
            .iter()
            .map(|n| [n[0], n[1], n[2], 0.0])
            .collect();
        let normal = gpu.texture(TextureFormat::Rgba32Float, size[0], size[1], &normals);
        let texture = target(gpu, size);
        record(
            gpu,
            &case.pass(),
            &shot,
            &depth,
            &normal,
            None,
            &texture,
            &case.settings,
        )
        .expect("valid input");
        let image: Vec<f32> = gpu.read_texture(&texture, 0);
        let least = image.iter().copied().fold(1.0, f32::min);
        // A step of depth is 0.25 there, a twelfth of the radius.
        assert!(
            if flat { least > 0.99 } else { least < 0.8 },
            "{flat}: {least}"
        );
        let mut mirror = shot.mirror();
        mirror.decoder.depth_format = TextureFormat::Depth16Unorm;
        let mirrored: Vec<f64> = shot
            .pixels()
            .map(|p| mirror.openness(p, case.sampling, case.volume, &case.settings, None))
            .collect();
        check(&format!("16 bits, {flat}"), &image, &mirrored, 2e-3, 0.01);
    }
}

#[test]
fn many_samples_give_the_integral() {
    let (scene, tracer) = scene("cornell");
    let shot = Shot::of(&scene, &tracer, [64, 64]);
    let mirror = shot.mirror();
    let plain = settings(0.1 * scene.ao_radius);
    for volume in VOLUMES {
        let some = shot.pixels().zip(&shot.pixels).step_by(97);
        let truth: Vec<([u32; 2], [f64; 2])> = some
            .filter_map(|(pixel, seen)| {
                let receiver = &seen.as_ref()?.receiver;
                let of_depth = mirror.integral(pixel, volume, &plain, 14);
                let of_geometry =
                    integral_of_geometry(&shot.camera, &tracer, receiver, volume, &plain, 14);
                Some((pixel, [of_depth, of_geometry]))
            })
            .collect();
        for sampling in [
            ObscuranceSampling::Lines(DiskSamples::Sixteen),
            ObscuranceSampling::Lines(DiskSamples::Six),
            POINTS,
        ] {
            let mut errors = [0.0; 2];
            for &(pixel, truth) in &truth {
                let mean = (0..16)
                    .map(|seed| {
                        let settings = ObscuranceSettings { seed, ..plain };
                        mirror.openness(pixel, sampling, volume, &settings, None) / 16.0
                    })
                    .sum::<f64>();
                for (error, truth) in errors.iter_mut().zip(truth) {
                    *error += (mean - truth).abs();
                }
            }
            let [of_depth, of_geometry] = errors.map(|e| e / truth.len() as f64);
            println!("{volume:?}, {sampling:?}: {of_depth:.4}, {of_geometry:.4}");
            // What is left of sixteen reflections, and of pixels that are not small beside a radius of a few: at silhouettes
            // the depth in between two of them stands for a surface that a sample at their centres never sees.
            // Points near a slope are held against a pixel's own depth, which shades it where pixels are large.
            // Five lines beside the centre are as far from it, each, and see nothing between.
            let most = match sampling {
                POINTS => [0.15, 0.15],
                ObscuranceSampling::Lines(DiskSamples::Six) => [0.08, 0.07],
                _ => [0.06, 0.03],
            };
            assert!(
                of_depth < most[0] && of_geometry < most[1],
                "{volume:?}, {sampling:?}: {of_depth}, {of_geometry}"
            );
        }
    }
}

#[test]
fn lines_move_less_than_as_many_points_when_the_camera_does() {
    let (scene, tracer) = scene("colonnade");
    let shots = [0.0, 2e-3].map(|shift| {
        let camera = camera_of(&scene, shift * DVec3::new(1.0, 0.3, 0.0), [64, 48]);
        Shot::new(&camera, &scene, &tracer)
    });
    // Of several seeds: which samples a pixel's edge passes over is luck.
    let moved = |sampling| {
        let squares: f64 = (0..8)
            .map(|seed| {
                let case = Case {
                    sampling,
                    volume: ObscuranceVolume::Hemisphere,
                    settings: ObscuranceSettings {
                        seed,
                        ..settings(0.5 * scene.ao_radius)
                    },
                };
                let [a, b] = [0, 1].map(|i: usize| shots[i].mirrored(&case));
                a.iter()
                    .zip(&b)
                    .map(|(a, b)| (a - b) * (a - b))
                    .sum::<f64>()
                    / a.len() as f64
            })
            .inspect(|square| println!("{sampling:?}: {:.4}", square.sqrt()))
            .sum();
        (squares / 8.0).sqrt()
    };
    let (lines, points) = (
        moved(ObscuranceSampling::Lines(DiskSamples::Six)),
        moved(ObscuranceSampling::Points(BallSamples::Six)),
    );
    println!("lines {lines:.4}, points {points:.4}");
    assert!(
        lines < 0.05 && lines < points,
        "lines {lines}, points {points}"
    );
}

#[test]
fn extremes_are_numbers() {
    let odd = [f32::NAN, f32::INFINITY, 0.0, 1e-30, -1.0, 0.5, 2.0, 1e30];
    for size in [[1, 1], [17, 5]] {
        for (name, projection) in projections(0.1, 50.0).into_iter().step_by(3) {
            let camera = camera(projection, DVec3::ZERO, size);
            let count = (size[0] * size[1]) as usize;
            let pick = |i: usize| odd[i * 7 % odd.len()];
            let plane = planes(&camera, &[(DVec3::NEG_Z, DVec3::Z)]);
            let shot = |depths: Vec<f32>, normals| Shot {
                depths,
                normals,
                camera,
                pixels: Vec::new(),
            };
            let sky = shot(
                vec![camera.background_depth(); count],
                plane.normals.clone(),
            );
            let broken = shot(
                (0..count).map(pick).collect(),
                (0..count)
                    .map(|i| [pick(i), pick(i + 3), pick(i + 5)])
                    .collect(),
            );
            let bare = shot(plane.depths.clone(), vec![[f32::NAN; 3]; count]);
            for volume in VOLUMES {
                for sampling in [LINES, POINTS, ObscuranceSampling::OneArea] {
                    for radius in [0.0, 0.5, f32::INFINITY] {
                        let case = Case {
                            sampling,
                            volume,
                            settings: settings(radius),
                        };
                        let numbers = |image: &[f32]| image.iter().all(|v| (0.0..=1.0).contains(v));
                        let image = rendered(&broken, &case);
                        assert!(numbers(&image), "{name}, {size:?}, {case:?}: {image:?}");
                        if radius != 0.5 {
                            continue;
                        }
                        let image = rendered(&bare, &case);
                        assert!(numbers(&image), "{name}, {size:?}, {case:?}: {image:?}");
                        let image = rendered(&sky, &case);
                        assert!(
                            image.iter().all(|v| *v == 1.0),
                            "{name}, {size:?}, {case:?}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn a_list_computes_its_pixels_alone() {
    let gpu = pipelines::gpu();
    let (scene, tracer) = scene("cornell");
    let size = [37, 26];
    let shot = Shot::of(&scene, &tracer, size);
    for sampling in [LINES, ObscuranceSampling::Areas(DiskSamples::Five)] {
        let case = Case {
            sampling,
            volume: ObscuranceVolume::Sphere,
            settings: settings(0.2 * scene.ao_radius),
        };
        list_of(gpu, &shot, &case);
    }
}

/// Computes every third pixel of each sub-image, and compares with the whole image.
fn list_of(gpu: &Gpu, shot: &Shot, case: &Case) {
    let size = shot.size();
    let whole = rendered(shot, case);
    let moments = case.takes_areas().then(|| {
        case.pass()
            .create_moments(&gpu.device, size[0], size[1])
            .expect("moments")
    });
    let pass = case.pass();
    let depth = gpu.texture(TextureFormat::R32Float, size[0], size[1], &shot.depths);
    for level in 0..4 {
        let sub = size.map(|n: u32| n.div_ceil(1 << level));
        let listed: Vec<u32> = (0..sub[0] * sub[1])
            .filter(|i| i % 3 == 0)
            .map(|i| (i % sub[0]) | (i / sub[0]) << 16)
            .collect();
        let mut words = vec![listed.len() as u32];
        words.extend(&listed);
        words.resize((1 + sub[0] * sub[1]) as usize, 0);
        let pixels = gpu.buffer(&words, wgpu::BufferUsages::STORAGE);
        let groups = [(listed.len() as u32).div_ceil(64), 1, 1];
        let dispatch = gpu.buffer(&groups, wgpu::BufferUsages::INDIRECT);
        let texture = target(gpu, sub);
        let work = PixelList {
            level,
            pixels: &pixels,
            dispatch: &dispatch,
        };
        let input = ObscuranceInput {
            depth: depth.texture().into(),
            normals: None,
            camera: &shot.camera,
            moments: moments.as_ref(),
            work: Some(work),
            target: (&texture).into(),
            timestamps: None,
        };
        let mut encoder = gpu.encoder();
        if let Some(moments) = &moments {
            pass.record_moments(
                &gpu.device,
                &mut encoder,
                depth.texture().into(),
                &shot.camera,
                moments,
                None,
            )
            .expect("valid input");
        }
        pass.record(&gpu.device, &mut encoder, &input, &case.settings)
            .expect("valid input");
        gpu.finish(encoder);
        let image: Vec<f32> = gpu.read_texture(&texture, 0);
        for (i, value) in image.iter().enumerate() {
            let texel = [i as u32 % sub[0], i as u32 / sub[0]];
            let at = [0, 1].map(|k| ((texel[k] << level) + ((1 << level) >> 1)).min(size[k] - 1));
            let wanted = if i % 3 == 0 {
                whole[(at[1] * size[0] + at[0]) as usize]
            } else {
                -1.0
            };
            assert_eq!(*value, wanted, "{case:?}, level {level}, {texel:?}");
        }
    }
}

#[test]
fn what_cannot_be_honoured_is_refused() {
    let gpu = pipelines::gpu();
    let plain = ObscuranceSettings::default();
    let bad = |settings: ObscuranceSettings, field: &str| match settings.validate() {
        Err(Error::Setting { field: found, .. }) => assert_eq!(found, field),
        other => panic!("{field}: {other:?}"),
    };
    for radius in [-1.0, f32::NAN] {
        bad(
            ObscuranceSettings { radius, ..plain },
            "ObscuranceSettings::radius",
        );
        let second = Some(SecondRadius {
            radius,
            combine: Combine::Product,
        });
        bad(
            ObscuranceSettings { second, ..plain },
            "SecondRadius::radius",
        );
    }
    for value in [0.0, -1.0, f32::NAN] {
        bad(
            ObscuranceSettings {
                thickness: value,
                ..plain
            },
            "ObscuranceSettings::thickness",
        );
        bad(
            ObscuranceSettings {
                max_pixels: value,
                ..plain
            },
            "ObscuranceSettings::max_pixels",
        );
        bad(
            ObscuranceSettings {
                box_half_width: value,
                ..plain
            },
            "ObscuranceSettings::box_half_width",
        );
    }
    let camera = camera(perspective(45.0, 1.0, 0.1), DVec3::ZERO, [8, 8]);
    let shot = planes(&camera, &[(DVec3::NEG_Z, DVec3::Z)]);
    let depth = gpu.texture(TextureFormat::R32Float, 8, 8, &shot.depths);
    let small = target(gpu, [8, 7]);
    let right = target(gpu, [8, 8]);
    let record = |sampling, volume, texture: &wgpu::Texture, moments: Option<&DepthMoments>| {
        let case = Case {
            sampling,
            volume,
            settings: plain,
        };
        let input = ObscuranceInput {
            depth: depth.texture().into(),
            normals: None,
            camera: &shot.camera,
            moments,
            work: None,
            target: texture.into(),
            timestamps: None,
        };
        let mut encoder = gpu.encoder();
        case.pass()
            .record(&gpu.device, &mut encoder, &input, &plain)
    };
    let sphere = ObscuranceVolume::Sphere;
    assert_eq!(record(LINES, sphere, &right, None), Ok(()));
    let refused = record(LINES, sphere, &small, None);
    assert!(matches!(refused, Err(Error::Size { .. })), "{refused:?}");
    let refused = record(LINES, ObscuranceVolume::Hemisphere, &right, None);
    assert!(
        matches!(refused, Err(Error::Mismatch { .. })),
        "{refused:?}"
    );
    let area = ObscuranceSampling::OneArea;
    let refused = record(area, sphere, &right, None);
    assert!(
        matches!(refused, Err(Error::Mismatch { .. })),
        "{refused:?}"
    );
    let other = Case {
        sampling: area,
        volume: sphere,
        settings: plain,
    }
    .pass()
    .create_moments(&gpu.device, 9, 8)
    .expect("moments");
    let refused = record(area, sphere, &right, Some(&other));
    assert!(
        matches!(refused, Err(Error::Mismatch { .. })),
        "{refused:?}"
    );
}

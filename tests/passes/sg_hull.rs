//! The hull: segments against a flood fill, vertices and pixels against the f64 mirror, the picture against light gathered
//! at every pixel, and what must hold whatever is asked for.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::LazyLock,
};
use support::testing::pipelines;

use deep_screen_space::{
    Camera, Components, Error, GBuffer, Gatherer, GathererBinding, HullSegment, HullVertex, Light,
    PolygonLight, SgHull, SgHullCounts, SgHullDescriptor, SgHullInput, SgHullSettings, SgHullSize,
    SgHullView, Viewport,
    glam::{DMat4, DVec3, DVec4},
    reference::{
        packing::unpack_normal,
        sg_hull::{Corner, Fit, Hull, Part, gather_lights, is_flat, is_tiny, quad_error, shade},
        shell_splatter::Receiver,
    },
    scenes,
    spherical_gaussian::DLightMoments,
    wgpu::{self, BufferUsages, TextureFormat as Format},
};
use support::testing::frames::Decoded;
use support::testing::shot::{Shot, camera_of};
use support::{
    gpu::Gpu,
    hull::{HullRenderer, LightSource, difference},
    raster::{Raster, perspective},
    scene::SceneBuffers,
};

const SKY: u32 = 0xffff_ffff;
const FORMAT: Format = Format::Rgba32Float;
/// What no pixel is.
const UNTOUCHED: f64 = -7.0;

fn hull(gpu: &Gpu, gatherer: &Gatherer, components: Components) -> SgHull {
    let descriptor = SgHullDescriptor {
        gatherer,
        target: FORMAT,
        albedo: false,
        glossy: false,
        components,
    };
    SgHull::new(&gpu.device, &descriptor).expect("pipelines")
}

/// What most tests need: drivers compile for seconds.
struct Lab {
    gpu: &'static Gpu,
    gatherer: Gatherer,
    hull: SgHull,
}

static LAB: LazyLock<Lab> = LazyLock::new(|| {
    let gpu = pipelines::gpu();
    let gatherer = Gatherer::lights(&gpu.device);
    let hull = hull(gpu, &gatherer, Components::UnionFind);
    Lab {
        gpu,
        gatherer,
        hull,
    }
});

/// All that a recording left.
struct Recorded {
    size: SgHullSize,
    counts: SgHullCounts,
    segment_of: Vec<u32>,
    segments: Vec<HullSegment>,
    vertices: Vec<HullVertex>,
    /// Of the viewport.
    pixels: Vec<[f32; 4]>,
}

impl Recorded {
    /// The place of a segment among the vertices.
    fn index(&self, slot: u32) -> u32 {
        let regular = self.counts.segments.min(self.size.segments);
        if slot < self.size.segments {
            slot
        } else {
            regular + slot - self.size.segments
        }
    }
}

fn record(
    gpu: &Gpu,
    hull: &SgHull,
    shot: &Shot,
    gather: &GathererBinding,
    settings: &SgHullSettings,
    size: SgHullSize,
) -> Recorded {
    let device = &gpu.device;
    let viewport = shot.camera.viewport();
    let view = hull.create_view(device, size).expect("a view");
    let [width, height] = [viewport.x + viewport.width, viewport.y + viewport.height];
    let target = gpu.target(FORMAT, width, height);
    let mut encoder = gpu.encoder();
    clear(&mut encoder, &target);
    let camera = &shot.camera;
    let mut decoded = Decoded::of(camera);
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), camera, camera.eye());
    let input = SgHullInput::new(&frame, Some(gather), target.texture());
    hull.record(device, &mut encoder, &input, settings, &view)
        .expect("it fits");
    gpu.finish(encoder);
    let texels: Vec<[f32; 4]> = gpu.read_texture(target.texture(), 0);
    let counts: Vec<SgHullCounts> = gpu.read_buffer(view.counts());
    Recorded {
        size,
        counts: counts[0],
        segment_of: gpu.read_buffer(view.segment_of()),
        segments: gpu.read_buffer(view.segments()),
        vertices: gpu.read_buffer(view.vertices()),
        pixels: (0..viewport.width * viewport.height)
            .map(|i| {
                let [x, y] = [
                    i % viewport.width + viewport.x,
                    i / viewport.width + viewport.y,
                ];
                texels[(y * width + x) as usize]
            })
            .collect(),
    }
}

fn clear(encoder: &mut wgpu::CommandEncoder, target: &wgpu::TextureView) {
    let color = wgpu::Color {
        r: UNTOUCHED,
        g: UNTOUCHED,
        b: UNTOUCHED,
        a: UNTOUCHED,
    };
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(color),
                store: wgpu::StoreOp::Store,
            },
        })],
        ..Default::default()
    });
}

fn lamps() -> Vec<Light> {
    vec![
        Light::Point {
            position: DVec3::new(0.4, 2.6, 0.7),
            intensity: [9.0, 7.0, 5.0],
        },
        Light::Point {
            position: DVec3::new(-1.1, 1.9, 2.0),
            intensity: [1.0, 2.0, 4.0],
        },
        Light::Directional {
            direction: DVec3::new(0.4, -1.0, -0.3),
            irradiance: [0.3, 0.5, 0.2],
        },
    ]
}

/// Every pixel is covered, by a quad whose bounds it lies in, and is a number.
#[track_caller]
fn check_covered(recorded: &Recorded, shot: &Shot, name: &str) {
    let viewport = shot.camera.viewport();
    let receivers = shot.receivers(shot.camera.eye());
    let mut uncovered = 0;
    for (i, (pixel, slot)) in recorded.pixels.iter().zip(&recorded.segment_of).enumerate() {
        if pixel[3] != 1.0 {
            uncovered += 1;
            continue;
        }
        assert!(
            pixel.iter().all(|c| c.is_finite() && *c >= 0.0),
            "{name}: pixel {i} is {pixel:?}"
        );
        if *slot == SKY {
            assert_eq!(*pixel, [0.0, 0.0, 0.0, 1.0], "{name}: sky pixel {i}");
            continue;
        }
        let segment = recorded.segments[*slot as usize];
        let [x, y] = [i as u32 % viewport.width, i as u32 / viewport.width];
        let [left, top, right, bottom] = segment.rect;
        assert!(
            (left..right).contains(&x) && (top..bottom).contains(&y),
            "{name}: pixel {x}, {y} is not in {segment:?}"
        );
        if let Some(receiver) = &receivers[i] {
            let depth = receiver.position.dot(axis(&shot.camera));
            let slack = 1e-4 * depth.abs() + 1e-6;
            assert!(
                depth >= f64::from(segment.nearest) - slack
                    && depth <= f64::from(segment.farthest) + slack,
                "{name}: pixel {x}, {y} at {depth} is not in {segment:?}"
            );
        }
    }
    assert_eq!(
        uncovered,
        0,
        "{name}: uncovered of {}",
        recorded.pixels.len()
    );
}

/// Away from the camera: along the ray through the middle.
fn axis(camera: &Camera) -> DVec3 {
    let rotation = camera.rotation();
    -rotation.row(2)
}

fn quad_sides(
    camera: &Camera,
    receivers: &[Option<Receiver>],
    settings: &SgHullSettings,
    widened: f64,
) -> Vec<Option<u32>> {
    Hull {
        camera,
        receivers,
        settings,
    }
    .components(widened)
}

#[test]
fn segments_are_components() {
    let gpu = pipelines::gpu();
    let gatherer = Gatherer::lights(&gpu.device);
    let both = [Components::UnionFind, Components::Propagation]
        .map(|components| (components, hull(gpu, &gatherer, components)));
    for (name, view) in [("colonnade", 0), ("fence", 1)] {
        let scene = scenes::by_name(name).expect("a scene");
        let shot = Shot::new(gpu, &scene, &camera_of(&scene, view, [128, 90]));
        let gather = gatherer
            .bind_lights(&gpu.device, &lamps(), shot.camera.eye())
            .expect("lights");
        let receivers = shot.receivers(shot.camera.eye());
        for quad in [8, 32] {
            let settings = SgHullSettings {
                quad,
                ..SgHullSettings::default()
            };
            // Rounding of positions and of packed normals moves what is close to a threshold either way.
            let [tight, loose] =
                [0.97, 1.03].map(|w| quad_sides(&shot.camera, &receivers, &settings, w));
            let count = |c: &[Option<u32>]| c.iter().flatten().collect::<BTreeSet<_>>().len();
            for (components, hull) in &both {
                let inputs = format!("{name} {view}, quad {quad}, {components:?}");
                let recorded = record(
                    gpu,
                    hull,
                    &shot,
                    &gather,
                    &settings,
                    SgHullSize::new(128, 90),
                );
                let found = recorded.counts.segments as usize;
                println!(
                    "{inputs}: {found} segments, {} components, {} pixels of last resort",
                    count(&tight),
                    recorded.counts.fallback_pixels
                );
                // No segment joins two components.
                let mut component_of = BTreeMap::new();
                for (i, slot) in recorded.segment_of.iter().enumerate() {
                    if *slot != SKY && *slot < recorded.size.segments {
                        let here = loose[i];
                        let there = *component_of.entry(*slot).or_insert(here);
                        assert_eq!(here, there, "{inputs}: segment {slot} at pixel {i}");
                    }
                }
                match components {
                    Components::UnionFind if recorded.counts.fallbacks == 0 => assert!(
                        (count(&loose)..=count(&tight)).contains(&found),
                        "{inputs}: {found} segments, {} to {} components",
                        count(&loose),
                        count(&tight)
                    ),
                    _ => assert!(
                        found >= count(&loose) || recorded.counts.fallbacks > 0,
                        "{inputs}: {found} segments, {} components",
                        count(&loose)
                    ),
                }
            }
        }
    }
}

#[test]
fn vertices_and_pixels_are_those_of_the_mirror() {
    let Lab {
        gpu,
        gatherer,
        hull,
    } = &*LAB;
    let settings = SgHullSettings::default();
    // Light beside a wall leaves the rest dark: there the error is in units of the dimmest corner. Columns have it from their
    // normals.
    let beside = Light::Point {
        position: DVec3::new(-2.6, 2.7, 0.0),
        intensity: [1.0, 2.0, 3.0],
    };
    for (name, quad, error_threshold, lights) in [
        ("cornell", 4, 0.3, lamps()),
        ("cornell", 4, 0.3, vec![beside]),
        ("cornell", 16, 0.1, lamps()),
        ("fence", 4, 0.3, lamps()[2..].to_vec()),
        ("colonnade", 4, 0.06, lamps()),
    ] {
        let settings = SgHullSettings {
            quad,
            error_threshold,
            ..settings
        };
        let scene = scenes::by_name(name).expect("a scene");
        let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [96, 64]));
        let eye = shot.camera.eye();
        let gather = gatherer
            .bind_lights(&gpu.device, &lights, eye)
            .expect("lights");
        let size = SgHullSize::new(96, 64);
        let recorded = record(gpu, hull, &shot, &gather, &settings, size);
        let receivers = shot.receivers(eye);
        let mirror = Hull {
            camera: &shot.camera,
            receivers: &receivers,
            settings: &settings,
        };
        let (mut off_vertices, mut off_pixels, mut vertices) = (0, 0, 0);
        let (mut gathered, mut sum) = (0_u32, 0.0);
        let mut corners = BTreeMap::new();
        let mut slots: BTreeSet<u32> = recorded.segment_of.iter().copied().collect();
        slots.remove(&SKY);
        let slot_of: BTreeMap<u32, u32> = slots.iter().map(|s| (recorded.index(*s), *s)).collect();
        let mut shared = 0;
        for slot in slots {
            let segment = recorded.segments[slot as usize];
            if is_tiny(&segment) {
                continue;
            }
            let list = [0, 1, 2, 3].map(|corner| {
                let own = recorded.vertices[(4 * recorded.index(slot) + corner) as usize];
                let place = |slot: u32, corner| {
                    let segment = recorded.segments[slot as usize];
                    mirror
                        .place(&segment, slot, &recorded.segment_of, corner)
                        .expect("a place")
                };
                // Light of a neighbour is that of the same point of the same surface, and gathered there.
                let found = recorded.vertices[own.owner as usize];
                assert_eq!(found.owner, own.owner, "{name}: {slot} {corner}");
                let owner = (slot_of[&(own.owner / 4)], own.owner % 4);
                if owner.0 != slot {
                    shared += 1;
                    let corner_of = |(slot, corner): (u32, u32)| {
                        let rect = recorded.segments[slot as usize].rect;
                        [
                            rect[(2 * (corner & 1)) as usize],
                            rect[(1 + (corner & 2)) as usize],
                        ]
                    };
                    assert_eq!(
                        corner_of(owner),
                        corner_of((slot, corner)),
                        "{name}: {slot}"
                    );
                    let [a, b] = [(slot, corner), owner].map(|(slot, corner)| {
                        let (position, normal) = place(slot, corner);
                        Receiver { position, normal }
                    });
                    assert!(mirror.similar(&a, &b, 1.03), "{name}: {slot}, {a:?}, {b:?}");
                }
                let (position, normal) = place(owner.0, owner.1);
                let lobes = gather_lights(&lights, position + eye, normal);
                if owner == (slot, corner) {
                    gathered += 1;
                    sum += lobes.irradiance.element_sum() / 3.0;
                }
                let excess = lobes.excess(normal);
                let total = lobes.moments.iter().fold(1e-6, |s, m| f64::max(s, m.total));
                let near = |a: DVec3, b: DVec3, tolerance: f64| a.distance(b) <= tolerance;
                let wide = |v: [f32; 3]| DVec3::from(v.map(f64::from));
                let red = DVec3::from([found.red[0], found.red[1], found.red[2]].map(f64::from));
                vertices += 1;
                // Normals are packed to 16 bits, positions known to 1e-6 of the distance: 1e-3 of the light is far beyond.
                if !(near(wide(found.position), position, 1e-3 * position.length())
                    && near(red, lobes.moments[0].vector, 2e-3 * total)
                    && near(wide(found.excess), excess, 2e-3 * total))
                {
                    off_vertices += 1;
                }
                let moments = |m: [f32; 4]| DLightMoments {
                    vector: DVec3::new(m[0].into(), m[1].into(), m[2].into()),
                    total: m[3].into(),
                };
                let found = Corner {
                    moments: [found.red, found.green, found.blue].map(moments),
                    excess: wide(found.excess),
                    depth: own.depth.into(),
                };
                let expected = found.irradiance(unpack_normal(segment.normal));
                assert!(
                    near(wide(own.irradiance), expected, 1e-3 * total),
                    "{name}: {slot} {corner}: {:?}, expected {expected}",
                    own.irradiance
                );
                found
            });
            corners.insert(slot, list);
        }
        // A quad's normals: a pixel is a texel here.
        let mut normals: BTreeMap<u32, Vec<DVec3>> = BTreeMap::new();
        for (slot, receiver) in recorded.segment_of.iter().zip(&receivers) {
            if let Some(receiver) = receiver {
                normals.entry(*slot).or_default().push(receiver.normal);
            }
        }
        for (slot, list) in &normals {
            let mean = list.iter().sum::<DVec3>() / list.len() as f64;
            let expected = (2.0 * (1.0 - mean.length())).max(0.0).sqrt();
            let found = f64::from(recorded.segments[*slot as usize].spread);
            // What the kernel takes off for rounding is 1.4e-3 where there is nothing else.
            assert!(
                (found - expected).abs() < 2e-3 + 0.02 * expected,
                "{name}: segment {slot} of {} pixels: {found}, expected {expected}",
                list.len()
            );
        }
        // Each vertex that light is gathered at counts, once.
        assert_eq!(recorded.counts.gathered, gathered, "{name}");
        let mean = f64::from(recorded.counts.mean_irradiance);
        let expected = sum / f64::from(gathered);
        assert!(
            (mean - expected).abs() < 2e-3 * expected,
            "{name}: mean {mean}, expected {expected}"
        );
        let (mut exact, mut flat, mut either, mut split) = (0_u32, 0, 0, 0_u32);
        for (i, (slot, pixel)) in recorded.segment_of.iter().zip(&recorded.pixels).enumerate() {
            let Some(receiver) = receivers[i].as_ref().filter(|_| *slot != SKY) else {
                continue;
            };
            let segment = recorded.segments[*slot as usize];
            let truth = || {
                gather_lights(&lights, receiver.position + eye, receiver.normal).irradiance
                    / std::f64::consts::PI
            };
            let found = DVec3::from([pixel[0], pixel[1], pixel[2]].map(f64::from));
            let list = corners.get(slot).filter(|_| *slot < recorded.size.segments);
            let Some(list) = list else {
                exact += 1;
                off_pixels += u32::from(found.distance(truth()) > 2e-3 * truth().length() + 1e-6);
                continue;
            };
            let at = [i as u32 % 96, i as u32 / 96];
            let hull = shade(&segment, list, at, receiver.normal);
            let scale = list
                .iter()
                .fold(1e-6, |s, c| f64::max(s, c.moments[1].total));
            let is = |expected: DVec3| found.distance(expected) <= 2e-3 * scale;
            let bound = f64::from(settings.error_threshold);
            let here = quad_error(&segment, list, mean);
            // Rounding moves what is close to the bound either way.
            let whole = Part::whole(&segment, list);
            let splits = is_flat(&segment) && whole.can_be_split();
            let near_bound = (here / bound - 1.0).abs() < 0.01;
            let right = if here < bound || near_bound {
                flat += i32::from(is_flat(&segment));
                is(hull)
            } else {
                false
            } || if !splits && (here >= bound || near_bound) {
                exact += u32::from(!near_bound);
                either += u32::from(near_bound);
                is(truth())
            } else {
                false
            } || if splits && (here >= bound || near_bound) {
                // Rounding moves what a part is, too: by more, since what is off is a difference of lights known to 1e-3.
                let found: Vec<Fit> = [0.95, 1.0, 1.05]
                    .iter()
                    .flat_map(|widened| {
                        let mut parts = Vec::new();
                        mirror
                            .split(
                                (&segment, *slot, &recorded.segment_of),
                                &whole,
                                (mean, bound * widened),
                                &|position, normal| {
                                    gather_lights(&lights, position + eye, normal).irradiance
                                },
                                &mut parts,
                            )
                            .expect("places");
                        parts.into_iter().filter(|(part, _)| part.contains(at))
                    })
                    .filter(|(part, fit)| match fit {
                        Fit::Quad => {
                            let middle = at.map(|x| f64::from(x) + 0.5);
                            is(part.shown(&shot.camera, middle) / std::f64::consts::PI)
                        }
                        Fit::Pixels => is(truth()),
                    })
                    .map(|(_, fit)| fit)
                    .collect();
                either += u32::from(found.contains(&Fit::Pixels));
                split += u32::from(found.contains(&Fit::Quad));
                !found.is_empty()
            } else {
                false
            };
            off_pixels += u32::from(!right);
        }
        println!(
            "{name}: {exact} pixels by themselves, {either} perhaps, {flat} of flat quads, {split} of parts"
        );
        assert!(
            exact > 20 && flat > 20 && (name != "cornell" || split > 100),
            "{name}"
        );
        assert!(
            (exact..=exact + either).contains(&recorded.counts.per_pixel),
            "{name}: {} of {exact} and {either}",
            recorded.counts.per_pixel
        );
        // Most of a flat wall's are.
        assert!(
            name != "cornell" || quad > 4 || 2 * shared > vertices,
            "{shared} of {vertices}"
        );
        println!(
            "{name}: {shared} shared, {off_vertices} of {vertices} vertices and {off_pixels} of {} pixels are off",
            recorded.pixels.len()
        );
        // A plane that is seen edge-on puts its corners where rounding has them.
        assert!(off_vertices * 100 <= vertices, "{name}");
        assert!(
            off_pixels as usize * 1000 <= recorded.pixels.len(),
            "{name}"
        );
    }
}

#[test]
fn every_pixel_is_covered() {
    let Lab {
        gpu,
        gatherer,
        hull,
    } = &*LAB;
    let settings = SgHullSettings::default();
    let half = 4.0;
    let (near, far) = (1.0, 40.0);
    let f = 1.0 / 0.5;
    let a = -far / (far - near);
    let orthographic = DMat4::from_cols(
        DVec4::X / half,
        DVec4::Y / half,
        DVec4::Z * (1.0 / (far - near)),
        DVec4::new(0.0, 0.0, far / (far - near), 1.0),
    );
    let forward = DMat4::from_cols(
        DVec4::X * f,
        DVec4::Y * f,
        DVec4::new(0.0, 0.0, a, -1.0),
        DVec4::Z * (a * near),
    );
    let off_axis = DMat4::from_cols(
        DVec4::X * f,
        DVec4::Y * f,
        DVec4::new(0.4, -0.2, 0.0, -1.0),
        DVec4::Z * 0.1,
    );
    let projections = [
        ("reversed", perspective(50.0, 1.0, 0.05)),
        ("forward", forward),
        ("off-axis", off_axis),
        ("orthographic", orthographic),
    ];
    let mut fallbacks = 0;
    {
        let scene_name = "fence";
        let scene = scenes::by_name(scene_name).expect("a scene");
        let view = &scene.views[0];
        for (name, projection) in projections {
            for (viewport, grid, segments) in [
                (Viewport::full(97, 61), 1024, 4096),
                (
                    Viewport {
                        x: 5,
                        y: 3,
                        width: 90,
                        height: 110,
                    },
                    32,
                    4096,
                ),
                (Viewport::full(64, 64), 64, 5),
                (Viewport::full(1, 1), 32, 0),
                (Viewport::full(3, 70), 33, 100),
            ] {
                let camera = Camera::look_at(
                    view.eye.into(),
                    view.target.into(),
                    view.up.into(),
                    projection,
                    viewport,
                )
                .expect("a camera");
                let shot = Shot::new(gpu, &scene, &camera);
                let gather = gatherer
                    .bind_lights(&gpu.device, &lamps(), camera.eye())
                    .expect("lights");
                let size = SgHullSize {
                    grid,
                    segments,
                    ..SgHullSize::new(viewport.width, viewport.height)
                };
                let recorded = record(gpu, hull, &shot, &gather, &settings, size);
                let inputs = format!("{scene_name}, {name}, {viewport:?}, {size:?}");
                check_covered(&recorded, &shot, &inputs);
                fallbacks += recorded.counts.fallbacks;
            }
        }
    }
    assert!(fallbacks > 0, "the last resort was not among the cases");
}

/// A pixel in two is something else: segments of one pixel, in a picture finer than the grid as well.
#[test]
fn foliage_is_covered() {
    let Lab {
        gpu,
        gatherer,
        hull,
    } = &*LAB;
    let scene = scenes::cornell();
    let mut shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [72, 72]));
    let hash = |i: u32| deep_screen_space::reference::hashing::hash(i);
    // Reversed depth: any value above 0 is somewhere.
    let depth: Vec<f32> = (0..72 * 72)
        .map(|i| match hash(i) % 8 {
            0 => 0.0,
            k => 0.002 * k as f32,
        })
        .collect();
    let normal: Vec<[f32; 4]> = (0..72 * 72)
        .map(|i| match hash(i + 9999) % 5 {
            0 => [0.0; 4],
            1 => [f32::NAN; 4],
            2 => [1.0, 0.0, 0.2, 0.0],
            3 => [0.0, -1.0, 0.1, 0.0],
            _ => [0.0, 0.1, 1.0, 0.0],
        })
        .collect();
    shot.upload(gpu, &depth, &normal);
    let gather = gatherer
        .bind_lights(&gpu.device, &lamps(), shot.camera.eye())
        .expect("lights");
    for (grid, segments) in [(1024, 10000), (36, 10000), (36, 40)] {
        let size = SgHullSize {
            grid,
            segments,
            ..SgHullSize::new(72, 72)
        };
        let recorded = record(gpu, hull, &shot, &gather, &SgHullSettings::default(), size);
        println!("grid {grid}, room {segments}: {:?}", recorded.counts);
        let untouched = recorded.pixels.iter().filter(|p| p[3] != 1.0).count();
        assert_eq!(untouched, 0, "grid {grid}, room {segments}");
        let finite = |p: &[f32; 4]| p.iter().all(|c| c.is_finite());
        assert!(recorded.pixels.iter().all(finite), "grid {grid}");
    }
}

#[test]
fn extreme_lights() {
    let Lab {
        gpu,
        gatherer,
        hull,
    } = &*LAB;
    let scene = scenes::cornell();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [64, 64]));
    let receivers = shot.receivers(shot.camera.eye());
    let on_surface = receivers
        .iter()
        .flatten()
        .next()
        .expect("a surface")
        .position;
    let directional = |direction: DVec3, irradiance: f32| Light::Directional {
        direction,
        irradiance: [irradiance; 3],
    };
    let around: Vec<Light> = [DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .flat_map(|d| [directional(d, 1.0), directional(-d, 1.0)])
        .collect();
    let at_surface = Light::Point {
        position: shot.camera.eye() + on_surface,
        intensity: [1.0; 3],
    };
    for (name, lights) in [
        ("none", vec![]),
        ("black", vec![directional(DVec3::X, 0.0)]),
        ("one", vec![directional(DVec3::new(0.3, -1.0, -0.5), 1.0)]),
        (
            "one of 1e6",
            vec![directional(DVec3::new(0.3, -1.0, -0.5), 1e6)],
        ),
        (
            "the brightest",
            vec![directional(DVec3::new(0.3, -1.0, -0.5), 1e18)],
        ),
        ("all around", around),
        ("at a surface", vec![at_surface]),
    ] {
        let gather = gatherer
            .bind_lights(&gpu.device, &lights, shot.camera.eye())
            .expect("lights");
        let settings = SgHullSettings::default();
        let size = SgHullSize::new(64, 64);
        let recorded = record(gpu, hull, &shot, &gather, &settings, size);
        check_covered(&recorded, &shot, name);
        // Directional light is the same everywhere, and one lobe holds one light: the picture is exact.
        if let [
            Light::Directional {
                direction,
                irradiance,
            },
        ] = lights[..]
        {
            let peak = f64::from(irradiance[0]).max(1e-30);
            for (i, receiver) in receivers.iter().enumerate() {
                let Some(receiver) = receiver else { continue };
                let cosine = receiver.normal.dot(-direction.normalize()).max(0.0);
                let expected = cosine / std::f64::consts::PI;
                let found = f64::from(recorded.pixels[i][0]) / peak;
                // Normals of 16 bits, and the width of the narrowest lobe at the horizon.
                let off = if irradiance[0] > 0.0 {
                    (found - expected).abs()
                } else {
                    found
                };
                assert!(
                    off < 1e-3,
                    "{name}: pixel {i} is {found}, expected {expected}"
                );
            }
        }
    }
}

/// A scene drawn for a hull, and its lamp.
struct Stage {
    gpu: &'static Gpu,
    lamp: LightSource,
    buffers: SceneBuffers,
    camera: Camera,
    raster: Raster,
}

type Picture = Vec<[f32; 4]>;

impl Stage {
    fn new(name: &str, size: [u32; 2]) -> Self {
        let gpu = pipelines::gpu();
        let scene = scenes::by_name(name).expect("a scene");
        let camera = camera_of(&scene, 0, size);
        let buffers = SceneBuffers::new(gpu, &scene);
        Self {
            lamp: LightSource::of(&scene).expect("a lamp"),
            raster: Raster::draw(gpu, &buffers, &camera),
            gpu,
            buffers,
            camera,
        }
    }

    fn renderer(&self, size: SgHullSize) -> (HullRenderer, GathererBinding) {
        let mut renderer =
            HullRenderer::new(self.gpu, size, Components::default()).expect("it fits");
        let lights = renderer
            .lights(self.gpu, &self.buffers, &self.lamp, self.camera.eye())
            .expect("lights");
        (renderer, lights)
    }

    fn picture(
        &self,
        renderer: &mut HullRenderer,
        lights: &GathererBinding,
    ) -> (Picture, SgHullCounts) {
        let rendered = renderer.render(self.gpu, &self.raster, &self.camera, lights);
        (rendered.expect("a picture").1, renderer.counts(self.gpu))
    }

    fn truth(&self, renderer: &mut HullRenderer, lights: &GathererBinding) -> Picture {
        let rendered = renderer.render_per_pixel(self.gpu, &self.raster, &self.camera, lights);
        rendered.expect("a picture").1
    }
}

/// Against light gathered at every pixel. The bars are those for whole pictures; these are small ones, whose quads are
/// as much coarser.
#[test]
fn picture_is_close_to_the_truth() {
    let stage = Stage::new("cornell", [256, 256]);
    let (mut renderer, lights) = stage.renderer(SgHullSize::new(256, 256));
    let (found, counts) = stage.picture(&mut renderer, &lights);
    let truth = stage.truth(&mut renderer, &lights);
    let off = difference(&found, &truth, 256);
    println!("{off:?}, {counts:?}");
    assert!(
        off.rmse < 0.03 && off.energy.abs() < 0.02 && off.ratio < 2.0,
        "{off:?}"
    );
    let mean: f32 = truth.iter().map(|p| p[0]).sum::<f32>() / truth.len() as f32;
    assert!(mean > 0.02, "the picture is black: {mean}");
}

/// The error threshold: at 0 the picture is the truth, and between it and infinity the error falls with it. Pixels that
/// find no room are shaded by the hull, tiny segments as well.
#[test]
fn error_threshold_converges() {
    for name in ["fence", "cornell"] {
        let stage = Stage::new(name, [128, 96]);
        let size = SgHullSize::new(128, 96);
        let (mut renderer, lights) = stage.renderer(size);
        let truth = stage.truth(&mut renderer, &lights);
        let mut before = (f64::INFINITY, 0);
        for error_threshold in [f32::INFINITY, 0.5, 0.1, 0.0] {
            renderer.settings.error_threshold = error_threshold;
            let (found, counts) = stage.picture(&mut renderer, &lights);
            let off = difference(&found, &truth, 128);
            println!(
                "{name}, {error_threshold}: {off:?}, {} pixels",
                counts.per_pixel
            );
            assert!(
                off.rmse < before.0 && counts.per_pixel > before.1,
                "{name}, {error_threshold}: {off:?} after {before:?}"
            );
            before = (off.rmse, counts.per_pixel);
        }
        // Both gather alike; compilers may contract differently.
        assert!(before.0 < 1e-5, "{name}: {before:?}");

        let size = SgHullSize {
            per_pixel: 50,
            ..size
        };
        let (mut few, lights) = stage.renderer(size);
        few.settings.error_threshold = 0.0;
        let (found, counts) = stage.picture(&mut few, &lights);
        assert_eq!(
            counts.per_pixel_overflow(&size),
            before.1 - 50,
            "{counts:?}"
        );
        assert_eq!(counts.points[0], 50, "{counts:?}");
        let off = difference(&found, &truth, 128);
        println!("{name}, 50 pixels: {off:?}");
        assert!(off.energy.abs() < 0.05, "{name}: {off:?}");
    }
}

/// Splits that find no room have their pixels gathered: they cost more and err less.
#[test]
fn splits_without_room_are_pixels() {
    let stage = Stage::new("cornell", [256, 256]);
    let [many, few] = [32768, 2].map(|splits| {
        let size = SgHullSize {
            splits,
            ..SgHullSize::new(256, 256)
        };
        let (mut renderer, lights) = stage.renderer(size);
        let (found, counts) = stage.picture(&mut renderer, &lights);
        let off = difference(&found, &stage.truth(&mut renderer, &lights), 256).rmse;
        println!("room for {splits}: {off}, {counts:?}");
        (counts, counts.split_overflow(&size), off)
    });
    assert!(many.0.parts[1] > 100 && many.1 == 0);
    assert!(few.0.parts[1] <= 8 && few.1 > 10);
    assert!(many.0.per_pixel < few.0.per_pixel && many.2 > few.2);
}

/// A square light above a point, by the form factor of a parallel square.
#[test]
fn polygons_have_their_form_factor() {
    let gpu = pipelines::gpu();
    let gatherer = Gatherer::polygons(&gpu.device);
    let hull = hull(gpu, &gatherer, Components::UnionFind);
    // A plane seen from above, orthographic: every pixel at y = 0.
    let projection = DMat4::from_cols(
        DVec4::X / 1e-3,
        DVec4::Y / 1e-3,
        DVec4::Z * 0.1,
        DVec4::W + DVec4::Z,
    );
    let camera = Camera::look_at(
        DVec3::Y * 5.0,
        DVec3::ZERO,
        DVec3::Z,
        projection,
        Viewport::full(32, 32),
    )
    .expect("a camera");
    let depth = [0.5_f32; 1024];
    let normal = [[0.0_f32, 1.0, 0.0, 0.0]; 1024];
    let depth = gpu.texture(Format::R32Float, 32, 32, &depth);
    let normal = gpu.texture(Format::Rgba32Float, 32, 32, &normal);
    // 2 x 2 at a height of 1 above the plane, that is 4 below the eye, facing down.
    let corner = |x: f32, z: f32| [x, -4.0, z];
    let corners = [
        corner(-1.0, -1.0),
        corner(1.0, -1.0),
        corner(1.0, 1.0),
        corner(-1.0, 1.0),
    ];
    let light = |a: usize, b: usize, c: usize| PolygonLight {
        a: corners[a],
        red: 1.0,
        b: corners[b],
        green: 2.0,
        c: corners[c],
        blue: 1e6,
    };
    let lights = gpu.buffer(&[light(0, 1, 2), light(0, 2, 3)], BufferUsages::STORAGE);
    let gather = gatherer
        .bind_polygons(&gpu.device, &lights)
        .expect("lights");
    let view = hull
        .create_view(&gpu.device, SgHullSize::new(32, 32))
        .expect("a view");
    let target = gpu.target(FORMAT, 32, 32);
    let gbuffer = GBuffer::new(depth.texture(), normal.texture());
    let mut decoded = Decoded::of(&camera);
    // Four quarters: F = 2 / π · a/√(1+a²) · atan(a/√(1+a²)) each of side a = 1 at height 1, over four of them.
    let s = 1.0 / 2.0_f64.sqrt();
    let expected = 4.0 * s * s.atan() / std::f64::consts::PI;
    let settings = SgHullSettings::default();
    for exact in [false, true] {
        let mut encoder = gpu.encoder();
        let frame = decoded.frame(&mut encoder, gbuffer, &camera, camera.eye());
        let input = SgHullInput::new(&frame, Some(&gather), target.texture());
        if exact {
            hull.record_per_pixel(&gpu.device, &mut encoder, &input, &settings, &view)
        } else {
            hull.record(&gpu.device, &mut encoder, &input, &settings, &view)
        }
        .expect("it fits");
        gpu.finish(encoder);
        let texels: Vec<[f32; 4]> = gpu.read_texture(target.texture(), 0);
        for (channel, radiosity) in [1.0, 2.0, 1e6].into_iter().enumerate() {
            let found = f64::from(texels[500][channel]) * std::f64::consts::PI / radiosity;
            // The angle's fit is good to 5e-4.
            assert!(
                (found - expected).abs() < 1e-3,
                "exact {exact}, channel {channel}: {found}, expected {expected}"
            );
        }
    }
}

#[track_caller]
fn refused<T>(result: Result<T, Error>, kind: &str, thing: &str) {
    let Err(error) = result else {
        panic!("{thing} was accepted");
    };
    assert!(format!("{error:?}").starts_with(kind), "{error:?}");
    assert!(error.to_string().contains(thing), "{error}");
}

#[test]
fn what_does_not_fit_is_refused() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let gatherer = Gatherer::lights(device);
    let hull = hull(gpu, &gatherer, Components::UnionFind);
    let with = |change: &dyn Fn(&mut SgHullSettings)| {
        let mut settings = SgHullSettings::default();
        change(&mut settings);
        settings.validate()
    };
    refused(with(&|s| s.quad = 7), "Setting", "::quad");
    refused(with(&|s| s.gap = 0.0), "Setting", "::gap");
    refused(
        with(&|s| s.plane_distance = f32::NAN),
        "Setting",
        "::plane_distance",
    );
    refused(with(&|s| s.normal_angle = 4.0), "Setting", "::normal_angle");
    refused(
        with(&|s| s.error_threshold = f32::NAN),
        "Setting",
        "::error_threshold",
    );
    refused(with(&|s| s.f0[1] = 1.1), "Setting", "::f0");
    let size = SgHullSize::new(16, 16);
    let create = |size| hull.create_view(device, size);
    refused(create(SgHullSize { width: 0, ..size }), "Setting", "size");
    refused(create(SgHullSize { grid: 31, ..size }), "Setting", "::grid");
    let many = SgHullSize {
        segments: 1 << 20,
        ..size
    };
    refused(create(many), "Limit", "max_storage_buffer_binding_size");
    let view: SgHullView = create(size).expect("a view");
    assert!(view.memory_bytes() > 65536 * 480 + 32768 * 624);
    refused(
        create(SgHullSize {
            per_pixel: 0,
            ..size
        }),
        "Setting",
        "::per_pixel",
    );
    let many = SgHullSize {
        splits: (1 << 18) + 1,
        ..size
    };
    refused(create(many), "Setting", "::splits");

    let scene = scenes::cornell();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [16, 16]));
    let target = gpu.target(FORMAT, 16, 16);
    let other = gpu.target(Format::Rgba16Float, 16, 16);
    let gather = gatherer
        .bind_lights(device, &[], shot.camera.eye())
        .expect("lights");
    let mut encoder = gpu.encoder();
    let mut decoded = Decoded::of(&shot.camera);
    let eye = shot.camera.eye();
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, eye);
    let good = SgHullInput::new(&frame, Some(&gather), target.texture());
    let settings = SgHullSettings::default();
    let record =
        |input: &SgHullInput<'_>| hull.record(device, &mut gpu.encoder(), input, &settings, &view);
    record(&good).expect("it fits");
    let input = SgHullInput {
        gather: None,
        ..good
    };
    refused(record(&input), "Mismatch", "SgHullInput::gather");
    let input = SgHullInput {
        target: other.texture().into(),
        ..good
    };
    refused(record(&input), "Mismatch", "Rgba16Float");
    let camera = camera_of(&scene, 0, [15, 16]);
    let mut narrow = Decoded::of(&camera);
    let frame = narrow.frame(&mut encoder, shot.gbuffer(), &camera, eye);
    let input = SgHullInput {
        frame: &frame,
        ..good
    };
    refused(record(&input), "Mismatch", "SgHullView");
    let bad = [Light::Point {
        position: DVec3::NAN,
        intensity: [1.0; 3],
    }];
    refused(
        gatherer.bind_lights(device, &bad, DVec3::ZERO),
        "Setting",
        "Light::position",
    );
}

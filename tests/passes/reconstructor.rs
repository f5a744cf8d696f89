//! The Reconstructor: GPU against the f64 mirror, and what must hold of any reconstruction.
//!
//! Sums come from the splatter, by effects whose contributions are known: groups of surfels so far away that each lies
//! within one level's shell for all pixels.

// Exact values are meant where floats are compared for equality.
#![allow(clippy::float_cmp)]

use deep_screen_space::{
    AmbientOcclusion, Camera, Effect, Frame, GBuffer, Reconstructor, ReconstructorInput,
    ReconstructorSettings, ReconstructorView, SplatView, Viewport,
    glam::{DVec3, dcamera::rh::proj::directx as right},
    reference::reconstructor::{Reconstruction, Sum},
    wgpu::{self, TextureFormat as Format, TextureUsages},
};
use support::gpu::Gpu;
use support::testing::frames::Decoded;
use support::testing::passes::{Passes, descriptor, effect, receivers, texture};
use support::testing::pipelines;
use support::testing::refusals::refused;

/// Shells of levels end at 1000, 2000, 4000 …; `HERE` makes a pixel's sum depend on its normal alone.
const SHELLS: &str = "fn max_distance(sender: Sender, epsilon: f32) -> f32 { return 1000.0; }\n";

/// The sum as it is.
const PLAIN: &str =
    "fn resolve(sum: f32, albedo: vec3f) -> vec4f { return vec4f(sum, 0.25, 0.5, 1.0); }\n";

fn one_channel(contribution: &str, resolve: &str) -> Effect {
    let source = format!(
        "{SHELLS}{resolve}
fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> f32 {{
  {contribution}
}}"
    );
    effect(&source, 1, false)
}

/// About 1 a pixel and level of 4, different from sub-buffer to sub-buffer, and with the normal.
const NOISE: &str = "return (0.5 + fract(distance2 * 0.0173) + 0.3 * receiver_normal.x) * 0.016;";

/// 64 on each level of 4.
const ONE: &str = "return 1.0;";

/// A run of 4^(levels − 1) surfels per level.
fn groups(levels: u32) -> Vec<DVec3> {
    let count = 1_u32 << (2 * (levels - 1));
    (0..levels)
        .flat_map(|level| {
            let distance = if level == 0 {
                500.0
            } else {
                750.0 * f64::from(1 << level)
            };
            (0..count).map(move |i| {
                // A spread of a twentieth of the distance.
                let angle = 0.05 * f64::from(i) / f64::from(count);
                distance * DVec3::new(angle.sin(), 0.3, -angle.cos()).normalize()
            })
        })
        .collect()
}

/// What is seen: a floor, a wall with a band of sky above, and a block in front of it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Surface {
    Sky,
    Floor,
    Wall,
    Block,
}

const EYE: DVec3 = DVec3::new(0.3, 0.1, 2.0);

fn camera(viewport: Viewport) -> Camera {
    let aspect = f64::from(viewport.width) / f64::from(viewport.height);
    Camera::look_at(
        EYE,
        EYE - DVec3::Z,
        DVec3::Y,
        right::perspective_infinite_reverse(1.0, aspect, 0.1),
        viewport,
    )
    .expect("a camera")
}

/// The nearest surface along a ray from the eye, and where.
fn hit(direction: DVec3) -> (Surface, DVec3) {
    let at = |t: f64| t * direction;
    let block = at(-3.0 / direction.z);
    let world = EYE + block;
    if world.x.abs() < 0.6 && world.y < 0.3 && world.y > -1.0 {
        return (Surface::Block, block);
    }
    if direction.y < 0.0 {
        let floor = at((-1.0 - EYE.y) / direction.y);
        if floor.z > -6.0 {
            return (Surface::Floor, floor);
        }
    }
    let wall = at(-6.0 / direction.z);
    if (EYE + wall).y < 1.6 {
        (Surface::Wall, wall)
    } else {
        (Surface::Sky, DVec3::ZERO)
    }
}

/// A G-buffer drawn on the CPU, into textures larger than the viewport where it is moved.
struct Scene {
    camera: Camera,
    surfaces: Vec<Surface>,
    depth: wgpu::TextureView,
    normal: wgpu::TextureView,
    albedo: wgpu::TextureView,
    texture: [u32; 2],
}

fn normal_of(surface: Surface) -> DVec3 {
    match surface {
        Surface::Floor => DVec3::Y,
        // Tilted by a little, so that an effect can tell it from the wall while the filter hardly does.
        Surface::Block => DVec3::new(0.02, 0.0, 1.0).normalize(),
        Surface::Wall | Surface::Sky => DVec3::Z,
    }
}

impl Scene {
    fn new(gpu: &Gpu, viewport: Viewport) -> Self {
        Self::with_normals(gpu, viewport, |_, surface| normal_of(surface))
    }

    /// Normals by pixel index and surface.
    fn with_normals(gpu: &Gpu, viewport: Viewport, normal: impl Fn(u32, Surface) -> DVec3) -> Self {
        let camera = camera(viewport);
        let texture = [
            2 * viewport.x + viewport.width,
            2 * viewport.y + viewport.height,
        ];
        let count = (texture[0] * texture[1]) as usize;
        let mut depths = vec![0.03_f32; count];
        let mut normals = vec![[1.0_f32, 0.0, 0.0, 0.0]; count];
        let mut surfaces = Vec::new();
        for i in 0..viewport.width * viewport.height {
            let [x, y] = [i % viewport.width, i / viewport.width];
            let at = ((y + viewport.y) * texture[0] + x + viewport.x) as usize;
            let ray = camera
                .unproject(f64::from(x) + 0.5, f64::from(y) + 0.5, 0.5)
                .expect("a ray");
            let (surface, point) = hit(ray);
            surfaces.push(surface);
            depths[at] = camera.project(point).map_or(0.0, |p| p.z as f32);
            normals[at] = normal(i, surface).as_vec3().extend(0.0).to_array();
        }
        let albedo: Vec<[u8; 4]> = (0..count as u32).map(albedo_of).collect();
        let [width, height] = texture;
        Self {
            depth: gpu.texture(Format::R32Float, width, height, &depths),
            normal: gpu.texture(Format::Rgba32Float, width, height, &normals),
            albedo: gpu.texture(Format::Rgba8Unorm, width, height, &albedo),
            camera,
            surfaces,
            texture,
        }
    }

    fn gbuffer(&self) -> GBuffer<'_> {
        GBuffer {
            albedo: Some(self.albedo.texture().into()),
            ..GBuffer::new(self.depth.texture(), self.normal.texture())
        }
    }
}

fn albedo_of(i: u32) -> [u8; 4] {
    [i, i * 7, i * 31, 0].map(|c| (c % 256) as u8)
}

/// The target that shows totals as they are.
const SUM: Format = Format::R32Float;

/// The pipelines for an effect.
struct Wired {
    effect: Effect,
    passes: Passes,
    reconstructor: &'static Reconstructor,
}

impl Wired {
    fn new(gpu: &Gpu, effect: Effect) -> Self {
        Self {
            passes: Passes::new(gpu, &effect, 5 << 8),
            reconstructor: pipelines::reconstructor(&effect, SUM),
            effect,
        }
    }

    fn sum(&mut self, gpu: &Gpu, scene: &Scene, levels: u32) -> Summed<'_> {
        self.passes
            .emit(gpu, &scene.camera, &groups(levels), levels);
        let (decoded, view) = self
            .passes
            .splat(gpu, scene.gbuffer(), &scene.camera)
            .expect("sums");
        Summed {
            wired: self,
            decoded,
            view,
            levels,
        }
    }
}

/// What the passes summed for a scene.
struct Summed<'w> {
    wired: &'w Wired,
    decoded: Decoded<'static>,
    view: SplatView,
    levels: u32,
}

impl Summed<'_> {
    fn sums<T: bytemuck::Pod, S>(&self, gpu: &Gpu, value: impl Fn(T) -> S) -> Vec<Vec<S>> {
        (0..self.levels)
            .map(|level| {
                let texels: Vec<T> = gpu.read_texture(self.view.sums().texture(), level);
                texels.into_iter().map(&value).collect()
            })
            .collect()
    }

    /// The mirror's totals of the GPU's sums.
    fn mirror<S: Sum>(
        &self,
        gpu: &Gpu,
        scene: &Scene,
        settings: &ReconstructorSettings,
        sums: &[Vec<S>],
    ) -> Vec<S> {
        Reconstruction {
            camera: &scene.camera,
            origin: self.wired.passes.cloud.origin(),
            receivers: &receivers(gpu, &self.decoded),
            settings,
        }
        .reconstruct(sums)
    }

    /// The scene's frame once more.
    fn frame<'a>(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        scene: &'a Scene,
        decoded: &'a mut Decoded<'_>,
    ) -> Frame<'a> {
        let origin = self.wired.passes.cloud.origin();
        decoded.frame(encoder, scene.gbuffer(), &scene.camera, origin)
    }

    /// The texels of a target of the scene's size, cleared to `clear` before.
    fn reconstruct<T: bytemuck::Pod>(
        &self,
        gpu: &Gpu,
        scene: &Scene,
        settings: &ReconstructorSettings,
        format: Format,
        clear: f64,
    ) -> Vec<T> {
        let device = &gpu.device;
        let [width, height] = scene.texture;
        let target = gpu.target(format, width, height);
        let other;
        let reconstructor = if format == SUM {
            &self.wired.reconstructor
        } else {
            other = pipelines::reconstructor(&self.wired.effect, format);
            &other
        };
        let scratch = reconstructor
            .create_view(device, &self.view)
            .expect("a view");
        let mut encoder = gpu.encoder();
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color {
                        r: clear,
                        g: clear,
                        b: clear,
                        a: clear,
                    }),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        let mut decoded = Decoded::of(&scene.camera);
        let frame = self.frame(&mut encoder, scene, &mut decoded);
        let input = ReconstructorInput::new(&frame, &self.view, target.texture());
        reconstructor
            .record(device, &mut encoder, &input, settings, &scratch)
            .expect("a reconstruction");
        gpu.finish(encoder);
        gpu.read_texture(target.texture(), 0)
    }
}

/// How far off a pixel may be, relative to 1 + its value: f32 positions are off by some 1e-7 of the distance from the
/// eye, and the plane distances that they are compared with are a few 1e-3 of it.
const TOLERANCE: f64 = 1e-4;

/// Which share may be further off, and how far: none was seen to be; a pixel whose weights are all but gone divides
/// rounding by them.
const EXCEPTIONS: (f64, f64) = (1e-3, 1e-2);

/// How many are beyond TOLERANCE, and the farthest.
fn differences(found: &[f64], expected: &[f64]) -> (usize, f64) {
    assert_eq!(found.len(), expected.len());
    let relative = |(f, e): (&f64, &f64)| (f - e).abs() / (1.0 + e.abs());
    let beyond = |e: &f64| e.is_nan() || *e > TOLERANCE;
    let all: Vec<f64> = found.iter().zip(expected).map(relative).collect();
    (
        all.iter().filter(|e| beyond(e)).count(),
        all.iter()
            .copied()
            .fold(0.0, |a, b| if b.is_nan() { b } else { f64::max(a, b) }),
    )
}

#[track_caller]
fn assert_same(found: &[f64], expected: &[f64], inputs: &str) {
    let (count, worst) = differences(found, expected);
    println!(
        "{inputs}: {count} of {} beyond {TOLERANCE}, the farthest {worst:.1e}",
        found.len()
    );
    assert!(
        count as f64 <= EXCEPTIONS.0 * found.len() as f64 && worst <= EXCEPTIONS.1,
        "{inputs}: {count} of {} pixels are off by more than {TOLERANCE}, one by {worst}",
        found.len()
    );
}

fn wide(texels: &[f32]) -> Vec<f64> {
    texels.iter().copied().map(f64::from).collect()
}

/// Hills on every surface, so that all weights occur.
fn hilly(i: u32, surface: Surface) -> DVec3 {
    let n = normal_of(surface);
    let phase = f64::from(i) * 0.7;
    (n + 0.3 * DVec3::new(phase.sin(), (1.7 * phase).cos(), (0.3 * phase).sin())).normalize()
}

#[test]
fn totals_match_the_mirror() {
    let gpu = pipelines::gpu();
    let mut wired = Wired::new(gpu, one_channel(NOISE, PLAIN));
    let standard = ReconstructorSettings::default();
    for (size, levels, settings) in [
        ([96, 64], 5, standard),
        ([1, 1], 4, standard),
        ([1, 7], 4, standard),
        ([31, 17], 4, standard),
        (
            [127, 89],
            3,
            ReconstructorSettings {
                radius: 2.3,
                ..standard
            },
        ),
        (
            [64, 64],
            4,
            ReconstructorSettings {
                plane_distance: 0.02,
                ..standard
            },
        ),
        (
            [64, 64],
            4,
            ReconstructorSettings {
                plane_distance: 1e30,
                normal_power: 8.0,
                ..standard
            },
        ),
        (
            [64, 64],
            2,
            ReconstructorSettings {
                normal_power: 1000.0,
                radius: 8.0,
                ..standard
            },
        ),
    ] {
        let inputs = format!("{size:?}, {levels} levels, {settings:?}");
        let viewport = Viewport::full(size[0], size[1]);
        let scene = Scene::with_normals(gpu, viewport, hilly);
        let summed = wired.sum(gpu, &scene, levels);
        let sums = summed.sums::<f32, f64>(gpu, f64::from);
        let found: Vec<f32> = summed.reconstruct(gpu, &scene, &settings, Format::R32Float, 9.0);
        let expected = summed.mirror(gpu, &scene, &settings, &sums);
        assert_same(&wide(&found), &expected, &inputs);

        // The comparison sees a setting that is off by a tenth, and a sum that is off by a thousandth.
        if size[0] >= 64 && settings == standard {
            for other in [
                ReconstructorSettings {
                    plane_distance: 0.275,
                    ..settings
                },
                ReconstructorSettings {
                    normal_power: 8.8,
                    ..settings
                },
                ReconstructorSettings {
                    radius: 1.1,
                    ..settings
                },
            ] {
                let expected = summed.mirror(gpu, &scene, &other, &sums);
                let (count, _) = differences(&wide(&found), &expected);
                assert!(
                    count > found.len() / 10,
                    "{inputs}, {other:?}: {count} differ"
                );
            }
        }
    }
}

#[test]
fn three_channels_and_albedo_match_the_mirror() {
    let gpu = pipelines::gpu();
    // An engine's own effect: light in three colours, times what the surface reflects.
    let source = format!(
        "{SHELLS}
fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> vec3f {{
  let noise = fract(distance2 * vec3f(0.0173, 0.0091, 0.0277));
  return (noise + 0.3 * abs(receiver_normal)) * 0.016;
}}
fn resolve(sum: vec3f, albedo: vec3f) -> vec4f {{
  return vec4f(sum * albedo, 1.0);
}}"
    );
    let light = effect(&source, 3, true);
    let viewport = Viewport {
        x: 3,
        y: 5,
        width: 61,
        height: 43,
    };
    let scene = Scene::with_normals(gpu, viewport, hilly);
    let mut wired = Wired::new(gpu, light);
    let summed = wired.sum(gpu, &scene, 4);
    let sums = summed.sums(gpu, |[r, g, b, _]: [f32; 4]| {
        DVec3::from([r, g, b].map(f64::from))
    });
    let settings = ReconstructorSettings::default();
    let all: Vec<[f32; 4]> = summed.reconstruct(gpu, &scene, &settings, Format::Rgba32Float, 9.0);
    let totals = summed.mirror(gpu, &scene, &settings, &sums);
    let (mut found, mut expected) = (Vec::new(), Vec::new());
    for (i, total) in (0..).zip(totals) {
        let [x, y] = [
            i % viewport.width + viewport.x,
            i / viewport.width + viewport.y,
        ];
        let at = y * scene.texture[0] + x;
        let albedo = albedo_of(at).map(|c| f64::from(c) / 255.0);
        for c in 0..3 {
            found.push(f64::from(all[at as usize][c]));
            expected.push(total[c] * albedo[c]);
        }
        assert_eq!(all[at as usize][3], 1.0);
    }
    assert_same(&found, &expected, "three channels");
}

#[test]
fn constants_stay() {
    let gpu = pipelines::gpu();
    let one = one_channel(ONE, PLAIN);
    let scene = Scene::with_normals(gpu, Viewport::full(67, 53), hilly);
    let mut wired = Wired::new(gpu, one);
    let summed = wired.sum(gpu, &scene, 4);
    for (level, sums) in summed.sums::<f32, f32>(gpu, |s| s).iter().enumerate() {
        for (sum, surface) in sums.iter().zip(&scene.surfaces) {
            let expected = if *surface == Surface::Sky { 0.0 } else { 64.0 };
            assert_eq!(*sum, expected, "level {level}, {surface:?}");
        }
    }
    let settings = ReconstructorSettings::default();
    let found: Vec<f32> = summed.reconstruct(gpu, &scene, &settings, Format::R32Float, 9.0);
    for (value, surface) in found.iter().zip(&scene.surfaces) {
        // Two means of up to 17 on each of three levels, a rounding each.
        let expected: f32 = if *surface == Surface::Sky { 0.0 } else { 256.0 };
        assert!(
            (value - expected).abs() <= 1e-5 * expected,
            "{surface:?}: {value}"
        );
    }
}

#[test]
fn nothing_leaks_over_edges() {
    let gpu = pipelines::gpu();
    let scene = Scene::new(gpu, Viewport::full(96, 64));
    let settings = ReconstructorSettings::default();
    // The block lies in front of the wall, with its own tilt; the floor meets the wall at a right angle.
    for (name, contribution, bright, dark) in [
        (
            "depth",
            "return select(0.0, 1.0, receiver_normal.x > 0.01);",
            Surface::Block,
            Surface::Wall,
        ),
        (
            "a corner",
            "return select(0.0, 1.0, receiver_normal.y > 0.5);",
            Surface::Floor,
            Surface::Wall,
        ),
        (
            "a corner, from the other side",
            "return select(0.0, 1.0, receiver_normal.y < 0.5);",
            Surface::Wall,
            Surface::Floor,
        ),
    ] {
        let mut wired = Wired::new(gpu, one_channel(contribution, PLAIN));
        let summed = wired.sum(gpu, &scene, 4);
        let found: Vec<f32> = summed.reconstruct(gpu, &scene, &settings, Format::R32Float, 9.0);
        let mut seen = [0, 0];
        for (value, surface) in found.iter().zip(&scene.surfaces) {
            if *surface == dark {
                assert_eq!(*value, 0.0, "{name}");
                seen[0] += 1;
            } else if *surface == bright {
                assert!((value - 256.0).abs() <= 1e-5 * 256.0, "{name}: {value}");
                seen[1] += 1;
            }
        }
        assert!(seen[0] > 100 && seen[1] > 100, "{name}: {seen:?} pixels");
        // The sums are there to leak: with the plane as thick as the room, over the edge in depth they do.
        if name == "depth" {
            let loose = ReconstructorSettings {
                plane_distance: 100.0,
                ..settings
            };
            let leaky: Vec<f32> = summed.reconstruct(gpu, &scene, &loose, Format::R32Float, 9.0);
            let leaks = |(v, s): (&f32, &Surface)| *s == dark && *v > 1.0;
            assert!(leaky.iter().zip(&scene.surfaces).any(leaks));
        }
    }
}

#[test]
fn sky_stays_open() {
    let gpu = pipelines::gpu();
    let scene = Scene::new(gpu, Viewport::full(64, 48));
    let mut wired = Wired::new(gpu, AmbientOcclusion::default().effect());
    for levels in [1, 4] {
        let summed = wired.sum(gpu, &scene, levels);
        let settings = ReconstructorSettings::default();
        let found: Vec<u8> = summed.reconstruct(gpu, &scene, &settings, Format::R8Unorm, 0.0);
        let mut sky = 0;
        for (value, surface) in found.iter().zip(&scene.surfaces) {
            if *surface == Surface::Sky {
                assert_eq!(*value, 255, "{levels} levels");
                sky += 1;
            }
        }
        assert!(sky > 100, "{sky} pixels of sky");
    }
}

#[test]
fn one_level_is_resolved_as_it_is() {
    let gpu = pipelines::gpu();
    let scene = Scene::with_normals(gpu, Viewport::full(31, 17), hilly);
    let mut wired = Wired::new(gpu, one_channel(NOISE, PLAIN));
    let summed = wired.sum(gpu, &scene, 1);
    let settings = ReconstructorSettings::default();
    let found: Vec<f32> = summed.reconstruct(gpu, &scene, &settings, Format::R32Float, 9.0);
    assert_eq!(found, summed.sums::<f32, f32>(gpu, |s| s)[0]);
    let scratch = summed
        .wired
        .reconstructor
        .create_view(&gpu.device, &summed.view)
        .expect("a view");
    assert_eq!(scratch.memory_bytes(), 0);
}

#[test]
fn radius_zero_smooths_nothing() {
    let gpu = pipelines::gpu();
    let scene = Scene::with_normals(gpu, Viewport::full(31, 17), hilly);
    let mut wired = Wired::new(gpu, one_channel(NOISE, PLAIN));
    let summed = wired.sum(gpu, &scene, 4);
    let settings = ReconstructorSettings {
        radius: 0.0,
        ..ReconstructorSettings::default()
    };
    let found: Vec<f32> = summed.reconstruct(gpu, &scene, &settings, Format::R32Float, 9.0);
    let sums = summed.sums::<f32, f32>(gpu, |s| s);
    for (i, value) in found.iter().enumerate() {
        let total: f32 = sums.iter().map(|level| level[i]).sum();
        assert!(
            (value - total).abs() <= 1e-6 * total,
            "pixel {i}: {value}, {total}"
        );
    }
}

#[test]
fn only_the_viewport_is_written() {
    let gpu = pipelines::gpu();
    let mut wired = Wired::new(gpu, one_channel(NOISE, PLAIN));
    let moved = Viewport {
        x: 7,
        y: 3,
        width: 33,
        height: 21,
    };
    for levels in [1, 4] {
        let scene = Scene::new(gpu, moved);
        let summed = wired.sum(gpu, &scene, levels);
        let settings = ReconstructorSettings::default();
        let all: Vec<f32> = summed.reconstruct(gpu, &scene, &settings, Format::R32Float, 9.0);
        let plain = Scene::new(gpu, Viewport::full(moved.width, moved.height));
        let summed = wired.sum(gpu, &plain, levels);
        let alone: Vec<f32> = summed.reconstruct(gpu, &plain, &settings, Format::R32Float, 8.0);
        for (i, value) in (0..).zip(&all) {
            let [x, y] = [i % scene.texture[0], i / scene.texture[0]];
            let (u, v) = (x.wrapping_sub(moved.x), y.wrapping_sub(moved.y));
            let expected = if u < moved.width && v < moved.height {
                alone[(v * moved.width + u) as usize]
            } else {
                9.0
            };
            assert_eq!(*value, expected, "{levels} levels, pixel {x} {y}");
        }
    }
}

#[test]
fn sums_that_are_not_finite_count_for_nothing() {
    let gpu = pipelines::gpu();
    let settings = ReconstructorSettings::default();
    let viewport = Viewport::full(48, 40);
    // Some pixels, single ones and a run, told by a tilt that only they have.
    let is_bad = |i: u32| i % 97 == 5 || (900..905).contains(&i);
    let tilted = |i: u32, surface| {
        let n = normal_of(surface);
        if is_bad(i) {
            (n + DVec3::X * 0.1).normalize()
        } else {
            n
        }
    };
    let scene = Scene::with_normals(gpu, viewport, tilted);
    for (name, bits) in [
        ("NaN", "0x7fc00000u"),
        ("inf", "0x7f800000u"),
        ("-inf", "0xff800000u"),
    ] {
        // Made at run time: WGSL has no such constants.
        let contribution = format!(
            "if receiver_normal.x > 0.05 {{ return bitcast<f32>({bits} | (u32(distance2) & 0u)); }} {NOISE}"
        );
        let mut wired = Wired::new(gpu, one_channel(&contribution, PLAIN));
        for levels in [1, 4] {
            let inputs = format!("{name}, {levels} levels");
            let summed = wired.sum(gpu, &scene, levels);
            let sums = summed.sums::<f32, f64>(gpu, f64::from);
            let bad = sums[0].iter().filter(|s| !s.is_finite()).count();
            assert!(bad > 15, "{inputs}: only {bad} sums are not finite");
            let found: Vec<f32> = summed.reconstruct(gpu, &scene, &settings, Format::R32Float, 9.0);
            let left = found.iter().position(|v| !v.is_finite());
            assert_eq!(left, None, "{inputs}: the first pixel that is not finite");
            let expected = summed.mirror(gpu, &scene, &settings, &sums);
            assert_same(&wide(&found), &expected, &inputs);
            if levels == 1 {
                for (i, value) in found.iter().enumerate() {
                    let sum = sums[0][i];
                    let expected = if sum.is_finite() { sum as f32 } else { 0.0 };
                    assert_eq!(*value, expected, "{inputs}, pixel {i}");
                }
            } else {
                // Their coarser levels are their neighbours'.
                let filled = (0..)
                    .zip(&found)
                    .filter(|(i, v)| is_bad(*i) && **v > 1.0)
                    .count();
                assert!(
                    filled > 15,
                    "{inputs}: {filled} pixels took over their neighbours' means"
                );
            }
        }
    }
}

#[test]
fn targets_of_any_float_format_are_written() {
    let gpu = pipelines::gpu();
    let resolve = "fn resolve(sum: f32, albedo: vec3f) -> vec4f { return vec4f(1.0 / (1.0 + sum), 0.25, 0.5, 1.0); }\n";
    let scene = Scene::new(gpu, Viewport::full(31, 17));
    let mut wired = Wired::new(gpu, one_channel(NOISE, resolve));
    let summed = wired.sum(gpu, &scene, 3);
    let settings = ReconstructorSettings::default();
    let exact: Vec<f32> = summed.reconstruct(gpu, &scene, &settings, Format::R32Float, 0.0);
    let byte = |v: u8| f32::from(v) / 255.0;
    // Within a step of the format, since drivers may round 16-bit floats toward zero: 2^-11 below 1.
    let (unorm, half) = (0.51 / 255.0, 1.0 / 2048.0);
    let check = |format: Format, step: f32, found: Vec<[f32; 4]>| {
        for (i, (texel, exact)) in found.iter().zip(&exact).enumerate() {
            let expected = [*exact, 0.25, 0.5, 1.0];
            for c in 0..usize::from(format.components()) {
                assert!(
                    (texel[c] - expected[c]).abs() <= step,
                    "{format:?}, pixel {i}: {texel:?} in place of {expected:?}"
                );
            }
        }
    };
    let r8: Vec<u8> = summed.reconstruct(gpu, &scene, &settings, Format::R8Unorm, 0.0);
    check(
        Format::R8Unorm,
        unorm,
        r8.iter().map(|&v| [byte(v); 4]).collect(),
    );
    let rgba8: Vec<[u8; 4]> = summed.reconstruct(gpu, &scene, &settings, Format::Rgba8Unorm, 0.0);
    check(
        Format::Rgba8Unorm,
        unorm,
        rgba8.iter().map(|v| v.map(byte)).collect(),
    );
    let r16: Vec<u16> = summed.reconstruct(gpu, &scene, &settings, Format::R16Float, 0.0);
    check(
        Format::R16Float,
        half,
        r16.iter().map(|&v| [from_half(v); 4]).collect(),
    );
    let rgba16: Vec<[u16; 4]> =
        summed.reconstruct(gpu, &scene, &settings, Format::Rgba16Float, 0.0);
    check(
        Format::Rgba16Float,
        half,
        rgba16.iter().map(|v| v.map(from_half)).collect(),
    );
}

/// The value of a 16-bit float, normal and positive or zero.
fn from_half(bits: u16) -> f32 {
    if bits == 0 {
        return 0.0;
    }
    f32::from_bits((u32::from(bits) << 13) + ((127 - 15) << 23))
}

#[test]
fn formats_that_cannot_be_rendered_to_are_refused() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let plain = one_channel(ONE, PLAIN);
    for format in [
        Format::Depth32Float,
        Format::R32Uint,
        Format::Rgba8Sint,
        Format::Rgb9e5Ufloat,
    ] {
        let made = Reconstructor::new(device, &plain, format);
        refused(
            made,
            "Format",
            "Reconstructor target",
            "a colour format of floats",
        );
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let standard = ReconstructorSettings::default();
    standard.validate().expect("the default");
    for bad in [-0.1, 8.1, f32::NAN, f32::INFINITY] {
        let settings = ReconstructorSettings {
            radius: bad,
            ..standard
        };
        refused(settings.validate(), "Setting", "::radius", "0 to 8");
    }
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let settings = ReconstructorSettings {
            plane_distance: bad,
            ..standard
        };
        refused(
            settings.validate(),
            "Setting",
            "::plane_distance",
            "above 0",
        );
    }
    for bad in [0.0, 7.9, 1001.0, f32::NAN] {
        let settings = ReconstructorSettings {
            normal_power: bad,
            ..standard
        };
        refused(
            settings.validate(),
            "Setting",
            "::normal_power",
            "8 to 1000",
        );
    }
}

#[test]
#[allow(clippy::too_many_lines)] // A list.
fn what_does_not_fit_is_refused() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let mut tinted = one_channel(ONE, PLAIN);
    tinted.albedo = true;
    let size = [8, 6];
    let scene = Scene::new(gpu, Viewport::full(8, 6));
    let mut wired = Wired::new(gpu, tinted);
    let summed = wired.sum(gpu, &scene, 3);
    let reconstructor = &summed.wired.reconstructor;
    let scratch = reconstructor.create_view(device, &summed.view);
    let scratch = scratch.expect("a view");

    let standard = ReconstructorSettings::default();
    let record = |input: &ReconstructorInput<'_>,
                  settings: &ReconstructorSettings,
                  scratch: &ReconstructorView| {
        reconstructor.record(device, &mut gpu.encoder(), input, settings, scratch)
    };
    let target = gpu.target(Format::R32Float, 8, 6);
    let mut decoded = Decoded::of(&scene.camera);
    let frame = summed.frame(&mut gpu.encoder(), &scene, &mut decoded);
    let good = ReconstructorInput::new(&frame, &summed.view, target.texture());
    record(&good, &standard, &scratch).expect("it fits");

    let unset = ReconstructorSettings {
        radius: -1.0,
        ..standard
    };
    refused(
        record(&good, &unset, &scratch),
        "Setting",
        "::radius",
        "0 to 8",
    );

    let black = GBuffer {
        albedo: None,
        ..scene.gbuffer()
    };
    let origin = summed.wired.passes.cloud.origin();
    for (gbuffer, origin, kind, thing, needed) in [
        (black, origin, "Mismatch", "GBuffer", "the effect test"),
        (
            scene.gbuffer(),
            origin + DVec3::X,
            "Recording",
            "SplatView",
            "origin",
        ),
    ] {
        let mut decoded = Decoded::of(&scene.camera);
        let frame = decoded.frame(&mut gpu.encoder(), gbuffer, &scene.camera, origin);
        let input = ReconstructorInput {
            frame: &frame,
            ..good
        };
        refused(record(&input, &standard, &scratch), kind, thing, needed);
    }
    let splatter = pipelines::shell_splatter(&summed.wired.effect, false);
    for (height, levels) in [(5, 3), (6, 2)] {
        let sums = splatter.create_view(device, 8, height, levels);
        let other = reconstructor.create_view(device, &sums.expect("a view"));
        refused(
            record(&good, &standard, &other.expect("a view")),
            "Mismatch",
            "ReconstructorView",
            "[8, 6] pixels",
        );
    }
    // Another effect's sums, of as many channels.
    let other = Reconstructor::new(device, &one_channel(ONE, PLAIN), Format::R32Float);
    refused(
        other
            .expect("pipelines")
            .record(device, &mut gpu.encoder(), &good, &standard, &scratch),
        "Mismatch",
        "SplatView",
        "effect",
    );

    let attachment = TextureUsages::RENDER_ATTACHMENT;
    let with = |texture: wgpu::Texture| {
        let target = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let input = ReconstructorInput {
            target: target.texture().into(),
            ..good
        };
        record(&input, &standard, &scratch)
    };
    let name = "ReconstructorInput::target";
    let format = Format::R32Float;
    with(texture(gpu, format, size, attachment)).expect("it fits");
    let other = texture(gpu, Format::R16Float, size, attachment);
    refused(with(other), "Mismatch", name, "R16Float");
    let unusable = texture(gpu, format, size, TextureUsages::TEXTURE_BINDING);
    refused(with(unusable), "Usage", name, "RENDER_ATTACHMENT");
    let small = texture(gpu, format, [8, 5], attachment);
    refused(with(small), "Size", name, "at least 8x6");
    let mut array = descriptor(format, size, attachment);
    array.size.depth_or_array_layers = 2;
    with(device.create_texture(&array)).expect("the first layer of an array");
    let mut multisampled = descriptor(Format::Rgba8Unorm, size, attachment);
    multisampled.sample_count = 4;
    refused(
        with(device.create_texture(&multisampled)),
        "Shape",
        name,
        "one sample",
    );
}

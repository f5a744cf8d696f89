//! What plans are made of: the rungs of each method rendered and timed.

use deep_screen_space::{
    AmbientOcclusion, BentNormals, Camera, CloudCapacity, DirectionalOcclusion, Environment,
    EnvironmentBuilder, EnvironmentSettings, Light, ObscuranceInput, Payload, RaySettings,
    RayTracedEffect, Sampling, SpecularBounce, VolumetricObscurance,
    planner::{Calibration, Method, MethodCalibration, MethodKind},
    reference::environment,
    wgpu,
};

use crate::{
    ambient_occlusion::Renderer,
    apart::apart,
    bounced::{BouncedRenderer, Picture, RayRoom},
    gpu::Gpu,
    presets::{self, BouncedPreset},
    raster::Raster,
    scene::SceneBuffers,
    sky,
};

/// What is rendered.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    pub gpu: &'a Gpu,
    pub size: [u32; 2],
    pub camera: &'a Camera,
    pub buffers: &'a SceneBuffers,
    pub drawn: &'a Raster,
    pub lights: &'a [Light],
    /// For effects of an environment.
    pub sky: Option<&'a environment::Picture>,
    /// Perceptual, of all surfaces, for glossy light.
    pub roughness: f32,
}

impl Subject<'_> {
    /// Which pixels show surfaces.
    pub fn shown(&self) -> Vec<bool> {
        let normals: Vec<[f32; 4]> = self.gpu.read_texture(self.drawn.normal.texture(), 0);
        normals.iter().map(|n| *n != [0.0; 4]).collect()
    }

    /// Of as many cells as by default, or for a reference as the picture has, as far as may be.
    fn environment(&self, exact: bool) -> Result<Option<Environment>, String> {
        let mut settings = EnvironmentSettings {
            levels: true,
            ..EnvironmentSettings::default()
        };
        if let (true, Some(picture)) = (exact, self.sky) {
            let [columns, rows] = picture.size.map(|n| n as u32);
            settings.size = [columns.clamp(16, 2048), rows.clamp(8, 1024)];
        }
        let build = |picture| {
            let builder = EnvironmentBuilder::new(&self.gpu.device)?;
            sky::build(self.gpu, &builder, picture, &settings)
        };
        self.sky.map(build).transpose().map_err(|e| e.to_string())
    }

    fn roughness(&self) -> wgpu::TextureView {
        let [width, height] = self.size;
        let texels = vec![self.roughness; (width * height) as usize];
        let format = wgpu::TextureFormat::R32Float;
        self.gpu.texture(format, width, height, &texels)
    }
}

/// A picture and what it took.
pub struct Rendered {
    /// Visibility in red, or light, or bent normals and visibility.
    pub pixels: Vec<[f32; 4]>,
    /// Time of what views share, and of the rest.
    pub scene_ms: f64,
    pub view_ms: f64,
}

/// What plans are made of, by rendering the rungs that they ask for.
pub fn calibrate(subject: &Subject<'_>, effect: &RayTracedEffect) -> Result<Calibration, String> {
    let mut pictures = Vec::new();
    for kind in MethodKind::ALL {
        let Some(rungs) = kind.calibrated(effect) else {
            continue;
        };
        pictures.push((kind, render(subject, effect, &rungs)?));
    }
    let rays = pictures.iter().find(|p| p.0 == MethodKind::Rays);
    let best = &rays.ok_or("every effect has rays")?.1[1].pixels;
    let shown = subject.shown();
    let reference = Reference::of(subject, effect)?;
    let of = |wanted: MethodKind| {
        let (_, pictures) = pictures.iter().find(|p| p.0 == wanted)?;
        let [cheap, dear] = &pictures[..] else {
            return None;
        };
        Some(MethodCalibration {
            scene_ms: cheap.scene_ms,
            view_ms: [cheap.view_ms, dear.view_ms],
            difference: Some(apart(effect, &cheap.pixels, best, &shown)),
            errors: reference
                .as_ref()
                .map(|r| [cheap, dear].map(|picture| r.error(effect, &picture.pixels, &shown))),
        })
    };
    Ok(Calibration {
        size: subject.size,
        triangles: subject.buffers.triangles().max(1),
        rays: of(MethodKind::Rays),
        splats: of(MethodKind::Splats),
        obscurance: of(MethodKind::Obscurance),
    })
}

/// Renders rungs of one method.
pub fn render(
    subject: &Subject<'_>,
    effect: &RayTracedEffect,
    rungs: &[Method],
) -> Result<Vec<Rendered>, String> {
    match rungs.first().map(Method::kind) {
        None => Ok(Vec::new()),
        Some(MethodKind::Rays) => by_rays(subject, effect, rungs),
        Some(MethodKind::Splats) => by_splats(subject, effect, rungs),
        Some(MethodKind::Obscurance) => by_reads(subject, rungs),
    }
}

/// Rays without a filter, of so many frames that little noise is left.
pub struct Reference {
    /// Of the first half of the frames, of the second half, and of all.
    means: [Vec<[f32; 4]>; 3],
}

/// Frames of 64 rays.
const FRAMES: u32 = 16;

impl Reference {
    /// For effects whose errors differences of two pictures tell too little of.
    pub fn of(subject: &Subject<'_>, effect: &RayTracedEffect) -> Result<Option<Self>, String> {
        if let RayTracedEffect::AmbientOcclusion { .. } | RayTracedEffect::IndirectDiffuse { .. } =
            effect
        {
            return Ok(None);
        }
        let mut rays = RaySettings::new(64, effect.payload());
        rays.filter.radius = 0;
        let mut renderer = ray_renderer(subject, effect, true)?;
        let mut preset = presets::of(&rays, radius_of(effect));
        let [width, height] = subject.size;
        let mut halves = [0, 1].map(|_| vec![[0.0_f32; 4]; (width * height) as usize]);
        for frame in 0..FRAMES {
            preset.bounced.frame = frame;
            let picture = renderer.render(subject, &preset)?;
            let sum = &mut halves[usize::from(frame >= FRAMES / 2)];
            for (sum, texel) in sum.iter_mut().zip(picture.pixels) {
                add(effect, sum, texel);
            }
        }
        let share = 2.0 / FRAMES as f32;
        let halves = halves.map(|half| {
            let mean = |sum: [f32; 4]| sum.map(|channel| channel * share);
            half.into_iter().map(mean).collect::<Vec<_>>()
        });
        let both = halves[0].iter().zip(&halves[1]);
        let all = both.map(|(a, b)| [0, 1, 2, 3].map(|i| 0.5 * (a[i] + b[i])));
        let all = all.collect();
        let [first, second] = halves;
        Ok(Some(Self {
            means: [first, second, all],
        }))
    }

    /// How far a picture is off, less the reference's own noise.
    pub fn error(&self, effect: &RayTracedEffect, pixels: &[[f32; 4]], shown: &[bool]) -> f64 {
        let [first, second, all] = &self.means;
        let noise = 0.5 * apart(effect, first, second, shown);
        let found = apart(effect, pixels, all, shown);
        (found * found - noise * noise).max(0.0).sqrt()
    }
}

/// Rays that a reference aims at what shines.
const AIMED: u32 = 16;

/// A direction counts by how much is open about it.
fn add(effect: &RayTracedEffect, sum: &mut [f32; 4], texel: [f32; 4]) {
    let weight = match effect {
        RayTracedEffect::BentNormals { .. } => texel[3],
        _ => 1.0,
    };
    for (sum, channel) in sum.iter_mut().zip(&texel[..3]) {
        *sum += weight * channel;
    }
    sum[3] += texel[3];
}

/// Milliseconds beside which what a machine has else to do is little.
const LONG: f64 = 500.0;

/// The faster of two runs, after one that compiles the pipelines. One, where it takes long anyway.
fn fastest(
    first: bool,
    mut render: impl FnMut() -> Result<Rendered, String>,
) -> Result<Rendered, String> {
    if first {
        render()?;
    }
    let a = render()?;
    if a.view_ms > LONG {
        return Ok(a);
    }
    let b = render()?;
    Ok(Rendered {
        pixels: a.pixels,
        scene_ms: a.scene_ms.min(b.scene_ms),
        view_ms: a.view_ms.min(b.view_ms),
    })
}

/// Time of what views share, and of the rest.
fn split(passes: &[(&str, f64)], shared: &[&str]) -> (f64, f64) {
    let sum = |is: bool| {
        let of = passes.iter().filter(|p| shared.contains(&p.0) == is);
        of.map(|p| p.1).sum()
    };
    (sum(true), sum(false))
}

/// What renders rungs of rays.
struct Rays {
    renderer: BouncedRenderer,
    is_lit: bool,
}

impl Rays {
    fn render(&mut self, subject: &Subject<'_>, preset: &BouncedPreset) -> Result<Picture, String> {
        let lights = if self.is_lit { subject.lights } else { &[] };
        let Subject {
            gpu,
            drawn,
            buffers,
            camera,
            ..
        } = *subject;
        self.renderer
            .render(gpu, drawn, buffers, camera, lights, preset)
            .map_err(|e| e.to_string())
    }
}

fn radius_of(effect: &RayTracedEffect) -> f32 {
    match effect {
        RayTracedEffect::AmbientOcclusion { radius }
        | RayTracedEffect::DirectionalOcclusion { radius }
        | RayTracedEffect::BentNormals { radius } => *radius,
        RayTracedEffect::IndirectDiffuse { .. } | RayTracedEffect::IndirectSpecular { .. } => {
            f32::INFINITY
        }
    }
}

/// Of rungs, or of what they are held against.
fn ray_renderer(
    subject: &Subject<'_>,
    effect: &RayTracedEffect,
    exact: bool,
) -> Result<Rays, String> {
    let triangles = subject.buffers.triangles();
    let capacity = CloudCapacity {
        surfels: 0,
        pieces: triangles + 100_000,
        triangles,
    };
    let payload = effect.payload();
    let is_lit = payload == Payload::LitRadiance;
    let glossy = matches!(effect, RayTracedEffect::IndirectSpecular { .. });
    let room = RayRoom {
        rays_per_pixel: 64,
        counted: is_lit && !exact,
        bent_normals: matches!(effect, RayTracedEffect::BentNormals { .. }),
        sampling: if glossy {
            Sampling::Glossy
        } else {
            Sampling::default()
        },
        emitter_samples: if is_lit && exact { AIMED } else { 0 },
        ..RayRoom::default()
    };
    let mut renderer = BouncedRenderer::new(subject.gpu, payload, capacity, subject.size, room)
        .map_err(|e| e.to_string())?;
    if payload == Payload::Sky {
        renderer.scene.environment = subject.environment(exact)?;
    }
    renderer.roughness = glossy.then(|| subject.roughness());
    Ok(Rays { renderer, is_lit })
}

fn by_rays(
    subject: &Subject<'_>,
    effect: &RayTracedEffect,
    rungs: &[Method],
) -> Result<Vec<Rendered>, String> {
    let mut renderer = ray_renderer(subject, effect, false)?;
    let rays = rungs.iter().filter_map(|rung| match rung {
        Method::Rays(rays) => Some(presets::of(rays, radius_of(effect))),
        _ => None,
    });
    rays.enumerate()
        .map(|(i, preset)| {
            fastest(i == 0, || {
                let picture = renderer.render(subject, &preset)?;
                let (scene_ms, view_ms) = split(&picture.passes, &["surfelize", "bvh"]);
                Ok(Rendered {
                    pixels: picture.pixels,
                    scene_ms,
                    view_ms,
                })
            })
        })
        .collect()
}

fn by_splats(
    subject: &Subject<'_>,
    effect: &RayTracedEffect,
    rungs: &[Method],
) -> Result<Vec<Rendered>, String> {
    let triangles = subject.buffers.triangles();
    let capacity = CloudCapacity {
        surfels: 1 << 19,
        pieces: triangles + 100_000,
        triangles,
    };
    let effect = match effect {
        RayTracedEffect::DirectionalOcclusion { .. } => DirectionalOcclusion::default().effect(),
        RayTracedEffect::BentNormals { .. } => BentNormals::default().effect(),
        RayTracedEffect::IndirectSpecular { .. } => SpecularBounce::default()
            .effect()
            .map_err(|e| e.to_string())?,
        _ => AmbientOcclusion::default().effect(),
    };
    let size = subject.size;
    let mut renderer =
        Renderer::of(subject.gpu, &effect, capacity, size, 5, false).map_err(|e| e.to_string())?;
    if effect.environment {
        renderer.environment = subject.environment(false)?;
    }
    renderer.roughness = effect.roughness.then(|| subject.roughness());
    let splats = rungs.iter().filter_map(|rung| match rung {
        Method::Splats(splats) => Some(*splats),
        _ => None,
    });
    splats
        .enumerate()
        .map(|(i, preset)| {
            fastest(i == 0, || {
                let picture = renderer
                    .render_scene(
                        subject.gpu,
                        subject.drawn,
                        subject.buffers,
                        subject.camera,
                        subject.lights,
                        &preset,
                    )
                    .map_err(|e| e.to_string())?;
                let shared = ["surfelize", "holes", "bvh", "light"];
                let (scene_ms, view_ms) = split(&picture.passes, &shared);
                let grey = |v: f32| [v, v, v, 1.0];
                Ok(Rendered {
                    pixels: match picture.pictures.into_iter().next() {
                        Some(pixels) => pixels,
                        None => picture.visibility.into_iter().map(grey).collect(),
                    },
                    scene_ms,
                    view_ms,
                })
            })
        })
        .collect()
}

fn by_reads(subject: &Subject<'_>, rungs: &[Method]) -> Result<Vec<Rendered>, String> {
    let device = &subject.gpu.device;
    let [width, height] = subject.size;
    let target = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("obscurance"),
        size: wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::R32Float,
        usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let reads = rungs.iter().filter_map(|rung| match rung {
        Method::Obscurance {
            descriptor,
            settings,
        } => Some((descriptor, settings)),
        _ => None,
    });
    reads
        .map(|(descriptor, settings)| {
            let pass = VolumetricObscurance::new(device, descriptor).map_err(|e| e.to_string())?;
            fastest(true, || {
                let gbuffer = subject.drawn.gbuffer();
                let input = ObscuranceInput {
                    depth: gbuffer.depth,
                    normals: Some(gbuffer.normals()),
                    camera: subject.camera,
                    moments: None,
                    work: None,
                    target: (&target).into(),
                    timestamps: None,
                };
                let (view_ms, done) = subject
                    .gpu
                    .time(|encoder| pass.record(device, encoder, &input, settings));
                done.map_err(|e| e.to_string())?;
                let visibility: Vec<f32> = subject.gpu.read_texture(&target, 0);
                Ok(Rendered {
                    pixels: visibility.into_iter().map(|v| [v, v, v, 1.0]).collect(),
                    scene_ms: 0.0,
                    view_ms,
                })
            })
        })
        .collect()
}

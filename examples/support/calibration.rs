//! What plans are made of: the rungs of each method rendered and timed.

use deep_screen_space::{
    AmbientOcclusion, Camera, CloudCapacity, Light, ObscuranceInput, Payload, RayTracedEffect,
    VolumetricObscurance,
    glam::DVec3,
    planner::{Calibration, Method, MethodCalibration, MethodKind},
    wgpu,
};

use crate::{
    ambient_occlusion::Renderer,
    bounced::{BouncedRenderer, RayRoom},
    gpu::Gpu,
    presets,
    raster::Raster,
    scene::SceneBuffers,
    stage::luminance,
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
}

/// A picture and what it took.
pub struct Picture {
    /// Visibility, or luminance.
    pub values: Vec<f32>,
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
    let best = &rays.ok_or("every effect has rays")?.1[1].values;
    let normals: Vec<[f32; 4]> = subject.gpu.read_texture(subject.drawn.normal.texture(), 0);
    let shown: Vec<bool> = normals.iter().map(|n| *n != [0.0; 4]).collect();
    let level = match effect {
        RayTracedEffect::AmbientOcclusion { .. } => 1.0,
        _ => mean(best, &shown).max(f64::MIN_POSITIVE),
    };
    let of = |wanted: MethodKind| {
        let (_, pictures) = pictures.iter().find(|p| p.0 == wanted)?;
        let [cheap, dear] = &pictures[..] else {
            return None;
        };
        Some(MethodCalibration {
            scene_ms: cheap.scene_ms,
            view_ms: [cheap.view_ms, dear.view_ms],
            difference: Some(difference(&cheap.values, best, &shown) / level),
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

fn mean(values: &[f32], of: &[bool]) -> f64 {
    let chosen = values.iter().zip(of).filter(|(_, of)| **of);
    let (sum, count) = chosen.fold((0.0, 0_u32), |(sum, count), (v, _)| {
        (sum + f64::from(*v), count + 1)
    });
    sum / f64::from(count.max(1))
}

/// Root mean square of the difference, over those pixels.
pub fn difference(a: &[f32], b: &[f32], of: &[bool]) -> f64 {
    let squares: Vec<f32> = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).collect();
    mean(&squares, of).sqrt()
}

/// Renders rungs of one method.
pub fn render(
    subject: &Subject<'_>,
    effect: &RayTracedEffect,
    rungs: &[Method],
) -> Result<Vec<Picture>, String> {
    match rungs.first().map(Method::kind) {
        None => Ok(Vec::new()),
        Some(MethodKind::Rays) => by_rays(subject, effect, rungs),
        Some(MethodKind::Splats) => by_splats(subject, rungs),
        Some(MethodKind::Obscurance) => by_reads(subject, rungs),
    }
}

/// The faster of two runs, after one that compiles the pipelines.
fn fastest(
    first: bool,
    mut render: impl FnMut() -> Result<Picture, String>,
) -> Result<Picture, String> {
    if first {
        render()?;
    }
    let [a, b] = [render()?, render()?];
    Ok(Picture {
        values: a.values,
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

fn by_rays(
    subject: &Subject<'_>,
    effect: &RayTracedEffect,
    rungs: &[Method],
) -> Result<Vec<Picture>, String> {
    let triangles = subject.buffers.triangles();
    let capacity = CloudCapacity {
        surfels: 0,
        pieces: triangles + 100_000,
        triangles,
    };
    let radius = match effect {
        RayTracedEffect::AmbientOcclusion { radius } => *radius,
        _ => f32::INFINITY,
    };
    let payload = effect.payload();
    let is_light = payload == Payload::LitRadiance;
    let room = RayRoom {
        rays_per_pixel: 64,
        counted: is_light,
        ..RayRoom::default()
    };
    let mut renderer = BouncedRenderer::new(subject.gpu, payload, capacity, subject.size, room)
        .map_err(|e| e.to_string())?;
    let lights = if is_light { subject.lights } else { &[] };
    let rays = rungs.iter().filter_map(|rung| match rung {
        Method::Rays(rays) => Some(presets::of(rays, radius)),
        _ => None,
    });
    rays.enumerate()
        .map(|(i, preset)| {
            fastest(i == 0, || {
                let picture = renderer
                    .render(
                        subject.gpu,
                        subject.drawn,
                        subject.buffers,
                        subject.camera,
                        lights,
                        &preset,
                    )
                    .map_err(|e| e.to_string())?;
                let (scene_ms, view_ms) = split(&picture.passes, &["surfelize", "bvh"]);
                let light = |c: [f32; 3]| luminance(DVec3::from(c.map(f64::from)));
                Ok(Picture {
                    values: if is_light {
                        picture
                            .radiance()
                            .into_iter()
                            .map(|c| light(c) as f32)
                            .collect()
                    } else {
                        picture.visibility()
                    },
                    scene_ms,
                    view_ms,
                })
            })
        })
        .collect()
}

fn by_splats(subject: &Subject<'_>, rungs: &[Method]) -> Result<Vec<Picture>, String> {
    let triangles = subject.buffers.triangles();
    let capacity = CloudCapacity {
        surfels: 1 << 19,
        pieces: triangles + 100_000,
        triangles,
    };
    let effect = AmbientOcclusion::default();
    let size = subject.size;
    let mut renderer =
        Renderer::new(subject.gpu, effect, capacity, size, 5, false).map_err(|e| e.to_string())?;
    let splats = rungs.iter().filter_map(|rung| match rung {
        Method::Splats(splats) => Some(*splats),
        _ => None,
    });
    splats
        .enumerate()
        .map(|(i, preset)| {
            fastest(i == 0, || {
                let picture = renderer
                    .render(
                        subject.gpu,
                        subject.drawn,
                        &subject.buffers.meshes(),
                        subject.camera,
                        &preset,
                    )
                    .map_err(|e| e.to_string())?;
                let (scene_ms, view_ms) = split(&picture.passes, &["surfelize"]);
                Ok(Picture {
                    values: picture.visibility,
                    scene_ms,
                    view_ms,
                })
            })
        })
        .collect()
}

fn by_reads(subject: &Subject<'_>, rungs: &[Method]) -> Result<Vec<Picture>, String> {
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
                Ok(Picture {
                    values: subject.gpu.read_texture(&target, 0),
                    scene_ms: 0.0,
                    view_ms,
                })
            })
        })
        .collect()
}

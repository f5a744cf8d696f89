//! Errors and times of the rungs of one view.

use deep_screen_space::{
    AmbientOcclusion, CloudCapacity, ObscuranceInput, Payload, RayTracedEffect,
    VolumetricObscurance,
    glam::DVec3,
    planner::{Calibration, Method, MethodCalibration, MethodKind},
    wgpu,
};
use serde::Serialize;
use support::{
    ambient_occlusion::Renderer,
    bounced::{BouncedRenderer, RayRoom},
    presets,
    stage::{Stage, Truth, compare, luminance},
};

/// One effect in one view.
#[derive(Serialize)]
pub struct Measured {
    pub view: String,
    /// `within`, `unbounded` or `light`.
    pub effect: &'static str,
    #[serde(skip)]
    pub asked: RayTracedEffect,
    #[serde(skip)]
    pub size: [u32; 2],
    pub triangles: u32,
    pub rungs: Vec<Rung>,
    /// By method: the difference of the calibration's cheap picture from the dear one of rays.
    pub differences: Vec<(String, f64)>,
}

/// One setting.
#[derive(Serialize)]
pub struct Rung {
    #[serde(skip)]
    pub method: Method,
    pub name: String,
    pub error: f64,
    pub scene_ms: f64,
    pub view_ms: f64,
}

impl Measured {
    /// What a caller would have measured.
    pub fn calibration(&self) -> Calibration {
        let of = |kind: MethodKind| {
            let rungs = kind.calibrated(&self.asked)?;
            let found = rungs.map(|rung| self.rungs.iter().find(|r| r.method == rung));
            let [Some(cheap), Some(dear)] = found else {
                return None;
            };
            let named = |(name, _): &&(String, f64)| *name == format!("{kind:?}");
            Some(MethodCalibration {
                scene_ms: cheap.scene_ms,
                view_ms: [cheap.view_ms, dear.view_ms],
                difference: self.differences.iter().find(named).map(|d| d.1),
            })
        };
        Calibration {
            size: self.size,
            triangles: self.triangles,
            rays: of(MethodKind::Rays),
            splats: of(MethodKind::Splats),
            obscurance: of(MethodKind::Obscurance),
        }
    }
}

/// All effects of a view.
pub fn measure(stage: &Stage<'_>, view: &str) -> Result<Vec<Measured>, String> {
    let radius = stage.scene.ao_radius;
    let occlusion = |radius| RayTracedEffect::AmbientOcclusion { radius };
    let light = RayTracedEffect::IndirectDiffuse {
        sky_radiance: [0.0; 3],
    };
    let mut all = Vec::new();
    for (name, effect) in [
        ("within", occlusion(radius)),
        ("unbounded", occlusion(f32::INFINITY)),
        ("light", light),
    ] {
        let truth = match effect {
            RayTracedEffect::AmbientOcclusion { radius } => stage.truth(radius)?,
            _ => stage.light_truth(),
        };
        let mut pictures = Vec::new();
        for kind in MethodKind::ALL {
            let rungs = kind.rungs(&effect);
            let rendered = match kind {
                _ if rungs.is_empty() => Vec::new(),
                MethodKind::Rays => by_rays(stage, &effect, &truth, &rungs)?,
                MethodKind::Splats => by_splats(stage, &rungs)?,
                MethodKind::Obscurance => by_reads(stage, &rungs)?,
            };
            pictures.extend(rungs.into_iter().zip(rendered));
        }
        let of = |method: Method| pictures.iter().find(|p| p.0 == method).map(|p| &p.1);
        let best = MethodKind::Rays
            .calibrated(&effect)
            .and_then(|[_, dear]| of(dear))
            .ok_or("rays are always rendered")?;
        let mut differences = Vec::new();
        for kind in MethodKind::ALL {
            let Some([cheap, _]) = kind.calibrated(&effect) else {
                continue;
            };
            let cheap = of(cheap).ok_or("calibrated rungs are rungs")?;
            differences.push((format!("{kind:?}"), apart(cheap, best, &truth)));
        }
        let rungs = pictures
            .iter()
            .map(|(method, picture)| Rung {
                method: *method,
                name: method.to_string(),
                error: compare(&picture.values, &truth.estimates).0,
                scene_ms: picture.scene_ms,
                view_ms: picture.view_ms,
            })
            .collect();
        all.push(Measured {
            view: view.to_owned(),
            effect: name,
            asked: effect,
            size: stage.effort.size,
            triangles: stage.buffers.triangles(),
            rungs,
            differences,
        });
    }
    Ok(all)
}

struct Picture {
    values: Vec<f32>,
    scene_ms: f64,
    view_ms: f64,
}

/// Root mean square of the difference, over pixels with a surface.
fn apart(a: &Picture, b: &Picture, truth: &Truth) -> f64 {
    let (mut sum, mut count) = (0.0, 0_u32);
    for ((a, b), known) in a.values.iter().zip(&b.values).zip(&truth.estimates) {
        if known.is_some() {
            sum += (f64::from(*a) - f64::from(*b)).powi(2);
            count += 1;
        }
    }
    (sum / f64::from(count.max(1))).sqrt()
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
    stage: &Stage<'_>,
    effect: &RayTracedEffect,
    truth: &Truth,
    rungs: &[Method],
) -> Result<Vec<Picture>, String> {
    let triangles = stage.buffers.triangles();
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
    let mut renderer = BouncedRenderer::new(stage.gpu, payload, capacity, stage.effort.size, room)
        .map_err(|e| e.to_string())?;
    let lights = if is_light {
        stage.lights.as_slice()
    } else {
        &[]
    };
    let rays = rungs.iter().filter_map(|rung| match rung {
        Method::Rays(rays) => Some(presets::of(rays, radius)),
        _ => None,
    });
    rays.enumerate()
        .map(|(i, preset)| {
            fastest(i == 0, || {
                let picture = renderer
                    .render(
                        stage.gpu,
                        &stage.drawn,
                        &stage.buffers,
                        &stage.camera,
                        lights,
                        &preset,
                    )
                    .map_err(|e| e.to_string())?;
                let (scene_ms, view_ms) = split(&picture.passes, &["surfelize", "bvh"]);
                let light = |c: [f32; 3]| luminance(DVec3::from(c.map(f64::from))) / truth.level;
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

fn by_splats(stage: &Stage<'_>, rungs: &[Method]) -> Result<Vec<Picture>, String> {
    let triangles = stage.buffers.triangles();
    let capacity = CloudCapacity {
        surfels: 1 << 19,
        pieces: triangles + 100_000,
        triangles,
    };
    let effect = AmbientOcclusion::default();
    let size = stage.effort.size;
    let mut renderer =
        Renderer::new(stage.gpu, effect, capacity, size, 5, false).map_err(|e| e.to_string())?;
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
                        stage.gpu,
                        &stage.drawn,
                        &stage.buffers.meshes(),
                        &stage.camera,
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

fn by_reads(stage: &Stage<'_>, rungs: &[Method]) -> Result<Vec<Picture>, String> {
    let device = &stage.gpu.device;
    let [width, height] = stage.effort.size;
    let target = stage
        .gpu
        .target(wgpu::TextureFormat::R32Float, width, height);
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
                let gbuffer = stage.drawn.gbuffer();
                let input = ObscuranceInput {
                    depth: gbuffer.depth,
                    normals: Some(gbuffer.normals()),
                    camera: &stage.camera,
                    moments: None,
                    work: None,
                    target: target.texture().into(),
                    timestamps: None,
                };
                let (view_ms, done) = stage
                    .gpu
                    .time(|encoder| pass.record(device, encoder, &input, settings));
                done.map_err(|e| e.to_string())?;
                Ok(Picture {
                    values: stage.gpu.read_texture(target.texture(), 0),
                    scene_ms: 0.0,
                    view_ms,
                })
            })
        })
        .collect()
}

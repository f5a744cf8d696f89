//! Errors and times of the rungs of one view.

use deep_screen_space::{
    RayTracedEffect,
    glam::DVec3,
    planner::{Calibration, Method, MethodCalibration, MethodKind},
    reference::trace::BentEstimate,
};
use serde::Serialize;
use support::{
    apart::{apart, mean_angle, values},
    calibration::{Reference, Rendered, Subject, render},
    sky,
    stage::{Stage, Truth, compare},
};

/// The curves, as `src/planner/curves.rs` has them.
pub const CURVES: [&str; 6] = ["within", "unbounded", "light", "sky", "bent", "glossy"];

/// The environment of the curve of skies: a small sun, which gives a surface that faces it four times what the dim rest does.
const SKY: &str = "sunny";

/// One effect in one view.
#[derive(Serialize)]
pub struct Measured {
    pub view: String,
    /// One of [`CURVES`].
    pub curve: &'static str,
    /// What of the effect was asked for.
    pub case: String,
    #[serde(skip)]
    pub asked: RayTracedEffect,
    #[serde(skip)]
    pub size: [u32; 2],
    pub triangles: u32,
    pub rungs: Vec<Rung>,
}

/// One setting.
#[derive(Serialize)]
pub struct Rung {
    #[serde(skip)]
    pub method: Method,
    pub name: String,
    pub error: f64,
    /// How far the picture is from the dearest one of rays.
    pub apart: f64,
    /// What a calibration finds its error to be, where it renders a reference.
    pub off: Option<f64>,
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
            Some(MethodCalibration {
                scene_ms: cheap.scene_ms,
                view_ms: [cheap.view_ms, dear.view_ms],
                difference: Some(cheap.apart),
                errors: cheap.off.zip(dear.off).map(|(cheap, dear)| [cheap, dear]),
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

    pub fn label(&self) -> String {
        format!("{} {}", self.view, self.case)
    }
}

/// What is asked for: an effect, and how rough surfaces are.
struct Case {
    name: String,
    effect: RayTracedEffect,
    roughness: f32,
}

/// Those of a curve, where occluders within `radius` matter.
fn cases(curve: &str, radius: f32) -> Vec<Case> {
    let case = |how: &str, effect, roughness| Case {
        name: format!("{curve}{how}"),
        effect,
        roughness,
    };
    let sky_radiance = [0.0; 3];
    let each = |effect: fn(f32) -> RayTracedEffect| {
        vec![
            case(" within", effect(radius), 0.0),
            case(" unbounded", effect(f32::INFINITY), 0.0),
        ]
    };
    match curve {
        "within" => vec![case("", RayTracedEffect::AmbientOcclusion { radius }, 0.0)],
        "unbounded" => {
            let radius = f32::INFINITY;
            vec![case("", RayTracedEffect::AmbientOcclusion { radius }, 0.0)]
        }
        "sky" => each(|radius| RayTracedEffect::DirectionalOcclusion { radius }),
        "bent" => each(|radius| RayTracedEffect::BentNormals { radius }),
        "glossy" => {
            let effect = RayTracedEffect::IndirectSpecular { sky_radiance };
            vec![case(" 0.3", effect, 0.3), case(" 1", effect, 1.0)]
        }
        _ => vec![case(
            "",
            RayTracedEffect::IndirectDiffuse { sky_radiance },
            0.0,
        )],
    }
}

/// What errors are of.
enum Known {
    Values(Truth),
    Bent([Vec<Option<BentEstimate>>; 2]),
}

impl Known {
    fn error(&self, effect: &RayTracedEffect, pixels: &[[f32; 4]]) -> f64 {
        match self {
            Self::Values(truth) => {
                let values = values(effect, pixels);
                let values: Vec<f32> = values.iter().map(|v| v / truth.level as f32).collect();
                compare(&values, &truth.estimates).0
            }
            Self::Bent([one, other]) => {
                let cones = one.iter().zip(other).map(|(one, other)| {
                    let (one, other) = (one.as_ref()?, other.as_ref()?);
                    let visibility = 0.5 * (one.visibility + other.visibility);
                    Some((one.mean + other.mean, visibility))
                });
                let found = mean_angle(pixels, cones);
                let axis = |e: &Option<BentEstimate>| {
                    let mean = e.map_or(DVec3::ZERO, |e| e.mean);
                    mean.as_vec3().extend(1.0).to_array()
                };
                let axes: Vec<_> = one.iter().map(axis).collect();
                let cones = other.iter().map(|e| e.map(|e| (e.mean, e.visibility)));
                let noise = 0.5 * mean_angle(&axes, cones);
                (found * found - noise * noise).max(0.0).sqrt()
            }
        }
    }
}

/// All effects of a view, by those curves.
pub fn measure(
    stage: &Stage<'_>,
    view: &str,
    curves: &[&'static str],
) -> Result<Vec<Measured>, String> {
    let sky = sky::by_name(SKY).ok_or("there is no such sky")?;
    let mut all = Vec::new();
    for &curve in curves {
        for case in cases(curve, stage.scene.ao_radius) {
            let subject = Subject {
                sky: Some(&sky),
                roughness: case.roughness,
                ..stage.subject()
            };
            let truth = match case.effect {
                RayTracedEffect::AmbientOcclusion { radius } => Known::Values(stage.truth(radius)?),
                RayTracedEffect::DirectionalOcclusion { radius } => {
                    Known::Values(stage.sky_truth(&sky, radius))
                }
                RayTracedEffect::BentNormals { radius } => Known::Bent(stage.bent_truth(radius)),
                RayTracedEffect::IndirectDiffuse { .. } => Known::Values(stage.light_truth()),
                RayTracedEffect::IndirectSpecular { .. } => {
                    Known::Values(stage.glossy_truth(case.roughness))
                }
            };
            all.push(Measured {
                view: view.to_owned(),
                curve,
                asked: case.effect,
                size: stage.effort.size,
                triangles: stage.buffers.triangles(),
                rungs: rungs(&subject, &case.effect, &truth)?,
                case: case.name,
            });
        }
    }
    Ok(all)
}

fn rungs(
    subject: &Subject<'_>,
    effect: &RayTracedEffect,
    truth: &Known,
) -> Result<Vec<Rung>, String> {
    let mut pictures = Vec::new();
    for kind in MethodKind::ALL {
        let rungs = kind.rungs(effect);
        let rendered = render(subject, effect, &rungs)?;
        pictures.extend(rungs.into_iter().zip(rendered));
    }
    let dear = MethodKind::Rays
        .calibrated(effect)
        .and_then(|[_, dear]| pictures.iter().find(|p| p.0 == dear))
        .ok_or("rays are always rendered")?;
    let shown = subject.shown();
    let reference = Reference::of(subject, effect)?;
    let rung = |(method, picture): &(Method, Rendered)| Rung {
        method: *method,
        name: method.to_string(),
        error: truth.error(effect, &picture.pixels),
        apart: apart(effect, &picture.pixels, &dear.1.pixels, &shown),
        off: reference
            .as_ref()
            .map(|reference| reference.error(effect, &picture.pixels, &shown)),
        scene_ms: picture.scene_ms,
        view_ms: picture.view_ms,
    };
    Ok(pictures.iter().map(rung).collect())
}

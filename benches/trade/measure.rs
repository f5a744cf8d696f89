//! Errors and times of the rungs of one view.

use deep_screen_space::{
    RayTracedEffect,
    planner::{Calibration, Method, MethodCalibration, MethodKind},
};
use serde::Serialize;
use support::{
    calibration::{difference, render},
    stage::{Stage, Truth, compare},
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
            let rendered = render(&stage.subject(), &effect, &rungs)?;
            pictures.extend(rungs.into_iter().zip(rendered));
        }
        let of = |method: Method| pictures.iter().find(|p| p.0 == method).map(|p| &p.1);
        let best = MethodKind::Rays
            .calibrated(&effect)
            .and_then(|[_, dear]| of(dear))
            .ok_or("rays are always rendered")?;
        let shown: Vec<bool> = truth.estimates.iter().map(Option::is_some).collect();
        let mut differences = Vec::new();
        for kind in MethodKind::ALL {
            let Some([cheap, _]) = kind.calibrated(&effect) else {
                continue;
            };
            let cheap = of(cheap).ok_or("calibrated rungs are rungs")?;
            let apart = difference(&cheap.values, &best.values, &shown);
            differences.push((format!("{kind:?}"), apart / truth.level));
        }
        let rungs = pictures
            .iter()
            .map(|(method, picture)| Rung {
                method: *method,
                name: method.to_string(),
                error: error(&picture.values, &truth),
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

/// Of values that are not yet in units of the truth's level.
fn error(values: &[f32], truth: &Truth) -> f64 {
    let values: Vec<f32> = values.iter().map(|v| v / truth.level as f32).collect();
    compare(&values, &truth.estimates).0
}

//! What plans predict beside what was measured.

use deep_screen_space::{
    planner::{Budget, MethodKind, Plan, PlanRequest, SceneCounts, plan},
    wgpu::Limits,
};

use crate::{
    fit::{Fitted, NOTHING, fit},
    measure::{Measured, Rung},
};

fn planned(view: &Measured, budget: Budget) -> Option<Plan> {
    let calibration = view.calibration();
    plan(&PlanRequest {
        limits: &Limits::default(),
        size: view.size,
        scene: SceneCounts::once(view.triangles.into()),
        effect: view.asked,
        budget,
        calibration: Some(&calibration),
    })
    .ok()
}

fn measured<'m>(view: &'m Measured, plan: &Plan) -> Option<&'m Rung> {
    view.rungs
        .iter()
        .find(|rung| rung.method == plan.chosen.method)
}

/// Errors of each scene by a table of the others.
pub fn left_out(all: &[Measured]) {
    let mut scenes: Vec<&str> = all.iter().map(|m| m.view.as_str()).collect();
    scenes.dedup();
    let mut of = Vec::new();
    for scene in scenes {
        let others: Vec<&Measured> = all.iter().filter(|m| m.view != scene).collect();
        let others = fit(&others);
        of.extend(ratios(
            all.iter().filter(|m| m.view == scene),
            Some(&others),
        ));
    }
    tell(
        "errors by a table of the other scenes, with a calibration",
        of,
    );
}

/// Errors by a table, or by that which the crate has.
pub fn errors(all: &[Measured], table: Option<&[Fitted]>) {
    tell(
        "errors by the crate's table, with a calibration",
        ratios(all.iter(), table),
    );
}

/// Predicted over measured, of each view, effect, method and rung.
fn ratios<'m>(
    views: impl Iterator<Item = &'m Measured>,
    table: Option<&[Fitted]>,
) -> Vec<(String, f64)> {
    let mut all = Vec::new();
    for view in views {
        let calibration = view.calibration();
        let weighed = planned(view, Budget::Error(1.0)).map_or_else(Vec::new, |p| p.weighed);
        for rung in &view.rungs {
            let kind = rung.method.kind();
            let own = view.rungs.iter().filter(|r| r.method.kind() == kind);
            let place = own.take_while(|r| r.method != rung.method).count();
            let predicted = match table {
                Some(lines) => {
                    let known = match kind {
                        MethodKind::Rays => calibration.rays,
                        MethodKind::Splats => calibration.splats,
                        MethodKind::Obscurance => calibration.obscurance,
                    };
                    let line = lines
                        .iter()
                        .find(|l| l.curve == view.curve && l.kind == kind);
                    line.zip(known)
                        .and_then(|(line, known)| line.error(place, &known))
                }
                None => weighed
                    .iter()
                    .find(|c| c.method == rung.method)
                    .map(|c| c.error),
            };
            if rung.error <= NOTHING {
                continue;
            }
            if let Some(predicted) = predicted {
                let label = format!("{} {}", view.label(), rung.name);
                all.push((label, predicted / rung.error));
            }
        }
    }
    all
}

fn tell(what: &str, mut ratios: Vec<(String, f64)>) {
    ratios.sort_by(|a, b| a.1.total_cmp(&b.1));
    let good = ratios
        .iter()
        .filter(|(_, r)| (r - 1.0).abs() <= 0.3)
        .count();
    let tenth = ratios.get(ratios.len() / 10).map_or(1.0, |r| r.1);
    println!(
        "\n{what}: {good} of {} within 30 %; nine of ten at least {tenth:.2} of the measured",
        ratios.len()
    );
    let ends = ratios.iter().take(5).chain(ratios.iter().rev().take(5));
    for (label, ratio) in ends {
        println!("  {ratio:5.2} of the measured: {label}");
    }
}

/// Times of the rungs that no calibration measured.
pub fn times(all: &[Measured]) {
    let mut ratios = Vec::new();
    for view in all {
        let Some(plan) = planned(view, Budget::Error(1.0)) else {
            continue;
        };
        for rung in &view.rungs {
            let found = plan.weighed.iter().find(|c| c.method == rung.method);
            if let Some(predicted) = found.and_then(|c| c.milliseconds) {
                let label = format!("{} {}", view.label(), rung.name);
                ratios.push((label, predicted / (rung.scene_ms + rung.view_ms)));
            }
        }
    }
    tell("times, with a calibration", ratios);
}

/// Plans for an error and for a time, and whether they meet it.
pub fn budgets(all: &[Measured]) {
    let (mut met, mut of) = (0, 0);
    let mut worst: f64 = 1.0;
    let mut within = (0, 0);
    for view in all {
        let errors = view.rungs.iter().map(|r| r.error);
        let least = errors.clone().fold(f64::INFINITY, f64::min);
        if least <= NOTHING {
            continue;
        }
        for factor in [1.2, 1.5, 2.0, 3.0] {
            let asked = factor * least;
            let Some(plan) = planned(view, Budget::Error(asked)) else {
                continue;
            };
            if let Some(rung) = measured(view, &plan) {
                of += 1;
                if rung.error <= asked {
                    met += 1;
                } else {
                    println!(
                        "  {}: {asked:.4} was asked for, {} has {:.4}",
                        view.label(),
                        rung.name,
                        rung.error
                    );
                }
            }
        }
        let times = view.rungs.iter().map(|r| r.scene_ms + r.view_ms);
        let (low, high) = times.fold((f64::INFINITY, 0.0_f64), |(l, h), t| (l.min(t), h.max(t)));
        for share in [0.2, 0.5, 0.8] {
            let asked = low * (high / low).powf(share);
            let Some(plan) = planned(view, Budget::Milliseconds(asked)) else {
                continue;
            };
            if let Some(rung) = measured(view, &plan) {
                let ratio = (rung.scene_ms + rung.view_ms) / asked;
                worst = worst.max(ratio);
                within.0 += u32::from(ratio <= 1.5);
                within.1 += 1;
            }
        }
    }
    println!("\nplans for an error: {met} of {of} meet it");
    println!(
        "plans for a time: {} of {} take at most 1.5 times of it, the worst {worst:.2}",
        within.0, within.1
    );
}

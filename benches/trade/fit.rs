//! The table of `src/planner/curves.rs`, from what was measured.

use deep_screen_space::planner::MethodKind;

use crate::measure::Measured;

/// One method's line of the table.
#[derive(Clone, Debug)]
pub struct Fitted {
    pub effect: &'static str,
    pub kind: MethodKind,
    pub errors: Vec<f64>,
    pub typical: f64,
    pub of_difference: f64,
}

/// An error below which there is none.
pub const NOTHING: f64 = 1e-4;

/// Errors are products: means of them are of their logarithms.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| {
        (sum + value.max(1e-6).ln(), count + 1)
    });
    (sum / f64::from(count.max(1))).exp()
}

/// Of all effects and methods.
pub fn fit(all: &[&Measured]) -> Vec<Fitted> {
    let mut lines = Vec::new();
    for effect in ["within", "unbounded", "light"] {
        for kind in MethodKind::ALL {
            let cheap = if kind == MethodKind::Rays { 2 } else { 0 };
            let views: Vec<(Vec<f64>, f64)> = all
                .iter()
                .filter(|view| view.effect == effect)
                .filter_map(|view| {
                    let rungs = view.rungs.iter().filter(|rung| rung.method.kind() == kind);
                    let named = |(name, _): &&(String, f64)| *name == format!("{kind:?}");
                    let difference = view.differences.iter().find(named)?.1;
                    let errors: Vec<f64> = rungs.map(|rung| rung.error).collect();
                    // Where nothing is seen to vary there is no curve.
                    (errors[cheap] > NOTHING).then_some((errors, difference))
                })
                .collect();
            let Some((first, _)) = views.first() else {
                continue;
            };
            let errors = (0..first.len())
                .map(|i| mean(views.iter().map(|(errors, _)| errors[i] / errors[cheap])));
            lines.push(Fitted {
                effect,
                kind,
                errors: errors.collect(),
                typical: mean(views.iter().map(|(errors, _)| errors[cheap])),
                of_difference: mean(views.iter().map(|(errors, d)| errors[cheap] / d.max(1e-6))),
            });
        }
    }
    lines
}

/// As the source has it.
pub fn print(all: &[Measured]) {
    let all: Vec<&Measured> = all.iter().collect();
    println!("\nsrc/planner/curves.rs:");
    for Fitted {
        effect,
        kind,
        errors,
        typical,
        of_difference,
    } in fit(&all)
    {
        let errors: Vec<String> = errors.iter().map(|e| format!("{e:.3}")).collect();
        println!(
            "{effect:9} {kind:10?} errors: &[{}], typical: {typical:.4}, of_difference: {of_difference:.3}",
            errors.join(", ")
        );
    }
}

//! The table of `src/planner/curves.rs`, from what was measured.

use deep_screen_space::planner::{MethodCalibration, MethodKind};

use crate::measure::{CURVES, Measured};

/// One method's line of the table.
#[derive(Clone, Debug)]
pub struct Fitted {
    pub curve: &'static str,
    pub kind: MethodKind,
    pub errors: Vec<f64>,
    pub typical: f64,
    pub of_difference: f64,
}

impl Fitted {
    /// The error of a rung, of a calibration.
    pub fn error(&self, place: usize, known: &MethodCalibration) -> Option<f64> {
        let found = self.errors[place];
        if let Some([cheap, dear]) = known.errors {
            let [cheap, dear] = [cheap, dear].map(|error| error.max(1e-6));
            let last = self.errors.last()?;
            let along = (found.ln() / last.ln()).clamp(-3.0, 1.0);
            return Some(cheap * (dear / cheap).powf(along));
        }
        Some(known.difference? * self.of_difference * found)
    }
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

/// Of all curves and methods.
pub fn fit(all: &[&Measured]) -> Vec<Fitted> {
    let mut lines = Vec::new();
    for curve in CURVES {
        for kind in MethodKind::ALL {
            let views: Vec<(Vec<f64>, (f64, f64))> = all
                .iter()
                .filter(|view| view.curve == curve)
                .filter_map(|view| {
                    let [cheap, _] = kind.calibrated(&view.asked)?;
                    let rungs = view.rungs.iter().filter(|rung| rung.method.kind() == kind);
                    let rungs: Vec<_> = rungs.collect();
                    let cheap = rungs.iter().find(|rung| rung.method == cheap)?;
                    // Where nothing is seen to vary there is no curve.
                    (cheap.error > NOTHING).then(|| {
                        let relative = rungs.iter().map(|rung| rung.error / cheap.error);
                        (relative.collect(), (cheap.error, cheap.apart))
                    })
                })
                .collect();
            let Some((first, _)) = views.first() else {
                continue;
            };
            let errors = (0..first.len()).map(|i| mean(views.iter().map(|(errors, _)| errors[i])));
            lines.push(Fitted {
                curve,
                kind,
                errors: errors.collect(),
                typical: mean(views.iter().map(|(_, (error, _))| *error)),
                of_difference: mean(
                    views
                        .iter()
                        .map(|(_, (error, apart))| error / apart.max(1e-6)),
                ),
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
        curve,
        kind,
        errors,
        typical,
        of_difference,
    } in fit(&all)
    {
        let errors: Vec<String> = errors.iter().map(|e| format!("{e:.3}")).collect();
        println!(
            "{curve:9} {kind:10?} errors: &[{}], typical: {typical:.4}, of_difference: {of_difference:.3}",
            errors.join(", ")
        );
    }
}

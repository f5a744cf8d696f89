//! A row a picture: printed, saved, and averaged over scenes into panels.

use std::fmt::Write as _;

use serde::Serialize;
use serde_json::Value;

use support::stage::{self, Effect};

use super::{
    chart::{Panel, Point},
    method::{Measurement, QUALITY, Shot},
    splat::PRESETS,
};

/// One line of the table.
#[derive(Clone, Serialize)]
pub struct Row {
    pub adapter: String,
    pub effect: Effect,
    pub scene: &'static str,
    pub view: &'static str,
    pub width: u32,
    pub height: u32,
    pub ao_radius: f32,
    pub method: &'static str,
    pub knob: &'static str,
    pub value: String,
    pub settings: Value,
    pub work: Value,
    pub note: Option<&'static str>,
    pub rmse: f64,
    pub bias: f64,
    pub depth_alone_rmse: Option<f64>,
    pub ms: f64,
    pub ms_of_balanced: f64,
    /// Milliseconds a pass.
    pub passes: Value,
}

impl Row {
    /// Of a shot, without a place on a curve.
    pub fn new(
        measurement: &Measurement<'_, '_>,
        method: &'static str,
        settings: Value,
        work: Value,
        shot: &Shot,
        unit_ms: f64,
    ) -> Self {
        let Measurement { stage, truth, .. } = measurement;
        let (rmse, bias) = stage::compare(&shot.values, &truth.estimates);
        Self {
            adapter: stage.gpu.name(),
            effect: measurement.effect,
            scene: stage.scene.name,
            view: stage.scene.views[0].name,
            width: stage.effort.size[0],
            height: stage.effort.size[1],
            ao_radius: measurement.radius,
            method,
            knob: "",
            value: String::new(),
            settings,
            work,
            note: shot.note,
            rmse,
            bias,
            depth_alone_rmse: truth.depth_alone_rmse,
            ms: shot.total_ms(),
            ms_of_balanced: shot.total_ms() / unit_ms,
            passes: shot
                .passes
                .iter()
                .map(|&(name, ms)| (name.to_owned(), Value::from(ms)))
                .collect(),
        }
    }

    pub fn print_header() {
        println!(
            "{:12} {:>3} {:>6} {:10} {:>18} {:>14} {:>8} {:>8} {:>9} {:>11}",
            "scene", "of", "radius", "method", "knob", "value", "RMSE", "bias", "ms", "of balanced"
        );
    }

    pub fn print(&self) {
        println!(
            "{:12} {:>3} {:>6} {:10} {:>18} {:>14} {:>8.4} {:>+8.4} {:>9.1} {:>11.2}  {}",
            self.scene,
            self.effect.name(),
            self.ao_radius,
            self.method,
            self.knob,
            self.value,
            self.rmse,
            self.bias,
            self.ms,
            self.ms_of_balanced,
            self.note.unwrap_or_default(),
        );
    }

    /// The name of the method's line in the comparison of methods, for rows that are on one.
    fn method_line(&self) -> Option<String> {
        let rest = self.knob.strip_prefix(QUALITY)?;
        Some(format!("{}{rest}", self.method))
    }
}

/// One line a method.
pub fn method_panel(title: &str, rows: &[&Row]) -> Panel {
    panel(title, rows, Row::method_line)
}

/// One line a knob of one method.
pub fn knob_panel(title: &str, rows: &[&Row], method: &str) -> Panel {
    panel(title, rows, |row| {
        let shown = row.method == method && row.knob != "preset" && row.knob != QUALITY;
        shown.then(|| row.knob.to_owned())
    })
}

fn panel(title: &str, rows: &[&Row], line: impl Fn(&Row) -> Option<String>) -> Panel {
    let presets = curves(rows, |row| (row.knob == "preset").then(String::new));
    // Once a scene, not once a row.
    let alone: Vec<f64> = rows
        .iter()
        .filter(|r| r.knob == "preset" && r.value == PRESETS[0])
        .filter_map(|r| r.depth_alone_rmse)
        .collect();
    Panel {
        title: title.into(),
        curves: curves(rows, line),
        presets: presets.into_iter().flat_map(|(_, points)| points).collect(),
        depth_alone: (!alone.is_empty()).then(|| alone.iter().sum::<f64>() / alone.len() as f64),
    }
}

/// Means over scenes: of errors the arithmetic one, of times the geometric one of their ratios. In the order of the rows.
fn curves(rows: &[&Row], line: impl Fn(&Row) -> Option<String>) -> Vec<(String, Vec<Point>)> {
    // Points whose time is still a sum of logarithms and whose error is a sum, and of how many rows.
    let mut curves: Vec<(String, Vec<(Point, f64)>)> = Vec::new();
    for row in rows {
        let Some(name) = line(row) else { continue };
        let at = curves.iter().position(|c| c.0 == name);
        let at = at.unwrap_or_else(|| {
            curves.push((name, Vec::new()));
            curves.len() - 1
        });
        let points = &mut curves[at].1;
        let at = points.iter().position(|(p, _)| p.label == row.value);
        let at = at.unwrap_or_else(|| {
            let label = row.value.clone();
            let (time, error) = (0.0, 0.0);
            points.push((Point { label, time, error }, 0.0));
            points.len() - 1
        });
        let (point, count) = &mut points[at];
        point.time += row.ms_of_balanced.ln();
        point.error += row.rmse;
        *count += 1.0;
    }
    let mean = |(point, count): (Point, f64)| Point {
        time: (point.time / count).exp(),
        error: point.error / count,
        ..point
    };
    curves
        .into_iter()
        .map(|(name, points)| (name, points.into_iter().map(mean).collect()))
        .collect()
}

/// Of all settings those that none beats in time and error both.
pub fn print_best(panel: &Panel) {
    println!("{}: mean RMSE, time of balanced", panel.title);
    if let Some(error) = panel.depth_alone {
        println!("  {:29} {error:.4}", "rays against the depth buffer");
    }
    for preset in &panel.presets {
        println!(
            "  preset {:21} {:.4} {:6.2}",
            preset.label, preset.error, preset.time
        );
    }
    let mut all: Vec<(&str, &Point)> = panel
        .curves
        .iter()
        .flat_map(|(name, curve)| curve.iter().map(move |p| (name.as_str(), p)))
        .collect();
    all.sort_by(|a, b| a.1.time.total_cmp(&b.1.time));
    println!(" none beats");
    let mut best = f64::INFINITY;
    for (name, point) in all {
        if point.error < best {
            best = point.error;
            println!(
                "  {name:22} {:>5} {:.4} {:6.2}",
                point.label, point.error, point.time
            );
        }
    }
}

/// Scene by scene the method's preset `balanced`, and the least error on each other method's line with its time.
pub fn print_scenes(rows: &[&Row]) {
    println!("RMSE (time of balanced), at best on its line");
    for balanced in rows
        .iter()
        .filter(|r| r.knob == "preset" && r.value == "balanced")
    {
        let mut best: Vec<(String, &Row)> = Vec::new();
        let here = |r: &&&Row| r.scene == balanced.scene && r.ao_radius == balanced.ao_radius;
        for row in rows.iter().filter(here) {
            let Some(line) = row.method_line() else {
                continue;
            };
            match best.iter_mut().find(|(name, _)| *name == line) {
                Some((_, least)) if row.rmse < least.rmse => *least = row,
                Some(_) => {}
                None => best.push((line, row)),
            }
        }
        let mut text = format!(
            "  {:12} {:>6}  balanced {:.4}",
            balanced.scene, balanced.ao_radius, balanced.rmse
        );
        for (line, row) in best {
            let _ = write!(text, ", {line} {:.4} ({:.2})", row.rmse, row.ms_of_balanced);
        }
        if let Some(error) = balanced.depth_alone_rmse {
            let _ = write!(text, ", rays against the depth buffer {error:.4}");
        }
        println!("{text}");
    }
}

/// The rows as comma-separated values; what is an object in JSON is one column of `name=value` here.
pub fn csv(rows: &[Row]) -> Result<String, String> {
    let mut text = String::new();
    for row in rows {
        let Value::Object(fields) = serde_json::to_value(row).map_err(|e| e.to_string())? else {
            return Err("a row is not an object".into());
        };
        if text.is_empty() {
            let names: Vec<_> = fields.keys().map(String::as_str).collect();
            let _ = writeln!(text, "{}", names.join(","));
        }
        let values: Vec<String> = fields
            .iter()
            .map(|(name, value)| match value {
                Value::Null if name == "note" => String::new(),
                Value::Object(inner) => {
                    let pairs: Vec<_> = inner
                        .iter()
                        .map(|(name, value)| format!("{name}={}", plain(value)))
                        .collect();
                    pairs.join(" ")
                }
                // Adapters' names may hold commas.
                Value::String(s) => format!("\"{}\"", s.replace('"', "\"\"")),
                other => plain(other),
            })
            .collect();
        let _ = writeln!(text, "{}", values.join(","));
    }
    Ok(text)
}

/// In JSON, null is infinity.
fn plain(value: &Value) -> String {
    match value {
        Value::Null => "inf".into(),
        Value::String(s) => s.clone(),
        other => other.to_string(),
    }
}

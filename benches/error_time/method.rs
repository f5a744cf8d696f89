//! What a method has to offer to be measured, and the measuring.

use std::{collections::HashMap, fmt::Debug};

use serde_json::Value;

use super::table::Row;
use support::stage::{Effect, Stage, Truth};

/// The knob that each method's line in the comparison of methods turns: all of its settings from cheap to dear together.
pub const QUALITY: &str = "quality";

/// A way from a view to its visibility or indirect light. Another method is one more implementation, and one more line where the
/// methods are measured in `main.rs`.
pub trait Method {
    /// Everything that can be set.
    type Setting: Copy + Debug;
    /// Names the method's rows; its line in the comparison is named after this and the curve.
    const NAME: &'static str;

    /// What to render, curve by curve, each from cheap to dear. The curves whose knob starts with [`QUALITY`] stand for
    /// the method in the comparison.
    fn variants(&self, stage: &Stage<'_>, radius: f32, grid: bool) -> Vec<Variant<Self::Setting>>;

    /// A setting as an object for the table.
    fn describe(setting: &Self::Setting) -> Value;

    /// Renders once.
    fn render(&mut self, stage: &Stage<'_>, setting: &Self::Setting) -> Result<Shot, String>;

    /// The work behind a picture in numbers that do not depend on the machine, an object for the table.
    fn work(&mut self, stage: &Stage<'_>, setting: &Self::Setting) -> Result<Value, String>;
}

/// One place on a curve.
pub struct Variant<S> {
    pub knob: &'static str,
    pub value: String,
    pub setting: S,
}

/// A picture and what it took.
pub struct Shot {
    /// What the effect is measured in: visibility, 1 = open, or luminance over the picture's mean. Rows from the top.
    pub values: Vec<f32>,
    /// A name and milliseconds by `Gpu::stopwatch` per pass.
    pub passes: Vec<(&'static str, f64)>,
    /// What the reader must know of this picture, if anything.
    pub note: Option<&'static str>,
}

impl Shot {
    pub fn total_ms(&self) -> f64 {
        self.passes.iter().map(|p| p.1).sum()
    }
}

/// The measurements of one view within one radius, method after method.
pub struct Measurement<'a, 'g> {
    pub stage: &'a Stage<'g>,
    pub effect: Effect,
    pub radius: f32,
    pub truth: Truth,
    pub grid: bool,
    /// Milliseconds of the first setting of the first method, which all are relative to.
    pub unit_ms: Option<f64>,
    pub rows: &'a mut Vec<Row>,
}

impl Measurement<'_, '_> {
    /// Renders all variants of a method, each that several curves have in common once.
    pub fn of<M: Method>(&mut self, method: &mut M) -> Result<(), String> {
        let mut known: HashMap<String, Row> = HashMap::new();
        for variant in method.variants(self.stage, self.radius, self.grid) {
            let key = format!("{:?}", variant.setting);
            let mut row = if let Some(row) = known.get(&key) {
                row.clone()
            } else {
                // The first run of all compiles the pipelines.
                let runs = self.stage.effort.runs + u32::from(known.is_empty());
                let shot = self.fastest(method, &variant.setting, runs)?;
                let unit_ms = *self.unit_ms.get_or_insert(shot.total_ms());
                let work = method.work(self.stage, &variant.setting)?;
                let settings = M::describe(&variant.setting);
                Row::new(self, M::NAME, settings, work, &shot, unit_ms)
            };
            known.entry(key).or_insert_with(|| row.clone());
            row.knob = variant.knob;
            row.value.clone_from(&variant.value);
            row.print();
            self.rows.push(row);
        }
        Ok(())
    }

    fn fastest<M: Method>(
        &self,
        method: &mut M,
        setting: &M::Setting,
        runs: u32,
    ) -> Result<Shot, String> {
        let mut fastest = method.render(self.stage, setting)?;
        for _ in 1..runs {
            let shot = method.render(self.stage, setting)?;
            if shot.total_ms() < fastest.total_ms() {
                fastest = shot;
            }
        }
        Ok(fastest)
    }
}

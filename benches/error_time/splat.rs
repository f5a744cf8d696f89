//! The crate's shell splatter: `balanced` with one knob turned, and the presets' line carried on to both sides.

use deep_screen_space::{AmbientOcclusion, CloudCapacity, Overlap};
use serde_json::{Value, json};

use super::method::{Method, QUALITY, Shot, Variant};
use support::stage::Stage;
use support::{
    ambient_occlusion::Renderer,
    presets::{self, Preset},
};

/// Room for the finest settings at these sizes; a row says if it was too little.
const CAPACITY: u32 = 1 << 18;

/// The most levels that a variant asks for.
const MAX_LEVELS: u32 = 6;

/// The presets, from cheap to dear.
pub const PRESETS: [&str; 3] = ["fast", "balanced", "accurate"];

/// The renderers of one view.
pub struct Splat {
    add: Renderer,
    independent: Renderer,
    /// Counts pairs, and is slower for it.
    counting: Renderer,
}

/// One setting of everything.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    preset: Preset,
    overlap: Overlap,
}

impl Splat {
    pub fn new(stage: &Stage<'_>) -> Result<Self, String> {
        let triangles = stage.buffers.triangles();
        let capacity = CloudCapacity {
            surfels: CAPACITY,
            pieces: triangles + 100_000,
            triangles,
        };
        let renderer = |overlap, counting| {
            let effect = AmbientOcclusion {
                overlap,
                ..AmbientOcclusion::default()
            };
            let size = stage.effort.size;
            Renderer::new(stage.gpu, effect, capacity, size, MAX_LEVELS, counting)
                .map_err(|e| e.to_string())
        };
        Ok(Self {
            add: renderer(Overlap::Add, false)?,
            independent: renderer(Overlap::Independent, false)?,
            counting: renderer(Overlap::Add, true)?,
        })
    }
}

impl Method for Splat {
    type Setting = Setting;
    const NAME: &'static str = "splat";

    /// `balanced` comes first, since all times are relative to it.
    fn variants(&self, _: &Stage<'_>, radius: f32, grid: bool) -> Vec<Variant<Setting>> {
        let preset = |name| presets::preset(name, radius).expect("a preset of that name");
        let balanced = preset("balanced");
        let mut all = Vec::new();
        let mut push = |knob, value: String, preset, overlap| {
            let setting = Setting { preset, overlap };
            all.push(Variant {
                knob,
                value,
                setting,
            });
        };
        for name in ["balanced", "fast", "accurate"] {
            push("preset", name.into(), preset(name), Overlap::Add);
        }
        for (pixels, epsilon) in [
            (8.0, 0.16),
            (4.0, 0.08),
            (2.0, 0.04),
            (1.5, 0.02),
            (1.0, 0.01),
        ] {
            let mut preset = balanced;
            preset.surfelizer.radius_pixels = pixels;
            preset.splat.epsilon = epsilon;
            push(QUALITY, format!("{pixels} px"), preset, Overlap::Add);
        }
        for epsilon in [0.32, 0.16, 0.08, 0.04, 0.02, 0.01, 0.005, 0.0025] {
            let mut preset = balanced;
            preset.splat.epsilon = epsilon;
            push("epsilon", epsilon.to_string(), preset, Overlap::Add);
        }
        for pixels in [8.0, 4.0, 3.0, 2.0, 1.5, 1.0] {
            let mut preset = balanced;
            preset.surfelizer.radius_pixels = pixels;
            push("pixels", pixels.to_string(), preset, Overlap::Add);
        }
        for levels in 1..=MAX_LEVELS {
            let mut preset = balanced;
            preset.splat.levels = levels;
            push("levels", levels.to_string(), preset, Overlap::Add);
        }
        for density in [1.0, 4.0, 16.0, f32::INFINITY] {
            let mut preset = balanced;
            preset.surfelizer.density = density;
            push("density", density.to_string(), preset, Overlap::Add);
        }
        for (value, overlap) in [("add", Overlap::Add), ("independent", Overlap::Independent)] {
            push("overlap", value.into(), balanced, overlap);
        }
        if grid {
            for pixels in [4.0, 3.0, 2.0, 1.5, 1.0] {
                for epsilon in [0.16, 0.08, 0.04, 0.02, 0.01] {
                    for levels in 3..=MAX_LEVELS {
                        let mut preset = balanced;
                        preset.surfelizer.radius_pixels = pixels;
                        preset.splat.epsilon = epsilon;
                        preset.splat.levels = levels;
                        let value = format!("{pixels}/{epsilon}/{levels}");
                        push("grid", value, preset, Overlap::Add);
                    }
                }
            }
        }
        all
    }

    fn describe(Setting { preset, overlap }: &Setting) -> Value {
        json!({
            "radius_pixels": preset.surfelizer.radius_pixels,
            "density": preset.surfelizer.density,
            "epsilon": preset.splat.epsilon,
            "levels": preset.splat.levels,
            "overlap": format!("{overlap:?}").to_lowercase(),
        })
    }

    fn render(&mut self, stage: &Stage<'_>, setting: &Setting) -> Result<Shot, String> {
        let renderer = match setting.overlap {
            Overlap::Add => &mut self.add,
            Overlap::Independent => &mut self.independent,
        };
        let (meshes, camera) = (stage.buffers.meshes(), &stage.camera);
        let rendered = renderer
            .render(stage.gpu, &stage.drawn, &meshes, camera, &setting.preset)
            .map_err(|e| e.to_string())?;
        Ok(Shot {
            values: rendered.visibility,
            passes: rendered.passes,
            note: (rendered.counts.overflow() > 0).then_some("more surfels than room"),
        })
    }

    fn work(&mut self, stage: &Stage<'_>, setting: &Setting) -> Result<Value, String> {
        let (meshes, camera) = (stage.buffers.meshes(), &stage.camera);
        let rendered = self
            .counting
            .render(stage.gpu, &stage.drawn, &meshes, camera, &setting.preset)
            .map_err(|e| e.to_string())?;
        let counted = self
            .counting
            .view
            .statistics()
            .ok_or("nothing was counted")?;
        let counts: Vec<u32> = stage.gpu.read_buffer(counted);
        // Rows of four per level, the pairs evaluated first.
        let pairs: u32 = counts.iter().step_by(4).sum();
        Ok(json!({
            "surfels": rendered.counts.stored,
            "surfel_overflow": rendered.counts.overflow(),
            "pairs": pairs,
        }))
    }
}

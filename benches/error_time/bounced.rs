//! The crate's bounced z-buffer: `balanced` with one knob turned, and all of them together from cheap to dear.

use deep_screen_space::{CloudCapacity, Payload};
use serde_json::{Value, json};

use super::method::{Method, QUALITY, Shot, Variant};
use support::stage::Stage;
use support::{
    bounced::{BouncedRenderer, RayRoom},
    presets::{self, BouncedPreset},
};

/// Directions, from cheap to dear; the filter follows.
const LADDER: [u32; 7] = [1, 2, 4, 9, 16, 36, 64];

/// The most directions that a variant asks for.
const MAX_RAYS_PER_PIXEL: u32 = 64;

/// The renderers of one view.
pub struct Bounced {
    plain: BouncedRenderer,
    /// Counts tests, and is slower for it.
    counting: BouncedRenderer,
}

impl Bounced {
    pub fn new(stage: &Stage<'_>) -> Result<Self, String> {
        let triangles = stage.buffers.triangles();
        let capacity = CloudCapacity {
            surfels: 0,
            pieces: triangles + 100_000,
            triangles,
        };
        let renderer = |counting| {
            let payload = Payload::Occlusion;
            let size = stage.effort.size;
            BouncedRenderer::new(
                stage.gpu,
                payload,
                capacity,
                size,
                RayRoom {
                    rays_per_pixel: MAX_RAYS_PER_PIXEL,
                    statistics: counting,
                    ..RayRoom::default()
                },
            )
            .map_err(|e| e.to_string())
        };
        Ok(Self {
            plain: renderer(false)?,
            counting: renderer(true)?,
        })
    }
}

impl Method for Bounced {
    type Setting = BouncedPreset;
    const NAME: &'static str = "bounced";

    fn variants(&self, _: &Stage<'_>, radius: f32, _: bool) -> Vec<Variant<BouncedPreset>> {
        let balanced = presets::bounced_preset("balanced", Payload::Occlusion, radius)
            .expect("a preset of that name");
        let mut all = Vec::new();
        let mut push = |knob, value: String, setting| {
            all.push(Variant {
                knob,
                value,
                setting,
            });
        };
        for rays_per_pixel in LADDER {
            let preset = presets::bounced(rays_per_pixel, Payload::Occlusion, radius);
            push(QUALITY, rays_per_pixel.to_string(), preset);
        }
        for rays_per_pixel in [1, 4, 16, 64] {
            let mut preset = balanced;
            preset.bounced.rays_per_pixel = rays_per_pixel;
            push("rays_per_pixel", rays_per_pixel.to_string(), preset);
        }
        for window in [0, 1, 2, 3, 6, 10] {
            let mut preset = balanced;
            preset.reconstructor.radius = window;
            // As the presets' window is to its Gaussian.
            preset.reconstructor.spread = (window as f32 / 1.6).max(0.5);
            push("window", window.to_string(), preset);
        }
        for density in [1.0, 4.0, 16.0, f32::INFINITY] {
            let mut preset = balanced;
            preset.surfelizer.density = density;
            push("density", density.to_string(), preset);
        }
        all
    }

    fn describe(preset: &BouncedPreset) -> Value {
        json!({
            "rays_per_pixel": preset.bounced.rays_per_pixel,
            "window": preset.reconstructor.radius,
            "variance_clamp": preset.reconstructor.variance_clamp,
            "radius_pixels": preset.surfelizer.radius_pixels,
            "density": preset.surfelizer.density,
        })
    }

    fn render(&mut self, stage: &Stage<'_>, preset: &BouncedPreset) -> Result<Shot, String> {
        let picture = self
            .plain
            .render(
                stage.gpu,
                &stage.drawn,
                &stage.buffers,
                &stage.camera,
                &[],
                preset,
            )
            .map_err(|e| e.to_string())?;
        Ok(Shot {
            values: picture.visibility(),
            passes: picture.passes,
            note: None,
        })
    }

    fn work(&mut self, stage: &Stage<'_>, preset: &BouncedPreset) -> Result<Value, String> {
        self.counting
            .render(
                stage.gpu,
                &stage.drawn,
                &stage.buffers,
                &stage.camera,
                &[],
                preset,
            )
            .map_err(|e| e.to_string())?;
        let counts: Vec<u32> = stage.gpu.read_buffer(
            self.counting
                .gatherer
                .view
                .statistics()
                .ok_or("the counting renderer counts")?,
        );
        Ok(json!({
            "rays": counts[0],
            "nodes": counts[1],
            "leaves": counts[2],
            "hits": counts[3],
        }))
    }
}

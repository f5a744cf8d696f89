//! One bounce of diffuse light: by the bounced z-buffer, by splatting, and by what the depth buffer alone allows.

use deep_screen_space::{
    CloudCapacity, DiffuseBounce, Payload, RaySettings, SurfelCounts, glam::DVec3,
    wgpu::TextureView,
};
use serde_json::{Value, json};

use super::method::{Method, QUALITY, Shot, Variant};
use support::depth_only::{DepthOnly, Frame, IndirectSettings};
use support::stage::{Stage, luminance};
use support::{
    ambient_occlusion::Renderer,
    bounced::{BouncedRenderer, RayRoom},
    presets::{self, BouncedPreset, Preset},
};

/// Directions, from cheap to dear; the filter follows.
const LADDER: [u32; 7] = [1, 2, 4, 8, 16, 36, 64];

/// Half of the rays, of those that go where noise is.
const HALVES: [u32; 5] = [2, 4, 8, 18, 32];

/// Directions, steps along each and half width of the filter, from cheap to dear.
const MARCHES: [[u32; 3]; 7] = [
    [1, 8, 6],
    [2, 8, 6],
    [4, 8, 5],
    [4, 16, 5],
    [8, 32, 4],
    [16, 64, 3],
    [32, 96, 2],
];

/// How deep surfaces are, in the scene's radius for occlusion.
const THICKNESS: f32 = 0.5;

fn values(pixels: impl Iterator<Item = [f32; 3]>, level: f64) -> Vec<f32> {
    pixels
        .map(|c| (luminance(DVec3::from(c.map(f64::from))) / level) as f32)
        .collect()
}

/// The bounced z-buffer, its hits lit where they are.
pub struct BouncedLight {
    renderer: BouncedRenderer,
    level: f64,
}

impl BouncedLight {
    /// `level` is what values are in units of.
    pub fn new(stage: &Stage<'_>, level: f64) -> Result<Self, String> {
        Self::aiming(stage, level, 0)
    }

    /// With so many rays per pixel towards what shines.
    fn aiming(stage: &Stage<'_>, level: f64, emitter_samples: u32) -> Result<Self, String> {
        let triangles = stage.buffers.triangles();
        let capacity = CloudCapacity {
            surfels: 0,
            pieces: triangles + 100_000,
            triangles,
        };
        let size = stage.effort.size;
        let most = LADDER[LADDER.len() - 1];
        let room = RayRoom {
            rays_per_pixel: most,
            // Only such pixels need counts as have further rays, which none of those has that aims.
            counted: emitter_samples == 0,
            emitter_samples,
            ..RayRoom::default()
        };
        let renderer = BouncedRenderer::new(stage.gpu, Payload::LitRadiance, capacity, size, room)
            .map_err(|e| e.to_string())?;
        Ok(Self { renderer, level })
    }
}

impl Method for BouncedLight {
    type Setting = BouncedPreset;
    const NAME: &'static str = "bounced";

    /// `balanced` comes first, since all times are relative to it.
    fn variants(&self, _: &Stage<'_>, _: f32, _: bool) -> Vec<Variant<BouncedPreset>> {
        let preset = |name| {
            presets::bounced_preset(name, Payload::LitRadiance, f32::INFINITY)
                .expect("a preset of that name")
        };
        let mut all: Vec<_> = ["balanced", "fast", "accurate"]
            .into_iter()
            .map(|name| Variant {
                knob: "preset",
                value: name.into(),
                setting: preset(name),
            })
            .collect();
        all.extend(LADDER.map(|rays_per_pixel| Variant {
            knob: QUALITY,
            value: rays_per_pixel.to_string(),
            setting: presets::bounced(rays_per_pixel, Payload::LitRadiance, f32::INFINITY),
        }));
        // As many rays everywhere as further ones, which go where noise is.
        all.extend(HALVES.map(|half| Variant {
            knob: "further",
            value: format!("{half} + {half}"),
            setting: presets::of(
                &RaySettings::with_further(half, half as f32, Payload::LitRadiance),
                f32::INFINITY,
            ),
        }));
        all
    }

    fn describe(preset: &BouncedPreset) -> Value {
        json!({
            "rays_per_pixel": preset.bounced.rays_per_pixel,
            "further_rays": preset.further.map_or(0.0, |further| further.rays_per_pixel),
            "window": preset.reconstructor.radius,
            "variance_clamp": preset.reconstructor.variance_clamp,
        })
    }

    fn render(&mut self, stage: &Stage<'_>, preset: &BouncedPreset) -> Result<Shot, String> {
        let picture = self
            .renderer
            .render(
                stage.gpu,
                &stage.drawn,
                &stage.buffers,
                &stage.camera,
                &stage.lights,
                preset,
            )
            .map_err(|e| e.to_string())?;
        Ok(Shot {
            values: values(picture.radiance().into_iter(), self.level),
            passes: picture.passes,
            note: None,
        })
    }

    fn work(&mut self, stage: &Stage<'_>, preset: &BouncedPreset) -> Result<Value, String> {
        let pixels: u32 = stage.effort.size.iter().product();
        let further = preset.further.map_or(0.0, |further| further.rays_per_pixel);
        let rays = preset.bounced.rays_per_pixel + further.ceil() as u32;
        Ok(json!({ "most_rays": pixels * rays * 2 }))
    }
}

/// The same where something shines of itself, a part of its rays aimed there. The traced truth's rays are not, so that its own
/// noise is what is left of the error of many aimed rays.
pub struct AimedLight {
    /// For as many aimed rays as were asked for last.
    made: Option<(u32, BouncedLight)>,
    level: f64,
}

impl AimedLight {
    /// `level` is what values are in units of.
    pub fn new(level: f64) -> Self {
        Self { made: None, level }
    }
}

impl Method for AimedLight {
    type Setting = BouncedPreset;
    const NAME: &'static str = BouncedLight::NAME;

    /// As many rays in all as [`BouncedLight`] has, from two on. They are a knob, as not every scene has such rows, and lines are
    /// means over scenes.
    fn variants(&self, _: &Stage<'_>, _: f32, _: bool) -> Vec<Variant<BouncedPreset>> {
        let aimed = |all| RaySettings::new(all, Payload::LitRadiance).for_emitters();
        let aimed = LADDER.map(aimed).into_iter();
        let aimed = aimed.filter(|rays| rays.emitter_samples > 0);
        let variant = |rays: RaySettings| Variant {
            knob: "at lamps",
            value: format!("{} + {}", rays.rays_per_pixel, rays.emitter_samples),
            setting: presets::of(&rays, f32::INFINITY),
        };
        aimed.map(variant).collect()
    }

    fn describe(preset: &BouncedPreset) -> Value {
        let mut settings = BouncedLight::describe(preset);
        settings["emitter_samples"] = json!(preset.emitter_samples);
        settings
    }

    fn render(&mut self, stage: &Stage<'_>, preset: &BouncedPreset) -> Result<Shot, String> {
        let made = match self.made.take() {
            Some((samples, made)) if samples == preset.emitter_samples => made,
            _ => {
                let mut made = BouncedLight::aiming(stage, self.level, preset.emitter_samples)?;
                // Compiles the pipelines.
                made.render(stage, preset)?;
                made
            }
        };
        let (_, made) = self.made.insert((preset.emitter_samples, made));
        made.render(stage, preset)
    }

    fn work(&mut self, stage: &Stage<'_>, preset: &BouncedPreset) -> Result<Value, String> {
        let pixels: u32 = stage.effort.size.iter().product();
        let rays = preset.bounced.rays_per_pixel + preset.emitter_samples;
        Ok(json!({ "most_rays": pixels * rays * 2 }))
    }
}

/// Sums over lit surfels, which do not know what hides what.
pub struct SplatLight {
    renderer: Renderer,
    level: f64,
}

/// Surfels' radii and thresholds, as the presets have them, carried on to both sides.
const SURFELS: [[f32; 2]; 5] = [
    [8.0, 0.16],
    [4.0, 0.08],
    [2.0, 0.04],
    [1.5, 0.02],
    [1.0, 0.01],
];

impl SplatLight {
    /// `level` is what values are in units of.
    pub fn new(stage: &Stage<'_>, level: f64) -> Result<Self, String> {
        let triangles = stage.buffers.triangles();
        let capacity = CloudCapacity {
            surfels: 1 << 18,
            pieces: triangles + 100_000,
            triangles,
        };
        let levels = Self::preset("balanced").splat.levels;
        let effect = DiffuseBounce::default().effect();
        let size = stage.effort.size;
        let renderer = effect
            .and_then(|effect| Renderer::of(stage.gpu, &effect, capacity, size, levels, false))
            .map_err(|e| e.to_string())?;
        Ok(Self { renderer, level })
    }

    fn preset(name: &str) -> Preset {
        presets::preset(name, f32::INFINITY).expect("a preset of that name")
    }
}

impl Method for SplatLight {
    type Setting = Preset;
    const NAME: &'static str = "splat";

    fn variants(&self, _: &Stage<'_>, _: f32, _: bool) -> Vec<Variant<Preset>> {
        SURFELS
            .map(|[pixels, epsilon]| {
                let mut setting = Self::preset("balanced");
                setting.surfelizer.radius_pixels = pixels;
                setting.splat.epsilon = epsilon;
                Variant {
                    knob: QUALITY,
                    value: format!("{pixels} px"),
                    setting,
                }
            })
            .into()
    }

    fn describe(preset: &Preset) -> Value {
        json!({
            "radius_pixels": preset.surfelizer.radius_pixels,
            "epsilon": preset.splat.epsilon,
            "levels": preset.splat.levels,
        })
    }

    fn render(&mut self, stage: &Stage<'_>, preset: &Preset) -> Result<Shot, String> {
        let (scene, camera, lights) = (&stage.buffers, &stage.camera, &stage.lights);
        let rendered = self
            .renderer
            .render_scene(stage.gpu, &stage.drawn, scene, camera, lights, preset)
            .map_err(|e| e.to_string())?;
        let light = rendered.pictures[0].iter().map(|&[r, g, b, _]| [r, g, b]);
        Ok(Shot {
            values: values(light, self.level),
            passes: rendered.passes,
            note: (rendered.counts.overflow() > 0).then_some("more surfels than room"),
        })
    }

    fn work(&mut self, stage: &Stage<'_>, _: &Preset) -> Result<Value, String> {
        let counts: Vec<SurfelCounts> = stage.gpu.read_buffer(self.renderer.cloud.counters());
        Ok(json!({ "surfels": counts[0].stored }))
    }
}

/// Rays marched through the depth buffer, of a lit picture that is given exactly.
pub struct Marched {
    passes: DepthOnly,
    target: TextureView,
    lit: TextureView,
    level: f64,
}

impl Marched {
    /// `level` is what values are in units of.
    pub fn new(stage: &Stage<'_>, level: f64) -> Self {
        let device = &stage.gpu.device;
        let [width, height] = stage.effort.size;
        let passes = DepthOnly::new(device, stage.effort.size);
        Self {
            target: passes.create_target(device, DepthOnly::COLOR),
            lit: stage
                .gpu
                .texture(DepthOnly::COLOR, width, height, &stage.direct_light()),
            passes,
            level,
        }
    }
}

impl Method for Marched {
    type Setting = IndirectSettings;
    const NAME: &'static str = "depth-only";

    fn variants(&self, stage: &Stage<'_>, _: f32, _: bool) -> Vec<Variant<IndirectSettings>> {
        MARCHES
            .map(|[directions, steps, filter_radius]| Variant {
                knob: QUALITY,
                value: format!("{directions}x{steps}"),
                setting: IndirectSettings {
                    radius: f32::INFINITY,
                    directions,
                    steps,
                    thickness: THICKNESS * stage.scene.ao_radius,
                    filter_radius,
                },
            })
            .into()
    }

    fn describe(setting: &IndirectSettings) -> Value {
        json!({
            "directions": setting.directions,
            "steps": setting.steps,
            "thickness": setting.thickness,
            "filter_radius": setting.filter_radius,
        })
    }

    fn render(&mut self, stage: &Stage<'_>, setting: &IndirectSettings) -> Result<Shot, String> {
        let frame = Frame {
            camera: &stage.camera,
            depth: &stage.drawn.depth,
            normal: &stage.drawn.normal,
        };
        let (ms, ()) = stage.gpu.time(|encoder| {
            let device = &stage.gpu.device;
            let given = [&self.lit, &stage.drawn.albedo];
            self.passes
                .record_indirect(device, encoder, &frame, given, setting, &self.target);
        });
        let texels: Vec<[f32; 4]> = stage.gpu.read_texture(self.target.texture(), 0);
        Ok(Shot {
            values: values(texels.into_iter().map(|[r, g, b, _]| [r, g, b]), self.level),
            passes: vec![("depth-only", ms)],
            note: None,
        })
    }

    fn work(&mut self, stage: &Stage<'_>, setting: &IndirectSettings) -> Result<Value, String> {
        let pixels: u32 = stage.effort.size.iter().product();
        Ok(json!({ "most_taps": pixels * setting.directions * setting.steps }))
    }
}

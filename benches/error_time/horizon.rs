//! What the depth buffer alone gives at the price of its taps: GTAO, and the same with a thickness.

use deep_screen_space::wgpu::TextureView;
use serde_json::{Value, json};

use super::method::{Method, Shot, Variant};
use support::depth_only::{AmbientOcclusionSettings, DepthOnly, Frame};
use support::stage::Stage;

/// Slices, taps on each side of each, and half width of the filter: from cheap to dear, each the best of its price.
const LADDER: [[u32; 3]; 9] = [
    [1, 2, 3],
    [1, 4, 3],
    [1, 8, 3],
    [2, 8, 3],
    [2, 16, 3],
    [4, 16, 3],
    [4, 32, 2],
    [8, 32, 1],
    [16, 64, 1],
];

/// How deep surfaces are, in radii, and in the scene's radius where there is none. Of 1/16 to 4 what errs least in the
/// mean over the crate's scenes; no one thickness suits all of them.
const THICKNESS: f32 = 0.5;
const THICKNESS_UNBOUNDED: f32 = 2.0;

/// The pipelines and the picture of one view.
pub struct Horizon {
    passes: DepthOnly,
    target: TextureView,
}

impl Horizon {
    pub fn new(stage: &Stage<'_>) -> Self {
        let device = &stage.gpu.device;
        let passes = DepthOnly::new(device, stage.effort.size);
        Self {
            target: passes.create_target(device, DepthOnly::GRAY),
            passes,
        }
    }
}

impl Method for Horizon {
    type Setting = AmbientOcclusionSettings;
    const NAME: &'static str = "depth-only";

    fn variants(
        &self,
        stage: &Stage<'_>,
        radius: f32,
        _: bool,
    ) -> Vec<Variant<AmbientOcclusionSettings>> {
        let thickness = if radius.is_finite() {
            THICKNESS * radius
        } else {
            THICKNESS_UNBOUNDED * stage.scene.ao_radius
        };
        [
            ("quality", f32::INFINITY),
            ("quality, thickness", thickness),
        ]
        .into_iter()
        .flat_map(|(knob, thickness)| {
            LADDER.map(|[slices, taps, filter_radius]| Variant {
                knob,
                value: format!("{slices}x{taps}"),
                setting: AmbientOcclusionSettings {
                    radius,
                    slices,
                    taps,
                    thickness,
                    filter_radius,
                },
            })
        })
        .collect()
    }

    fn describe(setting: &AmbientOcclusionSettings) -> Value {
        json!({
            "slices": setting.slices,
            "taps": setting.taps,
            "thickness": setting.thickness,
            "filter_radius": setting.filter_radius,
        })
    }

    fn render(
        &mut self,
        stage: &Stage<'_>,
        setting: &AmbientOcclusionSettings,
    ) -> Result<Shot, String> {
        let frame = Frame {
            camera: &stage.camera,
            depth: &stage.drawn.depth,
            normal: &stage.drawn.normal,
        };
        let (ms, ()) = stage.gpu.time(|encoder| {
            let device = &stage.gpu.device;
            self.passes
                .record_ambient_occlusion(device, encoder, &frame, setting, &self.target);
        });
        Ok(Shot {
            values: stage.gpu.read_texture(self.target.texture(), 0),
            passes: vec![("depth-only", ms)],
            note: None,
        })
    }

    fn work(
        &mut self,
        stage: &Stage<'_>,
        setting: &AmbientOcclusionSettings,
    ) -> Result<Value, String> {
        let pixels: u32 = stage.effort.size.iter().product();
        Ok(json!({ "most_taps": pixels * setting.slices * setting.taps * 2 }))
    }
}

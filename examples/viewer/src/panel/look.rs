//! What an effect and a method have to set.

use deep_screen_space::{
    BounceSettings, BouncedSettings, Bounces, Combine, Components, ObscuranceVolume, Overlap,
    Placement, RayBudgetSettings, Scattering, SecondRadius, TemporalSettings,
};
use egui::{ComboBox, Slider, SliderClamping, Ui};
use support::sky;

use super::controls::{color, fields, label, number, option, section};
use crate::{
    fields::Settings,
    look::{Effect, Look, Method},
    passes::SAMPLINGS,
};

/// What an effect and a method have.
pub(super) fn settings(ui: &mut Ui, look: &mut Look) {
    effect_settings(ui, look);
    match look.method {
        Method::Rays => ray_settings(ui, look),
        Method::Splats => {
            let surfels = &mut look.surfels;
            ui.label("room for surfels");
            ui.add(
                Slider::new(surfels, 1 << 14..=1 << 22)
                    .logarithmic(true)
                    .clamping(SliderClamping::Always),
            );
            ui.horizontal(|ui| {
                ui.label("placement");
                let placement = &mut look.splats.surfelizer.placement;
                for of in [Placement::Centroid, Placement::Random, Placement::Grid] {
                    ui.selectable_value(placement, of, format!("{of:?}"));
                }
            });
            section(ui, "Surfels", &mut look.splats.surfelizer);
            section(ui, "Splats", &mut look.splats.splat);
            section(ui, "Reconstruction", &mut look.splats.reconstructor);
        }
        Method::Depths => match look.effect {
            Effect::SoftShadows => fields(ui, &mut look.shadows),
            Effect::IndirectDiffuse => fields(ui, &mut look.screen),
            _ => {
                obscurance_settings(ui, look);
                fields(ui, &mut look.obscurance);
                second_radius(ui, &mut look.obscurance.second);
            }
        },
        Method::Hull => {
            ui.horizontal(|ui| {
                ui.label("quad, texels");
                for quad in [4, 8, 16, 32] {
                    ui.selectable_value(&mut look.hull.quad, quad, quad.to_string());
                }
            });
            ui.horizontal(|ui| {
                ui.label("components");
                for of in [Components::UnionFind, Components::Propagation] {
                    ui.selectable_value(&mut look.components, of, format!("{of:?}"));
                }
            });
            fields(ui, &mut look.hull_size);
            fields(ui, &mut look.hull);
        }
    }
}

/// A number from 0 to infinity that is the effect's.
fn distance(ui: &mut Ui, name: &str, help: &str, value: &mut f32) {
    let slider = crate::fields::endless(0.01, 100.0);
    label(ui, name, "world units", Some("0 to infinity"), help);
    number(ui, slider, value);
}

fn effect_settings(ui: &mut Ui, look: &mut Look) {
    let (rays, splats) = (look.method == Method::Rays, look.method == Method::Splats);
    let occludes = matches!(
        look.effect,
        Effect::AmbientOcclusion | Effect::BentNormals | Effect::DirectionalOcclusion
    );
    if occludes && (rays || splats) {
        let help = "The distance beyond which nothing occludes.";
        distance(ui, "radius", help, &mut look.radius);
    }
    if look.effect == Effect::DirectionalOcclusion {
        ui.horizontal(|ui| {
            ui.label("sky");
            for (i, name) in sky::NAMES.iter().enumerate() {
                ui.selectable_value(&mut look.sky, i, *name);
            }
        });
    }
    if look.is_lit() && rays {
        label(
            ui,
            "sky_radiance",
            "W/(m² sr)",
            Some("0 to 1e18"),
            "What arrives from where nothing is.",
        );
        color(ui, [0.0, 1e18], &mut look.sky_radiance);
    }
    if look.effect == Effect::IndirectSpecular {
        label(
            ui,
            "roughness",
            "perceptual",
            Some("0 to 1"),
            "Of all surfaces.",
        );
        ui.add(Slider::new(&mut look.roughness, 0.0..=1.0));
        label(ui, "f0", "reflectance", Some("0 to 1"), "Seen straight on.");
        color(ui, [0.0, 1.0], &mut look.f0);
        look.rays.filter.f0 = look.f0;
    }
    if look.effect == Effect::SubsurfaceScattering {
        ComboBox::from_label("material")
            .selected_text(Scattering::NAMED[look.material].0)
            .show_ui(ui, |ui| {
                for (i, (name, _)) in Scattering::NAMED.iter().enumerate() {
                    ui.selectable_value(&mut look.material, i, *name);
                }
            });
        label(
            ui,
            "millimetres",
            "mm in a world unit",
            None,
            "How large the body is; the scene's first material is the body's.",
        );
        ui.add(Slider::new(&mut look.millimetres, 1.0..=10_000.0).logarithmic(true));
    }
    if splats && occludes {
        ui.horizontal(|ui| {
            ui.label("overlap");
            ui.selectable_value(&mut look.overlap, Overlap::Add, "Add");
            ui.selectable_value(&mut look.overlap, Overlap::Independent, "Independent");
        });
    }
    if splats && look.effect != Effect::SubsurfaceScattering {
        ui.checkbox(&mut look.two_sided, "two_sided")
            .on_hover_text("Whether surfaces count behind their backs: for single sheets.");
    }
    if splats && !occludes {
        label(
            ui,
            "unit",
            "W/m²",
            Some("above 0 to 1e18"),
            "What epsilon is a share of: about what bright surfaces send.",
        );
        ui.add(Slider::new(&mut look.unit, 0.01..=100.0).logarithmic(true));
    }
}

fn ray_settings(ui: &mut Ui, look: &mut Look) {
    let mut bounced = BouncedSettings {
        rays_per_pixel: look.rays.rays_per_pixel,
        ..BouncedSettings::default()
    };
    fields(ui, &mut bounced);
    look.rays.rays_per_pixel = bounced.rays_per_pixel;
    if look.is_lit() && look.emits {
        let mut aims = look.rays.emitter_samples > 0;
        let help = "Some of the rays go to surfaces that shine of themselves, which few others meet where lamps are small.";
        if ui
            .checkbox(&mut aims, "rays at lamps")
            .on_hover_text(help)
            .changed()
        {
            look.aim(aims);
        }
        if aims {
            ui.indent("rays at lamps", |ui| fields(ui, &mut look.rays));
        }
    }
    if look.effect != Effect::IndirectSpecular {
        option(
            ui,
            "further rays where noise is",
            &mut look.rays.further,
            RayBudgetSettings::default(),
        );
    }
    if look.effect != Effect::BentNormals {
        let fallback = TemporalSettings::default();
        option(ui, "frames are joined", &mut look.temporal, fallback);
    }
    if look.is_lit() {
        let in_frame = look.suited(BounceSettings::in_frame(2));
        let by_frames = look.suited(BounceSettings::over_frames());
        option(ui, "further bounces", &mut look.bounces, in_frame);
        if let Some(settings) = &mut look.bounces {
            let mut over_frames = settings.bounces == Bounces::OverFrames;
            if ui.checkbox(&mut over_frames, "over frames").changed() {
                *settings = if over_frames { by_frames } else { in_frame };
            }
            if let Bounces::InFrame(bounces) = &mut settings.bounces {
                ui.add(Slider::new(bounces, 2..=16).text("bounces, 2 to 16"));
            }
        }
    }
    section(ui, "Filter", &mut look.rays.filter);
}

fn second_radius(ui: &mut Ui, second: &mut Option<SecondRadius>) {
    option(ui, "a second radius", second, SecondRadius::rest());
    if let Some(second) = second {
        ui.horizontal(|ui| {
            ui.label("combine");
            for of in [Combine::Product, Combine::Minimum] {
                ui.selectable_value(&mut second.combine, of, format!("{of:?}"));
            }
        });
    }
}

fn obscurance_settings(ui: &mut Ui, look: &mut Look) {
    ComboBox::from_label("sampling")
        .selected_text(format!("{:?}", look.sampling))
        .show_ui(ui, |ui| {
            for sampling in SAMPLINGS {
                ui.selectable_value(&mut look.sampling, sampling, format!("{sampling:?}"));
            }
        });
    ComboBox::from_label("volume")
        .selected_text(format!("{:?}", look.volume))
        .show_ui(ui, |ui| {
            for volume in [
                ObscuranceVolume::Sphere,
                ObscuranceVolume::Hemisphere,
                ObscuranceVolume::TangentSphere,
            ] {
                ui.selectable_value(&mut look.volume, volume, format!("{volume:?}"));
            }
        });
}

//! Controls of settings, as their tables have them.

use egui::{Button, CollapsingHeader, DragValue, RichText, Slider, SliderClamping, Ui};

use crate::fields::{Field, Kind, Settings, accepted};

/// Settings that may be there or not.
pub(super) fn option<S: Settings>(ui: &mut Ui, name: &str, settings: &mut Option<S>, fallback: S) {
    let mut on = settings.is_some();
    if ui.checkbox(&mut on, name).changed() {
        *settings = on.then_some(fallback);
    }
    if let Some(settings) = settings {
        ui.indent(name, |ui| fields(ui, settings));
    }
}

/// Settings under a heading.
pub(super) fn section<S: Settings>(ui: &mut Ui, name: &str, settings: &mut S) {
    CollapsingHeader::new(name)
        .id_salt(S::TYPE)
        .show(ui, |ui| fields(ui, settings));
}

/// Each field of a struct, with its unit and what the crate accepts.
pub(super) fn fields<S: Settings>(ui: &mut Ui, settings: &mut S) {
    for field in S::FIELDS {
        let Field {
            name, unit, help, ..
        } = field;
        let before = *settings;
        match &field.kind {
            Kind::Flag(of) => {
                ui.checkbox(of(settings), *name).on_hover_text(*help);
            }
            Kind::Number(slider, of) => {
                label(ui, name, unit, accepted(field), help);
                number(ui, *slider, of(settings));
            }
            Kind::Count(slider, of) => {
                label(ui, name, unit, accepted(field), help);
                ui.add(
                    Slider::new(of(settings), slider.from..=slider.to)
                        .logarithmic(slider.logarithmic)
                        .clamping(SliderClamping::Never),
                );
            }
            Kind::Color(slider, of) => {
                label(ui, name, unit, accepted(field), help);
                color(ui, [slider.from, slider.to], of(settings));
            }
        }
        if *settings != before && settings.check().is_err() {
            // The side says what is accepted, and shows what it showed.
            ui.colored_label(ui.visuals().error_fg_color, "not accepted");
        }
    }
}

/// A setting's name, unit and range, in a line above its control.
pub(super) fn label(ui: &mut Ui, name: &str, unit: &str, accepted: Option<&str>, help: &str) {
    let parts = [unit, accepted.unwrap_or("")];
    let parts: Vec<&str> = parts.into_iter().filter(|part| !part.is_empty()).collect();
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 6.0;
        ui.label(name).on_hover_text(help);
        ui.label(RichText::new(parts.join(" · ")).weak().small())
            .on_hover_text(help);
    });
}

pub(super) fn number(ui: &mut Ui, slider: crate::fields::Slider<f32>, value: &mut f32) {
    ui.horizontal(|ui| {
        if slider.endless {
            let mut endless = *value == f32::INFINITY;
            if ui.add(Button::selectable(endless, "∞")).clicked() {
                endless = !endless;
                *value = if endless { f32::INFINITY } else { slider.to };
            }
            if endless {
                return;
            }
        }
        ui.add(
            Slider::new(value, slider.from..=slider.to)
                .logarithmic(slider.logarithmic)
                .clamping(SliderClamping::Never),
        );
    });
}

pub(super) fn color(ui: &mut Ui, [from, to]: [f32; 2], value: &mut [f32; 3]) {
    ui.horizontal(|ui| {
        for (channel, name) in value.iter_mut().zip(["r ", "g ", "b "]) {
            ui.add(
                DragValue::new(channel)
                    .range(from..=to)
                    .speed(0.01)
                    .prefix(name),
            );
        }
    });
}

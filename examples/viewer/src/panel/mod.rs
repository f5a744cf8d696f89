//! The panel beside the picture: every control, and what there is to know.

mod controls;
mod look;

use deep_screen_space::{Quality, SurfelCounts};
use egui::{
    Align, CollapsingHeader, ComboBox, ProgressBar, RichText, ScrollArea, Slider, SliderClamping,
    Ui,
};

use support::lights::is_emissive;

use self::look::settings;
use crate::{
    clock::Row,
    code,
    display::Shown,
    flight::Flight,
    look::{Effect, Look, Method},
    place::{NAMES, Place},
    planning::{Planning, Wish},
    truth::Off,
};

/// What the moving object does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Motion {
    /// There is none.
    #[default]
    Away,
    Moving,
    Resting,
}

/// What a button asks for that is not a setting.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    Load(String),
    /// To fly to one of the place's views.
    View(usize),
    Still,
    Calibrate,
    /// To change the first side's settings to those that meet the wish.
    Plan,
}

/// All that one can set.
pub struct Panel {
    pub looks: [Look; 2],
    pub qualities: [Quality; 2],
    /// Whether there are two sides.
    pub compare: bool,
    pub split: f32,
    pub shown: Shown,
    pub gain: f32,
    pub exposure: f32,
    /// Pixels of the picture in one of the window, along a side.
    pub scale: f32,
    pub moves: Motion,
    pub truth_rays: u32,
    pub wish: Wish,
    /// The value that the wish last had, of an error and of a time.
    pub wishes: [f64; 2],
    pub file: String,
    /// By how far the panel is to be scrolled, points.
    pub scroll: f32,
}

/// What there is to know.
pub struct Facts<'a> {
    pub device: &'a str,
    pub place: Option<&'a Place>,
    pub loading: Option<&'a str>,
    pub size: [u32; 2],
    pub rows: &'a [Row],
    /// What is owned, bytes.
    pub memory: &'a [(&'static str, u64)],
    /// Of each side.
    pub problems: &'a [Option<String>; 2],
    pub message: Option<&'a str>,
    pub counts: Option<SurfelCounts>,
    pub truth: TruthFacts,
    pub planning: &'a Planning,
}

/// What is known of the truth.
#[derive(Clone, Debug, Default)]
pub struct TruthFacts {
    pub rays: u32,
    pub progress: Option<f32>,
    pub off: [Option<Off>; 2],
    pub problem: Option<String>,
}

impl Panel {
    /// For a device that is fast, or for software.
    pub fn new(is_software: bool, name: &str) -> Self {
        let quality = if is_software {
            Quality::Fast
        } else {
            Quality::Balanced
        };
        let look = Look::new(2.0, 1.0, quality);
        let mut other = look;
        other.method = Method::Splats;
        Self {
            looks: [look, other],
            qualities: [quality; 2],
            compare: false,
            split: 0.5,
            shown: Shown::Picture,
            gain: 4.0,
            exposure: 1.0,
            scale: if is_software { 0.5 } else { 1.0 },
            moves: Motion::Away,
            truth_rays: 256,
            wish: Wish::Free,
            wishes: [0.03, 50.0],
            file: name.into(),
            scroll: 0.0,
        }
    }

    /// What suits another place, of the same effects and methods.
    pub fn arrive(&mut self, place: &Place) {
        for (look, quality) in self.looks.iter_mut().zip(self.qualities) {
            let radius = place.radius();
            let mut suited = Look::new(radius, radius, quality);
            suited.emits = is_emissive(&place.scene);
            suited.choose(look.effect, quality);
            suited.method = look.method;
            *look = suited;
        }
        self.file.clone_from(&place.name);
    }

    /// Those sides that are seen.
    pub fn sides(&self) -> usize {
        1 + usize::from(self.compare)
    }

    /// Shows all of it.
    pub fn show(&mut self, ui: &mut Ui, facts: &Facts<'_>, flight: &mut Flight) -> Vec<Action> {
        let mut actions = Vec::new();
        ui.spacing_mut().slider_width = 110.0;
        ScrollArea::vertical()
            .auto_shrink([false; 2])
            .show(ui, |ui| {
                if self.scroll != 0.0 {
                    ui.scroll_with_delta(egui::vec2(0.0, -self.scroll));
                    self.scroll = 0.0;
                }
                self.place(ui, facts, flight, &mut actions);
                for side in 0..self.sides() {
                    self.side(ui, side, facts);
                }
                ui.checkbox(&mut self.compare, "Side by side with another");
                if self.compare {
                    ui.add(Slider::new(&mut self.split, 0.0..=1.0).text("split"));
                }
                self.truth(ui, facts);
                self.plan(ui, facts, &mut actions);
                costs(ui, facts);
                self.picture(ui, &mut actions);
                let text = code::of(&self.looks[0]);
                CollapsingHeader::new("Settings as Rust").show(ui, |ui| {
                    if ui.button("Copy").clicked() {
                        ui.copy_text(text.clone());
                    }
                    ui.label(RichText::new(&text).monospace().small());
                });
            });
        actions
    }

    fn place(
        &mut self,
        ui: &mut Ui,
        facts: &Facts<'_>,
        flight: &mut Flight,
        actions: &mut Vec<Action>,
    ) {
        ui.label(RichText::new(facts.device).weak().small());
        if let Some(message) = facts.message {
            ui.colored_label(ui.visuals().error_fg_color, message);
        }
        CollapsingHeader::new("Scene").default_open(true).show(ui, |ui| {
            ui.horizontal(|ui| {
                ComboBox::from_id_salt("scene")
                    .selected_text("of the crate")
                    .width(100.0)
                    .show_ui(ui, |ui| {
                        for name in NAMES {
                            if ui.selectable_label(self.file == name, name).clicked() {
                                actions.push(Action::Load(name.into()));
                            }
                        }
                    });
                if let Some(place) = facts.place {
                    ComboBox::from_id_salt("view")
                        .selected_text("view")
                        .width(70.0)
                        .show_ui(ui, |ui| {
                            for (i, (name, _)) in place.views.iter().enumerate() {
                                if ui.selectable_label(false, name).clicked() {
                                    actions.push(Action::View(i));
                                }
                            }
                        });
                }
            });
            ui.horizontal(|ui| {
                ui.add(egui::TextEdit::singleline(&mut self.file).desired_width(170.0))
                    .on_hover_text("A glTF 2.0 file, or the name of a scene. Files may be dropped on the window.");
                if ui.button("Load").clicked() {
                    actions.push(Action::Load(self.file.trim().into()));
                }
            });
            if let Some(name) = facts.loading {
                ui.horizontal(|ui| {
                    ui.spinner();
                    ui.label(format!("loading {name}"));
                });
            }
            if let Some(place) = facts.place {
                let triangles = place.buffers.triangles();
                ui.label(format!("{}: {triangles} triangles", place.name));
                for note in &place.notes {
                    ui.label(RichText::new(note).weak().small());
                }
            }
            ui.horizontal(|ui| {
                ui.label("A box");
                for (moves, name) in [
                    (Motion::Away, "away"),
                    (Motion::Moving, "moves"),
                    (Motion::Resting, "rests"),
                ] {
                    ui.selectable_value(&mut self.moves, moves, name);
                }
            });
            ui.add(
                Slider::new(&mut flight.speed, 1e-3..=1e3)
                    .logarithmic(true)
                    .clamping(SliderClamping::Edits)
                    .text("speed, units/s"),
            );
            let lens = &mut flight.pose.vertical_fov_degrees;
            ui.add(Slider::new(lens, 5.0..=120.0).text("view, degrees"));
            ui.label(RichText::new("WASD, E, Q: fly. Drag: turn. Wheel: speed. Shift: faster.").weak().small());
        });
    }

    fn side(&mut self, ui: &mut Ui, side: usize, facts: &Facts<'_>) {
        let name = ["A", "B"][side];
        let title = if self.compare {
            format!("Effect, side {name}")
        } else {
            "Effect".into()
        };
        let look = &mut self.looks[side];
        let quality = &mut self.qualities[side];
        CollapsingHeader::new(title)
            .id_salt(("side", side))
            .default_open(true)
            .show(ui, |ui| {
                ComboBox::from_id_salt(("effect", side))
                    .selected_text(look.effect.name())
                    .width(200.0)
                    .show_ui(ui, |ui| {
                        for effect in Effect::ALL {
                            let is = look.effect == effect;
                            if ui.selectable_label(is, effect.name()).clicked() {
                                look.choose(effect, *quality);
                            }
                        }
                    });
                ComboBox::from_id_salt(("method", side))
                    .selected_text(look.method.name(look.effect))
                    .width(200.0)
                    .show_ui(ui, |ui| {
                        for &method in look.effect.methods() {
                            let name = method.name(look.effect);
                            ui.selectable_value(&mut look.method, method, name);
                        }
                    });
                ui.horizontal(|ui| {
                    ui.label("Settings of");
                    for (of, name) in [
                        (Quality::Fast, "Fast"),
                        (Quality::Balanced, "Balanced"),
                        (Quality::Accurate, "Accurate"),
                    ] {
                        if ui.selectable_label(*quality == of, name).clicked() {
                            *quality = of;
                            look.take(of);
                        }
                    }
                });
                if let Err(e) = look.validate() {
                    ui.colored_label(ui.visuals().error_fg_color, e.to_string());
                } else if let Some(problem) = &facts.problems[side] {
                    ui.colored_label(ui.visuals().error_fg_color, problem);
                }
                ui.push_id(("settings", side), |ui| settings(ui, look));
            });
    }

    fn truth(&mut self, ui: &mut Ui, facts: &Facts<'_>) {
        CollapsingHeader::new("Beside traced rays")
            .default_open(true)
            .show(ui, |ui| {
                ui.horizontal(|ui| {
                    for (shown, name) in [
                        (Shown::Picture, "picture"),
                        (Shown::Error, "its error"),
                        (Shown::Truth, "the truth"),
                    ] {
                        ui.selectable_value(&mut self.shown, shown, name);
                    }
                });
                ui.add(
                    Slider::new(&mut self.truth_rays, 1..=4096)
                        .logarithmic(true)
                        .text("rays per pixel"),
                );
                if self.shown == Shown::Picture {
                    return;
                }
                if !self.looks[0].has_truth() {
                    ui.label("Rays have nothing to say of this effect, or of this sky.");
                    return;
                }
                if self.shown == Shown::Error {
                    ui.add(
                        Slider::new(&mut self.gain, 0.5..=64.0)
                            .logarithmic(true)
                            .text("errors shown times"),
                    );
                }
                if self.moves == Motion::Moving {
                    ui.label("Known once the box rests.");
                    return;
                }
                let truth = &facts.truth;
                if let Some(problem) = &truth.problem {
                    ui.colored_label(ui.visuals().error_fg_color, problem);
                }
                if let Some(progress) = truth.progress {
                    let text = format!("{} rays per pixel", truth.rays);
                    ui.add(ProgressBar::new(progress).text(text));
                }
                for (name, off) in ["A", "B"].iter().zip(&truth.off) {
                    if let Some(off) = off {
                        ui.label(format!(
                            "{name}: RMSE {:.4}, bias {:+.4}, mean {:.4}",
                            off.rmse, off.bias, off.mean
                        ));
                    }
                }
            });
    }

    fn plan(&mut self, ui: &mut Ui, facts: &Facts<'_>, actions: &mut Vec<Action>) {
        CollapsingHeader::new("Planner").show(ui, |ui| {
            let before = self.wish;
            let [error, milliseconds] = self.wishes;
            ui.horizontal(|ui| {
                ui.selectable_value(&mut self.wish, Wish::Free, "by hand");
                let is = matches!(self.wish, Wish::Quality(_));
                if ui.selectable_label(is, "quality").clicked() {
                    self.wish = Wish::Quality(self.qualities[0]);
                }
                let is = matches!(self.wish, Wish::Error(_));
                if ui.selectable_label(is, "error").clicked() {
                    self.wish = Wish::Error(error);
                }
                let is = matches!(self.wish, Wish::Milliseconds(_));
                if ui.selectable_label(is, "time").clicked() {
                    self.wish = Wish::Milliseconds(milliseconds);
                }
            });
            match &mut self.wish {
                Wish::Free => {}
                Wish::Quality(quality) => {
                    ui.horizontal(|ui| {
                        for (of, name) in [
                            (Quality::Fast, "Fast"),
                            (Quality::Balanced, "Balanced"),
                            (Quality::Accurate, "Accurate"),
                        ] {
                            ui.selectable_value(quality, of, name);
                        }
                    });
                }
                Wish::Error(error) => {
                    let (range, unit) = match self.looks[0].effect {
                        Effect::BentNormals => (0.5..=50.0, "° off at most"),
                        _ => (0.002..=0.5, "RMSE at most"),
                    };
                    ui.add(Slider::new(error, range).logarithmic(true).text(unit));
                    self.wishes[0] = *error;
                }
                Wish::Milliseconds(milliseconds) => {
                    ui.add(
                        Slider::new(milliseconds, 0.5..=5000.0)
                            .logarithmic(true)
                            .text("ms at most"),
                    );
                    self.wishes[1] = *milliseconds;
                }
            }
            if self.wish != before && self.wish != Wish::Free {
                actions.push(Action::Plan);
            }
            if matches!(self.wish, Wish::Error(_) | Wish::Milliseconds(_)) {
                if facts.planning.is_calibrating() {
                    ui.horizontal(|ui| {
                        ui.spinner();
                        ui.label("rendering what times and errors are told from");
                    });
                } else if ui
                    .button("Calibrate")
                    .on_hover_text("Renders a few pictures from here: a time needs it, an error is told better.")
                    .clicked()
                {
                    actions.push(Action::Calibrate);
                }
            }
            if let Some(problem) = &facts.planning.problem {
                ui.colored_label(ui.visuals().error_fg_color, problem);
            }
            if !facts.planning.table.is_empty() && self.wish != Wish::Free {
                ScrollArea::horizontal().id_salt("plan").show(ui, |ui| {
                    let text = RichText::new(&facts.planning.table).monospace().small();
                    ui.add(egui::Label::new(text).extend());
                });
            }
        });
    }

    fn picture(&mut self, ui: &mut Ui, actions: &mut Vec<Action>) {
        CollapsingHeader::new("Picture")
            .default_open(true)
            .show(ui, |ui| {
                ui.add(Slider::new(&mut self.scale, 0.1..=1.0).text("render scale"));
                ui.add(
                    Slider::new(&mut self.exposure, 0.05..=20.0)
                        .logarithmic(true)
                        .text("exposure, times"),
                );
                if ui
                    .button("Save as PNG and EXR")
                    .on_hover_text("Both sides, without the panel, at the size that is rendered.")
                    .clicked()
                {
                    actions.push(Action::Still);
                }
            });
    }
}

/// Times and memory.
fn costs(ui: &mut Ui, facts: &Facts<'_>) {
    CollapsingHeader::new("Times and memory")
        .default_open(true)
        .show(ui, |ui| {
            let total: f64 = facts.rows.iter().map(|row| row.ms).sum();
            let [width, height] = facts.size;
            ui.label(format!("{width} x {height}, {total:.1} ms"));
            egui::Grid::new("times").num_columns(2).show(ui, |ui| {
                for row in facts.rows {
                    ui.label(format!("{} {}", row.side, row.name));
                    ui.with_layout(egui::Layout::right_to_left(Align::Center), |ui| {
                        ui.monospace(format!("{:.2} ms", row.ms));
                    });
                    ui.end_row();
                }
                for (name, bytes) in facts.memory {
                    ui.label(*name);
                    ui.with_layout(egui::Layout::right_to_left(Align::Center), |ui| {
                        ui.monospace(format!("{:.1} MB", *bytes as f64 * 1e-6));
                    });
                    ui.end_row();
                }
            });
            if let Some(counts) = &facts.counts {
                let lost = counts.overflow();
                ui.label(format!("{} surfels", counts.stored));
                if lost > 0 {
                    let text = format!("{lost} more found no room");
                    ui.colored_label(ui.visuals().warn_fg_color, text);
                }
            }
        });
}

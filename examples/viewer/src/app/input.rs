//! The mouse and the keys.

use deep_screen_space::glam::DVec2;
use winit::{
    dpi::PhysicalPosition,
    event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent},
    keyboard::{KeyCode, PhysicalKey},
};

use super::State;
use crate::flight::Way;

/// What a pressed mouse does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Drag {
    Turn,
    Split,
}

/// How near the split line a mouse takes hold of it, pixels.
const HOLD: f64 = 8.0;

impl State {
    /// Takes an event that is no frame's.
    pub(super) fn hear(&mut self, event: &WindowEvent) {
        self.wake();
        let consumed = self.input.on_window_event(&self.window, event).consumed;
        let typing = self.input.egui_ctx().egui_wants_keyboard_input();
        match event {
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => {
                self.surface.resize(&self.gpu);
            }
            WindowEvent::Focused(false) => self.flight.release(),
            WindowEvent::DroppedFile(path) => {
                let name = path.to_string_lossy().into_owned();
                self.load(&name);
            }
            WindowEvent::KeyboardInput { event, .. } => {
                let pressed = event.state == ElementState::Pressed;
                if let PhysicalKey::Code(code) = event.physical_key {
                    self.press(code, pressed && !typing && !consumed);
                }
            }
            WindowEvent::CursorMoved { position, .. } => self.point(*position),
            WindowEvent::MouseInput { state, .. } if *state == ElementState::Released => {
                self.drag = None;
            }
            WindowEvent::MouseInput {
                button: MouseButton::Left | MouseButton::Right,
                ..
            } if self.is_over_picture() => {
                let [left, _, width, _] = self.area.map(f64::from);
                let line = left + f64::from(self.panel.split) * width;
                let near = self.panel.compare && (self.cursor.x - line).abs() < HOLD;
                self.drag = Some(if near { Drag::Split } else { Drag::Turn });
            }
            WindowEvent::MouseWheel { delta, .. } if self.is_over_picture() => {
                self.flight.hasten(match delta {
                    MouseScrollDelta::LineDelta(_, lines) => f64::from(*lines),
                    MouseScrollDelta::PixelDelta(by) => by.y / 50.0,
                });
            }
            _ => {}
        }
    }

    fn press(&mut self, code: KeyCode, pressed: bool) {
        let way = match code {
            KeyCode::KeyW | KeyCode::ArrowUp => Way::Ahead,
            KeyCode::KeyS | KeyCode::ArrowDown => Way::Back,
            KeyCode::KeyA | KeyCode::ArrowLeft => Way::Left,
            KeyCode::KeyD | KeyCode::ArrowRight => Way::Right,
            KeyCode::KeyE => Way::Up,
            KeyCode::KeyQ => Way::Down,
            KeyCode::ShiftLeft | KeyCode::ShiftRight => {
                self.flight.fast = pressed;
                return;
            }
            KeyCode::KeyH if pressed => {
                self.hidden = !self.hidden;
                return;
            }
            _ => return,
        };
        self.flight.hold(way, pressed);
    }

    fn point(&mut self, at: PhysicalPosition<f64>) {
        let at = DVec2::new(at.x, at.y);
        let by = at - self.cursor;
        self.cursor = at;
        match self.drag {
            Some(Drag::Turn) => self.flight.turn(by),
            Some(Drag::Split) => {
                let [left, _, width, _] = self.area.map(f64::from);
                let share = (at.x - left) / width.max(1.0);
                self.panel.split = share.clamp(0.0, 1.0) as f32;
            }
            None => {}
        }
    }

    /// Whether the mouse is over the picture, and no open list.
    fn is_over_picture(&self) -> bool {
        let [left, top, width, height] = self.area.map(f64::from);
        let context = self.input.egui_ctx();
        let place = (self.cursor / f64::from(context.pixels_per_point())).as_vec2();
        let layer = context.layer_id_at(egui::pos2(place.x, place.y));
        (left..left + width).contains(&self.cursor.x)
            && (top..top + height).contains(&self.cursor.y)
            && layer.is_none_or(|layer| layer.order == egui::Order::Background)
    }
}

//! The window's loop: events, and what each frame does.

use std::{
    path::PathBuf,
    sync::{
        Arc, Mutex, PoisonError,
        mpsc::{Receiver, TryRecvError, channel},
    },
    thread,
    time::{Duration, Instant},
};

use deep_screen_space::{
    glam::DVec2,
    wgpu::{self, TextureFormat, TextureView},
};
use egui_wgpu::{Renderer as Painter, RendererOptions, ScreenDescriptor};
use support::{gpu::Gpu, multires::read_image};
use winit::{
    application::ApplicationHandler,
    dpi::{PhysicalPosition, PhysicalSize},
    event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent},
    event_loop::{ActiveEventLoop, ControlFlow},
    keyboard::{KeyCode, PhysicalKey},
    window::{Window, WindowId},
};

use crate::{
    Options,
    display::{Arrangement, Display, Shown, Side},
    flight::{Flight, Pose, Way},
    panel::{Action, Facts, Motion, Panel, TruthFacts},
    place::Place,
    planning::{Planning, Wish},
    script::{Script, Step},
    sides::Sides,
    stills,
    surface::Surface,
    truth::{Answer, Question, Truth},
};

/// What runs in the event loop.
pub struct App {
    scene: String,
    size: [u32; 2],
    out: PathBuf,
    script: Option<Script>,
    state: Option<State>,
    failed: Option<String>,
}

impl App {
    pub fn new(options: &Options, script: Option<Script>) -> Self {
        Self {
            scene: options.scene.clone(),
            size: options.size,
            out: options.out.clone(),
            script,
            state: None,
            failed: None,
        }
    }

    /// How it ended.
    ///
    /// # Errors
    /// The line that says what it ended of.
    pub fn outcome(self) -> Result<(), String> {
        self.failed.map_or(Ok(()), Err)
    }

    fn end(&mut self, events: &ActiveEventLoop, problem: Option<String>) {
        self.failed = problem;
        events.exit();
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.state.is_some() {
            return;
        }
        match State::new(events, self) {
            Ok(state) => self.state = Some(state),
            Err(problem) => self.end(events, Some(problem)),
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(state) = &mut self.state else {
            return;
        };
        match event {
            WindowEvent::CloseRequested => self.end(events, None),
            WindowEvent::RedrawRequested => match state.frame() {
                Ok(true) => {}
                Ok(false) => self.end(events, None),
                Err(problem) => self.end(events, Some(problem)),
            },
            event => state.hear(&event),
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let Some(state) = &self.state else {
            return;
        };
        let now = Instant::now();
        if state.next <= now {
            state.window.request_redraw();
            events.set_control_flow(ControlFlow::Wait);
        } else {
            events.set_control_flow(ControlFlow::WaitUntil(state.next));
        }
    }
}

/// What a pressed mouse does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Drag {
    Turn,
    Split,
}

/// How near the split line a mouse takes hold of it, pixels.
const HOLD: f64 = 8.0;

/// How often one looks whether a thread has found something.
const OFTEN: Duration = Duration::from_millis(50);

/// As long as a frame lasts where nobody watches.
const STEP: f64 = 1.0 / 30.0;

/// After which a step of a script has failed.
const PATIENCE: Duration = Duration::from_secs(100);

/// The window and all that is in it.
struct State {
    window: Arc<Window>,
    gpu: Arc<Gpu>,
    device: String,
    surface: Surface,
    input: egui_winit::State,
    painter: Painter,
    display: Display,
    panel: Panel,
    hidden: bool,
    flight: Flight,
    place: Option<Arc<Place>>,
    loading: Option<(String, Receiver<Result<Place, String>>)>,
    sides: Sides,
    truth: Truth,
    answer: Answer,
    known: TextureView,
    off: TruthFacts,
    planning: Planning,
    out: PathBuf,
    message: Option<String>,
    /// What the device complained of.
    complaint: Arc<Mutex<Option<String>>>,
    /// Where the box is.
    rounds: f32,
    cursor: DVec2,
    drag: Option<Drag>,
    /// Of the window, pixels: left, top, width, height.
    area: [u32; 4],
    last: Instant,
    next: Instant,
    script: Option<Script>,
    /// Since when the script is at its step.
    since: Instant,
    shot: Option<PathBuf>,
}

impl State {
    fn new(events: &ActiveEventLoop, app: &mut App) -> Result<Self, String> {
        let [width, height] = app.size;
        let attributes = Window::default_attributes()
            .with_title("deep-screen-space")
            .with_inner_size(PhysicalSize::new(width, height));
        let window = events.create_window(attributes);
        let window = Arc::new(window.map_err(|e| format!("no window can be had: {e}"))?);
        let display = Box::new(events.owned_display_handle());
        let descriptor = wgpu::InstanceDescriptor::new_with_display_handle_from_env(display);
        let (gpu, surface) = Surface::open(Gpu::instance(descriptor), &window)?;
        let complaint = Arc::<Mutex<Option<String>>>::default();
        let of_device = Arc::clone(&complaint);
        gpu.device
            .on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
                let text = error.to_string();
                let words: Vec<&str> = text.split_whitespace().collect();
                *of_device.lock().unwrap_or_else(PoisonError::into_inner) = Some(words.join(" "));
            }));
        let context = egui::Context::default();
        let most = gpu.device.limits().max_texture_dimension_2d as usize;
        let input = egui_winit::State::new(
            context,
            egui::ViewportId::ROOT,
            &window,
            Some(window.scale_factor() as f32),
            None,
            Some(most),
        );
        let format = surface.format();
        let name = gpu.name();
        let mut state = Self {
            painter: Painter::new(&gpu.device, format, RendererOptions::PREDICTABLE),
            display: Display::new(&gpu, format),
            panel: Panel::new(gpu.on_processor(), &app.scene),
            hidden: false,
            flight: Flight::new(
                Pose::new(
                    deep_screen_space::glam::DVec3::ZERO,
                    deep_screen_space::glam::DVec3::NEG_Z,
                    45.0,
                    0.1,
                ),
                1.0,
            ),
            place: None,
            loading: None,
            sides: Sides::new(&gpu),
            truth: Truth::new(),
            answer: Answer::default(),
            known: gpu.texture(TextureFormat::Rgba32Float, 1, 1, &[[0.0_f32; 4]]),
            off: TruthFacts::default(),
            planning: Planning::default(),
            out: app.out.clone(),
            message: None,
            complaint,
            rounds: 0.0,
            cursor: DVec2::ZERO,
            drag: None,
            area: [0; 4],
            last: Instant::now(),
            next: Instant::now(),
            script: app.script.take(),
            since: Instant::now(),
            shot: None,
            device: name,
            gpu: Arc::new(gpu),
            window,
            surface,
            input,
        };
        state.load(&app.scene);
        Ok(state)
    }

    /// Reads a scene in a thread of its own.
    fn load(&mut self, name: &str) {
        let (sender, receiver) = channel();
        let (gpu, wanted) = (Arc::clone(&self.gpu), name.to_owned());
        thread::spawn(move || {
            // Nobody listens where something else was asked for since.
            let _ = sender.send(Place::load(&gpu, &wanted));
        });
        self.loading = Some((name.to_owned(), receiver));
        self.message = None;
        self.wake();
    }

    fn arrive(&mut self) {
        let Some((name, receiver)) = &self.loading else {
            return;
        };
        let loaded = match receiver.try_recv() {
            Ok(loaded) => loaded,
            Err(TryRecvError::Empty) => return,
            Err(TryRecvError::Disconnected) => Err(format!("{name}: reading it broke off")),
        };
        self.loading = None;
        match loaded {
            Ok(place) => {
                self.flight = Flight::new(place.views[0].1, 0.15 * place.size);
                self.panel.arrive(&place);
                self.window
                    .set_title(&format!("{} - deep-screen-space", place.name));
                self.place = Some(Arc::new(place));
                self.sides.cut();
                self.forget();
            }
            // What was there stays.
            Err(problem) => self.message = Some(problem),
        }
    }

    /// What was known of the truth is of no more use.
    fn forget(&mut self) {
        self.answer = Answer::default();
        self.off = TruthFacts::default();
        self.known = self
            .gpu
            .texture(TextureFormat::Rgba32Float, 1, 1, &[[0.0_f32; 4]]);
    }

    /// The next frame comes at once.
    fn wake(&mut self) {
        self.next = Instant::now();
    }

    /// Takes an event that is no frame's.
    fn hear(&mut self, event: &WindowEvent) {
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

    /// Pixels of the picture.
    fn size(&self) -> [u32; 2] {
        let scale = f64::from(self.panel.scale.clamp(0.01, 1.0));
        [self.area[2], self.area[3]].map(|n| ((f64::from(n) * scale).round() as u32).max(1))
    }

    /// The box's place, if there is one.
    fn rounds(&self) -> Option<f32> {
        (self.panel.moves != Motion::Away).then_some(self.rounds)
    }

    /// A frame. False after the last.
    fn frame(&mut self) -> Result<bool, String> {
        if !self.follow_script()? {
            return Ok(false);
        }
        if !self.surface.is_open() {
            self.next = Instant::now() + OFTEN;
            return Ok(true);
        }
        let now = Instant::now();
        let seconds = match self.script {
            Some(_) => STEP,
            None => (now - self.last).as_secs_f64(),
        };
        self.last = now;
        self.flight.advance(seconds);
        if self.panel.moves == Motion::Moving {
            self.rounds = (self.rounds + 0.1 * seconds.min(0.2) as f32) % 1.0;
        }
        self.arrive();
        let output = self.speak();
        let delay = output
            .viewport_output
            .get(&egui::ViewportId::ROOT)
            .map_or(Duration::MAX, |viewport| viewport.repaint_delay);
        let resting = self.render();
        self.trace();
        self.present(output)?;
        let complaint = self.complaint.lock();
        if let Some(text) = complaint.unwrap_or_else(PoisonError::into_inner).take() {
            self.message = Some(format!("the device: {text}"));
        }

        let waits = self.loading.is_some()
            || self.planning.is_calibrating()
            || (self.truth.is_asked() && self.answer.rays < self.panel.truth_rays);
        let moving = self.flight.is_moving() || self.panel.moves == Motion::Moving;
        let delay = if moving || !resting || self.script.is_some() {
            Duration::ZERO
        } else if waits {
            OFTEN.min(delay)
        } else {
            delay
        };
        // As good as never.
        let never = Duration::from_hours(1);
        self.next = Instant::now() + delay.min(never);
        Ok(true)
    }

    /// Has the panel shown, and does what it asks for.
    fn speak(&mut self) -> egui::FullOutput {
        if self.planning.take() {
            self.plan();
        }
        let sides = self.panel.sides();
        let place = self.place.clone();
        let memory = self.sides.memory(sides);
        let facts = Facts {
            device: &self.device,
            place: place.as_deref(),
            loading: self.loading.as_ref().map(|(name, _)| name.as_str()),
            size: self.size(),
            rows: self.sides.clock.rows(),
            memory: &memory,
            problems: &self.sides.problems,
            message: self.message.as_deref(),
            counts: self.sides.counts,
            truth: TruthFacts {
                rays: self.answer.rays,
                progress: self.truth.is_asked().then(|| self.truth.progress()),
                problem: self.truth.problem(),
                ..self.off.clone()
            },
            planning: &self.planning,
        };
        let (panel, flight, hidden) = (&mut self.panel, &mut self.flight, self.hidden);
        let input = self.input.take_egui_input(&self.window);
        let context = self.input.egui_ctx().clone();
        let (mut actions, mut left) = (Vec::new(), egui::Rect::NOTHING);
        let output = context.run_ui(input, |ui| {
            if !hidden {
                let most = 0.75 * ui.available_width();
                egui::Panel::right("settings")
                    .default_size(270.0_f32.min(most))
                    .max_size(most)
                    .show(ui, |ui| actions = panel.show(ui, &facts, flight));
            }
            left = ui.available_rect_before_wrap();
        });
        let scale = output.pixels_per_point;
        let [width, height] = self.surface.size();
        let [right, bottom] = [left.right(), left.bottom()].map(|n| (n * scale).max(0.0) as u32);
        let [x, y] = [left.left(), left.top()].map(|n| (n * scale).max(0.0) as u32);
        let (right, bottom) = (right.min(width), bottom.min(height));
        self.area = [x, y, right.saturating_sub(x), bottom.saturating_sub(y)];
        for action in actions {
            self.act(action);
        }
        output
    }

    fn act(&mut self, action: Action) {
        self.wake();
        match action {
            Action::Load(name) => self.load(&name),
            Action::View(number) => {
                if let Some(place) = &self.place
                    && let Some((_, pose)) = place.views.get(number)
                {
                    self.flight.pose = *pose;
                    self.sides.cut();
                }
            }
            Action::Still => self.save(),
            Action::Calibrate => self.calibrate(),
            Action::Plan => {
                if let Some(place) = self.place.clone()
                    && matches!(self.panel.wish, Wish::Milliseconds(_))
                    && !self.planning.is_calibrated(&place, &self.panel.looks[0])
                {
                    // A time can be told of none but this device.
                    self.calibrate();
                } else {
                    self.plan();
                }
            }
        }
    }

    fn calibrate(&mut self) {
        if let Some(place) = &self.place
            && !self.planning.is_calibrating()
        {
            let look = &self.panel.looks[0];
            self.planning
                .calibrate(&self.gpu, place, self.flight.pose, look);
        }
    }

    fn plan(&mut self) {
        let size = self.size();
        if let Some(place) = &self.place {
            let look = &mut self.panel.looks[0];
            self.planning
                .apply(&self.gpu, place, self.panel.wish, look, size);
        }
    }

    fn save(&mut self) {
        for side in 0..self.panel.sides() {
            let Some(passes) = self.sides.passes(side) else {
                continue;
            };
            let what = (&self.panel.looks[side], passes);
            let written = stills::write(&self.gpu, &self.out, what, self.panel.exposure);
            self.message = Some(match written {
                Ok(path) => format!("saved {}", path.display()),
                Err(problem) => problem,
            });
        }
    }

    /// Renders what has changed. True where nothing has, and nothing is to be joined.
    fn render(&mut self) -> bool {
        let (size, rounds) = (self.size(), self.rounds());
        let Some(place) = &self.place else {
            return true;
        };
        if self.area[2] == 0 || self.area[3] == 0 {
            return true;
        }
        let held = self.input.egui_ctx().input(|i| i.pointer.any_down());
        let looks = &self.panel.looks[..self.panel.sides()];
        let what = (place, &self.flight.pose, size, rounds);
        let resting = self.sides.render(&self.gpu, what, looks, held);
        if self.sides.changed && !self.answer.texels.is_empty() {
            self.measure();
        }
        resting
    }

    /// Asks for the truth, where it is to be seen, and takes what is known of it.
    fn trace(&mut self) {
        let wanted = self.panel.shown != Shown::Picture
            && self.panel.looks[0].has_truth()
            && self.panel.moves != Motion::Moving
            && !self.flight.is_moving()
            && self.drag != Some(Drag::Turn);
        let Some(place) = self.place.clone().filter(|_| wanted) else {
            if self.truth.is_asked() {
                self.truth.forget();
                self.forget();
            }
            return;
        };
        let asked = self.truth.ask(Question {
            place,
            rounds: self.rounds(),
            pose: self.flight.pose,
            size: self.size(),
            look: self.panel.looks[0],
            rays: self.panel.truth_rays,
        });
        if asked {
            self.forget();
        }
        if let Some(answer) = self.truth.take() {
            let [width, height] = answer.size;
            self.known =
                self.gpu
                    .texture(TextureFormat::Rgba32Float, width, height, &answer.texels);
            self.answer = answer;
            self.measure();
        }
    }

    /// How far both sides are off what is known.
    fn measure(&mut self) {
        let first = self.panel.looks[0];
        for side in 0..2 {
            let passes = self.sides.passes(side);
            let known = side < self.panel.sides() && first.shares_truth(&self.panel.looks[side]);
            self.off.off[side] = passes.filter(|_| known).and_then(|passes| {
                self.answer
                    .off(&read_image(&self.gpu, passes.target().texture()))
            });
        }
    }

    /// Draws both sides and the panel into the window, or into the file that a script asks for.
    fn present(&mut self, output: egui::FullOutput) -> Result<(), String> {
        let egui::FullOutput {
            platform_output,
            mut textures_delta,
            shapes,
            pixels_per_point,
            ..
        } = output;
        self.input
            .handle_platform_output(&self.window, platform_output);
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        for (id, deltas) in std::mem::take(&mut textures_delta.set) {
            for delta in deltas {
                self.painter.update_texture(device, queue, id, &delta);
            }
        }
        let jobs = self.input.egui_ctx().tessellate(shapes, pixels_per_point);
        if let Some(path) = self.shot.take() {
            let [width, height] = self.surface.size();
            let target = self.gpu.target(self.surface.format(), width, height);
            self.draw(&target, &jobs, pixels_per_point);
            self.write_shot(&path, &target)?;
        }
        if let Some(texture) = self.surface.next(&self.gpu) {
            let view = texture
                .texture
                .create_view(&wgpu::TextureViewDescriptor::default());
            self.draw(&view, &jobs, pixels_per_point);
            self.window.pre_present_notify();
            self.gpu.queue.present(texture);
        }
        for id in std::mem::take(&mut textures_delta.free) {
            self.painter.free_texture(&id);
        }
        // Nothing else waits for the device, which has to say what it is done with.
        let polled = self.gpu.device.poll(wgpu::PollType::Poll);
        polled.map(|_| ()).map_err(|e| format!("the device: {e}"))
    }

    fn draw(
        &mut self,
        target: &TextureView,
        jobs: &[egui::ClippedPrimitive],
        pixels_per_point: f32,
    ) {
        let gpu = &self.gpu;
        let mut encoder = gpu.encoder();
        let screen = ScreenDescriptor {
            size_in_pixels: self.surface.size(),
            pixels_per_point,
        };
        let buffers =
            self.painter
                .update_buffers(&gpu.device, &gpu.queue, &mut encoder, jobs, &screen);
        let shared = self.panel.looks[0].shares_truth(&self.panel.looks[1]);
        let side = |side: usize| {
            let passes = self.sides.passes(side)?;
            Some(Side {
                picture: passes.target(),
                look: &self.panel.looks[side],
                // The truth is about the first side's effect.
                shown: match self.panel.shown {
                    _ if side == 1 && !shared => Shown::Picture,
                    _ if !self.truth.is_asked() => Shown::Picture,
                    shown => shown,
                },
            })
        };
        let is_seen = self.area[2] > 0 && self.area[3] > 0;
        let load = if let Some(first) = side(0).filter(|_| is_seen) {
            let arrangement = Arrangement {
                first,
                second: side(1).filter(|_| self.panel.compare),
                truth: &self.known,
                area: self.area,
                split: self.panel.split,
                exposure: self.panel.exposure,
                gain: self.panel.gain,
            };
            self.display.record(gpu, &mut encoder, &arrangement, target);
            wgpu::LoadOp::Load
        } else {
            wgpu::LoadOp::Clear(wgpu::Color::BLACK)
        };
        let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("panel"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load,
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        self.painter
            .render(&mut pass.forget_lifetime(), jobs, &screen);
        let commands = buffers.into_iter().chain([encoder.finish()]);
        gpu.queue.submit(commands);
    }

    fn write_shot(&self, path: &PathBuf, target: &TextureView) -> Result<(), String> {
        let texture = target.texture();
        let mut texels: Vec<[u8; 4]> = self.gpu.read_texture(texture, 0);
        let is_turned = matches!(
            texture.format(),
            TextureFormat::Bgra8Unorm | TextureFormat::Bgra8UnormSrgb
        );
        for texel in &mut texels {
            if is_turned {
                texel.swap(0, 2);
            }
        }
        let bytes: Vec<u8> = texels.iter().flat_map(|t| [t[0], t[1], t[2]]).collect();
        let (width, height) = (texture.width(), texture.height());
        image::save_buffer(path, &bytes, width, height, image::ColorType::Rgb8)
            .map_err(|e| format!("{}: {e}", path.display()))
    }

    /// Takes the script's next steps, up to one that is to be waited for. False after the last.
    fn follow_script(&mut self) -> Result<bool, String> {
        let Some(mut script) = self.script.take() else {
            return Ok(true);
        };
        let mut goes_on = true;
        loop {
            let Some(step) = script.steps.front().cloned() else {
                goes_on = false;
                break;
            };
            let before = script.steps.len();
            match self.take_step(&step) {
                Progress::Done => {
                    script.steps.pop_front();
                }
                Progress::Then(rest) => {
                    script.steps[0] = rest;
                    self.since = Instant::now();
                    break;
                }
                Progress::Waits => {
                    if self.since.elapsed() > PATIENCE {
                        return Err(format!(
                            "{step:?} was waited for in vain: {:?}",
                            self.message
                        ));
                    }
                    break;
                }
            }
            if script.steps.len() != before {
                self.since = Instant::now();
            }
        }
        self.script = Some(script);
        Ok(goes_on)
    }

    fn take_step(&mut self, step: &Step) -> Progress {
        let wait = |done| {
            if done {
                Progress::Done
            } else {
                Progress::Waits
            }
        };
        match step {
            Step::Frames(0) => {}
            Step::Frames(n) => return Progress::Then(Step::Frames(n - 1)),
            Step::Key(way, n) => {
                self.flight.hold(*way, *n > 0);
                if *n > 0 {
                    return Progress::Then(Step::Key(*way, n - 1));
                }
            }
            Step::Scene(name) => self.load(name),
            Step::Effect(side, effect, method) => {
                let quality = self.panel.qualities[*side];
                let look = &mut self.panel.looks[*side];
                look.method = *method;
                look.choose(*effect, quality);
            }
            Step::Compare(on) => self.panel.compare = *on,
            Step::Split(share) => self.panel.split = *share,
            Step::Scale(scale) => self.panel.scale = *scale,
            Step::Show(shown) => self.panel.shown = *shown,
            Step::Mover(moves) => self.panel.moves = *moves,
            Step::Drag([x, y]) => self.flight.turn(DVec2::new(*x, *y)),
            Step::Resize([width, height]) => {
                if self.surface.size() == [*width, *height] {
                    return Progress::Done;
                }
                let size = PhysicalSize::new(*width, *height);
                let _ = self.window.request_inner_size(size);
                return Progress::Waits;
            }
            Step::Loaded => return wait(self.loading.is_none()),
            Step::Traced(rays) => return wait(self.answer.rays >= *rays),
            Step::Planned => return wait(!self.planning.is_calibrating()),
            Step::Plan(wish) => {
                self.panel.wish = *wish;
                self.act(Action::Plan);
            }
            Step::Still => self.save(),
            Step::Scroll(points) => self.panel.scroll = *points,
            Step::Shot(path) => {
                // Taken by the frame that comes.
                self.shot = Some(path.clone());
                return Progress::Then(Step::Frames(0));
            }
            Step::Report => self.report(),
        }
        Progress::Done
    }

    /// A line of what a test asks about.
    fn report(&self) {
        let [width, height] = self.size();
        let eye = self.flight.pose.eye;
        let rows = self.sides.clock.rows();
        let memory: u64 = self
            .sides
            .memory(self.panel.sides())
            .iter()
            .map(|m| m.1)
            .sum();
        let problems = self.sides.problems.iter().flatten();
        let problems: Vec<&str> = problems
            .map(String::as_str)
            .chain(self.message.as_deref())
            .collect();
        let picture = self.sides.passes(0).map(|passes| {
            let picture = read_image(&self.gpu, passes.target().texture());
            let values = picture.as_flattened();
            values.iter().map(|v| v.abs()).sum::<f32>() / values.len() as f32
        });
        let rmse = self.off.off.map(|off| off.map_or(-1.0, |off| off.rmse));
        println!(
            "report size={width}x{height} eye={:.4},{:.4},{:.4} stages={} ms={:.3} memory={memory} rays={} rmse={:.5},{:.5} \
             method={} mean={:.4} said={}",
            eye.x,
            eye.y,
            eye.z,
            rows.len(),
            self.sides.clock.total_ms(),
            self.answer.rays,
            rmse[0],
            rmse[1],
            self.panel.looks[0].method.short(),
            picture.unwrap_or(0.0),
            problems.join("; ")
        );
    }
}

/// What became of a step.
enum Progress {
    Done,
    /// Something is left of it, after a frame.
    Then(Step),
    Waits,
}

//! The window's loop: events, and what each frame does.

mod drawing;
mod input;
mod steps;

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
use egui_wgpu::{Renderer as Painter, RendererOptions};
use support::{gpu::Gpu, multires::read_image};
use winit::{
    application::ApplicationHandler,
    dpi::PhysicalSize,
    event::WindowEvent,
    event_loop::{ActiveEventLoop, ControlFlow},
    window::{Window, WindowId},
};

use self::input::Drag;
use crate::{
    Options,
    display::{Display, Shown},
    flight::{Flight, Pose},
    panel::{Action, Facts, Motion, Panel, TruthFacts},
    place::Place,
    planning::{Planning, Wish},
    script::Script,
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

/// How often one looks whether a thread has found something.
const OFTEN: Duration = Duration::from_millis(50);

/// As long as a frame lasts where nobody watches.
const STEP: f64 = 1.0 / 30.0;

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
        let shown = self.present(output)?;
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
        } else if waits || !shown {
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
}

//! The planner as a control: a wish, the settings that meet it, and what this device takes.

use std::{
    sync::{
        Arc,
        mpsc::{Receiver, TryRecvError, channel},
    },
    thread,
};

use deep_screen_space::{
    Quality,
    planner::{Budget, Calibration, Method as Planned, PlanRequest, SceneCounts, plan},
};
use support::{
    calibration::{Subject, calibrate},
    gpu::Gpu,
    raster::Raster,
    sky,
};

use crate::{
    flight::Pose,
    look::{Effect, Look, Method},
    place::Place,
};

/// What settings are to meet.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Wish {
    /// They are set by hand.
    #[default]
    Free,
    Quality(Quality),
    /// As [`Budget::Error`].
    Error(f64),
    Milliseconds(f64),
}

/// What is known of the device, and what was planned last.
#[derive(Default)]
pub struct Planning {
    /// Of a place and an effect.
    calibration: Option<(Key, Calibration)>,
    running: Option<(Key, Receiver<Result<Calibration, String>>)>,
    /// What was weighed, or why there is no plan.
    pub table: String,
    pub problem: Option<String>,
}

type Key = (u64, Effect);

/// Pictures that a calibration renders.
const SIZE: [u32; 2] = [320, 200];

impl Planning {
    pub fn is_calibrating(&self) -> bool {
        self.running.is_some()
    }

    pub fn is_calibrated(&self, place: &Place, look: &Look) -> bool {
        let key = (place.id, look.effect);
        self.calibration.as_ref().is_some_and(|c| c.0 == key)
    }

    /// Renders a few pictures of the place from where one is, in a thread of its own.
    pub fn calibrate(&mut self, gpu: &Arc<Gpu>, place: &Arc<Place>, pose: Pose, look: &Look) {
        let key = (place.id, look.effect);
        let (gpu, place, effect) = (Arc::clone(gpu), Arc::clone(place), look.ray_traced());
        let sky = sky::by_name(sky::NAMES[look.sky % sky::NAMES.len()]);
        let roughness = look.roughness;
        let (sender, receiver) = channel();
        thread::spawn(move || {
            let camera = pose.camera(SIZE).map_err(|e| e.to_string());
            let calibration = camera.and_then(|camera| {
                let subject = Subject {
                    gpu: &gpu,
                    size: SIZE,
                    camera: &camera,
                    buffers: &place.buffers,
                    drawn: &Raster::draw(&gpu, &place.buffers, &camera),
                    lights: &place.lights,
                    sky: sky.as_ref(),
                    roughness,
                };
                calibrate(&subject, &effect)
            });
            // Nobody listens where the window was closed.
            let _ = sender.send(calibration);
        });
        self.running = Some((key, receiver));
    }

    /// Takes what a calibration found, if it has ended. True where it did.
    pub fn take(&mut self) -> bool {
        let Some((key, receiver)) = &self.running else {
            return false;
        };
        let found = match receiver.try_recv() {
            Ok(found) => found,
            Err(TryRecvError::Empty) => return false,
            Err(TryRecvError::Disconnected) => Err("the calibration broke off".into()),
        };
        let key = *key;
        self.running = None;
        match found {
            Ok(calibration) => self.calibration = Some((key, calibration)),
            Err(problem) => self.problem = Some(problem),
        }
        true
    }

    /// Changes settings to those that meet a wish.
    pub fn apply(&mut self, gpu: &Gpu, place: &Place, wish: Wish, look: &mut Look, size: [u32; 2]) {
        self.problem = None;
        let unplanned = [Effect::SubsurfaceScattering, Effect::SoftShadows].contains(&look.effect);
        if unplanned && matches!(wish, Wish::Error(_) | Wish::Milliseconds(_)) {
            let effect = look.effect.name().to_lowercase();
            self.problem = Some(format!("there are no plans for {effect}"));
            return;
        }
        let budget = match wish {
            Wish::Free => return,
            Wish::Quality(quality) => {
                look.take(quality);
                return;
            }
            Wish::Error(error) => Budget::Error(error),
            Wish::Milliseconds(milliseconds) => Budget::Milliseconds(milliseconds),
        };
        let key = (place.id, look.effect);
        let known = self.calibration.as_ref().filter(|known| known.0 == key);
        let request = PlanRequest {
            limits: &gpu.device.limits(),
            size,
            scene: SceneCounts::once(place.buffers.triangles().into()),
            effect: look.ray_traced(),
            budget,
            calibration: known.map(|known| &known.1),
        };
        let plan = match plan(&request) {
            Ok(plan) => plan,
            Err(e) => {
                self.problem = Some(e.to_string());
                return;
            }
        };
        self.table = plan.to_string();
        match plan.chosen.method {
            Planned::Rays(rays) => {
                look.method = Method::Rays;
                look.rays = rays;
                look.rays.filter.f0 = look.f0;
            }
            Planned::Splats(splats) => {
                look.method = Method::Splats;
                look.splats = splats;
            }
            Planned::Obscurance {
                descriptor,
                settings,
            } => {
                look.method = Method::Depths;
                look.sampling = descriptor.sampling;
                look.volume = descriptor.volume;
                look.obscurance = settings;
            }
        }
    }
}

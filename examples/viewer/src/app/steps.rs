//! The steps of a script, taken as a user would.

use std::time::{Duration, Instant};

use deep_screen_space::{TemporalSettings, glam::DVec2};
use support::multires::read_image;
use winit::dpi::PhysicalSize;

use super::State;
use crate::{panel::Action, script::Step};

/// After which a step of a script has failed.
const PATIENCE: Duration = Duration::from_secs(100);

/// What became of a step.
enum Progress {
    Done,
    /// Something is left of it, after a frame.
    Then(Step),
    Waits,
}

impl State {
    /// Takes the script's next steps, up to one that is to be waited for. False after the last.
    pub(super) fn follow_script(&mut self) -> Result<bool, String> {
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
            Step::Join(side, on) => {
                self.panel.looks[*side].temporal = on.then(TemporalSettings::default);
            }
            Step::Lamps(side, on) => self.panel.looks[*side].aim(*on),
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
                // Where the window decides by itself no event follows.
                if self.window.request_inner_size(size).is_some() {
                    self.surface.resize(&self.gpu);
                }
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

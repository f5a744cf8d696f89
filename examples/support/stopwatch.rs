//! How long work took, by the clock that says most about it.

use std::time::{Duration, Instant};

use cpu_time::ProcessTime;

/// Runs from when it was made.
pub struct Stopwatch {
    wall: Instant,
    processor: Option<ProcessTime>,
}

impl Stopwatch {
    /// By the processor's time of all threads of this process over the number of cores, where `on_processor` says that they do
    /// the work: what it would take if no other program ran and all cores had as much to do. By wall clock otherwise.
    pub fn start(on_processor: bool) -> Self {
        Self {
            processor: on_processor.then(|| ProcessTime::try_now().ok()).flatten(),
            wall: Instant::now(),
        }
    }

    /// Since then.
    pub fn elapsed(&self) -> Duration {
        self.processor
            .and_then(|start| start.try_elapsed().ok())
            .map_or_else(|| self.wall.elapsed(), |elapsed| elapsed / cores())
    }

    /// The same in milliseconds.
    pub fn milliseconds(&self) -> f64 {
        self.elapsed().as_secs_f64() * 1e3
    }
}

fn cores() -> u32 {
    std::thread::available_parallelism().map_or(1, |n| n.get() as u32)
}

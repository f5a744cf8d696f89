//! A window in which one flies through a scene: `cargo run --release --example viewer -- [SCENE.glb]`.
//!
//! W, A, S and D fly, E and Q rise and sink, a dragged mouse turns, the wheel sets the speed, Shift is four times as fast. The
//! panel has every setting with its unit and what the crate accepts, two effects or methods side by side, times and memory, the
//! planner, the error against traced rays, stills, and the settings as Rust code. Long work (files, the ray tracer, a
//! calibration) is done by threads of its own: no frame waits for it.

mod app;
mod clock;
mod code;
mod display;
mod fields;
mod flight;
mod look;
mod motion;
mod mover;
mod panel;
mod passes;
mod place;
mod planning;
mod rays;
mod script;
mod settings;
mod sides;
mod stills;
mod surface;
mod truth;

use std::{path::PathBuf, process::ExitCode};

use clap::Parser;
use support::arguments;
use winit::event_loop::EventLoop;

/// Fly through a scene, and see what each setting does.
#[derive(Parser)]
#[command(name = "viewer", about)]
struct Options {
    /// A glTF 2.0 file, or the name of one of the crate's scenes.
    #[arg(default_value = "colonnade")]
    scene: String,
    /// Size of the window in pixels, `WxH`.
    #[arg(long, value_parser = arguments::parse_size, default_value = "1280x800")]
    size: [u32; 2],
    /// Where stills are written.
    #[arg(long, default_value = ".")]
    out: PathBuf,
    /// Steps to go through without hands, for tests: see `script.rs`.
    #[arg(long, hide = true)]
    script: Option<String>,
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("viewer: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    let script = options.script.as_deref().map(script::Script::parse);
    let script = script.transpose()?;
    let events = EventLoop::new().map_err(|e| format!("no window can be had: {e}"))?;
    let mut app = app::App::new(options, script);
    events.run_app(&mut app).map_err(|e| e.to_string())?;
    app.outcome()
}

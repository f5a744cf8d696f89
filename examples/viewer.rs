//! Starts the viewer: `cargo run --release --example viewer -- [SCENE.glb]`.
//!
//! It is a package of its own, `examples/viewer`, since its window needs a newer Rust than the crate does, and no test of the
//! crate should wait for a window's dependencies. `cargo run --release --package deep-screen-space-viewer` is the same.

use std::{
    path::Path,
    process::{Command, ExitCode},
};

fn main() -> ExitCode {
    let cargo = std::env::var_os("CARGO").unwrap_or("cargo".into());
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
    let profile = if cfg!(debug_assertions) {
        "dev"
    } else {
        "release"
    };
    let ended = Command::new(cargo)
        .args(["run", "--quiet", "--package", "deep-screen-space-viewer"])
        .args(["--profile", profile, "--manifest-path"])
        .arg(manifest)
        .arg("--")
        .args(std::env::args_os().skip(1))
        .status();
    match ended {
        Ok(status) => ExitCode::from(status.code().unwrap_or(1) as u8),
        Err(e) => {
            eprintln!("viewer: cargo cannot be run: {e}");
            ExitCode::FAILURE
        }
    }
}

//! What benches share: their files, sizes, and a bar that says how long they will take.

use std::path::PathBuf;

use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

/// `target/bench` of the crate, made if it is not there.
pub fn folder() -> Result<PathBuf, String> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../target/bench");
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    Ok(folder)
}

/// Writes rows to `target/bench/{name}.json`.
pub fn write_rows<T: Serialize>(name: &str, rows: &[T]) -> Result<(), String> {
    let path = folder()?.join(format!("{name}.json"));
    let text = serde_json::to_string_pretty(rows).map_err(|e| e.to_string())?;
    std::fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))
}

/// A bar of so many steps on standard error, with the time that is left; nothing where that is no terminal.
pub fn progress(steps: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len}, {eta} left {msg}");
    ProgressBar::new(steps as u64)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// `1280x720` and the like.
pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let sides: Option<Vec<u32>> = text.split('x').map(|n| n.parse().ok()).collect();
    match sides.as_deref() {
        Some(&[width, height]) if width > 0 && height > 0 => Ok([width, height]),
        _ => Err(format!("{text} is no size, such as 1280x720")),
    }
}

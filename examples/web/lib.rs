//! The crate in a browser: what `index.html` calls, and the frame that it draws, which is the same elsewhere.
//!
//! `scripts/web.sh` builds it for `wasm32-unknown-unknown`, and compares its pictures in a browser with those that
//! `tests/whole/browser.rs` renders without one.

#![warn(missing_docs)]

mod frame;
#[cfg(target_arch = "wasm32")]
mod page;
#[cfg(target_arch = "wasm32")]
mod show;

pub use frame::{Effect, Frame, Orbit, SIZE, compared};

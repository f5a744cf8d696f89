//! The `BouncedZBuffer`: directions by themselves, GPU against the f64 mirror, nothing that leaks, and typed errors.

mod closed;
mod comparison;
mod directions;
mod errors;
mod harness;
mod packing;

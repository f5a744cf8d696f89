//! The `TemporalAccumulator`: GPU against the f64 mirror, and what must hold of any accumulation.
//!
//! Scenes are a wall, a floor and a block, drawn on the CPU; pictures are functions of the surface's point, noise, or
//! absent (NaN), which shows the reprojected history alone.

mod comparison;
mod errors;
mod extremes;
mod ghosts;
mod harness;
mod means;
mod reprojection;
mod room;

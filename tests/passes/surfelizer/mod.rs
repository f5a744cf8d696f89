//! The Surfelizer: GPU against the f64 mirror, and both against what the surfels stand for.

mod area;
mod comparison;
mod coverage;
mod culling;
mod errors;
mod extremes;
mod formats;
mod harness;
mod overflow;
mod repeatability;
mod size;

mod zoom;

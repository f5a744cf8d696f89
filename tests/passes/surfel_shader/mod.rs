//! The `SurfelShader`: GPU against the f64 mirror, against closed forms and traced shadows, and at the extremes.

mod closed_forms;
mod comparison;
mod errors;
mod extremes;
mod harness;
mod shadow_maps;
mod shadow_rays;

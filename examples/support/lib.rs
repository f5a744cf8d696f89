//! What examples, tests and benches share: a device, scenes, a G-buffer, the passes wired together, image files.

// Its users are in this repository: programs that end with the message of an error or a panic.
#![allow(clippy::missing_errors_doc, clippy::missing_panics_doc)]

pub mod ambient_occlusion;
pub mod arguments;
pub mod bench;
pub mod bounced;
pub mod calibration;
pub mod decoding;
pub mod depth_only;
pub mod errors;
pub mod files;
pub mod gltf;
pub mod gpu;
pub mod hull;
pub mod lights;
pub mod multires;
pub mod near;
pub mod presets;
pub mod raster;
pub mod scene;
pub mod shadow;
pub mod sky;
pub mod stage;
pub mod stages;
pub mod stopwatch;
pub mod temporal;
pub mod testing;
pub mod visible;
pub mod world;

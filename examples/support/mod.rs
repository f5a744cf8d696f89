//! What examples and benches share: a device, scenes, a G-buffer, the passes wired together, image files.

// Each user needs a part of it.
#![allow(dead_code)]

pub mod ambient_occlusion;
pub mod arguments;
pub mod bounced;
pub mod errors;
pub mod files;
pub mod gltf;
pub mod gpu;
pub mod hull;
pub mod multires;
pub mod near;
pub mod presets;
pub mod raster;
pub mod scene;
pub mod shadow;
pub mod temporal;
pub mod visible;
pub mod world;

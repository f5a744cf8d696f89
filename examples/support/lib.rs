//! What examples, tests and benches share: a device, scenes, a G-buffer, the passes wired together, image files.
//!
//! Without the feature `native` only what an engine has anyway, a device, meshes in buffers and a G-buffer, which compiles for
//! browsers too.

// Its users are in this repository: programs that end with the message of an error or a panic.
#![allow(clippy::missing_errors_doc, clippy::missing_panics_doc)]

#[cfg(feature = "native")]
pub mod ambient_occlusion;
#[cfg(feature = "native")]
pub mod apart;
#[cfg(feature = "native")]
pub mod arguments;
#[cfg(feature = "native")]
pub mod bench;
#[cfg(feature = "native")]
pub mod bounced;
#[cfg(feature = "native")]
pub mod calibration;
#[cfg(feature = "native")]
pub mod decoding;
#[cfg(feature = "native")]
pub mod depth_only;
#[cfg(feature = "native")]
pub mod errors;
#[cfg(feature = "native")]
pub mod files;
#[cfg(feature = "native")]
pub mod gltf;
pub mod gpu;
#[cfg(feature = "native")]
pub mod hull;
#[cfg(feature = "native")]
pub mod lights;
#[cfg(feature = "native")]
pub mod multires;
#[cfg(feature = "native")]
pub mod near;
#[cfg(feature = "native")]
pub mod presets;
pub mod raster;
pub mod scene;
#[cfg(feature = "native")]
pub mod shadow;
#[cfg(feature = "native")]
pub mod sky;
#[cfg(feature = "native")]
pub mod stage;
#[cfg(feature = "native")]
pub mod stages;
#[cfg(feature = "native")]
pub mod stopwatch;
#[cfg(feature = "native")]
pub mod temporal;
#[cfg(feature = "native")]
pub mod testing;
#[cfg(feature = "native")]
pub mod visible;
#[cfg(feature = "native")]
pub mod world;

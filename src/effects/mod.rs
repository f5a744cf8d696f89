//! The crate's own effects.

pub mod ambient_occlusion;
pub mod diffuse_bounce;

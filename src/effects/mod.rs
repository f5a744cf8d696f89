//! The crate's own effects.

pub mod ambient_occlusion;
pub mod diffuse_bounce;
pub mod scattering;
pub mod subsurface_scattering;

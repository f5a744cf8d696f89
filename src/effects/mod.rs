//! The crate's own effects.

pub mod ambient_occlusion;
pub mod bent_normals;
pub mod diffuse_bounce;
pub mod directional_occlusion;
pub mod scattering;
pub mod specular_bounce;
pub mod subsurface_scattering;

//! Ambient occlusion and indirect light for wgpu.
#![doc = ""]

pub use glam;
pub use wgpu;

mod camera;
mod effect;
mod effects;
mod error;
mod gbuffer;
mod geometry;
mod gpu;
#[cfg(test)]
mod layout;
mod receivers;
mod reconstructor;
#[cfg(feature = "reference")]
pub mod reference;
#[cfg(feature = "scenes")]
pub mod scenes;
mod shaders;
mod shell_splatter;
mod surfel;
mod surfelizer;

pub use camera::{Camera, Footprint, Viewport};
pub use effect::{Channels, Effect};
pub use effects::ambient_occlusion::{AmbientOcclusion, Overlap};
pub use error::Error;
pub use gbuffer::{GBuffer, NormalEncoding, NormalSpace};
pub use geometry::{
    Geometry, IndexFormat, Indices, Instances, Material, Mesh, PositionFormat, TransformFormat,
    Vertices,
};
pub use gpu::Timestamps;
pub use reconstructor::{
    Reconstructor, ReconstructorInput, ReconstructorView, settings::ReconstructorSettings,
};
pub use shaders::{Shader, shaders};
pub use shell_splatter::{
    ShellSplatter, ShellSplatterDescriptor, SplatInput, SplatView, SurfelClusters,
    settings::SplatSettings,
};
pub use surfel::{CloudCapacity, Piece, Surfel, SurfelCloud, SurfelCounts, SurfelSource};
pub use surfelizer::{
    Surfelizer, SurfelizerInput,
    settings::{Placement, Reach, SurfelizerSettings},
};

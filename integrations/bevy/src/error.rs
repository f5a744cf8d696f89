//! Why a camera is drawn without the effect.

use thiserror::Error;

/// Why a camera is drawn without the effect. Each says what to change.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// Depth and normals have several samples per pixel.
    #[error(
        "the camera has {samples} samples per pixel, and rays start from one: give it Msaa::Off"
    )]
    Msaa {
        /// Of the camera.
        samples: u32,
    },
    /// There would be two occlusions in one place.
    #[error(
        "the camera has Bevy's ScreenSpaceAmbientOcclusion, whose place this would take: remove one of the two"
    )]
    ScreenSpace,
    /// Bevy's materials read occlusion where its own is loaded, and it is not.
    #[error(
        "Bevy's ScreenSpaceAmbientOcclusionPlugin, by which materials read occlusion, makes nothing of this device: it asks for \
         5 storage textures per shader stage, of which there are {storage_textures}"
    )]
    Materials {
        /// What the device was made with.
        storage_textures: u32,
    },
    /// There is nothing to start rays from.
    #[error("the camera has no {0}, from which rays start: leave it with the camera")]
    Prepass(&'static str),
    /// A mesh that rays would go through.
    #[error(
        "a mesh, {mesh}, is of {topology}, which rays cannot meet: make it a TriangleList, or give it NotShadowCaster"
    )]
    Topology {
        /// Its asset.
        mesh: String,
        /// What it is made of.
        topology: &'static str,
    },
    /// Vertices that cannot be read where they stand.
    #[error("a mesh, {mesh}: {error}")]
    Mesh {
        /// Its asset.
        mesh: String,
        /// What the library says of it.
        error: deep_screen_space::Error,
    },
    /// What the library refuses: a setting out of range, a camera that is neither perspective nor orthographic, a device with
    /// too low limits.
    #[error(transparent)]
    Library(#[from] deep_screen_space::Error),
}

//! Why a frame is drawn without the effect.

use thiserror::Error;

/// Why a frame is drawn without the effect. Each says what to switch on, or what to leave out.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// There is no device to make anything with.
    #[error("kiss3d has no device yet: open a window or an off-screen surface before this")]
    NoContext,
    /// Vertices or indices cannot be had.
    #[error(
        "object {object}'s {what} are neither in memory nor in a buffer with the usage STORAGE: keep them in memory (leave \
         `GPUVec::unload_from_ram` out), or write them to the buffer of `GPUVec::prepare_gpu_writable`, which has STORAGE"
    )]
    Mesh {
        /// Which object, counted from 0 in the order of the scene's nodes.
        object: usize,
        /// What is missing.
        what: &'static str,
    },
    /// Instances cannot be had.
    #[error(
        "object {object}'s instances are not in memory: give them by `set_instances` in place of `instance_compute_buffers`"
    )]
    Instances {
        /// Which object, counted from 0 in the order of the scene's nodes.
        object: usize,
    },
    /// What the library refuses: a setting out of range, a camera that is neither perspective nor orthographic, a device with
    /// too low limits.
    #[error(transparent)]
    Library(#[from] deep_screen_space::Error),
}

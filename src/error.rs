//! The one error type of the crate.

use thiserror::Error;

/// Why a request was refused. Every variant names the thing, its value and what would be accepted.
///
/// Nothing that a caller passes in makes the crate panic: what cannot be honoured comes back as one of these, before
/// anything is recorded.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting lies outside its range.
    #[error("{field} is {value}, accepted is {accepted}")]
    Setting {
        /// The field, as `Type::field`.
        field: &'static str,
        /// What it was set to.
        value: f64,
        /// The range in words.
        accepted: &'static str,
    },
    /// A camera's matrix is not of a kind that the passes can work with.
    #[error("the camera's {field} is {value}, accepted is {accepted}")]
    Camera {
        /// Which part of the camera.
        field: &'static str,
        /// Its value.
        value: String,
        /// What is accepted.
        accepted: &'static str,
    },
    /// A texture has a format that its role does not allow.
    #[error("{name} has format {format:?}, accepted is {accepted}")]
    Format {
        /// The texture's role.
        name: &'static str,
        /// Its format.
        format: wgpu::TextureFormat,
        /// What is accepted, in words.
        accepted: &'static str,
    },
    /// A texture lacks a usage.
    #[error("{name} was created with usage {usage:?}, needed is {needed:?}")]
    Usage {
        /// The texture's or buffer's role.
        name: &'static str,
        /// The usage it was created with.
        usage: wgpu::TextureUsages,
        /// The usage that is missing or not.
        needed: wgpu::TextureUsages,
    },
    /// A texture is multisampled, layered or three-dimensional where a plain 2-D one is needed.
    #[error("{name} has {found}, needed is {needed}")]
    Shape {
        /// The texture's role.
        name: &'static str,
        /// What it has.
        found: String,
        /// What is needed.
        needed: &'static str,
    },
    /// A texture does not cover the camera's viewport, or sizes disagree.
    #[error("{name} is {}x{}, needed is at least {}x{}", size[0], size[1], needed[0], needed[1])]
    Size {
        /// The texture's role.
        name: &'static str,
        /// Its size in pixels.
        size: [u32; 2],
        /// The size that is needed.
        needed: [u32; 2],
    },
    /// A buffer is too small, or lacks a usage.
    #[error("{name} has {found}, needed is {needed}")]
    Buffer {
        /// The buffer's role.
        name: &'static str,
        /// What it has.
        found: String,
        /// What is needed.
        needed: String,
    },
    /// The device was created with a lower limit than the configuration needs.
    #[error("the device's limit {limit} is {available}, needed is {needed} ({why})")]
    Limit {
        /// The limit's name in [`wgpu::Limits`].
        limit: &'static str,
        /// The device's value.
        available: u64,
        /// The needed value.
        needed: u64,
        /// What needs it.
        why: &'static str,
    },
    /// The device was created without a feature that the configuration needs.
    #[error("the device lacks the feature {feature:?} ({why})")]
    Feature {
        /// The feature.
        feature: wgpu::Features,
        /// What needs it.
        why: &'static str,
    },
    /// Two objects do not belong together.
    #[error("{name} is for {found}, needed is {needed}")]
    Mismatch {
        /// Which object.
        name: &'static str,
        /// What it was made for.
        found: String,
        /// What this call needs.
        needed: String,
    },
    /// An object was not recorded, or not from what it is used with, or not since that was last recorded.
    ///
    /// What counts is the order of recordings. Encoders that are submitted in another order are not noticed.
    #[error(
        "{name} is {found}, needed is one that was recorded from what it is used with, since that was"
    )]
    Recording {
        /// Which object.
        name: &'static str,
        /// How it was recorded.
        found: String,
    },
    /// WGSL given by the caller does not fit.
    #[error("the WGSL of {label} {problem}")]
    Effect {
        /// The label of the effect or gatherer.
        label: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A module of the crate's own WGSL does not fit together, which is a fault of the crate.
    #[error("{file}, line {line}: the module {problem}")]
    Shader {
        /// The file, relative to the crate.
        file: String,
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        problem: String,
    },
}

/// [`Error::Setting`] unless `accept` holds.
pub(crate) fn check_setting(
    accept: bool,
    field: &'static str,
    value: impl Into<f64>,
    accepted: &'static str,
) -> Result<(), Error> {
    if accept {
        Ok(())
    } else {
        Err(Error::Setting {
            field,
            value: value.into(),
            accepted,
        })
    }
}

/// [`Error::Limit`] where a device's limit is below what is needed.
pub(crate) fn check_limit(
    limit: &'static str,
    available: u64,
    needed: u64,
    why: &'static str,
) -> Result<(), Error> {
    if needed <= available {
        Ok(())
    } else {
        Err(Error::Limit {
            limit,
            available,
            needed,
            why,
        })
    }
}

//! CPU references (feature `reference`): a mirror in f64 of each pass, which reads line by line like its shader, and the
//! ray-traced truth.

pub mod gbuffer;
pub mod trace;

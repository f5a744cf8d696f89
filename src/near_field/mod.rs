//! Effects of what the depth buffer holds, in one object and one recording per frame: at every pixel, or by multi-resolution
//! masks.

pub(crate) mod effect;
pub(crate) mod view;

//! Ambient occlusion and indirect light by rays, in two objects and two recordings per frame: the passes wired together.

pub(crate) mod bounces;
pub(crate) mod counts;
pub(crate) mod quality;
pub(crate) mod scene;
pub(crate) mod view;

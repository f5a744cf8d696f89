//! What the tests share: passes wired for one picture, rays and hits read back, refusals looked at.

pub mod calls;
pub mod frames;
pub mod kernel;
pub mod multi_res;
pub mod passes;
pub mod pipelines;
pub mod rays;
pub mod refusals;
pub mod shot;
pub mod splats;

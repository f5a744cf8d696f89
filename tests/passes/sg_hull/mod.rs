//! The hull: segments against a flood fill, vertices and pixels against the f64 mirror, the picture against light gathered
//! at every pixel, and what must hold whatever is asked for.

mod comparison;
mod errors;
mod harness;
mod lights;
mod picture;
mod segments;

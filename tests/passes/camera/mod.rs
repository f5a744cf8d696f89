//! The camera and the G-buffer contract: every kind of projection, size and format, on the CPU and as the GPU decodes it.

mod depths;
mod errors;
mod harness;
mod normals;
mod projections;

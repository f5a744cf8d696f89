//! Alpha-tested triangles: hits against the f64 mirror in one level and in two, by mirrored instances too, against the same shape
//! cut out in triangles, what it costs where nothing has holes, and typed errors.

mod comparison;
mod errors;
mod extremes;
mod grass;
mod harness;
mod sheets;
mod unused;

//! Rays that the device traces (`Primitives::RayQuery`): against the mirrors, beside the crate's own traversal, and what is
//! refused. `scripts/ray_query.sh` runs them on a driver that has such rays.

mod hits;
mod light;
mod scene;
mod timestamps;

//! The passes together: whole pictures against ray tracing, extremes, misuse, and what is drawn at random.

mod bounces;
mod browser;
mod extremes;
mod frames;
mod fuzz;
mod hull;
mod misuse;
mod near_extremes;
mod near_field;
mod odd_cameras;
mod ray_traced;
mod truth;
mod unused;

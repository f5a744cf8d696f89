//! Mirror of `wgsl/surfelizer.wgsl`.

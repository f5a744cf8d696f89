//! Mirror of `wgsl/reconstructor.wgsl`.

//! Mirror of `wgsl/effects.wgsl`.

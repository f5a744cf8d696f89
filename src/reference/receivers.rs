//! Mirror of `wgsl/receivers.wgsl`.

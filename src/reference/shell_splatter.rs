//! Mirror of `wgsl/shell_splatter.wgsl`.

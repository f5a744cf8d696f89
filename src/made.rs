//! How many wgpu objects recordings make, counted with the feature `reference` alone.

/// Kinds of objects that recordings make.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Kind {
    Buffer,
    BindGroup,
    TextureView,
}

#[cfg(feature = "reference")]
static COUNTS: [std::sync::atomic::AtomicU64; 3] =
    [const { std::sync::atomic::AtomicU64::new(0) }; 3];

/// Counts one more.
pub(crate) fn count(kind: Kind) {
    #[cfg(feature = "reference")]
    COUNTS[kind as usize].fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    #[cfg(not(feature = "reference"))]
    let _ = kind;
}

/// How many there were so far, over all devices.
#[cfg(feature = "reference")]
pub(crate) fn counts() -> [u64; 3] {
    COUNTS
        .each_ref()
        .map(|count| count.load(std::sync::atomic::Ordering::Relaxed))
}

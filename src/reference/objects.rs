//! What recordings make on the device, for benches.

use crate::made;

/// Numbers of wgpu objects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Objects {
    /// Buffers, most of them of uniforms.
    pub buffers: u64,
    /// Bind groups.
    pub bind_groups: u64,
    /// Views of the caller's textures.
    pub texture_views: u64,
}

impl Objects {
    /// What all recordings of this process have made so far, on all devices. What `new` and `create…` make is in it where
    /// recordings make the like.
    pub fn made() -> Self {
        let [buffers, bind_groups, texture_views] = made::counts();
        Self {
            buffers,
            bind_groups,
            texture_views,
        }
    }

    /// What was made since.
    #[must_use]
    pub fn since(self, before: Self) -> Self {
        Self {
            buffers: self.buffers - before.buffers,
            bind_groups: self.bind_groups - before.bind_groups,
            texture_views: self.texture_views - before.texture_views,
        }
    }
}

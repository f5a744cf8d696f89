//! What the GPU reads: `Params` of `wgsl/emitters.wgsl`.

use bytemuck::{Pod, Zeroable};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct EmittersParams {
    pub(crate) capacity: u32,
    pub(crate) padding: [u32; 3],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: EmittersParams as "Params" in ["emitters"]
    { capacity }
);

impl EmittersParams {
    /// Of a cloud with room for so many pieces.
    pub fn new(capacity: u32) -> Self {
        Self {
            capacity,
            padding: [0; 3],
        }
    }
}

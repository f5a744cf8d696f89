//! The textures that passes make.

use wgpu::{
    Device, Extent3d, Texture, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages,
};

/// A 2-D texture with one sample per pixel. Sizes are checked before.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane<'a> {
    pub label: &'a str,
    pub format: TextureFormat,
    /// Width and height.
    pub size: [u32; 2],
    pub layers: u32,
    /// Mip levels.
    pub levels: u32,
    pub usage: TextureUsages,
}

impl<'a> Plane<'a> {
    /// One layer and one level.
    pub fn new(
        label: &'a str,
        format: TextureFormat,
        size: [u32; 2],
        usage: TextureUsages,
    ) -> Self {
        Self {
            label,
            format,
            size,
            layers: 1,
            levels: 1,
            usage,
        }
    }

    /// The one place with wgpu's descriptor of a texture.
    pub fn create(&self, device: &Device) -> Texture {
        let [width, height] = self.size;
        device.create_texture(&TextureDescriptor {
            label: Some(self.label),
            size: Extent3d {
                width,
                height,
                depth_or_array_layers: self.layers,
            },
            mip_level_count: self.levels,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format: self.format,
            usage: self.usage,
            view_formats: &[],
        })
    }
}

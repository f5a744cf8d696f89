//! Bind group layouts in one line a binding.

use wgpu::{
    BindGroup, BindGroupEntry, BindGroupLayout, BindGroupLayoutEntry, BindingResource, BindingType,
    Buffer, BufferBindingType, Device, ShaderStages, StorageTextureAccess, TextureFormat,
    TextureSampleType, TextureView, TextureViewDimension,
};

const fn buffer(ty: BufferBindingType) -> BindingType {
    BindingType::Buffer {
        ty,
        has_dynamic_offset: false,
        min_binding_size: None,
    }
}

/// `var<uniform>`.
pub(crate) const UNIFORM: BindingType = buffer(BufferBindingType::Uniform);
/// `var<storage, read>`.
pub(crate) const READ: BindingType = buffer(BufferBindingType::Storage { read_only: true });
/// `var<storage, read_write>`.
pub(crate) const WRITE: BindingType = buffer(BufferBindingType::Storage { read_only: false });

const fn texture(
    sample_type: TextureSampleType,
    view_dimension: TextureViewDimension,
) -> BindingType {
    BindingType::Texture {
        sample_type,
        view_dimension,
        multisampled: false,
    }
}

/// `texture_2d<f32>`, read with `textureLoad`; depth textures bind to it too.
pub(crate) const FLOAT_2D: BindingType = texture(
    TextureSampleType::Float { filterable: false },
    TextureViewDimension::D2,
);
/// `texture_2d_array<f32>`, read with `textureLoad`.
pub(crate) const FLOAT_ARRAY: BindingType = texture(
    TextureSampleType::Float { filterable: false },
    TextureViewDimension::D2Array,
);
/// `texture_2d<u32>`.
pub(crate) const UINT_2D: BindingType = texture(TextureSampleType::Uint, TextureViewDimension::D2);

/// `texture_2d_array<u32>`.
pub(crate) const UINT_ARRAY: BindingType =
    texture(TextureSampleType::Uint, TextureViewDimension::D2Array);

/// `texture_storage_2d<format, write>`, or the array of it.
pub(crate) const fn store(
    format: TextureFormat,
    view_dimension: TextureViewDimension,
) -> BindingType {
    BindingType::StorageTexture {
        access: StorageTextureAccess::WriteOnly,
        format,
        view_dimension,
    }
}

/// A layout of `entries` at the binding numbers given.
pub(crate) fn layout(
    device: &Device,
    label: &str,
    visibility: ShaderStages,
    entries: &[(u32, BindingType)],
) -> BindGroupLayout {
    let entries: Vec<_> = entries
        .iter()
        .map(|&(binding, ty)| BindGroupLayoutEntry {
            binding,
            visibility,
            ty,
            count: None,
        })
        .collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(label),
        entries: &entries,
    })
}

/// A bind group of `resources` at the binding numbers given.
pub(crate) fn group(
    device: &Device,
    label: &str,
    layout: &BindGroupLayout,
    resources: &[(u32, BindingResource<'_>)],
) -> BindGroup {
    let entries: Vec<_> = resources
        .iter()
        .map(|(binding, resource)| BindGroupEntry {
            binding: *binding,
            resource: resource.clone(),
        })
        .collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(label),
        layout,
        entries: &entries,
    })
}

/// A whole buffer as a binding.
pub(crate) fn whole(buffer: &Buffer) -> BindingResource<'_> {
    buffer.as_entire_binding()
}

/// A texture view as a binding.
pub(crate) const fn view(view: &TextureView) -> BindingResource<'_> {
    BindingResource::TextureView(view)
}

//! Bind group layouts in one line per binding.

use wgpu::{
    BindGroup, BindGroupEntry, BindGroupLayout, BindGroupLayoutEntry, BindingResource, BindingType,
    Buffer, BufferBinding, BufferBindingType, Device, ShaderStages, StorageTextureAccess,
    TextureFormat, TextureSampleType, TextureView, TextureViewDimension,
};

use crate::{
    error::{Error, check_limit},
    geometry::{check_size, check_usage},
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
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(label),
        layout,
        entries: &entries(resources),
    })
}

/// `resources` at the binding numbers given.
pub(crate) fn entries<'a>(resources: &[(u32, BindingResource<'a>)]) -> Vec<BindGroupEntry<'a>> {
    resources
        .iter()
        .map(|(binding, resource)| BindGroupEntry {
            binding: *binding,
            resource: resource.clone(),
        })
        .collect()
}

/// A whole buffer as a binding.
pub(crate) fn whole(buffer: &Buffer) -> BindingResource<'_> {
    buffer.as_entire_binding()
}

/// The first bytes of a buffer of the caller's as a binding. It may be of any size, and a binding is whole words.
pub(crate) fn first(buffer: &Buffer, bytes: u64) -> BindingResource<'_> {
    BindingResource::Buffer(BufferBinding {
        buffer,
        offset: 0,
        size: std::num::NonZeroU64::new(bytes),
    })
}

/// As many elements as a buffer of the caller's holds.
pub(crate) fn table<T>(buffer: &Buffer) -> BindingResource<'_> {
    first(buffer, table_bytes::<T>(buffer))
}

fn table_bytes<T>(buffer: &Buffer) -> u64 {
    let element = size_of::<T>() as u64;
    buffer.size() / element * element
}

/// Checks that a buffer can be bound as at least one element, and as all that it holds.
pub(crate) fn check_table<T>(
    device: &Device,
    name: &'static str,
    buffer: &Buffer,
) -> Result<(), Error> {
    check_usage(name, buffer)?;
    check_size(name, buffer, size_of::<T>() as u64)?;
    check_bytes(device, name, table_bytes::<T>(buffer))
}

/// Checks that a buffer's first bytes can be bound.
pub(crate) fn check_first(
    device: &Device,
    name: &'static str,
    buffer: &Buffer,
    bytes: u64,
) -> Result<(), Error> {
    check_usage(name, buffer)?;
    check_size(name, buffer, bytes)?;
    check_bytes(device, name, bytes)
}

fn check_bytes(device: &Device, name: &'static str, bytes: u64) -> Result<(), Error> {
    let limit = device.limits().max_storage_buffer_binding_size;
    check_limit("max_storage_buffer_binding_size", limit, bytes, name)
}

/// [`Error::Buffer`] for a buffer of the caller's that is one of those that the same pass uses otherwise.
pub(crate) fn check_own<'b>(
    name: &'static str,
    buffer: &Buffer,
    others: impl IntoIterator<Item = &'b Buffer>,
) -> Result<(), Error> {
    if others.into_iter().any(|other| other == buffer) {
        return Err(Error::Buffer {
            name,
            found: "a buffer that the pass uses otherwise".into(),
            needed: "a buffer of its own".into(),
        });
    }
    Ok(())
}

/// A texture view as a binding.
pub(crate) const fn view(view: &TextureView) -> BindingResource<'_> {
    BindingResource::TextureView(view)
}

//! A mesh as kernels bind and read it: `wgsl/common/mesh.wgsl`.

use bytemuck::{Pod, Zeroable};
use wgpu::{Buffer, Device};

use crate::{
    error::{Error, check_limit},
    geometry::{IndexFormat, Mesh, PositionFormat, TransformFormat},
    gpu::binding::{Resource, part},
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct MeshParams {
    pub(crate) vertex_offset: u32,
    pub(crate) vertex_stride: u32,
    pub(crate) vertex_format: u32,
    pub(crate) vertex_count: u32,
    pub(crate) index_offset: u32,
    pub(crate) index_format: u32,
    pub(crate) base_vertex: i32,
    pub(crate) triangles: u32,
    pub(crate) instance_offset: u32,
    pub(crate) instance_stride: u32,
    pub(crate) instance_format: u32,
    pub(crate) instances: u32,
    pub(crate) first_triangle: u32,
    pub(crate) material: u32,
    pub(crate) padding: [u32; 2],
}

crate::reflection::same_as_wgsl!(
    meshes_are_the_shaders: MeshParams as "Mesh" in ["surfelizer", "instanced_bvh"] {
        vertex_offset, vertex_stride, vertex_format, vertex_count, index_offset, index_format,
        base_vertex, triangles, instance_offset, instance_stride, instance_format, instances,
        first_triangle, material,
    }
);

/// A part of one of the caller's buffers as it is bound: bindings begin at multiples of 256 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Window {
    pub offset: u64,
    pub size: u64,
    /// Bytes from the start of the window to what was asked for.
    pub inside: u32,
}

impl Window {
    /// A window over `bytes` bytes from `offset` on, in a buffer of `limit` bytes.
    pub(crate) fn over(offset: u64, bytes: u64, limit: u64) -> Self {
        let start = offset & !255;
        // A binding is whole words. `Mesh::validate` saw to it that all that is read lies in the buffer's whole words;
        // a stride behind the last vertex may not.
        let size = (offset - start + bytes).next_multiple_of(4);
        Self {
            offset: start,
            size: size.min((limit & !3) - start),
            inside: (offset - start) as u32,
        }
    }
}

/// How a mesh is bound, and what its kernels are told.
pub(crate) struct MeshBinding {
    pub params: MeshParams,
    pub vertices: Window,
    pub indices: Option<Window>,
    pub instances: Option<Window>,
}

impl MeshBinding {
    pub fn new(mesh: &Mesh<'_>, first_triangle: u32) -> Self {
        let vertices = Window::over(
            mesh.vertices.offset,
            u64::from(mesh.vertices.count) * u64::from(mesh.vertices.stride),
            mesh.vertices.buffer.size(),
        );
        let index_bytes = |format| match format {
            IndexFormat::Uint16 => 2,
            IndexFormat::Uint32 => 4,
        };
        // The window begins at the draw's first index, so that a long buffer may exceed the binding limit.
        let indices = mesh.indices.map(|i| {
            let size = index_bytes(i.format);
            (
                Window::over(
                    i.offset + u64::from(mesh.first) * size,
                    u64::from(mesh.count) * size,
                    i.buffer.size(),
                ),
                size as u32,
                i.format,
            )
        });
        let instances = mesh.instances.map(|i| {
            Window::over(
                i.offset,
                u64::from(i.count) * u64::from(i.stride),
                i.buffer.size(),
            )
        });
        let params = MeshParams {
            vertex_offset: vertices.inside / 4,
            vertex_stride: mesh.vertices.stride / 4,
            vertex_format: match mesh.vertices.format {
                PositionFormat::Float32x3 => 0,
                PositionFormat::Float16x4 => 1,
            },
            vertex_count: mesh.vertices.count,
            index_offset: indices.map_or(mesh.first, |(w, size, _)| w.inside / size),
            index_format: indices.map_or(0, |(_, _, format)| match format {
                IndexFormat::Uint16 => 1,
                IndexFormat::Uint32 => 2,
            }),
            base_vertex: mesh.base_vertex,
            triangles: mesh.triangles(),
            instance_offset: instances.map_or(0, |w| w.inside / 4),
            instance_stride: mesh.instances.map_or(0, |i| i.stride / 4),
            instance_format: mesh.instances.map_or(0, |i| match i.format {
                TransformFormat::Mat4 => 1,
                TransformFormat::Rows3x4 => 2,
            }),
            instances: mesh.instance_count(),
            first_triangle,
            material: mesh.material,
            padding: [0; 2],
        };
        Self {
            params,
            vertices,
            indices: indices.map(|(w, _, _)| w),
            instances,
        }
    }
}

/// What a mesh binds of its buffers.
pub(crate) fn windows<'a>(mesh: &Mesh<'a>, bound: &MeshBinding) -> [Resource<'a>; 3] {
    let vertices = window(mesh.vertices.buffer, bound.vertices);
    // A layout has no optional bindings: what a mesh lacks is its vertices once more, and is never read.
    let indices = match (mesh.indices, bound.indices) {
        (Some(indices), Some(w)) => window(indices.buffer, w),
        _ => vertices.clone(),
    };
    let transforms = match (mesh.instances, bound.instances) {
        (Some(instances), Some(w)) => window(instances.buffer, w),
        _ => vertices.clone(),
    };
    [vertices, indices, transforms]
}

/// Checks that the device can bind as much.
pub(crate) fn check_bound(device: &Device, bound: &MeshBinding) -> Result<(), Error> {
    let limit = device.limits().max_storage_buffer_binding_size;
    for (size, why) in [
        (Some(bound.vertices.size), "Mesh::vertices"),
        (bound.indices.map(|w| w.size), "Mesh::indices"),
        (bound.instances.map(|w| w.size), "Mesh::instances"),
    ] {
        check_limit(
            "max_storage_buffer_binding_size",
            limit,
            size.unwrap_or(0),
            why,
        )?;
    }
    Ok(())
}

fn window(buffer: &Buffer, window: Window) -> Resource<'_> {
    part(buffer, window.offset, window.size)
}

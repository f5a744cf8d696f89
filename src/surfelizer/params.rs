//! What the GPU reads: `Params` and `Mesh` of `wgsl/surfelizer.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::settings::SurfelizerSettings;
use crate::{
    camera::{Camera, CameraParams},
    geometry::{IndexFormat, Mesh, PositionFormat, TransformFormat},
    surfel::CloudCapacity,
};

/// Views that one cloud can be culled by.
pub(crate) const MAX_VIEWS: usize = 4;

/// Stands for infinity: WGSL lets a compiler assume that floats are finite. Its products with scene scales up to
/// 1e15 are finite too.
const UNBOUNDED: f32 = 1e18;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SurfelizerParams {
    pub(crate) camera: CameraParams,
    pub(crate) planes: [[f32; 4]; 6 * MAX_VIEWS],
    pub(crate) view_count: u32,
    pub(crate) triangle_count: u32,
    pub(crate) piece_capacity: u32,
    pub(crate) surfel_capacity: u32,
    pub(crate) radius_pixels: f32,
    pub(crate) density: f32,
    pub(crate) reach_radii: f32,
    pub(crate) reach_world: f32,
    pub(crate) origin_high: [f32; 3],
    pub(crate) placement: u32,
    pub(crate) origin_low: [f32; 3],
    pub(crate) without_vertices: u32,
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: SurfelizerParams as "Params" in ["surfelizer"] {
        camera, planes, view_count, triangle_count, piece_capacity, surfel_capacity,
        radius_pixels, density, reach_radii, reach_world, origin_high, placement, origin_low,
        without_vertices,
    }
);

impl SurfelizerParams {
    pub fn new(
        settings: &SurfelizerSettings,
        camera: &Camera,
        views: &[Camera],
        capacity: CloudCapacity,
        without_vertices: u32,
    ) -> Self {
        let origin = camera.focus();
        let mut planes = [[0.0; 4]; 6 * MAX_VIEWS];
        let all = views.iter().flat_map(|view| view.frustum(origin));
        for (to, plane) in planes.iter_mut().zip(all) {
            *to = plane.as_vec4().to_array();
        }
        let high = origin.as_vec3();
        Self {
            camera: camera.params(origin),
            planes,
            view_count: views.len() as u32,
            triangle_count: capacity.triangles,
            piece_capacity: capacity.pieces,
            surfel_capacity: capacity.surfels,
            radius_pixels: settings.radius_pixels,
            density: settings.density.min(UNBOUNDED),
            reach_radii: settings.reach.radii.min(UNBOUNDED),
            reach_world: settings.reach.world.min(UNBOUNDED),
            origin_high: high.to_array(),
            placement: settings.placement.code(),
            origin_low: (origin - high.as_dvec3()).as_vec3().to_array(),
            without_vertices,
        }
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct MeshParams {
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
    meshes_are_the_shaders: MeshParams as "Mesh" in ["surfelizer"] {
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
    fn over(offset: u64, bytes: u64, limit: u64) -> Self {
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

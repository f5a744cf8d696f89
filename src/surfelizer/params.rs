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
    camera: CameraParams,
    planes: [[f32; 4]; 6 * MAX_VIEWS],
    view_count: u32,
    triangle_count: u32,
    piece_capacity: u32,
    surfel_capacity: u32,
    radius_pixels: f32,
    density: f32,
    reach_radii: f32,
    reach_world: f32,
    origin_high: [f32; 3],
    placement: u32,
    origin_low: [f32; 3],
    padding: u32,
}

impl SurfelizerParams {
    pub fn new(
        settings: &SurfelizerSettings,
        camera: &Camera,
        views: &[Camera],
        capacity: CloudCapacity,
    ) -> Self {
        let origin = camera.eye();
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
            padding: 0,
        }
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct MeshParams {
    vertex_offset: u32,
    vertex_stride: u32,
    vertex_format: u32,
    vertex_count: u32,
    index_offset: u32,
    index_format: u32,
    base_vertex: i32,
    triangles: u32,
    instance_offset: u32,
    instance_stride: u32,
    instance_format: u32,
    instances: u32,
    first_triangle: u32,
    material: u32,
    padding: [u32; 2],
}

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
        // Whole words, at least one; a trailing u16 index is read with its neighbour, or with padding bytes that
        // wgpu keeps behind every buffer's end.
        let size = (offset - start + bytes).next_multiple_of(4).max(4);
        Self {
            offset: start,
            size: size.min(limit - start),
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

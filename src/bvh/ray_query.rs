//! The hierarchy that a device builds and traverses itself, over a cloud's pieces (`wgsl/ray_query_vertices.wgsl`,
//! `wgsl/common/ray_query_traverse.wgsl`).
//!
//! A structure of wgpu's takes the transforms of its instances from the CPU. The caller's stand in buffers on the GPU, where the
//! Surfelizer has placed every triangle by them already: there is one geometry, the pieces, and one instance of it.

use wgpu::{
    AccelerationStructureFlags, AccelerationStructureGeometryFlags,
    AccelerationStructureUpdateMode, Blas, BlasBuildEntry, BlasGeometries,
    BlasGeometrySizeDescriptors, BlasTriangleGeometry, BlasTriangleGeometrySizeDescriptor, Buffer,
    BufferUsages, CommandEncoder, ComputePipeline, CreateBlasDescriptor, CreateTlasDescriptor,
    Device, Features, Limits, PipelineCache, Tlas, TlasInstance, VertexFormat,
};

use crate::{
    effect::Listing,
    error::{Error, check_limit},
    gpu::{
        Timestamps, WORKGROUP,
        binding::{Kept, Layout, whole},
        dispatch, end_pass, first_pass, shader, storage,
    },
};

const LABEL: &str = "deep-screen-space ray query";

/// Corners of a piece, and bytes of a corner.
const CORNERS: u32 = 3;
const CORNER_BYTES: u64 = 12;

/// What a device has to have been made with.
pub(crate) const FEATURE: Features = Features::EXPERIMENTAL_RAY_QUERY;

/// A device's own structure over up to so many pieces.
#[derive(Debug)]
pub(crate) struct DeviceBvh {
    capacity: u32,
    vertices: Buffer,
    size: BlasTriangleGeometrySizeDescriptor,
    geometry: Blas,
    /// What rays traverse.
    pub scene: Tlas,
    kept: Kept,
}

impl DeviceBvh {
    /// Room for `capacity` pieces.
    pub fn new(device: &Device, capacity: u32) -> Result<Self, Error> {
        let vertex_count = CORNERS * capacity;
        // By wgpu 30 it is vertices that the limit counts.
        check_limit(
            "max_blas_primitive_count",
            device.limits().max_blas_primitive_count.into(),
            vertex_count.into(),
            LABEL,
        )?;
        let vertices = storage(
            device,
            "deep-screen-space corners of pieces",
            CORNER_BYTES * u64::from(vertex_count),
            BufferUsages::BLAS_INPUT,
        )?;
        let size = BlasTriangleGeometrySizeDescriptor {
            vertex_format: VertexFormat::Float32x3,
            vertex_count,
            index_format: None,
            index_count: None,
            flags: AccelerationStructureGeometryFlags::OPAQUE,
        };
        // Built anew each frame, but by as many rays as a frame has the better tree is worth it: `scripts/ray_query.sh --times`.
        let flags = AccelerationStructureFlags::PREFER_FAST_TRACE;
        let update_mode = AccelerationStructureUpdateMode::Build;
        let geometry = device.create_blas(
            &CreateBlasDescriptor {
                label: Some(LABEL),
                flags,
                update_mode,
            },
            BlasGeometrySizeDescriptors::Triangles {
                descriptors: vec![size.clone()],
            },
        );
        let mut scene = device.create_tlas(&CreateTlasDescriptor {
            label: Some(LABEL),
            max_instances: 1,
            flags,
            update_mode,
        });
        let in_place = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0.];
        scene[0] = Some(TlasInstance::new(&geometry, in_place, 0, 0xff));
        Ok(Self {
            capacity,
            vertices,
            size,
            geometry,
            scene,
            kept: Kept::default(),
        })
    }

    pub fn capacity(&self) -> u32 {
        self.capacity
    }

    /// GPU memory, bytes: without the device's structure, whose size wgpu does not tell.
    pub fn memory_bytes(&self) -> u64 {
        self.vertices.size()
    }
}

/// Whether a device can trace rays: [`Error::Feature`] and [`Error::Limit`] where it was not made for it.
pub(crate) fn check_device(device: &Device) -> Result<(), Error> {
    const WHY: &str = "Primitives::RayQuery";
    if !device.features().contains(FEATURE) {
        return Err(Error::Feature {
            feature: FEATURE,
            why: WHY,
        });
    }
    let Limits {
        max_acceleration_structures_per_shader_stage: structures,
        max_blas_geometry_count: geometries,
        max_tlas_instance_count: instances,
        ..
    } = device.limits();
    for (limit, available) in [
        ("max_acceleration_structures_per_shader_stage", structures),
        ("max_blas_geometry_count", geometries),
        ("max_tlas_instance_count", instances),
    ] {
        check_limit(limit, available.into(), 1, WHY)?;
    }
    Ok(())
}

/// The pipeline.
#[derive(Debug)]
pub(crate) struct DeviceBvhPass {
    layout: Layout,
    place_corners: ComputePipeline,
}

fn source() -> Result<String, Error> {
    let text = include_str!("../../wgsl/ray_query_vertices.wgsl");
    shader::assemble("ray_query_vertices", text, &[], &[])
}

impl DeviceBvhPass {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let module = shader::create(device, LABEL, source()?);
        let (layout, place_corners) = module.kernel(device, "place_corners", &[], cache);
        Ok(Self {
            layout,
            place_corners,
        })
    }

    /// Records a pass and the building after it. `pieces` are the triangles, with the counters of what there are.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        (pieces, counters): (&Buffer, &Buffer),
        bvh: &DeviceBvh,
        timestamps: Option<Timestamps<'_>>,
    ) {
        let resources = [
            ("counters", whole(counters)),
            ("pieces", whole(pieces)),
            ("vertices", whole(&bvh.vertices)),
        ];
        let group = bvh.kept.groups(device).next(&self.layout, &resources);
        let mut pass = first_pass(encoder, LABEL, timestamps);
        let groups = bvh.capacity.div_ceil(WORKGROUP);
        dispatch(&mut pass, &self.place_corners, &group, groups);
        drop(pass);
        encoder.build_acceleration_structures(
            [&BlasBuildEntry {
                blas: &bvh.geometry,
                geometry: BlasGeometries::TriangleGeometries(vec![BlasTriangleGeometry {
                    size: &bvh.size,
                    vertex_buffer: &bvh.vertices,
                    first_vertex: 0,
                    vertex_stride: CORNER_BYTES,
                    index_buffer: None,
                    first_index: None,
                    transform_buffer: None,
                    transform_buffer_offset: None,
                }]),
            }],
            [&bvh.scene],
        );
        end_pass(encoder, LABEL, timestamps);
    }
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add("ray_query_vertices", source()?);
    Ok(())
}

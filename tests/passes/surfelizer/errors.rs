//! What cannot be honoured is refused by name, before anything is recorded.

use deep_screen_space::{
    CloudCapacity, Error, Geometry, IndexFormat, Indices, Instances, Mesh, Reach, SurfelizerInput,
    SurfelizerSettings, TransformFormat, Vertices, glam::DVec3, wgpu::BufferUsages,
};

use super::harness::{Soup, Task, fixture, from_above, plain_mesh, sphere};

/// The name that an error carries.
fn name(error: &Error) -> &'static str {
    match error {
        Error::Setting { field, .. } => field,
        Error::Buffer { name, .. } => name,
        Error::Limit { limit, .. } => limit,
        other => panic!("{other}"),
    }
}

#[track_caller]
fn refused(meshes: &[Mesh<'_>], task: &Task<'_>, expected: &str) {
    match fixture().try_record(meshes, task) {
        Ok(_) => panic!("accepted, expected a refusal of {expected}: {task:?}"),
        Err(error) => assert_eq!(name(&error), expected, "{error}"),
    }
}

#[test]
fn settings() {
    let camera = from_above(1.0);
    let good = SurfelizerSettings::default();
    let refuse = |settings, expected| refused(&[], &Task::new(&camera, settings), expected);
    for radius_pixels in [0.0, -1.0, 0.049, 1001.0, f32::INFINITY, f32::NAN] {
        refuse(
            SurfelizerSettings {
                radius_pixels,
                ..good
            },
            "SurfelizerSettings::radius_pixels",
        );
    }
    for density in [0.0, 0.009, -4.0, f32::NAN, f32::NEG_INFINITY] {
        refuse(
            SurfelizerSettings { density, ..good },
            "SurfelizerSettings::density",
        );
    }
    for bad in [-0.1, f32::NAN, f32::NEG_INFINITY] {
        let reach = |radii, world| SurfelizerSettings {
            reach: Reach { radii, world },
            ..good
        };
        refuse(reach(bad, 1.0), "Reach::radii");
        refuse(reach(1.0, bad), "Reach::world");
    }
    let views = [camera; 5];
    let mut task = Task::new(&camera, good);
    task.cull_by = &views;
    refused(&[], &task, "SurfelizerInput::cull_by");
    task.cull_by = &views[..4];
    assert!(fixture().try_record(&[], &task).is_ok());
    for (radius_pixels, density) in [(0.05, 0.01), (1000.0, f32::INFINITY)] {
        let edge = SurfelizerSettings {
            radius_pixels,
            density,
            ..good
        };
        assert!(fixture().try_record(&[], &Task::new(&camera, edge)).is_ok());
    }
}

#[test]
fn capacities() {
    let camera = from_above(1.0);
    let good = CloudCapacity {
        surfels: 1,
        pieces: 1,
        triangles: 0,
    };
    let mut task = Task::new(&camera, SurfelizerSettings::default());
    for (capacity, expected) in [
        (
            CloudCapacity {
                surfels: (1 << 23) + 1,
                ..good
            },
            "CloudCapacity::surfels",
        ),
        (CloudCapacity { pieces: 0, ..good }, "CloudCapacity::pieces"),
        (
            CloudCapacity {
                pieces: u32::MAX,
                ..good
            },
            "CloudCapacity::pieces",
        ),
        (
            CloudCapacity {
                triangles: (1 << 25) + 1,
                ..good
            },
            "CloudCapacity::triangles",
        ),
    ] {
        task.capacity = capacity;
        refused(&[], &task, expected);
    }
    let limit = fixture()
        .gpu
        .device
        .limits()
        .max_storage_buffer_binding_size;
    task.capacity = CloudCapacity {
        pieces: 1 << 23,
        ..good
    };
    if limit < 48 << 23 {
        refused(&[], &task, "max_storage_buffer_binding_size");
    }
    task.capacity = good;
    assert!(fixture().try_record(&[], &task).is_ok());

    let soup = Soup::of(&sphere(DVec3::ZERO, 1.0, 4));
    let uploaded = fixture().upload(&soup);
    let count = soup.0.len() as u32;
    task.capacity.triangles = count - 1;
    refused(&[uploaded.mesh()], &task, "CloudCapacity::triangles");
    // The sum over all instances is more than 2^32.
    let many = Mesh {
        instances: Some(Instances {
            buffer: &uploaded.buffer,
            offset: 0,
            stride: 0,
            format: TransformFormat::Mat4,
            count: u32::MAX,
        }),
        ..uploaded.mesh()
    };
    refused(&[many], &task, "Mesh::instances");
    task.capacity.triangles = count;
    assert!(fixture().try_record(&[uploaded.mesh()], &task).is_ok());
    // No surfels but their pieces.
    task.capacity.surfels = 0;
    task.capacity.pieces = 1 << 10;
    let cloud = fixture().record(&[uploaded.mesh()], &task);
    assert_eq!(cloud.counts, soup.mirrored(&task).counts);
    assert!(cloud.counts.pieces >= count && cloud.counts.overflow() >= count);
    assert_eq!(cloud.surfels, []);
}

#[test]
fn buffers() {
    let gpu = &fixture().gpu;
    let camera = from_above(1.0);
    let task = Task::new(&camera, SurfelizerSettings::default());
    let storage = gpu.buffer(&[0.0_f32; 256], BufferUsages::STORAGE);
    let vertex_only = gpu.buffer(&[0.0_f32; 256], BufferUsages::VERTEX);
    let uploaded = fixture().upload(&Soup(vec![[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]));
    let good = uploaded.mesh();
    assert!(fixture().try_record(&[good], &task).is_ok());

    let mut vertices = good.vertices;
    let mut refuse_vertices = |change: &dyn Fn(&mut Vertices<'_>)| {
        vertices = good.vertices;
        change(&mut vertices);
        refused(&[Mesh { vertices, ..good }], &task, "Mesh::vertices");
    };
    refuse_vertices(&|v| v.offset = 2);
    refuse_vertices(&|v| v.offset = 4);
    refuse_vertices(&|v| v.offset = u64::MAX - 3);
    refuse_vertices(&|v| v.stride = 8);
    refuse_vertices(&|v| v.stride = 14);
    refuse_vertices(&|v| v.stride = u32::MAX - 3);
    refuse_vertices(&|v| v.count = 4);
    refuse_vertices(&|v| v.count = u32::MAX);
    let vertices = Vertices {
        buffer: &vertex_only,
        ..good.vertices
    };
    refused(&[Mesh { vertices, ..good }], &task, "Mesh::vertices");

    let indices = |buffer, offset, format| Indices {
        buffer,
        offset,
        format,
    };
    for (indices, first, count) in [
        (indices(&vertex_only, 0, IndexFormat::Uint16), 0, 3),
        (indices(&storage, 1, IndexFormat::Uint16), 0, 3),
        (indices(&storage, 2, IndexFormat::Uint32), 0, 3),
        (indices(&storage, 0, IndexFormat::Uint32), 0, 258),
        (indices(&storage, 0, IndexFormat::Uint16), 510, 3),
        (
            indices(&storage, 0, IndexFormat::Uint32),
            u32::MAX,
            u32::MAX,
        ),
        (indices(&storage, u64::MAX - 3, IndexFormat::Uint32), 0, 3),
        (indices(&storage, 1024, IndexFormat::Uint32), 0, 3),
    ] {
        let mesh = Mesh {
            indices: Some(indices),
            first,
            count,
            ..good
        };
        refused(&[mesh], &task, "Mesh::indices");
    }

    let instances = Instances {
        buffer: &storage,
        offset: 0,
        stride: 64,
        format: TransformFormat::Mat4,
        count: 16,
    };
    let mesh = |instances| Mesh {
        instances: Some(instances),
        ..good
    };
    assert!(fixture().try_record(&[mesh(instances)], &task).is_ok());
    for bad in [
        Instances {
            count: 17,
            ..instances
        },
        Instances {
            stride: 60,
            ..instances
        },
        Instances {
            stride: 66,
            ..instances
        },
        Instances {
            offset: 4,
            ..instances
        },
        Instances {
            offset: 1,
            ..instances
        },
        Instances {
            buffer: &vertex_only,
            ..instances
        },
        Instances {
            stride: 44,
            format: TransformFormat::Rows3x4,
            ..instances
        },
    ] {
        refused(&[mesh(bad)], &task, "Mesh::instances");
    }
}

/// A binding is whole words. Three u16 indices in six bytes cannot be read; in eight, or from the middle of a longer
/// buffer that ends within a word, they can.
#[test]
fn buffers_that_end_within_a_word() {
    let gpu = &fixture().gpu;
    let camera = from_above(1.0);
    let task = Task::new(&camera, SurfelizerSettings::default());
    let bytes = |contents: &[u8]| {
        // `Gpu::buffer` pads.
        let buffer = gpu
            .device
            .create_buffer(&deep_screen_space::wgpu::BufferDescriptor {
                label: None,
                size: contents.len() as u64,
                usage: BufferUsages::STORAGE | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
        let whole = contents.len() & !3;
        gpu.queue.write_buffer(&buffer, 0, &contents[..whole]);
        buffer
    };
    let points: [[f32; 3]; 3] = [[0.0; 3], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]];
    let mut vertex_bytes = bytemuck::bytes_of(&points).to_vec();
    vertex_bytes.extend([0; 3]);
    let vertices = bytes(&vertex_bytes);
    let mut mesh = plain_mesh(&vertices, 3);
    // A stride that the last vertex does not fill ends beyond the buffer, whose size is odd.
    mesh.count = 3;
    assert!(fixture().record(&[mesh], &task).counts.stored > 0);
    mesh.vertices.stride = 36;
    mesh.vertices.count = 1;
    assert_eq!(fixture().record(&[mesh], &task).counts.rejected, 1);
    mesh.vertices.stride = 12;
    mesh.vertices.count = 3;

    let short: Vec<u8> = [0_u16, 1, 2].iter().flat_map(|i| i.to_le_bytes()).collect();
    let six = bytes(&short);
    mesh.indices = Some(Indices {
        buffer: &six,
        offset: 0,
        format: IndexFormat::Uint16,
    });
    refused(&[mesh], &task, "Mesh::indices");
    let mut long = short.clone();
    long.extend([0; 4]);
    let ten = bytes(&long);
    mesh.indices = Some(Indices {
        buffer: &ten,
        offset: 0,
        format: IndexFormat::Uint16,
    });
    assert!(fixture().record(&[mesh], &task).counts.stored > 0);
}

/// A mesh made of the buffers that the recording writes.
#[test]
fn a_cloud_is_not_made_of_itself() {
    let camera = from_above(1.0);
    let task = Task::new(&camera, SurfelizerSettings::default());
    let uploaded = fixture().upload(&Soup::of(&sphere(DVec3::ZERO, 0.5, 4)));
    let gpu = &fixture().gpu;
    let first = fixture()
        .try_record(&[uploaded.mesh()], &task)
        .expect("valid");
    let mut second = fixture()
        .surfelizer
        .create_cloud(&gpu.device, task.capacity)
        .expect("valid");
    // Another cloud's pieces are triangles like any: three corners of 16 bytes.
    let count = fixture().counts(&first).pieces * 3;
    let own = second.pieces().clone();
    for (source, accepted) in [(first.pieces(), true), (&own, false)] {
        let mut mesh = plain_mesh(source, count);
        mesh.vertices.stride = 16;
        let mut encoder = gpu.encoder();
        let result = fixture().surfelizer.record(
            &gpu.device,
            &mut encoder,
            &SurfelizerInput::new(Geometry { meshes: &[mesh] }, &camera),
            &task.settings,
            &mut second,
        );
        gpu.finish(encoder);
        match result {
            Ok(()) => assert!(accepted, "reads what it writes"),
            Err(error) => assert!(!accepted && name(&error) == "Mesh::vertices", "{error}"),
        }
    }
}

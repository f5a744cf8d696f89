//! The caller's buffers as they come: every layout gives the surfels of the triangles that it describes.

use deep_screen_space::{
    Camera, IndexFormat, Indices, Instances, Mesh, PositionFormat, SurfelizerSettings,
    TransformFormat, Vertices,
    glam::{DAffine3, DMat3, DVec3},
    reference::{packing::unpack_normal, surfelizer as mirror},
    wgpu::{Buffer, BufferUsages},
};

use super::{
    comparison::assert_alike,
    harness::{Task, fixture, look_at, sphere},
};
use support::raster::perspective;

/// Distinct vertices and the indices of a sphere about (0.5, 0.25, 0), at multiples of 1/256 so that f16 holds them.
fn indexed_sphere() -> (Vec<DVec3>, Vec<u32>) {
    let mut vertices: Vec<DVec3> = Vec::new();
    let mut indices = Vec::new();
    for corner in sphere(DVec3::new(0.5, 0.25, 0.0), 0.7, 8).concat() {
        let corner = (corner * 256.0).round() / 256.0;
        let index = vertices
            .iter()
            .position(|v| *v == corner)
            .unwrap_or_else(|| {
                vertices.push(corner);
                vertices.len() - 1
            });
        indices.push(index as u32);
    }
    (vertices, indices)
}

fn world_triangles(vertices: &[DVec3], indices: &[u32]) -> Vec<[DVec3; 3]> {
    indices
        .chunks_exact(3)
        .map(|t| [0, 1, 2].map(|k| vertices[t[k] as usize]))
        .collect()
}

fn camera() -> Camera {
    look_at(
        DVec3::new(0.3, 1.0, 4.0),
        DVec3::ZERO,
        perspective(50.0, 1.0, 0.1),
    )
}

fn task(camera: &Camera) -> Task<'_> {
    Task::new(
        camera,
        SurfelizerSettings {
            radius_pixels: 1.0,
            density: f32::INFINITY,
            ..SurfelizerSettings::default()
        },
    )
}

#[track_caller]
fn assert_gives(meshes: &[Mesh<'_>], triangles: &[[DVec3; 3]], materials: &[u32], inputs: &str) {
    let camera = camera();
    let task = task(&camera);
    let cloud = fixture().record(meshes, &task);
    let expected = mirror::surfelize(
        &task.settings,
        &camera,
        &[],
        task.capacity,
        triangles,
        materials,
    );
    assert!(
        expected.surfels.len() >= triangles.len() / 2,
        "{inputs}: {:?}",
        expected.counts
    );
    assert_alike(&cloud, &expected, inputs);
}

/// A vertex buffer with `before` bytes ahead and `stride` bytes per vertex; what lies between holds NaN.
fn vertex_buffer(
    vertices: &[DVec3],
    format: PositionFormat,
    before: usize,
    stride: usize,
) -> Buffer {
    let mut bytes = vec![0xff_u8; before];
    for v in vertices {
        let start = bytes.len();
        match format {
            PositionFormat::Float32x3 => {
                bytes.extend(v.as_vec3().to_array().iter().flat_map(|x| x.to_le_bytes()));
            }
            PositionFormat::Float16x4 => {
                bytes.extend(
                    v.as_vec3()
                        .to_array()
                        .iter()
                        .flat_map(|x| half(*x).to_le_bytes()),
                );
                bytes.extend([0xff; 2]);
            }
        }
        bytes.resize(start + stride, 0xff);
    }
    fixture().gpu.buffer(&bytes, BufferUsages::STORAGE)
}

/// A number that f16 holds as a normal one, or zero.
fn half(x: f32) -> u16 {
    let bits = x.to_bits();
    let sign = (bits >> 16) & 0x8000;
    if x == 0.0 {
        return sign as u16;
    }
    let exponent = ((bits >> 23) & 0xff) - 112;
    assert!(
        (1..31).contains(&exponent) && bits.trailing_zeros() >= 13,
        "{x}"
    );
    (sign | exponent << 10 | (bits >> 13) & 0x3ff) as u16
}

fn index_buffer(indices: &[u32], format: IndexFormat, before: usize) -> Buffer {
    let mut bytes = vec![0xff_u8; before];
    for &i in indices {
        match format {
            IndexFormat::Uint16 => bytes.extend((i as u16).to_le_bytes()),
            IndexFormat::Uint32 => bytes.extend(i.to_le_bytes()),
        }
    }
    fixture().gpu.buffer(&bytes, BufferUsages::STORAGE)
}

fn mesh(
    buffer: &Buffer,
    format: PositionFormat,
    offset: u64,
    stride: u32,
    count: usize,
) -> Mesh<'_> {
    Mesh {
        vertices: Vertices {
            buffer,
            offset,
            stride,
            format,
            count: count as u32,
        },
        indices: None,
        first: 0,
        count: 0,
        base_vertex: 0,
        instances: None,
        material: 0,
    }
}

#[test]
fn positions() {
    let (vertices, indices) = indexed_sphere();
    let expected = world_triangles(&vertices, &indices);
    let index = index_buffer(&indices, IndexFormat::Uint32, 0);
    for (format, offset, stride) in [
        (PositionFormat::Float32x3, 0, 12),
        (PositionFormat::Float32x3, 4, 20),
        (PositionFormat::Float32x3, 260, 32),
        (PositionFormat::Float32x3, 768, 16),
        (PositionFormat::Float16x4, 0, 8),
        (PositionFormat::Float16x4, 1028, 12),
    ] {
        let buffer = vertex_buffer(&vertices, format, offset, stride);
        let mut mesh = mesh(
            &buffer,
            format,
            offset as u64,
            stride as u32,
            vertices.len(),
        );
        mesh.indices = Some(Indices {
            buffer: &index,
            offset: 0,
            format: IndexFormat::Uint32,
        });
        mesh.count = indices.len() as u32;
        assert_gives(
            &[mesh],
            &expected,
            &vec![0; expected.len()],
            &format!("{format:?}, offset {offset}, stride {stride}"),
        );
    }
}

/// Offsets that are odd multiples of the index's size, first indices, base vertices of either sign.
#[test]
fn indices() {
    let (vertices, indices) = indexed_sphere();
    let buffer = vertex_buffer(&vertices, PositionFormat::Float32x3, 0, 12);
    for format in [IndexFormat::Uint16, IndexFormat::Uint32] {
        let size = if format == IndexFormat::Uint16 { 2 } else { 4 };
        for (offset, first, count, base) in [
            (0, 0, indices.len(), 0),
            (1, 0, indices.len(), 0),
            (131, 3, 27, 0),
            (0, 301, 60, 3),
            (3, 129, 63, 0),
            (1, 0, 60, -5),
            // The last two indices are of no whole triangle.
            (1, 1, 50, 0),
        ] {
            // A positive base: the vertices are numbered from it on, and the indices of those before it fall away.
            let used = &indices[first..first + count];
            if base > 0 {
                assert!(used.iter().all(|&i| i >= base as u32), "{used:?}");
            }
            let stored: Vec<u32> = indices
                .iter()
                .map(|&i| i.wrapping_sub(base as u32))
                .collect();
            let index = index_buffer(&stored, format, offset * size);
            let mut mesh = mesh(&buffer, PositionFormat::Float32x3, 0, 12, vertices.len());
            mesh.indices = Some(Indices {
                buffer: &index,
                offset: (offset * size) as u64,
                format,
            });
            mesh.first = first as u32;
            mesh.count = count as u32;
            mesh.base_vertex = base;
            let expected = world_triangles(&vertices, &indices[first..first + count]);
            assert_gives(
                &[mesh],
                &expected,
                &vec![0; expected.len()],
                &format!("{format:?}, offset {offset}, first {first}, count {count}, base {base}"),
            );
        }
    }
    let flat: Vec<DVec3> = world_triangles(&vertices, &indices).concat();
    let buffer = vertex_buffer(&flat, PositionFormat::Float32x3, 0, 12);
    let mut mesh = mesh(&buffer, PositionFormat::Float32x3, 0, 12, flat.len());
    mesh.first = 4;
    mesh.count = 31;
    mesh.base_vertex = -1;
    let expected: Vec<[DVec3; 3]> = flat[3..33]
        .chunks_exact(3)
        .map(|t| [t[0], t[1], t[2]])
        .collect();
    assert_gives(&[mesh], &expected, &[0; 10], "no indices");
}

/// Rigid, scaled, sheared and mirrored transforms. A mirrored sphere's normals still point outward.
#[test]
fn instances() {
    let (vertices, indices) = indexed_sphere();
    let buffer = vertex_buffer(&vertices, PositionFormat::Float32x3, 0, 12);
    let index = index_buffer(&indices, IndexFormat::Uint16, 2);
    let transforms = [
        DAffine3::IDENTITY,
        DAffine3::from_translation(DVec3::new(-1.0, 0.5, -2.0)),
        DAffine3::from_mat3_translation(
            DMat3::from_rotation_y(0.6) * DMat3::from_diagonal(DVec3::new(0.5, 1.5, 0.25)),
            DVec3::new(1.0, -0.5, -1.0),
        ),
        DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0))),
        DAffine3::from_mat3_translation(
            DMat3::from_cols(
                DVec3::X,
                DVec3::new(0.5, -0.8, 0.0),
                DVec3::new(0.0, 0.3, 1.0),
            ),
            DVec3::new(0.0, 1.0, -3.0),
        ),
    ]
    .map(|t| {
        // As f32 holds it.
        DAffine3::from_cols_array(&t.to_cols_array().map(|x| f64::from(x as f32)))
    });
    for (format, before, stride) in [
        (TransformFormat::Mat4, 0, 64),
        (TransformFormat::Mat4, 12, 80),
        (TransformFormat::Rows3x4, 0, 48),
        (TransformFormat::Rows3x4, 260, 52),
    ] {
        let mut bytes = vec![0xff_u8; before];
        for t in &transforms {
            let start = bytes.len();
            // The last row of a Mat4 is ignored: it holds NaN.
            let column = |i: usize| {
                [
                    t.matrix3.x_axis,
                    t.matrix3.y_axis,
                    t.matrix3.z_axis,
                    t.translation,
                ][i]
            };
            let elements: Vec<f64> = match format {
                TransformFormat::Mat4 => (0..4)
                    .flat_map(|i| column(i).extend(f64::NAN).to_array())
                    .collect(),
                TransformFormat::Rows3x4 => (0..3)
                    .flat_map(|r| (0..4).map(move |i| column(i)[r]))
                    .collect(),
            };
            bytes.extend(elements.iter().flat_map(|&x| (x as f32).to_le_bytes()));
            bytes.resize(start + stride, 0xff);
        }
        let instances = fixture().gpu.buffer(&bytes, BufferUsages::STORAGE);
        let mut mesh = mesh(&buffer, PositionFormat::Float32x3, 0, 12, vertices.len());
        mesh.indices = Some(Indices {
            buffer: &index,
            offset: 2,
            format: IndexFormat::Uint16,
        });
        mesh.count = indices.len() as u32;
        mesh.instances = Some(Instances {
            buffer: &instances,
            offset: before as u64,
            stride: stride as u32,
            format,
            count: transforms.len() as u32,
        });
        let expected: Vec<[DVec3; 3]> = transforms
            .iter()
            .flat_map(|t| {
                world_triangles(&vertices, &indices)
                    .into_iter()
                    .map(|corners| {
                        let [a, b, c] = corners.map(|p| t.transform_point3(p));
                        if t.matrix3.determinant() < 0.0 {
                            [a, c, b]
                        } else {
                            [a, b, c]
                        }
                    })
            })
            .collect();
        let inputs = format!("{format:?}, offset {before}, stride {stride}");
        assert_gives(&[mesh], &expected, &vec![0; expected.len()], &inputs);

        let camera = camera();
        let cloud = fixture().record(&[mesh], &task(&camera));
        let each = (indices.len() / 3) as u32;
        for surfel in &cloud.surfels {
            let instance = cloud.pieces[surfel.piece as usize].triangle / each;
            let centre = transforms[instance as usize].transform_point3(DVec3::new(0.5, 0.25, 0.0));
            let outward = surfel.position + camera.focus() - centre;
            assert!(
                unpack_normal(surfel.normal).dot(outward) > 0.0,
                "{inputs}, instance {instance}: {surfel:?} faces inward"
            );
        }
    }
}

/// Several meshes number their triangles in order and carry their own materials; empty ones take no numbers.
#[test]
fn meshes_side_by_side() {
    let (vertices, indices) = indexed_sphere();
    let buffer = vertex_buffer(&vertices, PositionFormat::Float32x3, 0, 12);
    let index = index_buffer(&indices, IndexFormat::Uint32, 0);
    let part = |first: u32, count: u32, material| Mesh {
        indices: Some(Indices {
            buffer: &index,
            offset: 0,
            format: IndexFormat::Uint32,
        }),
        first,
        count,
        material,
        ..mesh(&buffer, PositionFormat::Float32x3, 0, 12, vertices.len())
    };
    let empty = part(0, 0, 9);
    let no_instance = Mesh {
        instances: Some(Instances {
            buffer: &buffer,
            offset: 0,
            stride: 64,
            format: TransformFormat::Mat4,
            count: 0,
        }),
        ..part(0, 30, 9)
    };
    let expected = world_triangles(&vertices, &indices);
    let materials: Vec<u32> = (0..expected.len())
        .map(|t| if t < 10 { 3 } else { 70_000 })
        .collect();
    let rest = indices.len() as u32 - 30;
    assert_gives(
        &[
            empty,
            part(0, 30, 3),
            no_instance,
            part(0, 2, 9),
            part(30, rest, 70_000),
            empty,
        ],
        &expected,
        &materials,
        "parts",
    );
    let camera = camera();
    for meshes in [&[][..], &[empty][..], &[no_instance][..]] {
        let cloud = fixture().record(meshes, &task(&camera));
        assert_eq!(cloud, mirror::Cloud::default());
    }
}

/// Indices that give no vertex drop their triangle, whatever their sum with the base vertex wraps around to.
#[test]
fn indices_out_of_range_are_rejected() {
    let (vertices, _) = indexed_sphere();
    let buffer = vertex_buffer(&vertices, PositionFormat::Float32x3, 0, 12);
    let count = vertices.len() as u32;
    let rejected = |mesh: Mesh<'_>| {
        let camera = camera();
        let cloud = fixture().record(&[mesh], &task(&camera));
        assert_eq!(
            cloud.counts.pieces + cloud.counts.rejected,
            mesh.count / 3,
            "{:?}",
            cloud.counts
        );
        cloud.counts.rejected
    };
    for (corners, base, expected) in [
        ([0, 9, 20], 0, 0),
        ([0, 9, count - 1], 0, 0),
        ([0, 9, count], 0, 1),
        ([0, u32::MAX, 20], 0, 1),
        ([0, 9, count - 1], 1, 1),
        ([0, u32::MAX, 20], 1, 1),
        ([0, 0x8000_0000, 20], i32::MIN, 1),
        ([0x8000_0000, 0x8000_0009, 0x8000_0014], i32::MIN, 0),
        ([0, 9, 20], -1, 1),
        ([1, 10, 21], -1, 0),
        ([0x7fff_ffff, 9, 20], i32::MAX, 1),
    ] {
        let index = index_buffer(&corners, IndexFormat::Uint32, 0);
        let mut mesh = mesh(&buffer, PositionFormat::Float32x3, 0, 12, vertices.len());
        mesh.indices = Some(Indices {
            buffer: &index,
            offset: 0,
            format: IndexFormat::Uint32,
        });
        mesh.count = 3;
        mesh.base_vertex = base;
        assert_eq!(
            rejected(mesh),
            expected,
            "{corners:?} with base {base}, {count} vertices"
        );
    }
    let mut plain = mesh(&buffer, PositionFormat::Float32x3, 0, 12, vertices.len());
    plain.count = 12;
    plain.first = count - 4;
    assert_eq!(rejected(plain), 3, "past the last vertex");
    plain.first = u32::MAX - 1;
    assert_eq!(rejected(plain), 4, "past the last number");
    plain.first = 0;
    plain.vertices.count = 0;
    assert_eq!(rejected(plain), 4, "no vertices");
}

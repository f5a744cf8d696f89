//! Engines that were not made for the crate: the error says what to switch on, and the frame goes on without the effect.

use deep_screen_space::{IndexFormat, Indices};

use super::*;
use support::testing::refusals::refused;

/// After a refusal the same encoder and the same objects serve.
fn goes_on(lab: &Lab, mut encoder: wgpu::CommandEncoder, cloud: &mut SurfelCloud) {
    lab.record_cloud(&mut encoder, cloud);
    let mut decoded = lab.decoded();
    decoded.frame(&mut encoder, lab.gbuffer(), &lab.camera, cloud.origin());
    submit(lab, encoder);
}

#[test]
fn without_storage_on_its_buffers() {
    let lab = &*LAB;
    let mut cloud = lab.cloud(ROOM);
    let buffer = |usage| lab.gpu.buffer(&[0.0_f32; 9], usage);
    let (vertices, indices) = (buffer(BufferUsages::VERTEX), buffer(BufferUsages::INDEX));
    let wall = lab.wall();
    let drawn_alone = [
        (
            "Mesh::vertices",
            Mesh {
                vertices: Vertices {
                    buffer: &vertices,
                    ..wall.vertices
                },
                ..wall
            },
        ),
        (
            "Mesh::indices",
            Mesh {
                indices: Some(Indices {
                    buffer: &indices,
                    offset: 0,
                    format: IndexFormat::from(wgpu::IndexFormat::Uint32),
                }),
                ..wall
            },
        ),
    ];
    for (name, mesh) in drawn_alone {
        let mut encoder = lab.gpu.encoder();
        let result = lab.record_mesh(&mut encoder, mesh, &mut cloud);
        refused(result, "Buffer", name, "add BufferUsages::STORAGE");
        goes_on(lab, encoder, &mut cloud);
    }
}

#[test]
fn with_multisampled_depth() {
    let lab = &*LAB;
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::RENDER_ATTACHMENT;
    let depth = lab.gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: lab.depth.texture().size(),
        mip_level_count: 1,
        sample_count: 4,
        dimension: wgpu::TextureDimension::D2,
        format: Format::Depth32Float,
        usage,
        view_formats: &[],
    });
    let gbuffer = GBuffer {
        depth: (&depth).into(),
        ..lab.gbuffer()
    };
    let mut encoder = lab.gpu.encoder();
    let mut decoded = lab.decoded();
    let result = decoded.record(&mut encoder, gbuffer, &lab.camera, lab.camera.focus());
    refused(
        result.map(drop),
        "Shape",
        "GBuffer::depth",
        "without multisampling",
    );
    goes_on(lab, encoder, &mut lab.cloud(ROOM));
}

#[test]
fn with_compressed_vertices() {
    use wgpu::VertexFormat as Stored;
    let accepted = [
        (Stored::Float32x3, PositionFormat::Float32x3),
        (Stored::Float32x4, PositionFormat::Float32x3),
        (Stored::Float16x4, PositionFormat::Float16x4),
    ];
    for (stored, format) in accepted {
        assert_eq!(PositionFormat::try_from(stored), Ok(format));
    }
    for stored in [
        Stored::Snorm16x4,
        Stored::Unorm16x4,
        Stored::Snorm8x4,
        Stored::Unorm10_10_10_2,
        Stored::Uint32,
        Stored::Float32x2,
        Stored::Float64x3,
    ] {
        let result = PositionFormat::try_from(stored);
        refused(
            result,
            "Buffer",
            &format!("{stored:?}"),
            "without compression",
        );
    }
}

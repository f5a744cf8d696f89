//! What is refused, by name.

use deep_screen_space::{
    Error, ShadedLight, Shadow, ShadowMap, SurfelShaderInput, SurfelShaderSettings,
    SurfelizerSettings, Timestamps, glam::DVec3, wgpu,
};

use super::harness::{ALBEDO, Lab, above, cube, material, point, squares, unshadowed};

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let lab = Lab::new();
    let device = &lab.gpu.device;
    let none = lab.cloud(&squares(&[]), &above(3.0), &SurfelizerSettings::default());
    let cloud = none.cloud;
    let storage = wgpu::BufferUsages::STORAGE;
    let materials = lab.gpu.buffer(&[material(ALBEDO, [0.0; 3])], storage);
    let radiance = lab.shader.create_radiance(device, &cloud).expect("room");
    assert!(
        radiance
            .usage()
            .contains(storage | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST)
    );
    assert_eq!(radiance.size(), 32 << 15);
    let input = SurfelShaderInput {
        cloud: &cloud,
        materials: &materials,
        lights: &[],
        radiance: &radiance,
        timestamps: None,
    };
    let record = |input: &SurfelShaderInput<'_>, samples| {
        lab.shader.record(
            device,
            &mut lab.gpu.encoder(),
            input,
            &SurfelShaderSettings { samples },
        )
    };
    assert_eq!(record(&input, 1), Ok(()));
    for samples in [0, 3, 12, 32, u32::MAX] {
        match record(&input, samples) {
            Err(Error::Setting { field, .. }) => {
                assert_eq!(field, "SurfelShaderSettings::samples");
            }
            other => panic!("{samples}: {other:?}"),
        }
    }

    let short = lab.gpu.buffer(&[0_u32; 7], storage);
    let unusable = lab.gpu.buffer(&[0_u32; 64], wgpu::BufferUsages::VERTEX);
    let one_short = lab.gpu.buffer(&vec![0_u8; (32 << 15) - 4], storage);
    for (input, named) in [
        (
            SurfelShaderInput {
                materials: &short,
                ..input
            },
            "SurfelShaderInput::materials",
        ),
        (
            SurfelShaderInput {
                materials: &unusable,
                ..input
            },
            "SurfelShaderInput::materials",
        ),
        (
            SurfelShaderInput {
                radiance: &one_short,
                ..input
            },
            "SurfelShaderInput::radiance",
        ),
        (
            SurfelShaderInput {
                radiance: &unusable,
                ..input
            },
            "SurfelShaderInput::radiance",
        ),
        (
            SurfelShaderInput {
                materials: &radiance,
                ..input
            },
            "SurfelShaderInput::radiance",
        ),
        (
            SurfelShaderInput {
                radiance: cloud.pieces(),
                ..input
            },
            "SurfelShaderInput::radiance",
        ),
    ] {
        match record(&input, 1) {
            Err(Error::Buffer { name, .. }) => assert_eq!(name, named, "{input:?}"),
            other => panic!("{input:?}: {other:?}"),
        }
    }

    let lights = [unshadowed(point(DVec3::NAN, [1.0; 3]))];
    let bad = SurfelShaderInput {
        lights: &lights,
        ..input
    };
    assert!(matches!(
        record(&bad, 1),
        Err(Error::Setting {
            field: "Light::position",
            ..
        })
    ));

    let texture = |format, layers, samples, usage| {
        device
            .create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d {
                    width: 64,
                    height: 64,
                    depth_or_array_layers: layers,
                },
                mip_level_count: 1,
                sample_count: samples,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
            .create_view(&wgpu::TextureViewDescriptor::default())
    };
    let bound = wgpu::TextureUsages::TEXTURE_BINDING;
    let target = wgpu::TextureUsages::RENDER_ATTACHMENT;
    let depth32 = wgpu::TextureFormat::Depth32Float;
    let good = texture(depth32, 2, 1, bound);
    let cameras = cube(DVec3::ZERO, 64, 0.1);
    let large = [above(1.0), cube(DVec3::ZERO, 65, 0.1)[0]];
    for (depth, cameras, bias, named) in [
        (&good, &cameras[..0], 1.0, "ShadowMap::cameras"),
        (&good, &[cameras[0]; 7][..], 1.0, "ShadowMap::cameras"),
        (&good, &cameras[..1], -0.1, "ShadowMap::bias"),
        (&good, &cameras[..1], f32::NAN, "ShadowMap::bias"),
        (&good, &cameras[..3], 1.0, "ShadowMap::depth"),
        (&good, &large, 1.0, "ShadowMap::depth"),
        (
            &texture(wgpu::TextureFormat::R16Float, 2, 1, bound),
            &cameras[..1],
            1.0,
            "ShadowMap::depth",
        ),
        (
            &texture(depth32, 2, 1, target),
            &cameras[..1],
            1.0,
            "ShadowMap::depth",
        ),
        (
            &texture(depth32, 1, 4, bound | target),
            &cameras[..1],
            1.0,
            "ShadowMap::depth",
        ),
    ] {
        let lights = [ShadedLight {
            light: point(DVec3::Y, [1.0; 3]),
            shadow: Shadow::Map(ShadowMap {
                depth: depth.texture().into(),
                cameras,
                bias,
            }),
        }];
        let input = SurfelShaderInput {
            lights: &lights,
            ..input
        };
        let found = match record(&input, 1) {
            Err(Error::Setting { field, .. }) => field,
            Err(
                Error::Format { name, .. }
                | Error::Usage { name, .. }
                | Error::Shape { name, .. }
                | Error::Size { name, .. },
            ) => name,
            other => panic!("{lights:?}: {other:?}"),
        };
        assert_eq!(found, named, "{lights:?}");
    }

    if device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
        let set = device.create_query_set(&wgpu::QuerySetDescriptor {
            label: None,
            ty: wgpu::QueryType::Timestamp,
            count: 2,
        });
        let bad = SurfelShaderInput {
            timestamps: Some(Timestamps {
                set: &set,
                begin: 1,
                end: 1,
            }),
            ..input
        };
        assert!(matches!(record(&bad, 1), Err(Error::Setting { .. })));
    }
}

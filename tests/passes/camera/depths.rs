//! Depth, as the GPU decodes it.

use deep_screen_space::{
    AmbientOcclusion, Camera, GBuffer, NormalEncoding, NormalSpace, Viewport,
    glam::{DVec3, dcamera::rh::proj::directx as right},
    reference::receivers::Decoder,
    wgpu::{self, TextureFormat as Format, TextureUsages},
};

use support::{
    gpu::Gpu,
    testing::{
        passes::{Passes, receivers, texture},
        pipelines,
    },
};

use super::harness::{Case, SIZES, assert_receiver, cases, direction, random};

/// A camera's depths over its whole texture, its viewport and garbage around it; `None` is sky.
fn depths(case: &Case, camera: &Camera) -> (Vec<Option<f64>>, Vec<f32>, [u32; 2]) {
    let viewport = camera.viewport();
    let texture = [
        2 * viewport.x + viewport.width,
        2 * viewport.y + viewport.height,
    ];
    let mut all = vec![0.4_f32; (texture[0] * texture[1]) as usize];
    let mut inside = Vec::new();
    for i in 0..viewport.width * viewport.height {
        let [x, y] = [i % viewport.width, i / viewport.width];
        let point = case.point(
            camera,
            f64::from(x) + 0.5,
            f64::from(y) + 0.5,
            case.distance(i),
        );
        let depth = camera.project(point).expect("a point in front").z as f32;
        // Forward depth of what is far rounds to the background's.
        let sky = random(i, 4) < 0.2 || depth == camera.background_depth();
        let depth = if sky {
            camera.background_depth()
        } else {
            depth
        };
        all[((y + viewport.y) * texture[0] + x + viewport.x) as usize] = depth;
        inside.push((!sky).then_some(f64::from(depth)));
    }
    (inside, all, texture)
}

#[test]
fn receivers_are_where_the_camera_says() {
    let gpu = pipelines::gpu();
    let mut passes = Passes::new(gpu, &AmbientOcclusion::default().effect(), 1);
    for case in cases() {
        for size in SIZES {
            let camera = case.camera(size);
            let origin = camera.eye() + case.origin;
            let cloud_camera = Camera::look_at(
                origin,
                origin + DVec3::X,
                DVec3::Y,
                right::perspective_infinite_reverse(1.0, 1.0, 0.1),
                Viewport::full(1, 1),
            )
            .and_then(|camera| camera.with_focus(origin))
            .expect("a camera");
            passes.emit(gpu, &cloud_camera, &[DVec3::X], 1);
            let (inside, all, texture) = depths(&case, &camera);
            let normals: Vec<[f32; 4]> = (0..all.len() as u32)
                .map(|i| direction(i).as_vec3().extend(0.0).to_array())
                .collect();
            let [width, height] = texture;
            let depth = gpu.texture(Format::R32Float, width, height, &all);
            let normal = gpu.texture(Format::Rgba32Float, width, height, &normals);
            let gbuffer = GBuffer {
                depth: depth.texture().into(),
                normal: normal.texture().into(),
                normal_encoding: NormalEncoding::Signed,
                normal_space: NormalSpace::World,
                albedo: None,
                roughness: None,
            };
            let (decoded, _) = passes.splat(gpu, gbuffer, &camera).expect(case.name);
            let decoder = Decoder {
                camera: &camera,
                origin,
                depth_format: Format::R32Float,
                normal_encoding: NormalEncoding::Signed,
                normal_space: NormalSpace::World,
            };
            let found = receivers(gpu, &decoded);
            for (i, (&found, depth)) in (0..).zip(found.iter().zip(&inside)) {
                let pixel = [i % size[0], i / size[0]];
                let at = (pixel[1] + case.corner[1]) * width + pixel[0] + case.corner[0];
                let texel = direction(at).as_vec3().as_dvec3();
                let inputs = format!("{}, {size:?}", case.name);
                let stored = depth.unwrap_or(f64::from(camera.background_depth()));
                assert_receiver(&decoder, found, pixel, stored, texel, case.exact, &inputs);
                assert_eq!(found.is_some(), depth.is_some(), "{inputs}, {pixel:?}");
                if let (Some(found), true) = (found, case.exact) {
                    let [x, y] = pixel.map(|c| f64::from(c) + 0.5);
                    let point = case.point(&camera, x, y, case.distance(i)) - case.origin;
                    // And of the depth itself, and its lift: half a unit each.
                    let tolerance = 1.2e-6 * (point + case.origin).length();
                    assert!(
                        found.position.distance(point) <= tolerance,
                        "{inputs}, {pixel:?}: {} in place of {point}",
                        found.position
                    );
                }
            }
        }
    }
}

/// Draws depths into a texture of any depth format.
fn draw_depth(
    gpu: &Gpu,
    format: Format,
    [width, height]: [u32; 2],
    depths: &[f32],
) -> wgpu::TextureView {
    const SHADER: &str = r"
@group(0) @binding(0) var depths: texture_2d<f32>;
@vertex fn vertex(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
  return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}
@fragment fn fragment(@builtin(position) at: vec4f) -> @builtin(frag_depth) f32 {
  return textureLoad(depths, vec2i(at.xy), 0).x;
}";
    let device = &gpu.device;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(SHADER.into()),
    });
    let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: false },
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            count: None,
        }],
    });
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(&layout)],
        immediate_size: 0,
    });
    let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: Some(&pipeline_layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Always),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[],
        }),
        multiview_mask: None,
        cache: None,
    });
    let source = gpu.texture(Format::R32Float, width, height, depths);
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &layout,
        entries: &[wgpu::BindGroupEntry {
            binding: 0,
            resource: wgpu::BindingResource::TextureView(&source),
        }],
    });
    let target = texture(
        gpu,
        format,
        [width, height],
        TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING,
    );
    let attachment = target.create_view(&wgpu::TextureViewDescriptor::default());
    let mut encoder = gpu.encoder();
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &attachment,
            depth_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(0.5),
                store: wgpu::StoreOp::Store,
            }),
            stencil_ops: format.has_stencil_aspect().then_some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(0),
                store: wgpu::StoreOp::Store,
            }),
        }),
        ..Default::default()
    });
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.draw(0..3, 0..1);
    drop(pass);
    gpu.finish(encoder);
    target.create_view(&wgpu::TextureViewDescriptor {
        aspect: wgpu::TextureAspect::DepthOnly,
        ..Default::default()
    })
}

#[test]
fn every_depth_format_is_read() {
    let gpu = pipelines::gpu();
    let mut passes = Passes::new(gpu, &AmbientOcclusion::default().effect(), 1);
    let mut formats = vec![
        Format::Depth16Unorm,
        Format::Depth24Plus,
        Format::Depth24PlusStencil8,
        Format::Depth32Float,
    ];
    if gpu
        .device
        .features()
        .contains(wgpu::Features::DEPTH32FLOAT_STENCIL8)
    {
        formats.push(Format::Depth32FloatStencil8);
    } else {
        println!("Depth32FloatStencil8 is left out: the device was not asked for it");
    }
    let size = [31, 17];
    let projections = [
        right::perspective(1.0, 1.0, 0.1, 100.0),
        right::perspective_infinite_reverse(1.0, 1.0, 0.1),
        right::orthographic(-4.0, 4.0, -4.0, 4.0, 100.0, 0.1),
    ];
    for format in formats {
        for projection in projections {
            let case = Case::new("formats", projection);
            let camera = case.camera(size);
            passes.emit(gpu, &camera, &[DVec3::X], 1);
            let (inside, mut all, _) = depths(&case, &camera);
            if format == Format::Depth16Unorm {
                // As the texture will hold it.
                for depth in &mut all {
                    *depth = (f64::from(*depth) * 65535.0).round() as f32 / 65535.0;
                }
            }
            let depth = draw_depth(gpu, format, size, &all);
            let texels = vec![[0.0, 0.0, 1.0, 0.0_f32]; all.len()];
            let normal = gpu.texture(Format::Rgba32Float, size[0], size[1], &texels);
            let gbuffer = GBuffer {
                depth: depth.texture().into(),
                normal: normal.texture().into(),
                normal_encoding: NormalEncoding::Signed,
                normal_space: NormalSpace::View,
                albedo: None,
                roughness: None,
            };
            let (decoded, _) = passes.splat(gpu, gbuffer, &camera).expect("a depth format");
            let decoder = Decoder {
                camera: &camera,
                origin: camera.focus(),
                depth_format: format,
                normal_encoding: NormalEncoding::Signed,
                normal_space: NormalSpace::View,
            };
            let mut seen = 0;
            for (i, &found) in (0..).zip(&receivers(gpu, &decoded)) {
                let pixel = [i % size[0], i / size[0]];
                let stored = f64::from(all[i as usize]);
                let background = f64::from(camera.background_depth());
                let inputs = format!("{format:?}, {projection}");
                // Within a step of the background a fixed-point format may round either way.
                if stored != background && (stored - background).abs() < 1e-7 {
                    continue;
                }
                assert_receiver(&decoder, found, pixel, stored, DVec3::Z, false, &inputs);
                assert!(
                    found.is_none() || inside[i as usize].is_some(),
                    "{inputs}: {pixel:?}"
                );
                seen += u32::from(found.is_some());
            }
            assert!(seen > 100, "{format:?}: {seen} pixels are no sky");
        }
    }
}

#[test]
fn depths_that_no_camera_gives_are_sky_or_finite() {
    let gpu = pipelines::gpu();
    let mut passes = Passes::new(gpu, &AmbientOcclusion::default().effect(), 1);
    let depths = [
        f32::NAN,
        f32::INFINITY,
        -f32::INFINITY,
        -1.0,
        0.0,
        -0.0,
        1e-45,
        1e-40,
        1e-37,
        1e-20,
        0.5,
        1.0,
        1.0 - 6e-8,
        2.0,
        1e30,
    ];
    let size = [depths.len() as u32, 1];
    let depth = gpu.texture(Format::R32Float, size[0], 1, &depths);
    let texels = vec![[0.0, 0.0, 1.0, 0.0_f32]; depths.len()];
    let normal = gpu.texture(Format::Rgba32Float, size[0], 1, &texels);
    for case in cases() {
        let case = Case {
            corner: [0, 0],
            ..case
        };
        let camera = case.camera(size);
        passes.emit(gpu, &camera, &[DVec3::X], 1);
        let gbuffer = GBuffer {
            depth: depth.texture().into(),
            normal: normal.texture().into(),
            normal_encoding: NormalEncoding::Signed,
            normal_space: NormalSpace::World,
            albedo: None,
            roughness: None,
        };
        let (decoded, _) = passes.splat(gpu, gbuffer, &camera).expect("a G-buffer");
        for (depth, found) in depths.iter().zip(receivers(gpu, &decoded)) {
            let inputs = format!("{}, depth {depth}: {found:?}", case.name);
            if let Some(found) = found {
                let farthest = found.position.abs().max_element();
                assert!(farthest <= 1e18 + case.eye.abs().max_element(), "{inputs}");
            }
            let sky = if camera.background_depth() == 0.0 {
                0.0
            } else {
                1.0
            };
            if !depth.is_finite() || *depth == sky {
                assert_eq!(found, None, "{inputs}");
            }
            if *depth == 0.5 {
                assert!(found.is_some(), "{inputs}");
            }
        }
    }
}

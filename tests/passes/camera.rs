//! The camera and the G-buffer contract: every kind of projection, size and format, on the CPU and as the GPU decodes it.

// Exact values are meant where floats are compared for equality.
#![allow(clippy::float_cmp)]

use std::f64::consts::FRAC_PI_3;
use support::testing::pipelines;

use NormalEncoding::{Octahedral, OctahedralUnsigned, Signed, Unsigned};
use deep_screen_space::{
    AmbientOcclusion, Camera, GBuffer, NormalEncoding, NormalSpace, Viewport,
    glam::{
        DMat3, DMat4, DVec2, DVec3, DVec4,
        dcamera::{
            lh::proj::directx as left,
            rh::{proj::directx as right, view::look_at_mat4},
        },
    },
    reference::{packing::octahedral_from, receivers::Decoder, shell_splatter::Receiver},
    wgpu::{self, TextureFormat as Format, TextureUsages},
};
use support::gpu::Gpu;
use support::testing::passes::{Passes, descriptor, receivers, texture};
use support::testing::refusals::refused;

/// 0 ≤ x < 1, the same for the same inputs.
fn random(a: u32, b: u32) -> f64 {
    let mut x = a.wrapping_mul(0x9e37_79b9) ^ b.wrapping_mul(0x85eb_ca6b) ^ 0x5bd1_e995;
    for _ in 0..3 {
        x ^= x >> 15;
        x = x.wrapping_mul(0x2c1b_3c6d);
        x ^= x >> 13;
    }
    f64::from(x) / 2_f64.powi(32)
}

fn direction(i: u32) -> DVec3 {
    let z = 2.0 * random(i, 1) - 1.0;
    let (sin, cos) = (std::f64::consts::TAU * random(i, 2)).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * cos, r * sin, z)
}

const SIZES: [[u32; 2]; 4] = [[1, 1], [1, 7], [31, 17], [127, 89]];

/// A projection and how to place a camera with it.
struct Case {
    name: &'static str,
    projection: DMat4,
    /// Distances from the eye plane to try, within the depth range.
    distances: [f64; 2],
    left_handed: bool,
    /// Said outright with `with_reversed_depth`.
    reversed: Option<bool>,
    eye: DVec3,
    up: DVec3,
    /// Left and top of the viewport.
    corner: [u32; 2],
    /// Where the positions' origin is, from the eye.
    origin: DVec3,
    /// Depth steps are too small to matter: positions are exact to f32.
    exact: bool,
}

impl Case {
    fn new(name: &'static str, projection: DMat4) -> Self {
        Self {
            name,
            projection,
            distances: [0.11, 90.0],
            left_handed: false,
            reversed: None,
            eye: DVec3::new(1.5, -0.7, 2.0),
            up: DVec3::Y,
            corner: [0, 0],
            origin: DVec3::ZERO,
            exact: false,
        }
    }

    fn camera(&self, [width, height]: [u32; 2]) -> Camera {
        let [x, y] = self.corner;
        let viewport = Viewport {
            x,
            y,
            width,
            height,
        };
        let forward = DVec3::new(0.6, 0.1, -0.9).normalize();
        let right = forward.cross(self.up).normalize();
        let up = right.cross(forward);
        let z = if self.left_handed { forward } else { -forward };
        let rotation = DMat3::from_cols(right, up, z).transpose();
        let view = DMat4::from_mat3(rotation) * DMat4::from_translation(-self.eye);
        let camera = Camera::new(view, self.projection, viewport).expect(self.name);
        match self.reversed {
            Some(reversed) => camera.with_reversed_depth(reversed),
            None => camera,
        }
    }

    /// The point that a pixel shows at a distance from the eye plane, relative to the eye, from the projection's rows
    /// alone: x and y do not mix in them.
    fn point(&self, camera: &Camera, x: f64, y: f64, distance: f64) -> DVec3 {
        let viewport = camera.viewport();
        let z = if self.left_handed {
            distance
        } else {
            -distance
        };
        let p = &self.projection;
        let w = p.z_axis.w * z + p.w_axis.w;
        let ndc = DVec2::new(
            x / f64::from(viewport.width) * 2.0 - 1.0,
            1.0 - y / f64::from(viewport.height) * 2.0,
        );
        let across = ndc * w - p.z_axis.truncate().truncate() * z - p.w_axis.truncate().truncate();
        let view = DVec3::new(across.x / p.x_axis.x, across.y / p.y_axis.y, z);
        camera.rotation().transpose() * view
    }

    fn distance(&self, i: u32) -> f64 {
        let [near, far] = self.distances;
        near * (far / near).powf(random(i, 3))
    }
}

#[allow(clippy::too_many_lines)] // A table.
fn cases() -> Vec<Case> {
    let aspect = 1.3;
    let fov = FRAC_PI_3;
    let reversed = right::perspective_infinite_reverse(fov, aspect, 0.1);
    let off_axis = {
        let mut p = reversed;
        p.z_axis.x = 0.7;
        p.z_axis.y = -0.4;
        p
    };
    let ortho = |near, far| right::orthographic(-4.0, 5.0, -3.0, 2.0, near, far);
    let ortho_lh = |near, far| left::orthographic(-4.0, 5.0, -3.0, 2.0, near, far);
    let case = Case::new;
    vec![
        case("forward", right::perspective(fov, aspect, 0.1, 100.0)),
        case("reversed", right::perspective(fov, aspect, 100.0, 0.1)),
        Case {
            exact: true,
            ..case("reversed, infinite", reversed)
        },
        case(
            "forward, infinite",
            right::perspective_infinite(fov, aspect, 0.1),
        ),
        case("forward orthographic", ortho(0.1, 100.0)),
        case("reversed orthographic", ortho(100.0, 0.1)),
        Case {
            left_handed: true,
            reversed: Some(false),
            ..case("left-handed forward orthographic", ortho_lh(0.1, 100.0))
        },
        Case {
            left_handed: true,
            reversed: Some(true),
            ..case("left-handed reversed orthographic", ortho_lh(100.0, 0.1))
        },
        Case {
            left_handed: true,
            ..case("left-handed", left::perspective(fov, aspect, 0.1, 100.0))
        },
        Case {
            left_handed: true,
            exact: true,
            ..case(
                "left-handed, reversed, infinite",
                left::perspective_infinite_reverse(fov, aspect, 0.1),
            )
        },
        Case {
            exact: true,
            ..case("off-axis", off_axis)
        },
        Case {
            up: DVec3::new(0.8, 0.5, 0.1),
            exact: true,
            ..case("rolled", reversed)
        },
        Case {
            corner: [5, 3],
            exact: true,
            ..case("a part of a texture", reversed)
        },
        Case {
            eye: DVec3::new(1e5, -2e5, 7e4),
            exact: true,
            ..case("far from the world's origin", reversed)
        },
        Case {
            origin: DVec3::new(0.03, 0.0, -0.01),
            exact: true,
            ..case("beside the cloud's eye", reversed)
        },
        Case {
            distances: [1.1e-3, 9e5],
            ..case(
                "near 1e-3, far 1e6",
                right::perspective(fov, aspect, 1e-3, 1e6),
            )
        },
        Case {
            distances: [1.1e-3, 9e5],
            exact: true,
            ..case(
                "near 1e-3, reversed, infinite",
                right::perspective_infinite_reverse(fov, aspect, 1e-3),
            )
        },
        Case {
            distances: [1e-6, 1e-2],
            exact: true,
            ..case(
                "scale 1e-4",
                right::perspective_infinite_reverse(fov, aspect, 1e-7),
            )
        },
        Case {
            distances: [1e4, 1e8],
            exact: true,
            ..case(
                "scale 1e5",
                right::perspective_infinite_reverse(fov, aspect, 1e4),
            )
        },
    ]
}

/// Columns of plain arrays are those of the matrices.
#[test]
fn arrays_are_matrices() {
    let view = look_at_mat4(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Y);
    let projection = right::perspective_infinite_reverse(1.0, 1.5, 0.1);
    let viewport = Viewport::full(12, 8);
    let arrays = [view, projection].map(|m| m.to_cols_array_2d());
    assert_eq!(
        Camera::from_arrays(arrays[0], arrays[1], viewport),
        Camera::new(view, projection, viewport)
    );
    let singles = [view, projection].map(|m| m.as_mat4());
    let of_singles = singles.map(|m| m.to_cols_array_2d());
    assert_eq!(
        Camera::from_arrays(of_singles[0], of_singles[1], viewport),
        Camera::new(singles[0].as_dmat4(), singles[1].as_dmat4(), viewport)
    );
    let flat = [[0.0; 4]; 4];
    assert!(matches!(
        Camera::from_arrays(arrays[0], flat, viewport),
        Err(deep_screen_space::Error::Camera { .. })
    ));
}

#[test]
fn project_and_unproject_are_each_others_inverse() {
    for case in cases() {
        for size in SIZES {
            let camera = case.camera(size);
            for i in 0..200 {
                let x = random(i, 10) * f64::from(size[0]);
                let y = random(i, 11) * f64::from(size[1]);
                let point = case.point(&camera, x, y, case.distance(i));
                let inputs = format!("{}, {size:?}, pixel {x} {y}, point {point}", case.name);
                let pixel = camera.project(point).expect(&inputs);
                assert!(
                    (pixel.x - x).abs().max((pixel.y - y).abs())
                        < 1e-8 * f64::from(size[0].max(size[1])),
                    "{inputs}: projects to {pixel}"
                );
                assert!(
                    (0.0..=1.0).contains(&pixel.z),
                    "{inputs}: depth {}",
                    pixel.z
                );
                let back = camera.unproject(x, y, pixel.z).expect(&inputs);
                // Forward depth of a far point has lost far/near of its 2^-53.
                let lost = case.distances[1] / case.distances[0] * 1e-15;
                assert!(
                    back.distance(point) <= (1e-11 + lost) * point.length(),
                    "{inputs}: comes back as {back}"
                );
            }
            let background = f64::from(camera.background_depth());
            assert_eq!(
                camera.unproject(0.5, 0.5, background),
                None,
                "{}",
                case.name
            );
            assert_eq!(camera.unproject(0.5, 0.5, f64::NAN), None, "{}", case.name);
            // Nearer is on the other side of the range.
            let depth = |i| {
                let distance = case.distances[i];
                camera
                    .project(case.point(&camera, 0.5, 0.5, distance))
                    .expect(case.name)
                    .z
            };
            assert!(
                (depth(0) - background).abs() > (depth(1) - background).abs(),
                "{}: depth {} near, {} far, background {background}",
                case.name,
                depth(0),
                depth(1)
            );
        }
    }
}

#[test]
fn a_pixel_is_as_large_as_its_neighbours_are_apart() {
    for case in cases() {
        let camera = case.camera([127, 89]);
        let footprint = camera.footprint();
        let distance = case.distance(1);
        // About the axis, where the distance along it is the Euclidean one.
        let axis = camera
            .project(
                camera.rotation().transpose()
                    * DVec3::Z
                    * if case.left_handed {
                        distance
                    } else {
                        -distance
                    },
            )
            .expect(case.name);
        let at = |x, y| case.point(&camera, axis.x + x, axis.y + y, distance);
        let measured =
            (at(0.5, 0.0).distance(at(-0.5, 0.0)) * at(0.0, 0.5).distance(at(0.0, -0.5))).sqrt();
        let given = footprint.at(at(0.0, 0.0));
        assert!(
            (given / measured - 1.0).abs() < 1e-3,
            "{}: {given}, measured {measured}",
            case.name
        );
    }
}

/// Whether a GPU's receiver is where it should be.
#[track_caller]
fn assert_receiver(
    decoder: &Decoder<'_>,
    found: Option<Receiver>,
    pixel: [u32; 2],
    depth: f64,
    texel: DVec3,
    exact: bool,
    inputs: &str,
) {
    let inputs = format!("{inputs}, pixel {pixel:?}, depth {depth}, normal {texel}");
    let expected = decoder.prepare(pixel, depth, texel);
    let (Some(found), Some(expected)) = (found, expected) else {
        assert_eq!(
            found.is_some(),
            expected.is_some(),
            "{inputs}: {found:?}, mirror {expected:?}"
        );
        return;
    };
    let eye = decoder.camera.eye() - decoder.origin;
    // Some roundings of f32 (6e-8 each) in a product of three.
    let mut tolerance = 1e-6 * (expected.position - eye).length();
    if !exact {
        // A unit in the last place of the depth, or of its fixed-point format: what the lift off the surface may be
        // rounded to.
        let step = match decoder.depth_format {
            Format::Depth16Unorm => 1.0 / 65535.0,
            Format::Depth24Plus | Format::Depth24PlusStencil8 => 1.0 / 16_777_215.0,
            _ => 1.2e-7 * depth,
        };
        let at = |depth| {
            decoder
                .unproject(pixel, depth)
                .unwrap_or(expected.position - eye)
        };
        tolerance += 2.0 * at(depth + step).distance(at(depth - step));
        if !decoder.camera.is_perspective() {
            // Depth is linear: f32 resolves a share of the range.
            tolerance += 1e-6 * 100.0;
        }
    }
    assert!(
        found.position.distance(expected.position) <= tolerance,
        "{inputs}: {} is off {} by {}, allowed {tolerance}",
        found.position,
        expected.position,
        found.position.distance(expected.position)
    );
    // Half a step of 16-bit snorm in each octahedral coordinate, which stretches by up to 2.
    assert!(
        found.normal.distance(expected.normal) <= 1e-4,
        "{inputs}: normal {}, mirror {}",
        found.normal,
        expected.normal
    );
}

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

/// A value that a normal's format holds: its bytes, and what a shader reads of them.
fn encode(format: Format, v: DVec4) -> (Vec<u8>, DVec4) {
    let snorm = |v: f64| (v.clamp(-1.0, 1.0) * 127.0).round();
    let unorm = |v: f64, most: f64| (v.clamp(0.0, 1.0) * most).round();
    match format {
        Format::Rgba32Float => (
            v.as_vec4()
                .to_array()
                .iter()
                .flat_map(|c| c.to_le_bytes())
                .collect(),
            v.as_vec4().as_dvec4(),
        ),
        Format::Rgba16Float | Format::Rg16Float => {
            let count = usize::from(format.components());
            let halves = v.to_array().map(half);
            let bytes = halves[..count]
                .iter()
                .flat_map(|h| h.0.to_le_bytes())
                .collect();
            (bytes, DVec4::from(halves.map(|h| h.1)))
        }
        Format::Rgba8Snorm | Format::Rg8Snorm => {
            let count = usize::from(format.components());
            let codes = v.to_array().map(snorm);
            let bytes = codes[..count].iter().map(|c| *c as i8 as u8).collect();
            (bytes, DVec4::from(codes) / 127.0)
        }
        Format::Rgba8Unorm | Format::Rg8Unorm => {
            let count = usize::from(format.components());
            let codes = v.to_array().map(|c| unorm(c, 255.0));
            (
                codes[..count].iter().map(|c| *c as u8).collect(),
                DVec4::from(codes) / 255.0,
            )
        }
        Format::Rgb10a2Unorm => {
            let codes = v.to_array().map(|c| unorm(c, 1023.0));
            let bits = codes[0] as u32 | (codes[1] as u32) << 10 | (codes[2] as u32) << 20;
            (bits.to_le_bytes().to_vec(), DVec4::from(codes) / 1023.0)
        }
        other => panic!("{other:?} is not encoded here"),
    }
}

/// The 16-bit float at or next to `v` on the side of zero, and its value.
fn half(v: f64) -> (u16, f64) {
    let bits = (v as f32).to_bits();
    let exponent = (bits >> 23 & 0xff) as i32 - 127 + 15;
    if exponent <= 0 {
        return (0, 0.0);
    }
    let kept = bits & !0x1fff;
    let half = (bits >> 16 & 0x8000) | (exponent as u32) << 10 | (kept >> 13 & 0x3ff);
    (half as u16, f64::from(f32::from_bits(kept)))
}

#[test]
fn every_normal_encoding_is_read() {
    let gpu = pipelines::gpu();
    let mut passes = Passes::new(gpu, &AmbientOcclusion::default().effect(), 1);
    let case = Case {
        up: DVec3::new(0.8, 0.5, 0.1),
        ..Case::new(
            "normals",
            right::perspective_infinite_reverse(1.0, 1.0, 0.1),
        )
    };
    let size = [31, 17];
    let camera = case.camera(size);
    passes.emit(gpu, &camera, &[DVec3::X], 1);
    let depth = gpu.texture(Format::R32Float, size[0], size[1], &vec![0.02_f32; 31 * 17]);
    // How far off a unit vector each format's rounding may leave a component, doubled where 0…1 stands for −1…1 and
    // doubled again by the octahedron's stretch; three components.
    for (format, encoding, step) in [
        (Format::Rgba32Float, Signed, 1e-7),
        (Format::Rgba16Float, Signed, 1e-3),
        (Format::Rgba8Snorm, Signed, 0.5 / 127.0),
        (Format::Rgba8Unorm, Unsigned, 1.0 / 255.0),
        (Format::Rgba32Float, Unsigned, 2e-7),
        (Format::Rgb10a2Unorm, Unsigned, 1.0 / 1023.0),
        (Format::Rg16Float, Octahedral, 2e-3),
        (Format::Rg8Snorm, Octahedral, 1.0 / 127.0),
        (Format::Rg8Unorm, OctahedralUnsigned, 2.0 / 255.0),
    ] {
        for space in [NormalSpace::World, NormalSpace::View] {
            let mut bytes = Vec::new();
            let mut texels = Vec::new();
            for i in 0..size[0] * size[1] {
                let n = match space {
                    NormalSpace::World => direction(i),
                    NormalSpace::View => camera.rotation() * direction(i),
                };
                let v = match encoding {
                    Signed => n,
                    Unsigned => n * 0.5 + 0.5,
                    Octahedral => octahedral_from(n).extend(0.3),
                    OctahedralUnsigned => (octahedral_from(n) * 0.5 + 0.5).extend(0.3),
                };
                let (b, texel) = encode(format, v.extend(0.0));
                bytes.extend(b);
                texels.push(texel.truncate());
            }
            let normal = gpu.texture(format, size[0], size[1], &bytes);
            let gbuffer = GBuffer {
                depth: depth.texture().into(),
                normal: normal.texture().into(),
                normal_encoding: encoding,
                normal_space: space,
                albedo: None,
                roughness: None,
            };
            let (decoded, _) = passes
                .splat(gpu, gbuffer, &camera)
                .expect("a normal format");
            let decoder = Decoder {
                camera: &camera,
                origin: camera.focus(),
                depth_format: Format::R32Float,
                normal_encoding: encoding,
                normal_space: space,
            };
            for (i, &found) in (0..).zip(&receivers(gpu, &decoded)) {
                let pixel = [i % size[0], i / size[0]];
                let inputs = format!("{format:?}, {encoding:?}, {space:?}");
                let texel = texels[i as usize];
                assert_receiver(
                    &decoder,
                    found,
                    pixel,
                    f64::from(0.02_f32),
                    texel,
                    true,
                    &inputs,
                );
                let normal = found.expect(&inputs).normal;
                let tolerance = 3_f64.sqrt() * 1.5 * step + 1e-4;
                assert!(
                    normal.distance(direction(i)) <= tolerance,
                    "{inputs}, {texel}: {normal} in place of {}",
                    direction(i)
                );
            }
        }
    }
}

#[test]
fn normals_without_a_direction_face_the_eye() {
    let gpu = pipelines::gpu();
    let mut passes = Passes::new(gpu, &AmbientOcclusion::default().effect(), 1);
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    let none = [
        [0.0, 0.0, 0.0],
        [-0.0, 0.0, -0.0],
        [nan, 0.0, 0.0],
        [1.0, 0.0, nan],
        [inf, 0.0, 0.0],
        [0.0, -inf, 1.0],
        [nan, nan, nan],
        [1e-40, 0.0, 0.0],
        [0.0, 1e-45, 0.0],
        [1e-31, 1e-31, 1e-31],
    ];
    let some = [
        [0.0, 0.0, 1e-25],
        [1e-20, -2e-20, 2e-20],
        [1e20, 2e20, -2e20],
        [0.0, 3e38, 3e38],
        [1.0, 1e-40, 0.0],
        [-5.0, 0.1, 0.0],
    ];
    let all: Vec<[f32; 3]> = none.iter().chain(&some).copied().collect();
    let texels: Vec<[f32; 4]> = all.iter().map(|&[x, y, z]| [x, y, z, 0.0]).collect();
    let size = [all.len() as u32, 1];
    let case = Case::new(
        "normals",
        right::perspective_infinite_reverse(1.0, 1.0, 0.1),
    );
    let camera = case.camera(size);
    passes.emit(gpu, &camera, &[DVec3::X], 1);
    let depth = gpu.texture(Format::R32Float, size[0], 1, &vec![0.02_f32; all.len()]);
    let normal = gpu.texture(Format::Rgba32Float, size[0], 1, &texels);
    for normal_space in [NormalSpace::World, NormalSpace::View] {
        let gbuffer = GBuffer {
            depth: depth.texture().into(),
            normal: normal.texture().into(),
            normal_encoding: NormalEncoding::Signed,
            normal_space,
            albedo: None,
            roughness: None,
        };
        let (decoded, _) = passes.splat(gpu, gbuffer, &camera).expect("a G-buffer");
        for (i, found) in (0_u32..).zip(receivers(gpu, &decoded)) {
            let texel = DVec3::from(all[i as usize].map(f64::from));
            let found = found.expect("no sky");
            let to_eye = -camera
                .unproject(f64::from(i) + 0.5, 0.5, f64::from(0.02_f32))
                .expect("no sky")
                .normalize();
            let expected = if (i as usize) < none.len() {
                to_eye
            } else {
                let n = (texel / texel.abs().max_element()).normalize();
                match normal_space {
                    NormalSpace::World => n,
                    NormalSpace::View => camera.rotation().transpose() * n,
                }
            };
            assert!(
                found.normal.distance(expected) <= 1e-4,
                "{texel} in {normal_space:?}: {} in place of {expected}",
                found.normal
            );
            assert!(found.position.is_finite(), "{texel}: {}", found.position);
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

/// What is refused of a G-buffer that is good but for one view.
struct Checks {
    gpu: &'static Gpu,
    depth: wgpu::TextureView,
    normal: wgpu::TextureView,
}

impl Checks {
    const SIZE: [u32; 2] = [8, 8];
    const VIEWPORT: Viewport = Viewport::full(8, 8);

    fn new() -> Self {
        let gpu = pipelines::gpu();
        let checks = Self {
            depth: Self::plain(gpu, Format::Depth32Float),
            normal: Self::plain(gpu, Format::Rgba16Float),
            gpu,
        };
        checks.good().validate(Self::VIEWPORT).expect("it fits");
        checks
    }

    fn plain(gpu: &Gpu, format: Format) -> wgpu::TextureView {
        texture(gpu, format, Self::SIZE, TextureUsages::TEXTURE_BINDING)
            .create_view(&wgpu::TextureViewDescriptor::default())
    }

    fn good(&self) -> GBuffer<'_> {
        GBuffer {
            depth: self.depth.texture().into(),
            normal: self.normal.texture().into(),
            normal_encoding: Signed,
            normal_space: NormalSpace::World,
            albedo: None,
            roughness: None,
        }
    }
}

#[test]
fn formats_that_do_not_fit_are_refused() {
    let checks = Checks::new();
    let good = checks.good();
    for format in [
        Format::R16Float,
        Format::Rgba32Float,
        Format::R32Uint,
        Format::Stencil8,
    ] {
        let depth = Checks::plain(checks.gpu, format);
        let bad = GBuffer {
            depth: depth.texture().into(),
            ..good
        };
        refused(
            bad.validate(Checks::VIEWPORT),
            "Format",
            "GBuffer::depth",
            "a depth format or R32Float",
        );
    }
    for (format, encoding) in [
        (Format::Rg16Float, Signed),
        (Format::Rgba8Unorm, Signed),
        (Format::Rgb10a2Unorm, Signed),
        (Format::Rgba16Sint, Signed),
        (Format::Rgba8Snorm, Unsigned),
        (Format::Rg8Unorm, Unsigned),
        (Format::Rgba8UnormSrgb, Unsigned),
        (Format::Rgb10a2Uint, Unsigned),
        (Format::R32Float, Octahedral),
        (Format::Rg8Unorm, Octahedral),
        (Format::Rg8Snorm, OctahedralUnsigned),
        (Format::Rg8Uint, OctahedralUnsigned),
        (Format::Depth32Float, Signed),
    ] {
        let normal = Checks::plain(checks.gpu, format);
        let bad = GBuffer {
            normal: normal.texture().into(),
            normal_encoding: encoding,
            ..good
        };
        refused(
            bad.validate(Checks::VIEWPORT),
            "Format",
            "GBuffer::normal",
            "format with t",
        );
    }
    for format in [Format::R8Unorm, Format::Rgba8Uint, Format::Rg16Float] {
        let albedo = Checks::plain(checks.gpu, format);
        let bad = GBuffer {
            albedo: Some(albedo.texture().into()),
            ..good
        };
        refused(
            bad.validate(Checks::VIEWPORT),
            "Format",
            "GBuffer::albedo",
            "three components",
        );
    }
    for format in [Format::R8Snorm, Format::R8Uint, Format::Depth32Float] {
        let roughness = Checks::plain(checks.gpu, format);
        let bad = GBuffer {
            roughness: Some(roughness.texture().into()),
            ..good
        };
        refused(
            bad.validate(Checks::VIEWPORT),
            "Format",
            "GBuffer::roughness",
            "a float or unorm format",
        );
    }
}

#[test]
fn textures_that_do_not_fit_are_refused() {
    let checks = Checks::new();
    let good = checks.good();
    let (size, viewport) = (Checks::SIZE, Checks::VIEWPORT);
    let bind = TextureUsages::TEXTURE_BINDING;
    for (format, name) in [
        (Format::Depth32Float, "GBuffer::depth"),
        (Format::Rgba16Float, "GBuffer::normal"),
        (Format::Rgba8Unorm, "GBuffer::albedo"),
        (Format::R8Unorm, "GBuffer::roughness"),
    ] {
        let with = |texture: wgpu::Texture, viewport| {
            let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
            match name {
                "GBuffer::depth" => GBuffer {
                    depth: view.texture().into(),
                    ..good
                }
                .validate(viewport),
                "GBuffer::normal" => GBuffer {
                    normal: view.texture().into(),
                    ..good
                }
                .validate(viewport),
                "GBuffer::roughness" => GBuffer {
                    roughness: Some(view.texture().into()),
                    ..good
                }
                .validate(viewport),
                _ => GBuffer {
                    albedo: Some(view.texture().into()),
                    ..good
                }
                .validate(viewport),
            }
        };
        let plain = descriptor(format, size, bind);
        let make = |d: &wgpu::TextureDescriptor<'_>| checks.gpu.device.create_texture(d);
        with(make(&plain), viewport).expect(name);

        let unusable = descriptor(format, size, TextureUsages::RENDER_ATTACHMENT);
        refused(
            with(make(&unusable), viewport),
            "Usage",
            name,
            "TEXTURE_BINDING",
        );

        let mut multisampled = descriptor(format, size, bind | TextureUsages::RENDER_ATTACHMENT);
        multisampled.sample_count = 4;
        refused(
            with(make(&multisampled), viewport),
            "Shape",
            name,
            "one sample",
        );

        let mut array = plain.clone();
        array.size.depth_or_array_layers = 2;
        with(make(&array), viewport).expect("the first layer of an array");

        if !format.has_depth_aspect() {
            let mut volume = array.clone();
            volume.dimension = wgpu::TextureDimension::D3;
            refused(with(make(&volume), viewport), "Shape", name, "2-D");
        }

        let small = descriptor(format, [8, 7], bind);
        refused(with(make(&small), viewport), "Size", name, "at least 8x8");
    }
    let beyond = Viewport {
        y: u32::MAX,
        ..viewport
    };
    refused(
        good.validate(beyond),
        "Size",
        "GBuffer::depth",
        "at least 8x4294967295",
    );
}

#[test]
fn cameras_that_cannot_be_are_refused() {
    let view = look_at_mat4(DVec3::ZERO, DVec3::X, DVec3::Y);
    let projection = right::perspective_infinite_reverse(1.0, 1.0, 0.1);
    let viewport = Viewport::full(4, 4);
    let new = |view, projection, viewport| Camera::new(view, projection, viewport).map(|_| ());
    new(view, projection, viewport).expect("a camera");
    new(
        DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)) * view,
        projection,
        viewport,
    )
    .expect("a mirrored camera");

    let nan = DMat4::from_cols_array(&[f64::NAN; 16]);
    let mut sheared = view;
    sheared.x_axis.y += 0.1;
    let mut projective = view;
    projective.x_axis.w = 0.1;
    for bad in [
        DMat4::from_scale(DVec3::splat(2.0)) * view,
        DMat4::from_scale(DVec3::new(1.0, 1.01, 1.0)) * view,
        DMat4::from_translation(DVec3::new(f64::INFINITY, 0.0, 0.0)) * view,
        DMat4::ZERO,
        nan,
        sheared,
        projective,
    ] {
        refused(
            new(bad, projection, viewport),
            "Camera",
            "view",
            "finite rotation",
        );
    }
    let mut flat = projection;
    flat.y_axis = DVec4::ZERO;
    let mut oblique = projection;
    oblique.x_axis.w = 0.2;
    for bad in [DMat4::ZERO, nan, flat, oblique] {
        refused(
            new(view, bad, viewport),
            "Camera",
            "projection",
            "invertible",
        );
    }
    for bad in [Viewport::full(0, 4), Viewport::full(4, 0)] {
        refused(
            new(view, projection, bad),
            "Camera",
            "viewport",
            "at least 1x1",
        );
    }
    let look = |eye, target, up| Camera::look_at(eye, target, up, projection, viewport).map(|_| ());
    look(DVec3::ZERO, DVec3::X, DVec3::Y).expect("a camera");
    for (eye, target, up) in [
        (DVec3::ONE, DVec3::ONE, DVec3::Y),
        (DVec3::ZERO, DVec3::Y, DVec3::Y),
        (DVec3::ZERO, DVec3::X, DVec3::ZERO),
        (DVec3::NAN, DVec3::X, DVec3::Y),
        (DVec3::ZERO, DVec3::NAN, DVec3::Y),
        (DVec3::ZERO, DVec3::X, DVec3::NAN),
        (DVec3::INFINITY, DVec3::X, DVec3::Y),
    ] {
        refused(look(eye, target, up), "Camera", "view", "finite rotation");
    }
}

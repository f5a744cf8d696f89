//! What is refused, by name.

use NormalEncoding::{Octahedral, OctahedralUnsigned, Signed, Unsigned};
use deep_screen_space::{
    Camera, GBuffer, NormalEncoding, NormalSpace, Viewport,
    glam::{
        DMat4, DVec3, DVec4,
        dcamera::rh::{proj::directx as right, view::look_at_mat4},
    },
    wgpu::{self, TextureFormat as Format, TextureUsages},
};

use support::{
    gpu::Gpu,
    testing::{
        passes::{descriptor, texture},
        pipelines,
        refusals::refused,
    },
};

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

//! Normals, as the GPU decodes them.

use NormalEncoding::{Octahedral, OctahedralUnsigned, Signed, Unsigned};
use deep_screen_space::{
    AmbientOcclusion, GBuffer, NormalEncoding, NormalSpace,
    glam::{DVec3, DVec4, dcamera::rh::proj::directx as right},
    reference::{packing::octahedral_from, receivers::Decoder},
    wgpu::TextureFormat as Format,
};

use support::testing::{
    passes::{Passes, receivers},
    pipelines,
};

use super::harness::{Case, assert_receiver, direction};

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

//! What is refused, by name.

use deep_screen_space::{
    Channels, MotionVectors, TemporalAccumulator, TemporalInput, TemporalSettings, Viewport,
    wgpu::{self, TextureFormat as Format, TextureUsages},
};

use support::testing::{
    frames::Decoded,
    passes::{descriptor, texture},
    pipelines,
    refusals::refused,
};

use super::{
    harness::RUNNING,
    room::{EYE, ROOM, Shot, straight},
};

#[test]
fn settings_out_of_range_are_refused() {
    let standard = TemporalSettings::default();
    standard.validate().expect("the default");
    RUNNING.validate().expect("a running mean");
    let zero = TemporalSettings {
        max_frames: 0,
        ..standard
    };
    refused(zero.validate(), "Setting", "::max_frames", "1 or more");
    for bad in [-0.1, f32::NAN, f32::INFINITY] {
        let settings = TemporalSettings {
            depth_tolerance: bad,
            ..standard
        };
        refused(
            settings.validate(),
            "Setting",
            "::depth_tolerance",
            "0 or more",
        );
    }
    for bad in [-1.1, 1.1, f32::NAN] {
        let settings = TemporalSettings {
            normal_tolerance: bad,
            ..standard
        };
        refused(
            settings.validate(),
            "Setting",
            "::normal_tolerance",
            "-1 to 1",
        );
    }
    for bad in [-0.1, 101.0, f32::NAN] {
        let settings = TemporalSettings {
            clamping: bad,
            ..standard
        };
        refused(settings.validate(), "Setting", "::clamping", "0 to 100");
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    for format in [Format::Depth32Float, Format::R32Uint, Format::Rgb9e5Ufloat] {
        let made = TemporalAccumulator::new(device, Channels::One, format);
        refused(
            made,
            "Format",
            "TemporalAccumulator target",
            "a colour format",
        );
    }
    let make =
        |channels| TemporalAccumulator::new(device, channels, Format::R8Unorm).expect("pipelines");
    let (one, three) = (make(Channels::One), make(Channels::Three));
    refused(
        one.create_history(device, 0, 6),
        "Setting",
        "view size",
        "at least 1x1",
    );
    refused(
        one.create_history(device, 1 << 20, 1),
        "Limit",
        "max_texture_dimension_2d",
        "1048576",
    );

    let size = [8, 6];
    let shot = Shot::new(gpu, ROOM, &straight(EYE, Viewport::full(8, 6)));
    let binding = TextureUsages::TEXTURE_BINDING;
    let attachment = TextureUsages::RENDER_ATTACHMENT;
    let view =
        |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
    let plain = |format, size, usage| view(&texture(gpu, format, size, usage));
    let picture = plain(Format::Rgba16Float, size, binding);
    let target = plain(Format::R8Unorm, size, attachment);
    let mut decoded = Decoded::of(&shot.camera);
    let mut encoder = gpu.encoder();
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, EYE);
    let good = TemporalInput::new(&frame, &shot.camera, picture.texture(), target.texture());
    let history = |accumulator: &TemporalAccumulator, [width, height]: [u32; 2]| {
        accumulator
            .create_history(device, width, height)
            .expect("a history")
    };
    let mut ones = history(&one, size);
    let mut threes = history(&three, size);
    assert_eq!(
        [ones.memory_bytes(), threes.memory_bytes()],
        [48 * 32, 48 * 48]
    );
    let mut record = |input: &TemporalInput<'_>| {
        let settings = TemporalSettings::default();
        one.record(device, &mut gpu.encoder(), input, &settings, &mut ones)
    };
    record(&good).expect("it fits");

    // Pictures and targets.
    let name = "TemporalInput::picture";
    for (format, usage, size, kind, accepted) in [
        (Format::R32Uint, binding, size, "Format", "a float"),
        (
            Format::R32Float,
            attachment,
            size,
            "Usage",
            "TEXTURE_BINDING",
        ),
        (Format::R32Float, binding, [8, 5], "Size", "at least 8x6"),
    ] {
        let picture = plain(format, size, usage);
        refused(
            record(&TemporalInput {
                picture: picture.texture().into(),
                ..good
            }),
            kind,
            name,
            accepted,
        );
    }
    let name = "TemporalInput::target";
    for (format, usage, size, kind, name, accepted) in [
        (
            Format::R16Float,
            attachment,
            size,
            "Mismatch",
            name,
            "R16Float",
        ),
        (
            Format::R8Unorm,
            binding,
            size,
            "Usage",
            name,
            "RENDER_ATTACHMENT",
        ),
        (
            Format::R8Unorm,
            attachment,
            [7, 6],
            "Size",
            name,
            "at least 8x6",
        ),
    ] {
        let target = plain(format, size, usage);
        refused(
            record(&TemporalInput {
                target: target.texture().into(),
                ..good
            }),
            kind,
            name,
            accepted,
        );
    }
    let mut array = descriptor(Format::R8Unorm, size, attachment);
    array.size.depth_or_array_layers = 2;
    let array = device.create_texture(&array);
    record(&TemporalInput {
        target: (&array).into(),
        ..good
    })
    .expect("the first layer of an array");

    // Motion vectors.
    let name = "MotionVectors::texture";
    for (format, usage, size, kind, accepted) in [
        (Format::R32Float, binding, size, "Format", "two components"),
        (Format::Rg32Uint, binding, size, "Format", "a float"),
        (
            Format::Rg16Float,
            attachment,
            size,
            "Usage",
            "TEXTURE_BINDING",
        ),
        (Format::Rg16Float, binding, [4, 6], "Size", "at least 8x6"),
    ] {
        let vectors = plain(format, size, usage);
        let motion = Some(MotionVectors::uv(vectors.texture()));
        refused(
            record(&TemporalInput { motion, ..good }),
            kind,
            name,
            accepted,
        );
    }
    let vectors = plain(Format::Rg16Float, size, binding);
    for bad in [0.0, f32::NAN, f32::INFINITY] {
        let motion = Some(MotionVectors {
            texture: vectors.texture().into(),
            scale: [1.0, bad],
        });
        refused(
            record(&TemporalInput { motion, ..good }),
            "Setting",
            "MotionVectors::scale",
            "not 0",
        );
    }

    // Cameras, G-buffers and histories.
    let small = straight(EYE, Viewport::full(7, 6));
    refused(
        record(&TemporalInput {
            previous_camera: &small,
            ..good
        }),
        "Mismatch",
        "previous_camera",
        "[8, 6]",
    );
    let mut decoded = Decoded::of(&small);
    let frame = decoded.frame(&mut gpu.encoder(), shot.gbuffer(), &small, small.focus());
    refused(
        record(&TemporalInput {
            frame: &frame,
            previous_camera: &small,
            ..good
        }),
        "Mismatch",
        "TemporalHistory",
        "[7, 6]",
    );
    let standard = TemporalSettings::default();
    let zero = TemporalSettings {
        max_frames: 0,
        ..standard
    };
    let mut encoder = gpu.encoder();
    refused(
        one.record(device, &mut encoder, &good, &zero, &mut ones),
        "Setting",
        "::max_frames",
        "1 or more",
    );
    refused(
        one.record(device, &mut encoder, &good, &standard, &mut threes),
        "Mismatch",
        "TemporalHistory",
        "One",
    );
    let narrow = plain(Format::Rg16Float, size, binding);
    refused(
        three.record(
            device,
            &mut encoder,
            &TemporalInput {
                picture: narrow.texture().into(),
                ..good
            },
            &standard,
            &mut threes,
        ),
        "Format",
        "TemporalInput::picture",
        "three components",
    );
}

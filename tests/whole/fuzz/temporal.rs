//! Pictures accumulated over a few frames.

use deep_screen_space::{
    Camera, Channels, MotionVectors, TemporalAccumulator, TemporalInput, TemporalSettings,
    Viewport,
    wgpu::{TextureFormat as Format, TextureUsages},
};

use super::{
    case::Case,
    inputs::{self, Part},
};

pub fn record(case: &mut Case<'_>) {
    let _ = steps(case);
}

fn steps(case: &mut Case<'_>) -> Option<()> {
    let device = case.device();
    let channels = case.usual("channels", &[Channels::One, Channels::Three]);
    let format = inputs::target_format(case);
    let pass = case.once((channels, format), |device| {
        TemporalAccumulator::new(device, channels, format)
    })?;
    let viewport = inputs::viewport(case);
    let Viewport { width, height, .. } = viewport;
    let history = pass.create_history(device, width, height);
    let mut history = case.accept(history)?;
    let settings = TemporalSettings {
        max_frames: case.random.one_of(&[1, 2, 32, 1 << 24, u32::MAX]),
        depth_tolerance: case.random.scale(0.0, f32::MAX),
        normal_tolerance: case.random.setting(-1.0, 1.0),
        clamping: case.random.setting(0.0, 100.0),
    };
    case.note("temporal", settings);
    let mut camera = inputs::camera_of(case, viewport);
    let mut previous = camera;
    for _ in 0..=case.random.below(3) {
        frame(
            case,
            &pass,
            [&camera, &previous],
            (channels, format),
            &settings,
            &mut history,
        )?;
        previous = camera;
        if case.random.chance(0.5) {
            camera = inputs::camera_at(case, viewport, previous.eye());
        }
        if case.random.breaks() {
            camera = inputs::camera(case);
        }
    }
    case.texture("means", history.means().texture());
    Some(())
}

fn frame(
    case: &mut Case<'_>,
    pass: &TemporalAccumulator,
    [camera, previous]: [&Camera; 2],
    (channels, format): (Channels, Format),
    settings: &TemporalSettings,
    history: &mut deep_screen_space::TemporalHistory,
) -> Option<()> {
    let viewport = camera.viewport();
    let drawn = inputs::gbuffer(case, camera, false);
    let formats: &[Format] = match channels {
        Channels::One => &[Format::R32Float, Format::R8Unorm, Format::Rg16Float],
        Channels::Three => &[
            Format::Rgba32Float,
            Format::Rgba16Float,
            Format::Rgba8UnormSrgb,
        ],
    };
    let picture_format = case.usual("picture", formats);
    let brightness = case.random.scale(1e-6, 1e4);
    let picture = inputs::image(case, "picture", picture_format, viewport, |x, y| {
        [0, 1, 2, 3].map(|c| ((x * 7 + y * 3 + c) % 11) as f32 * brightness)
    });
    let motion = case.random.chance(0.4).then(|| {
        let formats = [Format::Rg32Float, Format::Rg16Float, Format::Rgba16Float];
        let format = case.usual("motion", &formats);
        inputs::image(case, "motion", format, viewport, |x, y| {
            [(x % 3) as f32 * 0.1, (y % 2) as f32 * -0.1, 0.0, 0.0]
        })
    });
    let scale = std::array::from_fn(|_| {
        if case.random.breaks() {
            case.random.odd()
        } else {
            case.random.one_of(&[1.0, -1.0, 0.5, 1e-30, 1e30])
        }
    });
    let motion = motion
        .as_ref()
        .map(Part::slice)
        .map(|texture| MotionVectors { texture, scale });
    let target = inputs::target(case, format, viewport, TextureUsages::RENDER_ATTACHMENT);
    let mut decoding = inputs::Decoding::new(case, viewport)?;
    let origin = if case.random.chance(0.5) {
        camera.focus()
    } else {
        camera.eye()
    };
    let frame = decoding.frame(case, drawn.gbuffer(), camera, origin)?;
    let input = TemporalInput {
        frame: &frame,
        previous_camera: previous,
        motion,
        picture: picture.slice(),
        target: target.slice(),
        reset: case.random.chance(0.1),
        timestamps: case.timestamps(),
    };
    let done = pass.record(case.device(), &mut case.encoder, &input, settings, history);
    case.accept(done)?;
    case.texture("mean", &target.texture);
    Some(())
}

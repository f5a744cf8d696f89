//! An accumulator with the mirror's beside it, and how far they may be apart.

use deep_screen_space::{
    Camera, Channels, MotionVectors, TemporalAccumulator, TemporalHistory, TemporalInput,
    TemporalSettings,
    glam::{DVec2, DVec3},
    reference::temporal_accumulator::{Accumulation, History, Pixel},
    wgpu::{self, TextureFormat as Format},
};

use support::{gpu::Gpu, testing::frames::Decoded};

use super::room::{Shot, placed, texture_size};

/// True means, and histories that only geometry ends.
pub const RUNNING: TemporalSettings = TemporalSettings {
    max_frames: u32::MAX,
    depth_tolerance: 0.02,
    normal_tolerance: 0.9,
    clamping: 0.0,
};

/// An accumulator and one view's history, with the mirror's beside it.
pub struct Rig<'g> {
    pub gpu: &'g Gpu,
    pub channels: Channels,
    pub accumulator: TemporalAccumulator,
    pub history: TemporalHistory,
    pub previous: Option<Camera>,
    pub mirror: Option<History>,
    pub settings: TemporalSettings,
    pub frames: u32,
}

/// What a frame of the caller is made of, but for the G-buffer.
#[derive(Clone, Copy, Default)]
pub struct Frame<'a> {
    pub picture: &'a [DVec3],
    /// In pixels.
    pub motion: Option<&'a [DVec2]>,
    pub reset: bool,
}

impl<'g> Rig<'g> {
    pub fn new(
        gpu: &'g Gpu,
        channels: Channels,
        size: [u32; 2],
        settings: TemporalSettings,
    ) -> Self {
        let format = match channels {
            Channels::One => Format::R32Float,
            Channels::Three => Format::Rgba32Float,
        };
        let accumulator =
            TemporalAccumulator::new(&gpu.device, channels, format).expect("a target");
        let history = accumulator
            .create_history(&gpu.device, size[0], size[1])
            .expect("a history");
        Self {
            gpu,
            channels,
            accumulator,
            history,
            previous: None,
            mirror: None,
            settings,
            frames: 0,
        }
    }

    /// Accumulates a frame on both sides; returns what the GPU shows and counts. What is shown must be what is kept, and
    /// nothing around the viewport may change.
    pub fn step(&mut self, shot: &Shot, frame: Frame<'_>) -> Vec<Pixel> {
        let gpu = self.gpu;
        let viewport = shot.camera.viewport();
        let [width, height] = texture_size(viewport);
        let size = DVec2::new(f64::from(viewport.width), f64::from(viewport.height));
        let previous = self.previous.unwrap_or(shot.camera);
        let floats: Vec<[f32; 4]> = (frame.picture.iter())
            .map(|v| v.as_vec3().extend(0.0).to_array())
            .collect();
        let (format, picture) = match self.channels {
            Channels::One => {
                let one: Vec<f32> = floats.iter().map(|v| v[0]).collect();
                let format = Format::R32Float;
                (format, placed(gpu, viewport, format, &one, 7.0))
            }
            Channels::Three => {
                let format = Format::Rgba32Float;
                (format, placed(gpu, viewport, format, &floats, [7.0; 4]))
            }
        };
        let motion: Option<Vec<[f32; 2]>> = frame.motion.map(|all| {
            all.iter()
                .map(|v| (*v / size).as_vec2().to_array())
                .collect()
        });
        let motion_view = motion
            .as_ref()
            .map(|motion| placed(gpu, viewport, Format::Rg32Float, motion, [0.0; 2]));
        let target = gpu.target(format, width, height);
        let mut encoder = gpu.encoder();
        clear(&mut encoder, &target);
        let mut decoded = Decoded::of(&shot.camera);
        // Whatever positions are relative to, histories are the same.
        self.frames += 1;
        let origin = match self.frames % 3 {
            0 => shot.camera.focus(),
            1 => shot.camera.eye(),
            _ => shot.camera.eye() + DVec3::new(0.25, -0.5, 1.0),
        };
        let decoded = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, origin);
        let input = TemporalInput {
            motion: motion_view
                .as_ref()
                .map(|view| MotionVectors::uv(view.texture())),
            reset: frame.reset,
            ..TemporalInput::new(&decoded, &previous, picture.texture(), target.texture())
        };
        self.accumulator
            .record(
                &gpu.device,
                &mut encoder,
                &input,
                &self.settings,
                &mut self.history,
            )
            .expect("a frame");
        gpu.finish(encoder);

        // The mirror gets what the GPU's formats hold of it.
        let seen: Vec<DVec3> = (frame.picture.iter())
            .map(|v| match self.channels {
                Channels::One => DVec3::new(f64::from(v.x as f32), 0.0, 0.0),
                Channels::Three => v.as_vec3().as_dvec3(),
            })
            .collect();
        let motion: Option<Vec<DVec2>> = motion.map(|all| {
            all.iter()
                .map(|v| DVec2::from(v.map(f64::from)) * size)
                .collect()
        });
        let next = Accumulation {
            camera: &shot.camera,
            previous_camera: &previous,
            receivers: &shot.receivers,
            motion: motion.as_deref(),
            picture: &seen,
            settings: &self.settings,
        }
        .accumulate(self.mirror.as_ref().filter(|_| !frame.reset));
        self.mirror = Some(next);
        self.previous = Some(shot.camera);

        let kept = self.kept();
        let shown: Vec<[f32; 4]> = match self.channels {
            Channels::One => gpu
                .read_texture::<f32>(target.texture(), 0)
                .into_iter()
                .map(|v| [v, 0.0, 0.0, 1.0])
                .collect(),
            Channels::Three => gpu.read_texture(target.texture(), 0),
        };
        let mut inside = 0;
        for (i, v) in (0..).zip(&shown) {
            let [x, y] = [i % width, i / width].map(i64::from);
            let [x, y] = [x - i64::from(viewport.x), y - i64::from(viewport.y)];
            if (0..i64::from(viewport.width)).contains(&x)
                && (0..i64::from(viewport.height)).contains(&y)
            {
                let mean = kept[inside].mean.as_vec3();
                assert_eq!(
                    [v[0], v[1], v[2]].map(f32::to_bits),
                    mean.to_array().map(f32::to_bits)
                );
                assert_eq!(v[3], 1.0);
                inside += 1;
            } else {
                assert_eq!(v[0], 9.0, "outside of the viewport at {x}, {y}");
            }
        }
        kept
    }

    /// The GPU's history.
    pub fn kept(&self) -> Vec<Pixel> {
        let texture = self.history.means().texture();
        let pixel = |mean: [f32; 3], frames: f32| Pixel {
            mean: DVec3::from(mean.map(f64::from)),
            frames: f64::from(frames),
        };
        match self.channels {
            Channels::One => (self.gpu.read_texture::<[f32; 2]>(texture, 0).into_iter())
                .map(|[mean, frames]| pixel([mean, 0.0, 0.0], frames))
                .collect(),
            Channels::Three => (self.gpu.read_texture::<[f32; 4]>(texture, 0).into_iter())
                .map(|[r, g, b, frames]| pixel([r, g, b], frames))
                .collect(),
        }
    }

    pub fn expected(&self) -> &[Pixel] {
        &self.mirror.as_ref().expect("a step before").pixels
    }
}

pub fn clear(encoder: &mut wgpu::CommandEncoder, target: &wgpu::TextureView) {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color {
                    r: 9.0,
                    g: 9.0,
                    b: 9.0,
                    a: 9.0,
                }),
                store: wgpu::StoreOp::Store,
            },
        })],
        ..Default::default()
    });
}

/// How far off a mean may be: f32 places a history to some 1e-5 of a pixel in a picture of 100, and from pixel to pixel
/// the test's pictures change by 0.1.
pub const TOLERANCE: f64 = 1e-5;

/// Which share may be further off: those whose taps lie at a tolerance, which f32 takes on the other side, and those
/// that fetch from them in the frames that follow.
pub const EXCEPTIONS: f64 = 2e-3;

/// How many pixels are beyond the tolerance, in mean or (relative) in frames, and how far the farthest within the rest.
pub fn differences(found: &[Pixel], expected: &[Pixel]) -> (usize, f64) {
    assert_eq!(found.len(), expected.len());
    let off = |(f, e): (&Pixel, &Pixel)| {
        let mean = (f.mean - e.mean).abs().max_element();
        // A count comes of weights that are off by a few 1e-5 where they are small.
        let frames = 0.05 * (f.frames - e.frames).abs() / e.frames.max(1.0);
        if f.mean.is_finite() {
            mean.max(frames)
        } else {
            f64::INFINITY
        }
    };
    let all: Vec<f64> = found.iter().zip(expected).map(off).collect();
    (
        all.iter().filter(|e| **e > TOLERANCE).count(),
        all.iter()
            .copied()
            .filter(|e| *e <= TOLERANCE)
            .fold(0.0, f64::max),
    )
}

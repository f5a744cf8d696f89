//! A device, a hull on it, and all that a recording leaves.

use std::sync::LazyLock;

use deep_screen_space::{
    Camera, Components, Gatherer, GathererBinding, HullSegment, HullVertex, Light, SgHull,
    SgHullCounts, SgHullDescriptor, SgHullInput, SgHullSettings, SgHullSize,
    glam::DVec3,
    wgpu::{self, TextureFormat as Format},
};

use support::{
    gpu::Gpu,
    testing::{frames::Decoded, pipelines, shot::Shot},
};

pub const SKY: u32 = 0xffff_ffff;

pub const FORMAT: Format = Format::Rgba32Float;

/// What no pixel is.
const UNTOUCHED: f64 = -7.0;

pub fn hull(gpu: &Gpu, gatherer: &Gatherer, components: Components) -> SgHull {
    let descriptor = SgHullDescriptor {
        gatherer,
        target: FORMAT,
        albedo: false,
        glossy: false,
        components,
    };
    SgHull::new(&gpu.device, &descriptor).expect("pipelines")
}

/// What most tests need: drivers compile for seconds.
pub struct Lab {
    pub gpu: &'static Gpu,
    pub gatherer: Gatherer,
    pub hull: SgHull,
}

pub static LAB: LazyLock<Lab> = LazyLock::new(|| {
    let gpu = pipelines::gpu();
    let gatherer = Gatherer::lights(&gpu.device);
    let hull = hull(gpu, &gatherer, Components::UnionFind);
    Lab {
        gpu,
        gatherer,
        hull,
    }
});

/// All that a recording left.
pub struct Recorded {
    pub size: SgHullSize,
    pub counts: SgHullCounts,
    pub segment_of: Vec<u32>,
    pub segments: Vec<HullSegment>,
    pub vertices: Vec<HullVertex>,
    /// Of the viewport.
    pub pixels: Vec<[f32; 4]>,
}

impl Recorded {
    /// The place of a segment among the vertices.
    pub fn index(&self, slot: u32) -> u32 {
        let regular = self.counts.segments.min(self.size.segments);
        if slot < self.size.segments {
            slot
        } else {
            regular + slot - self.size.segments
        }
    }
}

pub fn record(
    gpu: &Gpu,
    hull: &SgHull,
    shot: &Shot,
    gather: &GathererBinding,
    settings: &SgHullSettings,
    size: SgHullSize,
) -> Recorded {
    let device = &gpu.device;
    let viewport = shot.camera.viewport();
    let view = hull.create_view(device, size).expect("a view");
    let [width, height] = [viewport.x + viewport.width, viewport.y + viewport.height];
    let target = gpu.target(FORMAT, width, height);
    let mut encoder = gpu.encoder();
    clear(&mut encoder, &target);
    let camera = &shot.camera;
    let mut decoded = Decoded::of(camera);
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), camera, camera.eye());
    let input = SgHullInput::new(&frame, Some(gather), target.texture());
    hull.record(device, &mut encoder, &input, settings, &view)
        .expect("it fits");
    gpu.finish(encoder);
    let texels: Vec<[f32; 4]> = gpu.read_texture(target.texture(), 0);
    let counts: Vec<SgHullCounts> = gpu.read_buffer(view.counts());
    Recorded {
        size,
        counts: counts[0],
        segment_of: gpu.read_buffer(view.segment_of()),
        segments: gpu.read_buffer(view.segments()),
        vertices: gpu.read_buffer(view.vertices()),
        pixels: (0..viewport.width * viewport.height)
            .map(|i| {
                let [x, y] = [
                    i % viewport.width + viewport.x,
                    i / viewport.width + viewport.y,
                ];
                texels[(y * width + x) as usize]
            })
            .collect(),
    }
}

fn clear(encoder: &mut wgpu::CommandEncoder, target: &wgpu::TextureView) {
    let color = wgpu::Color {
        r: UNTOUCHED,
        g: UNTOUCHED,
        b: UNTOUCHED,
        a: UNTOUCHED,
    };
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(color),
                store: wgpu::StoreOp::Store,
            },
        })],
        ..Default::default()
    });
}

pub fn lamps() -> Vec<Light> {
    vec![
        Light::Point {
            position: DVec3::new(0.4, 2.6, 0.7),
            intensity: [9.0, 7.0, 5.0],
        },
        Light::Point {
            position: DVec3::new(-1.1, 1.9, 2.0),
            intensity: [1.0, 2.0, 4.0],
        },
        Light::Directional {
            direction: DVec3::new(0.4, -1.0, -0.3),
            irradiance: [0.3, 0.5, 0.2],
        },
    ]
}

/// Every pixel is covered, by a quad whose bounds it lies in, and is a number.
#[track_caller]
pub fn check_covered(recorded: &Recorded, shot: &Shot, name: &str) {
    let viewport = shot.camera.viewport();
    let receivers = shot.receivers(shot.camera.eye());
    let mut uncovered = 0;
    for (i, (pixel, slot)) in recorded.pixels.iter().zip(&recorded.segment_of).enumerate() {
        if pixel[3] != 1.0 {
            uncovered += 1;
            continue;
        }
        assert!(
            pixel.iter().all(|c| c.is_finite() && *c >= 0.0),
            "{name}: pixel {i} is {pixel:?}"
        );
        if *slot == SKY {
            assert_eq!(*pixel, [0.0, 0.0, 0.0, 1.0], "{name}: sky pixel {i}");
            continue;
        }
        let segment = recorded.segments[*slot as usize];
        let [x, y] = [i as u32 % viewport.width, i as u32 / viewport.width];
        let [left, top, right, bottom] = segment.rect;
        assert!(
            (left..right).contains(&x) && (top..bottom).contains(&y),
            "{name}: pixel {x}, {y} is not in {segment:?}"
        );
        if let Some(receiver) = &receivers[i] {
            let depth = receiver.position.dot(axis(&shot.camera));
            let slack = 1e-4 * depth.abs() + 1e-6;
            assert!(
                depth >= f64::from(segment.nearest) - slack
                    && depth <= f64::from(segment.farthest) + slack,
                "{name}: pixel {x}, {y} at {depth} is not in {segment:?}"
            );
        }
    }
    assert_eq!(
        uncovered,
        0,
        "{name}: uncovered of {}",
        recorded.pixels.len()
    );
}

/// Away from the camera: along the ray through the middle.
fn axis(camera: &Camera) -> DVec3 {
    let rotation = camera.rotation();
    -rotation.row(2)
}

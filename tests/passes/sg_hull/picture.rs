//! The picture against light gathered at every pixel.

use deep_screen_space::{Camera, Components, GathererBinding, SgHullCounts, SgHullSize, scenes};

use support::{
    gpu::Gpu,
    hull::{HullRenderer, LightSource, difference},
    raster::Raster,
    scene::SceneBuffers,
    testing::{pipelines, shot::camera_of},
};

/// A scene drawn for a hull, and its lamp.
struct Stage {
    gpu: &'static Gpu,
    lamp: LightSource,
    buffers: SceneBuffers,
    camera: Camera,
    raster: Raster,
}

type Picture = Vec<[f32; 4]>;

impl Stage {
    fn new(name: &str, size: [u32; 2]) -> Self {
        let gpu = pipelines::gpu();
        let scene = scenes::by_name(name).expect("a scene");
        let camera = camera_of(&scene, 0, size);
        let buffers = SceneBuffers::new(gpu, &scene);
        Self {
            lamp: LightSource::of(&scene).expect("a lamp"),
            raster: Raster::draw(gpu, &buffers, &camera),
            gpu,
            buffers,
            camera,
        }
    }

    fn renderer(&self, size: SgHullSize) -> (HullRenderer, GathererBinding) {
        let mut renderer =
            HullRenderer::new(self.gpu, size, Components::default()).expect("it fits");
        let lights = renderer
            .lights(self.gpu, &self.buffers, &self.lamp, self.camera.eye())
            .expect("lights");
        (renderer, lights)
    }

    fn picture(
        &self,
        renderer: &mut HullRenderer,
        lights: &GathererBinding,
    ) -> (Picture, SgHullCounts) {
        let rendered = renderer.render(self.gpu, &self.raster, &self.camera, lights);
        (rendered.expect("a picture").1, renderer.counts(self.gpu))
    }

    fn truth(&self, renderer: &mut HullRenderer, lights: &GathererBinding) -> Picture {
        let rendered = renderer.render_per_pixel(self.gpu, &self.raster, &self.camera, lights);
        rendered.expect("a picture").1
    }
}

/// Against light gathered at every pixel. The bars are those for whole pictures; these are small ones, whose quads are
/// as much coarser.
#[test]
fn picture_is_close_to_the_truth() {
    let stage = Stage::new("cornell", [256, 256]);
    let (mut renderer, lights) = stage.renderer(SgHullSize::new(256, 256));
    let (found, counts) = stage.picture(&mut renderer, &lights);
    let truth = stage.truth(&mut renderer, &lights);
    let off = difference(&found, &truth, 256);
    println!("{off:?}, {counts:?}");
    assert!(
        off.rmse < 0.03 && off.energy.abs() < 0.02 && off.ratio < 2.0,
        "{off:?}"
    );
    let mean: f32 = truth.iter().map(|p| p[0]).sum::<f32>() / truth.len() as f32;
    assert!(mean > 0.02, "the picture is black: {mean}");
}

/// The error threshold: at 0 the picture is the truth, and between it and infinity the error falls with it. Pixels that
/// find no room are shaded by the hull, tiny segments as well.
#[test]
fn error_threshold_converges() {
    for name in ["fence", "cornell"] {
        let stage = Stage::new(name, [128, 96]);
        let size = SgHullSize::new(128, 96);
        let (mut renderer, lights) = stage.renderer(size);
        let truth = stage.truth(&mut renderer, &lights);
        let mut before = (f64::INFINITY, 0);
        for error_threshold in [f32::INFINITY, 0.5, 0.1, 0.0] {
            renderer.settings.error_threshold = error_threshold;
            let (found, counts) = stage.picture(&mut renderer, &lights);
            let off = difference(&found, &truth, 128);
            println!(
                "{name}, {error_threshold}: {off:?}, {} pixels",
                counts.per_pixel
            );
            assert!(
                off.rmse < before.0 && counts.per_pixel > before.1,
                "{name}, {error_threshold}: {off:?} after {before:?}"
            );
            before = (off.rmse, counts.per_pixel);
        }
        // Both gather alike; compilers may contract differently.
        assert!(before.0 < 1e-5, "{name}: {before:?}");

        let size = SgHullSize {
            per_pixel: 50,
            ..size
        };
        let (mut few, lights) = stage.renderer(size);
        few.settings.error_threshold = 0.0;
        let (found, counts) = stage.picture(&mut few, &lights);
        assert_eq!(
            counts.per_pixel_overflow(&size),
            before.1 - 50,
            "{counts:?}"
        );
        assert_eq!(counts.points[0], 50, "{counts:?}");
        let off = difference(&found, &truth, 128);
        println!("{name}, 50 pixels: {off:?}");
        assert!(off.energy.abs() < 0.05, "{name}: {off:?}");
    }
}

/// Splits that find no room have their pixels gathered: they cost more and err less.
#[test]
fn splits_without_room_are_pixels() {
    let stage = Stage::new("cornell", [256, 256]);
    let [many, few] = [32768, 2].map(|splits| {
        let size = SgHullSize {
            splits,
            ..SgHullSize::new(256, 256)
        };
        let (mut renderer, lights) = stage.renderer(size);
        let (found, counts) = stage.picture(&mut renderer, &lights);
        let off = difference(&found, &stage.truth(&mut renderer, &lights), 256).rmse;
        println!("room for {splits}: {off}, {counts:?}");
        (counts, counts.split_overflow(&size), off)
    });
    assert!(many.0.parts[1] > 100 && many.1 == 0);
    assert!(few.0.parts[1] <= 8 && few.1 > 10);
    assert!(many.0.per_pixel < few.0.per_pixel && many.2 > few.2);
}

//! `HullLights` and `HullView`: the same as the passes by hand, over sizes, and what they refuse.

use deep_screen_space::{
    Components, HullInput, HullLights, HullLightsInput, HullView, SgHullCounts, SgHullDescriptor,
    SgHullSettings, SgHullSize, glam::DVec3, scenes, wgpu::TextureFormat as Format,
};
use support::{
    hull::{HullRenderer, LightSource},
    raster::{Raster, camera_of},
    scene::SceneBuffers,
    testing::{pipelines, refusals::refused},
};

#[test]
fn pictures_are_those_of_the_passes_by_hand() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let scene = scenes::by_name("cornell").expect("a scene");
    let buffers = SceneBuffers::new(gpu, &scene);
    let lamp = LightSource::of(&scene).expect("a lamp");
    let lit = Raster::draw(gpu, &buffers, &lamp.camera);
    let mut lights = HullLights::new(device).expect("pipelines");
    let descriptor = SgHullDescriptor {
        gatherer: lights.gatherer(),
        target: Format::Rgba32Float,
        albedo: true,
        glossy: false,
        components: Components::default(),
    };
    let settings = SgHullSettings::default();
    let mut view = HullView::new(device, &descriptor, settings).expect("pipelines");
    let unfit = SgHullSettings {
        quad: 5,
        ..settings
    };
    refused(
        view.set_settings(unfit),
        "Setting",
        "SgHullSettings::quad",
        "4, 8, 16 or 32",
    );
    assert_eq!([lights.memory_bytes(), view.memory_bytes()], [0; 2]);
    assert!(view.counts().is_none() && lights.bound().is_none());

    // What has another size is made anew: the second one's is what counts.
    for [width, height] in [[48, 32], [80, 60]] {
        let camera = camera_of(&scene, [width, height]);
        let raster = Raster::draw(gpu, &buffers, &camera);
        let target = gpu.target(Format::Rgba32Float, width, height);
        let mut encoder = gpu.encoder();
        if width == 48 {
            let input = HullInput::new(raster.gbuffer(), &camera, &lights, target.texture());
            let none = view.record(device, &mut gpu.encoder(), &input);
            refused(none, "Mismatch", "SgHullInput::gather", "layout");
        }
        let input = HullLightsInput {
            gbuffer: lit.gbuffer(),
            camera: &lamp.camera,
            light: lamp.light,
            origin: camera.eye(),
        };
        lights.record(device, &mut encoder, &input).expect("lights");
        let input = HullInput::new(raster.gbuffer(), &camera, &lights, target.texture());
        view.record(device, &mut encoder, &input)
            .expect("a picture");
        let elsewhere = HullInput {
            origin: camera.eye() + DVec3::X,
            ..input
        };
        let other = view.record(device, &mut gpu.encoder(), &elsewhere);
        refused(other, "Mismatch", "SgHullInput::gather", "");
        gpu.finish(encoder);
        if width == 48 {
            continue;
        }
        let found: Vec<[f32; 4]> = gpu.read_texture(target.texture(), 0);

        let size = SgHullSize::new(width, height);
        let mut by_hand = HullRenderer::new(gpu, size, Components::default()).expect("pipelines");
        let bound = by_hand
            .lights(gpu, &buffers, &lamp, camera.eye())
            .expect("lights");
        let (_, picture) = by_hand
            .render(gpu, &raster, &camera, &bound)
            .expect("a picture");
        assert_eq!(found, picture);
        assert!(
            found.iter().any(|pixel| pixel[0] > 0.05),
            "it shows something"
        );
        let counts: Vec<SgHullCounts> = gpu.read_buffer(view.counts().expect("recorded"));
        assert_eq!(counts[0], by_hand.counts(gpu));
        assert!(view.memory_bytes() > by_hand.view.memory_bytes());
        assert!(lights.memory_bytes() > 0);
    }
}

//! kiss3d's picture with the library, off screen: compared with one that is kept, and with the one without where the library
//! cannot take part.
//!
//! All of it is one test: kiss3d has one device for a thread, and most of the time is that of compiling its shaders.

#[path = "../examples/common/mod.rs"]
mod common;

use deep_screen_space_kiss3d::{Error, RayTracedLighting, Settings, deep_screen_space::scenes};
use image::RgbImage;
use kiss3d::prelude::*;

const SIZE: [u32; 2] = [96, 64];

/// How far apart two pictures are: the share of the pixels that are further off than `most` of 255 in any channel.
fn share_beyond(a: &RgbImage, b: &RgbImage, most: u8) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions());
    let pairs = a.pixels().zip(b.pixels());
    let beyond = pairs.filter(|(a, b)| (0..3).any(|c| a.0[c].abs_diff(b.0[c]) > most));
    beyond.count() as f64 / f64::from(a.width() * a.height())
}

/// What a picture is, beside the one that is kept. `DSS_BLESS` keeps it anew.
fn compare(name: &str, picture: &RgbImage) {
    let path = format!("{}/tests/{name}.png", env!("CARGO_MANIFEST_DIR"));
    if std::env::var_os("DSS_BLESS").is_some() {
        picture
            .save(&path)
            .expect("a folder that can be written to");
    }
    let kept = image::open(&path)
        .expect("a picture that is kept")
        .to_rgb8();
    // Drivers round otherwise, and rays that pass an edge by less than that then meet it: a ray in 16 is 1/16 of visibility,
    // which ambient light and the filter make 6 of 255. Where surfaces are thinner than a pixel, as the rails, drivers differ on
    // who has it: lavapipe and SwiftShader do at 2 % of the pixels of kiss3d's own picture.
    let share = share_beyond(picture, &kept, 6);
    assert!(share <= 0.04, "{name}: {share} of the pixels are off");
}

struct Stage {
    surface: OffscreenSurface,
    nodes: SceneNode3d,
    camera: OrbitCamera3d,
}

impl Stage {
    fn picture(&mut self, lighting: Option<&mut RayTracedLighting>) -> RgbImage {
        let Self {
            surface,
            nodes,
            camera,
        } = self;
        let renderer = lighting.map(|lighting| lighting as &mut dyn Renderer3d);
        pollster::block_on(surface.render(Some(nodes), None, Some(camera), None, renderer, None));
        surface.snap_image()
    }
}

#[test]
fn pictures_with_and_without() {
    assert_eq!(
        RayTracedLighting::new(Settings::default()).err(),
        Some(Error::NoContext)
    );
    let scene = scenes::colonnade();
    let surface = pollster::block_on(OffscreenSurface::new(SIZE[0], SIZE[1]));
    let mut nodes = SceneNode3d::empty();
    common::add(&scene, &mut nodes);
    nodes.add_light(common::sun());
    let camera = common::camera(&scene);
    let mut stage = Stage {
        surface,
        nodes,
        camera,
    };
    stage.surface.set_ambient(0.6);

    let refused = RayTracedLighting::new(Settings {
        occlusion_radius: Some(f32::NAN),
        ..Settings::default()
    });
    assert!(matches!(refused.err(), Some(Error::Library(_))));

    let without = stage.picture(None);
    compare("without", &without);
    let mut lighting = RayTracedLighting::new(Settings {
        occlusion_radius: Some(scene.ao_radius),
        ..Settings::default()
    })
    .expect("a device with the default limits");
    lighting.adopt(&mut stage.nodes);
    let with = stage.picture(Some(&mut lighting));
    assert_eq!(lighting.status(), Ok(()));
    compare("with", &with);
    // It is no picture of nothing: a tenth of the pixels at least are another grey.
    assert!(share_beyond(&with, &without, 10) > 0.1);
    assert!(lighting.memory_bytes() > 0);

    // What moves is seen where it is: nothing is kept of a frame. Up and away, and the picture is the background's.
    let away = Vec3::new(0.0, 1e4, 0.0);
    stage.nodes.set_position(away);
    let gone = stage.picture(Some(&mut lighting));
    assert_eq!(lighting.status(), Ok(()));
    assert!(gone.pixels().all(|p| p.0 == gone.get_pixel(0, 0).0));
    stage.nodes.set_position(Vec3::ZERO);
    // And hidden nothing is drawn at all, light of the frame before included.
    stage.nodes.set_visible(false);
    let hidden = stage.picture(Some(&mut lighting));
    assert_eq!(share_beyond(&hidden, &gone, 0), 0.0);
    stage.nodes.set_visible(true);
    let back = stage.picture(Some(&mut lighting));
    // The same work on the same machine.
    assert_eq!(share_beyond(&back, &with, 0), 0.0);

    // A film of four samples: the library's picture has one, so that edges alone differ, and there are many.
    stage.surface.set_samples(NumSamples::Four);
    let smooth = stage.picture(Some(&mut lighting));
    assert_eq!(lighting.status(), Ok(()));
    assert!(share_beyond(&smooth, &with, 10) < 0.3);
    stage.surface.set_samples(NumSamples::One);

    // A mesh that is on the GPU alone, in buffers that shaders may not read: kiss3d draws on, without the effect.
    let mut meshes = Vec::new();
    stage
        .nodes
        .apply_to_objects_recursive(&mut |object| meshes.push(object.mesh().clone()));
    let coords = meshes[0].borrow().coords().clone();
    coords.write().expect("no other thread").unload_from_ram();
    lighting.adopt(&mut stage.nodes);
    let refused = stage.picture(Some(&mut lighting));
    let error = lighting.status().expect_err("vertices that cannot be read");
    assert!(matches!(
        error,
        Error::Mesh {
            object: 0,
            what: "vertices"
        }
    ));
    assert!(error.to_string().contains("STORAGE"), "{error}");
    // The occlusion is 1 everywhere, which kiss3d multiplies by: a rounding at most.
    assert_eq!(share_beyond(&refused, &without, 1), 0.0);

    lighting.release(&mut stage.nodes);
    let released = stage.picture(None);
    assert_eq!(share_beyond(&released, &without, 0), 0.0);
}

//! Bevy's picture with the library, off screen: compared with one that is kept, and with the one without where the library
//! cannot take part.
//!
//! All but one of it is one test: most of the time is that of compiling Bevy's shaders.

#[path = "../examples/common/mod.rs"]
mod common;

use bevy::{
    asset::RenderAssetUsages,
    camera::{ScalingMode, Viewport, primitives::Aabb},
    core_pipeline::{
        deferred::Opaque3dDeferred,
        prepass::{DeferredPrepass, MotionVectorPrepass, NormalPrepass},
        tonemapping::{DebandDither, Tonemapping},
    },
    light::NotShadowCaster,
    material::OpaqueRendererMethod,
    mesh::PrimitiveTopology,
    pbr::ScreenSpaceAmbientOcclusion,
    prelude::*,
    render::{
        RenderApp, camera::TemporalJitter, mesh::allocator::MeshAllocatorSettings,
        render_phase::ViewBinnedRenderPhases, render_resource::AsBindGroup, renderer::RenderDevice,
        settings::WgpuLimits, view::Msaa,
    },
};
use common::Headless;
use deep_screen_space_bevy::{
    DeepScreenSpacePlugin, Error, OccludingMaterialPlugin, RayTracedAmbientOcclusion,
    RayTracingStatus, deep_screen_space::Quality,
};
use image::RgbImage;

const SIZE: [u32; 2] = [96, 64];

/// How far apart two pictures are: the share of the pixels that are further off than `most` of 255 in any channel.
fn share_beyond(a: &RgbImage, b: &RgbImage, most: u8) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions());
    let pairs = a.pixels().zip(b.pixels());
    let beyond = pairs.filter(|(a, b)| (0..3).any(|c| a.0[c].abs_diff(b.0[c]) > most));
    beyond.count() as f64 / f64::from(a.width() * a.height())
}

/// How far apart two pictures are, root mean square of the greens.
fn off_by(a: &RgbImage, b: &RgbImage) -> f64 {
    let pairs = a.pixels().zip(b.pixels());
    let squares = pairs.map(|(a, b)| f64::from(a.0[1].abs_diff(b.0[1])).powi(2));
    (squares.sum::<f64>() / f64::from(a.width() * a.height())).sqrt()
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
    // which ambient light and the filter make 6 of 255. Where a pixel's centre is on an edge drivers differ on who has it.
    let share = share_beyond(picture, &kept, 6);
    assert!(share <= 0.02, "{name}: {share} of the pixels are off");
}

/// A material of another type than Bevy's.
#[derive(Asset, TypePath, AsBindGroup, Clone)]
struct Other {}

impl Material for Other {}

/// A plane with a box and a ball on it.
struct Stage {
    bevy: Headless,
    camera: Entity,
    cube: Entity,
}

impl Stage {
    fn new(limits: Option<WgpuLimits>) -> Self {
        let mut bevy = Headless::new(SIZE, limits, |app| {
            app.add_plugins((
                DeepScreenSpacePlugin,
                MaterialPlugin::<Other>::default(),
                OccludingMaterialPlugin::<Other>::default(),
            ));
        });
        bevy.app
            .add_systems(Last, |mut jitters: Query<&mut TemporalJitter>| {
                for mut jitter in &mut jitters {
                    jitter.offset *= -1.0;
                }
            });
        let target = bevy.target();
        let world = bevy.app.world_mut();
        let white = world
            .resource_mut::<Assets<StandardMaterial>>()
            .add(StandardMaterial {
                base_color: Color::linear_rgb(0.5, 0.5, 0.5),
                ..common::matt()
            });
        let mut add = |mesh: Mesh, x: f32, y: f32, z: f32| {
            let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh);
            let place = Transform::from_xyz(x, y, z);
            world
                .spawn((Mesh3d(mesh), MeshMaterial3d(white.clone()), place))
                .id()
        };
        // Of no vertices, for which Bevy keeps nothing.
        let nothing = Mesh::new(
            PrimitiveTopology::TriangleList,
            RenderAssetUsages::default(),
        );
        let nothing = add(
            nothing.with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, Vec::<[f32; 3]>::new()),
            0.0,
            0.0,
            0.0,
        );
        add(
            Plane3d::default().mesh().size(40.0, 40.0).build(),
            0.0,
            0.0,
            0.0,
        );
        let cube = add(Cuboid::new(1.4, 1.4, 1.4).into(), -0.9, 0.7, 0.0);
        add(
            Sphere::new(0.7)
                .mesh()
                .ico(5)
                .expect("few enough triangles"),
            1.4,
            0.7,
            0.4,
        );
        // As the others have it, which it is then met before.
        world.entity_mut(nothing).insert(Aabb::default());
        world.insert_resource(GlobalAmbientLight {
            brightness: 2500.0,
            ..default()
        });
        let eye = Transform::from_xyz(0.0, 3.0, 6.0).looking_at(Vec3::new(0.0, 0.2, 0.0), Vec3::Y);
        let camera = (
            Camera3d::default(),
            Msaa::Off,
            Tonemapping::None,
            DebandDither::Disabled,
            eye,
            target,
        );
        let camera = world.spawn(camera).id();
        Self { bevy, camera, cube }
    }

    fn world(&mut self) -> &mut World {
        self.bevy.app.world_mut()
    }

    fn give(&mut self, to: Entity, what: impl Bundle) {
        self.world().entity_mut(to).insert(what);
    }

    /// Has the camera draw into a part of the picture: its place and size.
    fn part(&mut self, part: Option<([u32; 2], [u32; 2])>) {
        let mut camera = self.bevy.app.world_mut().entity_mut(self.camera);
        let mut camera = camera.get_mut::<Camera>().expect("a camera");
        camera.viewport = part.map(|(place, size)| Viewport {
            physical_position: place.into(),
            physical_size: size.into(),
            ..default()
        });
    }

    /// Has the materials drawn by a method.
    fn draw_by(&mut self, method: OpaqueRendererMethod) {
        let mut materials = self.world().resource_mut::<Assets<StandardMaterial>>();
        let ids: Vec<_> = materials.ids().collect();
        for id in ids {
            let mut material = materials.get_mut(id).expect("a material");
            material.opaque_render_method = method;
        }
    }

    fn projection(&self) -> Projection {
        let camera = self.bevy.app.world().entity(self.camera);
        camera.get::<Projection>().expect("a camera").clone()
    }

    /// The picture, and what became of its frame.
    fn picture(&mut self) -> (RgbImage, Option<Result<(), Error>>) {
        let picture = self.bevy.picture();
        let camera = self.camera;
        (
            picture,
            self.world().resource::<RayTracingStatus>().of(camera),
        )
    }

    /// The library's and its own buffers and textures, by their labels.
    fn allocations(&self) -> Vec<String> {
        let device = self.bevy.app.world().resource::<RenderDevice>();
        let report = device.wgpu_device().generate_allocator_report();
        let all = report.expect("Vulkan has one").allocations.into_iter();
        all.map(|allocation| allocation.name)
            .filter(|name| name.starts_with("deep-screen-space"))
            .collect()
    }

    /// The grey of the ground at a point of it.
    fn ground(&self, picture: &RgbImage, x: f32, z: f32) -> u8 {
        let camera = self.bevy.app.world().entity(self.camera);
        let place = camera.get::<GlobalTransform>().expect("a place");
        let camera = camera.get::<Camera>().expect("a camera");
        let pixel = camera
            .world_to_viewport(place, Vec3::new(x, 0.0, z))
            .expect("in the picture");
        picture.get_pixel(pixel.x as u32, pixel.y as u32).0[1]
    }
}

const OCCLUSION: RayTracedAmbientOcclusion = RayTracedAmbientOcclusion {
    radius: 2.0,
    quality: Quality::Balanced,
    frames: 1,
};

#[test]
fn pictures_with_and_without() {
    let mut stage = Stage::new(None);
    let (camera, cube) = (stage.camera, stage.cube);
    let (without, status) = stage.picture();
    assert_eq!(status, None);
    compare("without", &without);
    stage.give(camera, OCCLUSION);
    let (with, status) = stage.picture();
    assert_eq!(status, Some(Ok(())));
    compare("with", &with);

    // Before the box the ground is darker, where all is open it is what it was, and the picture is not all dark.
    let contact = (-0.9, 0.8);
    let [dark, light] = [&with, &without].map(|p| stage.ground(p, contact.0, contact.1));
    assert!(
        dark < light - 20,
        "{dark} in place of {light} before the box"
    );
    for (x, z) in [(-2.4, 2.9), (0.0, 2.9), (2.4, 2.9)] {
        assert_eq!(
            stage.ground(&with, x, z),
            stage.ground(&without, x, z),
            "at {x}, {z}"
        );
    }
    let changed = share_beyond(&with, &without, 2);
    assert!(
        (0.1..0.7).contains(&changed),
        "{changed} of the pixels are changed"
    );

    // Nothing is kept of a frame: without the box the ground is open there, and with it the picture is the same again.
    stage.give(cube, Visibility::Hidden);
    let (hidden, _) = stage.picture();
    assert!(stage.ground(&hidden, contact.0, contact.1) > light - 10);
    stage.give(cube, Visibility::Inherited);
    let (back, _) = stage.picture();
    assert_eq!(share_beyond(&back, &with, 0), 0.0);
    // What is not on screen occludes too: a box beyond the right edge, unless it is none that hides light.
    stage.give(cube, Transform::from_xyz(4.0, 0.7, 2.6));
    let (aside, status) = stage.picture();
    assert_eq!(status, Some(Ok(())));
    let [dark, open] = [&aside, &hidden].map(|p| stage.ground(p, 2.5, 2.6));
    assert!(dark < open - 5, "{dark} in place of {open} beside the box");
    stage.give(cube, NotShadowCaster);
    let (without_aside, _) = stage.picture();
    assert_eq!(share_beyond(&without_aside, &hidden, 0), 0.0);
    stage.world().entity_mut(cube).remove::<NotShadowCaster>();
    stage.give(cube, Transform::from_xyz(-0.9, 0.7, 0.0));

    // What Bevy does not draw hides nothing: a mesh without a material, or with one that is not loaded. A material of another
    // type does, as its plugin was added.
    let mesh = |stage: &mut Stage| {
        let cube = stage.world().entity(cube);
        cube.get::<Mesh3d>().expect("a mesh").clone()
    };
    let beside = (mesh(&mut stage), Transform::from_xyz(4.0, 0.7, 2.6));
    let collider = stage.world().spawn(beside).id();
    let (bare, _) = stage.picture();
    assert_eq!(share_beyond(&bare, &with, 0), 0.0);
    let unloaded = stage.world().resource::<Assets<StandardMaterial>>();
    let unloaded = MeshMaterial3d(unloaded.reserve_handle());
    stage.give(collider, unloaded);
    let (unloaded, _) = stage.picture();
    assert_eq!(share_beyond(&unloaded, &with, 0), 0.0);
    stage
        .world()
        .entity_mut(collider)
        .remove::<MeshMaterial3d<StandardMaterial>>();
    let other = stage.world().resource_mut::<Assets<Other>>().add(Other {});
    stage.give(collider, MeshMaterial3d(other));
    let (other, _) = stage.picture();
    let [dark, open] = [&other, &hidden].map(|p| stage.ground(p, 2.5, 2.6));
    assert!(dark < open - 5, "{dark} in place of {open} beside the box");
    stage.world().despawn(collider);

    // Vertices that change are seen as they are: a box of no height hides nothing.
    let mesh = stage
        .world()
        .entity(cube)
        .get::<Mesh3d>()
        .expect("a mesh")
        .0
        .clone();
    let flat = Cuboid::new(1.4, 1e-3, 1.4)
        .mesh()
        .build()
        .translated_by(Vec3::Y * -0.7);
    let tall = Cuboid::new(1.4, 1.4, 1.4).mesh().build();
    let change = |stage: &mut Stage, to: &Mesh| {
        let mut meshes = stage.world().resource_mut::<Assets<Mesh>>();
        *meshes.get_mut(&mesh).expect("a mesh").into_inner() = to.clone();
    };
    change(&mut stage, &flat);
    let (low, _) = stage.picture();
    assert!(stage.ground(&low, contact.0, contact.1) > light - 10);
    // Compressed vertices are for Bevy's shaders alone.
    let mut compressed = tall.clone();
    compressed.compress_positions().expect("a box");
    change(&mut stage, &compressed);
    let (refused, status) = stage.picture();
    assert!(
        matches!(status, Some(Err(Error::Mesh { .. }))),
        "{status:?}"
    );
    // The occlusion is 1 everywhere, by which Bevy multiplies: a rounding at most.
    assert_eq!(share_beyond(&refused, &without, 2), 0.0);
    // What the error says to do is enough.
    stage.give(cube, NotShadowCaster);
    let (cured, status) = stage.picture();
    assert_eq!(status, Some(Ok(())));
    assert!(stage.ground(&cured, contact.0, contact.1) > light - 10);
    stage.world().entity_mut(cube).remove::<NotShadowCaster>();
    change(&mut stage, &tall);
    let (back, status) = stage.picture();
    assert_eq!(status, Some(Ok(())));
    assert_eq!(share_beyond(&back, &with, 0), 0.0);

    // Nor can strips be read.
    let strip = Mesh::new(
        PrimitiveTopology::TriangleStrip,
        RenderAssetUsages::default(),
    )
    .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, vec![[0.0, -1.0, 0.0]; 3]);
    let strip = stage.world().resource_mut::<Assets<Mesh>>().add(strip);
    let material = stage
        .world()
        .entity(cube)
        .get::<MeshMaterial3d<StandardMaterial>>()
        .expect("a material")
        .clone();
    let strip = stage.world().spawn((Mesh3d(strip), material)).id();
    let (_, status) = stage.picture();
    assert!(
        matches!(status, Some(Err(Error::Topology { .. }))),
        "{status:?}"
    );
    stage.give(strip, NotShadowCaster);
    let (_, status) = stage.picture();
    assert_eq!(status, Some(Ok(())));
    stage.world().despawn(strip);

    // A camera without normals, with several samples, or Bevy's own occlusion, and settings out of range: drawn on, without.
    stage.world().entity_mut(camera).remove::<NormalPrepass>();
    let (bare, status) = stage.picture();
    assert_eq!(status, Some(Err(Error::Prepass("NormalPrepass"))));
    assert_eq!(share_beyond(&bare, &without, 1), 0.0);
    stage.give(camera, (NormalPrepass, Msaa::Sample4));
    let (smooth, status) = stage.picture();
    assert_eq!(status, Some(Err(Error::Msaa { samples: 4 })));
    // Edges alone are others.
    assert!(share_beyond(&smooth, &without, 2) < 0.1);
    stage.give(camera, (Msaa::Off, ScreenSpaceAmbientOcclusion::default()));
    let (_, status) = stage.picture();
    assert_eq!(status, Some(Err(Error::ScreenSpace)));
    stage
        .world()
        .entity_mut(camera)
        .remove::<ScreenSpaceAmbientOcclusion>();
    let bad = RayTracedAmbientOcclusion {
        radius: f32::NAN,
        ..OCCLUSION
    };
    stage.give(camera, bad);
    let (refused, status) = stage.picture();
    assert!(matches!(status, Some(Err(Error::Library(_)))), "{status:?}");
    assert_eq!(share_beyond(&refused, &without, 1), 0.0);

    // With settings that are again in range the picture is the same again.
    stage.give(camera, OCCLUSION);
    let (back, status) = stage.picture();
    assert_eq!(status, Some(Ok(())));
    assert_eq!(share_beyond(&back, &with, 0), 0.0);

    // A camera that pauses keeps its passes and textures, and is drawn with them at once.
    let active = |stage: &mut Stage, is_active| {
        let mut camera = stage.world().entity_mut(camera);
        camera.get_mut::<Camera>().expect("a camera").is_active = is_active;
    };
    active(&mut stage, false);
    stage.picture();
    let kept = stage.allocations();
    assert!(
        kept.iter().any(|name| name.ends_with("bounced z-buffer")),
        "{kept:?}"
    );
    active(&mut stage, true);
    let (back, status) = stage.picture();
    assert_eq!(status, Some(Ok(())));
    assert_eq!(share_beyond(&back, &with, 0), 0.0);

    // A part of the picture shows what the same part elsewhere does.
    let [corner, aside] = [[0, 0], [29, 17]].map(|place| {
        stage.part(Some((place, [64, 40])));
        let (picture, status) = stage.picture();
        assert_eq!(status, Some(Ok(())));
        image::imageops::crop_imm(&picture, place[0], place[1], 64, 40).to_image()
    });
    stage.part(None);
    assert!(share_beyond(&corner, &aside, 6) <= 0.02);

    // Deferred materials read it as others do. Bevy rounds their colours to 8 bits.
    stage.give(camera, DeferredPrepass);
    stage.draw_by(OpaqueRendererMethod::Deferred);
    let (deferred, status) = stage.picture();
    assert_eq!(status, Some(Ok(())));
    let render_world = stage.bevy.app.sub_app(RenderApp).world();
    let phases = render_world.resource::<ViewBinnedRenderPhases<Opaque3dDeferred>>();
    assert!(phases.values().any(|phase| !phase.is_empty()));
    let off = share_beyond(&deferred, &with, 6);
    assert!(off <= 0.02, "{off} of the deferred pixels are off");
    stage.draw_by(OpaqueRendererMethod::Forward);
    stage.world().entity_mut(camera).remove::<DeferredPrepass>();

    // An orthographic camera: before the box it is dark, and where nothing is near it is not.
    let perspective = stage.projection();
    let mut orthographic = OrthographicProjection::default_3d();
    orthographic.scaling_mode = ScalingMode::FixedVertical {
        viewport_height: 6.0,
    };
    stage.give(camera, Projection::from(orthographic));
    let (flat, status) = stage.picture();
    assert_eq!(status, Some(Ok(())));
    let [dark, open] = [contact, (-2.4, 2.9)].map(|(x, z)| stage.ground(&flat, x, z));
    assert!(dark < open - 20, "{dark} before the box, {open} beside it");
    assert_eq!(open, stage.ground(&without, 0.0, 2.9));
    stage.give(camera, perspective);

    // Frames that are joined: 4 rays in each are nearer to 64 rays than those of one frame.
    let mut with_rays = |quality, frames| {
        let settings = RayTracedAmbientOcclusion {
            quality,
            frames,
            ..OCCLUSION
        };
        stage.give(camera, settings);
        // As many frames as two pictures take, and more.
        stage.picture();
        let (picture, status) = stage.picture();
        assert_eq!(status, Some(Ok(())));
        picture
    };
    let truth = with_rays(Quality::Accurate, 1);
    let one = off_by(&with_rays(Quality::Fast, 1), &truth);
    let joined = off_by(&with_rays(Quality::Fast, 32), &truth);
    assert!(joined < 0.8 * one, "{joined} in place of {one}");

    // Nor does jitter smear them, which Bevy's motion vectors are without.
    let mut jittered = |with_motion: bool| {
        stage
            .world()
            .entity_mut(camera)
            .remove::<(RayTracedAmbientOcclusion, TemporalJitter)>();
        stage.picture();
        if with_motion {
            stage.give(camera, MotionVectorPrepass);
        }
        let frames = RayTracedAmbientOcclusion {
            quality: Quality::Fast,
            frames: 32,
            ..OCCLUSION
        };
        let offset = Vec2::splat(0.5);
        stage.give(camera, (frames, TemporalJitter { offset }));
        let (picture, status) = stage.picture();
        assert_eq!(status, Some(Ok(())));
        picture
    };
    let [without_motion, with_motion] = [false, true].map(&mut jittered);
    assert_eq!(share_beyond(&with_motion, &without_motion, 0), 0.0);
    stage
        .world()
        .entity_mut(camera)
        .remove::<(TemporalJitter, MotionVectorPrepass)>();
    stage.give(camera, OCCLUSION);

    // Light of lamps is no ambient light.
    stage.world().insert_resource(GlobalAmbientLight::NONE);
    stage.world().spawn(common::sun(5000.0));
    let (lit, status) = stage.picture();
    assert_eq!(status, Some(Ok(())));
    stage
        .world()
        .entity_mut(camera)
        .remove::<RayTracedAmbientOcclusion>();
    let (lit_without, status) = stage.picture();
    assert_eq!(status, None);
    assert_eq!(share_beyond(&lit, &lit_without, 0), 0.0);
    // Nothing is kept without cameras but the texture, which Bevy's own bind groups hold.
    assert_eq!(stage.allocations(), ["deep-screen-space-bevy occlusion"]);
    assert!(stage.ground(&lit, 0.0, 2.9) > 20);
}

/// A camera that the library refuses, met before the other, is drawn without, and the other with.
#[test]
fn a_camera_that_is_refused_beside_another() {
    let mut stage = Stage::new(None);
    let (camera, target) = (stage.camera, stage.bevy.target());
    let first = Camera {
        order: -1,
        ..default()
    };
    let camera3d = (Camera3d::default(), Msaa::Off, first, target, OCCLUSION);
    let flat = PerspectiveProjection {
        near: 0.0,
        ..default()
    };
    let refused = stage.world().spawn((camera3d, Projection::from(flat)));
    let refused = refused.id();
    stage.picture();
    stage.give(camera, OCCLUSION);
    let (with, status) = stage.picture();
    assert_eq!(status, Some(Ok(())));
    compare("with", &with);
    let status = stage.world().resource::<RayTracingStatus>().of(refused);
    assert!(matches!(status, Some(Err(Error::Library(_)))), "{status:?}");
}

#[test]
fn buffers_that_shaders_may_not_read() {
    let mut stage = Stage::new(None);
    // Before the first frame, in which Bevy makes them.
    let render_app = stage.bevy.app.sub_app_mut(RenderApp);
    render_app.insert_resource(MeshAllocatorSettings::default());
    let camera = stage.camera;
    let (without, _) = stage.picture();
    stage.give(camera, OCCLUSION);
    let (refused, status) = stage.picture();
    let error = status.and_then(Result::err).expect("an error");
    assert!(error.to_string().contains("STORAGE"), "{error}");
    assert_eq!(share_beyond(&refused, &without, 1), 0.0);
}

#[test]
fn a_device_for_which_bevy_makes_no_occlusion() {
    let mut stage = Stage::new(Some(WgpuLimits {
        max_storage_textures_per_shader_stage: 4,
        ..WgpuLimits::default()
    }));
    let camera = stage.camera;
    stage.give(camera, OCCLUSION);
    let (_, status) = stage.picture();
    let error = Error::Materials {
        storage_textures: 4,
    };
    assert_eq!(status, Some(Err(error)));
}

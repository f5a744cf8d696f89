//! Bevy without a window, and pictures of it.
#![allow(dead_code)] // not all of it is of use to all that share this file

use bevy::{
    asset::Handle,
    camera::RenderTarget,
    image::Image,
    prelude::*,
    render::{
        RenderPlugin,
        gpu_readback::{Readback, ReadbackComplete},
        render_resource::{PollType, TextureFormat, TextureUsages},
        renderer::RenderDevice,
        settings::{Backends, RenderCreation, WgpuLimits, WgpuSettings},
    },
    window::ExitCondition,
};
use deep_screen_space_bevy::deep_screen_space::scenes::{Part, Scene};
use image::{RgbImage, RgbaImage};

/// What was read last.
#[derive(Resource, Default)]
struct Read(Option<Vec<u8>>);

/// Bevy that draws into pictures alone.
pub struct Headless {
    pub app: App,
    size: [u32; 2],
    target: Handle<Image>,
}

impl Headless {
    /// With a device of no more than some limits, if they are given.
    pub fn new(size: [u32; 2], limits: Option<WgpuLimits>, plugins: impl FnOnce(&mut App)) -> Self {
        let mut app = App::new();
        let settings = WgpuSettings {
            backends: Some(Backends::VULKAN),
            constrained_limits: limits,
            ..default()
        };
        app.add_plugins(
            DefaultPlugins
                .set(WindowPlugin {
                    primary_window: None,
                    exit_condition: ExitCondition::DontExit,
                    ..default()
                })
                .set(RenderPlugin {
                    render_creation: RenderCreation::Automatic(Box::new(settings)),
                    ..default()
                }),
        );
        plugins(&mut app);
        app.init_resource::<Read>();
        app.finish();
        app.cleanup();
        let mut image =
            Image::new_target_texture(size[0], size[1], TextureFormat::Rgba8UnormSrgb, None);
        image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
        let target = app.world_mut().resource_mut::<Assets<Image>>().add(image);
        Self { app, size, target }
    }

    /// What a camera draws into.
    pub fn target(&self) -> RenderTarget {
        RenderTarget::Image(self.target.clone().into())
    }

    /// A picture, once all that was asked for has come about: assets take a frame, occlusion another.
    pub fn picture(&mut self) -> RgbImage {
        for _ in 0..4 {
            self.app.update();
        }
        self.app.insert_resource(Read::default());
        let world = self.app.world_mut();
        let mut reader = world.spawn(Readback::texture(self.target.clone()));
        reader.observe(|read: On<ReadbackComplete>, mut into: ResMut<Read>| {
            into.0 = Some(read.data.clone());
        });
        let reader = reader.id();
        // It comes in the frame after the GPU is done.
        for _ in 0..10 {
            self.app.update();
            let device = self.app.world().resource::<RenderDevice>();
            device
                .poll(PollType::wait_indefinitely())
                .expect("a device that is not lost");
            if let Some(bytes) = self.app.world_mut().resource_mut::<Read>().0.take() {
                self.app.world_mut().despawn(reader);
                return picture(self.size, &bytes);
            }
        }
        panic!("the picture does not come");
    }
}

/// Of rows that are padded, as wgpu copies them.
fn picture([width, height]: [u32; 2], bytes: &[u8]) -> RgbImage {
    let row = RenderDevice::align_copy_bytes_per_row(4 * width as usize);
    let rows = bytes.chunks(row).flat_map(|row| &row[..4 * width as usize]);
    let picture = RgbaImage::from_raw(width, height, rows.copied().collect());
    let picture = picture.expect("as many bytes as the picture has");
    image::DynamicImage::from(picture).to_rgb8()
}

/// A scene of the library's, an entity a part. Lights are the caller's to add.
pub fn add(scene: &Scene, app: &mut World) {
    for part in &scene.parts {
        let material = &scene.materials[part.material as usize];
        let [r, g, b] = material.albedo;
        // Emission is radiosity in the library, radiance in Bevy.
        let [er, eg, eb] = material.emission.map(|e| e / std::f32::consts::PI);
        let mesh = app.resource_mut::<Assets<Mesh>>().add(mesh(scene, part));
        let material = app
            .resource_mut::<Assets<StandardMaterial>>()
            .add(StandardMaterial {
                base_color: Color::linear_rgb(r, g, b),
                emissive: LinearRgba::rgb(er, eg, eb),
                // The scenes have single sheets, which are seen from either side.
                double_sided: true,
                cull_mode: None,
                ..matt()
            });
        app.spawn((Mesh3d(mesh), MeshMaterial3d(material)));
    }
}

/// A material without gloss.
pub fn matt() -> StandardMaterial {
    StandardMaterial {
        perceptual_roughness: 1.0,
        reflectance: 0.0,
        ..default()
    }
}

/// The vertices of a part alone.
fn mesh(scene: &Scene, part: &Part) -> Mesh {
    use bevy::{
        asset::RenderAssetUsages,
        mesh::{Indices, PrimitiveTopology},
    };
    let range = part.first_index as usize..(part.first_index + part.index_count) as usize;
    let mut place = vec![None; scene.positions.len()];
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    let corners: Vec<u32> = scene.indices[range]
        .iter()
        .map(|&index| {
            let index = index as usize;
            *place[index].get_or_insert_with(|| {
                positions.push(scene.positions[index]);
                normals.push(scene.normals[index]);
                positions.len() as u32 - 1
            })
        })
        .collect();
    Mesh::new(
        PrimitiveTopology::TriangleList,
        RenderAssetUsages::default(),
    )
    .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
    .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, normals)
    .with_inserted_indices(Indices::U32(corners))
}

/// A scene's first view.
pub fn view(scene: &Scene) -> (Transform, Projection) {
    let view = &scene.views[0];
    let [eye, target] = [view.eye, view.target].map(|p| Vec3::from(p.map(|x| x as f32)));
    let projection = PerspectiveProjection {
        fov: view.vertical_fov_degrees.to_radians() as f32,
        near: view.near as f32,
        ..default()
    };
    (
        Transform::from_translation(eye).looking_at(target, Vec3::Y),
        projection.into(),
    )
}

/// Light from above, that comes in sideways.
pub fn sun(illuminance: f32) -> (DirectionalLight, Transform) {
    let light = DirectionalLight {
        illuminance,
        shadow_maps_enabled: true,
        ..default()
    };
    (
        light,
        Transform::default().looking_to(Vec3::new(-0.6, -0.7, -0.8), Vec3::Y),
    )
}

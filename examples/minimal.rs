//! Ambient occlusion by rays in a frame of an engine: `cargo run --release --example minimal -- OUT.png`.
//!
//! Two objects, and two recordings per frame. What an engine has anyway (a device, meshes in buffers, a G-buffer) comes from
//! `examples/support`.

use deep_screen_space::{
    Camera, Geometry, Quality, RayTracedEffect, RayTracedInput, RayTracedScene,
    RayTracedSceneInput, RayTracedView, RayTracedViewDescriptor, Viewport, scenes, wgpu,
};
use support::{
    gpu::{Ask, Gpu},
    raster::{self, Raster},
    scene::SceneBuffers,
};

const WIDTH: u32 = 768;
const HEIGHT: u32 = 512;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // What an engine has. A device with Limits::default() and no features:
    let gpu = Gpu::open(Ask::Floor)?;
    let device = &gpu.device;
    // triangles in buffers with the usage STORAGE:
    let scene = scenes::colonnade();
    let buffers = SceneBuffers::new(&gpu, &scene);
    let meshes = buffers.meshes();
    // a camera, in f64, with any projection; its depth convention is read off the matrix:
    let view = &scene.views[0];
    let aspect = f64::from(WIDTH) / f64::from(HEIGHT);
    let camera = Camera::look_at(
        view.eye.into(),
        view.target.into(),
        view.up.into(),
        raster::perspective(view.vertical_fov_degrees, aspect, view.near),
        Viewport::full(WIDTH, HEIGHT),
    )?;
    // depth and normals, and a texture for the result.
    let drawn = Raster::draw(&gpu, &buffers, &camera);
    let format = wgpu::TextureFormat::R8Unorm;
    let target = gpu.target(format, WIDTH, HEIGHT);

    // Once per scene, and once per view and effect.
    let radius = scene.ao_radius;
    let effect = RayTracedEffect::AmbientOcclusion { radius };
    let mut traced = RayTracedScene::new(device)?;
    let descriptor = RayTracedViewDescriptor::new(effect, Quality::Balanced, format);
    let mut occlusion = RayTracedView::new(device, &descriptor)?;

    // Every frame: the scene, once for all its views …
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let input = RayTracedSceneInput {
        cull_by: &[camera],
        reach: radius,
        ..RayTracedSceneInput::new(Geometry { meshes: &meshes }, &camera)
    };
    traced.record(device, &mut encoder, &input)?;
    // … and each view's picture.
    let input = RayTracedInput::new(drawn.gbuffer(), &camera, target.texture());
    occlusion.record(device, &mut encoder, &traced, &input)?;
    gpu.queue.submit([encoder.finish()]);

    let out = std::env::args().nth(1).unwrap_or("minimal.png".into());
    let pixels: Vec<u8> = gpu.read_texture(target.texture(), 0);
    image::save_buffer(out, &pixels, WIDTH, HEIGHT, image::ColorType::L8)?;
    Ok(())
}

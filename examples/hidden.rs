//! What a depth buffer cannot know: `cargo run --release --example hidden -- DIR`.
//!
//! Ambient occlusion three times over, side by side: from the depth buffer alone (horizon-based), from the bounced
//! z-buffer, and by traced rays. In the closed room most walls are behind the camera; in the colonnade most of what
//! occludes stands behind something else.

use std::path::{Path, PathBuf};

use deep_screen_space::{
    Camera, CloudCapacity, Payload,
    reference::{gbuffer, trace::Tracer},
    scenes::{self, Scene},
};
use support::depth_only::{AmbientOcclusionSettings, DepthOnly, Frame};
use support::{
    bounced::{BouncedRenderer, RayRoom},
    errors::rmse,
    files,
    gpu::{Ask, Gpu},
    presets,
    raster::{self, Raster},
    scene::SceneBuffers,
};

const WIDTH: u32 = 384;
const HEIGHT: u32 = 256;
const RAYS: u32 = 64;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder: PathBuf = std::env::args().nth(1).unwrap_or("out".into()).into();
    std::fs::create_dir_all(&folder)?;
    let gpu = Gpu::open(Ask::from_env())?;
    for (scene, radius) in [
        (scenes::closed_room(), scenes::closed_room().ao_radius),
        (scenes::colonnade(), f32::INFINITY),
    ] {
        compare(&gpu, &scene, radius, &folder)?;
    }
    Ok(())
}

fn compare(
    gpu: &Gpu,
    scene: &Scene,
    radius: f32,
    folder: &Path,
) -> Result<(), Box<dyn std::error::Error>> {
    let camera = raster::camera_of(scene, [WIDTH, HEIGHT]);
    let buffers = SceneBuffers::new(gpu, scene);
    let drawn = Raster::draw(gpu, &buffers, &camera);

    let seen = from_depth(gpu, &drawn, &camera, radius);
    let triangles = buffers.triangles();
    let capacity = CloudCapacity {
        surfels: 0,
        pieces: triangles + 100_000,
        triangles,
    };
    let preset =
        presets::bounced_preset("balanced", Payload::Occlusion, radius).ok_or("no such preset")?;
    let rays_per_pixel = preset.bounced.rays_per_pixel;
    let payload = Payload::Occlusion;
    let mut renderer = BouncedRenderer::new(
        gpu,
        payload,
        capacity,
        [WIDTH, HEIGHT],
        RayRoom {
            rays_per_pixel,
            ..RayRoom::default()
        },
    )?;
    let bounced = renderer
        .render(gpu, &drawn, &buffers, &camera, &[], &preset)?
        .visibility();

    let tracer = Tracer::of_scene(scene)?;
    let receivers = gbuffer::receivers(
        &camera,
        &tracer,
        &scene.positions,
        &scene.normals,
        &scene.indices,
    );
    let truth: Vec<f32> = tracer
        .ambient_occlusion_image(&receivers, f64::from(radius), RAYS, 1, true)
        .iter()
        .map(|estimate| estimate.map_or(1.0, |e| e.mean as f32))
        .collect();

    let path = folder.join(format!("hidden_{}.png", scene.name));
    let rows: Vec<f32> = (0..HEIGHT as usize)
        .flat_map(|y| {
            let row = y * WIDTH as usize..(y + 1) * WIDTH as usize;
            [&seen, &bounced, &truth].map(|image| image[row.clone()].to_vec())
        })
        .flatten()
        .collect();
    files::write_png(&path, 3 * WIDTH, HEIGHT, &rows)?;
    println!(
        "{}: RMSE of the depth buffer alone {:.4}, of the bounced z-buffer {:.4}",
        path.display(),
        rmse(&seen, &truth),
        rmse(&bounced, &truth)
    );
    Ok(())
}

/// As well as the depth buffer allows: whatever is lower than a horizon is hidden.
fn from_depth(gpu: &Gpu, drawn: &Raster, camera: &Camera, radius: f32) -> Vec<f32> {
    let device = &gpu.device;
    let passes = DepthOnly::new(device, [WIDTH, HEIGHT]);
    let target = passes.create_target(device, DepthOnly::GRAY);
    let settings = AmbientOcclusionSettings {
        radius,
        slices: 4,
        taps: 16,
        thickness: f32::INFINITY,
        filter_radius: 3,
    };
    let frame = Frame {
        camera,
        depth: &drawn.depth,
        normal: &drawn.normal,
    };
    let mut encoder = gpu.encoder();
    passes.record_ambient_occlusion(device, &mut encoder, &frame, &settings, &target);
    gpu.finish(encoder);
    gpu.read_texture(target.texture(), 0)
}

//! Ambient occlusion by rays, each pass by hand: `cargo run --release --example by_hand -- OUT.png`. What `RayTracedScene` and
//! `RayTracedView` do in `examples/minimal.rs`, for those who share passes between effects or put others between them.
//!
//! Pipelines once, room for a scene and a view once; then a frame is five recordings into the caller's encoder, and one
//! submission. What an engine has anyway (a device, meshes in buffers, a G-buffer) comes from `examples/support`.

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, BouncedZBuffer, BvhBuilder, CloudCapacity,
    FrameInput, GBufferDecoder, Geometry, HitResolverInput, HitResolverSettings, Primitives, Reach,
    SurfelCounts, Surfelizer, SurfelizerInput, SurfelizerSettings, scenes, wgpu,
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
    let camera = raster::camera_of(&scene, [WIDTH, HEIGHT]);
    // depth and normals, and a texture for the result.
    let drawn = Raster::draw(&gpu, &buffers, &camera);
    let format = wgpu::TextureFormat::R8Unorm;
    let target = gpu.target(format, WIDTH, HEIGHT);

    // Once: pipelines.
    let decoder = GBufferDecoder::new(device)?;
    let surfelizer = Surfelizer::new(device)?;
    let builder = BvhBuilder::new(device, Primitives::Triangles)?;
    let tracer = BouncedZBuffer::new(device, &BouncedDescriptor::default())?;
    let resolver = tracer.resolver(device, format, false)?;

    // Once a scene: room for its triangles. Once a view: textures of its size.
    let rays = BouncedSettings {
        rays_per_pixel: 8,
        radius: scene.ao_radius,
        ..BouncedSettings::default()
    };
    let settings = SurfelizerSettings {
        // Every triangle as it is, if a ray can reach it from what is seen.
        density: f32::INFINITY,
        reach: Reach {
            radii: f32::INFINITY,
            world: rays.radius,
        },
        ..SurfelizerSettings::default()
    };
    let capacity = CloudCapacity {
        surfels: 0,
        pieces: buffers.triangles() + 10_000,
        triangles: buffers.triangles(),
    };
    let mut cloud = surfelizer.create_cloud(device, capacity)?;
    let bvh = builder.create(device, &cloud)?;
    let mut receivers = decoder.create_receivers(device, WIDTH, HEIGHT)?;
    let hits = tracer.create_view(device, WIDTH, HEIGHT, rays.rays_per_pixel)?;
    let scratch = resolver.create_view(device, &hits)?;

    // Every frame: the triangles, relative to a point near what is seen …
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let input = SurfelizerInput {
        geometry: Geometry { meshes: &meshes },
        camera: &camera,
        cull_by: &[camera],
        timestamps: None,
    };
    surfelizer.record(device, &mut encoder, &input, &settings, &mut cloud)?;
    // … a hierarchy over them …
    builder.record(device, &mut encoder, &cloud, &bvh, None)?;
    // … what the pixels show, relative to the same point …
    let input = FrameInput::new(drawn.gbuffer(), &camera);
    let frame = decoder.record(device, &mut encoder, &input, &mut receivers)?;
    // … rays from every pixel …
    let input = BouncedInput::new(&frame, &cloud, &bvh);
    tracer.record(device, &mut encoder, &input, &rays, &hits)?;
    // … and the picture.
    let input = HitResolverInput::new(&frame, &hits, target.texture());
    let filter = HitResolverSettings::default();
    resolver.record(device, &mut encoder, &input, &filter, &scratch)?;
    // The counts are copied too: whether the triangles found room is known without waiting.
    let counts = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: cloud.counters().size(),
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    encoder.copy_buffer_to_buffer(cloud.counters(), 0, &counts, 0, None);
    gpu.queue.submit([encoder.finish()]);

    // A frame or two later the counts are there. An engine polls without waiting; this one has nothing else to do.
    counts.map_async(wgpu::MapMode::Read, .., |_| ());
    device.poll(wgpu::PollType::wait_indefinitely())?;
    let counts: SurfelCounts = bytemuck::pod_read_unaligned(&counts.get_mapped_range(..)?);
    println!(
        "{} triangles for rays; {:.2} % of the area found no room",
        counts.pieces,
        100.0 * counts.lost_area_share()
    );
    let out = std::env::args().nth(1).unwrap_or("by_hand.png".into());
    let pixels: Vec<u8> = gpu.read_texture(target.texture(), 0);
    image::save_buffer(out, &pixels, WIDTH, HEIGHT, image::ColorType::L8)?;
    Ok(())
}

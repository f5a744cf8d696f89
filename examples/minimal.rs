//! The shortest whole wiring of the crate into a frame: `cargo run --release --example minimal -- OUT.png`.
//!
//! Pipelines once, room for a scene and a view once; then a frame is four recordings into the caller's encoder, and one
//! submission. What an engine has anyway (a device, meshes in buffers, a G-buffer) comes from `examples/support`.

use deep_screen_space::{
    AmbientOcclusion, Camera, CloudCapacity, ClusterInput, Geometry, Reconstructor,
    ReconstructorInput, ReconstructorSettings, ShellSplatter, ShellSplatterDescriptor, SplatInput,
    SplatSettings, SurfelCounts, Surfelizer, SurfelizerInput, SurfelizerSettings, Viewport, scenes,
    wgpu,
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

    // Once: pipelines, for an effect and a format.
    let effect = AmbientOcclusion::default().effect();
    let surfelizer = Surfelizer::new(device, None)?;
    let descriptor = ShellSplatterDescriptor {
        effect: &effect,
        subgroups: device.features().contains(wgpu::Features::SUBGROUP),
        statistics: false,
        cache: None,
    };
    let splatter = ShellSplatter::new(device, &descriptor)?;
    let reconstructor = Reconstructor::new(device, &effect, format, None)?;

    // Once a scene: room for its surfels. Once a view: textures of its size.
    let splat = SplatSettings {
        radius: scene.ao_radius,
        ..SplatSettings::default()
    };
    let settings = SurfelizerSettings {
        reach: ShellSplatter::reach(&splat),
        ..SurfelizerSettings::default()
    };
    let capacity = CloudCapacity {
        surfels: 1 << 18,
        pieces: buffers.triangles() + 10_000,
        triangles: buffers.triangles(),
    };
    let mut cloud = surfelizer.create_cloud(device, capacity)?;
    let mut clusters = splatter.create_clusters(device, &cloud, splat.levels)?;
    let sums = splatter.create_view(device, WIDTH, HEIGHT, splat.levels)?;
    let scratch = reconstructor.create_view(device, WIDTH, HEIGHT, splat.levels)?;

    // Every frame: surfels of the triangles …
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let input = SurfelizerInput {
        geometry: Geometry { meshes: &meshes },
        camera: &camera,
        cull_by: &[camera],
        timestamps: None,
    };
    surfelizer.record(device, &mut encoder, &input, &settings, &mut cloud)?;
    // … bounds of runs of them …
    splatter.record_clusters(
        device,
        &mut encoder,
        &ClusterInput {
            cloud: &cloud,
            materials: None,
            timestamps: None,
        },
        &splat,
        &mut clusters,
    )?;
    // … their sums for every pixel …
    let input = SplatInput {
        gbuffer: drawn.gbuffer(),
        camera: &camera,
        cloud: &cloud,
        clusters: &clusters,
        materials: None,
        work: None,
        timestamps: None,
    };
    splatter.record(device, &mut encoder, &input, &splat, &sums)?;
    // … and the picture.
    let input = ReconstructorInput {
        gbuffer: drawn.gbuffer(),
        camera: &camera,
        cloud: &cloud,
        sums: &sums,
        levels: splat.levels,
        target: target.texture().into(),
        sub_image: None,
        timestamps: None,
    };
    let filter = ReconstructorSettings::default();
    reconstructor.record(device, &mut encoder, &input, &filter, &scratch)?;
    // The surfels' counts are copied too: whether they found room is known without waiting.
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
    println!("{} surfels", counts.stored);
    if counts.overflow() > 0 {
        println!(
            "{} more found no room: raise the capacity",
            counts.overflow()
        );
    }
    let out = std::env::args().nth(1).unwrap_or("minimal.png".into());
    let pixels: Vec<u8> = gpu.read_texture(target.texture(), 0);
    image::save_buffer(out, &pixels, WIDTH, HEIGHT, image::ColorType::L8)?;
    Ok(())
}

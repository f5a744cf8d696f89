//! kiss3d's own occlusion and path tracer beside the library's rays, in one program, on the library's scenes: how far each is off
//! the traced truth, what it takes of a frame's time, and what it keeps in memory.
//!
//! `peers [SCENE]…` prints a table of each. Truth is the share of the cosine-weighted hemisphere over a pixel that nothing nearer
//! than the scene's radius occludes, by 256 rays in f64, whose own
//! noise is taken out. kiss3d's radius, intensity, power and bias are scanned for what is
//! nearest to that; its defaults at the scene's radius stand beside it. Its path tracer, which knows no radius, is compared with
//! truth without one: white surfaces under an even sky, two vertices a path.
//!
//! Times are differences of whole frames to one without occlusion, so that each method has its own prepass in it. Of a software
//! driver they are the processor's, and only ratios of them mean anything.

mod common;
#[path = "../../../examples/support/stopwatch.rs"]
mod stopwatch;

use deep_screen_space_kiss3d::{
    RayTracedLighting, Settings,
    deep_screen_space::{
        Camera, Quality, Viewport,
        reference::{
            gbuffer,
            trace::{Estimate, Tracer},
        },
        scenes::{self, Scene},
    },
};
use kiss3d::{post_processing::Tonemap, prelude::*};
use stopwatch::Stopwatch;

const SIZE: [u32; 2] = [320, 200];
const TRUTH_RAYS: u32 = 256;

fn main() {
    let mut names: Vec<String> = std::env::args().skip(1).collect();
    if names.is_empty() {
        names = ["cornell", "colonnade", "dominoes"]
            .map(String::from)
            .to_vec();
    }
    if let [name] = &*names {
        match scenes::by_name(name) {
            Some(scene) => pollster::block_on(measure(&scene)),
            None => eprintln!("peers: no scene {name}"),
        }
        return;
    }
    // A process each: kiss3d keeps what it made of a device that is gone, and panics where the next one has none of it.
    for name in names {
        let this = std::env::current_exe().expect("this program has a path");
        let run = std::process::Command::new(this).arg(name).status();
        if !run.is_ok_and(|status| status.success()) {
            std::process::exit(1);
        }
    }
}

/// Sees what materials are given as occlusion: kiss3d's own.
struct Eavesdropper(Rc<RefCell<Option<wgpu::TextureView>>>);

struct Nothing;

impl GpuData for Nothing {
    fn as_any(&self) -> &dyn std::any::Any {
        self
    }

    fn as_any_mut(&mut self) -> &mut dyn std::any::Any {
        self
    }
}

impl Material3d for Eavesdropper {
    fn create_gpu_data(&self) -> Box<dyn GpuData> {
        Box::new(Nothing)
    }

    fn set_ssao(&mut self, ao: Option<&wgpu::TextureView>) {
        *self.0.borrow_mut() = ao.cloned();
    }

    fn render(
        &mut self,
        _: usize,
        _: Pose3,
        _: Vec3,
        _: &mut dyn Camera3d,
        _: &LightCollection,
        _: &ObjectData3d,
        _: &mut GpuMesh3d,
        _: &mut InstancesBuffer3d,
        _: &mut dyn GpuData,
        _: &mut wgpu::RenderPass<'_>,
        _: &RenderContext,
    ) {
    }
}

struct Bench {
    surface: OffscreenSurface,
    nodes: SceneNode3d,
    camera: OrbitCamera3d,
}

impl Bench {
    async fn frame(&mut self, lighting: Option<&mut RayTracedLighting>) {
        let renderer = lighting.map(|lighting| lighting as &mut dyn Renderer3d);
        let Self {
            surface,
            nodes,
            camera,
        } = self;
        surface
            .render(Some(nodes), None, Some(camera), None, renderer, None)
            .await;
    }

    /// Milliseconds of a frame, the least of twice four.
    async fn time(&mut self, mut lighting: Option<&mut RayTracedLighting>) -> f64 {
        let context = Context::get();
        let on_processor = context.adapter.get_info().device_type == wgpu::DeviceType::Cpu;
        let mut least = f64::INFINITY;
        for round in 0..3 {
            let stopwatch = Stopwatch::start(on_processor);
            for _ in 0..4 {
                self.frame(lighting.as_deref_mut()).await;
                wait(&context);
            }
            // The first compiles.
            if round > 0 {
                least = least.min(stopwatch.milliseconds() / 4.0);
            }
        }
        least
    }
}

fn wait(context: &Context) {
    let polled = context.device.poll(wgpu::PollType::wait_indefinitely());
    polled.expect("the device answers");
}

/// What rays say of a pixel: its visibility, and the standard error of that.
type Truth = Vec<Option<Estimate>>;

/// Root of the mean square of the differences, without the truth's own noise, and their mean.
fn errors(picture: &[f32], truth: &Truth) -> (f64, f64) {
    let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for (p, t) in picture.iter().zip(truth) {
        if let Some(t) = t {
            let off = f64::from(*p) - t.mean;
            count += 1.0;
            sum += off;
            squares += off * off - t.standard_error.powi(2);
        }
    }
    ((squares / count).max(0.0).sqrt(), sum / count)
}

async fn measure(scene: &Scene) {
    let surface = OffscreenSurface::new(SIZE[0], SIZE[1]).await;
    let mut nodes = SceneNode3d::empty();
    common::add(scene, &mut nodes);
    let mut bench = Bench {
        surface,
        nodes,
        camera: common::camera(scene),
    };
    let context = Context::get();
    let reader = Reader::new(&context);
    let heard = Rc::new(RefCell::new(None));
    let ears: Rc<RefCell<Box<dyn Material3d>>> =
        Rc::new(RefCell::new(Box::new(Eavesdropper(Rc::clone(&heard)))));
    MaterialManager3d::get_global_manager(|manager| manager.add(ears.clone(), "ears"));
    let alone = bench.time(None).await;

    let (view, projection) = bench.camera.view_transform_pair(0);
    let camera = Camera::from_arrays(
        view.to_mat4().to_cols_array_2d(),
        projection.to_cols_array_2d(),
        Viewport::full(SIZE[0], SIZE[1]),
    )
    .expect("kiss3d's camera");
    let tracer = Tracer::of_scene(scene).expect("a scene of the library");
    let receivers = gbuffer::receivers(
        &camera,
        &tracer,
        &scene.positions,
        &scene.normals,
        &scene.indices,
    );
    let truth_within = |radius: f64| -> Truth {
        tracer.ambient_occlusion_image(&receivers, radius, TRUTH_RAYS, 1, false)
    };
    let radius = scene.ao_radius;
    let truth = truth_within(f64::from(radius));

    println!(
        "\n### {}, {} triangles, radius {radius} m\n",
        scene.name,
        scene.triangle_count()
    );
    println!(
        "| | RMSE (bias) | time, SSAO's is 1 | a frame without is 1 | MB |\n|---|---|---|---|---|"
    );

    // What knows nothing of the picture but its mean.
    let known: Vec<f64> = truth.iter().flatten().map(|t| t.mean).collect();
    let mean = known.iter().sum::<f64>() / known.len() as f64;
    let constant = errors(&vec![mean as f32; truth.len()], &truth);
    println!(
        "| a constant, {mean:.2} | {:.3} ({:+.3}) | | | |",
        constant.0, constant.1
    );

    // kiss3d's own.
    bench.surface.window_mut().set_ssao_enabled(true);
    let pixels = f64::from(SIZE[0] * SIZE[1]);
    let mut best: Option<(f64, SsaoSettings)> = None;
    let with_radius = SsaoSettings {
        radius,
        ..SsaoSettings::default()
    };
    *bench.surface.window_mut().ssao_settings_mut() = with_radius;
    let ssao_time = bench.time(None).await - alone;
    let kiss3d = |heard: &RefCell<Option<wgpu::TextureView>>| {
        let view = heard.borrow().clone().expect("kiss3d's occlusion");
        reader.read(&context, &view)
    };
    let row = |name: &str, error: (f64, f64), time: f64, bytes: Option<f64>| {
        let megabytes = bytes.map_or(String::new(), |bytes| format!("{:.1}", bytes / 1e6));
        println!(
            "| {name} | {:.3} ({:+.3}) | {:.2} | {:.2} | {megabytes} |",
            error.0,
            error.1,
            time / ssao_time,
            time / alone
        );
    };
    // Four targets of 8 bytes, depth, and two of 2 bytes.
    let ssao_bytes = Some(40.0 * pixels);
    let defaults = errors(&kiss3d(&heard), &truth);
    row(
        "kiss3d's SSAO, its defaults",
        defaults,
        ssao_time,
        ssao_bytes,
    );
    for factor in [0.5, 1.0, 2.0, 3.0, 4.5, 6.0] {
        for bias in [0.025, 0.05 * radius] {
            for intensity in [0.3, 0.45, 0.6, 0.8, 1.0, 1.3] {
                for power in [1.0, 1.5] {
                    let settings = SsaoSettings {
                        radius: radius * factor,
                        bias,
                        intensity,
                        power,
                    };
                    *bench.surface.window_mut().ssao_settings_mut() = settings;
                    bench.frame(None).await;
                    let (rmse, _) = errors(&kiss3d(&heard), &truth);
                    if best.is_none_or(|(least, _)| rmse < least) {
                        best = Some((rmse, settings));
                    }
                }
            }
        }
    }
    if let Some((_, settings)) = best {
        *bench.surface.window_mut().ssao_settings_mut() = settings;
        bench.frame(None).await;
        let name = format!(
            "the same at its best: radius {:.2}, bias {:.3}, intensity {}, power {}",
            settings.radius, settings.bias, settings.intensity, settings.power
        );
        row(
            &name,
            errors(&kiss3d(&heard), &truth),
            ssao_time,
            ssao_bytes,
        );
    }
    bench.surface.window_mut().set_ssao_enabled(false);

    // The library's.
    for (name, quality) in [("4", Quality::Fast), ("16", Quality::Balanced)] {
        let settings = Settings {
            occlusion_radius: Some(radius),
            bounce: false,
            quality,
        };
        let (error, time, bytes) = library(&mut bench, &reader, settings, &truth, alone).await;
        row(&format!("the library's, {name} rays"), error, time, bytes);
    }
    let settings = Settings {
        occlusion_radius: Some(radius),
        ..Settings::default()
    };
    let (error, time, bytes) = library(&mut bench, &reader, settings, &truth, alone).await;
    row(
        "the library's, 16 rays, and one bounce of light",
        error,
        time,
        bytes,
    );

    // Without a radius.
    let truth = truth_within(f64::INFINITY);
    let settings = Settings {
        occlusion_radius: Some(f32::INFINITY),
        bounce: false,
        ..Settings::default()
    };
    let (error, time, bytes) = library(&mut bench, &reader, settings, &truth, alone).await;
    row(
        "without a radius: the library's, 16 rays",
        error,
        time,
        bytes,
    );
    path_traced(&mut bench, &truth, row).await;
    MaterialManager3d::get_global_manager(|manager| manager.remove("ears"));
}

async fn library(
    bench: &mut Bench,
    reader: &Reader,
    settings: Settings,
    truth: &Truth,
    alone: f64,
) -> ((f64, f64), f64, Option<f64>) {
    let mut lighting = RayTracedLighting::new(settings).expect("a device with the default limits");
    lighting.adopt(&mut bench.nodes);
    let time = bench.time(Some(&mut lighting)).await - alone;
    lighting.status().expect("a frame with the effect");
    let occlusion = lighting.occlusion().expect("occlusion");
    let view = occlusion.create_view(&wgpu::TextureViewDescriptor::default());
    let picture = reader.read(&Context::get(), &view);
    lighting.release(&mut bench.nodes);
    (
        errors(&picture, truth),
        time,
        Some(lighting.memory_bytes() as f64),
    )
}

/// kiss3d's path tracer: what a white scene sends on of an even sky after one reflection.
async fn path_traced(
    bench: &mut Bench,
    truth: &Truth,
    row: impl Fn(&str, (f64, f64), f64, Option<f64>),
) {
    let context = Context::get();
    bench.nodes.apply_to_objects_mut_recursive(&mut |object| {
        object.set_color(WHITE);
        object.set_emissive(BLACK);
    });
    let window = bench.surface.window_mut();
    window.set_ambient(1.0);
    window.set_tonemap(Tonemap::None);
    window.set_exposure(1.0);
    for (paths, denoise) in [(4, true), (16, true)] {
        let mut tracer = RayTracer::new();
        tracer.set_max_bounces(2);
        tracer.set_samples_per_frame(paths);
        tracer.set_denoise(denoise);
        tracer.set_interactive_scale(1.0);
        let mut least = f64::INFINITY;
        let mut image = None;
        for round in 0..4 {
            tracer.mark_dirty();
            let on_processor = context.adapter.get_info().device_type == wgpu::DeviceType::Cpu;
            let stopwatch = Stopwatch::start(on_processor);
            let Bench {
                surface,
                nodes,
                camera,
            } = bench;
            surface.raytrace_3d(nodes, camera, &mut tracer).await;
            wait(&context);
            if round > 0 {
                least = least.min(stopwatch.milliseconds());
            }
            image.get_or_insert_with(|| surface.snap_image());
        }
        // Its film is encoded for a display, in 8 bits.
        let image = image.expect("a picture");
        let picture: Vec<f32> = image
            .pixels()
            .map(|p| (f32::from(p.0[1]) / 255.0).powf(2.2))
            .collect();
        let filter = if denoise { ", denoised" } else { "" };
        let name = format!(
            "without a radius: kiss3d's path tracer, {paths} paths{filter} (a whole frame)"
        );
        row(&name, errors(&picture, truth), least, None);
    }
}

/// Reads the red channel of any texture that can be sampled.
struct Reader {
    pipeline: wgpu::RenderPipeline,
}

const COPY: &str = "
@group(0) @binding(0) var source: texture_2d<f32>;
@vertex fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
  let corner = vec2f(f32((index << 1u) & 2u), f32(index & 2u));
  return vec4f(corner * 2.0 - 1.0, 0.0, 1.0);
}
@fragment fn fragment(@builtin(position) at: vec4f) -> @location(0) vec4f {
  return textureLoad(source, vec2i(at.xy), 0);
}";

impl Reader {
    fn new(context: &Context) -> Self {
        let module = context.create_shader_module(Some("copy"), COPY);
        let pipeline = context.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("copy"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vertex"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fragment"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(wgpu::TextureFormat::R32Float.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        Self { pipeline }
    }

    fn read(&self, context: &Context, from: &wgpu::TextureView) -> Vec<f32> {
        let size = wgpu::Extent3d {
            width: SIZE[0],
            height: SIZE[1],
            depth_or_array_layers: 1,
        };
        let target = context.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::R32Float,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let group = context.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(from),
            }],
        });
        let row = (SIZE[0] * 4).next_multiple_of(256);
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let staging = context.create_buffer_simple(None, u64::from(row * SIZE[1]), usage);
        let mut encoder = context.create_command_encoder(None);
        let view = target.create_view(&wgpu::TextureViewDescriptor::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations::default(),
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
        drop(pass);
        encoder.copy_texture_to_buffer(
            target.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &staging,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: None,
                },
            },
            size,
        );
        context.submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., |mapped| {
            mapped.expect("a buffer to read");
        });
        wait(context);
        let bytes = staging.get_mapped_range(..).expect("a mapped buffer");
        let rows = bytes.chunks_exact(row as usize);
        rows.flat_map(|row| bytemuck::pod_collect_to_vec::<u8, f32>(&row[..SIZE[0] as usize * 4]))
            .collect()
    }
}

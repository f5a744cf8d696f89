//! Skinned vertices: `cargo run --release --example animate -- DIR` bends a column over a few frames, by two bones in a compute
//! shader, and writes the ambient occlusion of each to `DIR/frame-N.png`.
//!
//! The crate reads vertices where the engine has them, as they are when the GPU runs the recording: what skins or morphs them is
//! recorded or submitted before, into the same buffer, and nothing else is to be said. The hierarchy over all instances is built
//! anew each frame anyway. With `Primitives::Instances` meshes are kept: `RayTracedSceneInput::changed` then names the skinned
//! ones.

use std::f32::consts::FRAC_PI_3;

use deep_screen_space::{
    Geometry, Quality, RayTracedEffect, RayTracedInput, RayTracedScene, RayTracedSceneInput,
    RayTracedView, RayTracedViewDescriptor, scenes::Scene, wgpu,
};
use support::{
    gpu::{Ask, Gpu},
    raster::{self, Raster},
    scene::SceneBuffers,
};

const SIZE: [u32; 2] = [480, 320];
const FRAMES: u32 = 6;

/// Each vertex is turned about the x axis by a share of the angle that grows over its height, as by a bone at the foot that
/// rests and one at half the height that turns.
const SKIN: &str = "
struct Bone { angle: f32, pivot: f32, padding0: f32, padding1: f32 }
@group(0) @binding(0) var<uniform> bone: Bone;
@group(0) @binding(1) var<storage, read> rest: array<f32>;
@group(0) @binding(2) var<storage, read> rest_normals: array<f32>;
@group(0) @binding(3) var<storage, read_write> positions: array<f32>;
@group(0) @binding(4) var<storage, read_write> normals: array<f32>;

@compute @workgroup_size(64)
fn skin(@builtin(global_invocation_id) id: vec3u) {
  let at = 3u * id.x;
  if at >= arrayLength(&rest) {
    return;
  }
  let p = vec3f(rest[at], rest[at + 1u], rest[at + 2u]);
  let n = vec3f(rest_normals[at], rest_normals[at + 1u], rest_normals[at + 2u]);
  let angle = bone.angle * smoothstep(0.3 * bone.pivot, 1.7 * bone.pivot, p.y);
  let turn = mat3x3f(vec3f(1.0, 0.0, 0.0), vec3f(0.0, cos(angle), sin(angle)), vec3f(0.0, -sin(angle), cos(angle)));
  let pivot = vec3f(0.0, bone.pivot, 0.0);
  let q = pivot + turn * (p - pivot);
  let m = turn * n;
  for (var axis = 0u; axis < 3u; axis++) {
    positions[at + axis] = q[axis];
    normals[at + axis] = m[axis];
  }
}
";

/// A column of many segments on a ground.
fn scene() -> Scene {
    let mut scene = deep_screen_space::scenes::fence();
    (scene.positions, scene.normals, scene.indices) = (Vec::new(), Vec::new(), Vec::new());
    // Two corners of a strip's first edge, the way to its next one, how many segments, and its normal.
    let (side, height, segments) = (0.25, 1.5, 32);
    let mut strips = vec![(
        [[-3.0, 0.0, 3.0], [3.0, 0.0, 3.0]],
        [0.0, 0.0, -6.0],
        1,
        [0.0, 1.0, 0.0],
    )];
    for [x, z] in [[0.0, 1.0], [1.0, 0.0], [0.0, -1.0], [-1.0, 0.0]] {
        let edge = [-1.0, 1.0].map(|s| [side * (x + s * z), 0.0, side * (z - s * x)]);
        strips.push((edge, [0.0, height, 0.0], segments, [x, 0.0, z]));
    }
    strips.push((
        [[-side, height, side], [side, height, side]],
        [0.0, 0.0, -2.0 * side],
        1,
        [0.0, 1.0, 0.0],
    ));
    for (edge, way, segments, normal) in strips {
        let first = scene.positions.len() as u32;
        for i in 0..=segments {
            let share = i as f32 / segments as f32;
            for corner in edge {
                scene
                    .positions
                    .push([0, 1, 2].map(|k| corner[k] + share * way[k]));
                scene.normals.push(normal);
            }
        }
        for at in (0..segments as u32).map(|i| first + 2 * i) {
            scene
                .indices
                .extend([at, at + 1, at + 3, at, at + 3, at + 2]);
        }
    }
    scene.parts.truncate(1);
    scene.parts[0].first_index = 0;
    scene.parts[0].index_count = scene.indices.len() as u32;
    scene.views[0].eye = [2.4, 1.6, 2.8];
    scene.views[0].target = [0.0, 0.6, 0.0];
    scene.views[0].near = 0.05;
    scene
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).unwrap_or("animate".into());
    std::fs::create_dir_all(&folder)?;
    let gpu = Gpu::open(Ask::Floor)?;
    let device = &gpu.device;
    let scene = scene();
    let buffers = SceneBuffers::new(&gpu, &scene);
    let meshes = buffers.meshes();
    let camera = raster::camera_of(&scene, SIZE);
    let format = wgpu::TextureFormat::R8Unorm;
    let target = gpu.target(format, SIZE[0], SIZE[1]);

    // What an engine skins with.
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("skin"),
        source: wgpu::ShaderSource::Wgsl(SKIN.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("skin"),
        layout: None,
        module: &module,
        entry_point: Some("skin"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let rest = gpu.buffer(&scene.positions, wgpu::BufferUsages::STORAGE);
    let rest_normals = gpu.buffer(&scene.normals, wgpu::BufferUsages::STORAGE);
    let run = &buffers.runs[0];

    let effect = RayTracedEffect::AmbientOcclusion { radius: 1.0 };
    let mut traced = RayTracedScene::new(device)?;
    let descriptor = RayTracedViewDescriptor::new(effect, Quality::Balanced, format);
    let mut occlusion = RayTracedView::new(device, &descriptor)?;
    for frame in 0..FRAMES {
        // First the vertices of this frame, into the buffers that are drawn and traced …
        let share = frame as f32 / (FRAMES - 1) as f32;
        let bone = gpu.buffer(
            &[1.6 * FRAC_PI_3 * share, 0.75, 0.0, 0.0],
            wgpu::BufferUsages::UNIFORM,
        );
        let bound = [&bone, &rest, &rest_normals, &run.positions, &run.normals];
        let entries: Vec<_> = (0..)
            .zip(bound)
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut encoder = gpu.encoder();
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups((scene.positions.len() as u32).div_ceil(64), 1, 1);
        drop(pass);
        gpu.finish(encoder);
        let drawn = Raster::draw(&gpu, &buffers, &camera);

        // … then the scene and the picture, as for vertices that rest.
        let mut encoder = gpu.encoder();
        let input = RayTracedSceneInput::new(Geometry { meshes: &meshes }, &camera);
        traced.record(device, &mut encoder, &input)?;
        let input = RayTracedInput::new(drawn.gbuffer(), &camera, target.texture());
        occlusion.record(device, &mut encoder, &traced, &input)?;
        gpu.finish(encoder);

        let pixels: Vec<u8> = gpu.read_texture(target.texture(), 0);
        let path = format!("{folder}/frame-{frame}.png");
        image::save_buffer(path, &pixels, SIZE[0], SIZE[1], image::ColorType::L8)?;
    }
    Ok(())
}

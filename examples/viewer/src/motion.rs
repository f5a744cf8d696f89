//! Motion vectors of the G-buffer: where each pixel's surface was in the last frame.

use deep_screen_space::{
    Camera,
    glam::DMat4,
    wgpu::{self, BufferUsages, TextureFormat, TextureView},
};
use support::{gpu::Gpu, raster::Raster};

/// A frame's camera, and the box's place in the world, where there is a box.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot {
    pub camera: Camera,
    pub world_from_box: Option<DMat4>,
}

impl Snapshot {
    /// Whether anything but the camera has moved since another.
    pub fn moved_since(&self, before: &Self) -> bool {
        self.world_from_box.is_some() && self.world_from_box != before.world_from_box
    }
}

/// As the shader has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct Uniform {
    before: [[f32; 16]; 2],
    box_from_clip: [f32; 16],
    known: u32,
    padding: [u32; 3],
}

impl Uniform {
    fn new(now: &Snapshot, before: &Snapshot) -> Self {
        let world_from_clip = clip_from_world(&now.camera).inverse();
        let clip_before = clip_from_world(&before.camera);
        // Nothing is within a box that there is not.
        let nowhere = DMat4::from_cols_array(&[0.0; 16]);
        let box_from_clip = now
            .world_from_box
            .map_or(nowhere, |of| of.inverse() * world_from_clip);
        let moved = before.world_from_box.unwrap_or(nowhere) * box_from_clip;
        // Of equal cameras the product is 1 but for the last bits of a double, which a float does not have.
        let before_from_clip = [clip_before * world_from_clip, clip_before * moved];
        Self {
            before: before_from_clip.map(|m| m.as_mat4().to_cols_array()),
            box_from_clip: box_from_clip.as_mat4().to_cols_array(),
            known: u32::from(before.world_from_box.is_some()),
            padding: [0; 3],
        }
    }
}

fn clip_from_world(camera: &Camera) -> DMat4 {
    let view = DMat4::from_mat3(camera.rotation()) * DMat4::from_translation(-camera.eye());
    camera.projection() * view
}

/// What draws them, and where to.
pub struct Motion {
    pipeline: wgpu::RenderPipeline,
    vectors: TextureView,
}

impl Motion {
    /// For pictures of a size.
    pub fn new(gpu: &Gpu, [width, height]: [u32; 2]) -> Self {
        let module = gpu
            .device
            .create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some("motion"),
                source: wgpu::ShaderSource::Wgsl(include_str!("motion.wgsl").into()),
            });
        let format = TextureFormat::Rg32Float;
        let pipeline = gpu
            .device
            .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some("motion"),
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
                    targets: &[Some(format.into())],
                }),
                multiview_mask: None,
                cache: None,
            });
        Self {
            pipeline,
            vectors: gpu.target(format, width, height),
        }
    }

    /// A vector a pixel, in UV.
    pub fn vectors(&self) -> &TextureView {
        &self.vectors
    }

    /// Draws them, of a frame's G-buffer and the frame before.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        raster: &Raster,
        (now, before): (&Snapshot, &Snapshot),
    ) {
        let uniform = gpu.buffer(&[Uniform::new(now, before)], BufferUsages::UNIFORM);
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("motion"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: uniform.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::TextureView(&raster.depth),
                },
            ],
        });
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("motion"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.vectors,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
    }
}

#[cfg(test)]
mod tests {
    use deep_screen_space::{
        Viewport,
        glam::{DVec2, DVec3, Mat4, Vec2, Vec4},
        scenes,
    };
    use support::{
        gpu::{Ask, Gpu},
        raster::perspective,
    };

    use super::*;
    use crate::{mover::Mover, place::Place};

    fn camera(eye: DVec3) -> Camera {
        let (target, up) = (DVec3::new(0.0, 3.0, 0.0), DVec3::Y);
        let projection = perspective(45.0, 1.5, 0.1);
        Camera::look_at(eye, target, up, projection, Viewport::full(96, 64)).unwrap()
    }

    fn apply(matrix: &[f32; 16], at: Vec4) -> Vec4 {
        Mat4::from_cols_array(matrix) * at
    }

    /// Where the last frame's camera saw a point of the world, and the same point of the box.
    #[test]
    fn leads_to_where_points_were() {
        let mut scene = scenes::cornell();
        let mover = Mover::add(&mut scene, DVec3::new(0.0, 3.0, 0.0), 1.0);
        let instant = |eye, rounds| Snapshot {
            camera: camera(eye),
            world_from_box: Some(mover.world_from_box(rounds)),
        };
        let now = instant(DVec3::new(0.0, 3.0, 8.0), 0.31);
        let before = instant(DVec3::new(0.5, 3.2, 8.0), 0.3);
        let uniform = Uniform::new(&now, &before);
        let corner = DVec3::new(1.0, -1.0, 0.5);
        let [seen, then] =
            [&now, &before].map(|of| of.world_from_box.unwrap().transform_point3(corner));
        let clip = clip_from_world(&now.camera) * seen.extend(1.0);
        let clip = (clip / clip.w).as_vec4();
        let within = apply(&uniform.box_from_clip, clip);
        let within = within.truncate() / within.w;
        assert!(within.distance(corner.as_vec3()) < 1e-4, "{within}");
        for (matrix, point) in uniform.before.iter().zip([seen, then]) {
            let found = apply(matrix, clip);
            let found = found.truncate() / found.w;
            let wanted = clip_from_world(&before.camera) * point.extend(1.0);
            let wanted = (wanted.truncate() / wanted.w).as_vec3();
            assert!(found.distance(wanted) < 1e-5, "{found} and {wanted}");
        }
        // Under a camera that rests the world does not move at all, and a box that was not there has no past.
        let appears = Snapshot {
            world_from_box: None,
            ..now
        };
        let uniform = Uniform::new(&now, &appears);
        let resting = apply(&uniform.before[0], clip);
        assert_eq!(resting, Vec4::from((clip.truncate(), 1.0)));
        assert_eq!(uniform.known, 0);
        let still = now.moved_since(&now) || appears.moved_since(&now);
        assert!(!still && now.moved_since(&appears) && now.moved_since(&before));
    }

    /// A picture's vectors are those of its points: of the box by how it moved, and of all else by the camera.
    #[test]
    fn pictures_lead_there() {
        let gpu = Gpu::open(Ask::Floor).unwrap();
        let place = Place::load(&gpu, "cornell").unwrap();
        let (size, mut pose) = ([96, 64], place.views[0].1);
        let mut snapshot = |rounds, turn| {
            pose.yaw += turn;
            Snapshot {
                camera: pose.camera(size).unwrap(),
                world_from_box: Some(place.mover.world_from_box(rounds)),
            }
        };
        let (before, now) = (snapshot(0.3, 0.0), snapshot(0.31, 0.01));
        place.mover.write(&gpu.queue, &place.buffers, Some(0.31));
        let raster = Raster::draw(&gpu, &place.buffers, &now.camera);
        let motion = Motion::new(&gpu, size);
        let mut encoder = gpu.encoder();
        motion.record(&gpu, &mut encoder, &raster, (&now, &before));
        gpu.finish(encoder);
        let vectors: Vec<[f32; 2]> = gpu.read_texture(motion.vectors().texture(), 0);
        let depths: Vec<f32> = gpu.read_texture(raster.depth.texture(), 0);
        let albedo: Vec<[f32; 4]> = gpu.read_texture(raster.albedo.texture(), 0);
        let own = place.scene.materials.last().unwrap().albedo;
        let moved = before.world_from_box.unwrap() * now.world_from_box.unwrap().inverse();
        let mut of_box = 0;
        for (i, vector) in vectors.iter().enumerate().filter(|(i, _)| depths[*i] > 0.0) {
            let at = DVec2::new((i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5);
            let seen = now.camera.unproject(at.x, at.y, depths[i].into());
            let point = seen.unwrap() + now.camera.eye();
            let is_box = albedo[i][..3] == own;
            of_box += u32::from(is_box);
            let was = if is_box {
                moved.transform_point3(point)
            } else {
                point
            };
            let was = before.camera.project(was - before.camera.eye()).unwrap();
            let wanted = (at - was.truncate()) / DVec2::new(96.0, 64.0);
            let found = Vec2::from(*vector).as_dvec2();
            // A thousandth of a pixel.
            assert!(found.distance(wanted) < 1e-5, "{i}: {found} and {wanted}");
        }
        assert!(of_box > 50, "{of_box} pixels show the box");
    }
}

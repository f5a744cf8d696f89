//! kiss3d's own material, which tells what it draws and takes occlusion that is computed elsewhere.
//!
//! kiss3d calls [`Material3d::prepare`] for each object that it will draw, with the frame's camera, lights and transforms, then
//! [`Material3d::flush`] once, and only then draws. So what is submitted in `flush` is of the same frame as what is drawn.

use std::{any::Any, cell::RefCell, rc::Rc};

use kiss3d::{
    builtin::ObjectMaterial,
    camera::Camera3d,
    glamx::{Pose3, Vec3},
    light::LightCollection,
    resource::{EnvLight, GpuData, GpuMesh3d, Material3d, ProbeLighting, RenderContext},
    scene::{InstancesBuffer3d, ObjectData3d},
};
use wgpu::{Buffer, RenderPass, TextureView};

use crate::{frame::Frames, geometry::Drawn};

/// The material of adopted objects.
pub struct TellingMaterial {
    inner: ObjectMaterial,
    frames: Rc<RefCell<Frames>>,
    /// What the next object that takes this material is called.
    next: Rc<RefCell<usize>>,
    /// Whether kiss3d renders probes or mirrors, with cameras that the effects are not for.
    captures: bool,
}

/// What an object has of it.
struct Told {
    object: usize,
    inner: Box<dyn GpuData>,
}

impl GpuData for Told {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn as_any_mut(&mut self) -> &mut dyn Any {
        self
    }
}

impl TellingMaterial {
    pub fn new(frames: Rc<RefCell<Frames>>, next: Rc<RefCell<usize>>) -> Self {
        Self {
            inner: ObjectMaterial::new(),
            frames,
            next,
            captures: false,
        }
    }

    /// What this frame's objects are told of, unless something else holds it.
    fn tell(
        &mut self,
        pass: usize,
        drawn: Option<Drawn>,
        camera: &dyn Camera3d,
        lights: &LightCollection,
        size: [u32; 2],
    ) {
        let Ok(mut frames) = self.frames.try_borrow_mut() else {
            return;
        };
        if pass != 0 || self.captures {
            return;
        }
        if frames.is_at_start() {
            let occlusion = frames.prepare(camera, lights, size);
            if let Some(occlusion) = occlusion {
                let view = occlusion.create_view(&wgpu::TextureViewDescriptor::default());
                self.inner.set_ssao(Some(&view));
            }
        }
        if let Some(drawn) = drawn {
            frames.push(drawn);
        }
    }
}

impl Material3d for TellingMaterial {
    fn create_gpu_data(&self) -> Box<dyn GpuData> {
        let mut next = self.next.borrow_mut();
        let object = *next;
        *next += 1;
        let inner = self.inner.create_gpu_data();
        Box::new(Told { object, inner })
    }

    fn begin_frame(&mut self) {
        self.inner.begin_frame();
        self.frames.borrow_mut().begin();
    }

    fn prepare(
        &mut self,
        pass: usize,
        transform: Pose3,
        scale: Vec3,
        camera: &mut dyn Camera3d,
        lights: &LightCollection,
        data: &ObjectData3d,
        gpu_data: &mut dyn GpuData,
        viewport_width: u32,
        viewport_height: u32,
    ) {
        let Some(told) = gpu_data.as_any_mut().downcast_mut::<Told>() else {
            return;
        };
        let is_seen = data.render_layers() & camera.render_layers() != 0;
        let is_adopted = told.object < self.frames.borrow().adopted.len();
        let drawn = (is_seen && is_adopted)
            .then(|| Drawn::new(told.object, transform, scale, data))
            .flatten();
        // Before the first object is prepared: that is when the material notes whether there is occlusion.
        let size = [viewport_width, viewport_height];
        self.tell(pass, drawn, camera, lights, size);
        self.inner.prepare(
            pass,
            transform,
            scale,
            camera,
            lights,
            data,
            &mut *told.inner,
            viewport_width,
            viewport_height,
        );
    }

    fn flush(&mut self) {
        self.inner.flush();
        self.frames.borrow_mut().submit();
    }

    fn renders_in_transparent_phase(&self) -> bool {
        self.inner.renders_in_transparent_phase()
    }

    fn set_environment_lighting(&mut self, env: Option<EnvLight<'_>>) {
        self.inner.set_environment_lighting(env);
    }

    fn set_reflection_probes(&mut self, probes: Option<ProbeLighting<'_>>) {
        self.inner.set_reflection_probes(probes);
    }

    fn set_ssao(&mut self, ao: Option<&TextureView>) {
        self.inner.set_ssao(ao);
    }

    fn set_transmission_background(&mut self, bg: Option<&TextureView>) {
        self.inner.set_transmission_background(bg);
    }

    fn set_capture_mode(&mut self, on: bool) {
        self.captures = on;
        self.inner.set_capture_mode(on);
    }

    fn set_clip_plane(&mut self, plane: Option<[f32; 4]>) {
        self.inner.set_clip_plane(plane);
    }

    fn set_clustered_buffers(
        &mut self,
        lights: &Buffer,
        grid: &Buffer,
        index: &Buffer,
        force_rebind: bool,
    ) {
        self.inner
            .set_clustered_buffers(lights, grid, index, force_rebind);
    }

    fn render(
        &mut self,
        pass: usize,
        transform: Pose3,
        scale: Vec3,
        camera: &mut dyn Camera3d,
        lights: &LightCollection,
        data: &ObjectData3d,
        mesh: &mut GpuMesh3d,
        instances: &mut InstancesBuffer3d,
        gpu_data: &mut dyn GpuData,
        render_pass: &mut RenderPass<'_>,
        context: &RenderContext,
    ) {
        let Some(told) = gpu_data.as_any_mut().downcast_mut::<Told>() else {
            return;
        };
        self.inner.render(
            pass,
            transform,
            scale,
            camera,
            lights,
            data,
            mesh,
            instances,
            &mut *told.inner,
            render_pass,
            context,
        );
    }
}

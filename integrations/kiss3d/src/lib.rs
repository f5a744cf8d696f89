//! Ray-traced ambient occlusion and a bounce of light in kiss3d's picture, by [`deep_screen_space`].
//!
//! ```no_run
//! use deep_screen_space_kiss3d::{RayTracedLighting, Settings};
//! use kiss3d::prelude::*;
//!
//! #[kiss3d::main]
//! async fn main() {
//!     let mut window = Window::new("Ray-traced lighting").await;
//!     let mut camera = OrbitCamera3d::default();
//!     let mut scene = SceneNode3d::empty();
//!     scene.add_cube(1.0, 1.0, 1.0);
//!
//!     let mut lighting = RayTracedLighting::new(Settings::default()).expect("a device with wgpu's default limits");
//!     lighting.adopt(&mut scene);
//!     while window
//!         .render(Some(&mut scene), None, Some(&mut camera), None, Some(&mut lighting), None)
//!         .await
//!     {
//!         if let Err(error) = lighting.status() {
//!             eprintln!("drawn without it: {error}");
//!         }
//!     }
//! }
//! ```

mod composite;
mod error;
mod frame;
mod gbuffer;
mod geometry;
mod lights;
mod material;
mod settings;

use std::{cell::RefCell, rc::Rc};

pub use deep_screen_space;
pub use error::Error;
use kiss3d::{
    camera::Camera3d,
    renderer::Renderer3d,
    resource::{Material3d, MaterialManager3d, RenderContext},
    scene::SceneNode3d,
};
pub use settings::Settings;

use crate::{frame::Frames, geometry::Adopted, material::TellingMaterial};

/// Occlusion and light for one window, of the objects that it [adopted](RayTracedLighting::adopt).
///
/// It is a [`Renderer3d`]: give it to `Window::render`, which calls it between the objects and the tone mapping, for light that
/// bounced; occlusion reaches the picture by the objects' material. Both are of the frame that is drawn, moved objects, lights
/// and camera included. A window with antialiasing has both too, with one sample per pixel.
///
/// What takes part: opaque objects with kiss3d's own material, their instances, colours, textures (of what is seen; rays meet
/// the object's colour alone), emission and transforms. Vertices may change if they do on the CPU. Skinned and morphed meshes
/// take part as they are at rest, since kiss3d deforms them where they are drawn; alpha masks are opaque to rays; what is
/// transparent takes no part.
pub struct RayTracedLighting {
    frames: Rc<RefCell<Frames>>,
    material: Rc<RefCell<Box<dyn Material3d>>>,
    /// How many objects took the material since it was last set to 0.
    next: Rc<RefCell<usize>>,
    name: String,
}

impl RayTracedLighting {
    /// Compiles the pipelines, for the device of kiss3d's windows.
    ///
    /// # Errors
    /// [`Error::NoContext`] before there is a window or an off-screen surface; [`Error::Library`] for settings out of range, and
    /// for a device that has less than `Limits::default()`.
    pub fn new(settings: Settings) -> Result<Self, Error> {
        let frames = Rc::new(RefCell::new(Frames::new(settings)?));
        let next = Rc::new(RefCell::new(0));
        let material = TellingMaterial::new(Rc::clone(&frames), Rc::clone(&next));
        let material: Rc<RefCell<Box<dyn Material3d>>> = Rc::new(RefCell::new(Box::new(material)));
        // Windows tell registered materials of what a frame has.
        let name = format!("deep-screen-space-kiss3d {:p}", Rc::as_ptr(&material));
        MaterialManager3d::get_global_manager(|manager| manager.add(material.clone(), &name));
        Ok(Self {
            frames,
            material,
            next,
            name,
        })
    }

    /// Takes up the objects of a scene, which get a material that draws as kiss3d's own does. To be called again after objects
    /// or meshes were added, removed or replaced; not after they moved or changed colour.
    pub fn adopt(&mut self, scene: &mut SceneNode3d) {
        *self.next.borrow_mut() = 0;
        let mut adopted = Vec::new();
        scene.apply_to_objects_mut_recursive(&mut |object| {
            object.set_material(Rc::clone(&self.material));
            adopted.push(Adopted::new(object));
        });
        let mut frames = self.frames.borrow_mut();
        frames.adopted = adopted;
        frames.is_new = true;
    }

    /// Gives a scene's objects kiss3d's own material back.
    pub fn release(&mut self, scene: &mut SceneNode3d) {
        let material = MaterialManager3d::get_global_manager(|manager| manager.get_default());
        scene.set_material_recursive(material);
        self.frames.borrow_mut().adopted.clear();
    }

    /// What it was made with.
    pub fn settings(&self) -> Settings {
        self.frames.borrow().settings()
    }

    /// What became of the last frame.
    ///
    /// # Errors
    /// Why it was drawn without occlusion and light: [`Error::Mesh`] and [`Error::Instances`] for data that is not to be had, and
    /// [`Error::Library`].
    pub fn status(&self) -> Result<(), Error> {
        self.frames.borrow().status.clone()
    }

    /// The last frame's ambient visibility, 0 to 1, in `R8Unorm`. `None` before the first, and without occlusion.
    pub fn occlusion(&self) -> Option<wgpu::Texture> {
        self.frames.borrow().occlusion_texture().cloned()
    }

    /// The light that the last frame's surfaces reflected of what bounced once, in `Rgba16Float`. `None` before the first, and
    /// without it.
    pub fn light(&self) -> Option<wgpu::Texture> {
        self.frames.borrow().light_texture().cloned()
    }

    /// GPU memory that it takes beside kiss3d's, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.frames.borrow().memory_bytes()
    }
}

impl Drop for RayTracedLighting {
    fn drop(&mut self) {
        if kiss3d::context::Context::is_initialized() {
            MaterialManager3d::get_global_manager(|manager| manager.remove(&self.name));
        }
    }
}

impl Renderer3d for RayTracedLighting {
    fn render(
        &mut self,
        pass: usize,
        _camera: &mut dyn Camera3d,
        render_pass: &mut wgpu::RenderPass<'_>,
        context: &RenderContext,
    ) {
        if pass == 0 {
            let frames = self.frames.borrow();
            frames.add_light(render_pass, context.sample_count);
        }
    }
}

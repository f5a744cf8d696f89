//! What happens in a frame: kiss3d's objects, lights and camera go in, occlusion and light come out.

use deep_screen_space::{
    Camera, ChangedMeshes, Geometry, HitLighting, Light, Primitives, RayTracedEffect,
    RayTracedInput, RayTracedScene, RayTracedSceneInput, RayTracedView, RayTracedViewDescriptor,
    Viewport,
};
use kiss3d::{camera::Camera3d, context::Context, glamx::Mat4, light::LightCollection};
use wgpu::{BindGroup, CommandEncoder, Texture, TextureFormat};

use crate::{
    composite::Composite,
    error::Error,
    gbuffer::{self, GBufferPass, GBufferTextures},
    geometry::{Adopted, Drawn, Triangulation},
    lights,
    settings::Settings,
};

/// What lies in a texture each.
const OCCLUSION: TextureFormat = TextureFormat::R8Unorm;
const LIGHT: TextureFormat = TextureFormat::Rgba16Float;

/// What kiss3d said of the frame that it prepares.
struct Prepared {
    view: Mat4,
    projection: Mat4,
    size: [u32; 2],
    lights: Vec<Light>,
    drawn: Vec<Drawn>,
}

/// Textures of the film's size.
struct Targets {
    size: [u32; 2],
    gbuffer: GBufferTextures,
    occlusion: Option<Texture>,
    light: Option<(Texture, BindGroup)>,
}

/// All that the material and the renderer share.
pub struct Frames {
    settings: Settings,
    pub adopted: Vec<Adopted>,
    /// Whether the adopted objects are others than in the last recording.
    pub is_new: bool,
    prepared: Option<Prepared>,
    triangulation: Triangulation,
    gbuffer: GBufferPass,
    scene: RayTracedScene,
    occlusion: Option<RayTracedView>,
    light: Option<RayTracedView>,
    composite: Composite,
    targets: Option<Targets>,
    /// Whether the targets are this frame's: where nothing is drawn, nothing is submitted.
    is_current: bool,
    /// What became of the last frame.
    pub status: Result<(), Error>,
}

impl Frames {
    pub fn new(settings: Settings) -> Result<Self, Error> {
        if !Context::is_initialized() {
            return Err(Error::NoContext);
        }
        let context = Context::get();
        let device = &*context.device;
        // Meshes stay as they are built, and only their transforms are taken up each frame.
        let primitives = Primitives::Instances;
        let view = |effect, target| {
            let descriptor = RayTracedViewDescriptor {
                primitives,
                ..RayTracedViewDescriptor::new(effect, settings.quality, target)
            };
            RayTracedView::new(device, &descriptor)
        };
        let occlusion = settings
            .occlusion_radius
            .map(|radius| RayTracedEffect::AmbientOcclusion { radius });
        // What comes from where nothing is, is kiss3d's ambient light or skybox.
        let light = settings.bounce.then_some(RayTracedEffect::IndirectDiffuse {
            sky_radiance: [0.0; 3],
        });
        Ok(Self {
            settings,
            adopted: Vec::new(),
            is_new: true,
            prepared: None,
            triangulation: Triangulation::default(),
            gbuffer: GBufferPass::new(&context),
            scene: RayTracedScene::with_primitives(device, primitives)?,
            occlusion: occlusion
                .map(|effect| view(effect, OCCLUSION))
                .transpose()?,
            light: light.map(|effect| view(effect, LIGHT)).transpose()?,
            composite: Composite::new(&context),
            targets: None,
            is_current: false,
            status: Ok(()),
        })
    }

    /// Whether this frame's objects are yet to be told of.
    pub fn is_at_start(&self) -> bool {
        self.prepared.is_none()
    }

    /// Forgets what was prepared, as a frame begins.
    pub fn begin(&mut self) {
        self.prepared = None;
        self.is_current = false;
    }

    /// Takes up the camera and the lights, before the first object. Where the occlusion of the frame will be.
    pub fn prepare(
        &mut self,
        camera: &dyn Camera3d,
        lights: &LightCollection,
        size: [u32; 2],
    ) -> Option<&Texture> {
        let (view, projection) = camera.view_transform_pair(0);
        self.prepared = Some(Prepared {
            view: view.to_mat4(),
            projection,
            size,
            lights: lights::of(lights),
            drawn: Vec::new(),
        });
        if self.targets.as_ref().is_none_or(|t| t.size != size) {
            let context = Context::get();
            let texture = |format| gbuffer::texture(&context, format, size);
            self.targets = Some(Targets {
                size,
                gbuffer: GBufferTextures::new(&context, size),
                occlusion: self.occlusion.as_ref().map(|_| texture(OCCLUSION)),
                light: self.light.as_ref().map(|_| {
                    let light = texture(LIGHT);
                    let group = self.composite.bind(&context, &light);
                    (light, group)
                }),
            });
        }
        self.occlusion_texture()
    }

    /// An object of the frame.
    pub fn push(&mut self, drawn: Drawn) {
        if let Some(prepared) = &mut self.prepared {
            prepared.drawn.push(drawn);
        }
    }

    /// Records and submits what was prepared, before kiss3d submits its own. Where something is refused the frame has no
    /// occlusion and no light, and [`Frames::status`] says why.
    pub fn submit(&mut self) {
        let Some(prepared) = self.prepared.take() else {
            return;
        };
        let context = Context::get();
        let mut encoder = context.create_command_encoder(Some("deep-screen-space-kiss3d"));
        self.status = self.record(&context, &mut encoder, &prepared);
        if self.status.is_err() {
            // Meshes that were to be built may not have been.
            self.is_new = true;
            encoder = context.create_command_encoder(Some("deep-screen-space-kiss3d"));
            if let Some(targets) = &self.targets {
                let light = targets.light.as_ref().map(|(light, _)| light);
                clear(&mut encoder, targets.occlusion.as_ref(), wgpu::Color::WHITE);
                clear(&mut encoder, light, wgpu::Color::TRANSPARENT);
            }
        }
        context.submit([encoder.finish()]);
        self.is_current = true;
    }

    fn record(
        &mut self,
        context: &Context,
        encoder: &mut CommandEncoder,
        prepared: &Prepared,
    ) -> Result<(), Error> {
        let Prepared {
            view,
            projection,
            size: [width, height],
            lights,
            drawn,
        } = prepared;
        let device = &*context.device;
        self.triangulation
            .update(context, &mut self.adopted, drawn)?;
        let Some(targets) = &self.targets else {
            return Ok(());
        };
        let scene = (&self.triangulation, &*self.adopted, &**drawn);
        self.gbuffer.record(
            context,
            encoder,
            [*view, *projection],
            scene,
            &targets.gbuffer,
        );

        let camera = Camera::from_arrays(
            view.to_cols_array_2d(),
            projection.to_cols_array_2d(),
            Viewport::full(*width, *height),
        )?;
        let meshes = self.triangulation.meshes(&self.adopted);
        let input = RayTracedSceneInput {
            changed: if self.is_new {
                ChangedMeshes::All
            } else {
                ChangedMeshes::Some(&self.triangulation.changed)
            },
            lighting: self
                .triangulation
                .materials()
                .filter(|_| self.light.is_some())
                .map(|materials| HitLighting { materials, lights }),
            ..RayTracedSceneInput::new(Geometry { meshes: &meshes }, &camera)
        };
        self.scene.record(device, encoder, &input)?;
        let light = targets.light.as_ref().map(|(light, _)| light);
        for (pass, target) in [
            (&mut self.occlusion, targets.occlusion.as_ref()),
            (&mut self.light, light),
        ] {
            if let (Some(pass), Some(target)) = (pass, target) {
                let input = RayTracedInput::new(targets.gbuffer.gbuffer(), &camera, target);
                pass.record(device, encoder, &self.scene, &input)?;
            }
        }
        drop(meshes);
        self.triangulation.changed.clear();
        self.is_new = false;
        Ok(())
    }

    /// Adds the frame's light to kiss3d's film.
    pub fn add_light(&self, pass: &mut wgpu::RenderPass<'_>, samples: u32) {
        let targets = self.targets.as_ref().filter(|_| self.is_current);
        if let Some((_, group)) = targets.and_then(|targets| targets.light.as_ref()) {
            self.composite.draw(pass, group, samples);
        }
    }

    pub fn settings(&self) -> Settings {
        self.settings
    }

    pub fn occlusion_texture(&self) -> Option<&Texture> {
        self.targets.as_ref()?.occlusion.as_ref()
    }

    pub fn light_texture(&self) -> Option<&Texture> {
        Some(&self.targets.as_ref()?.light.as_ref()?.0)
    }

    /// GPU memory of the library's objects and this crate's own, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let views = [&self.occlusion, &self.light];
        let views = views.into_iter().flatten().map(RayTracedView::memory_bytes);
        let targets = self.targets.as_ref().map_or(0, |targets| {
            let [width, height] = targets.size.map(u64::from);
            let of = |exists: bool, bytes| if exists { width * height * bytes } else { 0 };
            targets.gbuffer.memory_bytes()
                + of(targets.occlusion.is_some(), 1)
                + of(targets.light.is_some(), 8)
        });
        let copies = self.triangulation.memory_bytes(&self.adopted);
        self.scene.memory_bytes() + views.sum::<u64>() + targets + copies
    }
}

/// Fills a texture, if there is one.
fn clear(encoder: &mut CommandEncoder, texture: Option<&Texture>, color: wgpu::Color) {
    let Some(texture) = texture else {
        return;
    };
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("deep-screen-space-kiss3d clear"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(color),
                store: wgpu::StoreOp::Store,
            },
        })],
        ..Default::default()
    });
}

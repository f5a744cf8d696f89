//! A frame of a scene of the crate's, as an engine draws it: the G-buffer, and an effect from it into a texture.

use deep_screen_space::{
    Camera, Error, Geometry, HitLighting, Light, Quality, RayTracedEffect, RayTracedInput,
    RayTracedScene, RayTracedSceneInput, RayTracedView, RayTracedViewDescriptor, Viewport,
    glam::DVec3,
    scenes::{self, Scene, View},
    wgpu::{self, TextureFormat},
};
use support::{
    gpu::Gpu,
    raster::{Raster, Rasterizer, perspective},
    scene::SceneBuffers,
};

/// What [`compared`] renders: width and height in pixels.
pub const SIZE: [u32; 2] = [96, 64];

/// What is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Ambient visibility, within the radius that suits the scene.
    Occlusion,
    /// One diffuse bounce of a lamp, where the scene has one, or of the sun.
    Light,
}

impl Effect {
    /// Each of them.
    pub const ALL: [Self; 2] = [Self::Occlusion, Self::Light];

    /// As the page calls it, and files are named.
    pub fn name(self) -> &'static str {
        match self {
            Self::Occlusion => "occlusion",
            Self::Light => "light",
        }
    }

    /// The one of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|effect| effect.name() == name)
    }

    fn of(self, scene: &Scene) -> RayTracedEffect {
        match self {
            Self::Occlusion => RayTracedEffect::AmbientOcclusion {
                radius: scene.ao_radius,
            },
            Self::Light => RayTracedEffect::IndirectDiffuse {
                sky_radiance: [0.0; 3],
            },
        }
    }

    /// How far it looks.
    fn reach(self, scene: &Scene) -> f32 {
        match self {
            Self::Occlusion => scene.ao_radius,
            Self::Light => f32::INFINITY,
        }
    }
}

/// A camera that is turned around what it looks at.
#[derive(Clone, Copy, Debug)]
pub struct Orbit {
    view: View,
    /// Around the vertical, and above the horizon, radians.
    angles: [f64; 2],
    distance: f64,
}

impl Orbit {
    /// Where a view stands.
    pub fn new(view: View) -> Self {
        let from = DVec3::from(view.eye) - DVec3::from(view.target);
        let distance = from.length();
        Self {
            view,
            angles: [from.x.atan2(from.z), (from.y / distance).asin()],
            distance,
        }
    }

    /// Turns by so much, radians, and no further up or down than almost upright.
    pub fn turn(&mut self, across: f64, up: f64) {
        self.angles = [
            (self.angles[0] + across) % std::f64::consts::TAU,
            (self.angles[1] + up).clamp(-1.5, 1.5),
        ];
    }

    /// Goes nearer by a factor below 1, or farther, within a tenth and ten times of a metre's scale.
    pub fn approach(&mut self, factor: f64) {
        self.distance = (self.distance * factor).clamp(0.1, 1e3);
    }

    /// The camera of a picture of that size.
    pub fn camera(&self, [width, height]: [u32; 2]) -> Result<Camera, Error> {
        let [(sin_across, cos_across), (sin_up, cos_up)] = self.angles.map(f64::sin_cos);
        let direction = DVec3::new(sin_across * cos_up, sin_up, cos_across * cos_up);
        let target = DVec3::from(self.view.target);
        let aspect = f64::from(width) / f64::from(height);
        Camera::look_at(
            target + direction * self.distance,
            target,
            DVec3::Y,
            perspective(self.view.vertical_fov_degrees, aspect, self.view.near),
            Viewport::full(width, height),
        )
    }
}

/// A scene on the GPU, and all that an effect of it needs.
pub struct Frame {
    /// Where its first view stands.
    pub orbit: Orbit,
    scene: Scene,
    buffers: SceneBuffers,
    rasterizer: Rasterizer,
    gbuffer: Raster,
    size: [u32; 2],
    lights: Vec<Light>,
    traced: RayTracedScene,
    effect: Effect,
    view: RayTracedView,
}

impl Frame {
    /// The format of the texture that [`Frame::record`] writes.
    pub const FORMAT: TextureFormat = TextureFormat::Rgba16Float;

    /// For pictures of one size. The scene is one of [`scenes::by_name`].
    pub fn new(
        gpu: &Gpu,
        scene: &str,
        effect: Effect,
        quality: Quality,
        size: [u32; 2],
    ) -> Result<Self, String> {
        let mut scene =
            scenes::by_name(scene).ok_or_else(|| format!("there is no scene {scene}"))?;
        let lights = lights(&mut scene);
        let buffers = SceneBuffers::new(gpu, &scene);
        Ok(Self {
            orbit: Orbit::new(scene.views[0]),
            rasterizer: Rasterizer::new(gpu, &buffers),
            gbuffer: Raster::new(gpu, size),
            size,
            lights,
            traced: RayTracedScene::new(&gpu.device).map_err(|e| e.to_string())?,
            view: view(gpu, effect.of(&scene), quality)?,
            effect,
            buffers,
            scene,
        })
    }

    /// Shows something else of the same scene.
    pub fn show(&mut self, gpu: &Gpu, effect: Effect, quality: Quality) -> Result<(), String> {
        self.view = view(gpu, effect.of(&self.scene), quality)?;
        self.effect = effect;
        Ok(())
    }

    /// The G-buffer, what rays meet, and the effect into a texture of the frame's size and [`Frame::FORMAT`].
    pub fn record(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::Texture,
    ) -> Result<(), Error> {
        let camera = self.orbit.camera(self.size)?;
        let drawn = (&self.buffers, &camera);
        self.rasterizer.record(gpu, encoder, drawn, &self.gbuffer);
        let meshes = self.buffers.meshes();
        let input = RayTracedSceneInput {
            cull_by: &[camera],
            reach: self.effect.reach(&self.scene),
            lighting: Some(HitLighting {
                materials: &self.buffers.materials,
                lights: &self.lights,
            }),
            ..RayTracedSceneInput::new(Geometry { meshes: &meshes }, &camera)
        };
        self.traced.record(&gpu.device, encoder, &input)?;
        let input = RayTracedInput::new(self.gbuffer.gbuffer(), &camera, target);
        self.view.record(&gpu.device, encoder, &self.traced, &input)
    }
}

/// A lamp where the scene has one that shines itself, else the sun. Few rays would meet a small lamp, so that it is a point.
fn lights(scene: &mut Scene) -> Vec<Light> {
    let shines = |material: &scenes::Material| material.emission != [0.0; 3];
    let has_lamp = scene.materials.iter().any(shines);
    for material in &mut scene.materials {
        material.emission = [0.0; 3];
    }
    vec![if has_lamp {
        Light::Point {
            position: DVec3::new(0.0, 5.0, 0.0),
            intensity: [100.0, 80.0, 50.0],
        }
    } else {
        Light::Directional {
            direction: DVec3::new(-0.4, -0.8, -0.45).normalize(),
            irradiance: [4.0, 3.8, 3.4],
        }
    }]
}

fn view(gpu: &Gpu, effect: RayTracedEffect, quality: Quality) -> Result<RayTracedView, String> {
    let descriptor = RayTracedViewDescriptor::new(effect, quality, Frame::FORMAT);
    RayTracedView::new(&gpu.device, &descriptor).map_err(|e| e.to_string())
}

/// The picture by which a browser is compared with other drivers: of the room with a lamp, [`SIZE`] texels from the top.
pub async fn compared(gpu: &Gpu, effect: Effect) -> Result<Vec<[u16; 4]>, String> {
    let mut frame = Frame::new(gpu, "cornell", effect, Quality::Fast, SIZE)?;
    let [width, height] = SIZE;
    let target = gpu.target(Frame::FORMAT, width, height);
    let mut encoder = gpu.encoder();
    let recorded = frame.record(gpu, &mut encoder, target.texture());
    recorded.map_err(|e| e.to_string())?;
    gpu.finish(encoder);
    Ok(gpu.read_texture_soon(target.texture(), 0).await)
}

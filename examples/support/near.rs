//! The effects that need no surfels, over a whole image or a list of its pixels, and what they read: a G-buffer, a light, its
//! shadow map and what it lights.

use deep_screen_space::{
    BallSamples, Camera, Channels, Error, Light, MultiResMask, MultiResMaskSettings,
    NearFieldEffect, NearFieldSource, ObscuranceInput, ObscuranceSampling, ObscuranceSettings,
    ObscuranceVolume, PixelList, ScreenSpaceGi, ScreenSpaceGiInput, ScreenSpaceGiSettings,
    ShadowMap, SoftShadows, SoftShadowsInput, SoftShadowsSettings, Viewport, VolumetricObscurance,
    VolumetricObscuranceDescriptor,
    glam::{DMat4, DVec3},
    scenes::Scene,
    wgpu::{self, TextureFormat, TextureView},
};

use super::{
    gpu::Gpu,
    lights::beside,
    raster::{self, Raster},
    scene::SceneBuffers,
    shadow,
    visible::near_of,
    world::bounds_of,
};

/// What is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Volumetric obscurance by points.
    Obscurance,
    /// Soft shadows of one light.
    Shadow,
    /// Screen-space indirect light.
    Indirect,
}

impl Effect {
    pub const ALL: [Self; 3] = [Self::Obscurance, Self::Shadow, Self::Indirect];

    pub fn name(self) -> &'static str {
        match self {
            Self::Obscurance => "vo",
            Self::Shadow => "shadow",
            Self::Indirect => "ssgi",
        }
    }

    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|effect| effect.name() == name)
    }

    /// As many as the paper has.
    pub fn samples(self) -> u32 {
        match self {
            Self::Obscurance => 64,
            Self::Shadow => 196,
            Self::Indirect => 288,
        }
    }

    /// Whether it can take as many samples: obscurance has tables of a few numbers.
    pub fn takes(self, samples: u32) -> bool {
        self != Self::Obscurance || points(samples).is_some()
    }

    /// The paper's levels for it.
    pub fn mask(self) -> MultiResMaskSettings {
        match self {
            Self::Obscurance => MultiResMaskSettings::OCCLUSION,
            Self::Shadow => MultiResMaskSettings::SHADOW,
            Self::Indirect => MultiResMaskSettings::INDIRECT,
        }
    }

    pub fn channels(self) -> Channels {
        match self {
            Self::Obscurance | Self::Shadow => Channels::One,
            Self::Indirect => Channels::Three,
        }
    }

    /// Format of what it writes.
    pub fn format(self) -> TextureFormat {
        match self {
            Self::Obscurance | Self::Shadow => TextureFormat::R32Float,
            Self::Indirect => TextureFormat::Rgba16Float,
        }
    }
}

/// The table of as many points, if there is one.
fn points(samples: u32) -> Option<BallSamples> {
    let fits = |table: &BallSamples| table.table().len() == samples as usize;
    BallSamples::ALL.into_iter().find(fits)
}

/// Texels of a side of the shadow map's faces.
const MAP: u32 = 1024;

/// Radiance that leaves each pixel: what it reflects of the light, and of a little light from everywhere.
const LIT: &str = "
struct View { relative_from_clip: mat4x4f, light: vec4f }
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var depth: texture_2d<f32>;
@group(0) @binding(2) var normal: texture_2d<f32>;
@group(0) @binding(3) var albedo: texture_2d<f32>;
@group(0) @binding(4) var visible: texture_2d<f32>;
@group(0) @binding(5) var lit: texture_storage_2d<rgba16float, write>;
@compute @workgroup_size(8, 8)
fn light(@builtin(global_invocation_id) id: vec3u) {
  let size = textureDimensions(lit);
  if any(id.xy >= size) { return; }
  let ndc = (vec2f(id.xy) + 0.5) / vec2f(size) * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
  let at = textureLoad(depth, id.xy, 0).x;
  let h = view.relative_from_clip * vec4f(ndc, at, 1.0);
  var radiance = vec3f(0.0);
  if at > 0.0 {
    let to_light = normalize(view.light.xyz - view.light.w * h.xyz / h.w);
    let direct = max(dot(textureLoad(normal, id.xy, 0).xyz, to_light), 0.0) * textureLoad(visible, id.xy, 0).x;
    radiance = textureLoad(albedo, id.xy, 0).xyz * (0.9 * direct + 0.1);
  }
  textureStore(lit, id.xy, vec4f(radiance, 1.0));
}
";

/// A view of a scene: its G-buffer, a light beside the camera with its shadow map, and what is lit by it.
pub struct Stage<'g> {
    pub gpu: &'g Gpu,
    pub camera: Camera,
    pub drawn: Raster,
    pub lamp: ShadowedLight,
    pub lit: TextureView,
    /// How far shadows and indirect light reach, world units.
    pub reach: f32,
    /// How far obscurance does: it is of what is near.
    pub obscurance_radius: f32,
}

impl<'g> Stage<'g> {
    /// `view` is one of the scene's own.
    pub fn new(
        gpu: &'g Gpu,
        passes: &Passes,
        scene: &Scene,
        view: usize,
        [width, height]: [u32; 2],
    ) -> Result<Self, Error> {
        let view = &scene.views[view];
        let camera = Camera::look_at(
            view.eye.into(),
            view.target.into(),
            view.up.into(),
            raster::perspective(
                view.vertical_fov_degrees,
                f64::from(width) / f64::from(height),
                view.near,
            ),
            Viewport::full(width, height),
        )?;
        let light = beside(view.eye.into(), view.target.into(), view.up.into());
        let buffers = SceneBuffers::new(gpu, scene);
        Self::of(gpu, passes, scene, &buffers, &camera, light)
    }

    /// Any view of a scene, and any light, of which the place alone counts: `lit` takes it for white, and as bright everywhere.
    pub fn of(
        gpu: &'g Gpu,
        passes: &Passes,
        scene: &Scene,
        buffers: &SceneBuffers,
        camera: &Camera,
        light: Light,
    ) -> Result<Self, Error> {
        let Viewport { width, height, .. } = camera.viewport();
        let (low, high) = bounds_of(scene);
        // A file says nothing of what suits it.
        let reach = if scene.ao_radius.is_finite() {
            scene.ao_radius
        } else {
            0.05 * (high - low).length() as f32
        };
        let mut stage = Self {
            gpu,
            drawn: Raster::draw(gpu, buffers, camera),
            camera: *camera,
            lamp: ShadowedLight::new(gpu, scene, buffers, light)?,
            lit: gpu.storage(TextureFormat::Rgba16Float, width, height),
            reach,
            obscurance_radius: 0.25 * reach,
        };
        stage.illuminate(passes)?;
        Ok(stage)
    }

    /// Fills `lit`.
    fn illuminate(&mut self, passes: &Passes) -> Result<(), Error> {
        let gpu = self.gpu;
        let [width, height] = self.size();
        let visible = gpu.storage(TextureFormat::R32Float, width, height);
        let mut encoder = gpu.encoder();
        passes.record_hard_shadows(self, &mut encoder, visible.texture())?;
        let what = (&self.camera, &self.drawn, self.lamp.light);
        Illuminator::new(gpu).record(gpu, &mut encoder, what, [&visible, &self.lit]);
        gpu.finish(encoder);
        Ok(())
    }

    pub fn size(&self) -> [u32; 2] {
        let viewport = self.camera.viewport();
        [viewport.width, viewport.height]
    }

    /// What an effect reads besides the G-buffer.
    pub fn source(&self, effect: Effect) -> NearFieldSource<'_> {
        match effect {
            Effect::Obscurance => NearFieldSource::GBuffer,
            Effect::Shadow => NearFieldSource::Light(&self.lamp.light, self.lamp.map()),
            Effect::Indirect => NearFieldSource::Lit(self.lit.texture().into()),
        }
    }

    /// An effect as a view takes it, with as many samples as `record` takes.
    pub fn effect(&self, effect: Effect, samples: u32) -> Option<NearFieldEffect> {
        Some(match effect {
            Effect::Obscurance => NearFieldEffect::Obscurance {
                descriptor: of_points(points(samples)?),
                settings: self.obscurance(),
            },
            Effect::Shadow => NearFieldEffect::SoftShadows(self.shadows(samples)),
            Effect::Indirect => NearFieldEffect::ScreenSpaceGi(self.indirect(samples)),
        })
    }

    fn obscurance(&self) -> ObscuranceSettings {
        ObscuranceSettings {
            radius: self.obscurance_radius,
            turn: false,
            ..Default::default()
        }
    }

    fn shadows(&self, samples: u32) -> SoftShadowsSettings {
        SoftShadowsSettings {
            extent: match self.lamp.light {
                // Ten times as wide as the sun.
                Light::Directional { .. } => 0.05,
                _ => 0.1 * self.reach,
            },
            max_penumbra: 0.25 * self.reach,
            samples,
            ..Default::default()
        }
    }

    fn indirect(&self, samples: u32) -> ScreenSpaceGiSettings {
        ScreenSpaceGiSettings {
            radius: self.reach,
            samples,
            turn: false,
        }
    }
}

fn of_points(table: BallSamples) -> VolumetricObscuranceDescriptor {
    VolumetricObscuranceDescriptor {
        sampling: ObscuranceSampling::Points(table),
        volume: ObscuranceVolume::Hemisphere,
    }
}

/// A light with its shadow map.
pub struct ShadowedLight {
    pub light: Light,
    cameras: Vec<Camera>,
    map: wgpu::Texture,
}

impl ShadowedLight {
    /// Draws the map.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        buffers: &SceneBuffers,
        light: Light,
    ) -> Result<Self, Error> {
        let (low, high) = bounds_of(scene);
        let radius = 0.5 * (high - low).length();
        let cameras = match light {
            Light::Point { position, .. } | Light::Spot { position, .. } => {
                cube(position, near_of(scene, position, 1e-4 * radius))?
            }
            Light::Directional { direction, .. } => vec![sun(low, high, direction)?],
        };
        Ok(Self {
            map: shadow::draw(gpu, buffers, &cameras, MAP, TextureFormat::Depth32Float),
            light,
            cameras,
        })
    }

    pub fn map(&self) -> ShadowMap<'_> {
        ShadowMap::new(&self.map, &self.cameras)
    }
}

/// What lights a picture.
pub struct Illuminator {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
}

impl Illuminator {
    pub fn new(gpu: &Gpu) -> Self {
        let device = &gpu.device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("lit"),
            source: wgpu::ShaderSource::Wgsl(LIT.into()),
        });
        let sampled = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: false },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let written = wgpu::BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format: TextureFormat::Rgba16Float,
            view_dimension: wgpu::TextureViewDimension::D2,
        };
        let read = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let types = [read, sampled, sampled, sampled, sampled, written];
        let entries: Vec<_> = (0..)
            .zip(types)
            .map(|(binding, ty)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty,
                count: None,
            })
            .collect();
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("lit"),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some("light"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        Self { layout, pipeline }
    }

    /// Fills the last texture: radiance that leaves what is drawn, where the first says how much of the light is visible.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        (camera, drawn, light): (&Camera, &Raster, Light),
        [visible, lit]: [&TextureView; 2],
    ) {
        let clip = camera.projection() * DMat4::from_mat3(camera.rotation());
        let mut uniform = clip.inverse().as_mat4().to_cols_array().to_vec();
        let light = match light {
            Light::Point { position, .. } | Light::Spot { position, .. } => {
                (position - camera.eye()).as_vec3().extend(1.0)
            }
            Light::Directional { direction, .. } => -direction.as_vec3().extend(0.0),
        };
        uniform.extend(light.to_array());
        let uniform = gpu.buffer(&uniform, wgpu::BufferUsages::UNIFORM);
        let textures = [&drawn.depth, &drawn.normal, &drawn.albedo, visible, lit];
        let mut entries = vec![wgpu::BindGroupEntry {
            binding: 0,
            resource: uniform.as_entire_binding(),
        }];
        entries.extend(
            (1..)
                .zip(textures)
                .map(|(binding, view)| wgpu::BindGroupEntry {
                    binding,
                    resource: wgpu::BindingResource::TextureView(view),
                }),
        );
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.layout,
            entries: &entries,
        });
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(
            lit.texture().width().div_ceil(8),
            lit.texture().height().div_ceil(8),
            1,
        );
    }
}

/// Six faces about a point.
fn cube(eye: DVec3, near: f64) -> Result<Vec<Camera>, Error> {
    [DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .flat_map(|axis| [axis, -axis])
        .map(|axis| {
            let up = if axis.y == 0.0 { DVec3::Y } else { DVec3::Z };
            let projection = raster::perspective(90.0, 1.0, near);
            Camera::look_at(eye, eye + axis, up, projection, Viewport::full(MAP, MAP))
        })
        .collect()
}

/// One face over a whole box, along the sun's rays.
fn sun(low: DVec3, high: DVec3, direction: DVec3) -> Result<Camera, Error> {
    let direction = direction.normalize();
    let radius = 0.5 * (high - low).length();
    // Depth 1 at the near plane and 0 at the far one.
    let (near, far) = (0.5 * radius, 4.0 * radius);
    let scale = 1.0 / (far - near);
    let mut projection = DMat4::from_scale(DVec3::new(1.0 / radius, 1.0 / radius, scale));
    projection.w_axis.z = far * scale;
    let target = 0.5 * (low + high);
    let up = direction.any_orthogonal_vector();
    let eye = target - 2.0 * radius * direction;
    Camera::look_at(eye, target, up, projection, Viewport::full(MAP, MAP))
}

/// The pipelines of all effects, and of the masks.
pub struct Passes {
    pub mask: MultiResMask,
    /// One for each table.
    obscurance: Vec<(BallSamples, VolumetricObscurance)>,
    shadows: SoftShadows,
    indirect: ScreenSpaceGi,
}

impl Passes {
    pub fn new(device: &wgpu::Device) -> Result<Self, Error> {
        Ok(Self {
            mask: MultiResMask::new(device)?,
            obscurance: BallSamples::ALL
                .into_iter()
                .map(|table| {
                    let pass = VolumetricObscurance::new(device, &of_points(table))?;
                    Ok((table, pass))
                })
                .collect::<Result<_, Error>>()?,
            shadows: SoftShadows::new(device)?,
            indirect: ScreenSpaceGi::new(device)?,
        })
    }

    /// An effect with `samples` a pixel, for all pixels or those of a list.
    pub fn record(
        &self,
        stage: &Stage<'_>,
        encoder: &mut wgpu::CommandEncoder,
        (effect, samples): (Effect, u32),
        work: Option<PixelList<'_>>,
        target: &wgpu::Texture,
    ) -> Result<(), Error> {
        let device = &stage.gpu.device;
        match effect {
            Effect::Obscurance => {
                let find = |(table, _): &&(BallSamples, _)| points(samples) == Some(*table);
                let Some((_, pass)) = self.obscurance.iter().find(find) else {
                    return Err(Error::Setting {
                        field: "samples",
                        value: samples.into(),
                        accepted: "6, 12, 33 or 64",
                    });
                };
                let gbuffer = stage.drawn.gbuffer();
                let input = ObscuranceInput {
                    depth: gbuffer.depth,
                    normals: Some(gbuffer.normals()),
                    camera: &stage.camera,
                    moments: None,
                    work,
                    target: target.into(),
                    timestamps: None,
                };
                pass.record(device, encoder, &input, &stage.obscurance())
            }
            Effect::Shadow => {
                let settings = stage.shadows(samples);
                self.record_shadows(stage, encoder, &settings, work, target)
            }
            Effect::Indirect => self.indirect.record(
                device,
                encoder,
                &ScreenSpaceGiInput {
                    gbuffer: stage.drawn.gbuffer(),
                    camera: &stage.camera,
                    lit: stage.lit.texture().into(),
                    work,
                    target: target.into(),
                    timestamps: None,
                },
                &stage.indirect(samples),
            ),
        }
    }

    fn record_shadows(
        &self,
        stage: &Stage<'_>,
        encoder: &mut wgpu::CommandEncoder,
        settings: &SoftShadowsSettings,
        work: Option<PixelList<'_>>,
        target: &wgpu::Texture,
    ) -> Result<(), Error> {
        self.shadows.record(
            &stage.gpu.device,
            encoder,
            &SoftShadowsInput {
                gbuffer: stage.drawn.gbuffer(),
                camera: &stage.camera,
                light: &stage.lamp.light,
                map: stage.lamp.map(),
                work,
                target: target.into(),
                timestamps: None,
            },
            settings,
        )
    }

    /// One look-up a pixel.
    pub fn record_hard_shadows(
        &self,
        stage: &Stage<'_>,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::Texture,
    ) -> Result<(), Error> {
        self.record_shadows(stage, encoder, &SoftShadowsSettings::hard(), None, target)
    }
}

//! Direct light of surfels, for effects that bounce it (`wgsl/surfel_shader.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device, Features, PipelineCache,
    TextureUsages, TextureView,
};

use self::{
    params::{ShadowParams, SurfelShaderParams},
    settings::SurfelShaderSettings,
};
use crate::{
    bvh::{Bvh, Primitives},
    camera::Camera,
    effect::Listing,
    error::{Error, check_limit, check_setting},
    geometry::Material,
    gpu::compiler::Compiler,
    gpu::listing::name_of,
    gpu::{
        Kernel, Timestamps,
        binding::{self, Layout, Named, view, whole},
        check_timestamps, compute_pass, shader, storage,
        uniforms::{Parameters, Place, Uniforms, Uploaded},
    },
    light::Light,
    surfel::Placement,
    surfel::{SurfelCloud, SurfelRadiance},
    texture_slice::{Read, TextureSlice, check_layers},
};

const SOURCE: &str = include_str!("../../wgsl/surfel_shader.wgsl");

const LABEL: &str = "deep-screen-space surfel shader";

/// Cameras that one shadow map can have: a point light's six.
pub(crate) const MAX_SHADOW_CAMERAS: usize = 6;

/// Lights surfels: fills a buffer with what each of a cloud's surfels sends from its front and its back, its own
/// emission and the direct light that it reflects. One pass between the [`Surfelizer`](crate::Surfelizer) and those
/// that splat.
///
/// Holds pipelines only; one serves any number of clouds.
#[derive(Debug)]
pub struct SurfelShader {
    plain: [ShadeKernel; 2],
    mapped: [ShadeKernel; 2],
    traced: [ShadeKernel; 2],
    /// Which rays those meet.
    primitives: Primitives,
    /// Where the device traces rays itself.
    #[cfg(feature = "ray-query")]
    by_device: Option<[ShadeKernel; 2]>,
    uniforms: Uniforms,
}

/// A variant: at index 0 for one point per surfel, at index 1 for several.
#[derive(Debug)]
struct ShadeKernel {
    layout: Layout,
    pipeline: ComputePipeline,
}

/// How a light's shadows are found.
#[derive(Clone, Copy, Debug, Default)]
pub enum Shadow<'a> {
    /// The light casts none.
    #[default]
    None,
    /// In the caller's shadow map.
    Map(ShadowMap<'a>),
    /// By a ray from the surfel to the light, among the triangles that its cloud was made of, given the hierarchy over them,
    /// recorded since the cloud was ([`BvhBuilder::record`](crate::BvhBuilder::record)): exact, without a map or a bias. What the
    /// cloud was culled of casts none.
    Traced(&'a Bvh),
}

/// A light's shadow map: depth as seen from the light, by one camera or by several.
///
/// A surfel looks into the first layer whose camera's frustum contains it (so that cascades go from the finest to the
/// coarsest) and is in shadow where the depth there is nearer than its own. Outside of all frusta it is lit.
#[derive(Clone, Copy, Debug)]
pub struct ShadowMap<'a> {
    /// The layer of the first camera; those of the others follow it. A whole map, a range of an array's layers, some of a
    /// cube's faces or all six: a depth format (of one with stencil the depth is read), or `R32Float` with the same values.
    /// Usage `TEXTURE_BINDING`, one sample per texel.
    pub depth: TextureSlice<'a>,
    /// What the layers were drawn with, in order, 1…6: one for a directional or spot light, six for a point light. A
    /// camera's viewport says which rectangle of its layer it fills. Depth is what the camera's projection makes of it:
    /// forward or reversed, perspective or orthographic.
    pub cameras: &'a [Camera],
    /// How far a surfel is moved off its surface, to the side of the light, before it looks, in texels of the map where
    /// the surfel is; 0…100. A texel holds the depth at its middle, at most `√½` of its side away, and a plane at the
    /// angle θ to the light's rays is deeper there by up to `√½ tan θ` sides: moving off it by `√½ sin θ` sides makes up
    /// for that at any slope. Default 1: the rest is for curved surfaces and for rounding. More loses shadows where
    /// things touch. What no bias makes up for is an inner edge whose other surface the light grazes: there a strip of
    /// less than a texel can be dark, and a finer map is what helps.
    pub bias: f32,
}

impl<'a> ShadowMap<'a> {
    /// A map with the default bias.
    pub fn new(depth: impl Into<TextureSlice<'a>>, cameras: &'a [Camera]) -> Self {
        Self {
            depth: depth.into(),
            cameras,
            bias: 1.0,
        }
    }

    /// Checks the cameras, the bias and the texture.
    ///
    /// # Errors
    /// [`Error::Setting`], [`Error::Format`], [`Error::Usage`], [`Error::Shape`] or [`Error::Size`], naming the field.
    pub fn validate(&self) -> Result<(), Error> {
        const DEPTH: &str = "ShadowMap::depth";
        check_setting(
            (1..=MAX_SHADOW_CAMERAS).contains(&self.cameras.len()),
            "ShadowMap::cameras",
            self.cameras.len() as f64,
            "1 to 6 cameras",
        )?;
        check_setting(
            (0.0..=100.0).contains(&self.bias),
            "ShadowMap::bias",
            self.bias,
            "0 to 100 texels",
        )?;
        let layers = self.cameras.len() as u32;
        check_layers(DEPTH, &self.depth, layers, TextureUsages::TEXTURE_BINDING)?;
        let format = self.depth.view_format();
        if !(format.has_depth_aspect() || format == wgpu::TextureFormat::R32Float) {
            return Err(Error::Format {
                name: DEPTH,
                format,
                accepted: "a depth format or R32Float",
            });
        }
        let size = self.depth.size();
        for camera in self.cameras {
            let needed = camera.viewport().end();
            if size[0] < needed[0] || size[1] < needed[1] {
                return Err(Error::Size {
                    name: DEPTH,
                    size,
                    needed,
                });
            }
        }
        Ok(())
    }

    /// A view of the cameras' layers.
    pub(crate) fn view(&self) -> TextureView {
        self.depth.read_layers(self.cameras.len() as u32)
    }

    pub(crate) fn reads(&self) -> Read<'_> {
        ("ShadowMap::depth", self.depth, self.cameras.len() as u32)
    }
}

/// A light and its shadows.
#[derive(Clone, Copy, Debug)]
pub struct ShadedLight<'a> {
    /// The light.
    pub light: Light,
    /// How its shadows are found.
    pub shadow: Shadow<'a>,
}

/// What one recording of the [`SurfelShader`] works on.
#[derive(Clone, Copy, Debug)]
pub struct SurfelShaderInput<'a> {
    /// The surfels.
    pub cloud: &'a SurfelCloud,
    /// A storage buffer of one or more [`Material`]s. An index beyond its end takes the last one; a component that is
    /// negative or not finite counts as 0.
    pub materials: &'a Buffer,
    /// The lights, one dispatch each. None leaves the surfaces' own emission.
    pub lights: &'a [ShadedLight<'a>],
    /// Where the result goes: [`SurfelRadiance`] a surfel, of which the cloud's
    /// [`SurfelCounts::stored`](crate::SurfelCounts::stored) are written. From [`SurfelShader::create_radiance`], or the
    /// caller's own with usage `STORAGE` and 32 bytes for each surfel of the cloud's capacity.
    pub radiance: &'a Buffer,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> SurfelShaderInput<'a> {
    /// Without timestamps.
    pub fn new(
        cloud: &'a SurfelCloud,
        materials: &'a Buffer,
        lights: &'a [ShadedLight<'a>],
        radiance: &'a Buffer,
    ) -> Self {
        Self {
            cloud,
            materials,
            lights,
            radiance,
            timestamps: None,
        }
    }
}

impl SurfelShader {
    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device was made with less than that.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        Self::with_primitives(compiler, Primitives::Triangles)
    }

    /// The same for shadows by rays that meet [`Primitives::AlphaTested`] in place of [`Primitives::Triangles`]; for others it is
    /// as `new`.
    ///
    /// # Errors
    /// As [`SurfelShader::new`].
    pub fn with_primitives<'a>(
        compiler: impl Into<Compiler<'a>>,
        primitives: Primitives,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        let primitives = primitives.of_own_traversal();
        check_limit(
            "max_storage_buffers_per_shader_stage",
            u64::from(device.limits().max_storage_buffers_per_shader_stage),
            6,
            LABEL,
        )?;
        let kernels = |shadow| -> Result<_, Error> {
            let kernel =
                |samples| ShadeKernel::new(device, ShadeVariant { shadow, samples }, cache);
            Ok([kernel(false)?, kernel(true)?])
        };
        Ok(Self {
            #[cfg(feature = "ray-query")]
            by_device: Primitives::RayQuery
                .validate(device)
                .is_ok()
                .then(|| kernels(ShadowKind::Traced(Primitives::RayQuery)))
                .transpose()?,
            plain: kernels(ShadowKind::None)?,
            mapped: kernels(ShadowKind::Map)?,
            traced: kernels(ShadowKind::Traced(primitives))?,
            primitives,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Room for what the surfels of a cloud send: a [`SurfelRadiance`] each (usages `STORAGE | COPY_SRC | COPY_DST`).
    ///
    /// # Errors
    /// [`Error::Limit`] where the device cannot bind as much.
    pub fn create_radiance(&self, device: &Device, cloud: &SurfelCloud) -> Result<Buffer, Error> {
        storage(
            device,
            "deep-screen-space surfel radiance",
            radiance_bytes(cloud),
            BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
        )
    }

    /// Records the lighting of a cloud, after the recording that makes it and before those that splat it.
    ///
    /// # Errors
    /// What [`SurfelShaderSettings::validate`], [`Light::validate`] and [`ShadowMap::validate`] find;
    /// [`Error::Mismatch`] for bounds of another cloud's capacity, or of disks; [`Error::Recording`] for a cloud that was not
    /// recorded, and for bounds that were not recorded from it, since that was;
    /// [`Error::Buffer`] for materials or radiance that are too small, lack a usage or are the same buffer as another
    /// one, [`Error::Limit`] for more materials than the device can bind. All before anything is recorded.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SurfelShaderInput<'_>,
        settings: &SurfelShaderSettings,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        for ShadedLight { light, shadow } in input.lights {
            light.validate()?;
            match shadow {
                Shadow::None => {}
                Shadow::Map(map) => map.validate()?,
                Shadow::Traced(bvh) => {
                    self.traced(bvh, input.cloud)?;
                }
            }
        }
        input.cloud.last()?;
        check_buffers(device, input)?;

        // The emission is written by the first dispatch: without a light that shines, by one without any.
        let mut lights: Vec<Option<&ShadedLight<'_>>> = input
            .lights
            .iter()
            .filter(|shaded| shaded.light.is_emitting())
            .map(Some)
            .collect();
        if lights.is_empty() {
            lights.push(None);
        }
        let cloud = input.cloud;
        let mut parameters = Parameters::new(device);
        let dispatches: Vec<Dispatch<'_>> = lights
            .into_iter()
            .enumerate()
            .map(|(index, shaded)| {
                let light = shaded.map(|s| &s.light);
                // Other placements leave a surfel without a triangle of its own.
                let samples = if light.is_some() && cloud.placement == Placement::Centroid {
                    settings.samples
                } else {
                    1
                };
                let params = SurfelShaderParams::new(light, cloud, index == 0, samples);
                let shadow = shaded.map_or(Shadow::None, |s| s.shadow);
                Dispatch {
                    samples,
                    shadow,
                    params: parameters.add(&params),
                    map: match &shadow {
                        Shadow::Map(map) => {
                            Some(parameters.add(&ShadowParams::new(map, cloud.origin)))
                        }
                        _ => None,
                    },
                }
            })
            .collect();
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);
        for dispatch in &dispatches {
            self.dispatch(device, &mut pass, input, &parameters, dispatch)?;
        }
        Ok(())
    }

    /// The kernels that trace such a hierarchy, and what they bind of it.
    fn traced<'b>(
        &self,
        bvh: &'b Bvh,
        cloud: &SurfelCloud,
    ) -> Result<(&[ShadeKernel; 2], Vec<Named<'b>>), Error> {
        match bvh.primitives() {
            #[cfg(feature = "ray-query")]
            Primitives::RayQuery => {
                let pieces = bvh.pieces(cloud, Primitives::RayQuery)?;
                let kernels = self.by_device.as_ref().ok_or_else(|| Error::Feature {
                    feature: Primitives::RayQuery.features(),
                    why: LABEL,
                })?;
                Ok((kernels, pieces))
            }
            _ => Ok((&self.traced, bvh.pieces(cloud, self.primitives)?)),
        }
    }

    fn dispatch(
        &self,
        device: &Device,
        pass: &mut wgpu::ComputePass<'_>,
        input: &SurfelShaderInput<'_>,
        parameters: &Uploaded,
        dispatch: &Dispatch<'_>,
    ) -> Result<(), Error> {
        let cloud = input.cloud;
        let mut resources = vec![
            ("params", parameters.at(dispatch.params)),
            ("surfels", whole(&cloud.surfels)),
            ("sources", whole(&cloud.sources)),
            ("counters", whole(&cloud.counters)),
            ("materials", binding::table::<Material>(input.materials)),
            (
                "radiance",
                binding::first(input.radiance, radiance_bytes(cloud)),
            ),
        ];
        let by_device =
            matches!(&dispatch.shadow, Shadow::Traced(bvh) if bvh.primitives().by_device());
        if dispatch.samples > 1 || by_device {
            resources.push(("pieces", whole(&cloud.pieces)));
        }
        resources.extend(dispatch.map.map(|map| ("shadow", parameters.at(map))));
        let depth;
        let kernels = match &dispatch.shadow {
            Shadow::Map(map) => {
                depth = map.view();
                resources.push(("depth_map", view(&depth)));
                &self.mapped
            }
            Shadow::Traced(bvh) => {
                let (kernels, pieces) = self.traced(bvh, cloud)?;
                resources.extend(pieces);
                kernels
            }
            Shadow::None => &self.plain,
        };
        let kernel = &kernels[usize::from(dispatch.samples > 1)];
        let group = kernel.layout.group(device, &resources);
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &group.raw, &group.offsets);
        // As many workgroups as wrote the surfels: none for a cloud that holds none.
        pass.dispatch_workgroups_indirect(&cloud.emission, 0);
        Ok(())
    }
}

/// One light of a recording, or none.
struct Dispatch<'a> {
    /// Points a surfel.
    samples: u32,
    shadow: Shadow<'a>,
    params: Place,
    /// Of a shadow map.
    map: Option<Place>,
}

impl ShadeKernel {
    fn new(
        device: &Device,
        variant: ShadeVariant,
        cache: Option<&PipelineCache>,
    ) -> Result<Self, Error> {
        let module = shader::create(device, LABEL, source(variant)?);
        let layout = module.layout(device, &["shade"]);
        let pipeline = Kernel {
            label: LABEL,
            module: &module,
            entry: "shade",
            layouts: &[&layout.raw],
            constants: &[],
            cache,
        }
        .create(device);
        Ok(Self { layout, pipeline })
    }
}

/// How a module finds shadows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ShadowKind {
    None,
    Map,
    Traced(Primitives),
}

/// What a module is assembled for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShadeVariant {
    pub shadow: ShadowKind,
    pub samples: bool,
}

/// Assembles one of them.
fn source(variant: ShadeVariant) -> Result<String, Error> {
    let mut flags = Vec::new();
    match variant.shadow {
        ShadowKind::None => {}
        ShadowKind::Map => flags.push("SHADOW_MAP"),
        ShadowKind::Traced(primitives) => {
            flags.extend(["SHADOW_TRACED", "SHADOW_RAYS"]);
            flags.extend(primitives.flags());
        }
    }
    flags.extend(variant.samples.then_some("SAMPLES"));
    shader::assemble("surfel_shader", SOURCE, &flags, &[])
}

/// Bytes of radiance for all surfels that a cloud can hold, and for one at least: no less can be bound.
pub(crate) fn radiance_bytes(cloud: &SurfelCloud) -> u64 {
    u64::from(cloud.capacity.surfels.max(1)) * size_of::<SurfelRadiance>() as u64
}

fn check_buffers(device: &Device, input: &SurfelShaderInput<'_>) -> Result<(), Error> {
    const MATERIALS: &str = "SurfelShaderInput::materials";
    const RADIANCE: &str = "SurfelShaderInput::radiance";
    let cloud = input.cloud;
    binding::check_table::<Material>(device, MATERIALS, input.materials)?;
    binding::check_first(device, RADIANCE, input.radiance, radiance_bytes(cloud))?;
    // A kernel cannot read what it writes.
    let read = [
        input.materials,
        &cloud.surfels,
        &cloud.sources,
        &cloud.counters,
        &cloud.pieces,
    ];
    binding::check_own(RADIANCE, input.radiance, read)
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    for (shadow, name) in [
        (ShadowKind::None, "surfel_shader"),
        (ShadowKind::Map, "surfel_shader shadow map"),
        (
            ShadowKind::Traced(Primitives::Triangles),
            "surfel_shader shadow traced",
        ),
        (
            ShadowKind::Traced(Primitives::AlphaTested),
            "surfel_shader shadow traced alpha tested",
        ),
        #[cfg(feature = "ray-query")]
        (
            ShadowKind::Traced(Primitives::RayQuery),
            "surfel_shader shadow traced ray query",
        ),
    ] {
        for samples in [false, true] {
            let name = name_of(name, &[(samples, "samples")]);
            let features = match shadow {
                ShadowKind::Traced(primitives) => primitives.features(),
                _ => Features::empty(),
            };
            all.add_for(features, &name, source(ShadeVariant { shadow, samples })?);
        }
    }
    Ok(())
}

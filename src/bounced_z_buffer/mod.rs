//! What each pixel meets first along directions of its own (The Bounced Z-buffer 3, 4.2; `wgsl/bounced_z_buffer.wgsl`).

pub(crate) mod descriptor;
pub(crate) mod params;
pub(crate) mod settings;
pub(crate) mod view;

use wgpu::{
    BindGroupLayout, BindingType, Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device,
    PipelineCache, ShaderStages, TextureFormat, TextureViewDimension,
};

use self::{
    descriptor::{BouncedDescriptor, HitLighting, Lighting, Payload},
    params::{BouncedParams, DiskParams, LightsParams, MAX_LIGHTS},
    settings::{BouncedSettings, MAX_RAYS_PER_PIXEL, Sampling},
    view::{BouncedView, Hits, Traced},
};
use crate::{
    bvh::{Bvh, Primitives},
    camera::Camera,
    error::{Error, check_setting},
    gbuffer::{GBuffer, check_roughness},
    geometry::Material,
    gpu::{
        Kernel, Timestamps,
        binding::{self, FLOAT_2D, READ, UINT_2D, UNIFORM, WRITE, whole},
        check_timestamps, compute_pass, shader, storage, uniform,
    },
    receivers::{Receivers, ReceiversPass, check_view_size, plane},
    recorded::Last,
    shaders::{Listing, name_of},
    surfel::SurfelCloud,
    surfel_shader::radiance_bytes,
    surfelizer::settings::Placement,
    texture_slice::TextureSlice,
};

const SOURCE: &str = include_str!("../../wgsl/bounced_z_buffer.wgsl");

const LABEL: &str = "deep-screen-space bounced z-buffer";

/// Finds what each pixel meets first along directions of its own: exactly, whether it is hidden, off screen or edge-on,
/// among the triangles that a cloud was made of (or, for comparison, among its surfels as disks: [`Primitives`]). What lies
/// behind a hit does not count, so that light neither passes through surfaces nor is blocked twice.
///
/// Holds pipelines only; one serves any number of clouds and views.
#[derive(Debug)]
pub struct BouncedZBuffer {
    descriptor: BouncedDescriptor,
    layout: BindGroupLayout,
    trace: ComputePipeline,
    receivers: ReceiversPass,
}

/// What one recording of the [`BouncedZBuffer`] works on.
#[derive(Clone, Copy, Debug)]
pub struct BouncedInput<'a> {
    /// The caller's G-buffer.
    pub gbuffer: GBuffer<'a>,
    /// The camera that the G-buffer was drawn with; it may be another than the cloud's (stereo, split screen).
    pub camera: &'a Camera,
    /// The cloud whose pieces or surfels rays meet. Recorded with [`SurfelizerSettings::density`](crate::SurfelizerSettings::density)
    /// at infinity its pieces are the caller's triangles, and hits are exact.
    pub cloud: &'a SurfelCloud,
    /// The hierarchy over the cloud's pieces or surfels, recorded since the cloud was.
    pub bvh: &'a Bvh,
    /// With [`Lighting::Surfels`] and [`Payload::Radiance`] a storage buffer of a
    /// [`SurfelRadiance`](crate::SurfelRadiance) for each surfel of the cloud, as the [`SurfelShader`](crate::SurfelShader) or
    /// the caller fills it. What is not a number or negative counts as 0, and what is above 1e30 as that.
    pub radiance: Option<&'a Buffer>,
    /// With [`Lighting::Hits`] and [`Payload::Radiance`] what lights the hits.
    pub lighting: Option<HitLighting<'a>>,
    /// With [`Sampling::Glossy`] the G-buffer's roughness: perceptual, 0 for a mirror to 1, its square being the width α
    /// of the Trowbridge-Reitz distribution. The red channel of any float or unorm format, usage `TEXTURE_BINDING`,
    /// covering the camera's viewport. Values beyond 0…1 are clamped, NaN counts as 1; α is at least 1e-3, below which
    /// `f32` cannot tell a lobe's directions apart. A shading normal that faces away from the viewer is seen from just
    /// above its horizon.
    pub roughness: Option<TextureSlice<'a>>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl BouncedZBuffer {
    /// What it was compiled for.
    pub(crate) fn descriptor(&self) -> &BouncedDescriptor {
        &self.descriptor
    }

    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device was made with less than that; [`Error::Setting`] for levels out of range.
    pub fn new(
        device: &Device,
        descriptor: &BouncedDescriptor,
        cache: Option<&PipelineCache>,
    ) -> Result<Self, Error> {
        descriptor.primitives.validate()?;
        let mut entries = vec![
            (0, UNIFORM),
            (1, READ),
            (4, UINT_2D),
            (9, WRITE),
            (11, UNIFORM),
        ];
        check_setting(
            !descriptor.lit() || descriptor.primitives == Primitives::Triangles,
            "BouncedDescriptor::primitives",
            f64::from(u8::from(descriptor.primitives != Primitives::Triangles)),
            "Primitives::Triangles, with Lighting::Hits",
        )?;
        entries.extend(match (descriptor.payload, descriptor.lighting) {
            (Payload::Occlusion, _) => vec![(5, WRITE)],
            (Payload::Radiance, Lighting::Surfels) => vec![(5, store_colors()), (6, READ)],
            (Payload::Radiance, Lighting::Hits) => {
                vec![(5, store_colors()), (13, UNIFORM), (14, READ)]
            }
        });
        entries.extend(match (descriptor.primitives, descriptor.payload) {
            (Primitives::Disks { .. }, _) => {
                vec![(2, FLOAT_2D), (16, UNIFORM), (17, READ), (18, READ)]
            }
            (Primitives::Triangles, Payload::Occlusion) => vec![(2, UINT_2D), (3, UINT_2D)],
            (Primitives::Triangles, Payload::Radiance) => {
                vec![(2, UINT_2D), (3, UINT_2D), (8, READ)]
            }
        });
        let offsets = descriptor.primitives == Primitives::Triangles
            && (descriptor.payload, descriptor.lighting) == (Payload::Radiance, Lighting::Surfels);
        entries.extend(offsets.then_some((7, READ)));
        entries.extend(descriptor.statistics.then_some((10, WRITE)));
        if descriptor.sampling == Sampling::Glossy {
            entries.push((12, FLOAT_2D));
        }
        let layout = binding::layout(device, LABEL, ShaderStages::COMPUTE, &entries);
        let module = shader::create(device, LABEL, source(descriptor)?);
        let trace = Kernel {
            label: LABEL,
            module: &module,
            entry: "trace",
            layouts: &[&layout],
            constants: &[("SAMPLING", f64::from(descriptor.sampling.code()))],
            cache,
        }
        .create(device);
        Ok(Self {
            descriptor: *descriptor,
            layout,
            trace,
            receivers: ReceiversPass::new(device, cache)?,
        })
    }

    /// Room for a view of `width` × `height` pixels with up to `directions` directions each.
    ///
    /// # Errors
    /// [`Error::Setting`] for directions or a size out of range, [`Error::Limit`] for more than the device can hold.
    pub fn create_view(
        &self,
        device: &Device,
        width: u32,
        height: u32,
        rays_per_pixel: u32,
    ) -> Result<BouncedView, Error> {
        check_setting(
            rays_per_pixel <= MAX_RAYS_PER_PIXEL,
            "rays_per_pixel",
            rays_per_pixel,
            "0 to 64",
        )?;
        let size = [width, height];
        check_view_size(device, "deep-screen-space hits", size)?;
        let usage = BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let hits = match self.descriptor.payload {
            Payload::Occlusion => Hits::Bits(storage(
                device,
                "deep-screen-space hits",
                4 * u64::from(words(rays_per_pixel)) * u64::from(width) * u64::from(height),
                usage,
            )?),
            Payload::Radiance => {
                let texture = plane(
                    device,
                    "deep-screen-space hits",
                    TextureFormat::R32Uint,
                    size,
                    rays_per_pixel.max(1),
                )?;
                Hits::Colors(texture.create_view(&wgpu::TextureViewDescriptor {
                    dimension: Some(TextureViewDimension::D2Array),
                    ..Default::default()
                }))
            }
        };
        let nearness = storage(
            device,
            "deep-screen-space nearness of hits",
            4 * u64::from(width) * u64::from(height),
            usage,
        )?;
        let statistics = self
            .descriptor
            .statistics
            .then(|| storage(device, "deep-screen-space hit statistics", 24, usage))
            .transpose()?;
        Ok(BouncedView {
            // Last: what the device's limits refuse is known before this much memory is asked for.
            receivers: Receivers::new(device, size)?,
            hits,
            nearness,
            descriptor: self.descriptor,
            rays_per_pixel,
            statistics,
            recorded: Last::default(),
        })
    }

    /// Records the tracing of a view's directions.
    ///
    /// # Errors
    /// What [`GBuffer::validate`] and [`BouncedSettings::validate`] find; [`Error::Mismatch`] where the view was made for
    /// another descriptor or size or for fewer directions, or the hierarchy for another cloud's capacity; [`Error::Recording`] where the
    /// hierarchy was not recorded from this cloud, since that was; [`Error::Buffer`] for radiance
    /// that is missing or too small, or for materials; what [`Light::validate`](crate::Light::validate) finds; [`Error::Mismatch`] for lighting that is
    /// missing, and [`Error::Setting`] for too many lights; what [`GBuffer::validate`] finds of views, and [`Error::Mismatch`] where there is none,
    /// for roughness; [`Error::Setting`] where radiance of pieces is asked for and the surfels are not leaves of them
    /// ([`Placement::Grid`] and [`Placement::Random`]).
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &BouncedInput<'_>,
        settings: &BouncedSettings,
        view: &BouncedView,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let viewport = input.camera.viewport();
        input.gbuffer.validate(viewport)?;
        let cloud = input.cloud;
        self.check_view([viewport.width, viewport.height], settings, view)?;
        let radiance = self.check_radiance(device, input, view)?;
        let lighting = self.check_lighting(device, input, view)?;
        let roughness = check_roughness(
            "BouncedInput::roughness",
            input.roughness,
            (self.descriptor.sampling == Sampling::Glossy).then_some("Sampling::Glossy"),
            viewport,
        )?;
        let disks;
        let (nodes, primitives) = match self.descriptor.primitives {
            Primitives::Triangles => {
                let bounds = input.bvh.triangles(cloud)?;
                let mut primitives = vec![(3, binding::view(&bounds.triangles))];
                if self.descriptor.payload == Payload::Radiance {
                    primitives.push((8, whole(&cloud.pieces)));
                }
                primitives.extend(radiance.map(|_| (7, whole(&cloud.piece_offsets.values))));
                (&bounds.nodes, primitives)
            }
            Primitives::Disks { levels } => {
                let bounds = input.bvh.disks(cloud, levels)?;
                disks = uniform(device, LABEL, &DiskParams::new(&settings.disks, bounds));
                let primitives = vec![
                    (16, whole(&disks)),
                    (17, whole(&cloud.surfels)),
                    (18, whole(&cloud.sources)),
                ];
                (&bounds.nodes, primitives)
            }
        };

        view.recorded.set(Traced {
            settings: *settings,
            camera: *input.camera,
            origin: cloud.origin(),
            of: cloud.last()?,
        });
        if let Some(statistics) = &view.statistics {
            encoder.clear_buffer(statistics, 0, None);
        }
        if let Hits::Bits(buffer) = &view.hits {
            encoder.clear_buffer(buffer, 0, None);
        }
        encoder.clear_buffer(&view.nearness, 0, None);
        self.receivers.record(
            device,
            encoder,
            &input.gbuffer,
            input.camera,
            cloud.origin(),
            &view.receivers,
        );
        let params = uniform(
            device,
            LABEL,
            &BouncedParams::new(settings, view.size(), cloud.capacity),
        );
        let camera = uniform(device, LABEL, &input.camera.params(cloud.origin()));
        let mut resources = vec![
            (0, whole(&params)),
            (1, whole(&cloud.counters)),
            (2, binding::view(nodes)),
            (4, binding::view(&view.receivers.view)),
            (9, whole(&view.nearness)),
            (11, whole(&camera)),
        ];
        resources.extend(primitives);
        match &view.hits {
            Hits::Bits(buffer) => resources.push((5, whole(buffer))),
            Hits::Colors(colors) => resources.push((5, binding::view(colors))),
        }
        resources
            .extend(radiance.map(|radiance| (6, binding::first(radiance, radiance_bytes(cloud)))));
        let lights = lighting.map(|lighting| {
            uniform(
                device,
                LABEL,
                &LightsParams::new(lighting.lights, cloud.origin),
            )
        });
        if let (Some(lighting), Some(lights)) = (&lighting, &lights) {
            resources.extend([
                (13, whole(lights)),
                (14, binding::table::<Material>(lighting.materials)),
            ]);
        }
        if let Some(statistics) = &view.statistics {
            resources.push((10, whole(statistics)));
        }
        let roughness = roughness.map(|slice| slice.read());
        resources.extend(
            roughness
                .as_ref()
                .map(|roughness| (12, binding::view(roughness))),
        );
        let group = binding::group(device, LABEL, &self.layout, &resources);
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);
        // Bits were cleared; a layer of colours cannot be, and without directions gets one that meets nothing.
        let layers = match view.hits {
            Hits::Bits(_) => settings.rays_per_pixel,
            Hits::Colors(_) => settings.rays_per_pixel.max(1),
        };
        if layers > 0 {
            let [width, height] = view.size();
            pass.set_pipeline(&self.trace);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), layers);
        }
        Ok(())
    }

    fn check_view(
        &self,
        size: [u32; 2],
        settings: &BouncedSettings,
        view: &BouncedView,
    ) -> Result<(), Error> {
        if view.size() != size
            || view.rays_per_pixel < settings.rays_per_pixel
            || view.descriptor != self.descriptor
        {
            return Err(Error::Mismatch {
                name: "BouncedView",
                found: format!(
                    "{:?} pixels, {} rays per pixel, {:?}",
                    view.size(),
                    view.rays_per_pixel,
                    view.descriptor
                ),
                needed: format!(
                    "{size:?} pixels, {} rays per pixel, {:?}",
                    settings.rays_per_pixel, self.descriptor
                ),
            });
        }
        Ok(())
    }

    fn check_lighting<'r>(
        &self,
        device: &Device,
        input: &BouncedInput<'r>,
        view: &BouncedView,
    ) -> Result<Option<HitLighting<'r>>, Error> {
        const LIGHTING: &str = "BouncedInput::lighting";
        const MATERIALS: &str = "HitLighting::materials";
        if !self.descriptor.lit() {
            return Ok(None);
        }
        let lighting = input.lighting.ok_or_else(|| Error::Mismatch {
            name: LIGHTING,
            found: "none".into(),
            needed: "lights and materials, for Lighting::Hits".into(),
        })?;
        binding::check_table::<Material>(device, MATERIALS, lighting.materials)?;
        binding::check_own(MATERIALS, lighting.materials, &view.statistics)?;
        for light in lighting.lights {
            light.validate()?;
        }
        let emitting = lighting.lights.iter().filter(|l| l.is_emitting()).count();
        check_setting(
            emitting <= MAX_LIGHTS,
            "HitLighting::lights",
            emitting as f64,
            "0 to 16 lights that shine",
        )?;
        Ok(Some(lighting))
    }

    fn check_radiance<'r>(
        &self,
        device: &Device,
        input: &BouncedInput<'r>,
        view: &BouncedView,
    ) -> Result<Option<&'r Buffer>, Error> {
        const RADIANCE: &str = "BouncedInput::radiance";
        if self.descriptor.payload == Payload::Occlusion || self.descriptor.lit() {
            return Ok(None);
        }
        check_setting(
            input.cloud.placement == Placement::Centroid
                || self.descriptor.primitives != Primitives::Triangles,
            "SurfelizerSettings::placement",
            f64::from(input.cloud.placement.code()),
            "Placement::Centroid, for radiance of pieces",
        )?;
        let needed = radiance_bytes(input.cloud);
        let buffer = input.radiance.ok_or_else(|| Error::Buffer {
            name: RADIANCE,
            found: "not been given".into(),
            needed: format!("usage STORAGE and at least {needed} bytes"),
        })?;
        binding::check_first(device, RADIANCE, buffer, needed)?;
        binding::check_own(RADIANCE, buffer, &view.statistics)?;
        Ok(Some(buffer))
    }
}

/// Words of bits per pixel.
pub(crate) fn words(rays_per_pixel: u32) -> u32 {
    rays_per_pixel.div_ceil(32)
}

fn store_colors() -> BindingType {
    binding::store(TextureFormat::R32Uint, TextureViewDimension::D2Array)
}

/// Assembles the module.
fn source(descriptor: &BouncedDescriptor) -> Result<String, Error> {
    shader::assemble("bounced_z_buffer", SOURCE, &descriptor.flags(), &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    for payload in [Payload::Occlusion, Payload::Radiance] {
        for primitives in [Primitives::Triangles, Primitives::Disks { levels: 1 }] {
            for sampling in [Sampling::Cosine, Sampling::Glossy] {
                for lighting in [Lighting::Surfels, Lighting::Hits] {
                    for statistics in [false, true] {
                        let descriptor = BouncedDescriptor {
                            payload,
                            primitives,
                            sampling,
                            lighting,
                            statistics,
                        };
                        let lit = lighting == Lighting::Hits;
                        let disks = primitives != Primitives::Triangles;
                        if lit && (disks || !descriptor.lit()) {
                            continue;
                        }
                        let name = name_of(
                            match payload {
                                Payload::Occlusion => "bounced_z_buffer occlusion",
                                Payload::Radiance => "bounced_z_buffer radiance",
                            },
                            &[
                                (lit, "lit"),
                                (disks, "disks"),
                                (sampling == Sampling::Glossy, "glossy"),
                                (statistics, "statistics"),
                            ],
                        );
                        all.add(&name, source(&descriptor)?);
                    }
                }
            }
        }
    }
    Ok(())
}

//! What each pixel sees along directions of its own (The Bounced Z-buffer 3, 4.2; `wgsl/bounced_z_buffer.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device, PipelineCache, ShaderStages,
};

use self::{
    params::BouncedParams,
    settings::{BouncedSettings, MAX_DIRECTIONS, Sampling},
};
use crate::{
    camera::Camera,
    error::{Error, check_setting},
    gbuffer::GBuffer,
    gpu::{
        Kernel, Timestamps,
        binding::{self, READ, UINT_2D, UNIFORM, WRITE, whole},
        check_timestamps, compute_pass, shader, storage, uniform,
    },
    receivers::{Receivers, ReceiversPass, plane_bytes},
    sender_bounds::{SenderBounds, SenderBoundsPass},
    surfel::SurfelCloud,
};

pub(crate) const SOURCE: &str = include_str!("../../wgsl/bounced_z_buffer.wgsl");

const LABEL: &str = "deep-screen-space bounced z-buffer";

/// Finds what each pixel sees along its own directions. Holds pipelines only; one serves any number of views.
#[derive(Debug)]
pub struct BouncedZBuffer {
    descriptor: BouncedDescriptor,
    layout: wgpu::BindGroupLayout,
    trace: ComputePipeline,
    bounds: SenderBoundsPass,
    receivers: ReceiversPass,
}

/// What a [`BouncedZBuffer`] is compiled for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BouncedDescriptor {
    /// How directions are drawn.
    pub sampling: Sampling,
    /// Whether to count into [`BouncedView::statistics`]. Slower; for measuring.
    pub statistics: bool,
}

/// One view's receivers and hits.
#[derive(Debug)]
pub struct BouncedView {
    pub(crate) receivers: Receivers,
    pub(crate) hits: Buffer,
    directions: u32,
    statistics: Option<Buffer>,
}

impl BouncedView {
    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.receivers.size
    }

    /// How many directions it has room for.
    pub fn directions(&self) -> u32 {
        self.directions
    }

    /// The hits.
    pub fn hits(&self) -> &Buffer {
        &self.hits
    }

    /// What the last recording counted, where it was made to: four `u32`, namely rays, nodes and senders tested, and
    /// rays that hit (usage `COPY_SRC`).
    pub fn statistics(&self) -> Option<&Buffer> {
        self.statistics.as_ref()
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        plane_bytes(wgpu::TextureFormat::Rgba32Uint, self.size(), 1)
            + self.hits.size()
            + self.statistics.as_ref().map_or(0, Buffer::size)
    }
}

/// What one recording of the [`BouncedZBuffer`] works on.
#[derive(Clone, Copy, Debug)]
pub struct BouncedInput<'a> {
    /// The caller's G-buffer.
    pub gbuffer: GBuffer<'a>,
    /// The camera that the G-buffer was drawn with; it may be another than the cloud's.
    pub camera: &'a Camera,
    /// The senders.
    pub cloud: &'a SurfelCloud,
    /// Their bounds, recorded since the cloud was.
    pub bounds: &'a SenderBounds,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl BouncedZBuffer {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// None yet.
    pub fn new(
        device: &Device,
        descriptor: &BouncedDescriptor,
        cache: Option<&PipelineCache>,
    ) -> Result<Self, Error> {
        let mut entries = vec![
            (0, UNIFORM),
            (1, READ),
            (2, binding::FLOAT_2D),
            (3, binding::FLOAT_2D),
            (4, UINT_2D),
            (5, WRITE),
        ];
        entries.extend(descriptor.statistics.then_some((8, WRITE)));
        let layout = binding::layout(device, LABEL, ShaderStages::COMPUTE, &entries);
        let flags: &[&str] = if descriptor.statistics { &["STATISTICS"] } else { &[] };
        let module = shader::create(
            device,
            LABEL,
            shader::assemble("bounced_z_buffer", SOURCE, flags, &[])?,
        );
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
            bounds: SenderBoundsPass::new(device, cache)?,
            receivers: ReceiversPass::new(device, cache)?,
        })
    }

    /// Room for the bounds of a cloud's senders.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device cannot bind as much.
    pub fn create_bounds(&self, device: &Device, cloud: &SurfelCloud) -> Result<SenderBounds, Error> {
        self.bounds.create(device, cloud)
    }

    /// Room for a view.
    ///
    /// # Errors
    /// [`Error::Setting`] or [`Error::Limit`].
    pub fn create_view(
        &self,
        device: &Device,
        width: u32,
        height: u32,
        directions: u32,
    ) -> Result<BouncedView, Error> {
        check_setting(directions <= MAX_DIRECTIONS, "directions", directions, "0 to 64")?;
        let size = [width, height];
        let words = u64::from(directions.div_ceil(32));
        Ok(BouncedView {
            receivers: Receivers::new(device, size)?,
            hits: storage(
                device,
                "deep-screen-space hits",
                4 * words * u64::from(width) * u64::from(height),
                BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
            )?,
            directions,
            statistics: self
                .descriptor
                .statistics
                .then(|| {
                    storage(
                        device,
                        "deep-screen-space hit statistics",
                        16,
                        BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
                    )
                })
                .transpose()?,
        })
    }

    /// Records the bounds of a cloud's senders, after the recording that makes the cloud.
    ///
    /// # Errors
    /// [`Error::Mismatch`] where the bounds were made for another cloud's capacity.
    pub fn record_bounds(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        cloud: &SurfelCloud,
        bounds: &SenderBounds,
        timestamps: Option<Timestamps<'_>>,
    ) -> Result<(), Error> {
        check_timestamps(timestamps)?;
        self.bounds.record(device, encoder, cloud, bounds, timestamps);
        Ok(())
    }

    /// Records the tracing of a view's directions.
    ///
    /// # Errors
    /// What [`GBuffer::validate`] and [`BouncedSettings::validate`] find.
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
        encoder.clear_buffer(&view.hits, 0, None);
        if let Some(statistics) = &view.statistics {
            encoder.clear_buffer(statistics, 0, None);
        }
        self.receivers.record(
            device,
            encoder,
            &input.gbuffer,
            input.camera,
            input.cloud.origin(),
            &view.receivers,
        );
        let words = settings.directions.div_ceil(32);
        let params = uniform(
            device,
            LABEL,
            &BouncedParams::new(settings, view.size(), words, input.cloud.capacity),
        );
        let nv = input.bounds.node_texture.create_view(&Default::default());
        let lv = input.bounds.leaf_texture.create_view(&Default::default());
        let mut resources = vec![
            (0, whole(&params)),
            (1, whole(&input.cloud.counters)),
            (2, binding::view(&nv)),
            (3, binding::view(&lv)),
            (4, binding::view(&view.receivers.view)),
            (5, whole(&view.hits)),
        ];
        if let Some(statistics) = &view.statistics {
            resources.push((8, whole(statistics)));
        }
        let group = binding::group(device, LABEL, &self.layout, &resources);
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);
        if settings.directions > 0 {
            pass.set_pipeline(&self.trace);
            pass.set_bind_group(0, &group, &[]);
            let [w, h] = view.size();
            pass.dispatch_workgroups(w.div_ceil(8), h.div_ceil(8), settings.directions);
        }
        Ok(())
    }
}

//! Light gathered on a sparse hull of what is seen (Meder and Brüderlin, *Screen Space Approximate Gaussian Hulls*, 2018;
//! `wgsl/sg_hull*.wgsl`).

pub(crate) mod gatherer;
pub(crate) mod params;
pub(crate) mod settings;
pub(crate) mod surfels;

use glam::DVec3;
use wgpu::{
    BindGroup, BindGroupLayout, BindingType, Buffer, BufferUsages, CommandEncoder, ComputePipeline,
    Device, PipelineCache, RenderPipeline, ShaderStages, TextureFormat, TextureUsages, TextureView,
};

pub use self::params::{HullSegment, HullVertex, SgHullCounts};
use self::{
    gatherer::Gatherer,
    params::SgHullParams,
    settings::{Components, SgHullSettings, SgHullSize},
};
use crate::{
    camera::Camera,
    error::Error,
    gbuffer::{GBuffer, check_plain},
    gpu::{
        Kernel, Timestamps,
        binding::{self, FLOAT_2D, READ, UINT_2D, UNIFORM, WRITE, view, whole},
        check_timestamps, first_pass, screen, shader, storage, uniform,
    },
    receivers::{Receivers, ReceiversPass, plane_bytes},
};

const LABEL: &str = "deep-screen-space hull";

/// Segments what is seen, gathers light at the corners of the segments' rectangles and integrates it at every pixel.
///
/// The cost of a [`Gatherer`] is paid at some thousand vertices whatever the resolution, and each pixel's own normal still
/// shades it. Light has to vary little over 1/32 of the picture, and to be told by one lobe a colour channel; shadows
/// finer than that, and glossy reflections, are not for it.
///
/// Holds pipelines only, for one gatherer and one target format; one serves any number of views.
#[derive(Debug)]
pub struct SgHull {
    target: TextureFormat,
    albedo: bool,
    bound: bool,
    segment_layout: BindGroupLayout,
    plan_layout: BindGroupLayout,
    gather_layout: BindGroupLayout,
    shade_layout: BindGroupLayout,
    exact_layout: BindGroupLayout,
    receivers: ReceiversPass,
    segment: ComputePipeline,
    plan: ComputePipeline,
    gather: ComputePipeline,
    shade: RenderPipeline,
    clear_sky: RenderPipeline,
    exact: RenderPipeline,
}

/// What a [`SgHull`] is compiled for.
#[derive(Clone, Copy, Debug)]
pub struct SgHullDescriptor<'a> {
    /// Where light comes from.
    pub gatherer: &'a Gatherer,
    /// Format of the caller's texture: any colour format of floats that can be rendered to.
    pub target: TextureFormat,
    /// Whether the picture is multiplied by the G-buffer's albedo; it is 1 otherwise.
    pub albedo: bool,
    /// How texels become segments.
    pub components: Components,
    /// The caller's cache, if any.
    pub cache: Option<&'a PipelineCache>,
}

/// The buffers of one view.
#[derive(Debug)]
pub struct SgHullView {
    size: SgHullSize,
    receivers: Receivers,
    segment_of: Buffer,
    segments: Buffer,
    vertices: Buffer,
    counts: Buffer,
}

impl SgHullView {
    /// What it was made for.
    pub fn size(&self) -> SgHullSize {
        self.size
    }

    /// One [`SgHullCounts`] (usage `COPY_SRC`).
    pub fn counts(&self) -> &Buffer {
        &self.counts
    }

    /// The segment of each pixel, a `u32` each, rows from the top; `0xffff_ffff` for the sky (usage `COPY_SRC`).
    pub fn segment_of(&self) -> &Buffer {
        &self.segment_of
    }

    /// The segments, [`HullSegment`]s of 32 bytes: first those counted as [`SgHullCounts::segments`], then, from
    /// [`SgHullSize::segments`] on, those of last resort (usage `COPY_SRC`).
    pub fn segments(&self) -> &Buffer {
        &self.segments
    }

    /// Four [`HullVertex`]es of 80 bytes a quad, without gaps (usage `COPY_SRC`).
    pub fn vertices(&self) -> &Buffer {
        &self.vertices
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        plane_bytes(TextureFormat::Rgba32Uint, self.receivers.size, 1)
            + self.segment_of.size()
            + self.segments.size()
            + self.vertices.size()
            + self.counts.size()
    }
}

/// What one recording of the [`SgHull`] works on.
#[derive(Clone, Copy, Debug)]
pub struct SgHullInput<'a> {
    /// The caller's G-buffer.
    pub gbuffer: GBuffer<'a>,
    /// Its camera.
    pub camera: &'a Camera,
    /// The point of the world that the gatherer's positions are relative to: the camera's eye, or one near it.
    pub origin: DVec3,
    /// What the gatherer's layout is for, where it has one.
    pub gather: Option<&'a BindGroup>,
    /// The caller's texture, of the format that the hull was made for, usage `RENDER_ATTACHMENT`, covering the camera's
    /// viewport. Only the viewport is written: reflected radiance, `albedo / π` times irradiance, W/(m² sr), and 1; black
    /// for the sky.
    pub target: &'a TextureView,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl SgHull {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// [`Error::Format`] for a target that cannot be rendered to or does not hold floats, [`Error::Effect`] where the
    /// gatherer's source has a malformed directive. WGSL that does not compile is wgpu's own validation error.
    pub fn new(device: &Device, descriptor: &SgHullDescriptor<'_>) -> Result<Self, Error> {
        let SgHullDescriptor {
            gatherer,
            target,
            albedo,
            components,
            cache,
        } = *descriptor;
        screen::check_format(device, "SgHull target", target)?;
        let (compute, fragment) = (ShaderStages::COMPUTE, ShaderStages::FRAGMENT);
        let drawing = ShaderStages::VERTEX_FRAGMENT;
        let with_albedo = |mut entries: Vec<(u32, BindingType)>| {
            entries.extend(albedo.then_some((6, FLOAT_2D)));
            entries
        };
        let shared = [(0, UNIFORM), (1, UINT_2D)];
        let layout = |stages, entries: &[(u32, BindingType)]| {
            binding::layout(device, LABEL, stages, entries)
        };
        let list = |entries: &[(u32, BindingType)]| [&shared[..], entries].concat();
        let segment_layout = layout(compute, &list(&[(2, WRITE), (3, WRITE), (4, WRITE)]));
        let plan_layout = layout(compute, &[(0, UNIFORM), (1, WRITE)]);
        let read = [(2, READ), (3, READ), (4, READ)];
        let gather_layout = layout(compute, &[&list(&read)[..], &[(5, WRITE)]].concat());
        let shade_layout = layout(
            drawing,
            &with_albedo([&list(&read)[..], &[(5, READ)]].concat()),
        );
        let exact_layout = layout(fragment, &with_albedo(shared.to_vec()));

        let module = |stage| -> Result<_, Error> {
            Ok(shader::create(
                device,
                LABEL,
                source(&gatherer.source, stage, albedo)?,
            ))
        };
        let constants: Vec<(&str, f64)> = gatherer
            .constants
            .iter()
            .map(|(k, v)| (k.as_str(), *v))
            .collect();
        let kernel = |stage, entry, layouts: &[&BindGroupLayout], constants: &[(&str, f64)]| {
            Ok::<_, Error>(
                Kernel {
                    label: LABEL,
                    module: &module(stage)?,
                    entry,
                    layouts,
                    constants,
                    cache,
                }
                .create(device),
            )
        };
        let propagate = f64::from(u8::from(components == Components::Propagation));
        let gather_layouts: Vec<_> = [&gather_layout]
            .into_iter()
            .chain(&gatherer.layout)
            .collect();
        let exact_layouts: Vec<_> = [&exact_layout]
            .into_iter()
            .chain(&gatherer.layout)
            .collect();
        let draw = |module: &wgpu::ShaderModule,
                    [vertex, fragment]: [&str; 2],
                    layouts: &[&BindGroupLayout],
                    constants: &[(&str, f64)]| {
            screen::Drawing {
                label: LABEL,
                module,
                vertex,
                fragment,
                layouts,
                constants,
                topology: wgpu::PrimitiveTopology::TriangleStrip,
                target,
                cache,
            }
            .create(device)
        };
        let shade_module = module(HullStage::Shade)?;
        Ok(Self {
            target,
            albedo,
            bound: gatherer.layout.is_some(),
            receivers: ReceiversPass::new(device, cache)?,
            segment: kernel(
                HullStage::Segment,
                "segment",
                &[&segment_layout],
                &[("PROPAGATE", propagate)],
            )?,
            plan: kernel(HullStage::Plan, "plan", &[&plan_layout], &[])?,
            gather: kernel(
                HullStage::Gather,
                "gather_vertices",
                &gather_layouts,
                &constants,
            )?,
            shade: draw(&shade_module, ["corner", "shade"], &[&shade_layout], &[]),
            clear_sky: draw(&shade_module, ["cover", "clear_sky"], &[&shade_layout], &[]),
            exact: draw(
                &module(HullStage::Exact)?,
                ["cover", "exact"],
                &exact_layouts,
                &constants,
            ),
            segment_layout,
            plan_layout,
            gather_layout,
            shade_layout,
            exact_layout,
        })
    }

    /// Buffers for a view.
    ///
    /// # Errors
    /// [`Error::Setting`] for a size out of range, [`Error::Limit`] for one beyond the device's.
    pub fn create_view(&self, device: &Device, size: SgHullSize) -> Result<SgHullView, Error> {
        size.validate()?;
        let capacity = u64::from(size.capacity());
        let buffer =
            |label, bytes, usage| storage(device, label, bytes, usage | BufferUsages::COPY_SRC);
        let none = BufferUsages::empty();
        Ok(SgHullView {
            size,
            receivers: Receivers::new(device, [size.width, size.height])?,
            segment_of: buffer(
                "deep-screen-space hull pixels",
                4 * u64::from(size.width) * u64::from(size.height),
                none,
            )?,
            segments: buffer(
                "deep-screen-space hull segments",
                capacity * size_of::<HullSegment>() as u64,
                none,
            )?,
            vertices: buffer(
                "deep-screen-space hull vertices",
                4 * capacity * size_of::<HullVertex>() as u64,
                none,
            )?,
            counts: buffer(
                "deep-screen-space hull counts",
                size_of::<SgHullCounts>() as u64,
                BufferUsages::INDIRECT | BufferUsages::COPY_DST,
            )?,
        })
    }

    /// Records the hull and the picture.
    ///
    /// # Errors
    /// What [`GBuffer::validate`] and [`SgHullSettings::validate`] find; [`Error::Format`], [`Error::Size`] or
    /// [`Error::Usage`] for the target; [`Error::Mismatch`] where the view has another size than the camera's viewport,
    /// and where albedo or what the gatherer binds is missing.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SgHullInput<'_>,
        settings: &SgHullSettings,
        hull: &SgHullView,
    ) -> Result<(), Error> {
        settings.validate()?;
        let params = self.prepare(device, encoder, input, settings, hull)?;
        encoder.clear_buffer(&hull.counts, 0, None);
        let shared = [(0, whole(&params)), (1, view(&hull.receivers.view))];
        let group = |layout, entries: &[_]| {
            binding::group(device, LABEL, layout, &[&shared[..], entries].concat())
        };
        let buffers = [
            (2, whole(&hull.segment_of)),
            (3, whole(&hull.segments)),
            (4, whole(&hull.counts)),
        ];
        let segment = group(&self.segment_layout, &buffers);
        let plan = binding::group(
            device,
            LABEL,
            &self.plan_layout,
            &[(0, whole(&params)), (1, whole(&hull.counts))],
        );
        let vertices = [&buffers[..], &[(5, whole(&hull.vertices))]].concat();
        let gather = group(&self.gather_layout, &vertices);
        let [columns, rows] = hull.size.tiles();
        let mut pass = first_pass(encoder, LABEL, input.timestamps);
        pass.set_pipeline(&self.segment);
        pass.set_bind_group(0, &segment, &[]);
        pass.dispatch_workgroups(columns, rows, 1);
        pass.set_pipeline(&self.plan);
        pass.set_bind_group(0, &plan, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        pass.set_pipeline(&self.gather);
        pass.set_bind_group(0, &gather, &[]);
        if let Some(group) = input.gather {
            pass.set_bind_group(1, group, &[]);
        }
        pass.dispatch_workgroups_indirect(
            &hull.counts,
            std::mem::offset_of!(SgHullCounts, dispatch) as u64,
        );
        drop(pass);

        let mut resources = vertices;
        resources.extend(self.albedo_of(input).map(|albedo| (6, view(albedo))));
        let shade = group(&self.shade_layout, &resources);
        let mut pass = screen::begin(
            encoder,
            LABEL,
            input.target,
            input.camera.viewport(),
            input.timestamps,
            false,
        );
        pass.set_bind_group(0, &shade, &[]);
        pass.set_pipeline(&self.clear_sky);
        pass.draw(0..3, 0..1);
        pass.set_pipeline(&self.shade);
        pass.draw_indirect(
            &hull.counts,
            std::mem::offset_of!(SgHullCounts, draw) as u64,
        );
        Ok(())
    }

    /// Records the picture with the light gathered at every pixel: what the hull approximates, at the cost that it saves.
    ///
    /// # Errors
    /// As [`SgHull::record`].
    pub fn record_exact(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SgHullInput<'_>,
        hull: &SgHullView,
    ) -> Result<(), Error> {
        let params = self.prepare(device, encoder, input, &SgHullSettings::default(), hull)?;
        let mut resources = vec![(0, whole(&params)), (1, view(&hull.receivers.view))];
        resources.extend(self.albedo_of(input).map(|albedo| (6, view(albedo))));
        let group = binding::group(device, LABEL, &self.exact_layout, &resources);
        let mut pass = screen::begin(
            encoder,
            LABEL,
            input.target,
            input.camera.viewport(),
            input.timestamps,
            true,
        );
        pass.set_pipeline(&self.exact);
        pass.set_bind_group(0, &group, &[]);
        if let Some(group) = input.gather {
            pass.set_bind_group(1, group, &[]);
        }
        pass.draw(0..3, 0..1);
        Ok(())
    }

    fn albedo_of<'v>(&self, input: &SgHullInput<'v>) -> Option<&'v TextureView> {
        input.gbuffer.albedo.filter(|_| self.albedo)
    }

    /// Checks the input, records its receivers and makes the parameters.
    fn prepare(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SgHullInput<'_>,
        settings: &SgHullSettings,
        hull: &SgHullView,
    ) -> Result<Buffer, Error> {
        check_timestamps(input.timestamps)?;
        let viewport = input.camera.viewport();
        input.gbuffer.validate(viewport)?;
        check_plain(
            "SgHullInput::target",
            input.target,
            viewport,
            TextureUsages::RENDER_ATTACHMENT,
        )?;
        let mismatch = |name, found: String, needed: String| {
            Err(Error::Mismatch {
                name,
                found,
                needed,
            })
        };
        let format = input.target.texture().format();
        if format != self.target {
            return mismatch(
                "SgHull",
                format!("{:?}", self.target),
                format!("{format:?}"),
            );
        }
        if self.albedo && input.gbuffer.albedo.is_none() {
            return mismatch(
                "GBuffer",
                "no albedo".into(),
                "one, for SgHullDescriptor::albedo".into(),
            );
        }
        if self.bound != input.gather.is_some() {
            return mismatch(
                "SgHullInput::gather",
                if self.bound {
                    "nothing"
                } else {
                    "a bind group"
                }
                .into(),
                "what the gatherer's layout is for".into(),
            );
        }
        if hull.receivers.size != [viewport.width, viewport.height] {
            return mismatch(
                "SgHullView",
                format!("{:?} pixels", hull.receivers.size),
                format!("{:?} pixels", [viewport.width, viewport.height]),
            );
        }
        self.receivers.record(
            device,
            encoder,
            &input.gbuffer,
            input.camera,
            input.origin,
            &hull.receivers,
        );
        Ok(uniform(
            device,
            LABEL,
            &SgHullParams::new(settings, &hull.size, input.camera, input.origin),
        ))
    }
}

/// The modules that a hull is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum HullStage {
    Segment,
    Plan,
    Gather,
    Shade,
    Exact,
}

/// Assembles one of them.
pub(crate) fn source(gatherer: &str, stage: HullStage, albedo: bool) -> Result<String, Error> {
    let (name, text) = match stage {
        HullStage::Segment => (
            "sg_hull_segment",
            include_str!("../../wgsl/sg_hull_segment.wgsl"),
        ),
        HullStage::Plan => ("sg_hull_plan", include_str!("../../wgsl/sg_hull_plan.wgsl")),
        HullStage::Gather => (
            "sg_hull_gather",
            include_str!("../../wgsl/sg_hull_gather.wgsl"),
        ),
        HullStage::Shade => ("sg_hull", include_str!("../../wgsl/sg_hull.wgsl")),
        HullStage::Exact => (
            "sg_hull_exact",
            include_str!("../../wgsl/sg_hull_exact.wgsl"),
        ),
    };
    let flags: &[&str] = if albedo { &["ALBEDO"] } else { &[] };
    shader::assemble(name, text, flags, &[("gatherer", gatherer)])
}

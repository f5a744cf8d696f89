//! Light gathered on a sparse hull of what is seen (Meder and Brüderlin, *Screen Space Approximate Gaussian Hulls*, 2018;
//! `wgsl/sg_hull*.wgsl`).

pub(crate) mod bound;
pub(crate) mod gatherer;
pub(crate) mod modules;
pub(crate) mod params;
pub(crate) mod settings;
pub(crate) mod surfels;
pub(crate) mod view;

use std::borrow::Cow;

use glam::DVec3;
use wgpu::{
    BindGroup, BindGroupLayout, BindingType, Buffer, CommandEncoder, ComputePass, ComputePipeline,
    Device, PipelineCache, RenderPipeline, ShaderStages, TextureFormat, TextureView,
};

use self::{
    bound::{GathererBinding, check_origin},
    gatherer::Gatherer,
    modules::{HullStage, HullVariant, source},
    params::{SgHullCounts, SgHullParams},
    settings::{Components, SgHullSettings, SgHullSize},
    view::SgHullView,
};
use crate::{
    camera::Camera,
    error::Error,
    gbuffer::{GBuffer, check_roughness},
    gpu::{
        Kernel, Timestamps,
        binding::{self, FLOAT_2D, READ, UINT_2D, UNIFORM, WRITE, view, whole},
        check_timestamps, first_pass, screen, shader, uniform,
    },
    overrides::check_constants,
    receivers::ReceiversPass,
    texture_slice::{TextureSlice, check_apart},
};

const LABEL: &str = "deep-screen-space hull";

/// Segments what is seen, gathers light at the corners of the segments' rectangles and integrates it at every pixel.
///
/// The cost of a [`Gatherer`] is paid at some thousand vertices whatever the resolution, and each pixel's own normal still
/// shades it. Light has to vary little over a quad, and to be told by one lobe a colour channel where normals vary. Quads
/// where it is not so are found ([`SgHullSettings::misfit`]) and split, or light is gathered at each of their pixels: cost
/// grows with fine shadows, thin things and relief, rather than error. What is lit from more than 30° below the plane of its quad's
/// corners, and shows in none of them, is not found.
///
/// # Glossy surfaces
/// With [`SgHullDescriptor::glossy`] a pixel reflects a second, narrow lobe besides: that of a Trowbridge-Reitz (GGX) surface
/// of the pixel's roughness, as a spherical Gaussian about the mirrored view (Wang et al., *All-Frequency Rendering of
/// Dynamic, Spatially-Varying Reflectance*, 2009), times the light's lobe. Masking, shadowing, the cosine and Fresnel's factor
/// are those of the product's axis; Fresnel's is less where both lobes are wide. The light is taken to come from a hemisphere,
/// so that even light is not shown brighter than it is. It is one lobe a channel: a mirror shows one soft spot however many
/// lights there are, and no outline of any.
///
/// Against GGX integrated over the same light, root mean square of the right values, reflectance 0.04, seen from 0°, 30°, 60°
/// and 80°, the light's middle up to 50° off the mirrored view (`cargo test --test passes off_ggx -- --nocapture`):
///
/// | Light | Roughness 0.1 | 0.3 | 0.6 | 1 |
/// |---|---|---|---|---|
/// | a lobe itself, of sharpness 8 | 8 % | 11 % | 29 % | 30 % |
/// | even, 10° to either side | 23 % | 30 % | 66 % | 24 % |
/// | 30° | 50 % | 48 % | 46 % | 32 % |
/// | 60° | 35 % | 36 % | 31 % | 36 % |
/// | from everywhere | 2 % | 9 % | 22 % | 65 % |
///
/// Their sums are off by −17 to +20 %. What is off at a low roughness is the edge of a light that one lobe makes soft; at a
/// high one the Gaussian, which has not GGX's tails, and Fresnel's factor at grazing views. Directional light is
/// off by the Gaussian alone.
///
/// Quads are not judged by it, and not split but gathered at each pixel: where it varies within one, [`SgHullSettings::misfit`] finds what the diffuse light betrays.
/// That of 0 has light gathered at each pixel, for both lobes. At a roughness of 0.2 the picture of a colonnade is 3.5 % off
/// the one gathered at every pixel, and 1.0 % without gloss (`cargo run --example hull -- colonnade 320x240 --glossy 0.2`).
///
/// Holds pipelines only, for one gatherer and one target format; one serves any number of views.
#[derive(Debug)]
pub struct SgHull {
    target: TextureFormat,
    variant: HullVariant,
    /// The gatherer's.
    source: Cow<'static, str>,
    bound: bool,
    segment_layout: BindGroupLayout,
    plan_layout: BindGroupLayout,
    place_layout: BindGroupLayout,
    gather_layout: BindGroupLayout,
    judge_layout: BindGroupLayout,
    split: Option<SplitPipelines>,
    pixels_layout: BindGroupLayout,
    shade_layout: BindGroupLayout,
    exact_layout: BindGroupLayout,
    points_layout: BindGroupLayout,
    receivers: ReceiversPass,
    segment: ComputePipeline,
    plans: [ComputePipeline; 7],
    place: ComputePipeline,
    gather: ComputePipeline,
    mean: ComputePipeline,
    judge: ComputePipeline,
    list: ComputePipeline,
    pixels: ComputePipeline,
    shade: RenderPipeline,
    shade_flat: RenderPipeline,
    clear_sky: RenderPipeline,
    points: RenderPipeline,
    exact: RenderPipeline,
}

/// What splits quads that do not fit: without gloss, of which parts know nothing.
#[derive(Debug)]
struct SplitPipelines {
    layout: BindGroupLayout,
    gather_layout: BindGroupLayout,
    place: ComputePipeline,
    gather: ComputePipeline,
    divide: ComputePipeline,
    draw: RenderPipeline,
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
    /// Whether surfaces are glossy besides: adds what the lobe of [`SgHullInput::roughness`] reflects. Off, nothing is bound
    /// or computed for it.
    pub glossy: bool,
    /// How texels become segments.
    pub components: Components,
    /// The caller's cache, if any.
    pub cache: Option<&'a PipelineCache>,
}

/// What one recording of the [`SgHull`] works on.
#[derive(Clone, Copy, Debug)]
pub struct SgHullInput<'a> {
    /// The caller's G-buffer.
    pub gbuffer: GBuffer<'a>,
    /// Its camera.
    pub camera: &'a Camera,
    /// The point of the world that the gatherer's positions are relative to: the camera's [focus](Camera::focus), its eye
    /// where that is near, or a point near either.
    pub origin: DVec3,
    /// What the gatherer bound, where it has a layout.
    pub gather: Option<&'a GathererBinding>,
    /// With [`SgHullDescriptor::glossy`] the G-buffer's roughness, as
    /// [`BouncedInput::roughness`](crate::BouncedInput::roughness). Not read otherwise.
    pub roughness: Option<TextureSlice<'a>>,
    /// The caller's texture, of the format that the hull was made for, usage `RENDER_ATTACHMENT`, covering the camera's
    /// viewport. Only the viewport is written: reflected radiance, `albedo / π` times irradiance and what a glossy
    /// surface adds, W/(m² sr), and 1; black for the sky.
    pub target: TextureSlice<'a>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl SgHull {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// [`Error::Format`] for a target that cannot be rendered to or does not hold floats, [`Error::Effect`] where the
    /// gatherer's source has a malformed directive or not the constants that are given. WGSL that does not compile is wgpu's own validation error.
    pub fn new(device: &Device, descriptor: &SgHullDescriptor<'_>) -> Result<Self, Error> {
        let SgHullDescriptor {
            gatherer,
            target,
            albedo,
            glossy,
            components,
            cache,
        } = *descriptor;
        check_constants(&gatherer.label, &gatherer.source, &gatherer.constants)?;
        let variant = HullVariant { albedo, glossy };
        screen::check_format(device, "SgHull target", target)?;
        let (compute, fragment) = (ShaderStages::COMPUTE, ShaderStages::FRAGMENT);
        let drawing = ShaderStages::VERTEX_FRAGMENT;
        // What a surface reflects depends on.
        let with_surface = |mut entries: Vec<(u32, BindingType)>| {
            entries.extend(albedo.then_some((6, FLOAT_2D)));
            entries.extend(glossy.then_some((7, FLOAT_2D)));
            entries
        };
        let shared = [(0, UNIFORM), (1, UINT_2D)];
        let layout = |stages, entries: &[(u32, BindingType)]| {
            binding::layout(device, LABEL, stages, entries)
        };
        let list = |entries: &[(u32, BindingType)]| [&shared[..], entries].concat();
        let segment_layout = layout(
            compute,
            &list(&[(2, WRITE), (3, WRITE), (4, WRITE), (5, WRITE)]),
        );
        let plan_layout = layout(compute, &[(0, UNIFORM), (1, WRITE), (2, WRITE)]);
        let read = [(2, READ), (3, READ), (4, READ)];
        let place_layout = layout(
            compute,
            &list(&[(2, READ), (3, READ), (4, WRITE), (5, WRITE), (6, WRITE)]),
        );
        let gather_layout = layout(compute, &[(0, UNIFORM), (1, READ), (2, READ), (3, WRITE)]);
        let judge_layout = layout(
            compute,
            &[
                (0, UNIFORM),
                (2, READ),
                (3, READ),
                (4, WRITE),
                (5, WRITE),
                (6, READ),
                (7, WRITE),
                (8, WRITE),
                (9, WRITE),
            ],
        );
        let mut shading = with_surface([&list(&read)[..], &[(5, READ)]].concat());
        shading.extend((!glossy).then_some((8, READ)));
        let shade_layout = layout(drawing, &shading);
        let exact_layout = layout(fragment, &with_surface(shared.to_vec()));
        // Points are drawn with irradiance, or with what is reflected where that is more than albedo times irradiance.
        let mut pixels = list(&[(2, READ), (3, WRITE)]);
        let mut points = vec![(0, UNIFORM), (4, READ)];
        if glossy {
            pixels = with_surface(pixels);
        } else {
            points = with_surface(points);
        }
        let pixels_layout = layout(compute, &pixels);
        let points_layout = layout(drawing, &points);

        let module = |stage| -> Result<_, Error> {
            Ok(shader::create(
                device,
                LABEL,
                source(&gatherer.source, stage, variant)?,
            ))
        };
        let constants: Vec<(&str, f64)> = gatherer
            .constants
            .iter()
            .map(|(k, v)| (k.as_str(), *v))
            .collect();
        let kernel = |module: &wgpu::ShaderModule,
                      entry,
                      layouts: &[&BindGroupLayout],
                      constants: &[(&str, f64)]| {
            Kernel {
                label: LABEL,
                module,
                entry,
                layouts,
                constants,
                cache,
            }
            .create(device)
        };
        let propagate = f64::from(u8::from(components == Components::Propagation));
        let draw = |module: &wgpu::ShaderModule,
                    [vertex, fragment]: [&str; 2],
                    topology,
                    layouts: &[&BindGroupLayout],
                    constants: &[(&str, f64)]| {
            screen::Drawing {
                label: LABEL,
                module,
                vertex,
                fragment,
                layouts,
                constants,
                topology,
                target,
                cache,
            }
            .create(device)
        };
        let shade_module = module(HullStage::Shade)?;
        let gather_module = module(HullStage::Gather)?;
        let plan_module = module(HullStage::Plan)?;
        let judge_module = module(HullStage::Judge)?;
        let exact_module = module(HullStage::Exact)?;
        let (strip, triangles, points) = (
            wgpu::PrimitiveTopology::TriangleStrip,
            wgpu::PrimitiveTopology::TriangleList,
            wgpu::PrimitiveTopology::PointList,
        );
        let split = if glossy {
            None
        } else {
            let module = module(HullStage::Split)?;
            let layout = layout(
                compute,
                &list(&[
                    (2, READ),
                    (3, READ),
                    (4, WRITE),
                    (5, WRITE),
                    (6, WRITE),
                    (7, WRITE),
                ]),
            );
            let gather_layout = binding::layout(
                device,
                LABEL,
                compute,
                &[(0, UNIFORM), (1, READ), (4, WRITE)],
            );
            Some(SplitPipelines {
                place: kernel(&module, "place_points", &[&layout], &[]),
                gather: kernel(
                    &gather_module,
                    "gather_points",
                    &with_gatherer(gatherer, &gather_layout),
                    &constants,
                ),
                divide: kernel(&module, "divide", &[&layout], &[]),
                draw: draw(
                    &shade_module,
                    ["part_corner", "shade_flat"],
                    strip,
                    &[&shade_layout],
                    &[],
                ),
                layout,
                gather_layout,
            })
        };
        let judging = |entry| kernel(&judge_module, entry, &[&judge_layout], &[]);
        Ok(Self {
            target,
            variant,
            source: gatherer.source.clone(),
            bound: gatherer.layout.is_some(),
            receivers: ReceiversPass::new(device, cache)?,
            segment: kernel(
                &module(HullStage::Segment)?,
                "segment",
                &[&segment_layout],
                &[("PROPAGATE", propagate)],
            ),
            plans: Plan::ALL.map(|plan| kernel(&plan_module, plan.entry(), &[&plan_layout], &[])),
            place: kernel(
                &module(HullStage::Place)?,
                "place_vertices",
                &[&place_layout],
                &[],
            ),
            gather: kernel(
                &gather_module,
                "gather_vertices",
                &with_gatherer(gatherer, &gather_layout),
                &constants,
            ),
            mean: judging("mean"),
            judge: judging("judge"),
            list: judging("list_pixels"),
            pixels: kernel(
                &exact_module,
                "gather_pixels",
                &with_gatherer(gatherer, &pixels_layout),
                &constants,
            ),
            shade: draw(
                &shade_module,
                ["corner", "shade"],
                strip,
                &[&shade_layout],
                &[],
            ),
            shade_flat: draw(
                &shade_module,
                ["flat_corner", "shade_flat"],
                strip,
                &[&shade_layout],
                &[],
            ),
            clear_sky: draw(
                &shade_module,
                ["cover", "clear_sky"],
                triangles,
                &[&shade_layout],
                &[],
            ),
            points: draw(
                &exact_module,
                ["point", "draw_point"],
                points,
                &[&points_layout],
                &[],
            ),
            exact: draw(
                &exact_module,
                ["cover", "exact"],
                triangles,
                &with_gatherer(gatherer, &exact_layout),
                &constants,
            ),
            segment_layout,
            plan_layout,
            place_layout,
            gather_layout,
            judge_layout,
            split,
            pixels_layout,
            shade_layout,
            exact_layout,
            points_layout,
        })
    }

    /// Buffers for a view.
    ///
    /// # Errors
    /// [`Error::Setting`] for a size out of range, [`Error::Limit`] for one beyond the device's.
    pub fn create_view(&self, device: &Device, size: SgHullSize) -> Result<SgHullView, Error> {
        SgHullView::new(device, size, self.split.is_some())
    }

    /// Records the hull and the picture.
    ///
    /// # Errors
    /// What [`GBuffer::validate`] and [`SgHullSettings::validate`] find; [`Error::Format`], [`Error::Size`] or
    /// [`Error::Usage`] for the target; [`Error::Mismatch`] where the view has another size than the camera's viewport,
    /// where albedo, roughness or what the gatherer binds is missing, and where that is another gatherer's or for another
    /// origin; [`Error::Recording`] for surfels of a cloud that was recorded since, and for a map that was not recorded;
    /// [`Error::Setting`] for an origin out of range; [`Error::Format`], [`Error::Size`] or
    /// [`Error::Usage`] for roughness.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SgHullInput<'_>,
        settings: &SgHullSettings,
        hull: &SgHullView,
    ) -> Result<(), Error> {
        let (params, surface) = self.prepare(device, encoder, input, settings, hull)?;
        let surface: Vec<_> = surface.iter().map(|(at, v)| (*at, view(v))).collect();
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
        let segment = group(
            &self.segment_layout,
            &[&buffers[..], &[(5, whole(&hull.others))]].concat(),
        );
        let plan_group = binding::group(
            device,
            LABEL,
            &self.plan_layout,
            &[
                (0, whole(&params)),
                (1, whole(&hull.counts)),
                (2, whole(&hull.dispatch)),
            ],
        );
        let vertices = [&buffers[..], &[(5, whole(&hull.vertices))]].concat();
        let place = group(
            &self.place_layout,
            &[&vertices[..], &[(6, whole(&hull.list))]].concat(),
        );
        let alone = |layout, entries: &[_]| binding::group(device, LABEL, layout, entries);
        let gather = alone(
            &self.gather_layout,
            &[
                (0, whole(&params)),
                (1, whole(&hull.counts)),
                (2, whole(&hull.list)),
                (3, whole(&hull.vertices)),
            ],
        );
        let listed = [
            (6, whole(&hull.list)),
            (7, whole(&hull.misfits)),
            (8, whole(&hull.exact)),
            (9, whole(&hull.splits)),
        ];
        let judge = alone(
            &self.judge_layout,
            &[&[(0, whole(&params))], &vertices[..], &listed].concat(),
        );
        let mut pixels = vec![(2, whole(&hull.counts)), (3, whole(&hull.exact))];
        let mut points = vec![(0, whole(&params)), (4, whole(&hull.exact))];
        if self.variant.glossy {
            pixels.extend(surface.clone());
        } else {
            points.extend(surface.clone());
        }
        let pixels = group(&self.pixels_layout, &pixels);
        let [columns, rows] = hull.size.tiles();
        let mut pass = first_pass(encoder, LABEL, input.timestamps);
        pass.set_pipeline(&self.segment);
        pass.set_bind_group(0, &segment, &[]);
        pass.dispatch_workgroups(columns, rows, 1);
        let run =
            |pass: &mut ComputePass<'_>, plan: Plan, kernels: &[(&ComputePipeline, &BindGroup)]| {
                pass.set_pipeline(&self.plans[plan as usize]);
                pass.set_bind_group(0, &plan_group, &[]);
                pass.dispatch_workgroups(1, 1, 1);
                for (kernel, group) in kernels {
                    pass.set_pipeline(kernel);
                    pass.set_bind_group(0, *group, &[]);
                    if let Some(lights) = input.gather {
                        pass.set_bind_group(1, &lights.group, &[]);
                    }
                    pass.dispatch_workgroups_indirect(&hull.dispatch, 0);
                }
            };
        // Where no quad can be split there is nothing to do.
        let split = self.split.as_ref();
        let split = split.filter(|_| hull.size.splits > 0 && settings.misfit > 0.0);
        run(&mut pass, Plan::Vertices, &[(&self.place, &place)]);
        run(&mut pass, Plan::Gather, &[(&self.gather, &gather)]);
        pass.set_pipeline(&self.mean);
        pass.set_bind_group(0, &judge, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        run(&mut pass, Plan::Judge, &[(&self.judge, &judge)]);
        if let Some(split) = split {
            let points = group(
                &split.layout,
                &[
                    &buffers[..],
                    &[
                        (5, whole(&hull.splits)),
                        (6, whole(&hull.parts)),
                        (7, whole(&hull.misfits)),
                    ],
                ]
                .concat(),
            );
            let light = alone(
                &split.gather_layout,
                &[
                    (0, whole(&params)),
                    (1, whole(&hull.counts)),
                    (4, whole(&hull.splits)),
                ],
            );
            for _ in 0..split_rounds(settings, &hull.size) {
                run(
                    &mut pass,
                    Plan::Points,
                    &[(&split.place, &points), (&split.gather, &light)],
                );
                run(&mut pass, Plan::Divide, &[(&split.divide, &points)]);
            }
            // The parts that the last round found.
            run(&mut pass, Plan::Points, &[]);
        }
        run(&mut pass, Plan::List, &[(&self.list, &judge)]);
        run(&mut pass, Plan::Pixels, &[(&self.pixels, &pixels)]);
        drop(pass);

        let parts = self.split.as_ref().map(|_| (8, whole(&hull.parts)));
        let shade = group(
            &self.shade_layout,
            &[vertices, surface, parts.into_iter().collect()].concat(),
        );
        let points = alone(&self.points_layout, &points);
        let mut pass = screen::begin(
            encoder,
            LABEL,
            &input.target,
            input.camera.viewport(),
            input.timestamps,
            false,
        );
        pass.set_bind_group(0, &shade, &[]);
        pass.set_pipeline(&self.clear_sky);
        pass.draw(0..3, 0..1);
        for pipeline in [&self.shade, &self.shade_flat] {
            pass.set_pipeline(pipeline);
            pass.draw_indirect(
                &hull.counts,
                std::mem::offset_of!(SgHullCounts, draw) as u64,
            );
        }
        if let Some(split) = split {
            pass.set_pipeline(&split.draw);
            pass.draw_indirect(
                &hull.counts,
                std::mem::offset_of!(SgHullCounts, parts) as u64,
            );
        }
        pass.set_bind_group(0, &points, &[]);
        pass.set_pipeline(&self.points);
        pass.draw_indirect(
            &hull.counts,
            std::mem::offset_of!(SgHullCounts, points) as u64,
        );
        Ok(())
    }

    /// Records the picture with the light gathered at every pixel: what the hull approximates, at the cost that it saves. Of the settings
    /// only [`SgHullSettings::f0`] matters.
    ///
    /// # Errors
    /// As [`SgHull::record`].
    pub fn record_exact(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SgHullInput<'_>,
        settings: &SgHullSettings,
        hull: &SgHullView,
    ) -> Result<(), Error> {
        let (params, surface) = self.prepare(device, encoder, input, settings, hull)?;
        let surface: Vec<_> = surface.iter().map(|(at, v)| (*at, view(v))).collect();
        let mut resources = vec![(0, whole(&params)), (1, view(&hull.receivers.view))];
        resources.extend(surface);
        let group = binding::group(device, LABEL, &self.exact_layout, &resources);
        let mut pass = screen::begin(
            encoder,
            LABEL,
            &input.target,
            input.camera.viewport(),
            input.timestamps,
            true,
        );
        pass.set_pipeline(&self.exact);
        pass.set_bind_group(0, &group, &[]);
        if let Some(group) = input.gather {
            pass.set_bind_group(1, &group.group, &[]);
        }
        pass.draw(0..3, 0..1);
        Ok(())
    }

    /// Checks the input, records its receivers and makes the parameters, and what is bound of the surfaces' reflectance.
    fn prepare(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SgHullInput<'_>,
        settings: &SgHullSettings,
        hull: &SgHullView,
    ) -> Result<(Buffer, Vec<(u32, TextureView)>), Error> {
        const TARGET: &str = "SgHullInput::target";
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let viewport = input.camera.viewport();
        input.gbuffer.validate(viewport)?;
        screen::check_target(TARGET, &input.target, viewport, self.target)?;
        let mismatch = |name, found: String, needed: String| {
            Err(Error::Mismatch {
                name,
                found,
                needed,
            })
        };
        let HullVariant { albedo, glossy } = self.variant;
        if albedo && input.gbuffer.albedo.is_none() {
            return mismatch(
                "GBuffer",
                "no albedo".into(),
                "one, for SgHullDescriptor::albedo".into(),
            );
        }
        let roughness = check_roughness(
            "SgHullInput::roughness",
            input.roughness,
            glossy.then_some("SgHullDescriptor::glossy"),
            viewport,
        )?;
        let read = input.roughness.map(|r| ("SgHullInput::roughness", r, 1));
        check_apart(TARGET, &input.target, input.gbuffer.reads().chain(read))?;
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
        check_origin("SgHullInput::origin", input.origin)?;
        if let Some(gather) = input.gather {
            gather.check(&self.source, input.origin)?;
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
        let params = uniform(
            device,
            LABEL,
            &SgHullParams::new(
                settings,
                &hull.size,
                input.camera,
                input.origin,
                if self.split.is_some() {
                    hull.size.splits
                } else {
                    0
                },
            ),
        );
        let albedo = input.gbuffer.albedo.filter(|_| albedo);
        let surface = [
            albedo.map(|slice| (6, slice.read())),
            roughness.map(|slice| (7, slice.read())),
        ];
        Ok((params, surface.into_iter().flatten().collect()))
    }
}

/// The layouts of a pipeline that gathers.
fn with_gatherer<'a>(
    gatherer: &'a Gatherer,
    layout: &'a BindGroupLayout,
) -> Vec<&'a BindGroupLayout> {
    [layout].into_iter().chain(&gatherer.layout).collect()
}

/// Rounds until no part of a quad is wide enough to be split.
fn split_rounds(settings: &SgHullSettings, size: &SgHullSize) -> u32 {
    const SPLIT_SIDE: u32 = 4;
    // Pixels of a texel beside a quad's own may be of its segment.
    let mut side = (settings.quad + 2) * size.texel();
    let mut rounds = 0;
    while side >= SPLIT_SIDE {
        side = side.div_ceil(2);
        rounds += 1;
    }
    rounds
}

/// The kernels of `wgsl/sg_hull_plan.wgsl`, by what they plan.
#[derive(Clone, Copy, Debug)]
enum Plan {
    Vertices,
    Gather,
    Judge,
    Points,
    Divide,
    List,
    Pixels,
}

impl Plan {
    const ALL: [Self; 7] = [
        Self::Vertices,
        Self::Gather,
        Self::Judge,
        Self::Points,
        Self::Divide,
        Self::List,
        Self::Pixels,
    ];

    fn entry(self) -> &'static str {
        match self {
            Self::Vertices => "plan_vertices",
            Self::Gather => "plan_gather",
            Self::Judge => "plan_judge",
            Self::Points => "plan_points",
            Self::Divide => "plan_divide",
            Self::List => "plan_list",
            Self::Pixels => "plan_pixels",
        }
    }
}

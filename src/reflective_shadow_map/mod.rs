//! What a light's own camera sees as lights (Dachsbacher and Stamminger, *Reflective Shadow Maps*, 2005;
//! `wgsl/reflective_shadow_map.wgsl`).

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use wgpu::{BufferUsages, CommandEncoder, ComputePipeline, Device};

use crate::{
    camera::CameraParams,
    effect::Listing,
    error::{Error, check_setting},
    gpu::compiler::Compiler,
    gpu::{
        Timestamps,
        binding::{Layout, view, whole},
        check_timestamps, compute_pass, shader, storage,
        uniforms::Uniforms,
    },
    light::{Light, LightParams},
    receivers::Frame,
    recorded::Last,
    sg_hull::{
        bound::GathererBinding,
        gatherer::{Gatherer, PolygonLight},
    },
};

const SOURCE: &str = include_str!("../../wgsl/reflective_shadow_map.wgsl");

const LABEL: &str = "deep-screen-space reflective shadow map";

/// Turns the G-buffer of a light's camera into [`PolygonLight`]s, one per texel: the first bounce of that light, for
/// [`Gatherer::bind_map`](crate::Gatherer::bind_map). 16 × 16 texels are a usual size.
#[derive(Debug)]
pub struct ReflectiveShadowMap {
    layout: Layout,
    kernel: ComputePipeline,
    uniforms: Uniforms,
}

/// The lights of one map.
#[derive(Debug)]
pub struct ReflectiveShadowMapView {
    size: [u32; 2],
    lights: wgpu::Buffer,
    /// The origin, shared with what a gatherer bound of it.
    pub(crate) recorded: Arc<Last<DVec3>>,
}

impl ReflectiveShadowMapView {
    /// A [`PolygonLight`] a texel, row by row (usages `STORAGE | COPY_SRC`).
    pub fn lights(&self) -> &wgpu::Buffer {
        &self.lights
    }
}

impl Gatherer {
    /// The lights of a reflective shadow map, as [`Gatherer::polygons`] binds them. One binding serves all recordings of the
    /// map.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for another gatherer.
    pub fn bind_map(
        &self,
        device: &Device,
        map: &ReflectiveShadowMapView,
    ) -> Result<GathererBinding, Error> {
        self.bind_recorded(device, map.lights(), &map.recorded)
    }
}

/// What one recording of the [`ReflectiveShadowMap`] works on.
#[derive(Clone, Copy, Debug)]
pub struct ReflectiveShadowMapInput<'a> {
    /// The view from the light, with albedo: its camera is where the light is for point and spot lights, along its direction for
    /// directional ones. Its origin is the point of the world that the lights' corners are relative to: that of the frame
    /// which the hull is recorded for.
    pub frame: &'a Frame<'a>,
    /// The light.
    pub light: Light,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

/// `Params` of `wgsl/reflective_shadow_map.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct ReflectiveShadowMapParams {
    pub(crate) camera: CameraParams,
    pub(crate) light: LightParams,
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: ReflectiveShadowMapParams as "Params" in ["reflective_shadow_map"]
    { camera, light }
);

impl<'a> ReflectiveShadowMapInput<'a> {
    /// Without timestamps.
    pub fn new(frame: &'a Frame<'a>, light: Light) -> Self {
        Self {
            frame,
            light,
            timestamps: None,
        }
    }
}

impl ReflectiveShadowMap {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// None today.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        let source = shader::assemble("reflective_shadow_map", SOURCE, &[], &[])?;
        let module = shader::create(device, LABEL, source);
        let (layout, kernel) = module.kernel(device, "texel_to_light", &[], cache);
        Ok(Self {
            layout,
            kernel,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Room for a map of `width` × `height` texels, 1 to 1024 per side.
    ///
    /// # Errors
    /// [`Error::Setting`] for a size out of range, [`Error::Limit`] for one beyond the device's.
    pub fn create_view(
        &self,
        device: &Device,
        width: u32,
        height: u32,
    ) -> Result<ReflectiveShadowMapView, Error> {
        for side in [width, height] {
            check_setting(
                (1..=1024).contains(&side),
                "reflective shadow map size",
                side,
                "1 to 1024",
            )?;
        }
        let bytes = u64::from(width) * u64::from(height) * size_of::<PolygonLight>() as u64;
        Ok(ReflectiveShadowMapView {
            size: [width, height],
            lights: storage(
                device,
                "deep-screen-space polygon lights",
                bytes,
                BufferUsages::COPY_SRC,
            )?,
            recorded: Arc::default(),
        })
    }

    /// Records the lights of a map.
    ///
    /// # Errors
    /// What [`Light::validate`] finds; [`Error::Mismatch`] without albedo, and where the view has
    /// another size than the frame.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &ReflectiveShadowMapInput<'_>,
        map: &ReflectiveShadowMapView,
    ) -> Result<(), Error> {
        check_timestamps(input.timestamps)?;
        input.light.validate()?;
        let frame = input.frame;
        let albedo = frame.gbuffer.albedo_for("what the map reflects")?;
        let viewport = frame.viewport();
        let size = [viewport.width, viewport.height];
        if map.size != size {
            return Err(Error::Mismatch {
                name: "ReflectiveShadowMapView",
                found: format!("{:?} texels", map.size),
                needed: format!("{size:?} texels"),
            });
        }
        map.recorded.set(frame.origin);
        let params = ReflectiveShadowMapParams {
            camera: frame.camera.params(frame.origin),
            light: LightParams::new(&input.light, frame.origin),
        };
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let albedo = albedo.read();
        let resources = [
            ("params", parameters.at(params)),
            ("receivers", view(&frame.receivers.view)),
            ("albedo_texture", view(&albedo)),
            ("lights", whole(&map.lights)),
        ];
        let group = self.layout.group(device, &resources);
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);
        pass.set_pipeline(&self.kernel);
        pass.set_bind_group(0, &group.raw, &group.offsets);
        pass.dispatch_workgroups(size[0].div_ceil(8), size[1].div_ceil(8), 1);
        Ok(())
    }
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add(
        "reflective_shadow_map",
        shader::assemble("reflective_shadow_map", SOURCE, &[], &[])?,
    );
    Ok(())
}

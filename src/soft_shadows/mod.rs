//! Soft shadows from a shadow map (Fernando, *Percentage-Closer Soft Shadows*, 2005; `wgsl/soft_shadows.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use wgpu::{CommandEncoder, Device, TextureFormat, TextureUsages};

use self::{params::SoftShadowsParams, settings::SoftShadowsSettings};
use crate::{
    camera::Camera,
    effect::Listing,
    error::Error,
    gbuffer::GBuffer,
    gpu::compiler::Compiler,
    gpu::{
        Timestamps,
        binding::view,
        check_timestamps, shader,
        uniforms::{Parameters, Uniforms},
    },
    light::Light,
    surfel_shader::{ShadowMap, params::ShadowParams},
    texture_slice::{TextureSlice, check_apart},
    work::{PixelList, WorkKernel, WorkKernelDescriptor, check_work},
};

const SOURCE: &str = include_str!("../../wgsl/soft_shadows.wgsl");

const LABEL: &str = "deep-screen-space soft shadows";

/// The share of a light with an extent that arrives at each pixel, 0…1, from the caller's shadow map: blockers are looked
/// for around the pixel, their mean distance gives the penumbra's width, and over that width the map is averaged.
///
/// Points are looked up [`ShadowMap::bias`] texels off their surface and as much nearer to the light: what lies nearer than
/// that to a surface does not shadow it, which inner edges, whose texels hold either surface, would otherwise do to themselves.
///
/// It is a picture of one depth: what a blocker hides of blockers behind it counts for nothing, and a penumbra of
/// several is that of their mean. The cosine of the light's direction and a spot's cone are not in it.
///
/// [`SoftShadowsSettings::samples`] are looked up for those pixels alone that something blocks the light of; the
/// invocations of a workgroup share them.
///
/// Holds pipelines only; one serves any number of views.
#[derive(Debug)]
pub struct SoftShadows {
    /// By whether shadows are hard, then by whether the light has one map alone.
    kernels: [[WorkKernel; 2]; 2],
    uniforms: Uniforms,
}

/// What one recording of [`SoftShadows`] works on.
#[derive(Clone, Copy, Debug)]
pub struct SoftShadowsInput<'a> {
    /// The G-buffer. Its albedo is not read.
    pub gbuffer: GBuffer<'a>,
    /// Its camera.
    pub camera: &'a Camera,
    /// The light. Its colour has no meaning here.
    pub light: &'a Light,
    /// Its shadow map, drawn from the light's middle: by perspective cameras at the light's position, or by orthographic
    /// ones along its direction.
    pub map: ShadowMap<'a>,
    /// The pixels to compute; `None` for all, at full resolution.
    pub work: Option<PixelList<'a>>,
    /// Where visibility goes, 1 for what is wholly lit and for the sky: a texture of the size of the work's level
    /// (`⌈size / 2^level⌉`) or larger, `R32Float`, usage `STORAGE_BINDING`. Pixels that are not listed are left as they
    /// are.
    pub target: TextureSlice<'a>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> SoftShadowsInput<'a> {
    /// At all pixels, without timestamps.
    pub fn new(
        gbuffer: GBuffer<'a>,
        camera: &'a Camera,
        light: &'a Light,
        map: ShadowMap<'a>,
        target: impl Into<TextureSlice<'a>>,
    ) -> Self {
        Self {
            gbuffer,
            camera,
            light,
            map,
            target: target.into(),
            work: None,
            timestamps: None,
        }
    }
}

impl SoftShadows {
    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// None that a device with these limits gives.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        let kernel = |entry, one_map: bool| {
            let descriptor = WorkKernelDescriptor {
                label: LABEL,
                entry,
                constants: &[("ONE_MAP", f64::from(u8::from(one_map)))],
                cache,
            };
            WorkKernel::new(device, &descriptor, source)
        };
        Ok(Self {
            kernels: [
                [kernel("soften", false)?, kernel("soften", true)?],
                [kernel("harden", false)?, kernel("harden", true)?],
            ],
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Records the shadows of a light.
    ///
    /// # Errors
    /// What [`GBuffer::validate`], [`SoftShadowsSettings::validate`], [`Light::validate`], [`ShadowMap::validate`] and
    /// [`PixelList::validate`] find; [`Error::Format`], [`Error::Size`], [`Error::Shape`] or [`Error::Usage`] for the target.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SoftShadowsInput<'_>,
        settings: &SoftShadowsSettings,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let viewport = input.camera.viewport();
        input.gbuffer.validate(viewport)?;
        input.light.validate()?;
        input.map.validate()?;
        let work = input.work.as_ref();
        let level = check_work(
            device,
            "SoftShadowsInput::target",
            work,
            viewport,
            &input.target,
            TextureFormat::R32Float,
        )?;
        let reads = input.gbuffer.reads().chain([input.map.reads()]);
        check_apart("SoftShadowsInput::target", &input.target, reads)?;
        let mut parameters = Parameters::new(device);
        let params = parameters.add(&SoftShadowsParams::new(input, settings, level));
        let shadow = parameters.add(&ShadowParams::new(&input.map, input.camera.focus()));
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let [depth, normal] = [input.gbuffer.depth, input.gbuffer.normal].map(|slice| slice.read());
        let map = input.map.view();
        let target = input.target.view(TextureUsages::STORAGE_BINDING);
        let resources = vec![
            ("params", parameters.at(params)),
            ("depth_texture", view(&depth)),
            ("normal_texture", view(&normal)),
            ("shadow", parameters.at(shadow)),
            ("depth_map", view(&map)),
            ("result", view(&target)),
        ];
        let is_hard = usize::from(settings.extent == 0.0);
        let has_one_map = usize::from(input.map.cameras.len() == 1);
        self.kernels[is_hard][has_one_map].record(
            device,
            encoder,
            resources,
            work,
            viewport,
            input.timestamps,
        );
        Ok(())
    }
}

/// Assembles a module: for all pixels, or for those of a list.
fn source(list: bool) -> Result<String, Error> {
    let flags: &[&str] = if list { &["LIST"] } else { &[] };
    shader::assemble("soft_shadows", SOURCE, flags, &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add("soft_shadows", source(false)?);
    all.add("soft_shadows list", source(true)?);
    Ok(())
}

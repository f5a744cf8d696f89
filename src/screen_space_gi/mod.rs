//! One bounce of light among what the image shows (Ritschel, Grosch and Seidel, *Approximating Dynamic Global Illumination in
//! Image Space*, 2009; `wgsl/screen_space_gi.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use wgpu::{CommandEncoder, Device, TextureFormat, TextureUsages};

use self::{params::ScreenSpaceGiParams, settings::ScreenSpaceGiSettings};
use crate::{
    camera::Camera,
    effect::Listing,
    error::Error,
    gbuffer::{GBuffer, samples_as_float},
    gpu::compiler::Compiler,
    gpu::{Timestamps, binding::view, check_timestamps, shader, uniforms::Uniforms},
    texture_slice::{TextureSlice, check_apart, check_slice},
    work::{PixelList, WorkKernel, WorkKernelDescriptor, check_work},
};

const SOURCE: &str = include_str!("../../wgsl/screen_space_gi.wgsl");

const LABEL: &str = "deep-screen-space screen-space gi";

/// Indirect light from a lit colour buffer: of points in the hemisphere over each pixel, those that the depth buffer hides
/// stand for a sender each, what is seen there, by its form factor.
///
/// It knows the image alone: what is hidden, off screen or edge-on sends nothing, nothing casts a shadow, and all senders
/// of a pixel share one area, which is a guess (3.2 of the paper). For what all surfaces send see
/// [`BouncedZBuffer`](crate::BouncedZBuffer).
///
/// Holds pipelines only; one serves any number of views.
#[derive(Debug)]
pub struct ScreenSpaceGi {
    kernel: WorkKernel,
    uniforms: Uniforms,
}

/// What one recording of [`ScreenSpaceGi`] works on.
#[derive(Clone, Copy, Debug)]
pub struct ScreenSpaceGiInput<'a> {
    /// The G-buffer. Its albedo is not read.
    pub gbuffer: GBuffer<'a>,
    /// Its camera.
    pub camera: &'a Camera,
    /// Radiance that leaves each pixel's surface, W/(m² sr), linear RGB: any float or unorm format with three components or
    /// more, usage `TEXTURE_BINDING`, covering the camera's viewport. What is not finite counts as 0.
    pub lit: TextureSlice<'a>,
    /// The pixels to compute; `None` for all, at full resolution.
    pub work: Option<PixelList<'a>>,
    /// Where irradiance / π goes, what a white surface sends back, 0 for the sky and alpha 1: a texture of the size of the
    /// work's level (`⌈size / 2^level⌉`) or larger, `Rgba16Float`, usage `STORAGE_BINDING`. Pixels that are not listed are
    /// left as they are.
    pub target: TextureSlice<'a>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> ScreenSpaceGiInput<'a> {
    /// At all pixels, without timestamps.
    pub fn new(
        gbuffer: GBuffer<'a>,
        camera: &'a Camera,
        lit: impl Into<TextureSlice<'a>>,
        target: impl Into<TextureSlice<'a>>,
    ) -> Self {
        Self {
            gbuffer,
            camera,
            lit: lit.into(),
            target: target.into(),
            work: None,
            timestamps: None,
        }
    }
}

impl ScreenSpaceGi {
    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// None that a device with these limits gives.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        let kernel = WorkKernelDescriptor {
            label: LABEL,
            entry: "bounce",
            constants: &[],
            cache,
        };
        Ok(Self {
            kernel: WorkKernel::new(device, &kernel, source)?,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Records the bounce.
    ///
    /// # Errors
    /// What [`GBuffer::validate`], [`ScreenSpaceGiSettings::validate`] and [`PixelList::validate`] find; [`Error::Format`],
    /// [`Error::Size`], [`Error::Shape`] or [`Error::Usage`] for the lit buffer and the target.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &ScreenSpaceGiInput<'_>,
        settings: &ScreenSpaceGiSettings,
    ) -> Result<(), Error> {
        const LIT: &str = "ScreenSpaceGiInput::lit";
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let viewport = input.camera.viewport();
        input.gbuffer.validate(viewport)?;
        check_slice(LIT, &input.lit, viewport, TextureUsages::TEXTURE_BINDING)?;
        let format = input.lit.view_format();
        if !samples_as_float(format) || format.components() < 3 {
            return Err(Error::Format {
                name: LIT,
                format,
                accepted: "a float or unorm format with three components or more",
            });
        }
        let work = input.work.as_ref();
        let level = check_work(
            device,
            "ScreenSpaceGiInput::target",
            work,
            viewport,
            &input.target,
            TextureFormat::Rgba16Float,
        )?;
        let lit = (LIT, input.lit, 1);
        let reads = input.gbuffer.reads().chain([lit]);
        check_apart("ScreenSpaceGiInput::target", &input.target, reads)?;
        let params = ScreenSpaceGiParams::new(input, settings, level);
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let [depth, normal, lit] =
            [input.gbuffer.depth, input.gbuffer.normal, input.lit].map(|slice| slice.read());
        let target = input.target.view(TextureUsages::STORAGE_BINDING);
        let resources = vec![
            ("params", parameters.at(params)),
            ("depth_texture", view(&depth)),
            ("normal_texture", view(&normal)),
            ("lit", view(&lit)),
            ("result", view(&target)),
        ];
        self.kernel
            .record(device, encoder, resources, work, viewport, input.timestamps);
        Ok(())
    }
}

/// Assembles a module: for all pixels, or for those of a list.
fn source(list: bool) -> Result<String, Error> {
    let flags: &[&str] = if list { &["LIST"] } else { &[] };
    shader::assemble("screen_space_gi", SOURCE, flags, &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add("screen_space_gi", source(false)?);
    all.add("screen_space_gi list", source(true)?);
    Ok(())
}

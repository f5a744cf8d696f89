//! Light gathered on a sparse hull of what is seen (Meder and Brüderlin, *Screen Space Approximate Gaussian Hulls*, 2018;
//! `wgsl/sg_hull*.wgsl`).

pub(crate) mod bound;
pub(crate) mod gatherer;
pub(crate) mod modules;
pub(crate) mod params;
mod per_pixel;
mod picture;
mod pipelines;
mod plan;
mod recording;
pub(crate) mod settings;
mod split;
mod stages;
pub(crate) mod surfels;
pub(crate) mod view;

use std::borrow::Cow;

use wgpu::{CommandEncoder, Device, TextureFormat};

use self::{
    bound::GathererBinding,
    gatherer::Gatherer,
    modules::{HullStage, HullVariant},
    per_pixel::PerPixel,
    picture::Picture,
    pipelines::Maker,
    plan::Plans,
    settings::{Components, SgHullSettings, SgHullSize},
    split::Splitter,
    stages::Stages,
    view::SgHullView,
};
use crate::{
    error::Error,
    gpu::compiler::Compiler,
    gpu::{Timestamps, first_pass, screen, uniforms::Uniforms},
    overrides::check_constants,
    receivers::Frame,
    texture_slice::TextureSlice,
};

const LABEL: &str = "deep-screen-space hull";

/// Segments what is seen, gathers light at the corners of the segments' rectangles and integrates it at every pixel.
///
/// The cost of a [`Gatherer`] is paid at some thousand vertices whatever the resolution, and each pixel's own normal still shades
/// it. Light has to vary little over a quad, and to be told by one lobe a colour channel where normals vary. Quads where it is
/// not so are found ([`SgHullSettings::error_threshold`]) and split, or light is gathered at each of their pixels: cost grows
/// with fine shadows, thin things and relief, rather than error. What is lit from more than 30° below the plane of its quad's
/// corners, and shows in none of them, is not found.
///
/// # Glossy surfaces
/// With [`SgHullDescriptor::glossy`] a pixel reflects a second, narrow lobe besides: that of a Trowbridge-Reitz (GGX) surface
/// of the pixel's roughness, as a spherical Gaussian about the mirrored view (Wang et al., *All-Frequency Rendering of
/// Dynamic, Spatially-Varying Reflectance*, 2009), times the light's lobe. Masking, shadowing, the cosine and Fresnel's factor
/// are those of the product's axis; Fresnel's is less where both lobes are wide. The light is taken to come from a hemisphere,
/// so that even light is not shown brighter than it is. It is one lobe per channel: a mirror shows one soft spot however many
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
/// Quads are not judged by it, and not split but gathered at each pixel: where it varies within one,
/// [`SgHullSettings::error_threshold`] finds what the diffuse light betrays. That of 0 has light gathered at each pixel, for both
/// lobes. At a roughness of 0.2 the picture of a colonnade is 3.5 % off the one gathered at every pixel, and 1.0 % without gloss
/// (`cargo run --example hull -- colonnade 320x240 --glossy 0.2`).
///
/// # Example
///
/// ```no_run
/// use deep_screen_space::*;
///
/// /// What a G-buffer's diffuse surfaces reflect of triangles that shine, without shadows, into an `Rgba16Float` texture.
/// fn light(
///     device: &wgpu::Device,
///     encoder: &mut wgpu::CommandEncoder,
///     (gbuffer, camera): (GBuffer<'_>, &Camera),
///     lamps: &wgpu::Buffer,
///     target: &wgpu::Texture,
/// ) -> Result<(), Error> {
///     // Once, and what is of the view's size once per view.
///     let gatherer = Gatherer::polygons(device);
///     let lights = gatherer.bind_polygons(device, lamps)?;
///     let descriptor = SgHullDescriptor {
///         gatherer: &gatherer,
///         target: wgpu::TextureFormat::Rgba16Float,
///         albedo: true,
///         glossy: false,
///         components: Components::default(),
///     };
///     let hull = SgHull::new(device, &descriptor)?;
///     let decoder = GBufferDecoder::new(device)?;
///     let Viewport { width, height, .. } = camera.viewport();
///     let view = hull.create_view(device, SgHullSize::new(width, height))?;
///     let mut receivers = decoder.create_receivers(device, width, height)?;
///
///     // Every frame. The lamps' corners are relative to the frame's origin.
///     let frame = FrameInput::new(gbuffer, camera);
///     let frame = decoder.record(device, encoder, &frame, &mut receivers)?;
///     let input = SgHullInput::new(&frame, Some(&lights), target);
///     hull.record(device, encoder, &input, &SgHullSettings::default(), &view)
/// }
/// ```
///
/// Holds pipelines only, for one gatherer and one target format; one serves any number of views.
#[derive(Debug)]
pub struct SgHull {
    target: TextureFormat,
    variant: HullVariant,
    /// The gatherer's.
    source: Cow<'static, str>,
    bound: bool,
    uniforms: Uniforms,
    plans: Plans,
    stages: Stages,
    /// Without gloss.
    splitter: Option<Splitter>,
    picture: Picture,
    per_pixel: PerPixel,
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
    /// Whether surfaces are glossy besides: adds what the lobe of [`GBuffer::roughness`](crate::GBuffer::roughness) reflects.
    /// Off, nothing is bound or computed for it.
    pub glossy: bool,
    /// How texels become segments.
    pub components: Components,
}

/// What one recording of the [`SgHull`] works on.
#[derive(Clone, Copy, Debug)]
pub struct SgHullInput<'a> {
    /// The pixels to shade. With [`SgHullDescriptor::glossy`] its G-buffer has roughness, and with
    /// [`SgHullDescriptor::albedo`] albedo. Its origin is that of what the gatherer bound.
    pub frame: &'a Frame<'a>,
    /// What the gatherer bound, where it has a layout.
    pub gather: Option<&'a GathererBinding>,
    /// The caller's texture, of the format that the hull was made for, usage `RENDER_ATTACHMENT`, covering the camera's
    /// viewport. Only the viewport is written: reflected radiance, `albedo / π` times irradiance and what a glossy
    /// surface adds, W/(m² sr), and 1; black for the sky.
    pub target: TextureSlice<'a>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> SgHullInput<'a> {
    /// With what a gatherer of its own layout bound, and without timestamps.
    pub fn new(
        frame: &'a Frame<'a>,
        gather: Option<&'a GathererBinding>,
        target: impl Into<TextureSlice<'a>>,
    ) -> Self {
        Self {
            frame,
            gather,
            target: target.into(),
            timestamps: None,
        }
    }
}

impl SgHull {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// [`Error::Format`] for a target that cannot be rendered to or does not hold floats, [`Error::Effect`] where the
    /// gatherer's source has a malformed directive or not the constants that are given. WGSL that does not compile is wgpu's
    /// own validation error.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        descriptor: &SgHullDescriptor<'_>,
    ) -> Result<Self, Error> {
        let compiler = compiler.into();
        let SgHullDescriptor {
            gatherer,
            target,
            glossy,
            ..
        } = *descriptor;
        check_constants(&gatherer.label, &gatherer.source, &gatherer.constants)?;
        screen::check_format(compiler.device, "SgHull target", target)?;
        let make = Maker::new(compiler, descriptor);
        let gather = make.module(HullStage::Gather)?;
        let splitter = (!glossy).then(|| Splitter::new(&make, &gather));
        Ok(Self {
            target,
            variant: make.variant,
            source: gatherer.source.clone(),
            bound: gatherer.layout.is_some(),
            uniforms: Uniforms::new(LABEL),
            plans: Plans::new(&make)?,
            stages: Stages::new(&make, &gather)?,
            splitter: splitter.transpose()?,
            picture: Picture::new(&make)?,
            per_pixel: PerPixel::new(&make)?,
        })
    }

    /// Buffers for a view.
    ///
    /// # Errors
    /// [`Error::Setting`] for a size out of range, [`Error::Limit`] for one beyond the device's.
    pub fn create_view(&self, device: &Device, size: SgHullSize) -> Result<SgHullView, Error> {
        SgHullView::new(device, size, self.splitter.is_some())
    }

    /// Records the hull and the picture.
    ///
    /// # Errors
    /// What [`SgHullSettings::validate`] finds; [`Error::Format`], [`Error::Size`] or [`Error::Usage`] for the target;
    /// [`Error::Mismatch`] where the view has another size than the frame, where albedo, roughness or what the gatherer binds is
    /// missing, and where that is another gatherer's or for another origin; [`Error::Recording`] for surfels of a cloud that was
    /// recorded since, and for a map that was not recorded.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SgHullInput<'_>,
        settings: &SgHullSettings,
        hull: &SgHullView,
    ) -> Result<(), Error> {
        let recording = self.prepare(device, encoder, input, settings, hull)?;
        encoder.clear_buffer(&hull.counts, 0, None);
        // Where no quad can be split there is nothing to do.
        let splitter = self.splitter.as_ref();
        let splitter = splitter.filter(|_| hull.size.splits > 0 && settings.error_threshold > 0.0);
        let planned = self.plans.of(&recording);
        let mut pass = first_pass(encoder, LABEL, input.timestamps);
        self.stages.record(&mut pass, &planned, splitter);
        self.per_pixel.gather(&mut pass, &planned);
        drop(pass);

        let mut pass = screen::begin(
            encoder,
            LABEL,
            &input.target,
            input.frame.viewport(),
            input.timestamps,
            false,
        );
        self.picture.draw(&mut pass, &recording, splitter.is_some());
        self.per_pixel.draw_points(&mut pass, &recording);
        Ok(())
    }

    /// Records the picture with the light gathered at every pixel: what the hull approximates, at the cost that it saves. Of
    /// the settings only [`SgHullSettings::f0`] matters.
    ///
    /// # Errors
    /// As [`SgHull::record`].
    pub fn record_per_pixel(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SgHullInput<'_>,
        settings: &SgHullSettings,
        hull: &SgHullView,
    ) -> Result<(), Error> {
        let recording = self.prepare(device, encoder, input, settings, hull)?;
        let mut pass = screen::begin(
            encoder,
            LABEL,
            &input.target,
            input.frame.viewport(),
            input.timestamps,
            true,
        );
        self.per_pixel.draw_all(&mut pass, &recording);
        Ok(())
    }
}

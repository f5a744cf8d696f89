//! One view's effect of the near field: its textures, and its recording into the caller's target.

use wgpu::{CommandEncoder, Device, Texture, TextureFormat, TextureUsages};

use super::effect::NearFieldEffect;
use crate::{
    camera::{Camera, Viewport},
    depth_moments::DepthMoments,
    effect::Channels,
    error::Error,
    gbuffer::GBuffer,
    gpu::{compiler::Compiler, screen},
    light::Light,
    multi_res_mask::{
        MultiResMask, MultiResMaskInput, settings::MultiResMaskSettings, view::MultiResView,
    },
    multi_res_reconstructor::{
        MultiResReconstructor, MultiResReconstructorInput, SubImages,
        settings::MultiResReconstructorSettings,
    },
    receivers::{plane_bytes, plane_for},
    room::room_for,
    screen_space_gi::{ScreenSpaceGi, ScreenSpaceGiInput, settings::ScreenSpaceGiSettings},
    soft_shadows::{SoftShadows, SoftShadowsInput, settings::SoftShadowsSettings},
    surfel_shader::ShadowMap,
    texture_slice::{TextureSlice, check_apart},
    volumetric_obscurance::{
        ObscuranceInput, VolumetricObscurance, VolumetricObscuranceDescriptor,
        settings::ObscuranceSettings,
    },
    work::PixelList,
};

/// What a [`NearFieldView`] is made for.
#[derive(Clone, Copy, Debug)]
pub struct NearFieldDescriptor {
    /// The effect.
    pub effect: NearFieldEffect,
    /// Which pixels are computed at which resolution, if not all of them at the full one.
    pub masks: Option<MultiResMaskSettings>,
    /// Format of the caller's texture. By masks any colour format of floats that can be rendered to; without them what the effect
    /// writes: `R32Float`, or `Rgba16Float` for [`NearFieldEffect::ScreenSpaceGi`].
    pub target: TextureFormat,
}

impl NearFieldDescriptor {
    /// At every pixel, into the format that the effect writes.
    pub fn new(effect: NearFieldEffect) -> Self {
        Self {
            effect,
            masks: None,
            target: match effect.channels() {
                Channels::One => TextureFormat::R32Float,
                Channels::Three => TextureFormat::Rgba16Float,
            },
        }
    }

    /// At the resolutions that the paper has for the effect ([`NearFieldEffect::masks`]), and each pixel by the same samples,
    /// which sub-images are blended best of.
    pub fn by_masks(effect: NearFieldEffect, target: TextureFormat) -> Self {
        let mut effect = effect;
        match &mut effect {
            NearFieldEffect::Obscurance { settings, .. } => settings.turn = false,
            NearFieldEffect::SoftShadows(settings) => settings.turn = false,
            NearFieldEffect::ScreenSpaceGi(settings) => settings.turn = false,
        }
        Self {
            effect,
            masks: Some(effect.masks()),
            target,
        }
    }
}

/// What an effect of the near field reads besides the G-buffer.
#[derive(Clone, Copy, Debug)]
pub enum NearFieldSource<'a> {
    /// Nothing: [`NearFieldEffect::Obscurance`].
    GBuffer,
    /// [`NearFieldEffect::SoftShadows`] of this light, whose shadow map is this one: as [`SoftShadowsInput::light`] and
    /// [`SoftShadowsInput::map`].
    Light(&'a Light, ShadowMap<'a>),
    /// [`NearFieldEffect::ScreenSpaceGi`] of this picture: as [`ScreenSpaceGiInput::lit`].
    Lit(TextureSlice<'a>),
}

/// What one recording of a [`NearFieldView`] works on.
#[derive(Clone, Copy, Debug)]
pub struct NearFieldInput<'a> {
    /// The caller's G-buffer. Its albedo is not read.
    pub gbuffer: GBuffer<'a>,
    /// The camera that it was drawn with.
    pub camera: &'a Camera,
    /// What else the effect reads.
    pub source: NearFieldSource<'a>,
    /// The caller's texture, of the view's format. By masks: usage `RENDER_ATTACHMENT`, covering the camera's viewport, of which
    /// alone it is written. Without: usage `STORAGE_BINDING`, at least of the viewport's size, written from the corner on.
    pub target: TextureSlice<'a>,
}

impl<'a> NearFieldInput<'a> {
    /// Of the G-buffer alone.
    pub fn new(
        gbuffer: GBuffer<'a>,
        camera: &'a Camera,
        target: impl Into<TextureSlice<'a>>,
    ) -> Self {
        Self {
            gbuffer,
            camera,
            source: NearFieldSource::GBuffer,
            target: target.into(),
        }
    }
}

/// Obscurance, soft shadows or indirect light of what the depth buffer holds, for one camera: the pass of the effect and, where
/// pixels are computed at several resolutions, the [`MultiResMask`] and the [`MultiResReconstructor`], with the textures that
/// they need.
///
/// ```no_run
/// use deep_screen_space::*;
///
/// /// Obscurance within half a world unit into `target`, an `R8Unorm` texture: finely about edges, coarsely elsewhere.
/// fn obscure(
///     device: &wgpu::Device,
///     encoder: &mut wgpu::CommandEncoder,
///     (gbuffer, camera): (GBuffer<'_>, &Camera),
///     target: &wgpu::Texture,
/// ) -> Result<(), Error> {
///     // Once per view.
///     let effect = NearFieldEffect::obscurance(0.5, Quality::Balanced);
///     let descriptor = NearFieldDescriptor::by_masks(effect, wgpu::TextureFormat::R8Unorm);
///     let mut obscurance = NearFieldView::new(device, &descriptor)?;
///
///     // Every frame.
///     obscurance.record(device, encoder, &NearFieldInput::new(gbuffer, camera, target))
/// }
/// ```
///
/// Textures are made by the first recording that needs them, and made anew where the camera's viewport has another size.
#[derive(Debug)]
pub struct NearFieldView {
    effect: Wired,
    target: TextureFormat,
    masks: Option<Masks>,
    /// Of the depth, for obscurance by areas.
    moments: Option<DepthMoments>,
}

/// An effect with its pass.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "one for each view")]
enum Wired {
    Obscurance {
        pass: VolumetricObscurance,
        descriptor: VolumetricObscuranceDescriptor,
        settings: ObscuranceSettings,
    },
    SoftShadows(SoftShadows, SoftShadowsSettings),
    ScreenSpaceGi(ScreenSpaceGi, ScreenSpaceGiSettings),
}

/// What computing at several resolutions takes.
#[derive(Debug)]
struct Masks {
    settings: MultiResMaskSettings,
    mask: MultiResMask,
    reconstructor: MultiResReconstructor,
    room: Option<Room>,
}

/// What a size asks for.
#[derive(Debug)]
struct Room {
    masks: MultiResView,
    images: SubImages,
    /// Hard shadows, whose edges are those of soft ones.
    hard: Option<Texture>,
}

const HARD: TextureFormat = TextureFormat::R32Float;

impl NearFieldView {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings out of range; [`Error::Format`] for a target that cannot be rendered to or does not hold
    /// floats, and [`Error::Mismatch`] without masks for one of another format than the effect writes.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        descriptor: &NearFieldDescriptor,
    ) -> Result<Self, Error> {
        let compiler = compiler.into();
        let &NearFieldDescriptor {
            effect,
            masks,
            target,
        } = descriptor;
        validate(&effect)?;
        let written = NearFieldDescriptor::new(effect).target;
        if masks.is_none() && target != written {
            return Err(Error::Mismatch {
                name: "NearFieldDescriptor::target",
                found: format!("{target:?}"),
                needed: format!("{written:?}, which the effect writes without masks"),
            });
        }
        let masks = masks
            .map(|settings| {
                settings.validate()?;
                Ok(Masks {
                    settings,
                    reconstructor: MultiResReconstructor::new(compiler, effect.channels(), target)?,
                    mask: MultiResMask::new(compiler)?,
                    room: None,
                })
            })
            .transpose()?;
        let effect = match effect {
            NearFieldEffect::Obscurance {
                descriptor,
                settings,
            } => Wired::Obscurance {
                pass: VolumetricObscurance::new(compiler, &descriptor)?,
                descriptor,
                settings,
            },
            NearFieldEffect::SoftShadows(settings) => {
                Wired::SoftShadows(SoftShadows::new(compiler)?, settings)
            }
            NearFieldEffect::ScreenSpaceGi(settings) => {
                Wired::ScreenSpaceGi(ScreenSpaceGi::new(compiler)?, settings)
            }
        };
        Ok(Self {
            effect,
            target,
            masks,
            moments: None,
        })
    }

    /// Changes the effect's settings, from the next recording on.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings out of range, [`Error::Mismatch`] for an effect of another kind or descriptor; those of
    /// before stay.
    pub fn set_effect(&mut self, effect: NearFieldEffect) -> Result<(), Error> {
        validate(&effect)?;
        match (&mut self.effect, effect) {
            (
                Wired::Obscurance {
                    descriptor: made_for,
                    settings: own,
                    ..
                },
                NearFieldEffect::Obscurance {
                    descriptor,
                    settings,
                },
            ) if *made_for == descriptor => *own = settings,
            (Wired::SoftShadows(_, own), NearFieldEffect::SoftShadows(settings)) => *own = settings,
            (Wired::ScreenSpaceGi(_, own), NearFieldEffect::ScreenSpaceGi(settings)) => {
                *own = settings;
            }
            _ => {
                return Err(Error::Mismatch {
                    name: "NearFieldEffect",
                    found: format!("{effect:?}"),
                    needed: "one of the kind and descriptor that the view was made for".into(),
                });
            }
        }
        Ok(())
    }

    /// Records the effect into the caller's texture.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for a [source](NearFieldInput::source) of another effect, for a target of another format or that is
    /// read too, and for soft shadows by masks in a viewport that does not begin in the texture's corner; what the effect's own
    /// pass finds, and the [`MultiResMask`].
    pub fn record(
        &mut self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &NearFieldInput<'_>,
    ) -> Result<(), Error> {
        self.check(input)?;
        self.record_moments(device, encoder, input)?;
        let moments = self.moments.as_ref();
        let Some(masks) = &mut self.masks else {
            let at_all = (moments, None);
            return self
                .effect
                .record(device, encoder, input, at_all, input.target);
        };
        let Masks {
            settings,
            mask,
            reconstructor,
            room,
        } = masks;
        let is_shadow = matches!(self.effect, Wired::SoftShadows(..));
        let Viewport { width, height, .. } = input.camera.viewport();
        let Room {
            masks,
            images,
            hard,
        } = room_for(
            room,
            |room| room.masks.size() == [width, height],
            || {
                let label = "deep-screen-space hard shadows";
                let usages = TextureUsages::STORAGE_BINDING;
                let hard = || plane_for(device, label, HARD, [width, height], 1, usages);
                Ok(Room {
                    masks: mask.create_view(device, width, height, false)?,
                    images: reconstructor.create_images(device, width, height, settings)?,
                    hard: is_shadow.then(hard).transpose()?,
                })
            },
        )?;
        if let Some(hard) = hard {
            self.effect
                .record_hard_shadows(device, encoder, input, (&*hard).into())?;
        }
        let found = MultiResMaskInput {
            shading: hard.as_ref().map(TextureSlice::from),
            ..MultiResMaskInput::new(input.gbuffer, input.camera)
        };
        mask.record(device, encoder, &found, settings, masks)?;
        for work in masks.works() {
            if let Some(image) = images.level(work.level) {
                self.effect
                    .record(device, encoder, input, (moments, Some(work)), image.into())?;
            }
        }
        let blended = MultiResReconstructorInput::new(
            input.gbuffer,
            input.camera,
            masks,
            images,
            input.target,
        );
        let settings = MultiResReconstructorSettings::default();
        reconstructor.record(device, encoder, &blended, &settings)
    }

    /// GPU memory that it owns, bytes: nothing before the first recording, nor ever of obscurance by points or lines at every
    /// pixel and of what else needs no masks.
    pub fn memory_bytes(&self) -> u64 {
        let moments = self.moments.as_ref().map_or(0, DepthMoments::memory_bytes);
        let room = self.masks.as_ref().and_then(|masks| masks.room.as_ref());
        moments
            + room.map_or(0, |room| {
                let hard = |hard: &Texture| plane_bytes(HARD, [hard.width(), hard.height()], 1);
                room.masks.memory_bytes()
                    + room.images.memory_bytes()
                    + room.hard.as_ref().map_or(0, hard)
            })
    }

    /// The depth's moments, for obscurance by areas.
    fn record_moments(
        &mut self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &NearFieldInput<'_>,
    ) -> Result<(), Error> {
        let Wired::Obscurance { pass, .. } = &self.effect else {
            return Ok(());
        };
        if !pass.reads_moments() {
            return Ok(());
        }
        let Viewport { width, height, .. } = input.camera.viewport();
        let moments = match self.moments.take() {
            Some(moments) if moments.size == [width, height] => moments,
            _ => pass.create_moments(device, width, height)?,
        };
        let moments = self.moments.insert(moments);
        let depth = input.gbuffer.depth;
        pass.record_moments(device, encoder, depth, input.camera, moments, None)
    }

    /// What the passes would find only after others were recorded.
    fn check(&self, input: &NearFieldInput<'_>) -> Result<(), Error> {
        const TARGET: &str = "NearFieldInput::target";
        let needed = match (&self.effect, input.source) {
            (Wired::Obscurance { .. }, NearFieldSource::GBuffer)
            | (Wired::SoftShadows(..), NearFieldSource::Light(..))
            | (Wired::ScreenSpaceGi(..), NearFieldSource::Lit(_)) => None,
            (Wired::Obscurance { .. }, _) => Some("GBuffer, for obscurance"),
            (Wired::SoftShadows(..), _) => Some("Light, for soft shadows"),
            (Wired::ScreenSpaceGi(..), _) => Some("Lit, for indirect light"),
        };
        if let Some(needed) = needed {
            return Err(Error::Mismatch {
                name: "NearFieldInput::source",
                found: match input.source {
                    NearFieldSource::GBuffer => "GBuffer".into(),
                    NearFieldSource::Light(..) => "Light".into(),
                    NearFieldSource::Lit(_) => "Lit".into(),
                },
                needed: needed.into(),
            });
        }
        if self.masks.is_none() {
            return Ok(());
        }
        let viewport = input.camera.viewport();
        if matches!(self.effect, Wired::SoftShadows(..)) && [viewport.x, viewport.y] != [0; 2] {
            return Err(Error::Mismatch {
                name: "NearFieldInput::camera",
                found: format!("a viewport at {}, {}", viewport.x, viewport.y),
                needed: "one at 0, 0, for soft shadows by masks".into(),
            });
        }
        input.gbuffer.validate(viewport)?;
        screen::check_target(TARGET, &input.target, viewport, self.target)?;
        let lit = match input.source {
            NearFieldSource::Lit(lit) => Some(("NearFieldSource::Lit", lit, 1)),
            _ => None,
        };
        check_apart(TARGET, &input.target, input.gbuffer.reads().chain(lit))
    }
}

impl Wired {
    /// Shadows of the same light without an extent.
    fn record_hard_shadows(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &NearFieldInput<'_>,
        target: TextureSlice<'_>,
    ) -> Result<(), Error> {
        let (Self::SoftShadows(pass, _), NearFieldSource::Light(light, map)) = (self, input.source)
        else {
            return Ok(());
        };
        let shadows = SoftShadowsInput::new(input.gbuffer, input.camera, light, map, target);
        pass.record(device, encoder, &shadows, &SoftShadowsSettings::hard())
    }

    /// The effect, at all pixels or at those of a list.
    fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &NearFieldInput<'_>,
        (moments, work): (Option<&DepthMoments>, Option<PixelList<'_>>),
        target: TextureSlice<'_>,
    ) -> Result<(), Error> {
        let NearFieldInput {
            gbuffer, camera, ..
        } = *input;
        match (self, input.source) {
            (Self::Obscurance { pass, settings, .. }, _) => {
                let obscured = ObscuranceInput {
                    normals: Some(gbuffer.normals()),
                    moments,
                    work,
                    ..ObscuranceInput::new(gbuffer.depth, camera, target)
                };
                pass.record(device, encoder, &obscured, settings)
            }
            (Self::SoftShadows(pass, settings), NearFieldSource::Light(light, map)) => {
                let shadows = SoftShadowsInput {
                    work,
                    ..SoftShadowsInput::new(gbuffer, camera, light, map, target)
                };
                pass.record(device, encoder, &shadows, settings)
            }
            (Self::ScreenSpaceGi(pass, settings), NearFieldSource::Lit(lit)) => {
                let gathered = ScreenSpaceGiInput {
                    work,
                    ..ScreenSpaceGiInput::new(gbuffer, camera, lit, target)
                };
                pass.record(device, encoder, &gathered, settings)
            }
            // Refused before.
            _ => Ok(()),
        }
    }
}

fn validate(effect: &NearFieldEffect) -> Result<(), Error> {
    match effect {
        NearFieldEffect::Obscurance { settings, .. } => settings.validate(),
        NearFieldEffect::SoftShadows(settings) => settings.validate(),
        NearFieldEffect::ScreenSpaceGi(settings) => settings.validate(),
    }
}

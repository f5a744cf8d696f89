//! What one side of the window shows: an effect, a method, and all their settings.

use deep_screen_space::{
    BallSamples, BounceSettings, Components, Error, ObscuranceSampling, ObscuranceSettings,
    ObscuranceVolume, Overlap, Payload, Quality, RaySettings, RayTracedEffect,
    RayTracedViewDescriptor, Scattering, ScreenSpaceGiSettings, SgHullSettings, SgHullSize,
    SoftShadowsSettings, SplatQuality, SubsurfaceScattering, SurfelGathererSettings,
    TemporalSettings, wgpu::TextureFormat,
};

use crate::fields::Settings;

/// What is to be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    AmbientOcclusion,
    BentNormals,
    DirectionalOcclusion,
    IndirectDiffuse,
    IndirectSpecular,
    SubsurfaceScattering,
    SoftShadows,
}

/// How it is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The bounced z-buffer: rays among all triangles.
    Rays,
    /// Sums over surfels.
    Splats,
    /// From the depth buffer alone, or from a shadow map.
    Depths,
    /// Light of a reflective shadow map, gathered on a hull of what is seen.
    Hull,
}

impl Effect {
    pub const ALL: [Self; 7] = [
        Self::AmbientOcclusion,
        Self::BentNormals,
        Self::DirectionalOcclusion,
        Self::IndirectDiffuse,
        Self::IndirectSpecular,
        Self::SubsurfaceScattering,
        Self::SoftShadows,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::AmbientOcclusion => "Ambient occlusion",
            Self::BentNormals => "Bent normals",
            Self::DirectionalOcclusion => "Light of a sky",
            Self::IndirectDiffuse => "Indirect light, diffuse",
            Self::IndirectSpecular => "Indirect light, glossy",
            Self::SubsurfaceScattering => "Subsurface scattering",
            Self::SoftShadows => "Soft shadows",
        }
    }

    /// As scripts and files call it.
    pub fn short(self) -> &'static str {
        match self {
            Self::AmbientOcclusion => "ao",
            Self::BentNormals => "bent",
            Self::DirectionalOcclusion => "do",
            Self::IndirectDiffuse => "gi",
            Self::IndirectSpecular => "specular",
            Self::SubsurfaceScattering => "sss",
            Self::SoftShadows => "shadow",
        }
    }

    pub fn methods(self) -> &'static [Method] {
        match self {
            Self::AmbientOcclusion => &[Method::Rays, Method::Splats, Method::Depths],
            Self::IndirectDiffuse => &[Method::Rays, Method::Splats, Method::Depths, Method::Hull],
            Self::BentNormals | Self::DirectionalOcclusion | Self::IndirectSpecular => {
                &[Method::Rays, Method::Splats]
            }
            Self::SubsurfaceScattering => &[Method::Splats],
            Self::SoftShadows => &[Method::Depths],
        }
    }

    /// Whether the picture has one channel.
    pub fn is_grey(self) -> bool {
        matches!(self, Self::AmbientOcclusion | Self::SoftShadows)
    }

    /// Whether rays that are traced on the processor can say what is true.
    pub fn has_truth(self) -> bool {
        !matches!(self, Self::SubsurfaceScattering | Self::SoftShadows)
    }
}

impl Method {
    pub fn name(self, of: Effect) -> &'static str {
        match (self, of) {
            (Self::Rays, _) => "Rays",
            (Self::Splats, _) => "Splats",
            (Self::Depths, Effect::AmbientOcclusion) => "Obscurance of the depth buffer",
            (Self::Depths, Effect::SoftShadows) => "Shadow map",
            (Self::Depths, _) => "What is on screen",
            (Self::Hull, _) => "Hull, without shadows",
        }
    }

    pub fn short(self) -> &'static str {
        match self {
            Self::Rays => "rays",
            Self::Splats => "splats",
            Self::Depths => "depths",
            Self::Hull => "hull",
        }
    }
}

/// All that one side is made by. What the effect and the method have no use for stays as it was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    pub effect: Effect,
    pub method: Method,
    /// Whether anything in the scene shines of itself, so that rays are worth aiming at it.
    pub emits: bool,
    /// Beyond it nothing occludes, world units.
    pub radius: f32,
    /// Which of [`support::sky::NAMES`].
    pub sky: usize,
    /// What comes from where nothing is, W/(m² sr).
    pub sky_radiance: [f32; 3],
    /// Perceptual, of all surfaces.
    pub roughness: f32,
    pub f0: [f32; 3],
    pub two_sided: bool,
    pub overlap: Overlap,
    /// Which of [`Scattering::NAMED`].
    pub material: usize,
    pub millimetres: f32,
    /// What a splat's `epsilon` is a share of, W/m².
    pub unit: f32,
    pub rays: RaySettings,
    pub temporal: Option<TemporalSettings>,
    pub bounces: Option<BounceSettings>,
    pub splats: SplatQuality,
    /// Surfels that there is room for.
    pub surfels: u32,
    pub obscurance: ObscuranceSettings,
    pub sampling: ObscuranceSampling,
    pub volume: ObscuranceVolume,
    pub shadows: SoftShadowsSettings,
    pub screen: ScreenSpaceGiSettings,
    pub hull: SgHullSettings,
    /// Of which width and height are the picture's.
    pub hull_size: SgHullSize,
    pub components: Components,
}

/// Surfels of a usual view, with room.
const SURFELS: u32 = 1 << 19;

impl Look {
    /// Where occluders within `radius` count, and light of `reach` about a pixel.
    pub fn new(radius: f32, reach: f32, quality: Quality) -> Self {
        let mut look = Self {
            effect: Effect::AmbientOcclusion,
            method: Method::Rays,
            emits: false,
            radius,
            sky: 0,
            sky_radiance: [0.0; 3],
            roughness: 0.3,
            f0: [0.04; 3],
            two_sided: false,
            overlap: Overlap::default(),
            material: 5,
            millimetres: 1000.0,
            unit: 1.0,
            rays: quality.rays(Payload::Occlusion),
            temporal: None,
            bounces: None,
            splats: quality.splats(radius),
            surfels: SURFELS,
            obscurance: ObscuranceSettings {
                radius: 0.25 * reach,
                ..ObscuranceSettings::default()
            },
            sampling: ObscuranceSampling::Points(BallSamples::Twelve),
            volume: ObscuranceVolume::default(),
            shadows: SoftShadowsSettings {
                max_penumbra: 0.25 * reach,
                turn: true,
                ..SoftShadowsSettings::default()
            },
            screen: ScreenSpaceGiSettings {
                radius: reach,
                turn: true,
                ..ScreenSpaceGiSettings::default()
            },
            hull: SgHullSettings::default(),
            hull_size: SgHullSize::rest(),
            components: Components::default(),
        };
        look.take(quality);
        look
    }

    /// Another effect, by the same method where it has that, at a quality.
    pub fn choose(&mut self, effect: Effect, quality: Quality) {
        self.effect = effect;
        if !effect.methods().contains(&self.method) {
            self.method = effect.methods()[0];
        }
        self.take(quality);
    }

    /// The settings of a quality, for the effect.
    pub fn take(&mut self, quality: Quality) {
        self.rays = self.rays_of(quality);
        if self.emits && self.is_lit() {
            self.rays = self.rays.for_emitters();
        }
        self.rays.filter.f0 = self.f0;
        self.splats = match self.effect {
            Effect::SubsurfaceScattering => self.scattering().splats(quality, self.pixel()),
            _ => quality.splats(self.reach()),
        };
        self.sampling = ObscuranceSampling::Points(match quality {
            Quality::Fast => BallSamples::Twelve,
            Quality::Balanced => BallSamples::ThirtyThree,
            Quality::Accurate => BallSamples::SixtyFour,
        });
        [self.screen.samples, self.shadows.samples] = match quality {
            Quality::Fast => [16, 16],
            Quality::Balanced => [64, 64],
            Quality::Accurate => [288, 196],
        };
    }

    /// A quality's rays, none of them aimed.
    fn rays_of(&self, quality: Quality) -> RaySettings {
        let effect = self.ray_traced();
        RayTracedViewDescriptor::new(effect, quality, TextureFormat::Rgba32Float).rays
    }

    /// As many rays, of pixels and of surfels, a part of them to what shines of itself or none.
    pub fn aim(&mut self, aims: bool) {
        if aims {
            self.rays = self.rays.for_emitters();
            self.bounces = self.bounces.map(BounceSettings::for_emitters);
            return;
        }
        let rays = &mut self.rays;
        rays.rays_per_pixel = (rays.rays_per_pixel + rays.emitter_samples).min(64);
        rays.emitter_samples = 0;
        self.rays.filter.variance_clamp = self.rays_of(Quality::Balanced).filter.variance_clamp;
        if let Some(bounces) = &mut self.bounces {
            let gatherer = &mut bounces.gatherer;
            gatherer.rays_per_surfel =
                (gatherer.rays_per_surfel + gatherer.emitter_samples).min(64);
            gatherer.emitter_samples = 0;
        }
    }

    /// Whether any rays are aimed.
    pub fn aims(&self) -> bool {
        let bounces = self.further_bounces();
        let by_surfels = bounces.is_some_and(|bounces| bounces.gatherer.emitter_samples > 0);
        let by_pixels = self.is_lit() && self.rays.emitter_samples > 0;
        self.method == Method::Rays && (by_pixels || by_surfels)
    }

    /// Further bounces as suits the rays of pixels.
    pub fn suited(&self, bounces: BounceSettings) -> BounceSettings {
        if self.rays.emitter_samples > 0 {
            bounces.for_emitters()
        } else {
            bounces
        }
    }

    /// Whether frames are joined, which those of bent normals are not.
    pub fn joins_frames(&self) -> bool {
        self.method == Method::Rays && self.temporal.is_some() && self.effect != Effect::BentNormals
    }

    /// The effect as the facade has it.
    pub fn ray_traced(&self) -> RayTracedEffect {
        let (radius, sky_radiance) = (self.radius, self.sky_radiance);
        match self.effect {
            Effect::BentNormals => RayTracedEffect::BentNormals { radius },
            Effect::DirectionalOcclusion => RayTracedEffect::DirectionalOcclusion { radius },
            Effect::IndirectDiffuse => RayTracedEffect::IndirectDiffuse { sky_radiance },
            Effect::IndirectSpecular => RayTracedEffect::IndirectSpecular { sky_radiance },
            _ => RayTracedEffect::AmbientOcclusion { radius },
        }
    }

    /// Whether light has to be known at what rays hit, or where surfels are.
    pub fn is_lit(&self) -> bool {
        self.ray_traced().payload() == Payload::LitRadiance
    }

    /// How far the scene matters, world units.
    pub fn reach(&self) -> f32 {
        match self.effect {
            Effect::AmbientOcclusion | Effect::BentNormals | Effect::DirectionalOcclusion => {
                self.radius
            }
            _ => f32::INFINITY,
        }
    }

    /// Bounces of light that are to be seen, under the effect's sky; further ones by rays alone.
    pub fn further_bounces(&self) -> Option<BounceSettings> {
        let seen = self.method == Method::Rays && self.is_lit();
        self.bounces.filter(|_| seen).map(|bounces| BounceSettings {
            gatherer: SurfelGathererSettings {
                sky_radiance: self.sky_radiance,
                ..bounces.gatherer
            },
            ..bounces
        })
    }

    pub fn scattering(&self) -> SubsurfaceScattering {
        let (_, named) = Scattering::NAMED[self.material % Scattering::NAMED.len()];
        SubsurfaceScattering {
            unit: self.unit,
            ..SubsurfaceScattering::new(named.scaled(self.millimetres))
        }
    }

    /// World units of a pixel, roughly, that surfels are held against.
    fn pixel(&self) -> f32 {
        // A body a metre across fills the picture.
        1.0 / self.millimetres
    }

    /// What the crate itself says of the settings that are in use.
    ///
    /// # Errors
    /// The first that is out of range.
    pub fn validate(&self) -> Result<(), Error> {
        match self.method {
            Method::Rays => {
                self.rays.bounced(self.reach()).validate()?;
                self.rays.validate()?;
                if let Some(temporal) = &self.temporal {
                    temporal.validate()?;
                }
                self.further_bounces()
                    .map_or(Ok(()), |bounces| bounces.validate())
            }
            Method::Splats => {
                self.splats.surfelizer.validate()?;
                self.splats.splat.validate()?;
                self.splats.reconstructor.validate()?;
                if self.effect == Effect::SubsurfaceScattering {
                    self.scattering().scattering.validate()?;
                }
                Ok(())
            }
            Method::Depths => match self.effect {
                Effect::SoftShadows => self.shadows.validate(),
                Effect::IndirectDiffuse => self.screen.validate(),
                _ => self.obscurance.validate(),
            },
            Method::Hull => {
                self.hull_size.validate()?;
                self.hull.validate()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As many rays as before, and the filter of before.
    #[test]
    fn rays_are_aimed_and_not() {
        let mut look = Look::new(2.0, 1.0, Quality::Balanced);
        look.choose(Effect::IndirectSpecular, Quality::Balanced);
        look.bounces = Some(BounceSettings::in_frame(2));
        let before = look;
        look.aim(true);
        assert_eq!(look.rays.all_rays(), before.rays.all_rays());
        assert_eq!([look.rays.emitter_samples, look.aims().into()], [2, 1]);
        look.aim(false);
        assert_eq!(look, before);
    }

    #[test]
    fn every_effect_by_every_method_has_settings_that_hold() {
        for quality in Quality::ALL {
            for effect in Effect::ALL {
                for &method in effect.methods() {
                    let mut look = Look::new(2.0, 1.0, quality);
                    look.choose(effect, quality);
                    look.method = method;
                    for emits in [false, true] {
                        look.emits = emits;
                        look.take(quality);
                        look.validate().unwrap();
                        assert_eq!(
                            look.aims(),
                            emits && method == Method::Rays && look.is_lit()
                        );
                    }
                }
            }
        }
    }
}

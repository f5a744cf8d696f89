//! Points on the curve of error over time, measured by `benches/error_time`.

use crate::{
    BouncedSettings, Error, HitResolverSettings, Payload, RayBudgetSettings, ReconstructorSettings,
    SplatSettings, SurfelizerSettings,
    bounced_z_buffer::{descriptor::MAX_EMITTER_SAMPLES, settings::MAX_RAYS_PER_PIXEL},
    error::check_setting,
    ray_budget::settings::MOST_RAYS,
    ray_traced::bounces::aimed,
};

/// How exactly: a point on the curve of error over time, which `cargo bench --bench error_time` measures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quality {
    /// 4 rays per pixel for occlusion, of an environment too. For light 8, half of them where noise is greatest.
    Fast,
    /// 16 rays per pixel for occlusion, of an environment too. For light 40, half of them where noise is greatest.
    #[default]
    Balanced,
    /// 64 rays per pixel, for light half of them where noise is greatest; for light that glossy receivers reflect 128.
    Accurate,
}

impl Quality {
    /// Each of them, from the fastest.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Balanced, Self::Accurate];

    /// Rays per pixel, and the filter that suits them, for diffuse receivers; [`glossy_rays`](Self::glossy_rays) are those for
    /// glossy ones.
    pub fn rays(self, payload: Payload) -> RaySettings {
        // Occlusion gains nothing by rays that go where noise is: it is nearly the same everywhere.
        if matches!(payload, Payload::Occlusion | Payload::Sky) {
            let rays_per_pixel = match self {
                Self::Fast => 4,
                Self::Balanced => 16,
                Self::Accurate => 64,
            };
            return RaySettings::new(rays_per_pixel, payload);
        }
        let half = match self {
            Self::Fast => 4,
            Self::Balanced => 20,
            Self::Accurate => 32,
        };
        RaySettings::with_further(half, half as f32, payload)
    }

    /// The same for light that glossy receivers reflect: 8, 40 and 128 rays per pixel, of which three in four, and seven in
    /// eight of [`Accurate`](Self::Accurate), go where noise is greatest, up to 255 to a pixel, as most of it is at few pixels.
    pub fn glossy_rays(self) -> RaySettings {
        let (each, further) = match self {
            Self::Fast => (2, 6.0),
            Self::Balanced => (10, 30.0),
            Self::Accurate => (16, 112.0),
        };
        let rays = RaySettings::with_further(each, further, Payload::LitRadiance).for_glossy();
        RaySettings {
            further: rays.further.map(|further| RayBudgetSettings {
                most: MOST_RAYS,
                ..further
            }),
            ..rays
        }
    }

    /// What suits splatting ambient occlusion by occluders nearer than `radius`, in world units.
    pub fn splats(self, radius: f32) -> SplatQuality {
        // The error follows the surfels' radius: a smaller epsilon buys little at the same radius, while pairs grow with its
        // inverse. It has to fall with the radius, or fine surfels reach the noisy levels too soon.
        let (radius_pixels, epsilon) = match self {
            Self::Fast => (4.0, 0.08),
            Self::Balanced => (2.0, 0.04),
            Self::Accurate => (1.5, 0.02),
        };
        SplatQuality {
            surfelizer: SurfelizerSettings {
                radius_pixels,
                ..SurfelizerSettings::default()
            },
            splat: SplatSettings {
                levels: 5,
                epsilon,
                radius,
                ..SplatSettings::default()
            },
            reconstructor: ReconstructorSettings::default(),
        }
    }
}

/// The [`HitResolverSettings::variance_clamp`] for rays of which a part is aimed and a part goes where noise is: of 0 to 16 that
/// of the least error in the Cornell box, diffuse and glossy, and in the closed room. Without further rays few that agree by
/// chance would be kept apart from their neighbours: there it makes the closed room's error half as large again.
const AIMED_CLAMP: f32 = 2.0;

/// How many rays, and how pixels share them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RaySettings {
    /// As [`BouncedSettings::rays_per_pixel`], 0…64.
    pub rays_per_pixel: u32,
    /// Further rays, for those pixels that are noisiest, if any.
    pub further: Option<RayBudgetSettings>,
    /// How many rays per pixel go to surfaces that shine of themselves, beside `rays_per_pixel`, 0…16, as
    /// [`BouncedDescriptor::emitter_samples`](crate::BouncedDescriptor::emitter_samples): for a scene
    /// [with emitters](crate::RayTracedScene::with_emitters), and indirect light alone.
    pub emitter_samples: u32,
    /// The filter.
    pub filter: HitResolverSettings,
}

impl RaySettings {
    /// So many rays, and the filter that suits them.
    pub fn new(rays_per_pixel: u32, payload: Payload) -> Self {
        let filter = match payload {
            Payload::Occlusion => HitResolverSettings::for_occlusion(rays_per_pixel),
            Payload::Sky => HitResolverSettings::for_environment(rays_per_pixel),
            Payload::Radiance | Payload::LitRadiance | Payload::LitAndGathered => {
                HitResolverSettings::for_light(rays_per_pixel)
            }
        };
        Self {
            rays_per_pixel,
            further: None,
            emitter_samples: 0,
            filter,
        }
    }

    /// So many rays, `further` more per pixel on average where noise is greatest, and the filter that suits all of them.
    pub fn with_further(rays_per_pixel: u32, further: f32, payload: Payload) -> Self {
        let all = rays_per_pixel.saturating_add(further.round() as u32);
        Self {
            rays_per_pixel,
            further: Some(RayBudgetSettings {
                rays_per_pixel: further,
                ..RayBudgetSettings::default()
            }),
            ..Self::new(all, payload)
        }
    }

    /// As many rays, and the filter that suits them where receivers are glossy.
    #[must_use]
    pub fn for_glossy(self) -> Self {
        let mut filter = HitResolverSettings::for_glossy_light(self.all_rays().round() as u32);
        if self.emitter_samples > 0 {
            filter.variance_clamp = AIMED_CLAMP;
        }
        Self { filter, ..self }
    }

    /// As many rays in all, a part of which go to surfaces that shine of themselves, for a scene
    /// [with emitters](crate::RayTracedScene::with_emitters): one in five, rounded, and one at least, of two rays or more. So
    /// little noise is left that the filter may keep the edges of shadows: neighbours whose means differ by more than their noise
    /// hardly count.
    #[must_use]
    pub fn for_emitters(self) -> Self {
        let [rays_per_pixel, emitter_samples] = aimed(self.rays_per_pixel, self.emitter_samples);
        Self {
            rays_per_pixel,
            emitter_samples,
            filter: HitResolverSettings {
                variance_clamp: match self.further {
                    Some(_) => AIMED_CLAMP,
                    None => self.filter.variance_clamp,
                },
                ..self.filter
            },
            ..self
        }
    }

    /// As many rays in all, at every pixel alike.
    #[must_use]
    pub fn everywhere(self) -> Self {
        let further = self.further.map_or(0.0, |further| further.rays_per_pixel);
        let all = self.rays_per_pixel.saturating_add(further.round() as u32);
        Self {
            rays_per_pixel: all.min(MAX_RAYS_PER_PIXEL),
            further: None,
            ..self
        }
    }

    /// Rays per pixel on average, further ones included.
    pub fn all_rays(&self) -> f64 {
        let further = self.further.map_or(0.0, |further| further.rays_per_pixel);
        f64::from(self.rays_per_pixel) + f64::from(self.emitter_samples) + f64::from(further)
    }

    /// What the tracer takes, for hits nearer than `radius`.
    pub fn bounced(&self, radius: f32) -> BouncedSettings {
        BouncedSettings {
            rays_per_pixel: self.rays_per_pixel,
            radius,
            ..BouncedSettings::default()
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        self.bounced(f32::INFINITY).validate()?;
        check_setting(
            self.emitter_samples <= MAX_EMITTER_SAMPLES,
            "RaySettings::emitter_samples",
            self.emitter_samples,
            "0 to 16",
        )?;
        self.filter.validate()?;
        self.further
            .as_ref()
            .map_or(Ok(()), RayBudgetSettings::validate)
    }
}

/// Settings of the passes that splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatQuality {
    /// Of the [`Surfelizer`](crate::Surfelizer), but for its reach.
    pub surfelizer: SurfelizerSettings,
    /// Of the [`ShellSplatter`](crate::ShellSplatter).
    pub splat: SplatSettings,
    /// Of the [`Reconstructor`](crate::Reconstructor).
    pub reconstructor: ReconstructorSettings,
}

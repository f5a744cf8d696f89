//! Points on the curve of error over time, measured by `benches/error_time`.

use crate::{
    BouncedSettings, HitResolverSettings, Payload, ReconstructorSettings, SplatSettings,
    SurfelizerSettings,
};

/// How exactly: a point on the curve of error over time, which `cargo bench --bench error_time` measures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quality {
    /// 4 rays per pixel for occlusion and 8 for light.
    Fast,
    /// 16 rays per pixel for occlusion and 40 for light.
    #[default]
    Balanced,
    /// 64 rays per pixel.
    Accurate,
}

impl Quality {
    /// Each of them, from the fastest.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Balanced, Self::Accurate];

    /// Rays per pixel, and the filter that suits them.
    pub fn rays(self, payload: Payload) -> RaySettings {
        let light = payload.is_radiance();
        let rays_per_pixel = match self {
            Self::Fast if light => 8,
            Self::Fast => 4,
            Self::Balanced if light => 40,
            Self::Balanced => 16,
            Self::Accurate => 64,
        };
        RaySettings::new(rays_per_pixel, payload)
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

/// How many rays, and how pixels share them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RaySettings {
    /// As [`BouncedSettings::rays_per_pixel`], 0…64.
    pub rays_per_pixel: u32,
    /// The filter.
    pub filter: HitResolverSettings,
}

impl RaySettings {
    /// So many rays, and the filter that suits them.
    pub fn new(rays_per_pixel: u32, payload: Payload) -> Self {
        let filter = if payload.is_radiance() {
            HitResolverSettings::for_light(rays_per_pixel)
        } else {
            HitResolverSettings::for_occlusion(rays_per_pixel)
        };
        Self {
            rays_per_pixel,
            filter,
        }
    }

    /// What the tracer takes, for hits nearer than `radius`.
    pub fn bounced(&self, radius: f32) -> BouncedSettings {
        BouncedSettings {
            rays_per_pixel: self.rays_per_pixel,
            radius,
            ..BouncedSettings::default()
        }
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

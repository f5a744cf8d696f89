//! Light that enters a translucent body and leaves it elsewhere (`wgsl/effects/subsurface_scattering.wgsl`).

use super::scattering::Scattering;
use crate::{
    effect::Effect,
    error::{Error, check_setting},
    geometry::Material,
    ray_traced::quality::{Quality, SplatQuality},
    reconstructor::settings::ReconstructorSettings,
    shell_splatter::settings::SplatSettings,
    surfelizer::settings::SurfelizerSettings,
};

/// Subsurface scattering by splatting (Deep Screen Space 4): what light lets into a body, at every surfel of it, comes out around
/// the surfel by the dipole of Jensen and Buhler, *A Rapid Hierarchical Rendering Technique for Translucent Materials* (2002).
/// All surfaces of the body count: its back, and what is off screen.
///
/// * **What surfels send** is the irradiance on their fronts. The [`SurfelShader`](crate::SurfelShader) writes it, shadows
///   included, when given [`SubsurfaceScattering::senders`] for materials: what scatters is white there, and all else is black,
///   sends nothing and costs nothing.
/// * **Which pixels receive** is in the G-buffer's albedo: 1 where this material is seen, 0 elsewhere, and what a channel's light
///   is tinted by as it leaves. Several materials are several recordings, whose pictures add up.
/// * **The picture** is `M_o / π`, where `M_o`, W/m², is the radiant exitance: outgoing radiance, W/(m² sr), the same into all
///   directions. Jensen and Buhler's dependence on the direction ω is a factor `F_t(η, ω) / F_dt` of the caller's, where `F_t` is
///   the transmittance of a smooth boundary and `F_dt` its mean, [`Scattering::transmittance`]. It is also the share of
///   irradiance that is let in, whatever direction it comes from.
///
/// A dipole is of a flat, endless body: light leaves thin parts and edges as if there were more behind them. Nothing is between a
/// surfel and a pixel, so that bodies of one material that are recorded together shine on each other through the air, and so do
/// two parts of one body. Light that scatters once alone, and what a surface reflects, are not in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SubsurfaceScattering {
    /// The material, in world units.
    pub scattering: Scattering,
    /// The irradiance, W/m², that [`SplatSettings::epsilon`](crate::SplatSettings::epsilon) is a share of, above 0 to 1e18: about
    /// that of the light. A surfel of radius r in irradiance E is on the first level up to about
    /// `r √(0.19 E / (epsilon · unit))` from it, and costs nothing in shadow.
    pub unit: f32,
}

impl SubsurfaceScattering {
    /// Of a material, where irradiance is about 1.
    pub fn new(scattering: Scattering) -> Self {
        Self {
            scattering,
            unit: 1.0,
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        self.scattering.validate()?;
        check_setting(
            self.unit > 0.0 && self.unit <= 1e18,
            "SubsurfaceScattering::unit",
            self.unit,
            "above 0 to 1e18",
        )
    }

    /// The effect. Three channels; reads what surfels send and the G-buffer's albedo, and writes outgoing radiance, W/(m² sr), to
    /// r, g and b and 1 to a.
    ///
    /// # Errors
    /// What [`SubsurfaceScattering::validate`] finds.
    pub fn effect(self) -> Result<Effect, Error> {
        self.validate()?;
        let dipoles = self.scattering.dipoles();
        let transmittance = self.scattering.transmittance();
        let mut constants = vec![("UNIT".into(), self.unit.into())];
        for (dipole, channel) in dipoles.iter().zip(["RED", "GREEN", "BLUE"]) {
            for (name, value) in [
                ("GAIN", transmittance * dipole.albedo),
                ("SIGMA_TR", dipole.sigma_tr),
                ("Z_R", dipole.z_r),
                ("Z_V", dipole.z_v),
            ] {
                constants.push((format!("{name}_{channel}"), value));
            }
        }
        Ok(Effect {
            channels: 3,
            radiance: true,
            albedo: true,
            // Light comes through a body: from surfels that face away.
            two_sided: true,
            constants,
            ..Effect::new(
                "subsurface scattering",
                include_str!("../../wgsl/effects/subsurface_scattering.wgsl"),
            )
        })
    }

    /// What suits splatting it, where a pixel at the body has this side, world units
    /// ([`Camera::footprint`](crate::Camera::footprint) tells). Surfels are 2, 1 or 0.4 mean free paths in radius, as far as that
    /// is between 1, 0.5 or 0.25 pixels and 8; light is followed as far as all but 2 %, 1 % or 0.3 % of it goes. Where the mean
    /// free path is well below a pixel, surfels are coarse beside it, and blur what pixels would show of it.
    ///
    /// What comes of a `pixel` that is not a number is refused where it is used.
    pub fn splats(&self, quality: Quality, pixel: f32) -> SplatQuality {
        // Epsilon falls faster than a surfel's area, or fine surfels reach the noisy levels too soon.
        let (paths, finest, epsilon, left_out) = match quality {
            Quality::Fast => (2.0, 1.0, 0.01, 0.02),
            Quality::Balanced => (1.0, 0.5, 1e-3, 0.01),
            Quality::Accurate => (0.4, 0.25, 5e-5, 0.003),
        };
        let path = self.scattering.mean_free_path() / f64::from(pixel);
        let radius_pixels = (paths * path).clamp(finest, 8.0) as f32;
        SplatQuality {
            surfelizer: SurfelizerSettings {
                radius_pixels,
                // A triangle that stands for others reaches below a curved surface, into its shadow.
                density: f32::INFINITY,
                ..SurfelizerSettings::default()
            },
            splat: SplatSettings {
                levels: 5,
                epsilon,
                radius: self.scattering.reach(left_out) as f32,
                ..SplatSettings::default()
            },
            reconstructor: ReconstructorSettings::default(),
        }
    }

    /// A material table for the [`SurfelShader`](crate::SurfelShader), as long as the scene's own, with which surfels of the
    /// materials that scatter send irradiance over π and all others nothing.
    pub fn senders(materials: usize, scatters: impl Fn(usize) -> bool) -> Vec<Material> {
        let of = |number| Material {
            albedo: [f32::from(u8::from(scatters(number))); 3],
            ..Material::default()
        };
        (0..materials).map(of).collect()
    }
}

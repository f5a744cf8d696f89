//! What a device and a scene took, of which plans are made.

use super::{Method, curves::RAYS};
use crate::{
    error::{Error, check_setting},
    ray_traced::{
        quality::{Quality, RaySettings},
        view::RayTracedEffect,
    },
    volumetric_obscurance::{
        VolumetricObscuranceDescriptor,
        samples::DiskSamples,
        settings::{ObscuranceSampling, ObscuranceSettings, ObscuranceVolume},
    },
};

/// What one device took for one scene, which [`plan`](super::plan) scales: measured once, in some frames, with any scene that is
/// like those to come.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Width and height of the pictures, pixels, each at least 1.
    pub size: [u32; 2],
    /// How many triangles the scene has, at least 1.
    pub triangles: u32,
    /// Of [`MethodKind::Rays`].
    pub rays: Option<MethodCalibration>,
    /// Of [`MethodKind::Splats`].
    pub splats: Option<MethodCalibration>,
    /// Of [`MethodKind::Obscurance`].
    pub obscurance: Option<MethodCalibration>,
}

/// What one method took: of the two settings that [`MethodKind::calibrated`] names, the cheap one and the dear one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MethodCalibration {
    /// Time of what all views share, milliseconds, at least 0: of [`RayTracedScene::record`](crate::RayTracedScene::record), or
    /// of the [`Surfelizer`](crate::Surfelizer); 0 for obscurance.
    pub scene_ms: f64,
    /// Time of one view by each of the two settings, milliseconds, at least 0: all that follows the scene.
    pub view_ms: [f64; 2],
    /// How far the picture by the cheap setting is from the picture by the dear setting of [`MethodKind::Rays`], over the pixels
    /// that show surfaces, as the effect's [error](super#errors): units and cones are those of the picture by the dear setting.
    /// At least 0; `None` where it was not measured.
    pub difference: Option<f64>,
    /// The [errors](super#errors) of both settings' pictures, each at least 0, against a reference: the mean of some frames of 64
    /// rays per pixel, [`BouncedSettings::frame`](crate::BouncedSettings::frame) counted up, and 0 for
    /// [`HitResolverSettings::radius`](crate::HitResolverSettings::radius). Skies, bent normals and glossy light need it for
    /// plans that hold: what more rays gain is another share in each scene, which no difference of filtered pictures tells.
    /// `None` where it was not measured.
    pub errors: Option<[f64; 2]>,
}

/// A way to an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MethodKind {
    /// [`RayTracedView`](crate::RayTracedView).
    Rays,
    /// [`ShellSplatter`](crate::ShellSplatter).
    Splats,
    /// [`VolumetricObscurance`](crate::VolumetricObscurance).
    Obscurance,
}

impl MethodKind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Rays, Self::Splats, Self::Obscurance];

    /// The settings of this kind that plans choose among, from the cheapest; none for an effect that the method does not have.
    pub fn rungs(self, effect: &RayTracedEffect) -> Vec<Method> {
        match (self, effect) {
            (Self::Rays, effect) => {
                let rungs = &RAYS[fewest(effect)..];
                let rung = |&rays| Method::Rays(in_all(rays, effect));
                rungs.iter().map(rung).collect()
            }
            (
                Self::Splats,
                RayTracedEffect::AmbientOcclusion { radius }
                | RayTracedEffect::DirectionalOcclusion { radius }
                | RayTracedEffect::BentNormals { radius },
            ) => splats(*radius),
            (Self::Splats, RayTracedEffect::IndirectSpecular { .. }) => splats(f32::INFINITY),
            (Self::Obscurance, RayTracedEffect::AmbientOcclusion { radius })
                if radius.is_finite() =>
            {
                [DiskSamples::Six, DiskSamples::Nine, DiskSamples::Thirteen]
                    .map(|samples| Method::Obscurance {
                        descriptor: VolumetricObscuranceDescriptor {
                            sampling: ObscuranceSampling::Lines(samples),
                            volume: ObscuranceVolume::Hemisphere,
                        },
                        settings: ObscuranceSettings {
                            radius: *radius,
                            ..ObscuranceSettings::default()
                        },
                    })
                    .into()
            }
            _ => Vec::new(),
        }
    }

    /// Those of the [rungs](Self::rungs) that a calibration renders: a cheap one and the dearest.
    pub fn calibrated(self, effect: &RayTracedEffect) -> Option<[Method; 2]> {
        let rungs = self.rungs(effect);
        let cheap = *rungs.get(self.cheap(effect))?;
        Some([cheap, *rungs.last()?])
    }

    /// Which rung the cheap one is.
    pub(super) fn cheap(self, effect: &RayTracedEffect) -> usize {
        match self {
            // Fewer rays are noise, which says little about the scene.
            Self::Rays => 2 - fewest(effect),
            Self::Splats | Self::Obscurance => 0,
        }
    }
}

/// Which number of rays an effect begins with: of a sky with a sun one ray alone says nothing, and of a mean direction two.
fn fewest(effect: &RayTracedEffect) -> usize {
    match effect {
        RayTracedEffect::DirectionalOcclusion { .. } => 1,
        RayTracedEffect::BentNormals { .. } => 2,
        _ => 0,
    }
}

/// So many rays per pixel in all, as suits an effect.
fn in_all(rays: u32, effect: &RayTracedEffect) -> RaySettings {
    let payload = effect.payload();
    let glossy = matches!(effect, RayTracedEffect::IndirectSpecular { .. });
    // Fewer rays do not tell where noise is.
    let settings = if glossy && rays >= 8 {
        RaySettings::with_further(rays / 2, (rays / 2) as f32, payload)
    } else {
        RaySettings::new(rays, payload)
    };
    effect.suited(settings)
}

fn splats(radius: f32) -> Vec<Method> {
    Quality::ALL
        .map(|quality| Method::Splats(quality.splats(radius)))
        .into()
}

impl Calibration {
    /// Of one method.
    pub(super) fn of(&self, kind: MethodKind) -> Option<&MethodCalibration> {
        match kind {
            MethodKind::Rays => self.rays.as_ref(),
            MethodKind::Splats => self.splats.as_ref(),
            MethodKind::Obscurance => self.obscurance.as_ref(),
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        for side in self.size {
            check_setting(side > 0, "Calibration::size", side, "at least 1 x 1")?;
        }
        check_setting(
            self.triangles > 0,
            "Calibration::triangles",
            f64::from(self.triangles),
            "at least 1",
        )?;
        let known = MethodKind::ALL.map(|kind| self.of(kind));
        for method in known.into_iter().flatten() {
            for (field, value) in [
                ("MethodCalibration::scene_ms", method.scene_ms),
                ("MethodCalibration::view_ms", method.view_ms[0]),
                ("MethodCalibration::view_ms", method.view_ms[1]),
                (
                    "MethodCalibration::difference",
                    method.difference.unwrap_or(0.0),
                ),
                (
                    "MethodCalibration::errors",
                    method.errors.map_or(0.0, |errors| errors[0]),
                ),
                (
                    "MethodCalibration::errors",
                    method.errors.map_or(0.0, |errors| errors[1]),
                ),
            ] {
                check_setting(
                    value.is_finite() && value >= 0.0,
                    field,
                    value,
                    "at least 0, and finite",
                )?;
            }
        }
        Ok(())
    }
}

//! Which method and settings meet an error, or a time.
//!
//! Errors follow curves that `cargo bench --bench trade` measured on the crate's scenes. How steeply they fall is nearly the same
//! everywhere, how high they begin is not: a [`Calibration`] of one's own scene tells that, by the difference of two pictures.
//! Times follow what the same pictures took on the device.
//!
//! # Example
//!
//! ```no_run
//! use deep_screen_space::{
//!     Error, RayTracedEffect,
//!     planner::{Budget, Calibration, Method, PlanRequest, SceneCounts, plan},
//!     wgpu,
//! };
//!
//! /// How many rays per pixel indirect light takes for a root mean square error of a fifth of its mean.
//! fn rays_for(device: &wgpu::Device, calibration: &Calibration) -> Result<Option<u32>, Error> {
//!     let plan = plan(&PlanRequest {
//!         limits: &device.limits(),
//!         size: [1920, 1080],
//!         scene: SceneCounts::once(300_000),
//!         effect: RayTracedEffect::IndirectDiffuse { sky_radiance: [0.0; 3] },
//!         budget: Budget::Error(0.2),
//!         calibration: Some(calibration),
//!     })?;
//!     // A table of what was weighed, and why the chosen one was.
//!     println!("{plan}");
//!     Ok(match plan.chosen.method {
//!         Method::Rays(rays) => Some(rays.rays_per_pixel),
//!         _ => None,
//!     })
//! }
//! ```
//!
//! `examples/plan.rs` measures a calibration and prints a plan.
//!
//! # Errors
//!
//! What an error is depends on the effect:
//!
//! * of [`AmbientOcclusion`](RayTracedEffect::AmbientOcclusion) the root mean square of visibility, 0 to 1;
//! * of [`DirectionalOcclusion`](RayTracedEffect::DirectionalOcclusion), [`IndirectDiffuse`](RayTracedEffect::IndirectDiffuse)
//!   and [`IndirectSpecular`](RayTracedEffect::IndirectSpecular) the root mean square of luminance, in units of its mean;
//! * of [`BentNormals`](RayTracedEffect::BentNormals) the mean angle in degrees, over the pixels whose
//!   [cone](crate::HitResolver::cone_angle) is narrower than 60°.
//!
//! Skies, bent normals and glossy light need [`MethodCalibration::errors`] for plans that hold. Plans for glossy light are the
//! least sure: scenes differ more than one curve can say, and rough surfaces have the curve of smooth ones.

mod adaptive;
mod calibration;
mod curves;
mod expected;
mod table;
#[cfg(test)]
mod tests;

use wgpu::Limits;

pub use adaptive::{AdaptiveQuality, AdaptiveSettings};
pub use calibration::{Calibration, MethodCalibration, MethodKind};

use crate::{
    bvh::Primitives,
    error::{Error, check_setting},
    ray_traced::{
        quality::{Quality, RaySettings, SplatQuality},
        view::RayTracedEffect,
    },
    volumetric_obscurance::{VolumetricObscuranceDescriptor, settings::ObscuranceSettings},
};
use expected::{candidates, piece_bytes, primitives_for, too_many_pixels};

/// Of what is predicted, the error of nine settings out of ten is at most this, in a scene that no curve was measured in.
const MARGIN: f64 = 1.25;

/// What a plan is asked for.
#[derive(Clone, Copy, Debug)]
pub struct PlanRequest<'a> {
    /// The device's limits.
    pub limits: &'a Limits,
    /// Width and height of the picture, pixels, each at least 1.
    pub size: [u32; 2],
    /// What the scene has.
    pub scene: SceneCounts,
    /// The effect.
    pub effect: RayTracedEffect,
    /// What has to be met.
    pub budget: Budget,
    /// What is known of the device and the scene. Without it errors are those of the crate's own scenes in the mean, which may
    /// be twice or half those of another, and there are no times.
    pub calibration: Option<&'a Calibration>,
}

/// What a scene has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneCounts {
    /// Triangles of all instances.
    pub triangles: u64,
    /// Triangles of the meshes that they are instances of.
    pub mesh_triangles: u64,
    /// Instances.
    pub instances: u64,
}

impl SceneCounts {
    /// Meshes that stand once each.
    pub fn once(triangles: u64) -> Self {
        Self {
            triangles,
            mesh_triangles: triangles,
            instances: 1,
        }
    }
}

/// What a plan has to meet. The cheapest rung that does is chosen, or of a time the most exact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// The largest [error](self#errors), above 0. What is predicted for the setting that is chosen is a fifth less, so that nine
    /// plans of ten hold.
    Error(f64),
    /// The longest time of the scene's recording and one view's together, milliseconds, above 0. Needs a calibration.
    Milliseconds(f64),
    /// Rays of this quality.
    Quality(Quality),
}

/// A method with its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// [`RayTracedView`](crate::RayTracedView).
    Rays(RaySettings),
    /// [`ShellSplatter`](crate::ShellSplatter), of the effect's own name: [`AmbientOcclusion`](crate::AmbientOcclusion),
    /// [`DirectionalOcclusion`](crate::DirectionalOcclusion), [`BentNormals`](crate::BentNormals) or, for glossy light,
    /// [`SpecularBounce`](crate::SpecularBounce), each by default.
    Splats(SplatQuality),
    /// [`VolumetricObscurance`](crate::VolumetricObscurance).
    Obscurance {
        /// How it samples.
        descriptor: VolumetricObscuranceDescriptor,
        /// Its settings.
        settings: ObscuranceSettings,
    },
}

/// What to do, and what was weighed.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// What was chosen.
    pub chosen: Candidate,
    /// What rays should meet, where they were chosen: one level of triangles, or instances where those do not fit.
    pub primitives: Primitives,
    /// By which factor the budget is missed where nothing meets it, above 1: of the error or of the time.
    pub misses_by: Option<f64>,
    /// All that was weighed, by method and then from the cheapest.
    pub weighed: Vec<Candidate>,
}

/// One method and setting, and what is expected of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// The method.
    pub method: Method,
    /// The [error](self#errors).
    pub error: f64,
    /// Time of the scene's recording and one view's, milliseconds, where a calibration knows the method.
    pub milliseconds: Option<f64>,
    /// Memory on the GPU for the scene and one view, bytes.
    pub memory_bytes: u64,
    /// Why it can not be had, if it can not.
    pub refused: Option<String>,
}

/// Chooses a method and its settings.
///
/// Nothing is recorded or submitted. A budget that nothing can meet gets what comes nearest, and [`Plan::misses_by`] says how
/// near.
///
/// # Errors
/// [`Error::Setting`] for a size, a budget or a calibration out of range, and for a time without a calibration; [`Error::Limit`]
/// for a size that no texture has, and where the device has room for no method.
pub fn plan(request: &PlanRequest<'_>) -> Result<Plan, Error> {
    check(request)?;
    let curves = match request.effect {
        RayTracedEffect::AmbientOcclusion { radius } if radius.is_finite() => curves::WITHIN_RADIUS,
        RayTracedEffect::AmbientOcclusion { .. } => curves::UNBOUNDED,
        RayTracedEffect::DirectionalOcclusion { .. } => curves::SKY,
        RayTracedEffect::BentNormals { .. } => curves::BENT,
        RayTracedEffect::IndirectDiffuse { .. } => curves::LIGHT,
        RayTracedEffect::IndirectSpecular { .. } => curves::GLOSSY,
    };
    let (primitives, refused) = primitives_for(request);
    let mut weighed = Vec::new();
    for kind in MethodKind::ALL {
        if let Some(curve) = curves.of(kind) {
            let rungs = match (kind, request.budget) {
                (MethodKind::Rays, Budget::Quality(quality)) => {
                    vec![Method::Rays(request.effect.rays(quality))]
                }
                (_, Budget::Quality(_)) => Vec::new(),
                _ => kind.rungs(&request.effect),
            };
            weighed.extend(candidates(
                request,
                (kind, &rungs),
                &curve,
                (primitives, refused.as_ref()),
            ));
        }
    }
    let possible: Vec<&Candidate> = weighed.iter().filter(|c| c.refused.is_none()).collect();
    let Some((chosen, misses_by)) = choose(request, &possible) else {
        let too_many = weighed
            .iter()
            .find_map(|c| too_many_pixels(request, &c.method));
        return Err(refused.or(too_many).unwrap_or(Error::Limit {
            limit: "max_storage_buffer_binding_size",
            available: request.limits.max_storage_buffer_binding_size,
            needed: piece_bytes(request.scene.triangles),
            why: "what surfels are made of",
        }));
    };
    Ok(Plan {
        chosen: chosen.clone(),
        primitives,
        misses_by,
        weighed,
    })
}

fn check(request: &PlanRequest<'_>) -> Result<(), Error> {
    for side in request.size {
        check_setting(side > 0, "PlanRequest::size", side, "at least 1 x 1")?;
        let most = request.limits.max_texture_dimension_2d;
        if side > most {
            return Err(Error::Limit {
                limit: "max_texture_dimension_2d",
                available: most.into(),
                needed: side.into(),
                why: "PlanRequest::size",
            });
        }
    }
    let bounded = match request.effect {
        RayTracedEffect::AmbientOcclusion { radius } => {
            Some(("RayTracedEffect::AmbientOcclusion::radius", radius))
        }
        RayTracedEffect::DirectionalOcclusion { radius } => {
            Some(("RayTracedEffect::DirectionalOcclusion::radius", radius))
        }
        RayTracedEffect::BentNormals { radius } => {
            Some(("RayTracedEffect::BentNormals::radius", radius))
        }
        RayTracedEffect::IndirectDiffuse { .. } | RayTracedEffect::IndirectSpecular { .. } => None,
    };
    if let Some((field, radius)) = bounded {
        check_setting(radius >= 0.0, field, radius, "0 to infinity")?;
    }
    if let Some(calibration) = request.calibration {
        calibration.validate()?;
    }
    match request.budget {
        Budget::Error(error) => {
            check_setting(error > 0.0, "Budget::Error", error, "above 0, to infinity")
        }
        Budget::Milliseconds(time) => {
            check_setting(
                time > 0.0,
                "Budget::Milliseconds",
                time,
                "above 0, to infinity",
            )?;
            let known = |kind| request.calibration.and_then(|c| c.of(kind)).is_some();
            check_setting(
                MethodKind::ALL.into_iter().any(known),
                "Budget::Milliseconds",
                time,
                "only with a calibration of a method",
            )
        }
        Budget::Quality(_) => Ok(()),
    }
}

impl Method {
    /// The kind of it.
    pub fn kind(&self) -> MethodKind {
        match self {
            Self::Rays(_) => MethodKind::Rays,
            Self::Splats(_) => MethodKind::Splats,
            Self::Obscurance { .. } => MethodKind::Obscurance,
        }
    }
}

/// What meets the budget, or comes nearest, and by how much it misses.
fn choose<'c>(
    request: &PlanRequest<'_>,
    possible: &[&'c Candidate],
) -> Option<(&'c Candidate, Option<f64>)> {
    let least = |all: &mut dyn Iterator<Item = &'c Candidate>, of: &dyn Fn(&Candidate) -> f64| {
        all.min_by(|a, b| of(a).total_cmp(&of(b)))
    };
    let all = || possible.iter().copied();
    let error = |c: &Candidate| c.error;
    // Without times the order of the methods says which are cheap, and a method's own order.
    let unknown = possible.iter().any(|c| c.milliseconds.is_none());
    let time = |c: &Candidate| c.milliseconds.unwrap_or(f64::INFINITY);
    let cost = |c: &Candidate| {
        if unknown {
            let kind = match c.method.kind() {
                MethodKind::Obscurance => 0.0,
                MethodKind::Splats => 1e3,
                MethodKind::Rays => 2e3,
            };
            kind + c.method.work()
        } else {
            time(c)
        }
    };
    match request.budget {
        Budget::Error(most) => {
            let found = least(&mut all().filter(|c| c.error * MARGIN <= most), &cost);
            found.map(|found| (found, None)).or_else(|| {
                let nearest = least(&mut all(), &error)?;
                let misses = nearest.error / most;
                Some((nearest, (misses > 1.0).then_some(misses)))
            })
        }
        Budget::Milliseconds(most) => {
            let found = least(&mut all().filter(|c| time(c) <= most), &error);
            found.map(|found| (found, None)).or_else(|| {
                let nearest = least(&mut all(), &time)?;
                Some((nearest, Some(time(nearest) / most)))
            })
        }
        // There is one.
        Budget::Quality(_) => all().next().map(|found| (found, None)),
    }
}

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

mod adaptive;
mod calibration;
mod curves;
#[cfg(test)]
mod tests;

use std::fmt;

use wgpu::Limits;

pub use adaptive::{AdaptiveQuality, AdaptiveSettings};
pub use calibration::{Calibration, MethodCalibration, MethodKind};

use crate::{
    bvh::Primitives,
    error::{Error, check_setting},
    instanced_bvh::INSTANCE_BYTES,
    ray_traced::{
        quality::{Quality, RaySettings, SplatQuality},
        view::RayTracedEffect,
    },
    surfel::{CloudCapacity, Piece},
    volumetric_obscurance::{VolumetricObscuranceDescriptor, settings::ObscuranceSettings},
};
use curves::{Curve, Curves};

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
    /// The largest root mean square error, above 0: of visibility, 0 to 1; of light in units of its mean. What is predicted for
    /// the setting that is chosen is a fifth less, so that nine plans of ten hold.
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
    /// [`ShellSplatter`](crate::ShellSplatter).
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
    /// Root mean square error: of visibility, 0 to 1; of light in units of its mean.
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
/// [`Error::Setting`] for a size, a budget or a calibration out of range, for an effect that no curve is of, and for a time
/// without a calibration; [`Error::Limit`] where the device has room for no method.
pub fn plan(request: &PlanRequest<'_>) -> Result<Plan, Error> {
    check(request)?;
    let curves = match request.effect {
        RayTracedEffect::AmbientOcclusion { radius } if radius.is_finite() => curves::WITHIN_RADIUS,
        RayTracedEffect::AmbientOcclusion { .. } => curves::UNBOUNDED,
        _ => curves::LIGHT,
    };
    let (primitives, refused) = primitives_for(request);
    let mut weighed = Vec::new();
    for kind in MethodKind::ALL {
        if let Some(curve) = curve_of(&curves, kind) {
            let rungs = match (kind, request.budget) {
                (MethodKind::Rays, Budget::Quality(quality)) => {
                    vec![Method::Rays(quality.rays(request.effect.payload()))]
                }
                (_, Budget::Quality(_)) => Vec::new(),
                _ => kind.rungs(&request.effect),
            };
            weighed.extend(candidates(
                request,
                (kind, &rungs),
                &curve,
                (primitives, &refused),
            ));
        }
    }
    let possible: Vec<&Candidate> = weighed.iter().filter(|c| c.refused.is_none()).collect();
    let (chosen, misses_by) = choose(request, &possible).ok_or(Error::Limit {
        limit: "max_storage_buffer_binding_size",
        available: request.limits.max_storage_buffer_binding_size,
        needed: request
            .scene
            .mesh_triangles
            .saturating_mul(size_of::<Piece>() as u64),
        why: "what rays meet",
    })?;
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
    }
    let measured = match request.effect {
        RayTracedEffect::AmbientOcclusion { radius } => {
            check_setting(
                radius >= 0.0,
                "RayTracedEffect::AmbientOcclusion::radius",
                radius,
                "0 to infinity",
            )?;
            true
        }
        effect => matches!(effect, RayTracedEffect::IndirectDiffuse { .. }),
    };
    check_setting(
        measured,
        "PlanRequest::effect",
        f64::from(u8::from(measured)),
        "ambient occlusion and indirect diffuse light, whose errors were measured",
    )?;
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

fn curve_of(curves: &Curves, kind: MethodKind) -> Option<Curve> {
    match kind {
        MethodKind::Rays => Some(curves.rays),
        MethodKind::Splats => curves.splats,
        MethodKind::Obscurance => curves.obscurance,
    }
}

/// One level where it fits, since rays traverse it faster.
fn primitives_for(request: &PlanRequest<'_>) -> (Primitives, Option<String>) {
    let most = u64::from(CloudCapacity::largest(request.limits).pieces);
    let SceneCounts {
        triangles,
        mesh_triangles,
        instances,
    } = request.scene;
    if triangles <= most {
        return (Primitives::Triangles, None);
    }
    let most_instances = request.limits.max_storage_buffer_binding_size / INSTANCE_BYTES;
    // Within one texture of triangles, four times what one binding holds.
    let refused = if mesh_triangles > 4 * most {
        Some(format!(
            "{mesh_triangles} triangles of meshes are more than a device has room for"
        ))
    } else if instances > most_instances {
        Some(format!(
            "{instances} instances are more than {most_instances}, which one binding holds"
        ))
    } else {
        None
    };
    (Primitives::Instances, refused)
}

/// Settings of one method, with what is expected of each.
fn candidates(
    request: &PlanRequest<'_>,
    (kind, rungs): (MethodKind, &[Method]),
    curve: &Curve,
    (primitives, refused): (Primitives, &Option<String>),
) -> Vec<Candidate> {
    let calibrated = request.calibration.and_then(|c| Some((c, c.of(kind)?)));
    let first = calibrated
        .and_then(|(_, known)| known.difference)
        .map_or(curve.typical, |difference| difference * curve.of_difference);
    let works: Vec<f64> = kind
        .rungs(&request.effect)
        .iter()
        .map(Method::work)
        .collect();
    let cheap = works.get(kind.cheap()).copied().unwrap_or_default();
    let dear = works.last().copied().unwrap_or_default();
    let candidate = |&method: &Method| Candidate {
        method,
        error: first * curve.at(&works, method.work()),
        milliseconds: calibrated.map(|(calibration, known)| {
            let share = (method.work() - cheap) / (dear - cheap);
            let [low, high] = known.view_ms;
            let scale = Scale::new(request, calibration, kind);
            scale.scene * known.scene_ms + scale.view * (low + share * (high - low)).max(0.0)
        }),
        memory_bytes: memory(request, &method, primitives),
        refused: match kind {
            MethodKind::Rays => refused.clone(),
            MethodKind::Splats if primitives == Primitives::Instances => {
                Some("more triangles than one binding holds".into())
            }
            _ => None,
        },
    };
    rungs.iter().map(candidate).collect()
}

/// How times grow from the calibrated scene and size to those asked for.
struct Scale {
    scene: f64,
    view: f64,
}

impl Scale {
    fn new(request: &PlanRequest<'_>, calibration: &Calibration, kind: MethodKind) -> Self {
        let pixels = |[width, height]: [u32; 2]| f64::from(width) * f64::from(height);
        let asked = request.scene.triangles.max(1) as f64;
        let known = f64::from(calibration.triangles);
        // A ray's way through a tree is as long as the tree is deep.
        let deeper = match kind {
            MethodKind::Rays => (asked + 1.0).log2() / (known + 1.0).log2(),
            MethodKind::Splats | MethodKind::Obscurance => 1.0,
        };
        Self {
            scene: asked / known,
            view: pixels(request.size) / pixels(calibration.size) * deeper,
        }
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

    /// What its time grows with: rays or reads per pixel, or pairs relative to those of `balanced`.
    fn work(&self) -> f64 {
        match self {
            Self::Rays(rays) => rays.all_rays(),
            // Pairs grow with the inverse square of the radius, as far as surfels are larger than triangles.
            Self::Splats(splats) => f64::from(splats.surfelizer.radius_pixels).powi(-1),
            Self::Obscurance { descriptor, .. } => f64::from(descriptor.sampling.samples()),
        }
    }
}

/// What the objects of a method own. In floats, since no count is too large for them; an integer of them saturates.
fn memory(request: &PlanRequest<'_>, method: &Method, primitives: Primitives) -> u64 {
    let [width, height] = request.size.map(f64::from);
    let pixels = width * height;
    let SceneCounts {
        triangles,
        mesh_triangles,
        instances,
    } = request.scene;
    let [triangles, mesh_triangles, instances] =
        [triangles, mesh_triangles, instances].map(|count| count as f64);
    let bytes = match method {
        Method::Rays(rays) => {
            let scene = match primitives {
                // A quarter more room than there are triangles.
                Primitives::Triangles => 1.25 * (151.0 + 52.0 + 4.0) * triangles,
                _ => (79.0 + 123.0) * mesh_triangles + 1.25 * 312.0 * instances,
            };
            let hits = if request.effect.payload().is_radiance() {
                4 + 4 * rays.rays_per_pixel
            } else {
                4 + 4 * rays.rays_per_pixel.div_ceil(32)
            };
            let further = if rays.further.is_some() { 29.0 } else { 0.0 };
            scene + pixels * (16.0 + f64::from(hits) + 20.0 + further)
        }
        Method::Splats(splats) => {
            let radius = f64::from(splats.surfelizer.radius_pixels);
            // About as many surfels as there are disks of that radius in the picture, on each side of what is seen.
            let surfels = 4.0 * pixels / (radius * radius) + triangles;
            let levels = f64::from(splats.splat.levels);
            (32.0 + 2.0 * levels) * surfels + 56.0 * triangles + pixels * (16.0 + 8.0 * levels)
        }
        Method::Obscurance { .. } => 0.0,
    };
    bytes as u64
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

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rays(rays) => write!(f, "{} rays per pixel", rays.all_rays()),
            Self::Splats(splats) => {
                write!(f, "surfels of {} pixels", splats.surfelizer.radius_pixels)
            }
            Self::Obscurance { descriptor, .. } => {
                write!(
                    f,
                    "obscurance, {} reads per pixel",
                    descriptor.sampling.samples()
                )
            }
        }
    }
}

/// A table of what was weighed.
impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for candidate in &self.weighed {
            let mark = if *candidate == self.chosen { '>' } else { ' ' };
            let time = candidate
                .milliseconds
                .map_or_else(|| "-".into(), |time| format!("{time:.2} ms"));
            let megabytes = candidate.memory_bytes as f64 / 1e6;
            let refused = candidate.refused.as_deref().unwrap_or_default();
            let Candidate { method, error, .. } = candidate;
            let method = method.to_string();
            writeln!(
                f,
                "{mark} {method:32} {error:8.4} {time:>12} {megabytes:9.1} MB {refused}"
            )?;
        }
        match self.misses_by {
            Some(factor) => writeln!(
                f,
                "nothing meets the budget: it is missed by a factor of {factor:.2}"
            ),
            None => Ok(()),
        }
    }
}

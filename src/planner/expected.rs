//! What is expected of a method and its settings: error, time and memory.

use super::{Calibration, Candidate, Method, MethodKind, PlanRequest, SceneCounts, curves::Curve};
use crate::{
    SurfelRadiance,
    bounced_z_buffer::{descriptor::BouncedDescriptor, params::pixel_rays_bytes},
    bvh::Primitives,
    error::Error,
    instanced_bvh::INSTANCE_BYTES,
    ray_traced::{quality::RaySettings, view::RayTracedEffect},
    surfel::{CloudCapacity, Piece},
};

/// What so many triangles take in the binding that holds the most for each.
pub(super) fn piece_bytes(triangles: u64) -> u64 {
    triangles.saturating_mul(size_of::<Piece>() as u64)
}

/// One level where it fits, since rays traverse it faster; and why there is no room for what rays meet, if there is none.
pub(super) fn primitives_for(request: &PlanRequest<'_>) -> (Primitives, Option<Error>) {
    let most = u64::from(CloudCapacity::largest(request.limits).pieces);
    let SceneCounts {
        triangles,
        mesh_triangles,
        instances,
    } = request.scene;
    if triangles <= most {
        return (Primitives::Triangles, None);
    }
    let available = request.limits.max_storage_buffer_binding_size;
    let refused = |needed, why| Error::Limit {
        limit: "max_storage_buffer_binding_size",
        available,
        needed,
        why,
    };
    // Within one texture of triangles, four times what one binding holds.
    let refused = if mesh_triangles > 4 * most {
        let needed = piece_bytes(mesh_triangles.div_ceil(4));
        Some(refused(needed, "a quarter of the meshes' triangles"))
    } else if instances > available / INSTANCE_BYTES {
        let needed = instances.saturating_mul(INSTANCE_BYTES);
        Some(refused(needed, "instances"))
    } else {
        None
    };
    (Primitives::Instances, refused)
}

/// Why rays have no room for what is counted of them at each pixel, if they have none.
pub(super) fn too_many_pixels(request: &PlanRequest<'_>, method: &Method) -> Option<Error> {
    let Method::Rays(rays) = method else {
        return None;
    };
    let [width, height] = request.size.map(u64::from);
    let available = request.limits.max_storage_buffer_binding_size;
    let needed = counted_bytes(&request.effect, rays) * width * height;
    (needed > available).then_some(Error::Limit {
        limit: "max_storage_buffer_binding_size",
        available,
        needed,
        why: "rays of pixels, where further ones go to some",
    })
}

/// Of each pixel, in one binding.
fn counted_bytes(effect: &RayTracedEffect, rays: &RaySettings) -> u64 {
    rays.further.map_or(0, |_| {
        pixel_rays_bytes(&BouncedDescriptor {
            payload: effect.payload(),
            sampling: effect.sampling(),
            ..BouncedDescriptor::default()
        })
    })
}

/// Settings of one method, with what is expected of each.
pub(super) fn candidates(
    request: &PlanRequest<'_>,
    (kind, rungs): (MethodKind, &[Method]),
    curve: &Curve,
    (primitives, refused): (Primitives, Option<&Error>),
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
    let cheap = works.get(kind.cheap(&request.effect));
    let cheap = cheap.copied().unwrap_or_default();
    let dear = works.last().copied().unwrap_or_default();
    let candidate = |&method: &Method| Candidate {
        method,
        error: match calibrated.and_then(|(_, known)| known.errors) {
            Some(errors) => curve.through(errors, &works, method.work()),
            None => first * curve.at(&works, method.work()),
        },
        milliseconds: calibrated.map(|(calibration, known)| {
            let share = (method.work() - cheap) / (dear - cheap);
            let [low, high] = known.view_ms;
            let scale = Scale::new(request, calibration, kind);
            scale.scene * known.scene_ms + scale.view * (low + share * (high - low)).max(0.0)
        }),
        memory_bytes: memory(request, &method, primitives),
        refused: match kind {
            MethodKind::Rays => refused
                .map(Error::to_string)
                .or_else(|| too_many_pixels(request, &method).map(|e| e.to_string())),
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
    /// What its time grows with: rays or reads per pixel, or pairs relative to those of `balanced`.
    pub(super) fn work(&self) -> f64 {
        match self {
            Self::Rays(rays) => rays.all_rays(),
            // Pairs grow with the inverse square of the radius, as far as surfels are larger than triangles.
            Self::Splats(splats) => f64::from(splats.surfelizer.radius_pixels).powi(-1),
            Self::Obscurance { descriptor, .. } => f64::from(descriptor.sampling.samples()),
        }
    }
}

/// What a pixel of a level of splats takes.
fn channel_bytes(effect: &RayTracedEffect) -> f64 {
    match effect {
        RayTracedEffect::AmbientOcclusion { .. } => 4.0,
        _ => 16.0,
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
            let further = match counted_bytes(&request.effect, rays) {
                0 => 0.0,
                counted => 12.5 + counted as f64,
            };
            scene + pixels * (16.0 + f64::from(hits) + 20.0 + further)
        }
        Method::Splats(splats) => {
            let radius = f64::from(splats.surfelizer.radius_pixels);
            // About as many surfels as there are disks of that radius in the picture, on each side of what is seen.
            let surfels = 4.0 * pixels / (radius * radius) + triangles;
            let levels = f64::from(splats.splat.levels);
            // A level of the view and one of the filter.
            let level = 2.0 * channel_bytes(&request.effect);
            // What surfels send, and what hides lights from them.
            let lit = match request.effect {
                RayTracedEffect::IndirectSpecular { .. } => {
                    size_of::<SurfelRadiance>() as f64 * surfels + 151.0 * triangles
                }
                _ => 0.0,
            };
            (32.0 + 2.0 * levels) * surfels
                + 56.0 * triangles
                + lit
                + pixels * (16.0 + level * levels)
        }
        Method::Obscurance { .. } => 0.0,
    };
    bytes as u64
}

//! Mirror of `wgsl/bounced_z_buffer.wgsl` and `wgsl/common/bvh_traverse.wgsl`: each ray against every piece, without
//! the hierarchy, which skips only what it misses.
//!
//! Where two pieces meet, f32 may find the other one of the two, or find its way between an edge and what lies behind.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use super::{
    directions::{Direction, directions, further_point, hemisphere_direction, strewn_point},
    environment::{Cells, Sample},
    light::arrival,
    packing::pack_color,
    shell_splatter::Receiver,
    surfel_shader::{BRIGHTEST, own_radiosity, sanitize},
    surfelizer::{Piece, Triangle, leaf_at, nearest_room},
};
use crate::{
    BouncedSettings, Camera, CloudCapacity, Light, Material, Sampling, SurfelCounts,
    SurfelRadiance,
    bounced_z_buffer::{params::grid, words},
    environment::params::cosine_rays,
};

/// Stands for infinity.
pub(super) const FAR: f64 = 1e18;
pub(super) const POSITION_TOLERANCE: f64 = 1e-6;
const GRID: f64 = 1.0 / 32.0;
const MOST_OFFSET: f64 = 1e-3;
const SHAPE_ORDER: u32 = 0xfff;
/// What a hit within a pixel's side adds to nearness.
pub(super) const NEAREST: f64 = 16_777_216.0;

/// A ray in the cloud's space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// A unit vector.
    pub direction: DVec3,
    /// What it leaves, if it is a pixel's.
    pub left: Option<Left>,
}

/// The surface that a pixel's ray leaves, which does not shine on itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Left {
    /// The pixel's unit normal.
    pub normal: DVec3,
    /// How high above the surface the ray starts, at most.
    pub height: f64,
}

const OWN_COSINE: f64 = 0.25;

impl Ray {
    /// A pixel's; the receiver is relative to the cloud's `origin`.
    pub fn of_pixel(
        camera: &Camera,
        origin: DVec3,
        Receiver { position, normal }: Receiver,
        direction: DVec3,
    ) -> Self {
        Self {
            origin: offset_origin(camera, origin, position, normal),
            direction,
            left: Some(Left {
                normal,
                height: 2.5 * offset_at(camera, origin, position),
            }),
        }
    }

    /// Whether a hit is on the surface that it left; `side` is the unit normal of the side that is met.
    pub(super) fn is_own(&self, t: f64, side: DVec3) -> bool {
        self.left.is_some_and(|left| {
            left.normal.dot(side) > OWN_COSINE && -t * self.direction.dot(side) <= left.height
        })
    }
}

/// The side of a piece that a direction meets, as a unit vector.
pub(super) fn side_met(t: &Triangle, direction: DVec3) -> DVec3 {
    let normal = (t.b - t.a).cross(t.c - t.a).normalize_or(-direction);
    if normal.dot(direction) < 0.0 {
        normal
    } else {
        -normal
    }
}

/// What a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance.
    pub t: f64,
    /// Index of the piece.
    pub piece: usize,
}

/// How far a ray starts off what it leaves.
pub fn ray_epsilon(position: DVec3) -> f64 {
    4.0 * POSITION_TOLERANCE * position.abs().max_element()
}

/// How far a pixel's rays start off it, along its normal and to where it is seen from; `position` is relative to the cloud's
/// `origin`.
pub fn offset_at(camera: &Camera, origin: DVec3, position: DVec3) -> f64 {
    let relative = position - (camera.eye() - origin);
    let grid = (GRID * camera.footprint().at(relative)).min(MOST_OFFSET * relative.length());
    ray_epsilon(position) + grid
}

/// Where a pixel's rays start; `side` is its unit normal.
pub fn offset_origin(camera: &Camera, origin: DVec3, position: DVec3, side: DVec3) -> DVec3 {
    let seen_from = to_camera(camera, origin, position);
    position + (side + seen_from) * offset_at(camera, origin, position)
}

/// Unit vector from a point to where a camera sees it from, both relative to the cloud's `origin`.
pub fn to_camera(camera: &Camera, origin: DVec3, point: DVec3) -> DVec3 {
    if camera.footprint().perspective {
        (camera.eye() - origin - point).normalize_or(DVec3::Z)
    } else {
        camera.rotation().row(2)
    }
}

/// Where a ray meets a triangle, from either side (Möller and Trumbore 1997).
///
/// `end_size` is the size of the coordinates of the light that the ray ends at, if it does: a triangle that the light lies
/// on is met beyond it.
pub fn meet(ray: &Ray, triangle: &Triangle, end_size: Option<f64>) -> Option<f64> {
    meet_at(ray, triangle, end_size).map(|(t, _)| t)
}

/// The same, with weights of the triangle's second and third corner.
pub(super) fn meet_at(
    ray: &Ray,
    triangle: &Triangle,
    end_size: Option<f64>,
) -> Option<(f64, [f64; 2])> {
    let a = triangle.a;
    let e1 = triangle.b - a;
    let e2 = triangle.c - a;
    let d = ray.direction;
    let p = d.cross(e2);
    let det = e1.dot(p);
    let s = ray.origin - a;
    let q = s.cross(e1);
    let per_det = 1.0 / det;
    let u = s.dot(p) * per_det;
    let v = d.dot(q) * per_det;
    let ahead = e2.dot(q) * per_det;
    let mut t = ahead;
    let size = e1.abs().max_element() + e2.abs().max_element();
    let reach = a.abs().max_element() + ray.origin.abs().max_element();
    let slack = POSITION_TOLERANCE * reach * size * per_det.abs();
    if let Some(end_size) = end_size {
        let across = 1.732_050_8 * e1.cross(e2).abs().max_element();
        t += POSITION_TOLERANCE * (reach + end_size) * across * per_det.abs();
    }
    let inside =
        u >= -slack && v >= -slack && u + v <= 1.0 + slack && ahead > 0.0 && det.abs() > 1e-35;
    inside.then_some((t, [u, v]))
}

/// The nearest hit closer than `t_max`.
pub fn nearest(ray: &Ray, pieces: &[Piece], t_max: f64) -> Option<Hit> {
    traverse(ray, None, pieces, t_max, |_, _| true)
}

/// Whether a light reaches a point off a surface.
pub fn unshadowed(point: DVec3, light: &Light, pieces: &[Piece]) -> bool {
    unshadowed_where(point, light, pieces, |_, _| true)
}

/// The same among pieces that are where `is_there` says.
pub(super) fn unshadowed_where(
    point: DVec3,
    light: &Light,
    pieces: &[Piece],
    is_there: impl Fn(usize, [f64; 2]) -> bool,
) -> bool {
    let way = arrival(light, point);
    let ray = Ray {
        origin: point,
        direction: way.to_light,
        left: None,
    };
    let t_max = way.distance.min(FAR);
    traverse(&ray, end_size_of(light), pieces, t_max, is_there).is_none()
}

/// The size of the coordinates of a light that rays end at.
pub(super) fn end_size_of(light: &Light) -> Option<f64> {
    match light {
        Light::Directional { .. } => None,
        Light::Point { position, .. } | Light::Spot { position, .. } => {
            Some(position.abs().max_element())
        }
    }
}

/// What a surface that a ray meets at a distance sends back along it. `normal` is along its normal, and `reaches` tells whether
/// a light reaches a point off it.
pub(super) fn lit_surface(
    (ray, t): (&Ray, f64),
    normal: DVec3,
    material: &Material,
    lights: &[Light],
    reaches: impl Fn(DVec3, &Light) -> bool,
) -> DVec3 {
    let normal = normal.normalize_or(-ray.direction);
    let facing = normal.dot(ray.direction) < 0.0;
    let side = if facing { normal } else { -normal };
    if ray.is_own(t, side) {
        return DVec3::ZERO;
    }
    let place = ray.origin + ray.direction * t;
    let offset = ray_epsilon(place).max(ray_epsilon(ray.origin));
    let point = place + (side - ray.direction) * offset;
    let mut irradiance = DVec3::ZERO;
    for light in lights {
        let arrival = arrival(light, place);
        let cosine = side.dot(arrival.to_light);
        if cosine > 0.0 && reaches(point, light) {
            irradiance += arrival.irradiance * cosine;
        }
    }
    let own = own_radiosity(material, facing);
    ((own + sanitize(material.albedo) * irradiance) / PI).min(DVec3::splat(BRIGHTEST))
}

/// The nearest hit of a piece that is there, at a place that weights of its second and third corner say.
pub(super) fn traverse(
    ray: &Ray,
    end_size: Option<f64>,
    pieces: &[Piece],
    t_max: f64,
    is_there: impl Fn(usize, [f64; 2]) -> bool,
) -> Option<Hit> {
    let mut hit = None;
    let mut closest = t_max;
    for (piece, candidate) in pieces.iter().enumerate() {
        if let Some((t, place)) = meet_at(ray, &candidate.corners, end_size)
            && t < closest
            && is_there(piece, place)
        {
            closest = t;
            hit = Some(Hit { t, piece });
        }
    }
    hit
}

/// What the surfels of a cloud send.
#[derive(Clone, Copy, Debug)]
pub struct Senders<'a> {
    /// The cloud's counters.
    pub counts: SurfelCounts,
    /// Its capacity.
    pub capacity: CloudCapacity,
    /// As [`BouncedInput::radiance`](crate::BouncedInput::radiance).
    pub radiance: &'a [SurfelRadiance],
}

/// The first surfel of each piece.
fn surfel_offsets(pieces: &[Piece]) -> Vec<u32> {
    let mut surfels = 0_u32;
    let first = |piece: &Piece| {
        let first = surfels;
        surfels = surfels.saturating_add(1 << (piece.shape & SHAPE_ORDER));
        first
    };
    pieces.iter().map(first).collect()
}

/// How many rays a pixel had, as [`BouncedView::counts`](crate::BouncedView::counts).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelRays {
    /// The sum of what came along rays of further sets: radiance, or 1 for each that nothing blocked.
    pub sum: DVec3,
    /// Of all sets.
    pub rays: u32,
}

/// A view's rays and what they are traced against.
#[derive(Clone, Copy, Debug)]
pub struct Tracing<'a> {
    /// The pixels of the viewport, rows from the top; `None` for the sky.
    pub receivers: &'a [Option<Receiver>],
    /// What they were seen with.
    pub camera: &'a Camera,
    /// The cloud's origin.
    pub origin: DVec3,
    /// The settings.
    pub settings: &'a BouncedSettings,
    /// How directions are drawn.
    pub sampling: Sampling,
    /// The cloud's pieces.
    pub pieces: &'a [Piece],
}

impl Tracing<'_> {
    /// The rays, in the order of [`directions`].
    pub fn rays(&self) -> Vec<Option<Ray>> {
        let drawn = directions(
            self.receivers,
            self.camera.viewport().width,
            self.settings,
            self.sampling,
        );
        let per_pixel = drawn.len() / self.receivers.len().max(1);
        drawn
            .iter()
            .enumerate()
            .map(|(i, drawn)| {
                let receiver = self.receivers[i / per_pixel]?;
                let Direction { direction, .. } = (*drawn)?;
                Some(Ray::of_pixel(self.camera, self.origin, receiver, direction))
            })
            .collect()
    }

    /// The rays of a pixel's further sets.
    pub fn further_rays(&self, pixel: usize, sets: u32) -> Vec<Ray> {
        let Some(receiver) = self.receivers[pixel] else {
            return Vec::new();
        };
        let width = self.camera.viewport().width;
        let at = [pixel as u32 % width, pixel as u32 / width];
        let grid = grid(self.settings.rays_per_pixel);
        (0..grid[0] * grid[1])
            .flat_map(|index| (1..=sets).map(move |turn| [index, turn]))
            .map(|which| {
                let point = further_point(at, which, grid, self.settings.frame);
                let drawn = hemisphere_direction(point, receiver.normal, self.sampling);
                Ray::of_pixel(self.camera, self.origin, receiver, drawn.direction)
            })
            .collect()
    }

    /// Where a diffuse pixel's ray goes, and what its radiance counts, 0 if it is not to be traced.
    pub fn draw(&self, environment: &Cells, pixel: usize, index: u32) -> Option<(Sample, f64)> {
        let Receiver { normal, .. } = self.receivers[pixel]?;
        let width = self.camera.viewport().width;
        let at = [pixel as u32 % width, pixel as u32 / width];
        let own = cosine_rays(self.settings);
        let all = self.settings.rays_per_pixel;
        let frame = self.settings.frame;
        let toward = if index < own {
            let point = further_point(at, [index, 0], grid(own), frame);
            environment.at(hemisphere_direction(point, normal, Sampling::Cosine).direction)
        } else {
            environment.sample(strewn_point(at, [index - own, 0], all - own, frame))
        };
        let cosine = normal.dot(toward.direction).max(0.0) / PI;
        let [own, all] = [own, all].map(f64::from);
        let others = (all - own) / all * toward.pdf;
        Some((toward, cosine / (own / all * cosine + others).max(1e-30)))
    }

    /// With [`BouncedDescriptor::environment`](crate::BouncedDescriptor::environment) what each ray brings of the environment
    /// where it meets nothing, and of `hit` where it meets something: colours not yet packed, those of a pixel together.
    pub fn under(
        &self,
        environment: &Cells,
        hit: impl Fn(&Ray, &Hit) -> DVec3 + Sync,
    ) -> Vec<DVec3> {
        let all = self.settings.rays_per_pixel as usize;
        let t_max = f64::from(self.settings.radius).min(FAR);
        (0..all * self.receivers.len())
            .into_par_iter()
            .map(|i| {
                let pixel = i / all;
                let drawn = self.draw(environment, pixel, (i % all) as u32);
                let (Some(receiver), Some((toward, weight))) = (self.receivers[pixel], drawn)
                else {
                    return DVec3::ZERO;
                };
                if weight <= 0.0 {
                    return DVec3::ZERO;
                }
                let ray = Ray::of_pixel(self.camera, self.origin, receiver, toward.direction);
                let met = nearest(&ray, self.pieces, t_max);
                weight * met.map_or(toward.radiance, |met| hit(&ray, &met))
            })
            .collect()
    }

    /// What each ray meets first.
    pub fn hits(&self) -> Vec<Option<Hit>> {
        let t_max = f64::from(self.settings.radius).min(FAR);
        self.rays()
            .par_iter()
            .map(|ray| nearest((*ray).as_ref()?, self.pieces, t_max))
            .collect()
    }

    /// As [`BouncedView::blocked`](crate::BouncedView::blocked).
    pub fn blocked(&self) -> Vec<u32> {
        let rays_per_pixel = self.settings.rays_per_pixel;
        let words = words(rays_per_pixel) as usize;
        let mut bits = vec![0; words * self.receivers.len()];
        if rays_per_pixel > 0 {
            for (i, hit) in self.hits().iter().enumerate() {
                let (pixel, index) = (i / rays_per_pixel as usize, i % rays_per_pixel as usize);
                bits[pixel * words + index / 32] |= u32::from(hit.is_some()) << (index & 31);
            }
        }
        bits
    }

    /// As [`BouncedView::nearness`](crate::BouncedView::nearness), of the nearest hits.
    pub fn nearness(&self) -> Vec<u32> {
        let per_pixel = (self.settings.rays_per_pixel as usize).max(1);
        let mut nearness = vec![0; self.receivers.len()];
        for (i, hit) in self.hits().iter().enumerate() {
            let pixel = i / per_pixel;
            if let (Some(hit), Some(receiver)) = (hit, self.receivers[pixel]) {
                let relative = receiver.position - (self.camera.eye() - self.origin);
                let side = self.camera.footprint().at(relative);
                nearness[pixel] += (side / hit.t.max(side) * NEAREST).round() as u32;
            }
        }
        nearness
    }

    /// As [`BouncedView::radiance`](crate::BouncedView::radiance), in the order of [`directions`]; 0 for the sky.
    pub fn colors(&self, senders: &Senders<'_>) -> Vec<u32> {
        let offsets = surfel_offsets(self.pieces);
        let incoming = |ray: &Ray, hit: Option<&Hit>| match hit {
            Some(hit) => self.sent_at(ray, hit, &offsets, senders),
            None => self.settings.sky_radiance,
        };
        self.rays()
            .iter()
            .zip(self.hits())
            .map(|(ray, hit)| ray.map_or(0, |ray| pack_color(incoming(&ray, hit.as_ref()))))
            .collect()
    }

    /// What the surfel that a hit belongs to sends back along its ray.
    fn sent_at(&self, ray: &Ray, hit: &Hit, offsets: &[u32], senders: &Senders<'_>) -> [f32; 3] {
        let Piece {
            corners: t, shape, ..
        } = self.pieces[hit.piece];
        let leaf = leaf_at(t, ray.origin + ray.direction * hit.t, shape & SHAPE_ORDER);
        let surfel = nearest_room(
            offsets[hit.piece] + leaf,
            senders.counts.surfels,
            senders.capacity.surfels,
        );
        if ray.is_own(hit.t, side_met(&t, ray.direction)) {
            return [0.0; 3];
        }
        let sent = senders.radiance[surfel as usize];
        let facing = (t.b - t.a).cross(t.c - t.a).dot(ray.direction) < 0.0;
        if facing { sent.front } else { sent.back }
    }

    /// The same with [`Payload::LitAndGathered`](crate::Payload::LitAndGathered): colours not yet packed.
    pub fn lit_and_gathered(
        &self,
        materials: &[Material],
        lights: &[Light],
        senders: &Senders<'_>,
    ) -> Vec<DVec3> {
        let offsets = surfel_offsets(self.pieces);
        self.rays()
            .iter()
            .zip(self.hits())
            .zip(self.lit(materials, lights))
            .map(|((ray, hit), lit)| match (ray, hit) {
                (Some(ray), Some(hit)) => {
                    let gathered = sanitize(self.sent_at(ray, &hit, &offsets, senders));
                    (lit + gathered).min(DVec3::splat(BRIGHTEST))
                }
                _ => lit,
            })
            .collect()
    }

    /// The same with [`Payload::LitRadiance`](crate::Payload::LitRadiance): colours not yet packed. `lights` are in the cloud's
    /// space.
    pub fn lit(&self, materials: &[Material], lights: &[Light]) -> Vec<DVec3> {
        self.rays()
            .par_iter()
            .zip(self.hits())
            .map(|(ray, hit)| match (ray, hit) {
                (None, _) => DVec3::ZERO,
                (Some(_), None) => DVec3::from(self.settings.sky_radiance.map(f64::from)),
                (Some(ray), Some(hit)) => self.lit_at(ray, &hit, materials, lights),
            })
            .collect()
    }

    /// What a hit sends back along its ray.
    pub fn lit_at(&self, ray: &Ray, hit: &Hit, materials: &[Material], lights: &[Light]) -> DVec3 {
        let reaches = |point, light: &Light| unshadowed(point, light, self.pieces);
        self.lit_where(ray, hit, (materials, lights), reaches)
    }

    /// The same where `reaches` tells whether a light reaches a point.
    pub(super) fn lit_where(
        &self,
        ray: &Ray,
        hit: &Hit,
        (materials, lights): (&[Material], &[Light]),
        reaches: impl Fn(DVec3, &Light) -> bool,
    ) -> DVec3 {
        let piece = &self.pieces[hit.piece];
        let t = piece.corners;
        let normal = (t.b - t.a).cross(t.c - t.a);
        let material = &materials[(piece.material as usize).min(materials.len() - 1)];
        lit_surface((ray, hit.t), normal, material, lights, reaches)
    }
}

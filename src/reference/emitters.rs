//! Mirror of `wgsl/emitters.wgsl`, `wgsl/common/emitters.wgsl` and of the rays that `wgsl/bounced_z_buffer.wgsl` aims.

use std::f64::consts::PI;

use glam::DVec3;

use super::{
    bounced_z_buffer::{
        FAR, POSITION_TOLERANCE, Ray, Tracing, nearest, offset_origin, side_met, to_camera,
    },
    directions::{GOLDEN_STEP, further_point, hemisphere_direction, point_within},
    ggx::Lobe,
    hashing::{hash, multiply_high, unit_float},
    shell_splatter::Receiver,
    surfel_shader::{own_radiosity, sanitize},
    surfelizer::{Piece, area_vector},
};
use crate::{Light, Material, Sampling, bounced_z_buffer::params::grid};

const WHOLE: u32 = 0xf000_0000;
const FINE: f64 = 65_536.0;
const KEY: u32 = 64;
const MOST_SIZES: f64 = 1e12;
const LEAST_SEEN: f64 = 1e-10;
const AIM: f64 = 2e-5;
const EDGE: f64 = 4.0;

fn material_of<'a>(piece: &Piece, materials: &'a [Material]) -> &'a Material {
    &materials[(piece.material as usize).min(materials.len() - 1)]
}

/// The logarithm of emission times area, for pieces that shine.
fn level_of(piece: &Piece, materials: &[Material]) -> Option<f64> {
    let emission = sanitize(material_of(piece, materials).emission);
    let brightness = emission.dot(DVec3::new(0.2126, 0.7152, 0.0722));
    let area = area_vector(piece.corners);
    let twice = area.direction.length();
    let shines = brightness > 0.0 && twice > 0.0;
    shines.then(|| brightness.log2() + twice.log2() + 2.0 * area.scale.log2())
}

/// A weight for each piece, as a share of the most.
pub fn weights(pieces: &[Piece], materials: &[Material]) -> Vec<u32> {
    let levels: Vec<_> = pieces.iter().map(|p| level_of(p, materials)).collect();
    let shining = || levels.iter().flatten();
    let most = shining().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
    let unit = f64::from(WHOLE / (shining().count() as u32).max(1));
    let weigh = |(i, level): (u32, &Option<f64>)| {
        let mut weight = (level.as_ref()? - most).exp2() * unit;
        if weight < FINE {
            weight += unit_float(hash(i));
        }
        Some(weight as u32)
    };
    (0..)
        .zip(&levels)
        .map(|of| weigh(of).unwrap_or(0))
        .collect()
}

/// By what pieces are drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Emitters {
    /// The sum of the weights before each piece, and of all behind the last.
    pub before: Vec<u32>,
}

/// A point on a piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmitterSample {
    /// The point.
    pub point: DVec3,
    /// Index of the piece.
    pub piece: usize,
    /// Of all weights that of the piece.
    pub share: f64,
    /// The least of the point's three barycentric coordinates.
    pub inside: f64,
}

impl Emitters {
    /// Of weights.
    pub fn new(weights: &[u32]) -> Self {
        let mut sum = 0;
        let mut before = vec![0];
        before.extend(weights.iter().map(|weight| {
            sum += weight;
            sum
        }));
        Self { before }
    }

    fn all(&self) -> u32 {
        self.before.last().copied().unwrap_or(0)
    }

    /// What share of the rays towards emitters goes to a piece.
    pub fn share(&self, piece: usize) -> f64 {
        f64::from(self.before[piece + 1] - self.before[piece]) / f64::from(self.all().max(1))
    }

    /// One of a pixel's `count` points on emitters.
    pub fn sample(
        &self,
        pieces: &[Piece],
        pixel: [u32; 2],
        [index, turn]: [u32; 2],
        (count, frame): (u32, u32),
    ) -> Option<EmitterSample> {
        if self.all() == 0 {
            return None;
        }
        let [across, which] = point_within(pixel, [KEY, turn], frame);
        let step = u32::MAX / count;
        let pick = multiply_high(index * step + multiply_high(which, step), self.all());
        let piece = self.before.partition_point(|before| *before <= pick) - 1;
        let weight = self.before[piece + 1] - self.before[piece];
        let x = unit_float(across.wrapping_add(index.wrapping_mul(GOLDEN_STEP)));
        let y = (f64::from(pick - self.before[piece]) + 0.5) / f64::from(weight);
        let t = pieces[piece].corners;
        let across = x.sqrt();
        let (u, v) = (across * (1.0 - y), across * y);
        let point = t.a + (t.b - t.a) * u + (t.c - t.a) * v;
        Some(EmitterSample {
            point,
            piece,
            share: self.share(piece),
            inside: u.min(v).min(1.0 - across),
        })
    }
}

/// Density over solid angle with which a point of a piece is drawn, as seen from so far away along a unit vector.
pub fn pdf(share: f64, piece: &Piece, direction: DVec3, distance: f64) -> f64 {
    let area = area_vector(piece.corners);
    let sizes = (distance / area.scale.max(1e-30)).min(MOST_SIZES);
    let seen = f64::max(0.5 * area.direction.dot(direction).abs(), LEAST_SEEN);
    share * sizes * sizes / seen
}

/// Of what a surface shines, the share that rays count which come there by chance, by the densities of all rays of a kind.
pub(super) fn chance_share(by_chance: f64, aimed: f64) -> f64 {
    by_chance / (by_chance + aimed).max(1e-30)
}

/// Whether rounding may take a ray past the drawn point's piece.
fn is_at_edge(ray: &Ray, pieces: &[Piece], drawn: &EmitterSample) -> bool {
    let area = area_vector(pieces[drawn.piece].corners);
    let reach = ray.origin.abs().max_element() + drawn.point.abs().max_element();
    let rounding = EDGE * POSITION_TOLERANCE * reach;
    drawn.inside * area.scale * area.direction.dot(ray.direction).abs() <= rounding
}

/// The piece that a ray meets where it was aimed at.
pub(super) fn aim(
    ray: &Ray,
    (pieces, materials): (&[Piece], &[Material]),
    drawn: &EmitterSample,
    distance: f64,
    farthest: f64,
) -> Option<usize> {
    if own_along(&pieces[drawn.piece], materials, ray.direction) == DVec3::ZERO {
        return None;
    }
    let hit = nearest(ray, pieces, (2.0 * distance).min(farthest))?;
    let is_near = (hit.t - distance).abs() <= AIM * distance;
    let is_there = hit.piece == drawn.piece || (is_near && is_at_edge(ray, pieces, drawn));
    is_there.then_some(hit.piece)
}

/// A view's rays with those that are aimed at emitters.
#[derive(Clone, Copy, Debug)]
pub struct Aiming<'a> {
    /// The view's own rays.
    pub tracing: &'a Tracing<'a>,
    /// What they are aimed at.
    pub emitters: &'a Emitters,
    /// As [`BouncedDescriptor::emitter_samples`](crate::BouncedDescriptor::emitter_samples).
    pub samples: u32,
    /// What hits are lit by, in the cloud's space.
    pub lighting: (&'a [Material], &'a [Light]),
    /// Of all receivers, with [`Sampling::Glossy`].
    pub roughness: f64,
}

/// Where a pixel's rays start.
struct Start {
    receiver: Receiver,
    origin: DVec3,
    lobe: Option<Lobe>,
}

impl Aiming<'_> {
    fn start(&self, pixel: usize) -> Option<Start> {
        let Tracing {
            camera,
            origin: eye,
            ..
        } = *self.tracing;
        let receiver = self.tracing.receivers[pixel]?;
        let Receiver { position, normal } = receiver;
        let glossy = self.tracing.sampling == Sampling::Glossy;
        let seen_from = to_camera(camera, eye, position);
        Some(Start {
            receiver,
            origin: offset_origin(camera, eye, position, normal),
            lobe: glossy.then(|| Lobe::new(normal, seen_from, self.roughness)),
        })
    }

    fn ray(&self, start: &Start, direction: DVec3) -> Ray {
        let Tracing { camera, origin, .. } = *self.tracing;
        Ray::of_pixel(camera, origin, start.receiver, direction)
    }

    fn place(&self, pixel: usize) -> [u32; 2] {
        let width = self.tracing.camera.viewport().width;
        [pixel as u32 % width, pixel as u32 / width]
    }

    fn t_max(&self) -> f64 {
        f64::from(self.tracing.settings.radius).min(FAR)
    }

    /// What a pixel's own ray brings, a further one's where `turn` is not 0; not yet packed.
    pub fn look(&self, pixel: usize, index: u32, turn: u32) -> DVec3 {
        let settings = self.tracing.settings;
        let Some(start) = self.start(pixel) else {
            return DVec3::ZERO;
        };
        let grid = grid(settings.rays_per_pixel);
        let point = further_point(self.place(pixel), [index, turn], grid, settings.frame);
        let (direction, density) = if let Some(lobe) = &start.lobe {
            let drawn = lobe.direction(point);
            if drawn.light.z <= 0.0 {
                return DVec3::ZERO;
            }
            (lobe.frame * drawn.light, lobe.pdf(drawn.facet))
        } else {
            let normal = start.receiver.normal;
            let direction = hemisphere_direction(point, normal, Sampling::Cosine).direction;
            (direction, normal.dot(direction).max(0.0) / PI)
        };
        let ray = self.ray(&start, direction);
        let pieces = self.tracing.pieces;
        let Some(hit) = nearest(&ray, pieces, self.t_max()) else {
            return DVec3::from(settings.sky_radiance.map(f64::from));
        };
        let (materials, lights) = self.lighting;
        let piece = &pieces[hit.piece];
        if ray.is_own(hit.t, side_met(&piece.corners, direction)) {
            return DVec3::ZERO;
        }
        let own = own_along(piece, materials, direction);
        let aimed = pdf(self.emitters.share(hit.piece), piece, direction, hit.t);
        let by_chance = f64::from(settings.rays_per_pixel) * density;
        let share = chance_share(by_chance, f64::from(self.samples) * aimed);
        let lit = self.tracing.lit_at(&ray, &hit, materials, lights);
        lit - own * (1.0 - share)
    }

    /// What a ray towards emitters brings, not yet packed; of glossy receivers what the lobe makes of it, times the reflectance
    /// straight on and besides.
    pub fn shine(&self, pixel: usize, index: u32, turn: u32) -> [DVec3; 2] {
        const NONE: [DVec3; 2] = [DVec3::ZERO; 2];
        let Tracing {
            settings, pieces, ..
        } = *self.tracing;
        let which = [index, turn];
        let how = (self.samples, settings.frame);
        let Some(start) = self.start(pixel) else {
            return NONE;
        };
        let drawn = self.emitters.sample(pieces, self.place(pixel), which, how);
        let Some(drawn) = drawn else {
            return NONE;
        };
        let offset = drawn.point - start.origin;
        let distance = offset.length();
        let direction = offset.normalize_or_zero();
        let (density, values) = if let Some(lobe) = &start.lobe {
            let light = lobe.frame.transpose() * direction;
            let facet = lobe.facet_of(light);
            let density = lobe.pdf(facet);
            let power = lobe.schlick_power(facet);
            let value = density * lobe.share(light);
            (density, [value * (1.0 - power), value * power])
        } else {
            let cosine = start.receiver.normal.dot(direction).max(0.0) / PI;
            (cosine, [cosine, 0.0])
        };
        if values[0] + values[1] <= 0.0 || distance > self.t_max() {
            return NONE;
        }
        let ray = self.ray(&start, direction);
        let scene = (pieces, self.lighting.0);
        let Some(met) = aim(&ray, scene, &drawn, distance, self.t_max()) else {
            return NONE;
        };
        if ray.is_own(distance, side_met(&pieces[met].corners, direction)) {
            return NONE;
        }
        let own = own_along(&pieces[met], self.lighting.0, direction);
        let aimed = pdf(drawn.share, &pieces[drawn.piece], direction, distance);
        let samples = f64::from(self.samples);
        let all = f64::from(settings.rays_per_pixel) * density + samples * aimed;
        values.map(|value| own * (value * samples / all.max(1e-30)))
    }
}

/// Radiance that a piece sends of its own against a direction.
pub(super) fn own_along(piece: &Piece, materials: &[Material], direction: DVec3) -> DVec3 {
    let facing = area_vector(piece.corners).direction.dot(direction) < 0.0;
    own_radiosity(material_of(piece, materials), facing) / PI
}

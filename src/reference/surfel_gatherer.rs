//! Mirror of `wgsl/surfel_gatherer.wgsl`, and of `wgsl/common/bvh_traverse.wgsl` as in
//! [`bounced_z_buffer`](super::bounced_z_buffer): each ray against every piece.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use super::{
    bounced_z_buffer::{FAR, Hit, Ray, nearest, ray_epsilon},
    directions::{cell_point, hemisphere_direction},
    emitters::{self, Emitters, chance_share, own_along},
    hashing::hash2,
    packing::unpack_normal,
    surfel_shader::{BRIGHTEST, Radiance, sanitize},
    surfelizer::{Piece, SHAPE_ORDER, Triangle, centroid, leaf_at, leaf_of, nearest_room},
};
use crate::{
    CloudCapacity, Material, Sampling, SurfelGathererSettings, SurfelRadiance, SurfelSource,
    bounced_z_buffer::params::grid,
};

const SPLITS: u32 = 4;
const PARTS: u32 = 16;
const PART_STEP: u32 = 5;

/// What rays from surfels meet, as [`crate::SurfelSenders`].
#[derive(Clone, Copy, Debug)]
pub struct Senders<'a> {
    /// The cloud's pieces.
    pub pieces: &'a [Piece],
    /// Its capacity.
    pub capacity: CloudCapacity,
    /// What its surfels send.
    pub radiance: &'a [SurfelRadiance],
}

/// The surfels that gather, and what from.
#[derive(Clone, Copy, Debug)]
pub struct Gathering<'a> {
    /// The surfels.
    pub sources: &'a [SurfelSource],
    /// Their cloud's pieces.
    pub own_pieces: &'a [Piece],
    /// The material table.
    pub materials: &'a [Material],
    /// What rays meet.
    pub senders: Senders<'a>,
    /// From the surfels' space to that of what rays meet.
    pub shift: DVec3,
    /// What rays are aimed at besides, if they are.
    pub emitters: Option<&'a Emitters>,
    /// The settings.
    pub settings: &'a SurfelGathererSettings,
}

impl Gathering<'_> {
    /// What each surfel reflects of what it gathers.
    pub fn gather(&self) -> Vec<Radiance> {
        let mut total = 0_u32;
        let surfel_offsets: Vec<u32> = self
            .senders
            .pieces
            .iter()
            .map(|piece| {
                let first = total;
                total = total.saturating_add(1 << (piece.shape & SHAPE_ORDER));
                first
            })
            .collect();
        (0..self.sources.len() as u32)
            .into_par_iter()
            .map(|i| self.gather_one(i, &surfel_offsets, total))
            .collect()
    }

    fn gather_one(&self, i: u32, surfel_offsets: &[u32], total: u32) -> Radiance {
        let source = self.sources[i as usize];
        let material = self.materials[(source.material as usize).min(self.materials.len() - 1)];
        let most = DVec3::splat(f64::from(self.settings.most_albedo));
        let albedo = sanitize(material.albedo).min(most);
        let mut radiance = Radiance::default();
        if albedo.cmpgt(DVec3::ZERO).any() {
            let piece = self.own_pieces[source.piece as usize];
            let t = piece.corners;
            let normal = (t.b - t.a)
                .cross(t.c - t.a)
                .normalize_or(unpack_normal(source.normal));
            let leaf = leaf_of(t, source.leaf, piece.shape & SHAPE_ORDER);
            let brightest = DVec3::splat(BRIGHTEST);
            let gathered =
                |which, side| self.gathered([i, which], leaf, side, surfel_offsets, total);
            radiance.front = (albedo * gathered(0, normal)).min(brightest);
            if self.settings.backs {
                radiance.back = (albedo * gathered(1, -normal)).min(brightest);
            }
        }
        radiance
    }

    /// The mean of what reaches a side of a surfel, weighed by the cosine.
    fn gathered(
        &self,
        [i, which]: [u32; 2],
        leaf: Triangle,
        side: DVec3,
        surfel_offsets: &[u32],
        total: u32,
    ) -> DVec3 {
        let grid = grid(self.settings.rays_per_surfel);
        let rays = grid[0] * grid[1];
        let turn = hash2(i, which);
        let mut sum = DVec3::ZERO;
        for k in 0..rays {
            let cell = cell_point([i, which], k, grid, self.settings.frame);
            let ray = Ray {
                origin: self.start_of(leaf, turn, k, side),
                direction: hemisphere_direction(cell, side, Sampling::Cosine).direction,
                left: None,
            };
            let hit = nearest(&ray, self.senders.pieces, FAR);
            sum += self.incoming(&ray, hit, side, (surfel_offsets, total));
        }
        let aimed = |emitters| self.shone(emitters, [i, which], leaf, side);
        sum / f64::from(rays) + self.emitters.map_or(DVec3::ZERO, aimed)
    }

    /// Where ray k of a side starts.
    fn start_of(&self, leaf: Triangle, turn: u32, k: u32, side: DVec3) -> DVec3 {
        let part = turn.wrapping_add(PART_STEP.wrapping_mul(k)) % PARTS;
        let own = centroid(leaf_of(leaf, part, SPLITS));
        let place = own + self.shift;
        place + side * ray_epsilon(own).max(ray_epsilon(place))
    }

    /// What rays towards emitters bring of the mean.
    fn shone(
        &self,
        emitters: &Emitters,
        [i, which]: [u32; 2],
        leaf: Triangle,
        side: DVec3,
    ) -> DVec3 {
        let pieces = self.senders.pieces;
        let turn = hash2(i, which);
        let samples = self.settings.emitter_samples;
        let how = (samples, self.settings.frame);
        let mut sum = DVec3::ZERO;
        for k in 0..samples {
            let start = k.wrapping_add(self.settings.frame.wrapping_mul(samples | 1));
            let origin = self.start_of(leaf, turn, start, side);
            let Some(drawn) = emitters.sample(pieces, [i, which], [k, 0], how) else {
                continue;
            };
            let (direction, distance) = (drawn.point - origin).normalize_and_length();
            let value = side.dot(direction).max(0.0) / PI;
            let ray = Ray {
                origin,
                direction,
                left: None,
            };
            if value > 0.0
                && let Some(met) =
                    emitters::aim(&ray, (pieces, self.materials), &drawn, distance, FAR)
            {
                let density = emitters::pdf(drawn.share, &pieces[drawn.piece], direction, distance);
                let by_chance = f64::from(self.settings.rays_per_surfel) * value;
                let all = by_chance + f64::from(samples) * density;
                let own = own_along(&pieces[met], self.materials, direction);
                sum += own * (value / all.max(1e-30));
            }
        }
        sum
    }

    /// What comes along a ray that was drawn by the cosine to `side`.
    fn incoming(
        &self,
        ray: &Ray,
        hit: Option<Hit>,
        side: DVec3,
        (surfel_offsets, total): (&[u32], u32),
    ) -> DVec3 {
        let Some(hit) = hit else {
            return DVec3::from(self.settings.sky_radiance.map(f64::from));
        };
        let piece = self.senders.pieces[hit.piece];
        let t = piece.corners;
        let leaf = leaf_at(
            t,
            ray.origin + ray.direction * hit.t,
            piece.shape & SHAPE_ORDER,
        );
        let surfel = nearest_room(
            surfel_offsets[hit.piece] + leaf,
            total,
            self.senders.capacity.surfels,
        );
        let facing = (t.b - t.a).cross(t.c - t.a).dot(ray.direction) < 0.0;
        let sent = self.senders.radiance[surfel as usize];
        let all = sanitize(if facing { sent.front } else { sent.back });
        let Some(emitters) = self.emitters else {
            return all;
        };
        let own = own_along(&piece, self.materials, ray.direction);
        let density = emitters::pdf(emitters.share(hit.piece), &piece, ray.direction, hit.t);
        let cosine = side.dot(ray.direction).max(0.0);
        let by_chance = f64::from(self.settings.rays_per_surfel) * cosine / PI;
        let aimed = f64::from(self.settings.emitter_samples) * density;
        (all - own * (1.0 - chance_share(by_chance, aimed))).max(DVec3::ZERO)
    }
}

/// What surfels send by two buffers together.
pub fn add(onto: &SurfelRadiance, more: &SurfelRadiance) -> Radiance {
    let both = |a, b| (sanitize(a) + sanitize(b)).min(DVec3::splat(BRIGHTEST));
    Radiance {
        front: both(onto.front, more.front),
        back: both(onto.back, more.back),
    }
}

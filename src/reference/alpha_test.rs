//! Mirror of `wgsl/alpha_test.wgsl` and `wgsl/common/map_alpha.wgsl`: triangles with holes, and what rays meet of them.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::{
    bounced_z_buffer::{FAR, Hit, Tracing, traverse, unshadowed_where},
    instanced_bvh::{self, Instance, nearest_where},
    surfelizer::{Piece, SHAPE_PATH_SHIFT, SHAPE_SMALL, Triangle},
};
use crate::{AlphaWrap, Light, Material, scenes::Scene};

/// Pictures of one size, of alpha alone, 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct AlphaMaps {
    /// Width and height in texels.
    pub size: [usize; 2],
    /// Rows of each, from the first on.
    pub layers: Vec<Vec<f32>>,
}

/// The holes of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cutout {
    /// Texture coordinates of its corners.
    pub tex_coords: [DVec2; 3],
    /// Which of the pictures.
    pub layer: usize,
    /// The least alpha that is there.
    pub threshold: f64,
    /// What is beyond the picture.
    pub wrap: [AlphaWrap; 2],
}

/// The holes of all triangles.
#[derive(Clone, Copy, Debug)]
pub struct Holes<'a> {
    /// Those of each triangle, if it has any.
    pub cutouts: &'a [Option<Cutout>],
    /// The pictures.
    pub maps: &'a AlphaMaps,
}

/// A coordinate within the picture, or with [`AlphaWrap::MirrorRepeat`] within it and its mirrored one.
fn within_map(x: f64, wrap: AlphaWrap) -> f64 {
    match wrap {
        AlphaWrap::ClampToEdge => x.clamp(0.0, 1.0),
        AlphaWrap::MirrorRepeat => x.rem_euclid(2.0),
        AlphaWrap::Repeat => x.rem_euclid(1.0),
    }
}

/// Texel i, at most a picture beyond it.
fn texel_within(i: i64, size: i64, wrap: AlphaWrap) -> usize {
    let texel = match wrap {
        AlphaWrap::ClampToEdge => i.clamp(0, size - 1),
        AlphaWrap::MirrorRepeat => {
            let turned = (i + 2 * size) % (2 * size);
            turned.min(2 * size - 1 - turned)
        }
        AlphaWrap::Repeat => (i + size) % size,
    };
    texel as usize
}

/// The holes of a scene's triangles, in the order of its indices, and their pictures; `None` where there are none.
pub fn of_scene(scene: &Scene) -> Option<(Vec<Option<Cutout>>, AlphaMaps)> {
    let holes = scene.holes.as_ref()?;
    let maps = AlphaMaps {
        size: holes.size.map(|side| side as usize),
        layers: holes
            .maps
            .iter()
            .map(|map| map.iter().map(|alpha| f32::from(*alpha) / 255.0).collect())
            .collect(),
    };
    let cutouts = scene.parts.iter().flat_map(|part| {
        let test = holes.tests.get(part.material as usize).copied().flatten();
        let range = part.first_index as usize..(part.first_index + part.index_count) as usize;
        scene.indices[range].chunks_exact(3).map(move |corners| {
            let tex_coords = [0, 1, 2]
                .map(|i| DVec2::from(holes.tex_coords[corners[i] as usize].map(f64::from)));
            // Where no coordinates are known there are no holes.
            let test = test.filter(|_| tex_coords.iter().all(|uv| uv.is_finite()));
            test.map(|test| Cutout {
                tex_coords,
                layer: test.layer as usize,
                threshold: f64::from(test.threshold),
                wrap: test.wrap,
            })
        })
    });
    Some((cutouts.collect(), maps))
}

impl AlphaMaps {
    fn map_alpha(&self, [x, y]: [usize; 2], layer: usize) -> f64 {
        let alpha = f64::from(self.layers[layer][y * self.size[0] + x]);
        if alpha > 0.0 { alpha.min(1.0) } else { 0.0 }
    }

    /// Alpha at texture coordinates, between the four texels about them.
    pub fn alpha_at(&self, uv: DVec2, layer: usize, wrap: [AlphaWrap; 2]) -> f64 {
        let [width, height] = self.size.map(|side| side as i64);
        let within = DVec2::new(within_map(uv.x, wrap[0]), within_map(uv.y, wrap[1]));
        let place = within * DVec2::new(width as f64, height as f64) - 0.5;
        let first = place.floor();
        let share = place - first;
        let [x, y] = [first.x as i64, first.y as i64];
        let [x0, x1] = [x, x + 1].map(|x| texel_within(x, width, wrap[0]));
        let [y0, y1] = [y, y + 1].map(|y| texel_within(y, height, wrap[1]));
        let mix = |a: f64, b: f64, share: f64| a + (b - a) * share;
        let row = |y| {
            let ends = [x0, x1].map(|x| self.map_alpha([x, y], layer));
            mix(ends[0], ends[1], share.x)
        };
        mix(row(y0), row(y1), share.y)
    }
}

impl Cutout {
    /// Texture coordinates at weights of the second and third corner.
    pub fn tex_coords_at(&self, [v, w]: [f64; 2]) -> DVec2 {
        let [a, b, c] = self.tex_coords;
        a + (b - a) * v + (c - a) * w
    }

    /// Whether its triangle is there, at such weights.
    pub fn is_there(&self, maps: &AlphaMaps, place: [f64; 2]) -> bool {
        let uv = self.tex_coords_at(place);
        maps.alpha_at(uv, self.layer, self.wrap) >= self.threshold
    }

    /// Texture coordinates of a point in the plane of the triangle that this is of.
    pub fn tex_coords_of(&self, whole: &Triangle, point: DVec3) -> DVec2 {
        let (e1, e2) = (whole.b - whole.a, whole.c - whole.a);
        let normal = e1.cross(e2);
        let from_a = point - whole.a;
        let per_area = normal.length_squared().recip();
        let v = from_a.cross(e2).dot(normal) * per_area;
        let w = e1.cross(from_a).dot(normal) * per_area;
        self.tex_coords_at([v, w])
    }

    /// The holes of a piece of the triangle that this is of. A small triangle's piece may be enlarged, and has the same holes.
    #[must_use]
    pub fn of_piece(&self, whole: &Triangle, piece: &Piece) -> Self {
        if piece.shape & SHAPE_SMALL != 0 && piece.shape >> SHAPE_PATH_SHIFT == 0 {
            return *self;
        }
        let at = |point: DVec3| self.tex_coords_of(whole, point);
        let Triangle { a, b, c } = piece.corners;
        Self {
            tex_coords: [a, b, c].map(at),
            ..*self
        }
    }
}

impl Holes<'_> {
    /// Whether a triangle is there, at weights of its second and third corner.
    pub fn is_there(&self, triangle: usize, place: [f64; 2]) -> bool {
        let cutout = self.cutouts.get(triangle).copied().flatten();
        cutout.is_none_or(|cutout| cutout.is_there(self.maps, place))
    }
}

/// What each ray of a view meets first of pieces with such holes.
pub fn hits(tracing: &Tracing<'_>, holes: &Holes<'_>) -> Vec<Option<Hit>> {
    let t_max = f64::from(tracing.settings.radius).min(FAR);
    let is_there = |piece, place| holes.is_there(piece, place);
    let rays = tracing.rays();
    rays.par_iter()
        .map(|ray| traverse((*ray).as_ref()?, None, tracing.pieces, t_max, is_there))
        .collect()
}

/// What each ray of a view brings with [`Payload::LitRadiance`](crate::Payload::LitRadiance) among pieces with such holes:
/// colours not yet packed. `lights` are in the cloud's space.
pub fn lit(
    tracing: &Tracing<'_>,
    holes: &Holes<'_>,
    materials: &[Material],
    lights: &[Light],
) -> Vec<DVec3> {
    let sky = DVec3::from(tracing.settings.sky_radiance.map(f64::from));
    let is_there = |piece, place| holes.is_there(piece, place);
    let reaches = |point, light: &Light| unshadowed_where(point, light, tracing.pieces, is_there);
    let rays = tracing.rays();
    rays.par_iter()
        .zip(hits(tracing, holes))
        .map(|(ray, hit)| match (ray, hit) {
            (None, _) => DVec3::ZERO,
            (Some(_), None) => sky,
            (Some(ray), Some(hit)) => tracing.lit_where(ray, &hit, (materials, lights), reaches),
        })
        .collect()
}

/// What each ray of a view meets first among instances, each with such holes; the view's pieces are not asked.
pub fn hits_of_instances(
    tracing: &Tracing<'_>,
    instances: &[Instance<'_>],
    holes: &[Holes<'_>],
) -> Vec<Option<instanced_bvh::Hit>> {
    let t_max = f64::from(tracing.settings.radius).min(FAR);
    let is_there = |instance: usize, triangle, place| holes[instance].is_there(triangle, place);
    let rays = tracing.rays();
    rays.par_iter()
        .map(|ray| nearest_where((*ray).as_ref()?, instances, t_max, is_there))
        .collect()
}

//! Mirror of `wgsl/sg_hull*.wgsl` and `wgsl/common/lobes.wgsl`: components by an exact flood fill, vertices, splits, and shading.

use std::f64::consts::PI;

use glam::DVec3;

use super::{light::arrival, packing::unpack_normal, shell_splatter::Receiver};
use crate::{
    Camera, HullSegment, Light, SgHullSettings,
    sg_hull::settings::TILE,
    spherical_gaussian::{DLightMoments, Estimate},
};

/// How far below the horizon light counts for lobes, as a sine.
const BELOW_HORIZON: f64 = 0.5;

/// Pixels across below which a segment is a sliver.
const NARROW: u32 = 4;

/// Pixels of a rectangle up to which light is gathered at each of them.
const TINY_AREA: u32 = 8;

/// Radians below which a segment's normals are one.
const FLAT_SPREAD: f32 = 0.003;

/// Of an error in units of the dimmest corner, and what counts as dark, in mean irradiances.
const RELATIVE_SHARE: f64 = 0.2;
const DIMMEST: f64 = 0.005;

/// Pixels across from which on a part is split rather than gathered at each of its pixels.
const SPLIT_SIDE: u32 = 4;

/// How much a whole's being off at a part's points, and its corners' being apart, count as the part's error.
const OFF_SHARE: f64 = 3.0;
const APART_SHARE: f64 = 0.25;

/// Whether light is gathered at each pixel of a segment whatever the settings, and at none of its corners.
pub fn is_tiny(segment: &HullSegment) -> bool {
    let [left, top, right, bottom] = segment.rect;
    (right - left) * (bottom - top) <= TINY_AREA
}

/// Whether irradiance itself is interpolated on a segment.
pub fn is_flat(segment: &HullSegment) -> bool {
    segment.spread < FLAT_SPREAD
}

/// The most light that counts.
const MOST_LIGHT: f64 = 1e18;

/// Light that arrives at a point, gathered for a normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobes {
    /// A colour channel each.
    pub moments: [DLightMoments; 3],
    /// Of a surface with the normal.
    pub irradiance: DVec3,
}

impl Lobes {
    /// No light.
    pub const ZERO: Self = Self {
        moments: [DLightMoments::ZERO; 3],
        irradiance: DVec3::ZERO,
    };

    /// Light from a direction, with the irradiance of a surface that faces it.
    pub fn add_light(&mut self, normal: DVec3, direction: DVec3, irradiance: DVec3) {
        let height = normal.dot(direction);
        let share = (1.0 + height / BELOW_HORIZON).clamp(0.0, 1.0);
        for (moments, amount) in self.moments.iter_mut().zip(irradiance.to_array()) {
            moments.add(direction, share * amount);
        }
        self.irradiance += irradiance * height.max(0.0);
    }

    /// What of it counts: light that is not finite is none, and what is beyond 1e18 counts as that.
    #[must_use]
    pub fn usable(self) -> Self {
        let moments = self.moments.map(|m| {
            if !(m.vector.is_finite() && m.total.is_finite() && m.total > 0.0) {
                return DLightMoments::ZERO;
            }
            let share = (MOST_LIGHT / m.total.max(1e-30)).min(1.0);
            DLightMoments {
                vector: m.vector * share,
                total: m.total * share,
            }
        });
        let irradiance = if self.irradiance.is_finite() {
            self.irradiance.clamp(DVec3::ZERO, DVec3::splat(MOST_LIGHT))
        } else {
            DVec3::ZERO
        };
        Self {
            moments,
            irradiance,
        }
    }

    /// What the lobe of each channel adds to the irradiance of a surface with the normal that is not there.
    pub fn excess(&self, normal: DVec3) -> DVec3 {
        lobe_irradiance(&self.moments, normal) - self.irradiance
    }
}

/// Irradiance from the lobes with these moments.
pub fn lobe_irradiance(moments: &[DLightMoments; 3], normal: DVec3) -> DVec3 {
    DVec3::from(moments.map(|m| m.lobe(Estimate::Moments).irradiance(normal)))
}

/// What counts of that which [`Gatherer::lights`](crate::Gatherer::lights) gathers at a point of the world.
pub fn gather_lights(lights: &[Light], point: DVec3, normal: DVec3) -> Lobes {
    let mut lobes = Lobes::ZERO;
    for light in lights {
        let found = arrival(light, point);
        lobes.add_light(normal, found.to_light, found.irradiance);
    }
    lobes.usable()
}

/// A view without more pixels than its grid has texels, so that each pixel is one. Positions are relative to the eye.
#[derive(Clone, Copy, Debug)]
pub struct Hull<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Rows from the top.
    pub receivers: &'a [Option<Receiver>],
    /// Settings.
    pub settings: &'a SgHullSettings,
}

impl Hull<'_> {
    fn size(&self) -> [u32; 2] {
        let viewport = self.camera.viewport();
        [viewport.width, viewport.height]
    }

    /// Whether two pixels are one surface, with all thresholds widened by a factor: what rounding may move across lies
    /// between a factor a little below 1 and one a little above.
    pub fn similar(&self, a: &Receiver, b: &Receiver, widened: f64) -> bool {
        let d = b.position - a.position;
        let [width, height] = self.size();
        let extent = |p: DVec3| self.camera.footprint().at(p) * f64::from(width.max(height));
        let extent = extent(a.position).min(extent(b.position));
        let off = a.normal.dot(d).abs().max(b.normal.dot(d).abs());
        let angle = f64::from(self.settings.normal_angle);
        a.normal.dot(b.normal) >= angle.cos() - 1e-4 * widened
            && off <= f64::from(self.settings.plane_distance) * extent * widened
            && self.camera.axis().dot(d).abs() <= f64::from(self.settings.gap) * extent * widened
    }

    /// The connected components of every quad, by a flood fill: a number for each pixel, `None` for the sky.
    pub fn components(&self, widened: f64) -> Vec<Option<u32>> {
        let [width, height] = self.size();
        let mut found: Vec<Option<u32>> = vec![None; self.receivers.len()];
        let mut count = 0;
        let quad = |i: u32| i / self.settings.quad.min(TILE);
        for start in 0..width * height {
            if found[start as usize].is_some() || self.receivers[start as usize].is_none() {
                continue;
            }
            let mut open = vec![start];
            found[start as usize] = Some(count);
            while let Some(i) = open.pop() {
                let [x, y] = [i % width, i / width];
                let neighbours = [
                    (x > 0).then(|| i - 1),
                    (x + 1 < width).then(|| i + 1),
                    (y > 0).then(|| i - width),
                    (y + 1 < height).then(|| i + width),
                ];
                for j in neighbours.into_iter().flatten() {
                    let same_quad = quad(j % width) == quad(x) && quad(j / width) == quad(y);
                    let (Some(a), Some(b)) =
                        (&self.receivers[i as usize], &self.receivers[j as usize])
                    else {
                        continue;
                    };
                    if same_quad && found[j as usize].is_none() && self.similar(a, b, widened) {
                        found[j as usize] = Some(count);
                        open.push(j);
                    }
                }
            }
            count += 1;
        }
        found
    }

    /// Where a corner of a segment (0 to 3, rows from the top) gathers its light, and the normal that it gathers for.
    pub fn place(
        &self,
        segment: &HullSegment,
        id: u32,
        segment_of: &[u32],
        corner: u32,
    ) -> Option<(DVec3, DVec3)> {
        if is_tiny(segment) {
            let anchor = self.receivers[segment.anchor as usize]?;
            return Some((anchor.position, anchor.normal));
        }
        let [left, top, right, bottom] = segment.rect;
        let edge = [
            [left, right][(corner & 1) as usize],
            [top, bottom][(corner >> 1) as usize],
        ];
        let pixel = [edge[0] - (corner & 1), edge[1] - (corner >> 1)];
        self.place_at(segment, id, segment_of, edge, pixel)
    }

    /// Where a point between pixels gathers its light, and the normal that it gathers for: by a pixel beside it if that is the
    /// segment's own.
    pub fn place_at(
        &self,
        segment: &HullSegment,
        id: u32,
        segment_of: &[u32],
        edge: [u32; 2],
        pixel: [u32; 2],
    ) -> Option<(DVec3, DVec3)> {
        let [width, height] = self.size();
        let [left, top, right, bottom] = segment.rect;
        let anchor = self.receivers[segment.anchor as usize]?;
        let at = (pixel[1] * width + pixel[0]) as usize;
        let own = segment_of[at] == id;
        let narrow = (right - left).min(bottom - top);
        let (point, normal) = if own {
            let receiver = self.receivers[at]?;
            (receiver.position, receiver.normal)
        } else {
            (anchor.position, unpack_normal(segment.normal))
        };
        if own && narrow < NARROW {
            return Some((point, normal));
        }
        let axis = self.camera.axis();
        let [x, y] = edge.map(f64::from);
        debug_assert!(x <= f64::from(width) && y <= f64::from(height));
        let (base, direction) = self.camera.line_of_sight(x, y);
        let [mut nearest, mut farthest] = [segment.nearest, segment.farthest].map(f64::from);
        let toward = normal.dot(direction);
        let depth = if toward.abs() > 1e-6 * direction.length() {
            normal.dot(point - base) / toward
        } else {
            0.5 * (nearest + farthest)
        };
        if own {
            let half_pixel = 0.5 * (farthest - nearest) / f64::from(narrow);
            let middle = axis.dot(point);
            nearest = middle
                - if self.camera.is_perspective() {
                    half_pixel.min(0.5 * middle.abs())
                } else {
                    half_pixel
                };
            farthest = middle + half_pixel;
        }
        Some((base + direction * depth.clamp(nearest, farthest), normal))
    }

    /// What becomes of a part that does not fit: parts that do, and rectangles whose pixels are gathered each for itself.
    /// `gather` is irradiance at a point relative to the eye, for a normal; `bound` is [`SgHullSettings::error_threshold`].
    pub fn split(
        &self,
        (segment, id, segment_of): (&HullSegment, u32, &[u32]),
        whole: &Part,
        (mean, bound): (f64, f64),
        gather: &dyn Fn(DVec3, DVec3) -> DVec3,
        found: &mut Vec<(Part, Fit)>,
    ) -> Option<()> {
        let [left, top, right, bottom] = segment.rect;
        let (low, high) = (whole.low, whole.high);
        let middle = [0, 1].map(|i| u32::midpoint(low[i], high[i]));
        let mut lattice = [(DVec3::ZERO, 0.0); 9];
        let mut off = [0.0_f64; 9];
        for (k, corner) in whole.corners.iter().enumerate() {
            lattice[(k & 1) * 2 + (k >> 1) * 6] = *corner;
        }
        for place in [1, 3, 4, 5, 7] {
            let edge = [
                [low[0], middle[0], high[0]][place % 3],
                [low[1], middle[1], high[1]][place / 3],
            ];
            let mut pixel = [edge[0].min(right - 1), edge[1].min(bottom - 1)];
            for j in 1..4 {
                let other = [
                    edge[0].saturating_sub(j & 1).clamp(left, right - 1),
                    edge[1].saturating_sub(j >> 1).clamp(top, bottom - 1),
                ];
                if segment_of[(other[1] * self.size()[0] + other[0]) as usize] == id {
                    pixel = other;
                }
            }
            let (position, normal) = self.place_at(segment, id, segment_of, edge, pixel)?;
            let right = gather(position, normal);
            lattice[place] = (right, self.camera.axis().dot(position));
            let at = edge.map(f64::from);
            let apart = (average(whole.shown(self.camera, at)) - average(right)).abs();
            off[place] = relative_error(OFF_SHARE * apart, average(right), mean);
        }
        for k in 0..4 {
            let (column, row) = (k & 1, k >> 1);
            let places = [0, 1, 3, 4].map(|place| column + 3 * row + place);
            let part = Part {
                low: [[low[0], middle[0]][column], [low[1], middle[1]][row]],
                high: [[middle[0], high[0]][column], [middle[1], high[1]][row]],
                corners: places.map(|place| lattice[place]),
            };
            let light = part.corners.map(|(light, _)| average(light));
            let least = light.iter().copied().fold(f64::INFINITY, f64::min);
            let apart = light.iter().copied().fold(0.0, f64::max) - least;
            // No number is no fit.
            let fits = places.iter().all(|&place| off[place] < bound);
            if fits && relative_error(APART_SHARE * apart, least, mean) < bound {
                found.push((part, Fit::Quad));
            } else if part.can_be_split() {
                self.split(
                    (segment, id, segment_of),
                    &part,
                    (mean, bound),
                    gather,
                    found,
                )?;
            } else {
                found.push((part, Fit::Pixels));
            }
        }
        Some(())
    }
}

/// A corner's moments and excess, and its depth along the axis (1 for an orthographic camera).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// A colour channel each.
    pub moments: [DLightMoments; 3],
    /// Of [`Lobes::excess`].
    pub excess: DVec3,
    /// Along the camera's axis.
    pub depth: f64,
}

impl Corner {
    /// Irradiance of a surface with a normal, a colour channel each.
    pub fn irradiance(&self, normal: DVec3) -> DVec3 {
        (lobe_irradiance(&self.moments, normal) - self.excess).max(DVec3::ZERO)
    }
}

/// A part of a flat quad that does not fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// The first pixel.
    pub low: [u32; 2],
    /// The one past the last.
    pub high: [u32; 2],
    /// Irradiance at the corners, rows from the top, and how far along the camera's axis they are.
    pub corners: [(DVec3, f64); 4],
}

/// What becomes of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fit {
    /// It is drawn.
    Quad,
    /// Light is gathered at its pixels.
    Pixels,
}

impl Part {
    /// All of a segment's rectangle.
    pub fn whole(segment: &HullSegment, corners: &[Corner; 4]) -> Self {
        let [left, top, right, bottom] = segment.rect;
        let normal = unpack_normal(segment.normal);
        Self {
            low: [left, top],
            high: [right, bottom],
            corners: corners.map(|corner| (corner.irradiance(normal), corner.depth)),
        }
    }

    /// Whether it is wide enough.
    pub fn can_be_split(&self) -> bool {
        (0..2).all(|i| self.high[i] - self.low[i] >= SPLIT_SIDE)
    }

    /// Whether it has a pixel.
    pub fn contains(&self, pixel: [u32; 2]) -> bool {
        (0..2).all(|i| (self.low[i]..self.high[i]).contains(&pixel[i]))
    }

    /// Irradiance as a rasteriser interpolates it at a point of the picture, pixels.
    pub fn shown(&self, camera: &Camera, at: [f64; 2]) -> DVec3 {
        let depths = self.corners.map(|(_, depth)| depth);
        let farthest = depths.iter().copied().fold(0.0, f64::max);
        let depths = if camera.is_perspective() {
            depths
        } else {
            [farthest; 4]
        };
        let weights = weights_between(self.low, self.high, depths, farthest, at);
        let terms = self.corners.iter().zip(weights);
        terms.map(|((light, _), w)| *light * w).sum()
    }
}

fn average(color: DVec3) -> f64 {
    color.element_sum() / 3.0
}

/// Of a difference where the dimmest light is `least`, in units of the picture's mean irradiance.
fn relative_error(apart: f64, least: f64, mean: f64) -> f64 {
    let scale = mean.max(1e-30);
    (apart / scale).max(RELATIVE_SHARE * apart / (least + DIMMEST * scale))
}

/// How far the light of a quad that is neither tiny nor of last resort may be off, in units of the picture's mean irradiance.
pub fn quad_error(segment: &HullSegment, corners: &[Corner; 4], mean: f64) -> f64 {
    let normal = unpack_normal(segment.normal);
    let found = corners.map(|corner| average(corner.irradiance(normal)));
    let least = found.iter().copied().fold(f64::INFINITY, f64::min);
    let apart = found.iter().copied().fold(0.0, f64::max) - least;
    let totals = corners
        .iter()
        .flat_map(|corner| corner.moments.map(|m| m.total));
    let light = totals.sum::<f64>() / 12.0;
    relative_error(
        apart.max(0.3 * f64::from(segment.spread) * light),
        least,
        mean,
    )
}

/// How much each corner counts at a pixel, as a rasteriser interpolates them.
fn weights(segment: &HullSegment, corners: &[Corner; 4], pixel: [u32; 2]) -> [f64; 4] {
    let [left, top, right, bottom] = segment.rect;
    let depths = corners.map(|corner| corner.depth);
    let at = pixel.map(|x| f64::from(x) + 0.5);
    weights_between(
        [left, top],
        [right, bottom],
        depths,
        f64::from(segment.farthest),
        at,
    )
}

/// Of the corners of a rectangle drawn as two triangles.
fn weights_between(
    low: [u32; 2],
    high: [u32; 2],
    depths: [f64; 4],
    farthest: f64,
    at: [f64; 2],
) -> [f64; 4] {
    let [u, v] = [0, 1].map(|i| (at[i] - f64::from(low[i])) / f64::from(high[i] - low[i]));
    let flat = if u + v <= 1.0 {
        [1.0 - u - v, u, v, 0.0]
    } else {
        [0.0, 1.0 - v, 1.0 - u, u + v - 1.0]
    };
    let farthest = farthest.max(1e-30);
    let weights = [0, 1, 2, 3].map(|i| flat[i] / (depths[i] / farthest).clamp(1e-6, 1.0));
    let total: f64 = weights.iter().sum();
    weights.map(|w| w / total)
}

/// The moments that are interpolated at a pixel, a colour channel each.
pub fn moments_at(
    segment: &HullSegment,
    corners: &[Corner; 4],
    pixel: [u32; 2],
) -> [DLightMoments; 3] {
    let mut moments = [DLightMoments::ZERO; 3];
    for (corner, weight) in corners.iter().zip(weights(segment, corners, pixel)) {
        for (sum, m) in moments.iter_mut().zip(&corner.moments) {
            sum.vector += m.vector * weight;
            sum.total += m.total * weight;
        }
    }
    moments
}

/// Radiance that a white pixel of a quad that fits reflects, from its corners.
pub fn shade(
    segment: &HullSegment,
    corners: &[Corner; 4],
    pixel: [u32; 2],
    normal: DVec3,
) -> DVec3 {
    let weights = weights(segment, corners, pixel);
    let terms = || corners.iter().zip(weights);
    if is_flat(segment) {
        let normal = unpack_normal(segment.normal);
        return terms()
            .map(|(c, w)| c.irradiance(normal) * w)
            .sum::<DVec3>()
            / PI;
    }
    let excess: DVec3 = terms().map(|(c, w)| c.excess * w).sum();
    let moments = moments_at(segment, corners, pixel);
    (lobe_irradiance(&moments, normal) - excess).max(DVec3::ZERO) / PI
}

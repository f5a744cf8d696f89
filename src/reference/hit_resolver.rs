//! Mirror of `wgsl/hit_resolver.wgsl`.

use std::f64::consts::PI;

use glam::{DVec2, DVec3, DVec4, IVec2};
use rayon::prelude::*;

use super::{
    bounced_z_buffer::{NEAREST, PixelRays},
    directions::{Direction, directions, tangent_frame},
    shell_splatter::Receiver,
    temporal_accumulator::Pixel,
};
use crate::{
    BouncedSettings, Camera, HitResolverSettings, Payload, Sampling,
    hit_resolver::params::{falloff, near_radius, per_hit_distance, plane_unit},
};

/// What a reconstruction works on.
#[derive(Clone, Copy, Debug)]
pub struct HitResolution<'a> {
    /// The camera of the view.
    pub camera: &'a Camera,
    /// The eye that positions are relative to.
    pub origin: DVec3,
    /// The pixels of the viewport, rows from the top; `None` for the sky.
    pub receivers: &'a [Option<Receiver>],
    /// What the hits were traced with.
    pub traced: &'a BouncedSettings,
    /// What was kept of them.
    pub payload: Payload,
    /// How their directions were drawn.
    pub sampling: Sampling,
    /// The settings.
    pub settings: &'a HitResolverSettings,
    /// As [`HitResolverDescriptor::deferred`](crate::HitResolverDescriptor::deferred).
    pub deferred: bool,
    /// What came along each direction, in the order of [`directions`]: radiance, or 1 where nothing was hit.
    pub incoming: &'a [DVec3],
    /// How near each pixel's hits are, as [`BouncedView::nearness`](crate::BouncedView::nearness).
    pub nearness: &'a [u32],
    /// How many rays each pixel had, where they are counted.
    pub counts: Option<&'a [PixelRays]>,
    /// Means over frames to resolve in place of the hits' own.
    pub joined: Option<&'a [Pixel]>,
}

/// The least sum of neighbours' weights that a plane is fitted to, where the pixel itself has no rays.
const LEAST_KIN: f64 = 1e-3;

/// Neighbours are not taken to be farther away than so many units.
const FARTHEST: f64 = 1000.0;

/// A pixel's own mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mean {
    /// The mean.
    pub mean: DVec3,
    /// The variance of its luminance; negative where there are no rays, if they are counted.
    pub variance: f64,
}

/// A receiver's cosine to a direction over the density that the direction was drawn with.
fn share(normal: DVec3, drawn: Direction) -> f64 {
    normal.dot(drawn.direction).max(0.0) / (PI * drawn.pdf.max(1e-6))
}

const MOST_LUMINANCE: f64 = 1e16;

fn luminance(color: DVec3) -> f64 {
    let luminance = color.dot(DVec3::new(0.2126, 0.7152, 0.0722));
    luminance.min(MOST_LUMINANCE)
}

impl HitResolution<'_> {
    fn size(&self) -> IVec2 {
        let viewport = self.camera.viewport();
        IVec2::new(viewport.width as i32, viewport.height as i32)
    }

    fn drawn(&self) -> Vec<Option<Direction>> {
        let width = self.camera.viewport().width;
        directions(self.receivers, width, self.traced, self.sampling)
    }

    /// Each pixel's own mean over its directions.
    pub fn average(&self) -> Vec<Mean> {
        self.average_with(&[], 0)
    }

    /// The same with what came along so many rays towards emitters, those of a pixel together.
    pub fn average_with(&self, shone: &[DVec3], samples: usize) -> Vec<Mean> {
        let drawn = self.drawn();
        let rays_per_pixel = drawn.len() / self.receivers.len().max(1);
        (0..self.receivers.len())
            .map(|pixel| {
                let counts = self.counts.map(|counts| counts[pixel]);
                let none = Mean {
                    variance: if counts.is_some() { -1.0 } else { 0.0 },
                    ..Mean::default()
                };
                let Some(receiver) = self.receivers[pixel] else {
                    return none;
                };
                if counts.is_some_and(|own| own.rays == 0) {
                    return none;
                }
                let mut sum = DVec3::ZERO;
                let mut weights = 0.0;
                let mut squares = 0.0;
                for i in pixel * rays_per_pixel..(pixel + 1) * rays_per_pixel {
                    let mut weight = 1.0;
                    if let (Sampling::Uniform, Some(drawn)) = (self.sampling, drawn[i]) {
                        weight = share(receiver.normal, drawn);
                    }
                    let value = self.incoming[i];
                    sum += weight * value;
                    weights += weight;
                    squares += weight * luminance(value) * luminance(value);
                }
                let per_weight = 1.0 / f64::max(weights, 1e-6);
                let mut mean = sum * per_weight;
                let mut spread =
                    (squares * per_weight - luminance(mean) * luminance(mean)).max(0.0);
                let mut rays = rays_per_pixel as f64;
                let mut shone_mean = DVec3::ZERO;
                if samples > 0 {
                    let shone = &shone[pixel * samples..(pixel + 1) * samples];
                    let n = samples as f64;
                    let squares: f64 = shone.iter().map(|value| luminance(*value).powi(2)).sum();
                    shone_mean = shone.iter().sum::<DVec3>() / n;
                    mean += shone_mean;
                    sum += shone_mean * rays;
                    let of_shone = (squares / n - luminance(shone_mean).powi(2)).max(0.0);
                    spread += of_shone * rays / n;
                }
                let mut apart = 0.0;
                if let Some(own) = counts
                    && own.rays as usize > rays_per_pixel
                {
                    let first = rays_per_pixel as f64;
                    rays = f64::from(own.rays);
                    let all = (sum + own.sum) / rays;
                    let off = luminance(all) - luminance(mean);
                    apart = off * off * first / (rays - first);
                    mean = all;
                }
                let whole = match self.payload {
                    Payload::Occlusion => 1.0,
                    _ => luminance(mean),
                };
                let chance = 0.5 * whole / rays;
                let per_sample = rays_per_pixel as f64 / (samples.max(1) as f64 * rays);
                let aimed = 0.5 * luminance(shone_mean) * per_sample;
                Mean {
                    mean,
                    variance: 0.5 * f64::max(spread / rays, apart)
                        + chance * chance
                        + aimed * aimed,
                }
            })
            .collect()
    }

    /// Of each pixel by how much the mean of the open directions leans off that of all, and in the last component the share of
    /// those that are open.
    pub fn lean(&self) -> Vec<DVec4> {
        let drawn = self.drawn();
        let rays_per_pixel = drawn.len() / self.receivers.len().max(1);
        (0..self.receivers.len())
            .map(|pixel| {
                let (mut open, mut all) = (DVec4::ZERO, DVec3::ZERO);
                let own = pixel * rays_per_pixel..(pixel + 1) * rays_per_pixel;
                for (ray, incoming) in drawn[own.clone()].iter().zip(&self.incoming[own]) {
                    let Some(Direction { direction, .. }) = ray else {
                        return DVec4::ZERO;
                    };
                    open += incoming.x * direction.extend(1.0);
                    all += *direction;
                }
                let per_ray = 1.0 / rays_per_pixel as f64;
                let openness = open.w * per_ray;
                ((open.truncate() - openness * all) * per_ray).extend(openness)
            })
            .collect()
    }

    /// Bent normals, and in the last component visibility, of what [`lean`](Self::lean) gave; `None` for the sky.
    pub fn bent(&self, leans: &[DVec4], near: &[f64]) -> Vec<Option<DVec4>> {
        let rays = f64::from(self.traced.rays_per_pixel.max(1));
        let chance = 0.5 / rays;
        let fitted = |part: &dyn Fn(&DVec4) -> DVec3| {
            let means: Vec<Mean> = leans
                .iter()
                .map(|lean| Mean {
                    mean: part(lean),
                    variance: 0.5 * lean.w * (1.0 - lean.w) / rays + chance * chance,
                })
                .collect();
            self.fit(&means, Some(leans), near)
        };
        let leaning = fitted(&|lean| lean.truncate());
        let openness = fitted(&|lean| DVec3::splat(lean.w));
        (0..self.receivers.len())
            .map(|i| {
                let normal = self.receivers[i]?.normal;
                let openness = openness[i]?.x.clamp(0.0, 1.0);
                let bent = leaning[i]? + 2.0 / 3.0 * openness * normal;
                Some(bent.normalize_or(normal).extend(openness))
            })
            .collect()
    }

    /// A pixel's side at a receiver.
    pub(super) fn side(&self, receiver: &Receiver) -> f64 {
        let eye = self.camera.eye() - self.origin;
        self.camera.footprint().at(receiver.position - eye)
    }

    pub(super) fn per_tolerance_at(&self, pixel: f64) -> f64 {
        1.0 / (f64::from(self.settings.plane_distance) * pixel).max(1e-30)
    }

    /// How far a neighbour's surface is the pixel's own; `d` leads from the pixel to it.
    pub(super) fn kinship(
        &self,
        normal: DVec3,
        other_normal: DVec3,
        d: DVec3,
        per_tolerance: f64,
    ) -> f64 {
        let off_plane = normal.dot(d).abs().max(other_normal.dot(d).abs()) * per_tolerance;
        let in_plane = (1.0 - off_plane * off_plane).max(0.0);
        let power = f64::from(self.settings.normal_power);
        let alike = (1.0 - power / 8.0 * (1.0 - normal.dot(other_normal))).max(0.0);
        in_plane * in_plane * alike.powi(8)
    }

    /// The mean of 1 / distance of the hits about each pixel.
    pub fn near(&self) -> Vec<f64> {
        let width = self.size().x;
        (0..self.receivers.len() as i32)
            .into_par_iter()
            .map(|i| self.near_at(IVec2::new(i % width, i / width)))
            .collect()
    }

    fn near_at(&self, at: IVec2) -> f64 {
        let index = |p: IVec2| (p.y * self.size().x + p.x) as usize;
        let Some(Receiver { position, normal }) = self.receivers[index(at)] else {
            return 0.0;
        };
        let per_tolerance = self.per_tolerance_at(self.side(&Receiver { position, normal }));
        let radius = IVec2::splat(near_radius(self.traced.rays_per_pixel) as i32);
        let low = (at - radius).max(IVec2::ZERO);
        let high = (at + radius).min(self.size() - 1);
        let mut sum = 0.0;
        let mut weights = 0.0;
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                let there = IVec2::new(x, y);
                let Some(other) = self.receivers[index(there)] else {
                    continue;
                };
                let rays = self
                    .counts
                    .map_or(self.traced.rays_per_pixel.max(1), |counts| {
                        counts[index(there)].rays
                    });
                if rays == 0 {
                    continue;
                }
                let d = other.position - position;
                let mut weight = self.kinship(normal, other.normal, d, per_tolerance);
                if there == at {
                    weight = 1.0;
                }
                let units = f64::from(rays) * NEAREST * self.side(&other).max(1e-30);
                sum += weight * f64::from(self.nearness[index(there)]) / units;
                weights += weight;
            }
        }
        sum / f64::max(weights, 1e-30)
    }

    /// The plane about each pixel, before it meets the albedo; `None` for the sky.
    pub fn reconstruct(&self, means: &[Mean], near: &[f64]) -> Vec<Option<DVec3>> {
        self.fit(means, None, near)
            .into_iter()
            .map(|value| {
                let value = value?;
                Some(match self.payload {
                    Payload::Occlusion => value.clamp(DVec3::ZERO, DVec3::ONE),
                    _ => value.max(DVec3::ZERO),
                })
            })
            .collect()
    }

    /// The same before it is held to what there can be, with neighbours' differences those of `leans` where there are any.
    fn fit(&self, means: &[Mean], leans: Option<&[DVec4]>, near: &[f64]) -> Vec<Option<DVec3>> {
        let drawn = self.drawn();
        let width = self.size().x;
        (0..self.receivers.len() as i32)
            .into_par_iter()
            .map(|i| {
                self.reconstructed(
                    (means, leans, near),
                    &drawn,
                    IVec2::new(i % width, i / width),
                )
            })
            .collect()
    }

    fn reconstructed(
        &self,
        (means, leans, near): (&[Mean], Option<&[DVec4]>, &[f64]),
        drawn: &[Option<Direction>],
        at: IVec2,
    ) -> Option<DVec3> {
        let index = |p: IVec2| (p.y * self.size().x + p.x) as usize;
        let rays_per_pixel = drawn.len() / self.receivers.len();
        let settings = self.settings;
        let Receiver { position, normal } = self.receivers[index(at)]?;
        let frame = tangent_frame(normal);
        let mean_at = |i: usize| match self.joined {
            Some(joined) => Mean {
                mean: joined[i].mean,
                variance: means[i].variance / joined[i].frames.max(1.0),
            },
            None => means[i],
        };
        let narrowed = self.joined.map_or(1.0, |joined| {
            let frames = joined[index(at)].frames / f64::from(settings.frames);
            frames.max(1.0).powf(settings.narrowing.into())
        });
        let own = mean_at(index(at));
        let pixel = self.side(&Receiver { position, normal });
        let per_tolerance = self.per_tolerance_at(pixel);
        let per_spread = narrowed / (f64::from(plane_unit(settings)) * pixel).max(1e-30);
        let falloff = f64::from(falloff(settings)) * narrowed * narrowed;
        let per_hit_distance = f64::from(per_hit_distance(settings));
        let radius = IVec2::splat((f64::from(settings.radius) / narrowed).ceil() as i32);
        let low = (at - radius).max(IVec2::ZERO);
        let high = (at + radius).min(self.size() - 1);
        let mut weights = 0.0;
        let mut moments = DVec2::ZERO;
        let mut squares = DVec3::ZERO;
        let mut sum = DVec3::ZERO;
        let mut sum_u = DVec3::ZERO;
        let mut sum_v = DVec3::ZERO;
        let mut near_sum = DVec3::ZERO;
        let mut near_weights = 0.0;
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                let there = IVec2::new(x, y);
                let Some(other) = self.receivers[index(there)] else {
                    continue;
                };
                let d = other.position - position;
                let mut weight = self.kinship(normal, other.normal, d, per_tolerance);
                let theirs = mean_at(index(there));
                let aside = (there - at).as_dvec2();
                if theirs.variance < 0.0 {
                    continue;
                }
                let plain = (-aside.length_squared() * falloff).exp();
                near_sum += plain * theirs.mean;
                near_weights += plain;
                let nearest = near[index(at)].max(near[index(there)]);
                let hits_aside = d.length() * nearest * per_hit_distance;
                let mut distance = aside.length_squared() * falloff + hits_aside * hits_aside;
                if settings.variance_clamp > 0.0 && own.variance >= 0.0 {
                    let difference = match leans {
                        Some(leans) => (leans[index(there)] - leans[index(at)]).length(),
                        None => luminance(theirs.mean) - luminance(own.mean),
                    };
                    let variance_clamp = f64::from(settings.variance_clamp);
                    let allowed =
                        variance_clamp * variance_clamp * (theirs.variance + own.variance) + 1e-30;
                    distance += difference * difference / allowed;
                }
                weight *= (-distance).exp();
                if there == at {
                    weight = 1.0;
                }
                let mut weighted = weight * (theirs.mean - own.mean);
                if self.deferred {
                    let mut shares = 0.0;
                    weighted = DVec3::ZERO;
                    if weight > 1e-3 {
                        let theirs =
                            index(there) * rays_per_pixel..(index(there) + 1) * rays_per_pixel;
                        for (drawn, &incoming) in
                            drawn[theirs.clone()].iter().zip(&self.incoming[theirs])
                        {
                            let own_share = weight * share(normal, (*drawn)?).min(4.0);
                            weighted += own_share * incoming;
                            shares += own_share;
                        }
                    }
                    weight = shares;
                    weighted -= weight * own.mean;
                }
                let place = ((frame.transpose() * d).truncate() * per_spread)
                    .clamp(DVec2::splat(-FARTHEST), DVec2::splat(FARTHEST));
                weights += weight;
                moments += weight * place;
                squares += weight * (place * place).extend(place.x * place.y);
                sum += weighted;
                sum_u += weighted * place.x;
                sum_v += weighted * place.y;
            }
        }
        if own.variance < 0.0 && weights < LEAST_KIN {
            return Some(match self.payload {
                _ if near_weights > 0.0 => near_sum / near_weights,
                Payload::Occlusion => DVec3::ONE,
                _ => DVec3::ZERO,
            });
        }
        let per_weight = 1.0 / f64::max(weights, 1e-6);
        let average = sum * per_weight;
        let middle = moments * per_weight;
        let spread = squares * per_weight - (middle * middle).extend(middle.x * middle.y);
        let damping = f64::from(settings.damping).min(1e9);
        let uu = spread.x + damping;
        let vv = spread.y + damping;
        let uv = spread.z;
        let along_u = sum_u * per_weight - average * middle.x;
        let along_v = sum_v * per_weight - average * middle.y;
        let per_determinant = 1.0 / (uu * vv - uv * uv).max(1e-30);
        let slope_u = (vv * along_u - uv * along_v) * per_determinant;
        let slope_v = (uu * along_v - uv * along_u) * per_determinant;
        Some(own.mean + average - slope_u * middle.x - slope_v * middle.y)
    }
}

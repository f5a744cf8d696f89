//! Subsurface scattering by brute force: the dipole between every receiver and points all over a body.
//!
//! `L = F_dt / π ∫ R_d(|x − y|) E(y) dA(y)` over the fronts of the body's triangles, with E the irradiance straight from lights
//! with traced shadows, and `R_d` and `F_dt` those of a [`Scattering`] (Jensen and Buhler 2002, who draw the points at random;
//! here each triangle is cut into equal ones, and points are their centroids, which leaves far less error).

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use super::{
    Tracer,
    hemisphere::{Receiver, of_each},
};
use crate::{Light, Scattering};

/// A point of a body that stands for the surface around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LitPoint {
    /// Where it is.
    pub position: DVec3,
    /// Irradiance times the area that it stands for, W.
    pub flux: DVec3,
}

impl Tracer {
    /// Lights points of the triangles that `scatters` says, by their place in the list that [`new`](Self::new) was given: as many
    /// as come to about `count` in all, each for about as much area. Those that no light reaches are left out.
    pub fn lit_points(
        &self,
        scatters: impl Fn(usize) -> bool + Sync,
        lights: &[Light],
        count: u32,
    ) -> Vec<LitPoint> {
        let all = self.trees.iter().flat_map(|tree| &tree.triangles);
        let body: Vec<[DVec3; 3]> = all
            .filter(|triangle| scatters(triangle.index()))
            .map(super::Triangle::corners)
            .collect();
        let area_of = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).length();
        let area: f64 = body.iter().map(|&corners| area_of(corners)).sum();
        let each = area / f64::from(count.max(1));
        body.into_par_iter()
            .flat_map_iter(|corners| {
                let [a, b, c] = corners;
                let rows = (area_of(corners) / each).sqrt().round().max(1.0) as u32;
                let step = 1.0 / f64::from(rows);
                let own = area_of(corners) * step * step;
                let normal = (b - a).cross(c - a).normalize_or_zero();
                let cells =
                    (0..rows).flat_map(move |i| (0..2 * (rows - i) - 1).map(move |k| (i, k)));
                cells.filter_map(move |(i, k)| {
                    // Upright cells have even numbers, those between them odd ones.
                    let third = f64::from(1 + k % 2) / 3.0;
                    let [u, v] = [f64::from(k / 2), f64::from(i)].map(|n| (n + third) * step);
                    let position = a + u * (b - a) + v * (c - a);
                    // A white surface sends irradiance over pi.
                    let sent = self.direct(position, normal, DVec3::ONE, lights);
                    let flux = PI * own * sent;
                    (flux != DVec3::ZERO).then_some(LitPoint { position, flux })
                })
            })
            .collect()
    }

    /// What receivers send of what points of their body let in, outgoing radiance, W/(m² sr). Points farther than `reach` are
    /// left out, which may be infinity. `progress` shows a bar on standard error.
    pub fn subsurface_scattering_image(
        receivers: &[Option<Receiver>],
        points: &[LitPoint],
        scattering: &Scattering,
        reach: f64,
        progress: bool,
    ) -> Vec<Option<DVec3>> {
        let dipoles = scattering.dipoles();
        let transmittance = scattering.transmittance();
        of_each(receivers, 0, progress, |at, _| {
            let mut exitance = DVec3::ZERO;
            for point in points {
                let distance2 = point.position.distance_squared(at.position);
                if distance2 <= reach * reach {
                    let distance = distance2.sqrt();
                    exitance += point.flux * DVec3::from(dipoles.map(|d| d.profile(distance)));
                }
            }
            transmittance / PI * exitance
        })
    }
}

//! Mirror of `wgsl/surfel_shader.wgsl`, with positions in world space.

use std::f64::consts::PI;

use glam::{DVec2, DVec3, DVec4};

use super::{
    light::{Arrival, arrival},
    surfelizer::{Triangle, centroid, leaf_of},
};
use crate::{Camera, Light, Material, surfel_shader::params::texel};

pub(super) const BRIGHTEST: f64 = 1e18;
const SEAM: f64 = 1e-5;

/// A surfel as it is lit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surfel {
    /// Its centre.
    pub position: DVec3,
    /// Its unit normal.
    pub normal: DVec3,
    /// Index into the material table.
    pub material: u32,
    /// The triangle that it stands for, where it has one.
    pub leaf: Option<Triangle>,
}

/// [`crate::SurfelRadiance`] in f64.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Radiance {
    /// Of the front side.
    pub front: DVec3,
    /// Of the back side.
    pub back: DVec3,
}

/// [`crate::ShadowMap`] on the CPU.
#[derive(Clone, Copy, Debug)]
pub struct ShadowMap<'a> {
    /// The texels of each layer, rows from the top.
    pub depth: &'a [Vec<f32>],
    /// Texels in a row.
    pub width: u32,
    /// As [`crate::ShadowMap::cameras`].
    pub cameras: &'a [Camera],
    /// As [`crate::ShadowMap::bias`].
    pub bias: f64,
    /// How far a stored depth may lie from the true one: 0 for 32 bits, a step of the format for fewer.
    pub depth_step: f64,
}

/// A light, and its shadow map if it casts shadows.
#[derive(Clone, Copy, Debug)]
pub struct ShadedLight<'a> {
    /// The light.
    pub light: Light,
    /// Its map.
    pub shadow: Option<ShadowMap<'a>>,
}

pub(super) fn sanitize(color: [f32; 3]) -> DVec3 {
    let sound = |c: f32| {
        if c.is_finite() {
            f64::from(c).clamp(0.0, BRIGHTEST)
        } else {
            0.0
        }
    };
    DVec3::from(color.map(sound))
}

/// What a side of a surface sends of its own.
pub(super) fn own_radiosity(material: &Material, front: bool) -> DVec3 {
    if front || material.double_sided != 0 {
        sanitize(material.emission)
    } else {
        DVec3::ZERO
    }
}

impl ShadowMap<'_> {
    /// A point in the clip space of the first map that knows of it.
    fn first_map(&self, point: DVec3) -> Option<(usize, DVec4)> {
        self.cameras.iter().enumerate().find_map(|(layer, camera)| {
            let clip = camera.clip_matrix(camera.eye()) * (point - camera.eye()).extend(1.0);
            let bound = clip.w * (1.0 + SEAM);
            let inside = clip.w > 0.0
                && clip.x.abs() <= bound
                && clip.y.abs() <= bound
                && (0.0..=clip.w).contains(&clip.z);
            inside.then_some((layer, clip))
        })
    }

    /// What the map says of a point of a surface; `side` is the normal on the side of the light.
    pub fn look_up(&self, point: DVec3, side: DVec3) -> Option<LookUp> {
        let (layer, own) = self.first_map(point)?;
        let moved = point + side * (self.bias * texel(&self.cameras[layer]) * own.w);
        let (layer, seen) = self.first_map(moved)?;
        let viewport = self.cameras[layer].viewport();
        let at = |ndc: f64, from: u32, texels: u32| {
            let texel = ((ndc * 0.5 + 0.5).clamp(0.0, 1.0) * f64::from(texels)) as u32;
            from + texel.min(texels - 1)
        };
        let ndc = seen.truncate() / seen.w;
        let x = at(ndc.x, viewport.x, viewport.width);
        let y = at(-ndc.y, viewport.y, viewport.height);
        // The map holds depths at the middles of its texels.
        let middle = |texel: u32, from: u32, texels: u32| {
            (f64::from(texel - from) + 0.5) / f64::from(texels) * 2.0 - 1.0
        };
        let middle = DVec2::new(
            middle(x, viewport.x, viewport.width),
            -middle(y, viewport.y, viewport.height),
        );
        Some(LookUp {
            layer,
            depth: ndc.z + self.cameras[layer].tilt().dot(middle - ndc.truncate()),
            nearest: f64::from(self.depth[layer][(y * self.width + x) as usize]),
            w: seen.w,
        })
    }

    /// Whether something is nearer to the light.
    pub fn is_hidden(&self, found: &LookUp) -> bool {
        if self.cameras[found.layer].background_depth() == 0.0 {
            found.nearest > found.depth + self.depth_step
        } else {
            found.nearest < found.depth - self.depth_step
        }
    }

    /// Side of a texel where a point is, 0 where no map knows of it.
    pub fn texel_side(&self, point: DVec3) -> f64 {
        self.first_map(point)
            .map_or(0.0, |(layer, own)| texel(&self.cameras[layer]) * own.w)
    }

    /// Share of a light that arrives at a point of a surface; `side` is the normal on the side of the light.
    pub fn lit(&self, point: DVec3, side: DVec3) -> f64 {
        let hidden = self
            .look_up(point, side)
            .is_some_and(|f| self.is_hidden(&f));
        if hidden { 0.0 } else { 1.0 }
    }
}

/// What a map says of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookUp {
    /// The map's layer that knows of it.
    pub layer: usize,
    /// Of the point.
    pub depth: f64,
    /// Of what the light sees there.
    pub nearest: f64,
    /// The clip space's of the point.
    pub w: f64,
}

/// What one surfel sends. `samples` is a power of two; a surfel without a triangle is lit at its centre alone.
pub fn shade(
    surfel: &Surfel,
    materials: &[Material],
    lights: &[ShadedLight<'_>],
    samples: u32,
) -> Radiance {
    let material = materials[(surfel.material as usize).min(materials.len() - 1)];
    let mut radiance = Radiance {
        front: own_radiosity(&material, true) / PI,
        back: own_radiosity(&material, false) / PI,
    };
    let points: Vec<DVec3> = match surfel.leaf {
        Some(leaf) if samples > 1 => (0..samples)
            .map(|k| centroid(leaf_of(leaf, k, samples.trailing_zeros())))
            .collect(),
        _ => vec![surfel.position],
    };
    for shaded in lights {
        let (mut to_front, mut to_back) = (DVec3::ZERO, DVec3::ZERO);
        for &point in &points {
            let Arrival {
                to_light,
                irradiance,
                ..
            } = arrival(&shaded.light, point);
            let cosine = surfel.normal.dot(to_light);
            let lit = |side| shaded.shadow.map_or(1.0, |map| map.lit(point, side));
            if cosine > 0.0 {
                to_front += irradiance * cosine * lit(surfel.normal);
            } else if cosine < 0.0 {
                to_back -= irradiance * cosine * lit(-surfel.normal);
            }
        }
        let share = sanitize(material.albedo) / (PI * points.len() as f64);
        let brightest = DVec3::splat(BRIGHTEST);
        radiance.front = (radiance.front + share * to_front).min(brightest);
        radiance.back = (radiance.back + share * to_back).min(brightest);
    }
    radiance
}

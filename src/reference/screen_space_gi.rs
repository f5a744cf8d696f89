//! Mirror of `wgsl/screen_space_gi.wgsl`.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use rayon::prelude::*;

use super::{
    directions::tangent_frame,
    hashing::{hash2, unit_float},
    receivers::Decoder,
    shell_splatter::Receiver,
};
use crate::ScreenSpaceGiSettings;

const BRIGHTEST: f64 = 65504.0;

/// What light is gathered from: the pixels of the viewport, rows from the top.
#[derive(Clone, Copy, Debug)]
pub struct ScreenSpaceGi<'a> {
    /// The G-buffer's encoding; positions are relative to the camera's eye.
    pub decoder: Decoder<'a>,
    /// Depth as it is stored.
    pub depth: &'a [f64],
    /// Normals as they are stored.
    pub normal: &'a [DVec3],
    /// Radiance.
    pub lit: &'a [DVec3],
    /// The settings.
    pub settings: &'a ScreenSpaceGiSettings,
}

/// A point of the unit ball's upper half.
fn ball_point(i: u32, samples: u32, turn: f64) -> DVec3 {
    let height = (f64::from(i) + 0.5) / f64::from(samples);
    let angle = TAU * unit_float(i.reverse_bits()) + turn;
    let spread = unit_float(i.wrapping_mul(0x9e37_79b9).wrapping_add(0x8000_0000)).cbrt();
    let across = (1.0 - height * height).max(0.0).sqrt();
    spread * DVec3::new(across * angle.cos(), across * angle.sin(), height)
}

impl ScreenSpaceGi<'_> {
    /// What of the radiance that a sample finds arrives, in units of irradiance / π.
    fn arriving(&self, p: &Receiver, at: DVec3, area: f64) -> Option<DVec3> {
        let camera = self.decoder.camera;
        let viewport = camera.viewport();
        let place = camera.project(at)?;
        let inside = |c: f64, n: u32| (0.0..f64::from(n)).contains(&c);
        if !inside(place.x, viewport.width) || !inside(place.y, viewport.height) {
            return None;
        }
        let pixel = [place.x as u32, place.y as u32];
        let i = (pixel[1] * viewport.width + pixel[0]) as usize;
        let q = self.decoder.unproject(pixel, self.depth[i])?;
        let to_camera = if camera.is_perspective() {
            -q
        } else {
            -camera.forward()
        };
        let offset = q - p.position;
        let radius = f64::from(self.settings.radius);
        if (at - q).dot(to_camera) >= 0.0 || offset.length_squared() > radius * radius {
            return None;
        }
        let direction = offset.normalize_or_zero();
        let normal = self.decoder.decode_normal(self.normal[i], DVec3::ZERO);
        let cosines = p.normal.dot(direction).max(0.0) * (-normal.dot(direction)).max(0.0);
        let radiance = self.lit[i];
        (cosines > 0.0 && radiance.is_finite()).then(|| {
            let clamped = radiance.clamp(DVec3::ZERO, DVec3::splat(BRIGHTEST));
            clamped * (cosines * area / (PI * offset.length_squared() + area))
        })
    }

    /// Irradiance / π at a pixel, and 0 for the sky.
    pub fn gather(&self, pixel: [u32; 2]) -> DVec3 {
        let viewport = self.decoder.camera.viewport();
        let i = (pixel[1] * viewport.width + pixel[0]) as usize;
        let Some(p) = self.decoder.prepare(pixel, self.depth[i], self.normal[i]) else {
            return DVec3::ZERO;
        };
        let settings = self.settings;
        let frame = tangent_frame(p.normal);
        let turn = if settings.turn {
            TAU * unit_float(hash2(pixel[0], pixel[1]))
        } else {
            0.0
        };
        let radius = f64::from(settings.radius);
        let area = TAU * radius * radius / f64::from(settings.samples);
        (0..settings.samples)
            .filter_map(|i| {
                let at = p.position + frame * (radius * ball_point(i, settings.samples, turn));
                self.arriving(&p, at, area)
            })
            .sum::<DVec3>()
            .min(DVec3::splat(BRIGHTEST))
    }

    /// The image, rows from the top.
    pub fn image(&self) -> Vec<DVec3> {
        let viewport = self.decoder.camera.viewport();
        (0..viewport.width * viewport.height)
            .into_par_iter()
            .map(|i| self.gather([i % viewport.width, i / viewport.width]))
            .collect()
    }
}

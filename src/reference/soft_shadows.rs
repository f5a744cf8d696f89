//! Mirror of `wgsl/soft_shadows.wgsl`, with positions in world space.

use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3};

use super::{
    directions::tangent_frame,
    hashing::{hash2, unit_float},
    light::{Arrival, arrival},
    shell_splatter::Receiver,
    surfel_shader::{LookUp, ShadowMap},
};
use crate::{Light, SoftShadowsSettings, surfel_shader::params::depth_scale};

const STEEPEST: f64 = 16.0;
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// A light and its map.
#[derive(Clone, Copy, Debug)]
pub struct SoftShadows<'a> {
    /// The light.
    pub light: &'a Light,
    /// Its map.
    pub map: ShadowMap<'a>,
    /// The settings.
    pub settings: &'a SoftShadowsSettings,
}

/// A pixel's surface and the light.
struct Seen {
    point: DVec3,
    normal: DVec3,
    arrival: Arrival,
    frame: DMat3,
    turn: f64,
}

/// Points of a spiral in the unit disk: with the exponent 0.5 they cover it evenly, with 1 they are denser towards the middle.
fn spiral(i: u32, count: u32, exponent: f64, turn: f64) -> DVec2 {
    let angle = f64::from(i) * GOLDEN_ANGLE + turn;
    ((f64::from(i) + 0.5) / f64::from(count)).powf(exponent) * DVec2::from_angle(angle)
}

impl SoftShadows<'_> {
    fn is_directional(&self) -> bool {
        matches!(self.light, Light::Directional { .. })
    }

    /// The point of the tangent plane that the light's middle sees at an offset across its ray to the pixel.
    fn beside(&self, seen: &Seen, offset: DVec2) -> DVec3 {
        let across = seen.frame * offset.extend(0.0);
        let mut along = -seen.arrival.to_light;
        if !self.is_directional() {
            along = (along + across / seen.arrival.distance).normalize_or(along);
        }
        let steepness = seen.normal.dot(across) / seen.normal.dot(along).min(-1e-6);
        let most = STEEPEST * offset.length();
        seen.point + across - steepness.clamp(-most, most) * along
    }

    /// How far a blocker is from the surface along the light's ray; `None` where there is none.
    fn gap(&self, seen: &Seen, found: Option<LookUp>) -> Option<f64> {
        let found = found.filter(|f| self.map.is_hidden(f))?;
        let camera = &self.map.cameras[found.layer];
        let scale = depth_scale(camera);
        if !camera.is_perspective() {
            return Some((scale * (found.depth - found.nearest)).max(0.0));
        }
        let own = found.w / camera.projection().row(3).z.abs();
        let apart = (found.nearest - found.depth) * own;
        let share = (apart / (scale + apart)).clamp(0.0, 1.0);
        Some(if self.is_directional() {
            share * own
        } else {
            share * seen.arrival.distance
        })
    }

    fn penumbra(&self, seen: &Seen, gap: f64) -> f64 {
        let extent = f64::from(self.settings.extent);
        let width = if self.is_directional() {
            extent * gap
        } else {
            let distance = seen.arrival.distance;
            extent * gap / (distance - gap).max(1e-6 * distance)
        };
        width.min(self.settings.max_penumbra.into())
    }

    /// The share of the light that arrives at a pixel of an image; `receiver` is in world space.
    pub fn visibility(&self, receiver: Option<Receiver>, [x, y]: [u32; 2]) -> f64 {
        let Some(receiver) = receiver else {
            return 1.0;
        };
        let settings = self.settings;
        let arrival = arrival(self.light, receiver.position);
        if receiver.normal.dot(arrival.to_light) <= 0.0 {
            return 0.0;
        }
        let seen = Seen {
            point: receiver.position,
            normal: receiver.normal,
            frame: tangent_frame(arrival.to_light),
            arrival,
            turn: if settings.turn {
                TAU * unit_float(hash2(x, y))
            } else {
                0.0
            },
        };
        if settings.extent == 0.0 {
            return f64::from(u8::from(!self.is_hidden(&seen, seen.point)));
        }
        let Some(width) = self.width_at(&seen) else {
            return 1.0;
        };
        f64::from(self.lit_of(&seen, width)) / f64::from(settings.samples)
    }

    fn look_up(&self, seen: &Seen, point: DVec3) -> Option<LookUp> {
        // Off the surface, and as far to the light.
        self.map.look_up(point, seen.normal + seen.arrival.to_light)
    }

    fn is_hidden(&self, seen: &Seen, point: DVec3) -> bool {
        self.look_up(seen, point)
            .is_some_and(|found| self.map.is_hidden(&found))
    }

    /// Half width of a pixel's penumbra; `None` where nothing blocks the light.
    fn width_at(&self, seen: &Seen) -> Option<f64> {
        let settings = self.settings;
        let middle = self.gap(seen, self.look_up(seen, seen.point));
        let mut gaps: Vec<f64> = middle.into_iter().collect();
        for i in 0..settings.blockers {
            let offset =
                f64::from(settings.max_penumbra) * spiral(i, settings.blockers, 1.0, seen.turn);
            let found = self.gap(seen, self.look_up(seen, self.beside(seen, offset)));
            gaps.extend(
                found.filter(|&gap| gap > 0.0 && offset.length() <= self.penumbra(seen, gap)),
            );
        }
        let mean = gaps.iter().sum::<f64>() / gaps.len().max(1) as f64;
        let width = self
            .penumbra(seen, mean)
            .max(self.map.texel_side(seen.point));
        (!gaps.is_empty()).then_some(width)
    }

    /// How many of the samples are lit.
    fn lit_of(&self, seen: &Seen, width: f64) -> u32 {
        let is_lit = |i| {
            let offset = width * spiral(i, self.settings.samples, 0.5, seen.turn);
            !self.is_hidden(seen, self.beside(seen, offset))
        };
        (0..self.settings.samples)
            .map(|i| u32::from(is_lit(i)))
            .sum()
    }
}

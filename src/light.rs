//! Lights, as indirect light knows them: hard ones, each with the direct light that it sends.

use std::f32::consts::FRAC_PI_2;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::error::{Error, check_setting};

/// The brightest that a light may be, in its own unit: squares of what surfaces then send still fit into f32.
pub(crate) const MAX_LIGHT: f32 = 1e18;

/// A light without extent. Colours are linear RGB; a black one is valid and lights nothing. Positions and directions are
/// the world's; a direction is that of travel, away from the light, of any length but zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// A light at infinity.
    Directional {
        /// The direction in which the light travels.
        direction: DVec3,
        /// Irradiance of a surface that faces the light, W/m², each 0…1e18.
        irradiance: [f32; 3],
    },
    /// A light that sends the same into all directions. A surface that faces it, at distance d, has the irradiance
    /// `intensity / d²`.
    Point {
        /// Where it is, world units.
        position: DVec3,
        /// Radiant intensity, W/sr, each 0…1e18.
        intensity: [f32; 3],
    },
    /// A point light with a cone. At the angle θ from its axis the intensity is multiplied by `t² (3 − 2 t)` with
    /// `t = clamp((cos θ − cos outer) / (cos inner − cos outer), 0, 1)`: whole within the inner cone, none outside of the
    /// outer one, and without a kink at either. Where both are the same the edge is sharp.
    Spot {
        /// Where it is, world units.
        position: DVec3,
        /// The cone's axis.
        direction: DVec3,
        /// Radiant intensity within the inner cone, W/sr, each 0…1e18.
        intensity: [f32; 3],
        /// Half the opening angle of the cone that has all of the intensity, radians, 0…`outer`.
        inner: f32,
        /// Half the opening angle of the cone that has any, radians, up to π/2.
        outer: f32,
    },
}

impl Light {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        match self {
            Self::Directional {
                direction,
                irradiance,
            } => {
                check_direction(*direction)?;
                check_color("Light::irradiance", *irradiance)
            }
            Self::Point {
                position,
                intensity,
            } => {
                check_position(*position)?;
                check_color("Light::intensity", *intensity)
            }
            Self::Spot {
                position,
                direction,
                intensity,
                inner,
                outer,
            } => {
                check_position(*position)?;
                check_direction(*direction)?;
                check_color("Light::intensity", *intensity)?;
                check_setting(
                    (0.0..=FRAC_PI_2).contains(outer),
                    "Light::outer",
                    *outer,
                    "0 to pi/2",
                )?;
                check_setting(
                    (0.0..=*outer).contains(inner),
                    "Light::inner",
                    *inner,
                    "0 to Light::outer",
                )
            }
        }
    }

    /// Whether it sends anything at all.
    pub(crate) fn is_emitting(&self) -> bool {
        let (Self::Directional {
            irradiance: color, ..
        }
        | Self::Point {
            intensity: color, ..
        }
        | Self::Spot {
            intensity: color, ..
        }) = self;
        color.iter().any(|c| *c > 0.0)
    }
}

/// `Light` of `wgsl/common/light.wgsl`. All zero is no light.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct LightParams {
    pub(crate) position: [f32; 3],
    pub(crate) kind: u32,
    pub(crate) direction: [f32; 3],
    pub(crate) outer: f32,
    pub(crate) color: [f32; 3],
    pub(crate) sharpness: f32,
}

crate::reflection::same_as_wgsl!(
    lights_are_the_shaders: LightParams as "Light" in [
        "surfel_shader shadow map samples", "sg_hull_gather lights",
    ]
    { position, kind, direction, outer, color, sharpness }
);

impl LightParams {
    /// In the eye space of `origin`.
    pub fn new(light: &Light, origin: DVec3) -> Self {
        // Infinity never goes to a shader: coordinates beyond this are taken to lie there.
        let farthest = DVec3::splat(MAX_LIGHT.into());
        let relative = |p: DVec3| (p - origin).clamp(-farthest, farthest).as_vec3().to_array();
        let unit = |d: DVec3| d.normalize_or_zero().as_vec3().to_array();
        match *light {
            Light::Directional {
                direction,
                irradiance,
            } => Self {
                kind: 1,
                direction: unit(direction),
                color: irradiance,
                ..Self::default()
            },
            Light::Point {
                position,
                intensity,
            } => Self {
                kind: 2,
                position: relative(position),
                color: intensity,
                ..Self::default()
            },
            Light::Spot {
                position,
                direction,
                intensity,
                inner,
                outer,
            } => {
                let [inner, outer] = [inner, outer].map(versine);
                Self {
                    kind: 3,
                    position: relative(position),
                    direction: unit(direction),
                    outer: outer as f32,
                    color: intensity,
                    sharpness: (1.0 / (outer - inner).max(1e-18)) as f32,
                }
            }
        }
    }
}

/// 1 − cos of an angle, with the digits that the cosine of a small one loses.
pub(crate) fn versine(angle: f32) -> f64 {
    2.0 * (f64::from(angle) / 2.0).sin().powi(2)
}

fn check_position(position: DVec3) -> Result<(), Error> {
    let bad = position.to_array().into_iter().find(|x| !x.is_finite());
    check_setting(
        bad.is_none(),
        "Light::position",
        bad.unwrap_or(0.0),
        "finite",
    )
}

fn check_direction(direction: DVec3) -> Result<(), Error> {
    check_setting(
        direction.try_normalize().is_some(),
        "Light::direction",
        direction.length(),
        "of a finite length above 0",
    )
}

fn check_color(field: &'static str, color: [f32; 3]) -> Result<(), Error> {
    let bad = color.into_iter().find(|c| !(0.0..=MAX_LIGHT).contains(c));
    check_setting(bad.is_none(), field, bad.unwrap_or(0.0), "0 to 1e18")
}

//! How far pictures of an effect are apart, in the unit of the errors that plans are made for.

use deep_screen_space::{HitResolver, RayTracedEffect, glam::DVec3};

use crate::stage::luminance;

/// Bent normals count where their cone is narrower: of a wider one hardly anything is hidden.
const NARROW_DEGREES: f64 = 60.0;

/// How far a picture is from a better one, over those pixels: root mean square of visibility; of light that of luminance, in
/// units of the better picture's mean; of bent normals the mean angle in degrees, where the better picture's cone is narrow.
pub fn apart(
    effect: &RayTracedEffect,
    picture: &[[f32; 4]],
    better: &[[f32; 4]],
    of: &[bool],
) -> f64 {
    if let RayTracedEffect::BentNormals { .. } = effect {
        let cones = better.iter().zip(of).map(|(texel, of)| {
            let [x, y, z, visibility] = texel.map(f64::from);
            of.then_some((DVec3::new(x, y, z), visibility))
        });
        return mean_angle(picture, cones);
    }
    let [values, better] = [picture, better].map(|pixels| values(effect, pixels));
    let squares: Vec<f32> = values
        .iter()
        .zip(&better)
        .map(|(a, b)| (a - b) * (a - b))
        .collect();
    let level = match effect {
        RayTracedEffect::AmbientOcclusion { .. } => 1.0,
        _ => mean(&better, of),
    };
    // Where all is black there is no unit.
    mean(&squares, of).sqrt() / if level > 0.0 { level } else { 1.0 }
}

/// Visibility, or luminance.
pub fn values(effect: &RayTracedEffect, pixels: &[[f32; 4]]) -> Vec<f32> {
    let value = |&[red, green, blue, _]: &[f32; 4]| match effect {
        RayTracedEffect::AmbientOcclusion { .. } => red,
        _ => luminance(DVec3::from([red, green, blue].map(f64::from))) as f32,
    };
    pixels.iter().map(value).collect()
}

/// Mean angle in degrees between directions and those of cones, each an axis of any length and how much of the sky is open, where
/// the cone is narrow. 0 where none is.
pub fn mean_angle(
    directions: &[[f32; 4]],
    cones: impl Iterator<Item = Option<(DVec3, f64)>>,
) -> f64 {
    let (mut sum, mut count) = (0.0, 0_u32);
    for (&[x, y, z, _], cone) in directions.iter().zip(cones) {
        let Some((axis, visibility)) = cone.filter(|(_, visibility)| *visibility > 0.0) else {
            continue;
        };
        let found = DVec3::from([x, y, z].map(f64::from));
        let narrow =
            f64::from(HitResolver::cone_angle(visibility as f32).to_degrees()) < NARROW_DEGREES;
        // Rasterised, an edge may be the sky's where a ray meets what it is of.
        if narrow && found != DVec3::ZERO {
            sum += found.angle_between(axis).to_degrees();
            count += 1;
        }
    }
    sum / f64::from(count.max(1))
}

fn mean(values: &[f32], of: &[bool]) -> f64 {
    let chosen = values.iter().zip(of).filter(|(_, of)| **of);
    let (sum, count) = chosen.fold((0.0, 0_u32), |(sum, count), (v, _)| {
        (sum + f64::from(*v), count + 1)
    });
    sum / f64::from(count.max(1))
}

//! Mirror of `wgsl/multi_res_mask.wgsl`.

use glam::DVec3;

use super::receivers::Decoder;
use crate::{
    MultiResMaskSettings, gbuffer::depth_step, receivers::DEPTH_RELATIVE, work::level_size,
};

/// What edges are found in: the pixels of the viewport, rows from the top.
#[derive(Clone, Copy, Debug)]
pub struct Edges<'a> {
    /// The G-buffer's encoding.
    pub decoder: Decoder<'a>,
    /// Depth as it is stored.
    pub depth: &'a [f64],
    /// Normals as they are stored.
    pub normal: &'a [DVec3],
    /// As [`crate::MultiResMaskInput::shading`].
    pub shading: Option<&'a [f64]>,
    /// As [`crate::MultiResMaskInput::edges`].
    pub extra: Option<&'a [f64]>,
    /// As [`crate::MultiResMaskInput::importance`].
    pub importance: Option<&'a [f64]>,
    /// The settings.
    pub settings: &'a MultiResMaskSettings,
}

/// What of a pixel is differentiated.
#[derive(Clone, Copy, Debug)]
struct Sample {
    normal: DVec3,
    depth: f64,
    /// `None` for the sky.
    linear: Option<f64>,
    shade: f64,
}

/// 0 up to the threshold, 1 from twice the threshold on.
fn beyond(value: f64, threshold: f32) -> f64 {
    if value.is_finite() {
        (value / f64::from(threshold) - 1.0).clamp(0.0, 1.0)
    } else {
        1.0
    }
}

/// Differs from any shading.
const GARBAGE: f64 = 1e30;

/// As a texture of 8 bits has it: what is above 0 stays above 0.
pub fn stored(value: f64) -> f64 {
    if value > 0.0 {
        (value * 255.0).round().max(1.0) / 255.0
    } else {
        0.0
    }
}

fn sanitize(value: f64) -> f64 {
    if value.is_finite() {
        value.clamp(0.0, 1.0)
    } else {
        1.0
    }
}

impl Edges<'_> {
    fn size(&self) -> [u32; 2] {
        let viewport = self.decoder.camera.viewport();
        [viewport.width, viewport.height]
    }

    /// What is linear over the image on a plane: one over the view depth, or of an orthographic camera the view depth.
    fn linear(&self, [x, y]: [u32; 2], depth: f64) -> Option<f64> {
        let camera = self.decoder.camera;
        let point = camera.unproject(f64::from(x) + 0.5, f64::from(y) + 0.5, depth)?;
        let along = (camera.rotation() * point).z.abs();
        Some(if camera.is_perspective() {
            1.0 / along
        } else {
            along
        })
    }

    fn sample(&self, pixel: [u32; 2]) -> Sample {
        let i = (pixel[1] * self.size()[0] + pixel[0]) as usize;
        Sample {
            normal: self.decoder.decode_normal(self.normal[i], DVec3::ZERO),
            depth: self.depth[i],
            linear: self.linear(pixel, self.depth[i]),
            shade: self.shading.map_or(0.0, |shading| {
                if shading[i].is_finite() {
                    shading[i]
                } else {
                    GARBAGE
                }
            }),
        }
    }

    fn first_difference(&self, a: &Sample, b: &Sample) -> f64 {
        if a.linear.is_none() || b.linear.is_none() {
            return f64::from(u8::from(a.linear.is_some() || b.linear.is_some()));
        }
        let normal = beyond(a.normal.distance(b.normal), self.settings.normal_threshold);
        normal.max(beyond(
            (a.shade - b.shade).abs(),
            self.settings.shading_threshold,
        ))
    }

    /// Of what is linear over the image on a plane: its share that is linear in the pixel drops out, so that depth alone
    /// is left.
    fn second_difference(&self, samples: [&Sample; 3]) -> f64 {
        if samples.iter().any(|s| s.linear.is_none()) {
            return 0.0;
        }
        let camera = self.decoder.camera;
        let depths = samples.map(|s| s.depth);
        let depth = depths.iter().fold(0.0, |m: f64, d| m.max(d.abs()));
        let step =
            f64::from(depth_step(self.decoder.depth_format)) + f64::from(DEPTH_RELATIVE) * depth;
        let slope = camera.linear_slope().abs();
        let scale = if camera.is_perspective() {
            let linear = samples.iter().filter_map(|s| s.linear);
            linear.fold(0.0, f64::max)
        } else {
            camera.footprint().pixel * f64::from(self.size()[1])
        };
        let difference = (depths[0] - 2.0 * depths[1] + depths[2]).abs();
        beyond(
            (difference - 4.0 * step).max(0.0) * slope / scale,
            self.settings.depth_threshold,
        )
    }

    fn edge(&self, pixel: [u32; 2]) -> f64 {
        let centre = self.sample(pixel);
        let mut value = 0.0_f64;
        for axis in 0..2 {
            let before = pixel[axis].checked_sub(1);
            let after = Some(pixel[axis] + 1).filter(|&next| next < self.size()[axis]);
            let [before, after] = [before, after].map(|along| {
                let mut there = pixel;
                there[axis] = along?;
                Some(self.sample(there))
            });
            for neighbour in [&before, &after].into_iter().flatten() {
                value = value.max(self.first_difference(&centre, neighbour));
            }
            if let (Some(before), Some(after)) = (before, after) {
                value = value.max(self.second_difference([&before, &centre, &after]));
            }
        }
        if centre.linear.is_some() && centre.shade == GARBAGE {
            value = 1.0;
        }
        let i = (pixel[1] * self.size()[0] + pixel[0]) as usize;
        if let Some(extra) = self.extra {
            value = value.max(sanitize(extra[i]));
        }
        if let Some(importance) = self.importance {
            value = value.min(sanitize(importance[i]));
        }
        value
    }

    /// The edges of all pixels, as they are stored.
    pub fn find(&self) -> Vec<f64> {
        let [width, height] = self.size();
        (0..width * height)
            .map(|i| stored(self.edge([i % width, i / width])))
            .collect()
    }
}

/// The maxima of an image over squares of 2^level pixels.
pub fn coarsen(image: &[f64], [width, height]: [u32; 2], level: u32) -> Vec<f64> {
    let [columns, rows] = level_size([width, height], level);
    let mut coarse = vec![0.0_f64; (columns * rows) as usize];
    for (i, &value) in (0..).zip(image) {
        let [x, y] = [i % width, i / width].map(|p| p >> level);
        let to = &mut coarse[(y * columns + x) as usize];
        *to = to.max(value);
    }
    coarse
}

/// A level's edges blurred along rows and columns; beyond the image there are none.
fn blur(image: &[f64], [width, height]: [u32; 2], radius: i32, variance: f64) -> Vec<f64> {
    let bell = |offset: i32| (-f64::from(offset * offset) * 0.5 / variance.max(1e-6)).exp();
    let total: f64 = (-radius..=radius).map(bell).sum();
    let pass = |image: &[f64], along: [i32; 2]| -> Vec<f64> {
        (0..(width * height) as i32)
            .map(|i| {
                let [x, y] = [i % width as i32, i / width as i32];
                let sum: f64 = (-radius..=radius)
                    .map(|offset| {
                        let there_x = x + offset * along[0];
                        let there_y = y + offset * along[1];
                        let inside = (0..width as i32).contains(&there_x)
                            && (0..height as i32).contains(&there_y);
                        if !inside {
                            return 0.0;
                        }
                        image[(there_y * width as i32 + there_x) as usize] * bell(offset)
                    })
                    .sum();
                sum / total
            })
            .collect()
    };
    pass(&pass(image, [1, 0]), [0, 1])
}

/// The masks of all levels that there are, as they are stored, of edges at full resolution.
pub fn masks(
    edges: &[f64],
    size: [u32; 2],
    settings: &MultiResMaskSettings,
) -> [Option<Vec<f64>>; 4] {
    let mut masks = [const { None }; 4];
    let mut finer: Option<(u32, Vec<f64>)> = None;
    for (level, own) in settings.present() {
        let own_size = level_size(size, level);
        let coarse = coarsen(edges, size, level);
        let radius = own.radius() as i32;
        let mut mask = blur(&coarse, own_size, radius, f64::from(own.variance));
        for value in &mut mask {
            let blurred = value.min(1.0);
            *value = if blurred > f64::from(own.threshold) {
                stored(blurred)
            } else {
                0.0
            };
        }
        if let Some((finer_level, finer)) = &finer {
            let contained = coarsen(finer, level_size(size, *finer_level), level - finer_level);
            for (value, contained) in mask.iter_mut().zip(contained) {
                *value = value.max(contained);
            }
        }
        if level == settings.coarsest() {
            mask.fill(1.0);
        }
        finer = Some((level, mask.clone()));
        masks[level as usize] = Some(mask);
    }
    masks
}

/// The listed pixels of a level's mask `width` pixels wide, `x | y << 16`: first those whose image counts alone, then those
/// that are blended, both in the order of tiles of 8 × 8, of blocks of 2 × 2 within a tile, and of rows within a block.
pub fn list(mask: &[f32], width: u32, settings: &MultiResMaskSettings, level: u32) -> Vec<u32> {
    let mut listed: Vec<(bool, [u32; 2])> = (0..)
        .zip(mask)
        .filter(|(_, value)| **value > 0.0)
        .map(|(i, &value)| {
            let is_blended = value < settings.whole_from(level);
            (is_blended, [i % width, i / width])
        })
        .collect();
    listed.sort_by_key(|&(blended, [x, y])| (blended, [y / 8, x / 8, y / 2, x / 2, y, x]));
    listed.into_iter().map(|(_, [x, y])| x | y << 16).collect()
}

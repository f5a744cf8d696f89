//! Mirror of `wgsl/multi_res_reconstructor.wgsl`, coarse to fine as the paper has it.

use glam::DVec3;

use super::shell_splatter::Receiver;
use crate::{
    Camera, MultiResMaskSettings, MultiResReconstructorSettings,
    multi_res_reconstructor::params::alike, work::level_size,
};

const STRANGER: f64 = 1e-4;

/// What a blend works on.
#[derive(Clone, Copy, Debug)]
pub struct Blend<'a> {
    /// The camera of the view.
    pub camera: &'a Camera,
    /// The pixels of the viewport relative to its eye, rows from the top; `None` for the sky.
    pub receivers: &'a [Option<Receiver>],
    /// The settings of the masks.
    pub mask_settings: &'a MultiResMaskSettings,
    /// The masks.
    pub masks: &'a [Option<Vec<f64>>; 4],
    /// The sub-images; what is not listed is not read.
    pub images: &'a [Option<Vec<DVec3>>; 4],
    /// Whether the masks were recorded with an importance.
    pub has_importance: bool,
    /// The settings.
    pub settings: &'a MultiResReconstructorSettings,
}

/// The pixel of an image that a pixel of a sub-image stands for.
pub fn stands_for([x, y]: [u32; 2], level: u32, [width, height]: [u32; 2]) -> [u32; 2] {
    let half = (1 << level) >> 1;
    [
        ((x << level) + half).min(width - 1),
        ((y << level) + half).min(height - 1),
    ]
}

impl Blend<'_> {
    fn size(&self) -> [u32; 2] {
        let viewport = self.camera.viewport();
        [viewport.width, viewport.height]
    }

    fn receiver(&self, [x, y]: [u32; 2]) -> Option<Receiver> {
        self.receivers[(y * self.size()[0] + x) as usize]
    }

    fn similarity(&self, p: Option<Receiver>, q: Option<Receiver>, level: u32) -> f64 {
        let (Some(p), Some(q)) = (p, q) else {
            return f64::from(u8::from(p.is_none() && q.is_none()));
        };
        let pixel = self.camera.footprint().at(p.position);
        let reach = f64::from(self.settings.plane_distance) * f64::from(1 << level) * pixel;
        let d = q.position - p.position;
        let off_plane = p.normal.dot(d).abs().max(q.normal.dot(d).abs()) / reach.max(1e-30);
        let in_plane = (1.0 - off_plane * off_plane).max(0.0);
        let power = f64::from(self.settings.normal_power);
        let base = (1.0 - power / 8.0 * (1.0 - p.normal.dot(q.normal))).max(0.0);
        in_plane * in_plane * base.powi(8)
    }

    /// Along an axis: the two pixels of a sub-image about a pixel, and the share of the second.
    fn between(&self, at: u32, level: u32, axis: usize) -> ([u32; 2], f64) {
        let end = level_size(self.size(), level)[axis] - 1;
        let half = (1_u32 << level) >> 1;
        let first = (at.saturating_sub(half) >> level).min(end);
        let last = (first + 1).min(end);
        let place = |t: u32| f64::from(stands_for([t, t], level, self.size())[axis]);
        let extent = place(last) - place(first);
        let share = (f64::from(at) - place(first)) / extent.max(1.0);
        ([first, last], share.clamp(0.0, 1.0))
    }

    /// What a coarser level's image gives at a pixel; 0 where it has nothing finite.
    fn coarser_at(&self, pixel: [u32; 2], level: u32, image: &[DVec3], is_alike: bool) -> DVec3 {
        let width = level_size(self.size(), level)[0];
        let (columns, share_x) = self.between(pixel[0], level, 0);
        let (rows, share_y) = self.between(pixel[1], level, 1);
        let p = self.receiver(pixel);
        let (mut value, mut total) = (DVec3::ZERO, 0.0);
        for (y, share_y) in [(rows[0], 1.0 - share_y), (rows[1], share_y)] {
            for (x, share_x) in [(columns[0], 1.0 - share_x), (columns[1], share_x)] {
                let there = image[(y * width + x) as usize];
                let mut weight = share_x * share_y;
                if !is_alike {
                    let q = self.receiver(stands_for([x, y], level, self.size()));
                    weight *= self.similarity(p, q, level) + STRANGER;
                }
                if there.is_finite() {
                    value += weight * there;
                    total += weight;
                }
            }
        }
        value / f64::max(total, 1e-30)
    }

    /// A level's image completed with that of the next coarser level.
    fn complete(&self, level: u32, coarser: u32, coarse: &[DVec3]) -> Vec<DVec3> {
        let [width, height] = level_size(self.size(), level);
        let all_alike = alike(self.mask_settings, self.has_importance) & (1 << coarser) != 0;
        let weight = self.mask_settings.levels[level as usize].map_or(0.0, |l| f64::from(l.weight));
        let own = self.masks[level as usize]
            .as_ref()
            .zip(self.images[level as usize].as_ref());
        (0..width * height)
            .map(|i| {
                let (mask, value) = own.map_or((0.0, DVec3::ZERO), |(mask, image)| {
                    (mask[i as usize], image[i as usize])
                });
                let is_whole = mask >= f64::from(self.mask_settings.whole_from(level));
                if is_whole && value.is_finite() {
                    return value;
                }
                let is_blended = mask > 0.0 && !is_whole;
                let is_alike = all_alike && !is_blended;
                let pixel = stands_for([i % width, i / width], level, self.size());
                let coarser = self.coarser_at(pixel, coarser, coarse, is_alike);
                if !is_blended || !value.is_finite() {
                    return coarser;
                }
                let alpha = (mask * weight).min(1.0);
                value * alpha + coarser * (1.0 - alpha)
            })
            .collect()
    }

    /// The image, rows from the top.
    pub fn image(&self) -> Vec<DVec3> {
        let mut coarser = self.mask_settings.coarsest();
        let mut image = self.images[coarser as usize].clone().unwrap_or_default();
        for level in (0..coarser).rev() {
            if level == 0 || self.masks[level as usize].is_some() {
                image = self.complete(level, coarser, &image);
                coarser = level;
            }
        }
        for value in &mut image {
            if !value.is_finite() {
                *value = DVec3::ZERO;
            }
        }
        image
    }
}

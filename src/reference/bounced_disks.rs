//! Mirror of `wgsl/common/disk_bvh_traverse.wgsl`: the same hits, by a loop over all surfels in place of bounds, which leave out
//! only what a ray misses.

use glam::DVec3;

use super::shell_splatter::{Disk, Receiver, sub_buffer_of};
use crate::{BouncedSettings, Merge};

/// Stands for infinity, as in the shader.
const FAR: f64 = 1e18;

/// What a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiskHit {
    /// Distance from the ray's origin.
    pub t: f64,
    /// Index of the surfel.
    pub surfel: usize,
    /// The level it was met on.
    pub level: u32,
}

/// A pixel's ray: from off its surface, along a unit vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelRay {
    /// The pixel, from the top left.
    pub pixel: [u32; 2],
    /// What it sees.
    pub receiver: Receiver,
    /// Where the ray starts: [`offset_origin`](super::bounced_z_buffer::offset_origin).
    pub origin: DVec3,
    /// Where it goes.
    pub direction: DVec3,
}

impl PixelRay {
    /// Where it meets a disk on a level, from either side and within the level's shell.
    pub fn meet(
        &self,
        disk: &Disk,
        level: u32,
        levels: u32,
        settings: &BouncedSettings,
    ) -> Option<f64> {
        let (radius, normal) = (disk.sender.radius, disk.sender.normal);
        let scale = f64::from(1_u32 << level);
        let to_center = disk.position - self.origin;
        let height = normal.dot(to_center);
        let slope = normal.dot(self.direction);
        if slope.abs() < 1e-12 {
            return None;
        }
        let t = height / slope;
        let shell_radii = f64::from(settings.disks.shell_radii).min(FAR);
        let bound = ((shell_radii * radius).min(FAR) * scale).min(FAR);
        let inner = if level > 0 { 0.5 * bound } else { 0.0 };
        let outer = if level + 1 == levels { FAR } else { bound };
        if !(t > 0.0 && (inner..outer).contains(&t)) {
            return None;
        }
        let aside = self.direction * t - to_center;
        if aside.length_squared() > (radius * scale).min(FAR).powi(2) {
            return None;
        }
        let own = normal.dot(self.receiver.normal).abs() > 0.8
            && height.abs() < 0.5 * radius
            && t < 4.0 * radius;
        (level > 0 || !own).then_some(t)
    }

    /// The nearest hit of one level; of two at the same distance that with the lower index.
    fn first_on(
        &self,
        disks: &[Disk],
        level: u32,
        levels: u32,
        settings: &BouncedSettings,
    ) -> Option<DiskHit> {
        let sub_buffer = sub_buffer_of(self.pixel, level, settings.disks.seed);
        let mut first: Option<DiskHit> = None;
        // The surfels are dealt to the sub-buffers in turn.
        for surfel in (sub_buffer as usize..disks.len()).step_by(1 << (2 * level)) {
            if let Some(t) = self.meet(&disks[surfel], level, levels, settings)
                && first.is_none_or(|first| t < first.t)
            {
                first = Some(DiskHit { t, surfel, level });
            }
        }
        first
    }

    /// The hit that counts among disks on so many levels, if any.
    pub fn first(
        &self,
        disks: &[Disk],
        levels: u32,
        settings: &BouncedSettings,
    ) -> Option<DiskHit> {
        let mut merged: Option<DiskHit> = None;
        for level in 0..levels {
            let hit = self.first_on(disks, level, levels, settings);
            merged = match (merged, hit) {
                (Some(old), Some(new))
                    if settings.disks.merge == Merge::Nearest && new.t <= old.t =>
                {
                    Some(new)
                }
                (None, new) => new,
                (old, _) => old,
            };
        }
        merged.filter(|hit| hit.t < f64::from(settings.radius).min(FAR))
    }
}

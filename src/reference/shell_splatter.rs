//! Mirror of `wgsl/shell_splatter.wgsl` and `wgsl/common/levels.wgsl`: the same sums, without tiles and clusters, which
//! leave out only what contributes nothing.

use glam::{DVec3, IVec2};
use rayon::prelude::*;

use super::{
    effects::{self, Effect, Sender},
    hashing::hash2,
};
use crate::{
    SplatSettings,
    shell_splatter::{params::UNBOUNDED, settings::MIN_EPSILON},
};

/// A surfel in the cloud's space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disk {
    /// Its centre.
    pub position: DVec3,
    /// What the effect knows of it.
    pub sender: Sender,
}

/// A pixel's position in the cloud's space, and its unit normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// Where it is.
    pub position: DVec3,
    /// Its shading normal.
    pub normal: DVec3,
}

/// One pixel's sum on one level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LevelSum<S> {
    /// The sum.
    pub value: S,
    /// What of it lies so close to a bound of its shell that rounding in f32 may put it to the next level, or to none:
    /// with `margin` as in [`splat`].
    pub at_a_bound: S,
    /// Surfels within their shell.
    pub in_shell: u32,
}

/// A permutation of 0 … 4^level − 1, keyed.
pub fn permute(value: u32, key: u32, level: u32) -> u32 {
    let bits = 2 * level;
    let mask = (1_u32 << bits) - 1;
    let half = bits.div_ceil(2);
    let mut x = value ^ (key & mask);
    x = x.wrapping_mul(((key >> 5) << 1) | 1) & mask;
    x ^= x >> half;
    x = x.wrapping_mul(((key >> 13) << 1) | 1) & mask;
    x ^= x >> half;
    x.wrapping_add(key >> 20) & mask
}

/// The inverse of [`permute`]: its steps undone, last one first.
pub fn unpermute(value: u32, key: u32, level: u32) -> u32 {
    let bits = 2 * level;
    let mask = (1_u32 << bits) - 1;
    let half = bits.div_ceil(2);
    let mut x = value.wrapping_sub(key >> 20) & mask;
    x ^= x >> half;
    x = x.wrapping_mul(inverse_odd(((key >> 13) << 1) | 1)) & mask;
    x ^= x >> half;
    x = x.wrapping_mul(inverse_odd(((key >> 5) << 1) | 1)) & mask;
    x ^ (key & mask)
}

/// The number that an odd one multiplies to 1 modulo 2^24, by Newton's steps.
fn inverse_odd(a: u32) -> u32 {
    (0..3).fold(a, |x, _| {
        x.wrapping_mul(2_u32.wrapping_sub(a.wrapping_mul(x)))
    })
}

fn block_key(block: [u32; 2], level: u32, seed: u32) -> u32 {
    hash2(
        block[0] | (block[1] << 16),
        level.wrapping_add(seed.wrapping_mul(16)),
    )
}

/// The pixel that a block gives to a sub-buffer; it may lie outside of the image.
pub fn pixel_of(block: [u32; 2], sub_buffer: u32, level: u32, seed: u32) -> [u32; 2] {
    if level == 0 {
        return block;
    }
    let k = permute(sub_buffer, block_key(block, level, seed), level);
    [
        (block[0] << level) + (k & ((1 << level) - 1)),
        (block[1] << level) + (k >> level),
    ]
}

/// The sub-buffer that gets a pixel: the inverse of [`pixel_of`].
pub fn sub_buffer_of(pixel: [u32; 2], level: u32, seed: u32) -> u32 {
    if level == 0 {
        return 0;
    }
    let block = pixel.map(|i| i >> level);
    let [x, y] = pixel.map(|i| i & ((1 << level) - 1));
    unpermute(x | (y << level), block_key(block, level, seed), level)
}

/// Inner and outer radius of a surfel's shell on a level.
fn shell<E: Effect>(effect: &E, sender: &Sender, level: u32, settings: &SplatSettings) -> [f64; 2] {
    let unbounded = f64::from(UNBOUNDED);
    let epsilon = f64::from(settings.epsilon.clamp(MIN_EPSILON, UNBOUNDED));
    let reach = (effect.max_distance(sender, epsilon) * f64::from(1_u32 << level)).min(unbounded);
    let inner = if level > 0 { 0.5 * reach } else { 0.0 };
    let last = settings.unbounded && level + 1 == settings.levels && reach >= 0.0;
    let outer = if last { unbounded } else { reach };
    [inner, outer.min(f64::from(settings.radius).min(unbounded))]
}

/// The unit vector to a pixel's neighbour, and how much the line of the two is bent at it: 0 on a plane, up to 2.
#[derive(Clone, Copy)]
struct Side {
    direction: DVec3,
    bend: f64,
}

/// The pixels around one, for the normal of its surface.
struct Around<'a> {
    receivers: &'a [Option<Receiver>],
    size: IVec2,
}

impl Around<'_> {
    fn position(&self, at: IVec2) -> Option<DVec3> {
        let inside = at.cmpge(IVec2::ZERO).all() && at.cmplt(self.size).all();
        let i = (at.y * self.size.x + at.x) as usize;
        Some(self.receivers.get(i).filter(|_| inside)?.as_ref()?.position)
    }

    fn side(&self, at: IVec2, step: IVec2, position: DVec3) -> Side {
        let Some(near) = self.position(at + step) else {
            return Side {
                direction: DVec3::ZERO,
                bend: 4.0,
            };
        };
        let direction = (near - position).normalize_or_zero();
        let bend = self.position(at + 2 * step).map_or(2.0, |far| {
            1.0 - direction.dot((far - near).normalize_or_zero())
        });
        Side { direction, bend }
    }

    /// Along a row or a column of the image within the surface that a pixel shows.
    fn along(&self, at: IVec2, step: IVec2, position: DVec3) -> DVec3 {
        let before = self.side(at, -step, position);
        let after = self.side(at, step, position);
        if before.bend < after.bend {
            -before.direction
        } else {
            after.direction
        }
    }

    /// The normal of the surface at a pixel, on the side of its shading normal.
    fn surface_normal(&self, at: IVec2, receiver: &Receiver) -> DVec3 {
        let [row, column] =
            [IVec2::X, IVec2::Y].map(|step| self.along(at, step, receiver.position));
        let found = row.cross(column).normalize_or(receiver.normal);
        if found.dot(receiver.normal) >= 0.0 {
            found
        } else {
            -found
        }
    }
}

/// The normal of the surface that each pixel shows, from the positions around it.
pub fn surface_normals(
    receivers: &[Option<Receiver>],
    [width, height]: [u32; 2],
) -> Vec<Option<DVec3>> {
    let around = Around {
        receivers,
        size: IVec2::new(width as i32, height as i32),
    };
    (0..)
        .zip(receivers)
        .map(|(i, receiver)| {
            let at = IVec2::new(i % around.size.x, i / around.size.x);
            Some(around.surface_normal(at, receiver.as_ref()?))
        })
        .collect()
}

/// The sums of one level, rows from the top. `margin` is relative: a pair within that share of a shell's radius counts
/// as one that rounding may move.
pub fn splat<E: Effect>(
    effect: &E,
    disks: &[Disk],
    receivers: &[Option<Receiver>],
    [width, height]: [u32; 2],
    level: u32,
    settings: &SplatSettings,
    margin: f64,
) -> Vec<LevelSum<E::Sum>> {
    let sub_buffers = 1_u32 << (2 * level);
    let sub_size = [width, height].map(|n| n.div_ceil(1 << level));
    let shells: Vec<[f64; 2]> = disks
        .iter()
        .map(|disk| shell(effect, &disk.sender, level, settings))
        .collect();
    let share = f64::from(sub_buffers);
    let disks: Vec<Disk> = disks
        .iter()
        .map(|disk| Disk {
            sender: Sender {
                share,
                ..disk.sender
            },
            ..*disk
        })
        .collect();
    // Where the effect has a surface of a pixel's own.
    let surfaces = effect
        .own_surface(1.0)
        .map(|_| surface_normals(receivers, [width, height]));
    let blocks = sub_size[0] * sub_size[1];
    let dealt: Vec<(usize, LevelSum<E::Sum>)> = (0..blocks * sub_buffers)
        .into_par_iter()
        .filter_map(|i| {
            let (block, sub_buffer) = (i / sub_buffers, i % sub_buffers);
            let block = [block % sub_size[0], block / sub_size[0]];
            let [x, y] = pixel_of(block, sub_buffer, level, settings.seed);
            if x >= width || y >= height {
                return None;
            }
            let at = (y * width + x) as usize;
            let mut sum = LevelSum::default();
            if let Some(receiver) = &receivers[at] {
                let surface = surfaces.as_ref().and_then(|all| all[at]);
                let known = effect.receiver(at, receiver);
                // The surfels are dealt to the sub-buffers in turn.
                for k in (sub_buffer as usize..disks.len()).step_by(sub_buffers as usize) {
                    let pixel = (receiver.position, &known, surface);
                    add_pair(effect, &disks[k], shells[k], pixel, margin, &mut sum);
                }
                sum.value = sum.value * share;
                sum.at_a_bound = sum.at_a_bound * share;
                let cosine = surface.map_or(1.0, |surface| surface.dot(receiver.normal).min(1.0));
                if let Some(own) = effect.own_surface(cosine).filter(|_| level == 0) {
                    sum.value += own;
                }
            }
            Some((at, sum))
        })
        .collect();
    let mut sums = vec![LevelSum::default(); (width * height) as usize];
    for (at, sum) in dealt {
        sums[at] = sum;
    }
    sums
}

fn add_pair<E: Effect>(
    effect: &E,
    disk: &Disk,
    [inner, outer]: [f64; 2],
    (position, receiver, surface): (DVec3, &effects::Receiver, Option<DVec3>),
    margin: f64,
    sum: &mut LevelSum<E::Sum>,
) {
    if outer <= inner {
        return;
    }
    let to_sender = disk.position - position;
    let distance2 = to_sender.length_squared();
    let near = |bound: f64| (distance2 - bound * bound).abs() <= 2.0 * margin * bound * bound;
    let above = surface.map_or(1.0, |surface| surface.dot(to_sender));
    let inside = distance2 >= inner * inner && distance2 < outer * outer && above > 0.0;
    // A surface's normal is of positions a pixel apart, and as much rounder.
    let grazing = surface.is_some() && above.abs() <= 50.0 * margin * distance2.sqrt();
    let uncertain = margin > 0.0 && (near(inner) || near(outer) || grazing);
    if inside || uncertain {
        let value = effect.contribution(&disk.sender, receiver, to_sender, distance2);
        if inside {
            sum.value += value;
            sum.in_shell += 1;
        }
        if uncertain {
            sum.at_a_bound += value;
        }
    }
}

//! Mirror of `wgsl/shell_splatter.wgsl` and `wgsl/common/levels.wgsl`: the same sums, without tiles and clusters, which
//! leave out only what contributes nothing.

use glam::DVec3;
use rayon::prelude::*;

use super::{
    effects::{Effect, Sender},
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
    let last = settings.unbounded && level + 1 == settings.levels;
    let outer = if last { unbounded } else { reach };
    [inner, outer.min(f64::from(settings.radius).min(unbounded))]
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
                // The surfels are dealt to the sub-buffers in turn.
                for k in (sub_buffer as usize..disks.len()).step_by(sub_buffers as usize) {
                    add_pair(effect, &disks[k], shells[k], receiver, margin, &mut sum);
                }
            }
            sum.value = sum.value * share;
            sum.at_a_bound = sum.at_a_bound * share;
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
    receiver: &Receiver,
    margin: f64,
    sum: &mut LevelSum<E::Sum>,
) {
    if outer <= inner {
        return;
    }
    let to_sender = disk.position - receiver.position;
    let distance2 = to_sender.length_squared();
    let near = |bound: f64| (distance2 - bound * bound).abs() <= 2.0 * margin * bound * bound;
    let inside = distance2 >= inner * inner && distance2 < outer * outer;
    let uncertain = margin > 0.0 && (near(inner) || near(outer));
    if inside || uncertain {
        let value = effect.contribution(&disk.sender, receiver.normal, to_sender, distance2);
        if inside {
            sum.value += value;
            sum.in_shell += 1;
        }
        if uncertain {
            sum.at_a_bound += value;
        }
    }
}

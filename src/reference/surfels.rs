//! Mirror of `wgsl/gatherers/surfels.wgsl`, without clusters, which leave out only what is out of reach.

use std::f64::consts::PI;

use glam::DVec3;

use super::{hashing::hash2, packing::unpack_normal, sg_hull::Lobes};
use crate::{
    SplatSettings, Surfel, SurfelRadiance, SurfelSource,
    shell_splatter::{params::UNBOUNDED, settings::MIN_EPSILON},
};

/// A lit cloud as it stands in its buffers.
#[derive(Clone, Copy, Debug)]
pub struct LitSurfels<'a> {
    /// The surfels that there are.
    pub surfels: &'a [Surfel],
    /// Where their normals are.
    pub sources: &'a [SurfelSource],
    /// What they send.
    pub radiance: &'a [SurfelRadiance],
    /// How exactly they are gathered.
    pub settings: &'a SplatSettings,
}

impl LitSurfels<'_> {
    /// Which sub-buffer of a level a vertex is dealt, by its position as the shader has it.
    fn sub_buffer(&self, position: [f32; 3], level: u32) -> u32 {
        let [x, y, z] = position.map(f32::to_bits);
        let key = hash2(x, hash2(y, z.wrapping_add(self.settings.seed)));
        hash2(key, level) & ((1 << (2 * level)) - 1)
    }

    /// Inner and outer radius of the shell of a surfel of radius r on a level.
    fn shell(&self, r: f64, level: u32) -> [f64; 2] {
        let settings = self.settings;
        let unbounded = f64::from(UNBOUNDED);
        let epsilon = f64::from(settings.epsilon.clamp(MIN_EPSILON, UNBOUNDED));
        let radii = (1.0 / epsilon - 1.0).max(0.0).sqrt();
        let reach = (r * radii * f64::from(1_u32 << level)).min(unbounded);
        let inner = if level > 0 { 0.5 * reach } else { 0.0 };
        let is_last = settings.unbounded && level + 1 == settings.levels;
        let outer = if is_last { unbounded } else { reach };
        [inner, outer.min(f64::from(settings.radius).min(unbounded))]
    }

    /// What a vertex gathers; `offset` takes its position to the cloud's space.
    pub fn gather(&self, position: [f32; 3], offset: DVec3, normal: DVec3) -> Lobes {
        let mut lobes = Lobes::ZERO;
        let p = DVec3::from(position.map(f64::from)) + offset;
        for level in 0..self.settings.levels {
            let sub_buffer = self.sub_buffer(position, level);
            for at in (sub_buffer as usize..self.surfels.len()).step_by(1 << (2 * level)) {
                self.add(&mut lobes, normal, p, at, level);
            }
        }
        lobes
    }

    fn add(&self, lobes: &mut Lobes, normal: DVec3, p: DVec3, at: usize, level: u32) {
        let surfel = self.surfels[at];
        let to_surfel = DVec3::from(surfel.position.map(f64::from)) - p;
        let distance2 = to_surfel.length_squared();
        let radius = f64::from(surfel.radius);
        let [inner, outer] = self.shell(radius, level);
        if !(distance2 >= inner * inner && distance2 < outer * outer && distance2 > 0.0) {
            return;
        }
        let direction = to_surfel / distance2.sqrt();
        let facing = -unpack_normal(self.sources[at].normal).dot(direction);
        let solid_angle = PI * facing.abs() / (1.0 + distance2 / (radius * radius));
        let sent = self.radiance[at];
        let radiance = if facing > 0.0 { sent.front } else { sent.back };
        let radiance = DVec3::from(radiance.map(f64::from)) * f64::from(1_u32 << (2 * level));
        lobes.add_light(normal, direction, radiance * solid_angle);
    }
}

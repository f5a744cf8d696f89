//! The mean of the directions in which a point sees the sky, cosine-weighted.

use glam::DVec3;

use super::{
    Tracer,
    hemisphere::{Hemisphere, Receiver, of_each},
};

/// A mean of random samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BentEstimate {
    /// 1/π ∫ visible(ω) ω ⟨Ns, ω⟩ dω: two thirds of the normal where all is open, 0 where nothing is.
    pub mean: DVec3,
    /// Visibility, as [`Tracer::ambient_occlusion`]'s.
    pub visibility: f64,
}

impl Tracer {
    /// Estimates the mean of a receiver's open directions, by rays as those of
    /// [`ambient_occlusion`](Self::ambient_occlusion).
    pub fn bent_normal(&self, at: &Receiver, radius: f64, rays: u32, seed: u64) -> BentEstimate {
        let Some(hemisphere) = Hemisphere::new(at, self) else {
            return BentEstimate {
                mean: DVec3::NAN,
                visibility: f64::NAN,
            };
        };
        let means = hemisphere.estimate(rays, seed, |direction| {
            if self.occluded(hemisphere.origin, direction, 0.0, radius) {
                [0.0; 4]
            } else {
                direction.extend(1.0).to_array()
            }
        });
        let [x, y, z, visibility] = means.mean;
        BentEstimate {
            mean: DVec3::new(x, y, z),
            visibility,
        }
    }

    /// [`bent_normal`](Self::bent_normal) of many receivers, as [`ambient_occlusion_image`](Self::ambient_occlusion_image).
    pub fn bent_normal_image(
        &self,
        receivers: &[Option<Receiver>],
        radius: f64,
        rays: u32,
        seed: u64,
        progress: bool,
    ) -> Vec<Option<BentEstimate>> {
        of_each(receivers, seed, progress, |at, own_seed| {
            self.bent_normal(at, radius, rays, own_seed)
        })
    }
}

//! Visibility of the sky from a point, estimated with rays.
//!
//! V = 1/π ∫ visible(ω) ⟨Ns, ω⟩ dω over the hemisphere about the shading normal Ns: 1 is open, 0 is
//! closed. A direction with ⟨Ng, ω⟩ ≤ 0 points into the surface, by its geometric normal Ng, and is
//! blocked. With a finite radius only what is nearer than it blocks, and blocks fully.

use super::{
    Tracer,
    hemisphere::{Hemisphere, Receiver, of_each},
};

/// A mean of random samples and how far off it may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The estimated value.
    pub mean: f64,
    /// Standard deviation of `mean` over seeds, itself estimated.
    pub standard_error: f64,
}

impl Tracer {
    /// Estimates the visibility of a receiver within `radius`, which may be infinite, with at
    /// least `rays` rays. It depends on the arguments alone, `seed` included.
    ///
    /// The cosine-weighted hemisphere is cut into a grid of cells of one weight, and each cell
    /// gets two independent rays. The mean of all rays has no bias. Nor has the variance made of
    /// the differences between the two rays of each cell, since cells do not depend on each
    /// other: the standard error is its root. It is zero when both rays agree in every cell, also
    /// where an occluder smaller than a cell was missed by both. The number of rays is the next
    /// that fills a grid, at least 2.
    ///
    /// Normals need not have unit length. If one is zero or anything is not finite but `radius`,
    /// the estimate is not a number.
    pub fn ambient_occlusion(&self, at: &Receiver, radius: f64, rays: u32, seed: u64) -> Estimate {
        let Some(hemisphere) = Hemisphere::new(at, self) else {
            return Estimate {
                mean: f64::NAN,
                standard_error: f64::NAN,
            };
        };
        let means = hemisphere.estimate(rays, seed, |direction| {
            let occluded = self.occluded(hemisphere.origin, direction, 0.0, radius);
            [f64::from(u8::from(!occluded))]
        });
        Estimate {
            mean: means.mean[0],
            standard_error: means.standard_error[0],
        }
    }

    /// [`ambient_occlusion`](Self::ambient_occlusion) of many receivers, in parallel on rayon's
    /// current thread pool; where there is no receiver there is no estimate. Each place in the
    /// list draws random numbers of its own from `seed`, so that the result does not depend on
    /// the number of threads. `progress` shows a bar on standard error.
    pub fn ambient_occlusion_image(
        &self,
        receivers: &[Option<Receiver>],
        radius: f64,
        rays: u32,
        seed: u64,
        progress: bool,
    ) -> Vec<Option<Estimate>> {
        of_each(receivers, seed, progress, |at, own_seed| {
            self.ambient_occlusion(at, radius, rays, own_seed)
        })
    }
}

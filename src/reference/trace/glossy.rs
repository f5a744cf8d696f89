//! Light that a glossy surface reflects, traced.

use glam::DVec3;

use super::{
    Tracer,
    hemisphere::{Hemisphere, Receiver, of_each, stratified},
    one_bounce::ColorEstimate,
};
use crate::{Light, Material, reference::ggx::Lobe};

/// How a receiver reflects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gloss {
    /// Where it is seen from.
    pub eye: DVec3,
    /// Perceptual roughness, 0…1.
    pub roughness: f64,
    /// Reflectance seen straight on.
    pub f0: DVec3,
}

impl Tracer {
    /// Estimates the light that a glossy receiver sends to the eye after it has bounced off one other surface, with at least
    /// `rays` rays: radiance, W/(m² sr), by the lobe of `wgsl/common/ggx.wgsl`. What surfaces send is that of
    /// [`one_bounce`](Self::one_bounce).
    pub fn glossy(
        &self,
        at: &Receiver,
        gloss: &Gloss,
        (materials, lights): (&[Material], &[Light]),
        rays: u32,
        seed: u64,
    ) -> ColorEstimate {
        let to_eye = (gloss.eye - at.position).try_normalize();
        let (Some(hemisphere), Some(to_eye)) = (Hemisphere::new(at, self), to_eye) else {
            return ColorEstimate {
                mean: DVec3::NAN,
                standard_error: DVec3::NAN,
            };
        };
        let lobe = Lobe::new(hemisphere.normal(), to_eye, gloss.roughness);
        let means = stratified(rays, seed, |square| {
            let drawn = lobe.direction(square);
            let direction = lobe.frame * drawn.light;
            if drawn.light.z <= 0.0 || !hemisphere.is_above(direction) {
                return [0.0; 3];
            }
            let from_there = self.radiance_along(hemisphere.origin, direction, materials, lights);
            let reflected = lobe.share(drawn.light) * lobe.schlick(gloss.f0, drawn.facet);
            (reflected * from_there).to_array()
        });
        ColorEstimate {
            mean: means.mean.into(),
            standard_error: means.standard_error.into(),
        }
    }

    /// [`glossy`](Self::glossy) of many receivers, as [`ambient_occlusion_image`](Self::ambient_occlusion_image).
    pub fn glossy_image(
        &self,
        receivers: &[Option<Receiver>],
        gloss: &Gloss,
        scene: (&[Material], &[Light]),
        (rays, seed): (u32, u64),
        progress: bool,
    ) -> Vec<Option<ColorEstimate>> {
        of_each(receivers, seed, progress, |at, own_seed| {
            self.glossy(at, gloss, scene, rays, own_seed)
        })
    }
}

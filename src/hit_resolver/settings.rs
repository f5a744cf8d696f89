//! Public settings and their validation.

use crate::error::{Error, check_setting};

/// Settings of the [`HitResolver`](crate::HitResolver).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HitResolverSettings {
    /// Half width of the window in pixels, 0…16: `(2 radius + 1)²` pixels share their hits. 0 for each pixel's own
    /// alone. Default 6.
    pub radius: u32,
    /// Standard deviation of the Gaussian by which a neighbour counts the less the farther away it is in the picture, in
    /// pixels, above 0; infinity for all of the window alike. The window should be half as wide again to twice as wide.
    /// Default 3, which suits 16 directions; 4 suits 4 of them and 5 one.
    pub spread: f32,
    /// How far away a neighbour counts 1/e, in mean distances of hits (harmonic means of both pixels' surroundings, of which
    /// the smaller counts; what is not hit is infinitely far), above 0; infinity for no such test. What two points see differs
    /// by how far they are apart in this measure. Smaller keeps contacts sharper, and leaves more noise there. For glossy
    /// receivers it is multiplied by the roughness: narrow lobes show finer detail of the same hits. Default 0.8.
    pub hit_distances: f32,
    /// How far slopes are mistrusted, 0.01 to infinity: the picture is the value at the pixel of a plane fitted to the window,
    /// over coordinates of which one is as long as `spread`, or the window where that is narrower, and this is added to their
    /// variance. Smaller follows what changes steadily, up to the edges of surfaces, and leaves more noise there; infinity takes
    /// the window's mean. Default 0.2.
    pub damping: f32,
    /// How far a neighbour may lie off the pixel's tangent plane, and the pixel off the neighbour's, to count, in pixels
    /// at the pixel's distance, above 0. Smaller keeps finer relief, and leaves more noise on it. Default 2.
    pub plane_distance: f32,
    /// Exponent n of the cosine c between the pixel's normal and a neighbour's, 8…1000: the neighbour counts
    /// `(1 − (1 − c) n / 8)⁸`, which is c⁸ at 8 and close to cⁿ above. Larger keeps creases and curvature sharper, and
    /// leaves more noise there. Default 8.
    pub normal_power: f32,
    /// How far a neighbour's mean may differ from the pixel's own, in standard deviations of their difference, 0…100: at
    /// this many it counts 1/e. Keeps what the hits themselves show to differ, such as contact shadows that end within
    /// the window. Both means are noisy: a small number of directions needs a larger one here. 0 (default) for no
    /// such test.
    pub variance_clamp: f32,
    /// By which power of the number of frames the window narrows, 0…1, where means over frames are resolved
    /// ([`HitResolverInput::history`](crate::HitResolverInput::history)): radius and spread are divided by
    /// `(n / frames)^narrowing` at a pixel whose history has n frames, once those are more than [`Self::frames`]. Default 0.18,
    /// which suits occlusion; 0.6 suits light.
    pub narrowing: f32,
    /// How many frames radius and spread suit, 1…1000. Default 1.
    pub frames: f32,
    /// Reflectance of glossy receivers seen straight on, linear RGB, 0…1 (Schlick, *An Inexpensive BRDF Model for
    /// Physically-based Rendering*, 1994); of use with [`Sampling::Glossy`](crate::Sampling::Glossy) and
    /// payloads of radiance. Default 0.04, that of glass and most plastics; metals have
    /// their colour.
    pub f0: [f32; 3],
}

/// The widest window.
pub(crate) const MAX_RADIUS: u32 = 16;

impl Default for HitResolverSettings {
    fn default() -> Self {
        Self {
            radius: 6,
            spread: 3.0,
            hit_distances: 0.8,
            damping: 0.2,
            plane_distance: 2.0,
            normal_power: 8.0,
            variance_clamp: 0.0,
            narrowing: 0.18,
            frames: 1.0,
            f0: [0.04; 3],
        }
    }
}

impl HitResolverSettings {
    /// What suits occlusion by so many directions per pixel, 1…64: the fewer, the wider the window. Measured in twelve views of
    /// nine scenes, with a radius and without, at 1, 4, 16 and 64 directions.
    pub fn for_occlusion(rays_per_pixel: u32) -> Self {
        let few = rays_per_pixel.clamp(1, 64) as f32;
        let spread = 5.0 * few.powf(-0.18);
        Self {
            radius: (1.6 * spread).round() as u32,
            spread,
            // What two points see is told apart the better the more rays there are.
            hit_distances: (1.2 * few.powf(-0.3)).min(1.0),
            plane_distance: (4.0 / few.sqrt()).max(2.0),
            // Of fewer directions the variance is not known well enough.
            variance_clamp: if rays_per_pixel < 9 { 0.0 } else { 6.0 },
            ..Self::default()
        }
    }

    /// The same for light, whose detail is finer and noise coarser. Measured in two views of one scene, at 8 and 40.
    pub fn for_light(rays_per_pixel: u32) -> Self {
        let few = rays_per_pixel.clamp(1, 64) as f32;
        let spread = (19.0 * few.powf(-0.6)).min(6.0);
        Self {
            narrowing: 0.6,
            // From as many rays on as the widest window suits.
            frames: ((19.0_f32 / 6.0).powf(1.0 / 0.6) / few).max(1.0),
            radius: (1.8 * spread).round() as u32,
            spread,
            damping: 0.3,
            normal_power: (0.6 * few).max(8.0),
            ..Self::default()
        }
    }

    /// The same for light that glossy receivers reflect, which has edges where the surface has none: neighbours whose means
    /// differ by more than their noise hardly count. Measured in three scenes at 40 rays; a smaller clamp blurs less, and leaves
    /// more noise where small lamps alone shine.
    pub fn for_glossy_light(rays_per_pixel: u32) -> Self {
        Self {
            variance_clamp: 3.0,
            ..Self::for_light(rays_per_pixel)
        }
    }

    /// The same for what an environment sends, [`Payload::Sky`](crate::Payload::Sky), where a small sun's shadow may end within
    /// a pixel: neighbours whose means differ by more than their noise hardly count. Measured in three scenes under two skies.
    pub fn for_environment(rays_per_pixel: u32) -> Self {
        let few = rays_per_pixel.clamp(1, 64) as f32;
        let spread = 4.9 * few.powf(-0.24);
        Self {
            radius: (1.6 * spread).round() as u32,
            spread,
            // The fewer directions, the less is known of their noise.
            variance_clamp: 12.0 / few.sqrt(),
            ..Self::default()
        }
    }

    /// The same for bent normals, which a window turns where it bends their cone's edge: narrower than for occlusion. Measured in
    /// three scenes, at 64 directions.
    pub fn for_bent_normals(rays_per_pixel: u32) -> Self {
        let few = rays_per_pixel.clamp(1, 64) as f32;
        let spread = 5.0 * few.powf(-0.34);
        Self {
            radius: (1.6 * spread).round() as u32,
            spread,
            variance_clamp: 12.0 / few.sqrt(),
            ..Self::default()
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.radius <= MAX_RADIUS,
            "HitResolverSettings::radius",
            self.radius,
            "0 to 16",
        )?;
        for (field, value) in [
            ("HitResolverSettings::spread", self.spread),
            ("HitResolverSettings::hit_distances", self.hit_distances),
        ] {
            check_setting(value > 0.0, field, value, "above 0, to infinity")?;
        }
        check_setting(
            self.damping >= 0.01,
            "HitResolverSettings::damping",
            self.damping,
            "0.01 to infinity",
        )?;
        check_setting(
            self.plane_distance > 0.0 && self.plane_distance.is_finite(),
            "HitResolverSettings::plane_distance",
            self.plane_distance,
            "above 0, finite",
        )?;
        check_setting(
            (8.0..=1000.0).contains(&self.normal_power),
            "HitResolverSettings::normal_power",
            self.normal_power,
            "8 to 1000",
        )?;
        check_setting(
            (0.0..=100.0).contains(&self.variance_clamp),
            "HitResolverSettings::variance_clamp",
            self.variance_clamp,
            "0 to 100",
        )?;
        check_setting(
            (0.0..=1.0).contains(&self.narrowing),
            "HitResolverSettings::narrowing",
            self.narrowing,
            "0 to 1",
        )?;
        check_setting(
            (1.0..=1000.0).contains(&self.frames),
            "HitResolverSettings::frames",
            self.frames,
            "1 to 1000",
        )?;
        for channel in self.f0 {
            check_setting(
                (0.0..=1.0).contains(&channel),
                "HitResolverSettings::f0",
                channel,
                "0 to 1",
            )?;
        }
        Ok(())
    }
}

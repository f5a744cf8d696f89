//! Public settings and their validation.

use crate::error::{Error, check_setting};

/// How a pixel's directions are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Sampling {
    /// In proportion to the cosine to the normal: what a diffuse receiver weighs its light by.
    #[default]
    Cosine,
    /// Uniform over the hemisphere, as in the paper for ambient occlusion. The Reconstructor weighs the hits.
    Uniform,
    /// In proportion to the visible normals of a microfacet surface (The Bounced Z-buffer 3.1; Dupuy and Benyoub,
    /// *Sampling Visible GGX Normals with Spherical Caps*, 2023), about the view's reflection: for glossy receivers, of
    /// the roughness in [`GBuffer::roughness`](crate::GBuffer::roughness). Directions below the shading
    /// normal's horizon are not traced and carry nothing.
    Glossy,
}

impl Sampling {
    /// The shader's number for it.
    pub(crate) fn code(self) -> u32 {
        match self {
            Self::Cosine => 0,
            Self::Uniform => 1,
            Self::Glossy => 2,
        }
    }
}

/// Which of the levels' hits counts, with [`Primitives::Disks`](crate::Primitives::Disks).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Merge {
    /// The nearest one. Shells are measured in radii of the surfel that is hit, so that a far and large one may be hit on
    /// a finer level than a near and small one that it lies behind.
    #[default]
    Nearest,
    /// That of the finest level that has one, as in the paper (The Bounced Z-buffer 4.2), which takes it for the nearest.
    /// Beyond [`BouncedSettings::radius`] it does not count, and still hides those of coarser levels.
    Finest,
}

impl Merge {
    /// The shader's number for it.
    pub(crate) fn code(self) -> u32 {
        match self {
            Self::Nearest => 0,
            Self::Finest => 1,
        }
    }
}

/// Settings of [`Primitives::Disks`](crate::Primitives::Disks).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiskSettings {
    /// Where level 0 ends, in radii of the surfel that is hit, > 0; `f32::INFINITY` leaves all to level 0. With m for it
    /// and r for the radius, level l counts hits at distances from m r 2^(l − 1) (level 0: from 0) to m r 2^l, the last
    /// one without end. Larger is more accurate: coarse levels see few disks, and large ones, which stick out of their
    /// surface. Default 10.
    pub shell_radii: f32,
    /// Which of the levels' hits counts.
    pub merge: Merge,
    /// Which of the random permutations deals pixels to sub-buffers, 0…2²⁴. Default 0.
    pub seed: u32,
}

impl Default for DiskSettings {
    fn default() -> Self {
        Self {
            shell_radii: 10.0,
            merge: Merge::default(),
            seed: 0,
        }
    }
}

impl DiskSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.shell_radii > 0.0,
            "DiskSettings::shell_radii",
            self.shell_radii,
            "above 0, to infinity",
        )?;
        check_setting(
            self.seed <= 1 << 24,
            "DiskSettings::seed",
            self.seed,
            "0 to 2^24",
        )
    }
}

/// Settings of the [`BouncedZBuffer`](crate::BouncedZBuffer).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BouncedSettings {
    /// Rays per pixel, 0…64. Noise falls with the root of their number times that of the pixels that the
    /// Reconstructor gathers, and somewhat faster, since both are stratified; the time to trace grows with it. Numbers
    /// with two nearly equal factors are stratified best: 4, 6, 9, 12, 16, 20, 25, 36, 49, 64. With 0 nothing is
    /// traced and everything is open and dark. Default 16.
    pub rays_per_pixel: u32,
    /// The distance beyond which hits do not count, world units, ≥ 0; `f32::INFINITY` (default) for none.
    pub radius: f32,
    /// Which set of directions to take, 0…2²⁰. Counted up from frame to frame it gives each pixel directions that lie
    /// between the old ones: a mean over n frames of N directions has about the noise of n N directions at once, and with n
    /// a power of two it is stratified best. Default 0.
    pub frame: u32,
    /// Radiance that comes from where nothing is hit, linear RGB, W/(m² sr), each 0…1e18; of use with
    /// payloads of radiance, but for [`Payload::Sky`](crate::Payload::Sky), whose environment it is. Default black.
    pub sky_radiance: [f32; 3],
    /// The share of a pixel's rays that go where an environment is bright, 0…1, rounded down to whole rays, of which one at least
    /// goes by the cosine; of use with [`BouncedDescriptor::environment`](crate::BouncedDescriptor::environment) and
    /// [`Sampling::Cosine`] alone. Half of the rays to an even sky would be below the horizon, and less noise is left with 0; a
    /// sun is found by these rays alone. Default 0.5.
    pub environment_share: f32,
    /// Of use with [`Primitives::Disks`](crate::Primitives::Disks) alone.
    pub disks: DiskSettings,
}

/// The most directions.
pub(crate) const MAX_RAYS_PER_PIXEL: u32 = 64;
/// The last set of directions.
pub(crate) const MAX_FRAME: u32 = 1 << 20;

impl Default for BouncedSettings {
    fn default() -> Self {
        Self {
            rays_per_pixel: 16,
            radius: f32::INFINITY,
            frame: 0,
            sky_radiance: [0.0; 3],
            environment_share: 0.5,
            disks: DiskSettings::default(),
        }
    }
}

impl BouncedSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.rays_per_pixel <= MAX_RAYS_PER_PIXEL,
            "BouncedSettings::rays_per_pixel",
            self.rays_per_pixel,
            "0 to 64",
        )?;
        check_setting(
            self.radius >= 0.0,
            "BouncedSettings::radius",
            self.radius,
            "0 to infinity",
        )?;
        check_setting(
            self.frame <= MAX_FRAME,
            "BouncedSettings::frame",
            self.frame,
            "0 to 2^20",
        )?;
        for channel in self.sky_radiance {
            check_setting(
                (0.0..=1e18).contains(&channel),
                "BouncedSettings::sky_radiance",
                channel,
                "0 to 1e18",
            )?;
        }
        check_setting(
            (0.0..=1.0).contains(&self.environment_share),
            "BouncedSettings::environment_share",
            self.environment_share,
            "0 to 1",
        )?;
        self.disks.validate()
    }
}

//! What a bounced z-buffer is compiled for.

use wgpu::Buffer;

use super::settings::Sampling;
use crate::{bvh::Primitives, light::Light};

/// What is kept of a hit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Payload {
    /// That there is one: one bit per direction. A ray ends at the first hit that it finds, the nearest or not.
    #[default]
    Occlusion,
    /// The radiance that its surfel sends towards the pixel: four bytes per direction.
    Radiance,
}

/// Where the light of a hit is taken from; with [`Payload::Radiance`] alone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lighting {
    /// From the surfel that the hit belongs to, which a [`SurfelShader`](crate::SurfelShader) or the caller has lit: any
    /// radiance and any shadows, once a surfel, however many hits. As fine as surfels are: an edge of light or shadow
    /// that crosses one is lost, which shows where a surface lies close beside it.
    #[default]
    Surfels,
    /// From the lights, at the hit itself, by a ray to each through the same bounds: exact, and no surfel is needed (a
    /// cloud with a capacity of 0 surfels does). Costs a ray a hit and light. Not with [`Primitives::Disks`].
    Hits,
}

/// The lights and materials of [`Lighting::Hits`].
#[derive(Clone, Copy, Debug)]
pub struct HitLighting<'a> {
    /// A storage buffer of one or more [`Material`](crate::Material)s. An index beyond its end takes the last one; a
    /// component that is negative or not finite counts as 0.
    pub materials: &'a Buffer,
    /// Up to 16 that shine. None leaves the surfaces' own emission.
    pub lights: &'a [Light],
}

/// What a [`BouncedZBuffer`](crate::BouncedZBuffer) is compiled for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BouncedDescriptor {
    /// What is kept of a hit.
    pub payload: Payload,
    /// What rays meet.
    pub primitives: Primitives,
    /// How directions are drawn.
    pub sampling: Sampling,
    /// Where the light of a hit is taken from.
    pub lighting: Lighting,
    /// Whether to count into [`BouncedView::statistics`](crate::BouncedView::statistics). Slower; for measuring.
    pub statistics: bool,
}

impl BouncedDescriptor {
    /// Whether hits are lit where they are.
    pub(crate) fn lit(&self) -> bool {
        (self.payload, self.lighting) == (Payload::Radiance, Lighting::Hits)
    }

    pub(crate) fn flags(&self) -> Vec<&'static str> {
        let mut flags = Vec::new();
        flags.extend((self.payload == Payload::Radiance).then_some("RADIANCE"));
        flags.extend(matches!(self.primitives, Primitives::Disks { .. }).then_some("DISKS"));
        if self.lit() {
            flags.extend(["LIT", "SHADOW_RAYS"]);
        }
        flags.extend(self.statistics.then_some("STATISTICS"));
        flags.extend((self.sampling == Sampling::Glossy).then_some("GLOSSY"));
        flags
    }
}

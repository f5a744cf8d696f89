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
    /// The radiance that the surfel which it belongs to sends towards the pixel: four bytes per direction. A
    /// [`SurfelShader`](crate::SurfelShader) or the caller lit the surfels: any radiance and any shadows, once per surfel,
    /// however many hits. As fine as surfels are: an edge of light or shadow that crosses one is lost, which shows where a
    /// surface lies close beside it.
    Radiance,
    /// The radiance that the hit itself sends, lit by a ray to each light through the same hierarchy: exact, and no surfel is
    /// needed (a cloud with a capacity of 0 surfels does). Four bytes per direction; costs a ray per hit and light. Not with
    /// [`Primitives::Disks`].
    LitRadiance,
}

impl Payload {
    /// Whether hits bring radiance, from wherever.
    pub(crate) fn is_radiance(self) -> bool {
        self != Self::Occlusion
    }
}

/// What lights the hits of [`Payload::LitRadiance`].
#[derive(Clone, Copy, Debug)]
pub struct HitLighting<'a> {
    /// A storage buffer of one or more [`Material`](crate::Material)s. An index beyond its end takes the last one; a
    /// component that is negative or not finite counts as 0.
    pub materials: &'a Buffer,
    /// Up to 16 that shine. None leaves the surfaces' own emission.
    pub lights: &'a [Light],
}

/// Where the radiance of hits comes from.
#[derive(Clone, Copy, Debug, Default)]
pub enum HitRadiance<'a> {
    /// From nowhere, for [`Payload::Occlusion`].
    #[default]
    None,
    /// For [`Payload::Radiance`] a storage buffer of a [`SurfelRadiance`](crate::SurfelRadiance) for each surfel of the cloud, as
    /// the [`SurfelShader`](crate::SurfelShader) or the caller fills it. What is not a number or negative counts as 0, and what
    /// is above 1e30 as that.
    Surfels(&'a Buffer),
    /// For [`Payload::LitRadiance`] lights and materials.
    Lit(HitLighting<'a>),
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
    /// Whether to count into [`BouncedView::statistics`](crate::BouncedView::statistics). Slower; for measuring. Not with
    /// `Primitives::RayQuery`, whose steps the device does not tell.
    pub statistics: bool,
    /// Whether pixels may have different numbers of rays: those of [`BouncedInput::pixels`](crate::BouncedInput::pixels) alone,
    /// and with [`Sampling::Cosine`] further ones where a [`RayBudget`](crate::RayBudget) puts them. Views then take 8 bytes per
    /// pixel more, and 16 with radiance.
    pub counted: bool,
}

impl BouncedDescriptor {
    /// Whether hits are lit where they are.
    pub(crate) fn lit(&self) -> bool {
        self.payload == Payload::LitRadiance
    }

    /// Whether pixels may have further rays: their sums are kept, of which only cosine sampling's are what arrives.
    pub(crate) fn takes_more(&self) -> bool {
        self.counted && self.sampling == Sampling::Cosine
    }

    pub(crate) fn flags(&self) -> Vec<&'static str> {
        let mut flags = Vec::new();
        flags.extend(self.payload.is_radiance().then_some("RADIANCE"));
        flags.extend(self.primitives.are_disks().then_some("DISKS"));
        flags.extend(self.primitives.by_device().then_some("RAY_QUERY"));
        if self.lit() {
            flags.extend(["LIT", "SHADOW_RAYS"]);
        }
        flags.extend(self.statistics.then_some("STATISTICS"));
        flags.extend((self.sampling == Sampling::Glossy).then_some("GLOSSY"));
        flags.extend(self.counted.then_some("COUNTED"));
        flags
    }
}

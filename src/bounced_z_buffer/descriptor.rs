//! What a bounced z-buffer is compiled for.

use wgpu::Buffer;

use super::settings::Sampling;
use crate::{
    bvh::{Bvh, Primitives},
    error::Error,
    instanced_bvh::InstancedBvh,
    light::Light,
    recorded::Stamp,
    surfel::SurfelCloud,
};

/// What is kept of a hit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Payload {
    /// That there is one: one bit per direction. A ray ends at the first hit that it finds, the nearest or not.
    #[default]
    Occlusion,
    /// The radiance that the surfel which it belongs to sends towards the pixel: four bytes per direction. A
    /// [`SurfelShader`](crate::SurfelShader) or the caller lit the surfels: any radiance and any shadows, once per surfel,
    /// however many hits. As fine as surfels are: an edge of light or shadow that crosses one is lost, which shows where a
    /// surface lies close beside it. Not with primitives of instances, which have no surfels.
    Radiance,
    /// The radiance that the hit itself sends, lit by a ray to each light through the same hierarchy: exact, and no surfel is
    /// needed (a cloud with a capacity of 0 surfels does). Four bytes per direction; costs a ray per hit and light. Not with
    /// [`Primitives::Disks`].
    LitRadiance,
    /// As [`LitRadiance`](Self::LitRadiance), and what the surfel at the hit reflects of light that it gathered from other
    /// surfels: more than one bounce, by a [`SurfelGatherer`](crate::SurfelGatherer). Four bytes per direction. With
    /// [`Primitives::Triangles`], [`Primitives::AlphaTested`] and `Primitives::RayQuery` alone.
    LitAndGathered,
    /// What an [`Environment`](crate::Environment) sends along the direction where nothing is hit, and nothing where something
    /// is: directional occlusion. Four bytes per direction; a ray ends at the first hit that it finds, the nearest or not. With
    /// [`BouncedDescriptor::environment`] and [`Sampling::Cosine`] alone.
    Sky,
}

impl Payload {
    /// Whether hits bring radiance, from wherever.
    pub(crate) fn is_radiance(self) -> bool {
        self != Self::Occlusion
    }
}

/// What lights the hits of [`Payload::LitRadiance`] and [`Payload::LitAndGathered`].
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
    /// From nowhere, for [`Payload::Occlusion`] and [`Payload::Sky`].
    #[default]
    None,
    /// For [`Payload::Radiance`] a storage buffer of a [`SurfelRadiance`](crate::SurfelRadiance) for each surfel of the cloud, as
    /// the [`SurfelShader`](crate::SurfelShader) or the caller fills it. What is not a number or negative counts as 0, and what
    /// is above 1e30 as that.
    Surfels(&'a Buffer),
    /// For [`Payload::LitRadiance`] lights and materials.
    Lit(HitLighting<'a>),
    /// For [`Payload::LitAndGathered`].
    LitAndGathered {
        /// Lights and materials.
        lighting: HitLighting<'a>,
        /// A storage buffer of a [`SurfelRadiance`](crate::SurfelRadiance) for each surfel of the cloud, as the
        /// [`SurfelGatherer`](crate::SurfelGatherer) fills it: without what surfels send of themselves and reflect straight from
        /// the lights. What is negative or not finite counts as 0.
        gathered: &'a Buffer,
    },
}

/// What rays meet, as [`BouncedDescriptor::primitives`] says.
#[derive(Clone, Copy, Debug)]
pub enum BouncedScene<'a> {
    /// The pieces of a cloud, with holes or without, or its surfels as disks.
    Cloud {
        /// The cloud. Recorded with [`SurfelizerSettings::density`](crate::SurfelizerSettings::density) at infinity its pieces
        /// are the caller's triangles, and hits are exact.
        cloud: &'a SurfelCloud,
        /// The hierarchy over them, recorded since the cloud was.
        bvh: &'a Bvh,
    },
    /// Instances of meshes, for [`Primitives::Instances`] and [`Primitives::AlphaTestedInstances`].
    Instances(&'a InstancedBvh),
}

impl<'a> BouncedScene<'a> {
    /// The point that rays are relative to.
    pub(crate) fn origin(&self) -> glam::DVec3 {
        match self {
            Self::Cloud { cloud, .. } => cloud.origin(),
            Self::Instances(bvh) => bvh.origin(),
        }
    }

    /// Its last recording.
    pub(crate) fn last(&self) -> Result<Stamp, Error> {
        match self {
            Self::Cloud { cloud, .. } => cloud.last(),
            Self::Instances(bvh) => bvh.last(),
        }
    }

    /// [`Error::Recording`] for `name` where it was not recorded from this, since this was.
    pub(crate) fn check_source(&self, name: &'static str, stamp: &Stamp) -> Result<(), Error> {
        match self {
            Self::Cloud { cloud, .. } => cloud.check_source(name, stamp),
            Self::Instances(bvh) => bvh.check_source(name, stamp),
        }
    }

    /// [`Error::Mismatch`] where it is of others.
    pub(crate) fn check_primitives(&self, needed: Primitives) -> Result<(), Error> {
        match self {
            Self::Cloud { .. } if needed.are_instances() => self.instances().map(|_| ()),
            Self::Cloud { cloud, bvh } => bvh.check_primitives(needed, cloud),
            Self::Instances(bvh) if needed.are_instances() => bvh.check_primitives(needed),
            Self::Instances(_) => self.cloud().map(|_| ()),
        }
    }

    /// The cloud and its hierarchy.
    pub(crate) fn cloud(&self) -> Result<(&'a SurfelCloud, &'a Bvh), Error> {
        match self {
            Self::Cloud { cloud, bvh } => Ok((cloud, bvh)),
            Self::Instances(_) => Err(mismatch("Instances", "Cloud, for these Primitives")),
        }
    }

    /// The hierarchy of two levels.
    pub(crate) fn instances(&self) -> Result<&'a InstancedBvh, Error> {
        match self {
            Self::Cloud { .. } => Err(mismatch("Cloud", "Instances, for Primitives::Instances")),
            Self::Instances(bvh) => Ok(bvh),
        }
    }
}

fn mismatch(found: &str, needed: &str) -> Error {
    Error::Mismatch {
        name: "BouncedInput::scene",
        found: format!("BouncedScene::{found}"),
        needed: format!("BouncedScene::{needed}"),
    }
}

/// What [`BouncedDescriptor::takes_more`] asks for.
pub(crate) const NEEDED_FOR_MORE: &str =
    "BouncedDescriptor::counted, and Sampling::Cosine, or Sampling::Glossy with radiance";

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
    /// `Primitives::RayQuery`, whose steps the device does not tell, nor with [`Payload::LitAndGathered`], which binds as many
    /// buffers as there may be.
    pub statistics: bool,
    /// Whether pixels may have different numbers of rays: those of [`BouncedInput::pixels`](crate::BouncedInput::pixels) alone,
    /// and further ones where a [`RayBudget`](crate::RayBudget) puts them, with [`Sampling::Cosine`], and with
    /// [`Sampling::Glossy`] where hits bring radiance. Views then take 8 bytes per pixel more, with radiance 16, and with that of
    /// glossy receivers 32.
    pub counted: bool,
    /// Whether rays that meet nothing bring what an [`Environment`](crate::Environment) has there
    /// ([`BouncedInput::environment`](crate::BouncedInput::environment)) in place of
    /// [`BouncedSettings::sky_radiance`](crate::BouncedSettings::sky_radiance). With [`Sampling::Cosine`] some of a pixel's rays
    /// then go where the environment is bright
    /// ([`BouncedSettings::environment_share`](crate::BouncedSettings::environment_share)), and what rays bring is weighed by
    /// multiple importance sampling (balance heuristic; Veach and Guibas, *Optimally Combining Sampling Techniques for Monte
    /// Carlo Rendering*, 1995), so that their mean has no bias. Not with [`Payload::Occlusion`], nor with [`Sampling::Uniform`].
    pub environment: bool,
    /// How many rays of each pixel go to surfaces that shine of themselves
    /// ([`BouncedInput::emitters`](crate::BouncedInput::emitters)), beside
    /// [`BouncedSettings::rays_per_pixel`](crate::BouncedSettings::rays_per_pixel), 0…16; further sets of rays have as many. What
    /// shines is then weighed by multiple importance sampling (balance heuristic), whichever rays find it, so that their sum has
    /// no bias: of small lamps few rays that go by chance make noise. With [`Payload::LitRadiance`] and
    /// [`Payload::LitAndGathered`], not with primitives of instances nor [`Sampling::Uniform`]. Views take 4 bytes more per pixel
    /// and ray, of glossy receivers 8. Default 0, which binds nothing of it.
    pub emitter_samples: u32,
}

/// The most [`BouncedDescriptor::emitter_samples`].
pub(crate) const MAX_EMITTER_SAMPLES: u32 = 16;

impl BouncedDescriptor {
    /// Whether hits are lit where they are.
    pub(crate) fn lit(&self) -> bool {
        matches!(self.payload, Payload::LitRadiance | Payload::LitAndGathered)
    }

    /// Whether hits bring what surfels gathered besides.
    pub(crate) fn gathered(&self) -> bool {
        self.payload == Payload::LitAndGathered
    }

    /// Whether rays bring an environment alone.
    pub(crate) fn sky(&self) -> bool {
        self.payload == Payload::Sky
    }

    /// Whether pixels may have further rays: their sums are kept, of what arrives where directions are drawn by the cosine, and
    /// of what the lobe makes of radiance.
    pub(crate) fn takes_more(&self) -> bool {
        self.counted
            && match self.sampling {
                Sampling::Cosine => true,
                Sampling::Glossy => self.payload.is_radiance(),
                Sampling::Uniform => false,
            }
    }

    /// Whether directions are drawn by an environment too: those cannot be had from the settings alone.
    pub(crate) fn drawn_by_environment(&self) -> bool {
        self.environment && self.sampling == Sampling::Cosine
    }

    /// Whether rays go to emitters too.
    pub(crate) fn aims(&self) -> bool {
        self.emitter_samples > 0
    }

    /// Layers of colours that rays towards emitters bring.
    pub(crate) fn emitter_layers(&self) -> u32 {
        match self.sampling {
            // Linear in the reflectance straight on.
            Sampling::Glossy => 2 * self.emitter_samples,
            _ => self.emitter_samples,
        }
    }

    pub(crate) fn flags(&self) -> Vec<&'static str> {
        let mut flags = Vec::new();
        flags.extend(self.payload.is_radiance().then_some("RADIANCE"));
        flags.extend(self.primitives.flags());
        if self.lit() {
            flags.extend(["LIT", "SHADOW_RAYS"]);
        }
        flags.extend(self.gathered().then_some("GATHERED"));
        flags.extend(self.statistics.then_some("STATISTICS"));
        flags.extend((self.sampling == Sampling::Glossy).then_some("GLOSSY"));
        flags.extend(self.counted.then_some("COUNTED"));
        flags.extend(self.environment.then_some("ENVIRONMENT"));
        flags.extend((self.payload == Payload::Sky).then_some("SKY_LIGHT"));
        flags.extend(self.aims().then_some("EMITTERS"));
        flags
    }
}

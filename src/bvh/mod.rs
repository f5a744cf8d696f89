//! Bounding volume hierarchies, which rays traverse: over a cloud's pieces (`wgsl/common/bvh_traverse.wgsl`), or over its
//! surfels as disks (`wgsl/common/disk_bvh_traverse.wgsl`).

pub(crate) mod disks;
#[cfg(test)]
mod tests;
pub(crate) mod triangles;

use wgpu::{CommandEncoder, Device};

use self::{
    disks::{DiskBounds, DiskBoundsPass, MAX_LEVELS},
    triangles::{BvhPass, Over, TriangleBvh},
};
use crate::{
    effect::Listing,
    error::{Error, check_setting},
    gpu::compiler::Compiler,
    gpu::{Timestamps, check_timestamps},
    recorded::{Last, Stamp},
    surfel::SurfelCloud,
};

const NAME: &str = "Bvh";

/// What a [`Bvh`] is built over, and rays meet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Primitives {
    /// A cloud's pieces, which are triangles: exact.
    #[default]
    Triangles,
    /// A cloud's surfels as disks, from either side, as in the paper (The Bounced Z-buffer 4.2): for comparison with it.
    /// Disks leave gaps between them, which rays pass through, and stick out at edges.
    ///
    /// On level l a pixel meets one surfel in 4^l, 2^l times as large, at distances within the level's shell
    /// ([`DiskSettings`](crate::DiskSettings)). On level 0 those that lie in the pixel's own surface are left out: turned
    /// by less than acos 0.8, with less than half a radius between the pixel and their plane, and hit within four radii.
    Disks {
        /// Number of levels, 1…8; 1 for plain disks without levels.
        levels: u32,
    },
    /// The triangles of instances of meshes, in a hierarchy of two levels ([`InstancedBvh`](crate::InstancedBvh)), which its own
    /// builder makes: exact.
    Instances,
}

impl Primitives {
    pub(crate) fn validate(self) -> Result<(), Error> {
        match self {
            Self::Triangles | Self::Instances => Ok(()),
            Self::Disks { levels } => check_setting(
                (1..=MAX_LEVELS).contains(&levels),
                "Primitives::Disks::levels",
                levels,
                "1 to 8",
            ),
        }
    }

    /// Whether they are a cloud's surfels.
    pub(crate) fn are_disks(self) -> bool {
        matches!(self, Self::Disks { .. })
    }
}

/// A bounding volume hierarchy over the primitives of a cloud, which rays traverse. A [`BvhBuilder`] makes it, and records it
/// anew after each recording of the cloud; nothing of it is kept from frame to frame.
///
/// Any number of passes and views trace the same one: [`BouncedZBuffer`](crate::BouncedZBuffer),
/// [`Shadow::Traced`](crate::Shadow::Traced).
#[derive(Debug)]
pub struct Bvh {
    bounds: Bounds,
    /// The cloud's recording.
    recorded: Last<Stamp>,
}

/// Of either kind of primitives.
#[derive(Debug)]
enum Bounds {
    Triangles(Box<TriangleBvh>),
    Disks(Box<DiskBounds>),
}

impl Bvh {
    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        match &self.bounds {
            Bounds::Triangles(bvh) => bvh.memory_bytes(),
            Bounds::Disks(bounds) => bounds.memory_bytes(),
        }
    }

    /// That over a cloud's pieces. [`Error::Mismatch`] where they are of another kind or for another capacity,
    /// [`Error::Recording`] where they were not recorded from this cloud, since that was.
    pub(crate) fn triangles(&self, cloud: &SurfelCloud) -> Result<&TriangleBvh, Error> {
        let bvh = self.room_for_triangles(cloud)?;
        self.check_source(cloud)?;
        Ok(bvh)
    }

    /// That over a cloud's surfels as disks on so many levels.
    pub(crate) fn disks(&self, cloud: &SurfelCloud, levels: u32) -> Result<&DiskBounds, Error> {
        let bounds = self.room_for_disks(cloud, levels)?;
        self.check_source(cloud)?;
        Ok(bounds)
    }

    fn check_source(&self, cloud: &SurfelCloud) -> Result<(), Error> {
        cloud.last()?;
        cloud.check_source(NAME, &self.recorded.get(NAME)?)
    }

    fn room_for_triangles(&self, cloud: &SurfelCloud) -> Result<&TriangleBvh, Error> {
        match &self.bounds {
            Bounds::Triangles(bvh) if bvh.capacity() == cloud.capacity.pieces => Ok(bvh),
            _ => Err(self.mismatch(describe_triangles(cloud.capacity.pieces))),
        }
    }

    fn room_for_disks(&self, cloud: &SurfelCloud, levels: u32) -> Result<&DiskBounds, Error> {
        match &self.bounds {
            Bounds::Disks(bounds)
                if bounds.capacity == cloud.capacity.surfels && bounds.levels() == levels =>
            {
                Ok(bounds)
            }
            _ => Err(self.mismatch(describe_disks(cloud.capacity.surfels, levels))),
        }
    }

    fn mismatch(&self, needed: String) -> Error {
        Error::Mismatch {
            name: NAME,
            found: match &self.bounds {
                Bounds::Triangles(bvh) => describe_triangles(bvh.capacity()),
                Bounds::Disks(bounds) => describe_disks(bounds.capacity, bounds.levels()),
            },
            needed,
        }
    }
}

fn describe_triangles(capacity: u32) -> String {
    format!("{capacity} triangles")
}

fn describe_disks(capacity: u32, levels: u32) -> String {
    format!("{capacity} disks on {levels} levels")
}

/// Builds [`Bvh`]s on the GPU: one [`BvhBuilder::record`] a frame and cloud, between the recording that makes the cloud and
/// those that trace it.
///
/// Holds pipelines only; one serves any number of clouds.
#[derive(Debug)]
pub struct BvhBuilder(Builder);

#[derive(Debug)]
enum Builder {
    Triangles(Box<BvhPass>),
    Disks(DiskBoundsPass, u32),
}

impl BvhBuilder {
    /// Compiles the pipelines for one kind of primitives. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device was made with less than that; [`Error::Setting`] for levels out of range,
    /// [`Error::Mismatch`] for [`Primitives::Instances`], which an [`InstancedBvhBuilder`](crate::InstancedBvhBuilder) builds.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        primitives: Primitives,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        primitives.validate()?;
        Ok(Self(match primitives {
            Primitives::Triangles => {
                Builder::Triangles(Box::new(BvhPass::new(device, cache, Over::Triangles)?))
            }
            Primitives::Disks { levels } => {
                Builder::Disks(DiskBoundsPass::new(device, cache)?, levels)
            }
            Primitives::Instances => {
                return Err(Error::Mismatch {
                    name: "BvhBuilder",
                    found: "the primitives of a cloud".into(),
                    needed: "an InstancedBvhBuilder, for Primitives::Instances".into(),
                });
            }
        }))
    }

    /// Room for the hierarchy over the primitives of a cloud, by the cloud's capacity.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device cannot hold or bind as much.
    pub fn create(&self, device: &Device, cloud: &SurfelCloud) -> Result<Bvh, Error> {
        let bounds = match &self.0 {
            Builder::Triangles(pass) => {
                Bounds::Triangles(Box::new(pass.create(device, cloud.capacity.pieces)?))
            }
            Builder::Disks(_, levels) => {
                Bounds::Disks(Box::new(DiskBounds::new(device, cloud, *levels)?))
            }
        };
        Ok(Bvh {
            bounds,
            recorded: Last::default(),
        })
    }

    /// Records the building, into a compute pass of its own, from what the cloud was last recorded to be.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for a hierarchy over other primitives or for another cloud's capacity, [`Error::Recording`] for a
    /// cloud that was not recorded.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        cloud: &SurfelCloud,
        bvh: &Bvh,
        timestamps: Option<Timestamps<'_>>,
    ) -> Result<(), Error> {
        check_timestamps(timestamps)?;
        let of = cloud.last()?;
        match &self.0 {
            Builder::Triangles(pass) => {
                let primitives = (&cloud.pieces, &cloud.counters);
                let bounds = bvh.room_for_triangles(cloud)?;
                pass.record(device, encoder, primitives, bounds, timestamps);
            }
            Builder::Disks(pass, levels) => {
                let bounds = bvh.room_for_disks(cloud, *levels)?;
                pass.record(device, encoder, cloud, bounds, timestamps);
            }
        }
        bvh.recorded.set(of);
        Ok(())
    }
}

/// Every module of the room.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    triangles::list(all)?;
    disks::list(all)
}

//! Bounding volume hierarchies, which rays traverse: over a cloud's pieces (`wgsl/common/bvh_traverse.wgsl`), or over its
//! surfels as disks (`wgsl/common/disk_walk.wgsl`).

pub(crate) mod disks;
#[cfg(test)]
mod tests;
pub(crate) mod triangles;

use wgpu::{CommandEncoder, Device, PipelineCache};

use self::{
    disks::{DiskBounds, DiskBoundsPass},
    triangles::{TriangleBvh, TriangleBvhPass},
};
use crate::{
    error::Error,
    gpu::Timestamps,
    recorded::{Last, Stamp},
    shaders::Listing,
    surfel::SurfelCloud,
};

/// A bounding volume hierarchy over a cloud's senders: what a ray skips by. Made anew from each recording of the cloud;
/// nothing of it is kept from frame to frame. That of pieces takes 48 bytes a piece in one binding, as the cloud's own buffer
/// of them does: within `Limits::default()` up to 2 796 202 pieces, and up to 2^23 where the device binds more.
#[derive(Debug)]
pub struct SenderBounds {
    bounds: Bounds,
    /// The cloud's recording.
    recorded: Last<Stamp>,
}

/// Of either kind of senders.
#[derive(Debug)]
enum Bounds {
    Pieces(Box<TriangleBvh>),
    Disks(Box<DiskBounds>),
}

impl SenderBounds {
    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        match &self.bounds {
            Bounds::Pieces(bvh) => bvh.memory_bytes(),
            Bounds::Disks(bounds) => bounds.memory_bytes(),
        }
    }

    /// Those of a cloud's pieces. [`Error::Mismatch`] where they are of another kind or for another capacity,
    /// [`Error::Recording`] where they were not recorded from this cloud, since that was.
    pub(crate) fn pieces(&self, cloud: &SurfelCloud) -> Result<&TriangleBvh, Error> {
        let bvh = self.room_for_pieces(cloud)?;
        self.check_source(cloud)?;
        Ok(bvh)
    }

    /// Those of a cloud's surfels as disks on so many levels.
    pub(crate) fn disks(&self, cloud: &SurfelCloud, levels: u32) -> Result<&DiskBounds, Error> {
        let bounds = self.room_for_disks(cloud, levels)?;
        self.check_source(cloud)?;
        Ok(bounds)
    }

    fn check_source(&self, cloud: &SurfelCloud) -> Result<(), Error> {
        cloud.last()?;
        cloud.check_source("SenderBounds", &self.recorded.get("SenderBounds")?)
    }

    fn room_for_pieces(&self, cloud: &SurfelCloud) -> Result<&TriangleBvh, Error> {
        match &self.bounds {
            Bounds::Pieces(bvh) if bvh.capacity() == cloud.capacity.pieces => Ok(bvh),
            _ => Err(self.mismatch(describe_pieces(cloud.capacity.pieces))),
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
            name: "SenderBounds",
            found: match &self.bounds {
                Bounds::Pieces(bvh) => describe_pieces(bvh.capacity()),
                Bounds::Disks(bounds) => describe_disks(bounds.capacity, bounds.levels()),
            },
            needed,
        }
    }
}

fn describe_pieces(capacity: u32) -> String {
    format!("{capacity} pieces")
}

fn describe_disks(capacity: u32, levels: u32) -> String {
    format!("{capacity} disks on {levels} levels")
}

/// The pipelines for one kind of senders.
#[derive(Debug)]
pub(crate) enum SenderBoundsPass {
    Pieces(Box<TriangleBvhPass>),
    Disks(DiskBoundsPass, u32),
}

impl SenderBoundsPass {
    /// Of pieces, or of disks on so many levels.
    pub fn new(
        device: &Device,
        disk_levels: Option<u32>,
        cache: Option<&PipelineCache>,
    ) -> Result<Self, Error> {
        Ok(match disk_levels {
            None => Self::Pieces(Box::new(TriangleBvhPass::new(device, cache)?)),
            Some(levels) => Self::Disks(DiskBoundsPass::new(device, cache)?, levels),
        })
    }

    pub fn create(&self, device: &Device, cloud: &SurfelCloud) -> Result<SenderBounds, Error> {
        let bounds = match self {
            Self::Pieces(pass) => {
                Bounds::Pieces(Box::new(pass.create(device, cloud.capacity.pieces)?))
            }
            Self::Disks(_, levels) => {
                Bounds::Disks(Box::new(DiskBounds::new(device, cloud, *levels)?))
            }
        };
        Ok(SenderBounds {
            bounds,
            recorded: Last::default(),
        })
    }

    /// Records into a pass of its own.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for bounds of another kind, or of another cloud's capacity, [`Error::Recording`] for a cloud that
    /// was not recorded.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        cloud: &SurfelCloud,
        bounds: &SenderBounds,
        timestamps: Option<Timestamps<'_>>,
    ) -> Result<(), Error> {
        let of = cloud.last()?;
        let recorded = &bounds.recorded;
        match self {
            Self::Pieces(pass) => {
                let bvh = bounds.room_for_pieces(cloud)?;
                pass.record(
                    device,
                    encoder,
                    (&cloud.pieces, &cloud.counters),
                    bvh,
                    timestamps,
                );
            }
            Self::Disks(pass, levels) => {
                let bounds = bounds.room_for_disks(cloud, *levels)?;
                pass.record(device, encoder, cloud, bounds, timestamps);
            }
        }
        recorded.set(of);
        Ok(())
    }
}

/// Every module of the room.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    triangles::list(all)?;
    disks::list(all)
}

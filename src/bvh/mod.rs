//! Bounding volume hierarchies, which rays traverse: over a cloud's pieces (`wgsl/common/bvh_traverse.wgsl`, or by the device
//! itself `wgsl/common/ray_query_traverse.wgsl`), or over its surfels as disks (`wgsl/common/disk_bvh_traverse.wgsl`).

pub(crate) mod disks;
#[cfg(feature = "ray-query")]
pub(crate) mod ray_query;
#[cfg(test)]
mod tests;
pub(crate) mod triangles;

use wgpu::{CommandEncoder, Device, Features};

#[cfg(feature = "ray-query")]
use self::ray_query::{DeviceBvh, DeviceBvhPass};
use self::{
    disks::{DiskBounds, DiskBoundsPass, MAX_LEVELS},
    triangles::{TriangleBvh, TriangleBvhPass},
};
use crate::{
    effect::Listing,
    error::{Error, check_setting},
    gpu::binding::{self, Named},
    gpu::compiler::Compiler,
    gpu::{Timestamps, check_timestamps},
    recorded::{Last, Stamp},
    surfel::SurfelCloud,
};

const NAME: &str = "Bvh";

/// What a [`Bvh`] is built over, and rays meet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
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
    /// A cloud's pieces as with [`Primitives::Triangles`], in a structure that the device builds, by rays that it traces: in
    /// hardware, where it has that. Only with this crate's feature `ray-query`, and for a device that was made with
    /// [`Features::EXPERIMENTAL_RAY_QUERY`], which is `unsafe` to ask wgpu for and the caller's to decide, and with the
    /// [limits](wgpu::Limits::using_minimum_supported_acceleration_structure_values) that go with it.
    ///
    /// Hits are those of [`Primitives::Triangles`], but for rays that pass an edge by less than rounding. Of triangles at the
    /// same distance the device hits either, and where any hit will do, as for occlusion, it is the device's choice which one;
    /// how near those are guides the [`HitResolver`](crate::HitResolver)'s filter. A corner within another triangle's edge, as
    /// the pieces of large triangles have them, and triangles that are thinner than positions are rounded may leave a gap, as
    /// the device has it.
    #[cfg(feature = "ray-query")]
    RayQuery,
}

impl Primitives {
    /// [`Error::Setting`] for levels out of range, [`Error::Feature`] and [`Error::Limit`] for what a device was not made with.
    #[cfg_attr(not(feature = "ray-query"), expect(unused_variables))]
    pub(crate) fn validate(self, device: &Device) -> Result<(), Error> {
        match self {
            Self::Triangles => Ok(()),
            #[cfg(feature = "ray-query")]
            Self::RayQuery => ray_query::check_device(device),
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

    /// Whether the device traces the rays.
    pub(crate) fn by_device(self) -> bool {
        match self {
            #[cfg(feature = "ray-query")]
            Self::RayQuery => true,
            _ => false,
        }
    }

    /// What shaders that trace them need.
    pub(crate) fn features(self) -> Features {
        match self {
            #[cfg(feature = "ray-query")]
            Self::RayQuery => ray_query::FEATURE,
            _ => Features::empty(),
        }
    }

    /// In words, for errors.
    fn describe(self, capacity: u32) -> String {
        match self {
            Self::Triangles => format!("{capacity} triangles"),
            Self::Disks { levels } => format!("{capacity} disks on {levels} levels"),
            #[cfg(feature = "ray-query")]
            Self::RayQuery => format!("{capacity} triangles by ray queries"),
        }
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
    #[cfg(feature = "ray-query")]
    RayQuery(Box<DeviceBvh>),
}

impl Bvh {
    /// GPU memory that it owns, bytes. wgpu does not tell how large a device's own structure is: with
    /// `Primitives::RayQuery` that comes on top.
    pub fn memory_bytes(&self) -> u64 {
        match &self.bounds {
            Bounds::Triangles(bvh) => bvh.memory_bytes(),
            Bounds::Disks(bounds) => bounds.memory_bytes(),
            #[cfg(feature = "ray-query")]
            Bounds::RayQuery(bvh) => bvh.memory_bytes(),
        }
    }

    /// What it is over.
    pub(crate) fn primitives(&self) -> Primitives {
        match &self.bounds {
            Bounds::Triangles(_) => Primitives::Triangles,
            Bounds::Disks(bounds) => Primitives::Disks {
                levels: bounds.levels(),
            },
            #[cfg(feature = "ray-query")]
            Bounds::RayQuery(_) => Primitives::RayQuery,
        }
    }

    /// [`Error::Mismatch`] where it is over others.
    pub(crate) fn check_primitives(
        &self,
        needed: Primitives,
        cloud: &SurfelCloud,
    ) -> Result<(), Error> {
        if self.primitives() == needed {
            Ok(())
        } else {
            Err(self.mismatch(needed, cloud))
        }
    }

    /// What a shader binds to trace a cloud's pieces, by what it was assembled for. [`Error::Mismatch`] where this is over others
    /// or for another capacity, [`Error::Recording`] where it was not recorded from this cloud, since that was.
    pub(crate) fn pieces(
        &self,
        cloud: &SurfelCloud,
        primitives: Primitives,
    ) -> Result<Vec<Named<'_>>, Error> {
        let resources = match primitives {
            #[cfg(feature = "ray-query")]
            Primitives::RayQuery => {
                let bvh = self.room_for_ray_query(cloud)?;
                vec![("scene", binding::structure(&bvh.scene))]
            }
            _ => {
                let bvh = self.room_for_triangles(cloud)?;
                vec![
                    ("nodes", binding::view(&bvh.nodes)),
                    ("triangles", binding::view(&bvh.triangles)),
                ]
            }
        };
        self.check_source(cloud)?;
        Ok(resources)
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
            _ => Err(self.mismatch(Primitives::Triangles, cloud)),
        }
    }

    fn room_for_disks(&self, cloud: &SurfelCloud, levels: u32) -> Result<&DiskBounds, Error> {
        match &self.bounds {
            Bounds::Disks(bounds)
                if bounds.capacity == cloud.capacity.surfels && bounds.levels() == levels =>
            {
                Ok(bounds)
            }
            _ => Err(self.mismatch(Primitives::Disks { levels }, cloud)),
        }
    }

    #[cfg(feature = "ray-query")]
    fn room_for_ray_query(&self, cloud: &SurfelCloud) -> Result<&DeviceBvh, Error> {
        match &self.bounds {
            Bounds::RayQuery(bvh) if bvh.capacity() == cloud.capacity.pieces => Ok(bvh),
            _ => Err(self.mismatch(Primitives::RayQuery, cloud)),
        }
    }

    fn mismatch(&self, needed: Primitives, cloud: &SurfelCloud) -> Error {
        let capacity = match &self.bounds {
            Bounds::Triangles(bvh) => bvh.capacity(),
            Bounds::Disks(bounds) => bounds.capacity,
            #[cfg(feature = "ray-query")]
            Bounds::RayQuery(bvh) => bvh.capacity(),
        };
        Error::Mismatch {
            name: NAME,
            found: self.primitives().describe(capacity),
            needed: needed.describe(if needed.are_disks() {
                cloud.capacity.surfels
            } else {
                cloud.capacity.pieces
            }),
        }
    }
}

/// Builds [`Bvh`]s on the GPU: one [`BvhBuilder::record`] a frame and cloud, between the recording that makes the cloud and
/// those that trace it.
///
/// Holds pipelines only; one serves any number of clouds.
#[derive(Debug)]
pub struct BvhBuilder(Builder);

#[derive(Debug)]
enum Builder {
    Triangles(Box<TriangleBvhPass>),
    Disks(DiskBoundsPass, u32),
    #[cfg(feature = "ray-query")]
    RayQuery(Box<DeviceBvhPass>),
}

impl BvhBuilder {
    /// Compiles the pipelines for one kind of primitives. Needs no features and nothing beyond `Limits::default()`, but for
    /// `Primitives::RayQuery`.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device was made with less than that; [`Error::Setting`] for levels out of range;
    /// [`Error::Feature`] for ray queries that the device was not made for.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        primitives: Primitives,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        primitives.validate(device)?;
        Ok(Self(match primitives {
            Primitives::Triangles => {
                Builder::Triangles(Box::new(TriangleBvhPass::new(device, cache)?))
            }
            Primitives::Disks { levels } => {
                Builder::Disks(DiskBoundsPass::new(device, cache)?, levels)
            }
            #[cfg(feature = "ray-query")]
            Primitives::RayQuery => Builder::RayQuery(Box::new(DeviceBvhPass::new(device, cache)?)),
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
            #[cfg(feature = "ray-query")]
            Builder::RayQuery(_) => {
                Bounds::RayQuery(Box::new(DeviceBvh::new(device, cloud.capacity.pieces)?))
            }
        };
        Ok(Bvh {
            bounds,
            recorded: Last::default(),
        })
    }

    /// Records the building, into a compute pass of its own (and behind it, where the device builds), from what the cloud was
    /// last recorded to be.
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
            #[cfg(feature = "ray-query")]
            Builder::RayQuery(pass) => {
                let primitives = (&cloud.pieces, &cloud.counters);
                let bounds = bvh.room_for_ray_query(cloud)?;
                pass.record(device, encoder, primitives, bounds, timestamps);
            }
        }
        bvh.recorded.set(of);
        Ok(())
    }
}

/// Every module of the room.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    triangles::list(all)?;
    #[cfg(feature = "ray-query")]
    ray_query::list(all)?;
    disks::list(all)
}

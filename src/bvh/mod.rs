//! Bounding volume hierarchies, which rays traverse: over a cloud's pieces (`wgsl/common/bvh_traverse.wgsl`, or by the device
//! itself `wgsl/common/ray_query_traverse.wgsl`), or over its surfels as disks (`wgsl/common/disk_bvh_traverse.wgsl`).

pub(crate) mod disks;
#[cfg(feature = "ray-query")]
pub(crate) mod ray_query;
#[cfg(test)]
mod tests;
pub(crate) mod triangles;

use wgpu::{Buffer, CommandEncoder, Device, Features};

#[cfg(feature = "ray-query")]
use self::ray_query::{DeviceBvh, DeviceBvhPass};
use self::{
    disks::{DiskBounds, DiskBoundsPass, MAX_LEVELS},
    triangles::{BvhPass, Over, TriangleBvh},
};
use crate::{
    alpha_test::{AlphaMaps, AlphaTestPass, create_cutouts, settings::AlphaTests},
    effect::Listing,
    error::{Error, check_setting},
    geometry::Geometry,
    gpu::binding::{self, Kept, Named},
    gpu::compiler::Compiler,
    gpu::{Timestamps, check_timestamps, compute_pass},
    recorded::{Last, Stamp},
    surfel::SurfelCloud,
};

const NAME: &str = "Bvh";

const LABEL: &str = "deep-screen-space bvh";

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
    /// The triangles of instances of meshes, in a hierarchy of two levels ([`InstancedBvh`](crate::InstancedBvh)), which its own
    /// builder makes: exact.
    Instances,
    /// [`Primitives::Triangles`], of which some have holes where a texture of the caller's has little alpha ([`AlphaTests`]):
    /// foliage, fences. Rays pass the holes, those for shadows too. Surfels are those of whole triangles
    /// where light is gathered, and in splats unless [`SurfelHoles`](crate::SurfelHoles) are recorded. Triangles without holes
    /// cost what they do otherwise, but for 64 bytes more each and a branch.
    AlphaTested,
    /// [`Primitives::Instances`], of which some have holes.
    AlphaTestedInstances,
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
            Self::Triangles | Self::Instances | Self::AlphaTested | Self::AlphaTestedInstances => {
                Ok(())
            }
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

    /// Whether they are instances of meshes.
    pub(crate) fn are_instances(self) -> bool {
        matches!(self, Self::Instances | Self::AlphaTestedInstances)
    }

    /// Whether some may have holes.
    pub(crate) fn are_alpha_tested(self) -> bool {
        matches!(self, Self::AlphaTested | Self::AlphaTestedInstances)
    }

    /// What a pass is compiled for beside rays by the device: a cloud's triangles, with holes or without.
    pub(crate) fn of_own_traversal(self) -> Self {
        if self.are_alpha_tested() {
            Self::AlphaTested
        } else {
            Self::Triangles
        }
    }

    /// Flags of shaders that trace them.
    pub(crate) fn flags(self) -> impl Iterator<Item = &'static str> {
        [
            (self.are_disks(), "DISKS"),
            (self.by_device(), "RAY_QUERY"),
            (self.are_instances(), "TWO_LEVELS"),
            (self.are_alpha_tested(), "ALPHA_TESTED"),
        ]
        .into_iter()
        .filter_map(|(is, flag)| is.then_some(flag))
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
            Self::Instances => "triangles of instances".into(),
            Self::AlphaTested => format!("{capacity} alpha-tested triangles"),
            Self::AlphaTestedInstances => "alpha-tested triangles of instances".into(),
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
    AlphaTested(Box<AlphaTestedBvh>),
    Disks(Box<DiskBounds>),
    #[cfg(feature = "ray-query")]
    RayQuery(Box<DeviceBvh>),
}

/// Over triangles of which some have holes.
#[derive(Debug)]
struct AlphaTestedBvh {
    bvh: TriangleBvh,
    /// Of each triangle.
    cutouts: Buffer,
    maps: AlphaMaps,
    kept: Kept,
}

/// What a recording of alpha-tested triangles works on.
#[derive(Clone, Copy, Debug)]
pub struct AlphaTestedInput<'a> {
    /// What the cloud was made of: the geometry of its recording, whose buffers are read once more.
    pub geometry: Geometry<'a>,
    /// Which of it has holes.
    pub tests: AlphaTests<'a>,
    /// The cloud, as it was last recorded.
    pub cloud: &'a SurfelCloud,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl Bvh {
    /// GPU memory that it owns, bytes. wgpu does not tell how large a device's own structure is: with
    /// `Primitives::RayQuery` that comes on top.
    pub fn memory_bytes(&self) -> u64 {
        match &self.bounds {
            Bounds::Triangles(bvh) => bvh.memory_bytes(),
            Bounds::AlphaTested(room) => room.bvh.memory_bytes() + room.cutouts.size(),
            Bounds::Disks(bounds) => bounds.memory_bytes(),
            #[cfg(feature = "ray-query")]
            Bounds::RayQuery(bvh) => bvh.memory_bytes(),
        }
    }

    /// What it is over.
    pub(crate) fn primitives(&self) -> Primitives {
        match &self.bounds {
            Bounds::Triangles(_) => Primitives::Triangles,
            Bounds::AlphaTested(_) => Primitives::AlphaTested,
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
            Primitives::AlphaTested => {
                let room = self.room_for_alpha_tested(cloud)?;
                vec![
                    ("nodes", binding::view(room.bvh.nodes())),
                    ("triangles", binding::view(room.bvh.triangles())),
                    ("alpha_maps", binding::view(room.maps.view())),
                ]
            }
            _ => {
                let bvh = self.room_for_triangles(cloud)?;
                vec![
                    ("nodes", binding::view(bvh.nodes())),
                    ("triangles", binding::view(bvh.triangles())),
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

    fn room_for_alpha_tested(&self, cloud: &SurfelCloud) -> Result<&AlphaTestedBvh, Error> {
        match &self.bounds {
            Bounds::AlphaTested(room) if room.bvh.capacity() == cloud.capacity.pieces => Ok(room),
            _ => Err(self.mismatch(Primitives::AlphaTested, cloud)),
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
            Bounds::AlphaTested(room) => room.bvh.capacity(),
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
    Triangles(Box<BvhPass>),
    AlphaTested(Box<BvhPass>, Box<AlphaTestPass>),
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
    /// [`Error::Mismatch`] for [`Primitives::Instances`] and [`Primitives::AlphaTestedInstances`], which an
    /// [`InstancedBvhBuilder`](crate::InstancedBvhBuilder) builds;
    /// [`Error::Feature`] for ray queries that the device was not made for.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        primitives: Primitives,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        primitives.validate(device)?;
        Ok(Self(match primitives {
            Primitives::Triangles => {
                Builder::Triangles(Box::new(BvhPass::new(device, cache, Over::Triangles)?))
            }
            Primitives::Disks { levels } => {
                Builder::Disks(DiskBoundsPass::new(device, cache)?, levels)
            }
            Primitives::AlphaTested => Builder::AlphaTested(
                Box::new(BvhPass::new(device, cache, Over::AlphaTested)?),
                Box::new(AlphaTestPass::new(device, cache)?),
            ),
            Primitives::Instances | Primitives::AlphaTestedInstances => {
                return Err(Error::Mismatch {
                    name: "BvhBuilder",
                    found: "the primitives of a cloud".into(),
                    needed: "an InstancedBvhBuilder, for primitives of instances".into(),
                });
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
            Builder::AlphaTested(pass, _) => {
                let capacity = cloud.capacity.pieces;
                Bounds::AlphaTested(Box::new(AlphaTestedBvh {
                    bvh: pass.create(device, capacity)?,
                    cutouts: create_cutouts(device, capacity)?,
                    maps: AlphaMaps::none(device),
                    kept: Kept::default(),
                }))
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
    /// last recorded to be. With [`Primitives::AlphaTested`] no triangle has holes;
    /// [`record_alpha_tested`](Self::record_alpha_tested) gives them some.
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
            Builder::AlphaTested(pass, _) => {
                let room = bvh.room_for_alpha_tested(cloud)?;
                encoder.clear_buffer(&room.cutouts, 0, None);
                let primitives = (&cloud.pieces, &cloud.counters);
                let stages = pass.bind_to(device, primitives, Some(&room.cutouts), &room.bvh);
                let mut recorded = compute_pass(encoder, LABEL, timestamps);
                pass.dispatch_to(&mut recorded, &room.bvh, &stages);
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

    /// Records the building of a hierarchy whose triangles have holes, for a builder of [`Primitives::AlphaTested`]: as
    /// [`record`](Self::record), after a dispatch for each mesh that is alpha-tested.
    ///
    /// # Errors
    /// As [`record`](Self::record); what [`AlphaTests::validate`] and [`Mesh::validate`](crate::Mesh::validate) find;
    /// [`Error::Mismatch`] for a builder of other primitives, or a geometry of more triangles than the cloud has room for;
    /// [`Error::Limit`] for buffers that the device cannot bind.
    pub fn record_alpha_tested(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &AlphaTestedInput<'_>,
        bvh: &mut Bvh,
    ) -> Result<(), Error> {
        check_timestamps(input.timestamps)?;
        let AlphaTestedInput {
            geometry,
            tests,
            cloud,
            ..
        } = input;
        let of = cloud.last()?;
        let Builder::AlphaTested(pass, cutter) = &self.0 else {
            return Err(Error::Mismatch {
                name: "BvhBuilder",
                found: "triangles without holes".into(),
                needed: "Primitives::AlphaTested".into(),
            });
        };
        AlphaTestPass::check(device, "AlphaTestedInput::geometry", geometry, tests, cloud)?;
        bvh.room_for_alpha_tested(cloud)?;
        let Bounds::AlphaTested(room) = &mut bvh.bounds else {
            return Err(bvh.mismatch(Primitives::AlphaTested, cloud));
        };
        room.maps.set(tests);
        let own = (&room.cutouts, &room.kept);
        let cuts = cutter.bind(device, encoder, (geometry, tests), cloud, own);
        encoder.clear_buffer(&room.cutouts, 0, None);
        let primitives = (&cloud.pieces, &cloud.counters);
        let stages = pass.bind_to(device, primitives, Some(&room.cutouts), &room.bvh);
        let mut recorded = compute_pass(encoder, LABEL, input.timestamps);
        cutter.dispatch(&mut recorded, &cuts);
        pass.dispatch_to(&mut recorded, &room.bvh, &stages);
        drop(recorded);
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

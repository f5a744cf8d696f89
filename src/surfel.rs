//! The surfel cloud: what the Surfelizer writes and the splatting passes read.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use wgpu::{Buffer, BufferUsages, Device};

use crate::{
    error::{Error, check_setting},
    gpu::{
        binding::Kept,
        scan::{Scan, ScanBuffer},
        storage,
    },
    recorded::{Recordings, Stamp},
};

/// Where a piece's surfels go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Placement {
    /// At the centroids of the piece's leaves: even coverage, and disks that can become gap-free cells.
    #[default]
    Centroid,
    /// At random over the piece, by a hash that stays when the camera moves (The Bounced Z-buffer 4.3).
    Random,
    /// Deep Screen Space 3.1: the pattern of the tessellator's points, inset by a radius from the piece's corners and
    /// jittered by at most a radius. At least three surfels per piece.
    Grid,
}

impl Placement {
    /// The shader's number for it.
    pub(crate) fn code(self) -> u32 {
        match self {
            Self::Centroid => 0,
            Self::Random => 1,
            Self::Grid => 2,
        }
    }
}

/// How much a cloud can hold. Memory is `32 · surfels + 52 · pieces + 4 · triangles` bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CloudCapacity {
    /// Surfels, 0…2²³ within `Limits::default()` (16 bytes in each of two buffers). Where a recording asks for more,
    /// an even selection of them stays, enlarged to keep the area, and [`SurfelCounts::overflow`] tells. 0 where only
    /// pieces are of use, as to a [`BouncedZBuffer`](crate::BouncedZBuffer) for ambient occlusion; pieces are then whole
    /// triangles, but for those that are more than 16 times as large as they are near.
    pub surfels: u32,
    /// Triangles after large ones were split, 1…2²³, of which `Limits::default()` leaves 2 796 202: they are 48 bytes each in
    /// one binding, and 2²³ need a `max_storage_buffer_binding_size` of 402 653 184 bytes. One a triangle that is larger than
    /// a surfel, plus a few hundred for each that spans the view where there are surfels, is ample. Where a recording asks for
    /// more, large triangles are split less until it fits ([`SurfelCounts::merged`]): with room for as many pieces as
    /// triangles nothing is lost. With less an even selection stays, and what is lost is a hole to rays
    /// ([`SurfelCounts::lost_area_share`]).
    pub pieces: u32,
    /// Triangles of all instances of all meshes, 0…2²⁵, of which `Limits::default()` leaves 2²⁵ − 1.
    pub triangles: u32,
}

impl CloudCapacity {
    /// The most of each that a device with these limits can bind.
    pub fn largest(limits: &wgpu::Limits) -> Self {
        let bytes = limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size);
        let most = |most: u32, each: usize| (bytes / each as u64).min(u64::from(most)) as u32;
        Self {
            surfels: most(MOST_SURFELS, size_of::<Surfel>()),
            pieces: most(MOST_PIECES, size_of::<Piece>()),
            // A number for each, and their total.
            triangles: most(MOST_TRIANGLES + 1, size_of::<u32>()).saturating_sub(1),
        }
    }
}

const MOST_SURFELS: u32 = 1 << 23;
const MOST_PIECES: u32 = 1 << 23;
const MOST_TRIANGLES: u32 = 1 << 25;

/// A surfel's disk: `surfels` of the cloud, 16 bytes each.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Surfel {
    /// Centre, in the cloud's space: world axes, origin at the [focus](crate::Camera::focus) of the camera that it was
    /// recorded for.
    pub position: [f32; 3],
    /// Radius, world units.
    pub radius: f32,
}

/// What a surfel belongs to: `sources` of the cloud, 16 bytes each.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SurfelSource {
    /// Geometric normal, octahedral, two snorm16.
    pub normal: u32,
    /// Index of its piece.
    pub piece: u32,
    /// Its leaf in the piece's bisection tree: the last `order` bits are the sides taken, first split first.
    pub leaf: u32,
    /// Index into the caller's material table.
    pub material: u32,
}

crate::reflection::same_as_wgsl!(
    sources_are_the_shaders: SurfelSource as "SurfelSource" in [
        "surfelizer", "shell_splatter build", "shell_splatter splat",
    ]
    { normal, piece, leaf, material }
);

/// What a surfel sends: 32 bytes each, one per surfel of a cloud. The [`SurfelShader`](crate::SurfelShader) fills a buffer
/// of them; so may a caller that knows its surfaces' light from elsewhere.
///
/// A Lambertian surface sends the same into all directions of a side. Its radiosity, W/m², is π times this.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SurfelRadiance {
    /// Radiance of the front side, the one that the normal points to: linear RGB, W/(m² sr), 0…1e18.
    pub front: [f32; 3],
    /// 0.
    pub padding0: f32,
    /// Radiance of the back side.
    pub back: [f32; 3],
    /// 0.
    pub padding1: f32,
}

crate::reflection::same_as_wgsl!(
    radiance_is_the_shaders: SurfelRadiance as "SurfelRadiance" in [
        "surfel_shader shadow map samples",
    ]
    { front, back }
);

/// A triangle after pre-splitting: `pieces` of the cloud, 48 bytes each. Its surfels are the leaves of its
/// longest-edge bisection. A small triangle that stands for others, since
/// [`SurfelizerSettings::density`](crate::SurfelizerSettings::density) thinned them, is replaced by an equilateral one
/// of the area that it stands for.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Piece {
    /// First corner, in the cloud's space.
    pub a: [f32; 3],
    /// Index into the caller's material table.
    pub material: u32,
    /// Second corner.
    pub b: [f32; 3],
    /// Bits 0…11: how often the piece is bisected (or the level of the 2014 grid); bit 12: smaller than a surfel;
    /// bits 13…31: a hash that tells the pieces of one triangle apart.
    pub shape: u32,
    /// Third corner.
    pub c: [f32; 3],
    /// Its triangle, counted over all instances of all meshes.
    pub triangle: u32,
}

crate::reflection::same_as_wgsl!(
    pieces_are_the_shaders: Piece as "Piece" in ["surfelizer"]
    { a, material, b, shape, c, triangle }
);

/// What a recording found, as it stands in [`SurfelCloud::counters`] once the GPU has run it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SurfelCounts {
    /// Pieces that the triangles were split into, with [`SurfelCounts::merged`] those that the settings asked for. Saturates
    /// at `u32::MAX`.
    pub pieces: u32,
    /// Surfels that the settings asked for, given the pieces that found room. Where that were 2³¹ or more, all pieces are
    /// divided into fewer, larger ones until it is not.
    pub surfels: u32,
    /// Triangles left out: degenerate, not finite, or with an index out of range.
    pub rejected: u32,
    /// Surfels in the cloud.
    pub stored: u32,
    /// How many pieces fewer there are than the settings asked for, since large triangles were cut less, or not at all,
    /// until what they give found room. Saturates at `u32::MAX`.
    pub merged: u32,
    /// Share of the pieces' area that found no room, in units of 2⁻³² and rounded up:
    /// [`SurfelCounts::lost_area_share`].
    pub lost_area: u32,
}

crate::reflection::same_as_wgsl!(
    counts_are_the_shaders: SurfelCounts as "Counters" in [
        "surfelizer", "shell_splatter build", "shell_splatter splat",
    ]
    { pieces, surfels, rejected, stored, merged, lost_area }
);

impl SurfelCounts {
    /// Surfels that found no room.
    pub fn overflow(&self) -> u32 {
        self.surfels - self.stored
    }

    /// Share of the area, 0…1, of the pieces that found no room: of all that the Surfelizer made pieces of, in world units
    /// squared. 0 exactly where all found room. Rays pass through what is lost; surfels make up for it on average.
    pub fn lost_area_share(&self) -> f64 {
        f64::from(self.lost_area) / 4_294_967_296.0
    }

    /// Pieces that found no room in a cloud of this capacity; their surfels are not in [`SurfelCounts::surfels`].
    pub fn piece_overflow(&self, capacity: CloudCapacity) -> u32 {
        self.pieces.saturating_sub(capacity.pieces)
    }
}

/// Surfels of one scene for one point of view, on the GPU. Any number of views near that point can splat it.
#[derive(Debug)]
pub struct SurfelCloud {
    pub(crate) capacity: CloudCapacity,
    pub(crate) recordings: Recordings,
    pub(crate) origin: DVec3,
    /// Whether its surfels were made to fit the holes of their triangles since it was last recorded.
    pub(crate) fits_holes: bool,
    /// How its surfels were last placed.
    pub(crate) placement: Placement,
    /// Whether the camera last recorded for has a perspective: surfels then grow with their distance from it.
    pub(crate) perspective: bool,
    pub(crate) surfels: Buffer,
    pub(crate) sources: Buffer,
    pub(crate) pieces: Buffer,
    pub(crate) counters: Buffer,
    /// Sums over all triangles while it is made: `TALLY_WORDS` of `wgsl/surfelizer.wgsl`.
    pub(crate) tally: Buffer,
    /// The indirect dispatch that writes the surfels.
    pub(crate) emission: Buffer,
    pub(crate) triangle_offsets: ScanBuffer,
    pub(crate) piece_offsets: ScanBuffer,
    /// Of the recording that makes it: with the buffers of its meshes.
    pub(crate) kept: Kept,
}

impl SurfelCloud {
    pub(crate) fn new(
        device: &Device,
        scan: &Scan,
        capacity: CloudCapacity,
    ) -> Result<Self, Error> {
        check_setting(
            capacity.surfels <= MOST_SURFELS,
            "CloudCapacity::surfels",
            capacity.surfels,
            "0 to 2^23",
        )?;
        check_setting(
            (1..=MOST_PIECES).contains(&capacity.pieces),
            "CloudCapacity::pieces",
            capacity.pieces,
            "1 to 2^23",
        )?;
        check_setting(
            capacity.triangles <= MOST_TRIANGLES,
            "CloudCapacity::triangles",
            capacity.triangles,
            "0 to 2^25",
        )?;
        let read = BufferUsages::COPY_SRC;
        let bytes = |count: u32, size: usize| u64::from(count) * size as u64;
        Ok(Self {
            capacity,
            recordings: Recordings::default(),
            origin: DVec3::ZERO,
            fits_holes: false,
            placement: Placement::default(),
            perspective: true,
            surfels: storage(
                device,
                "deep-screen-space surfels",
                bytes(capacity.surfels, size_of::<Surfel>()),
                read,
            )?,
            sources: storage(
                device,
                "deep-screen-space surfel sources",
                bytes(capacity.surfels, size_of::<SurfelSource>()),
                read,
            )?,
            pieces: storage(
                device,
                "deep-screen-space pieces",
                bytes(capacity.pieces, size_of::<Piece>()),
                read,
            )?,
            counters: storage(
                device,
                "deep-screen-space surfel counters",
                size_of::<SurfelCounts>() as u64,
                read | BufferUsages::COPY_DST,
            )?,
            tally: storage(
                device,
                "deep-screen-space surfel sums",
                48,
                BufferUsages::COPY_DST,
            )?,
            emission: storage(
                device,
                "deep-screen-space surfel dispatch",
                12,
                BufferUsages::INDIRECT,
            )?,
            triangle_offsets: scan.buffer(
                device,
                "deep-screen-space piece offsets of triangles",
                capacity.triangles,
            )?,
            piece_offsets: scan.buffer(
                device,
                "deep-screen-space surfel offsets of pieces",
                capacity.pieces,
            )?,
            kept: Kept::default(),
        })
    }

    /// Its last recording, for what is recorded from it.
    pub(crate) fn last(&self) -> Result<Stamp, Error> {
        self.recordings.last("SurfelCloud")
    }

    /// [`Error::Recording`] for `name` where it was not recorded from this, since this was.
    pub(crate) fn check_source(&self, name: &'static str, stamp: &Stamp) -> Result<(), Error> {
        stamp.check(name, "SurfelCloud", &self.recordings)
    }

    /// What it can hold.
    pub fn capacity(&self) -> CloudCapacity {
        self.capacity
    }

    /// The point, in world space, that positions are relative to: the [focus](crate::Camera::focus) of the camera last
    /// recorded.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// A buffer of one [`SurfelCounts`] (usages `STORAGE | COPY_SRC`), for the caller to copy and read when it likes.
    pub fn counters(&self) -> &Buffer {
        &self.counters
    }

    /// A buffer of [`Surfel`]s, of which [`SurfelCounts::stored`] hold (usages `STORAGE | COPY_SRC`).
    pub fn surfels(&self) -> &Buffer {
        &self.surfels
    }

    /// A buffer of [`SurfelSource`]s, one per surfel (usages `STORAGE | COPY_SRC`).
    pub fn sources(&self) -> &Buffer {
        &self.sources
    }

    /// A buffer of [`Piece`]s (usages `STORAGE | COPY_SRC`).
    pub fn pieces(&self) -> &Buffer {
        &self.pieces
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        [
            &self.surfels,
            &self.sources,
            &self.pieces,
            &self.counters,
            &self.tally,
            &self.emission,
        ]
        .iter()
        .map(|b| b.size())
        .sum::<u64>()
            + self.triangle_offsets.bytes()
            + self.piece_offsets.bytes()
    }
}

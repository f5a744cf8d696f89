//! One view's hits.

use wgpu::{Buffer, TextureFormat, TextureView};

use super::{descriptor::BouncedDescriptor, settings::BouncedSettings};
use crate::{
    gpu::binding::Kept,
    receivers::{Place, plane_bytes},
    recorded::{Last, Stamp},
};

/// Hits of all pixels and directions.
#[derive(Debug)]
pub(crate) enum Hits {
    /// `rays_per_pixel / 32` words of bits per pixel, rows from the top.
    Bits(Buffer),
    /// A packed colour, one layer per direction.
    Colors(TextureView),
}

/// One view's hits.
#[derive(Debug)]
pub struct BouncedView {
    pub(super) size: [u32; 2],
    pub(crate) hits: Hits,
    pub(crate) nearness: Buffer,
    pub(crate) descriptor: BouncedDescriptor,
    pub(super) rays_per_pixel: u32,
    pub(super) statistics: Option<Buffer>,
    pub(crate) counts: Option<Buffer>,
    pub(crate) recorded: Last<Traced>,
    /// Of recordings, and of those of further rays.
    pub(super) kept: [Kept; 2],
}

/// What a view's hits are of.
#[derive(Clone, Debug)]
pub(crate) struct Traced {
    pub settings: BouncedSettings,
    /// The frame's.
    pub place: Place,
    /// The recording of the cloud, or of the hierarchy of two levels.
    pub of: Stamp,
    /// Whether only listed pixels have rays.
    pub listed: bool,
    /// Whether further rays followed.
    pub more: bool,
}

impl BouncedView {
    /// Width and height in pixels: that of the cameras' viewports.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// How many directions it has room for.
    pub fn rays_per_pixel(&self) -> u32 {
        self.rays_per_pixel
    }

    /// With [`Payload::Occlusion`](crate::Payload::Occlusion) the hits: for each pixel, rows from the top, as many words as the
    /// recording's directions fill, 32 each; bit i of them is set where direction i was blocked (usages `STORAGE | COPY_SRC`).
    pub fn blocked(&self) -> Option<&Buffer> {
        match &self.hits {
            Hits::Bits(buffer) => Some(buffer),
            Hits::Colors(_) => None,
        }
    }

    /// With [`Payload::Radiance`](crate::Payload::Radiance) the hits: an `R32Uint` array texture with one layer per direction, of
    /// what arrives along it: 8 bits each of red, green and blue times 2^(e − 136), e being the highest 8 bits; 0 where nothing
    /// does (usages `TEXTURE_BINDING | COPY_SRC`). Layers of rays towards emitters follow the recording's directions: of diffuse
    /// receivers one a ray, of what it brings as the pixel's own rays do, and of glossy ones two, of what the lobe makes of that,
    /// in units of the reflectance straight on and besides.
    pub fn radiance(&self) -> Option<&TextureView> {
        match &self.hits {
            Hits::Bits(_) => None,
            Hits::Colors(view) => Some(view),
        }
    }

    /// How near each pixel's hits are, rows from the top: a `u32` of the sum over its directions of the side of a pixel at
    /// the pixel's distance over the distance of the hit, each 1 at most and 0 for none, times 2²⁴ (usages `STORAGE |
    /// COPY_SRC`). With [`Payload::Occlusion`](crate::Payload::Occlusion) a hit need not be the nearest along its direction.
    pub fn nearness(&self) -> &Buffer {
        &self.nearness
    }

    /// What the last recording counted, where the descriptor asked for it: six `u32`, namely rays, nodes that they visited,
    /// senders that they were tested against, and rays that hit, towards emitters those that met theirs; then the steps, each a
    /// node or a sender, of the slowest of 32 neighbouring pixels' rays, summed over groups of such rays, and how many groups
    /// there were (usage `COPY_SRC`).
    pub fn statistics(&self) -> Option<&Buffer> {
        self.statistics.as_ref()
    }

    /// How many rays each pixel had, where the descriptor has them counted, rows from the top. With
    /// [`Payload::Occlusion`](crate::Payload::Occlusion) two `u32`: how many rays of further sets were blocked, and how many rays
    /// there were of all sets. With radiance three `f32`, the sum of what came along rays of further sets, and a `u32`, how many
    /// rays there were; the sum has what came from emitters too, the number not the rays towards them. Of glossy receivers the
    /// sum is of what counts as much as the reflectance straight on, and three `f32` and a word that is 0 follow, the sum of what
    /// is mirrored besides (usages `STORAGE | COPY_SRC`).
    pub fn counts(&self) -> Option<&Buffer> {
        self.counts.as_ref()
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let hits = match &self.hits {
            Hits::Bits(buffer) => buffer.size(),
            Hits::Colors(_) => plane_bytes(
                TextureFormat::R32Uint,
                self.size(),
                self.rays_per_pixel.max(1) + self.descriptor.emitter_layers(),
            ),
        };
        let besides = [&self.statistics, &self.counts];
        let besides = besides.into_iter().flatten().map(Buffer::size);
        hits + self.nearness.size() + besides.sum::<u64>()
    }
}

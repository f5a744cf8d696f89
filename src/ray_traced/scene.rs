//! What rays meet, shared by all views.

use wgpu::{Buffer, CommandEncoder, Device};

use super::counts::Readback;
use crate::{
    bounced_z_buffer::descriptor::HitLighting,
    bvh::{Bvh, BvhBuilder, Primitives},
    camera::Camera,
    error::{Error, check_setting},
    geometry::Geometry,
    gpu::Timestamps,
    gpu::compiler::Compiler,
    light::Light,
    surfel::{CloudCapacity, SurfelCloud, SurfelCounts},
    surfelizer::{
        Surfelizer, SurfelizerInput,
        settings::{Reach, SurfelizerSettings},
    },
};

/// The triangles that rays meet, the hierarchy over them, and the lights: what all [`RayTracedView`](crate::RayTracedView)s of a
/// scene share. Recorded once per frame, before they are.
///
/// Its room follows from the geometry. It grows where a recording has more triangles than there is room for, and, a frame or two
/// later, where the GPU counted parts of large ones that found none. Nothing is allocated before the first recording.
#[derive(Debug)]
pub struct RayTracedScene {
    surfelizer: Surfelizer,
    builder: BvhBuilder,
    room: Option<Room>,
    readback: Readback,
    counts: Option<SurfelCounts>,
    materials: Option<Buffer>,
    lights: Vec<Light>,
}

#[derive(Debug)]
struct Room {
    cloud: SurfelCloud,
    bvh: Bvh,
}

/// What one recording of a [`RayTracedScene`] works on.
#[derive(Clone, Copy, Debug)]
pub struct RayTracedSceneInput<'a> {
    /// The caller's triangles.
    pub geometry: Geometry<'a>,
    /// The camera whose [focus](Camera::focus) positions become relative to: one of those that see the scene.
    pub camera: &'a Camera,
    /// Up to four cameras that see the scene: triangles beyond `reach` of what these see are left out. Empty to keep all.
    pub cull_by: &'a [Camera],
    /// How far effects look from what is seen, world units: the largest radius of the views' ambient occlusion, and
    /// `f32::INFINITY` for indirect light.
    pub reach: f32,
    /// What lights the surfaces that rays meet, for views of indirect light.
    pub lighting: Option<HitLighting<'a>>,
    /// Where to write begin and end times of making the triangles, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> RayTracedSceneInput<'a> {
    /// All triangles, however far, without lights and timestamps.
    pub fn new(geometry: Geometry<'a>, camera: &'a Camera) -> Self {
        Self {
            geometry,
            camera,
            cull_by: &[],
            reach: f32::INFINITY,
            lighting: None,
            timestamps: None,
        }
    }
}

impl RayTracedScene {
    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device was made with less than that.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        Self::with_primitives(compiler, Primitives::default())
    }

    /// The same for views that are made for other primitives than [`Primitives::Triangles`], which `Primitives::RayQuery` alone
    /// are: there are no surfels.
    ///
    /// # Errors
    /// [`Error::Setting`] for [`Primitives::Disks`], [`Error::Feature`] and [`Error::Limit`] for what the device was not made
    /// with.
    pub fn with_primitives<'a>(
        compiler: impl Into<Compiler<'a>>,
        primitives: Primitives,
    ) -> Result<Self, Error> {
        let compiler = compiler.into();
        check_setting(
            !primitives.are_disks(),
            "RayTracedScene::with_primitives",
            f64::from(u8::from(primitives.are_disks())),
            "primitives that are triangles",
        )?;
        Ok(Self {
            surfelizer: Surfelizer::new(compiler)?,
            builder: BvhBuilder::new(compiler, primitives)?,
            room: None,
            readback: Readback::default(),
            counts: None,
            materials: None,
            lights: Vec::new(),
        })
    }

    /// Records the scene of a frame.
    ///
    /// # Errors
    /// What [`Surfelizer::record`] finds of the geometry and the cameras, and [`Light::validate`] of lights; [`Error::Setting`]
    /// for the reach; [`Error::Limit`] for more triangles than the device can bind. What was recorded before stays, unless
    /// the room had to grow: then views refuse the scene until it is recorded.
    pub fn record(
        &mut self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &RayTracedSceneInput<'_>,
    ) -> Result<(), Error> {
        check_setting(
            input.reach >= 0.0,
            "RayTracedSceneInput::reach",
            input.reach,
            "0 to infinity",
        )?;
        for light in input.lighting.iter().flat_map(|lighting| lighting.lights) {
            light.validate()?;
        }
        if let Some(counts) = self.readback.take() {
            self.counts = Some(counts);
        }
        self.make_room(device, input.geometry.triangles())?;
        let Some(Room { cloud, bvh }) = &mut self.room else {
            return Ok(());
        };
        let settings = SurfelizerSettings {
            density: f32::INFINITY,
            reach: Reach {
                radii: f32::INFINITY,
                world: input.reach,
            },
            ..SurfelizerSettings::default()
        };
        let surfelize = SurfelizerInput {
            geometry: input.geometry,
            camera: input.camera,
            cull_by: input.cull_by,
            timestamps: input.timestamps,
        };
        self.surfelizer
            .record(device, encoder, &surfelize, &settings, cloud)?;
        self.builder.record(device, encoder, cloud, bvh, None)?;
        self.readback.record(device, encoder, cloud.counters());
        self.materials = input.lighting.map(|lighting| lighting.materials.clone());
        self.lights.clear();
        self.lights
            .extend(input.lighting.iter().flat_map(|lighting| lighting.lights));
        Ok(())
    }

    /// What the GPU counted a frame or two ago: triangles, those that are degenerate, and the share of the area that found no
    /// room. `None` before the first counts arrived, which takes a submission and a poll of the caller's.
    pub fn counts(&self) -> Option<SurfelCounts> {
        self.counts
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let bytes = |room: &Room| room.cloud.memory_bytes() + room.bvh.memory_bytes();
        self.room.as_ref().map_or(0, bytes)
    }

    /// What views trace.
    pub(super) fn traced(&self) -> Option<(&SurfelCloud, &Bvh)> {
        self.room.as_ref().map(|room| (&room.cloud, &room.bvh))
    }

    /// What lights hits.
    pub(super) fn lighting(&self) -> Option<HitLighting<'_>> {
        self.materials.as_ref().map(|materials| HitLighting {
            materials,
            lights: &self.lights,
        })
    }

    /// Replaces the room where it is too small for so many triangles, or was by the last counts.
    fn make_room(&mut self, device: &Device, triangles: u32) -> Result<(), Error> {
        let most = CloudCapacity::largest(&device.limits());
        let had = self.room.as_ref().map(|room| room.cloud.capacity());
        let asked = self.counts.map_or(0, |counts| {
            // Those that were merged asked for room too.
            counts.pieces.saturating_add(counts.merged)
        });
        let Some(capacity) = grown(had, triangles, asked, most) else {
            return Ok(());
        };
        let cloud = self.surfelizer.create_cloud(device, capacity)?;
        let bvh = self.builder.create(device, &cloud)?;
        self.room = Some(Room { cloud, bvh });
        // Of other room these tell nothing.
        self.counts = None;
        Ok(())
    }
}

/// The room that so many triangles and pieces need, where what there is does not do and the device can bind more. Triangles
/// beyond what it can bind are asked for all the same, and refused.
fn grown(
    had: Option<CloudCapacity>,
    triangles: u32,
    pieces: u32,
    most: CloudCapacity,
) -> Option<CloudCapacity> {
    let (had_triangles, had_pieces) = had.map_or((0, 0), |had| (had.triangles, had.pieces));
    // More than a device can bind is never there: it is merged, and counted.
    let pieces = pieces.min(most.pieces);
    if had.is_some() && triangles <= had_triangles && pieces <= had_pieces {
        return None;
    }
    // A quarter more than is needed, so that a scene which grows does not ask each frame.
    let ample = |needed: u32| needed.saturating_add(needed / 4).max(256);
    Some(CloudCapacity {
        surfels: 0,
        pieces: ample(triangles.max(pieces))
            .min(most.pieces)
            .max(had_pieces),
        triangles: ample(triangles)
            .min(most.triangles)
            .max(triangles)
            .max(had_triangles),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn room_grows_up_to_what_a_device_binds() {
        let most = CloudCapacity {
            surfels: 0,
            pieces: 5000,
            triangles: 9000,
        };
        let first = grown(None, 0, 0, most).expect("some room");
        assert!(first.pieces > 0 && first.triangles > 0);
        assert_eq!(
            grown(Some(first), first.triangles, first.pieces, most),
            None
        );
        let more = grown(Some(first), 1000, 0, most).expect("more");
        assert!(more.triangles > 1000 && more.pieces > 1000);
        let parts = grown(Some(more), 1000, 3000, most).expect("more");
        assert!(parts.pieces >= 3000);
        // What cannot be had is asked for once.
        let all = grown(Some(parts), 1000, u32::MAX, most).expect("more");
        assert_eq!(all.pieces, most.pieces);
        assert_eq!(grown(Some(all), 1000, u32::MAX, most), None);
        assert_eq!(
            grown(Some(all), 9001, 0, most).map(|c| c.triangles),
            Some(9001)
        );
    }
}

//! What rays meet, shared by all views.

use wgpu::{Buffer, CommandEncoder, Device};

use super::counts::Readback;
use crate::{
    bounced_z_buffer::descriptor::{BouncedScene, HitLighting},
    bvh::{Bvh, BvhBuilder, Primitives},
    camera::Camera,
    error::{Error, check_setting},
    geometry::Geometry,
    gpu::Timestamps,
    gpu::compiler::Compiler,
    instanced_bvh::{ChangedMeshes, InstancedBvh, InstancedBvhBuilder, InstancedBvhInput},
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
    levels: Levels,
    materials: Option<Buffer>,
    lights: Vec<Light>,
}

/// How what rays meet is made, and what of it there is.
#[derive(Debug)]
enum Levels {
    One(Box<OneLevel>),
    Two(Box<InstancedBvhBuilder>, Option<Box<InstancedBvh>>),
}

/// A hierarchy over the triangles of all instances.
#[derive(Debug)]
struct OneLevel {
    surfelizer: Surfelizer,
    builder: BvhBuilder,
    room: Option<Room>,
    readback: Readback,
    counts: Option<SurfelCounts>,
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
    /// With [`Primitives::Instances`] the meshes to be built anew: those whose vertices are others. All are where the number of
    /// meshes changes, or one has more triangles than before. Of no use otherwise.
    pub changed: ChangedMeshes<'a>,
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
            changed: ChangedMeshes::None,
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

    /// The same for views that are made for other primitives than [`Primitives::Triangles`]: `Primitives::RayQuery`, or
    /// [`Primitives::Instances`] for the meshes' triangles, of which [`RayTracedSceneInput::changed`] says which are built. With
    /// these nothing is culled.
    ///
    /// # Errors
    /// [`Error::Setting`] for [`Primitives::Disks`], as there are no surfels; [`Error::Feature`] and [`Error::Limit`] for what
    /// the device was not made with.
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
        let levels = if primitives == Primitives::Instances {
            Levels::Two(Box::new(InstancedBvhBuilder::new(compiler)?), None)
        } else {
            Levels::One(Box::new(OneLevel {
                surfelizer: Surfelizer::new(compiler)?,
                builder: BvhBuilder::new(compiler, primitives)?,
                room: None,
                readback: Readback::default(),
                counts: None,
            }))
        };
        Ok(Self {
            levels,
            materials: None,
            lights: Vec::new(),
        })
    }

    /// Records the scene of a frame.
    ///
    /// # Errors
    /// What [`Surfelizer::record`] or [`InstancedBvhBuilder::record`] find of the geometry and the cameras, and
    /// [`Light::validate`] of lights; [`Error::Setting`]
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
        match &mut self.levels {
            Levels::One(level) => level.record(device, encoder, input)?,
            Levels::Two(builder, bvh) => {
                record_instances(builder, device, encoder, input, bvh)?;
            }
        }
        self.materials = input.lighting.map(|lighting| lighting.materials.clone());
        self.lights.clear();
        self.lights
            .extend(input.lighting.iter().flat_map(|lighting| lighting.lights));
        Ok(())
    }

    /// What the GPU counted a frame or two ago: triangles, those that are degenerate, and the share of the area that found no
    /// room. `None` before the first counts arrived, which takes a submission and a poll of the caller's, and with
    /// [`Primitives::Instances`], whose counts are [`RayTracedScene::instances`]'.
    pub fn counts(&self) -> Option<SurfelCounts> {
        match &self.levels {
            Levels::One(level) => level.counts,
            Levels::Two(..) => None,
        }
    }

    /// With [`Primitives::Instances`] the hierarchy, once it was recorded.
    pub fn instances(&self) -> Option<&InstancedBvh> {
        match &self.levels {
            Levels::One(_) => None,
            Levels::Two(_, bvh) => bvh.as_deref(),
        }
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let bytes = |room: &Room| room.cloud.memory_bytes() + room.bvh.memory_bytes();
        match &self.levels {
            Levels::One(level) => level.room.as_ref().map_or(0, bytes),
            Levels::Two(_, bvh) => bvh.as_ref().map_or(0, |bvh| bvh.memory_bytes()),
        }
    }

    /// What views trace.
    pub(super) fn traced(&self) -> Option<BouncedScene<'_>> {
        match &self.levels {
            Levels::One(level) => level.room.as_ref().map(|room| BouncedScene::Cloud {
                cloud: &room.cloud,
                bvh: &room.bvh,
            }),
            Levels::Two(_, bvh) => bvh.as_deref().map(BouncedScene::Instances),
        }
    }

    /// What lights hits.
    pub(super) fn lighting(&self) -> Option<HitLighting<'_>> {
        self.materials.as_ref().map(|materials| HitLighting {
            materials,
            lights: &self.lights,
        })
    }
}

/// Records instances, in new room where there is too little.
fn record_instances(
    builder: &InstancedBvhBuilder,
    device: &Device,
    encoder: &mut CommandEncoder,
    input: &RayTracedSceneInput<'_>,
    room: &mut Option<Box<InstancedBvh>>,
) -> Result<(), Error> {
    let geometry = &input.geometry;
    if !room.as_ref().is_some_and(|bvh| bvh.has_room(geometry)) {
        let instances = geometry.instances();
        // A quarter more than there are, so that a scene which grows does not build all its meshes each frame.
        let ample = instances.saturating_add(instances / 4);
        let made = builder
            .create_for(device, geometry, ample)
            .or_else(|_| builder.create(device, geometry))?;
        *room = Some(Box::new(made));
    }
    let Some(bvh) = room else {
        return Ok(());
    };
    let instanced = InstancedBvhInput {
        changed: input.changed,
        timestamps: input.timestamps,
        ..InstancedBvhInput::new(input.geometry, input.camera)
    };
    builder.record(device, encoder, &instanced, bvh)
}

impl OneLevel {
    fn record(
        &mut self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &RayTracedSceneInput<'_>,
    ) -> Result<(), Error> {
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
        Ok(())
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

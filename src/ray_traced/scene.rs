//! What rays meet, shared by all views.

use wgpu::{Buffer, CommandEncoder, Device};

use super::{
    bounces::{BouncePasses, BounceSettings, Bounces, Lit, SurfelLights},
    counts::Readback,
};
use crate::{
    alpha_test::settings::AlphaTests,
    bounced_z_buffer::{
        descriptor::{BouncedScene, HitLighting},
        settings::MAX_FRAME,
    },
    bvh::{AlphaTestedInput, Bvh, BvhBuilder, Primitives},
    camera::Camera,
    emitters::{Emitters, EmittersBuilder, EmittersInput},
    error::{Error, check_setting},
    geometry::{Geometry, Material},
    gpu::Timestamps,
    gpu::binding,
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
    primitives: Primitives,
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
    /// Where light bounces more than once.
    bounces: Option<BouncePasses>,
    /// Where rays are aimed at what shines.
    emitters: Option<EmittersBuilder>,
    room: Option<Room>,
    /// Over frames, that of the frame before.
    before: Option<Room>,
    readback: Readback,
    counts: Option<SurfelCounts>,
}

#[derive(Debug)]
struct Room {
    cloud: SurfelCloud,
    bvh: Bvh,
    lights: Option<SurfelLights>,
    emitters: Option<Emitters>,
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
    /// With primitives of instances the meshes to be built anew: those whose vertices are others, by skinning, say. All are where
    /// the number of meshes changes, or one has more triangles than before. Of no use otherwise: a hierarchy over all instances
    /// is built of the vertices that the buffers have when the GPU runs the recording, each time.
    pub changed: ChangedMeshes<'a>,
    /// What lights the surfaces that rays meet, for views of indirect light.
    pub lighting: Option<HitLighting<'a>>,
    /// Which triangles have holes, for a scene made for [`Primitives::AlphaTested`] or [`Primitives::AlphaTestedInstances`]: none
    /// of them without.
    pub alpha_tests: Option<AlphaTests<'a>>,
    /// Which set of directions its surfels take, 0…2²⁰, where light bounces more than once. Counted up from frame to frame, where
    /// views join frames, their noise becomes less too; kept at 0 (default) it is the same in each frame.
    pub frame: u32,
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
            alpha_tests: None,
            frame: 0,
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
    /// [`Primitives::Instances`] for the meshes' triangles, of which [`RayTracedSceneInput::changed`] says which are built, with
    /// which nothing is culled; and either with holes in triangles, [`Primitives::AlphaTested`] and
    /// [`Primitives::AlphaTestedInstances`].
    ///
    /// # Errors
    /// [`Error::Setting`] for [`Primitives::Disks`], as there are no surfels; [`Error::Feature`] and [`Error::Limit`] for what
    /// the device was not made with.
    pub fn with_primitives<'a>(
        compiler: impl Into<Compiler<'a>>,
        primitives: Primitives,
    ) -> Result<Self, Error> {
        Self::create(compiler.into(), primitives, None)
    }

    /// The same for light that bounces more than once, for views with
    /// [`RayTracedViewDescriptor::further_bounces`](crate::RayTracedViewDescriptor::further_bounces) and others. Its triangles
    /// get surfels; what [`RayTracedSceneInput::cull_by`] leaves out neither sends nor hides.
    ///
    /// # Errors
    /// As [`RayTracedScene::with_primitives`]; what [`BounceSettings::validate`] finds; and [`Error::Setting`] for primitives of
    /// instances, as there are no surfels.
    pub fn with_bounces<'a>(
        compiler: impl Into<Compiler<'a>>,
        primitives: Primitives,
        bounces: BounceSettings,
    ) -> Result<Self, Error> {
        let instances = primitives.are_instances();
        check_setting(
            !instances,
            "RayTracedScene::with_bounces",
            f64::from(u8::from(instances)),
            "primitives that are a cloud's triangles",
        )?;
        Self::create(compiler.into(), primitives, Some(bounces))
    }

    fn create(
        compiler: Compiler<'_>,
        primitives: Primitives,
        bounces: Option<BounceSettings>,
    ) -> Result<Self, Error> {
        check_setting(
            !primitives.are_disks(),
            "RayTracedScene::with_primitives",
            f64::from(u8::from(primitives.are_disks())),
            "primitives that are triangles",
        )?;
        let levels = if primitives.are_instances() {
            let builder = if primitives.are_alpha_tested() {
                InstancedBvhBuilder::alpha_tested(compiler)
            } else {
                InstancedBvhBuilder::new(compiler)
            };
            Levels::Two(Box::new(builder?), None)
        } else {
            Levels::One(Box::new(OneLevel {
                surfelizer: Surfelizer::new(compiler)?,
                builder: BvhBuilder::new(compiler, primitives)?,
                bounces: bounces
                    .map(|bounces| BouncePasses::new(compiler, primitives, bounces))
                    .transpose()?,
                emitters: None,
                room: None,
                before: None,
                readback: Readback::default(),
                counts: None,
            }))
        };
        Ok(Self {
            levels,
            primitives,
            materials: None,
            lights: Vec::new(),
        })
    }

    /// The same, whose surfaces that shine of themselves are found, for views that aim rays at them
    /// ([`RaySettings::emitter_samples`](crate::RaySettings::emitter_samples)), and for its own surfels that do
    /// ([`SurfelGathererSettings::emitter_samples`](crate::SurfelGathererSettings::emitter_samples)): worth it where materials
    /// emit, and small lamps above all. Needs [`RayTracedSceneInput::lighting`].
    ///
    /// # Errors
    /// [`Error::Setting`] for primitives of instances.
    pub fn with_emitters<'a>(mut self, compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        match &mut self.levels {
            Levels::One(level) => {
                let compiler = compiler.into();
                level.emitters = Some(EmittersBuilder::new(compiler)?);
                if let Some(bounces) = &mut level.bounces {
                    bounces.aim(compiler, self.primitives)?;
                }
                // Its room has none of them.
                level.room = None;
                level.before = None;
                Ok(self)
            }
            Levels::Two(..) => Err(Error::Setting {
                field: "RayTracedScene::with_emitters",
                value: 1.0,
                accepted: "primitives that are a cloud's triangles",
            }),
        }
    }

    /// Records the scene of a frame.
    ///
    /// # Errors
    /// What [`Surfelizer::record`] or [`InstancedBvhBuilder::record`] find of the geometry and the cameras, [`Light::validate`]
    /// of lights and [`AlphaTests::validate`] of holes; [`Error::Buffer`] for a table of materials that cannot be bound;
    /// [`Error::Mismatch`] for holes that the scene was not made for, and for surfels that aim without emitters;
    /// [`Error::Setting`] for the reach and the frame; [`Error::Limit`] for more triangles than the device can
    /// bind. What was recorded before stays, unless the room had to grow: then views refuse the scene until it is recorded.
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
        check_setting(
            input.frame <= MAX_FRAME,
            "RayTracedSceneInput::frame",
            input.frame,
            "0 to 2^20",
        )?;
        for light in input.lighting.iter().flat_map(|lighting| lighting.lights) {
            light.validate()?;
        }
        if input.alpha_tests.is_some() && !self.primitives.are_alpha_tested() {
            return Err(Error::Mismatch {
                name: "RayTracedSceneInput::alpha_tests",
                found: "triangles with holes".into(),
                needed: "Primitives::AlphaTested or AlphaTestedInstances of the scene, or none"
                    .into(),
            });
        }
        if let Some(tests) = &input.alpha_tests {
            tests.validate(device, input.geometry.meshes)?;
        }
        if let Some(lighting) = &input.lighting {
            const MATERIALS: &str = "HitLighting::materials";
            binding::check_table::<Material>(device, MATERIALS, lighting.materials)?;
        }
        match &mut self.levels {
            Levels::One(level) => {
                level.check_emitters()?;
                level.record(device, encoder, input)?;
            }
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
        let bytes = |room: &Room| {
            let lights = room.lights.as_ref().map_or(0, SurfelLights::memory_bytes);
            let emitters = room.emitters.as_ref().map_or(0, Emitters::memory_bytes);
            room.cloud.memory_bytes() + room.bvh.memory_bytes() + lights + emitters
        };
        match &self.levels {
            Levels::One(level) => [&level.room, &level.before]
                .into_iter()
                .flatten()
                .map(bytes)
                .sum(),
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

    /// What hits bring of further bounces.
    pub(super) fn gathered(&self) -> Option<&Buffer> {
        match &self.levels {
            Levels::One(level) => level.room.as_ref()?.lights.as_ref()?.gathered(),
            Levels::Two(..) => None,
        }
    }

    /// What shines of itself.
    pub(super) fn emitters(&self) -> Option<&Emitters> {
        match &self.levels {
            Levels::One(level) => level.room.as_ref()?.emitters.as_ref(),
            Levels::Two(..) => None,
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
        // The old goes before there is a new one.
        *room = None;
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
        alpha_tests: input.alpha_tests,
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
        let over_frames = self.over_frames();
        if over_frames {
            std::mem::swap(&mut self.room, &mut self.before);
        }
        let recorded = self.record_room(device, encoder, input);
        if over_frames && recorded.is_err() {
            // The last frame stays.
            std::mem::swap(&mut self.room, &mut self.before);
        }
        recorded
    }

    /// Surfels aim at emitters that the scene has.
    fn check_emitters(&self) -> Result<(), Error> {
        let aims = self.bounces.as_ref().is_some_and(BouncePasses::aims);
        if aims && self.emitters.is_none() {
            return Err(Error::Mismatch {
                name: "RayTracedScene",
                found: "surfels that aim at emitters, of which the scene has none".into(),
                needed:
                    "RayTracedScene::with_emitters, or 0 of SurfelGathererSettings::emitter_samples"
                        .into(),
            });
        }
        Ok(())
    }

    fn over_frames(&self) -> bool {
        let bounces = self.bounces.as_ref();
        bounces.is_some_and(|passes| passes.settings.bounces == Bounces::OverFrames)
    }

    fn record_room(
        &mut self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &RayTracedSceneInput<'_>,
    ) -> Result<(), Error> {
        self.make_room(device, input)?;
        let Some(Room {
            cloud,
            bvh,
            lights,
            emitters,
        }) = &mut self.room
        else {
            return Ok(());
        };
        let settings = self.bounces.as_ref().map_or(
            SurfelizerSettings {
                density: f32::INFINITY,
                ..SurfelizerSettings::default()
            },
            |passes| passes.settings.surfelizer(),
        );
        let settings = SurfelizerSettings {
            reach: Reach {
                radii: f32::INFINITY,
                world: input.reach,
            },
            ..settings
        };
        let surfelize = SurfelizerInput {
            geometry: input.geometry,
            camera: input.camera,
            cull_by: input.cull_by,
            timestamps: input.timestamps,
        };
        self.surfelizer
            .record(device, encoder, &surfelize, &settings, cloud)?;
        if let Some(lights) = &mut *lights {
            lights.forget();
        }
        match input.alpha_tests {
            Some(tests) => {
                let input = AlphaTestedInput {
                    geometry: input.geometry,
                    tests,
                    cloud,
                    timestamps: None,
                };
                self.builder
                    .record_alpha_tested(device, encoder, &input, bvh)?;
            }
            None => self.builder.record(device, encoder, cloud, bvh, None)?,
        }
        self.readback.record(device, encoder, cloud.counters());
        if let (Some(builder), Some(emitters), Some(lighting)) =
            (&self.emitters, emitters.as_ref(), &input.lighting)
        {
            let input = EmittersInput::new(cloud, lighting.materials);
            builder.record(device, encoder, &input, emitters)?;
        }
        if let (Some(passes), Some(lights), Some(lighting)) =
            (&self.bounces, lights, &input.lighting)
        {
            let lit = |room: &'_ Room| room.lights.as_ref().is_some_and(|l| l.gathered().is_some());
            let before = self.before.as_ref().filter(|room| lit(room));
            let before = before.and_then(|room| {
                Some(Lit {
                    cloud: &room.cloud,
                    bvh: &room.bvh,
                    emitters: room.emitters.as_ref(),
                    lights: room.lights.as_ref()?,
                })
            });
            let room = (&*cloud, &*bvh, emitters.as_ref(), lights);
            let lit = (lighting, input.frame);
            passes.record(device, encoder, room, before, lit)?;
        }
        Ok(())
    }

    /// Replaces the room where it is too small for the triangles, or was by the last counts.
    fn make_room(&mut self, device: &Device, input: &RayTracedSceneInput<'_>) -> Result<(), Error> {
        let most = CloudCapacity::largest(&device.limits());
        let had = self.room.as_ref().map(|room| room.cloud.capacity());
        let triangles = input.geometry.triangles();
        let asked = CloudCapacity {
            surfels: self.bounces.as_ref().map_or(0, |passes| {
                let guessed = guessed_surfels(&passes.settings, input);
                self.counts
                    .map_or(guessed, |counts| counts.surfels.max(triangles))
            }),
            pieces: self.counts.map_or(0, |counts| {
                // Those that were merged asked for room too.
                counts.pieces.saturating_add(counts.merged)
            }),
            triangles,
        };
        let Some(capacity) = grown(had, asked, most) else {
            return Ok(());
        };
        // The old goes before there is a new one.
        self.room = None;
        let cloud = self.surfelizer.create_cloud(device, capacity)?;
        let bvh = self.builder.create(device, &cloud)?;
        let lights = self.bounces.as_ref();
        let lights = lights
            .map(|passes| passes.create(device, &cloud))
            .transpose()?;
        let emitters = self.emitters.as_ref();
        let emitters = emitters
            .map(|builder| builder.create(device, &cloud))
            .transpose()?;
        self.room = Some(Room {
            cloud,
            bvh,
            lights,
            emitters,
        });
        // Of other room these tell nothing.
        self.counts = None;
        Ok(())
    }
}

/// Surfels of a scene before any were counted: one a triangle, and as many as cover the camera's picture four times.
fn guessed_surfels(settings: &BounceSettings, input: &RayTracedSceneInput<'_>) -> u32 {
    let viewport = input.camera.viewport();
    let pixels = f64::from(viewport.width) * f64::from(viewport.height);
    let each = std::f64::consts::PI * f64::from(settings.radius_pixels).powi(2);
    let seen = 4.0 * pixels / each;
    input.geometry.triangles().saturating_add(seen as u32)
}

/// The room that this takes, where what there is does not do and the device can bind more. Triangles beyond what it can bind are
/// asked for all the same, and refused.
fn grown(
    had: Option<CloudCapacity>,
    asked: CloudCapacity,
    most: CloudCapacity,
) -> Option<CloudCapacity> {
    let none = CloudCapacity {
        surfels: 0,
        pieces: 0,
        triangles: 0,
    };
    let (triangles, before) = (asked.triangles, had.unwrap_or(none));
    // More than a device can bind is never there: it is merged or left out, and counted.
    let pieces = asked.pieces.min(most.pieces);
    let surfels = asked.surfels.min(most.surfels);
    let fits =
        triangles <= before.triangles && pieces <= before.pieces && surfels <= before.surfels;
    if had.is_some() && fits {
        return None;
    }
    // A quarter more than is needed, so that a scene which grows does not ask each frame.
    let ample = |needed: u32| needed.saturating_add(needed / 4).max(256);
    Some(CloudCapacity {
        surfels: if asked.surfels == 0 {
            0
        } else {
            ample(surfels).min(most.surfels).max(before.surfels)
        },
        pieces: ample(triangles.max(pieces))
            .min(most.pieces)
            .max(before.pieces),
        triangles: ample(triangles)
            .min(most.triangles)
            .max(triangles)
            .max(before.triangles),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn room_grows_up_to_what_a_device_binds() {
        let most = CloudCapacity {
            surfels: 700,
            pieces: 5000,
            triangles: 9000,
        };
        let grown = |had, surfels, triangles, pieces| {
            let asked = CloudCapacity {
                surfels,
                pieces,
                triangles,
            };
            grown(had, asked, most)
        };
        let first = grown(None, 0, 0, 0).expect("some room");
        assert!(first.pieces > 0 && first.triangles > 0 && first.surfels == 0);
        assert_eq!(grown(Some(first), 0, first.triangles, first.pieces), None);
        let more = grown(Some(first), 0, 1000, 0).expect("more");
        assert!(more.triangles > 1000 && more.pieces > 1000);
        let parts = grown(Some(more), 0, 1000, 3000).expect("more");
        assert!(parts.pieces >= 3000);
        // What cannot be had is asked for once.
        let all = grown(Some(parts), 0, 1000, u32::MAX).expect("more");
        assert_eq!(all.pieces, most.pieces);
        assert_eq!(grown(Some(all), 0, 1000, u32::MAX), None);
        assert_eq!(
            grown(Some(all), 0, 9001, 0).map(|c| c.triangles),
            Some(9001)
        );
        let surfels = grown(Some(all), 300, 1000, 0).expect("more");
        assert!(surfels.surfels > 300 && surfels.pieces == all.pieces);
        let surfels = grown(Some(surfels), u32::MAX, 1000, 0).expect("more");
        assert_eq!(surfels.surfels, most.surfels);
        assert_eq!(grown(Some(surfels), u32::MAX, 1000, 0), None);
    }
}

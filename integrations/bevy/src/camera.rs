//! Which cameras have the effect, and how Bevy's materials come to read it: in the place of Bevy's own occlusion.
//!
//! Materials read occlusion where a camera has [`ScreenSpaceAmbientOcclusionResources`], whose texture is public, and were
//! compiled for it where a camera had [`ScreenSpaceAmbientOcclusion`] when Bevy looked for what pipelines are to be compiled
//! for. The resources' other textures are private, so only Bevy can make them: it does so for a camera of 16 × 16 pixels that
//! draws nothing, and the resources are then the real camera's. Of the real one's own occlusion Bevy makes nothing, since the
//! component is gone when it would.

use bevy::{
    camera::{Camera, Camera3d, CameraOutputMode, ClearColorConfig, MsaaWriteback},
    core_pipeline::{
        Core3d,
        prepass::{DepthPrepass, NormalPrepass},
    },
    ecs::{
        component::Component,
        entity::Entity,
        query::{Has, With, Without},
        schedule::ScheduleLabel,
        system::{Commands, Query, Res, ResMut},
        world::World,
    },
    math::UVec2,
    pbr::{ScreenSpaceAmbientOcclusion, ScreenSpaceAmbientOcclusionResources},
    render::{
        Extract, RenderApp, camera::ExtractedCamera, renderer::RenderDevice,
        sync_component::SyncComponent, sync_world::RenderEntity, view::Msaa,
    },
};

use crate::{
    error::Error, geometry::Occluders, settings::RayTracedAmbientOcclusion,
    status::RayTracingStatus, view::Occlusion,
};

/// What Bevy's own occlusion asks for, below which its plugin does nothing.
const STORAGE_TEXTURES: u32 = 5;

impl SyncComponent<RenderApp> for RayTracedAmbientOcclusion {
    type Target = OfCamera;
}

/// All that a camera has of the effect where it is drawn.
type OfCamera = (
    RayTracedAmbientOcclusion,
    Occlusion,
    ScreenSpaceAmbientOcclusion,
    ScreenSpaceAmbientOcclusionResources,
);

/// Takes up the cameras that have the effect.
pub fn extract_cameras(
    mut commands: Commands,
    mut occluders: ResMut<Occluders>,
    mut passes: Query<&mut Occlusion>,
    device: Res<RenderDevice>,
    status: Res<RayTracingStatus>,
    cameras: Extract<
        Query<
            (
                Entity,
                RenderEntity,
                &Camera,
                &RayTracedAmbientOcclusion,
                &Msaa,
                Has<ScreenSpaceAmbientOcclusion>,
                Has<DepthPrepass>,
                Has<NormalPrepass>,
            ),
            With<Camera3d>,
        >,
    >,
    read: Query<(), With<ScreenSpaceAmbientOcclusionResources>>,
) {
    occluders.clear();
    status.retain(|camera| cameras.contains(camera));
    for (entity, rendered, camera, settings, msaa, screen_space, depth, normal) in &cameras {
        let mut rendered_camera = commands.entity(rendered);
        if !camera.is_active {
            // Passes and textures are there for when it is active again.
            rendered_camera.remove::<(RayTracedAmbientOcclusion, ScreenSpaceAmbientOcclusion)>();
            if let Ok(mut passes) = passes.get_mut(rendered) {
                passes.forget_frames();
            }
            continue;
        }
        let storage_textures = device.limits().max_storage_textures_per_shader_stage;
        let refused = if *msaa != Msaa::Off {
            Some(Error::Msaa {
                samples: msaa.samples(),
            })
        } else if screen_space {
            Some(Error::ScreenSpace)
        } else if storage_textures < STORAGE_TEXTURES {
            Some(Error::Materials { storage_textures })
        } else if !depth {
            Some(Error::Prepass("DepthPrepass"))
        } else if !normal {
            Some(Error::Prepass("NormalPrepass"))
        } else {
            None
        };
        if let Some(error) = refused {
            if screen_space {
                // The rest is Bevy's own.
                rendered_camera.remove::<(RayTracedAmbientOcclusion, Occlusion)>();
            } else {
                rendered_camera.remove::<OfCamera>();
            }
            status.set(entity, Err(error));
            continue;
        }
        occluders.add_camera(entity);
        rendered_camera.insert(*settings);
        if read.contains(rendered) {
            rendered_camera.insert(ScreenSpaceAmbientOcclusion::default());
        }
    }
}

/// Once Bevy knows what to compile for: keeps it from making occlusion of its own.
pub fn keep_bevy_from_it(
    mut commands: Commands,
    cameras: Query<
        Entity,
        (
            With<RayTracedAmbientOcclusion>,
            With<ScreenSpaceAmbientOcclusion>,
        ),
    >,
) {
    for camera in cameras {
        commands
            .entity(camera)
            .remove::<ScreenSpaceAmbientOcclusion>();
    }
}

/// A camera that draws nothing, for whose resources another waits.
#[derive(Component)]
pub struct StandIn(Entity);

/// Has Bevy make what a new camera needs for materials to read its occlusion.
pub fn ask_for_resources(
    mut commands: Commands,
    cameras: Query<
        Entity,
        (
            With<RayTracedAmbientOcclusion>,
            Without<ScreenSpaceAmbientOcclusionResources>,
        ),
    >,
) {
    for camera in cameras {
        // Of the least size that has Bevy's five mip levels.
        let size = UVec2::splat(16);
        commands.spawn((
            StandIn(camera),
            ScreenSpaceAmbientOcclusion::default(),
            ExtractedCamera {
                target: None,
                physical_viewport_size: Some(size),
                physical_target_size: Some(size),
                viewport: None,
                schedule: Core3d.intern(),
                order: 0,
                output_mode: CameraOutputMode::Skip,
                msaa_writeback: MsaaWriteback::default(),
                clear_color: ClearColorConfig::None,
                sorted_camera_index_for_target: 0,
                exposure: 1.0,
                hdr: false,
            },
        ));
    }
}

/// Hands the resources over after the frame, for the next.
pub fn take_resources(world: &mut World) {
    let mut stand_ins = world.query::<(Entity, &StandIn)>();
    let stand_ins: Vec<_> = stand_ins
        .iter(world)
        .map(|(entity, of)| (entity, of.0))
        .collect();
    for (stand_in, camera) in stand_ins {
        let resources = world
            .entity_mut(stand_in)
            .take::<ScreenSpaceAmbientOcclusionResources>();
        world.despawn(stand_in);
        if let (Some(resources), Ok(mut camera)) = (resources, world.get_entity_mut(camera)) {
            camera.insert(resources);
        }
    }
}

/// Has materials read the occlusion of this frame.
pub fn show_occlusion(cameras: Query<(&Occlusion, &mut ScreenSpaceAmbientOcclusionResources)>) {
    for (occlusion, mut resources) in cameras {
        resources.screen_space_ambient_occlusion_texture = occlusion.read.clone();
    }
}

/// Forgets what was made with a device that is lost.
pub fn forget_device(mut commands: Commands, cameras: Query<Entity, With<Occlusion>>) {
    for camera in cameras {
        commands.entity(camera).remove::<OfCamera>();
    }
}

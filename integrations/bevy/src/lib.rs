//! Ray-traced ambient occlusion for Bevy's cameras, by [`deep_screen_space`].
//!
//! ```no_run
//! use bevy::prelude::*;
//! use deep_screen_space_bevy::{DeepScreenSpacePlugin, RayTracedAmbientOcclusion, RayTracingStatus};
//!
//! fn main() {
//!     App::new()
//!         .add_plugins((DefaultPlugins, DeepScreenSpacePlugin))
//!         .add_systems(Startup, set_up)
//!         .add_systems(Update, tell)
//!         .run();
//! }
//!
//! fn set_up(mut commands: Commands) {
//!     commands.spawn((Camera3d::default(), Msaa::Off, RayTracedAmbientOcclusion::default()));
//! }
//!
//! fn tell(status: Res<RayTracingStatus>, cameras: Query<Entity, With<RayTracedAmbientOcclusion>>) {
//!     for camera in &cameras {
//!         if let Some(Err(error)) = status.of(camera) {
//!             warn_once!("drawn without it: {error}");
//!         }
//!     }
//! }
//! ```
//!
//! What takes part: visible entities with a `Mesh3d` of triangles and a material, on screen or off it, unless they have
//! `NotShadowCaster`. The material is a `StandardMaterial`, or one of a type that an [`OccludingMaterialPlugin`] was added for.
//! It is loaded, in Bevy's prepass, of the alpha mode `Opaque`, `Mask` or `AlphaToCoverage`, and transmits nothing. What a mask
//! or a material's shader cuts out is opaque to rays, and vertices that a shader moves are where the mesh has them. Skinned and
//! morphed meshes are darkened and darken nothing, since Bevy deforms them where they are drawn, and so are materials of other
//! types.

mod camera;
mod error;
mod geometry;
mod scene;
mod settings;
mod status;
mod view;

use std::marker::PhantomData;

use bevy::{
    app::{App, Plugin},
    core_pipeline::{Core3d, Core3dSystems},
    ecs::schedule::{IntoScheduleConfigs, common_conditions::any_with_component},
    pbr::{Material, StandardMaterial, check_views_need_specialization},
    render::{
        ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderStartup, RenderSystems,
        mesh::allocator::MeshAllocatorSettings,
        renderer::{RenderGraph, RenderGraphSystems},
        sync_component::SyncComponentPlugin,
    },
};
pub use deep_screen_space;
pub use error::Error;
pub use settings::RayTracedAmbientOcclusion;
pub use status::RayTracingStatus;
use wgpu::BufferUsages;

/// Draws [`RayTracedAmbientOcclusion`] for the cameras that have it, and tells of them by [`RayTracingStatus`].
///
/// It has Bevy make its meshes' buffers with the usage `STORAGE`, and needs `PbrPlugin`, of `DefaultPlugins`.
pub struct DeepScreenSpacePlugin;

impl Plugin for DeepScreenSpacePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<RayTracingStatus>().add_plugins((
            SyncComponentPlugin::<RayTracedAmbientOcclusion>::default(),
            OccludingMaterialPlugin::<StandardMaterial>::default(),
        ));
    }

    // In `build` what renders may not be there yet.
    fn finish(&self, app: &mut App) {
        let status = app.world().resource::<RayTracingStatus>().clone();
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else {
            return;
        };
        // Read when Bevy makes its first buffer, which is after all plugins are there.
        render_app.init_resource::<MeshAllocatorSettings>();
        let mut settings = render_app
            .world_mut()
            .resource_mut::<MeshAllocatorSettings>();
        settings.extra_buffer_usages |= BufferUsages::STORAGE;
        render_app
            .insert_resource(status)
            .init_gpu_resource::<geometry::Triangles>()
            .init_gpu_resource::<scene::Scene>()
            .add_systems(RenderStartup, camera::forget_device)
            .init_resource::<geometry::Occluders>()
            .add_systems(ExtractSchedule, camera::extract_cameras)
            .add_systems(
                Render,
                (
                    camera::keep_bevy_from_it
                        .in_set(RenderSystems::PrepareMeshes)
                        .after(check_views_need_specialization),
                    camera::ask_for_resources
                        .in_set(RenderSystems::Prepare)
                        .before(RenderSystems::PrepareResources),
                    (geometry::update_triangles, view::prepare_occlusion)
                        .in_set(RenderSystems::PrepareResources),
                    camera::show_occlusion.in_set(RenderSystems::PrepareResourcesFlush),
                    camera::take_resources
                        .in_set(RenderSystems::Cleanup)
                        .run_if(any_with_component::<camera::StandIn>),
                ),
            )
            .add_systems(
                RenderGraph,
                scene::record_scene.in_set(RenderGraphSystems::Begin),
            )
            .add_systems(
                Core3d,
                view::record_occlusion
                    .after(Core3dSystems::Prepass)
                    .before(Core3dSystems::MainPass),
            );
    }
}

/// Has meshes of a further type of material occlude, beside those of Bevy's `StandardMaterial`: as that type's alpha mode and
/// transmission say, and where the mesh has its vertices, whatever shaders do with them. Added beside [`DeepScreenSpacePlugin`].
pub struct OccludingMaterialPlugin<M>(PhantomData<M>);

impl<M> Default for OccludingMaterialPlugin<M> {
    fn default() -> Self {
        Self(PhantomData)
    }
}

impl<M: Material> Plugin for OccludingMaterialPlugin<M> {
    fn build(&self, _: &mut App) {}

    fn finish(&self, app: &mut App) {
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app
                .init_resource::<geometry::Occluders>()
                .add_systems(
                    ExtractSchedule,
                    geometry::extract_occluders::<M>.after(camera::extract_cameras),
                );
        }
    }
}

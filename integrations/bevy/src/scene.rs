//! What rays meet in a frame, shared by all cameras.

use bevy::{
    asset::AssetId,
    ecs::{
        query::With,
        resource::Resource,
        system::{Query, Res, ResMut},
    },
    mesh::Mesh,
    render::{
        mesh::{RenderMesh, allocator::MeshAllocator},
        render_asset::RenderAssets,
        renderer::RenderContext,
    },
};
use deep_screen_space::{
    Camera, ChangedMeshes, Geometry, Primitives, RayTracedScene, RayTracedSceneInput,
};
use wgpu::{CommandEncoder, Device};

use crate::{
    error::Error,
    geometry::Triangles,
    settings::RayTracedAmbientOcclusion,
    view::{Occlusion, Seen},
};

/// Meshes stay as they are built, and only their transforms are taken up each frame.
pub const PRIMITIVES: Primitives = Primitives::Instances;

/// What rays meet, while there is a camera that asked for it.
#[derive(Resource)]
pub struct Scene {
    rays: Option<RayTracedScene>,
    /// What became of the last recording.
    recorded: Result<(), Error>,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            rays: None,
            recorded: Ok(()),
        }
    }
}

impl Scene {
    /// The scene of this frame, or why there is none.
    pub fn recorded(&self) -> Result<Option<&RayTracedScene>, Error> {
        self.recorded.clone().map(|()| self.rays.as_ref())
    }

    fn record(
        &mut self,
        (device, encoder): (&Device, &mut CommandEncoder),
        triangles: &Triangles,
        (assets, allocator): (&RenderAssets<RenderMesh>, &MeshAllocator),
        camera: &Camera,
    ) -> Result<Vec<AssetId<Mesh>>, Error> {
        let (assets, meshes) = triangles.meshes(assets, allocator)?;
        let rays = match &mut self.rays {
            Some(rays) => rays,
            none => none.insert(RayTracedScene::with_primitives(device, PRIMITIVES)?),
        };
        let changed = triangles.changed(&assets);
        let input = RayTracedSceneInput {
            changed: changed
                .as_deref()
                .map_or(ChangedMeshes::All, ChangedMeshes::Some),
            ..RayTracedSceneInput::new(Geometry { meshes: &meshes }, camera)
        };
        rays.record(device, encoder, &input)?;
        Ok(assets)
    }
}

/// Records the scene, before any camera draws.
pub fn record_scene(
    mut scene: ResMut<Scene>,
    mut triangles: ResMut<Triangles>,
    assets: Res<RenderAssets<RenderMesh>>,
    allocator: Res<MeshAllocator>,
    cameras: Query<Seen, (With<Occlusion>, With<RayTracedAmbientOcclusion>)>,
    passes: Query<(), With<Occlusion>>,
    mut context: RenderContext,
) {
    if passes.is_empty() {
        *scene = Scene::default();
    }
    // Positions become relative to the place of the first camera that has one: the others say why they have none.
    let Some(camera) = cameras.iter().find_map(|seen| seen.camera().ok()) else {
        return;
    };
    let device = context.render_device().wgpu_device().clone();
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor {
        label: Some("deep-screen-space-bevy scene"),
    });
    let data = (&*assets, &*allocator);
    let recorded = scene.record((&device, &mut encoder), &triangles, data, &camera);
    if recorded.is_ok() {
        context.add_command_buffer(encoder.finish());
    }
    scene.recorded = recorded.as_ref().map(|_| ()).map_err(Error::clone);
    triangles.note(recorded.ok());
}

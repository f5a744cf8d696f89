//! What became of the last frame, for the application to read.

use std::sync::{Arc, Mutex, PoisonError};

use bevy::{
    ecs::{
        entity::{Entity, EntityHashMap},
        resource::Resource,
    },
    log::error,
};

use crate::error::Error;

/// What became of the last frame of each camera with a [`RayTracedAmbientOcclusion`](crate::RayTracedAmbientOcclusion): a
/// resource of the application's world, and of the one that renders.
#[derive(Resource, Clone, Debug, Default)]
pub struct RayTracingStatus(Arc<Mutex<EntityHashMap<Result<(), Error>>>>);

impl RayTracingStatus {
    /// Whether a camera was drawn with occlusion, and if not, why. `None` before its first frame with a size.
    pub fn of(&self, camera: Entity) -> Option<Result<(), Error>> {
        let cameras = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        cameras.get(&camera).cloned()
    }

    /// Notes what became of a camera's frame, and logs what is new about it.
    pub(crate) fn set(&self, camera: Entity, result: Result<(), Error>) {
        let mut cameras = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Err(error) = &result {
            // As text: a setting that is NaN is none that is equal to it.
            let text = error.to_string();
            let before = cameras
                .get(&camera)
                .and_then(|before| before.as_ref().err());
            if before.is_none_or(|before| before.to_string() != text) {
                error!("camera {camera} is drawn without ray-traced ambient occlusion: {text}");
            }
        }
        cameras.insert(camera, result);
    }

    /// Forgets cameras that are no more.
    pub(crate) fn retain(&self, lives: impl Fn(Entity) -> bool) {
        let mut cameras = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        cameras.retain(|&camera, _| lives(camera));
    }
}

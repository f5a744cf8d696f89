//! What is flown through: a scene of the crate's or of a file, on the GPU.

use std::sync::atomic::{AtomicU64, Ordering};

use deep_screen_space::{
    Light, Primitives,
    glam::DVec3,
    scenes::{self, Scene},
};
use support::{
    gltf::{Loaded, load_gltf},
    gpu::Gpu,
    hull::LightSource,
    lights::{beside, sun_unless_emissive},
    near::ShadowedLight,
    raster::Rasterizer,
    scene::SceneBuffers,
    world::{bounds_of, origin_for},
};

use crate::{flight::Pose, mover::Mover};

/// The crate's scenes, by name.
pub const NAMES: [&str; 8] = [
    "colonnade",
    "cornell",
    "dominoes",
    "fence",
    "closed_room",
    "statue",
    "grass_cut_out",
    "stress",
];

/// The number of the next place.
static NEXT: AtomicU64 = AtomicU64::new(0);

/// A scene, and all that does not depend on where one is.
pub struct Place {
    /// Another for each that is loaded.
    pub id: u64,
    pub name: String,
    pub scene: Scene,
    pub buffers: SceneBuffers,
    pub rasterizer: Rasterizer,
    pub mover: Mover,
    /// What lights it besides its own emission.
    pub lights: Vec<Light>,
    pub lamp: ShadowedLight,
    pub map: LightSource,
    /// Views worth looking from, the first to begin with.
    pub views: Vec<(String, Pose)>,
    /// Across all of it, world units.
    pub size: f64,
    /// What was left out of a file.
    pub notes: Vec<String>,
}

impl Place {
    /// Reads a file, or makes a scene of that name.
    ///
    /// # Errors
    /// A line that says what is wrong with it.
    pub fn load(gpu: &Gpu, name: &str) -> Result<Self, String> {
        let loaded: Loaded = match scenes::by_name(name) {
            Some(scene) => scene.into(),
            None => load_gltf(name.as_ref())?,
        };
        Self::of(gpu, name, loaded)
    }

    fn of(gpu: &Gpu, name: &str, loaded: Loaded) -> Result<Self, String> {
        let mut looks = Vec::new();
        for camera in &loaded.cameras {
            let looking = [camera.eye, camera.target];
            let lens = [camera.vertical_fov_degrees, camera.near];
            looks.push((camera.name.clone(), looking, lens));
        }
        for view in &loaded.world.scene.views {
            let looking = [view.eye, view.target].map(DVec3::from);
            let lens = [view.vertical_fov_degrees, view.near];
            looks.push((view.name.to_owned(), looking, lens));
        }
        if looks.is_empty() {
            let looking = loaded.world.corner_view();
            let lens = [45.0, 0.5 * looking[0].distance(looking[1])];
            looks.push(("corner".into(), looking, lens));
        }
        let [eye, target] = looks[0].1;
        let origin = origin_for(loaded.world.bounds(), eye, target);
        let mut scene = loaded.world.relative_to(origin)?;
        let (low, high) = bounds_of(&scene);
        let size = low.distance(high);
        if !(size > 0.0 && size.is_finite()) {
            return Err(format!("{name}: all of it is in one point"));
        }
        let mut lights = loaded.lights;
        for light in &mut lights {
            if let Light::Point { position, .. } | Light::Spot { position, .. } = light {
                *position -= origin;
            }
            light.validate().map_err(|e| format!("{name}: {e}"))?;
        }
        if lights.is_empty() {
            lights.extend(sun_unless_emissive(&scene));
        }
        // Near enough that what one flies up to is not cut off, and no nearer than the view was made for.
        let views = looks
            .into_iter()
            .map(|(view, [eye, target], [degrees, near])| {
                let near = near.min(1e-3 * size).max(1e-6 * size);
                (
                    view,
                    Pose::new(eye - origin, target - origin, degrees, near),
                )
            })
            .collect();
        let [eye, target] = [eye - origin, target - origin];
        let circles = 0.12 * eye.distance(target).min(size);
        let mover = Mover::add(&mut scene, target, circles);
        let buffers = SceneBuffers::new(gpu, &scene);
        let error = |e: deep_screen_space::Error| format!("{name}: {e}");
        let light = lights.first().copied();
        let shadowed = light.unwrap_or_else(|| beside(eye, target, DVec3::Y));
        Ok(Self {
            id: NEXT.fetch_add(1, Ordering::Relaxed),
            name: name.to_owned(),
            rasterizer: Rasterizer::new(gpu, &buffers),
            lamp: ShadowedLight::new(gpu, &scene, &buffers, shadowed).map_err(error)?,
            map: LightSource::seen(&scene, light.as_ref(), [eye, target]).map_err(error)?,
            mover,
            buffers,
            lights,
            views,
            size,
            notes: loaded.notes,
            scene,
        })
    }

    /// Within which occluders count: what suits a scene of the crate's; of a file a tenth of all of it.
    pub fn radius(&self) -> f32 {
        if self.scene.ao_radius.is_finite() {
            self.scene.ao_radius
        } else {
            0.1 * self.size as f32
        }
    }

    /// What rays meet.
    pub fn primitives(&self) -> Primitives {
        if self.scene.holes.is_some() {
            Primitives::AlphaTested
        } else {
            Primitives::Triangles
        }
    }
}

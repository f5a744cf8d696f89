//! What rays meet, shared by both sides: one `RayTracedScene` for each number of bounces.

use deep_screen_space::{
    BounceSettings, Camera, Error, Geometry, HitLighting, Primitives, RayTracedScene,
    RayTracedSceneInput,
};
use support::{gpu::Gpu, stages::Stages};

use crate::{
    look::{Look, Method},
    place::Place,
};

/// The scenes that the sides ask for.
#[derive(Default)]
pub struct Scenes {
    scenes: Vec<(Option<BounceSettings>, RayTracedScene)>,
    primitives: Primitives,
}

impl Scenes {
    pub fn of(&self, look: &Look) -> Option<&RayTracedScene> {
        let wanted = look.further_bounces();
        let mut scenes = self.scenes.iter();
        scenes.find_map(|(bounces, scene)| (*bounces == wanted).then_some(scene))
    }

    /// Makes what the sides ask for, and lets go of what they no longer do.
    ///
    /// # Errors
    /// What the crate finds.
    pub fn make(&mut self, gpu: &Gpu, place: &Place, looks: &[&Look]) -> Result<(), Error> {
        if self.primitives != place.primitives() {
            self.scenes.clear();
            self.primitives = place.primitives();
        }
        let by_rays = looks.iter().filter(|look| look.method == Method::Rays);
        let wanted: Vec<_> = by_rays.map(|look| look.further_bounces()).collect();
        self.scenes.retain(|(bounces, _)| wanted.contains(bounces));
        for bounces in wanted {
            if self.scenes.iter().any(|(known, _)| *known == bounces) {
                continue;
            }
            let primitives = self.primitives;
            let scene = match bounces {
                Some(settings) => RayTracedScene::with_bounces(&gpu.device, primitives, settings)?,
                None => RayTracedScene::with_primitives(&gpu.device, primitives)?,
            };
            self.scenes.push((bounces, scene));
        }
        Ok(())
    }

    /// Records each once, as far as the sides look.
    ///
    /// # Errors
    /// What the crate finds.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        stages: &mut impl Stages,
        (place, camera): (&Place, &Camera),
        looks: &[&Look],
    ) -> Result<(), Error> {
        let meshes = place.buffers.meshes();
        let tests = place.buffers.tests();
        for (bounces, scene) in &mut self.scenes {
            let of =
                |look: &&&Look| look.method == Method::Rays && look.further_bounces() == *bounces;
            let of: Vec<_> = looks.iter().filter(of).collect();
            let reach = of.iter().map(|look| look.reach()).fold(0.0, f32::max);
            let lit = of.iter().any(|look| look.is_lit());
            let input = RayTracedSceneInput {
                cull_by: &[*camera],
                reach,
                lighting: lit.then_some(HitLighting {
                    materials: &place.buffers.materials,
                    lights: &place.lights,
                }),
                alpha_tests: place.buffers.alpha_tests(&tests),
                ..RayTracedSceneInput::new(Geometry { meshes: &meshes }, camera)
            };
            stages.stage("scene of rays", |encoder| {
                scene.record(&gpu.device, encoder, &input)
            })?;
        }
        Ok(())
    }

    pub fn memory_bytes(&self) -> u64 {
        self.scenes.iter().map(|(_, s)| s.memory_bytes()).sum()
    }
}

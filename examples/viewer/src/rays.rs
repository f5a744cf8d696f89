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
    scenes: Vec<(Made, RayTracedScene)>,
    primitives: Primitives,
}

/// What a scene is made for.
#[derive(Clone, Copy, PartialEq)]
struct Made {
    bounces: Option<BounceSettings>,
    /// Whether what shines is found, for rays that go there.
    emitters: bool,
}

impl Made {
    /// One for each number of bounces, with what shines where any side asks for it.
    fn wanted(looks: &[&Look]) -> Vec<Self> {
        let mut wanted: Vec<Self> = Vec::new();
        for look in looks.iter().filter(|look| look.method == Method::Rays) {
            let (bounces, emitters) = (look.further_bounces(), look.aims());
            match wanted.iter_mut().find(|made| made.bounces == bounces) {
                Some(made) => made.emitters |= emitters,
                None => wanted.push(Self { bounces, emitters }),
            }
        }
        wanted
    }

    fn create(self, gpu: &Gpu, primitives: Primitives) -> Result<RayTracedScene, Error> {
        let device = &gpu.device;
        let scene = match self.bounces {
            Some(settings) => RayTracedScene::with_bounces(device, primitives, settings)?,
            None => RayTracedScene::with_primitives(device, primitives)?,
        };
        if self.emitters {
            scene.with_emitters(device)
        } else {
            Ok(scene)
        }
    }
}

impl Scenes {
    pub fn of(&self, look: &Look) -> Option<&RayTracedScene> {
        let wanted = look.further_bounces();
        let mut scenes = self.scenes.iter();
        scenes.find_map(|(made, scene)| (made.bounces == wanted).then_some(scene))
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
        let wanted = Made::wanted(looks);
        self.scenes.retain(|(made, _)| wanted.contains(made));
        for made in wanted {
            if self.scenes.iter().all(|(known, _)| *known != made) {
                let scene = made.create(gpu, self.primitives)?;
                self.scenes.push((made, scene));
            }
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
        for (made, scene) in &mut self.scenes {
            let of = |look: &&&Look| {
                look.method == Method::Rays && look.further_bounces() == made.bounces
            };
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

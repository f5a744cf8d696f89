//! Both sides' pictures: rendered where something has changed, and no oftener.

use std::sync::Arc;

use deep_screen_space::{Bounces, SurfelCounts, wgpu::TextureView};
use support::{gpu::Gpu, near::ShadowedLight, raster::Raster, stages::Stages};

use crate::{
    clock::Clock,
    flight::Pose,
    look::{Effect, Look, Method},
    motion::{Motion, Snapshot},
    passes::{Passes, Scenery},
    place::Place,
    rays::Scenes,
};

/// What a picture is of: if it is the same, so is the picture.
#[derive(Clone, PartialEq)]
struct Subject {
    place: u64,
    pose: Pose,
    size: [u32; 2],
    rounds: Option<f32>,
    looks: Vec<Look>,
}

/// The passes of both, and what they share.
pub struct Sides {
    pub clock: Clock,
    scenes: Scenes,
    passes: [Option<Passes>; 2],
    /// Why a side shows what it showed before.
    pub problems: [Option<String>; 2],
    raster: Option<Raster>,
    motion: Option<Motion>,
    /// What was rendered last.
    last: Option<Snapshot>,
    /// Of the box where it is now.
    lamp: Option<ShadowedLight>,
    shown: Option<Subject>,
    /// Frames until there is nothing more to be joined.
    left: u32,
    reset: bool,
    /// Whether the last call rendered anything.
    pub changed: bool,
    /// Of the first side's surfels, where it has some.
    pub counts: Option<SurfelCounts>,
}

/// As many frames as are joined without anybody's asking for more.
const MOST_FRAMES: u32 = 256;

impl Sides {
    pub fn new(gpu: &Gpu) -> Self {
        Self {
            clock: Clock::new(gpu),
            scenes: Scenes::default(),
            passes: [None, None],
            problems: [None, None],
            raster: None,
            motion: None,
            last: None,
            lamp: None,
            shown: None,
            left: 0,
            reset: false,
            changed: false,
            counts: None,
        }
    }

    /// The next frame has nothing to do with the last.
    pub fn cut(&mut self) {
        self.reset = true;
        self.shown = None;
    }

    pub fn passes(&self, side: usize) -> Option<&Passes> {
        self.passes[side].as_ref()
    }

    /// What is owned, bytes.
    pub fn memory(&self, sides: usize) -> Vec<(&'static str, u64)> {
        let mut memory = vec![("scene of rays", self.scenes.memory_bytes())];
        let names = ["A, own memory", "B, own memory"];
        for (passes, name) in self.passes.iter().zip(names).take(sides) {
            memory.push((name, passes.as_ref().map_or(0, Passes::memory_bytes)));
        }
        memory.retain(|(_, bytes)| *bytes > 0);
        memory
    }

    /// Renders, where something has changed or frames are to be joined. True where there is nothing more to do. While a mouse
    /// button is `held`, passes are not made anew for each step of a slider.
    pub fn render(
        &mut self,
        gpu: &Gpu,
        (place, pose, size, rounds): (&Arc<Place>, &Pose, [u32; 2], Option<f32>),
        looks: &[Look],
        held: bool,
    ) -> bool {
        self.changed = false;
        let subject = Subject {
            place: place.id,
            pose: *pose,
            size,
            rounds,
            looks: looks.to_vec(),
        };
        let is_new = self.shown.as_ref() != Some(&subject);
        if !is_new && self.left == 0 {
            return true;
        }
        let waits = held
            && looks.iter().zip(&self.passes).any(|(look, passes)| {
                let passes = passes.as_ref();
                passes.is_some_and(|passes| !passes.fit(look))
            });
        if waits {
            return false;
        }
        self.left = if is_new {
            looks.iter().map(frames).max().unwrap_or_default()
        } else {
            self.left - 1
        };
        let before = self.shown.replace(subject);
        let other_place = before
            .as_ref()
            .is_none_or(|before| before.place != place.id);
        let moved = other_place || before.is_some_and(|before| before.rounds != rounds);
        if other_place {
            // What they were made of is another.
            self.passes = [None, None];
            self.last = None;
        }
        self.record(gpu, (place, pose, size, rounds), looks, moved);
        self.changed = true;
        self.reset = false;
        self.counts = if self.left == 0 {
            self.passes[0].as_ref().and_then(|p| p.counts(gpu))
        } else {
            None
        };
        self.left == 0
    }

    fn record(
        &mut self,
        gpu: &Gpu,
        (place, pose, size, rounds): (&Arc<Place>, &Pose, [u32; 2], Option<f32>),
        looks: &[Look],
        moved: bool,
    ) {
        self.problems = [None, None];
        let camera = match pose.camera(size) {
            Ok(camera) => camera,
            Err(e) => {
                self.problems[0] = Some(e.to_string());
                return;
            }
        };
        for (side, look) in looks.iter().enumerate() {
            if let Err(problem) = self.make(gpu, place, (side, look), size) {
                self.problems[side] = Some(problem.to_string());
            }
        }
        let accepted: Vec<&Look> = looks
            .iter()
            .zip(&self.problems)
            .filter_map(|(look, problem)| problem.is_none().then_some(look))
            .collect();
        if moved {
            place.mover.write(&gpu.queue, &place.buffers, rounds);
            self.lamp = None;
        }
        let wants_lamp =
            |look: &&Look| look.method == Method::Depths && look.effect != Effect::AmbientOcclusion;
        if rounds.is_some() && self.lamp.is_none() && accepted.iter().any(wants_lamp) {
            let light = place.lamp.light;
            self.lamp = ShadowedLight::new(gpu, &place.scene, &place.buffers, light).ok();
        }
        let raster = self.raster.take();
        let raster = raster.filter(|raster| size_of(&raster.depth) == size);
        let raster = raster.unwrap_or_else(|| Raster::new(gpu, size));
        let mut stages = self.clock.begin(gpu);
        stages.stage("G-buffer", |encoder| {
            let what = (&place.buffers, &camera);
            place.rasterizer.record(gpu, encoder, what, &raster);
        });
        let now = Snapshot {
            camera,
            world_from_box: rounds.map(|rounds| place.mover.world_from_box(rounds)),
        };
        let joins = accepted.iter().any(|look| look.joins_frames());
        let before = self.last.filter(|before| now.moved_since(before));
        let motion = if let Some(before) = before.filter(|_| joins) {
            let motion = self.motion.take();
            let motion = motion.filter(|motion| size_of(motion.vectors()) == size);
            let motion = motion.unwrap_or_else(|| Motion::new(gpu, size));
            stages.stage("motion vectors", |encoder| {
                motion.record(gpu, encoder, &raster, (&now, &before));
            });
            Some(self.motion.insert(motion).vectors())
        } else {
            None
        };
        self.last = Some(now);
        let recorded = self.scenes.make(gpu, place, &accepted).and_then(|()| {
            self.scenes
                .record(gpu, &mut stages, (place, &camera), &accepted)
        });
        if let Err(problem) = &recorded {
            self.problems[0] = Some(problem.to_string());
        }
        for (side, look) in looks.iter().enumerate() {
            if self.problems[side].is_some() {
                continue;
            }
            let scenery = Scenery {
                gpu,
                place,
                scenes: &self.scenes,
                camera: &camera,
                raster: &raster,
                lamp: self.lamp.as_ref().unwrap_or(&place.lamp),
                moved,
                motion,
                reset: self.reset,
            };
            stages.side = match (looks.len(), side) {
                (1, _) => "",
                (_, 0) => "A",
                _ => "B",
            };
            if let Some(passes) = &mut self.passes[side]
                && let Err(problem) = passes.record(&mut stages, &scenery, look)
            {
                self.problems[side] = Some(problem.to_string());
            }
        }
        stages.end();
        self.raster = Some(raster);
    }

    /// Passes for a side's settings, unless those that are there can take them.
    fn make(
        &mut self,
        gpu: &Gpu,
        place: &Place,
        (side, look): (usize, &Look),
        size: [u32; 2],
    ) -> Result<(), deep_screen_space::Error> {
        look.validate()?;
        let passes = &mut self.passes[side];
        if let Some(passes) = passes
            && passes.fit(look)
            && passes.resize(gpu, size)
        {
            return Ok(());
        }
        // What they own goes before there is more.
        *passes = None;
        *passes = Some(Passes::new(gpu, place, look, size)?);
        Ok(())
    }
}

fn size_of(view: &TextureView) -> [u32; 2] {
    let texture = view.texture();
    [texture.width(), texture.height()]
}

/// After how many frames a picture of a world at rest is what it will be.
fn frames(look: &Look) -> u32 {
    if look.method != Method::Rays {
        return 0;
    }
    let joined = look.temporal.filter(|_| look.joins_frames());
    let joined = joined.map_or(0, |temporal| temporal.max_frames);
    let bounced = look
        .further_bounces()
        .filter(|bounces| bounces.bounces == Bounces::OverFrames)
        .map_or(0, |bounces| {
            bounces.frames_until(0.01).unwrap_or(MOST_FRAMES)
        });
    joined.max(bounced).min(MOST_FRAMES)
}

#[cfg(test)]
mod tests {
    use deep_screen_space::{Quality, TemporalSettings, glam::Vec3};
    use support::{
        gpu::{Ask, Gpu},
        multires::read_image,
    };

    use super::*;

    const SIZE: [u32; 2] = [96, 64];
    const FRAMES: u32 = 8;

    /// The first view of a place after some frames in which the box moves, in those pixels that show it.
    fn of_box(gpu: &Gpu, place: &Arc<Place>, look: &Look, with_motion: bool) -> Vec<Vec3> {
        let mut sides = Sides::new(gpu);
        let pose = place.views[0].1;
        for frame in 1..=FRAMES {
            if !with_motion {
                // As if nobody had seen where it was.
                sides.last = None;
            }
            // As far as it goes where ten frames are a second.
            let rounds = Some(0.01 * frame as f32);
            sides.render(gpu, (place, &pose, SIZE, rounds), &[*look], false);
            assert_eq!(sides.problems, [None, None]);
        }
        let raster = sides.raster.as_ref().unwrap();
        let albedo: Vec<[f32; 4]> = gpu.read_texture(raster.albedo.texture(), 0);
        let own = place.scene.materials.last().unwrap().albedo;
        let picture = read_image(gpu, sides.passes(0).unwrap().target().texture());
        let pixels = picture.into_iter().zip(albedo);
        pixels
            .filter(|(_, [r, g, b, _])| [*r, *g, *b] == own)
            .map(|(light, _)| light.into())
            .collect()
    }

    /// Joined frames of a box that moves are nearer to one frame of many rays with motion vectors than without.
    #[test]
    fn what_moves_takes_its_light_along() {
        let gpu = Gpu::open(Ask::Floor).unwrap();
        let place = Arc::new(Place::load(&gpu, "cornell").unwrap());
        let mut look = Look::new(2.0, 1.0, Quality::Fast);
        look.emits = true;
        look.choose(Effect::IndirectDiffuse, Quality::Fast);
        let mut exact = look;
        exact.rays.rays_per_pixel = 32;
        let truth = of_box(&gpu, &place, &exact, false);
        assert!(truth.len() > 50, "{} pixels show the box", truth.len());
        look.temporal = Some(TemporalSettings::default());
        let off = |with_motion| {
            let found = of_box(&gpu, &place, &look, with_motion);
            let squares = found
                .iter()
                .zip(&truth)
                .map(|(a, b)| a.distance_squared(*b));
            (squares.sum::<f32>() / (3.0 * truth.len() as f32)).sqrt()
        };
        let [with, without] = [true, false].map(off);
        println!("with motion vectors {with:.4}, without {without:.4}");
        // What is left is a frame's own noise, and light that changes as the box turns.
        assert!(
            with < 0.6 * without,
            "{with} with motion vectors, {without} without"
        );
    }
}

//! More than one bounce of light, for a scene of rays: surfels of its triangles, lit, and what they gather of each other.

use wgpu::{Buffer, CommandEncoder, Device};

use crate::{
    bounced_z_buffer::{
        descriptor::{HitLighting, MAX_EMITTER_SAMPLES},
        settings::MAX_FRAME,
    },
    bvh::{Bvh, Primitives},
    emitters::Emitters,
    error::{Error, check_setting},
    gpu::compiler::Compiler,
    surfel::SurfelCloud,
    surfel_gatherer::{
        SurfelGatherer, SurfelGathererInput, SurfelSenders, settings::SurfelGathererSettings,
    },
    surfel_shader::{
        ShadedLight, Shadow, SurfelShader, SurfelShaderInput, settings::SurfelShaderSettings,
    },
    surfelizer::settings::SurfelizerSettings,
};

/// How many bounces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounces {
    /// So many in each frame, 2…16, the pixels' own among them: one recording of the [`SurfelGatherer`] for each but that.
    InFrame(u32),
    /// One recording per frame, of what the surfels of the last frame sent: two bounces in the first frame, and one more in each
    /// that follows. Light takes as many frames to come, and after it was switched off to go
    /// ([`BounceSettings::frames_until`]). Rays from surfels meet the last frame's triangles, so that things that move get
    /// further bounces as they were then. In the frame in which materials begin to emit otherwise, rays that are aimed at
    /// emitters and rays by chance do not agree on how they share the last frame's light. The last frame's triangles, their
    /// hierarchy and the surfels' light are kept: twice the memory.
    OverFrames,
}

/// Light that bounces more than once, for a [`RayTracedScene`](crate::RayTracedScene). Its triangles get surfels, which are lit
/// and gather light from each other; pixels see that light at the hits of their rays, beside what lights send there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BounceSettings {
    /// How many.
    pub bounces: Bounces,
    /// Radius of a surfel in pixels of the scene's camera, 0.05…1000. How finely indirect light is known where rays end; the
    /// number of surfels grows with its inverse square, and each triangle has one at least. Default 4.
    pub radius_pixels: f32,
    /// At how many points of a surfel lights are looked up, as [`SurfelShaderSettings::samples`]. Default 4.
    pub samples: u32,
    /// Rays from surfels. [`RayTracedSceneInput::frame`](crate::RayTracedSceneInput::frame) is added to its frame.
    pub gatherer: SurfelGathererSettings,
}

impl BounceSettings {
    /// So many bounces in each frame.
    pub fn in_frame(bounces: u32) -> Self {
        Self {
            bounces: Bounces::InFrame(bounces),
            radius_pixels: 4.0,
            samples: 4,
            gatherer: SurfelGathererSettings::default(),
        }
    }

    /// One more bounce each frame. No surface reflects more than 0.95 in further bounces, so that light which is switched off is
    /// below 1 % after 90 frames in any room, and after far fewer in most.
    pub fn over_frames() -> Self {
        Self {
            bounces: Bounces::OverFrames,
            gatherer: SurfelGathererSettings {
                most_albedo: 0.95,
                ..SurfelGathererSettings::default()
            },
            ..Self::in_frame(2)
        }
    }

    /// As many rays in all, one in five of which go to surfaces that shine of themselves, for a scene
    /// [with emitters](crate::RayTracedScene::with_emitters).
    #[must_use]
    pub fn for_emitters(self) -> Self {
        let [rays_per_surfel, emitter_samples] =
            aimed(self.gatherer.rays_per_surfel, self.gatherer.emitter_samples);
        Self {
            gatherer: SurfelGathererSettings {
                rays_per_surfel,
                emitter_samples,
                ..self.gatherer
            },
            ..self
        }
    }

    /// After how many frames without any light no surfel sends more than `share`, 0…1, of what the brightest one sent: 1 for
    /// bounces in a frame. `None` where there is no such number, as with a largest albedo of 1 or a share of 0.
    pub fn frames_until(&self, share: f32) -> Option<u32> {
        if self.bounces != Bounces::OverFrames || share >= 1.0 {
            return Some(1);
        }
        let frames = f64::from(share).ln() / f64::from(self.gatherer.most_albedo).ln();
        // Each frame gathers once, the first one too.
        (frames >= 0.0 && frames < f64::from(u32::MAX)).then(|| (frames.ceil() as u32).max(1))
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        if let Bounces::InFrame(bounces) = self.bounces {
            check_setting(
                (2..=16).contains(&bounces),
                "Bounces::InFrame",
                bounces,
                "2 to 16",
            )?;
        }
        self.surfelizer().validate()?;
        SurfelShaderSettings {
            samples: self.samples,
        }
        .validate()?;
        self.gatherer.validate()
    }

    /// What makes the surfels, on whole triangles.
    pub(super) fn surfelizer(&self) -> SurfelizerSettings {
        SurfelizerSettings {
            radius_pixels: self.radius_pixels,
            density: f32::INFINITY,
            ..SurfelizerSettings::default()
        }
    }
}

/// The passes.
#[derive(Debug)]
pub(super) struct BouncePasses {
    pub settings: BounceSettings,
    shader: SurfelShader,
    gatherer: SurfelGatherer,
}

/// What the surfels of a cloud send.
#[derive(Debug)]
pub(super) struct SurfelLights {
    /// Of themselves and straight from lights; over frames, with what they gathered.
    sent: Buffer,
    /// What they reflect of what they gathered. Of three bounces and more a pair that takes turns.
    gathered: Vec<Buffer>,
    /// Which of them has the last bounce, once one was recorded.
    last: Option<usize>,
}

impl SurfelLights {
    /// What pixels add to their hits.
    pub fn gathered(&self) -> Option<&Buffer> {
        self.last.map(|last| &self.gathered[last])
    }

    /// There is none of what the cloud is now.
    pub fn forget(&mut self) {
        self.last = None;
    }

    pub fn memory_bytes(&self) -> u64 {
        self.sent.size() + self.gathered.iter().map(Buffer::size).sum::<u64>()
    }
}

/// A cloud, its hierarchy and its light.
#[derive(Clone, Copy)]
pub(super) struct Lit<'a> {
    pub cloud: &'a SurfelCloud,
    pub bvh: &'a Bvh,
    pub emitters: Option<&'a Emitters>,
    pub lights: &'a SurfelLights,
}

impl BouncePasses {
    pub fn new(
        compiler: Compiler<'_>,
        primitives: Primitives,
        settings: BounceSettings,
    ) -> Result<Self, Error> {
        settings.validate()?;
        Ok(Self {
            settings,
            shader: SurfelShader::with_primitives(compiler, primitives)?,
            gatherer: SurfelGatherer::with_primitives(compiler, primitives)?,
        })
    }

    /// Has surfels aim at what shines, if the settings say so.
    pub fn aim(&mut self, compiler: Compiler<'_>, primitives: Primitives) -> Result<(), Error> {
        if self.aims() {
            self.gatherer = SurfelGatherer::with_emitters(compiler, primitives)?;
        }
        Ok(())
    }

    pub fn aims(&self) -> bool {
        self.settings.gatherer.emitter_samples > 0
    }

    /// How many recordings a frame has.
    fn recordings(&self) -> u32 {
        match self.settings.bounces {
            Bounces::InFrame(bounces) => bounces - 1,
            Bounces::OverFrames => 1,
        }
    }

    pub fn create(&self, device: &Device, cloud: &SurfelCloud) -> Result<SurfelLights, Error> {
        let room = || self.gatherer.create_radiance(device, cloud);
        let pair = self.recordings().min(2);
        Ok(SurfelLights {
            sent: room()?,
            gathered: (0..pair).map(|_| room()).collect::<Result<_, _>>()?,
            last: None,
        })
    }

    /// Lights the surfels, and lets them gather; over frames of what those of the frame before sent, if there was one.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        (cloud, bvh, emitters, lights): (&SurfelCloud, &Bvh, Option<&Emitters>, &mut SurfelLights),
        before: Option<Lit<'_>>,
        (lighting, frame): (&HitLighting<'_>, u32),
    ) -> Result<(), Error> {
        lights.last = None;
        let SurfelLights { sent, gathered, .. } = &*lights;
        let shaded: Vec<_> = lighting
            .lights
            .iter()
            .map(|light| ShadedLight {
                light: *light,
                shadow: Shadow::Traced(bvh),
            })
            .collect();
        let settings = SurfelShaderSettings {
            samples: self.settings.samples,
        };
        let input = SurfelShaderInput::new(cloud, lighting.materials, &shaded, sent);
        self.shader.record(device, encoder, &input, &settings)?;

        let recordings = self.recordings() as usize;
        for bounce in 0..recordings {
            let mut senders = SurfelSenders {
                cloud,
                bvh,
                radiance: match bounce {
                    0 => sent,
                    _ => &gathered[(bounce - 1) % 2],
                },
            };
            let mut emitters = emitters;
            if let (0, Some(before)) = (bounce, before) {
                senders = SurfelSenders {
                    cloud: before.cloud,
                    bvh: before.bvh,
                    radiance: &before.lights.sent,
                };
                emitters = before.emitters;
            }
            let to = &gathered[bounce % 2];
            let input = SurfelGathererInput {
                cloud,
                emitters: emitters.filter(|_| self.aims()),
                ..SurfelGathererInput::new(senders, lighting.materials, to)
            };
            let settings = SurfelGathererSettings {
                frame: (self.settings.gatherer.frame + frame) % (MAX_FRAME + 1),
                ..self.settings.gatherer
            };
            self.gatherer.record(device, encoder, &input, &settings)?;
            if bounce + 1 < recordings {
                self.gatherer.add(device, encoder, cloud, to, sent)?;
            }
        }
        if self.settings.bounces == Bounces::OverFrames {
            self.gatherer
                .add(device, encoder, cloud, sent, &gathered[0])?;
        }
        lights.last = Some((recordings - 1) % 2);
        Ok(())
    }
}

/// Of so many rays, those towards emitters among them, how many are to go by chance and how many to emitters.
pub(super) fn aimed(rays: u32, emitter_samples: u32) -> [u32; 2] {
    let all = rays.saturating_add(emitter_samples);
    let aimed = (all.saturating_add(2) / 5).clamp(1, MAX_EMITTER_SAMPLES);
    let aimed = aimed.min(all / 2);
    [all - aimed, aimed]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decay_follows_the_largest_albedo() {
        assert_eq!(BounceSettings::over_frames().frames_until(0.01), Some(90));
        assert_eq!(BounceSettings::in_frame(3).frames_until(0.01), Some(1));
        let mut settings = BounceSettings::over_frames();
        assert_eq!(settings.frames_until(1.0), Some(1));
        assert_eq!(settings.frames_until(0.0), None);
        assert_eq!(settings.frames_until(f32::NAN), None);
        settings.gatherer.most_albedo = 1.0;
        assert_eq!(settings.frames_until(0.5), None);
        settings.gatherer.most_albedo = 0.0;
        assert_eq!(settings.frames_until(0.5), Some(1));
        settings.gatherer.most_albedo = 0.5;
        assert_eq!(settings.frames_until(0.25), Some(2));
    }
}

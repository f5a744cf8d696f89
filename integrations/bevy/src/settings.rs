//! What a camera asks for.

use bevy::{
    core_pipeline::prepass::{DepthPrepass, NormalPrepass},
    ecs::component::Component,
};
use deep_screen_space::{
    Payload, Quality, RayTracedEffect, RayTracedViewDescriptor, TemporalSettings,
};

/// Gives a camera ray-traced ambient occlusion: what hides the sky dims ambient light, environment maps and irradiance volumes,
/// as Bevy's own `ScreenSpaceAmbientOcclusion` does, and light of lamps stays as it is.
///
/// The camera is a `Camera3d` with `Msaa::Off`, and has no `ScreenSpaceAmbientOcclusion`. Why it is drawn without, if it is, is
/// told by [`RayTracingStatus`](crate::RayTracingStatus), and logged once.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[require(DepthPrepass, NormalPrepass)]
pub struct RayTracedAmbientOcclusion {
    /// The distance beyond which nothing occludes, world units, 0 to infinity. Default 1.
    pub radius: f32,
    /// How many rays. Default [`Quality::Balanced`], 16 per pixel.
    pub quality: Quality,
    /// The mean of so many frames is shown, 1 or more; from then on it forgets exponentially. Each then has rays of its own, and
    /// [`Quality::Fast`] is enough. What moves is followed where the camera has a `MotionVectorPrepass`, and no
    /// `TemporalJitter`; else only the camera's own movement is. Default 1, each frame for itself.
    pub frames: u32,
}

impl Default for RayTracedAmbientOcclusion {
    fn default() -> Self {
        Self {
            radius: 1.0,
            quality: Quality::default(),
            frames: 1,
        }
    }
}

impl RayTracedAmbientOcclusion {
    /// Whether another asks for the same, NaN included.
    pub(crate) fn is(&self, other: &Self) -> bool {
        let radii = [self, other].map(|settings| settings.radius.to_bits());
        radii[0] == radii[1] && (self.quality, self.frames) == (other.quality, other.frames)
    }

    pub(crate) fn effect(&self) -> RayTracedEffect {
        RayTracedEffect::AmbientOcclusion {
            radius: self.radius,
        }
    }

    /// What a view is made for.
    pub(crate) fn descriptor(&self, target: wgpu::TextureFormat) -> RayTracedViewDescriptor {
        RayTracedViewDescriptor {
            primitives: crate::scene::PRIMITIVES,
            temporal: (self.frames != 1).then_some(TemporalSettings {
                max_frames: self.frames,
                ..TemporalSettings::default()
            }),
            ..RayTracedViewDescriptor::new(self.effect(), self.quality, target)
        }
    }

    pub(crate) fn rays(&self) -> deep_screen_space::RaySettings {
        self.quality.rays(Payload::Occlusion)
    }
}

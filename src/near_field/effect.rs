//! What a view of the near field shows, and by how many samples.

use crate::{
    effect::Channels,
    multi_res_mask::settings::MultiResMaskSettings,
    ray_traced::quality::Quality,
    screen_space_gi::settings::ScreenSpaceGiSettings,
    soft_shadows::settings::SoftShadowsSettings,
    volumetric_obscurance::{
        VolumetricObscuranceDescriptor,
        samples::DiskSamples,
        settings::{ObscuranceSampling, ObscuranceSettings, ObscuranceVolume},
    },
};

/// What a [`NearFieldView`](crate::NearFieldView) shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NearFieldEffect {
    /// The share of the space about a point that is open, 0 to 1 (open), of one channel:
    /// [`VolumetricObscurance`](crate::VolumetricObscurance).
    Obscurance {
        /// How to integrate, and over what.
        descriptor: VolumetricObscuranceDescriptor,
        /// Radius and all else.
        settings: ObscuranceSettings,
    },
    /// How much of one light is visible, 0 to 1 (wholly), of one channel: [`SoftShadows`](crate::SoftShadows).
    SoftShadows(SoftShadowsSettings),
    /// Irradiance over π of what is on the screen, W/(m² sr), of three channels: [`ScreenSpaceGi`](crate::ScreenSpaceGi).
    ScreenSpaceGi(ScreenSpaceGiSettings),
}

impl NearFieldEffect {
    /// Obscurance over half a sphere of `radius`, world units, by 6, 9 or 13 lines. Its samples are reflected about a direction
    /// of each pixel's own, for a filter of the caller's; by masks it is better without: [`ObscuranceSettings::turn`].
    pub fn obscurance(radius: f32, quality: Quality) -> Self {
        let samples = match quality {
            Quality::Fast => DiskSamples::Six,
            Quality::Balanced => DiskSamples::Nine,
            Quality::Accurate => DiskSamples::Thirteen,
        };
        Self::Obscurance {
            descriptor: VolumetricObscuranceDescriptor {
                sampling: ObscuranceSampling::Lines(samples),
                volume: ObscuranceVolume::Hemisphere,
            },
            settings: ObscuranceSettings {
                radius,
                ..ObscuranceSettings::default()
            },
        }
    }

    /// Soft shadows of a light of an [extent](SoftShadowsSettings::extent), with penumbrae up to
    /// [so wide](SoftShadowsSettings::max_penumbra), by 16, 64 or 196 look-ups.
    pub fn soft_shadows(extent: f32, max_penumbra: f32, quality: Quality) -> Self {
        Self::SoftShadows(SoftShadowsSettings {
            extent,
            max_penumbra,
            samples: match quality {
                Quality::Fast => 16,
                Quality::Balanced => 64,
                Quality::Accurate => 196,
            },
            ..SoftShadowsSettings::default()
        })
    }

    /// Light from surfaces on the screen nearer than `radius`, world units, by 32, 96 or 288 points.
    pub fn screen_space_gi(radius: f32, quality: Quality) -> Self {
        Self::ScreenSpaceGi(ScreenSpaceGiSettings {
            radius,
            samples: match quality {
                Quality::Fast => 32,
                Quality::Balanced => 96,
                Quality::Accurate => 288,
            },
            ..ScreenSpaceGiSettings::default()
        })
    }

    /// The paper's levels for it.
    pub fn masks(&self) -> MultiResMaskSettings {
        match self {
            Self::Obscurance { .. } => MultiResMaskSettings::OCCLUSION,
            Self::SoftShadows(_) => MultiResMaskSettings::SHADOW,
            Self::ScreenSpaceGi(_) => MultiResMaskSettings::INDIRECT,
        }
    }

    pub(super) fn channels(&self) -> Channels {
        match self {
            Self::Obscurance { .. } | Self::SoftShadows(_) => Channels::One,
            Self::ScreenSpaceGi(_) => Channels::Three,
        }
    }
}

//! Public settings and their validation.

use super::samples::{BallSamples, DiskSamples};
use crate::error::{Error, check_setting};

/// How [`VolumetricObscurance`](crate::VolumetricObscurance) integrates over its sphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ObscuranceSampling {
    /// Points of the ball, each of which is matter or not (Mittring, *Finding Next Gen*, 2007): for comparison.
    /// Noisier than [`Lines`](Self::Lines) at the same cost.
    Points(BallSamples),
    /// Chords of the sphere along the line of sight, integrated exactly against the depth at one pixel (4.1).
    Lines(DiskSamples),
    /// The same chords against the mean and variance of the depth over the sample's share of the disk (4.2). Needs
    /// [`DepthMoments`](crate::DepthMoments). Smoother, darker about edges that the areas run over, and several times as
    /// slow as lines. Meant for [`ObscuranceVolume::Sphere`] alone: over half spheres a slope's own variance reaches above
    /// its plane and shades it.
    Areas(DiskSamples),
    /// One area for the whole disk: darkens creases without any noise. As [`Areas`](Self::Areas), for
    /// [`ObscuranceVolume::Sphere`] alone.
    OneArea,
}

impl ObscuranceSampling {
    /// How many samples a pixel has.
    pub fn samples(&self) -> u32 {
        match self {
            Self::Points(samples) => samples.table().len() as u32,
            Self::Lines(samples) | Self::Areas(samples) => samples.table().len() as u32,
            Self::OneArea => 1,
        }
    }
}

/// What [`VolumetricObscurance`](crate::VolumetricObscurance) integrates over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum ObscuranceVolume {
    /// The sphere about the point, from the depth buffer alone. Half of it is matter where a surface is flat, which counts as
    /// open: the output is twice the open share, 1 at most. On slopes near the picture's edge that balance fails, since chords
    /// beyond the edge are dropped: what is left reads too dark or too open by up to the share dropped, and the other volumes
    /// read right.
    Sphere,
    /// Its half above the plane that the normal tells (4.4).
    #[default]
    Hemisphere,
    /// The sphere of half the radius that touches the plane at the point (4.4, after Szirmay-Kalos et al., *Volumetric
    /// ambient occlusion*, 2009): what lies high above the surface counts more, as with a cosine.
    TangentSphere,
}

/// How the openness about two radii becomes one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Combine {
    /// The product: darker where both are dark.
    #[default]
    Product,
    /// The smaller one.
    Minimum,
}

/// A second sphere beside the first, say a small one for fine features where the first is large (figure 8).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondRadius {
    /// As [`ObscuranceSettings::radius`].
    pub radius: f32,
    /// How both become one.
    pub combine: Combine,
}

/// Settings of [`VolumetricObscurance`](crate::VolumetricObscurance).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObscuranceSettings {
    /// Radius of the sphere, world units, 0…∞. At 0 nothing obscures anything. Default 1.
    pub radius: f32,
    /// A second sphere, which costs as much again. Default none.
    pub second: Option<SecondRadius>,
    /// The largest radius on screen, pixels, above 0, at most 16384. Where a sphere would be larger, near the eye, its radius
    /// in the world is this many times the side of a pixel there instead
    /// ([`Footprint::at`](crate::Footprint::at)): a smaller sphere, exactly as if `radius` were that. An infinite radius
    /// gives every pixel such a sphere. Samples far apart on screen cost time, since they share no cache lines. Default
    /// 128.
    pub max_pixels: f32,
    /// How thick surfaces are along the line of sight, world units, above 0…∞. What lies farther behind them is open
    /// again, so that they do not darken all that is behind their silhouettes (4.3). Default ∞.
    pub thickness: f32,
    /// Half the width of the box that stands for the depths of an area, in their standard deviations, above 0…4: √3, the
    /// default, gives the box their variance; 1 is what 4.2 prints. Areas alone read it.
    pub box_half_width: f32,
    /// Whether each pixel's samples are reflected about a direction of its own: the bands that few samples make become noise,
    /// for a filter. Sub-images are blended better without. Default true.
    pub turn: bool,
    /// Of the direction about which each pixel's samples are reflected. Another one each frame suits a
    /// mean over frames. Default 0.
    pub seed: u32,
}

impl Default for ObscuranceSettings {
    fn default() -> Self {
        Self {
            radius: 1.0,
            second: None,
            max_pixels: 128.0,
            thickness: f32::INFINITY,
            box_half_width: 1.732_050_8,
            turn: true,
            seed: 0,
        }
    }
}

impl ObscuranceSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            self.radius >= 0.0,
            "ObscuranceSettings::radius",
            self.radius,
            "0 or more",
        )?;
        if let Some(second) = self.second {
            check_setting(
                second.radius >= 0.0,
                "SecondRadius::radius",
                second.radius,
                "0 or more",
            )?;
        }
        check_setting(
            self.max_pixels > 0.0 && self.max_pixels <= 16384.0,
            "ObscuranceSettings::max_pixels",
            self.max_pixels,
            "above 0, at most 16384",
        )?;
        check_setting(
            self.thickness > 0.0,
            "ObscuranceSettings::thickness",
            self.thickness,
            "above 0",
        )?;
        check_setting(
            self.box_half_width > 0.0 && self.box_half_width <= 4.0,
            "ObscuranceSettings::box_half_width",
            self.box_half_width,
            "above 0, at most 4",
        )
    }
}

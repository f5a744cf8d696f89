//! Public settings and their validation.

use crate::{
    error::{Error, check_setting},
    surfel::Placement,
};

/// How far a surfel's effect reaches: what lies farther than this from all that a view can see is not made into
/// surfels. The smaller of the two holds; [`ShellSplatter::reach`](crate::ShellSplatter::reach) gives the right one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// A multiple of the surfel's radius, ≥ 0, `f32::INFINITY` for no bound.
    pub radii: f32,
    /// A distance in world units, ≥ 0, `f32::INFINITY` for no bound.
    pub world: f32,
}

impl Default for Reach {
    /// No bound: every triangle becomes surfels.
    fn default() -> Self {
        Self {
            radii: f32::INFINITY,
            world: f32::INFINITY,
        }
    }
}

/// Settings of the [`Surfelizer`](crate::Surfelizer).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelizerSettings {
    /// Radius of a surfel in pixels of the camera's image, 0.05…1000. Accuracy of what is near a surface, against the
    /// number of surfels, which grows with its inverse square. Default 2: contact shadows of two pixels and more.
    pub radius_pixels: f32,
    /// Where a piece's surfels go. Default [`Placement::Centroid`].
    pub placement: Placement,
    /// How many surfels stand for each target area (π times the square of the radius above) of triangles smaller than
    /// it, 0.01…∞. At 1 as many as for large triangles, each chosen one taking over its neighbours' area
    /// (The Bounced Z-buffer 4.3, with the probability corrected); `f32::INFINITY` keeps every triangle. Default 4:
    /// a fine mesh's folds cancel in fewer, larger disks.
    pub density: f32,
    /// Beyond which distance from a view's frustum nothing is made, when views are given. Default: no bound.
    pub reach: Reach,
}

impl Default for SurfelizerSettings {
    fn default() -> Self {
        Self {
            radius_pixels: 2.0,
            placement: Placement::Centroid,
            density: 4.0,
            reach: Reach::default(),
        }
    }
}

impl SurfelizerSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        check_setting(
            (0.05..=1000.0).contains(&self.radius_pixels),
            "SurfelizerSettings::radius_pixels",
            self.radius_pixels,
            "0.05 to 1000",
        )?;
        check_setting(
            self.density >= 0.01,
            "SurfelizerSettings::density",
            self.density,
            "0.01 to infinity",
        )?;
        check_setting(
            self.reach.radii >= 0.0,
            "Reach::radii",
            self.reach.radii,
            "0 to infinity",
        )?;
        check_setting(
            self.reach.world >= 0.0,
            "Reach::world",
            self.reach.world,
            "0 to infinity",
        )
    }
}

//! What is computed.

use deep_screen_space::Quality;

/// What is computed for a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Ambient occlusion by what is nearer than this, world units, 0 to infinity; `None` for none, which leaves kiss3d's own, if
    /// that is enabled. It multiplies kiss3d's ambient light, a skybox's too. Default 1.
    pub occlusion_radius: Option<f32>,
    /// Whether light that has bounced once off diffuse surfaces is added to the picture. Default true.
    pub bounce: bool,
    /// How many rays. Default [`Quality::Balanced`].
    pub quality: Quality,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            occlusion_radius: Some(1.0),
            bounce: true,
            quality: Quality::default(),
        }
    }
}

//! Ambient occlusion (`wgsl/effects/ambient_occlusion.wgsl`).

use crate::effect::Effect;

/// How occluders that may lie behind each other are combined. Sums of form factors know nothing of what hides what.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Overlap {
    /// Visibility is `1 − Σ F`, at least 0: exact where no occluder hides another, as in a convex room.
    #[default]
    Add,
    /// Visibility is `exp(−Σ F)`: what independent occluders would give. Too bright where they cover each other's gaps
    /// exactly, as walls do, closer than the sum where many lie behind each other.
    Independent,
}

impl Overlap {
    /// `OVERLAP` of the effects' shaders.
    pub(crate) fn constant(self) -> f64 {
        match self {
            Self::Add => 0.0,
            Self::Independent => 1.0,
        }
    }
}

/// Ambient occlusion by point-to-disk form factors: visibility of a uniform sky, cosine-weighted about the pixel's
/// normal; 1 is open (Deep Screen Space 4; Wallace et al. 1989).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct AmbientOcclusion {
    /// Whether a surface also occludes behind its back. Closed bodies need their front alone, since what enters
    /// through a front leaves through a back and would count twice; single sheets (curtains, leaves) need both.
    pub two_sided: bool,
    /// How occluders combine.
    pub overlap: Overlap,
    /// Whether a pixel's own surface hides the directions below it, for G-buffers whose normals are those of strong normal
    /// maps. Visibility is about the shading normal; without this, what the surface cuts off of the hemisphere about one
    /// that leans by an angle θ counts as open: too bright by up to `(1 − cos θ) / 2`, 0.15 at 45° and 0.33 at 70°. The
    /// surface's own normal comes from depth ([`Effect::own_surface`]), and that costs some time. Default false.
    pub own_surface: bool,
}

impl AmbientOcclusion {
    /// The effect. One channel, neither materials nor albedo; writes visibility to r, g and b and 1 to a.
    pub fn effect(self) -> Effect {
        Effect {
            two_sided: self.two_sided,
            own_surface: self.own_surface,
            constants: vec![
                ("TWO_SIDED".into(), f64::from(u8::from(self.two_sided))),
                ("OVERLAP".into(), self.overlap.constant()),
            ],
            ..Effect::new(
                "ambient occlusion",
                include_str!("../../wgsl/effects/ambient_occlusion.wgsl"),
            )
        }
    }
}

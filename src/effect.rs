//! What a surfel contributes to a pixel: a small piece of WGSL and what it needs bound.

use std::borrow::Cow;

use crate::gpu::{listing, preprocess::Module};

/// What passes add their modules to, of which some are made for an effect.
pub(crate) type Listing<'a> = listing::Listing<'a, Effect>;

/// How wide an effect's sums are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Channels {
    /// One: `Sum` is `f32`.
    #[default]
    One,
    /// Three: `Sum` is `vec3f`.
    Three,
}

/// An effect: the crate's own ([`AmbientOcclusion`](crate::AmbientOcclusion)) or one of the caller's.
///
/// Its `source` is WGSL that defines three functions over the types of `wgsl/common/effect_types.wgsl`:
///
/// ```wgsl
/// // The world-space distance from a surfel beyond which its contribution to any pixel is below epsilon (> 0).
/// // Proportional to sender.radius.
/// fn max_distance(sender: Sender, epsilon: f32) -> f32
/// // What a surfel adds to a pixel's sum. to_sender points from the pixel to the surfel's centre, world units;
/// // distance2 is its square, which may be 0. Proportional to the surfel's area where it is far.
/// fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> Sum
/// // From the sum over all surfels to what goes into the caller's texture. The sky's sum is 0.
/// fn resolve(sum: Sum, albedo: vec3f) -> vec4f
/// ```
///
/// With [`Effect::own_surface`] it defines a fourth:
///
/// ```wgsl
/// // What a pixel's own surface adds to its sum, where the shading normal and that of the surface have this cosine, 0 to 1.
/// fn own_surface(cosine: f32) -> Sum
/// ```
///
/// `sender` has `radius` and `normal`, and with [`Effect::materials`] `material.albedo`, `material.emission` and
/// `material.double_sided`.
#[derive(Clone, Debug, PartialEq)]
// What an effect needs and does is told apart; no two of them exclude each other.
#[allow(clippy::struct_excessive_bools)]
pub struct Effect {
    /// Appears in the labels of what is made for it.
    pub label: Cow<'static, str>,
    /// The WGSL.
    pub source: Cow<'static, str>,
    /// How wide its sums are.
    pub channels: Channels,
    /// Whether `sender.material` exists. The splatter is then given the material table.
    pub materials: bool,
    /// Whether `albedo` is the G-buffer's; it is 1 otherwise.
    pub albedo: bool,
    /// Whether a surfel contributes behind its back. Where it does not, surfels that face away are never evaluated.
    pub two_sided: bool,
    /// Whether surfels below a pixel's own surface are left out, which a shading normal that leans away from it would see,
    /// and `own_surface` of the source adds what the surface itself does. Its normal is found from the positions around
    /// the pixel: ten texels more are read a pixel and level.
    pub own_surface: bool,
    /// Values for `override` constants of `source`: for all that have none of their own, and for no others.
    pub constants: Vec<(String, f64)>,
}

impl Effect {
    /// The flags that shaders are assembled with.
    pub(crate) fn flags(&self) -> Vec<&'static str> {
        let mut flags = Vec::new();
        if self.channels == Channels::Three {
            flags.push("COLOR");
        }
        if self.materials {
            flags.push("MATERIAL");
        }
        if !self.two_sided {
            flags.push("ONE_SIDED");
        }
        if self.own_surface {
            flags.push("OWN_SURFACE");
        }
        flags
    }

    /// Its code, for the shaders that import it.
    pub(crate) fn module(&self) -> Module<'_> {
        Module {
            name: "effect",
            file: &self.label,
            text: &self.source,
        }
    }

    /// [`crate::Error::Effect`] for constants that its source does not have.
    pub(crate) fn check(&self) -> Result<(), crate::Error> {
        crate::overrides::check_constants(&self.label, &self.source, &self.constants)
    }

    /// The constants as pipelines take them.
    pub(crate) fn overrides(&self) -> Vec<(&str, f64)> {
        self.constants
            .iter()
            .map(|(k, v)| (k.as_str(), *v))
            .collect()
    }

    /// Format of the textures that hold sums: 32 bits, since sums of thousands of terms do not fit into 16.
    pub(crate) fn sum_format(&self) -> wgpu::TextureFormat {
        match self.channels {
            Channels::One => wgpu::TextureFormat::R32Float,
            Channels::Three => wgpu::TextureFormat::Rgba32Float,
        }
    }
}

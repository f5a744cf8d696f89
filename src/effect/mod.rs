//! What a surfel contributes to a pixel: a small piece of WGSL and what it needs bound.

mod joined;

use std::borrow::Cow;

use wgpu::TextureFormat;

use crate::{
    environment::EnvironmentLight,
    error::{Error, check_setting},
    gpu::{
        listing,
        preprocess::Module,
        tokens::{tokens, without_comments},
    },
    receivers::{Frame, plane_bytes},
    texture_slice::TextureSlice,
};

/// What passes add their modules to, of which some are made for an effect.
pub(crate) type Listing<'a> = listing::Listing<'a, Effect>;

/// How many channels a picture has that passes work on after it was resolved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Channels {
    /// One: grey.
    #[default]
    One,
    /// Three: red, green and blue.
    Three,
}

/// An effect: the crate's own ([`AmbientOcclusion`](crate::AmbientOcclusion), [`DiffuseBounce`](crate::DiffuseBounce)), one of
/// the caller's, or [two of them in one](Effect::and).
///
/// Its `source` is WGSL that defines three functions over the types of `wgsl/common/effect_types.wgsl`:
///
/// ```wgsl
/// // The world-space distance from a surfel beyond which its contribution to any pixel is below epsilon (> 0).
/// // Proportional to sender.radius; negative for a surfel that contributes nothing anywhere, which then costs nothing.
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
/// `sender` has `radius` and `normal`, and `share`, how many surfels near it it stands for on the level that it is splatted
/// on, 4^l on level l: the sum of theirs is that many times its own contribution. With [`Effect::materials`] it has
/// `material.albedo`, `material.emission` and `material.double_sided`, and with [`Effect::radiance`] `front` and `back`, what
/// the surfel sends from each side, in W/(m² sr); `back` is 0 unless the effect is two-sided.
///
/// With [`Effect::normal`], [`Effect::view`] or [`Effect::roughness`] `contribution` and the outputs take one argument more, the
/// last, `receiver: Receiver`: what is known of the pixel. It has `normal`, the unit shading normal, and what else was asked for,
/// `to_eye`, the unit vector to where it is seen from, and `roughness`, 0 to 1. For the sky, of which outputs make a picture too,
/// all of it is 0.
///
/// With [`Effect::environment`] they may call `environment_mean(direction: vec3f, solid_angle: f32) -> vec3f`, the mean
/// radiance of about a solid angle (sr) about a direction, and `environment_irradiance_at(normal: vec3f) -> vec3f`, what a
/// surface has of all of it, W/m².
///
/// `Sum` is `f32` for one channel, `vec2f`, `vec3f` or `vec4f` for two to four, and `mat2x4f` for five to eight: two columns of
/// four channels, of which those that are too many stay 0.
#[derive(Clone, Debug, PartialEq)]
// What an effect needs and does is told apart; no two of them exclude each other.
#[allow(clippy::struct_excessive_bools)]
pub struct Effect {
    /// Appears in the labels of what is made for it.
    pub label: Cow<'static, str>,
    /// The WGSL.
    pub source: Cow<'static, str>,
    /// How many channels its sums have, 1 to 8.
    pub channels: u32,
    /// Names of the functions of `source` that make pictures of a sum, one or more; most effects have one, `resolve`. Each
    /// takes and returns what `resolve` does, and has a target of its own.
    pub outputs: Vec<Cow<'static, str>>,
    /// Whether `sender.material` exists. The splatter is then given the material table.
    pub materials: bool,
    /// Whether `sender.front` and `sender.back` exist. The splatter is then given the surfels' radiance.
    pub radiance: bool,
    /// Whether `albedo` is the G-buffer's; it is 1 otherwise.
    pub albedo: bool,
    /// Whether `receiver` is given, with its `normal`.
    pub normal: bool,
    /// Whether `receiver` is given, with its `to_eye` too.
    pub view: bool,
    /// Whether `receiver` is given, with its `roughness` too, which is the G-buffer's.
    pub roughness: bool,
    /// Whether there is an [`Environment`](crate::Environment) to call for. Splatter and reconstructor are then given it.
    pub environment: bool,
    /// Whether a surfel contributes behind its back. Where it does not, surfels that face away are never evaluated.
    pub two_sided: bool,
    /// Whether surfels below a pixel's own surface are left out, which a shading normal that leans away from it would see,
    /// and `own_surface` of the source adds what the surface itself does. Its normal is found from the positions around
    /// the pixel: ten texels more are read a pixel and level.
    pub own_surface: bool,
    /// Values for `override` constants of `source`: for all that have none of their own, and for no others.
    pub constants: Vec<(String, f64)>,
}

/// How an effect's sums are kept: for each level so many layers of a texture, each with up to four channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SumPlanes {
    /// 32 bits, since sums of thousands of terms do not fit into 16.
    pub format: TextureFormat,
    pub count: u32,
}

impl SumPlanes {
    /// Of sums of a size, for so many levels.
    pub fn bytes(self, size: [u32; 2], levels: u32) -> u64 {
        plane_bytes(self.format, size, levels * self.count)
    }
}

/// The last argument of functions that take it, as they declare it and as they are called.
fn receiver_argument(taken: bool) -> [&'static str; 2] {
    if taken {
        [", receiver: Receiver", ", receiver"]
    } else {
        [""; 2]
    }
}

impl Effect {
    /// The most channels that its sums can have.
    pub const MAX_CHANNELS: u32 = 8;

    /// One of one channel and one output, `resolve`, that is given nothing besides and contributes before its surfels' fronts
    /// alone.
    pub fn new(label: impl Into<Cow<'static, str>>, source: impl Into<Cow<'static, str>>) -> Self {
        Self {
            label: label.into(),
            source: source.into(),
            channels: 1,
            outputs: vec!["resolve".into()],
            materials: false,
            radiance: false,
            albedo: false,
            normal: false,
            view: false,
            roughness: false,
            environment: false,
            two_sided: false,
            own_surface: false,
            constants: Vec::new(),
        }
    }

    /// The flags that shaders are assembled with.
    pub(crate) fn flags(&self) -> Vec<&'static str> {
        let mut flags = Vec::new();
        flags.extend(match self.channels {
            0 | 1 => None,
            2 => Some("PAIR"),
            3 => Some("COLOR"),
            4 => Some("QUAD"),
            _ => Some("OCTET"),
        });
        flags.extend(self.materials.then_some("MATERIAL"));
        flags.extend(self.radiance.then_some("RADIANCE"));
        flags.extend(self.receiver().then_some("RECEIVER"));
        flags.extend(self.view.then_some("VIEW"));
        flags.extend(self.roughness.then_some("ROUGHNESS"));
        flags.extend(self.environment.then_some("ENVIRONMENT"));
        flags.extend((!self.two_sided).then_some("ONE_SIDED"));
        flags.extend(self.own_surface.then_some("OWN_SURFACE"));
        flags
    }

    /// Whether its functions are told of the pixel.
    pub(crate) fn receiver(&self) -> bool {
        self.normal || self.view || self.roughness
    }

    /// The environment, where it asks for one; [`Error::Mismatch`] where there is none, or one without levels.
    pub(crate) fn environment_of<'e>(
        &self,
        name: &'static str,
        given: Option<EnvironmentLight<'e>>,
    ) -> Result<Option<EnvironmentLight<'e>>, Error> {
        if !self.environment {
            return Ok(None);
        }
        let needed = format!("one with levels, for the effect {}", self.label);
        let Some(light) = given else {
            let found = "none".into();
            return Err(Error::Mismatch {
                name,
                found,
                needed,
            });
        };
        light.validate()?;
        if light.environment.levels() < 2 {
            let found = "one without levels".into();
            return Err(Error::Mismatch {
                name,
                found,
                needed,
            });
        }
        Ok(Some(light))
    }

    /// The frame's roughness, where it asks for it; [`Error::Mismatch`] where there is none.
    pub(crate) fn roughness_of<'f>(
        &self,
        frame: &Frame<'f>,
    ) -> Result<Option<TextureSlice<'f>>, Error> {
        let by = || format!("the effect {}", self.label);
        let found = self.roughness.then(|| frame.gbuffer.roughness_for(&by()));
        found.transpose()
    }

    /// Its code, for the shaders that import it.
    pub(crate) fn module(&self) -> Module<'_> {
        Module {
            name: "effect",
            file: &self.label,
            text: &self.source,
        }
    }

    /// What `resolved()` of the reconstructor is for one of its outputs.
    pub(crate) fn resolved(&self, output: usize) -> String {
        let name = self.outputs.get(output).map_or("resolve", Cow::as_ref);
        let [declared, passed] = receiver_argument(self.receiver());
        format!(
            "fn resolved(sum: Sum, albedo: vec3f{declared}) -> vec4f {{\n  return {name}(sum, albedo{passed});\n}}\n"
        )
    }

    /// [`Error::Setting`] for a number of channels out of range, and [`Error::Effect`] for outputs and constants that its source
    /// does not have.
    pub(crate) fn check(&self) -> Result<(), Error> {
        check_setting(
            (1..=Self::MAX_CHANNELS).contains(&self.channels),
            "Effect::channels",
            self.channels,
            "1 to 8",
        )?;
        let bad = |problem| {
            let label = self.label.clone().into_owned();
            Err(Error::Effect { label, problem })
        };
        if self.outputs.is_empty() {
            return bad("has no output; needed is one at least".into());
        }
        let source = without_comments(&self.source);
        let tokens = tokens(&source);
        let is_function = |name: &str| tokens.windows(2).any(|pair| pair == ["fn", name]);
        if let Some(name) = self.outputs.iter().find(|name| !is_function(name)) {
            return bad(format!("has no function {name}, which is to be an output"));
        }
        crate::overrides::check_constants(&self.label, &self.source, &self.constants)
    }

    /// The constants as pipelines take them.
    pub(crate) fn overrides(&self) -> Vec<(&str, f64)> {
        self.constants
            .iter()
            .map(|(k, v)| (k.as_str(), *v))
            .collect()
    }

    /// How its sums are kept.
    pub(crate) fn sums(&self) -> SumPlanes {
        SumPlanes {
            format: match self.channels {
                0 | 1 => TextureFormat::R32Float,
                2 => TextureFormat::Rg32Float,
                _ => TextureFormat::Rgba32Float,
            },
            count: self.channels.div_ceil(4).max(1),
        }
    }
}

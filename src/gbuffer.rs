//! The caller's G-buffer: borrowed textures, how they are encoded, and the checks that they fit.

use wgpu::{TextureFormat as Format, TextureUsages};

use crate::{
    camera::Viewport,
    error::Error,
    texture_slice::{Read, TextureSlice, check_slice},
};

/// How the three components of a normal are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum NormalEncoding {
    /// xyz as they are, in −1…1: float and snorm formats.
    #[default]
    Signed,
    /// xyz mapped to 0…1: unorm formats, `n = 2 v − 1`.
    Unsigned,
    /// Octahedral in two components −1…1 (Cigolle et al., *A Survey of Efficient Representations for Independent
    /// Unit Vectors*, 2014): float and snorm formats.
    Octahedral,
    /// Octahedral mapped to 0…1: unorm formats.
    OctahedralUnsigned,
}

/// The axes that normals are given in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum NormalSpace {
    /// World axes.
    #[default]
    World,
    /// The camera's view axes.
    View,
}

/// The caller's G-buffer. Each texture covers the camera's viewport; they need not be of one size.
///
/// Pixels are read within the camera's viewport only. A normal that is zero, not finite or too short to normalise is
/// taken to face the eye; any other length is normalised away.
#[derive(Clone, Copy, Debug)]
pub struct GBuffer<'a> {
    /// The depth that the camera's projection produced: a depth format, or `R32Float` with the same values. Of a format
    /// with stencil the depth is read. Usage `TEXTURE_BINDING`.
    pub depth: TextureSlice<'a>,
    /// Shading normals, in any float, snorm or unorm format with the components that the encoding needs. Usage
    /// `TEXTURE_BINDING`.
    pub normal: TextureSlice<'a>,
    /// How normals are stored.
    pub normal_encoding: NormalEncoding,
    /// The axes of the normals.
    pub normal_space: NormalSpace,
    /// Diffuse albedo (linear, 0…1), for effects that ask for it with [`Effect::albedo`](crate::Effect::albedo). What is beyond
    /// 0…1 is clamped, and what is not finite counts as 0. Any float or unorm format, usage `TEXTURE_BINDING`.
    pub albedo: Option<TextureSlice<'a>>,
    /// Perceptual roughness, for glossy rays ([`Sampling::Glossy`](crate::Sampling::Glossy)), the glossy hull and effects
    /// that ask for it with [`Effect::roughness`](crate::Effect::roughness): 0 for a mirror to 1, its square being the width
    /// α of the Trowbridge-Reitz distribution. The red channel of any float or unorm format, usage `TEXTURE_BINDING`. Values
    /// beyond 0…1 are clamped, NaN counts as 1; α is at least 1e-3, below which `f32` cannot tell a lobe's directions apart.
    /// A shading normal that faces away from the viewer is seen from just above its horizon.
    pub roughness: Option<TextureSlice<'a>>,
}

impl<'a> GBuffer<'a> {
    /// Depth and normals, those as they are in world axes; the rest is absent.
    pub fn new(depth: impl Into<TextureSlice<'a>>, normal: impl Into<TextureSlice<'a>>) -> Self {
        Self {
            depth: depth.into(),
            normal: normal.into(),
            normal_encoding: NormalEncoding::default(),
            normal_space: NormalSpace::default(),
            albedo: None,
            roughness: None,
        }
    }

    /// Checks formats, sizes and usages against the rectangle that will be read.
    ///
    /// # Errors
    /// [`Error::Format`], [`Error::Usage`], [`Error::Shape`] or [`Error::Size`], naming the texture.
    pub fn validate(&self, viewport: Viewport) -> Result<(), Error> {
        check_depth("GBuffer::depth", &self.depth, viewport)?;
        self.normals().check("GBuffer::normal", viewport)?;
        if let Some(roughness) = &self.roughness {
            check_roughness(roughness, viewport)?;
        }
        if let Some(albedo) = &self.albedo {
            check_slice(
                "GBuffer::albedo",
                albedo,
                viewport,
                TextureUsages::TEXTURE_BINDING,
            )?;
            let format = albedo.view_format();
            if !samples_as_float(format) || format.components() < 3 {
                return Err(Error::Format {
                    name: "GBuffer::albedo",
                    format,
                    accepted: "a float or unorm format with three components or more",
                });
            }
        }
        Ok(())
    }

    /// Its normals, for passes that can do without.
    pub fn normals(&self) -> Normals<'_> {
        Normals {
            texture: self.normal,
            encoding: self.normal_encoding,
            space: self.normal_space,
        }
    }

    /// Its albedo, for what `by` says; [`Error::Mismatch`] where there is none.
    pub(crate) fn albedo_for(&self, by: &str) -> Result<TextureSlice<'a>, Error> {
        needed("GBuffer::albedo", self.albedo, by)
    }

    /// Its roughness, as [`GBuffer::albedo_for`].
    pub(crate) fn roughness_for(&self, by: &str) -> Result<TextureSlice<'a>, Error> {
        needed("GBuffer::roughness", self.roughness, by)
    }

    pub(crate) fn depth_step(&self) -> f32 {
        depth_step(self.depth.view_format())
    }

    /// What passes may read of it.
    pub(crate) fn reads(&self) -> impl Iterator<Item = Read<'_>> {
        [
            Some(("GBuffer::depth", self.depth, 1)),
            Some(("GBuffer::normal", self.normal, 1)),
            self.albedo.map(|albedo| ("GBuffer::albedo", albedo, 1)),
            self.roughness
                .map(|roughness| ("GBuffer::roughness", roughness, 1)),
        ]
        .into_iter()
        .flatten()
    }
}

/// The normals of a [`GBuffer`] alone, for passes that can do without.
#[derive(Clone, Copy, Debug)]
pub struct Normals<'a> {
    /// As [`GBuffer::normal`].
    pub texture: TextureSlice<'a>,
    /// How they are stored.
    pub encoding: NormalEncoding,
    /// Their axes.
    pub space: NormalSpace,
}

impl Normals<'_> {
    pub(crate) fn check(&self, name: &'static str, viewport: Viewport) -> Result<(), Error> {
        check_slice(
            name,
            &self.texture,
            viewport,
            TextureUsages::TEXTURE_BINDING,
        )?;
        let format = self.texture.view_format();
        let components = format.components();
        let (ok, accepted) = match self.encoding {
            NormalEncoding::Signed => (
                components >= 3 && (is_snorm(format) || is_float(format)),
                "a float or snorm format with three components or more",
            ),
            NormalEncoding::Unsigned => (
                components >= 3 && !is_snorm(format),
                "a unorm or float format with three components or more",
            ),
            NormalEncoding::Octahedral => (
                components >= 2 && (is_snorm(format) || is_float(format)),
                "a float or snorm format with two components or more",
            ),
            NormalEncoding::OctahedralUnsigned => (
                components >= 2 && !is_snorm(format),
                "a unorm or float format with two components or more",
            ),
        };
        if !ok || !samples_as_float(format) || format.is_srgb() {
            return Err(Error::Format {
                name,
                format,
                accepted,
            });
        }
        Ok(())
    }

    /// As `decode_normal` of `wgsl/common/gbuffer.wgsl` takes it.
    pub(crate) fn params(&self) -> [u32; 2] {
        let encoding = match self.encoding {
            NormalEncoding::Signed => 0,
            NormalEncoding::Unsigned => 1,
            NormalEncoding::Octahedral => 2,
            NormalEncoding::OctahedralUnsigned => 3,
        };
        [encoding, u32::from(self.space == NormalSpace::View)]
    }
}

/// Checks a depth buffer that covers the viewport.
pub(crate) fn check_depth(
    name: &'static str,
    depth: &TextureSlice<'_>,
    viewport: Viewport,
) -> Result<(), Error> {
    check_slice(name, depth, viewport, TextureUsages::TEXTURE_BINDING)?;
    let format = depth.view_format();
    if !(format.has_depth_aspect() || format == Format::R32Float) {
        return Err(Error::Format {
            name,
            format,
            accepted: "a depth format or R32Float",
        });
    }
    Ok(())
}

/// How far a stored depth may lie from the true one: half a step of its format. `R32Float` and `Depth32Float` round
/// relative to the value instead, which the shader adds itself.
pub(crate) fn depth_step(format: Format) -> f32 {
    match format {
        Format::Depth16Unorm => 0.5 / 65535.0,
        Format::Depth24Plus | Format::Depth24PlusStencil8 => 0.5 / 16_777_215.0,
        _ => 0.0,
    }
}

fn needed<'a>(
    name: &'static str,
    slice: Option<TextureSlice<'a>>,
    by: &str,
) -> Result<TextureSlice<'a>, Error> {
    slice.ok_or_else(|| Error::Mismatch {
        name,
        found: "none".into(),
        needed: format!("one, for {by}"),
    })
}

fn check_roughness(slice: &TextureSlice<'_>, viewport: Viewport) -> Result<(), Error> {
    const NAME: &str = "GBuffer::roughness";
    check_slice(NAME, slice, viewport, TextureUsages::TEXTURE_BINDING)?;
    let format = slice.view_format();
    if !samples_as_float(format) || is_snorm(format) {
        return Err(Error::Format {
            name: NAME,
            format,
            accepted: "a float or unorm format",
        });
    }
    Ok(())
}

pub(crate) fn samples_as_float(format: Format) -> bool {
    !format.has_depth_aspect()
        && !format.has_stencil_aspect()
        && matches!(
            format.sample_type(None, None),
            Some(wgpu::TextureSampleType::Float { .. })
        )
}

fn is_snorm(format: Format) -> bool {
    matches!(
        format,
        Format::R8Snorm
            | Format::Rg8Snorm
            | Format::Rgba8Snorm
            | Format::R16Snorm
            | Format::Rg16Snorm
            | Format::Rgba16Snorm
            | Format::Bc4RSnorm
            | Format::Bc5RgSnorm
            | Format::EacR11Snorm
            | Format::EacRg11Snorm
    )
}

fn is_float(format: Format) -> bool {
    matches!(
        format,
        Format::Rg16Float | Format::Rgba16Float | Format::Rg32Float | Format::Rgba32Float
    )
}

//! Textures of the caller's: which part of one a pass reads or writes, and the views that the crate makes of it.

use wgpu::{
    Texture, TextureAspect, TextureDimension, TextureFormat as Format, TextureUsages, TextureView,
    TextureViewDescriptor, TextureViewDimension,
};

use crate::{camera::Viewport, error::Error, made};

/// A part of a texture of the caller's: one layer of one mip level. `(&texture).into()` is its first, which is all of a plain
/// 2-D texture, and of a swap chain's.
///
/// Passes take this in place of a [`TextureView`], since a view does not tell what it is of. They make the view that
/// they need: of the depth aspect where a format has a stencil too, of the one layer of an array or the one face of a cube, and
/// with the one usage that they have for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TextureSlice<'a> {
    /// A 2-D texture (arrays and cubes are 2-D textures with layers), one sample per pixel.
    pub texture: &'a Texture,
    /// The mip level, 0 for the whole size. Sizes that passes ask for are those of this level.
    pub mip: u32,
    /// The layer of an array, or the face of a cube. Of a shadow map it is the layer of the first camera.
    pub layer: u32,
    /// The format that it is seen in, `None` for the texture's own: the same with or without sRGB, if it is among the texture's
    /// `view_formats`. Those alone wgpu does not tell: a format that is not among them is a validation error of its own.
    pub format: Option<Format>,
}

impl<'a> From<&'a Texture> for TextureSlice<'a> {
    fn from(texture: &'a Texture) -> Self {
        Self::new(texture)
    }
}

impl<'a> TextureSlice<'a> {
    /// The first layer of the first mip level.
    pub const fn new(texture: &'a Texture) -> Self {
        Self {
            texture,
            mip: 0,
            layer: 0,
            format: None,
        }
    }

    /// The same of another mip level.
    #[must_use]
    pub const fn mip(self, mip: u32) -> Self {
        Self { mip, ..self }
    }

    /// The same of another layer.
    #[must_use]
    pub const fn layer(self, layer: u32) -> Self {
        Self { layer, ..self }
    }

    /// The same seen in another format.
    #[must_use]
    pub const fn seen_as(self, format: Format) -> Self {
        Self {
            format: Some(format),
            ..self
        }
    }

    /// The format that it is seen in.
    pub fn view_format(&self) -> Format {
        self.format.unwrap_or(self.texture.format())
    }

    /// Width and height of its mip level.
    pub fn size(&self) -> [u32; 2] {
        let shrink = |side: u32| side.checked_shr(self.mip).unwrap_or(0).max(1);
        [self.texture.width(), self.texture.height()].map(shrink)
    }

    /// A view for one use.
    pub(crate) fn view(&self, usage: TextureUsages) -> TextureView {
        self.view_of(usage, TextureViewDimension::D2, 1)
    }

    /// A view for reading in shaders.
    pub(crate) fn read(&self) -> TextureView {
        self.view(TextureUsages::TEXTURE_BINDING)
    }

    /// A view of several layers, for reading in shaders.
    pub(crate) fn read_layers(&self, layers: u32) -> TextureView {
        self.view_of(
            TextureUsages::TEXTURE_BINDING,
            TextureViewDimension::D2Array,
            layers,
        )
    }

    fn view_of(
        &self,
        usage: TextureUsages,
        dimension: TextureViewDimension,
        layers: u32,
    ) -> TextureView {
        let aspect = if self.texture.format().has_depth_aspect() {
            TextureAspect::DepthOnly
        } else {
            TextureAspect::All
        };
        made::count(made::Kind::TextureView);
        self.texture.create_view(&TextureViewDescriptor {
            label: Some("deep-screen-space view"),
            format: self.format,
            dimension: Some(dimension),
            usage: Some(usage),
            aspect,
            base_mip_level: self.mip,
            mip_level_count: Some(1),
            base_array_layer: self.layer,
            array_layer_count: Some(layers),
        })
    }

    /// Whether the two share texels, where this one has so many layers.
    fn shares(&self, layers: u32, other: &TextureSlice<'_>) -> bool {
        self.texture == other.texture
            && self.mip == other.mip
            && (self.layer..self.layer + layers).contains(&other.layer)
    }
}

/// Checks that a slice is there, has one sample per pixel and a usage, and covers a viewport.
pub(crate) fn check_slice(
    name: &'static str,
    slice: &TextureSlice<'_>,
    viewport: Viewport,
    needed: TextureUsages,
) -> Result<(), Error> {
    check_layers(name, slice, 1, needed)?;
    let (size, needed) = (slice.size(), viewport.end());
    if size[0] < needed[0] || size[1] < needed[1] {
        return Err(Error::Size { name, size, needed });
    }
    Ok(())
}

/// Checks that so many layers from a slice on are there, have one sample per pixel and a usage.
pub(crate) fn check_layers(
    name: &'static str,
    slice: &TextureSlice<'_>,
    layers: u32,
    needed: TextureUsages,
) -> Result<(), Error> {
    let texture = slice.texture;
    let shape = |found, needed| {
        Err(Error::Shape {
            name,
            found,
            needed,
        })
    };
    if texture.dimension() != TextureDimension::D2 || texture.sample_count() != 1 {
        return shape(
            format!(
                "dimension {:?}, {} samples per pixel",
                texture.dimension(),
                texture.sample_count()
            ),
            "a 2-D texture with one sample per pixel (draw one without multisampling, or resolve it)",
        );
    }
    if slice.mip >= texture.mip_level_count() {
        return shape(
            format!("mip level {} of {}", slice.mip, texture.mip_level_count()),
            "a mip level that the texture has",
        );
    }
    let end = slice.layer.checked_add(layers);
    if end.is_none_or(|end| end > texture.depth_or_array_layers()) {
        return shape(
            format!(
                "{layers} layers from {} on, of {}",
                slice.layer,
                texture.depth_or_array_layers()
            ),
            "layers that the texture has",
        );
    }
    let format = slice.view_format();
    if format.remove_srgb_suffix() != texture.format().remove_srgb_suffix() {
        return Err(Error::Format {
            name,
            format,
            accepted: "the texture's own format, with or without sRGB",
        });
    }
    if !texture.usage().contains(needed) {
        return Err(Error::Usage {
            name,
            usage: texture.usage(),
            needed,
        });
    }
    Ok(())
}

/// A texture that a pass reads: its name, the slice, and how many layers of it.
pub(crate) type Read<'a> = (&'static str, TextureSlice<'a>, u32);

/// [`Error::Mismatch`] for a target that is one of the inputs too.
pub(crate) fn check_apart<'a>(
    name: &'static str,
    target: &TextureSlice<'_>,
    inputs: impl IntoIterator<Item = Read<'a>>,
) -> Result<(), Error> {
    for (input, slice, layers) in inputs {
        if slice.shares(layers, target) {
            return Err(Error::Mismatch {
                name,
                found: format!("that of {input}"),
                needed: "a texture of its own, or another mip level or layer".into(),
            });
        }
    }
    Ok(())
}

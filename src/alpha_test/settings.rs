//! Which triangles have holes, and the pictures of them that are the caller's.

use wgpu::{Buffer, Device, TextureUsages};

use crate::{
    error::{Error, check_setting},
    geometry::{Mesh, check_layout},
    texture_slice::{TextureSlice, check_layers},
};

/// How texture coordinates are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum TexCoordFormat {
    /// Two f32 (8 bytes).
    #[default]
    Float32x2,
    /// Two f16 (4 bytes).
    Float16x2,
    /// Two numbers of 16 bits that stand for 0 to 1 (4 bytes).
    Unorm16x2,
}

impl TexCoordFormat {
    pub(crate) const fn bytes(self) -> u64 {
        match self {
            Self::Float32x2 => 8,
            Self::Float16x2 | Self::Unorm16x2 => 4,
        }
    }

    /// As in `wgsl/common/cutout.wgsl`.
    pub(crate) const fn code(self) -> u32 {
        match self {
            Self::Float32x2 => 0,
            Self::Float16x2 => 1,
            Self::Unorm16x2 => 2,
        }
    }
}

/// Texture coordinates in one of the caller's buffers (usage `STORAGE`), one pair for each of the mesh's
/// [vertices](crate::Vertices::count). (0, 0) is the corner of the first texel, (1, 1) that of the last.
#[derive(Clone, Copy, Debug)]
pub struct TexCoords<'a> {
    /// The buffer, which may be that of the positions.
    pub buffer: &'a Buffer,
    /// Byte offset of the first vertex's coordinates, a multiple of 4.
    pub offset: u64,
    /// Bytes from one vertex to the next, a multiple of 4.
    pub stride: u32,
    /// How they are stored.
    pub format: TexCoordFormat,
}

/// What is read where texture coordinates leave 0…1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum AlphaWrap {
    /// The picture again.
    #[default]
    Repeat,
    /// The texel at the edge.
    ClampToEdge,
    /// The picture mirrored, by turns.
    MirrorRepeat,
}

impl AlphaWrap {
    /// As in `wgsl/common/cutout.wgsl`.
    const fn code(self) -> u32 {
        match self {
            Self::Repeat => 0,
            Self::ClampToEdge => 1,
            Self::MirrorRepeat => 2,
        }
    }
}

/// Which channel of a texture is alpha.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum AlphaChannel {
    /// Red: of textures that hold alpha alone.
    Red,
    /// Green.
    Green,
    /// Blue.
    Blue,
    /// Alpha, of colours that have it.
    #[default]
    Alpha,
}

impl AlphaChannel {
    const fn code(self) -> u32 {
        match self {
            Self::Red => 0,
            Self::Green => 1,
            Self::Blue => 2,
            Self::Alpha => 3,
        }
    }
}

/// Where the triangles of a mesh are: where alpha, interpolated between four texels, is at least the threshold.
#[derive(Clone, Copy, Debug)]
pub struct AlphaTest<'a> {
    /// Texture coordinates of the mesh's vertices. A triangle of which one is not finite has no holes.
    pub tex_coords: TexCoords<'a>,
    /// Which layer of [`AlphaTests::maps`], 0 to 16383.
    pub layer: u32,
    /// The least alpha that is there, 0…1; 0 is a mesh without holes. A material's cut-off, divided by the alpha that its
    /// texture is multiplied by.
    pub threshold: f32,
    /// What is beyond the picture, along either coordinate.
    pub wrap: [AlphaWrap; 2],
}

/// The holes of a scene's triangles: for rays, with [`Primitives::AlphaTested`](crate::Primitives::AlphaTested) and
/// [`Primitives::AlphaTestedInstances`](crate::Primitives::AlphaTestedInstances), and for the surfels of splats, by
/// [`SurfelHoles`](crate::SurfelHoles).
#[derive(Clone, Copy, Debug)]
pub struct AlphaTests<'a> {
    /// An array of pictures of one size, one per [layer](AlphaTest::layer) from the slice's own layer on; the slice's mip level
    /// is the one that is read. Any 2-D texture of floats, filterable or not. Alpha counts within 0…1, what is not a number as 0.
    pub maps: TextureSlice<'a>,
    /// Which channel is alpha.
    pub channel: AlphaChannel,
    /// For each of the geometry's meshes its test, if it has one; meshes beyond the list have none.
    pub meshes: &'a [Option<AlphaTest<'a>>],
}

/// Layers that a test can name: 14 bits.
const MOST_LAYERS: u32 = 1 << 14;

impl<'a> AlphaTests<'a> {
    /// The test of a mesh.
    pub(crate) fn of(&self, mesh: usize) -> Option<&AlphaTest<'a>> {
        self.meshes.get(mesh)?.as_ref()
    }

    /// How many layers there are.
    pub(crate) fn layers(&self) -> u32 {
        let all = self.maps.texture.depth_or_array_layers();
        all.saturating_sub(self.maps.layer).min(MOST_LAYERS)
    }

    /// What a shader is told of a mesh's pictures: as in `wgsl/common/cutout.wgsl`.
    pub(crate) fn map(&self, test: &AlphaTest<'_>) -> u32 {
        let [u, v] = test.wrap.map(AlphaWrap::code);
        test.layer | (u << 14) | (v << 16) | (self.channel.code() << 18)
    }

    /// Checks the pictures, and the tests against the meshes that they are of.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::Usage`] or [`Error::Format`] for the pictures; [`Error::Setting`] for a threshold, a layer or a
    /// list that is out of range; [`Error::Buffer`] for texture coordinates, naming what is wrong.
    pub fn validate(&self, device: &Device, meshes: &[Mesh<'_>]) -> Result<(), Error> {
        const MAPS: &str = "AlphaTests::maps";
        let layers = self.layers().max(1);
        check_layers(MAPS, &self.maps, layers, TextureUsages::TEXTURE_BINDING)?;
        let format = self.maps.view_format();
        let sample = format.sample_type(None, Some(device.features()));
        let is_float = matches!(sample, Some(wgpu::TextureSampleType::Float { .. }));
        if format.has_depth_aspect() || !is_float {
            return Err(Error::Format {
                name: MAPS,
                format,
                accepted: "colour formats of floats",
            });
        }
        if u32::from(format.components()) <= self.channel.code() {
            return Err(Error::Format {
                name: MAPS,
                format,
                accepted: "formats that have the AlphaTests::channel",
            });
        }
        check_setting(
            self.meshes.len() <= meshes.len(),
            "AlphaTests::meshes",
            self.meshes.len() as f64,
            "at most as many as the geometry has meshes",
        )?;
        for (test, mesh) in self.meshes.iter().zip(meshes) {
            if let Some(test) = test {
                test.validate(layers, mesh)?;
            }
        }
        Ok(())
    }
}

impl AlphaTest<'_> {
    fn validate(&self, layers: u32, mesh: &Mesh<'_>) -> Result<(), Error> {
        check_setting(
            (0.0..=1.0).contains(&self.threshold),
            "AlphaTest::threshold",
            self.threshold,
            "0 to 1",
        )?;
        check_setting(
            self.layer < layers,
            "AlphaTest::layer",
            self.layer,
            "layers that AlphaTests::maps has, up to 16383",
        )?;
        let TexCoords {
            buffer,
            offset,
            stride,
            format,
        } = self.tex_coords;
        check_layout(
            "AlphaTest::tex_coords",
            buffer,
            offset,
            stride,
            format.bytes(),
            mesh.vertices.count,
        )
    }
}

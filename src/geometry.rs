//! The caller's triangles: buffers described by offset, stride and format, never copied.

use wgpu::{Buffer, BufferUsages, VertexFormat};

use crate::error::Error;

/// How a position is stored in the vertex buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum PositionFormat {
    /// Three f32 (12 bytes).
    #[default]
    Float32x3,
    /// Four f16, the last one ignored (8 bytes).
    Float16x4,
}

impl PositionFormat {
    const fn bytes(self) -> u64 {
        match self {
            Self::Float32x3 => 12,
            Self::Float16x4 => 8,
        }
    }
}

/// Of the format by which a vertex shader reads positions.
impl TryFrom<VertexFormat> for PositionFormat {
    type Error = Error;

    /// # Errors
    /// [`Error::Buffer`] for compressed positions, which only the engine's own shader can decode, and for two coordinates.
    fn try_from(format: VertexFormat) -> Result<Self, Error> {
        match format {
            // The fourth is not read.
            VertexFormat::Float32x3 | VertexFormat::Float32x4 => Ok(Self::Float32x3),
            VertexFormat::Float16x4 => Ok(Self::Float16x4),
            _ => Err(Error::Buffer {
                name: "Mesh::vertices",
                found: format!("positions of format {format:?}"),
                needed: "Float32x3, Float32x4 or Float16x4 (have a mesh uploaded without compression, or decode its positions \
                         into a buffer of their own)"
                    .into(),
            }),
        }
    }
}

/// Positions in one of the caller's buffers (usage `STORAGE`, beside `VERTEX` as the caller likes).
///
/// They are read where they are, as they are when the GPU runs the recording. Skinned and morphed vertices are thus those of the
/// current frame if what writes the buffer comes before, earlier in the same encoder or in a submission before it. Hierarchies
/// over all instances and surfels are made of them each time; of an [`InstancedBvh`](crate::InstancedBvh)
/// [`ChangedMeshes`](crate::ChangedMeshes) says which meshes are.
#[derive(Clone, Copy, Debug)]
pub struct Vertices<'a> {
    /// The buffer.
    pub buffer: &'a Buffer,
    /// Byte offset of the first vertex's position, a multiple of 4.
    pub offset: u64,
    /// Bytes from one vertex to the next, a multiple of 4.
    pub stride: u32,
    /// How positions are stored.
    pub format: PositionFormat,
    /// How many vertices there are. An index that gives, with the base vertex, none of them drops its triangle and
    /// counts it as rejected.
    pub count: u32,
}

/// The width of an index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IndexFormat {
    /// 16 bits.
    Uint16,
    /// 32 bits.
    Uint32,
}

/// Of the format by which an engine draws.
impl From<wgpu::IndexFormat> for IndexFormat {
    fn from(format: wgpu::IndexFormat) -> Self {
        match format {
            wgpu::IndexFormat::Uint16 => Self::Uint16,
            wgpu::IndexFormat::Uint32 => Self::Uint32,
        }
    }
}

/// Indices in one of the caller's buffers (usage `STORAGE`, beside `INDEX`).
#[derive(Clone, Copy, Debug)]
pub struct Indices<'a> {
    /// The buffer.
    pub buffer: &'a Buffer,
    /// Byte offset of index 0, a multiple of the index's size. The buffer goes on to the multiple of 4 bytes that
    /// follows the draw's last index.
    pub offset: u64,
    /// The width of an index.
    pub format: IndexFormat,
}

/// How an instance's transform is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransformFormat {
    /// A column-major 4×4 f32 matrix (64 bytes), its last row taken as (0, 0, 0, 1).
    Mat4,
    /// The upper three rows of it, row-major (48 bytes).
    Rows3x4,
}

/// Instance transforms, object to world, in one of the caller's buffers (usage `STORAGE`).
#[derive(Clone, Copy, Debug)]
pub struct Instances<'a> {
    /// The buffer.
    pub buffer: &'a Buffer,
    /// Byte offset of instance 0's transform, a multiple of 4.
    pub offset: u64,
    /// Bytes from one instance to the next, a multiple of 4.
    pub stride: u32,
    /// How a transform is stored.
    pub format: TransformFormat,
    /// How many instances there are. 0 is valid: nothing is drawn.
    pub count: u32,
}

/// A draw of triangles. Front faces wind counter-clockwise seen from the side that their normal points to, before a
/// mirroring transform: what is mirrored keeps its front. Rays meet either side of all triangles; which side shines is
/// [`Material::double_sided`]'s to say.
#[derive(Clone, Copy, Debug)]
pub struct Mesh<'a> {
    /// Where its positions are.
    pub vertices: Vertices<'a>,
    /// Where its indices are; `None` takes vertices in order.
    pub indices: Option<Indices<'a>>,
    /// The first index, or the first vertex without indices.
    pub first: u32,
    /// How many indices (or vertices); a remainder of an incomplete triangle is ignored.
    pub count: u32,
    /// Added to every index.
    pub base_vertex: i32,
    /// Where its transforms are; `None` is one instance, already in world space.
    pub instances: Option<Instances<'a>>,
    /// Index into the material table, for effects that ask for
    /// [`Effect::materials`](crate::Effect::materials).
    pub material: u32,
}

impl Mesh<'_> {
    /// Triangles of one instance.
    pub(crate) fn triangles(&self) -> u32 {
        self.count / 3
    }

    pub(crate) fn instance_count(&self) -> u32 {
        self.instances.map_or(1, |i| i.count)
    }

    /// Checks offsets, strides, usages and sizes.
    ///
    /// # Errors
    /// [`Error::Buffer`], naming the buffer.
    pub fn validate(&self) -> Result<(), Error> {
        let vertices = &self.vertices;
        check_layout(
            "Mesh::vertices",
            vertices.buffer,
            vertices.offset,
            vertices.stride,
            vertices.format.bytes(),
            vertices.count,
        )?;
        if let Some(indices) = &self.indices {
            let size = match indices.format {
                IndexFormat::Uint16 => 2,
                IndexFormat::Uint32 => 4,
            };
            check_usage("Mesh::indices", indices.buffer)?;
            if !indices.offset.is_multiple_of(size) {
                return Err(Error::Buffer {
                    name: "Mesh::indices",
                    found: format!("offset {}", indices.offset),
                    needed: format!("a multiple of {size} bytes"),
                });
            }
            // The shader reads whole words, and a binding has no part of one: the last of an odd number of u16 indices
            // needs two bytes behind it.
            let end = (u64::from(self.first) + u64::from(self.count)) * size;
            let end = indices
                .offset
                .saturating_add(end)
                .checked_next_multiple_of(4);
            check_size("Mesh::indices", indices.buffer, end.unwrap_or(u64::MAX))?;
        }
        if let Some(instances) = &self.instances {
            let bytes = match instances.format {
                TransformFormat::Mat4 => 64,
                TransformFormat::Rows3x4 => 48,
            };
            check_layout(
                "Mesh::instances",
                instances.buffer,
                instances.offset,
                instances.stride,
                bytes,
                instances.count,
            )?;
        }
        Ok(())
    }
}

pub(crate) fn check_layout(
    name: &'static str,
    buffer: &Buffer,
    offset: u64,
    stride: u32,
    bytes: u64,
    count: u32,
) -> Result<(), Error> {
    check_usage(name, buffer)?;
    if !offset.is_multiple_of(4) || !stride.is_multiple_of(4) || u64::from(stride) < bytes {
        return Err(Error::Buffer {
            name,
            found: format!("offset {offset}, stride {stride}"),
            needed: format!("multiples of 4 bytes, a stride of at least {bytes}"),
        });
    }
    if count == 0 {
        return Ok(());
    }
    let end = u64::from(count - 1) * u64::from(stride) + bytes;
    check_size(name, buffer, offset.saturating_add(end))
}

pub(crate) fn check_usage(name: &'static str, buffer: &Buffer) -> Result<(), Error> {
    if buffer.usage().contains(BufferUsages::STORAGE) {
        Ok(())
    } else {
        Err(Error::Buffer {
            name,
            found: format!("usage {:?}", buffer.usage()),
            needed: "usage STORAGE (add BufferUsages::STORAGE where the buffer is created)".into(),
        })
    }
}

pub(crate) fn check_size(name: &'static str, buffer: &Buffer, end: u64) -> Result<(), Error> {
    if buffer.size() >= end {
        Ok(())
    } else {
        Err(Error::Buffer {
            name,
            found: format!("{} bytes", buffer.size()),
            needed: format!("at least {end} bytes"),
        })
    }
}

/// What a surface sends, per material. The table is a storage buffer of these, 32 bytes each, that the caller owns.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Material {
    /// Linear Lambert albedo, 0…1.
    pub albedo: [f32; 3],
    /// 0.
    pub padding0: f32,
    /// Emitted radiosity, W/m², of the front.
    pub emission: [f32; 3],
    /// Whether the back emits as the front does: 0 says no, all else says yes.
    pub double_sided: u32,
}

crate::reflection::same_as_wgsl!(
    materials_are_the_shaders: Material as "Material" in ["shell_splatter build", "surfel_shader"]
    { albedo, emission, double_sided }
);

/// The triangles of a scene as the caller draws them.
#[derive(Clone, Copy, Debug)]
pub struct Geometry<'a> {
    /// The draws.
    pub meshes: &'a [Mesh<'a>],
}

impl Geometry<'_> {
    /// How many triangles all instances of all meshes have, saturating.
    pub fn triangles(&self) -> u32 {
        self.meshes.iter().fold(0, |n: u32, m| {
            n.saturating_add(m.triangles().saturating_mul(m.instance_count()))
        })
    }

    /// How many instances all meshes have, saturating.
    pub(crate) fn instances(&self) -> u32 {
        self.meshes
            .iter()
            .fold(0, |n: u32, m| n.saturating_add(m.instance_count()))
    }
}

//! The values of accessors: only of types that the specification has for what they are, and only where there are bytes.

use gltf::{
    Accessor,
    accessor::{DataType, Dimensions, sparse::IndexType},
};

use super::{File, buffers::Buffers};

/// Elements that an accessor may have without bytes for them, where each makes something that takes room.
const MOST_ZEROS: usize = 1 << 16;

/// What an accessor is for, which says what types it may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Role {
    Positions,
    Normals,
    /// What a morph target adds to positions or normals.
    Displacements,
    TexCoords,
    Colors,
    Joints,
    Weights,
    Indices,
    Matrices,
    /// Of instances.
    Translations,
    Rotations,
    Scales,
}

impl Role {
    fn name(self) -> &'static str {
        match self {
            Self::Positions => "positions",
            Self::Normals => "normals",
            Self::Displacements => "displacements",
            Self::TexCoords => "texture coordinates",
            Self::Colors => "colours",
            Self::Joints => "joints",
            Self::Weights => "weights",
            Self::Indices => "indices",
            Self::Matrices => "matrices",
            Self::Translations => "translations",
            Self::Rotations => "rotations",
            Self::Scales => "scales",
        }
    }

    /// Whether the more there are, the more triangles there are.
    fn makes_triangles(self) -> bool {
        matches!(
            self,
            Self::Positions | Self::Indices | Self::Translations | Self::Rotations | Self::Scales
        )
    }

    /// Whether the specification has this type, or `KHR_mesh_quantization` where the file uses it.
    fn accepts(
        self,
        dimensions: Dimensions,
        data: DataType,
        normalized: bool,
        quantized: bool,
    ) -> bool {
        use DataType::{F32, I8, I16, U8, U16};
        use Dimensions::{Mat4, Scalar, Vec2, Vec3, Vec4};
        let shape = match self {
            Self::Indices => dimensions == Scalar,
            Self::TexCoords => dimensions == Vec2,
            Self::Colors => matches!(dimensions, Vec3 | Vec4),
            Self::Joints | Self::Weights | Self::Rotations => dimensions == Vec4,
            Self::Matrices => dimensions == Mat4,
            _ => dimensions == Vec3,
        };
        let signed = matches!(data, I8 | I16);
        let unsigned = matches!(data, U8 | U16);
        let kind = match self {
            Self::Indices => !normalized && (unsigned || data == DataType::U32),
            Self::Joints => !normalized && unsigned,
            Self::Weights | Self::Colors => data == F32 || (normalized && unsigned),
            Self::TexCoords => {
                data == F32 || (unsigned && (normalized || quantized)) || (signed && quantized)
            }
            Self::Positions => data == F32 || (quantized && (signed || unsigned)),
            Self::Normals => data == F32 || (quantized && signed && normalized),
            Self::Displacements => data == F32 || (quantized && signed),
            Self::Rotations => data == F32 || (normalized && signed),
            Self::Matrices | Self::Translations | Self::Scales => data == F32,
        };
        shape && kind
    }
}

/// An accessor whose every value has bytes.
pub struct Values<'a> {
    pub count: usize,
    index: usize,
    name: &'static str,
    data: DataType,
    normalized: bool,
    components: usize,
    /// Zeros where there are none.
    base: Option<Strided<'a>>,
    sparse: Option<Sparse<'a>>,
}

#[derive(Clone, Copy)]
struct Strided<'a> {
    bytes: &'a [u8],
    stride: usize,
}

struct Sparse<'a> {
    /// Increasing.
    indices: Vec<u32>,
    values: Strided<'a>,
}

impl<'a> Values<'a> {
    pub fn open(file: &File<'a>, accessor: &Accessor<'a>, role: Role) -> Result<Self, String> {
        let quantized = file
            .document
            .extensions_used()
            .any(|name| name == "KHR_mesh_quantization");
        let (data, dimensions) = (accessor.data_type(), accessor.dimensions());
        let place = format!("accessor {} of {}", accessor.index(), role.name());
        if !role.accepts(dimensions, data, accessor.normalized(), quantized) {
            let normalized = if accessor.normalized() {
                "normalized "
            } else {
                ""
            };
            return Err(format!(
                "{place}: they cannot be {normalized}{data:?} {dimensions:?}"
            ));
        }
        let count = accessor.count();
        if u32::try_from(count).is_err() {
            return Err(format!("{place}: {count} elements are too many"));
        }
        if accessor.view().is_none() && count > MOST_ZEROS && role.makes_triangles() {
            return Err(format!("{place}: {count} zeros, accepted are {MOST_ZEROS}"));
        }
        let element = accessor.size();
        let base = accessor
            .view()
            .map(|view| {
                let bytes = file.buffers.view(&view)?;
                let stride = view.stride().unwrap_or(element);
                Strided::new(
                    bytes,
                    accessor.offset(),
                    stride,
                    count,
                    data.size(),
                    element,
                )
            })
            .transpose()
            .map_err(|e| format!("{place}: {e}"))?;
        let sparse = accessor
            .sparse()
            .map(|sparse| Sparse::new(file.buffers, &sparse, count, data.size(), element))
            .transpose()
            .map_err(|e| format!("{place}: {e}"))?;
        Ok(Self {
            count,
            index: accessor.index(),
            name: role.name(),
            data,
            normalized: accessor.normalized(),
            components: dimensions.multiplicity(),
            base,
            sparse,
        })
    }

    /// The first `N` components of the element at an index below `count`.
    pub fn get<const N: usize>(&self, index: u32) -> [f64; N] {
        let size = self.data.size();
        let sparse = self.sparse.as_ref().and_then(|sparse| {
            let at = sparse.indices.binary_search(&index).ok()?;
            Some(sparse.values.element(at))
        });
        let base = || self.base.map(|base| base.element(index as usize));
        let Some(bytes) = sparse.or_else(base) else {
            return [0.0; N];
        };
        debug_assert!(N <= self.components);
        std::array::from_fn(|k| self.component(&bytes[k * size..]))
    }

    /// As [`get`](Self::get), of finite values.
    pub fn finite<const N: usize>(&self, index: u32) -> Result<[f64; N], String> {
        let value = self.get::<N>(index);
        if value.iter().all(|c| c.is_finite()) {
            Ok(value)
        } else {
            Err(format!(
                "accessor {} of {}: element {index} is {value:?}",
                self.index, self.name
            ))
        }
    }

    fn component(&self, bytes: &[u8]) -> f64 {
        let pair = || [bytes[0], bytes[1]];
        let four = || [bytes[0], bytes[1], bytes[2], bytes[3]];
        let (value, one) = match self.data {
            DataType::I8 => (f64::from(bytes[0].cast_signed()), 127.0),
            DataType::U8 => (f64::from(bytes[0]), 255.0),
            DataType::I16 => (f64::from(i16::from_le_bytes(pair())), 32767.0),
            DataType::U16 => (f64::from(u16::from_le_bytes(pair())), 65535.0),
            DataType::U32 => (f64::from(u32::from_le_bytes(four())), 1.0),
            DataType::F32 => (f64::from(f32::from_le_bytes(four())), 1.0),
        };
        if self.normalized {
            (value / one).max(-1.0)
        } else {
            value
        }
    }
}

impl<'a> Strided<'a> {
    fn new(
        view: &'a [u8],
        offset: usize,
        stride: usize,
        count: usize,
        component: usize,
        element: usize,
    ) -> Result<Self, String> {
        if stride < element || !stride.is_multiple_of(component) {
            return Err(format!(
                "a byte stride of {stride} for elements of {element} bytes"
            ));
        }
        let end = stride
            .checked_mul(count.saturating_sub(1))
            .and_then(|start| start.checked_add(if count == 0 { 0 } else { element }))
            .and_then(|length| length.checked_add(offset));
        end.and_then(|end| view.get(offset..end))
            .map(|bytes| Self { bytes, stride })
            .ok_or_else(|| {
                format!(
                    "{count} elements {stride} bytes apart from byte {offset} on, its buffer view has {} bytes",
                    view.len()
                )
            })
    }

    fn element(&self, index: usize) -> &'a [u8] {
        &self.bytes[index * self.stride..]
    }
}

impl<'a> Sparse<'a> {
    fn new(
        buffers: &'a Buffers,
        sparse: &gltf::accessor::sparse::Sparse<'a>,
        count: usize,
        component: usize,
        element: usize,
    ) -> Result<Self, String> {
        let (indices, values) = (sparse.indices(), sparse.values());
        let size = match indices.index_type() {
            IndexType::U8 => 1,
            IndexType::U16 => 2,
            IndexType::U32 => 4,
        };
        let found = Strided::new(
            buffers.view(&indices.view())?,
            indices.offset(),
            size,
            sparse.count(),
            size,
            size,
        )?;
        let index = |i: usize| {
            let mut word = [0; 4];
            word[..size].copy_from_slice(&found.element(i)[..size]);
            u32::from_le_bytes(word)
        };
        let indices: Vec<u32> = (0..sparse.count()).map(index).collect();
        if !indices.is_sorted_by(|a, b| a < b) {
            return Err("its sparse indices do not increase".into());
        }
        if let Some(last) = indices.last()
            && *last as usize >= count
        {
            return Err(format!("sparse index {last}, there are {count} elements"));
        }
        let values = Strided::new(
            buffers.view(&values.view())?,
            values.offset(),
            element,
            sparse.count(),
            component,
            element,
        )?;
        Ok(Self { indices, values })
    }
}

//! Sheets with holes, and the pictures that say where.

use deep_screen_space::{
    AlphaTest, AlphaWrap, Instances, Mesh, PositionFormat, TexCoordFormat, TexCoords,
    TransformFormat, Vertices,
    glam::{DMat4, DVec3, Mat4},
    reference::{
        alpha_test::Cutout,
        hashing::{hash2, unit_float},
    },
    scenes::HoleTest,
    wgpu::{self, BufferUsages, TextureFormat, TextureUsages},
};

use support::testing::pipelines;

/// Sheets of triangles with texture coordinates, which instances may place.
#[derive(Clone)]
pub struct Sheet {
    pub triangles: Vec<[DVec3; 3]>,
    pub tex_coords: Vec<[[f32; 2]; 3]>,
    pub transforms: Option<Vec<Mat4>>,
    pub test: Option<HoleTest>,
    pub format: TexCoordFormat,
}

/// Two triangles from `corner` along `u` and `v`, with texture coordinates from `low` to `high`.
pub fn sheet(
    [corner, u, v]: [DVec3; 3],
    [low, high]: [[f32; 2]; 2],
    test: impl Into<Option<HoleTest>>,
    format: TexCoordFormat,
) -> Sheet {
    let corners = [corner, corner + u, corner + u + v, corner + v];
    let uvs = [low, [high[0], low[1]], high, [low[0], high[1]]];
    Sheet {
        triangles: [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| corners[i])).into(),
        tex_coords: [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| uvs[i])).into(),
        transforms: None,
        test: test.into(),
        format,
    }
}

impl Sheet {
    pub fn matrices(&self) -> Vec<DMat4> {
        match &self.transforms {
            Some(transforms) => transforms.iter().map(Mat4::as_dmat4).collect(),
            None => vec![DMat4::IDENTITY],
        }
    }

    /// In world space: corners and texture coordinates, the other way around where they are mirrored.
    pub fn placed(&self) -> Vec<([DVec3; 3], [[f32; 2]; 3])> {
        let each = |m: DMat4| {
            let mirrored = m.determinant() < 0.0;
            let all = self.triangles.iter().zip(&self.tex_coords);
            all.map(move |(t, uv)| {
                let t = t.map(|p| m.transform_point3(p));
                if mirrored {
                    ([t[0], t[2], t[1]], [uv[0], uv[2], uv[1]])
                } else {
                    (t, *uv)
                }
            })
            .collect::<Vec<_>>()
        };
        self.matrices().into_iter().flat_map(each).collect()
    }

    /// The holes of its triangles.
    pub fn cutouts(&self) -> Vec<Option<Cutout>> {
        let of = |uv: &[[f32; 2]; 3]| {
            self.test.map(|test| Cutout {
                tex_coords: uv.map(|c| c.map(f64::from).into()),
                layer: test.layer as usize,
                threshold: f64::from(test.threshold),
                wrap: test.wrap,
            })
        };
        self.tex_coords.iter().map(of).collect()
    }
}

pub const SIDE: u32 = 16;

pub const LAYERS: u32 = 3;

/// Random alpha of three pictures.
pub fn pictures() -> Vec<Vec<u8>> {
    let alpha = |layer, i| (255.0 * unit_float(hash2(i, 11 + layer))) as u8;
    (0..LAYERS)
        .map(|layer| (0..SIDE * SIDE).map(|i| alpha(layer, i)).collect())
        .collect()
}

/// The pictures' alpha in the green channel, other numbers in the others.
pub fn texture() -> wgpu::Texture {
    let texels: Vec<[u8; 4]> = pictures()
        .concat()
        .into_iter()
        .map(|alpha| [255 - alpha, alpha, 0, 255])
        .collect();
    layers_of(TextureFormat::Rgba8Unorm, bytemuck::cast_slice(&texels))
}

pub fn layers_of(format: TextureFormat, texels: &[u8]) -> wgpu::Texture {
    let gpu = pipelines::gpu();
    let size = wgpu::Extent3d {
        width: SIDE,
        height: SIDE,
        depth_or_array_layers: LAYERS,
    };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(texels.len() as u32 / (SIDE * LAYERS)),
        rows_per_image: Some(SIDE),
    };
    gpu.queue
        .write_texture(texture.as_image_copy(), texels, layout, size);
    texture
}

/// A sheet's buffers.
pub struct Buffers {
    pub positions: wgpu::Buffer,
    pub tex_coords: wgpu::Buffer,
    pub transforms: Option<wgpu::Buffer>,
}

/// Where texture coordinates are in a vertex of theirs.
const OFFSET: u64 = 12;

const STRIDE: u32 = 20;

impl Buffers {
    pub fn new(sheet: &Sheet) -> Self {
        let gpu = pipelines::gpu();
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let positions: Vec<[f32; 3]> = sheet
            .triangles
            .iter()
            .flatten()
            .map(|p| p.as_vec3().to_array())
            .collect();
        let mut words = vec![0x7fc0_0000; OFFSET as usize / 4];
        for [u, v] in sheet.tex_coords.iter().flatten() {
            let own = match sheet.format {
                TexCoordFormat::Float32x2 => [u.to_bits(), v.to_bits()],
                TexCoordFormat::Float16x2 => [u32::from(half(*u)) | (u32::from(half(*v)) << 16), 0],
                TexCoordFormat::Unorm16x2 => {
                    let unorm = |x: f32| (x * 65535.0).round() as u32;
                    [unorm(*u) | (unorm(*v) << 16), 0]
                }
            };
            words.extend(own);
            words.extend([0x7fc0_0000; STRIDE as usize / 4 - 2]);
        }
        Self {
            positions: gpu.buffer(&positions, usage),
            tex_coords: gpu.buffer(&words, usage),
            transforms: sheet.transforms.as_ref().map(|transforms| {
                let all: Vec<f32> = transforms.iter().flat_map(Mat4::to_cols_array).collect();
                gpu.buffer(&all, usage)
            }),
        }
    }

    pub fn mesh(&self, sheet: &Sheet, material: u32) -> Mesh<'_> {
        let count = 3 * sheet.triangles.len() as u32;
        Mesh {
            vertices: Vertices {
                buffer: &self.positions,
                offset: 0,
                stride: 12,
                format: PositionFormat::Float32x3,
                count,
            },
            indices: None,
            first: 0,
            count,
            base_vertex: 0,
            instances: self.transforms.as_ref().map(|buffer| Instances {
                buffer,
                offset: 0,
                stride: 64,
                format: TransformFormat::Mat4,
                count: sheet.matrices().len() as u32,
            }),
            material,
        }
    }

    pub fn test(&self, sheet: &Sheet) -> Option<AlphaTest<'_>> {
        let HoleTest {
            layer,
            threshold,
            wrap,
        } = sheet.test?;
        Some(AlphaTest {
            tex_coords: TexCoords {
                buffer: &self.tex_coords,
                offset: OFFSET,
                stride: STRIDE,
                format: sheet.format,
            },
            layer,
            threshold,
            wrap,
        })
    }
}

/// The bits of a half: for 0 and numbers in its normal range that it holds exactly.
fn half(x: f32) -> u16 {
    if x == 0.0 {
        return 0;
    }
    let bits = x.to_bits();
    let exponent = ((bits >> 23) & 0xff) - 112;
    (((bits >> 16) & 0x8000) | (exponent << 10) | ((bits >> 13) & 0x3ff)) as u16
}

pub fn test_of(layer: u32, threshold: f32, wrap: [AlphaWrap; 2]) -> HoleTest {
    HoleTest {
        layer,
        threshold,
        wrap,
    }
}

pub fn ground() -> Sheet {
    let corner = DVec3::new(-4.0, 0.0, 4.0);
    let edges = [corner, DVec3::X * 8.0, DVec3::NEG_Z * 8.0];
    sheet(
        edges,
        [[0.0; 2], [1.0; 2]],
        None::<HoleTest>,
        TexCoordFormat::default(),
    )
}

//! Textures, as the mean colours of triangles need them: in linear light, in halves of halves.

use std::{cell::RefCell, collections::HashMap, io::Cursor, path::Path, rc::Rc};

use deep_screen_space::{
    AlphaWrap,
    glam::{DVec2, DVec3, DVec4},
};
use gltf::{
    Document,
    texture::{Info, WrappingMode},
};
use image::{ImageReader, Limits};

use super::{File, buffers::read_uri};
use crate::files::from_srgb;

/// Texels a side that are kept of an image: triangles' means need no more.
const KEPT: u32 = 1024;
/// The largest file of an image, in bytes.
const LARGEST: u64 = 1 << 30;
/// Points a side at which a triangle's texture is read.
const POINTS: f64 = 8.0;

/// An image, and whether its texels count as much as there is of them.
type Key = (usize, bool);

/// A file's images, each read when it is first needed.
pub struct Images<'a> {
    document: &'a Document,
    folder: &'a Path,
    read: RefCell<HashMap<Key, Option<Rc<Pyramid>>>>,
}

impl<'a> Images<'a> {
    pub fn new(document: &'a Document, folder: &'a Path) -> Self {
        Self {
            document,
            folder,
            read: RefCell::default(),
        }
    }

    /// A texture; none where it cannot be read, which is noted. Where it `cuts` holes, its colour is that of what is there.
    pub fn sampler(&self, file: &File<'_>, info: &Info<'_>, cuts: bool) -> Option<Sampler> {
        let texture = info.texture();
        let Some(image) = texture.source() else {
            file.notes.add(format!(
                "texture {} is of a format that is not read: it is left out",
                texture.index()
            ));
            return None;
        };
        let index = image.index();
        let mut read = self.read.borrow_mut();
        let pyramid = read.entry((index, cuts)).or_insert_with(|| {
            self.load(file, index, cuts)
                .map_err(|e| file.notes.add(format!("image {index} is left out: {e}")))
                .ok()
                .map(Rc::new)
        });
        let transform = info.texture_transform();
        Some(Sampler {
            image: index,
            pyramid: pyramid.clone()?,
            wrap: [texture.sampler().wrap_s(), texture.sampler().wrap_t()],
            set: transform
                .as_ref()
                .and_then(gltf::texture::TextureTransform::tex_coord)
                .unwrap_or(info.tex_coord()),
            transform: transform.map(|t| (t.offset(), t.rotation(), t.scale())),
        })
    }

    fn load(&self, file: &File<'_>, index: usize, cuts: bool) -> Result<Pyramid, String> {
        let json = &self.document.as_json().images[index];
        let view = json
            .buffer_view
            .as_ref()
            .and_then(|view| self.document.views().nth(view.value()));
        let bytes = match (view, &json.uri) {
            (Some(view), _) => file.buffers.view(&view)?.to_vec(),
            (None, Some(uri)) => read_uri(uri, self.folder, LARGEST)?,
            (None, None) => return Err("nothing says where it is".into()),
        };
        let mut reader = ImageReader::new(Cursor::new(bytes))
            .with_guessed_format()
            .map_err(|e| e.to_string())?;
        let mut limits = Limits::default();
        (limits.max_image_width, limits.max_image_height) = (Some(1 << 14), Some(1 << 14));
        reader.limits(limits);
        let image = reader.decode().map_err(|e| e.to_string())?;
        let texels = image.to_rgba8();
        let has_alpha = image.color().has_alpha();
        Ok(Pyramid {
            alpha: has_alpha.then(|| Rc::new(AlphaMap::new(&texels))),
            ..Pyramid::new(&texels, cuts)
        })
    }
}

/// Alpha of an image.
pub struct AlphaMap {
    pub size: [u32; 2],
    pub texels: Vec<u8>,
}

impl AlphaMap {
    fn new(image: &image::RgbaImage) -> Self {
        let (width, height) = image.dimensions();
        let step = width.max(height).div_ceil(KEPT).max(1);
        let alpha = |x, y| [f32::from(image.get_pixel(x, y).0[3]); 4];
        let level = Level::reduce([width, height], step, alpha);
        Self {
            size: level.size,
            texels: level.texels.iter().map(|a| a[0].round() as u8).collect(),
        }
    }

    /// The same at another size, each texel the one that its middle is in.
    pub fn resized(&self, size: [u32; 2]) -> Vec<u8> {
        let from = |i: u32, axis: usize| {
            (2 * u64::from(i) + 1) * u64::from(self.size[axis]) / (2 * u64::from(size[axis]))
        };
        let width = u64::from(self.size[0]);
        (0..size[1])
            .flat_map(|y| (0..size[0]).map(move |x| from(y, 1) * width + from(x, 0)))
            .map(|i| self.texels[i as usize])
            .collect()
    }
}

struct Level {
    size: [u32; 2],
    /// Colour times its weight, and the weight.
    texels: Vec<[f32; 4]>,
}

impl Level {
    /// The mean of `step` × `step` texels each, of fewer at an edge.
    fn reduce(size: [u32; 2], step: u32, at: impl Fn(u32, u32) -> [f32; 4]) -> Self {
        let reduced = size.map(|s| s.div_ceil(step));
        let mut texels = Vec::with_capacity((reduced[0] * reduced[1]) as usize);
        for y in 0..reduced[1] {
            for x in 0..reduced[0] {
                let (mut sum, mut count) = ([0.0; 4], 0.0);
                for v in y * step..((y + 1) * step).min(size[1]) {
                    for u in x * step..((x + 1) * step).min(size[0]) {
                        let texel = at(u, v);
                        sum = std::array::from_fn(|c| sum[c] + texel[c]);
                        count += 1.0;
                    }
                }
                texels.push(sum.map(|c| c / count));
            }
        }
        Self {
            size: reduced,
            texels,
        }
    }

    fn at(&self, x: u32, y: u32) -> [f32; 4] {
        self.texels[(y * self.size[0] + x) as usize]
    }
}

/// An image, and it in half the size, and so on; and its alpha, if it has any.
struct Pyramid {
    levels: Vec<Level>,
    alpha: Option<Rc<AlphaMap>>,
}

impl Pyramid {
    /// With `cuts` a texel counts as much as its alpha says.
    fn new(image: &image::RgbaImage, cuts: bool) -> Self {
        let linear: [f32; 256] = std::array::from_fn(|i| from_srgb(i as f32 / 255.0));
        let (width, height) = image.dimensions();
        let step = width.max(height).div_ceil(KEPT).max(1);
        let mut levels = vec![Level::reduce([width, height], step, |x, y| {
            let [r, g, b, a] = image.get_pixel(x, y).0;
            let weight = if cuts { f32::from(a) / 255.0 } else { 1.0 };
            let [r, g, b] = [r, g, b].map(|c| weight * linear[c as usize]);
            [r, g, b, weight]
        })];
        while let Some(last) = levels.last()
            && last.size != [1, 1]
        {
            levels.push(Level::reduce(last.size, 2, |x, y| last.at(x, y)));
        }
        Self {
            levels,
            alpha: None,
        }
    }
}

/// A texture as a material has it.
pub struct Sampler {
    image: usize,
    pyramid: Rc<Pyramid>,
    wrap: [WrappingMode; 2],
    set: u32,
    /// Offset, rotation, scale of coordinates.
    transform: Option<([f32; 2], f32, [f32; 2])>,
}

impl Sampler {
    /// Which texture coordinates it is read at.
    pub fn set(&self) -> u32 {
        self.set
    }

    /// The number of its image and the image's alpha, if it has any.
    pub fn alpha(&self) -> Option<(usize, Rc<AlphaMap>)> {
        Some((self.image, self.pyramid.alpha.clone()?))
    }

    /// What is beyond it.
    pub fn wrap(&self) -> [AlphaWrap; 2] {
        self.wrap.map(|wrap| match wrap {
            WrappingMode::ClampToEdge => AlphaWrap::ClampToEdge,
            WrappingMode::MirroredRepeat => AlphaWrap::MirrorRepeat,
            WrappingMode::Repeat => AlphaWrap::Repeat,
        })
    }

    /// The mean over a triangle with these coordinates.
    pub fn mean(&self, corners: [[f64; 2]; 3]) -> DVec3 {
        let [a, b, c] = corners.map(|uv| self.transformed(DVec2::from(uv)));
        let [width, height] = self.pyramid.levels[0].size.map(f64::from);
        let texels = (b - a).perp_dot(c - a).abs() / 2.0 * width * height;
        if !texels.is_finite() {
            return color_of(self.at(DVec2::ZERO, self.pyramid.levels.len() - 1));
        }
        // Points in a grid of the triangle's parts, and the level whose texels lie as close.
        let points = texels.sqrt().ceil().clamp(1.0, POINTS);
        let level = (texels.sqrt() / points).max(1.0).log2().round() as usize;
        let level = level.min(self.pyramid.levels.len() - 1);
        let n = points as u32;
        let mut sum = DVec4::ZERO;
        for i in 0..n {
            for k in 0..2 * (n - i) - 1 {
                // Parts of a strip point up and down by turns.
                let [along, third] = [f64::from(k / 2), f64::from(1 + k % 2) / 3.0];
                let u = (f64::from(i) + third) / points;
                let v = (along + third) / points;
                sum += self.at(a + (b - a) * u + (c - a) * v, level);
            }
        }
        color_of(sum)
    }

    /// Coordinates as the material has them.
    pub fn transformed(&self, uv: DVec2) -> DVec2 {
        let Some((offset, rotation, scale)) = self.transform else {
            return uv;
        };
        let scaled = uv * DVec2::from(scale.map(f64::from));
        let (sin, cos) = f64::from(rotation).sin_cos();
        let turned = DVec2::new(
            cos * scaled.x + sin * scaled.y,
            cos * scaled.y - sin * scaled.x,
        );
        turned + DVec2::from(offset.map(f64::from))
    }

    fn at(&self, uv: DVec2, level: usize) -> DVec4 {
        let level = &self.pyramid.levels[level];
        let texel = |t: f64, wrap: WrappingMode, size: u32| {
            let inside = match wrap {
                WrappingMode::ClampToEdge => t.clamp(0.0, 1.0),
                WrappingMode::Repeat => t.rem_euclid(1.0),
                WrappingMode::MirroredRepeat => 1.0 - (t.rem_euclid(2.0) - 1.0).abs(),
            };
            ((inside * f64::from(size)) as u32).min(size - 1)
        };
        let x = texel(uv.x, self.wrap[0], level.size[0]);
        let y = texel(uv.y, self.wrap[1], level.size[1]);
        DVec4::from(level.at(x, y).map(f64::from))
    }
}

/// The colour of a weighted one; of nothing, black.
fn color_of(weighted: DVec4) -> DVec3 {
    weighted.truncate() / weighted.w.max(f64::MIN_POSITIVE)
}

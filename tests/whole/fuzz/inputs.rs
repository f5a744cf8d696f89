//! What a caller brings: cameras, textures, G-buffers, lights, tables.

use std::rc::Rc;

use deep_screen_space::{
    Camera, Frame, FrameInput, GBuffer, GBufferDecoder, Light, NormalEncoding, NormalSpace,
    PixelList, Receivers, TextureSlice, Viewport,
    glam::{DMat4, DVec3, DVec4},
    wgpu::{
        self, Buffer, BufferUsages, Texture, TextureFormat as Format, TextureUsages as Usages,
        util::DeviceExt,
    },
};

use super::case::Case;

/// What drivers tell textures apart by: sides of 1, other powers of two, and neither. The same in successive cases.
fn is_even(case: &Case<'_>, name: &str) -> Option<bool> {
    case.usual(
        name,
        &[None, Some(true), Some(false), Some(false), Some(false)],
    )
}

/// The side of an image, mostly a small one.
fn side(case: &mut Case<'_>, name: &str) -> u32 {
    let is_even = is_even(case, name);
    match is_even {
        None => 1,
        Some(true) => 2 << case.random.below(6),
        Some(false) => {
            let side = 2 + 40_f64.powf(case.random.unit()) as u32;
            uneven(side)
        }
    }
}

fn uneven(side: u32) -> u32 {
    side + u32::from(side.is_power_of_two())
}

pub fn size(case: &mut Case<'_>) -> Viewport {
    Viewport::full(side(case, "width"), side(case, "height"))
}

pub fn viewport(case: &mut Case<'_>) -> Viewport {
    let mut viewport = size(case);
    let is_apart = ["width", "height"].map(|name| is_even(case, name) == Some(false));
    if case.random.chance(0.3) && is_apart == [true; 2] {
        viewport.x = uneven(viewport.width + case.random.below(9)) - viewport.width;
        viewport.y = uneven(viewport.height + case.random.below(9)) - viewport.height;
    }
    viewport
}

/// A camera of any kind.
pub fn camera(case: &mut Case<'_>) -> Camera {
    let viewport = viewport(case);
    camera_of(case, viewport)
}

pub fn camera_of(case: &mut Case<'_>, viewport: Viewport) -> Camera {
    let extent = case.random.one_of(&[0.0, 1.0, 10.0, 1e3, 1e5]);
    let eye = case.random.point(extent);
    camera_at(case, viewport, eye)
}

pub fn camera_at(case: &mut Case<'_>, viewport: Viewport, eye: DVec3) -> Camera {
    let toward = case.random.direction();
    let up = toward.any_orthonormal_vector();
    for _ in 0..8 {
        let projection = projection(case);
        let camera = Camera::look_at(eye, eye + toward, up, projection, viewport);
        if let Some(camera) = case.accept(camera) {
            case.note("camera", camera);
            return camera;
        }
    }
    let plain = perspective(1.5, 1.0, 0.1, f64::INFINITY, true);
    Camera::look_at(eye, eye + toward, up, plain, viewport).expect("a camera")
}

fn projection(case: &mut Case<'_>) -> DMat4 {
    let random = &mut case.random;
    if random.breaks() {
        return DMat4::from_cols_array(&std::array::from_fn(|_| f64::from(random.odd())));
    }
    let half = random.between(0.001_f64.ln(), 3.0_f64.ln()).exp();
    let aspect = random.between(0.5, 2.0);
    let near = random.between(1e-3_f64.ln(), 1.0_f64.ln()).exp();
    let far = near + random.between(1.0_f64.ln(), 1e4_f64.ln()).exp();
    let reversed = random.chance(0.7);
    if random.chance(0.2) {
        let half = half * 5.0;
        let depth = |z: f64, w: f64| DVec4::new(0.0, 0.0, z, w);
        let (z, w) = (1.0 / (near - far), near / (near - far));
        let (z, w) = if reversed { (-z, 1.0 - w) } else { (z, w) };
        return DMat4::from_cols(
            DVec4::X / half,
            DVec4::Y * aspect / half,
            depth(z, 0.0),
            depth(w, 1.0),
        );
    }
    let far = if random.chance(0.5) {
        f64::INFINITY
    } else {
        far
    };
    let mut projection = perspective(half, aspect, near, far, reversed);
    if random.chance(0.2) {
        // Off the axis.
        projection.z_axis.x = random.between(-1.0, 1.0);
        projection.z_axis.y = random.between(-1.0, 1.0);
    }
    projection
}

/// Right-handed, from the tangent of half the angle.
fn perspective(half: f64, aspect: f64, near: f64, far: f64, reversed: bool) -> DMat4 {
    // Depth is (a z + b) / -z.
    let (a, b) = if far.is_infinite() {
        (-1.0, -near)
    } else {
        (-far / (far - near), -far * near / (far - near))
    };
    let (a, b) = if reversed { (-1.0 - a, -b) } else { (a, b) };
    DMat4::from_cols(
        DVec4::X / half,
        DVec4::Y * aspect / half,
        DVec4::new(0.0, 0.0, a, -1.0),
        DVec4::new(0.0, 0.0, b, 0.0),
    )
}

/// A part of a texture of the case's.
#[derive(Clone, Debug)]
pub struct Part {
    pub texture: Texture,
    mip: u32,
    layer: u32,
}

impl Part {
    pub fn slice(&self) -> TextureSlice<'_> {
        TextureSlice::new(&self.texture)
            .mip(self.mip)
            .layer(self.layer)
    }
}

/// An empty texture that covers a rectangle, of one layer and mip level or a part of a larger one.
fn part(
    case: &mut Case<'_>,
    name: &str,
    format: Format,
    [width, height]: [u32; 2],
    usage: Usages,
) -> Part {
    let kind = case.usual(&format!("part {name}"), &[0, 1, 2, 3, 3, 3, 3, 3]);
    let random = &mut case.random;
    let mut descriptor = wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    };
    let (mut mip, mut layer) = (0, 0);
    match kind {
        0 => {
            descriptor.size.width *= 2;
            descriptor.size.height *= 2;
            descriptor.mip_level_count = 2;
            mip = 1;
        }
        1 => {
            descriptor.size.depth_or_array_layers = 6;
            layer = random.below(6);
        }
        2 => {
            let size = &mut descriptor.size;
            for side in [&mut size.width, &mut size.height] {
                if !side.is_power_of_two() {
                    *side = uneven(*side + random.below(9));
                }
            }
        }
        _ => {}
    }
    if random.breaks() {
        match random.below(5) {
            0 => descriptor.size.width = descriptor.size.width.div_ceil(2),
            1 => mip = random.one_of(&[1, 2, 31, 32, u32::MAX]),
            2 => layer = random.one_of(&[1, 6, u32::MAX]),
            3 => descriptor.usage = Usages::COPY_DST | Usages::COPY_SRC,
            _ if !format.has_depth_aspect() && mip == 0 && layer == 0 => {
                descriptor.dimension = wgpu::TextureDimension::D3;
                descriptor.usage -= Usages::RENDER_ATTACHMENT;
            }
            _ => {}
        }
    }
    let texture = case.device().create_texture(&descriptor);
    Part {
        texture,
        mip,
        layer,
    }
}

/// An empty texture for a pass to write.
pub fn target(case: &mut Case<'_>, format: Format, viewport: Viewport, written: Usages) -> Part {
    let usage = written | Usages::TEXTURE_BINDING | Usages::COPY_SRC;
    let size = [viewport.x + viewport.width, viewport.y + viewport.height];
    let mut part = part(case, "target", format, size, usage);
    // Only the first mip level is read back.
    if part.texture.mip_level_count() > 1 {
        part.mip = 0;
    }
    part
}

/// What a texture holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Contents {
    Meant,
    Empty,
    /// Some texels are garbage.
    Sprinkled,
    Garbage,
}

pub fn contents(case: &mut Case<'_>) -> Contents {
    match case.random.below(12) {
        0 => Contents::Empty,
        1 | 2 => Contents::Sprinkled,
        3 => Contents::Garbage,
        _ => Contents::Meant,
    }
}

/// A texture to read whose texels are those of `texel` or garbage, covering the viewport. Layers besides the part's are empty.
pub fn image(
    case: &mut Case<'_>,
    name: &str,
    format: Format,
    viewport: Viewport,
    texel: impl Fn(u32, u32) -> [f32; 4],
) -> Part {
    let usage = Usages::TEXTURE_BINDING | Usages::COPY_DST;
    let size = [viewport.x + viewport.width, viewport.y + viewport.height];
    let part = part(case, name, format, size, usage);
    fill(case, name, &part, viewport, texel);
    part
}

fn fill(
    case: &mut Case<'_>,
    name: &str,
    part: &Part,
    viewport: Viewport,
    texel: impl Fn(u32, u32) -> [f32; 4],
) {
    let contents = contents(case);
    let format = part.texture.format();
    case.note(
        name,
        (format, contents, &part.texture.size(), part.mip, part.layer),
    );
    let bytes = format.block_copy_size(None).expect("a format to copy to");
    let covered = part.slice().size();
    if contents == Contents::Empty
        || part.texture.dimension() != wgpu::TextureDimension::D2
        || part.mip >= part.texture.mip_level_count()
        || part.layer >= part.texture.depth_or_array_layers()
        || covered[0] < viewport.x + viewport.width
        || covered[1] < viewport.y + viewport.height
    {
        return;
    }
    // All of the level, since depth formats cannot be written in part; beside the viewport nothing is read.
    let mut data = Vec::new();
    for y in 0..covered[1] {
        for x in 0..covered[0] {
            let is_garbage = match contents {
                Contents::Garbage => true,
                Contents::Sprinkled => case.random.chance(0.1),
                _ => false,
            };
            if is_garbage {
                data.extend(case.random.garbage(bytes as usize));
            } else {
                let texel = texel(x.saturating_sub(viewport.x), y.saturating_sub(viewport.y));
                let end = data.len() + bytes as usize;
                encode(format, texel, &mut data);
                // Formats of whole numbers are to be refused, whatever they hold.
                data.resize(end, 0);
            }
        }
    }
    let mut to = part.texture.as_image_copy();
    to.mip_level = part.mip;
    to.origin.z = part.layer;
    case.world.gpu.queue.write_texture(
        to,
        &data,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(bytes * covered[0]),
            rows_per_image: None,
        },
        wgpu::Extent3d {
            width: covered[0],
            height: covered[1],
            depth_or_array_layers: 1,
        },
    );
}

/// A texel of a format.
fn encode(format: Format, texel: [f32; 4], to: &mut Vec<u8>) {
    let texel = &texel[..usize::from(format.components())];
    let quantum = |v: &f32, steps: f32| (v * steps).round_ties_even();
    match format {
        Format::R32Float | Format::Rg32Float | Format::Rgba32Float => {
            to.extend(texel.iter().flat_map(|v| v.to_le_bytes()));
        }
        Format::R16Float | Format::Rg16Float | Format::Rgba16Float => {
            to.extend(texel.iter().flat_map(|v| half(*v).to_le_bytes()));
        }
        Format::Rg8Snorm | Format::Rgba8Snorm => {
            to.extend(texel.iter().map(|v| quantum(v, 127.0) as i8 as u8));
        }
        Format::Depth16Unorm => to.extend((quantum(&texel[0], 65535.0) as u16).to_le_bytes()),
        _ => to.extend(texel.iter().map(|v| quantum(v, 255.0) as u8)),
    }
}

/// Bits of an f16, truncated.
fn half(value: f32) -> u16 {
    let bits = value.to_bits();
    let sign = (bits >> 16 & 0x8000) as u16;
    let exponent = (bits >> 23 & 0xff) as i32 - 112;
    let mantissa = (bits >> 13 & 0x3ff) as u16;
    sign | match exponent {
        ..=0 => 0,
        1..=30 => (exponent as u16) << 10 | mantissa,
        _ => 0x7bff,
    }
}

/// Textures of a G-buffer.
#[derive(Clone, Debug)]
pub struct Drawn {
    pub depth: Part,
    pub normal: Part,
    pub albedo: Option<Part>,
    encoding: NormalEncoding,
    space: NormalSpace,
}

impl Drawn {
    pub fn gbuffer(&self) -> GBuffer<'_> {
        GBuffer {
            depth: self.depth.slice(),
            normal: self.normal.slice(),
            normal_encoding: self.encoding,
            normal_space: self.space,
            albedo: self.albedo.as_ref().map(Part::slice),
            roughness: None,
        }
    }
}

/// Room for one camera's receivers.
pub struct Decoding {
    decoder: Rc<GBufferDecoder>,
    receivers: Receivers,
}

impl Decoding {
    pub fn new(case: &mut Case<'_>, viewport: Viewport) -> Option<Self> {
        let device = case.device();
        let decoder = case.once("", |device| GBufferDecoder::new(device))?;
        let Viewport { width, height, .. } = viewport;
        let width = if case.random.breaks() {
            case.random.count(0, 64)
        } else {
            width
        };
        let receivers = decoder.create_receivers(device, width, height);
        Some(Self {
            receivers: case.accept(receivers)?,
            decoder,
        })
    }

    pub fn frame<'a, 'w: 'a>(
        &'a mut self,
        case: &mut Case<'w>,
        gbuffer: GBuffer<'a>,
        camera: &'a Camera,
        origin: DVec3,
    ) -> Option<Frame<'a>> {
        let input = FrameInput {
            gbuffer,
            camera,
            origin: if case.random.breaks() {
                DVec3::splat(case.random.odd().into())
            } else {
                origin
            },
            timestamps: case.timestamps(),
        };
        let device = case.device();
        let frame = self
            .decoder
            .record(device, &mut case.encoder, &input, &mut self.receivers);
        let frame = case.accept(frame)?;
        case.texture("receivers", frame.receivers().view().texture());
        Some(frame)
    }
}

/// How far away what is seen lies: steps, so that there are edges.
fn distance(seed: u64, x: u32, y: u32) -> f64 {
    let block = u64::from(x / 5) + 1000 * u64::from(y / 7);
    let hash = (block ^ seed).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 60;
    1.0 + hash as f64 * 0.25 + f64::from(x + y) * 0.01
}

/// A G-buffer of some surfaces and some sky; albedo where it is needed, and sometimes where not.
pub fn gbuffer(case: &mut Case<'_>, camera: &Camera, albedo: bool) -> Drawn {
    let viewport = camera.viewport();
    let seed = case.random.bits();
    let depth = depth(case, "depth", camera, seed);
    let encodings = [
        (NormalEncoding::Signed, Format::Rgba16Float),
        (NormalEncoding::Signed, Format::Rgba32Float),
        (NormalEncoding::Signed, Format::Rgba8Snorm),
        (NormalEncoding::Unsigned, Format::Rgba8Unorm),
        (NormalEncoding::Octahedral, Format::Rg16Float),
        (NormalEncoding::Octahedral, Format::Rg8Snorm),
        (NormalEncoding::OctahedralUnsigned, Format::Rg8Unorm),
    ];
    let (encoding, mut format) = case.usual("normal", &encodings);
    let random = &mut case.random;
    if random.breaks() {
        format = random.one_of(&[Format::R32Float, Format::Rg8Unorm, Format::Rgba8Uint]);
    }
    let space = random.one_of(&[NormalSpace::World, NormalSpace::View]);
    let facing = random.direction().as_vec3();
    let normal = image(case, "normal", format, viewport, |x, y| {
        let turn = (x / 6 + y / 4) as f32;
        let n = (facing + 0.3 * glam_sin(turn)).normalize_or(facing);
        let l1 = n.x.abs() + n.y.abs() + n.z.abs();
        let fold = |a: f32, b: f32| {
            if n.z >= 0.0 {
                a / l1
            } else {
                (1.0 - (b / l1).abs()).copysign(a)
            }
        };
        let unsigned = |v: f32| v * 0.5 + 0.5;
        match encoding {
            NormalEncoding::Signed => [n.x, n.y, n.z, 0.0],
            NormalEncoding::Unsigned => [unsigned(n.x), unsigned(n.y), unsigned(n.z), 0.0],
            NormalEncoding::Octahedral => [fold(n.x, n.y), fold(n.y, n.x), 0.0, 0.0],
            NormalEncoding::OctahedralUnsigned => {
                [unsigned(fold(n.x, n.y)), unsigned(fold(n.y, n.x)), 0.0, 0.0]
            }
        }
    });
    let wanted = if albedo {
        !case.random.breaks()
    } else {
        case.random.chance(0.2)
    };
    let albedo = wanted.then(|| {
        let formats = [
            Format::Rgba8Unorm,
            Format::Rgba8UnormSrgb,
            Format::Rgba16Float,
            Format::Rgba32Float,
        ];
        let format = case.usual("albedo", &formats);
        image(case, "albedo", format, viewport, |x, y| {
            [(x % 4) as f32 * 0.3, (y % 5) as f32 * 0.25, 0.5, 1.0]
        })
    });
    Drawn {
        depth,
        normal,
        albedo,
        encoding,
        space,
    }
}

fn glam_sin(turn: f32) -> deep_screen_space::glam::Vec3 {
    deep_screen_space::glam::Vec3::new(turn.sin(), (2.0 * turn).cos(), (3.0 * turn).sin())
}

/// What a camera would draw of the surfaces at `distance`.
pub fn depth(case: &mut Case<'_>, name: &str, camera: &Camera, seed: u64) -> Part {
    let viewport = camera.viewport();
    let formats = [
        Format::R32Float,
        Format::R32Float,
        Format::R32Float,
        Format::Depth16Unorm,
        Format::Depth32Float,
        Format::Depth24Plus,
        Format::Depth24PlusStencil8,
    ];
    let mut format = case.usual(name, &formats);
    if case.random.breaks() {
        format = case
            .random
            .one_of(&[Format::R16Float, Format::R32Uint, Format::Rgba8Unorm]);
    }
    if matches!(format, Format::R32Float | Format::Depth16Unorm) || !format.has_depth_aspect() {
        return image(case, name, format, viewport, |x, y| {
            [seen(camera, seed, x, y), 0.0, 0.0, 0.0]
        });
    }
    let size = [viewport.x + viewport.width, viewport.y + viewport.height];
    let usage = Usages::TEXTURE_BINDING | Usages::RENDER_ATTACHMENT;
    let part = part(case, name, format, size, usage);
    case.note(name, (format, &part.texture.size(), part.mip, part.layer));
    let value = seen(camera, seed, viewport.width / 2, viewport.height / 2).clamp(0.0, 1.0);
    let is_there = part.mip < part.texture.mip_level_count()
        && part.layer < part.texture.depth_or_array_layers()
        && part.texture.usage().contains(Usages::RENDER_ATTACHMENT);
    if is_there {
        let view = part.texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_mip_level: part.mip,
            mip_level_count: Some(1),
            base_array_layer: part.layer,
            array_layer_count: Some(1),
            ..Default::default()
        });
        let stencil = format.has_stencil_aspect().then_some(wgpu::Operations {
            load: wgpu::LoadOp::Clear(7),
            store: wgpu::StoreOp::Store,
        });
        case.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &view,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(value),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: stencil,
            }),
            ..Default::default()
        });
    }
    part
}

/// The depth of a pixel: sky one time in eight.
fn seen(camera: &Camera, seed: u64, x: u32, y: u32) -> f32 {
    let far = camera.background_depth();
    let block = u64::from(x / 9) + 77 * u64::from(y / 8);
    if (block ^ seed).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 61 == 0 {
        return far;
    }
    let middle = |n: u32| f64::from(n) + 0.5;
    let point = camera.unproject(middle(x), middle(y), 0.5);
    let point = point.map(|point| {
        if camera.is_perspective() {
            point.normalize() * distance(seed, x, y)
        } else {
            point
        }
    });
    let depth = point.and_then(|point| camera.project(point));
    depth.map_or(far, |depth| depth.z as f32)
}

/// A table of numbers in a buffer: meant ones, or with garbage among them.
pub fn table(
    case: &mut Case<'_>,
    name: &str,
    length: usize,
    value: impl Fn(usize) -> f32,
) -> Buffer {
    let contents = contents(case);
    let numbers: Vec<f32> = (0..length.max(4))
        .map(|i| {
            let is_garbage = match contents {
                Contents::Garbage => true,
                Contents::Sprinkled => case.random.chance(0.05),
                _ => false,
            };
            if is_garbage {
                f32::from_bits(case.random.bits() as u32)
            } else if contents == Contents::Empty {
                0.0
            } else {
                value(i)
            }
        })
        .collect();
    case.note(name, (length, contents));
    let mut usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
    if case.random.breaks() {
        usage = BufferUsages::VERTEX;
    }
    case.device()
        .create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents: bytemuck::cast_slice(&numbers),
            usage,
        })
}

/// Materials, 32 bytes each.
pub fn materials(case: &mut Case<'_>) -> Buffer {
    let count = 1 + case.random.below(4) as usize;
    let count = if case.random.breaks() { 0 } else { count };
    let emission = case.random.scale(0.0, 1e18).clamp(0.0, 1e18);
    table(case, "materials", 8 * count, |i| match i % 8 {
        0..=2 => 0.2 + (i % 3) as f32 * 0.3,
        4..=6 if i < 16 => emission,
        _ => 0.0,
    })
}

pub fn light(case: &mut Case<'_>, near: DVec3) -> Light {
    let random = &mut case.random;
    let color = std::array::from_fn(|_| random.scale(0.0, 1e18));
    let extent = random.one_of(&[0.0, 1.0, 5.0, 1e4, 1e30]);
    let position = near + random.point(extent);
    let direction = if random.breaks() {
        DVec3::splat(random.odd().into())
    } else {
        random.direction() * random.one_of(&[1.0, 1e-20, 1e20])
    };
    let light = match random.below(3) {
        0 => Light::Directional {
            direction,
            irradiance: color,
        },
        1 => Light::Point {
            position,
            intensity: color,
        },
        _ => {
            let outer = random.setting(0.0, std::f32::consts::FRAC_PI_2);
            Light::Spot {
                position,
                direction,
                intensity: color,
                inner: random.setting(0.0, outer.clamp(0.0, 1.0)),
                outer,
            }
        }
    };
    case.note("light", light);
    light
}

/// A caller's own list of pixels: some twice, some beyond the image.
pub struct OwnWork {
    level: u32,
    pixels: Buffer,
    dispatch: Buffer,
}

impl OwnWork {
    pub fn new(case: &mut Case<'_>, viewport: Viewport) -> Self {
        let level = case.random.count(0, 3);
        let [width, height] =
            [viewport.width, viewport.height].map(|n| n.div_ceil(1 << level.min(16)));
        let count = case.random.below(width * height + 1);
        let told = if case.random.chance(0.2) {
            case.random.bits() as u32
        } else {
            count
        };
        let mut words = vec![told];
        for _ in 0..width * height {
            let beyond = u32::from(case.random.chance(0.1)) * 1000;
            let [x, y] = [width, height].map(|n| case.random.below(n) + beyond);
            words.push(x | y << 16);
        }
        case.note("own work", (level, told, count));
        let gpu = &case.world.gpu;
        Self {
            level,
            pixels: gpu.buffer(&words, BufferUsages::STORAGE),
            dispatch: gpu.buffer(&[count.div_ceil(64), 1, 1], BufferUsages::INDIRECT),
        }
    }

    pub fn list(&self) -> PixelList<'_> {
        PixelList {
            level: self.level,
            pixels: &self.pixels,
            dispatch: &self.dispatch,
        }
    }
}

/// A target's format: few, since each takes pipelines of its own.
pub fn target_format(case: &mut Case<'_>) -> Format {
    if case.random.breaks() {
        return case
            .random
            .one_of(&[Format::R32Uint, Format::Depth32Float, Format::Rg11b10Ufloat]);
    }
    case.random.one_of(&[Format::Rgba16Float, Format::R32Float])
}

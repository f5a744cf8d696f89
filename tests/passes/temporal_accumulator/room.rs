//! A wall, a floor and what stands before them, as cameras see them.

use deep_screen_space::{
    Camera, GBuffer, NormalEncoding, NormalSpace, Viewport,
    glam::{DMat4, DVec3, dcamera::rh::proj::directx as right},
    reference::{hashing, receivers::Decoder, shell_splatter::Receiver},
    wgpu::{self, TextureFormat as Format},
};

use support::gpu::Gpu;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Surface {
    Floor,
    Wall,
    Block,
}

/// A wall at z = −6 up to y = 1.6, a floor at y = −1, and a block's face at z = −3, `block` to the right of the middle.
#[derive(Clone, Copy, Debug)]
pub struct World {
    pub origin: DVec3,
    pub block: Option<f64>,
    /// The middle, on the floor, of a slab 5 cm high, 1.2 by 0.8 across.
    pub slab: Option<DVec3>,
    /// How much normals are bent, as by a normal map.
    pub hills: f64,
}

pub const ROOM: World = World {
    origin: DVec3::ZERO,
    block: None,
    slab: None,
    hills: 0.0,
};

#[derive(Clone, Copy, Debug)]
pub struct Hit {
    pub surface: Surface,
    /// From the world's `origin`.
    pub point: DVec3,
    normal: DVec3,
}

impl World {
    /// The first surface along a ray that starts at `from`, which is from `origin`.
    pub fn hit(&self, from: DVec3, direction: DVec3) -> Option<Hit> {
        let along = |t: f64| from + t * direction;
        let hit = |surface, point: DVec3, normal: DVec3| {
            let bent = self.hills * (5.0 * point).map(f64::sin);
            Some(Hit {
                surface,
                point,
                normal: (normal + bent).normalize(),
            })
        };
        if let Some(middle) = self.block {
            let face = along((-3.0 - from.z) / direction.z);
            if (face.x - middle).abs() < 0.6 && face.y.abs() < 0.6 {
                return hit(Surface::Block, face, DVec3::Z);
            }
        }
        if let Some(middle) = self.slab {
            let top = along((-0.95 - from.y) / direction.y);
            let off = (top - middle).abs();
            if direction.y < 0.0 && off.x < 0.6 && off.z < 0.4 {
                return hit(Surface::Block, top, DVec3::Y);
            }
        }
        if direction.y < 0.0 {
            let floor = along((-1.0 - from.y) / direction.y);
            if floor.z > -6.0 {
                return hit(Surface::Floor, floor, DVec3::Y);
            }
        }
        let wall = along((-6.0 - from.z) / direction.z);
        (wall.y < 1.6 && direction.z < 0.0)
            .then(|| hit(Surface::Wall, wall, DVec3::Z))
            .flatten()
    }
}

/// A frame's G-buffer, in textures larger than the viewport where it is moved.
pub struct Shot {
    pub camera: Camera,
    pub hits: Vec<Option<Hit>>,
    pub receivers: Vec<Option<Receiver>>,
    depth: wgpu::TextureView,
    normal: wgpu::TextureView,
}

impl Shot {
    pub fn new(gpu: &Gpu, world: World, camera: &Camera) -> Self {
        let viewport = camera.viewport();
        let background = camera.background_depth();
        let near = 1.0 - f64::from(background);
        let hits: Vec<Option<Hit>> = pixels(viewport)
            .map(|[x, y]| {
                let at = |depth| {
                    camera
                        .unproject(f64::from(x) + 0.5, f64::from(y) + 0.5, depth)
                        .expect("a point")
                };
                let (from, beyond) = (at(near), at(0.5));
                let from_origin = camera.eye() - world.origin + from;
                world.hit(from_origin, (beyond - from).normalize())
            })
            .collect();
        let depths: Vec<f32> = hits
            .iter()
            .map(|hit| {
                hit.map_or(background, |hit| {
                    let relative = hit.point - (camera.eye() - world.origin);
                    camera.project(relative).expect("it is seen").z as f32
                })
            })
            .collect();
        let normals: Vec<[f32; 4]> = hits
            .iter()
            .map(|hit| {
                let n = hit.map_or(DVec3::ZERO, |hit| hit.normal);
                n.as_vec3().extend(0.0).to_array()
            })
            .collect();
        let decoder = Decoder {
            camera,
            origin: camera.eye(),
            depth_format: Format::R32Float,
            normal_encoding: NormalEncoding::Signed,
            normal_space: NormalSpace::World,
        };
        let receivers = (pixels(viewport).zip(&depths).zip(&normals))
            .map(|((pixel, &depth), &[x, y, z, _])| {
                let normal = DVec3::from([x, y, z].map(f64::from));
                decoder.prepare(pixel, f64::from(depth), normal)
            })
            .collect();
        // What is around the viewport would be history if it were read.
        Self {
            depth: placed(gpu, viewport, Format::R32Float, &depths, 0.03),
            normal: placed(gpu, viewport, Format::Rgba32Float, &normals, [0.0; 4]),
            receivers,
            hits,
            camera: *camera,
        }
    }

    pub fn gbuffer(&self) -> GBuffer<'_> {
        GBuffer::new(self.depth.texture(), self.normal.texture())
    }

    /// A picture by pixel index and hit.
    pub fn paint(&self, value: impl Fn(u32, Option<Hit>) -> f64) -> Vec<DVec3> {
        (0..)
            .zip(&self.hits)
            .map(|(i, hit)| DVec3::splat(value(i, *hit)))
            .collect()
    }
}

pub fn pixels(viewport: Viewport) -> impl Iterator<Item = [u32; 2]> {
    (0..viewport.width * viewport.height).map(move |i| [i % viewport.width, i / viewport.width])
}

pub fn texture_size(viewport: Viewport) -> [u32; 2] {
    [
        2 * viewport.x + viewport.width,
        2 * viewport.y + viewport.height,
    ]
}

/// Texels of the viewport in a texture with `other` around them.
pub fn placed<T: bytemuck::Pod>(
    gpu: &Gpu,
    viewport: Viewport,
    format: Format,
    texels: &[T],
    other: T,
) -> wgpu::TextureView {
    let [width, height] = texture_size(viewport);
    let mut all = vec![other; (width * height) as usize];
    for ([x, y], texel) in pixels(viewport).zip(texels) {
        all[((y + viewport.y) * width + x + viewport.x) as usize] = *texel;
    }
    gpu.texture(format, width, height, &all)
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    Reversed,
    Forward,
    Orthographic,
}

pub fn look(eye: DVec3, toward: DVec3, projection: Projection, viewport: Viewport) -> Camera {
    let aspect = f64::from(viewport.width) / f64::from(viewport.height);
    let matrix: DMat4 = match projection {
        Projection::Reversed => right::perspective_infinite_reverse(1.0, aspect, 0.1),
        Projection::Forward => right::perspective(1.0, aspect, 0.1, 50.0),
        Projection::Orthographic => {
            right::orthographic(-2.0 * aspect, 2.0 * aspect, -2.0, 2.0, 0.1, 50.0)
        }
    };
    Camera::look_at(eye, eye + toward, DVec3::Y, matrix, viewport).expect("a camera")
}

/// As from [`EYE`], from so far behind it.
pub fn orthographic_from(back: f64, viewport: Viewport) -> Camera {
    let aspect = f64::from(viewport.width) / f64::from(viewport.height);
    let matrix = right::orthographic(
        -2.0 * aspect,
        2.0 * aspect,
        -2.0,
        2.0,
        back + 0.1,
        back + 50.0,
    );
    let eye = EYE + back * DVec3::Z;
    Camera::look_at(eye, eye - DVec3::Z, DVec3::Y, matrix, viewport).expect("a camera")
}

pub fn straight(eye: DVec3, viewport: Viewport) -> Camera {
    look(eye, -DVec3::Z, Projection::Reversed, viewport)
}

pub const EYE: DVec3 = DVec3::new(0.3, 0.1, 2.0);

/// Uniform noise, 0…1.
pub fn noise(i: u32, frame: u32) -> f64 {
    f64::from(hashing::hash2(i, frame) >> 8) / f64::from(1 << 24)
}

/// A value of every point, of about `0…1`, whose second derivatives are below [`CURVATURE`].
pub fn painted(point: DVec3) -> f64 {
    let DVec3 { x, y, z } = point;
    0.5 + 0.2 * ((1.7 * x).sin() + (1.3 * y + 0.4 * z).cos())
}

pub const CURVATURE: f64 = 0.2 * 1.7 * 1.7;

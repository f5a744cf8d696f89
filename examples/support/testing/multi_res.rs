//! G-buffers drawn on the CPU, and the masks of them.

use crate::testing::pipelines;
use deep_screen_space::{
    Camera, GBuffer, MultiResMask, MultiResMaskInput, MultiResMaskSettings, MultiResView,
    NormalEncoding, NormalSpace, PixelList, Viewport,
    glam::{DMat4, DVec3},
    reference::{
        multi_res_reconstructor::stands_for, receivers::Decoder, shell_splatter::Receiver,
    },
    scenes::Scene,
    wgpu::{self, TextureFormat as Format},
};

use crate::{
    gpu::Gpu,
    multires,
    testing::shot::{Shot, camera_of},
};

/// The texels of a level of an effect's, three channels each, whatever its format.
pub fn read_image(gpu: &Gpu, view: &wgpu::TextureView) -> Vec<DVec3> {
    let texels = multires::read_image(gpu, view.texture());
    texels
        .iter()
        .map(|t| DVec3::from(t.map(f64::from)))
        .collect()
}

/// A number of 0…1 of its arguments.
pub fn random(a: u32, b: u32) -> f64 {
    use deep_screen_space::reference::hashing::{hash2, unit_float};
    unit_float(hash2(a, b))
}

/// A camera at the origin that looks along −z.
pub fn camera(projection: DMat4, viewport: Viewport) -> Camera {
    Camera::look_at(DVec3::ZERO, -DVec3::Z, DVec3::Y, projection, viewport).expect("a camera")
}

/// What a camera's viewport shows, in textures that just reach its end, with garbage beside it.
pub struct Frame {
    pub camera: Camera,
    pub format: Format,
    /// As they are stored, rows from the top.
    pub depth: Vec<f64>,
    pub normal: Vec<DVec3>,
    pub depth_view: wgpu::TextureView,
    pub normal_view: wgpu::TextureView,
}

impl Frame {
    /// Of depths and normals. A depth format of 16 bits rounds the depths.
    pub fn new(
        gpu: &Gpu,
        camera: &Camera,
        format: Format,
        mut depth: Vec<f64>,
        normal: &[DVec3],
    ) -> Self {
        let normals: Vec<[f32; 4]> = normal
            .iter()
            .map(|n| n.as_vec3().extend(0.0).to_array())
            .collect();
        let depth_view = if format == Format::Depth16Unorm {
            let texels: Vec<u16> = depth.iter().map(|d| (d * 65535.0).round() as u16).collect();
            for (depth, &texel) in depth.iter_mut().zip(&texels) {
                *depth = f64::from(texel) / 65535.0;
            }
            framed(gpu, camera, format, &texels, 30000)
        } else {
            let texels: Vec<f32> = depth.iter().map(|&d| d as f32).collect();
            for (depth, &texel) in depth.iter_mut().zip(&texels) {
                *depth = f64::from(texel);
            }
            framed(gpu, camera, format, &texels, f32::NAN)
        };
        Self {
            camera: *camera,
            format,
            depth,
            normal: normals
                .iter()
                .map(|&[x, y, z, _]| DVec3::new(x.into(), y.into(), z.into()))
                .collect(),
            depth_view,
            normal_view: framed(gpu, camera, Format::Rgba32Float, &normals, [f32::NAN; 4]),
        }
    }

    /// Of a function that gives, for a pixel and the ray through its middle, the point in eye space and its normal;
    /// `None` is the sky.
    pub fn cast(
        gpu: &Gpu,
        camera: &Camera,
        format: Format,
        see: impl Fn([u32; 2], DVec3, DVec3) -> Option<(DVec3, DVec3)>,
    ) -> Self {
        let viewport = camera.viewport();
        let near = 1.0 - f64::from(camera.background_depth());
        let (depth, normal): (Vec<f64>, Vec<DVec3>) = (0..viewport.width * viewport.height)
            .map(|i| {
                let pixel = [i % viewport.width, i / viewport.width];
                let [x, y] = pixel.map(|p| f64::from(p) + 0.5);
                let from = camera.unproject(x, y, near).expect("a point");
                let beyond = camera.unproject(x, y, 0.5).expect("a point");
                match see(pixel, from, (beyond - from).normalize()) {
                    Some((point, normal)) => {
                        (camera.project(point).expect("a point in front").z, normal)
                    }
                    None => (f64::from(camera.background_depth()), DVec3::ZERO),
                }
            })
            .unzip();
        Self::new(gpu, camera, format, depth, &normal)
    }

    /// A scene's own view.
    pub fn of_scene(gpu: &Gpu, scene: &Scene, size: [u32; 2]) -> Self {
        Self::of_shot(gpu, &Shot::new(gpu, scene, &camera_of(scene, 0, size)))
    }

    /// What a camera sees of a scene.
    pub fn of_shot(gpu: &Gpu, shot: &Shot) -> Self {
        let camera = shot.camera;
        let depth = shot
            .pixels
            .iter()
            .map(|p| p.map_or(f64::from(camera.background_depth()), |p| p.depth))
            .collect();
        let normal: Vec<DVec3> = shot
            .pixels
            .iter()
            .map(|p| p.map_or(DVec3::ZERO, |p| p.receiver.shading_normal))
            .collect();
        Self::new(gpu, &camera, Format::R32Float, depth, &normal)
    }

    pub fn gbuffer(&self) -> GBuffer<'_> {
        GBuffer::new(self.depth_view.texture(), self.normal_view.texture())
    }

    pub fn decoder(&self) -> Decoder<'_> {
        Decoder {
            camera: &self.camera,
            origin: self.camera.eye(),
            depth_format: self.format,
            normal_encoding: NormalEncoding::Signed,
            normal_space: NormalSpace::World,
        }
    }

    /// The pixels relative to the eye.
    pub fn receivers(&self) -> Vec<Option<Receiver>> {
        let width = self.size()[0];
        (0..)
            .zip(self.depth.iter().zip(&self.normal))
            .map(|(i, (&depth, &normal))| {
                self.decoder()
                    .prepare([i % width, i / width], depth, normal)
            })
            .collect()
    }

    pub fn size(&self) -> [u32; 2] {
        let viewport = self.camera.viewport();
        [viewport.width, viewport.height]
    }

    pub fn input(&self) -> MultiResMaskInput<'_> {
        MultiResMaskInput {
            gbuffer: self.gbuffer(),
            camera: &self.camera,
            shading: None,
            edges: None,
            importance: None,
            timestamps: None,
        }
    }
}

/// Texels of a camera's viewport in a texture that just reaches its end, with `beside` beside it.
pub fn framed<T: bytemuck::Pod>(
    gpu: &Gpu,
    camera: &Camera,
    format: Format,
    texels: &[T],
    beside: T,
) -> wgpu::TextureView {
    let v = camera.viewport();
    let width = v.x + v.width;
    let mut all = vec![beside; (v.y * width) as usize];
    for row in texels.chunks_exact(v.width as usize) {
        all.extend(std::iter::repeat_n(beside, v.x as usize));
        all.extend_from_slice(row);
    }
    gpu.texture(format, width, v.y + v.height, &all)
}

/// Records the masks of a view of their own.
pub fn record(
    gpu: &Gpu,
    pass: &MultiResMask,
    input: &MultiResMaskInput<'_>,
    settings: &MultiResMaskSettings,
) -> MultiResView {
    let viewport = input.camera.viewport();
    let mut view = pass
        .create_view(&gpu.device, viewport.width, viewport.height, true)
        .expect("a view");
    let mut encoder = gpu.encoder();
    pass.record(&gpu.device, &mut encoder, input, settings, &mut view)
        .expect("masks");
    gpu.finish(encoder);
    view
}

/// A level's mask.
pub fn read_mask(gpu: &Gpu, view: &MultiResView, level: u32) -> Vec<f32> {
    let size = view.size().map(|n| n.div_ceil(1 << level));
    multires::read_blocks(gpu, view.mask(level).expect("a level"), size)
}

/// The pixels that a level lists.
pub fn read_list(gpu: &Gpu, view: &MultiResView, level: u32) -> Vec<u32> {
    let work = view.work(level).expect("a level");
    let words: Vec<u32> = gpu.read_buffer(work.pixels);
    words[1..=words[0] as usize].to_vec()
}

/// An effect's work lists: on every level each listed pixel is, bit by bit, the pixel of the whole image that it stands
/// for, and what is not listed is left alone. `record` records the effect into a target.
pub fn check_work(
    gpu: &Gpu,
    frame: &Frame,
    format: Format,
    record_effect: impl Fn(&mut wgpu::CommandEncoder, Option<PixelList<'_>>, &wgpu::TextureView),
) {
    let size = frame.size();
    let pass = pipelines::multi_res_mask();
    let view = record(gpu, pass, &frame.input(), &MultiResMaskSettings::OCCLUSION);
    let full = gpu.storage(format, size[0], size[1]);
    let mut encoder = gpu.encoder();
    record_effect(&mut encoder, None, &full);
    gpu.finish(encoder);
    let full = read_image(gpu, &full);
    for level in 0..4 {
        let [width, height] = size.map(|n| n.div_ceil(1 << level));
        let part = gpu.storage(format, width, height);
        let mut encoder = gpu.encoder();
        record_effect(&mut encoder, view.work(level), &part);
        gpu.finish(encoder);
        let part = read_image(gpu, &part);
        let mask = read_mask(gpu, &view, level);
        let mut listed = 0;
        for (i, (found, mask)) in (0..).zip(part.iter().zip(mask)) {
            let pixel = [i % width, i / width];
            let [x, y] = stands_for(pixel, level, size);
            if mask > 0.0 {
                listed += 1;
                let expected = full[(y * size[0] + x) as usize];
                assert_eq!(*found, expected, "level {level}, pixel {pixel:?}");
            } else {
                assert_eq!(*found, DVec3::ZERO, "level {level}, pixel {pixel:?}");
            }
        }
        assert!(listed > 0, "level {level}");
    }
}

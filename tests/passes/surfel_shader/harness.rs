//! A device, clouds on it and what they send, and the mirror of it.

use std::f64::consts::PI;

use deep_screen_space::{
    Camera, CloudCapacity, Geometry, Light, Material, Piece, Placement, ShadedLight, Shadow,
    Surfel, SurfelCloud, SurfelCounts, SurfelRadiance, SurfelShader, SurfelShaderInput,
    SurfelShaderSettings, SurfelSource, Surfelizer, SurfelizerInput, SurfelizerSettings, Viewport,
    glam::{DMat4, DVec3},
    reference::{self, packing::unpack_normal, surfel_shader as mirror},
    scenes::{Part, Scene},
    wgpu,
};

use support::{gpu::Gpu, raster::perspective, scene::SceneBuffers, shadow, testing::pipelines};

pub const ALBEDO: [f32; 3] = [0.2, 0.5, 1.0];

/// A device and the pipelines.
pub struct Lab {
    pub gpu: &'static Gpu,
    pub surfelizer: &'static Surfelizer,
    pub shader: &'static SurfelShader,
}

/// A cloud, and what it holds.
pub struct Lit {
    pub cloud: SurfelCloud,
    pub origin: DVec3,
    pub surfels: Vec<mirror::Surfel>,
}

impl Lab {
    pub fn new() -> Self {
        let gpu = pipelines::gpu();
        Self {
            surfelizer: pipelines::surfelizer(),
            shader: pipelines::surfel_shader(),
            gpu,
        }
    }

    fn empty_cloud(&self) -> SurfelCloud {
        let capacity = CloudCapacity {
            surfels: 1 << 15,
            pieces: 1 << 15,
            triangles: 1 << 15,
        };
        self.surfelizer
            .create_cloud(&self.gpu.device, capacity)
            .expect("a cloud")
    }

    pub fn cloud(&self, scene: &Scene, camera: &Camera, settings: &SurfelizerSettings) -> Lit {
        let mut cloud = self.empty_cloud();
        let buffers = SceneBuffers::new(self.gpu, scene);
        let mut encoder = self.gpu.encoder();
        let input = SurfelizerInput {
            geometry: Geometry {
                meshes: &buffers.meshes(),
            },
            camera,
            cull_by: &[],
            timestamps: None,
        };
        self.surfelizer
            .record(&self.gpu.device, &mut encoder, &input, settings, &mut cloud)
            .expect("surfels");
        self.gpu.finish(encoder);
        let counts: SurfelCounts = self.gpu.read_buffer(cloud.counters())[0];
        let stored = counts.stored as usize;
        let disks: Vec<Surfel> = self.gpu.read_buffer(cloud.surfels());
        let sources: Vec<SurfelSource> = self.gpu.read_buffer(cloud.sources());
        let pieces: Vec<Piece> = self.gpu.read_buffer(cloud.pieces());
        let origin = cloud.origin();
        let world = |p: [f32; 3]| DVec3::from(p.map(f64::from)) + origin;
        let surfels = disks[..stored]
            .iter()
            .zip(&sources)
            .map(|(disk, source)| {
                let piece = pieces[source.piece as usize];
                let piece_corners = reference::surfelizer::Triangle {
                    a: world(piece.a),
                    b: world(piece.b),
                    c: world(piece.c),
                };
                let order = piece.shape & 0xfff;
                mirror::Surfel {
                    position: world(disk.position),
                    normal: unpack_normal(source.normal),
                    material: source.material,
                    leaf: (settings.placement == Placement::Centroid)
                        .then(|| reference::surfelizer::leaf_of(piece_corners, source.leaf, order)),
                }
            })
            .collect();
        Lit {
            cloud,
            origin,
            surfels,
        }
    }

    /// What the surfels of a cloud send.
    pub fn shade(
        &self,
        lit: &Lit,
        materials: &[Material],
        lights: &[ShadedLight<'_>],
        samples: u32,
    ) -> Vec<SurfelRadiance> {
        let device = &self.gpu.device;
        let materials = self.gpu.buffer(materials, wgpu::BufferUsages::STORAGE);
        let radiance = self
            .shader
            .create_radiance(device, &lit.cloud)
            .expect("room");
        // What was there before must not matter.
        let old = vec![f32::NAN; radiance.size() as usize / 4];
        self.gpu
            .queue
            .write_buffer(&radiance, 0, bytemuck::cast_slice(&old));
        let input = SurfelShaderInput {
            cloud: &lit.cloud,
            materials: &materials,
            lights,
            radiance: &radiance,
            timestamps: None,
        };
        let mut encoder = self.gpu.encoder();
        let settings = SurfelShaderSettings { samples };
        self.shader
            .record(device, &mut encoder, &input, &settings)
            .expect("light");
        self.gpu.finish(encoder);
        let all: Vec<SurfelRadiance> = self.gpu.read_buffer(&radiance);
        let (written, rest) = all.split_at(lit.surfels.len());
        assert!(
            rest.iter()
                .all(|r| r.front[0].is_nan() && r.back[0].is_nan()),
            "written beyond the surfels"
        );
        written.to_vec()
    }
}

pub fn color(c: [f32; 3]) -> DVec3 {
    DVec3::from(c.map(f64::from))
}

pub fn material(albedo: [f32; 3], emission: [f32; 3]) -> Material {
    Material {
        albedo,
        emission,
        ..Material::default()
    }
}

pub fn unshadowed(light: Light) -> ShadedLight<'static> {
    ShadedLight {
        light,
        shadow: Shadow::None,
    }
}

pub fn point(position: DVec3, intensity: [f32; 3]) -> Light {
    Light::Point {
        position,
        intensity,
    }
}

/// Quadrilaterals of material 0; their corners run counter-clockwise seen from the front.
pub fn quads(list: &[[DVec3; 4]]) -> Scene {
    let positions: Vec<[f32; 3]> = list
        .iter()
        .flatten()
        .map(|p| p.as_vec3().to_array())
        .collect();
    let indices: Vec<u32> = (0..list.len() as u32)
        .flat_map(|quad| [0, 1, 2, 0, 2, 3].map(|corner| 4 * quad + corner))
        .collect();
    Scene {
        holes: None,
        name: "quads",
        normals: vec![[0.0, 1.0, 0.0]; positions.len()],
        parts: vec![Part {
            first_index: 0,
            index_count: indices.len() as u32,
            material: 0,
        }],
        positions,
        indices,
        materials: Vec::new(),
        views: Vec::new(),
        ao_radius: f32::INFINITY,
    }
}

/// Level squares, each a centre and half a side; fronts look up.
pub fn squares(list: &[(DVec3, f64)]) -> Scene {
    let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)];
    let quad = |(centre, half): &(DVec3, f64)| {
        corners.map(|(x, z)| *centre + DVec3::new(x, 0.0, z) * *half)
    };
    quads(&list.iter().map(quad).collect::<Vec<_>>())
}

pub fn above(height: f64) -> Camera {
    Camera::look_at(
        DVec3::Y * height,
        DVec3::ZERO,
        DVec3::NEG_Z,
        perspective(60.0, 1.0, 0.1),
        Viewport::full(64, 64),
    )
    .expect("a camera")
}

/// How depth is stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Convention {
    Forward,
    Reversed,
    InfiniteReversed,
    Orthographic,
    OrthographicReversed,
}

impl Convention {
    /// A projection that sees `half` to all sides at distance `at`, from `near` to `far`.
    pub fn projection(self, half: f64, at: f64, near: f64, far: f64) -> DMat4 {
        // Depth in terms of the distance z: a + b / z, or a + b z.
        let slope = at / half;
        let flip = |m: DMat4| {
            DMat4::from_cols_array(&[
                1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0, 1.0,
            ]) * m
        };
        let perspective = |a: f64, b: f64| {
            DMat4::from_cols_array(&[
                slope, 0.0, 0.0, 0.0, 0.0, slope, 0.0, 0.0, 0.0, 0.0, -a, -1.0, 0.0, 0.0, b, 0.0,
            ])
        };
        let finite = perspective(far / (far - near), -far * near / (far - near));
        let orthographic = DMat4::from_cols_array(&[
            1.0 / half,
            0.0,
            0.0,
            0.0,
            0.0,
            1.0 / half,
            0.0,
            0.0,
            0.0,
            0.0,
            -1.0 / (far - near),
            0.0,
            0.0,
            0.0,
            -near / (far - near),
            1.0,
        ]);
        match self {
            Self::Forward => finite,
            Self::Reversed => flip(finite),
            Self::InfiniteReversed => perspective(0.0, near),
            Self::Orthographic => orthographic,
            Self::OrthographicReversed => flip(orthographic),
        }
    }
}

/// Six cameras about a point, 90° each.
pub fn cube(eye: DVec3, texels: u32, near: f64) -> Vec<Camera> {
    let projection = Convention::InfiniteReversed.projection(1.0, 1.0, near, 0.0);
    DVec3::AXES
        .into_iter()
        .flat_map(|axis| [axis, -axis])
        .map(|axis| {
            let up = if axis.y == 0.0 { DVec3::Y } else { DVec3::Z };
            Camera::look_at(
                eye,
                eye + axis,
                up,
                projection,
                Viewport::full(texels, texels),
            )
            .expect("a face")
        })
        .collect()
}

/// A shadow map, and its texels where they can be read.
pub struct DepthMap {
    pub texture: wgpu::Texture,
    pub size: u32,
    pub depth: Vec<Vec<f32>>,
    step: f64,
}

impl DepthMap {
    /// As an engine would draw it: a layer a camera, both sides of all triangles, no bias.
    pub fn draw(
        gpu: &Gpu,
        scene: &Scene,
        cameras: &[Camera],
        size: u32,
        format: wgpu::TextureFormat,
    ) -> Self {
        let texture = shadow::draw(gpu, &SceneBuffers::new(gpu, scene), cameras, size, format);
        let layers = 0..cameras.len() as u32;
        let (depth, step) = match format {
            wgpu::TextureFormat::Depth32Float => {
                (layers.map(|l| gpu.read_texture(&texture, l)).collect(), 0.0)
            }
            wgpu::TextureFormat::Depth16Unorm => (
                layers
                    .map(|l| {
                        let texels: Vec<u16> = gpu.read_texture(&texture, l);
                        texels.iter().map(|d| f32::from(*d) / 65535.0).collect()
                    })
                    .collect(),
                1.0 / 65535.0,
            ),
            // Not to be read back.
            _ => (Vec::new(), 0.0),
        };
        Self {
            texture,
            size,
            depth,
            step,
        }
    }

    pub fn mirror<'a>(&'a self, cameras: &'a [Camera]) -> mirror::ShadowMap<'a> {
        mirror::ShadowMap {
            depth: &self.depth,
            width: self.size,
            cameras,
            bias: 1.0,
            depth_step: self.step,
        }
    }
}

/// How many surfels differ from the mirror by more than 1e-5 of what they would send if they faced all lights: f32 has
/// 1e-7 relative to the distance from the eye, and these scenes' lights are not much nearer.
pub fn differing(
    lit: &Lit,
    found: &[SurfelRadiance],
    materials: &[Material],
    lights: &[mirror::ShadedLight<'_>],
    samples: u32,
) -> usize {
    let mut worst = 0.0_f64;
    let mut differing = 0;
    for (surfel, found) in lit.surfels.iter().zip(found) {
        let expected = mirror::shade(surfel, materials, lights, samples);
        let facing: f64 = lights
            .iter()
            .map(|l| {
                reference::light::arrival(&l.light, surfel.position)
                    .irradiance
                    .max_element()
            })
            .sum();
        let scale = facing / PI + expected.front.max_element();
        let off = (color(found.front) - expected.front)
            .abs()
            .max((color(found.back) - expected.back).abs())
            .max_element();
        assert!(found.front.iter().chain(&found.back).all(|c| c.is_finite()));
        if off <= 1e-5 * scale {
            worst = worst.max(off / scale);
        } else {
            differing += 1;
        }
    }
    println!(
        "{} surfels, {differing} differ; the others by up to {worst:.1e}",
        lit.surfels.len()
    );
    differing
}

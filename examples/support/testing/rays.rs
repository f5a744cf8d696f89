//! Rays of pixels wired for tests: a device, pipelines, senders, and hits read back.

use crate::testing::pipelines;
use std::sync::LazyLock;

use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, BouncedView, BouncedZBuffer, Bvh, Camera,
    CloudCapacity, Geometry, HitRadiance, HitResolver, HitResolverDescriptor, HitResolverInput,
    HitResolverSettings, Light, Mesh, Payload, Piece, Primitives, Sampling, SurfelCloud,
    SurfelCounts, SurfelRadiance, Surfelizer, SurfelizerInput, SurfelizerSettings, Viewport,
    glam::DVec3,
    reference::{
        hashing::{hash2, unit_float},
        surfelizer as mirror,
    },
    scenes::{Part, Scene},
    wgpu,
};

use crate::{gpu::Gpu, testing::frames::Decoded, testing::shot::Shot};

/// The device and the pipelines, made once for all tests.
pub struct Lab {
    pub gpu: &'static Gpu,
    pub surfelizer: &'static Surfelizer,
    /// What rays meet.
    pub primitives: Primitives,
}

static LAB: LazyLock<Lab> = LazyLock::new(|| Lab::of(Primitives::Triangles));

pub fn lab() -> &'static Lab {
    &LAB
}

/// The caller's triangles, as they are.
pub fn triangles() -> SurfelizerSettings {
    SurfelizerSettings {
        density: f32::INFINITY,
        ..SurfelizerSettings::default()
    }
}

/// Room for what these tests make.
pub const AMPLE: CloudCapacity = CloudCapacity {
    surfels: 1 << 17,
    pieces: 1 << 16,
    triangles: 1 << 17,
};

/// A cloud with its bounds, and what it holds.
pub struct Senders {
    pub cloud: SurfelCloud,
    pub bounds: Bvh,
    pub counts: SurfelCounts,
    pub pieces: Vec<mirror::Piece>,
}

impl Lab {
    pub fn of(primitives: Primitives) -> Self {
        Self {
            gpu: pipelines::gpu(),
            surfelizer: pipelines::surfelizer(),
            primitives,
        }
    }

    pub fn tracer(&self, payload: Payload, sampling: Sampling) -> &'static BouncedZBuffer {
        pipelines::bounced(&BouncedDescriptor {
            payload,
            sampling,
            primitives: self.primitives,
            ..BouncedDescriptor::default()
        })
    }

    pub fn senders(
        &self,
        meshes: &[Mesh<'_>],
        camera: &Camera,
        settings: &SurfelizerSettings,
        capacity: CloudCapacity,
    ) -> Senders {
        let device = &self.gpu.device;
        let cloud = self
            .surfelizer
            .create_cloud(device, capacity)
            .expect("a cloud");
        let mut senders = Senders {
            bounds: pipelines::bvh_builder(self.primitives)
                .create(device, &cloud)
                .expect("bounds"),
            cloud,
            counts: SurfelCounts::default(),
            pieces: Vec::new(),
        };
        self.record_senders(&mut senders, meshes, camera, settings);
        senders
    }

    /// Records other triangles into the same buffers.
    pub fn record_senders(
        &self,
        senders: &mut Senders,
        meshes: &[Mesh<'_>],
        camera: &Camera,
        settings: &SurfelizerSettings,
    ) {
        let device = &self.gpu.device;
        let mut encoder = self.gpu.encoder();
        let input = SurfelizerInput {
            geometry: Geometry { meshes },
            camera,
            cull_by: &[],
            timestamps: None,
        };
        self.surfelizer
            .record(device, &mut encoder, &input, settings, &mut senders.cloud)
            .expect("surfels");
        pipelines::bvh_builder(self.primitives)
            .record(device, &mut encoder, &senders.cloud, &senders.bounds, None)
            .expect("bounds");
        self.gpu.finish(encoder);
        senders.counts = self.gpu.read_buffer(senders.cloud.counters())[0];
        let pieces: Vec<Piece> = self.gpu.read_buffer(senders.cloud.pieces());
        let taken =
            mirror::slots_taken(senders.counts.pieces, senders.cloud.capacity().pieces) as usize;
        let point = |p: [f32; 3]| DVec3::from(p.map(f64::from));
        senders.pieces = pieces[..taken]
            .iter()
            .map(|piece| mirror::Piece {
                corners: mirror::Triangle {
                    a: point(piece.a),
                    b: point(piece.b),
                    c: point(piece.c),
                },
                material: piece.material,
                shape: piece.shape,
                triangle: piece.triangle,
            })
            .collect();
    }

    pub fn view(
        &self,
        shot: &Shot,
        payload: Payload,
        sampling: Sampling,
        rays_per_pixel: u32,
    ) -> BouncedView {
        let Viewport { width, height, .. } = shot.camera.viewport();
        self.tracer(payload, sampling)
            .create_view(&self.gpu.device, width, height, rays_per_pixel)
            .expect("a view")
    }

    pub fn trace_into(
        &self,
        shot: &Shot,
        senders: &Senders,
        radiance: Option<&wgpu::Buffer>,
        settings: &BouncedSettings,
        sampling: Sampling,
        view: &BouncedView,
    ) {
        let camera = &shot.camera;
        let payload = if radiance.is_some() {
            Payload::Radiance
        } else {
            Payload::Occlusion
        };
        let mut encoder = self.gpu.encoder();
        let mut decoded = Decoded::of(camera);
        let origin = senders.cloud.origin();
        let frame = decoded.frame(&mut encoder, shot.gbuffer(), camera, origin);
        let input = BouncedInput {
            radiance: radiance.map_or(HitRadiance::None, HitRadiance::Surfels),
            ..BouncedInput::new(&frame, &senders.cloud, &senders.bounds)
        };
        self.tracer(payload, sampling)
            .record(&self.gpu.device, &mut encoder, &input, settings, view)
            .expect("hits");
        self.gpu.finish(encoder);
    }

    /// Occlusion without a buffer of radiance, radiance with one.
    pub fn trace(
        &self,
        shot: &Shot,
        senders: &Senders,
        radiance: Option<&wgpu::Buffer>,
        settings: &BouncedSettings,
        sampling: Sampling,
    ) -> BouncedView {
        let payload = if radiance.is_some() {
            Payload::Radiance
        } else {
            Payload::Occlusion
        };
        let view = self.view(shot, payload, sampling, settings.rays_per_pixel);
        self.trace_into(shot, senders, radiance, settings, sampling, &view);
        view
    }

    /// The words of bits of a view.
    pub fn blocked(&self, view: &BouncedView, settings: &BouncedSettings) -> Vec<u32> {
        let [width, height] = view.size();
        let words = settings.rays_per_pixel.div_ceil(32) * width * height;
        let mut all: Vec<u32> = self.gpu.read_buffer(view.blocked().expect("bits"));
        all.truncate(words as usize);
        all
    }

    /// The packed colours of a view, those of a pixel together.
    pub fn colors(&self, view: &BouncedView, settings: &BouncedSettings) -> Vec<u32> {
        let texture = view.radiance().expect("colours").texture();
        let layers: Vec<Vec<u32>> = (0..settings.rays_per_pixel.max(1))
            .map(|layer| self.gpu.read_texture(texture, layer))
            .collect();
        (0..layers[0].len())
            .flat_map(|pixel| layers.iter().map(move |layer| layer[pixel]))
            .collect()
    }

    pub fn reconstructor(
        &self,
        payload: Payload,
        sampling: Sampling,
        deferred: bool,
    ) -> &'static HitResolver {
        pipelines::hit_resolver(&HitResolverDescriptor {
            payload,
            sampling,
            deferred,
            counted: false,
            joined: false,
            bent_normals: false,
            emitter_samples: 0,
            target: wgpu::TextureFormat::Rgba32Float,
        })
    }

    /// The picture within the viewport.
    pub fn reconstruct(
        &self,
        reconstructor: &HitResolver,
        shot: &Shot,
        hits: &BouncedView,
        settings: &HitResolverSettings,
    ) -> Vec<[f32; 4]> {
        let device = &self.gpu.device;
        let Viewport {
            x,
            y,
            width,
            height,
        } = shot.camera.viewport();
        let scratch = reconstructor.create_view(device, hits).expect("a view");
        let target = self
            .gpu
            .target(wgpu::TextureFormat::Rgba32Float, x + width, y + height);
        let mut encoder = self.gpu.encoder();
        let mut decoded = Decoded::of(&shot.camera);
        let frame = decoded.frame(
            &mut encoder,
            shot.lit_gbuffer(),
            &shot.camera,
            shot.camera.focus(),
        );
        let input = HitResolverInput::new(&frame, hits, target.texture());
        reconstructor
            .record(device, &mut encoder, &input, settings, &scratch)
            .expect("a picture");
        self.gpu.finish(encoder);
        let all: Vec<[f32; 4]> = self.gpu.read_texture(target.texture(), 0);
        let row = (x + width) as usize;
        let (beside, inside): (Vec<_>, Vec<_>) = all
            .into_iter()
            .enumerate()
            .partition(|(i, _)| i / row < y as usize || i % row < x as usize);
        assert!(
            beside.iter().all(|(_, texel)| *texel == [0.0; 4]),
            "written beside the viewport"
        );
        inside.into_iter().map(|(_, texel)| texel).collect()
    }

    /// Radiance of all surfels that a cloud can hold, over six decades; no two are alike.
    pub fn motley(&self, senders: &Senders) -> (wgpu::Buffer, Vec<SurfelRadiance>) {
        let channel = |i: u32, channel: u32| {
            let draw = |salt| unit_float(hash2(i, channel + salt));
            (draw(0) * 10_f64.powf(6.0 * unit_float(hash2(i, 77)) - 3.0)) as f32
        };
        let all: Vec<SurfelRadiance> = (0..senders.cloud.capacity().surfels.max(1))
            .map(|i| SurfelRadiance {
                front: [0, 1, 2].map(|c| channel(i, c)),
                back: [3, 4, 5].map(|c| channel(i, c)),
                ..SurfelRadiance::default()
            })
            .collect();
        (self.gpu.buffer(&all, wgpu::BufferUsages::STORAGE), all)
    }
}

/// World-space triangles with flat normals, all of the material given.
pub fn scene_of(triangles: &[[DVec3; 3]], base: &Scene) -> Scene {
    let positions: Vec<[f32; 3]> = triangles
        .iter()
        .flatten()
        .map(|p| p.as_vec3().to_array())
        .collect();
    let normals = triangles
        .iter()
        .flat_map(|[a, b, c]| {
            let normal = (*b - *a).cross(*c - *a).normalize_or(DVec3::Y);
            [normal.as_vec3().to_array(); 3]
        })
        .collect();
    Scene {
        name: "triangles",
        normals,
        indices: (0..positions.len() as u32).collect(),
        parts: vec![Part {
            first_index: 0,
            index_count: positions.len() as u32,
            material: 0,
        }],
        positions,
        ..base.clone()
    }
}

/// The same scene elsewhere and larger.
pub fn moved(scene: &Scene, scale: f64, shift: DVec3) -> Scene {
    let place = |p: DVec3| p * scale + shift;
    let mut moved = scene.clone();
    for p in &mut moved.positions {
        *p = place(DVec3::from(p.map(f64::from))).as_vec3().to_array();
    }
    for view in &mut moved.views {
        view.eye = place(view.eye.into()).to_array();
        view.target = place(view.target.into()).to_array();
        view.near *= scale;
    }
    moved
}

/// A hall without its front wall, which would be at z = 20: 10 wide, 8 high and 40 long. From within nothing of it hides
/// anything.
pub fn hall(base: &Scene) -> Scene {
    let corner = |i: usize| {
        let side = |bit: usize, low: f64, high: f64| if i & bit == 0 { low } else { high };
        DVec3::new(side(1, -5.0, 5.0), side(2, 0.0, 8.0), side(4, -20.0, 20.0))
    };
    // Front sides face inward.
    let quads = [
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 5, 7, 3],
        [0, 1, 3, 2],
    ];
    let triangles: Vec<[DVec3; 3]> = quads
        .iter()
        .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
        .map(|face| face.map(corner))
        .collect();
    scene_of(&triangles, base)
}

/// Lights on its ceiling, on a wall, in an edge and in a corner, and near each; and spots that shine down from there.
pub fn lamps() -> Vec<Light> {
    let mut lamps = Vec::new();
    for off in [0.0, 1e-4, 1e-3, 0.1] {
        for (position, inward) in [
            (DVec3::new(0.0, 8.0, -10.0), DVec3::NEG_Y),
            (DVec3::new(-5.0, 3.0, -2.0), DVec3::X),
            (DVec3::new(5.0, 8.0, -7.0), DVec3::new(-1.0, -1.0, 0.0)),
            (DVec3::new(-5.0, 8.0, -20.0), DVec3::new(1.0, -1.0, 1.0)),
        ] {
            lamps.push(Light::Point {
                position: position + inward * off,
                intensity: [100.0; 3],
            });
            lamps.push(Light::Spot {
                position: position + inward * off,
                direction: inward + DVec3::new(0.1, -0.3, 0.2),
                intensity: [100.0; 3],
                inner: 0.5,
                outer: 1.2,
            });
        }
    }
    lamps
}

/// A sun, a lamp, one that is off, and a spot, in a scene that was [`moved`].
pub fn lights(scene: &Scene, scale: f64, shift: DVec3) -> Vec<Light> {
    let low = scene
        .positions
        .iter()
        .fold(DVec3::INFINITY, |a, p| a.min(DVec3::from(p.map(f64::from))));
    let high = scene.positions.iter().fold(DVec3::NEG_INFINITY, |a, p| {
        a.max(DVec3::from(p.map(f64::from)))
    });
    let place = |p: DVec3| (low + (high - low) * p) * scale + shift;
    let bright = (scale * scale) as f32 * (high - low).length_squared() as f32;
    vec![
        Light::Directional {
            direction: DVec3::new(0.3, -1.0, 0.2),
            irradiance: [1.0, 0.5, 0.25],
        },
        Light::Point {
            position: place(DVec3::new(0.4, 0.8, 0.55)),
            intensity: [0.1, 1.0, 0.3].map(|c| c * bright),
        },
        // None of it, and it takes no room.
        Light::Point {
            position: place(DVec3::splat(0.5)),
            intensity: [0.0; 3],
        },
        Light::Spot {
            position: place(DVec3::new(0.7, 0.9, 0.3)),
            direction: DVec3::new(-0.4, -1.0, 0.1),
            intensity: [0.2, 0.1, 2.0].map(|c| c * bright),
            inner: 0.2,
            outer: 0.7,
        },
    ]
}

/// A light by another origin.
pub fn relative(light: &Light, origin: DVec3) -> Light {
    let mut light = *light;
    if let Light::Point { position, .. } | Light::Spot { position, .. } = &mut light {
        *position -= origin;
    }
    light
}

/// How many bits differ.
pub fn differing_bits(a: &[u32], b: &[u32]) -> u32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum()
}

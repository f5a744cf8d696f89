//! The passes wired for tests that make their own G-buffer.

use crate::testing::{frames::Decoded, pipelines};
use deep_screen_space::{
    Camera, CloudCapacity, ClusterInput, Effect, Error, GBuffer, Geometry, Mesh, PositionFormat,
    ShellSplatter, SplatInput, SplatSettings, SplatView, SurfelCloud, SurfelClusters, Surfelizer,
    SurfelizerInput, SurfelizerSettings, Vertices,
    glam::DVec3,
    reference::{packing::unpack_normal, shell_splatter::Receiver},
    wgpu::{self, BufferUsages},
};

use crate::gpu::Gpu;

/// An effect of a test's own.
pub fn effect(source: &str, channels: u32, albedo: bool) -> Effect {
    Effect {
        channels,
        albedo,
        two_sided: true,
        ..Effect::new("test", source.to_owned())
    }
}

/// Pipelines, and a cloud of tiny triangles that become one surfel each, in their order.
pub struct Passes {
    surfelizer: &'static Surfelizer,
    splatter: &'static ShellSplatter,
    pub cloud: SurfelCloud,
    clusters: Option<SurfelClusters>,
    levels: u32,
}

impl Passes {
    /// Room for `surfels` of them.
    pub fn new(gpu: &Gpu, effect: &Effect, surfels: u32) -> Self {
        let device = &gpu.device;
        let surfelizer = pipelines::surfelizer();
        let splatter = pipelines::shell_splatter(effect, false);
        let capacity = CloudCapacity {
            surfels,
            pieces: surfels,
            triangles: surfels,
        };
        let cloud = surfelizer.create_cloud(device, capacity).expect("a cloud");
        Self {
            surfelizer,
            splatter,
            cloud,
            clusters: None,
            levels: 0,
        }
    }

    /// Makes the cloud for this many levels, about a camera's eye; `surfels` are relative to it.
    pub fn emit(&mut self, gpu: &Gpu, camera: &Camera, surfels: &[DVec3], levels: u32) {
        let device = &gpu.device;
        let count = surfels.len() as u32;
        let corners: Vec<[f32; 3]> = surfels
            .iter()
            .flat_map(|&p| {
                let side = 1e-3 * p.length();
                [DVec3::ZERO, DVec3::X * side, DVec3::Y * side]
                    .map(|corner| (camera.eye() + p + corner).as_vec3().to_array())
            })
            .collect();
        let vertices = gpu.buffer(&corners, BufferUsages::STORAGE);
        let mesh = Mesh {
            vertices: Vertices {
                buffer: &vertices,
                offset: 0,
                stride: 12,
                format: PositionFormat::Float32x3,
                count: 3 * count,
            },
            indices: None,
            first: 0,
            count: 3 * count,
            base_vertex: 0,
            instances: None,
            material: 0,
        };
        let settings = SurfelizerSettings {
            // Every triangle is smaller than such a surfel, and all are kept.
            radius_pixels: 1000.0,
            density: f32::INFINITY,
            ..SurfelizerSettings::default()
        };
        let mut encoder = gpu.encoder();
        self.surfelizer
            .record(
                device,
                &mut encoder,
                &SurfelizerInput {
                    geometry: Geometry { meshes: &[mesh] },
                    camera,
                    cull_by: &[],
                    timestamps: None,
                },
                &settings,
                &mut self.cloud,
            )
            .expect("surfels");
        let mut clusters = self
            .splatter
            .create_clusters(device, &self.cloud, levels)
            .expect("clusters");
        let settings = splat_settings(levels);
        self.splatter
            .record_clusters(
                device,
                &mut encoder,
                &ClusterInput::new(&self.cloud),
                &settings,
                &mut clusters,
            )
            .expect("clusters");
        gpu.finish(encoder);
        self.clusters = Some(clusters);
        self.levels = levels;
    }

    /// Decodes a G-buffer and sums the effect over it.
    pub fn splat(
        &self,
        gpu: &Gpu,
        gbuffer: GBuffer<'_>,
        camera: &Camera,
    ) -> Result<(Decoded<'static>, SplatView), Error> {
        let viewport = camera.viewport();
        let device = &gpu.device;
        let view =
            self.splatter
                .create_view(device, viewport.width, viewport.height, self.levels)?;
        let mut encoder = gpu.encoder();
        let mut decoded = Decoded::of(camera);
        let frame = decoded.record(&mut encoder, gbuffer, camera, self.cloud.origin())?;
        let clusters = self.clusters.as_ref().expect("emit comes first");
        self.splatter.record(
            device,
            &mut encoder,
            &SplatInput::new(&frame, &self.cloud, clusters),
            &splat_settings(self.levels),
            &view,
        )?;
        gpu.finish(encoder);
        Ok((decoded, view))
    }
}

fn splat_settings(levels: u32) -> SplatSettings {
    SplatSettings {
        levels,
        ..SplatSettings::default()
    }
}

/// The receivers that were decoded; `None` for the sky.
pub fn receivers(gpu: &Gpu, decoded: &Decoded<'_>) -> Vec<Option<Receiver>> {
    let texels: Vec<[u32; 4]> = gpu.read_texture(decoded.receivers.view().texture(), 0);
    texels
        .iter()
        .map(|&[x, y, z, n]| {
            (n != 0x8000_8000).then(|| Receiver {
                position: DVec3::from([x, y, z].map(|b| f64::from(f32::from_bits(b)))),
                normal: unpack_normal(n),
            })
        })
        .collect()
}

/// A texture for views that the passes are to accept or refuse.
pub fn texture(
    gpu: &Gpu,
    format: wgpu::TextureFormat,
    [width, height]: [u32; 2],
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    gpu.device
        .create_texture(&descriptor(format, [width, height], usage))
}

/// A plain one, to be altered.
pub fn descriptor(
    format: wgpu::TextureFormat,
    [width, height]: [u32; 2],
    usage: wgpu::TextureUsages,
) -> wgpu::TextureDescriptor<'static> {
    wgpu::TextureDescriptor {
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
    }
}

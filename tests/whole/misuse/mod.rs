//! What callers give by mistake: each is a typed error before anything is recorded, or works; nothing fails inside wgpu,
//! and nothing is silently wrong.

mod buffers;
mod empty;
mod engines;
mod recordings;
mod textures;

use std::sync::LazyLock;

use deep_screen_space::{
    AmbientOcclusion, BouncedDescriptor, BouncedInput, BouncedSettings, BouncedView,
    BouncedZBuffer, Bvh, BvhBuilder, Camera, CloudCapacity, ClusterInput, Error, GBuffer,
    GBufferDecoder, Geometry, HitLighting, HitRadiance, Material, Mesh, Payload, PositionFormat,
    Primitives, ShellSplatter, ShellSplatterDescriptor, SplatInput, SplatSettings, SplatView,
    SurfelCloud, SurfelClusters, Surfelizer, SurfelizerInput, SurfelizerSettings, Vertices,
    Viewport,
    glam::DVec3,
    wgpu::{self, BufferUsages, TextureFormat as Format},
};
use support::{
    gpu::{Ask, Gpu},
    raster::perspective,
    testing::frames::Decoded,
};

const SIDE: u32 = 8;

/// Pipelines take longest.
static LAB: LazyLock<Lab> = LazyLock::new(Lab::new);

/// A wall before the camera, its G-buffer, and passes that see it.
struct Lab {
    gpu: Gpu,
    camera: Camera,
    corners: wgpu::Buffer,
    depth: wgpu::TextureView,
    normal: wgpu::TextureView,
    albedo: wgpu::TextureView,
    materials: wgpu::Buffer,
    decoder: GBufferDecoder,
    surfelizer: Surfelizer,
    splatter: ShellSplatter,
    builder: BvhBuilder,
    bounced: BouncedZBuffer,
    lit: BouncedZBuffer,
}

const ROOM: CloudCapacity = CloudCapacity {
    surfels: 1 << 10,
    pieces: 1 << 10,
    triangles: 1,
};

fn splat() -> SplatSettings {
    SplatSettings {
        levels: 2,
        ..SplatSettings::default()
    }
}

impl Lab {
    fn new() -> Self {
        let gpu =
            Gpu::open(Ask::from_env()).expect("a graphics adapter; scripts/test.sh installs one");
        let device = &gpu.device;
        let camera = Camera::look_at(
            DVec3::ZERO,
            DVec3::NEG_Z,
            DVec3::Y,
            perspective(60.0, 1.0, 0.1),
            Viewport::full(SIDE, SIDE),
        )
        .expect("a camera");
        let texels = (SIDE * SIDE) as usize;
        let texture = |format, texels: &[[f32; 4]]| gpu.texture(format, SIDE, SIDE, texels);
        let effect = AmbientOcclusion::default().effect();
        let splatter = ShellSplatterDescriptor {
            effect: &effect,
            subgroups: false,
            statistics: false,
        };
        let lit = BouncedDescriptor {
            payload: Payload::LitRadiance,
            ..BouncedDescriptor::default()
        };
        let bounced = |descriptor| BouncedZBuffer::new(device, &descriptor).expect("pipelines");
        Self {
            corners: gpu.buffer(
                &[[-9.0_f32, -9.0, -2.0], [9.0, -9.0, -2.0], [0.0, 9.0, -2.0]],
                BufferUsages::STORAGE,
            ),
            depth: gpu.texture(Format::R32Float, SIDE, SIDE, &vec![0.05_f32; texels]),
            normal: texture(Format::Rgba32Float, &vec![[0.0, 0.0, 1.0, 0.0]; texels]),
            albedo: texture(Format::Rgba32Float, &vec![[0.5; 4]; texels]),
            materials: gpu.buffer(&[Material::default()], BufferUsages::STORAGE),
            decoder: GBufferDecoder::new(device).expect("pipelines"),
            surfelizer: Surfelizer::new(device).expect("pipelines"),
            splatter: ShellSplatter::new(device, &splatter).expect("pipelines"),
            builder: BvhBuilder::new(&gpu.device, Primitives::Triangles).expect("pipelines"),
            bounced: bounced(BouncedDescriptor::default()),
            lit: bounced(lit),
            camera,
            gpu,
        }
    }

    fn gbuffer(&self) -> GBuffer<'_> {
        GBuffer {
            albedo: Some(self.albedo.texture().into()),
            ..GBuffer::new(self.depth.texture(), self.normal.texture())
        }
    }

    fn decoded(&self) -> Decoded<'_> {
        Decoded::on(&self.gpu.device, &self.decoder, &self.camera)
    }

    fn cloud(&self, capacity: CloudCapacity) -> SurfelCloud {
        let cloud = self.surfelizer.create_cloud(&self.gpu.device, capacity);
        cloud.expect("a cloud")
    }

    fn wall(&self) -> Mesh<'_> {
        Mesh {
            vertices: Vertices {
                buffer: &self.corners,
                offset: 0,
                stride: 12,
                format: PositionFormat::Float32x3,
                count: 3,
            },
            indices: None,
            first: 0,
            count: 3,
            base_vertex: 0,
            instances: None,
            material: 0,
        }
    }

    fn record_mesh(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        mesh: Mesh<'_>,
        cloud: &mut SurfelCloud,
    ) -> Result<(), Error> {
        let input = SurfelizerInput {
            geometry: Geometry { meshes: &[mesh] },
            camera: &self.camera,
            cull_by: &[],
            timestamps: None,
        };
        let settings = SurfelizerSettings::default();
        self.surfelizer
            .record(&self.gpu.device, encoder, &input, &settings, cloud)
    }

    fn record_cloud(&self, encoder: &mut wgpu::CommandEncoder, cloud: &mut SurfelCloud) {
        self.record_mesh(encoder, self.wall(), cloud)
            .expect("surfels");
    }

    /// A cloud that was recorded.
    fn recorded(&self, encoder: &mut wgpu::CommandEncoder, capacity: CloudCapacity) -> SurfelCloud {
        let mut cloud = self.cloud(capacity);
        self.record_cloud(encoder, &mut cloud);
        cloud
    }

    fn clusters(&self, cloud: &SurfelCloud) -> SurfelClusters {
        let clusters = self.splatter.create_clusters(&self.gpu.device, cloud, 2);
        clusters.expect("clusters")
    }

    fn record_clusters(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        cloud: &SurfelCloud,
        clusters: &mut SurfelClusters,
    ) -> Result<(), Error> {
        let input = ClusterInput::new(cloud);
        self.splatter
            .record_clusters(&self.gpu.device, encoder, &input, &splat(), clusters)
    }

    fn splat_view(&self) -> SplatView {
        let view = self.splatter.create_view(&self.gpu.device, SIDE, SIDE, 2);
        view.expect("a view")
    }

    fn splat(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (cloud, clusters): (&SurfelCloud, &SurfelClusters),
        view: &SplatView,
    ) -> Result<(), Error> {
        let mut decoded = self.decoded();
        let frame = decoded.frame(encoder, self.gbuffer(), &self.camera, cloud.origin());
        let input = SplatInput::new(&frame, cloud, clusters);
        self.splatter
            .record(&self.gpu.device, encoder, &input, &splat(), view)
    }

    fn bvh(&self, cloud: &SurfelCloud) -> Bvh {
        let bvh = self.builder.create(&self.gpu.device, cloud);
        bvh.expect("room")
    }

    fn record_bvh(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        cloud: &SurfelCloud,
        bvh: &Bvh,
    ) -> Result<(), Error> {
        self.builder
            .record(&self.gpu.device, encoder, cloud, bvh, None)
    }

    fn hits(&self, pass: &BouncedZBuffer) -> BouncedView {
        let view = pass.create_view(&self.gpu.device, SIDE, SIDE, 4);
        view.expect("a view")
    }

    /// Rays of either pass; the lit one's materials may be others.
    fn trace(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pass: &BouncedZBuffer,
        (cloud, bounds): (&SurfelCloud, &Bvh),
        materials: &wgpu::Buffer,
        view: &BouncedView,
    ) -> Result<(), Error> {
        let mut decoded = self.decoded();
        let frame = decoded.frame(encoder, self.gbuffer(), &self.camera, cloud.origin());
        let input = BouncedInput {
            radiance: HitRadiance::Lit(HitLighting {
                materials,
                lights: &[],
            }),
            ..BouncedInput::new(&frame, cloud, bounds)
        };
        let settings = BouncedSettings {
            rays_per_pixel: 4,
            ..BouncedSettings::default()
        };
        pass.record(&self.gpu.device, encoder, &input, &settings, view)
    }
}

/// What wgpu itself finds wrong is an uncaptured error, which ends the test.
fn submit(lab: &Lab, encoder: wgpu::CommandEncoder) {
    lab.gpu.finish(encoder);
}

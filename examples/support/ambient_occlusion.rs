//! The passes wired together for ambient occlusion by splatting.

use deep_screen_space::{
    AmbientOcclusion, Camera, CloudCapacity, ClusterInput, Geometry, Mesh, Reconstructor,
    ReconstructorInput, ReconstructorView, ShellSplatter, ShellSplatterDescriptor, SplatInput,
    SplatView, SurfelCloud, SurfelClusters, SurfelCounts, Surfelizer, SurfelizerInput, wgpu,
};

use super::{decoding::Decoding, gpu::Gpu, presets::Preset, raster::Raster};

/// The pipelines and one view.
pub struct Renderer {
    surfelizer: Surfelizer,
    splatter: ShellSplatter,
    reconstructor: Reconstructor,
    pub cloud: SurfelCloud,
    clusters: SurfelClusters,
    pub decoding: Decoding,
    pub view: SplatView,
    scratch: ReconstructorView,
    target: wgpu::TextureView,
}

/// The image, 1 = open, and what it took.
pub struct Rendered {
    pub visibility: Vec<f32>,
    /// A name and milliseconds by `Gpu::stopwatch` per pass.
    pub passes: Vec<(&'static str, f64)>,
    pub counts: SurfelCounts,
}

impl Rendered {
    pub fn total_ms(&self) -> f64 {
        self.passes.iter().map(|p| p.1).sum()
    }
}

impl Renderer {
    pub fn new(
        gpu: &Gpu,
        effect: AmbientOcclusion,
        capacity: CloudCapacity,
        [width, height]: [u32; 2],
        levels: u32,
        statistics: bool,
    ) -> Result<Self, deep_screen_space::Error> {
        let device = &gpu.device;
        let effect = effect.effect();
        let surfelizer = Surfelizer::new(device)?;
        let splatter = ShellSplatter::new(
            device,
            &ShellSplatterDescriptor {
                effect: &effect,
                subgroups: device
                    .features()
                    .contains(ShellSplatter::optional_features()),
                statistics,
            },
        )?;
        let format = wgpu::TextureFormat::R32Float;
        let reconstructor = splatter.reconstructor(device, format)?;
        let cloud = surfelizer.create_cloud(device, capacity)?;
        let view = splatter.create_view(device, width, height, levels)?;
        Ok(Self {
            clusters: splatter.create_clusters(device, &cloud, levels)?,
            scratch: reconstructor.create_view(device, &view)?,
            decoding: Decoding::new(gpu, [width, height])?,
            view,
            target: gpu.target(format, width, height),
            surfelizer,
            splatter,
            reconstructor,
            cloud,
        })
    }

    /// GPU memory of everything that the passes own, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.cloud.memory_bytes()
            + self.clusters.memory_bytes()
            + self.decoding.memory_bytes()
            + self.view.memory_bytes()
            + self.scratch.memory_bytes()
    }

    /// Renders once, one submission per pass, so that each can be timed on any driver.
    pub fn render(
        &mut self,
        gpu: &Gpu,
        raster: &Raster,
        meshes: &[Mesh<'_>],
        camera: &Camera,
        preset: &Preset,
    ) -> Result<Rendered, deep_screen_space::Error> {
        let device = &gpu.device;
        let mut settings = preset.surfelizer;
        settings.reach = ShellSplatter::reach(&preset.splat);
        let (surfelize_ms, done) = gpu.time(|encoder| {
            self.surfelizer.record(
                device,
                encoder,
                &SurfelizerInput {
                    geometry: Geometry { meshes },
                    camera,
                    cull_by: &[*camera],
                    timestamps: None,
                },
                &settings,
                &mut self.cloud,
            )
        });
        done?;
        let (cluster_ms, done) = gpu.time(|encoder| {
            self.splatter.record_clusters(
                device,
                encoder,
                &ClusterInput::new(&self.cloud),
                &preset.splat,
                &mut self.clusters,
            )
        });
        done?;
        let origin = self.cloud.origin();
        let (decode_ms, frame) = self.decoding.frame(gpu, raster.gbuffer(), camera, origin)?;
        let (splat_ms, done) = gpu.time(|encoder| {
            self.splatter.record(
                device,
                encoder,
                &SplatInput::new(&frame, &self.cloud, &self.clusters),
                &preset.splat,
                &self.view,
            )
        });
        done?;
        let (reconstruct_ms, done) = gpu.time(|encoder| {
            self.reconstructor.record(
                device,
                encoder,
                &ReconstructorInput::new(&frame, &self.view, self.target.texture()),
                &preset.reconstructor,
                &self.scratch,
            )
        });
        done?;
        let counts: Vec<SurfelCounts> = gpu.read_buffer(self.cloud.counters());
        Ok(Rendered {
            visibility: gpu.read_texture(self.target.texture(), 0),
            passes: vec![
                ("surfelize", surfelize_ms),
                ("cluster", cluster_ms),
                ("decode", decode_ms),
                ("splat", splat_ms),
                ("reconstruct", reconstruct_ms),
            ],
            counts: counts[0],
        })
    }
}

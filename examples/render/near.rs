//! Effects of the near field, which read the G-buffer alone.

use deep_screen_space::{
    CloudCapacity, DiskSamples, Error, ObscuranceInput, ObscuranceSampling, ObscuranceSettings,
    ObscuranceVolume, SurfelCounts, VolumetricObscurance, VolumetricObscuranceDescriptor,
    scenes::Scene,
    wgpu::{self, TextureFormat, TextureUsages},
};
use serde_json::json;

use crate::{
    Options,
    methods::{Rendered, twice},
    support::{gpu::Gpu, raster::Raster, scene::SceneBuffers},
    view::Shot,
};

/// A share of a scene's radius: obscurance is of what is near.
const SHARE: f32 = 0.25;

/// Volumetric obscurance.
pub fn obscurance(
    gpu: &Gpu,
    options: &Options,
    scene: &Scene,
    shot: &Shot,
    radius: f32,
) -> Result<Rendered, String> {
    let camera = shot.camera()?;
    let buffers = SceneBuffers::new(gpu, scene);
    let raster = Raster::draw(gpu, &buffers, &camera);
    let samples = match options.preset.as_str() {
        "fast" => DiskSamples::Five,
        "accurate" => DiskSamples::Sixteen,
        _ => DiskSamples::Nine,
    };
    let settings = ObscuranceSettings {
        // A radius that the command line gives is taken as it is.
        radius: options.radius.unwrap_or(SHARE * radius),
        ..ObscuranceSettings::default()
    };
    let descriptor = VolumetricObscuranceDescriptor {
        sampling: ObscuranceSampling::Lines(samples),
        volume: ObscuranceVolume::Hemisphere,
        cache: None,
    };
    let pass = VolumetricObscurance::new(&gpu.device, &descriptor).map_err(|e| e.to_string())?;
    let target = target(gpu, shot);
    let view = target.create_view(&wgpu::TextureViewDescriptor::default());
    let gbuffer = raster.gbuffer();
    let input = ObscuranceInput {
        depth: gbuffer.depth,
        normals: Some(gbuffer.normals()),
        camera: &camera,
        moments: None,
        work: None,
        target: &view,
        timestamps: None,
    };
    let render = || -> Result<f64, Error> {
        let (ms, recorded) =
            gpu.time(|encoder| pass.record(&gpu.device, encoder, &input, &settings));
        recorded.map(|()| ms)
    };
    let ms = twice(render, |ms| *ms)?;
    let image: Vec<f32> = gpu.read_texture(&target, 0);
    Ok(Rendered {
        pixels: image.iter().map(|&v| [v; 3]).collect(),
        triangles: buffers.triangles(),
        capacity: CloudCapacity {
            surfels: 0,
            pieces: 0,
            triangles: 0,
        },
        counts: SurfelCounts::default(),
        surfels_made: false,
        passes: vec![("volumetric obscurance", ms)],
        memory_bytes: 0,
        settings: json!({
            "lines": samples.table().len(),
            "radius": settings.radius,
            "max_pixels": settings.max_pixels,
        }),
    })
}

fn target(gpu: &Gpu, shot: &Shot) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width: shot.width,
            height: shot.height,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: TextureFormat::R32Float,
        usage: TextureUsages::STORAGE_BINDING | TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

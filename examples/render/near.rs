//! Effects of the near field, which read the G-buffer alone.

use deep_screen_space::{
    CloudCapacity, DiskSamples, Error, Light, ObscuranceInput, ObscuranceSampling,
    ObscuranceSettings, ObscuranceVolume, SurfelCounts, VolumetricObscurance,
    VolumetricObscuranceDescriptor,
    glam::DVec3,
    scenes::Scene,
    wgpu::{self, TextureFormat, TextureUsages},
};
use serde_json::{Value, json};

use crate::{
    Options,
    methods::{Rendered, twice},
    support::{
        errors::rmse,
        gpu::Gpu,
        multires::{Masked, read_image},
        near::{Effect, Passes, Stage},
        raster::Raster,
        scene::SceneBuffers,
    },
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
        "fast" => DiskSamples::Six,
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
    let gbuffer = raster.gbuffer();
    let input = ObscuranceInput {
        depth: gbuffer.depth,
        normals: Some(gbuffer.normals()),
        camera: &camera,
        moments: None,
        work: None,
        target: (&target).into(),
        timestamps: None,
    };
    let render = || -> Result<f64, Error> {
        let (ms, recorded) =
            gpu.time(|encoder| pass.record(&gpu.device, encoder, &input, &settings));
        recorded.map(|()| ms)
    };
    let ms = twice(render, |ms| *ms)?;
    let image: Vec<f32> = gpu.read_texture(&target, 0);
    Ok(rendered(
        image.iter().map(|&v| [v; 3]).collect(),
        &buffers,
        vec![("volumetric obscurance", ms)],
        json!({
            "lines": samples.table().len(),
            "radius": settings.radius,
            "max_pixels": settings.max_pixels,
        }),
    ))
}

/// Of what reads the G-buffer alone: there is no cloud.
fn rendered(
    pixels: Vec<[f32; 3]>,
    buffers: &SceneBuffers,
    passes: Vec<(&'static str, f64)>,
    settings: Value,
) -> Rendered {
    Rendered {
        pixels,
        triangles: buffers.triangles(),
        capacity: CloudCapacity {
            surfels: 0,
            pieces: 0,
            triangles: 0,
        },
        counts: SurfelCounts::default(),
        surfels_made: false,
        passes,
        memory_bytes: 0,
        settings,
    }
}

/// An effect at full resolution, or with `--multires` by sub-images.
pub fn of_pixels(
    gpu: &Gpu,
    options: &Options,
    scene: &Scene,
    shot: &Shot,
    effect: Effect,
) -> Result<Rendered, String> {
    let error = |e: Error| e.to_string();
    let camera = shot.camera()?;
    let buffers = SceneBuffers::new(gpu, scene);
    // Where there is no light, one beside the camera.
    let light = shot.lights().first().copied().unwrap_or_else(|| {
        let along = DVec3::from(shot.target) - DVec3::from(shot.eye);
        let up = DVec3::from(shot.up);
        let right = along.cross(up).normalize_or_zero();
        Light::Point {
            position: camera.eye() + 0.12 * along.length() * (right + up),
            intensity: [1.0; 3],
        }
    });
    let passes = Passes::new(&gpu.device).map_err(error)?;
    let mut stage = Stage::of(gpu, &passes, scene, &buffers, &camera, light).map_err(error)?;
    if let Some(radius) = options.radius {
        stage.reach = radius;
    }
    let size = stage.size();
    let what = (effect, effect.samples());
    let full = gpu.storage(effect.format(), size[0], size[1]);
    let of_all = || {
        let (ms, done) =
            gpu.time(|encoder| passes.record(&stage, encoder, what, None, full.texture()));
        done.map(|()| ms)
    };
    let full_ms = twice(of_all, |ms| *ms)?;
    let image = read_image(gpu, full.texture());
    let samples = effect.samples();
    let reach = stage.reach;
    if !options.multires {
        let settings = json!({ "samples": samples, "reach": reach });
        return Ok(rendered(
            image,
            &buffers,
            vec![(effect.name(), full_ms)],
            settings,
        ));
    }
    let mut masked = Masked::new(gpu, &passes, effect, effect.mask(), size).map_err(error)?;
    let of_parts = || {
        let (mask_ms, done) = gpu.time(|e| masked.record_masks(&passes, &stage, e));
        done?;
        let (images_ms, done) = gpu.time(|e| masked.record_images(&passes, &stage, e, samples));
        done?;
        let (blend_ms, done) = gpu.time(|e| masked.record_blend(&stage, e));
        done?;
        Ok(vec![
            ("masks", mask_ms),
            ("sub-images", images_ms),
            ("blend", blend_ms),
        ])
    };
    let times = twice(of_parts, |times| times.iter().map(|t| t.1).sum())?;
    let computed: u32 = masked.counts(gpu).iter().sum();
    let share = f64::from(computed) / f64::from(size[0] * size[1]);
    let pixels = read_image(gpu, masked.target.texture());
    let off = rmse(image.as_flattened(), pixels.as_flattened());
    println!(
        "{:.1} % of the pixels computed; at full resolution {full_ms:.1} ms, RMSE {off:.4}",
        100.0 * share
    );
    let settings = json!({
        "samples": samples,
        "reach": reach,
        "computed_share": share,
        "full_ms": full_ms,
        "rmse": off,
    });
    Ok(rendered(pixels, &buffers, times, settings))
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

//! Volumetric obscurance: the shader against its mirror, both against the integral that they estimate, and what must hold at
//! extremes.

#[path = "../examples/support/mod.rs"]
mod support;

use deep_screen_space::{
    BallSamples, Camera, Combine, DepthMoments, DiskSamples, Error, NormalEncoding, NormalSpace,
    Normals, ObscuranceInput, ObscuranceSampling, ObscuranceSettings, ObscuranceVolume,
    SecondRadius, Viewport, VolumetricObscurance, VolumetricObscuranceDescriptor, WorkList,
    glam::{DMat4, DVec3},
    reference::{
        depth_moments::Pyramid,
        gbuffer::{Pixel, cast},
        receivers::Decoder,
        sample_tables::{Domain, TOLERANCE, generate},
        trace::Tracer,
        volumetric_obscurance::{DepthBuffer, integral_of_geometry},
    },
    scenes::{self, Scene},
    wgpu::{self, TextureFormat, TextureUsages},
};
use support::{
    gpu::{Ask, Gpu},
    raster::perspective,
};

const LINES: ObscuranceSampling = ObscuranceSampling::Lines(DiskSamples::Five);

/// A picture's depth and normals, cast in f64.
struct Shot {
    camera: Camera,
    depths: Vec<f32>,
    normals: Vec<[f32; 3]>,
    /// What was cast, in the world.
    pixels: Vec<Option<Pixel>>,
}

impl Shot {
    fn new(camera: Camera, scene: &Scene, tracer: &Tracer) -> Self {
        let pixels = cast(
            &camera,
            tracer,
            &scene.positions,
            &scene.normals,
            &scene.indices,
        );
        let sky = f64::from(camera.background_depth());
        let normal = |p: &Option<Pixel>| p.map_or(DVec3::ZERO, |p| p.receiver.shading_normal);
        Self {
            camera,
            depths: pixels
                .iter()
                .map(|p| p.map_or(sky, |p| p.depth) as f32)
                .collect(),
            normals: pixels
                .iter()
                .map(|p| normal(p).as_vec3().to_array())
                .collect(),
            pixels,
        }
    }

    /// The first view of a scene of the crate.
    fn of(scene: &Scene, tracer: &Tracer, [width, height]: [u32; 2]) -> Self {
        Self::new(
            camera_of(scene, DVec3::ZERO, [width, height]),
            scene,
            tracer,
        )
    }

    fn size(&self) -> [u32; 2] {
        let viewport = self.camera.viewport();
        [viewport.width, viewport.height]
    }

    fn mirror(&self) -> DepthBuffer<'_> {
        DepthBuffer {
            decoder: Decoder {
                camera: &self.camera,
                origin: DVec3::ZERO,
                depth_format: TextureFormat::R32Float,
                normal_encoding: NormalEncoding::Signed,
                normal_space: NormalSpace::World,
            },
            depths: &self.depths,
            normals: &self.normals,
        }
    }

    fn pixels(&self) -> impl Iterator<Item = [u32; 2]> + use<> {
        let [width, height] = self.size();
        (0..width * height).map(move |i| [i % width, i / width])
    }

    /// The mirror's picture.
    fn mirrored(&self, case: &Case) -> Vec<f64> {
        let mirror = self.mirror();
        let pyramid = Pyramid::new(self.size(), &mirror.view_depths());
        let pyramid = Some(&pyramid);
        self.pixels()
            .map(|p| mirror.openness(p, case.sampling, case.volume, &case.settings, pyramid))
            .collect()
    }
}

/// The first view of a scene, its eye moved along the camera's axes.
fn camera_of(scene: &Scene, shift: DVec3, [width, height]: [u32; 2]) -> Camera {
    let view = &scene.views[0];
    let aspect = f64::from(width) / f64::from(height);
    Camera::look_at(
        DVec3::from(view.eye) + shift,
        DVec3::from(view.target) + shift,
        view.up.into(),
        perspective(view.vertical_fov_degrees, aspect, view.near),
        Viewport::full(width, height),
    )
    .expect("a scene's own view")
}

/// What to compute.
#[derive(Clone, Copy, Debug)]
struct Case {
    sampling: ObscuranceSampling,
    volume: ObscuranceVolume,
    settings: ObscuranceSettings,
}

impl Case {
    fn pass(&self, gpu: &Gpu) -> VolumetricObscurance {
        let descriptor = VolumetricObscuranceDescriptor {
            sampling: self.sampling,
            volume: self.volume,
            cache: None,
        };
        VolumetricObscurance::new(&gpu.device, &descriptor).expect("pipelines")
    }

    fn takes_areas(&self) -> bool {
        matches!(
            self.sampling,
            ObscuranceSampling::Areas(_) | ObscuranceSampling::OneArea
        )
    }
}

/// A texture to compute into, filled with -1 so that what is not written shows.
fn target(gpu: &Gpu, [width, height]: [u32; 2]) -> wgpu::Texture {
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: TextureFormat::R32Float,
        usage: TextureUsages::STORAGE_BINDING | TextureUsages::COPY_SRC | TextureUsages::COPY_DST,
        view_formats: &[],
    });
    gpu.queue.write_texture(
        texture.as_image_copy(),
        bytemuck::cast_slice(&vec![-1.0_f32; (width * height) as usize]),
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(4 * width),
            rows_per_image: None,
        },
        texture.size(),
    );
    texture
}

/// The GPU's picture.
fn rendered(gpu: &Gpu, shot: &Shot, case: &Case) -> Vec<f32> {
    let [width, height] = shot.size();
    let normals: Vec<[f32; 4]> = shot
        .normals
        .iter()
        .map(|n| [n[0], n[1], n[2], 0.0])
        .collect();
    let depth = gpu.texture(TextureFormat::R32Float, width, height, &shot.depths);
    let normal = gpu.texture(TextureFormat::Rgba32Float, width, height, &normals);
    let pass = case.pass(gpu);
    let moments = case.takes_areas().then(|| {
        pass.create_moments(&gpu.device, width, height)
            .expect("moments")
    });
    let texture = target(gpu, [width, height]);
    record(
        gpu,
        &pass,
        shot,
        &depth,
        &normal,
        moments.as_ref(),
        &texture,
        &case.settings,
    )
    .expect("valid input");
    gpu.read_texture(&texture, 0)
}

#[allow(clippy::too_many_arguments)]
fn record(
    gpu: &Gpu,
    pass: &VolumetricObscurance,
    shot: &Shot,
    depth: &wgpu::TextureView,
    normal: &wgpu::TextureView,
    moments: Option<&DepthMoments>,
    target: &wgpu::Texture,
    settings: &ObscuranceSettings,
) -> Result<(), Error> {
    let mut encoder = gpu.encoder();
    if let Some(moments) = moments {
        pass.record_moments(
            &gpu.device,
            &mut encoder,
            depth,
            &shot.camera,
            moments,
            None,
        )?;
    }
    let input = ObscuranceInput {
        depth,
        normals: Some(Normals {
            view: normal,
            encoding: NormalEncoding::Signed,
            space: NormalSpace::World,
        }),
        camera: &shot.camera,
        moments,
        work: None,
        target: &target.create_view(&wgpu::TextureViewDescriptor::default()),
        timestamps: None,
    };
    pass.record(&gpu.device, &mut encoder, &input, settings)?;
    gpu.finish(encoder);
    Ok(())
}

const VOLUMES: [ObscuranceVolume; 3] = [
    ObscuranceVolume::Sphere,
    ObscuranceVolume::Hemisphere,
    ObscuranceVolume::TangentSphere,
];

/// How many items may be further off than `tolerance`: a share.
fn check(what: &str, gpu: &[f32], mirror: &[f64], tolerance: f64, share: f64) {
    assert_eq!(gpu.len(), mirror.len(), "{what}");
    let off = |(a, b): (&f32, &f64)| (f64::from(*a) - b).abs();
    let beyond = gpu
        .iter()
        .zip(mirror)
        .filter(|&pair| !(off(pair) <= tolerance))
        .count();
    let worst = gpu.iter().zip(mirror).map(off).fold(0.0, f64::max);
    println!(
        "{what}: {beyond} of {} beyond {tolerance}, worst {worst}",
        gpu.len()
    );
    assert!(
        beyond as f64 <= share * gpu.len() as f64,
        "{what}: {beyond} of {} are further off than {tolerance}, the worst {worst}",
        gpu.len()
    );
    assert!(
        gpu.iter().all(|v| (0.0..=1.0).contains(v)),
        "{what}: not all in 0...1"
    );
}

fn scene(name: &str) -> (Scene, Tracer) {
    let scene = scenes::by_name(name).expect("a scene of the crate");
    let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a valid mesh");
    (scene, tracer)
}

fn settings(radius: f32) -> ObscuranceSettings {
    ObscuranceSettings {
        radius,
        ..ObscuranceSettings::default()
    }
}

#[test]
fn the_shader_agrees_with_its_mirror() {
    let gpu = Gpu::open(Ask::from_env()).expect("a graphics adapter");
    let (scene, tracer) = scene("colonnade");
    let shot = Shot::of(&scene, &tracer, [75, 50]);
    let samplings = [
        ObscuranceSampling::Points(BallSamples::Twelve),
        ObscuranceSampling::Points(BallSamples::ThirtyThree),
        LINES,
        ObscuranceSampling::Lines(DiskSamples::TwelveAround),
        ObscuranceSampling::Areas(DiskSamples::Seven),
        ObscuranceSampling::OneArea,
    ];
    for sampling in samplings {
        for volume in VOLUMES {
            let plain = settings(0.5 * scene.ao_radius);
            let thick = ObscuranceSettings {
                thickness: 0.3 * scene.ao_radius,
                second: Some(SecondRadius {
                    radius: 0.2 * scene.ao_radius,
                    combine: Combine::Minimum,
                }),
                max_pixels: 9.0,
                seed: 7,
                ..plain
            };
            for settings in [plain, thick] {
                let case = Case {
                    sampling,
                    volume,
                    settings,
                };
                // A sample within rounding of a pixel's edge falls to either side of it. Of an area the deviation is the root
                // of how much a neighbouring pixel counts: f32's 1e-7 of one beside a jump of 10 radii shows as 0.005.
                let tolerance = if case.takes_areas() { 1e-2 } else { 1e-4 };
                let (gpu, mirror) = (rendered(&gpu, &shot, &case), shot.mirrored(&case));
                check(&format!("{case:?}"), &gpu, &mirror, tolerance, 0.002);
            }
        }
    }
}

#[test]
fn moments_agree_with_their_mirror() {
    let gpu = Gpu::open(Ask::from_env()).expect("a graphics adapter");
    let (scene, tracer) = scene("colonnade");
    let size = [75, 50];
    let shot = Shot::of(&scene, &tracer, size);
    let case = Case {
        sampling: ObscuranceSampling::OneArea,
        volume: ObscuranceVolume::Sphere,
        settings: settings(1.0),
    };
    let pass = case.pass(&gpu);
    let moments = pass
        .create_moments(&gpu.device, size[0], size[1])
        .expect("moments");
    let depth = gpu.texture(TextureFormat::R32Float, size[0], size[1], &shot.depths);
    let mut encoder = gpu.encoder();
    pass.record_moments(
        &gpu.device,
        &mut encoder,
        &depth,
        &shot.camera,
        &moments,
        None,
    )
    .expect("valid input");
    gpu.finish(encoder);
    let texels: Vec<[f32; 4]> = gpu.read_buffer(moments.buffer());
    let pyramid = Pyramid::new(size, &shot.mirror().view_depths());
    let mut at = 0;
    for level in 1..=8 {
        let [width, height] = size.map(|n| n.div_ceil(1 << level));
        for i in 0..width * height {
            let [mean, variance, covered, inside] = texels[at].map(f64::from);
            at += 1;
            let truth = pyramid.at([i64::from(i % width), i64::from(i / width)], level);
            // Depths are of up to 20 units: 2e-6 is a rounding of theirs, which a small variance shows as one of twice its
            // root times as much.
            let tolerance = 1e-5 * (truth.variance.sqrt() + 1e-5) + 1e-5 * truth.variance;
            let fits = (mean - truth.mean).abs() <= 1e-5
                && (variance - truth.variance).abs() <= tolerance
                && (covered, inside) == (truth.covered, truth.inside);
            assert!(
                fits,
                "level {level}, texel {i}: {:?}, {truth:?}",
                texels[at - 1]
            );
        }
    }
    assert_eq!(at, texels.len());
}

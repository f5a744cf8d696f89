//! Directional occlusion by splatting: the GPU against the f64 mirror, the picture against traced rays, and what is refused.

use deep_screen_space::{
    DirectionalOcclusion, Environment, EnvironmentBuilder, EnvironmentLight, EnvironmentSettings,
    Error, Overlap, ReconstructorInput, ReconstructorSettings,
    glam::{DQuat, DVec3},
    reference::{
        effects::{Receiver, UnderSky},
        environment::{Cells, Levels, Picture},
    },
    scenes, wgpu,
};
use support::{
    gpu::Gpu,
    sky,
    testing::{
        frames::Decoded,
        pipelines,
        shot::{Shot, camera_of},
        splats::{Options, Passes, Run, Tolerance, run, splat_settings},
    },
};

use super::splatted::{balanced, color, off};

fn built(gpu: &Gpu, shown: &Picture, size: [u32; 2], levels: bool) -> Environment {
    let builder = pipelines::once(&(), |gpu| {
        EnvironmentBuilder::new(&gpu.device).expect("pipelines")
    });
    let settings = EnvironmentSettings { size, levels };
    sky::build(gpu, builder, shown, &settings).expect("an environment")
}

fn turned() -> DQuat {
    DQuat::from_axis_angle(DVec3::new(0.3, 0.8, -0.5).normalize(), 0.9)
}

/// A level of what is kept.
fn level(gpu: &Gpu, environment: &Environment, level: u32) -> Vec<[f32; 4]> {
    let from = environment.radiance().texture();
    let [width, height] = environment.size().map(|n| n >> level);
    let to = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: from.format(),
        usage: wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let mut encoder = gpu.encoder();
    let mut source = from.as_image_copy();
    source.mip_level = level;
    encoder.copy_texture_to_texture(source, to.as_image_copy(), to.size());
    gpu.finish(encoder);
    gpu.read_texture(&to, 0)
}

#[test]
fn levels_are_the_mirrors() {
    let gpu = pipelines::gpu();
    // Sides that two does not divide.
    let size = [50, 27];
    let shown = Picture::of([100, 54], sky::sunny);
    let environment = built(gpu, &shown, size, true);
    let cells = Cells::new(shown.resampled([50, 27]), DQuat::IDENTITY);
    let levels = Levels::new(&cells);
    assert_eq!(environment.levels(), 4);
    assert_eq!(levels.grids.len(), 4);
    let [mut bytes, mut texels] = [0, 0];
    for (k, grid) in (0..).zip(&levels.grids) {
        let found = level(gpu, &environment, k);
        assert_eq!(found.len(), grid.texels.len());
        texels += found.len() as u64;
        bytes = 16 * texels;
        for (found, expected) in found.iter().zip(&grid.texels) {
            // Software drivers' sines are off by up to 2e-4, which weigh the texels of a cell.
            let off = (color(*found) - expected).abs();
            let most = 5e-4 * (1.0 + expected.max_element());
            assert!(off.max_element() < most, "{k}: {found:?} {expected}");
        }
    }
    let plain = built(gpu, &shown, size, false);
    assert_eq!(plain.levels(), 1);
    let more = environment.memory_bytes() - plain.memory_bytes();
    assert_eq!(more, bytes - 16 * 50 * 27);
}

/// Where a direction lies on an edge of a cell, or a disk between two levels, the driver's arcs and logarithms decide.
fn tolerance() -> Tolerance {
    Tolerance {
        rounding: 2e-4,
        most: 0.02,
        exceptions: 0.02,
    }
}

#[test]
fn sums_and_pictures_match_the_mirror() {
    let gpu = pipelines::gpu();
    let scene = scenes::dominoes();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [36, 28]));
    // So fine that neighbouring cells are alike.
    let shown = Picture::of([256, 128], sky::dim);
    let occlusion = DirectionalOcclusion {
        two_sided: true,
        overlap: Overlap::Independent,
    };
    let effect = occlusion.effect();
    let mut options = Options::new(splat_settings(3, 0.02));
    options.environment = Some((built(gpu, &shown, [256, 128], true), turned()));
    let run = run(gpu, &shot, &Passes::new(&effect, false), &options);
    let levels = Levels::new(&Cells::new(shown.clone(), turned()));
    let mirror = UnderSky {
        effect: occlusion,
        environment: &levels,
    };
    let channels = |sum: DVec3| sum.to_array().to_vec();
    let name = "directional occlusion";
    run.compare_within(gpu, (&mirror, &options), channels, (name, tolerance()));

    let of = |sum: &[f64]| DVec3::new(sum[0], sum[1], sum[2]);
    let totals = run.totals(gpu, (&shot, &options), 3, of);
    let pictures = run.pictures(gpu, &shot, &effect, &options);
    let receivers = run.receivers(gpu);
    for ((found, total), receiver) in pictures[0].iter().zip(totals).zip(&receivers) {
        let expected = receiver.map_or(DVec3::ZERO, |receiver| {
            mirror.radiance(total, &Receiver::new(receiver.normal))
        });
        // Of the sines that irradiance is an integral of, and of the reconstructor's plane distances.
        let off = (color(*found) - expected).abs().max_element();
        assert!(off < 2e-3, "{found:?} {expected}");
    }
}

/// Error and bias relative to the mean, of a picture at the balanced preset.
fn off_at_balanced(gpu: &Gpu, name: &str, shown: &Picture) -> [f64; 2] {
    let scene = scenes::by_name(name).expect("a scene");
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [72, 45]));
    let effect = DirectionalOcclusion::default().effect();
    let (mut renderer, preset) = balanced(gpu, &effect, &shot, scene.ao_radius);
    renderer.environment = Some(built(gpu, shown, [256, 128], true));
    let meshes = shot.buffers.meshes();
    let rendered = renderer.render(gpu, &shot.raster(), &meshes, &shot.camera, &preset);
    let rendered = rendered.expect("valid settings");
    let receivers = shot.traced();
    let cells = Cells::new(shown.clone(), DQuat::IDENTITY);
    let reach = f64::from(scene.ao_radius);
    let truth = shot
        .tracer
        .environment_image(&receivers, &cells, (reach, 128), 3, false);
    let pixels = rendered.pictures[0].iter().zip(&truth);
    off(pixels.filter_map(|(found, truth)| {
        let truth = (*truth)?;
        Some([color(*found), truth.mean, truth.standard_error])
    }))
}

/// Of the mean 0.1 under a dim sky, and 0.2 under one with a small sun, whose shadows are as soft as surfels are large.
#[test]
fn light_of_skies_is_near_the_traced_by_sums() {
    let gpu = pipelines::gpu();
    for (name, sky, most) in [("dominoes", "dim", 0.15), ("dominoes", "sunny", 0.3)] {
        let shown = sky::by_name(sky).expect("a sky");
        let [error, bias] = off_at_balanced(gpu, name, &shown);
        println!("{name}, {sky}: {error:.3} of the mean, bias {bias:+.3}");
        assert!(
            error < most && bias.abs() < 0.1,
            "{name}, {sky}: {error}, {bias}"
        );
    }
}

/// Black, and as bright as there is.
#[test]
fn extremes_are_finite() {
    let gpu = pipelines::gpu();
    let scene = scenes::fence();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [16, 16]));
    let effect = DirectionalOcclusion {
        two_sided: true,
        overlap: Overlap::Independent,
    };
    let effect = effect.effect();
    for (bright, epsilon) in [(0.0, 0.02), (1e18, 0.02), (1e18, 1e6), (f64::NAN, 1e-12)] {
        let shown = Picture::of([16, 8], |_| DVec3::splat(bright));
        let mut options = Options::new(splat_settings(2, epsilon));
        options.environment = Some((built(gpu, &shown, [16, 8], true), DQuat::IDENTITY));
        let run = run(gpu, &shot, &Passes::new(&effect, false), &options);
        let picture = run.pictures(gpu, &shot, &effect, &options).remove(0);
        let most = if bright > 0.0 {
            1.01 * bright as f32
        } else {
            0.0
        };
        assert!(
            picture
                .iter()
                .all(|texel| texel[..3].iter().all(|v| (0.0..=most).contains(v))),
            "{bright}: {picture:?}"
        );
        // Nothing hides all of it everywhere.
        assert_eq!(
            picture.iter().any(|texel| texel[0] > 0.1 * most),
            bright > 0.0
        );
    }
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let gpu = pipelines::gpu();
    let scene = scenes::fence();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [16, 16]));
    let effect = DirectionalOcclusion {
        two_sided: true,
        overlap: Overlap::Independent,
    };
    let effect = effect.effect();
    let shown = Picture::of([16, 8], sky::dim);
    let mut options = Options::new(splat_settings(2, 0.02));
    options.environment = Some((built(gpu, &shown, [16, 8], true), DQuat::IDENTITY));
    let run: Run = run(gpu, &shot, &Passes::new(&effect, false), &options);
    let plain = built(gpu, &shown, [16, 8], false);
    let reconstructor = pipelines::reconstructor(&effect, wgpu::TextureFormat::Rgba32Float);
    let scratch = reconstructor.create_view(&gpu.device, &run.view);
    let scratch = scratch.expect("a view");
    let target = gpu.target(wgpu::TextureFormat::Rgba32Float, 16, 16);
    let mut encoder = gpu.encoder();
    let mut decoded = Decoded::of(&shot.camera);
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, run.origin);
    for (environment, found) in [(None, "none"), (Some(&plain), "without levels")] {
        let input = ReconstructorInput {
            environment: environment.map(EnvironmentLight::new),
            ..ReconstructorInput::new(&frame, &run.view, target.texture())
        };
        let settings = ReconstructorSettings::default();
        let done = reconstructor.record(&gpu.device, &mut encoder, &input, &settings, &scratch);
        let error = done.expect_err("no environment");
        assert!(matches!(error, Error::Mismatch { .. }), "{error}");
        let text = error.to_string();
        assert!(
            text.contains("environment") && text.contains(found),
            "{text}"
        );
    }
}

//! A bounce of diffuse light by splatting: the GPU against the f64 mirror, and the picture against traced rays.

use deep_screen_space::{
    ClusterInput, DiffuseBounce, Error, Geometry, ShellSplatter, ShellSplatterDescriptor,
    SplatSettings, SurfelRadiance, SurfelizerInput, SurfelizerSettings, glam::DVec3, scenes,
    wgpu::BufferUsages,
};
use support::testing::{
    pipelines,
    shot::{Shot, camera_of},
    splats::{Options, Passes, run, splat_settings},
};

use super::splatted::{alike, balanced, color, floor_and_wall, lit, off, radiances, seen};

#[test]
fn sums_match_the_mirror() {
    let gpu = pipelines::gpu();
    for (name, size, settings, two_sided, unit) in [
        ("cornell", [40, 30], splat_settings(3, 0.02), false, 1.0),
        (
            "dominoes",
            [31, 33],
            SplatSettings {
                unbounded: false,
                radius: 0.8,
                ..splat_settings(2, 0.05)
            },
            true,
            4.0,
        ),
    ] {
        let scene = scenes::by_name(name).expect("a scene");
        let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, size));
        let effect = DiffuseBounce { two_sided, unit };
        let passes = Passes::new(&effect.effect().expect("a unit"), false);
        let mut options = lit(settings, radiances);
        if !two_sided {
            for radiance in options.radiance.iter_mut().flatten() {
                radiance.back = [0.0; 3];
            }
        }
        let run = run(gpu, &shot, &passes, &options);
        assert_eq!(run.counts.overflow(), 0, "{name}");
        let channels = |sum: DVec3| sum.to_array().to_vec();
        run.compare(gpu, (&effect, &options), channels, name);
        assert!(
            run.channels(gpu, 0, 3)[0].iter().any(|v| *v > 0.05),
            "{name} is dark"
        );
    }
}

/// Pairs of surfels and pixels that were evaluated, with these radiances.
fn evaluated(settings: SplatSettings, of: impl Fn(u32) -> Vec<SurfelRadiance>) -> u32 {
    let gpu = pipelines::gpu();
    let effect = DiffuseBounce::default().effect().expect("a unit");
    let counting = pipelines::once(&"counting light", |gpu| {
        let descriptor = ShellSplatterDescriptor {
            effect: &effect,
            subgroups: false,
            statistics: true,
        };
        ShellSplatter::new(&gpu.device, &descriptor).expect("pipelines")
    });
    let passes = Passes {
        surfelizer: pipelines::surfelizer(),
        splatter: counting,
    };
    let scene = scenes::by_name("cornell").expect("a scene");
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [24, 16]));
    let run = run(gpu, &shot, &passes, &lit(settings, of));
    let counts: Vec<u32> = gpu.read_buffer(run.view.statistics().expect("counts"));
    counts.iter().step_by(4).sum()
}

#[test]
fn black_surfels_cost_nothing() {
    let settings = splat_settings(3, 0.02);
    let black = alike(SurfelRadiance::default());
    let every_64th = |count| {
        let mut all = black(count);
        for radiance in all.iter_mut().step_by(64) {
            radiance.front = [1.0; 3];
        }
        all
    };
    let all = alike(SurfelRadiance {
        front: [1.0; 3],
        ..SurfelRadiance::default()
    });
    assert_eq!(evaluated(settings, &black), 0);
    let [few, many] = [evaluated(settings, every_64th), evaluated(settings, all)];
    println!("{few} and {many} pairs");
    assert!(few > 0 && 16 * few < many, "{few} and {many} pairs");
}

/// Dark and bright beyond all measure, in any unit: numbers all the same.
#[test]
fn extremes_are_finite() {
    let gpu = pipelines::gpu();
    let scene = scenes::by_name("fence").expect("a scene");
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [16, 16]));
    for (bright, unit, epsilon) in [
        (1e18, 1e-18, 1e-12),
        (1e18, 1e18, 1e6),
        (1e-18, 1.0, 0.01),
        (f32::NAN, 1.0, 0.01),
        (-1.0, 1.0, 0.01),
    ] {
        let effect = DiffuseBounce {
            two_sided: true,
            unit,
        };
        let passes = Passes::new(&effect.effect().expect("a unit"), false);
        let radiance = SurfelRadiance {
            front: [bright; 3],
            back: [bright; 3],
            ..SurfelRadiance::default()
        };
        let options = lit(splat_settings(2, epsilon), alike(radiance));
        let run = run(gpu, &shot, &passes, &options);
        for level in 0..2 {
            for sum in run.channels(gpu, level, 3).concat() {
                assert!(sum.is_finite() && sum >= 0.0, "{bright}, {unit}: {sum}");
                assert!(bright > 0.0 || sum == 0.0, "{bright}, {unit}: {sum}");
            }
        }
    }
}

/// Where nothing is hidden the picture is near the truth. At this size surfels of two pixels are coarse beside the wall, and the
/// pixels there are the brightest: 0.51 of the mean and a bias of -0.06 were seen.
#[test]
fn what_nothing_hides_is_near_the_truth() {
    let gpu = pipelines::gpu();
    let scene = floor_and_wall();
    let shot = seen(gpu, &scene, [48, 32]);
    let effect = DiffuseBounce::default().effect().expect("a unit");
    let (mut renderer, preset) = balanced(gpu, &effect, &shot, f32::INFINITY);
    let rendered = renderer
        .render_scene(
            gpu,
            &shot.raster(),
            &shot.buffers,
            &shot.camera,
            &[],
            &preset,
        )
        .expect("valid settings");
    assert_eq!(rendered.counts.overflow(), 0);

    let materials = scene.triangle_materials();
    let receivers = shot.traced();
    let truth = shot
        .tracer
        .one_bounce_image(&receivers, &materials, &[], 64, 1, false);
    let pixels = rendered.pictures[0].iter().zip(&truth).zip(&shot.pixels);
    let [error, bias] = off(pixels.filter_map(|((found, truth), pixel)| {
        let albedo = DVec3::from(materials[(*pixel)?.triangle].albedo.map(f64::from));
        let truth = (*truth)?;
        Some([
            color(*found),
            truth.mean * albedo,
            truth.standard_error * albedo,
        ])
    }));
    println!("{error:.3} of the mean, bias {bias:+.3}");
    assert!(
        error < 0.55 && bias.abs() < 0.1,
        "{error} of the mean, bias {bias}"
    );
}

#[test]
fn bad_input_is_a_typed_error() {
    let gpu = pipelines::gpu();
    for unit in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let bounce = DiffuseBounce {
            unit,
            ..DiffuseBounce::default()
        };
        let error = bounce.effect().expect_err("a unit that is none");
        assert!(
            matches!(
                error,
                Error::Setting {
                    field: "DiffuseBounce::unit",
                    ..
                }
            ),
            "{error}"
        );
    }
    let effect = DiffuseBounce::default().effect().expect("a unit");
    let splatter = pipelines::shell_splatter(&effect, false);
    let device = &gpu.device;
    let settings = splat_settings(1, 0.1);
    let scene = scenes::by_name("fence").expect("a scene");
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [8, 8]));
    let capacity = Options::new(settings).capacity;
    let surfelizer = pipelines::surfelizer();
    let mut cloud = surfelizer.create_cloud(device, capacity).expect("a cloud");
    let mut encoder = gpu.encoder();
    let meshes = shot.buffers.meshes();
    let input = SurfelizerInput::new(Geometry { meshes: &meshes }, &shot.camera);
    surfelizer
        .record(
            device,
            &mut encoder,
            &input,
            &SurfelizerSettings::default(),
            &mut cloud,
        )
        .expect("surfels");
    let clusters = splatter.create_clusters(device, &cloud, 1);
    let mut clusters = clusters.expect("clusters");
    let small = gpu.buffer(&radiances(8), BufferUsages::STORAGE);
    for (radiance, found) in [(None, "not been given"), (Some(&small), "256")] {
        let input = ClusterInput {
            radiance,
            ..ClusterInput::new(&cloud)
        };
        let done = splatter.record_clusters(device, &mut encoder, &input, &settings, &mut clusters);
        let error = done.expect_err("no radiance").to_string();
        assert!(
            error.contains("radiance") && error.contains(found),
            "{error}"
        );
    }
}

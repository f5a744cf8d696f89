//! A glossy bounce by splatting: the GPU against the f64 mirror, the picture against traced rays, and at the extremes.

use deep_screen_space::{
    Camera, Error, SpecularBounce, SurfelRadiance, Viewport,
    glam::{DMat4, DVec3, DVec4},
    reference::{effects::SeenGlossy, ggx::clean_roughness, trace::Gloss},
    scenes,
    wgpu::{TextureFormat, TextureView},
};
use support::{
    gpu::Gpu,
    testing::{
        pipelines,
        shot::{Shot, camera_in, camera_of},
        splats::{Passes, Tolerance, run, splat_settings, try_run},
    },
};

use super::splatted::{alike, balanced, color, floor_and_wall, lit, off, radiances, seen};

const BOUNCE: SpecularBounce = SpecularBounce {
    two_sided: true,
    unit: 2.0,
    f0: [0.04, 0.5, 1.0],
};

/// Another one at each texel of a viewport, and those beside it not a number, which counts as 1.
fn roughness(gpu: &Gpu, viewport: Viewport, least: f32) -> (TextureView, Vec<f64>) {
    let [right, bottom] = [viewport.x + viewport.width, viewport.y + viewport.height];
    let of = |x: u32, y: u32| {
        if x < viewport.x || y < viewport.y || (x + y).is_multiple_of(17) {
            f32::NAN
        } else {
            least + (1.1 - least) * ((37 * x + 11 * y) % 23) as f32 / 22.0
        }
    };
    let texels = (0..right * bottom).map(|i| of(i % right, i / right));
    let texels: Vec<f32> = texels.collect();
    let within = (0..viewport.width * viewport.height).map(|i| {
        let [x, y] = [i % viewport.width, i / viewport.width];
        clean_roughness(of(viewport.x + x, viewport.y + y).into())
    });
    let texture = gpu.texture(TextureFormat::R32Float, right, bottom, &texels);
    (texture, within.collect())
}

/// In a part of the target, and from everywhere at once.
#[test]
fn sums_match_the_mirror() {
    let gpu = pipelines::gpu();
    let scene = scenes::dominoes();
    let viewport = Viewport {
        x: 3,
        y: 5,
        ..Viewport::full(35, 27)
    };
    let seen = camera_in(&scene, 0, viewport);
    let projection = DMat4::from_cols(
        DVec4::X / 1.5,
        DVec4::Y / 1.2,
        DVec4::Z / 20.0,
        DVec4::new(0.0, 0.0, 1.0, 1.0),
    );
    let view = &scene.views[0];
    let flat = Camera::look_at(
        view.eye.into(),
        view.target.into(),
        view.up.into(),
        projection,
        viewport,
    )
    .expect("a camera");
    let effect = BOUNCE.effect().expect("settings");
    for (name, camera) in [("perspective", seen), ("orthographic", flat)] {
        let shot = Shot::new(gpu, &scene, &camera);
        let mut options = lit(splat_settings(3, 0.02), radiances);
        let (texture, roughness) = roughness(gpu, viewport, 0.25);
        options.roughness = Some(texture);
        let run = run(gpu, &shot, &Passes::new(&effect, false), &options);
        let mirror = SeenGlossy {
            effect: BOUNCE,
            camera: &shot.camera,
            origin: run.origin,
            roughness: &roughness,
        };
        let channels = |sum: DVec3| sum.to_array().to_vec();
        // A lobe is as much steeper as it is narrower: an alpha of 0.06 multiplies the rounding of directions by 30.
        let tolerance = Tolerance {
            rounding: 1e-3,
            most: 5e-3,
            exceptions: 0.02,
        };
        run.compare_within(gpu, (&mirror, &options), channels, (name, tolerance));
        let bright = run.channels(gpu, 0, 3)[1].iter().any(|v| *v > 0.05);
        assert!(bright, "{name} is dark");
        // The picture is the sum.
        let of = |sum: &[f64]| DVec3::new(sum[0], sum[1], sum[2]);
        let totals = run.totals(gpu, (&shot, &options), 3, of);
        let pictures = run.pictures(gpu, &shot, &effect, &options);
        for (found, total) in pictures[0].iter().zip(totals) {
            let found = color(*found);
            let off = (found - total).abs().max_element();
            assert!(off < 1e-3 * (1.0 + total.max_element()), "{found} {total}");
        }
    }
}

/// Where nothing is hidden the picture is near the truth, the nearer the rougher the floor is.
#[test]
fn what_nothing_hides_is_near_the_truth_at_each_roughness() {
    let gpu = pipelines::gpu();
    let scene = floor_and_wall();
    let size = [72, 48];
    let shot = seen(gpu, &scene, size);
    let bounce = SpecularBounce {
        f0: [0.2; 3],
        ..SpecularBounce::default()
    };
    let effect = bounce.effect().expect("settings");
    let (mut renderer, preset) = balanced(gpu, &effect, &shot, f32::INFINITY);
    let materials = scene.triangle_materials();
    let receivers = shot.traced();
    for (roughness, most) in [(0.1, 1.5), (0.3, 0.9), (0.6, 0.6), (1.0, 0.6)] {
        let texels = vec![roughness as f32; (size[0] * size[1]) as usize];
        renderer.roughness = Some(gpu.texture(TextureFormat::R32Float, size[0], size[1], &texels));
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
        let gloss = Gloss {
            eye: shot.camera.eye(),
            roughness,
            f0: DVec3::splat(0.2),
        };
        let truth =
            shot.tracer
                .glossy_image(&receivers, &gloss, (&materials, &[]), (256, 1), false);
        let pixels = rendered.pictures[0].iter().zip(&truth);
        let [error, bias] = off(pixels.filter_map(|(found, truth)| {
            let truth = (*truth)?;
            Some([color(*found), truth.mean, truth.standard_error])
        }));
        println!("roughness {roughness}: {error:.3} of the mean, bias {bias:+.3}");
        assert!(
            error < most && bias.abs() < 0.2,
            "{roughness}: {error}, {bias}"
        );
    }
}

/// Dark and bright beyond all measure, of a mirror and of the roughest: numbers all the same.
#[test]
fn extremes_are_finite() {
    let gpu = pipelines::gpu();
    let scene = scenes::fence();
    let camera = camera_of(&scene, 0, [16, 16]);
    let shot = Shot::new(gpu, &scene, &camera);
    let effect = BOUNCE.effect().expect("settings");
    for (bright, roughness, epsilon) in [
        (1e18, 0.0, 1e-12),
        (1e18, f32::NAN, 1e6),
        (1e-18, 1.0, 0.01),
        (f32::NAN, 0.0, 0.01),
        (-1.0, -1.0, 0.01),
        (0.0, f32::INFINITY, 0.01),
    ] {
        let radiance = SurfelRadiance {
            front: [bright; 3],
            back: [bright; 3],
            ..SurfelRadiance::default()
        };
        let mut options = lit(splat_settings(2, epsilon), alike(radiance));
        let texels = [roughness; 256];
        options.roughness = Some(gpu.texture(TextureFormat::R32Float, 16, 16, &texels));
        let run = run(gpu, &shot, &Passes::new(&effect, false), &options);
        for level in 0..2 {
            for sum in run.channels(gpu, level, 3).concat() {
                assert!(
                    sum.is_finite() && sum >= 0.0,
                    "{bright}, {roughness}: {sum}"
                );
                assert!(bright > 0.0 || sum == 0.0, "{bright}, {roughness}: {sum}");
            }
        }
    }
}

#[test]
fn bad_input_is_a_typed_error() {
    let check = |bounce: SpecularBounce, name: &str| {
        let error = bounce.effect().expect_err("out of range");
        let is_named = matches!(&error, Error::Setting { field, .. } if *field == name);
        assert!(is_named, "{error}");
    };
    for unit in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        check(SpecularBounce { unit, ..BOUNCE }, "SpecularBounce::unit");
    }
    for f0 in [-0.1, 1.1, f32::NAN] {
        let f0 = [0.5, f0, 0.5];
        check(SpecularBounce { f0, ..BOUNCE }, "SpecularBounce::f0");
    }
    let gpu = pipelines::gpu();
    let scene = scenes::fence();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [16, 16]));
    let effect = BOUNCE.effect().expect("settings");
    let options = lit(splat_settings(2, 0.02), radiances);
    let done = try_run(gpu, &shot, &Passes::new(&effect, false), &options);
    let error = done.err().expect("no roughness").to_string();
    assert!(error.contains("GBuffer::roughness"), "{error}");
}

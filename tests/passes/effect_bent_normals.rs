//! Bent normals by splatting: the GPU against the f64 mirror, and the picture against traced means of open directions.

use deep_screen_space::{
    BentNormals, HitResolver, Overlap, glam::DVec4, reference::effects::Receiver, scenes,
};
use support::testing::{
    pipelines,
    shot::{Shot, camera_of},
    splats::{Options, Passes, run, splat_settings},
};

use super::splatted::{balanced, color};

#[test]
fn sums_and_pictures_match_the_mirror() {
    let gpu = pipelines::gpu();
    let scene = scenes::dominoes();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [36, 28]));
    let bent = BentNormals {
        two_sided: true,
        overlap: Overlap::Independent,
    };
    let effect = bent.effect();
    let options = Options::new(splat_settings(3, 0.02));
    let run = run(gpu, &shot, &Passes::new(&effect, false), &options);
    let channels = |sum: DVec4| sum.to_array().to_vec();
    run.compare(gpu, (&bent, &options), channels, "bent normals");

    let of = |sum: &[f64]| DVec4::new(sum[0], sum[1], sum[2], sum[3]);
    let totals = run.totals(gpu, (&shot, &options), 4, of);
    let pictures = run.pictures(gpu, &shot, &effect, &options);
    let receivers = run.receivers(gpu);
    let mut further = 0;
    for ((found, total), receiver) in pictures[0].iter().zip(totals).zip(&receivers) {
        let found = DVec4::from_array(found.map(f64::from));
        let Some(receiver) = receiver else {
            assert_eq!(found, DVec4::W, "the sky");
            continue;
        };
        let expected = bent.bent(total, &Receiver::new(receiver.normal));
        assert!((found.truncate().length() - 1.0).abs() < 1e-5, "{found}");
        // Rounding of sums and plane distances is 1e-4, of what may be a tenth as long as a normal is.
        further += usize::from((found - expected).abs().max_element() > 1e-3);
        assert!(found.truncate().dot(receiver.normal) > -1e-4, "{found}");
    }
    println!("{further} of {} further", receivers.len());
    assert!(100 * further <= receivers.len(), "{further}");
}

/// Among the dominoes, where sums count what others hide, 19° where the cone is narrower than 60°, and 1.6° elsewhere.
#[test]
fn bent_normals_by_sums_are_near_the_traced_ones() {
    let gpu = pipelines::gpu();
    let scene = scenes::dominoes();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [72, 45]));
    let bent = BentNormals {
        overlap: Overlap::Independent,
        ..BentNormals::default()
    };
    let (mut renderer, preset) = balanced(gpu, &bent.effect(), &shot, scene.ao_radius);
    let meshes = shot.buffers.meshes();
    let rendered = renderer.render(gpu, &shot.raster(), &meshes, &shot.camera, &preset);
    let rendered = rendered.expect("valid settings");
    assert_eq!(rendered.counts.overflow(), 0);
    let receivers = shot.traced();
    let radius = f64::from(scene.ao_radius);
    let truth = shot
        .tracer
        .bent_normal_image(&receivers, radius, 128, 5, false);
    let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
    for (found, truth) in rendered.pictures[0].iter().zip(&truth) {
        let Some(truth) = truth.filter(|truth| truth.visibility > 0.0) else {
            continue;
        };
        let cone = HitResolver::cone_angle(truth.visibility as f32).to_degrees();
        let found = color(*found);
        let wide = usize::from(cone >= 60.0);
        sums[wide] += found.angle_between(truth.mean).to_degrees();
        counts[wide] += 1.0;
    }
    let [narrow, wide] = [sums[0] / counts[0], sums[1] / counts[1]];
    println!(
        "{narrow:.2}° over {} pixels, elsewhere {wide:.2}°",
        counts[0]
    );
    assert!(counts[0] > 100.0, "{counts:?}");
    assert!(narrow < 22.0 && wide < 2.0, "{narrow}, {wide}");
}

//! How large a surfel appears.

use deep_screen_space::{
    SurfelizerSettings,
    glam::{DMat4, DVec3},
};

use super::harness::{Soup, Task, fixture, look_at, sphere};
use support::raster::perspective;

/// Ground in two triangles, a sphere of fine ones, one of middling ones, and blades a hundred times longer than wide.
fn large_small_and_thin() -> Soup {
    let corner = |x: f64, z: f64| DVec3::new(20.0 * x, 0.0, 20.0 * z);
    let mut triangles = vec![
        [corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0)],
        [corner(-1.0, -1.0), corner(1.0, 1.0), corner(1.0, -1.0)],
    ];
    triangles.extend(sphere(DVec3::new(-1.0, 1.0, 0.0), 0.8, 40));
    triangles.extend(sphere(DVec3::new(1.5, 1.0, -1.0), 0.9, 8));
    for i in 0..60 {
        let foot = DVec3::new(0.05 * f64::from(i) - 1.0, 0.0, 1.5);
        let turn = DMat4::from_rotation_y(f64::from(i)).transform_vector3(DVec3::X);
        triangles.push([foot, foot + 0.01 * turn, foot + DVec3::new(0.2, 1.0, 0.1)]);
    }
    Soup::of(&triangles)
}

/// Rounding to a power of two leaves radii within 2^(±1/4), −16 % to +19 %, of their piece's target, and a piece's leaves
/// are nearer or farther than its centroid. The bar: 95 % within 25 %.
#[test]
fn radii_are_those_asked_for() {
    const OFF: f64 = 0.25;
    const SHARE_BEYOND: f64 = 0.05;
    let soup = large_small_and_thin();
    for (eye, radius_pixels) in [
        (DVec3::new(0.0, 2.0, 6.0), 1.0),
        (DVec3::new(0.5, 0.3, 2.2), 2.0),
        (DVec3::new(-8.0, 9.0, 3.0), 2.0),
    ] {
        let camera = look_at(eye, DVec3::new(0.0, 0.5, 0.0), perspective(60.0, 1.0, 0.05));
        let settings = SurfelizerSettings {
            radius_pixels,
            density: 1.0,
            ..SurfelizerSettings::default()
        };
        let cloud = fixture().record_soup(&soup, &Task::new(&camera, settings));
        let footprint = camera.footprint();
        let mut ratios: Vec<f64> = cloud
            .surfels
            .iter()
            .map(|s| s.radius / (f64::from(radius_pixels) * footprint.at(s.position)))
            .collect();
        ratios.sort_by(f64::total_cmp);
        let beyond =
            ratios.iter().filter(|r| (*r - 1.0).abs() > OFF).count() as f64 / ratios.len() as f64;
        let at = |share: f64| ratios[((ratios.len() - 1) as f64 * share) as usize];
        let found = format!(
            "eye {eye}, {radius_pixels} pixels: {:?}, {:.2} % beyond, from {:.3} by {:.3} {:.3} {:.3} to {:.3}",
            cloud.counts,
            100.0 * beyond,
            at(0.0),
            at(0.05),
            at(0.5),
            at(0.95),
            at(1.0)
        );
        println!("{found}");
        assert!(beyond <= SHARE_BEYOND, "{found}");
    }
}

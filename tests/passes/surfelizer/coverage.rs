//! Where a piece's surfels lie: evenly, at random, or in the tessellator's pattern.

use deep_screen_space::{
    Placement, SurfelizerSettings,
    glam::{DVec2, DVec3},
    reference::{
        hashing::{hash2, unit_float},
        surfelizer as mirror,
    },
};

use super::harness::{Soup, Task, corners, fixture, from_above};

/// A triangle that an orthographic camera sees, one piece of 2^12 or so surfels.
fn flat(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> Soup {
    Soup::of(&[[a, b, c].map(|p| DVec3::new(p[0], 0.0, p[1]))])
}

fn large() -> Soup {
    flat([-4.0, -3.0], [-3.0, 4.5], [4.2, 2.0])
}

/// 1000 times as long as wide.
fn sliver() -> Soup {
    flat([-4.0, 0.0], [0.5, 0.004], [4.0, 0.0])
}

fn cloud(soup: &Soup, placement: Placement, radius_pixels: f32) -> mirror::Cloud {
    let camera = from_above(5.0);
    let settings = SurfelizerSettings {
        radius_pixels,
        placement,
        density: f32::INFINITY,
        ..SurfelizerSettings::default()
    };
    let cloud = fixture().record_soup(soup, &Task::new(&camera, settings));
    assert_eq!(cloud.counts.pieces, 1, "{:?}", cloud.counts);
    cloud
}

/// Weights of the corners b and c at the surfels.
fn barycentric(cloud: &mirror::Cloud) -> Vec<DVec2> {
    let [a, b, c] = corners(&cloud.pieces[0]);
    let [u, v] = [b - a, c - a];
    let normal = u.cross(v);
    let scale = normal.length_squared().recip();
    cloud
        .surfels
        .iter()
        .map(|s| {
            let p = s.position - a;
            DVec2::new(p.cross(v).dot(normal), u.cross(p).dot(normal)) * scale
        })
        .collect()
}

/// To the unit square, areas in proportion: the inverse of the map that places random surfels.
fn unit_square(weights: DVec2) -> DVec2 {
    let u = weights.x + weights.y;
    DVec2::new(u * u, weights.y / u)
}

/// Deviations of counts from areas over disks that lie within the triangle: the root of their mean square, and the
/// largest. Disks, since boxes along the triangle's edges run along its leaves' edges.
fn disk_discrepancy(cloud: &mirror::Cloud, whole: f64) -> [f64; 2] {
    const DISKS: u32 = 600;
    let [a, b, c] = corners(&cloud.pieces[0]);
    let center = (a + b + c) / 3.0;
    let [mut square, mut worst] = [0.0, 0.0_f64];
    for i in 0..DISKS {
        let draw = |k: u32| unit_float(hash2(i, k));
        let radius = 0.3 + 0.7 * draw(0);
        let middle = center + DVec3::new(draw(1) - 0.5, 0.0, draw(2) - 0.5);
        let inside = cloud
            .surfels
            .iter()
            .filter(|s| s.position.distance(middle) < radius)
            .count() as f64;
        let share = std::f64::consts::PI * radius * radius / whole;
        let off = (inside / cloud.surfels.len() as f64 - share).abs();
        square += off * off / f64::from(DISKS);
        worst = worst.max(off);
    }
    [square.sqrt(), worst]
}

/// The same along one line: the deviation of the distribution of `positions`, sorted, from `area_below`.
fn discrepancy_along(mut positions: Vec<f64>, area_below: impl Fn(f64) -> f64) -> f64 {
    positions.sort_by(f64::total_cmp);
    let count = positions.len() as f64;
    positions.iter().enumerate().fold(0.0, |worst, (i, &x)| {
        let area = area_below(x);
        worst
            .max((i as f64 / count - area).abs())
            .max(((i + 1) as f64 / count - area).abs())
    })
}

/// Random points deviate by √(share (1 − share) / N). An even set errs along the disk's rim only, by N^(-3/4).
#[test]
fn centroids_cover_a_large_triangle_evenly() {
    let soup = large();
    let [even, random] = [Placement::Centroid, Placement::Random].map(|placement| {
        let cloud = cloud(&soup, placement, 0.5);
        assert!(cloud.surfels.len() >= 1024, "{:?}", cloud.counts);
        disk_discrepancy(&cloud, soup.area())
    });
    println!("root mean square and largest: even {even:.5?}, random {random:.5?}");
    for (even, random) in even.into_iter().zip(random) {
        assert!(even < 0.35 * random, "even {even}, random {random}");
    }
}

/// Across a sliver there is room for a surfel or two; along it they lie as evenly as a lattice, within 2/N, where random
/// ones deviate by N^(-1/2).
#[test]
fn centroids_cover_a_sliver_evenly() {
    let soup = sliver();
    // Corners at -4 and 4 on the long edge, the third at 0.5 on the other side: the area below x.
    let area_below = |x: f64| {
        if x < 0.5 {
            (x + 4.0).powi(2) / (8.0 * 4.5)
        } else {
            1.0 - (4.0 - x).powi(2) / (8.0 * 3.5)
        }
    };
    let found = [Placement::Centroid, Placement::Random].map(|placement| {
        let cloud = cloud(&soup, placement, 0.05);
        let along = cloud.surfels.iter().map(|s| s.position.x).collect();
        (cloud.surfels.len(), discrepancy_along(along, area_below))
    });
    println!("surfels and discrepancy: {found:?}");
    let [(count, even), (_, random)] = found;
    assert!(count >= 128, "{found:?}");
    assert!(even < 0.5 * random, "{found:?}");
    assert!(even < 4.0 / count as f64, "{found:?}");
}

/// Chi-square over 8 × 8 cells of equal area: 63 degrees of freedom, of which 4 standard deviations above the mean are
/// 63 + 4 √126 = 108. Too even is as wrong: 63 − 4 √126 = 18.
#[test]
fn random_surfels_are_uniform() {
    let points = barycentric(&cloud(&large(), Placement::Random, 0.5));
    let mut counts = [0_u32; 64];
    for p in &points {
        assert!(
            p.x >= -1e-5 && p.y >= -1e-5 && p.x + p.y <= 1.0 + 1e-5,
            "{p} is outside"
        );
        let q = (unit_square(*p) * 8.0).floor().min(DVec2::splat(7.0));
        counts[(q.y * 8.0 + q.x) as usize] += 1;
    }
    let expected = points.len() as f64 / 64.0;
    let chi: f64 = counts
        .iter()
        .map(|&n| (f64::from(n) - expected).powi(2) / expected)
        .sum();
    println!("{} surfels, chi-square {chi:.1}", points.len());
    assert!(
        (18.0..108.0).contains(&chi),
        "{} surfels, chi-square {chi}: {counts:?}",
        points.len()
    );
}

/// v(i) of the tessellator: ¾ i² + ³⁄₂ i + 1 for even i, 3 ⌈i/2⌉² for odd i. The level is the first whose polynomial
/// reaches the relative area.
#[test]
fn the_grid_has_the_tessellators_points() {
    let count = |i: u32| {
        if i.is_multiple_of(2) {
            3 * i * i / 4 + 3 * i / 2 + 1
        } else {
            3 * i.div_ceil(2).pow(2)
        }
    };
    assert_eq!([1, 2, 3, 4, 5].map(count), [3, 7, 12, 19, 27]);
    let soup = large();
    let mut levels = Vec::new();
    for radius_pixels in [0.5, 1.0, 2.0, 4.0, 7.0, 11.0, 14.0, 20.0, 30.0] {
        let cloud = cloud(&soup, Placement::Grid, radius_pixels);
        let level = cloud.pieces[0].shape & 0xfff;
        levels.push(level);
        assert_eq!(cloud.counts.surfels, count(level), "level {level}");
        let pixel = 2.0 * 5.0 / f64::from(super::harness::SIDE);
        let target = std::f64::consts::PI * (f64::from(radius_pixels) * pixel).powi(2);
        let relative = soup.area() / target;
        let i = f64::from(level);
        let polynomial = |i: f64| 0.75 * i * i + 1.5 * i + 1.0;
        assert!(
            polynomial(i) >= relative * (1.0 - 1e-5)
                && (level == 1 || polynomial(i - 1.0) < relative * (1.0 + 1e-5)),
            "level {level} for {relative} surfels"
        );
    }
    println!("levels {levels:?}");
    assert!(levels.contains(&1) && levels.contains(&2) && levels.iter().any(|l| *l > 20));
}

/// Each surfel within a radius of its own point of the pattern in the triangle inset by a radius a corner, and in the
/// triangle's plane.
#[test]
fn the_grid_is_inset_and_jittered_by_a_radius() {
    for radius_pixels in [0.5, 3.0] {
        let cloud = cloud(&large(), Placement::Grid, radius_pixels);
        let level = cloud.pieces[0].shape & 0xfff;
        let corners = corners(&cloud.pieces[0]);
        let center = (corners[0] + corners[1] + corners[2]) / 3.0;
        let radius = cloud.surfels[0].radius;
        let [a, b, c] = corners.map(|p| p + (center - p).normalize() * radius);
        let inner = mirror::Triangle { a, b, c };
        let [mut mean, mut farthest] = [0.0, 0.0_f64];
        for surfel in &cloud.surfels {
            let off = surfel.position - mirror::grid_point(inner, surfel.leaf, level);
            assert!(
                off.y.abs() < 1e-5 * radius.max(5.0),
                "{surfel:?} leaves the plane"
            );
            farthest = farthest.max(off.length() / radius);
            mean += off.length() / radius / cloud.surfels.len() as f64;
        }
        println!(
            "{} surfels: jitter {mean:.3} radii on average, {farthest:.4} at most",
            cloud.surfels.len()
        );
        assert!(farthest <= 1.0 + 1e-4, "{farthest} radii");
        // Uniform over a disk: 2/3 of its radius on average, standard deviation 0.236 a surfel.
        let tolerance = 4.0 * 0.236 / (cloud.surfels.len() as f64).sqrt();
        assert!(
            (mean - 2.0 / 3.0).abs() < tolerance,
            "{mean} radii on average"
        );
    }
}

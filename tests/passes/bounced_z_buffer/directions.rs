//! Where rays go: densities, and how evenly they lie in a pixel, between pixels and over frames.

use std::f64::consts::PI;

use deep_screen_space::{
    Sampling,
    glam::{DVec2, DVec3},
    reference::{
        directions::{cell_point, concentric_disk, hemisphere_direction, tangent_frame},
        hashing::{hash2, unit_float},
    },
};

use super::harness::SAMPLINGS;

/// A sampler's points fall into cells of the hemisphere as its density says: chi-square, and the density's integral.
#[test]
fn directions_have_their_density() {
    let normal = DVec3::new(0.3, -0.5, 0.81).normalize();
    let frame = tangent_frame(normal);
    for sampling in SAMPLINGS {
        // Cells of equal height and azimuth. A pixel a block: points of one block depend on each other.
        let (rings, sides) = (8, 16);
        let mut counts = vec![0_u32; rings * sides];
        let mut total = 0;
        for block in 0..6400 {
            for index in 0..5 {
                for part in 0..2 {
                    let corner = [block % 80 * 16, block / 80 * 16];
                    let pixel = [corner[0] + block % 16, corner[1] + block / 16 % 16];
                    let point = cell_point(pixel, index, [5, 1], part * (1 + block));
                    let drawn = hemisphere_direction(point, normal, sampling);
                    let local = frame.transpose() * drawn.direction;
                    assert!((drawn.direction.length() - 1.0).abs() < 1e-12);
                    assert!(local.z >= -1e-12, "{sampling:?}: {local}");
                    let expected = match sampling {
                        Sampling::Uniform => 0.5 / PI,
                        _ => local.z / PI,
                    };
                    assert!(
                        (drawn.pdf - expected).abs() < 1e-9,
                        "{sampling:?}: {drawn:?}"
                    );
                    let ring = ((local.z * rings as f64) as usize).min(rings - 1);
                    let turn = local.y.atan2(local.x) / (2.0 * PI) + 0.5;
                    let side = ((turn * sides as f64) as usize).min(sides - 1);
                    counts[ring * sides + side] += 1;
                    total += 1;
                }
            }
        }
        let mut chi2 = 0.0;
        let mut integral = 0.0;
        for (cell, &count) in counts.iter().enumerate() {
            let low = (cell / sides) as f64 / rings as f64;
            let high = low + 1.0 / rings as f64;
            let share = match sampling {
                Sampling::Uniform => high - low,
                _ => high * high - low * low,
            } / sides as f64;
            integral += share;
            let expected = share * f64::from(total);
            chi2 += (f64::from(count) - expected).powi(2) / expected;
        }
        println!("{sampling:?}: chi-square {chi2} of {} cells", counts.len());
        assert!((integral - 1.0).abs() < 1e-12);
        // 127 degrees of freedom: mean 127, deviation 16. The five cells make the points more even, if anything.
        assert!(chi2 < 127.0 + 4.0 * 16.0, "{sampling:?}: {chi2}");
    }
    // The integral of the densities over directions, with the other sampler's points: 1.
    let points = 4096;
    let mean: f64 = (0..points)
        .map(|i| {
            let p = [i % 16, i / 16 % 16];
            let drawn =
                hemisphere_direction(cell_point(p, 0, [1, 1], i / 256), normal, Sampling::Uniform);
            normal.dot(drawn.direction) / PI / drawn.pdf
        })
        .sum::<f64>()
        / f64::from(points);
    // Sixteen nets of 256 points, independent of each other; measured at 1e-3.
    assert!((mean - 1.0).abs() < 5e-3, "{mean}");
}

/// The concentric map keeps areas and order, and reaches the rim.
#[test]
fn disk_keeps_areas() {
    assert_eq!(concentric_disk(DVec2::splat(0.5)), DVec2::ZERO);
    let n = 200;
    let mut inner = 0;
    for i in 0..n * n {
        let cell = DVec2::new(f64::from(i % n) + 0.5, f64::from(i / n) + 0.5) / f64::from(n);
        let p = concentric_disk(cell);
        assert!(p.length() < 1.0, "{cell}");
        inner += i32::from(p.length_squared() < 0.25);
    }
    let share = f64::from(inner) / f64::from(n * n);
    assert!((share - 0.25).abs() < 0.002, "{share}");
    for edge in [0.0, 0.3, 1.0] {
        for p in [DVec2::new(edge, 0.0), DVec2::new(1.0, edge)] {
            assert!((concentric_disk(p).length() - 1.0).abs() < 1e-12, "{p}");
        }
    }
    for n in [DVec3::X, DVec3::NEG_Z, DVec3::new(0.6, 0.0, -0.8), DVec3::Z] {
        let frame = tangent_frame(n);
        assert!((frame.determinant() - 1.0).abs() < 1e-12, "{n}");
        let unit = frame.transpose() * frame;
        assert!(
            unit.abs_diff_eq(deep_screen_space::glam::DMat3::IDENTITY, 1e-12),
            "{n}"
        );
    }
}

/// The point of a pixel within its cell of 2 x 2.
fn within_cell(pixel: [u32; 2], index: u32, frame: u32) -> DVec2 {
    let cell = DVec2::new(f64::from(index % 2), f64::from(index / 2));
    cell_point(pixel, index, [2, 2], frame) * 2.0 - cell
}

/// How many points more or fewer than its area says any rectangle has that ends at eighths of the square.
fn unevenness(points: &[DVec2]) -> f64 {
    let edges = || (0..=8).map(|i| f64::from(i) / 8.0);
    let mut worst = 0.0_f64;
    for (left, right) in edges().flat_map(|l| edges().map(move |r| (l, r))) {
        for (low, high) in edges().flat_map(|l| edges().map(move |h| (l, h))) {
            let area = (right - left).max(0.0) * (high - low).max(0.0);
            let inside = |p: &&DVec2| (left..right).contains(&p.x) && (low..high).contains(&p.y);
            let found = points.iter().filter(inside).count() as f64;
            worst = worst.max((found - points.len() as f64 * area).abs());
        }
    }
    worst
}

/// Of any window of pixels the points within a cell lie evenly, wherever it is and in any frame.
#[test]
fn windows_of_pixels_are_stratified() {
    for [width, height] in [[5_u32, 5], [9, 9], [16, 16], [3, 40], [40, 1]] {
        let (mut even, mut random) = (0.0_f64, 0.0_f64);
        for (corner, frame) in [([0, 0], 0), ([333, 18], 1), ([4097, 2050], 1 << 20)] {
            for index in 0..4 {
                let of_pixels = |point: &dyn Fn([u32; 2]) -> DVec2| -> Vec<DVec2> {
                    (0..width * height)
                        .map(|i| point([corner[0] + i % width, corner[1] + i / width]))
                        .collect()
                };
                let points = of_pixels(&|pixel| within_cell(pixel, index, frame));
                even = even.max(unevenness(&points));
                let drawn = |pixel: [u32; 2], axis| {
                    unit_float(hash2(pixel[0] ^ (pixel[1] << 16), 2 * index + axis))
                };
                let points = of_pixels(&|pixel| DVec2::new(drawn(pixel, 0), drawn(pixel, 1)));
                random = random.max(unevenness(&points));
            }
        }
        println!("{width} x {height}: {even:.1} points off, random ones {random:.1}");
        // Measured at 0.31 to 0.52.
        assert!(
            even < 0.7 * random,
            "{width} x {height}: {even}, random {random}"
        );
    }
}

/// Of one pixel and cell, the points of 2^k frames in a row from a multiple of 2^k are one in each of 2^k subcells of every
/// shape, which lie where those of the first pixel do, moved by what does not depend on the frame.
#[test]
fn frames_are_stratified() {
    for count in [2_u32, 4, 8, 16, 64, 256] {
        for (pixel, index) in [([0, 0], 0), ([7, 12], 1), ([333, 18], 3)] {
            let moved = within_cell(pixel, index, 0) - within_cell([0, 0], index, 0);
            for start in [0, 5 * count, (1 << 20) - count] {
                for columns in (0..=count.ilog2()).map(|power| 1_u32 << power) {
                    let rows = count / columns;
                    let mut taken = vec![false; count as usize];
                    for frame in start..start + count {
                        // Twice the rounding of a coordinate, 2^-24, so that none falls below where it was.
                        let within = within_cell(pixel, index, frame) - moved + 2e-7;
                        let within = within - within.floor();
                        let x = (within.x * f64::from(columns)) as u32;
                        let y = (within.y * f64::from(rows)) as u32;
                        let at = (y * columns + x) as usize;
                        assert!(
                            !taken[at],
                            "{count} frames from {start}, pixel {pixel:?}, cell {index}: two points in {columns}x{rows}"
                        );
                        taken[at] = true;
                    }
                }
            }
        }
    }
}

/// One pixel's points over frames fill its cells evenly: chi-square over 8 x 8 subcells.
#[test]
fn frames_fill_the_cells() {
    for (pixel, index) in [([0, 0], 0), ([7, 12], 1), ([333, 18], 3)] {
        let mut counts = [0_u32; 64];
        let frames = 6400;
        for frame in 0..frames {
            let within = within_cell(pixel, index, frame);
            let [x, y] = [within.x, within.y].map(|v| ((v * 8.0) as usize).min(7));
            counts[y * 8 + x] += 1;
        }
        let expected = f64::from(frames) / 64.0;
        let chi2: f64 = counts
            .iter()
            .map(|&count| (f64::from(count) - expected).powi(2) / expected)
            .sum();
        println!("pixel {pixel:?}, cell {index}: chi-square {chi2}");
        // 63 degrees of freedom: mean 63, deviation 11.2.
        assert!(
            chi2 < 63.0 + 4.0 * 11.2,
            "pixel {pixel:?}, cell {index}: {chi2}"
        );
    }
}

//! Geometry and cameras at the ends of their ranges: nothing is NaN, nothing hangs, and the area stays.

use std::time::{Duration, Instant};

use deep_screen_space::{
    Camera, CloudCapacity, Instances, Mesh, Placement, SurfelizerSettings, TransformFormat,
    Viewport,
    glam::{DMat4, DVec3},
    reference::surfelizer as mirror,
    scenes,
    wgpu::BufferUsages,
};

use super::{
    comparison::{assert_alike, compare},
    harness::{SIDE, Soup, Task, disk_area, fixture, from_above, look_at, sphere},
};
use support::raster::perspective;

/// Far more than any of these takes with other work beside, seconds on two slow cores; unbounded work is longer.
const PATIENCE: Duration = Duration::from_secs(60);

fn settings(radius_pixels: f32, density: f32) -> SurfelizerSettings {
    SurfelizerSettings {
        radius_pixels,
        density,
        ..SurfelizerSettings::default()
    }
}

#[track_caller]
fn assert_sound(cloud: &mirror::Cloud, inputs: &str) {
    for surfel in &cloud.surfels {
        assert!(
            surfel.position.is_finite() && surfel.radius.is_finite() && surfel.radius > 0.0,
            "{inputs}: {surfel:?}"
        );
    }
}

#[track_caller]
fn assert_area(cloud: &mirror::Cloud, soup: &Soup, inputs: &str) {
    assert_sound(cloud, inputs);
    let ratio = disk_area(cloud) / soup.area();
    println!("{inputs}: {:?}, area {ratio:.5}", cloud.counts);
    assert!(
        (ratio - 1.0).abs() < 0.01,
        "{inputs}: {:?}, area {ratio}",
        cloud.counts
    );
}

/// Each is left out and counted, and the good one between them stays.
#[test]
fn triangles_without_an_area_are_rejected() {
    let [zero, x, z] = [[0.0_f32; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let good = [zero, z, x];
    let bad = [
        [zero, zero, zero],
        [x, x, z],
        [x, z, x],
        [zero, [0.5, 0.0, 0.0], x],
        [[f32::NAN; 3], x, z],
        [zero, [0.0, f32::NAN, 0.0], z],
        [zero, x, [f32::INFINITY, 0.0, 0.0]],
        [[f32::NEG_INFINITY; 3], [f32::INFINITY; 3], zero],
        // Edges beyond f32.
        [[f32::MAX, 0.0, 0.0], [-f32::MAX, 0.0, 0.0], z],
    ];
    let camera = from_above(2.0);
    for placement in [Placement::Centroid, Placement::Random, Placement::Grid] {
        let mut settings = settings(2.0, f32::INFINITY);
        settings.placement = placement;
        let task = Task::new(&camera, settings);
        let mut list = bad.to_vec();
        list.insert(4, good);
        let cloud = fixture().record_soup(&Soup(list), &task);
        let count = bad.len() as u32;
        assert_eq!(
            cloud.counts.rejected, count,
            "{placement:?}: {:?}",
            cloud.counts
        );
        assert!(
            cloud.pieces.iter().all(|p| p.triangle == 4),
            "{placement:?}"
        );
        assert_area(&cloud, &Soup(vec![good]), &format!("{placement:?}"));
    }
    // Edges of 1e-19 and 1e18, whose squares leave f32's range or nearly do.
    for size in [1e-19_f32, 1e-12, 1e12, 1e18] {
        let tiny = Soup(vec![good.map(|p| p.map(|x| x * size))]);
        let mut task = Task::new(&camera, settings(1.0, f32::INFINITY));
        task.capacity.surfels = 1000;
        let cloud = fixture().record_soup(&tiny, &task);
        assert_sound(&cloud, &format!("size {size}"));
        println!("size {size}: {:?}", cloud.counts);
    }
}

/// A triangle of 1e5 units a side about an eye with its near plane at 1e-3: eight decades of distance.
#[test]
fn large_triangles_near_the_eye() {
    let fixture = fixture(); // pipelines may take longer than what is timed
    let start = Instant::now();
    let side = 1e5;
    let around = |height: f64, turn: f64| {
        let spoke = |i: f64| {
            let angle = turn + std::f64::consts::TAU * i / 3.0;
            DVec3::new(side * angle.cos(), height, -side * angle.sin())
        };
        [spoke(0.0), spoke(1.0), spoke(2.0)]
    };
    let tilt = |t: [DVec3; 3]| t.map(|p| DMat4::from_rotation_x(0.5).transform_point3(p));
    let camera = look_at(DVec3::ZERO, DVec3::NEG_Z, perspective(70.0, 1.0, 1e-3));
    for (name, triangle) in [
        ("on the near plane", around(-1e-3, 0.3)),
        ("through the eye", around(0.0, 0.3)),
        ("a metre below", around(-1.0, 1.0)),
        ("tilted, crossing the near plane", tilt(around(-0.01, 0.2))),
        ("behind", around(-1.0, 0.0).map(|p| p + DVec3::Z * 2e5)),
        (
            "in front, larger than the screen",
            around(0.0, 0.1).map(|p| DVec3::new(p.x, p.z, -50.0)),
        ),
        (
            "with a corner at the eye",
            around(0.0, 0.0).map(|p| p + DVec3::X * (side / 2.0)),
        ),
    ] {
        let soup = Soup::of(&[triangle]);
        let task = Task::new(&camera, settings(4.0, f32::INFINITY));
        let cloud = fixture.record_soup(&soup, &task);
        assert_eq!(cloud.counts.rejected, 0, "{name}");
        assert_area(&cloud, &soup, name);
        let expected = soup.mirrored(&task);
        for decade in -1..6 {
            // f32 holds such vertices to 0.004 and the nearest pieces no better, so not each alike: their area by
            // distance, within what moves across a decade's ends with one piece of half its distance.
            let within = |cloud: &mirror::Cloud| {
                let near =
                    |s: &&mirror::Surfel| s.position.length().log10().floor() as i32 == decade;
                let disks = cloud.surfels.iter().filter(near);
                disks.map(|s| s.radius * s.radius).sum::<f64>()
            };
            let [found, expected] = [within(&cloud), within(&expected)];
            assert!(
                (found - expected).abs() <= 0.05 * expected,
                "{name}: area {found} at 10^{decade}, expected {expected}"
            );
        }
        let ratio = f64::from(cloud.counts.surfels) / f64::from(expected.counts.surfels);
        assert!(
            (ratio - 1.0).abs() < 0.05,
            "{name}: {:?} for {:?}",
            cloud.counts,
            expected.counts
        );
        // A cloud without room for it all takes an even selection.
        let mut small = task;
        small.capacity.surfels = 100;
        small.capacity.pieces = 50;
        let few = fixture.record_soup(&soup, &small);
        assert_sound(&few, name);
        assert!(few.counts.stored <= 100, "{name}: {:?}", few.counts);
    }
    let taken = start.elapsed();
    assert!(taken < PATIENCE, "{taken:?}");
}

/// The finest and the coarsest settings in the largest room, on the smallest cloud: bounded work.
#[test]
fn extreme_radii() {
    let scene = scenes::cornell();
    let soup = Soup::of_scene(&scene);
    let camera = super::harness::scene_camera(&scene, 1);
    let fixture = fixture();
    for radius_pixels in [0.05, 1000.0] {
        for placement in [Placement::Centroid, Placement::Grid] {
            let mut task = Task::new(&camera, settings(radius_pixels, f32::INFINITY));
            task.settings.placement = placement;
            task.capacity = CloudCapacity {
                surfels: 5000,
                pieces: 1 << 12,
                triangles: 64,
            };
            let start = Instant::now();
            let cloud = fixture.record_soup(&soup, &task);
            let inputs = format!("{radius_pixels} pixels, {placement:?}");
            assert!(start.elapsed() < PATIENCE, "{inputs}");
            // Of many millions 5000 stay, each for an area of its own: 5 %.
            let ratio = disk_area(&cloud) / soup.area();
            println!("{inputs}: {:?}, area {ratio:.4}", cloud.counts);
            assert_sound(&cloud, &inputs);
            assert!((ratio - 1.0).abs() < 0.05, "{inputs}: area {ratio}");
        }
    }
}

/// A scene and its camera scaled together: the same pieces and leaves, scaled.
#[test]
fn scales() {
    let triangles = scaled_scene(1.0);
    let view = |scale: f64| {
        look_at(
            DVec3::new(0.0, 1.5, 6.0) * scale,
            DVec3::new(0.0, 0.5, 0.0) * scale,
            perspective(60.0, 1.0, 0.05 * scale),
        )
    };
    let camera = view(1.0);
    let plain = Soup::of(&triangles).mirrored(&Task::new(&camera, settings(2.0, 4.0)));
    for scale in [1e-4, 1e5] {
        let camera = view(scale);
        let soup = Soup::of(&scaled_scene(scale));
        let mut cloud = fixture().record_soup(&soup, &Task::new(&camera, settings(2.0, 4.0)));
        assert_sound(&cloud, &format!("scale {scale}"));
        for piece in &mut cloud.pieces {
            let t = piece.corners;
            piece.corners = mirror::Triangle {
                a: t.a / scale,
                b: t.b / scale,
                c: t.c / scale,
            };
        }
        for surfel in &mut cloud.surfels {
            surfel.position /= scale;
            surfel.radius /= scale;
        }
        // Vertices are rounded at either scale: 1e-7 of the distance, against radii of 1e-2 of it.
        assert_alike(&cloud, &plain, &format!("scale {scale}"));
    }
}

fn scaled_scene(scale: f64) -> Vec<[DVec3; 3]> {
    let ground =
        [[-8.0, -9.0], [-7.0, 8.5], [9.0, 8.0], [8.0, -8.0]].map(|[x, z]| DVec3::new(x, 0.0, z));
    let mut triangles = vec![
        [ground[0], ground[1], ground[2]],
        [ground[0], ground[2], ground[3]],
    ];
    triangles.extend(sphere(DVec3::new(0.3, 1.0, 0.0), 0.9, 12));
    triangles.iter().map(|t| t.map(|p| p * scale)).collect()
}

/// 1e5 units from the origin. Through an instance's translation the surfels are where they were to a thousandth of a
/// radius; vertices that hold world positions themselves are 0.008 units off, and the surfels are those of the rounded
/// vertices to the same thousandth.
#[test]
fn far_from_the_origin() {
    const RADII: f64 = 1e-3;
    let away = DVec3::new(1e5, -1e5, 1e5);
    let at = |offset: DVec3| {
        look_at(
            DVec3::new(0.1, 1.5, 6.0) + offset,
            DVec3::new(0.0, 0.5, 0.0) + offset,
            perspective(60.0, 1.0, 0.05),
        )
    };
    let [here, there] = [at(DVec3::ZERO), at(away)];
    let soup = Soup::of(&scaled_scene(1.0));
    let uploaded = fixture().upload(&soup);
    let expected = fixture().record(&[uploaded.mesh()], &Task::new(&here, settings(2.0, 4.0)));
    let task = Task::new(&there, settings(2.0, 4.0));

    let mut columns = [0.0_f32; 16];
    for i in [0, 5, 10, 15] {
        columns[i] = 1.0;
    }
    columns[12..15].copy_from_slice(&away.as_vec3().to_array());
    let transform = fixture().gpu.buffer(&columns, BufferUsages::STORAGE);
    let moved = Mesh {
        instances: Some(Instances {
            buffer: &transform,
            offset: 0,
            stride: 64,
            format: TransformFormat::Mat4,
            count: 1,
        }),
        ..uploaded.mesh()
    };
    let found = compare(&fixture().record(&[moved], &task), &expected, RADII);
    println!("by instance: {found:?}");
    assert!(
        found.odd_pieces == 0 && found.far == 0 && found.surfels > 1000,
        "{found:?}"
    );

    let rounded = Soup::of(
        &scaled_scene(1.0)
            .iter()
            .map(|t| t.map(|p| p + away))
            .collect::<Vec<_>>(),
    );
    let cloud = fixture().record_soup(&rounded, &task);
    let found = compare(&cloud, &rounded.mirrored(&task), RADII);
    println!("by vertices: {found:?}");
    assert!(
        found.odd_pieces == 0 && found.far == 0 && found.surfels > 1000,
        "{found:?}"
    );
    // To the vertices' own rounding, at most half of 2^-7 a coordinate, and of its mean over three corners.
    let off = cloud.pieces.len().abs_diff(expected.pieces.len());
    assert!(off <= expected.pieces.len() / 10, "{off} pieces differ");
}

/// The depth convention changes nothing: only the near plane and the pixel's footprint count.
#[test]
fn depth_conventions() {
    let soup = Soup::of(&scaled_scene(1.0));
    let [eye, target] = [DVec3::new(0.1, 1.5, 6.0), DVec3::new(0.0, 0.5, 0.0)];
    let fov = 60.0_f64.to_radians();
    let flip = DMat4::from_translation(DVec3::Z) * DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0));
    let projections = [
        ("reversed infinite", perspective(60.0, 1.0, 0.05)),
        ("forward", finite(fov, 0.05, 100.0)),
        ("reversed", flip * finite(fov, 0.05, 100.0)),
        ("forward infinite", flip * perspective(60.0, 1.0, 0.05)),
    ];
    let clouds = projections.map(|(name, projection)| {
        let camera = look_at(eye, target, projection);
        let views = [camera];
        let mut task = Task::new(&camera, settings(2.0, 4.0));
        task.settings.reach.radii = 4.0;
        task.cull_by = &views;
        let cloud = fixture().record_soup(&soup, &task);
        assert_sound(&cloud, name);
        (name, cloud)
    });
    for (name, cloud) in &clouds[1..] {
        assert_alike(cloud, &clouds[0].1, name);
    }
}

fn finite(fov: f64, near: f64, far: f64) -> DMat4 {
    let f = 1.0 / (fov / 2.0).tan();
    DMat4::from_cols_array(&[
        f,
        0.0,
        0.0,
        0.0, //
        0.0,
        f,
        0.0,
        0.0, //
        0.0,
        0.0,
        far / (near - far),
        -1.0, //
        0.0,
        0.0,
        near * far / (near - far),
        0.0,
    ])
}

/// Orthographic views give one radius everywhere, off-axis and non-square ones included.
#[test]
fn orthographic_cameras() {
    let soup = Soup::of(&scaled_scene(1.0));
    let ortho = |w: f64, h: f64, reversed: bool| {
        let depth = if reversed { 0.01 } else { -0.01 };
        DMat4::from_translation(DVec3::new(0.1, 0.0, 0.5))
            * DMat4::from_scale(DVec3::new(1.0 / w, 1.0 / h, depth))
    };
    for (w, h, reversed) in [(3.0, 3.0, false), (3.0, 3.0, true), (8.0, 2.0, true)] {
        let camera = Camera::look_at(
            DVec3::new(2.0, 3.0, 6.0),
            DVec3::ZERO,
            DVec3::Y,
            ortho(w, h, reversed),
            Viewport::full(SIDE, SIDE / 2),
        )
        .expect("orthographic");
        let task = Task::new(&camera, settings(1.5, f32::INFINITY));
        let cloud = fixture().record_soup(&soup, &task);
        let inputs = format!("half extents {w} and {h}, reversed {reversed}");
        assert_alike(&cloud, &soup.mirrored(&task), &inputs);
        assert_area(&cloud, &soup, &inputs);
        let target = 1.5 * (2.0 * w / f64::from(SIDE) * (2.0 * h / f64::from(SIDE / 2))).sqrt();
        let large = cloud
            .surfels
            .iter()
            .filter(|s| cloud.pieces[s.piece as usize].shape & 0x1000 == 0);
        for surfel in large {
            let ratio = surfel.radius / target;
            // 2^(1/4) either way.
            assert!(
                (0.84..1.19).contains(&ratio),
                "{inputs}: {ratio}, {surfel:?}"
            );
        }
    }
}

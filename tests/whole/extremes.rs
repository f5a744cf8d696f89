//! The passes together where extremes live: whatever is asked for, every pixel is a number from 0 to 1, nothing hangs,
//! and no call that the API allows is a validation error (which would panic here).

use std::time::{Duration, Instant};
use support::testing::pipelines;

use deep_screen_space::{
    AmbientOcclusion, Camera, CloudCapacity, Placement, SplatSettings, Viewport,
    glam::{DMat4, DVec3, DVec4},
    scenes::{self, Part, Scene},
};
use support::testing::shot::{Passes, Settings, Shot, camera_of};
use support::{gpu::Gpu, raster::perspective};

/// Far more than any of these takes on two slow cores with other work beside; a hang is longer.
const PATIENCE: Duration = Duration::from_secs(180);

struct Bench {
    gpu: &'static Gpu,
    passes: Passes,
}

impl Bench {
    fn new() -> Self {
        let gpu = pipelines::gpu();
        let passes = Passes::new(gpu, AmbientOcclusion::default());
        Self { gpu, passes }
    }

    /// Renders, and checks what must always hold.
    fn picture(&self, name: &str, shot: &Shot, settings: &Settings) -> Vec<f32> {
        let start = Instant::now();
        let (visibility, counts) = self.passes.render(self.gpu, shot, settings);
        let took = start.elapsed();
        assert!(took < PATIENCE, "{name}: took {took:?}");
        assert!(
            counts.stored <= settings.capacity.surfels,
            "{name}: {counts:?}"
        );
        for (i, v) in visibility.iter().enumerate() {
            assert!((0.0..=1.0).contains(v), "{name}: pixel {i} is {v}");
            if shot.pixels[i].is_none() {
                assert!(*v == 1.0, "{name}: sky pixel {i} is {v}");
            }
        }
        visibility
    }
}

fn settings(levels: u32, epsilon: f32) -> Settings {
    Settings::new(
        2.0,
        SplatSettings {
            levels,
            epsilon,
            ..SplatSettings::default()
        },
    )
}

/// Every projection of one scene gives the picture that reversed depth without a far plane gives. What differs is the
/// precision of depth: with near and far 1e-3 and 1e6 and forward depth, a step of f32 is some centimetres at 8 m, and
/// the receivers are lifted off their surface by as much.
#[test]
fn every_projection_gives_the_same_picture() {
    let bench = Bench::new();
    let scene = scenes::cornell();
    let view = &scene.views[0];
    let size = 40;
    let with = |projection: DMat4| {
        Camera::look_at(
            view.eye.into(),
            view.target.into(),
            view.up.into(),
            projection,
            Viewport::full(size, size),
        )
        .expect("a camera")
    };
    let f = 1.0 / (view.vertical_fov_degrees.to_radians() / 2.0).tan();
    // Depth is (a z + b) / -z.
    let forward = |near: f64, far: f64| {
        let a = -far / (far - near);
        DMat4::from_cols(
            DVec4::X * f,
            DVec4::Y * f,
            DVec4::new(0.0, 0.0, a, -1.0),
            DVec4::Z * (a * near),
        )
    };
    let reversed = |near: f64, far: f64| {
        DMat4::from_cols(
            DVec4::X * f,
            DVec4::Y * f,
            DVec4::new(0.0, 0.0, near / (far - near), -1.0),
            DVec4::Z * (far * near / (far - near)),
        )
    };
    let best = with(perspective(view.vertical_fov_degrees, 1.0, view.near));
    let settings = settings(3, 0.02);
    let expected = bench.picture("infinite", &Shot::new(bench.gpu, &scene, &best), &settings);
    for (name, projection, tolerance) in [
        ("forward", forward(0.1, 100.0), 0.005),
        ("reversed", reversed(0.1, 100.0), 0.002),
        ("reversed 1e-3 to 1e6", reversed(1e-3, 1e6), 0.002),
        ("forward 1e-3 to 1e6", forward(1e-3, 1e6), 0.1),
    ] {
        let shot = Shot::new(bench.gpu, &scene, &with(projection));
        let picture = bench.picture(name, &shot, &settings);
        let rmse = rmse(&picture, &expected);
        println!("{name}: RMSE {rmse}");
        assert!(rmse < tolerance, "{name}: RMSE {rmse}");
    }
}

fn rmse(a: &[f32], b: &[f32]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

/// Orthographic, from far enough that the perspective picture is nearly the same.
#[test]
fn orthographic_cameras_agree_with_distant_ones() {
    let bench = Bench::new();
    let scene = scenes::dominoes();
    let (center, up) = (DVec3::from(scene.views[0].target), DVec3::Y);
    let toward = DVec3::new(0.5, 1.0, 0.7).normalize();
    let half = 1.0;
    let settings = settings(3, 0.02);
    let distance = 1000.0;
    let perspective = Camera::look_at(
        center + distance * toward,
        center,
        up,
        perspective(2.0 * (half / distance).atan().to_degrees(), 1.0, 0.1),
        Viewport::full(48, 48),
    )
    .expect("a camera");
    let (near, far) = (1.0, 40.0);
    let orthographic = Camera::look_at(
        center + 20.0 * toward,
        center,
        up,
        DMat4::from_cols(
            DVec4::X / half,
            DVec4::Y / half,
            DVec4::Z * (1.0 / (far - near)),
            DVec4::new(0.0, 0.0, far / (far - near), 1.0),
        ),
        Viewport::full(48, 48),
    )
    .expect("a camera");
    assert!(!orthographic.is_perspective());
    let pictures = [perspective, orthographic].map(|camera| {
        let shot = Shot::new(bench.gpu, &scene, &camera);
        bench.picture("orthographic", &shot, &settings)
    });
    // Pixels on edges see one thing or the other, and pieces are cut otherwise.
    let rmse = rmse(&pictures[0], &pictures[1]);
    println!("RMSE {rmse}");
    assert!(rmse < 0.05, "RMSE {rmse}");
}

#[test]
fn any_size_and_setting() {
    let bench = Bench::new();
    let scene = scenes::cornell();
    for size in [[1, 1], [1, 53], [61, 1], [31, 17], [67, 43]] {
        let shot = Shot::new(bench.gpu, &scene, &camera_of(&scene, 0, size));
        for (i, levels) in [1, 2, 8].into_iter().enumerate() {
            for (j, epsilon) in [1e-9, 0.05, 2.0].into_iter().enumerate() {
                // Every pair of sums of hundreds of pixels is seconds on a software driver, and so are 8 levels of any:
                // of these, each value once.
                if (levels == 8 || size[0].min(size[1]) > 1) && i != j {
                    continue;
                }
                let name = format!("{size:?}, {levels} levels, epsilon {epsilon}");
                bench.picture(&name, &shot, &settings(levels, epsilon));
            }
        }
    }
    let shot = Shot::new(bench.gpu, &scene, &camera_of(&scene, 1, [33, 29]));
    for radius_pixels in [0.05, 1000.0] {
        let mut extreme = settings(2, 0.05);
        extreme.surfelizer.radius_pixels = radius_pixels;
        extreme.capacity.surfels = 1 << 14;
        bench.picture(
            &format!("surfels of {radius_pixels} pixels"),
            &shot,
            &extreme,
        );
    }
    for placement in [Placement::Centroid, Placement::Random, Placement::Grid] {
        let mut extreme = settings(3, 0.05);
        extreme.surfelizer.placement = placement;
        bench.picture(&format!("{placement:?}"), &shot, &extreme);
    }
    let mut nothing = settings(3, 0.05);
    nothing.splat.radius = 0.0;
    let picture = bench.picture("radius 0", &shot, &nothing);
    assert!(picture.iter().all(|v| *v == 1.0));
}

/// A cloud that holds a tenth of what is asked for gives nearly the picture of one that holds all.
#[test]
fn overflow_keeps_the_picture() {
    let bench = Bench::new();
    let scene = scenes::cornell();
    let shot = Shot::new(bench.gpu, &scene, &camera_of(&scene, 0, [40, 40]));
    let mut all = settings(1, 0.01);
    all.surfelizer.radius_pixels = 0.5;
    let expected = bench.picture("all", &shot, &all);
    let (_, counts) = bench.passes.render(bench.gpu, &shot, &all);
    assert_eq!(counts.overflow(), 0);
    let mut tenth = all;
    tenth.capacity = CloudCapacity {
        surfels: counts.stored / 10,
        ..all.capacity
    };
    let picture = bench.picture("a tenth", &shot, &tenth);
    let (_, counts) = bench.passes.render(bench.gpu, &shot, &tenth);
    assert_eq!(counts.stored, tenth.capacity.surfels);
    assert!(counts.overflow() > 8 * counts.stored);
    // Surfels of sqrt(10) times the radius, 1.6 pixels: what those give by themselves.
    let rmse = rmse(&picture, &expected);
    println!("RMSE {rmse}");
    assert!(rmse < 0.1, "RMSE {rmse}");
}

fn with_triangles(triangles: &[[DVec3; 3]]) -> Scene {
    let base = scenes::cornell();
    let positions = triangles
        .iter()
        .flatten()
        .map(|p| p.as_vec3().to_array())
        .collect::<Vec<_>>();
    Scene {
        name: "triangles",
        normals: vec![[0.0, 1.0, 0.0]; positions.len()],
        indices: (0..positions.len() as u32).collect(),
        parts: vec![Part {
            first_index: 0,
            index_count: positions.len() as u32,
            material: 0,
        }],
        positions,
        ..base
    }
}

#[test]
fn any_triangle() {
    let bench = Bench::new();
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
    let floor = [
        [-10.0 * x, 10.0 * z, 10.0 * x],
        [-10.0 * x, 10.0 * x, -10.0 * z],
    ];
    let camera = |near: f64| {
        Camera::look_at(
            DVec3::new(0.0, 2.0, 5.0),
            DVec3::ZERO,
            DVec3::Y,
            perspective(60.0, 1.0, near),
            Viewport::full(32, 32),
        )
        .expect("a camera")
    };
    let nan = DVec3::splat(f64::NAN);
    let huge = 1e5;
    for (name, near, triangle) in [
        ("degenerate", 0.1, [x, x, y]),
        ("point", 0.1, [y, y, y]),
        ("collinear", 0.1, [y, y + x, y + 2.0 * x]),
        ("sliver", 0.1, [y, y + x, y + 0.5 * x + 1e-6 * z]),
        ("NaN", 0.1, [nan, x, y]),
        ("infinite", 0.1, [f64::INFINITY * x, y, z]),
        ("1e30", 0.1, [1e30 * x, 1e30 * y, 1e30 * z]),
        (
            "larger than the screen",
            0.1,
            [3.0 * y - huge * x, 3.0 * y + huge * x, 3.0 * y - huge * z],
        ),
        (
            "through the eye",
            1e-3,
            [2.0 * y - huge * x, 2.0 * y + huge * x, 2.0 * y - huge * z],
        ),
        (
            "across the near plane",
            1e-3,
            [y + 6.0 * z, y - 6.0 * z, y + x],
        ),
        (
            "behind the camera",
            0.1,
            [y + 8.0 * z, y + x + 8.0 * z, 2.0 * y + 8.0 * z],
        ),
    ] {
        let mut triangles = floor.to_vec();
        triangles.push(triangle);
        let shot = Shot::new(bench.gpu, &with_triangles(&triangles), &camera(near));
        bench.picture(name, &shot, &settings(3, 0.02));
    }
    let none = with_triangles(&[]);
    let shot = Shot::new(bench.gpu, &none, &camera(0.1));
    let picture = bench.picture("no triangles", &shot, &settings(3, 0.02));
    assert!(picture.iter().all(|v| *v == 1.0));
}

#[test]
fn any_gbuffer() {
    let bench = Bench::new();
    let scene = scenes::cornell();
    let camera = camera_of(&scene, 0, [24, 24]);
    let mut shot = Shot::new(bench.gpu, &scene, &camera);
    let count = 24 * 24;
    let depth: Vec<f32> = shot
        .pixels
        .iter()
        .map(|p| p.map_or(0.0, |p| p.depth as f32))
        .collect();
    let denormal = f32::from_bits(1);
    for normal in [
        [0.0; 4],
        [f32::NAN; 4],
        [f32::INFINITY; 4],
        [denormal; 4],
        [1e30, -1e30, 1e30, 0.0],
        [1e-30, 1e-30, -1e-30, 0.0],
        [0.0, 17.0, 0.0, 0.0],
    ] {
        shot.upload(bench.gpu, &depth, &vec![normal; count]);
        bench.picture(&format!("normals {normal:?}"), &shot, &settings(3, 0.02));
    }
    for value in [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        -1.0,
        2.0,
        denormal,
        1e-30,
    ] {
        shot.upload(
            bench.gpu,
            &vec![value; count],
            &vec![[0.0, 0.0, 1.0, 0.0]; count],
        );
        // What such a depth shows is the caller's affair; it must be a number.
        shot.pixels = vec![camera_pixel(&shot); count];
        bench.picture(&format!("depth {value}"), &shot, &settings(3, 0.02));
    }
}

/// Any pixel that sees something: keeps `Bench::picture` from expecting sky.
fn camera_pixel(shot: &Shot) -> Option<deep_screen_space::reference::gbuffer::Pixel> {
    shot.pixels.iter().find_map(|p| *p)
}

//! The ray tracer against closed forms, against a loop over all triangles and in closed scenes.
//!
//! A view factor F is the share of the cosine-weighted hemisphere that an occluder covers: where
//! nothing else stands, the visibility is 1 - F. Sources of the closed forms are noted at each.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use deep_screen_space::Light;
use deep_screen_space::reference::trace::{Estimate, Hit, Receiver, TraceError, Tracer};
use deep_screen_space::scenes::{self, Scene, View};
use glam::{DVec2, DVec3, Vec3};

/// Rays to an estimate where the error bar should be small.
const MANY: u32 = 400_000;

#[derive(Default)]
struct Mesh {
    positions: Vec<[f32; 3]>,
    indices: Vec<u32>,
}

impl Mesh {
    fn triangle(&mut self, corners: [DVec3; 3]) {
        for corner in corners {
            self.indices.push(self.positions.len() as u32);
            self.positions.push(corner.as_vec3().to_array());
        }
    }

    fn parallelogram(&mut self, corner: DVec3, u: DVec3, v: DVec3) {
        self.triangle([corner, corner + u, corner + u + v]);
        self.triangle([corner, corner + u + v, corner + v]);
    }

    /// A level square about a point.
    fn ground(&mut self, centre: DVec3, half: f64) {
        let corner = centre - DVec3::new(half, 0.0, half);
        self.parallelogram(corner, DVec3::Z * 2.0 * half, DVec3::X * 2.0 * half);
    }

    fn sphere(&mut self, centre: DVec3, radius: f64) {
        let (sides, rings) = (512, 256);
        let at = |side: i32, ring: i32| {
            let (sin, cos) = (PI * f64::from(ring) / f64::from(rings)).sin_cos();
            let around = DVec2::from_angle(TAU * f64::from(side % sides) / f64::from(sides)) * sin;
            centre + radius * DVec3::new(around.x, cos, around.y)
        };
        for ring in 0..rings {
            for side in 0..sides {
                let [a, b] = [at(side, ring), at(side + 1, ring)];
                let [c, d] = [at(side + 1, ring + 1), at(side, ring + 1)];
                self.triangle([a, b, c]);
                self.triangle([a, c, d]);
            }
        }
    }

    fn tracer(&self) -> Tracer {
        Tracer::new(&self.positions, &self.indices).expect("indices come in threes")
    }
}

fn scene_tracer(scene: &Scene) -> Tracer {
    Tracer::new(&scene.positions, &scene.indices).expect("indices come in threes")
}

/// A receiver at a point on level ground.
fn on_ground(position: DVec3) -> Receiver {
    Receiver {
        position,
        geometric_normal: DVec3::Y,
        shading_normal: DVec3::Y,
    }
}

/// Holds within four standard errors, and 1e-4 for tessellation and the step off the surface.
#[track_caller]
fn assert_estimates(estimate: Estimate, expected: f64, inputs: &str) {
    let Estimate {
        mean,
        standard_error,
    } = estimate;
    let tolerance = 4.0 * standard_error + 1e-4;
    assert!(
        (mean - expected).abs() <= tolerance,
        "{inputs}: estimated {mean} with standard error {standard_error}, expected {expected}"
    );
    assert!(
        standard_error < 2e-3,
        "{inputs}: standard error {standard_error} is large"
    );
}

/// Numbers in [0, 1) from a linear congruential generator (Knuth's MMIX), upper bits.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 32) as f64 / 2.0_f64.powi(32)
    }

    fn in_cube(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    fn direction(&mut self) -> DVec3 {
        loop {
            let point = self.in_cube();
            if (1e-3..1.0).contains(&point.length()) {
                return point.normalize();
            }
        }
    }
}

/// F = R²/(h² + R²): Howell, "A Catalog of Radiation Heat Transfer Configuration Factors", B-12.
#[test]
fn disk_overhead() {
    for (height, radius) in [(1.0, 1.0), (0.5, 2.0), (3.0, 0.4)] {
        let mut mesh = Mesh::default();
        mesh.ground(DVec3::ZERO, 5.0);
        let centre = DVec3::Y * height;
        let rim = |step: i32| {
            let around = DVec2::from_angle(TAU * f64::from(step % 2048) / 2048.0) * radius;
            centre + DVec3::new(around.x, 0.0, around.y)
        };
        for step in 0..2048 {
            mesh.triangle([centre, rim(step), rim(step + 1)]);
        }
        let expected = 1.0 - radius * radius / (height * height + radius * radius);
        let estimate =
            mesh.tracer()
                .ambient_occlusion(&on_ground(DVec3::ZERO), f64::INFINITY, MANY, 1);
        assert_estimates(
            estimate,
            expected,
            &format!("height {height}, radius {radius}"),
        );
    }
}

/// View factor of a wall that stands on the ground, from a point `distance` in front of its
/// middle: twice that of either half, Howell B-4 with the element below the rectangle's corner.
fn wall_factor(distance: f64, height: f64, half_width: f64) -> f64 {
    let slant = distance.hypot(height);
    let near = (half_width / distance).atan();
    let far = distance / slant * (half_width / slant).atan();
    (near - far) / PI
}

#[test]
fn wall_factor_has_its_limits() {
    // A wall without ends, up to the elevation phi, covers (1 - cos phi)/2; without top, a half.
    let phi = 3.0_f64.atan2(2.0);
    let endless = wall_factor(2.0, 3.0, 1e9);
    assert!(
        (endless - (1.0 - phi.cos()) / 2.0).abs() < 1e-8,
        "{endless}"
    );
    let half = wall_factor(2.0, 1e9, 1e9);
    assert!((half - 0.5).abs() < 1e-8, "{half}");
}

#[test]
fn wall() {
    // The first comes near the wall without an end, the others are ordinary walls.
    for (distance, height, half_width) in [(1.0, 300.0, 300.0), (1.0, 1.0, 50.0), (0.7, 2.0, 1.5)] {
        let mut mesh = Mesh::default();
        mesh.ground(DVec3::ZERO, 5.0);
        mesh.parallelogram(
            DVec3::new(-half_width, 0.0, 0.0),
            DVec3::X * 2.0 * half_width,
            DVec3::Y * height,
        );
        let expected = 1.0 - wall_factor(distance, height, half_width);
        let receiver = on_ground(DVec3::Z * distance);
        let estimate = mesh
            .tracer()
            .ambient_occlusion(&receiver, f64::INFINITY, MANY, 2);
        let inputs = format!("distance {distance}, height {height}, half width {half_width}");
        assert_estimates(estimate, expected, &inputs);
        if height > 100.0 {
            assert!(
                (estimate.mean - 0.5).abs() < 0.005,
                "{inputs}: {estimate:?}"
            );
        }
    }
}

/// A wall of a quarter on ground of a million, and far from the origin, where positions have a grid of an eighth. Neither
/// changes what a receiver sees, whether its position is exact or was rounded to f32; nor the light of a lamp on the wall.
#[test]
fn detail_survives_large_grounds_and_far_places() {
    let (distance, height, half_width) = (0.25, 0.25, 0.5);
    let expected = 1.0 - wall_factor(distance, height, half_width);
    for (place, half) in [
        (DVec3::ZERO, 5.0),
        (DVec3::ZERO, 1e6),
        (DVec3::new(2e6, 0.0, -1e6), 5.0),
        (DVec3::new(-2e6, 2e6, 2e6), 8.0),
        (DVec3::new(1e6, -1e6, 1e6), 1e6),
    ] {
        let mut mesh = Mesh::default();
        mesh.ground(place, half);
        mesh.parallelogram(
            place - DVec3::X * half_width,
            DVec3::X * 2.0 * half_width,
            DVec3::Y * height,
        );
        let tracer = mesh.tracer();
        let exact = place + DVec3::Z * distance;
        // As far off as the tree of a room here may be asked to bear.
        let rounded = exact + DVec3::Y * 1e-7 * (place.abs().max_element() + 1.0);
        for (position, side) in [(exact, 0.0), (rounded, 1.0), (2.0 * exact - rounded, -1.0)] {
            let inputs = format!("ground of {half} at {place}, {side} roundings off it");
            let estimate =
                tracer.ambient_occlusion(&on_ground(position), f64::INFINITY, MANY / 4, 3);
            assert_estimates(estimate, expected, &inputs);
            if side != 0.0 {
                continue;
            }
            let lamp = place + DVec3::Y * 0.125;
            let light = Light::Point {
                position: lamp,
                intensity: [1.0; 3],
            };
            let lit = tracer.direct(position, DVec3::Y, DVec3::splat(PI), &[light]);
            let to_lamp = lamp - position;
            let irradiance = to_lamp.y / to_lamp.length().powi(3);
            assert!(
                (lit.x - irradiance).abs() <= 1e-9 * irradiance,
                "{inputs}: {lit} for {irradiance}"
            );
            // Behind the wall the ground is dark.
            let behind = position - 2.0 * DVec3::Z * distance;
            let front = Light::Point {
                position: lamp + DVec3::Z * 0.25,
                intensity: [1.0; 3],
            };
            let dark = tracer.direct(behind, DVec3::Y, DVec3::ONE, &[front]);
            assert_eq!(dark, DVec3::ZERO, "{inputs}");
        }
    }
}

/// Small triangles on a ground that is much larger have a tree of their own.
#[test]
fn first_hit_holds_on_a_large_ground() {
    let mut random = Random(5);
    let mut mesh = Mesh::default();
    mesh.ground(DVec3::Y * -0.5, 1e5);
    for _ in 0..300 {
        let centre = random.in_cube();
        let mut corner = || centre + random.in_cube() * 0.1;
        mesh.triangle([corner(), corner(), corner()]);
    }
    mesh.ground(DVec3::Y * -1e3, 1e4);
    assert_same_hits((&mesh.positions, &mesh.indices), 4_000, 6, 1.0);
}

/// F = (r/d)² cos(theta) for a sphere wholly above the horizon: Howell B-39. The last one touches
/// the ground, and the horizon with it.
#[test]
fn sphere_above() {
    for (centre, radius) in [
        (DVec3::new(0.0, 2.0, 0.0), 1.0),
        (DVec3::new(1.5, 1.2, -0.4), 0.9),
        (DVec3::new(0.8, 0.5, 0.3), 0.5),
    ] {
        let mut mesh = Mesh::default();
        mesh.ground(DVec3::ZERO, 4.0);
        mesh.sphere(centre, radius);
        let distance = centre.length();
        let expected = 1.0 - (radius / distance).powi(2) * centre.y / distance;
        let estimate =
            mesh.tracer()
                .ambient_occlusion(&on_ground(DVec3::ZERO), f64::INFINITY, MANY, 3);
        assert_estimates(
            estimate,
            expected,
            &format!("centre {centre}, radius {radius}"),
        );
    }
}

/// A ceiling at height h blocks where h / cos(theta) < radius: V = (h / radius)², or 1.
#[test]
fn radius_limits_what_blocks() {
    let height = 0.8;
    let mut mesh = Mesh::default();
    mesh.ground(DVec3::ZERO, 20.0);
    mesh.ground(DVec3::Y * height, 20.0);
    let tracer = mesh.tracer();
    for radius in [0.1, 0.79, 0.81, 1.0, 2.5] {
        let expected = if radius < height {
            1.0
        } else {
            (height / radius).powi(2)
        };
        let estimate = tracer.ambient_occlusion(&on_ground(DVec3::ZERO), radius, MANY, 4);
        // The step off the ground shortens the way to the ceiling by up to 6e-5.
        assert_estimates(estimate, expected, &format!("radius {radius}"));
    }
}

/// The half-space below the geometric normal cuts the hemisphere about the shading normal as an
/// endless wall would: V = (1 + cos(alpha))/2.
#[test]
fn directions_into_the_surface_are_blocked() {
    let tracer = Mesh::default().tracer();
    for degrees in [0.0_f64, 20.0, 60.0, 90.0, 150.0, 180.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let receiver = Receiver {
            position: DVec3::ZERO,
            geometric_normal: DVec3::new(0.3, 0.5, -0.2),
            shading_normal: {
                let normal = DVec3::new(0.3, 0.5, -0.2).normalize();
                normal * cos + normal.any_orthonormal_vector() * sin
            },
        };
        let estimate = tracer.ambient_occlusion(&receiver, f64::INFINITY, MANY, 5);
        assert_estimates(
            estimate,
            f64::midpoint(1.0, cos),
            &format!("{degrees} degrees"),
        );
    }
}

#[test]
fn standard_error_is_honest() {
    let (distance, height, half_width) = (0.7, 2.0, 1.5);
    let mut mesh = Mesh::default();
    mesh.parallelogram(
        DVec3::new(-half_width, 0.0, 0.0),
        DVec3::X * 2.0 * half_width,
        DVec3::Y * height,
    );
    let tracer = mesh.tracer();
    let receiver = on_ground(DVec3::Z * distance);
    let expected = 1.0 - wall_factor(distance, height, half_width);
    // With 600 runs the spread is known to 3 %.
    let runs = 600;
    for rays in [8, 60, 256, 1_000] {
        let estimates: Vec<Estimate> = (0..runs)
            .map(|seed| tracer.ambient_occlusion(&receiver, f64::INFINITY, rays, seed))
            .collect();
        let average =
            |of: &dyn Fn(&Estimate) -> f64| estimates.iter().map(of).sum::<f64>() / runs as f64;
        let mean = average(&|estimate| estimate.mean);
        let spread = average(&|estimate| (estimate.mean - mean).powi(2)).sqrt();
        let reported = average(&|estimate| estimate.standard_error.powi(2)).sqrt();
        println!("{rays} rays: spread {spread:.5}, reported {reported:.5}");
        assert!(
            (0.87..1.15).contains(&(reported / spread)),
            "{rays} rays: spread {spread}, reported {reported}"
        );
        let bias = mean - expected;
        assert!(
            bias.abs() < 4.0 * spread / (runs as f64).sqrt() + 1e-4,
            "{rays} rays: biased by {bias}, spread {spread}"
        );
    }
}

/// Stratification must pay: pure chance would leave an error of sqrt(V (1 - V) / n).
#[test]
fn cells_beat_chance() {
    let mut mesh = Mesh::default();
    mesh.parallelogram(
        DVec3::new(-50.0, 0.0, 0.0),
        DVec3::X * 100.0,
        DVec3::Y * 3.0,
    );
    let estimate = mesh
        .tracer()
        .ambient_occlusion(&on_ground(DVec3::Z), f64::INFINITY, 10_000, 6);
    let chance = (estimate.mean * (1.0 - estimate.mean) / 10_000.0).sqrt();
    assert!(
        estimate.standard_error < 0.25 * chance,
        "{estimate:?}, by chance {chance}"
    );
}

#[test]
fn closed_room_sees_no_sky() {
    let scene = scenes::closed_room();
    let tracer = scene_tracer(&scene);
    let receivers: Vec<Option<Receiver>> = scene
        .indices
        .chunks_exact(3)
        .flat_map(|face| {
            let [a, b, c] = corners(&scene.positions, face);
            let normal = (b - a).cross(c - a);
            // The middle, and a place close to a corner.
            [[0.4, 0.3, 0.3], [0.999, 0.000_6, 0.000_4]].map(|[u, v, w]| {
                Some(Receiver {
                    position: a * u + b * v + c * w,
                    geometric_normal: normal,
                    shading_normal: normal + DVec3::splat(0.1 * normal.length()),
                })
            })
        })
        .collect();
    let estimates = tracer.ambient_occlusion_image(&receivers, f64::INFINITY, 200, 7, false);
    for (receiver, estimate) in receivers.iter().zip(estimates) {
        let closed = Some(Estimate {
            mean: 0.0,
            standard_error: 0.0,
        });
        assert_eq!(estimate, closed, "{receiver:?}");
    }
}

fn corners(positions: &[[f32; 3]], face: &[u32]) -> [DVec3; 3] {
    [0, 1, 2].map(|corner| Vec3::from(positions[face[corner] as usize]).as_dvec3())
}

/// The nearest hit by a loop over all triangles: plane first, then the corner weights by areas,
/// so that it shares no arithmetic with the tracer.
fn nearest_by_loop(
    mesh: (&[[f32; 3]], &[u32]),
    origin: DVec3,
    direction: DVec3,
    t_min: f64,
    t_max: f64,
) -> Option<Hit> {
    let (positions, indices) = mesh;
    let mut nearest: Option<Hit> = None;
    for (triangle, face) in indices.chunks_exact(3).enumerate() {
        let [a, b, c] = corners(positions, face);
        let normal = (b - a).cross(c - a);
        let t = normal.dot(a - origin) / normal.dot(direction);
        if !(t_min..t_max).contains(&t) || nearest.is_some_and(|old| old.t <= t) {
            continue;
        }
        let point = origin + direction * t;
        let area = normal.length_squared();
        let v = normal.dot((point - a).cross(c - a)) / area;
        let w = normal.dot((b - a).cross(point - a)) / area;
        if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
            nearest = Some(Hit {
                t,
                triangle,
                barycentric: [v, w],
            });
        }
    }
    nearest
}

#[track_caller]
fn assert_same_hits(mesh: (&[[f32; 3]], &[u32]), rays: usize, seed: u64, spread: f64) {
    let tracer = Tracer::new(mesh.0, mesh.1).expect("indices come in threes");
    let mut random = Random(seed);
    let mut hits = 0;
    for ray in 0..rays {
        // Every eighth ray starts far outside, every fifth runs along an axis.
        let reach = if ray % 8 == 0 { 100.0 * spread } else { spread };
        let target = random.in_cube() * spread;
        let (origin, direction) = if ray % 5 == 0 {
            let axis = DVec3::AXES[ray % 3] * if ray % 2 == 0 { 1.0 } else { -1.0 };
            (target - axis * reach, axis)
        } else {
            let origin = random.direction() * reach;
            (origin, (target - origin).normalize())
        };
        let (t_min, t_max) = match ray % 4 {
            0 => (0.0, f64::INFINITY),
            1 => (spread * 0.5, spread * 1.5),
            2 => (-spread, spread),
            _ => (0.0, spread),
        };
        let inputs = format!("ray {ray} from {origin} along {direction}, {t_min}..{t_max}");
        let expected = nearest_by_loop(mesh, origin, direction, t_min, t_max);
        let found = tracer.first_hit(origin, direction, t_min, t_max);
        assert_eq!(
            tracer.occluded(origin, direction, t_min, t_max),
            found.is_some(),
            "{inputs}: {found:?}"
        );
        match (expected, found) {
            (None, None) => {}
            (Some(expected), Some(found)) => {
                hits += 1;
                let close = 1e-9 * reach;
                assert!(
                    (expected.t - found.t).abs() <= close,
                    "{inputs}: {expected:?} {found:?}"
                );
                // The place by the corner weights is the place by the distance.
                let face = &mesh.1[3 * found.triangle..][..3];
                let [a, b, c] = corners(mesh.0, face);
                let [v, w] = found.barycentric;
                let place = a + (b - a) * v + (c - a) * w;
                let apart = place.distance(origin + direction * found.t);
                assert!(apart <= close, "{inputs}: {found:?} is off by {apart}");
                assert_eq!(expected.triangle, found.triangle, "{inputs}");
            }
            _ => panic!("{inputs}: expected {expected:?}, found {found:?}"),
        }
    }
    // Enough of both outcomes for the comparison to mean something.
    assert!(
        (rays / 20..rays).contains(&hits),
        "{hits} hits of {rays} rays"
    );
}

#[test]
fn first_hit_is_that_of_a_loop_over_all_triangles() {
    for (seed, place, size) in [
        (1, DVec3::ZERO, 1.0),
        (2, DVec3::ZERO, 1e-4),
        (3, DVec3::ZERO, 1e6),
    ] {
        let mut random = Random(seed);
        let mut mesh = Mesh::default();
        for number in 0..600 {
            let centre = random.in_cube();
            // From slivers and specks to half the scene.
            let extent = 0.5 * random.unit().powi(4) + 1e-3;
            let mut corner = || centre + random.in_cube() * extent;
            let mut triangle = [corner(), corner(), corner()];
            if number % 7 == 0 {
                // Square to an axis: its box is flat.
                triangle[1].y = triangle[0].y;
                triangle[2].y = triangle[0].y;
            }
            mesh.triangle(triangle.map(|corner| place + corner * size));
        }
        assert_same_hits((&mesh.positions, &mesh.indices), 4_000, seed, size);
    }
}

#[test]
fn first_hit_holds_in_the_scenes() {
    for name in ["cornell", "dominoes", "fence"] {
        let scene = scenes::by_name(name).expect("the scene exists");
        assert_same_hits((&scene.positions, &scene.indices), 1_500, 11, 4.0);
    }
}

/// Rays aimed at the corners and edges of a closed mesh must not slip between its triangles.
#[test]
fn closed_mesh_has_no_gaps() {
    let mut mesh = Mesh::default();
    mesh.sphere(DVec3::new(0.3, -0.2, 0.1), 1.0);
    let tracer = mesh.tracer();
    let mut random = Random(12);
    for face in mesh.indices.chunks_exact(3) {
        let [a, b, c] = corners(&mesh.positions, face);
        let origin = DVec3::new(0.3, -0.2, 0.1) + random.in_cube() * 0.5;
        for target in [a, a.midpoint(b), b.lerp(c, random.unit())] {
            let direction = (target - origin).normalize();
            assert!(
                tracer.occluded(origin, direction, 0.0, f64::INFINITY),
                "from {origin} to {target}"
            );
        }
    }
}

#[test]
fn shared_edge_belongs_to_the_lower_index() {
    let mut mesh = Mesh::default();
    mesh.parallelogram(DVec3::ZERO, DVec3::X, DVec3::Y);
    let tracer = mesh.tracer();
    for t in [0.125, 0.5, 0.75] {
        let origin = DVec3::new(t, t, 2.0);
        let hit = tracer.first_hit(origin, DVec3::NEG_Z, 0.0, 10.0);
        assert_eq!(
            hit.map(|hit| (hit.t, hit.triangle)),
            Some((2.0, 0)),
            "{origin}"
        );
    }
}

#[test]
fn unusable_triangles_are_left_out() {
    let positions = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [2.0, 0.0, 0.0],
        [f32::NAN, 0.0, 0.0],
        [0.0, f32::INFINITY, 0.0],
    ];
    let indices = [
        0, 1, 3, // on a line
        0, 1, 1, // an edge
        0, 1, 4, // not a number
        0, 1, 5, // without end
        0, 1, 6, // out of range
        0, 1, 2, // sound
    ];
    let tracer = Tracer::new(&positions, &indices).expect("indices come in threes");
    assert_eq!(tracer.skipped(), 5);
    let hit = tracer.first_hit(DVec3::new(0.2, 0.2, 1.0), DVec3::NEG_Z, 0.0, 2.0);
    assert_eq!(hit.map(|hit| hit.triangle), Some(5));

    assert_eq!(
        Tracer::new(&positions, &indices[..4]).err(),
        Some(TraceError::PartialTriangle { indices: 4 })
    );
}

#[test]
fn odd_input_gets_an_answer() {
    let empty = Mesh::default().tracer();
    let mut mesh = Mesh::default();
    mesh.ground(DVec3::ZERO, 1.0);
    let ground = mesh.tracer();
    let odd = [
        DVec3::ZERO,
        DVec3::NAN,
        DVec3::INFINITY,
        DVec3::MAX,
        DVec3::splat(1e-310),
    ];
    for tracer in [&empty, &ground] {
        for origin in odd {
            for direction in odd.into_iter().chain([DVec3::Y, DVec3::X]) {
                for (t_min, t_max) in [
                    (0.0, f64::INFINITY),
                    (f64::NEG_INFINITY, f64::INFINITY),
                    (f64::NAN, f64::NAN),
                    (1.0, -1.0),
                ] {
                    let found = tracer.first_hit(origin, direction, t_min, t_max);
                    let occluded = tracer.occluded(origin, direction, t_min, t_max);
                    assert_eq!(
                        found.is_some(),
                        occluded,
                        "{origin} {direction} {t_min} {t_max}"
                    );
                }
            }
        }
        for normal in odd {
            for radius in [0.0, -1.0, f64::NAN, f64::INFINITY] {
                for rays in [0, 1, 3] {
                    let receiver = Receiver {
                        position: DVec3::ZERO,
                        geometric_normal: normal,
                        shading_normal: DVec3::Y,
                    };
                    let estimate = tracer.ambient_occlusion(&receiver, radius, rays, 0);
                    let sound = normal.try_normalize().is_some();
                    assert_eq!(estimate.mean.is_finite(), sound, "{normal} {radius} {rays}");
                }
            }
        }
    }
    let open = empty.ambient_occlusion(&on_ground(DVec3::ZERO), f64::INFINITY, 1, 0);
    assert_eq!((open.mean, open.standard_error), (1.0, 0.0));
}

#[test]
fn image_is_the_same_for_any_number_of_threads() {
    let scene = scenes::cornell();
    let tracer = scene_tracer(&scene);
    let receivers: Vec<Option<Receiver>> = (0..200)
        .map(|index| {
            let x = f64::from(index) * 0.02 - 2.0;
            (index % 9 != 0).then(|| on_ground(DVec3::new(x, 0.0, 0.3 * x)))
        })
        .collect();
    let image = |threads, seed| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads start")
            .install(|| tracer.ambient_occlusion_image(&receivers, 1.0, 100, seed, false))
    };
    let one = image(1, 8);
    assert_eq!(one, image(3, 8));
    assert_ne!(one, image(3, 9));
    for (receiver, estimate) in receivers.iter().zip(&one) {
        assert_eq!(receiver.is_some(), estimate.is_some(), "{receiver:?}");
    }
}

/// The direction of a view through a place of its image, (-1, -1) at the lower left.
fn view_direction(view: &View, place: DVec2, aspect: f64) -> DVec3 {
    let ahead = (DVec3::from(view.target) - DVec3::from(view.eye)).normalize();
    let right = ahead.cross(DVec3::from(view.up)).normalize();
    let half = (view.vertical_fov_degrees.to_radians() / 2.0).tan();
    let offset = right * (place.x * aspect) + right.cross(ahead) * place.y;
    (ahead + offset * half).normalize()
}

/// Every view shows geometry, from its front, and none nearer than its near plane.
#[test]
fn views_look_at_their_scenes() {
    for scene in scenes::all() {
        let tracer = scene_tracer(&scene);
        assert_eq!(tracer.skipped(), 0, "{}", scene.name);
        for view in &scene.views {
            let eye = DVec3::from(view.eye);
            let (mut shown, mut from_behind, mut nearest) = (0, 0, f64::INFINITY);
            let steps = 24;
            for step in 0..steps * steps {
                let place = DVec2::new(f64::from(step % steps), f64::from(step / steps));
                let place = (place + 0.5) * 2.0 / f64::from(steps) - 1.0;
                let direction = view_direction(view, place, 16.0 / 9.0);
                let Some(hit) = tracer.first_hit(eye, direction, 0.0, f64::INFINITY) else {
                    continue;
                };
                let [a, b, c] = corners(&scene.positions, &scene.indices[3 * hit.triangle..][..3]);
                shown += 1;
                from_behind += i32::from((b - a).cross(c - a).dot(direction) > 0.0);
                nearest = nearest.min(hit.t);
            }
            let inputs = format!(
                "{} {}: {shown} of {} rays, {from_behind} from behind, nearest {nearest:.3} m",
                scene.name,
                view.name,
                steps * steps
            );
            println!("{inputs}");
            assert!(shown > steps * steps / 3, "{inputs}");
            assert_eq!(from_behind, 0, "{inputs}");
            // Depth runs along the axis: at the image's corner the ray is longer than it.
            let corner = view_direction(view, DVec2::ONE, 16.0 / 9.0);
            let ahead = view_direction(view, DVec2::ZERO, 1.0);
            assert!(nearest * corner.dot(ahead) > view.near, "{inputs}");
            assert!(corner.angle_between(ahead) < FRAC_PI_2, "{inputs}");
        }
    }
}

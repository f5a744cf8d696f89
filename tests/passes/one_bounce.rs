//! The ray-traced truth of direct light and of its first bounce, against closed forms.

use std::f64::consts::{FRAC_PI_2, PI};

use deep_screen_space::{
    Error, Light, Material,
    glam::{DVec2, DVec3},
    reference::trace::{ColorEstimate, Receiver, Tracer},
};

/// Rays to an estimate whose error bar should be small.
const MANY: u32 = 100_000;

#[derive(Default)]
struct Mesh {
    positions: Vec<[f32; 3]>,
    indices: Vec<u32>,
    materials: Vec<Material>,
}

impl Mesh {
    fn triangle(&mut self, corners: [DVec3; 3], material: Material) {
        for corner in corners {
            self.indices.push(self.positions.len() as u32);
            self.positions.push(corner.as_vec3().to_array());
        }
        self.materials.push(material);
    }

    fn parallelogram(&mut self, corner: DVec3, u: DVec3, v: DVec3, material: Material) {
        self.triangle([corner, corner + u, corner + u + v], material);
        self.triangle([corner, corner + u + v, corner + v], material);
    }

    /// A disk whose front looks along `normal`, an axis.
    fn disk(&mut self, centre: DVec3, radius: f64, normal: DVec3, material: Material) {
        let (x, y) = normal.any_orthonormal_pair();
        let rim = |step: i32| {
            let around = DVec2::from_angle(PI * f64::from(step % 1024) / 512.0) * radius;
            centre + x * around.x + y * around.y
        };
        for step in 0..1024 {
            self.triangle([centre, rim(step), rim(step + 1)], material);
        }
    }

    fn tracer(&self) -> Tracer {
        Tracer::new(&self.positions, &self.indices).expect("indices come in threes")
    }
}

fn material(albedo: [f32; 3], emission: [f32; 3]) -> Material {
    Material {
        albedo,
        emission,
        ..Material::default()
    }
}

fn facing(normal: DVec3) -> Receiver {
    Receiver {
        position: DVec3::ZERO,
        geometric_normal: normal,
        shading_normal: normal,
    }
}

/// Holds within four standard errors, and the relative 1e-4 of tessellation and of the step off a surface.
#[track_caller]
fn assert_estimates(estimate: ColorEstimate, expected: DVec3, inputs: &str) {
    let tolerance = estimate.standard_error * 4.0 + expected * 1e-4;
    assert!(
        (estimate.mean - expected).abs().cmple(tolerance).all(),
        "{inputs}: {estimate:?}, expected {expected}"
    );
    assert!(
        estimate.standard_error.max_element() <= 0.01 * expected.max_element(),
        "{inputs}: {estimate:?} has a wide error bar"
    );
}

#[track_caller]
fn assert_close(found: DVec3, expected: DVec3, inputs: &str) {
    assert!(
        (found - expected).abs().max_element() <= 1e-12 * (1.0 + expected.length()),
        "{inputs}: {found}, expected {expected}"
    );
}

fn point(position: DVec3, intensity: [f32; 3]) -> Light {
    Light::Point {
        position,
        intensity,
    }
}

/// `albedo/π · I cos θ / d²` and `albedo/π · E cos θ`.
#[test]
fn direct_light_has_its_closed_forms() {
    let tracer = Mesh::default().tracer();
    let albedo = DVec3::new(0.2, 0.5, 1.0);
    for (height, side) in [(1.0_f64, 0.0_f64), (2.0, 1.5), (0.25, 3.0)] {
        let inputs = format!("height {height}, side {side}");
        let at = DVec3::new(side, height, 0.0);
        let (d, color) = (side.hypot(height), DVec3::new(3.0, 2.0, 0.5));
        let point = point(at, [3.0, 2.0, 0.5]);
        let direct = |light| tracer.direct(DVec3::ZERO, DVec3::Y * 7.0, albedo, &[light]);
        let expected = albedo / PI * color * height / d.powi(3);
        assert_close(direct(point), expected, &inputs);
        let sun = Light::Directional {
            direction: -3.0 * at,
            irradiance: [3.0, 2.0, 0.5],
        };
        assert_close(direct(sun), albedo / PI * color * height / d, &inputs);
        // From below there is nothing, and two lights add.
        let below = tracer.direct(DVec3::ZERO, DVec3::NEG_Y, albedo, &[point, sun]);
        assert_eq!(below, DVec3::ZERO, "{inputs}");
        let both = tracer.direct(DVec3::ZERO, DVec3::Y, albedo, &[point, sun]);
        assert_close(both, direct(point) + direct(sun), &inputs);
    }
}

/// Whole within the inner cone, nothing outside of the outer one, 1/2 half-way in the cosine, and without a kink.
#[test]
fn spots_fall_off_between_their_cones() {
    let tracer = Mesh::default().tracer();
    let share = |inner: f32, outer: f32, angle: f64| {
        let light = Light::Spot {
            position: DVec3::Y * 2.0,
            direction: DVec3::new(angle.sin(), -angle.cos(), 0.0) * 5.0,
            intensity: [4.0; 3],
            inner,
            outer,
        };
        light.validate().expect("a spot");
        tracer.direct(DVec3::ZERO, DVec3::Y, DVec3::splat(PI), &[light])
    };
    for (inner, outer) in [(0.2_f32, 0.5_f32), (0.0, 1.5), (1e-4, 2e-4)] {
        let (i, o) = (f64::from(inner), f64::from(outer));
        let inputs = format!("{inner}..{outer}");
        let middle = f64::midpoint(i.cos(), o.cos()).acos();
        for (angle, expected) in [
            (0.0, 1.0),
            (i * 0.99, 1.0),
            (middle, 0.5),
            (o * 1.01, 0.0),
            (PI, 0.0),
        ] {
            let found = share(inner, outer, angle);
            assert!(
                (found - expected).abs().max_element() < 1e-6,
                "{inputs} at {angle}: {found}, expected {expected}"
            );
        }
        // The slope at either edge, in terms of the cosine, ends at 0: t² (3 − 2 t) leaves it by 3 t².
        let near = |t: f64| (o.cos() + t * (i.cos() - o.cos())).acos();
        for (t, expected) in [(1e-2, 2.98e-4), (1.0 - 1e-2, 1.0 - 2.98e-4)] {
            let found = share(inner, outer, near(t)).x;
            assert!((found - expected).abs() < 1e-6, "{inputs} at {t}: {found}");
        }
    }
    // A sharp edge.
    assert_eq!(share(0.3, 0.3, 0.299), DVec3::ONE);
    assert_eq!(share(0.3, 0.3, 0.301), DVec3::ZERO);
    assert_eq!(share(0.0, 0.0, 0.0), DVec3::ZERO);
}

/// A blocker counts where it lies between the point and the light, not behind the light and not where the light lies
/// on it.
#[test]
fn shadows_are_cast_by_what_lies_between() {
    let mut mesh = Mesh::default();
    let grey = material([0.5; 3], [0.0; 3]);
    let corner = DVec3::new(-5.0, 2.0, -5.0);
    mesh.parallelogram(corner, DVec3::X * 10.0, DVec3::Z * 10.0, grey);
    let tracer = mesh.tracer();
    for (height, lit) in [(1.0, true), (2.0, true), (2.001, false), (50.0, false)] {
        for side in [0.0, 3.0] {
            let light = point(DVec3::new(side, height, 0.0), [1.0; 3]);
            let found = tracer.direct(DVec3::ZERO, DVec3::Y, DVec3::ONE, &[light]);
            assert_eq!(found.x > 0.0, lit, "height {height}, side {side}: {found}");
        }
    }
    let sun = Light::Directional {
        direction: DVec3::NEG_Y,
        irradiance: [1.0; 3],
    };
    let under = tracer.direct(DVec3::ZERO, DVec3::Y, DVec3::ONE, &[sun]);
    assert_eq!(under, DVec3::ZERO);
    let above = tracer.direct(DVec3::Y * 3.0, DVec3::Y, DVec3::ONE, &[sun]);
    assert_close(above, DVec3::splat(1.0 / PI), "above the blocker");
    // A surface does not shade itself, whichever side is lit.
    let on = DVec3::new(1.0, 2.0, 1.0);
    let lit = tracer.direct(on, DVec3::Y, DVec3::ONE, &[sun]);
    assert_close(lit, DVec3::splat(1.0 / PI), "on the blocker");
}

/// An emitter of radiosity M has the radiance M/π: a disk overhead of view factor `R²/(h² + R²)` (Howell, "A Catalog of
/// Radiation Heat Transfer Configuration Factors", B-12) gives a white receiver `M/π · F`. Its back gives nothing.
#[test]
fn emission_comes_from_the_front() {
    let emission = [PI as f32, 2.0, 1e6];
    for (height, radius) in [(1.0, 1.0), (0.5, 2.0), (3.0, 0.4)] {
        for (side, share) in [(DVec3::NEG_Y, 1.0), (DVec3::Y, 0.0)] {
            let mut mesh = Mesh::default();
            let centre = DVec3::Y * height;
            mesh.disk(centre, radius, side, material([0.3; 3], emission));
            let factor = radius * radius / (height * height + radius * radius);
            let expected = DVec3::from(emission.map(f64::from)) / PI * factor * share;
            let found = mesh
                .tracer()
                .one_bounce(&facing(DVec3::Y), &mesh.materials, &[], MANY, 1);
            let inputs = format!("height {height}, radius {radius}, front to {side}");
            assert_estimates(found, expected, &inputs);
        }
    }
}

/// And its back as much where it is double-sided.
#[test]
fn double_sided_emission_comes_from_both() {
    let lamp = Material {
        double_sided: 1,
        ..material([0.3; 3], [PI as f32, 2.0, 1e6])
    };
    for side in [DVec3::NEG_Y, DVec3::Y] {
        let mut mesh = Mesh::default();
        mesh.disk(DVec3::Y, 1.0, side, lamp);
        let expected = DVec3::from(lamp.emission.map(f64::from)) / PI * 0.5;
        let found = mesh
            .tracer()
            .one_bounce(&facing(DVec3::Y), &mesh.materials, &[], MANY, 1);
        assert_estimates(found, expected, &format!("front to {side}"));
    }
}

/// The sun shines up onto a disk overhead, or down onto it: only the side that the receiver sees counts, front or back.
#[test]
fn the_side_that_is_seen_is_the_one_that_is_lit() {
    let albedo = [0.2_f32, 0.5, 0.9];
    let irradiance = [2.0_f32, 3.0, 4.0];
    for front in [DVec3::Y, DVec3::NEG_Y] {
        for (travel, share) in [(DVec3::Y, 1.0), (DVec3::NEG_Y, 0.0)] {
            let mut mesh = Mesh::default();
            mesh.disk(DVec3::Y, 1.0, front, material(albedo, [0.0; 3]));
            let sun = Light::Directional {
                direction: travel,
                irradiance,
            };
            let found =
                mesh.tracer()
                    .one_bounce(&facing(DVec3::Y), &mesh.materials, &[sun], MANY, 2);
            let expected =
                DVec3::from(albedo.map(f64::from)) * DVec3::from(irradiance.map(f64::from)) / PI
                    * 0.5
                    * share;
            assert_estimates(found, expected, &format!("front {front}, light {travel}"));
        }
    }
}

/// A point light at the centre of a sphere lights all of its inside alike, `E = I/R²`, so that any receiver inside has
/// `albedo/π · I/R²`, wherever it is and looks.
#[test]
fn sphere_lit_from_its_centre_is_uniform() {
    let mut mesh = Mesh::default();
    let grey = material([0.25, 0.5, 0.75], [0.0; 3]);
    let (sides, rings) = (256, 128);
    let at = |side: i32, ring: i32| {
        let (sin, cos) = (PI * f64::from(ring) / f64::from(rings)).sin_cos();
        let around = DVec2::from_angle(2.0 * PI * f64::from(side % sides) / f64::from(sides)) * sin;
        DVec3::new(around.x, cos, around.y) * 2.0
    };
    for ring in 0..rings {
        for side in 0..sides {
            let [a, b] = [at(side, ring), at(side + 1, ring)];
            let [c, d] = [at(side + 1, ring + 1), at(side, ring + 1)];
            mesh.triangle([a, b, c], grey);
            mesh.triangle([a, c, d], grey);
        }
    }
    let tracer = mesh.tracer();
    let light = point(DVec3::ZERO, [10.0; 3]);
    for (position, normal) in [
        (DVec3::new(0.5, 0.3, -0.7), DVec3::new(0.2, 0.9, 0.3)),
        (DVec3::new(-1.2, 0.0, 0.4), DVec3::X),
    ] {
        let receiver = Receiver {
            position,
            ..facing(normal)
        };
        let found = tracer.one_bounce(&receiver, &mesh.materials, &[light], 20_000, 3);
        let expected = DVec3::new(0.25, 0.5, 0.75) / PI * 10.0 / 4.0;
        // Flat faces lie up to 1 - cos(pi/128) nearer than the sphere: 3e-4 of the radius, 6e-4 of the irradiance.
        let off = ((found.mean - expected) / expected).abs().max_element();
        assert!(off < 1e-3, "{position}: {found:?}, expected {expected}");
        // Each further bounce has albedo times the one before.
        let albedo = DVec3::new(0.25, 0.5, 0.75);
        for (bounces, share) in [
            (0, DVec3::ZERO),
            (1, DVec3::ONE),
            (3, DVec3::ONE + albedo + albedo * albedo),
        ] {
            let how = (bounces, (2000, 3));
            let found = tracer.bounces(&receiver, &mesh.materials, &[light], how.0, how.1);
            let off = (found.mean - expected * share).abs().max_element();
            assert!(off <= 1e-3 * expected.max_element(), "{bounces}: {found:?}");
        }
    }
}

/// Directions below the geometric normal bring nothing though they are above the shading normal's horizon; in a glowing
/// sphere that leaves `(1 + cos α)/2`.
#[test]
fn directions_into_the_surface_bring_nothing() {
    let mut mesh = Mesh::default();
    let glow = material([0.0; 3], [PI as f32; 3]);
    for axis in DVec3::AXES {
        for side in [1.0, -1.0] {
            let (x, y) = (axis * side).any_orthonormal_pair();
            // Fronts look inward.
            let corner = axis * side * 4.0 - (x + y) * 4.0;
            mesh.parallelogram(corner, y * 8.0, x * 8.0, glow);
        }
    }
    let tracer = mesh.tracer();
    for degrees in [0.0_f64, 30.0, 90.0, 150.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let receiver = Receiver {
            position: DVec3::new(0.3, 0.2, 0.1),
            geometric_normal: DVec3::Y,
            shading_normal: DVec3::Y * cos + DVec3::X * sin,
        };
        let found = tracer.one_bounce(&receiver, &mesh.materials, &[], MANY, 4);
        let expected = DVec3::splat(f64::midpoint(1.0, cos));
        let off = (found.mean - expected).abs().max_element();
        let tolerance = 4.0 * found.standard_error.max_element() + 1e-6;
        assert!(off <= tolerance, "{degrees} degrees: {found:?}");
    }
}

#[test]
fn standard_error_is_honest() {
    let mut mesh = Mesh::default();
    let grey = material([0.3, 0.6, 0.9], [0.0; 3]);
    let corner = DVec3::new(-2.0, 0.0, 1.0);
    mesh.parallelogram(corner, DVec3::X * 4.0, DVec3::Y * 2.0, grey);
    let tracer = mesh.tracer();
    let light = point(DVec3::new(0.5, 0.7, 0.2), [1.0, 2.0, 3.0]);
    // With 400 runs the spread is known to 4 %.
    let runs = 400;
    for rays in [16, 200] {
        let estimates: Vec<ColorEstimate> = (0..runs)
            .map(|seed| tracer.one_bounce(&facing(DVec3::Y), &mesh.materials, &[light], rays, seed))
            .collect();
        let mean = estimates.iter().map(|e| e.mean).sum::<DVec3>() / runs as f64;
        let variance = estimates
            .iter()
            .map(|e| (e.mean - mean).powf(2.0))
            .sum::<DVec3>()
            / runs as f64;
        let reported = estimates
            .iter()
            .map(|e| e.standard_error.powf(2.0))
            .sum::<DVec3>()
            / runs as f64;
        let ratio = (reported / variance).powf(0.5);
        println!("{rays} rays: {ratio}");
        assert!(
            ratio.cmpgt(DVec3::splat(0.85)).all() && ratio.cmplt(DVec3::splat(1.18)).all(),
            "{rays} rays: reported by real {ratio}"
        );
    }
}

#[test]
fn image_is_the_same_for_any_number_of_threads() {
    let mut mesh = Mesh::default();
    mesh.disk(DVec3::Y, 1.0, DVec3::NEG_Y, material([0.5; 3], [1.0; 3]));
    let tracer = mesh.tracer();
    let light = point(DVec3::new(0.1, 0.5, 0.0), [1.0; 3]);
    let receivers: Vec<Option<Receiver>> = (0..60)
        .map(|index| {
            (index % 7 != 0).then(|| Receiver {
                position: DVec3::X * f64::from(index) * 0.02,
                ..facing(DVec3::Y)
            })
        })
        .collect();
    let image = |threads, seed| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads start")
            .install(|| {
                tracer.one_bounce_image(&receivers, &mesh.materials, &[light], 50, seed, false)
            })
    };
    let one = image(1, 8);
    assert_eq!(one, image(3, 8));
    assert_ne!(one, image(3, 9));
    for (receiver, estimate) in receivers.iter().zip(&one) {
        assert_eq!(receiver.is_some(), estimate.is_some(), "{receiver:?}");
    }
}

#[test]
fn odd_input_gets_an_answer() {
    let mut mesh = Mesh::default();
    mesh.disk(DVec3::Y, 1.0, DVec3::NEG_Y, material([0.5; 3], [1.0; 3]));
    let tracer = mesh.tracer();
    let light = point(DVec3::ZERO, [1.0; 3]);
    // Where the light is there is none of it; next to it there is much.
    let at = |y: f64| tracer.direct(DVec3::Y * y, DVec3::NEG_Y, DVec3::ONE, &[light]);
    for y in [0.0, 1e-300, 1e-100, 1e-20] {
        assert_eq!(at(y), DVec3::ZERO, "{y}");
    }
    for y in [1e-17, 1e-12] {
        assert!(at(y).is_finite() && at(y).x > 1e17, "{y}: {}", at(y));
    }
    let unlit = tracer.direct(DVec3::ZERO, DVec3::ZERO, DVec3::ONE, &[light]);
    assert_eq!(unlit, DVec3::ZERO);
    // Neither lights nor triangles.
    let empty = Mesh::default().tracer();
    let dark = empty.one_bounce(&facing(DVec3::Y), &[], &[light], 10, 0);
    assert_eq!((dark.mean, dark.standard_error), (DVec3::ZERO, DVec3::ZERO));
    // A normal without direction, and a triangle without a material.
    for (normal, materials) in [(DVec3::ZERO, &mesh.materials[..]), (DVec3::Y, &[])] {
        let estimate = tracer.one_bounce(&facing(normal), materials, &[], 100, 0);
        assert!(estimate.mean.is_nan(), "{normal}: {estimate:?}");
    }
}

#[test]
fn lights_out_of_range_are_typed_errors() {
    let spot = |direction, inner, outer| Light::Spot {
        position: DVec3::ZERO,
        direction,
        intensity: [1.0; 3],
        inner,
        outer,
    };
    let sun = |direction, irradiance| Light::Directional {
        direction,
        irradiance,
    };
    for good in [
        sun(DVec3::NEG_Y * 1e-100, [0.0; 3]),
        sun(DVec3::X, [0.0, 1e6, 1e18]),
        point(DVec3::splat(1e300), [0.0; 3]),
        spot(DVec3::Z, 0.0, 0.0),
        spot(DVec3::Z, 0.5, 0.5),
        spot(DVec3::Z, 0.0, FRAC_PI_2 as f32),
    ] {
        assert_eq!(good.validate(), Ok(()), "{good:?}");
    }
    for (bad, named) in [
        (sun(DVec3::ZERO, [1.0; 3]), "Light::direction"),
        (sun(DVec3::NAN, [1.0; 3]), "Light::direction"),
        (sun(DVec3::INFINITY, [1.0; 3]), "Light::direction"),
        (sun(DVec3::X, [1.0, -0.1, 1.0]), "Light::irradiance"),
        (sun(DVec3::X, [1.0, 1.0, f32::NAN]), "Light::irradiance"),
        (point(DVec3::NAN, [1.0; 3]), "Light::position"),
        (
            point(DVec3::Y * f64::NEG_INFINITY, [1.0; 3]),
            "Light::position",
        ),
        (point(DVec3::ZERO, [f32::INFINITY; 3]), "Light::intensity"),
        (point(DVec3::ZERO, [2e18; 3]), "Light::intensity"),
        (spot(DVec3::ZERO, 0.1, 0.2), "Light::direction"),
        (spot(DVec3::X, 0.3, 0.2), "Light::inner"),
        (spot(DVec3::X, -0.1, 0.2), "Light::inner"),
        (spot(DVec3::X, f32::NAN, 0.2), "Light::inner"),
        (spot(DVec3::X, 0.1, 1.6), "Light::outer"),
        (spot(DVec3::X, 0.1, f32::NAN), "Light::outer"),
    ] {
        match bad.validate() {
            Err(Error::Setting { field, .. }) => assert_eq!(field, named, "{bad:?}"),
            other => panic!("{bad:?}: {other:?}"),
        }
    }
}

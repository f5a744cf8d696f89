//! Spherical Gaussians: closed forms against quadrature, f32 and the GPU against f64, estimates against each other, and
//! every extreme.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use support::testing::pipelines;

use deep_screen_space::{
    glam::{DVec3, Vec3},
    reference::hashing::{hash2, unit_float},
    spherical_gaussian::{
        DLightMoments, DSphericalGaussian as Lobe, Estimate, LightMoments, MAX_ESTIMATE,
        SphericalGaussian,
    },
};
use support::gpu::Gpu;

/// From 0 to infinity, with both sides of every threshold between two forms.
fn sharpnesses() -> Vec<f64> {
    let mut all = vec![
        0.0, 1e-30, 1e-10, 0.4999, 0.5, 0.9999, 1.0, 1.0001, 3.7499, 3.75, 3.7501, 1e7, 1e12, 1e18,
    ];
    all.extend((-60..=60).map(|i| 10.0_f64.powf(f64::from(i) / 10.0)));
    all
}

fn cosines() -> impl Iterator<Item = f64> {
    (0..=60).map(|i| (PI * f64::from(i) / 60.0).cos())
}

/// `∫ f dx` with the points pressed together at both ends, where integrands have kinks.
fn quadrature(from: f64, to: f64, f: impl Fn(f64) -> f64) -> f64 {
    const STEPS: u32 = 400;
    let sum: f64 = (0..STEPS)
        .map(|i| {
            let t = (f64::from(i) + 0.5) / f64::from(STEPS);
            let x = t * t * t * (10.0 - t * (15.0 - 6.0 * t));
            let density = 30.0 * t * t * (1.0 - t) * (1.0 - t);
            f(from + (to - from) * x) * density
        })
        .sum();
    sum * (to - from) / f64::from(STEPS)
}

/// `∫ e^(λ (⟨φ, ω⟩ − 1)) f(⟨φ, ω⟩) dω`, given the mean of f over a ring around the axis, which may have kinks at ±kink.
fn around_axis(sharpness: f64, kink: f64, ring: impl Fn(f64) -> f64) -> f64 {
    let mut ends = vec![-1.0, -kink, kink, 1.0];
    ends.extend([0.1, 1.0, 4.0, 12.0, 40.0].map(|n| (1.0 - n / sharpness.max(1e-9)).max(-1.0)));
    ends.sort_by(f64::total_cmp);
    let parts = ends.windows(2).filter(|w| w[1] > w[0]);
    TAU * parts
        .map(|w| quadrature(w[0], w[1], |u| (sharpness * (u - 1.0)).exp() * ring(u)))
        .sum::<f64>()
}

/// The mean of the clamped cosine over a ring at height u around an axis whose cosine with the normal is z.
fn ring_of_clamped_cosines(u: f64, z: f64) -> f64 {
    let (a, b) = (u * z, ((1.0 - u * u) * (1.0 - z * z)).max(0.0).sqrt());
    if a.abs() >= b {
        return a.max(0.0);
    }
    (a * (FRAC_PI_2 + (a / b).asin()) + (b * b - a * a).sqrt()) / PI
}

fn truth(cosine: f64, sharpness: f64) -> f64 {
    let kink = (1.0 - cosine * cosine).max(0.0).sqrt();
    around_axis(sharpness, kink, |u| ring_of_clamped_cosines(u, cosine))
}

#[track_caller]
fn close(found: f64, expected: f64, relative: f64, inputs: &str) {
    assert!(
        (found - expected).abs() <= relative * expected.abs(),
        "{inputs}: {found} in place of {expected}"
    );
}

#[test]
fn exact_forms_are_the_integrals() {
    for sharpness in sharpnesses() {
        if sharpness > 1e6 {
            continue; // The quadrature's own u − 1 has no digits left.
        }
        let inputs = format!("sharpness {sharpness}");
        let lobe = Lobe {
            axis: DVec3::Z,
            sharpness,
            amplitude: 3.0,
        };
        // The quadrature is good to 1e-8 with λ (u − 1), of whose 1e-16 the λ-fold counts.
        let good = 1e-8 + 1e-15 * sharpness;
        let whole = 3.0 * around_axis(sharpness, 0.0, |_| 1.0);
        close(lobe.integral(), whole, good, &inputs);
        close(Lobe::upper(sharpness), truth(1.0, sharpness), good, &inputs);
        // The polynomials for I1 are good to 6e-7.
        close(
            Lobe::horizon(sharpness),
            truth(0.0, sharpness),
            6e-7,
            &inputs,
        );
        if sharpness < 600.0 {
            close(
                Lobe::lower(sharpness),
                truth(-1.0, sharpness),
                good,
                &inputs,
            );
        }
    }
}

/// The largest errors of both closed forms, relative to the largest value over angles.
fn worst(sharpness: f64) -> [f64; 2] {
    let mut worst = [0.0_f64; 2];
    for cosine in cosines().chain([-0.05, -0.02, -0.01, 0.01, 0.02, 0.05]) {
        let expected = truth(cosine, sharpness);
        let forms = [
            Lobe::cosine_integral(cosine, sharpness),
            Lobe::cosine_integral_logistic(cosine, sharpness),
        ];
        for (worst, found) in worst.iter_mut().zip(forms) {
            *worst = worst.max((found - expected).abs() / Lobe::upper(sharpness));
        }
    }
    worst
}

#[test]
fn cosine_integrals_are_as_close_as_said() {
    let mut largest = [0.0_f64; 2];
    for i in -20..=50 {
        let sharpness = 10.0_f64.powf(f64::from(i) / 10.0);
        let errors = worst(sharpness);
        if i % 5 == 0 {
            println!(
                "sharpness {sharpness:.3}: {:.1e} and {:.1e}",
                errors[0], errors[1]
            );
        }
        largest = [0, 1].map(|i| largest[i].max(errors[i]));
    }
    println!("largest: {:.2e} and {:.2e}", largest[0], largest[1]);
    assert!(
        largest[0] < 3.1e-4,
        "the erf's form is off by {}",
        largest[0]
    );
    // What numerics of the paper's form are known to be: neither better nor worse.
    assert!(
        (8e-3..9.5e-3).contains(&largest[1]),
        "the logistic form is off by {}",
        largest[1]
    );
}

/// No step in value or slope, in angle or in sharpness, the thresholds of all forms included.
#[test]
fn cosine_integral_is_smooth() {
    let f = |angle: f64, log: f64| {
        let sharpness = log.exp();
        Lobe::cosine_integral(angle.cos(), sharpness) / Lobe::upper(sharpness)
    };
    let h = 1e-3;
    for log in (-90..150).map(|i| f64::from(i) / 10.0 + 0.0217) {
        for angle in (1..60).map(|i| PI * f64::from(i) / 60.0) {
            let second = |a: f64, l: f64| {
                (f(angle + a, log + l) - 2.0 * f(angle, log) + f(angle - a, log - l)).abs()
            };
            // Curvature is that of a clamped cosine blurred by 1/√λ at most: a kink of 1 over that width. The polynomials
            // of the error function and of I1 may step by 5e-7.
            let width = (-0.5 * log).exp();
            let bound = h * h * (2.0 + 1.0 / width).min(1.0 / h) + 3e-6;
            for (a, l) in [(h, 0.0), (0.0, h), (h, h)] {
                let found = second(a, l);
                assert!(
                    found < 2.0 * bound,
                    "angle {angle}, log of sharpness {log}, step {a} {l}: {found}, bound {bound}"
                );
            }
        }
    }
}

/// Unit vectors all around.
fn directions(count: u32, seed: u32) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |i| {
        let z = 2.0 * unit_float(hash2(2 * i, seed)) - 1.0;
        let angle = TAU * unit_float(hash2(2 * i + 1, seed));
        let s = (1.0 - z * z).sqrt();
        DVec3::new(s * angle.cos(), s * angle.sin(), z)
    })
}

fn pairs() -> impl Iterator<Item = (Lobe, Lobe)> {
    let sharp = [0.0, 0.3, 4.0, 90.0, 1e5];
    let axes: Vec<DVec3> = directions(6, 1).chain([DVec3::Z, DVec3::NEG_Z]).collect();
    sharp.into_iter().flat_map(move |a| {
        let axes = axes.clone();
        sharp.into_iter().flat_map(move |b| {
            let axes = axes.clone();
            (0..axes.len()).map(move |i| {
                let lobe = |axis, sharpness, amplitude| Lobe {
                    axis,
                    sharpness,
                    amplitude,
                };
                (lobe(axes[i], a, 2.0), lobe(axes[(i * 3 + 1) % 8], b, 0.7))
            })
        })
    })
}

#[test]
fn product_is_the_product() {
    for (a, b) in pairs() {
        let c = a.product(&b);
        for direction in directions(20, 3).chain([a.axis, b.axis, c.axis]) {
            let expected = a.evaluate(direction) * b.evaluate(direction);
            let found = c.evaluate(direction);
            // Exponents of up to 4e5 with 16 digits.
            assert!(
                (found - expected).abs() <= 1e-9 * expected + 1e-300,
                "{a:?} times {b:?} along {direction}: {found} in place of {expected}"
            );
        }
    }
}

fn narrow(v: DVec3) -> Vec3 {
    v.as_vec3()
}

#[test]
fn single_precision_is_double_precision() {
    // 1e-5 of the value, and where e^(−λ) has been multiplied out, of what f32 has left above its least.
    let check = |found: f32, expected: f64, inputs: &str| {
        assert!(
            (f64::from(found) - expected).abs() <= 1e-5 * expected + 1e-37,
            "{inputs}: {found} in place of {expected}"
        );
    };
    for sharpness in sharpnesses() {
        let s = sharpness as f32;
        let same = f64::from(s);
        let inputs = format!("sharpness {s}");
        let unit = SphericalGaussian {
            sharpness: s,
            amplitude: 1.0,
            ..SphericalGaussian::ZERO
        };
        let double = Lobe {
            sharpness: same,
            amplitude: 1.0,
            ..Lobe::ZERO
        };
        check(unit.integral(), double.integral(), &inputs);
        check(SphericalGaussian::upper(s), Lobe::upper(same), &inputs);
        check(SphericalGaussian::horizon(s), Lobe::horizon(same), &inputs);
        check(SphericalGaussian::lower(s), Lobe::lower(same), &inputs);
        for cosine in cosines() {
            let found = SphericalGaussian::cosine_integral(cosine as f32, s);
            let expected = Lobe::cosine_integral(f64::from(cosine as f32), same);
            // A sum of parts of either sign: to the peak.
            let off = (f64::from(found) - expected).abs() / Lobe::upper(same);
            assert!(off < 2e-6, "{inputs}, cosine {cosine}: off by {off}");
        }
    }
    for (a, b) in pairs() {
        let single = |l: Lobe| SphericalGaussian {
            axis: narrow(l.axis),
            sharpness: l.sharpness as f32,
            amplitude: l.amplitude as f32,
        };
        let double = |l: SphericalGaussian| Lobe {
            axis: l.axis.as_dvec3(),
            sharpness: f64::from(l.sharpness),
            amplitude: f64::from(l.amplitude),
        };
        let (a, b) = (single(a), single(b));
        let found = a.product(&b);
        let expected = double(a).product(&double(b));
        let inputs = format!("{a:?} times {b:?}: {found:?} in place of {expected:?}");
        // The exponent is known to 1e-7 of itself.
        let exponent = (expected.amplitude / 1.4).max(1e-300).ln().abs();
        assert!(
            (f64::from(found.amplitude) - expected.amplitude).abs()
                <= (1e-5 + 1e-6 * exponent) * expected.amplitude + 1e-37,
            "{inputs}"
        );
        let longest = f64::from(a.sharpness.max(b.sharpness));
        assert!(
            (f64::from(found.sharpness) - expected.sharpness).abs() <= 1e-6 * longest,
            "{inputs}"
        );
    }
}

/// What a surface receives from a patch of sky, summed over samples and by the lobe of each estimate.
#[test]
fn moments_estimate_better_than_toksvig() {
    let normals: Vec<DVec3> = directions(64, 9).collect();
    let mut totals = [0.0_f64; 2];
    for (name, width) in [
        ("narrow", 0.05),
        ("a quarter", 0.5),
        ("a hemisphere", 1.0),
        ("the sphere", 2.0),
    ] {
        // Uniform over the cap `width` high.
        let samples: Vec<DVec3> = directions(4000, 5)
            .map(|d| {
                let z = 1.0 - width * (0.5 - 0.5 * d.z);
                let s = ((1.0 - z * z).max(0.0) / (1.0 - d.z * d.z).max(1e-12)).sqrt();
                DVec3::new(d.x * s, d.y * s, z)
            })
            .collect();
        let mut moments = DLightMoments::ZERO;
        for &sample in &samples {
            moments.add(sample, 1.0 / 4000.0);
        }
        let errors = [Estimate::Moments, Estimate::Toksvig].map(|estimate| {
            let lobe = moments.lobe(estimate);
            close(lobe.integral(), 1.0, 1e-12, name);
            let squares: f64 = normals
                .iter()
                .map(|n| {
                    let exact: f64 = samples.iter().map(|s| n.dot(*s).max(0.0)).sum::<f64>();
                    (lobe.irradiance(*n) - exact / 4000.0).powi(2)
                })
                .sum();
            (squares / 64.0).sqrt()
        });
        println!(
            "{name}: RMSE of irradiance {:.4} by moments, {:.4} by r / (1 - r), of 1",
            errors[0], errors[1]
        );
        for (total, error) in totals.iter_mut().zip(errors) {
            *total += error;
        }
    }
    assert!(
        totals[0] < 0.5 * totals[1],
        "moments {}, Toksvig {}",
        totals[0],
        totals[1]
    );
}

/// The estimate's lobe has the mean direction that it was made for.
#[test]
fn moments_are_kept() {
    for i in 1..1000 {
        let r = f64::from(i) / 1000.0;
        let moments = DLightMoments {
            vector: DVec3::X * r,
            total: 1.0,
        };
        let l = moments.lobe(Estimate::Moments).sharpness;
        let length = 1.0 / l.tanh() - 1.0 / l;
        close(length, r, 3e-3, &format!("length {r}, sharpness {l}"));
    }
}

#[test]
fn extremes_are_defined() {
    let mut one = LightMoments::ZERO;
    one.add(Vec3::new(0.6, 0.0, 0.8), 1e6);
    for estimate in [Estimate::Moments, Estimate::Toksvig] {
        let lobe = one.lobe(estimate);
        assert!(
            f64::from(lobe.sharpness) > 0.5 * MAX_ESTIMATE,
            "one light is a narrow lobe: {lobe:?}"
        );
        let head_on = lobe.irradiance(lobe.axis);
        assert!((head_on / 1e6 - 1.0).abs() < 1e-4, "{lobe:?}: {head_on}");
        assert_eq!(LightMoments::ZERO.lobe(estimate), SphericalGaussian::ZERO);

        let mut around = LightMoments::ZERO;
        for axis in Vec3::AXES {
            around.add(axis, 2.0);
            around.add(-axis, 2.0);
        }
        let lobe = around.lobe(estimate);
        assert_eq!(lobe.sharpness, 0.0, "{lobe:?}");
        assert!(
            (lobe.irradiance(Vec3::X) - 3.0).abs() < 1e-5,
            "a quarter of 12 whichever way: {lobe:?}"
        );
        for amount in [1e-30, 1e18, 1e30] {
            let mut moments = LightMoments::ZERO;
            moments.add(Vec3::X, amount);
            moments.add(Vec3::Y, amount);
            let value = moments.lobe(estimate).irradiance(Vec3::X) / amount;
            assert!((0.9..1.3).contains(&value), "{amount}: {value}");
        }
    }
    for sharpness in [f32::INFINITY, 3e38, f32::NAN, -1.0, 0.0, 1e-45] {
        for cosine in [-1.0, -1e-30, 0.0, 1.0, 1.0001, f32::NAN] {
            let values = [
                SphericalGaussian::cosine_integral(cosine, sharpness),
                SphericalGaussian::upper(sharpness),
                SphericalGaussian::lower(sharpness),
                SphericalGaussian::horizon(sharpness),
            ];
            assert!(
                values.iter().all(|v| v.is_finite() && *v >= 0.0),
                "sharpness {sharpness}, cosine {cosine}: {values:?}"
            );
        }
        let lobe = SphericalGaussian {
            axis: Vec3::X,
            sharpness,
            amplitude: 2.0,
        };
        assert_eq!(lobe.evaluate(Vec3::X), 2.0, "{lobe:?}");
        let product = lobe.product(&lobe);
        assert!(
            product.amplitude == 4.0 && product.axis.is_finite(),
            "{product:?}"
        );
    }
}

const KERNEL: &str = "
struct Found { integral: f32, upper: f32, lower: f32, horizon: f32, cosine: f32, logistic: f32, estimate: f32, toksvig: f32,
  value: f32, product: f32, product_sharpness: f32, lobe: f32 }
@group(0) @binding(0) var<storage, read> cases: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> found: array<Found>;
@compute @workgroup_size(64)
fn run(@builtin(global_invocation_id) id: vec3u) {
  if id.x >= arrayLength(&cases) { return; }
  let c = cases[id.x];
  let lobe = SphericalGaussian(vec3f(0.0, 0.0, 1.0), c.x);
  let aside = vec3f(sqrt(1.0 - c.y * c.y), 0.0, c.y);
  let product = sg_product(lobe, SphericalGaussian(aside, c.z));
  let scaled = sg_lobe(light_moments(lobe.axis, 3.0) + light_moments(aside, c.w));
  found[id.x] = Found(sg_integral(c.x), sg_upper(c.x), sg_lower(c.x), sg_horizon(c.x, exp(-c.x)),
    sg_cosine_integral(c.y, c.x), sg_cosine_integral_logistic(c.y, c.x), sg_estimate(c.w), sg_estimate_toksvig(c.w),
    sg_evaluate(lobe, aside), product.amplitude, product.lobe.sharpness,
    scaled.amplitude * sg_cosine_integral(scaled.lobe.axis.z, scaled.lobe.sharpness));
}
";

#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct Found {
    integral: f32,
    upper: f32,
    lower: f32,
    horizon: f32,
    cosine: f32,
    logistic: f32,
    estimate: f32,
    toksvig: f32,
    value: f32,
    product: f32,
    product_sharpness: f32,
    lobe: f32,
}

fn evaluate(gpu: &Gpu, cases: &[[f32; 4]]) -> Vec<Found> {
    let sources = [
        include_str!("../../wgsl/common/math.wgsl"),
        include_str!("../../wgsl/common/spherical_gaussian.wgsl"),
        KERNEL,
    ];
    support::testing::kernel::evaluate(gpu, &sources, cases, 64)
}

#[test]
fn gpu_is_double_precision() {
    let gpu = pipelines::gpu();
    let mut cases = Vec::new();
    for (i, sharpness) in sharpnesses().into_iter().enumerate() {
        for (j, cosine) in cosines().step_by(4).enumerate() {
            let other = [0.0, 0.2, 7.0, 1e4][(i + j) % 4];
            let r = ((i * 7 + j * 13) % 101) as f32 / 100.0;
            cases.push([sharpness as f32, cosine as f32, other, r]);
        }
    }
    let mut worst = [0.0_f64; 4];
    for (case, found) in cases.iter().zip(evaluate(gpu, &cases)) {
        let [s, z, other, r] = case.map(f64::from);
        let inputs = format!("sharpness {s}, cosine {z}, other {other}, r {r}: {found:?}");
        let unit = |axis, sharpness| Lobe {
            axis,
            sharpness,
            amplitude: 1.0,
        };
        let relative = |found: f32, expected: f64| {
            // Drivers flush what is below the least normal number.
            ((f64::from(found) - expected).abs() - 1.2e-38).max(0.0) / expected
        };
        let exact = [
            (found.integral, unit(DVec3::Z, s).integral()),
            (found.upper, Lobe::upper(s)),
            (found.horizon, Lobe::horizon(s)),
        ];
        for (found, expected) in exact {
            worst[0] = worst[0].max(relative(found, expected));
        }
        assert!(worst[0] < 1e-5, "{inputs}");
        // e^(−2λ): WGSL asks of an exponential 3 + 2 |x| units in the last place.
        let lower = relative(found.lower, Lobe::lower(s)) / (1.0 + s * 6e-8 * 4.0 / 1e-5);
        assert!(lower < 1e-5 || Lobe::lower(s) < 1e-36, "{inputs}");
        worst[1] = worst[1].max(lower);

        let peak = Lobe::upper(s);
        for (found, expected) in [
            (found.cosine, Lobe::cosine_integral(z, s)),
            (found.logistic, Lobe::cosine_integral_logistic(z, s)),
        ] {
            worst[2] = worst[2].max((f64::from(found) - expected).abs() / peak);
        }
        assert!(worst[2] < 1e-5, "{inputs}");

        let moments = |vector, total| DLightMoments { vector, total };
        for (found, estimate) in [
            (found.estimate, Estimate::Moments),
            (found.toksvig, Estimate::Toksvig),
        ] {
            let expected = moments(DVec3::X * r, 1.0).lobe(estimate).sharpness;
            // 1 − r² at 0.99 has 50 times the rounding of 1.
            assert!(
                (f64::from(found) - expected).abs() <= 2e-5 * expected,
                "{inputs}: {expected}"
            );
        }

        let aside = DVec3::new((1.0 - z * z).max(0.0).sqrt(), 0.0, z);
        let (lobe, second) = (unit(DVec3::Z, s), unit(aside, other));
        let product = lobe.product(&second);
        for (found, expected) in [
            (found.value, lobe.evaluate(aside)),
            (found.product, product.amplitude),
        ] {
            // Where the chord is short its square is known to 1e-7 of 1, and the exponent so much less.
            let exponent = expected.max(1e-40).ln().abs();
            let off = (f64::from(found) - expected).abs();
            let slack = 1e-5 + 1e-6 * exponent + if z > 0.99 { 1e-6 * s.max(other) } else { 0.0 };
            assert!(off <= slack * expected + 1.2e-38, "{inputs}: {expected}");
        }
        // Squares of less than 1e-19 are none.
        let off = (f64::from(found.product_sharpness) - product.sharpness).abs();
        assert!(off <= 1e-5 * s.max(other) + 1e-18, "{inputs}: {product:?}");

        let expected = moments(DVec3::Z * 3.0 + aside * r, 3.0 + r)
            .lobe(Estimate::Moments)
            .irradiance(DVec3::Z);
        let off = (f64::from(found.lobe) - expected).abs() / (3.0 + r);
        worst[3] = worst[3].max(off);
        assert!(off < 1e-4, "{inputs}: {expected}");
    }
    println!(
        "{}: exact {:.1e}, lower {:.1e}, cosine {:.1e} of the peak, from moments {:.1e}",
        gpu.name(),
        worst[0],
        worst[1],
        worst[2],
        worst[3]
    );
}

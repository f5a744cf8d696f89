//! Glossy lobes: sample, density and value against each other, against closed forms, and the GPU against its mirror.

use std::f64::consts::{LN_2, PI, TAU};
use support::testing::pipelines;

use deep_screen_space::{
    glam::{DVec2, DVec3},
    reference::{
        ggx::{Lobe, even_shares},
        hashing::{hash2, unit_float},
    },
};
use support::gpu::Gpu;

const ROUGHNESSES: [f64; 6] = [0.0, 1e-3, 0.1, 0.3, 0.5, 1.0];
/// Cosines of the view, down to the least that a lobe admits.
const VIEWS: [f64; 6] = [1.0, 0.9, 0.5, 0.1, 1e-2, 1e-4];

fn view_at(cosine: f64) -> DVec3 {
    let sine = (1.0 - cosine * cosine).sqrt();
    DVec3::new(0.6 * sine, -0.8 * sine, cosine)
}

fn lobe(cosine: f64, roughness: f64) -> Lobe {
    let lobe = Lobe::new(DVec3::Z, view_at(cosine), roughness);
    assert_eq!(lobe.frame * DVec3::Z, DVec3::Z);
    lobe
}

fn random(seed: u32, index: u32) -> DVec2 {
    DVec2::new(
        unit_float(hash2(index, 2 * seed)),
        unit_float(hash2(index, 2 * seed + 1)),
    )
}

/// A facet from two numbers of 0…1, the first of which is how far it leans in units of alpha, and the solid angle for a
/// unit of both: the lobe is as smooth in these whatever its width.
fn facet_at(alpha: f64, u: f64, angle: f64) -> (DVec3, f64) {
    let lean = u / (1.0 - u);
    let cosine = 1.0 / (1.0 + (alpha * lean).powi(2)).sqrt();
    let across = DVec2::from_angle(TAU * angle) * alpha * lean * cosine;
    let per_unit = cosine.powi(3) * alpha * alpha * lean / (1.0 - u).powi(2) * TAU;
    (across.extend(cosine), per_unit)
}

/// ∫ g(ω) dω over all directions that a lobe may draw, by a midpoint rule over `side` x `side` facets.
fn integrate(lobe: &Lobe, side: u32, mut g: impl FnMut(DVec3, DVec3) -> DVec3) -> DVec3 {
    let step = 1.0 / f64::from(side);
    let mut sum = DVec3::ZERO;
    for i in 0..side {
        for j in 0..side {
            let (u, angle) = (f64::from(i) + 0.5, f64::from(j) + 0.5);
            let (facet, solid_angle) = facet_at(lobe.alpha, u * step, angle * step);
            let toward = lobe.view.dot(facet);
            if toward > 0.0 {
                // Mirroring spreads a facet's solid angle by 4 <v, m>.
                let light = 2.0 * toward * facet - lobe.view;
                sum += g(light, facet) * (4.0 * toward * solid_angle);
            }
        }
    }
    sum * step * step
}

/// Every case of the lists above, with its name.
fn cases() -> impl Iterator<Item = (Lobe, String)> {
    ROUGHNESSES.into_iter().flat_map(|roughness| {
        VIEWS.map(|cosine| {
            let inputs = format!("roughness {roughness}, view at {cosine}");
            (lobe(cosine, roughness), inputs)
        })
    })
}

#[test]
fn pdf_integrates_to_one() {
    for (lobe, inputs) in cases() {
        let whole = integrate(&lobe, 512, |_, facet| DVec3::splat(lobe.pdf(facet))).x;
        // At the horizon the visible facets end in a kink, which the midpoint rule meets to 1 / side.
        assert!((whole - 1.0).abs() < 2e-3, "{inputs}: {whole}");
    }
}

/// What a surface makes of even light, against the sum of its lobe's own directions.
#[test]
fn even_light_is_about_the_lobes_sum() {
    const SIDE: u32 = 48;
    for roughness in [0.1, 0.3, 0.5, 0.7, 0.9, 1.0] {
        for cosine in [1.0, 0.8, 0.6, 0.4, 0.2, 0.1, 0.03] {
            let lobe = lobe(cosine, roughness);
            let mut sum = DVec2::ZERO;
            for i in 0..SIDE * SIDE {
                let point =
                    (DVec2::new(f64::from(i % SIDE), f64::from(i / SIDE)) + 0.5) / f64::from(SIDE);
                sum += DVec2::from(lobe.shares(&lobe.direction(point)));
            }
            let expected = sum / f64::from(SIDE * SIDE);
            let found = even_shares(cosine, roughness);
            assert!(found.min_element() >= 0.0, "{roughness}, {cosine}: {found}");
            for f0 in [0.04, 0.3, 1.0] {
                let [expected, found] = [expected, found].map(|s| f0 * s.x + s.y);
                // As far as two powers are from a table.
                let off = (found / expected).ln().abs();
                let inputs = format!("roughness {roughness}, view at {cosine}, f0 {f0}");
                assert!(
                    off < 1.45_f64.ln(),
                    "{inputs}: {found}, expected {expected}"
                );
            }
        }
    }
}

/// Directions fall into each of 12 x 12 sets of facets as often as the pdf says.
#[test]
fn directions_follow_the_pdf() {
    const CELLS: usize = 12;
    const RAYS_PER_PIXEL: u32 = 40_000;
    for (index, (lobe, inputs)) in (0..).zip(cases()) {
        let cell_of = |facet: DVec3| {
            let lean = facet.truncate().length() / facet.z.max(1e-30) / lobe.alpha;
            let angle = facet.y.atan2(facet.x) / TAU;
            let [i, j] = [lean / (1.0 + lean), angle - angle.floor()]
                .map(|x| ((x * CELLS as f64) as usize).min(CELLS - 1));
            i * CELLS + j
        };
        let mut expected = vec![0.0; CELLS * CELLS];
        integrate(&lobe, 480, |_, facet| {
            let density = lobe.pdf(facet);
            // What `integrate` multiplies by after this.
            let toward = lobe.view.dot(facet);
            let lean = facet.truncate().length() / facet.z / lobe.alpha;
            let (_, solid_angle) = facet_at(lobe.alpha, lean / (1.0 + lean), 0.0);
            expected[cell_of(facet)] += density * 4.0 * toward * solid_angle / (480.0 * 480.0);
            DVec3::ZERO
        });
        let mut found = vec![0.0; CELLS * CELLS];
        for i in 0..RAYS_PER_PIXEL {
            let drawn = lobe.direction(random(index, i));
            found[cell_of(drawn.facet)] += 1.0;
            let mirrored = drawn.light + lobe.view - 2.0 * lobe.view.dot(drawn.facet) * drawn.facet;
            assert!(mirrored.length() < 1e-12, "{inputs}: {drawn:?}");
        }
        let (mut chi2, mut freedom, mut rare) = (0.0, -1.0_f64, [0.0; 2]);
        for (expected, found) in expected.iter().zip(&found) {
            let expected = expected * f64::from(RAYS_PER_PIXEL);
            if expected < 10.0 {
                rare[0] += expected;
                rare[1] += found;
            } else {
                chi2 += (found - expected).powi(2) / expected;
                freedom += 1.0;
            }
        }
        if rare[0] >= 10.0 {
            chi2 += (rare[1] - rare[0]).powi(2) / rare[0];
            freedom += 1.0;
        }
        // Five standard deviations of a chi-square, and a tenth for the quadrature of the expected numbers.
        let most = freedom + 5.0 * (2.0 * freedom).sqrt() + 0.1 * freedom;
        assert!(chi2 < most, "{inputs}: chi2 {chi2} of {freedom}, {rare:?}");
    }
}

/// `D G2 / (4 ⟨n, l⟩ ⟨n, v⟩)` as it is printed.
fn textbook(alpha: f64, view: DVec3, light: DVec3) -> f64 {
    let h = (view + light).normalize();
    let d = alpha.powi(2) / (PI * (h.z.powi(2) * (alpha.powi(2) - 1.0) + 1.0).powi(2));
    let lambda = |w: DVec3| {
        let tan2 = (1.0 - w.z * w.z) / (w.z * w.z);
        ((1.0 + alpha.powi(2) * tan2).sqrt() - 1.0) / 2.0
    };
    d / (1.0 + lambda(view) + lambda(light)) / (4.0 * view.z * light.z)
}

#[test]
fn share_and_pdf_are_the_textbook_brdf_and_reciprocal() {
    for (index, (lobe, inputs)) in (0..).zip(cases()) {
        for i in 0..200 {
            let light = lobe.direction(random(index, i)).light;
            if light.z < 1e-3 {
                continue;
            }
            let brdf = |lobe: &Lobe, light: DVec3| {
                lobe.share(light) * lobe.pdf(lobe.facet_of(light)) / light.z
            };
            let found = brdf(&lobe, light);
            let printed = textbook(lobe.alpha, lobe.view, light);
            let other = Lobe {
                view: light,
                ..lobe
            };
            let back = brdf(&other, lobe.view);
            // The printed D cancels: 1e-16 over the square of the narrowest alpha.
            let close = |x: f64| (x - found).abs() <= 1e-8 * found;
            assert!(
                close(printed) && close(back),
                "{inputs}, {light}: {found}, printed {printed}, back {back}"
            );
        }
    }
}

/// A white surround. At roughness 1 D is constant, and the integral is `1 − μ ln(1 + 1/μ)`: `1 − ln 2` straight on.
#[test]
fn white_furnace() {
    for (lobe, inputs) in cases() {
        let energy = integrate(&lobe, 512, |light, facet| {
            DVec3::splat(lobe.share(light) * lobe.pdf(facet))
        });
        assert!((0.0..=1.0 + 2e-3).contains(&energy.x), "{inputs}: {energy}");
        let mean = mean_share(&lobe);
        // The quadrature meets the kink at the horizon to 1 / side, the mean to less.
        assert!(
            (mean - energy.x).abs() < 2e-3,
            "{inputs}: mean {mean}, quadrature {energy}"
        );
        if lobe.alpha == 1.0 {
            let mu = lobe.view.z;
            let exact = 1.0 - mu * (1.0 + 1.0 / mu).ln();
            assert!(
                (energy.x - exact).abs() < 2e-3,
                "{inputs}: {energy}, {exact}"
            );
        }
        if lobe.width <= 1e-6 && lobe.view.z >= 0.1 {
            assert!(energy.x > 0.999, "{inputs}: a mirror keeps {energy}");
        }
    }
    let straight = mean_share(&lobe(1.0, 1.0));
    assert!((straight - (1.0 - LN_2)).abs() < 1e-4, "{straight}");
}

fn mean_share(lobe: &Lobe) -> f64 {
    const SIDE: u32 = 256;
    (0..SIDE * SIDE)
        .map(|i| {
            let cell = DVec2::new(f64::from(i % SIDE), f64::from(i / SIDE));
            let point = (cell + random(3, i)) / f64::from(SIDE);
            lobe.share(lobe.direction(point).light)
        })
        .sum::<f64>()
        / f64::from(SIDE * SIDE)
}

#[test]
fn overlap_is_one_for_equal_lobes_and_none_for_mirrors() {
    for (lobe, inputs) in cases() {
        let itself = lobe.overlap(&lobe, 0.0);
        assert_eq!(itself, f64::from(u8::from(lobe.width > 0.0)), "{inputs}");
        let aside = lobe.overlap(&lobe, 0.002);
        if lobe.width <= 1e-6 {
            assert!(aside < 1e-12, "{inputs}: {aside}");
        }
        let wider = Lobe {
            width: 0.5 * lobe.width,
            ..lobe
        };
        assert!(lobe.overlap(&wider, 0.0) < 0.81, "{inputs}");
        assert_eq!(
            lobe.overlap(&wider, 0.1),
            wider.overlap(&lobe, 0.1),
            "{inputs}"
        );
    }
}

const KERNEL: &str = "
struct Case { normal: vec3f, roughness: f32, to_eye: vec3f, pad: f32, point: vec2f, pad2: vec2f }
struct Found { light: vec3f, pdf: f32, facet: vec3f, share: f32, fresnel: vec3f, overlap: f32, view: vec3f, alpha: f32 }
@group(0) @binding(0) var<storage, read> cases: array<Case>;
@group(0) @binding(1) var<storage, read_write> found: array<Found>;
@compute @workgroup_size(64)
fn run(@builtin(global_invocation_id) id: vec3u) {
  if id.x >= arrayLength(&cases) { return; }
  let c = cases[id.x];
  let lobe = make_lobe(c.normal, c.to_eye, c.roughness);
  let drawn = glossy_direction(lobe, c.point);
  let other = make_lobe(c.normal, normalize_or(c.to_eye + vec3f(0.01), c.normal), c.roughness * 0.9);
  found[id.x] = Found(drawn.light, glossy_pdf(lobe, drawn.facet), drawn.facet, glossy_share(lobe, drawn.light),
    schlick(vec3f(0.04, 0.5, 1.0), lobe, drawn.facet), lobe_overlap(lobe, other, 0.003), lobe.view, lobe.alpha);
}
";

#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct Case {
    normal: [f32; 3],
    roughness: f32,
    to_eye: [f32; 3],
    pad: f32,
    point: [f32; 2],
    pad2: [f32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct Found {
    light: [f32; 3],
    pdf: f32,
    facet: [f32; 3],
    share: f32,
    fresnel: [f32; 3],
    overlap: f32,
    view: [f32; 3],
    alpha: f32,
}

/// The functions of `wgsl/common/ggx.wgsl` alone.
fn evaluate(gpu: &Gpu, cases: &[Case]) -> Vec<Found> {
    let sources = [
        include_str!("../../wgsl/common/math.wgsl"),
        include_str!("../../wgsl/common/hashing.wgsl"),
        include_str!("../../wgsl/common/roughness.wgsl"),
        // What they import is above.
        &include_str!("../../wgsl/common/directions.wgsl").replace("#import", "//"),
        &include_str!("../../wgsl/common/ggx.wgsl").replace("#import", "//"),
        KERNEL,
    ];
    support::testing::kernel::evaluate(gpu, &sources, cases, 64)
}

fn case(normal: DVec3, to_eye: DVec3, roughness: f32, point: [f32; 2]) -> Case {
    Case {
        normal: normal.as_vec3().to_array(),
        roughness,
        to_eye: to_eye.as_vec3().to_array(),
        pad: 0.0,
        point,
        pad2: [0.0; 2],
    }
}

fn wide(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

#[test]
fn gpu_is_its_mirror() {
    let gpu = pipelines::gpu();
    let normals = [
        DVec3::Z,
        DVec3::NEG_Z,
        DVec3::new(0.3, -0.5, 0.8).normalize(),
        DVec3::new(-0.9, 0.4, -1e-3).normalize(),
    ];
    let mut inputs = Vec::new();
    for normal in normals {
        let (x, y) = normal.any_orthonormal_pair();
        for roughness in ROUGHNESSES {
            for cosine in VIEWS {
                let v = view_at(cosine);
                let to_eye = x * v.x + y * v.y + normal * v.z;
                for i in 0..16 {
                    let point = random(7, i).as_vec2().to_array();
                    inputs.push(case(normal, to_eye, roughness as f32, point));
                }
            }
        }
    }
    let found = evaluate(gpu, &inputs);
    for (input, found) in inputs.iter().zip(&found) {
        let normal = wide(input.normal).normalize();
        let lobe = Lobe::new(normal, wide(input.to_eye), f64::from(input.roughness));
        let point = DVec2::from(input.point.map(f64::from));
        let context = format!("{input:?}: {found:?}, {lobe:?}");
        // A view is known to some ulps, and near the horizon its own part along the normal with it.
        assert!(
            wide(found.view).distance(lobe.view) < 5e-7,
            "view of {context}"
        );
        assert!(
            (f64::from(found.alpha) - lobe.alpha).abs() < 1e-6 * lobe.alpha,
            "alpha of {context}"
        );
        // From the view as the GPU has it: at 1e-4 above the horizon its rounding is a hundredth of its height.
        let lobe = Lobe {
            view: wide(found.view).normalize(),
            ..lobe
        };
        let drawn = lobe.direction(point);
        let off = wide(found.facet).distance(drawn.facet);
        // The sum of a point on the cap and the view is known to 5e-7, the disk's part of it to the 2^-11 that WGSL asks of
        // sines. Once it is squeezed by alpha it is as long as this.
        let stretch = |v: DVec3, by: f64| (v.truncate() * by).extend(v.z);
        let unsqueezed = stretch(drawn.facet, 1.0 / lobe.alpha).normalize();
        let cap_view = stretch(lobe.view, lobe.alpha).normalize();
        let length = 2.0 * unsqueezed.dot(cap_view) * stretch(unsqueezed, lobe.alpha).length();
        let allowed = 1e-6 + (5e-7 + lobe.alpha / 2048.0) / length;
        assert!(
            off < allowed,
            "facet off by {off}, allowed {allowed}: {drawn:?}, {context}"
        );
        let off = wide(found.light).distance(drawn.light);
        assert!(
            off < 3.0 * allowed,
            "light off by {off}, allowed 3 times {allowed}: {drawn:?}, {context}"
        );
        let facet = wide(found.facet);
        let relative = |a: f32, b: f64| (f64::from(a) - b).abs() / b.max(1e-6);
        let of_own = lobe.pdf(facet);
        assert!(
            relative(found.pdf, of_own) < 1e-4,
            "pdf, of its own facet {of_own}: {context}"
        );
        let of_own = lobe.share(wide(found.light));
        assert!(
            (f64::from(found.share) - of_own).abs() < 1e-4,
            "share, of its own direction {of_own}: {context}"
        );
        let fresnel = lobe.schlick(DVec3::new(0.04, 0.5, 1.0), facet);
        assert!(
            wide(found.fresnel).distance(fresnel) < 1e-5,
            "{fresnel}: {context}"
        );
        let seen = wide(input.to_eye) + DVec3::splat(0.01);
        let other = Lobe::new(normal, seen.normalize(), 0.9 * f64::from(input.roughness));
        let overlap = lobe.overlap(&other, 0.003);
        assert!(
            (f64::from(found.overlap) - overlap).abs() < 1e-3,
            "{overlap}: {context}"
        );
    }
}

#[test]
fn extremes_stay_finite() {
    let gpu = pipelines::gpu();
    let normal = DVec3::new(0.3, -0.5, 0.8).normalize();
    let across = normal.any_orthonormal_vector();
    let mut inputs = Vec::new();
    for to_eye in [
        normal,
        -normal,
        across,
        (across - normal).normalize(),
        (across - normal * 1e-5).normalize(),
    ] {
        for roughness in [
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            -1.0,
            0.0,
            1e-40,
            1e-30,
            1e-3,
            0.5,
            1.0,
            7.0,
            f32::MAX,
        ] {
            let edge = [0.0, 1e-7, 0.25, 0.5, 0.75, 1.0 - f32::EPSILON / 2.0];
            for x in edge {
                for y in edge {
                    inputs.push(case(normal, to_eye, roughness, [x, y]));
                }
            }
        }
    }
    for (input, found) in inputs.iter().zip(evaluate(gpu, &inputs)) {
        let context = format!("{input:?}: {found:?}");
        let numbers = bytemuck::cast::<Found, [f32; 16]>(found);
        assert!(numbers.iter().all(|x| x.is_finite()), "{context}");
        assert!((0.0..=1.0).contains(&found.share), "{context}");
        assert!((0.0..=1.0).contains(&found.overlap), "{context}");
        assert!(found.pdf >= 0.0 && found.view[2] > 5e-5, "{context}");
        assert!((wide(found.light).length() - 1.0).abs() < 1e-5, "{context}");
        let alpha = match input.roughness {
            r if r.is_nan() => 1.0,
            r => (r.clamp(0.0, 1.0).powi(2)).max(1e-3),
        };
        assert!((found.alpha - alpha).abs() < 1e-6, "{alpha}: {context}");
    }
}

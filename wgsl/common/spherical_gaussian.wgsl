// Spherical Gaussians mu e^(lambda (<phi, w> - 1)) and sums of light samples (src/spherical_gaussian.rs, which says where
// each form comes from). Needs math. WGSL has no expm1: what would cancel is a series below 1.

struct SphericalGaussian {
  // phi, a unit vector.
  axis: vec3f,
  // lambda, 0 to MAX_SHARPNESS.
  sharpness: f32,
}

// What stands for an infinite sharpness.
const MAX_SHARPNESS: f32 = 1e18;
// The sharpest lobe that an estimate from samples gives, that of a single light.
const MAX_ESTIMATE: f32 = 1e6;

// Light samples added up: xyz are directions times amounts, w the amounts.
alias LightMoments = vec4f;

fn light_moments(direction: vec3f, amount: f32) -> LightMoments {
  return vec4f(direction * amount, amount);
}

// (1 - e^-x) / x, where `decay` is e^-x.
fn first_remainder(x: f32, decay: f32) -> f32 {
  let series = 1.0 - x * (1.0 / 2.0 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x * (1.0 / 720.0
    - x * (1.0 / 5040.0 - x * (1.0 / 40320.0 - x * (1.0 / 362880.0))))))));
  return select((1.0 - decay) / max(x, 1.0), series, x < 1.0);
}

// (e^-x - 1 + x) / x^2.
fn second_remainder(x: f32, decay: f32) -> f32 {
  let series = 1.0 / 2.0 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x * (1.0 / 720.0 - x * (1.0 / 5040.0
    - x * (1.0 / 40320.0 - x * (1.0 / 362880.0 - x * (1.0 / 3628800.0))))))));
  let y = max(x, 1.0);
  return select((1.0 - (1.0 - decay) / y) / y, series, x < 1.0);
}

// (1 - (1 + x) e^-x) / x^2.
fn first_moment(x: f32, decay: f32) -> f32 {
  let series = decay * (1.0 / 2.0 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x * (1.0 / 120.0 + x * (1.0 / 720.0
    + x * (1.0 / 5040.0 + x * (1.0 / 40320.0 + x * (1.0 / 362880.0 + x * (1.0 / 3628800.0)))))))));
  let y = max(x, 1.0);
  return select(((1.0 - decay) / y - decay) / y, series, x < 1.0);
}

// The value along a direction of a lobe of amplitude 1, by the chord between it and the axis.
fn sg_evaluate(lobe: SphericalGaussian, direction: vec3f) -> f32 {
  let chord = direction - lobe.axis;
  return exp(-lobe.sharpness * 0.5 * dot(chord, chord));
}

// Over the sphere, of amplitude 1.
fn sg_integral(sharpness: f32) -> f32 {
  let x = 2.0 * sharpness;
  return 4.0 * PI * first_remainder(x, exp(-x));
}

// A lobe, and its amplitude.
struct Scaled {
  lobe: SphericalGaussian,
  amplitude: f32,
}

// The product of two lobes of amplitude 1.
fn sg_product(a: SphericalGaussian, b: SphericalGaussian) -> Scaled {
  let sum = a.axis * a.sharpness + b.axis * b.sharpness;
  let sharpness = length(sum);
  let chord = a.axis - b.axis;
  let total = a.sharpness + b.sharpness + sharpness;
  let exponent = -a.sharpness * (b.sharpness / max(total, 1e-30)) * dot(chord, chord);
  return Scaled(SphericalGaussian(normalize_or(sum, a.axis), sharpness), exp(exponent));
}

fn sg_upper(sharpness: f32) -> f32 {
  return 2.0 * PI * second_remainder(sharpness, exp(-sharpness));
}

fn sg_lower(sharpness: f32) -> f32 {
  let decay = exp(-sharpness);
  return 2.0 * PI * decay * first_moment(sharpness, decay);
}

// 2 pi e^-x I1(x) / x, where `decay` is e^-x.
fn sg_horizon(x: f32, decay: f32) -> f32 {
  let y = (min(x, 3.75) / 3.75) * (min(x, 3.75) / 3.75);
  let small = decay * (0.5 + y * (0.87890594 + y * (0.51498869 + y * (0.15084934 + y * (0.02658733
    + y * (0.00301532 + y * 0.00032411))))));
  let wide = max(x, 3.75);
  let z = 3.75 / wide;
  let large = (0.39894228 + z * (-0.03988024 + z * (-0.00362018 + z * (0.00163801 + z * (-0.01031555
    + z * (0.02282967 + z * (-0.02895312 + z * (0.01787654 - z * 0.00420059)))))))) / (wide * sqrt(wide));
  return 2.0 * PI * select(large, small, x < 3.75);
}

// The error function of x >= 0, where `decay` is e^(-x^2).
fn error_function(x: f32, decay: f32) -> f32 {
  let y = 1.0 / (1.0 + 0.3275911 * x);
  return 1.0 - decay * y * (0.254829592 + y * (-0.284496736 + y * (1.421413741 + y * (-1.453152027 + y * 1.061405429))));
}

// |x| convolved with a Gaussian, less its value at 0.
fn rounded_absolute(x: f32, t: f32) -> f32 {
  let decay = exp(-(t * x) * (t * x));
  return x * error_function(t * x, decay) + (decay - 1.0) / (t * sqrt(PI));
}

// The integral of a lobe of amplitude 1 with a clamped cosine about a normal, `cosine` from the axis.
fn sg_cosine_integral(unclamped: f32, sharpness: f32) -> f32 {
  let cosine = clamp(unclamped, -1.0, 1.0);
  let decay = exp(-sharpness);
  let upper = 2.0 * PI * second_remainder(sharpness, decay);
  let lower = 2.0 * PI * decay * first_moment(sharpness, decay);
  let horizon = sg_horizon(sharpness, decay);
  let t = max(sqrt(sharpness * (sharpness + 3.12) / (2.0 * sharpness + 7.8 + 37.44 / max(sharpness, 1e-3))), 0.03);
  let bend = rounded_absolute(abs(cosine), t) / rounded_absolute(1.0, t);
  let odd = 0.5 * (upper - lower) * cosine;
  let even = horizon + (0.5 * (upper + lower) - horizon) * bend;
  return max(min(odd + even, upper), lower);
}

// The same by the closed form of the paper.
fn sg_cosine_integral_logistic(unclamped: f32, sharpness: f32) -> f32 {
  let cosine = clamp(unclamped, -1.0, 1.0);
  let decay = exp(-sharpness);
  let steepness = 2.1007 * sqrt(sharpness) * (sharpness / (sharpness + 4.4653));
  let height = 1.0 / (0.2958 * steepness + 0.5033);
  let share = height / (exp(min(abs(cosine) * steepness, 80.0)) + 1.0);
  let curve = mix(max(cosine, 0.0), 0.5 * cosine + 0.5, share);
  let upper = 2.0 * PI * second_remainder(sharpness, decay);
  return mix(2.0 * PI * decay * first_moment(sharpness, decay), upper, curve);
}

// The sharpness of a resultant's length.
fn sg_estimate(r: f32) -> f32 {
  let r2 = min(r * r, 1.0);
  let above = r * (3.0 - 0.2 * r2 * (6.0 + r2 * (1.0 - 2.0 * r2)));
  return min(above / max(1.0 - r2, 1e-18), MAX_ESTIMATE);
}

// The same as r / (1 - r).
fn sg_estimate_toksvig(r: f32) -> f32 {
  return min(r / max(1.0 - r, 1e-18), MAX_ESTIMATE);
}

// The lobe with these moments; without light, of amplitude 0.
fn sg_lobe(moments: LightMoments) -> Scaled {
  let mean = moments.xyz / max(moments.w, 1e-30);
  let sharpness = sg_estimate(min(length(mean), 1.0));
  let lobe = SphericalGaussian(normalize_or(mean, vec3f(0.0, 0.0, 1.0)), sharpness);
  return Scaled(lobe, max(moments.w, 0.0) / sg_integral(sharpness));
}

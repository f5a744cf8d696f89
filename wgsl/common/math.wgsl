const PI: f32 = 3.14159265358979;
const MAX_F32: f32 = 3.4028234e38;

// Compares bits, since a compiler may assume that floats are finite and fold `x - x == 0` or `x == x` away.
fn is_finite(x: f32) -> bool {
  return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn is_finite3(v: vec3f) -> bool {
  return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

fn is_finite4(v: vec4f) -> bool {
  return is_finite3(v.xyz) && is_finite(v.w);
}

fn max_component(v: vec3f) -> f32 {
  return max(v.x, max(v.y, v.z));
}

// The unit vector along v, or `fallback` where v is zero, not finite, or too short to have a direction. Scaled by the
// largest component first: squares of lengths below 1e-19 or above 1e19 leave the range of f32.
fn normalize_or(v: vec3f, fallback: vec3f) -> vec3f {
  let scale = max_component(abs(v));
  if !is_finite3(v) || scale < 1e-30 {
    return fallback;
  }
  return normalize(v / scale);
}

// Two unit vectors that complete n to a right-handed frame (Duff et al. 2017). It turns over where n.z is -0.2, where few
// walls face: at 0, where theirs do, rounding would decide for those along an axis.
fn tangent_frame(n: vec3f) -> mat3x3f {
  let s = select(-1.0, 1.0, n.z >= -0.2);
  let a = -1.0 / (s + n.z);
  let b = n.x * n.y * a;
  return mat3x3f(vec3f(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3f(b, s + n.y * n.y * a, -n.y), n);
}

// Moments of view depth over an area: mean, variance, the area's share that has a surface, and its share that lies in the
// viewport. Mean and variance are those of the surfaces alone.

// Where a level begins in the buffer of all, and its size in texels. A buffer, not a mip chain: drivers were seen to load from
// the level that a neighbouring invocation asks for.
struct MomentLevel {
  offset: u32,
  padding: u32,
  size: vec2u,
}

// The moments over several areas that count by `shares`, whose sum is at most 1. Centred, in the manner of Chan, Golub and
// LeVeque (1979): squares of depths themselves would cancel.
fn merge_moments(a: vec4f, b: vec4f, c: vec4f, d: vec4f, shares: vec4f) -> vec4f {
  let covered = shares * vec4f(a.z, b.z, c.z, d.z);
  let inside = dot(shares, vec4f(a.w, b.w, c.w, d.w));
  let sum = dot(covered, vec4f(1.0));
  if !(sum > 0.0) {
    return vec4f(0.0, 0.0, 0.0, inside);
  }
  let weights = covered / sum;
  // Relative to a mean among them, so that what is summed is small where they are alike.
  let origin = select(select(select(d.x, c.x, c.z > 0.0), b.x, b.z > 0.0), a.x, a.z > 0.0);
  let offsets = vec4f(a.x, b.x, c.x, d.x) - origin;
  let shift = dot(weights, offsets);
  let apart = offsets - shift;
  let variance = dot(weights, vec4f(a.y, b.y, c.y, d.y) + apart * apart);
  return vec4f(origin + shift, variance, sum, inside);
}

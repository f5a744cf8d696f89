// Horizon-based ambient occlusion after Jimenez et al., Practical Realtime Strategies for Accurate Indirect Occlusion
// (2016): in slices about the view ray, the highest horizon on either side, and between both the cosine about the
// shading normal integrated in closed form (their equation 7). V = 1/pi * integral of visible * cosine.
//
// Three things are more exact than in the paper and cost next to nothing. Slices are spread evenly about the view ray
// of the pixel, not about the camera's axis. A tap is slid parallel to the pixel's tangent plane into the slice, since a
// texel's centre is not in it: a plane then never occludes itself. And the sum is divided by that of an open
// hemisphere over the same slices: few slices are right about an open pixel and a closed one.

@group(0) @binding(1) var depths: texture_2d<f32>;
@group(0) @binding(2) var normals: texture_2d<f32>;
@group(0) @binding(3) var result: texture_storage_2d<r32float, write>;

const SECTORS: f32 = 32.0;

struct Slice {
  // The pixel's point and the middle of the pixel.
  p: vec3f,
  at: vec2f,
  to_eye: vec3f,
  // To where taps are slid: (tangential direction out of the plane) / (its part out of the plane), and the plane's normal.
  slide: vec3f,
  across: vec3f,
}

// How many pixels a sphere of the radius about the pixel's point reaches along one side of a slice, to the image's
// border at most.
fn reach(slice: Slice, side: vec3f, line: vec2f) -> f32 {
  let border = to_border(slice.at, line);
  let range = length(slice.p);
  if params.radius >= range {
    return border;
  }
  // The tangent from the eye to the circle that the slice cuts out of the sphere.
  let sine = params.radius / range;
  let cosine = sqrt(1.0 - sine * sine);
  let touch = (cosine * -slice.to_eye + sine * side) * cosine * range;
  let clip = params.clip_from_eye * vec4f(touch, 1.0);
  if clip.w <= 1e-6 * range {
    return border;
  }
  return min(border, distance(pixel_of_clip(clip), slice.at));
}

// A tap of one side, from the pixel's point; w is 0 where it is beyond the radius, or slid to the other side.
fn tap_at(slice: Slice, offset: f32, side: vec3f, line: vec2f) -> vec4f {
  let texel = clamp(vec2i(slice.at + offset * line), vec2i(0), size() - 1);
  let tap = position(vec2f(texel) + 0.5, textureLoad(depths, texel, 0).x) - slice.p;
  let d = tap - slice.slide * dot(tap, slice.across);
  let counts = dot(tap, tap) < params.radius * params.radius && dot(d, side) > 0.0;
  return vec4f(d, select(0.0, 1.0, counts));
}

// Cosine of the angle from the view ray.
fn cosine_to_eye(slice: Slice, d: vec3f) -> f32 {
  return clamp(dot(d, slice.to_eye) * inverseSqrt(max(dot(d, d), 1e-30)), -1.0, 1.0);
}

// The angle from the view ray to the highest horizon on one side.
fn horizon(slice: Slice, side: vec3f, line: vec2f, jitter: f32) -> f32 {
  let end = reach(slice, side, line);
  var highest = -1.0;
  for (var i = 0u; i < params.steps; i++) {
    let offset = step_at(i, jitter, end);
    if offset > end {
      break;
    }
    let tap = tap_at(slice, offset, side, line);
    highest = select(highest, max(highest, cosine_to_eye(slice, tap.xyz)), tap.w > 0.0);
  }
  return acos(highest);
}

// Integral of cos(t - gamma) * |sin t| from 0 to h, times 4.
fn arc(h: f32, gamma: f32) -> f32 {
  return sign(h) * (cos(gamma) - cos(2.0 * h - gamma) + 2.0 * h * sin(gamma));
}

// The sectors that are blocked on one side, a bit each: between the front of each tap and its back, which is the
// thickness farther along its view ray. Sectors are of one weight: they divide arc() evenly.
fn blocked(slice: Slice, gamma: f32, toward: f32, side: vec3f, line: vec2f, jitter: f32, round_up: f32) -> u32 {
  let end = reach(slice, side, line);
  let lowest = gamma - 0.5 * PI;
  let highest = gamma + 0.5 * PI;
  let from_low = arc(lowest, gamma);
  let per_sector = SECTORS / (arc(highest, gamma) - from_low);
  var bits = 0u;
  for (var i = 0u; i < params.steps; i++) {
    let offset = step_at(i, jitter, end);
    if offset > end {
      break;
    }
    let tap = tap_at(slice, offset, side, line);
    if tap.w > 0.0 {
      let behind = tap.xyz + normalize(slice.p + tap.xyz) * params.thickness;
      let front_angle = toward * acos(cosine_to_eye(slice, tap.xyz));
      let back_angle = toward * acos(cosine_to_eye(slice, behind));
      let angles = clamp(vec2f(min(front_angle, back_angle), max(front_angle, back_angle)), vec2f(lowest), vec2f(highest));
      let first = (arc(angles.x, gamma) - from_low) * per_sector + round_up;
      let last = (arc(angles.y, gamma) - from_low) * per_sector + round_up;
      let start = u32(clamp(first, 0.0, SECTORS));
      let stop = u32(clamp(last, 0.0, SECTORS));
      bits |= below(stop) & ~below(start);
    }
  }
  return bits;
}

// The lowest n bits; a shift by 32 would be one by 0.
fn below(n: u32) -> u32 {
  return select((1u << n) - 1u, 0xffffffffu, n >= 32u);
}

fn visibility(texel: vec2i, depth: f32) -> f32 {
  var slice: Slice;
  slice.at = vec2f(texel) + 0.5;
  slice.p = position(slice.at, depth);
  slice.to_eye = -normalize(slice.p);
  let normal = normalize(textureLoad(normals, texel, 0).xyz);
  let tangent = normalize(params.right - slice.to_eye * dot(params.right, slice.to_eye));
  let bitangent = cross(slice.to_eye, tangent);
  let clip = params.clip_from_eye * vec4f(slice.p, 1.0);
  let noise = pixel_noise(texel);
  var visible = 0.0;
  var open = 0.0;
  for (var i = 0u; i < params.count; i++) {
    let phi = PI * (f32(i) + noise.x) / f32(params.count);
    let side = cos(phi) * tangent + sin(phi) * bitangent;
    slice.across = cross(side, slice.to_eye);
    // The slice holds the eye: it is a line of the image.
    let ahead = params.clip_from_eye * vec4f(side, 0.0);
    let line = normalize((ahead.xy * clip.w - clip.xy * ahead.w) * vec2f(params.size) * vec2f(1.0, -1.0));
    // The normal in the slice.
    let out_of = dot(normal, slice.across);
    let inside2 = max(1.0 - out_of * out_of, 1e-4);
    let inside = normal - slice.across * out_of;
    let gamma = atan2(dot(inside, side), dot(inside, slice.to_eye));
    slice.slide = (slice.across - normal * out_of) / inside2;
    let jitter = fract(noise.y + f32(i) * 0.6180339887);
    let weight = sqrt(inside2);
    let whole = weight * (arc(gamma + 0.5 * PI, gamma) - arc(gamma - 0.5 * PI, gamma));
    open += whole;
    if params.thickness < SKY {
      let round_up = fract(noise.x + noise.y + f32(i) * 0.7548776662);
      let bits = blocked(slice, gamma, 1.0, side, line, jitter, round_up)
        | blocked(slice, gamma, -1.0, -side, -line, 1.0 - jitter, round_up);
      visible += whole * (1.0 - f32(countOneBits(bits)) / SECTORS);
    } else {
      // Not below the tangent plane.
      let low = max(-horizon(slice, -side, -line, 1.0 - jitter), gamma - 0.5 * PI);
      let high = max(min(horizon(slice, side, line, jitter), gamma + 0.5 * PI), low);
      visible += weight * (arc(high, gamma) - arc(low, gamma));
    }
  }
  return clamp(visible / max(open, 1e-6), 0.0, 1.0);
}

@compute @workgroup_size(8, 8)
fn gtao(@builtin(global_invocation_id) id: vec3u) {
  if any(id.xy >= params.size) {
    return;
  }
  let depth = textureLoad(depths, id.xy, 0).x;
  var value = 1.0;
  if !is_sky(depth) {
    value = visibility(vec2i(id.xy), depth);
  }
  textureStore(result, id.xy, vec4f(value, 0.0, 0.0, 0.0));
}

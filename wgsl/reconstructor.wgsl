// Reconstructor: the levels' sums, each smoothed over the pixels that its sub-buffers were dealt among, added up and
// resolved into the caller's texture (Deep Screen Space 3.3).
//
//   smooth_rows     compute: joint bilateral means along rows, for levels 1 and up
//   smooth_columns  compute: the same along columns, and the sum of these levels
//   reconstruct     fragment: level 0 and that sum, through one of the effect's outputs
//
// A pixel of level l saw one surfel in 4^l, by its place in a block of 2^l x 2^l pixels: the mean over such a block sees
// them all. Neighbours count as far as they lie in the pixel's tangent plane and it in theirs, and share its normal.
//
// A thread smooths four pixels next to each other along the filter, one a component of its vectors: each neighbour is
// loaded and decoded once for the four.

#import math
#import packing
#import camera
#import receiver

struct Params {
  camera: Camera,
  levels: u32,
  // Half width of the filter in pixels is round(radius * 2^level).
  radius: f32,
  // How far off a pixel's tangent plane a neighbour may lie, in half widths of the filter at the pixel's distance.
  plane_distance: f32,
  // Exponent of the cosine between normals, 8 or more.
  normal_power: f32,
  // Of the G-buffer; the camera's is a sub-image's where one is reconstructed.
  viewport: vec4u,
  // Which.
  sub_image: u32,
  padding0: u32,
  padding1: u32,
  padding2: u32,
}

#import effect_types

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var receivers: texture_2d<u32>;
@group(0) @binding(2) var sums: texture_2d_array<f32>;
#if SMOOTH
#if COLOR || QUAD || OCTET
@group(0) @binding(3) var means: texture_storage_2d_array<rgba32float, write>;
#else
#if PAIR
@group(0) @binding(3) var means: texture_storage_2d_array<rg32float, write>;
#else
@group(0) @binding(3) var means: texture_storage_2d_array<r32float, write>;
#endif
#endif
#else
#if SMOOTHED
@group(0) @binding(3) var means: texture_2d_array<f32>;
#endif
#if ALBEDO || ROUGHNESS
#import sub_image
#endif
#if ALBEDO
#import albedo
@group(0) @binding(4) var albedo_texture: texture_2d<f32>;
#endif
#if ROUGHNESS
#import roughness
@group(0) @binding(5) var roughness_texture: texture_2d<f32>;
#endif
#if ENVIRONMENT
#import environment_levels
@group(0) @binding(6) var<uniform> environment: Environment;
@group(0) @binding(7) var environment_levels: texture_2d<f32>;
@group(0) @binding(8) var<storage, read> environment_irradiance: array<vec4f, 9>;
#endif
#import effect
#import output
#endif

fn size() -> vec2i {
  return vec2i(params.camera.viewport.zw);
}

#if OCTET
fn sum_at(at: vec2i, level: u32) -> Sum {
  return Sum(textureLoad(sums, at, level * PLANES, 0), textureLoad(sums, at, level * PLANES + 1u, 0));
}
#else
fn value_of(texel: vec4f) -> Sum {
#if QUAD
  return texel;
#else
#if COLOR
  return texel.xyz;
#else
#if PAIR
  return texel.xy;
#else
  return texel.x;
#endif
#endif
#endif
}

fn sum_at(at: vec2i, level: u32) -> Sum {
  return value_of(textureLoad(sums, at, level, 0));
}
#endif

#if SMOOTH

// Sums of four pixels: a column holds one channel of all.
#if OCTET
struct FourSums {
  low: mat4x4f,
  high: mat4x4f,
}
fn four_of(sum: vec4f, weight: vec4f) -> mat4x4f {
  return mat4x4f(sum.x * weight, sum.y * weight, sum.z * weight, sum.w * weight);
}
fn scaled(sum: Sum, weight: vec4f) -> FourSums {
  return FourSums(four_of(sum[0], weight), four_of(sum[1], weight));
}
fn added(a: FourSums, b: FourSums) -> FourSums {
  return FourSums(a.low + b.low, a.high + b.high);
}
fn four_divided(sums: mat4x4f, weights: vec4f) -> mat4x4f {
  return mat4x4f(sums[0] / weights, sums[1] / weights, sums[2] / weights, sums[3] / weights);
}
fn divided(sums: FourSums, weights: vec4f) -> FourSums {
  return FourSums(four_divided(sums.low, weights), four_divided(sums.high, weights));
}
fn sum_of(sums: FourSums, i: u32) -> Sum {
  return Sum(transpose(sums.low)[i], transpose(sums.high)[i]);
}
#else
#if QUAD
alias FourSums = mat4x4f;
fn scaled(sum: vec4f, weight: vec4f) -> FourSums {
  return mat4x4f(sum.x * weight, sum.y * weight, sum.z * weight, sum.w * weight);
}
fn divided(sums: FourSums, weights: vec4f) -> FourSums {
  return mat4x4f(sums[0] / weights, sums[1] / weights, sums[2] / weights, sums[3] / weights);
}
fn sum_of(sums: FourSums, i: u32) -> Sum {
  return vec4f(sums[0][i], sums[1][i], sums[2][i], sums[3][i]);
}
#else
#if COLOR
alias FourSums = mat3x4f;
fn scaled(sum: vec3f, weight: vec4f) -> FourSums {
  return mat3x4f(sum.x * weight, sum.y * weight, sum.z * weight);
}
fn divided(sums: FourSums, weights: vec4f) -> FourSums {
  return mat3x4f(sums[0] / weights, sums[1] / weights, sums[2] / weights);
}
fn sum_of(sums: FourSums, i: u32) -> Sum {
  return vec3f(sums[0][i], sums[1][i], sums[2][i]);
}
#else
#if PAIR
alias FourSums = mat2x4f;
fn scaled(sum: vec2f, weight: vec4f) -> FourSums {
  return mat2x4f(sum.x * weight, sum.y * weight);
}
fn divided(sums: FourSums, weights: vec4f) -> FourSums {
  return mat2x4f(sums[0] / weights, sums[1] / weights);
}
fn sum_of(sums: FourSums, i: u32) -> Sum {
  return vec2f(sums[0][i], sums[1][i]);
}
#else
alias FourSums = vec4f;
fn scaled(sum: f32, weight: vec4f) -> FourSums {
  return sum * weight;
}
fn divided(sums: FourSums, weights: vec4f) -> FourSums {
  return sums / weights;
}
fn sum_of(sums: FourSums, i: u32) -> Sum {
  return sums[i];
}
#endif
#endif
#endif
fn added(a: FourSums, b: FourSums) -> FourSums {
  return a + b;
}
#endif

// Four pixels; a column holds one coordinate of all.
struct Four {
  position: mat3x4f,
  normal: mat3x4f,
  // One over the distance off the plane at which a neighbour counts no more.
  per_tolerance: vec4f,
}

fn half_width(level: u32) -> i32 {
  return i32(round(params.radius * f32(1u << level)));
}

fn load_four(first: vec2i, along: vec2i, width: i32) -> Four {
  var position: mat4x3f;
  var normal: mat4x3f;
  var per_tolerance: vec4f;
  for (var i = 0; i < 4; i++) {
    let texel = textureLoad(receivers, min(first + i * along, size() - 1), 0);
    position[i] = receiver_position(texel);
    normal[i] = unpack_normal(texel.w);
    let pixel = footprint(params.camera, position[i] - params.camera.eye);
    per_tolerance[i] = 1.0 / max(params.plane_distance * f32(width) * pixel, 1e-30);
  }
  return Four(transpose(position), transpose(normal), per_tolerance);
}

fn dot4(a: mat3x4f, b: mat3x4f) -> vec4f {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// 1 for a pixel itself; exactly 0 across an edge in depth or between perpendicular surfaces.
fn similarity(p: Four, position: vec3f, normal: vec3f) -> vec4f {
  let d = mat3x4f(position.x - p.position[0], position.y - p.position[1], position.z - p.position[2]);
  let off_plane = max(abs(dot4(p.normal, d)), abs(d * normal)) * p.per_tolerance;
  let in_plane = max(1.0 - off_plane * off_plane, vec4f(0.0));
  // About cosine^power, and cosine^8 where that is the power: cheaper than pow(), and 0 from 1 - 8 / power down.
  let base = max(1.0 - (params.normal_power / 8.0) * (1.0 - p.normal * normal), vec4f(0.0));
  let base2 = base * base;
  let base4 = base2 * base2;
  return in_plane * in_plane * base4 * base4;
}

fn smoothed(first: vec2i, along: vec2i, level: u32, place: u32) -> FourSums {
  let width = half_width(level);
  let p = load_four(first, along, width);
  var mean: FourSums;
  var weights = vec4f(0.0);
  let start = dot(first, along);
  let end = min(start + 3 + width, dot(size() - 1, along));
  for (var t = max(start - width, 0); t <= end; t++) {
    let there = first + (t - start) * along;
    let texel = textureLoad(receivers, there, 0);
    let sum = sum_at(there, place);
    if texel.w != SKY && is_usable(sum) {
      let offset = abs(vec4f(f32(t - start)) - vec4f(0.0, 1.0, 2.0, 3.0));
      var weight = similarity(p, receiver_position(texel), unpack_normal(texel.w));
      weight = select(weight, vec4f(0.0), offset > vec4f(f32(width)));
      weight = select(weight, vec4f(1.0), offset == vec4f(0.0));
      mean = added(mean, scaled(sum, weight));
      weights += weight;
    }
  }
  return divided(mean, max(weights, vec4f(1e-30)));
}

fn store(first: vec2i, along: vec2i, place: u32, four: FourSums) {
  for (var i = 0u; i < 4u; i++) {
    let at = first + i32(i) * along;
    if all(at < size()) {
      textureStore(means, at, place * PLANES, texel_of(sum_of(four, i), 0u));
#if OCTET
      textureStore(means, at, place * PLANES + 1u, texel_of(sum_of(four, i), 1u));
#endif
    }
  }
}

@compute @workgroup_size(8, 8)
fn smooth_rows(@builtin(global_invocation_id) id: vec3u) {
  let along = vec2i(1, 0);
  let first = vec2i(id.xy) * vec2i(4, 1);
  if all(first < size()) {
    store(first, along, id.z, smoothed(first, along, id.z + 1u, id.z + 1u));
  }
}

@compute @workgroup_size(8, 8)
fn smooth_columns(@builtin(global_invocation_id) id: vec3u) {
  let along = vec2i(0, 1);
  let first = vec2i(id.xy) * vec2i(1, 4);
  if all(first < size()) {
    var total: FourSums;
    for (var level = 1u; level < params.levels; level++) {
      total = added(total, smoothed(first, along, level, level - 1u));
    }
    store(first, along, 0u, total);
  }
}

#else

#import screen

@fragment
fn reconstruct(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let at = clamp(vec2i(fragment.xy) - vec2i(params.camera.viewport.xy), vec2i(0), size() - 1);
  var albedo = vec3f(1.0);
#if ALBEDO || ROUGHNESS
  let pixel = params.viewport.xy + stands_for(vec2u(at), params.sub_image, params.viewport.zw);
#endif
#if ALBEDO
  albedo = decode_albedo(textureLoad(albedo_texture, pixel, 0).xyz);
#endif
#if RECEIVER
  var receiver = Receiver();
#endif
  var total = Sum();
  let texel = textureLoad(receivers, at, 0);
  if texel.w != SKY {
#if RECEIVER
    receiver.normal = unpack_normal(texel.w);
#endif
#if VIEW
    receiver.to_eye = to_camera(params.camera, receiver_position(texel) - params.camera.eye);
#endif
#if ROUGHNESS
    receiver.roughness = clean_roughness(textureLoad(roughness_texture, pixel, 0).x);
#endif
    let finest = sum_at(at, 0u);
    if is_usable(finest) {
      total = finest;
    }
#if SMOOTHED
#if OCTET
    total += Sum(textureLoad(means, at, 0, 0), textureLoad(means, at, 1, 0));
#else
    total += value_of(textureLoad(means, at, 0, 0));
#endif
#endif
  }
#if RECEIVER
  return held(resolved(total, albedo, receiver));
#else
  return held(resolved(total, albedo));
#endif
}

#endif

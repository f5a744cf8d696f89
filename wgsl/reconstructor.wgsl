// Reconstructor: the levels' sums, each smoothed over the pixels that its sub-buffers were dealt among, added up and
// resolved into the caller's texture (Deep Screen Space 3.3).
//
//   blur_rows       compute: joint bilateral means along rows, for levels 1 and up
//   reconstruct     fragment: the same along columns, the sum over levels, the effect's resolve()
//
// A pixel of level l saw one surfel in 4^l, by its place in a block of 2^l x 2^l pixels: the mean over such a block sees
// them all. Neighbours count as far as they lie in the pixel's tangent plane and it in theirs, and share its normal.

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
  // Exponent of the cosine between normals.
  normal_power: f32,
}

#import effect_types

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var receivers: texture_2d<u32>;
@group(0) @binding(2) var sums: texture_2d_array<f32>;
#if ROWS
#if COLOR
@group(0) @binding(3) var rows: texture_storage_2d_array<rgba32float, write>;
#else
@group(0) @binding(3) var rows: texture_storage_2d_array<r32float, write>;
#endif
#else
#if BLURRED
@group(0) @binding(3) var rows: texture_2d_array<f32>;
#endif
#if ALBEDO
@group(0) @binding(4) var albedo_texture: texture_2d<f32>;
#endif
#import effect
#endif

fn half_width(level: u32) -> i32 {
  return i32(round(params.radius * f32(1u << level)));
}

struct Pixel {
  position: vec3f,
  normal: vec3f,
}

fn pixel_from(texel: vec4u) -> Pixel {
  return Pixel(receiver_position(texel), unpack_normal(texel.w));
}

// 1 for the pixel itself; exactly 0 across an edge in depth or between perpendicular surfaces.
fn similarity(p: Pixel, texel: vec4u, tolerance: f32) -> f32 {
  if texel.w == SKY {
    return 0.0;
  }
  let q = pixel_from(texel);
  let d = q.position - p.position;
  let off_plane = max(abs(dot(p.normal, d)), abs(dot(q.normal, d))) / tolerance;
  let in_plane = max(1.0 - off_plane * off_plane, 0.0);
  let cosine = max(dot(p.normal, q.normal), 0.0);
  return in_plane * in_plane * pow(cosine, params.normal_power);
}

fn value_of(texel: vec4f) -> Sum {
#if COLOR
  return texel.xyz;
#else
  return texel.x;
#endif
}

fn size() -> vec2i {
  return vec2i(params.camera.viewport.zw);
}

// World units that the plane distance of a neighbour is measured in.
fn plane_tolerance(p: Pixel, width: i32) -> f32 {
  let relative = p.position - params.camera.eye;
  return max(params.plane_distance * f32(width) * footprint(params.camera, relative), 1e-30);
}

#if ROWS

@compute @workgroup_size(8, 8)
fn blur_rows(@builtin(global_invocation_id) id: vec3u) {
  let at = vec2i(id.xy);
  let level = id.z + 1u;
  if any(at >= size()) {
    return;
  }
  let own = textureLoad(receivers, at, 0);
  var mean = value_of(textureLoad(sums, at, level, 0));
  let width = half_width(level);
  if own.w != SKY && width > 0 {
    let p = pixel_from(own);
    let tolerance = plane_tolerance(p, width);
    var weights = 1.0;
    for (var i = max(-width, -at.x); i <= min(width, size().x - 1 - at.x); i++) {
      let there = at + vec2i(i, 0);
      let weight = select(similarity(p, textureLoad(receivers, there, 0), tolerance), 0.0, i == 0);
      mean += weight * value_of(textureLoad(sums, there, level, 0));
      weights += weight;
    }
    mean /= weights;
  }
#if COLOR
  textureStore(rows, at, id.z, vec4f(mean, 0.0));
#else
  textureStore(rows, at, id.z, vec4f(mean, 0.0, 0.0, 0.0));
#endif
}

#else

@vertex
fn cover(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
  // One triangle over the whole viewport.
  return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn reconstruct(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let at = clamp(vec2i(fragment.xy) - vec2i(params.camera.viewport.xy), vec2i(0), size() - 1);
  let own = textureLoad(receivers, at, 0);
  var albedo = vec3f(1.0);
#if ALBEDO
  albedo = textureLoad(albedo_texture, vec2i(params.camera.viewport.xy) + at, 0).xyz;
#endif
  if own.w == SKY {
    return resolve(Sum(0.0), albedo);
  }
  let p = pixel_from(own);
  var total = value_of(textureLoad(sums, at, 0, 0));
#if BLURRED
  for (var level = 1u; level < params.levels; level++) {
    var mean = value_of(textureLoad(rows, at, level - 1u, 0));
    let width = half_width(level);
    let tolerance = plane_tolerance(p, width);
    var weights = 1.0;
    for (var i = max(-width, -at.y); i <= min(width, size().y - 1 - at.y); i++) {
      let there = at + vec2i(0, i);
      let weight = select(similarity(p, textureLoad(receivers, there, 0), tolerance), 0.0, i == 0);
      mean += weight * value_of(textureLoad(rows, there, level - 1u, 0));
      weights += weight;
    }
    total += mean / weights;
  }
#endif
  return resolve(total, albedo);
}

#endif

// HitReconstructor: from the hits of a bounced z-buffer to the caller's picture (The Bounced Z-buffer 3.3).
//
//   average       compute: each pixel's own mean over its directions, and how uncertain it is
//   reconstruct   fragment: a cross-bilateral mean over a window, into the caller's texture
//
// A pixel's estimate is the mean of radiance (or openness) over directions, each weighed by the receiver's cosine over
// the density that it was drawn with. With #if DEFERRED the window gathers its neighbours' hits, direction by direction,
// weighed by the cosine of the *receiving* pixel, so that what its normal tells is not blurred; without, their means.
//
// With #if GLOSSY a receiver mirrors radiance by its lobe (wgsl/common/ggx.wgsl), and a neighbour counts as far as its lobe
// overlaps the pixel's.

#import math
#import packing
#import hashing
#import camera
#import receiver
#import directions
#if GLOSSY
#import ggx
#endif

struct Params {
  camera: Camera,
  columns: u32,
  rows: u32,
  frame: u32,
  words: u32,
  // Half width of the window in pixels.
  radius: u32,
  // How far off a pixel's tangent plane a neighbour may lie, in pixels at the pixel's distance.
  plane_distance: f32,
  // Exponent of the cosine between normals.
  normal_power: f32,
  // How many standard deviations a neighbour's mean may differ; 0 for no such test.
  deviations: f32,
  // Reflectance of glossy receivers seen straight on.
  f0: vec3f,
}

override SAMPLING: u32 = 0u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var receivers: texture_2d<u32>;
#if HITS
#if RADIANCE
@group(0) @binding(2) var hits: texture_2d_array<u32>;
#else
@group(0) @binding(2) var<storage, read> hits: array<u32>;
#endif
#endif
#if AVERAGE
@group(0) @binding(3) var means: texture_storage_2d<rgba32float, write>;
#else
@group(0) @binding(3) var means: texture_2d<f32>;
#if ALBEDO
#import albedo
@group(0) @binding(4) var albedo_texture: texture_2d<f32>;
#endif
#endif
#if GLOSSY
@group(0) @binding(5) var roughness_texture: texture_2d<f32>;
#endif

fn size() -> vec2i {
  return vec2i(params.camera.viewport.zw);
}

fn directions() -> u32 {
  return params.columns * params.rows;
}

#if HITS
// What came along a direction: radiance, or 1 where nothing was hit.
fn incoming(pixel: vec2u, index: u32) -> vec3f {
#if RADIANCE
  return unpack_color(textureLoad(hits, pixel, index, 0).x);
#else
  let word = hits[(pixel.y * params.camera.viewport.z + pixel.x) * params.words + index / 32u];
  return vec3f(select(1.0, 0.0, ((word >> (index & 31u)) & 1u) != 0u));
#endif
}

#if !GLOSSY
// A receiver's cosine to a direction over the density that the direction was drawn with, as a share of what cosine
// sampling about the receiver's own normal gives, 1.
fn share(normal: vec3f, drawn: Direction) -> f32 {
  return max(dot(normal, drawn.direction), 0.0) / (PI * max(drawn.pdf, 1e-6));
}
#endif
#endif

#if GLOSSY
fn lobe_of(pixel: vec2u, texel: vec4u) -> Lobe {
  let roughness = textureLoad(roughness_texture, params.camera.viewport.xy + pixel, 0).x;
  let relative = receiver_position(texel) - params.camera.eye;
  return make_lobe(unpack_normal(texel.w), to_camera(params.camera, relative), roughness);
}

// How far two receivers lie from each other, as an angle. An orthographic camera is taken to stand as far off as its
// picture is high.
fn parallax(apart: vec3f, pixel: f32) -> f32 {
  let angle = select(1.0 / f32(params.camera.viewport.w), params.camera.pixel, params.camera.perspective != 0u);
  return length(apart) / max(pixel, 1e-30) * angle;
}

#if HITS
// What a lobe makes of what came along a direction. For radiance xyz is what it sends on, and w 1: a mean over directions
// drawn from the lobe has no bias. Openness is instead weighed by what the lobe would mirror, w.
fn mirrored(lobe: Lobe, light: vec3f, facet: vec3f, value: vec3f) -> vec4f {
  let share = glossy_share(lobe, light);
#if RADIANCE
  return vec4f(share * schlick(params.f0, lobe, facet) * value, 1.0);
#else
  return vec4f(value, share);
#endif
}
#endif

#if DEFERRED
// The same of a neighbour's direction, weighed by how much denser the pixel draws it. The ratio is bounded, and the mean is
// divided by the sum of ratios: no hit counts more than MAX_RATIO times, no energy is lost, and where the bound is met the
// mean leans towards the directions that both draw.
fn mirrored_deferred(lobe: Lobe, other: Lobe, drawn: GlossyDirection, value: vec3f) -> vec4f {
  let light = (other.frame * drawn.light) * lobe.frame;
  if drawn.light.z <= 0.0 && light.z > 0.0 {
    // Below the neighbour's horizon it was not traced, but here something may arrive.
    return vec4f(0.0);
  }
  let facet = facet_of(lobe, light);
  let ratio = min(glossy_pdf(lobe, facet) / max(glossy_pdf(other, drawn.facet), 1e-30), MAX_RATIO);
  return mirrored(lobe, light, facet, value) * vec4f(1.0, 1.0, 1.0, ratio);
}
#endif
#endif

fn luminance(color: vec3f) -> f32 {
  return dot(color, vec3f(0.2126, 0.7152, 0.0722));
}

#if AVERAGE

// xyz the mean, w the variance of its luminance.
@compute @workgroup_size(8, 8)
fn average(@builtin(global_invocation_id) id: vec3u) {
  let pixel = id.xy;
  if any(vec2i(pixel) >= size()) {
    return;
  }
  let texel = textureLoad(receivers, pixel, 0);
  var mean = vec3f(0.0);
  var variance = 0.0;
  if texel.w != SKY {
    let normal = unpack_normal(texel.w);
    var sum = vec3f(0.0);
    var weights = 0.0;
    var squares = 0.0;
#if GLOSSY
    let lobe = lobe_of(pixel, texel);
#endif
    for (var i = 0u; i < directions(); i++) {
#if GLOSSY
      let drawn = glossy_direction(lobe, cell_point(pixel, i, params.columns, params.rows, params.frame));
      let seen = mirrored(lobe, drawn.light, drawn.facet, incoming(pixel, i));
      let weight = seen.w;
      let value = seen.xyz;
#else
      var weight = 1.0;
      if SAMPLING != SAMPLE_COSINE {
        let point = cell_point(pixel, i, params.columns, params.rows, params.frame);
        weight = share(normal, hemisphere_direction(point, normal, SAMPLING));
      }
      let value = incoming(pixel, i);
#endif
      sum += weight * value;
      weights += weight;
      squares += weight * luminance(value) * luminance(value);
    }
    let per_weight = 1.0 / max(weights, 1e-6);
    mean = sum * per_weight;
    let spread = max(squares * per_weight - luminance(mean) * luminance(mean), 0.0);
    // Directions are stratified, which halves it; few that agree may do so by chance, by half of one of them.
#if RADIANCE
    let whole = luminance(mean);
#else
    let whole = 1.0;
#endif
    let chance = 0.5 * whole / f32(directions());
    variance = 0.5 * spread / f32(directions()) + chance * chance;
  }
  textureStore(means, pixel, vec4f(mean, variance));
}

#else

#import screen

@fragment
fn reconstruct(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let corner = vec2i(params.camera.viewport.xy);
  let at = clamp(vec2i(fragment.xy) - corner, vec2i(0), size() - 1);
  let texel = textureLoad(receivers, at, 0);
  if texel.w == SKY {
#if RADIANCE
    return vec4f(0.0, 0.0, 0.0, 1.0);
#else
    return vec4f(1.0);
#endif
  }
  let position = receiver_position(texel);
  let normal = unpack_normal(texel.w);
  let own = textureLoad(means, at, 0);
  let pixel = footprint(params.camera, position - params.camera.eye);
  let per_tolerance = 1.0 / max(params.plane_distance * pixel, 1e-30);
#if GLOSSY
  let lobe = lobe_of(vec2u(at), texel);
#endif
  let radius = i32(params.radius);
  let low = max(at - radius, vec2i(0));
  let high = min(at + radius, size() - 1);
  var sum = vec3f(0.0);
  var weights = 0.0;
  for (var y = low.y; y <= high.y; y++) {
    for (var x = low.x; x <= high.x; x++) {
      let there = vec2i(x, y);
      let other = textureLoad(receivers, there, 0);
      if other.w == SKY {
        continue;
      }
      let other_normal = unpack_normal(other.w);
      let d = receiver_position(other) - position;
      let off_plane = max(abs(dot(normal, d)), abs(dot(other_normal, d))) * per_tolerance;
      let in_plane = max(1.0 - off_plane * off_plane, 0.0);
      let alike = max(1.0 - (params.normal_power / 8.0) * (1.0 - dot(normal, other_normal)), 0.0);
      let alike4 = alike * alike * alike * alike;
      var weight = in_plane * in_plane * alike4 * alike4;
      let theirs = textureLoad(means, there, 0);
      if params.deviations > 0.0 {
        let difference = luminance(theirs.xyz) - luminance(own.xyz);
        let allowed = params.deviations * params.deviations * (theirs.w + own.w) + 1e-30;
        weight *= exp(-difference * difference / allowed);
      }
#if GLOSSY
      let other_lobe = lobe_of(vec2u(there), other);
      weight *= lobe_overlap(lobe, other_lobe, parallax(d, pixel));
#endif
      if all(there == at) {
        weight = 1.0;
      }
#if DEFERRED
      if weight > 1e-3 {
        for (var i = 0u; i < directions(); i++) {
          let point = cell_point(vec2u(there), i, params.columns, params.rows, params.frame);
#if GLOSSY
          let drawn = glossy_direction(other_lobe, point);
          let value = incoming(vec2u(there), i);
          var seen = mirrored(lobe, drawn.light, drawn.facet, value);
          if any(there != at) {
            seen = mirrored_deferred(lobe, other_lobe, drawn, value);
          }
          sum += weight * seen.w * seen.xyz;
          weights += weight * seen.w;
#else
          let drawn = hemisphere_direction(point, other_normal, SAMPLING);
          // A direction near the neighbour's horizon may be far from this one's: its share is bounded.
          let own_share = weight * min(share(normal, drawn), 4.0);
          sum += own_share * incoming(vec2u(there), i);
          weights += own_share;
#endif
        }
      }
#else
      sum += weight * theirs.xyz;
      weights += weight;
#endif
    }
  }
  let mean = sum / max(weights, 1e-6);
#if RADIANCE
#if ALBEDO
  return vec4f(mean * decode_albedo(textureLoad(albedo_texture, corner + at, 0).xyz), 1.0);
#else
  return vec4f(mean, 1.0);
#endif
#else
  return vec4f(clamp(mean, vec3f(0.0), vec3f(1.0)), 1.0);
#endif
}

#endif

// HitResolver: from the hits of a bounced z-buffer to the caller's picture (The Bounced Z-buffer 3.3).
//
//   average       compute: each pixel's own mean over its directions, and how uncertain it is
//   near          compute: how near the hits of a pixel and of those beside it are
//   reconstruct   fragment: a plane fitted to what a window of pixels has, into the caller's texture
//
// A pixel's estimate is the mean of radiance (or openness) over directions, each weighed by the receiver's cosine over
// the density that it was drawn with. With #if DEFERRED the window gathers its neighbours' hits, direction by direction,
// weighed by the cosine of the *receiving* pixel, so that what its normal tells is not blurred; without, their means.
//
// What is seen from two points differs the more the farther they are apart, measured by how far away the things are that are
// seen: a neighbour counts by its distance in mean distances of hits (Ward, Rubinstein and Clear, A Ray Tracing Solution for
// Diffuse Interreflection, 1988). What then still changes over the window mostly changes steadily: the picture is the value
// at the pixel of the plane that fits the window best, by least squares of the weights, over the pixel's tangent plane.
//
// With #if GLOSSY a receiver mirrors radiance by its lobe (wgsl/common/ggx.wgsl), and a neighbour counts as far as its lobe
// overlaps the pixel's.
//
// With #if BENT the picture is the mean of the directions in which nothing is hit, and the share of them. What is gathered is by
// how much that mean leans off the one of all the pixel's directions, which is known to be along its normal.
//
// With #if EMITTERS pixels had EMITTER_SAMPLES rays towards emitters besides: the mean is the sum of both kinds' means.
//
// With #if COUNTED pixels have different numbers of rays, and those that have none take their light from the others. A pixel
// counts alike whatever its number: that follows from what its neighbours' rays brought, and weights that did too would
// give a bias.

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
  variance_clamp: f32,
  // Reflectance of glossy receivers seen straight on.
  f0: vec3f,
  // Half width of the window over which distances of hits are averaged.
  near_radius: u32,
  // Of the square of a neighbour's distance in pixels: -falloff is the exponent of its weight.
  falloff: f32,
  // Over the mean distance of hits: its square, and that of a neighbour's distance, in the same way.
  per_hit_distance: f32,
  // Added to the variance of the plane's coordinates.
  damping: f32,
  // Their unit, in pixels.
  spread: f32,
  // By which power of the number of frames the window narrows, and of how many frames it was chosen.
  narrowing: f32,
  per_frames: f32,
}

override SAMPLING: u32 = 0u;
#if EMITTERS
override EMITTER_SAMPLES: u32 = 1u;
#endif

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
#if NEAR
// Of the bounced z-buffer (wgsl/bounced_z_buffer.wgsl), and the mean of 1 / distance.
@group(0) @binding(6) var<storage, read> nearness: array<u32>;
@group(0) @binding(7) var inverse_distances: texture_storage_2d<r32float, write>;
#else
@group(0) @binding(7) var inverse_distances: texture_2d<f32>;
@group(0) @binding(3) var means: texture_2d<f32>;
#if JOINED
// Of the temporal accumulator: the mean over frames, and in the last component how many they are.
@group(0) @binding(9) var joined: texture_2d<f32>;
#endif
#if ALBEDO
#import albedo
@group(0) @binding(4) var albedo_texture: texture_2d<f32>;
#endif
#endif
#endif
#if GLOSSY
@group(0) @binding(5) var roughness_texture: texture_2d<f32>;
#endif
#if RAYS
// Of each pixel, rows from the top (wgsl/bounced_z_buffer.wgsl).
struct PixelRays {
#if RADIANCE
  sum: vec3f,
#else
  blocked: u32,
#endif
  rays: u32,
#if RADIANCE && GLOSSY
  grazing: vec3f,
#endif
}
@group(0) @binding(8) var<storage, read> counts: array<PixelRays>;
#endif

fn size() -> vec2i {
  return vec2i(params.camera.viewport.zw);
}

fn rays_per_pixel() -> u32 {
  return params.columns * params.rows;
}

#if RAYS
fn rays_at(at: vec2i) -> u32 {
  return counts[at.y * size().x + at.x].rays;
}
#endif

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

#if EMITTERS
// The sum of what came along rays towards emitters, and in w of its luminance's squares.
fn shone_at(pixel: vec2u) -> vec4f {
  var sum = vec4f(0.0);
  for (var i = 0u; i < EMITTER_SAMPLES; i++) {
#if GLOSSY
    let layer = rays_per_pixel() + 2u * i;
    let value = params.f0 * incoming(pixel, layer) + incoming(pixel, layer + 1u);
#else
    let value = incoming(pixel, rays_per_pixel() + i);
#endif
    sum += vec4f(value, luminance(value) * luminance(value));
  }
  return sum;
}
#endif

#if BENT
// xyz by how much the mean of the open directions leans, w the share of them.
fn lean(pixel: vec2u, normal: vec3f) -> vec4f {
  var open = vec4f(0.0);
  var all = vec3f(0.0);
  for (var i = 0u; i < rays_per_pixel(); i++) {
    let point = cell_point(pixel, i, params.columns, params.rows, params.frame);
    let direction = hemisphere_direction(point, normal, SAMPLE_COSINE).direction;
    open += incoming(pixel, i).x * vec4f(direction, 1.0);
    all += direction;
  }
  let per_ray = 1.0 / f32(rays_per_pixel());
  let openness = open.w * per_ray;
  return vec4f((open.xyz - openness * all) * per_ray, openness);
}
#endif

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

// What a hit within a pixel's side adds to its nearness (wgsl/bounced_z_buffer.wgsl).
const NEAREST: f32 = 16777216.0;

// Beyond this, noise is not told apart: squares of what is brighter, and their sums, would leave the range of f32.
const MOST_LUMINANCE: f32 = 1e16;

fn luminance(color: vec3f) -> f32 {
  return min(dot(color, vec3f(0.2126, 0.7152, 0.0722)), MOST_LUMINANCE);
}

#if AVERAGE

// xyz the mean, w the variance of its luminance; with #if COUNTED this is negative where there are no rays.
@compute @workgroup_size(8, 8)
fn average(@builtin(global_invocation_id) id: vec3u) {
  let pixel = id.xy;
  if any(vec2i(pixel) >= size()) {
    return;
  }
  let texel = textureLoad(receivers, pixel, 0);
#if BENT
  var leaning = vec4f(0.0);
  if texel.w != SKY {
    leaning = lean(pixel, unpack_normal(texel.w));
  }
  textureStore(means, pixel, leaning);
#else
  var mean = vec3f(0.0);
  var variance = 0.0;
#if RAYS
  let has_rays = texel.w != SKY && rays_at(vec2i(pixel)) > 0u;
  variance = -1.0;
#else
  let has_rays = texel.w != SKY;
#endif
  if has_rays {
    let normal = unpack_normal(texel.w);
    var sum = vec3f(0.0);
    var weights = 0.0;
    var squares = 0.0;
#if GLOSSY
    let lobe = lobe_of(pixel, texel);
#endif
    for (var i = 0u; i < rays_per_pixel(); i++) {
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
    var spread = max(squares * per_weight - luminance(mean) * luminance(mean), 0.0);
    var rays = f32(rays_per_pixel());
#if EMITTERS
    let samples = f32(EMITTER_SAMPLES);
    let shone = shone_at(pixel);
    let shone_mean = shone.xyz / samples;
    mean += shone_mean;
    sum += shone_mean * rays;
    // The variance of the mean of rays towards emitters, in units of one ray of the pixel's own.
    spread += max(shone.w / samples - luminance(shone_mean) * luminance(shone_mean), 0.0) * rays / samples;
#endif
    var apart = 0.0;
#if RAYS
    // Of rays beyond the first set the sums are known; what they spread is taken to be the same, but what the first set did not
    // meet at all it does not tell: how far the two means are apart does.
    let own = counts[pixel.y * params.camera.viewport.z + pixel.x];
    if own.rays > rays_per_pixel() {
#if RADIANCE
#if GLOSSY
      sum += params.f0 * own.sum + own.grazing;
#else
      sum += own.sum;
#endif
#else
      sum += vec3f(f32(own.rays - rays_per_pixel() - own.blocked));
#endif
      let first = luminance(mean);
      rays = f32(own.rays);
      mean = sum / rays;
      let off = luminance(mean) - first;
      apart = off * off * f32(rays_per_pixel()) / (rays - f32(rays_per_pixel()));
    }
#endif
    // Directions are stratified, which halves it; few that agree may do so by chance, by half of one of them.
#if RADIANCE
    let whole = luminance(mean);
#else
    let whole = 1.0;
#endif
    let chance = 0.5 * whole / rays;
    variance = 0.5 * max(spread / rays, apart) + chance * chance;
#if EMITTERS
    // Few rays towards emitters that agree may do so by chance, too.
    let aimed = 0.5 * luminance(shone_mean) * f32(rays_per_pixel()) / (samples * rays);
    variance += aimed * aimed;
#endif
  }
  textureStore(means, pixel, vec4f(mean, variance));
#endif
}

#else

#import kinship

#if NEAR

// Of one pixel too few hits tell how far they are.
@compute @workgroup_size(8, 8)
fn near(@builtin(global_invocation_id) id: vec3u) {
  let at = vec2i(id.xy);
  if any(at >= size()) {
    return;
  }
  let texel = textureLoad(receivers, at, 0);
  var mean = 0.0;
  if texel.w != SKY {
    let position = receiver_position(texel);
    let normal = unpack_normal(texel.w);
    let per_tolerance = per_tolerance_at(footprint(params.camera, position - params.camera.eye));
    let low = max(at - i32(params.near_radius), vec2i(0));
    let high = min(at + i32(params.near_radius), size() - 1);
    var sum = 0.0;
    var weights = 0.0;
    for (var y = low.y; y <= high.y; y++) {
      for (var x = low.x; x <= high.x; x++) {
        let other = textureLoad(receivers, vec2i(x, y), 0);
        if other.w == SKY {
          continue;
        }
        var rays = f32(rays_per_pixel());
#if RAYS
        rays = f32(rays_at(vec2i(x, y)));
        if rays == 0.0 {
          continue;
        }
#endif
        let there = receiver_position(other);
        var weight = kinship(normal, unpack_normal(other.w), there - position, per_tolerance);
        if x == at.x && y == at.y {
          weight = 1.0;
        }
        let side = footprint(params.camera, there - params.camera.eye);
        let units = rays * NEAREST * max(side, 1e-30);
        sum += weight * f32(nearness[y * size().x + x]) / units;
        weights += weight;
      }
    }
#if RAYS
    weights = max(weights, 1e-30);
#endif
    mean = sum / weights;
  }
  textureStore(inverse_distances, at, vec4f(mean));
}

#else

#import screen

// What a window holds: radiance, or openness.
#if BENT
alias Value = vec4f;
#else
#if RADIANCE
alias Value = vec3f;
#else
alias Value = f32;
#endif
#endif

#if GLOSSY
// More than any exponent needs (src/hit_resolver/params.rs).
const STEEP: f32 = 1e9;
#endif
// Neighbours are not taken to be farther away than so many units: what is beyond is seen at too grazing an angle to tell slopes.
const FARTHEST: f32 = 1000.0;

// A pixel's mean, of this frame or of all, and its variance; negative where there are no rays.
fn mean_at(at: vec2i) -> vec4f {
  let own = textureLoad(means, at, 0);
#if JOINED
  let over_frames = textureLoad(joined, at, 0);
#if RADIANCE
  return vec4f(over_frames.xyz, own.w / max(over_frames.w, 1.0));
#else
  return vec4f(over_frames.xxx, own.w / max(over_frames.y, 1.0));
#endif
#else
  return own;
#endif
}

// By how much the window about a pixel is narrower than for one frame's rays.
fn narrowed_at(at: vec2i) -> f32 {
#if JOINED
#if RADIANCE
  let frames = textureLoad(joined, at, 0).w;
#else
  let frames = textureLoad(joined, at, 0).y;
#endif
  return pow(max(frames * params.per_frames, 1.0), params.narrowing);
#else
  return 1.0;
#endif
}

fn value_of(mean: vec4f) -> Value {
#if BENT
  return mean;
#else
#if RADIANCE
  return mean.xyz;
#else
  return mean.x;
#endif
#endif
}

#if BENT
// The length of the mean of all directions, by their cosine.
const OPEN_MEAN: f32 = 2.0 / 3.0;

// As that of means of hits, of the share of open ones.
fn openness_variance(openness: f32) -> f32 {
  let rays = f32(rays_per_pixel());
  let chance = 0.5 / rays;
  return 0.5 * openness * (1.0 - openness) / rays + chance * chance;
}

fn bent(normal: vec3f, value: Value) -> vec4f {
  let openness = clamp(value.w, 0.0, 1.0);
  return vec4f(normalize_or(value.xyz + OPEN_MEAN * openness * normal, normal), openness);
}
#else
// What the picture has of a window's value.
fn shown(pixel: vec2i, value: Value) -> vec4f {
#if RADIANCE
  // A plane may fall below what there is.
  let color = max(value, vec3f(0.0));
#if ALBEDO
  return vec4f(color * decode_albedo(textureLoad(albedo_texture, pixel, 0).xyz), 1.0);
#else
  return vec4f(color, 1.0);
#endif
#else
  return vec4f(vec3f(clamp(value, 0.0, 1.0)), 1.0);
#endif
}
#endif

#if COUNTED
// Where no pixel in sight has rays nothing is known: open, and dark.
#if RADIANCE
const OPEN: vec3f = vec3f(0.0);
#else
const OPEN: f32 = 1.0;
#endif
// The least sum of neighbours' weights that a plane is fitted to.
const LEAST_KIN: f32 = 1e-3;
#endif

@fragment
fn reconstruct(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  return held(resolved(fragment));
}

fn resolved(fragment: vec4f) -> vec4f {
  let corner = vec2i(params.camera.viewport.xy);
  let at = clamp(vec2i(fragment.xy) - corner, vec2i(0), size() - 1);
  let texel = textureLoad(receivers, at, 0);
  if texel.w == SKY {
#if RADIANCE
    return vec4f(0.0, 0.0, 0.0, 1.0);
#else
#if BENT
    return vec4f(0.0, 0.0, 0.0, 1.0);
#else
    return vec4f(1.0);
#endif
#endif
  }
  let position = receiver_position(texel);
  let normal = unpack_normal(texel.w);
  let frame = tangent_frame(normal);
  let own = mean_at(at);
  let own_value = value_of(own);
  let pixel = footprint(params.camera, position - params.camera.eye);
  let per_tolerance = per_tolerance_at(pixel);
  let narrowed = narrowed_at(at);
  let falloff = params.falloff * narrowed * narrowed;
  let per_spread = narrowed / max(params.spread * pixel, 1e-30);
  let inverse_distance = textureLoad(inverse_distances, at, 0).x;
#if GLOSSY
  let lobe = lobe_of(vec2u(at), texel);
  // The narrower a lobe is, the finer is what it shows of the same hits: by its roughness. By its width small lamps would be
  // noisier.
  let per_hit_distance = min(params.per_hit_distance / sqrt(lobe.alpha), STEEP);
#else
  let per_hit_distance = params.per_hit_distance;
#endif
  let radius = i32(ceil(f32(params.radius) / narrowed));
  let low = max(at - radius, vec2i(0));
  let high = min(at + radius, size() - 1);
  // Sums of weights, and of these times coordinates in the tangent plane, and times their products. And of values, as off the
  // pixel's own: where all are the same nothing is rounded.
  var weights = 0.0;
  var moments = vec2f(0.0);
  var squares = vec3f(0.0);
  var sum = value_of(vec4f(0.0));
  var sum_u = sum;
  var sum_v = sum;
#if COUNTED
  // For a pixel without rays that no neighbour with rays is kin to.
  var near_sum = sum;
  var near_weights = 0.0;
#endif
  for (var y = low.y; y <= high.y; y++) {
    for (var x = low.x; x <= high.x; x++) {
      let there = vec2i(x, y);
      let other = textureLoad(receivers, there, 0);
      if other.w == SKY {
        continue;
      }
#if COUNTED
      if textureLoad(means, there, 0).w < 0.0 {
        continue;
      }
      if own.w < 0.0 {
        let near = exp(-dot(vec2f(there - at), vec2f(there - at)) * falloff);
        near_sum += near * value_of(mean_at(there));
        near_weights += near;
      }
#endif
      let other_normal = unpack_normal(other.w);
      let d = receiver_position(other) - position;
      var weight = kinship(normal, other_normal, d, per_tolerance);
      if weight == 0.0 && any(there != at) {
        continue;
      }
      let theirs = mean_at(there);
      let aside = vec2f(there - at);
      let hits_aside = length(d) * max(inverse_distance, textureLoad(inverse_distances, there, 0).x) * per_hit_distance;
      var distance = dot(aside, aside) * falloff + hits_aside * hits_aside;
#if BENT
      if params.variance_clamp > 0.0 {
        let differences = theirs - own;
        let variance = openness_variance(theirs.w) + openness_variance(own.w);
        distance += dot(differences, differences) / (params.variance_clamp * params.variance_clamp * variance + 1e-30);
      }
#else
      if params.variance_clamp > 0.0 && own.w >= 0.0 {
        let difference = luminance(theirs.xyz) - luminance(own.xyz);
        let allowed = params.variance_clamp * params.variance_clamp * (theirs.w + own.w) + 1e-30;
        distance += difference * difference / allowed;
      }
#endif
      weight *= exp(-distance);
#if GLOSSY
      let other_lobe = lobe_of(vec2u(there), other);
      weight *= lobe_overlap(lobe, other_lobe, parallax(d, pixel));
#endif
      if all(there == at) {
        weight = 1.0;
      }
      if weight == 0.0 {
        continue;
      }
#if DEFERRED
      // Hits in place of means, with the sum of their shares for a weight.
      var seen_there = vec3f(0.0);
      var shares = 0.0;
      if weight > 1e-3 {
        for (var i = 0u; i < rays_per_pixel(); i++) {
          let point = cell_point(vec2u(there), i, params.columns, params.rows, params.frame);
#if GLOSSY
          let drawn = glossy_direction(other_lobe, point);
          let value = incoming(vec2u(there), i);
          var seen = mirrored(lobe, drawn.light, drawn.facet, value);
          if any(there != at) {
            seen = mirrored_deferred(lobe, other_lobe, drawn, value);
          }
          seen_there += weight * seen.w * seen.xyz;
          shares += weight * seen.w;
#else
          let drawn = hemisphere_direction(point, other_normal, SAMPLING);
          // A direction near the neighbour's horizon may be far from this one's: its share is bounded.
          let own_share = weight * min(share(normal, drawn), 4.0);
          seen_there += own_share * incoming(vec2u(there), i);
          shares += own_share;
#endif
        }
      }
      weight = shares;
      let weighted = value_of(vec4f(seen_there, 0.0)) - weight * own_value;
#else
      let weighted = weight * (value_of(theirs) - own_value);
#endif
      let place = clamp((d * frame).xy * per_spread, vec2f(-FARTHEST), vec2f(FARTHEST));
      weights += weight;
      moments += weight * place;
      squares += weight * vec3f(place * place, place.x * place.y);
      sum += weighted;
      sum_u += weighted * place.x;
      sum_v += weighted * place.y;
    }
  }
#if COUNTED
  if own.w < 0.0 && weights < LEAST_KIN {
    return shown(corner + at, select(OPEN, near_sum / max(near_weights, 1e-30), near_weights > 0.0));
  }
#endif
  // The plane through the window's mean at the middle of its weights, and its value at the pixel.
  let per_weight = 1.0 / max(weights, 1e-6);
  let average = sum * per_weight;
  let middle = moments * per_weight;
  let spread = squares * per_weight - vec3f(middle * middle, middle.x * middle.y);
  let uu = spread.x + params.damping;
  let vv = spread.y + params.damping;
  let uv = spread.z;
  let along_u = sum_u * per_weight - average * middle.x;
  let along_v = sum_v * per_weight - average * middle.y;
  let per_determinant = 1.0 / max(uu * vv - uv * uv, 1e-30);
  let slope_u = (vv * along_u - uv * along_v) * per_determinant;
  let slope_v = (uu * along_v - uv * along_u) * per_determinant;
  let value = own_value + average - slope_u * middle.x - slope_v * middle.y;
#if BENT
  return bent(normal, value);
#else
  return shown(corner + at, value);
#endif
}

#endif
#endif

// RayBudget: which pixels have further rays, and how many sets of them.
//
//   pool      one thread per cell of 4 x 4 pixels: the variance of their rays
//   measure   one thread per pixel: how much noise one more ray there would take from the picture; pixels by it are counted
//   choose    one workgroup: what that is multiplied by to give numbers of sets that make up the budget
//   list      one thread per pixel: those that get any
//   plan      one thread: how many workgroups they take
//
// The picture's squared error is the sum over pixels of the variance of their rays, over their number, times what the
// filter leaves of it. The least for so many rays in all is where each pixel's number is in proportion to the root of variance
// times share (Neyman 1934). The variance is that of the surroundings, without the pixel's own rays: what they happen to bring
// must not decide how many there are, or the mean would be off. Nor may it be that of few neighbours: directions of adjacent
// pixels lie between each other (wgsl/common/directions.wgsl), so that what one meets the other one is less likely to.
//
// With #if GLOSSY receivers reflect more the more aslant they are seen, and narrow ones have few neighbours that are seen alike:
// the surroundings tell the variance of what arrives, and the pixel's own reflectance how much of it is seen.

#import math
#import packing
#import hashing
#import dispatch
#import camera
#import receiver
#if GLOSSY
#import ggx
#endif

struct Params {
  camera: Camera,
  // As the filter has them (wgsl/hit_resolver.wgsl).
  plane_distance: f32,
  normal_power: f32,
  falloff: f32,
  per_hit_distance: f32,
  // Of all weights of the filter's window, the share of a pixel's own where nothing tells neighbours apart.
  least_share: f32,
  // Sets per pixel, on average, and of one pixel at most.
  sets: f32,
  most_sets: f32,
  frame: u32,
  // Luminance of glossy receivers' reflectance straight on.
  f0: f32,
  padding0: u32,
  padding1: u32,
  padding2: u32,
}

// Pixels are counted by the need's exponent and first two digits.
const BINS: u32 = 256u;
// That of 2^-40.
const FIRST_BIN: u32 = 87u << 2u;

struct State {
  counts: array<atomic<u32>, 256>,
  // That are not of the sky.
  pixels: atomic<u32>,
  // That have sets.
  listed: atomic<u32>,
  // Sets per unit of need.
  scale: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var receivers: texture_2d<u32>;
// Of the hit resolver: in w the variance of a pixel's mean, negative where it has no rays; and the mean of 1 / distance.
@group(0) @binding(2) var means: texture_2d<f32>;
@group(0) @binding(3) var inverse_distances: texture_2d<f32>;
@group(0) @binding(4) var<storage, read_write> needs: array<f32>;
@group(0) @binding(5) var<storage, read_write> state: State;
// In x how many pixels; then of each one x | y << 16, and how many sets.
@group(0) @binding(6) var<storage, read_write> work: array<vec2u>;
@group(0) @binding(7) var<storage, read_write> dispatches: array<u32, 3>;
// Of each cell: the sum of its pixels' variances, and how many there are.
@group(0) @binding(8) var<storage, read_write> cells: array<vec2f>;
#if GLOSSY
@group(0) @binding(9) var roughness_texture: texture_2d<f32>;
#endif

#import kinship

// Half width of the window that tells how many neighbours share their rays with a pixel.
const RADIUS: i32 = 2;
const NEIGHBOURS: f32 = 24.0;
// Side of a cell in pixels, and half width in cells of the surroundings.
const CELL: i32 = 4;
const CELLS: i32 = 2;
// Beyond which all are alike.
const MOST_NEED: f32 = 1e12;
#if GLOSSY
const LEAST_REFLECTANCE: f32 = 1e-3;
#endif

fn size() -> vec2i {
  return vec2i(params.camera.viewport.zw);
}

fn place_of(pixel: vec2i) -> u32 {
  return u32(pixel.y * size().x + pixel.x);
}

fn columns() -> i32 {
  return (size().x + CELL - 1) / CELL;
}

fn rows() -> i32 {
  return (size().y + CELL - 1) / CELL;
}

// What a pixel makes of what arrives.
fn reflectance_at(at: vec2i, texel: vec4u) -> f32 {
#if GLOSSY
  let relative = receiver_position(texel) - params.camera.eye;
  let cosine = clamp(dot(unpack_normal(texel.w), to_camera(params.camera, relative)), 0.0, 1.0);
  let corner = vec2i(params.camera.viewport.xy);
  let shares = even_shares(cosine, clean_roughness(textureLoad(roughness_texture, corner + at, 0).x));
  return max(params.f0 * shares.x + shares.y, LEAST_REFLECTANCE);
#else
  return 1.0;
#endif
}

// The variance of what arrives along a pixel's own rays, and 1; or nothing where there are none.
fn variance_at(at: vec2i) -> vec2f {
  let variance = textureLoad(means, at, 0).w;
  let texel = textureLoad(receivers, at, 0);
  if variance < 0.0 || texel.w == SKY {
    return vec2f(0.0);
  }
  let reflectance = reflectance_at(at, texel);
  return vec2f(min(variance / (reflectance * reflectance), MOST_NEED * MOST_NEED), 1.0);
}

@compute @workgroup_size(8, 8)
fn pool(@builtin(global_invocation_id) id: vec3u) {
  let cell = vec2i(id.xy);
  if cell.x >= columns() || cell.y >= rows() {
    return;
  }
  let first = cell * CELL;
  let end = min(first + CELL, size());
  var sum = vec2f(0.0);
  for (var y = first.y; y < end.y; y++) {
    for (var x = first.x; x < end.x; x++) {
      sum += variance_at(vec2i(x, y));
    }
  }
  cells[cell.y * columns() + cell.x] = sum;
}

// Of the surroundings without the pixel itself.
fn variance_around(at: vec2i) -> f32 {
  let cell = at / CELL;
  let low = max(cell - CELLS, vec2i(0));
  let high = min(cell + CELLS, vec2i(columns(), rows()) - 1);
  var sum = -variance_at(at);
  for (var y = low.y; y <= high.y; y++) {
    for (var x = low.x; x <= high.x; x++) {
      sum += cells[y * columns() + x];
    }
  }
  return max(sum.x, 0.0) / max(sum.y, 1.0);
}

// How many neighbours are kin to a pixel.
fn kin_of(at: vec2i, texel: vec4u, side: f32) -> f32 {
  let position = receiver_position(texel);
  let normal = unpack_normal(texel.w);
  let per_tolerance = per_tolerance_at(side);
  let low = max(at - RADIUS, vec2i(0));
  let high = min(at + RADIUS, size() - 1);
  var kin = 0.0;
  for (var y = low.y; y <= high.y; y++) {
    for (var x = low.x; x <= high.x; x++) {
      let other = textureLoad(receivers, vec2i(x, y), 0);
      if other.w != SKY {
        let d = receiver_position(other) - position;
        kin += kinship(normal, unpack_normal(other.w), d, per_tolerance);
      }
    }
  }
  return kin;
}

// The root of the variance of rays, times the share of it that the filter leaves.
fn need_at(at: vec2i, texel: vec4u) -> f32 {
  if textureLoad(means, at, 0).w < 0.0 {
    return 0.0;
  }
  let side = footprint(params.camera, receiver_position(texel) - params.camera.eye);
  let hits_aside = side * textureLoad(inverse_distances, at, 0).x * params.per_hit_distance;
  // Of a Gaussian of weights the sum of squares is so much of the square of the sum; fewer neighbours share as much among them.
  let steep = params.falloff + hits_aside * hits_aside;
  let share = max(steep / (2.0 * PI), params.least_share) * NEIGHBOURS / max(kin_of(at, texel, side), 1.0);
  return reflectance_at(at, texel) * sqrt(variance_around(at) * min(share, 1.0));
}

fn bin_of(need: f32) -> u32 {
  return min(max(bitcast<u32>(need) >> 21u, FIRST_BIN) - FIRST_BIN, BINS - 1u);
}

// In the middle of a bin.
fn need_of(bin: u32) -> f32 {
  return bitcast<f32>(((bin + FIRST_BIN) << 21u) | (1u << 20u));
}

var<workgroup> counts: array<atomic<u32>, 256>;
var<workgroup> pixels: atomic<u32>;

@compute @workgroup_size(8, 8)
fn measure(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) thread: u32) {
  for (var bin = thread; bin < BINS; bin += 64u) {
    atomicStore(&counts[bin], 0u);
  }
  if thread == 0u {
    atomicStore(&pixels, 0u);
  }
  workgroupBarrier();
  let at = vec2i(id.xy);
  if all(at < size()) {
    let texel = textureLoad(receivers, at, 0);
    var need = 0.0;
    if texel.w != SKY {
      need = need_at(at, texel);
      atomicAdd(&pixels, 1u);
      if need > 0.0 {
        atomicAdd(&counts[bin_of(need)], 1u);
      }
    }
    needs[place_of(at)] = need;
  }
  workgroupBarrier();
  for (var bin = thread; bin < BINS; bin += 64u) {
    let count = atomicLoad(&counts[bin]);
    if count > 0u {
      atomicAdd(&state.counts[bin], count);
    }
  }
  if thread == 0u {
    atomicAdd(&state.pixels, atomicLoad(&pixels));
  }
}

var<workgroup> bins: array<f32, 256>;
var<workgroup> best: atomic<u32>;

// How many sets a scale comes to.
fn sets_of(scale: f32) -> f32 {
  var sum = 0.0;
  for (var bin = 0u; bin < BINS; bin++) {
    sum += bins[bin] * min(need_of(bin) * scale, params.most_sets);
  }
  return sum;
}

// Scales are powers of two from 2^-40 on to 2^88: a set for all of the least needs is among them, and next to none for the
// largest.
const LEAST_SCALE: f32 = -40.0;
const COARSE_STEP: f32 = 0.5;

@compute @workgroup_size(256)
fn choose(@builtin(local_invocation_index) thread: u32) {
  bins[thread] = f32(atomicLoad(&state.counts[thread]));
  if thread == 0u {
    atomicStore(&best, 0u);
  }
  workgroupBarrier();
  let budget = params.sets * f32(atomicLoad(&state.pixels));
  if sets_of(exp2(LEAST_SCALE + COARSE_STEP * f32(thread))) <= budget {
    atomicMax(&best, thread);
  }
  workgroupBarrier();
  let coarse = LEAST_SCALE + COARSE_STEP * f32(atomicLoad(&best));
  workgroupBarrier();
  if thread == 0u {
    atomicStore(&best, 0u);
  }
  workgroupBarrier();
  if sets_of(exp2(coarse + COARSE_STEP / f32(BINS) * f32(thread))) <= budget {
    atomicMax(&best, thread);
  }
  workgroupBarrier();
  if thread == 0u {
    state.scale = exp2(coarse + COARSE_STEP / f32(BINS) * f32(atomicLoad(&best)));
  }
}

var<workgroup> listed: atomic<u32>;
var<workgroup> first: u32;

@compute @workgroup_size(8, 8)
fn list(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) thread: u32) {
  if thread == 0u {
    atomicStore(&listed, 0u);
  }
  workgroupBarrier();
  let at = vec2i(id.xy);
  var sets = 0u;
  var rank = 0u;
  if all(at < size()) {
    let need = needs[place_of(at)];
    if need > 0.0 {
      // A part of a set is a chance of one.
      let chance = unit_float(hash2(place_of(at), params.frame));
      sets = u32(min(need * state.scale, params.most_sets) + chance);
      sets = min(sets, u32(params.most_sets));
    }
    if sets > 0u {
      rank = atomicAdd(&listed, 1u);
    }
  }
  workgroupBarrier();
  if thread == 0u {
    first = atomicAdd(&state.listed, atomicLoad(&listed));
  }
  workgroupBarrier();
  // In any order: what one pixel gets does not depend on the others' places.
  if sets > 0u {
    work[1u + first + rank] = vec2u(id.x | (id.y << 16u), sets);
  }
}

@compute @workgroup_size(1)
fn plan() {
  let count = atomicLoad(&state.listed);
  let workgroups = (count + 63u) / 64u;
  work[0] = vec2u(count, 0u);
  dispatches[0] = min(workgroups, DISPATCH_ROW);
  dispatches[1] = (workgroups + DISPATCH_ROW - 1u) / DISPATCH_ROW;
  dispatches[2] = 1u;
}

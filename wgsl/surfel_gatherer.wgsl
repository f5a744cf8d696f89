// SurfelGatherer: a further bounce of light, which surfels gather as pixels do (The Bounced Z-buffer 3): along rays, of what the
// surfels that these meet send.
//
//   gather   one thread per surfel: what each side reflects of the light that it gathers
//   add      one thread per surfel: adds what another buffer holds
//
// Rays start from parts of the surfel's own triangle, so that it is the mean over the surfel that is found, and are distributed
// by the cosine to its normal. Surfaces are Lambertian and two-sided: what a side reflects is its albedo times the mean of what
// its rays bring.
//
// The cloud that rays meet may be another than that of the surfels: the one of the frame before, with the light of then.
//
// With #if EMITTERS each side has rays besides, towards pieces that shine of themselves; what these shine, which is a part of
// what their surfels send, is weighed by multiple importance sampling, along either kind of rays.
//
// With #if RAY_QUERY the device itself traverses, a structure of its own; with #if ALPHA_TESTED triangles may have holes.

#if RAY_QUERY
enable wgpu_ray_query;
#endif

#import math
#import packing
#import hashing
#import dispatch
#import surfel
#import material
#import slots
#import triangle
#import directions
#if EMITTERS
#import emitters
#endif

alias Counter = u32;

struct Params {
  // Rays of each side, one in each cell of a grid.
  columns: u32,
  rows: u32,
  frame: u32,
  // Not 0: backs gather too.
  backs: u32,
  // Radiance where nothing is hit.
  sky_radiance: vec3f,
  // Surfaces reflect no more than this share.
  most_albedo: f32,
  // From the surfels' space to that of the cloud that rays meet.
  shift: vec3f,
  // Of the cloud that rays meet.
  surfel_capacity: u32,
  piece_capacity: u32,
  // Rays of each side towards emitters.
  emitter_samples: u32,
  padding0: u32,
  padding1: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
// The surfels.
@group(0) @binding(1) var<storage, read> counters: Counters;
@group(0) @binding(2) var<storage, read> sources: array<SurfelSource>;
@group(0) @binding(3) var<storage, read> own_pieces: array<Piece>;
@group(0) @binding(4) var<storage, read> materials: array<Material>;
@group(0) @binding(5) var<storage, read_write> radiance: array<SurfelRadiance>;
// What rays meet: pieces, the first surfel of each, and after the last one how many there are; and what these send.
#if RAY_QUERY
@group(0) @binding(6) var scene: acceleration_structure;
#else
@group(0) @binding(6) var nodes: texture_2d<u32>;
@group(0) @binding(7) var triangles: texture_2d<u32>;
#endif
#if ALPHA_TESTED
@group(0) @binding(12) var alpha_maps: texture_2d_array<f32>;
#endif
@group(0) @binding(8) var<storage, read> pieces: array<Piece>;
@group(0) @binding(9) var<storage, read> surfel_offsets: array<u32>;
@group(0) @binding(10) var<storage, read> sent: array<SurfelRadiance>;
#if EMITTERS
@group(0) @binding(13) var emitters: texture_2d<u32>;
#endif
// What is added.
@group(0) @binding(11) var<storage, read> added: array<SurfelRadiance>;

#if RAY_QUERY
#import ray_query_traverse
#else
#import bvh_traverse
#endif

// A surfel's triangle is bisected so often, for its rays to start from 2^4 parts in turn.
const SPLITS: u32 = 4u;
const PARTS: u32 = 16u;
// From part to part: neighbouring directions start far apart.
const PART_STEP: u32 = 5u;

// What comes along a ray that was drawn by the cosine to `side`.
fn incoming(ray: Ray, hit: Hit, side: vec3f) -> vec3f {
  if hit.primitive == MISS {
    return params.sky_radiance;
  }
  let piece = pieces[hit.primitive];
  let t = Triangle(piece.a, piece.b, piece.c);
  let leaf = leaf_at(t, ray.origin + ray.direction * hit.t, piece.shape & SHAPE_ORDER);
  let total = surfel_offsets[params.piece_capacity];
  let surfel = nearest_room(surfel_offsets[hit.primitive] + leaf, total, params.surfel_capacity);
  let facing = dot(cross(t.b - t.a, t.c - t.a), ray.direction) < 0.0;
  let all = sanitize(select(sent[surfel].back, sent[surfel].front, facing));
#if EMITTERS
  let own = own_along(hit.primitive, ray.direction);
  if any(own > vec3f(0.0)) {
    let share = emitter_share(hit.primitive);
    let aimed = aimed_pdf(params.emitter_samples, hit.primitive, share, ray.direction, hit.t);
    let by_chance = f32(params.columns * params.rows) * max(dot(side, ray.direction), 0.0) / PI;
    return max(all - (1.0 - chance_share(by_chance, aimed)) * own, vec3f(0.0));
  }
#endif
  return all;
}

// Where ray k of a side starts, from one of the parts of the surfel's triangle in turn.
fn start_of(leaf: Triangle, turn: u32, k: u32, side: vec3f) -> vec3f {
  let part = (turn + PART_STEP * k) % PARTS;
  let own = centroid(leaf_of(leaf, part, SPLITS));
  let place = own + params.shift;
  return place + side * max(ray_epsilon(own), ray_epsilon(place));
}

#if EMITTERS
// What rays towards emitters bring of the mean below.
fn shone(i: u32, which: u32, leaf: Triangle, side: vec3f) -> vec3f {
  let turn = hash2(i, which);
  var sum = vec3f(0.0);
  for (var k = 0u; k < params.emitter_samples; k++) {
    // As few as they are, they start from other parts in each frame: an odd number further.
    let origin = start_of(leaf, turn, k + params.frame * (params.emitter_samples | 1u), side);
    let drawn = emitter_sample(vec2u(i, which), k, params.emitter_samples, 0u, params.frame);
    let direction = normalize_or(drawn.point - origin, vec3f(0.0));
    let distance = dot(drawn.point - origin, direction);
    let value = max(dot(side, direction), 0.0) / PI;
    if drawn.share > 0.0 && value > 0.0 {
      let met = aim(make_ray(origin, direction), drawn, distance, FAR);
      if met != MISS {
        let aimed = aimed_pdf(params.emitter_samples, drawn.piece, drawn.share, direction, distance);
        let density = f32(params.columns * params.rows) * value + aimed;
        sum += own_along(met, direction) * (value / max(density, 1e-30));
      }
    }
  }
  return sum;
}
#endif

// The mean of what reaches a side of a surfel, weighed by the cosine. `which` tells the surfel's sides apart.
fn gathered(i: u32, which: u32, leaf: Triangle, side: vec3f) -> vec3f {
  let rays = params.columns * params.rows;
  let turn = hash2(i, which);
  var sum = vec3f(0.0);
  for (var k = 0u; k < rays; k++) {
    let cell = cell_point(vec2u(i, which), k, params.columns, params.rows, params.frame);
    let direction = hemisphere_direction(cell, side, SAMPLE_COSINE).direction;
    let ray = make_ray(start_of(leaf, turn, k, side), direction);
    sum += incoming(ray, trace_nearest(ray, FAR), side);
  }
  let mean = sum / f32(rays);
#if EMITTERS
  return mean + shone(i, which, leaf, side);
#else
  return mean;
#endif
}

@compute @workgroup_size(64)
fn gather(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= counters.stored {
    return;
  }
  let source = sources[i];
  let material = materials[min(source.material, arrayLength(&materials) - 1u)];
  let albedo = min(sanitize(material.albedo), vec3f(params.most_albedo));
  var front = vec3f(0.0);
  var back = vec3f(0.0);
  // What reflects nothing gathers nothing.
  if any(albedo > vec3f(0.0)) {
    let piece = own_pieces[source.piece];
    let t = Triangle(piece.a, piece.b, piece.c);
    let normal = normalize_or(area_vector(t).direction, unpack_normal(source.normal));
    // A small piece has order 0: it is its own leaf.
    let leaf = leaf_of(t, source.leaf, piece.shape & SHAPE_ORDER);
    front = min(albedo * gathered(i, 0u, leaf, normal), vec3f(BRIGHTEST));
    if params.backs != 0u {
      back = min(albedo * gathered(i, 1u, leaf, -normal), vec3f(BRIGHTEST));
    }
  }
  radiance[i] = SurfelRadiance(front, 0.0, back, 0.0);
}

@compute @workgroup_size(64)
fn add(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= counters.stored {
    return;
  }
  let front = min(sanitize(radiance[i].front) + sanitize(added[i].front), vec3f(BRIGHTEST));
  let back = min(sanitize(radiance[i].back) + sanitize(added[i].back), vec3f(BRIGHTEST));
  radiance[i] = SurfelRadiance(front, 0.0, back, 0.0);
}

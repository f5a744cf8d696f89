// SurfelShader: what each surfel sends from its front and its back, of the light that reaches it straight from a light.
//
//   shade   one thread per surfel, one dispatch per light: the first starts from the surface's own emission, the others add to
//           what is there
//
// Surfaces are Lambertian and two-sided. A light is on one side of a surfel's plane, and lights that side alone.
//
// Variants: SHADOW_MAP looks shadows up in the caller's depth maps, SHADOW_TRACED along a ray; SAMPLES lights a surfel at several
// points of its own triangle, so that the edge of a shadow that crosses it is averaged. RAY_QUERY, with SHADOW_TRACED, lets the
// device itself traverse, a structure of its own; ALPHA_TESTED, with it, lets light through the holes of triangles.

#if RAY_QUERY
enable wgpu_ray_query;
#endif

#import math
#import packing
#import hashing
#import dispatch
#import surfel
#import light
#import material
#if SAMPLES
#import triangle
#endif

alias Counter = u32;

struct Params {
  light: Light,
  // 1 in the first dispatch of a recording.
  first: u32,
  // A surfel's triangle is bisected so often: 2^splits points.
  splits: u32,
  padding0: u32,
  padding1: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> surfels: array<vec4f>;
@group(0) @binding(2) var<storage, read> sources: array<SurfelSource>;
@group(0) @binding(3) var<storage, read> counters: Counters;
@group(0) @binding(4) var<storage, read> materials: array<Material>;
@group(0) @binding(5) var<storage, read_write> radiance: array<SurfelRadiance>;
#if SAMPLES || RAY_QUERY
@group(0) @binding(6) var<storage, read> pieces: array<Piece>;
#endif

// Share of a light that arrives at a point of a surface, 0 to 1; `side` is the normal on the side of the light.
#if SHADOW_MAP
#import shadow_map

@group(0) @binding(7) var<uniform> shadow: Shadow;
@group(0) @binding(8) var depth_map: texture_2d_array<f32>;

fn lit(point: vec3f, side: vec3f) -> f32 {
  return select(1.0, 0.0, is_hidden(look_up(point, side)));
}
#else
#if SHADOW_TRACED
#if RAY_QUERY
@group(0) @binding(9) var scene: acceleration_structure;

#import ray_query_traverse
#else
@group(0) @binding(9) var nodes: texture_2d<u32>;
@group(0) @binding(10) var triangles: texture_2d<u32>;
#if ALPHA_TESTED
@group(0) @binding(11) var alpha_maps: texture_2d_array<f32>;
#endif

#import bvh_traverse
#endif
#import shadow_ray

fn lit(point: vec3f, side: vec3f) -> f32 {
  return unshadowed(point + side * ray_epsilon(point), params.light);
}
#else
fn lit(point: vec3f, side: vec3f) -> f32 {
  return 1.0;
}
#endif
#endif

@compute @workgroup_size(64)
fn shade(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= counters.stored {
    return;
  }
  let source = sources[i];
  let material = materials[min(source.material, arrayLength(&materials) - 1u)];
  var front = vec3f(0.0);
  var back = vec3f(0.0);
  if params.first != 0u {
    front = own_radiosity(material, true) / PI;
    back = own_radiosity(material, false) / PI;
  } else {
    front = radiance[i].front;
    back = radiance[i].back;
  }

  if params.light.kind != NO_LIGHT {
    let normal = unpack_normal(source.normal);
    var point = surfels[i].xyz;
    var to_front = vec3f(0.0);
    var to_back = vec3f(0.0);
#if SAMPLES
    let piece = pieces[source.piece];
    // A small piece has order 0: it is its own leaf.
    let leaf = leaf_of(Triangle(piece.a, piece.b, piece.c), source.leaf, piece.shape & SHAPE_ORDER);
    for (var k = 0u; k < (1u << params.splits); k++) {
      point = centroid(leaf_of(leaf, k, params.splits));
#endif
      let arrival = light_at(params.light, point);
      let cosine = dot(normal, arrival.to_light);
      if cosine != 0.0 {
        let is_front = cosine > 0.0;
        let side = select(-normal, normal, is_front);
        let irradiance = arrival.irradiance * (abs(cosine) * lit(point, side));
        to_front += select(vec3f(0.0), irradiance, is_front);
        to_back += select(irradiance, vec3f(0.0), is_front);
      }
#if SAMPLES
    }
#endif
    let share = sanitize(material.albedo) / (PI * f32(1u << params.splits));
    front = min(front + share * to_front, vec3f(BRIGHTEST));
    back = min(back + share * to_back, vec3f(BRIGHTEST));
  }
  radiance[i] = SurfelRadiance(front, 0.0, back, 0.0);
}

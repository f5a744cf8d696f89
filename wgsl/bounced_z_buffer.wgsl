// BouncedZBuffer: what each pixel of the G-buffer meets first along N directions of its own (The Bounced Z-buffer 3 and
// 4.2).
//
//   trace          one thread per pixel and direction, a workgroup 8x8 pixels
//   trace_listed   #if LIST: one thread per listed pixel, which takes all of its directions
//   trace_more     #if MORE: one thread per pixel that is to have further rays (wgsl/ray_budget.wgsl)
//
// The paper splats senders onto pixels and keeps the nearest hit of each pixel's direction. Here a pixel gathers: its ray
// traverses a hierarchy of bounds and skips what it misses (wgsl/common/bvh_traverse.wgsl), so that a nearest hit takes
// tens of tests in place of all senders within their splats' reach, and none is out of reach.
//
// Without #if RADIANCE a hit is a bit; with it, the radiance that the surfel at the hit sends, or with #if LIT what the
// hit itself sends of the light that reaches it, and with #if GATHERED besides what its surfel sends of what it gathered from
// other surfels. Senders are a cloud's pieces, with #if TWO_LEVELS the triangles of instances
// of meshes, or with #if DISKS a cloud's surfels as disks. With #if GLOSSY directions are those of the pixel's glossy lobe;
// those below its horizon are not traced. With #if ENVIRONMENT rays that meet nothing bring what an environment has there, and
// some of a diffuse pixel's directions are drawn by it; with #if SKY_LIGHT that is all that they bring, and any hit is as good as
// the nearest. With #if RAY_QUERY the device itself traverses, a structure of its own. With #if ALPHA_TESTED triangles may have
// holes.
//
// With #if EMITTERS pixels have EMITTER_SAMPLES rays besides, towards pieces that shine of themselves. What these shine is
// weighed by multiple importance sampling, along either kind of rays; all else that hits send is brought by the pixels' own rays
// alone.
//
// With #if COUNTED pixels may have different numbers of rays, none among them. Those beyond `columns` x `rows` come in sets of
// as many, each with one ray per cell, of which the sums are kept.

#if RAY_QUERY
enable wgpu_ray_query;
#endif

#import math
#import packing
#import hashing
#import receiver
#import surfel
#import slots
#import triangle
#import directions
#import camera
#if GLOSSY
#import ggx
#endif
#if LIT
#import light
#import material
#endif
#if LIST
#import sub_image
#endif
#if ENVIRONMENT
#import environment
#endif
#if EMITTERS
#import emitters
#endif

alias Counter = u32;

struct Params {
  size: vec2u,
  columns: u32,
  rows: u32,
  frame: u32,
  // Words of bits per pixel.
  words: u32,
  surfel_capacity: u32,
  // Of the listed pixels (wgsl/common/sub_image.wgsl).
  level: u32,
  // Radiance where nothing is hit.
  sky_radiance: vec3f,
  // Farther hits do not count, world units.
  world_radius: f32,
}

#if LIT
struct Lights {
  // As many as shine.
  lights: array<Light, 16>,
  count: u32,
}
#endif

#if COUNTED
struct PixelRays {
  // Over the rays of further sets: of what comes along them, or how many were blocked. Of glossy receivers what the lobe makes of
  // it, in two parts: what counts as much as the reflectance straight on, and what is mirrored whatever that is.
#if RADIANCE
  sum: vec3f,
#else
  blocked: u32,
#endif
  // How many rays there were.
  rays: u32,
#if RADIANCE && GLOSSY
  grazing: vec3f,
#endif
}
#endif

override SAMPLING: u32 = 0u;
#if EMITTERS
override EMITTER_SAMPLES: u32 = 1u;
#endif

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> counters: Counters;
#if DISKS
@group(0) @binding(2) var nodes: texture_2d<f32>;
#else
#if RAY_QUERY
@group(0) @binding(2) var scene: acceleration_structure;
#else
@group(0) @binding(2) var nodes: texture_2d<u32>;
@group(0) @binding(3) var triangles: texture_2d<u32>;
#endif
#endif
#if ALPHA_TESTED
// The caller's, a layer a picture.
@group(0) @binding(35) var alpha_maps: texture_2d_array<f32>;
#endif
@group(0) @binding(4) var receivers: texture_2d<u32>;
#if RADIANCE
// Packed colours, one layer per direction; then one for each ray towards emitters, of glossy receivers two.
@group(0) @binding(5) var hits: texture_storage_2d_array<r32uint, write>;
#if LIT
@group(0) @binding(13) var<uniform> lights: Lights;
@group(0) @binding(14) var<storage, read> materials: array<Material>;
#endif
#if !SKY_LIGHT
#if !LIT || GATHERED
@group(0) @binding(6) var<storage, read> radiance: array<SurfelRadiance>;
#endif
#endif
#if !DISKS && !SKY_LIGHT
#if !LIT || GATHERED
// First surfel of each piece.
@group(0) @binding(7) var<storage, read> surfel_offsets: array<u32>;
#endif
#if !TWO_LEVELS
@group(0) @binding(8) var<storage, read> pieces: array<Piece>;
#endif
#endif
#else
// Bits of the directions that hit something.
@group(0) @binding(5) var<storage, read_write> hits: array<atomic<u32>>;
#endif
// How near a pixel's hits are: the sum over its directions of the pixel's side over the distance of the hit, 1 at most, in
// units of 2^-24, rounded. Integers, so that their order does not count.
@group(0) @binding(9) var<storage, read_write> nearness: array<atomic<u32>>;
#if STATISTICS
// Rays, nodes that they visited, primitives that they were tested against, and rays that hit; steps, each a node or a
// primitive, of the slowest of 32 neighbouring rays, summed, and how many such groups there were.
@group(0) @binding(10) var<storage, read_write> statistics: array<atomic<u32>, 6>;
#endif
@group(0) @binding(11) var<uniform> camera: Camera;
#if GLOSSY
// Perceptual roughness, of the caller's.
@group(0) @binding(12) var roughness_texture: texture_2d<f32>;
#endif
#if EMITTERS
// Sums of weights before each piece (wgsl/common/emitters.wgsl).
@group(0) @binding(36) var emitters: texture_2d<u32>;
#endif
#if ENVIRONMENT
@group(0) @binding(32) var<uniform> environment: Environment;
@group(0) @binding(33) var environment_radiance: texture_2d<f32>;
@group(0) @binding(34) var environment_distribution: texture_2d<f32>;
#endif
#if COUNTED
// Of each pixel, rows from the top.
@group(0) @binding(30) var<storage, read_write> counts: array<PixelRays>;
#endif
#if LIST
// How many pixels, then x | y << 16 of each.
@group(0) @binding(31) var<storage, read> work: array<u32>;
#endif
#if MORE
// In x how many pixels; then of each one x | y << 16, and how many further sets it is to have.
@group(0) @binding(31) var<storage, read> work: array<vec2u>;
#endif

#if DISKS
#import disk_bvh_traverse
#else
#if RAY_QUERY
#import ray_query_traverse
#else
#import bvh_traverse
#endif
#if LIT
#import shadow_ray
#endif
#endif

// A rasteriser takes vertices to lie on a grid, of 1/256 pixel or, on some drivers, of 1/16: a triangle as drawn is off the
// triangle that rays meet by up to half of that.
const GRID: f32 = 1.0 / 32.0;
// Of the distance from the eye; but not more than this, however large pixels are.
const MOST_OFFSET: f32 = 1e-3;

// What a hit within the pixel's side adds to nearness: of 64 directions the sum is less than 2^31, and of any number that a
// pixel can have, less than 2^32.
const NEAREST: f32 = 16777216.0;

// How far a pixel's rays start off it, along its normal and to where it is seen from: the latter leads off any other surface that
// meets its own there, since a point of an inner edge may have been rounded to beyond the other one.
fn offset_at(position: vec3f) -> f32 {
  let relative = position - camera.eye;
  return ray_epsilon(position) + min(GRID * footprint(camera, relative), MOST_OFFSET * length(relative));
}

#if RADIANCE && !SKY_LIGHT
// What a pixel's ray meets first.
fn find(ray: Ray, pixel: vec2u, normal: vec3f) -> Hit {
#if DISKS
  return walk_disks(ray, pixel, normal, false);
#else
  return trace_nearest(ray, params.world_radius);
#endif
}

#if !DISKS && !SKY_LIGHT
#if !LIT || GATHERED
// The surfel that a hit belongs to.
fn surfel_at(ray: Ray, hit: Hit) -> u32 {
  let index = hit.primitive;
  let piece = pieces[index];
  let t = Triangle(piece.a, piece.b, piece.c);
  let leaf = leaf_at(t, ray.origin + ray.direction * hit.t, piece.shape & SHAPE_ORDER);
  return nearest_room(surfel_offsets[index] + leaf, counters.surfels, params.surfel_capacity);
}
#endif
#endif

#if !DISKS
// How far a normal may lean off the surface that is taken for the pixel's own, as a cosine.
const OWN_COSINE: f32 = 0.25;

// Whether a hit is on the surface that a pixel's ray left. Directions are about the G-buffer's normal, which may lean off the
// surface, as smooth ones and those of maps do: then some lead below the surface's own horizon and meet it from where they
// start above it. Nothing shines on itself. `side` is the unit normal of the side that is met.
fn is_own(start: Start, ray: Ray, t: f32, side: vec3f) -> bool {
  return dot(start.normal, side) > OWN_COSINE && -t * dot(ray.direction, side) <= start.height;
}
#endif

#if EMITTERS
// `pdf` is the density over solid angle with which the ray was drawn.
fn incoming(start: Start, ray: Ray, hit: Hit, sky: vec3f, pdf: f32) -> vec3f {
#else
fn incoming(start: Start, ray: Ray, hit: Hit, sky: vec3f) -> vec3f {
#endif
  if hit.primitive == MISS {
    return sky;
  }
#if LIT
#if TWO_LEVELS
  let index = material_of(hit);
  let normal = normalize_or(normal_of(hit), -ray.direction);
#else
  let piece = pieces[hit.primitive];
  let index = piece.material;
  let normal = normalize_or(area_vector(Triangle(piece.a, piece.b, piece.c)).direction, -ray.direction);
#endif
  let facing = dot(normal, ray.direction) < 0.0;
  let side = select(-normal, normal, facing);
  if is_own(start, ray, hit.t, side) {
    return vec3f(0.0);
  }
  let place = ray.origin + ray.direction * hit.t;
  // Known to the rounding of where the ray started, which may be the farther end.
  let point = place + (side - ray.direction) * max(ray_epsilon(place), ray_epsilon(ray.origin));
  var irradiance = vec3f(0.0);
  for (var i = 0u; i < lights.count; i++) {
    let arrival = light_at(lights.lights[i], place);
    let cosine = dot(side, arrival.to_light);
    if cosine > 0.0 {
      irradiance += arrival.irradiance * (cosine * unshadowed(point, lights.lights[i]));
    }
  }
  let material = materials[min(index, arrayLength(&materials) - 1u)];
  var own = own_radiosity(material, facing);
#if EMITTERS
  if any(own > vec3f(0.0)) {
    let share = emitter_share(hit.primitive);
    let aimed = aimed_pdf(EMITTER_SAMPLES, hit.primitive, share, ray.direction, hit.t);
    own *= chance_share(f32(rays_per_pixel()) * pdf, aimed);
  }
#endif
  var sent = (own + sanitize(material.albedo) * irradiance) / PI;
#if GATHERED
  let gathered = radiance[surfel_at(ray, hit)];
  sent += sanitize(select(gathered.back, gathered.front, facing));
#endif
  return min(sent, vec3f(BRIGHTEST));
#else
#if DISKS
  let surfel = hit.primitive;
  let facing = dot(unpack_normal(sources[surfel].normal), ray.direction) < 0.0;
#else
  let surfel = surfel_at(ray, hit);
  let piece = pieces[hit.primitive];
  let normal = normalize_or(area_vector(Triangle(piece.a, piece.b, piece.c)).direction, -ray.direction);
  let facing = dot(normal, ray.direction) < 0.0;
  if is_own(start, ray, hit.t, select(-normal, normal, facing)) {
    return vec3f(0.0);
  }
#endif
  let sent = radiance[surfel];
  return select(sent.back, sent.front, facing);
#endif
}
#endif

#if !RADIANCE || SKY_LIGHT
// Where a pixel's ray meets something, the nearest or not; FAR where it meets nothing.
fn meet_any(ray: Ray, pixel: vec2u, normal: vec3f) -> f32 {
#if DISKS
  let hit = walk_disks(ray, pixel, normal, true);
  return select(hit.t, FAR, hit.primitive == MISS);
#else
  return trace_any(ray, params.world_radius);
#endif
}
#endif

fn place_of(pixel: vec2u) -> u32 {
  return pixel.y * params.size.x + pixel.x;
}

fn rays_per_pixel() -> u32 {
  return params.columns * params.rows;
}

// What a pixel's rays share.
struct Start {
  pixel: vec2u,
  normal: vec3f,
  seen_from: vec3f,
  origin: vec3f,
  // Of a pixel.
  side: f32,
  // How high above its surface the rays start, at most: along both ways, and as far as the surface may be drawn off.
  height: f32,
}

fn start_at(pixel: vec2u, texel: vec4u) -> Start {
  let position = receiver_position(texel);
  let normal = unpack_normal(texel.w);
  let relative = position - camera.eye;
  let seen_from = to_camera(camera, relative);
  let offset = offset_at(position);
  let origin = position + (normal + seen_from) * offset;
  return Start(pixel, normal, seen_from, origin, footprint(camera, relative), 2.5 * offset);
}

// What comes along a ray.
struct Seen {
#if RADIANCE
  // Packed.
  color: u32,
#endif
  blocked: bool,
  nearness: u32,
#if GLOSSY && MORE
  // How much of it the lobe sends on: times the reflectance straight on, and besides.
  shares: vec2f,
#endif
}

#if ENVIRONMENT && !GLOSSY
// Where a diffuse pixel's ray goes, and what its radiance counts, 0 if it is not to be traced.
struct Drawn {
  toward: EnvironmentSample,
  weight: f32,
}

// The first columns x rows of the environment's grid go by the pixel's cosine, the others where the environment is bright. What
// both could have drawn is weighed by the balance heuristic (Veach and Guibas, Optimally Combining Sampling Techniques for Monte
// Carlo Rendering, 1995): the cosine's density over that of all rays.
fn draw(start: Start, index: u32, turn: u32) -> Drawn {
  let own = environment.columns * environment.rows;
  let all = rays_per_pixel();
  var drawn: Drawn;
  if index < own {
    let point = further_point(start.pixel, index, turn, environment.columns, environment.rows, params.frame);
    drawn.toward = environment_at(hemisphere_direction(point, start.normal, SAMPLE_COSINE).direction);
  } else {
    drawn.toward = environment_sample(strewn_point(start.pixel, index - own, all - own, turn, params.frame));
  }
  let cosine = max(dot(start.normal, drawn.toward.direction), 0.0) / PI;
  let others = f32(all - own) / f32(all) * drawn.toward.pdf;
  drawn.weight = cosine / max(f32(own) / f32(all) * cosine + others, 1e-30);
  return drawn;
}
#endif

#if STATISTICS
fn count_ray(is_blocked: bool) {
  atomicAdd(&statistics[0], 1u);
  atomicAdd(&statistics[1], nodes_visited);
  atomicAdd(&statistics[2], primitives_tested);
  atomicAdd(&statistics[3], select(0u, 1u, is_blocked));
}
#endif

#if EMITTERS && !GLOSSY
// The mean density over a diffuse pixel's rays along a direction.
fn rays_pdf(start: Start, toward: vec3f) -> f32 {
  let cosine = max(dot(start.normal, toward), 0.0) / PI;
#if ENVIRONMENT
  let own = f32(environment.columns * environment.rows) / f32(rays_per_pixel());
  return own * cosine + (1.0 - own) * environment_at(toward).pdf;
#else
  return cosine;
#endif
}
#endif

fn look(start: Start, index: u32, turn: u32) -> Seen {
  var seen: Seen;
#if ENVIRONMENT && !GLOSSY
  let drawn = draw(start, index, turn);
  if drawn.weight <= 0.0 {
    return seen;
  }
  let direction = drawn.toward.direction;
#else
  let point = further_point(start.pixel, index, turn, params.columns, params.rows, params.frame);
#if GLOSSY
  let roughness = textureLoad(roughness_texture, camera.viewport.xy + start.pixel, 0).x;
  let lobe = make_lobe(start.normal, start.seen_from, roughness);
  let drawn = glossy_direction(lobe, point);
  if drawn.light.z <= 0.0 {
    return seen;
  }
  let direction = lobe.frame * drawn.light;
#if MORE
  let share = glossy_share(lobe, drawn.light);
  let power = schlick_power(lobe, drawn.facet);
  seen.shares = share * vec2f(1.0 - power, power);
#endif
#else
  let direction = hemisphere_direction(point, start.normal, SAMPLING).direction;
#endif
#endif
  let ray = make_ray(start.origin, direction);
#if EMITTERS
#if GLOSSY
  let pdf = glossy_pdf(lobe, drawn.facet);
#else
  let pdf = rays_pdf(start, direction);
#endif
#endif
#if RADIANCE && !SKY_LIGHT
  let hit = find(ray, start.pixel, start.normal);
  seen.blocked = hit.primitive != MISS;
  let distance = hit.t;
#if ENVIRONMENT
#if GLOSSY
  let sky = environment_at(direction).radiance;
#else
  let sky = drawn.toward.radiance;
#endif
#else
  let sky = params.sky_radiance;
#endif
#if EMITTERS
  let arriving = incoming(start, ray, hit, sky, pdf);
#else
  let arriving = incoming(start, ray, hit, sky);
#endif
#if ENVIRONMENT && !GLOSSY
  seen.color = pack_color(drawn.weight * arriving);
#else
  seen.color = pack_color(arriving);
#endif
#else
  let distance = meet_any(ray, start.pixel, start.normal);
  seen.blocked = distance < FAR;
#if SKY_LIGHT
  if !seen.blocked {
    seen.color = pack_color(drawn.weight * drawn.toward.radiance);
  }
#endif
#endif
  if seen.blocked {
    seen.nearness = u32(round(start.side / max(distance, start.side) * NEAREST));
  }
#if STATISTICS
  count_ray(seen.blocked);
#endif
  return seen;
}

#if EMITTERS
// What a ray towards emitters brings, weighed as a pixel's own rays are: packed radiance, or of glossy receivers what the lobe
// makes of it, times the reflectance straight on and besides.
#if GLOSSY
alias Shone = vec2u;
#else
alias Shone = u32;
#endif

fn shine(start: Start, index: u32, turn: u32) -> Shone {
  let drawn = emitter_sample(start.pixel, index, EMITTER_SAMPLES, turn, params.frame);
  let offset = drawn.point - start.origin;
  let direction = normalize_or(offset, vec3f(0.0));
  let distance = dot(offset, direction);
#if GLOSSY
  let roughness = textureLoad(roughness_texture, camera.viewport.xy + start.pixel, 0).x;
  let lobe = make_lobe(start.normal, start.seen_from, roughness);
  let light = direction * lobe.frame;
  let facet = facet_of(lobe, light);
  let pdf = glossy_pdf(lobe, facet);
  let value = pdf * glossy_share(lobe, light);
  let power = schlick_power(lobe, facet);
  let values = value * vec2f(1.0 - power, power);
#else
  let pdf = rays_pdf(start, direction);
  let value = max(dot(start.normal, direction), 0.0) / PI;
#endif
  if drawn.share <= 0.0 || !(value > 0.0) || distance > params.world_radius {
    return Shone();
  }
  let ray = make_ray(start.origin, direction);
  let met = aim(ray, drawn, distance, params.world_radius);
#if STATISTICS
  count_ray(met != MISS);
#endif
  if met == MISS {
    return Shone();
  }
  let piece = pieces[met];
  let normal = normalize_or(area_vector(Triangle(piece.a, piece.b, piece.c)).direction, -direction);
  if is_own(start, ray, distance, select(normal, -normal, dot(normal, direction) > 0.0)) {
    return Shone();
  }
  let aimed = aimed_pdf(EMITTER_SAMPLES, drawn.piece, drawn.share, direction, distance);
  let density = f32(rays_per_pixel()) * pdf + aimed;
  let radiance = own_along(met, direction) * (f32(EMITTER_SAMPLES) / max(density, 1e-30));
#if GLOSSY
  return vec2u(pack_color(values.x * radiance), pack_color(values.y * radiance));
#else
  return pack_color(value * radiance);
#endif
}

// In the layers behind those of a pixel's rays.
fn keep_shone(start: Start, index: u32, shone: Shone) {
#if GLOSSY
  let layer = rays_per_pixel() + 2u * index;
  textureStore(hits, start.pixel, layer, vec4u(shone.x, 0u, 0u, 0u));
  textureStore(hits, start.pixel, layer + 1u, vec4u(shone.y, 0u, 0u, 0u));
#else
  textureStore(hits, start.pixel, rays_per_pixel() + index, vec4u(shone, 0u, 0u, 0u));
#endif
}
#endif

fn keep(start: Start, index: u32, seen: Seen) {
  let place = place_of(start.pixel);
#if RADIANCE
  textureStore(hits, start.pixel, index, vec4u(seen.color, 0u, 0u, 0u));
#else
  if seen.blocked {
    atomicOr(&hits[place * params.words + index / 32u], 1u << (index & 31u));
  }
#endif
  if seen.nearness > 0u {
    atomicAdd(&nearness[place], seen.nearness);
  }
}

#if LIST

@compute @workgroup_size(64)
fn trace_listed(
  @builtin(workgroup_id) workgroup: vec3u,
  @builtin(num_workgroups) workgroups: vec3u,
  @builtin(local_invocation_index) thread: u32,
) {
  let i = (workgroup.y * workgroups.x + workgroup.x) * 64u + thread;
  if i >= min(work[0], arrayLength(&work) - 1u) {
    return;
  }
  let packed = work[i + 1u];
  let pixel = stands_for(vec2u(packed & 0xffffu, packed >> 16u), params.level, params.size);
  let texel = textureLoad(receivers, pixel, 0);
  // A finer level's pixel may be the same one.
  if texel.w == SKY || counts[place_of(pixel)].rays > 0u {
    return;
  }
  counts[place_of(pixel)].rays = rays_per_pixel();
  let start = start_at(pixel, texel);
  for (var index = 0u; index < rays_per_pixel(); index++) {
#if STATISTICS
    nodes_visited = 0u;
    primitives_tested = 0u;
#endif
    keep(start, index, look(start, index, 0u));
  }
#if EMITTERS
  for (var index = 0u; index < EMITTER_SAMPLES; index++) {
#if STATISTICS
    nodes_visited = 0u;
    primitives_tested = 0u;
#endif
    keep_shone(start, index, shine(start, index, 0u));
  }
#endif
}

#else
#if MORE

@compute @workgroup_size(64)
fn trace_more(
  @builtin(workgroup_id) workgroup: vec3u,
  @builtin(num_workgroups) workgroups: vec3u,
  @builtin(local_invocation_index) thread: u32,
) {
  let i = (workgroup.y * workgroups.x + workgroup.x) * 64u + thread;
  if i >= work[0].x {
    return;
  }
  let item = work[i + 1u];
  let pixel = vec2u(item.x & 0xffffu, item.x >> 16u);
  let place = place_of(pixel);
  let start = start_at(pixel, textureLoad(receivers, pixel, 0));
  var near = 0u;
#if RADIANCE
  var sum = vec3f(0.0);
#if GLOSSY
  var grazing = vec3f(0.0);
#endif
#else
  var blocked = 0u;
#endif
  for (var index = 0u; index < rays_per_pixel(); index++) {
    for (var turn = 1u; turn <= item.y; turn++) {
#if STATISTICS
      nodes_visited = 0u;
      primitives_tested = 0u;
#endif
      let seen = look(start, index, turn);
      near += seen.nearness;
#if RADIANCE
#if GLOSSY
      sum += seen.shares.x * unpack_color(seen.color);
      grazing += seen.shares.y * unpack_color(seen.color);
#else
      sum += unpack_color(seen.color);
#endif
#else
      blocked += select(0u, 1u, seen.blocked);
#endif
    }
  }
#if EMITTERS
  // As many rays count as there are of the pixel's own.
  let per_sample = f32(rays_per_pixel()) / f32(EMITTER_SAMPLES);
  for (var index = 0u; index < EMITTER_SAMPLES; index++) {
    for (var turn = 1u; turn <= item.y; turn++) {
#if STATISTICS
      nodes_visited = 0u;
      primitives_tested = 0u;
#endif
      let shone = shine(start, index, turn);
#if GLOSSY
      sum += per_sample * unpack_color(shone.x);
      grazing += per_sample * unpack_color(shone.y);
#else
      sum += per_sample * unpack_color(shone);
#endif
    }
  }
#endif
  atomicAdd(&nearness[place], near);
  counts[place].rays += item.y * rays_per_pixel();
#if RADIANCE
  counts[place].sum += sum;
#if GLOSSY
  counts[place].grazing += grazing;
#endif
#else
  counts[place].blocked += blocked;
#endif
}

#else

fn trace_pixel(pixel: vec2u, index: u32) {
  if any(pixel >= params.size) {
    return;
  }
  let texel = textureLoad(receivers, pixel, 0);
  if texel.w == SKY {
    return;
  }
#if COUNTED
  if index == 0u {
    counts[place_of(pixel)].rays = rays_per_pixel();
  }
#endif
  let start = start_at(pixel, texel);
#if EMITTERS
  if index >= rays_per_pixel() {
    let sample = index - rays_per_pixel();
    keep_shone(start, sample, shine(start, sample, 0u));
    return;
  }
#endif
  keep(start, index, look(start, index, 0u));
}

#if STATISTICS
// Steps of the slowest of the first 32 invocations of a workgroup, and of the others.
var<workgroup> slowest: array<atomic<u32>, 2>;
#endif

@compute @workgroup_size(8, 8)
fn trace(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) thread: u32) {
#if STATISTICS
  if thread < 2u {
    atomicStore(&slowest[thread], 0u);
  }
  workgroupBarrier();
#endif
  trace_pixel(id.xy, id.z);
#if STATISTICS
  atomicMax(&slowest[thread / 32u], nodes_visited + primitives_tested);
  workgroupBarrier();
  if thread < 2u {
    let steps = atomicLoad(&slowest[thread]);
    atomicAdd(&statistics[4], steps);
    atomicAdd(&statistics[5], select(0u, 1u, steps > 0u));
  }
#endif
}

#endif
#endif

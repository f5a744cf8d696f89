// BouncedZBuffer: what each pixel of the G-buffer meets first along N directions of its own (The Bounced Z-buffer 3 and
// 4.2).
//
//   trace   a thread a pixel and direction, a workgroup 8x8 pixels
//
// The paper splats senders onto pixels and keeps the nearest hit of each pixel's direction. Here a pixel gathers: its ray
// walks over the bounds of runs of senders and skips what it misses (wgsl/common/walk.wgsl), so that a nearest hit takes
// tens of tests in place of all senders within their splats' reach, and none is out of reach.
//
// Without #if RADIANCE a hit is a bit; with it, the radiance that the surfel at the hit sends. Senders are a cloud's pieces,
// or with #if SENDER_DISKS its surfels as disks. With #if GLOSSY directions are those of the pixel's glossy lobe; those
// below its horizon are not traced.

#import math
#import packing
#import hashing
#import receiver
#import surfel
#import rooms
#import triangle
#import directions
#if GLOSSY
#import camera
#import ggx
#endif

alias Counter = u32;

struct Params {
  size: vec2u,
  columns: u32,
  rows: u32,
  frame: u32,
  // Words of bits a pixel.
  words: u32,
  piece_capacity: u32,
  surfel_capacity: u32,
  // Radiance where nothing is hit.
  background: vec3f,
  // Farther hits do not count, world units.
  world_radius: f32,
}

override SAMPLING: u32 = 0u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> counters: Counters;
@group(0) @binding(2) var nodes: texture_2d<f32>;
#if SENDER_DISKS
#else
@group(0) @binding(3) var leaves: texture_2d<f32>;
#endif
@group(0) @binding(4) var receivers: texture_2d<u32>;
#if RADIANCE
// Packed colours, a layer a direction.
@group(0) @binding(5) var hits: texture_storage_2d_array<r32uint, write>;
@group(0) @binding(6) var<storage, read> radiance: array<SurfelRadiance>;
#if SENDER_DISKS
#else
// First surfel of each piece.
@group(0) @binding(7) var<storage, read> surfel_offsets: array<u32>;
@group(0) @binding(8) var<storage, read> pieces: array<Piece>;
// Pairs of a key and a piece, in the order that the leaves have.
@group(0) @binding(9) var<storage, read> order: array<vec2u>;
#endif
#else
// Bits of the directions that hit something.
@group(0) @binding(5) var<storage, read_write> hits: array<atomic<u32>>;
#endif
#if STATISTICS
// Rays, nodes and leaves that they were tested against, and rays that hit.
@group(0) @binding(10) var<storage, read_write> statistics: array<atomic<u32>, 4>;
#endif
#if GLOSSY
@group(0) @binding(11) var<uniform> camera: Camera;
// Perceptual roughness, of the caller's.
@group(0) @binding(12) var roughness_texture: texture_2d<f32>;
#endif

#if SENDER_DISKS
#import disk_walk
#else
#import meet_triangles
#endif

// What a pixel's ray meets first; with `any` something that it meets.
fn find(ray: Ray, pixel: vec2u, normal: vec3f, any: bool) -> Hit {
#if SENDER_DISKS
  return walk_disks(ray, pixel, normal, any);
#else
  let count = rooms_taken(counters.pieces, params.piece_capacity);
  return walk(ray, count, params.piece_capacity, params.world_radius, any);
#endif
}

#if RADIANCE
fn incoming(ray: Ray, hit: Hit) -> vec3f {
  if hit.sender == NO_SENDER {
    return params.background;
  }
#if SENDER_DISKS
  let surfel = hit.sender;
  let facing = dot(unpack_normal(sources[surfel].normal), ray.direction) < 0.0;
#else
  let index = order[hit.sender].y;
  let piece = pieces[index];
  let t = Triangle(piece.a, piece.b, piece.c);
  let leaf = leaf_at(t, ray.origin + ray.direction * hit.t, piece.shape & SHAPE_ORDER);
  let surfel = nearest_room(surfel_offsets[index] + leaf, counters.surfels, params.surfel_capacity);
  let facing = dot(cross(t.b - t.a, t.c - t.a), ray.direction) < 0.0;
#endif
  let sent = radiance[surfel];
  return select(sent.back, sent.front, facing);
}
#endif

@compute @workgroup_size(8, 8)
fn trace(@builtin(global_invocation_id) id: vec3u) {
  let pixel = id.xy;
  if any(pixel >= params.size) {
    return;
  }
  let texel = textureLoad(receivers, pixel, 0);
  if texel.w == SKY {
    return;
  }
  let position = receiver_position(texel);
  let normal = unpack_normal(texel.w);
  let point = cell_point(pixel, id.z, params.columns, params.rows, params.frame);
#if GLOSSY
  let roughness = textureLoad(roughness_texture, camera.viewport.xy + pixel, 0).x;
  let lobe = make_lobe(normal, to_camera(camera, position - camera.eye), roughness);
  let drawn = glossy_direction(lobe, point);
  if drawn.light.z <= 0.0 {
#if RADIANCE
    textureStore(hits, pixel, id.z, vec4u(0u));
#endif
    return;
  }
  let direction = lobe.frame * drawn.light;
#else
  let direction = hemisphere_direction(point, normal, SAMPLING).direction;
#endif
  let ray = make_ray(off_surface(position, normal), direction);
#if RADIANCE
  let hit = find(ray, pixel, normal, false);
  textureStore(hits, pixel, id.z, vec4u(pack_color(incoming(ray, hit)), 0u, 0u, 0u));
#else
  let hit = find(ray, pixel, normal, true);
  if hit.sender != NO_SENDER {
    atomicOr(&hits[(pixel.y * params.size.x + pixel.x) * params.words + id.z / 32u], 1u << (id.z & 31u));
  }
#endif
#if STATISTICS
  atomicAdd(&statistics[0], 1u);
  atomicAdd(&statistics[1], nodes_tested);
  atomicAdd(&statistics[2], leaves_tested);
  atomicAdd(&statistics[3], select(0u, 1u, hit.sender != NO_SENDER));
#endif
}

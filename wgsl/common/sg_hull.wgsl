// What the kernels of the hull share (src/sg_hull): its parameters, its segments, and what is known of a pixel.

#import math
#import packing
#import camera
#import receiver

struct Params {
  camera: Camera,
  // Unit vector away from the camera along its axis.
  along: vec3f,
  // Segments that there is room for.
  capacity: u32,
  // Texels of the grid that is segmented, and its tiles.
  grid: vec2u,
  tiles: vec2u,
  // Reflectance of glossy surfaces seen straight on.
  f0: vec3f,
  // Side of a texel in pixels.
  texel: u32,
  // Pixels that there is room for to be gathered each for itself.
  per_pixel_capacity: u32,
  // From which error on, in the picture's mean irradiances, a quad is split, or its pixels are.
  error_threshold: f32,
  // When neighbours are one surface: in widths of the view at their distance, and as a cosine.
  plane_distance: f32,
  gap: f32,
  normal_cosine: f32,
  // Side of the largest segment in texels: a power of two up to a tile's.
  quad: u32,
  // Parts of quads that there is room for to be split.
  split_room: u32,
  rays: Rays,
}

// Pixels of a tile that lie on one surface.
struct Segment {
  // The first pixel, and the one past the last.
  rect: vec4u,
  // Along the camera's axis, from the eye.
  nearest: f32,
  farthest: f32,
  // A pixel of it close to its middle.
  anchor: u32,
  // The mean normal, packed.
  normal: u32,
  // How far normals lie off it, root mean square, radians.
  spread: f32,
}

struct Counters {
  // What was asked for, room or not.
  segments: u32,
  // Of the last resort, one per tile at most.
  fallbacks: u32,
  fallback_pixels: u32,
  // Vertices that light is gathered at.
  gathered: u32,
  // Arguments of an indirect draw: vertices, instances, first vertex, first instance.
  draw: vec4u,
  // Quads, and parts of them, whose pixels are gathered each for itself.
  rejected: u32,
  // Those pixels, room or not.
  per_pixel: u32,
  // Of what arrives at the vertices, over colour channels as well.
  mean_irradiance: f32,
  // Quads, and parts of them, that are split in four, room or not.
  splits: u32,
  // Arguments of the draw of those pixels, as points.
  points: vec4u,
  // Arguments of the draw of the parts that fit.
  parts: vec4u,
  // The splits of the round: the first, and the one past the last.
  round: vec2u,
  padding: vec2u,
}

// Pixels to be gathered each for itself: those of a segment within a rectangle, its first pixel and the one past the last,
// each x and 65536 y.
struct RejectedQuad {
  slot: u32,
  low: u32,
  high: u32,
  padding: u32,
}

// A vertex that light is gathered at, and the normal that it is gathered for, packed.
struct Gathering {
  vertex: u32,
  normal: u32,
}

// In place of a segment.
const SKY_PIXEL: u32 = 0xffffffffu;
const UNASSIGNED: u32 = 0xfffffffeu;
// Pixels of a rectangle up to which light is gathered at each of them.
const TINY_AREA: u32 = 8u;
// Radians, a little above what packing does to a normal.
const FLAT_SPREAD: f32 = 0.003;

// Every tile has a segment of last resort: those lie behind the others.
fn first_fallback(params: Params) -> u32 {
  return params.capacity - params.tiles.x * params.tiles.y;
}

// Where the i-th of the segments lies.
fn segment_slot(params: Params, counted: u32, i: u32) -> u32 {
  let limit = first_fallback(params);
  let regular = min(counted, limit);
  return select(limit + (i - regular), i, i < regular);
}

// Half as many corners as pixels, or more: a corner's light costs what that of two pixels does, as lobes come with it, and
// gathering at the pixels is exact. Most of what is thin is such.
fn is_tiny(segment: Segment) -> bool {
  let size = segment.rect.zw - segment.rect.xy;
  return size.x * size.y <= TINY_AREA;
}

// Whether all pixels can be gathered each for itself, and with them those of tiny segments.
fn has_room(params: Params) -> bool {
  return params.per_pixel_capacity >= params.camera.viewport.z * params.camera.viewport.w;
}

// A corner of a rectangle, 0 to 3, rows from the top.
fn edge_of(low: vec2u, high: vec2u, corner: u32) -> vec2u {
  return select(low, high, vec2<bool>((corner & 1u) != 0u, (corner & 2u) != 0u));
}

fn pack_pixel(pixel: vec2u) -> u32 {
  return pixel.x | (pixel.y << 16u);
}

fn unpack_pixel(bits: u32) -> vec2u {
  return vec2u(bits & 0xffffu, bits >> 16u);
}

// Whether a segment's pixels have one normal: irradiance itself is interpolated then.
fn is_flat(segment: Segment) -> bool {
  return segment.spread < FLAT_SPREAD;
}

// Side of the view at a point.
fn view_width(params: Params, position: vec3f) -> f32 {
  return footprint(params.camera, position - params.camera.eye) * f32(max(params.camera.viewport.z, params.camera.viewport.w));
}

// How far a point is from the eye along the axis.
fn view_depth(params: Params, position: vec3f) -> f32 {
  return dot(params.along, position - params.camera.eye);
}

// What decides whether a pixel is one surface with another.
struct Facet {
  position: vec3f,
  normal: vec3f,
  // Side of the view at it.
  extent: f32,
}

fn facet(params: Params, texel: vec4u) -> Facet {
  let p = receiver_position(texel);
  return Facet(p, unpack_normal(texel.w), view_width(params, p));
}

// Whether two pixels are one surface: alike in normal, each close to the other's tangent plane, and no gap between them.
// Oblique planes are one whatever the step in depth from pixel to pixel, which is what a threshold on depth alone splits.
fn alike(params: Params, a: Facet, b: Facet) -> bool {
  let d = b.position - a.position;
  let extent = min(a.extent, b.extent);
  return dot(a.normal, b.normal) >= params.normal_cosine
    && max(abs(dot(a.normal, d)), abs(dot(b.normal, d))) <= params.plane_distance * extent
    && abs(dot(params.along, d)) <= params.gap * extent;
}

fn similar(params: Params, a: vec4u, b: vec4u) -> bool {
  return alike(params, facet(params, a), facet(params, b));
}

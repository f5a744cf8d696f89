// The hull drawn: one quad per segment, its light interpolated and integrated over each pixel's own hemisphere (Meder and
// Bruederlin 2018, sections 3 and 4). Fragments of pixels that belong to another segment are dropped.
//
// Moments are interpolated, not lobes: sums of light are linear, so that the total is kept, and a lobe's axis comes out
// of them with unit length. Where a quad has one normal, what is to be had of the lobes is known at the corners: irradiance
// itself is interpolated, which is cheaper and does not bend between them.
//
// @group(0) @binding(0) params, 1 receivers, 2 the segment of each pixel, 3 segments, 4 counters, 5 vertices, 6 albedo, 7
// roughness; without GLOSSY 8 parts of quads

#import sg_hull
#import spherical_gaussian
#import sg_hull_vertex
#import screen
#import target
#if GLOSSY
#import sg_glossy
#endif

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var receivers: texture_2d<u32>;
@group(0) @binding(2) var<storage, read> segment_of: array<u32>;
@group(0) @binding(3) var<storage, read> segments: array<Segment>;
@group(0) @binding(4) var<storage, read> counters: Counters;
@group(0) @binding(5) var<storage, read> vertices: array<HullVertex>;
#if ALBEDO
#import albedo
@group(0) @binding(6) var albedo_texture: texture_2d<f32>;
#endif
#if GLOSSY
@group(0) @binding(7) var roughness_texture: texture_2d<f32>;
#else
#import sg_hull_split
@group(0) @binding(8) var<storage, read> parts: array<Part>;
#endif

struct Corner {
  @builtin(position) clip: vec4f,
  @location(0) @interpolate(flat) id: u32,
  @location(1) red: vec4f,
  @location(2) green: vec4f,
  @location(3) blue: vec4f,
  @location(4) excess: vec3f,
}

struct FlatCorner {
  @builtin(position) clip: vec4f,
  @location(0) @interpolate(flat) id: u32,
  @location(1) irradiance: vec3f,
#if GLOSSY
  @location(2) red: vec4f,
  @location(3) green: vec4f,
  @location(4) blue: vec4f,
#endif
}

// Where a point between pixels is in the picture. Corners of quads that are not to be drawn are all in one point.
fn clip_position(edge: vec2u, depth: f32, farthest: f32, drawn: bool) -> vec4f {
  let ndc = vec2f(edge) / vec2f(params.camera.viewport.zw) * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
  // Only its ratio to the other corners' counts.
  let w = select(1.0, clamp(depth / max(farthest, 1e-30), 1e-6, 1.0), params.camera.perspective != 0u);
  return select(vec4f(0.0, 0.0, 0.0, 1.0), vec4f(ndc * w, 0.5 * w, w), drawn);
}

// Whether a segment is to be drawn as a quad: not if all of its pixels are sure to be drawn as points.
fn is_drawn(segment: Segment, slot: u32) -> bool {
  return !(has_room(params) && (slot >= first_fallback(params) || is_tiny(segment)));
}

@vertex
fn corner(@builtin(vertex_index) corner: u32, @builtin(instance_index) i: u32) -> Corner {
  let slot = segment_slot(params, counters.segments, i);
  let segment = segments[slot];
  let vertex = vertices[i * 4u + corner];
  let clip = clip_position(edge_of(segment.rect.xy, segment.rect.zw, corner), vertex.depth, segment.farthest,
    is_drawn(segment, slot) && !is_flat(segment));
  let light = vertices[vertex.owner];
  return Corner(clip, slot, light.red, light.green, light.blue, light.excess);
}

@vertex
fn flat_corner(@builtin(vertex_index) corner: u32, @builtin(instance_index) i: u32) -> FlatCorner {
  let slot = segment_slot(params, counters.segments, i);
  let segment = segments[slot];
  let vertex = vertices[i * 4u + corner];
  let clip = clip_position(edge_of(segment.rect.xy, segment.rect.zw, corner), vertex.depth, segment.farthest,
    is_drawn(segment, slot) && is_flat(segment));
#if GLOSSY
  let light = vertices[vertex.owner];
  return FlatCorner(clip, slot, vertex.irradiance, light.red, light.green, light.blue);
#else
  return FlatCorner(clip, slot, vertex.irradiance);
#endif
}

#if !GLOSSY
@vertex
fn part_corner(@builtin(vertex_index) corner: u32, @builtin(instance_index) i: u32) -> FlatCorner {
  let part = parts[i];
  var corners = part.corners;
  let farthest = max(max(corners[0].w, corners[1].w), max(corners[2].w, corners[3].w));
  let edge = edge_of(unpack_pixel(part.low), unpack_pixel(part.high), corner);
  return FlatCorner(clip_position(edge, corners[corner].w, farthest, true), part.slot, corners[corner].xyz);
}
#endif

fn pixel_of(fragment: vec4f) -> vec2u {
  return min(vec2u(fragment.xy) - params.camera.viewport.xy, params.camera.viewport.zw - 1u);
}

fn is_of(pixel: vec2u, id: u32) -> bool {
  return segment_of[pixel.y * params.camera.viewport.z + pixel.x] == id;
}

fn reflected(pixel: vec2u, irradiance: vec3f) -> vec4f {
  var color = irradiance / PI;
#if ALBEDO
  color *= decode_albedo(textureLoad(albedo_texture, params.camera.viewport.xy + pixel, 0).xyz);
#endif
  return vec4f(color, 1.0);
}

#if GLOSSY
// What is reflected, and what the second lobe adds to it.
fn with_gloss(pixel: vec2u, texel: vec4u, diffuse: vec4f, red: vec4f, green: vec4f, blue: vec4f) -> vec4f {
  let roughness = textureLoad(roughness_texture, params.camera.viewport.xy + pixel, 0).x;
  let lobe = lobe_seen(params.camera, texel, roughness);
  return diffuse + vec4f(glossy_radiance(lobe, params.f0, red, green, blue), 0.0);
}
#endif

@fragment
fn shade(in: Corner) -> @location(0) vec4f {
  let pixel = pixel_of(in.clip);
  if !is_of(pixel, in.id) {
    discard;
  }
  let texel = textureLoad(receivers, pixel, 0);
  let normal = unpack_normal(texel.w);
  let diffuse = reflected(pixel, vec3f(lobe_irradiance(in.red, in.excess.x, normal),
    lobe_irradiance(in.green, in.excess.y, normal), lobe_irradiance(in.blue, in.excess.z, normal)));
#if GLOSSY
  return held(with_gloss(pixel, texel, diffuse, in.red, in.green, in.blue));
#else
  return held(diffuse);
#endif
}

@fragment
fn shade_flat(in: FlatCorner) -> @location(0) vec4f {
  let pixel = pixel_of(in.clip);
  if !is_of(pixel, in.id) {
    discard;
  }
  let diffuse = reflected(pixel, in.irradiance);
#if GLOSSY
  return held(with_gloss(pixel, textureLoad(receivers, pixel, 0), diffuse, in.red, in.green, in.blue));
#else
  return held(diffuse);
#endif
}

// The sky reflects nothing, and no quad covers it.
@fragment
fn clear_sky(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let pixel = pixel_of(fragment);
  if !is_of(pixel, SKY_PIXEL) {
    discard;
  }
  return vec4f(0.0, 0.0, 0.0, 1.0);
}

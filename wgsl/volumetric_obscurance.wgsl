// Volumetric obscurance (Loos and Sloan 2010): how much of the sphere about a point, or of its half above the surface, lies
// in front of what the depth buffer shows.
//
// The sphere is seen along the line to the eye. A point of its disk is a chord of it along that line, which projects to one
// pixel; the depth there says how much of the chord is matter (4.1). Points of the ball say yes or no (Mittring 2007), areas
// know mean and variance of the depth (4.2). Heights along the line are in radii of the sphere from its centre, and grow
// toward the eye.
//
// @group(0) @binding(0) params, 1 depth (post-projection), 2 the target, 3 normals (NORMALS), 4 the work list (LIST),
// 5 moments of the depth (AREAS)

#import math
#import hashing
#import packing
#import camera
#import gbuffer
#import work
#import moments

struct Params {
  camera: Camera,
  // Points relative to the camera's eye to pixels of the viewport, (x w, y w, w, 0).
  to_pixel: mat4x4f,
  // (x, y, depth - far_depth, 1), x and y in pixels of the viewport, to homogeneous points relative to the camera's eye.
  from_pixel: mat4x4f,
  // Unit vector along which view depth grows.
  forward: vec3f,
  level: u32,
  // Encoding, as decode_normal takes it.
  normals: vec2u,
  depth_step: f32,
  depth_relative: f32,
  // One or two radii, world units.
  radii: vec2f,
  radius_count: u32,
  combine: u32,
  max_pixels: f32,
  thickness: f32,
  seed: u32,
  // Half width of the box that stands for an area's depths, in standard deviations.
  box_half_width: f32,
  count: u32,
  // Whether each pixel draws numbers of its own.
  turn: u32,
  // Whether lines are turned to the side where the half sphere is.
  uphill: u32,
  padding2: u32,
  // Of the depth's moments, from squares of 2 x 2 pixels on.
  moment_levels: array<MomentLevel, 8>,
  // On the disk x, y, half the chord's length (of an area the logarithm of the side of a square of the same share,
  // base 2) and share; in the ball x, y, z and share.
  samples: array<vec4f, 64>,
}

const MINIMUM: u32 = 1u;
const MOMENT_LEVELS: u32 = 8u;

// Samples are points of the ball, not of the disk.
override POINTS: bool = false;
// The sphere is that of half the radius which touches the surface at the point (4.4).
override TANGENT: bool = false;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var depth_texture: texture_2d<f32>;
@group(0) @binding(2) var obscurance: texture_storage_2d<r32float, write>;
#if NORMALS
@group(0) @binding(3) var normal_texture: texture_2d<f32>;
#endif
#if LIST
@group(0) @binding(4) var<storage, read> work: array<u32>;
#endif
#if AREAS
@group(0) @binding(5) var<storage, read> moments: array<vec4f>;
#endif

// A point of the viewport as seen, relative to this camera's eye.
struct Receiver {
  position: vec3f,
  normal: vec3f,
  // To the eye.
  axis: vec3f,
  // What from_pixel gives along the axis and along the normal, and both of this point.
  rows: mat2x4f,
  here: vec2f,
  // How far depths may be off, along the axis.
  uncertainty: f32,
  // What the pixel's samples are reflected about.
  mirror: vec3f,
  // In 0...1, what decides which lines are turned.
  draw: f32,
  footprint: f32,
}

// What a sample saw.
struct Seen {
  // Relative to the receiver, along its axis and along its normal, world units.
  offset: vec2f,
  // Half width of the box over which its depths spread, along the axis, world units.
  spread: f32,
  // The share that has a surface, of that which is in the viewport.
  covered: f32,
  // The share in the viewport.
  inside: f32,
}

fn depth_at(pixel: vec2u) -> f32 {
  return textureLoad(depth_texture, params.camera.viewport.xy + pixel, 0).x;
}

fn is_foreground(depth: f32) -> bool {
  return select((depth < 1.0 && depth > -1e30), (depth > 0.0 && depth < 1e30), params.camera.far_depth == 0.0);
}

// How far along axis and normal of a receiver the surface of a depth at a pixel's centre lies, from the eye.
fn along_rows(rows: mat2x4f, pixel: vec2f, depth: f32) -> vec2f {
  let v = vec4f(pixel + 0.5, depth - params.camera.far_depth, 1.0);
  let m = params.from_pixel;
  let w = dot(vec4f(m[0].w, m[1].w, m[2].w, m[3].w), v);
  return (v * rows) / w;
}

// Whether a place is in the viewport.
fn is_inside(place: vec2f) -> bool {
  return all(place >= vec2f(0.0)) && all(place < vec2f(params.camera.viewport.zw));
}

// The surface that the depth buffer holds where a point (x w, y w, w) in pixels of the viewport is, at the pixel's centre.
fn look(receiver: Receiver, h: vec3f) -> Seen {
  let place = floor(h.xy / h.z);
  if !(h.z > 0.0 && is_inside(place)) {
    return Seen(vec2f(0.0), 0.0, 0.0, 0.0);
  }
  let depth = depth_at(vec2u(place));
  let offset = along_rows(receiver.rows, place, depth) - receiver.here;
  return Seen(offset, 0.0, select(0.0, 1.0, is_foreground(depth)), 1.0);
}

#if AREAS
// Of a square of 2^level pixels a side; level 0 is the depth buffer.
fn moments_at(texel: vec2i, level: u32) -> vec4f {
  if level == 0u {
    if any(texel < vec2i(0)) || any(texel >= vec2i(params.camera.viewport.zw)) {
      return vec4f(0.0);
    }
    let p = unproject(params.camera, vec2u(texel), depth_at(vec2u(texel)));
    return vec4f(dot(p.xyz, params.forward), 0.0, p.w, 1.0);
  }
  let stored = params.moment_levels[level - 1u];
  if any(texel < vec2i(0)) || any(texel >= vec2i(stored.size)) {
    return vec4f(0.0);
  }
  return moments[stored.offset + u32(texel.y) * stored.size.x + u32(texel.x)];
}

// Of a square of 2^level pixels a side about a place: between the four texels about it, of two levels. One texel at a time, in
// the manner of Welford (1962), where eight reads side by side take some drivers minutes to compile.
fn moments_around(place: vec2f, level: f32) -> vec4f {
  let clamped = clamp(level, 0.0, f32(MOMENT_LEVELS));
  let lower = u32(clamped);
  let between = clamped - f32(lower);
  var mean = 0.0;
  var squares = 0.0;
  var covered = 0.0;
  var inside = 0.0;
  for (var i = 0u; i < 8u; i++) {
    let upper = i >= 4u;
    let at = min(lower + select(0u, 1u, upper), MOMENT_LEVELS);
    let p = place / f32(1u << at) - 0.5;
    let corner = floor(p);
    let step = vec2u(i & 1u, (i >> 1u) & 1u);
    let shares = select(1.0 - (p - corner), p - corner, step == vec2u(1u));
    let share = shares.x * shares.y * select(1.0 - between, between, upper);
    let m = moments_at(vec2i(corner) + vec2i(step), at);
    inside += share * m.w;
    let weight = share * m.z;
    if weight > 0.0 {
      covered += weight;
      let part = weight / covered;
      let apart = m.x - mean;
      mean += part * apart;
      squares += weight * (m.y + apart * apart * (1.0 - part));
    }
  }
  return vec4f(mean, select(0.0, squares / covered, covered > 0.0), covered, inside);
}

// The depths of a square of 2^level pixels a side about a place, as a box.
fn look_around(receiver: Receiver, h: vec3f, level: f32) -> Seen {
  let place = h.xy / h.z;
  if !(h.z > 0.0 && is_inside(place)) {
    return Seen(vec2f(0.0), 0.0, 0.0, 0.0);
  }
  let m = moments_around(place, level);
  // The point of that view depth on the line through the place.
  let p = params.from_pixel * vec4f(place, 0.0, 1.0);
  var direction = params.forward;
  var base = vec3f(0.0);
  if params.camera.perspective != 0u {
    direction = p.xyz / dot(p.xyz, params.forward);
  } else {
    base = p.xyz / p.w;
    base -= params.forward * dot(base, params.forward);
  }
  let apart = base + direction * m.x - receiver.position;
  let offset = vec2f(dot(apart, receiver.axis), dot(apart, receiver.normal));
  let spread = params.box_half_width * sqrt(m.y) * abs(dot(direction, receiver.axis));
  return Seen(offset, spread, m.z / max(m.w, 1e-6), m.w);
}
#endif

// A unit vector of the plane from 32 random bits. By polynomials, since a driver's sines may be coarse, and samples of the
// mirror (src/reference/volumetric_obscurance.rs) are to fall on the same pixels.
fn random_direction(bits: u32) -> vec2f {
  let angle = (unit_float(bits << 2u) - 0.5) * (0.5 * PI);
  let a2 = angle * angle;
  let c = 1.0 - a2 * (1.0 / 2.0 - a2 * (1.0 / 24.0 - a2 * (1.0 / 720.0 - a2 / 40320.0)));
  let s = angle * (1.0 - a2 * (1.0 / 6.0 - a2 * (1.0 / 120.0 - a2 * (1.0 / 5040.0 - a2 / 362880.0))));
  let turned = select(vec2f(c, s), vec2f(-s, c), (bits & 0x80000000u) != 0u);
  return select(turned, -turned, (bits & 0x40000000u) != 0u);
}

// The pixel's random bits.
fn random_bits(pixel: vec2u) -> u32 {
  return hash2(select(0u, pixel.x | (pixel.y << 16u), params.turn != 0u), params.seed);
}

// What the pixel's samples are reflected about: on the disk a direction of the plane, in the ball one of space.
fn random_mirror(bits: u32) -> vec3f {
  let direction = random_direction(bits);
  if POINTS {
    let z = 2.0 * unit_float(hash(bits)) - 1.0;
    return vec3f(direction * sqrt(max(1.0 - z * z, 0.0)), z);
  }
  return vec3f(direction, 0.0);
}

// How much of the heights low...high is matter, where the surface's height is spread evenly over a box of half width
// `spread` about `height` and what is below it is matter.
fn matter_below(height: f32, spread: f32, low: f32, high: f32) -> f32 {
#if AREAS
  let width = max(spread, 1e-6);
  let all_below = clamp(height - width, low, high);
  let some_below = clamp(height + width, low, high);
  // Between them the chance of matter falls linearly; at the middle it is its mean.
  let mean = (height + width - 0.5 * (all_below + some_below)) / (2.0 * width);
  return all_below - low + (some_below - all_below) * clamp(mean, 0.0, 1.0);
#else
  return clamp(height, low, high) - low;
#endif
}

// The share of the sphere that is open.
fn openness(receiver: Receiver, world_radius: f32) -> f32 {
  // Where the sphere would pass its cap on screen, it is smaller in the world.
  let radius = min(world_radius, params.max_pixels * receiver.footprint);
  let scale = select(radius, 0.5 * radius, TANGENT);
  // What f32 cannot tell from the point itself obscures nothing.
  if !(scale > 2e-7 * max_component(abs(receiver.position))) || scale < 1e-30 {
    return 1.0;
  }
  let n = receiver.normal;
  // Of the sphere's centre, in its radii: how far above the point it is.
  let above = select(0.0, 1.0, TANGENT);
  let toward_eye = dot(n, receiver.axis);
  // A normal that points away from the eye, as shading normals do at silhouettes, counts as one on the horizon.
  let facing = max(toward_eye, 0.02);
  let thickness = min(params.thickness / scale, 4e6);
  let uncertainty = receiver.uncertainty / scale;
  // The disk's axes, and its points' pixels: linear in the point. Reflected, since a reflection is linear too.
  let frame = tangent_frame(receiver.axis);
  let m = receiver.mirror;
  let to_pixel = mat3x3f(params.to_pixel[0].xyz, params.to_pixel[1].xyz, params.to_pixel[2].xyz);
  let center = to_pixel * (receiver.position + scale * above * n) + params.to_pixel[3].xyz;
  let u = frame * vec3f(2.0 * m.x * m.xy - vec2f(1.0, 0.0), 0.0);
  let v = frame * vec3f(2.0 * m.y * m.xy - vec2f(0.0, 1.0), 0.0);
  let across = mat2x3f(scale * (to_pixel * u), scale * (to_pixel * v));
#if NORMALS
  let slope = vec2f(dot(u, n), dot(v, n));
#endif
#if AREAS
  let log_pixels = log2(scale / receiver.footprint);
#endif
  var matter = 0.0;
  var total = 0.0;
  for (var i = 0u; i < params.count; i++) {
    let entry = params.samples[i];
    if POINTS {
      var q = 2.0 * dot(entry.xyz, m) * m - entry.xyz;
#if NORMALS
      // From below the surface to above it.
      q -= select(2.0 * min(dot(q, n), 0.0), 0.0, TANGENT) * n;
#endif
      let seen = look(receiver, center + scale * (to_pixel * q));
      let behind = seen.offset.x / scale - above * toward_eye - dot(q, receiver.axis);
      let hit = behind > uncertainty && behind < thickness;
      total += entry.w * seen.inside;
      matter += select(0.0, entry.w * seen.covered, hit);
      continue;
    }
#if AREAS
    let seen = look_around(receiver, center + across * entry.xy, log_pixels + entry.z);
    let half_chord = sqrt(max(1.0 - dot(entry.xy, entry.xy), 0.0));
    let at = entry.xy;
#else
    let half_chord = entry.z;
    var at = entry.xy;
#if NORMALS
    // Chords on opposite sides of the centre have as much of the half sphere between them as a whole one, and the draw
    // decides which of them is looked at: as often as is its share. So no line falls where there is little to see.
    if params.uphill != 0u && half_chord + dot(slope, at) / facing < 2.0 * half_chord * receiver.draw {
      at = -at;
    }
#endif
    // About the point itself there is the point: nothing to look up.
    var seen = Seen(vec2f(0.0), 0.0, 1.0, 1.0);
    if TANGENT || any(at != vec2f(0.0)) {
      seen = look(receiver, center + across * at);
    }
#endif
    // Farther than any sphere reaches, before it could leave the range of f32.
    let height = clamp(seen.offset.x / scale - above * toward_eye, -1e6, 1e6);
    var low = -half_chord;
#if NORMALS
    // The part of the chord above the plane through the point. Where a surface is seen, the plane's height is that on its
    // line of sight, which passes a pixel's centre, not the sample: so no plane shades itself.
    let on_disk = -(above + dot(slope, at)) / facing;
    let plane = select(on_disk, height - seen.offset.y / scale / facing, seen.covered > 0.0);
    low = clamp(mix(on_disk, plane, seen.covered), low, half_chord);
#endif
    // A turned line stands for as much as any other, however long it is.
    let whole = select(2.0 * half_chord, max(half_chord - low, 1e-6), params.uphill != 0u);
    let share = entry.w * seen.inside / whole;
    total += share * (half_chord - low);
    if seen.covered > 0.0 {
      let front = height - uncertainty;
      let spread = seen.spread / scale;
      // What lies farther behind the surface than it is thick is open again (4.3).
      let occupied = matter_below(front, spread, low, half_chord)
        - matter_below(front - thickness, spread, low, half_chord);
      matter += share * seen.covered * occupied;
    }
  }
  if !(total > 1e-6) {
    return 1.0;
  }
  let ratio = matter / total;
  // Numbers out of a depth buffer that holds none.
  let open = select(1.0, clamp(1.0 - ratio, 0.0, 1.0), is_finite(ratio));
#if NORMALS
  return open;
#else
  // Without normals half of the sphere about a point of a plane is matter.
  return min(2.0 * open, 1.0);
#endif
}

fn obscure(pixel: vec2u) -> f32 {
  let depth = depth_at(pixel);
  let p = unproject(params.camera, pixel, depth);
  if p.w == 0.0 {
    return 1.0;
  }
  let axis = to_camera(params.camera, p.xyz);
#if NORMALS
  let at = params.camera.viewport.xy + pixel;
  let n = decode_normal(params.camera, params.normals, textureLoad(normal_texture, at, 0).xyz, axis);
#else
  let n = axis;
#endif
  let rows = mat2x4f(vec4f(axis, 0.0) * params.from_pixel, vec4f(n, 0.0) * params.from_pixel);
  // By the same operations as what it is compared with, so that a pixel is at no distance from itself.
  let here = along_rows(rows, vec2f(pixel), depth);
  let step = params.depth_step + params.depth_relative * depth;
  let nearer = select(depth - step, depth + step, params.camera.far_depth == 0.0);
  // The point's own depth, and that of what it is compared with.
  let error = 2.0 * abs(along_rows(rows, vec2f(pixel), nearer).x - here.x);
  let uncertainty = select(0.0, error, step > 0.0 && is_finite(error));
  let bits = random_bits(pixel);
  let receiver = Receiver(
    p.xyz, n, axis, rows, here, uncertainty, random_mirror(bits), unit_float(hash(bits)),
    footprint(params.camera, p.xyz));
  var open = openness(receiver, params.radii.x);
  if params.radius_count > 1u {
    let second = openness(receiver, params.radii.y);
    open = select(open * second, min(open, second), params.combine == MINIMUM);
  }
  return open;
}

@compute @workgroup_size(8, 8)
fn obscurance_of_pixels(
  @builtin(workgroup_id) workgroup: vec3u,
  @builtin(num_workgroups) workgroups: vec3u,
  @builtin(local_invocation_index) local_index: u32,
) {
  let item = work_item(workgroup, workgroups, local_index);
  if item.valid {
    textureStore(obscurance, item.texel, vec4f(obscure(item.pixel), 0.0, 0.0, 0.0));
  }
}

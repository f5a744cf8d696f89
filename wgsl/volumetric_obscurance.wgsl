// Volumetric obscurance (Loos and Sloan 2010): how much of the sphere about a point, or of its half above the surface, lies
// in front of what the depth buffer shows.
//
// The sphere is seen along the line to the eye. A point of its disk is a chord of it along that line, which projects to one
// pixel; the depth there says how much of the chord is matter (4.1). Points of the ball say yes or no (Mittring 2007), areas
// know mean and variance of the depth (4.2). Heights along the line are in radii of the sphere from its centre, and grow
// toward the eye.
//
// Loops ask at their end whether to go on: some drivers run a body once more, to no effect, where they ask at its head.
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
  // Points relative to the camera's focus, as all are, to pixels of the viewport, (x w, y w, w, 0).
  to_pixel: mat4x4f,
  // As the camera's unproject, with x and y in pixels of the viewport.
  from_pixel: mat4x4f,
  rays: Rays,
  // The camera's right, its up, and the unit vector along which view depth falls.
  right: vec3f,
  level: u32,
  up: vec3f,
  // Of the sample in the centre, which sees the point itself and needs no look: its share over the length of its chord;
  // 0 if there is none.
  center: f32,
  back: vec3f,
  thickness: f32,
  // Encoding, as decode_normal takes it.
  normals: vec2u,
  depth_step: f32,
  depth_relative: f32,
  // One or two radii, world units.
  radii: vec2f,
  radius_count: u32,
  combine: u32,
  max_pixels: f32,
  // Half width of the box that stands for an area's depths, in standard deviations.
  box_half_width: f32,
  seed: u32,
  // Whether each pixel draws numbers of its own.
  turn: u32,
  // Of the depth's moments, from squares of 2 x 2 pixels on.
  moment_levels: array<MomentLevel, 8>,
  // Of a line x, y, half the chord's length and share, over the chord's length unless UPHILL; of an area x, y, the logarithm
  // of the side of a square of the same share, base 2, and share; of a point of the ball x, y, z and share.
  samples: array<vec4f, 64>,
}

const MINIMUM: u32 = 1u;
const MOMENT_LEVELS: u32 = 8u;

// Samples are points of the ball, not of the disk.
override POINTS: bool = false;
// The sphere is that of half the radius which touches the surface at the point (4.4).
override TANGENT: bool = false;
// Lines are turned to the side where the half sphere is.
override UPHILL: bool = false;
// How many samples there are to look at.
override COUNT: u32 = 1u;

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

// A point of the viewport as seen.
struct Receiver {
  position: vec3f,
  normal: vec3f,
  // To the eye.
  axis: vec3f,
  place: Place,
  // What from_pixel gives along the axis and along the normal.
  rows: mat2x4f,
  // How far depths may be off, along the axis.
  uncertainty: f32,
  // Cosine and sine of the angle by which the pixel's samples are turned, after a reflection; in the ball what they are
  // reflected about.
  mirror: vec3f,
  // In 0...1, what decides which lines are turned uphill.
  draw: f32,
  footprint: f32,
}

// The receiver's sphere, which is the unit of what follows.
struct Ball {
  rows: mat2x4f,
  // Of the point along them.
  here: vec2f,
}

// What a sample saw.
struct Seen {
  // Relative to the receiver, along its axis and along its normal, in radii.
  offset: vec2f,
  // Half width of the box over which its depths spread, along the axis, in radii.
  spread: f32,
  // The share that has a surface, of that which is in the viewport.
  covered: f32,
  // The share in the viewport.
  inside: f32,
}

fn depth_at(pixel: vec2u) -> f32 {
  return textureLoad(depth_texture, params.camera.viewport.xy + pixel, 0).x;
}

// A pixel's centre with its depth, as from_pixel takes it.
struct Place {
  // (x, y, depth - reference, 1).
  at: vec4f,
  // depth - far_depth.
  off_far: f32,
}

fn place_of(pixel: vec2f, depth: f32) -> Place {
  return Place(vec4f(pixel + 0.5, depth - params.camera.reference, 1.0), depth - params.camera.far_depth);
}

fn is_foreground(place: Place) -> bool {
  let nearer = select(-place.off_far, place.off_far, params.camera.far_depth == 0.0);
  return nearer > 0.0 && nearer < 1e30;
}

// The homogeneous coordinate that from_pixel gives.
fn weight_of(place: Place) -> f32 {
  let m = params.from_pixel;
  return dot(vec4f(m[0].w, m[1].w, m[2].w, m[3].w), vec4f(place.at.xy, place.off_far, 1.0));
}

// How far along a receiver's axis and normal a place's surface lies from the focus.
fn along_rows(rows: mat2x4f, place: Place) -> vec2f {
  return (place.at * rows) / weight_of(place);
}

// Whether a place is in the viewport.
fn is_inside(place: vec2f) -> bool {
  return all(place >= vec2f(0.0)) && all(place < vec2f(params.camera.viewport.zw));
}

// The surface that the depth buffer holds where a point (x w, y w, w) in pixels of the viewport is, at the pixel's centre.
fn look(ball: Ball, h: vec3f) -> Seen {
  let pixel = floor(h.xy / h.z);
  let inside = h.z > 0.0 && is_inside(pixel);
  let within = select(vec2f(0.0), pixel, inside);
  // By its bits: of a whole number of less than 2^23, these are what a conversion gives, which asks for its range besides.
  let at = bitcast<vec2u>(within + 8388608.0) & vec2u(0x7fffffu);
  let place = place_of(within, depth_at(at));
  let offset = along_rows(ball.rows, place) - ball.here;
  return Seen(offset, 0.0, select(0.0, 1.0, inside && is_foreground(place)), select(0.0, 1.0, inside));
}

#if AREAS
// Of a square of 2^level pixels a side; level 0 is the depth buffer.
fn moments_at(texel: vec2i, level: u32) -> vec4f {
  if level == 0u {
    if any(texel < vec2i(0)) || any(texel >= vec2i(params.camera.viewport.zw)) {
      return vec4f(0.0);
    }
    let p = unproject(params.camera, vec2u(texel), depth_at(vec2u(texel)));
    return vec4f(-dot(p.xyz, params.back), 0.0, p.w, 1.0);
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
fn look_around(receiver: Receiver, scale: f32, h: vec3f, level: f32) -> Seen {
  let place = h.xy / h.z;
  if !(h.z > 0.0 && is_inside(place)) {
    return Seen(vec2f(0.0), 0.0, 0.0, 0.0);
  }
  let m = moments_around(place, level);
  // The point of that view depth on the line through the place.
  let ndc = vec3f(place / vec2f(params.camera.viewport.zw) * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0), 1.0);
  let direction = params.rays.direction * ndc;
  let apart = params.rays.base * ndc + direction * m.x - receiver.position;
  let offset = vec2f(dot(apart, receiver.axis), dot(apart, receiver.normal)) / scale;
  let spread = params.box_half_width * sqrt(m.y) * abs(dot(direction, receiver.axis)) / scale;
  return Seen(offset, spread, m.z / max(m.w, 1e-6), m.w);
}
#endif

// A unit vector of the plane from the upper half of 32 random bits. By polynomials, since a driver's sines may be coarse, and
// samples of the mirror (src/reference/volumetric_obscurance.rs) are to fall on the same pixels.
fn random_direction(bits: u32) -> vec2f {
  let angle = (f32((bits >> 16u) & 0x3fffu) / 16384.0 - 0.5) * (0.5 * PI);
  let a2 = angle * angle;
  let c = 1.0 - a2 * (1.0 / 2.0 - a2 * (1.0 / 24.0 - a2 * (1.0 / 720.0 - a2 / 40320.0)));
  let s = angle * (1.0 - a2 * (1.0 / 6.0 - a2 * (1.0 / 120.0 - a2 * (1.0 / 5040.0 - a2 / 362880.0))));
  let turned = select(vec2f(c, s), vec2f(-s, c), (bits & 0x80000000u) != 0u);
  return select(turned, -turned, (bits & 0x40000000u) != 0u);
}

// What the pixel's samples are turned by, or reflected about, and a draw.
fn random_numbers(pixel: vec2u) -> vec4f {
  let bits = hash2(select(0u, pixel.x | (pixel.y << 16u), params.turn != 0u), params.seed);
  let direction = random_direction(bits);
  // From the half that the direction leaves.
  let draw = f32(bits & 0xffffu) / 65536.0;
  if POINTS {
    let z = 2.0 * draw - 1.0;
    return vec4f(direction * sqrt(max(1.0 - z * z, 0.0)), z, draw);
  }
  return vec4f(direction, 0.0, draw);
}

// Two unit vectors across the axis: the camera's right and up, turned by the least angle. All that is seen is before the
// camera, so none is turned by as much as half a circle, where there would be no such turn.
fn across_axis(axis: vec3f) -> mat2x3f {
  let middle = (axis + params.back) / (1.0 + dot(axis, params.back));
  return mat2x3f(params.right - dot(axis, params.right) * middle, params.up - dot(axis, params.up) * middle);
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
  let n = receiver.normal;
  // Of the sphere's centre, in its radii: how far above the point it is.
  let above = select(0.0, 1.0, TANGENT);
  let toward_eye = dot(n, receiver.axis);
  // A normal that points away from the eye, as shading normals do at silhouettes, counts as one on the horizon.
  let facing = max(toward_eye, 0.02);
  let thickness = min(params.thickness / scale, 4e6);
  let uncertainty = receiver.uncertainty / scale;
  let rows = receiver.rows * (1.0 / scale);
  // By the same operations as what it is compared with, so that a pixel is at no distance from itself.
  let ball = Ball(rows, along_rows(rows, receiver.place));
  // The disk's axes, and its points' pixels: linear in the point. Reflected, since a reflection is linear too.
  let frame = across_axis(receiver.axis);
  let m = receiver.mirror;
  let to_pixel = mat3x3f(params.to_pixel[0].xyz, params.to_pixel[1].xyz, params.to_pixel[2].xyz);
  let center = to_pixel * (receiver.position + scale * above * n) + params.to_pixel[3].xyz;
  let u = frame * m.xy;
  let v = frame * vec2f(m.y, -m.x);
  let across = mat2x3f(scale * (to_pixel * u), scale * (to_pixel * v));
  // How far the plane through the point falls beside it.
  let slope = vec2f(dot(u, n), dot(v, n)) / facing;
#if AREAS
  let log_pixels = log2(scale / receiver.footprint);
#endif
  // The chord through the point: its own surface is as high as the point, and what is below it is matter.
#if NORMALS
  var total = params.center;
  var matter = 0.0;
#else
  var total = 2.0 * params.center;
  var matter = params.center * (max(-uncertainty, -1.0) - max(-uncertainty - thickness, -1.0));
#endif
  var i = 0u;
  loop {
    let entry = params.samples[i];
    if POINTS {
      var q = 2.0 * dot(entry.xyz, m) * m - entry.xyz;
#if NORMALS
      // From below the surface to above it.
      q -= select(2.0 * min(dot(q, n), 0.0), 0.0, TANGENT) * n;
#endif
      let seen = look(ball, center + scale * (to_pixel * q));
      let behind = seen.offset.x - above * toward_eye - dot(q, receiver.axis);
      let hit = behind > uncertainty && behind < thickness;
      total += entry.w * seen.inside;
      matter += select(0.0, entry.w * seen.covered, hit);
    } else {
      var at = entry.xy;
#if AREAS
      let seen = look_around(receiver, scale, center + across * at, log_pixels + entry.z);
      let half_chord = sqrt(max(1.0 - dot(at, at), 0.0));
      let weight = entry.w / (2.0 * half_chord);
#else
      let half_chord = entry.z;
      let weight = entry.w;
      // Chords on opposite sides of the centre have as much of the half sphere between them as a whole one, and the draw
      // decides which of them is looked at: as often as is its share. So no line falls where there is little to see.
      if UPHILL {
        at *= select(1.0, -1.0, dot(slope, at) < half_chord * (2.0 * receiver.draw - 1.0));
      }
      let seen = look(ball, center + across * at);
#endif
      let height = seen.offset.x - above * toward_eye;
      var low = -half_chord;
#if NORMALS
      // The part of the chord above the plane through the point. Where a surface is seen, the plane's height is that on its
      // line of sight, which passes a pixel's centre, not the sample: so no plane shades itself.
      let on_disk = -above / facing - dot(slope, at);
      var plane = select(on_disk, height - seen.offset.y / facing, seen.covered > 0.0);
#if AREAS
      plane = mix(on_disk, plane, seen.covered);
#endif
      low = clamp(plane, low, half_chord);
#endif
      // A turned line stands for as much as any other, however long it is.
      let share = seen.inside * select(weight, weight / max(half_chord - low, 1e-6), UPHILL);
      total += share * (half_chord - low);
      let front = height - uncertainty;
      // What lies farther behind the surface than it is thick is open again (4.3).
      let occupied = matter_below(front, seen.spread, low, half_chord)
        - matter_below(front - thickness, seen.spread, low, half_chord);
      matter += select(0.0, share * seen.covered * occupied, seen.covered > 0.0);
    }
    continuing {
      i++;
      break if i >= COUNT;
    }
  }
  let ratio = matter / total;
  // What f32 cannot tell from the point itself obscures nothing; nor do numbers out of a depth buffer that holds none.
  let counts = scale > 2e-7 * max_component(abs(receiver.position)) && scale >= 1e-30 && total > 1e-6 && is_finite(ratio);
  let open = select(1.0, clamp(1.0 - ratio, 0.0, 1.0), counts);
#if NORMALS
  return open;
#else
  // Without normals half of the sphere about a point of a plane is matter.
  return min(2.0 * open, 1.0);
#endif
}

fn obscure(pixel: vec2u) -> f32 {
  let depth = depth_at(pixel);
  let place = place_of(vec2f(pixel), depth);
  let weight = weight_of(place);
  let position = (params.from_pixel * place.at).xyz / weight;
  if !(is_foreground(place) && weight > 0.0 && is_near(position)) {
    return 1.0;
  }
  let to_eye = params.camera.eye - position;
  let distance = length(to_eye);
  let perspective = params.camera.perspective != 0u;
  let axis = select(params.back, to_eye / distance, perspective && distance > 1e-18);
#if NORMALS
  let at = params.camera.viewport.xy + pixel;
  let n = decode_normal(params.camera, params.normals, textureLoad(normal_texture, at, 0).xyz, axis);
#else
  let n = axis;
#endif
  let rows = mat2x4f(vec4f(axis, 0.0) * params.from_pixel, vec4f(n, 0.0) * params.from_pixel);
  let step = params.depth_step + params.depth_relative * depth;
  let by = select(-step, step, params.camera.far_depth == 0.0);
  let nearer = Place(place.at + vec4f(0.0, 0.0, by, 0.0), place.off_far + by);
  // The point's own depth, and that of what it is compared with.
  let error = 2.0 * abs(along_rows(rows, nearer).x - along_rows(rows, place).x);
  let uncertainty = select(0.0, error, step > 0.0 && is_finite(error));
  let random = random_numbers(pixel);
  let footprint = params.camera.pixel * select(1.0, max(distance, params.camera.near), perspective);
  let receiver = Receiver(position, n, axis, place, rows, uncertainty, random.xyz, random.w, footprint);
  var open = 1.0;
  var k = 0u;
  loop {
    let own = openness(receiver, select(params.radii.x, params.radii.y, k > 0u));
    open = select(open * own, min(open, own), params.combine == MINIMUM);
    continuing {
      k++;
      break if k >= params.radius_count;
    }
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

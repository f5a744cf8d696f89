// TemporalAccumulator: the mean over frames of a picture that is noisy in each, fetched from where the pixel's surface
// was (reverse reprojection: Nehab et al. 2007, 3), and the caller's texture from it.
//
//   claim       compute, with motion vectors: which texels of the last history belong to what moves
//   accumulate  compute: this frame's picture and the last history to the next history
//   show        fragment: the next history to the caller's texture
//
// A history is two textures: the receivers of its frame, relative to its frame's origin, and one texel per pixel
// with the mean and the number of frames in it; 0 frames are no history. Every history has these of its own frame, so
// that a texel can be told to belong to another surface before it counts.
//
// @group(0) @binding(0) params, 1 receivers of this frame, 2 of the last, 3 means of the last, 4 the picture, 5 motion
// vectors, 6 the means to write, 7 the claims; for `show` 0 params, 3 the means to show

#import math
#import packing
#import camera
#import receiver

struct Params {
  // The last frame's, for positions relative to its own origin.
  previous: Camera,
  // Positions of the last frame to homogeneous pixels from the middle of its viewport, y down: x, y and w.
  project: mat4x4f,
  // This frame's: x, y, width, height in pixels.
  viewport: vec4u,
  // From a motion vector to pixels that the surface moved by, y down.
  motion_scale: vec2f,
  max_frames: f32,
  // Share of the distance from the last eye.
  depth_tolerance: f32,
  // Least cosine between normals.
  normal_tolerance: f32,
  // Half width of the box that the history is clipped to, in standard deviations; 0 for no box.
  clip_deviations: f32,
  // 1 where both cameras are the same.
  still: u32,
  // 1 where there is no history, or shall be none.
  forget: u32,
  // The last frame's origin relative to this frame's.
  previous_origin: vec3f,
  padding: u32,
  // Where the viewport's first pixel is in the picture.
  picture_corner: vec2u,
}

@group(0) @binding(0) var<uniform> params: Params;

// A pixel's mean and its frames. One channel stands in x, and the others are 0.
struct History {
  mean: vec3f,
  frames: f32,
}

fn size() -> vec2i {
  return vec2i(params.viewport.zw);
}

fn history_of(texel: vec4f) -> History {
#if COLOR
  return History(texel.xyz, texel.w);
#else
  return History(vec3f(texel.x, 0.0, 0.0), texel.y);
#endif
}

#if MOTION

@group(0) @binding(5) var motion_vectors: texture_2d<f32>;

// Minus what the pixel's surface moved by in the picture since the last frame.
fn motion_offset(pixel: vec2i) -> vec2f {
  return -params.motion_scale * textureLoad(motion_vectors, vec2i(params.viewport.xy) + pixel, 0).xy;
}

// Whether two surfaces' offsets differ by more than motion vectors in 16 bits may be off.
fn apart(a: vec2f, b: vec2f) -> bool {
  return length(a - b) > 0.0625 + 0.00390625 * length(a);
}

#endif

// Where a surface that stands still was in the last picture, as an offset from its pixel: a small number keeps the
// fraction that a large one loses, and under a camera that did not move it is exactly 0. `position` is relative to the last
// origin.
fn still_offset(pixel: vec2i, position: vec3f) -> vec2f {
  if params.still != 0u {
    return vec2f(0.0);
  }
  let h = params.project * vec4f(position, 1.0);
  let middle = 0.5 * vec2f(size());
  // Behind the last eye's plane is outside of its picture.
  return select(2.0 * vec2f(size()), h.xy / h.w - (vec2f(pixel) + 0.5 - middle), h.w > 0.0);
}

// Whether an offset is finite and leads somewhere near the picture: no larger number fits into an integer.
fn is_near(offset: vec2f) -> bool {
  let beyond = max_component(vec3f(abs(offset) - vec2f(size()), 0.0));
  return is_finite3(vec3f(offset, 0.0)) && beyond <= 0.0;
}

#if CLAIM

@group(0) @binding(1) var receivers: texture_2d<u32>;
// One a texel of the last history: one more than the index of a pixel that shows now what moved away from about there.
@group(0) @binding(7) var<storage, read_write> claims: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn claim(@builtin(global_invocation_id) id: vec3u) {
  let pixel = vec2i(id.xy);
  if any(pixel >= size()) {
    return;
  }
  let receiver = textureLoad(receivers, pixel, 0);
  let offset = motion_offset(pixel);
  if receiver.w == SKY || !is_near(offset) {
    return;
  }
  if !apart(offset, still_offset(pixel, receiver_position(receiver) - params.previous_origin)) {
    return;
  }
  // All texels within a pixel and a half, so that what was larger then leaves no gaps.
  let middle = pixel + vec2i(floor(offset + 0.5));
  for (var i = 0; i < 9; i++) {
    let at = middle + vec2i(i % 3 - 1, i / 3 - 1);
    if all(at >= vec2i(0)) && all(at < size()) {
      // The largest index, so that the order of threads decides nothing.
      atomicMax(&claims[at.y * size().x + at.x], u32(pixel.y * size().x + pixel.x) + 1u);
    }
  }
}

#endif

#if ACCUMULATE

@group(0) @binding(1) var receivers: texture_2d<u32>;
@group(0) @binding(2) var previous_receivers: texture_2d<u32>;
@group(0) @binding(3) var previous_means: texture_2d<f32>;
@group(0) @binding(4) var picture: texture_2d<f32>;
#if COLOR
@group(0) @binding(6) var means: texture_storage_2d<rgba32float, write>;
#else
@group(0) @binding(6) var means: texture_storage_2d<rg32float, write>;
#endif
#if MOTION
@group(0) @binding(7) var<storage, read> claims: array<u32>;
#endif

const NONE: History = History(vec3f(0.0), 0.0);

// What a tap that does not fit must be nearer than, off the plane of the pixel, to fit after all; in pixels' sides.
const PLANE_TOLERANCE: f32 = 0.5;
// The same for a tap of a texel that something else moved away from.
const CLAIMED_TOLERANCE: f32 = 0.125;

fn current(pixel: vec2i) -> vec3f {
  let texel = textureLoad(picture, vec2i(params.picture_corner) + pixel, 0);
#if COLOR
  return texel.xyz;
#else
  return vec3f(texel.x, 0.0, 0.0);
#endif
}

// Where the pixel's surface was in the last picture, as an offset from the pixel.
fn offset_of(pixel: vec2i, position: vec3f) -> vec2f {
#if MOTION
  return motion_offset(pixel);
#else
  return still_offset(pixel, position);
#endif
}

#if MOTION
// Whether a surface with another offset was near a texel of the last history.
fn is_claimed(at: vec2i, offset: vec2f) -> bool {
  let claimant = i32(claims[at.y * size().x + at.x]) - 1;
  return claimant >= 0 && apart(motion_offset(vec2i(claimant % size().x, claimant / size().x)), offset);
}
#endif

// The history at a texel, if it is of the surface at `position` with `normal`, relative to the last focus, which was
// at `offset`.
fn tap(at: vec2i, offset: vec2f, position: vec3f, normal: vec3f) -> History {
  if any(at < vec2i(0)) || any(at >= size()) {
    return NONE;
  }
  let texel = textureLoad(previous_receivers, at, 0);
  if texel.w == SKY || dot(normal, unpack_normal(texel.w)) < params.normal_tolerance {
    return NONE;
  }
  // Seen at a grazing angle a surface's distance changes by much from pixel to pixel, but stays in its plane.
  let there = receiver_position(texel);
  let relative = position - params.previous.eye;
  var distance = length(relative);
  var off_distance = abs(length(there - params.previous.eye) - distance);
  if params.previous.perspective == 0u {
    // It may stand anywhere along its axis, and is taken to be as far off as its picture is high.
    distance = params.previous.pixel * f32(size().y);
    off_distance = abs(dot(there - position, to_camera(params.previous, relative)));
  }
  let off_plane = abs(dot(normal, there - position));
  let side = footprint(params.previous, relative);
  if off_distance > params.depth_tolerance * distance && off_plane > PLANE_TOLERANCE * side {
    return NONE;
  }
#if MOTION
  // What moves may have been a hair's breadth in front of it.
  if off_plane > CLAIMED_TOLERANCE * side && is_claimed(at, offset) {
    return NONE;
  }
#endif
  return history_of(textureLoad(previous_means, at, 0));
}

// The history at an offset from a pixel: bilinear, over the taps that fit.
fn fetch(pixel: vec2i, offset: vec2f, position: vec3f, normal: vec3f) -> History {
  if !is_near(offset) {
    return NONE;
  }
  let base = floor(offset);
  let fraction = offset - base;
  let first = pixel + vec2i(base);
  // A whole number of pixels: the mean and the count as they are, without a rounding that frames would add up.
  if all(fraction == vec2f(0.0)) {
    return tap(first, offset, position, normal);
  }
  var mean = vec3f(0.0);
  var weights = 0.0;
  var variance = 0.0;
  for (var i = 0; i < 4; i++) {
    let corner = vec2i(i & 1, i >> 1u);
    let t = tap(first + corner, offset, position, normal);
    let along = select(1.0 - fraction, fraction, corner == vec2i(1));
    let weight = along.x * along.y;
    if t.frames > 0.0 && weight > 0.0 {
      mean += weight * t.mean;
      weights += weight;
      variance += weight / t.frames;
    }
  }
  if weights == 0.0 {
    return NONE;
  }
  // A mean over n frames has 1 / n of a frame's variance: that is what is interpolated, so that a young tap counts.
  return History(clamp(mean / weights, vec3f(-MAX_F32), vec3f(MAX_F32)), max(weights / variance, 1.0));
}

// The history drawn towards the mean of the pixels around, until it is within some standard deviations of it in every
// channel (Salvi 2016).
fn clip(mean: vec3f, pixel: vec2i) -> vec3f {
  var count = 0.0;
  var centre = vec3f(0.0);
  var squares = vec3f(0.0);
  for (var i = 0; i < 9; i++) {
    let at = pixel + vec2i(i % 3 - 1, i / 3 - 1);
    if any(at < vec2i(0)) || any(at >= size()) {
      continue;
    }
    let value = current(at);
    if textureLoad(receivers, at, 0).w == SKY || !is_finite3(value) {
      continue;
    }
    // Welford's: the mean of squares less the square of the mean would lose what the two have in common.
    count += 1.0;
    let step = value - centre;
    centre += step / count;
    squares += step * (value - centre);
  }
  // Spread over all of f32 they are no bound.
  if !is_finite3(centre) || !is_finite3(squares) {
    return mean;
  }
  let extent = min(params.clip_deviations * sqrt(squares / max(count, 1.0)), vec3f(MAX_F32));
  let off = clamp(mean - centre, vec3f(-MAX_F32), vec3f(MAX_F32));
  // A channel within its bound is none for the others. One that does not vary has rounding for a bound.
  let is_out = abs(off) > extent + 1e-6 * abs(centre);
  let share = select(vec3f(1.0), extent / max(abs(off), vec3f(1e-30)), is_out);
  let least = min(share.x, min(share.y, share.z));
#if COLOR
  return select(mean, centre + least * off, least < 1.0);
#else
  return vec3f(select(mean.x, centre.x + share.x * off.x, share.x < 1.0), 0.0, 0.0);
#endif
}

@compute @workgroup_size(8, 8)
fn accumulate(@builtin(global_invocation_id) id: vec3u) {
  let pixel = vec2i(id.xy);
  if any(pixel >= size()) {
    return;
  }
  let now = current(pixel);
  let usable = is_finite3(now);
  let receiver = textureLoad(receivers, pixel, 0);
  var next = NONE;
  if usable {
    next = History(now, select(1.0, 0.0, receiver.w == SKY));
  }
  if receiver.w != SKY && params.forget == 0u {
    let position = receiver_position(receiver) - params.previous_origin;
    let normal = unpack_normal(receiver.w);
    let last = fetch(pixel, offset_of(pixel, position), position, normal);
    if last.frames > 0.0 {
      next = last;
      if usable {
        if params.clip_deviations > 0.0 {
          next.mean = clip(last.mean, pixel);
        }
        next.frames = min(last.frames, params.max_frames - 1.0) + 1.0;
        // Divided first: the difference of two floats may be too large for one.
        next.mean += now / next.frames - next.mean / next.frames;
      }
    }
  }
#if COLOR
  textureStore(means, pixel, vec4f(next.mean, next.frames));
#else
  textureStore(means, pixel, vec4f(next.mean.x, next.frames, 0.0, 0.0));
#endif
}

#endif

#if SHOW

#import screen

@group(0) @binding(3) var means: texture_2d<f32>;

@fragment
fn show(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let at = clamp(vec2i(fragment.xy) - vec2i(params.viewport.xy), vec2i(0), size() - 1);
  let mean = history_of(textureLoad(means, at, 0)).mean;
#if COLOR
  return held(vec4f(mean, 1.0));
#else
  return held(vec4f(mean.xxx, 1.0));
#endif
}

#endif

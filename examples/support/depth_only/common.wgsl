// What all passes of the depth-only methods share. Positions are in eye space: axes of the world, origin at the eye.
// "Depth" here is the clip-space w of a perspective camera, world units along its axis.

struct Params {
  clip_from_eye: mat4x4f,
  // The point one unit deep at pixel coordinates (x, y): corner + x * right + y * down.
  corner: vec3f,
  // What the depth buffer holds to depth: scale / (value - offset).
  depth_scale: f32,
  right: vec3f,
  depth_offset: f32,
  down: vec3f,
  // The depth buffer's value of the sky, 0 or 1.
  far_depth: f32,
  size: vec2u,
  // Slices a pixel, or directions.
  count: u32,
  // Taps on each side of a slice, or steps along a direction, at most.
  steps: u32,
  // Farther than this nothing counts, world units.
  radius: f32,
  // How deep surfaces reach behind what is seen of them, world units.
  thickness: f32,
  // Half width of the filter, pixels.
  filter_radius: i32,
  padding: u32,
}

@group(0) @binding(0) var<uniform> params: Params;

const PI: f32 = 3.14159265358979;
// Depth of the sky: its square is still in range.
const SKY: f32 = 1e18;

fn is_sky(depth: f32) -> bool {
  return depth >= 0.5 * SKY;
}

fn size() -> vec2i {
  return vec2i(params.size);
}

// The point at a depth, at pixel coordinates; a pixel's centre is at its index plus one half.
fn position(at: vec2f, depth: f32) -> vec3f {
  return (params.corner + at.x * params.right + at.y * params.down) * depth;
}

fn pixel_of_clip(clip: vec4f) -> vec2f {
  return (clip.xy / clip.w * vec2f(0.5, -0.5) + 0.5) * vec2f(params.size);
}

// Where a line through `at` leaves the image, pixels along the unit vector `line`.
fn to_border(at: vec2f, line: vec2f) -> f32 {
  let side = select(vec2f(0.0), vec2f(params.size), line > vec2f(0.0));
  let along = (side - at) / select(line, vec2f(1e-6), abs(line) < vec2f(1e-6));
  return min(abs(along.x), abs(along.y));
}

// Pixels from the middle to the i-th step of a march `length` pixels long, never less than a pixel apart. Starts outside
// of the pixel in the middle. Even steps: in 256 x 160 pixels quadratic ones, which favour what is near, err more.
fn step_at(i: u32, jitter: f32, length: f32) -> f32 {
  let t = f32(i) + jitter;
  return 0.75 + t * max(1.0, length / f32(params.steps));
}

// Two numbers per pixel in 0..1 that cover the square evenly over every few pixels that lie together: the sequence R2
// (Roberts 2018) along a Hilbert curve, as XeGTAO has it.
fn pixel_noise(at: vec2i) -> vec2f {
  var p = vec2u(at) & vec2u(63u);
  var index = 0u;
  for (var level = 32u; level > 0u; level >>= 1u) {
    let upper = select(vec2u(0u), vec2u(1u), (p & vec2u(level)) != vec2u(0u));
    index += level * level * ((3u * upper.x) ^ upper.y);
    if upper.y == 0u {
      if upper.x == 1u {
        p = vec2u(63u) - p;
      }
      p = p.yx;
    }
  }
  return fract(0.5 + f32(index) * vec2f(0.7548776662, 0.5698402910));
}

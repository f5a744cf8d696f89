// Where each pixel's surface was in the last frame: motion vectors, from depth and what has moved. All that moves is a box, and
// what is seen of it is what lies within it.

struct Motion {
  // Clip space of this frame to that of the last, by what moves with the world and by what moves with the box.
  before: array<mat4x4f, 2>,
  // Clip space of this frame to the box's own, where it reaches from -1 to 1.
  box_from_clip: mat4x4f,
  // 1 where there was a box in the last frame.
  known: u32,
}

@group(0) @binding(0) var<uniform> motion: Motion;
@group(0) @binding(1) var depth: texture_depth_2d;

// How far outside of the box a point of it may be, in its half widths: by the rounding of depths, and by a share of a pixel, as
// drivers round corners to sixteenths of one. Beside an edge, where the next pixel is far away, no more than the last.
const ROUNDING: f32 = 0.002;
const PIXELS: f32 = 0.0625;
const MOST: f32 = 0.1;
// Leads out of any picture, so that the pixel starts anew.
const AWAY: vec2f = vec2f(4.0);

@vertex
fn vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4f {
  return vec4f(f32(corner & 1u) * 4.0 - 1.0, f32(corner >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

// This frame's place less the last one's, in UV.
@fragment
fn fragment(@builtin(position) place: vec4f) -> @location(0) vec2f {
  let uv = place.xy / vec2f(textureDimensions(depth));
  let clip = vec4f(2.0 * uv.x - 1.0, 1.0 - 2.0 * uv.y, textureLoad(depth, vec2i(place.xy), 0), 1.0);
  let homogeneous = motion.box_from_clip * clip;
  let within = homogeneous.xyz / homogeneous.w;
  let pixel = fwidth(within);
  let skin = ROUNDING + min(PIXELS * max(pixel.x, max(pixel.y, pixel.z)), MOST);
  let of_box = all(abs(within) <= vec3f(1.0 + skin));
  let before = motion.before[u32(of_box)] * clip;
  if (of_box && motion.known == 0u) || before.w <= 0.0 {
    return AWAY;
  }
  return vec2f(0.5, -0.5) * (clip.xy - before.xy / before.w);
}

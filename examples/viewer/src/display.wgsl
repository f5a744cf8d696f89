// Both sides' pictures in the window: exposure, the split line, and how far each is off the truth.

struct Side {
  // What a picture's values are multiplied by to be shown.
  exposure: f32,
  // 1 where one channel says all.
  grey: u32,
  // 1 for directions, shown from -1 to 1.
  direction: u32,
  // 0 for the picture, 1 for its error, 2 for the truth.
  shown: u32,
}

struct Display {
  // Where the pictures are in the window, pixels: left, top, width, height.
  area: vec4f,
  // In pixels from the area's left side; beyond its right side where there is one picture.
  split: f32,
  // What errors are multiplied by.
  gain: f32,
  // Half the width of the split line, pixels.
  line: f32,
  sides: array<Side, 2>,
}

@group(0) @binding(0) var<storage, read> display: Display;
@group(0) @binding(1) var first: texture_2d<f32>;
@group(0) @binding(2) var second: texture_2d<f32>;
// The truth: in alpha whether it is known.
@group(0) @binding(3) var truth: texture_2d<f32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
  let corner = vec2f(f32(index & 1u), f32(index >> 1u));
  return vec4f(4.0 * corner - 1.0, 0.0, 1.0);
}

// The texel's value of a side, of whatever channels.
fn picture(second_side: bool, place: vec2u) -> vec3f {
  if second_side {
    return textureLoad(second, place, 0).xyz;
  }
  return textureLoad(first, place, 0).xyz;
}

// The two sides may be of different sizes for a frame.
fn size_of(second_side: bool) -> vec2u {
  if second_side {
    return textureDimensions(second);
  }
  return textureDimensions(first);
}

fn in_channels(value: vec3f, side: Side) -> vec3f {
  return select(value, vec3f(value.x), side.grey == 1u);
}

fn shown_of(value: vec3f, side: Side) -> vec3f {
  if side.direction == 1u {
    return pow(clamp(0.5 * value + 0.5, vec3f(0.0), vec3f(1.0)), vec3f(2.2));
  }
  return value * side.exposure;
}

// Black, violet, orange, white: from 0 to 1.
fn heat(error: f32) -> vec3f {
  let x = clamp(error, 0.0, 1.0);
  return vec3f(smoothstep(0.0, 0.6, x), smoothstep(0.3, 0.9, x), smoothstep(0.0, 0.25, x) - smoothstep(0.3, 0.6, x) +
    smoothstep(0.75, 1.0, x));
}

fn color_at(second_side: bool, place: vec2u, side: Side) -> vec3f {
  let value = in_channels(picture(second_side, place), side);
  let known = textureLoad(truth, min(place, textureDimensions(truth) - 1u), 0);
  if side.shown == 0u {
    return shown_of(value, side);
  }
  if side.shown == 2u {
    return select(vec3f(0.0), shown_of(in_channels(known.xyz, side), side), known.w > 0.0);
  }
  if known.w == 0.0 {
    // What is not known yet is dim.
    return 0.15 * shown_of(value, side);
  }
  let off = abs(value - in_channels(known.xyz, side));
  return heat(display.gain * side.exposure * max(off.x, max(off.y, off.z)));
}

fn encoded(color: vec3f) -> vec3f {
  let c = clamp(color, vec3f(0.0), vec3f(1.0));
  return select(1.055 * pow(c, vec3f(1.0 / 2.4)) - 0.055, 12.92 * c, c <= vec3f(0.0031308));
}

@fragment
fn fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
  let place = position.xy - display.area.xy;
  let second_side = place.x > display.split;
  if abs(place.x - display.split) < display.line {
    return vec4f(1.0, 0.8, 0.2, 1.0);
  }
  let side = display.sides[u32(second_side)];
  let size = size_of(second_side);
  // Bilinear where a texel is larger than a pixel of the window.
  let at = place / display.area.zw * vec2f(size) - 0.5;
  let low = floor(at);
  var color = vec3f(0.0);
  for (var k = 0u; k < 4u; k++) {
    let corner = low + vec2f(f32(k & 1u), f32(k >> 1u));
    let weight = max(vec2f(0.0), 1.0 - abs(at - corner));
    let texel = vec2u(clamp(corner, vec2f(0.0), vec2f(size) - 1.0));
    if weight.x * weight.y > 0.0 {
      color += weight.x * weight.y * color_at(second_side, texel, side);
    }
  }
  return vec4f(encoded(color), 1.0);
}

// Whether an alpha-tested triangle is there, at a place of it.
//
// The importer declares `alpha_maps`, the caller's pictures.

#needs alpha_maps

const CLAMP_TO_EDGE: u32 = 1u;
const MIRROR_REPEAT: u32 = 2u;

// A coordinate within the picture, or with MIRROR_REPEAT within it and its mirrored one, and so exact as f32 is there.
fn within_map(x: f32, wrap: u32) -> f32 {
  switch wrap {
    case CLAMP_TO_EDGE: {
      return clamp(x, 0.0, 1.0);
    }
    case MIRROR_REPEAT: {
      return 2.0 * fract(0.5 * x);
    }
    default: {
      return fract(x);
    }
  }
}

// Texel i, at most a picture beyond it.
fn texel_within(i: i32, size: i32, wrap: u32) -> i32 {
  switch wrap {
    case CLAMP_TO_EDGE: {
      return clamp(i, 0, size - 1);
    }
    case MIRROR_REPEAT: {
      let turned = (i + 2 * size) % (2 * size);
      return min(turned, 2 * size - 1 - turned);
    }
    default: {
      return (i + size) % size;
    }
  }
}

fn map_alpha(texel: vec2i, map: u32) -> f32 {
  var values = textureLoad(alpha_maps, texel, map & 0x3fffu, 0);
  let alpha = values[(map >> 18u) & 3u];
  return min(select(0.0, alpha, alpha > 0.0), 1.0);
}

// Alpha at texture coordinates, between the four texels about them.
fn alpha_at(uv: vec2f, map: u32) -> f32 {
  let size = vec2i(textureDimensions(alpha_maps));
  let wrap = (vec2u(map) >> vec2u(14u, 16u)) & vec2u(3u);
  let place = vec2f(within_map(uv.x, wrap.x), within_map(uv.y, wrap.y)) * vec2f(size) - 0.5;
  let first = floor(place);
  let share = place - first;
  let texel = vec2i(first);
  let x0 = texel_within(texel.x, size.x, wrap.x);
  let x1 = texel_within(texel.x + 1, size.x, wrap.x);
  let y0 = texel_within(texel.y, size.y, wrap.y);
  let y1 = texel_within(texel.y + 1, size.y, wrap.y);
  let upper = mix(map_alpha(vec2i(x0, y0), map), map_alpha(vec2i(x1, y0), map), share.x);
  let lower = mix(map_alpha(vec2i(x0, y1), map), map_alpha(vec2i(x1, y1), map), share.x);
  return mix(upper, lower, share.y);
}
